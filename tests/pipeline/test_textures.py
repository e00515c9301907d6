"""Textures: nearest texels, coordinates far outside the image, and coordinates by planes."""

from __future__ import annotations

import numpy as np
import pytest
from devices import rendered
from kernel_stages import OTHER_LANES, Probe

import clshade
from clshade import Camera, Material, Mesh, PointLight, Renderer, Scene, Texture
from clshade.errors import InputError
from clshade.oracle import frame as oracle
from clshade.oracle import texture as reference
from clshade.pipeline.frame import Frame
from clshade.pipeline.frame_results import Check
from clshade.pipeline.opencl.device import Device
from clshade.scene.settings import Settings
from clshade.scene.texture import WRAPS, Wrap

CORNERS = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
QUAD = [[0, 1, 2], [0, 2, 3]]
UVS = np.array([[0.0, 1], [1, 1], [1, 0], [0, 0]])


def noise(columns: int, rows: int, channels: int = 3) -> np.ndarray:
    return np.random.default_rng(3).uniform(0, 1, (rows, columns, channels)).astype(np.float32)


def square(image: np.ndarray, uvs: np.ndarray = UVS, pixels: int = 36, **material) -> Scene:
    """Return a square that fills the image, lit by nothing."""
    texture = Texture(image, filter="nearest", wrap=material.pop("wrap", "repeat"))
    camera = Camera((0, 0, 3), (0, 0, 0), (0, 1, 0), 3.0, (2.0, 2.0), (pixels, pixels))
    return Scene(Mesh(CORNERS, QUAD, uvs=uvs, material=Material(texture=texture, **material)), camera, background=None)


@pytest.mark.long
def test_texels_are_squares(device):
    image = noise(4, 3)
    frame = clshade.render(square(image, pixels=36), shader="nolight", device=device)
    assert np.array_equal(frame.rgb, np.kron(image, np.ones((12, 9, 1), np.float32)))


@pytest.mark.long
def test_alpha_is_that_of_the_nearest_texel(device):
    image = noise(4, 4, 4)
    image[..., 3] = np.arange(16).reshape(4, 4) % 3 / 2
    frame = clshade.render(square(image, alpha_cutoff=0.5), shader="nolight", device=device)
    assert np.array_equal(frame.alpha, np.kron(image[..., 3] >= 0.5, np.ones((9, 9), np.float32)))


def test_pixel_centers_on_edges_are_gates(device):
    """Every pixel lies on the edge of a texel: either texel is right, and the oracle says so."""
    scene = square(noise(8, 8), UVS + 0.5 / 8, pixels=8)
    settings = Settings(shader="nolight")
    expected = oracle.render(scene, settings)
    colors = clshade.render(scene, settings=settings, device=device).rgb
    assert (np.abs(colors - expected.rgb) <= expected.jump + 1e-6).all()
    assert (expected.jump.max(axis=2) > 0.0).all()


TEXEL = """
#include "texture.clh"
kernel void texels(global const REAL *high, global const REAL *low, global const int *size, global const int *wrap,
                   global REAL *out)
{
    int i = get_global_id(0) * LANES;
    double_single u = {LOAD_LANES(high + i), LOAD_LANES(low + i)};
    Span span = texels_along(wrapped(u, wrap[i], LOOKUP_STANDARD), (ints)(size[i]), wrap[i], LOOKUP_STANDARD, 1);
    integer first[LANES], second[LANES];
    STORE_LANES(span.first, first);
    STORE_LANES(span.second, second);
    for (int k = 0; k < LANES; ++k)
        out[i + k] = first[k] == second[k] ? first[k] : -1;
}
"""


@pytest.mark.sampled
@pytest.mark.parametrize("lanes", [None, *OTHER_LANES])
def test_the_kernel_finds_the_texel(device, lanes):
    rng = np.random.default_rng(2)
    count = 16 * 500
    high = np.concatenate(
        [
            rng.integers(0, 2**32, count // 2, np.uint32).view(np.float32),
            rng.integers(-64, 65, count // 2).astype(np.float32) / 16 + np.float32(2.0**-18),  # not on an edge
        ]
    )
    low = np.zeros(count, np.float32)
    size, wrap = (np.repeat(rng.choice(a, count // 16), 16).astype(np.int32) for a in ([1, 3, 16, 32768], range(3)))
    indices = Probe(device, TEXEL, lanes=lanes, NEAREST=1)("texels", high, low, size, wrap)
    assert ((indices >= 0) & (indices < size)).all()
    exact = np.s_[count // 2 :]
    for number, name in enumerate(WRAPS):
        for texels in (1, 3, 16, 32768):
            mine = np.flatnonzero((wrap[exact] == number) & (size[exact] == texels)) + count // 2
            expected = reference.neighbors(high[mine].astype(np.float64), texels, "nearest", name)[0]
            assert np.array_equal(indices[mine], expected)


@pytest.mark.parametrize(("fields", "words"), [({"filter": "best"}, "linear"), ({"lookup": "course"}, "filter")])
def test_other_filters_are_refused(fields, words):
    with pytest.raises(InputError, match=words):
        Texture(np.ones((2, 2, 3)), **{"filter": "nearest", **fields})


@pytest.mark.long
def test_at_vertices_it_is_not_shown_and_said():
    scene = square(noise(2, 2))
    frame = clshade.render(scene, texture_at="vertex", shader="nolight", resolution=(4, 4))
    assert "the filter nearest of textures that are looked up at vertices" in frame.stats["ignored"]


FAR_CAMERA = Camera.from_fov((0, 0, 3), (0, 0, 0), (0, 1, 0), 45, (61, 47))


def far(reach: float) -> np.ndarray:
    """Return random coordinates (12, 3, 2) from -reach to reach."""
    return np.random.default_rng(2).uniform(-reach, reach, (12, 3, 2))


def report_of(device: Device, uvs: np.ndarray, shape: tuple[int, int], wrap: Wrap) -> Check:
    """Check an image of large white triangles with coordinates uvs (F, 3, 2)."""
    material = Material(texture=Texture(np.random.default_rng(5).random((*shape, 3)), wrap))
    verts, faces = np.random.default_rng(1).uniform(-1, 1, (uvs.size // 2, 3)), np.arange(uvs.size // 2).reshape(-1, 3)
    scene = Scene(Mesh(verts, faces, uvs=uvs.reshape(-1, 2), material=material), FAR_CAMERA)
    frame = rendered(scene, device=device, shader="nolight", layers=("Z", "id", "uv", "albedo"))
    return clshade.check(frame, "all")


@pytest.mark.parametrize("wrap", ["repeat", "mirror"])
def test_as_far_as_coordinates_go(device, wrap):
    """From 2^24 on float32 has no fractions: only the low parts hold them. At 2^39 they are accurate to 2^-9."""
    for exponent in (24, 26, 32, 39):
        report = report_of(device, far(2.0**exponent), (8, 4), wrap)
        assert report.passed
        assert report.error < 2.0 ** (exponent - 44)


def test_the_bound_knows_how_far_coordinates_reach(device):
    """It is 32 up to 2^21 texels; larger errors come from coordinates, which have only 48 bits."""
    for shape, reach, allowed in (((8, 8), 2.0**18, 32.0), ((8, 8), 2.0**22, 47.0), ((4, 1024), 2.0**20, 543.0)):
        uvs = far(reach)
        uvs[0, 0] = reach
        report = report_of(device, uvs, shape, "repeat")
        assert report.passed
        assert report.allowed == allowed
        assert (report.bounds > 32.0) == (allowed > 500.0)


def flat_camera(size: int, focal: float) -> Camera:
    matrix = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1.0]])
    return Camera.from_matrix(matrix, np.eye(4), (size, size))


def patches(side: float, size: int = 256, focal: float = 300.0) -> Scene:
    """Return triangles of `side` pixels on a wavy sheet, with a noisy texture: from some tiles their corners are farther
    than edge functions of 31 bits allow, from others not."""
    verts, uvs = [], []
    for y in np.arange(0, size - 1, side):
        for x in np.arange(0, size - 1, side):
            for a, b in ((0, 0), (1, 0), (0, 1), (1, 0), (1, 1), (0, 1)):
                px, py = x + a * side, y + b * side
                z = 2.0 + 0.3 * np.sin(px * 0.013) + 0.2 * np.cos(py * 0.017)
                verts.append(((px - size / 2) / focal * z, (py - size / 2) / focal * z, z))
                uvs.append((px / size * 0.97 + 0.013, py / size * 0.93 + 0.021))
    texture = Texture(np.random.default_rng(1).random((2048, 2048, 3)).astype(np.float32))
    faces = np.arange(len(verts)).reshape(-1, 3)
    mesh = Mesh(np.array(verts), faces, uvs=np.array(uvs), material=Material(texture=texture))
    return Scene((mesh,), flat_camera(size, focal), lights=(PointLight((0, 0, 0), (1, 1, 1)),))


def bits(frame: Frame) -> np.ndarray:
    return frame.rgba.view(np.uint32).copy()


@pytest.mark.long
@pytest.mark.parametrize(
    "options",
    [{"lanes": 4}, {"forced": {"MIPMAPS"}}, {"forced": {"SORTED"}}],
    ids=str,
)
def test_the_choice_depends_on_triangle_and_tile_alone(device, options):
    """Work-items take tiles in another order each time; lanes and features that are not needed change nothing."""
    scene = patches(75.0)
    with Renderer(scene, device=device) as renderer:
        expected = bits(renderer.render())
        for _ in range(12):
            assert np.array_equal(bits(renderer.render()), expected)
    assert np.array_equal(bits(rendered(scene, device=device, **options)), expected)


@pytest.mark.long
def test_coefficients_just_below_a_power_of_two_keep_their_digits(device):
    """A coordinate of -1 at a tile's corner: the plane's first coefficient is next to -2^23 units, and its values beyond."""
    size, rng = 512, np.random.default_rng(3)
    verts, uvs = [], []
    for row in range(size // 16):
        for column in range(size // 16):
            across, up = rng.uniform(1e-4, 5e-4, 2)
            corner_u = -(1.0 - rng.uniform(0, 1.5e-6))
            left, top = 16 * column, size - 16 * row
            for x, y in ((0, 0), (16, 0), (16, -16), (0, 0), (16, -16), (0, -16)):
                verts.append(((left + x - size / 2) / 256, (top + y - size / 2) / 256, 1.0))
                uvs.append((corner_u + across * (15.5 - x) + up * (15.5 + y), 0.5))
    texture = Texture(rng.random((4, 8192, 3)).astype(np.float32))
    faces = np.arange(len(verts)).reshape(-1, 3)
    mesh = Mesh(np.array(verts), faces, uvs=np.array(uvs), material=Material(texture=texture, ks=0.0))
    scene = Scene((mesh,), flat_camera(size, 256.0), lights=(PointLight((0, 0, 0), (1, 1, 1)),))
    assert clshade.check(clshade.render(scene, device=device), pixels=size * size).bounds < 2.0


@pytest.mark.sampled
@pytest.mark.parametrize("side", [1.3, 5.0, 17.0, 40.0])
def test_small_and_large_triangles_are_within_the_bound(device, side):
    frame = clshade.render(patches(side, size=128), device=device)
    assert clshade.check(frame, pixels=128 * 128).bounds < 4.0
