"""Trilinear textures (texture_filter): the level of detail, and frames in closed form."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest
from devices import rendered
from kernel_stages import OTHER_LANES, Probe
from oracle_asserts import assert_drawn

from clshade import oracle
from clshade.errors import InputError
from clshade.measure.stability.cases import lit
from clshade.oracle import texture as reference
from clshade.pipeline.frame import Frame, same_bits
from clshade.pipeline.opencl.device import Device
from clshade.pipeline.shading_tables import smaller_levels, texture_tables
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scene, Settings, Texture

LAYERS = ("Z", "id")
QUAD = [[0, 1, 2], [0, 2, 3]]
CORNERS = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
UNIT = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def noise(columns: int, rows: int, seed: int = 1) -> np.ndarray:
    """Return independent random texels, so that a wrong level shows in the color."""
    return np.random.default_rng(seed).uniform(0, 1, (rows, columns, 3)).astype(np.float32)


def draw(device: Device, scene: Scene, **options: Any) -> Frame:
    arguments = {"shader": "nolight", "texture_filter": "trilinear", "layers": LAYERS, **options}
    return rendered(scene, device=device, **arguments)


# The level of detail

TEXT = """
#include "texture.clh"
#define IN(name) LOAD_LANES(name + i)
kernel void detail(global const REAL *a, global const REAL *b, global const REAL *c, global const REAL *d,
                   global const Texture *texture, global REAL *out)
{
    int i = get_global_id(0) * LANES;
    Slopes slopes = {IN(a), IN(b), IN(c), IN(d)};
    Detail found = detail_of(slopes, texture);
    integer level[LANES];
    REAL fraction[LANES];
    STORE_LANES(found.level, level);
    STORE_LANES(found.fraction, fraction);
    for (int k = 0; k < LANES; ++k) {
        out[2 * (i + k)] = level[k];
        out[2 * (i + k) + 1] = fraction[k];
    }
}
"""
SIZE = (48, 20)  # columns and rows: levels 0 to 5
LAST = 5
# rho^2: a product per side, 2 roundings of its square; their sum, 1: 3 of 2^-53 or 2^-24, which are 3/(2 ln 2) = 2.2 in
# lambda. The logarithm, at most 3/2 before it is halved, is within 1 rounding, and a sum of 1 may be rounded once more:
# 3.7 in total.
DETAIL = {"float32": 4 * 2.0**-24, "float64": 4 * 2.0**-53}


def details(device: Device, slopes: np.ndarray, precision: str = "float32", lanes: int | None = None) -> np.ndarray:
    """Return level and fraction (K, 2) for slopes (K, 4): u and v to the right, u and v up."""
    features = {"DOUBLE": int(precision == "float64")}
    probe = Probe(device, TEXT, MIPMAPS=1, lanes=lanes, **features)
    kind = np.float64 if precision == "float64" else np.float32
    table, _ = texture_tables([Texture(noise(*SIZE))], mipmaps=True)
    columns = [np.ascontiguousarray(column, kind) for column in slopes.T]
    return probe("detail", *columns, table, width=2, dtype=kind)


@pytest.mark.sampled
@pytest.mark.parametrize("precision", DETAIL)
def test_level_of_detail(device, precision):
    rng = np.random.default_rng(1)
    slopes = np.exp2(rng.uniform(-9, 3, (20_000, 1))) * rng.normal(size=(20_000, 4))
    slopes = slopes if precision == "float64" else slopes.astype(np.float32).astype(np.float64)
    levels = details(device, slopes, precision).astype(np.float64)
    expected = reference.level_of_detail(slopes[:, :2], slopes[:, 2:], SIZE, LAST)
    assert len(np.unique(levels[:, 0])) == LAST + 1
    assert np.isin(levels[:, 0], np.arange(LAST + 1)).all()
    assert (levels[:, 1] >= 0.0).all()
    assert (levels[:, 1] <= 1.0).all()
    assert np.abs(levels.sum(axis=1) - expected).max() <= DETAIL[precision] + 4 * 2.0**-53
    assert (levels[expected == 0.0] == 0.0).all()
    assert (levels[expected == LAST] == [LAST, 0.0]).all()


def test_the_oracles_level_of_detail_is_the_specifications():
    mpmath.mp.dps = 30
    for a, b, c, d in np.random.default_rng(2).normal(size=(50, 4)):
        rho = max(mpmath.hypot(a * 48, b * 20), mpmath.hypot(c * 48, d * 20))
        level = reference.level_of_detail(np.array([a, b]), np.array([c, d]), SIZE, LAST)
        assert float(level) == pytest.approx(float(min(max(mpmath.log(rho, 2), 0), LAST)), abs=1e-15)


def test_whole_levels_are_exact(device):
    """A power of two texels per pixel, in any of the four slopes: that level, and nothing of the next."""
    for k in range(LAST + 3):
        step = np.diag([2.0**k / side for side in (*SIZE, *SIZE)])[[0, 2]]  # 20 rows: 1/20 is not a float32
        assert details(device, step).tolist() == [[min(k, LAST), 0.0]] * 2


def test_undefined_and_endless_slopes(device):
    """NaN, infinity and 1e30 select the last level; 0 and values whose squares underflow level 0. So in the oracle."""
    for value, level in ((np.nan, LAST), (np.inf, LAST), (1e30, LAST), (-1e30, LAST), (0.0, 0), (1e-30, 0)):
        for count in (1, 4):  # the last ones of the four
            slopes = np.zeros((1, 4))
            slopes[:, -count:] = value
            assert details(device, slopes).tolist() == [[level, 0.0]]
            assert reference.level_of_detail(slopes[:, :2], slopes[:, 2:], SIZE, LAST).tolist() == [level]


@pytest.mark.parametrize("lanes", OTHER_LANES)
def test_lanes_do_not_change_a_bit_of_the_level(device, lanes):
    slopes = np.exp2(np.random.default_rng(3).uniform(-9, 3, (999, 4)))
    assert np.array_equal(details(device, slopes), details(device, slopes, lanes=lanes))


# Whole frames


def cards(image: np.ndarray, wrap: Any = "repeat", **fields: Any) -> Scene:
    """Return white triangles of all sizes around the origin, with between a texel and the whole texture per pixel."""
    rng = np.random.default_rng(5)
    uvs = rng.uniform(-1, 2, (250, 1, 2)) + np.exp2(rng.uniform(-6, 2, (250, 1, 1))) * rng.normal(size=(250, 3, 2))
    mesh = lit.blob(uvs=uvs.reshape(-1, 2), material=Material(texture=Texture(image, wrap), n=5.0))
    return lit.scene_of(replace(mesh, colors=None), **fields)


def floor(repeats: float, image: np.ndarray, resolution: tuple[int, int] = (61, 61), far: float = 300.0) -> Scene:
    """Return a floor from behind the eye to far away, with `repeats` textures per side, seen slightly askew."""
    corners = np.array([[-far, -1.0, 4.0], [far, -1, 4], [far, -1, 4 - 2 * far], [-far, -1, 4 - 2 * far]])
    mesh = Mesh(corners, QUAD, uvs=repeats * UNIT, material=Material(texture=Texture(image)))
    camera = Camera((0, 0, 3.0), (0.1, -0.1, 0), (0.02, 1, 0), 1.0, (1.0, resolution[0] / resolution[1]), resolution)
    return Scene((mesh,), camera)


@pytest.mark.long
def test_long_thin_triangles(device):
    """Strips with aspect ratios up to 6000 and an undistorted texture: in their slopes all but one part in 6000
    cancels.

    Slopes in plain float32 give 490 bounds, in double-single 1.3. Allowed are the roundings after double-single: a
    slope's two parts, the division, the product and the texels, 5, twice in the square, and 2 there: 12/(2 ln 2) = 8.7
    in lambda, with the logarithm's 1.5 10.2 times the levels' difference, at most 1; and 2 of the mean.
    """
    turn = np.array([[0.8, 0.6], [-0.6, 0.8]])
    for count in (40, 4000):
        across = np.linspace(-1.5, 1.5, count + 1)
        ends = np.concatenate([np.stack([across, np.full(count + 1, side)], axis=1) for side in (-2.0, 2.0)])
        flat = ends @ turn
        verts = np.concatenate([flat, 0.3 * flat[:, :1]], axis=1)
        i = np.arange(count)
        faces = np.concatenate([np.stack([i, i + 1, i + count + 2], 1), np.stack([i, i + count + 2, i + count + 1], 1)])
        mesh = Mesh(verts, faces, uvs=0.7 * flat, material=Material(texture=Texture(noise(256, 256))))
        frame = draw(device, Scene((mesh,), lit.CAMERA))
        assert frame.alpha.mean() > 0.3
        assert assert_drawn(frame).bounds < 12.5


# Closed forms

ABOVE = Camera((0, 0, 5.0), (0, 0, 0), (0, 1, 0), 1.0, (2.0, 2.0), (16, 16), orthographic=True)


def aligned(image: np.ndarray, repeats: float = 1.0) -> Scene:
    """Return a square that fills the image of 16 x 16 pixels."""
    return Scene((Mesh(CORNERS, QUAD, uvs=repeats * UNIT, material=Material(texture=Texture(image))),), ABOVE)


@pytest.mark.sampled
@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_a_power_of_two_texels_a_pixel_gives_that_level(device, level):
    """Bit for bit, with the level's texels at the pixels' centers."""
    image = noise(16 << level, 16 << level)
    expected = [image, *smaller_levels(image)][level]
    frame = draw(device, aligned(image))
    assert np.array_equal(frame.rgb, expected[::-1])  # v goes up
    assert np.array_equal(oracle.render(frame.scene, frame.settings).rgb, expected[::-1])


def test_the_larger_of_the_two_directions_decides(device):
    """1 texel per pixel horizontally and 4 vertically: level 2 in both directions."""
    image = noise(16, 64)
    frame = draw(device, aligned(image))
    level = smaller_levels(image)[1]  # 4 x 16 texels
    columns = reference.bilerp(np.stack(np.meshgrid((np.arange(16) + 0.5) / 16, (np.arange(16) + 0.5) / 16), -1), level)
    # The error of the kernels' mean of four, as in test_kernel_bilerp.
    assert np.abs(frame.rgb - columns[::-1]).max() <= 8 * 2.0**-24


@pytest.mark.long
def test_between_two_levels_the_share_is_the_logarithm(device):
    """3 texels per pixel of a checkerboard, whose levels all average to 1 from the first on."""
    image = np.zeros((48, 48, 3), np.float32)
    image[::2, ::2] = image[1::2, 1::2] = 2.0  # a checkerboard of 0 and 2: all higher levels are 1
    frame = draw(device, aligned(image))
    fine, share = frame.rgb[..., 0], np.log2(3.0) - 1.0
    assert np.abs(fine - 1.0).max() <= 2.0**-24  # lambda 1.58 lies between levels of 1
    near = replace(frame.scene, camera=replace(ABOVE, resolution=(40, 40)))
    trilinear = draw(device, near).rgb[..., 0].astype(np.float64)
    share = np.log2(48 / 40)
    bilinear = draw(device, near, texture_filter="bilinear").rgb[..., 0].astype(np.float64)
    assert np.abs(trilinear - (bilinear + share * (1.0 - bilinear))).max() <= 16 * 2.0**-24


def test_magnified_is_bilinear_bit_for_bit(device):
    """At least a pixel per texel, up to exactly one."""
    scenes = [aligned(noise(16, 16)), aligned(noise(5, 3)), aligned(noise(16, 8), 0.5)]
    mesh = lit.patch(uvs=None)
    mesh = replace(mesh, uvs=0.2 * mesh.verts[:, :2], material=Material(texture=Texture(noise(37, 53))))
    for scene in (*scenes, lit.scene_of(replace(mesh, colors=None))):
        frames = [draw(device, scene, texture_filter=name) for name in ("bilinear", "trilinear")]
        assert "MIPMAPS" in frames[1].stats["features"]
        assert same_bits(*frames)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_texel_a_pixel_is_bilinear_whatever_rounding_makes_of_the_one(device, precision):
    """Slopes of one texel, up to a few roundings either way: level 0, and nothing of the next."""
    off = 1.0 + (2.0**-53 if precision == "float64" else 2.0**-24) * np.arange(-6.0, 7.0)
    slopes = np.stack([off / SIZE[0], 0.0 * off, 0.0 * off, off[::-1] / SIZE[1]], axis=1)
    assert (details(device, slopes, precision) == 0.0).all()
    slopes[:, 0] *= 1.0 + 2.0**-16  # exceeds rounding
    assert (details(device, slopes, precision)[:, 1] > 0.0).all()


def test_a_constant_texture_gives_the_constant(device):
    color = np.float32([0.1, 1 / 3, 0.7])
    for scene in (cards(np.tile(color, (53, 37, 1))), floor(600.0, np.tile(color, (5, 7, 1)))):
        frame = draw(device, scene)
        assert (frame.rgb[frame.alpha > 0] == color).all()


# Where it does not apply


def test_it_needs_lookups_at_pixels():
    expected = "texture_filter: expected bilinear with texture_at vertex"
    with pytest.raises(InputError, match=expected):
        Settings(texture_filter="trilinear", texture_at="vertex")
    with pytest.raises(InputError, match=expected):
        Settings.from_preset("course", texture_filter="trilinear")
    with pytest.raises(InputError, match="texture_filter: expected one of bilinear, trilinear, found 'nearest'"):
        Settings(texture_filter="nearest")
    assert Settings.from_preset("course", texture_filter="trilinear", texture_at="pixel").texture_filter == "trilinear"
