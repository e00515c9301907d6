"""Textures: nearest texels, far coordinates, coordinates by planes, levels of detail, mipmaps, and maps of shader pbr."""

import gc
import tracemalloc
import weakref
from dataclasses import replace
from typing import Any

import layer_scenes
import mpmath
import numpy as np
import oracle_asserts
import pytest
from devices import rendered, skip_unsupported
from kernel_stages import Probe
from mapped_scenes import mapped, mapped_scene, sheet
from mapped_scenes import noise as texels

import clshade
from clshade import Camera, Material, Mesh, PointLight, Renderer, Scene, Settings, Texture, oracle
from clshade.errors import InputError
from clshade.measure.stability.cases import lit
from clshade.oracle import texture as reference
from clshade.pipeline import struct_layout
from clshade.pipeline.features import ignored
from clshade.pipeline.frame import Frame, same_bits
from clshade.pipeline.shading_tables import BAND, levels_below, smaller_levels, texture_tables
from clshade.scene.material import MAPS

UVS = np.array([[0.0, 1], [1, 1], [1, 0], [0, 0]])


def noise(columns: int, rows: int, channels: int = 3) -> np.ndarray:
    """Return independent random texels, so that a wrong level shows in the color."""
    return np.random.default_rng(3).uniform(0, 1, (rows, columns, channels)).astype(np.float32)


def square(image: np.ndarray, uvs: np.ndarray = UVS, pixels: int = 36, **material) -> Scene:
    """Return a square that fills the image, lit by nothing."""
    texture = Texture(image, filter="nearest", wrap=material.pop("wrap", "repeat"))
    camera = Camera((0, 0, 3), (0, 0, 0), (0, 1, 0), 3.0, (2.0, 2.0), (pixels, pixels))
    return Scene(layer_scenes.square(uvs=uvs, material=Material(texture=texture, **material)), camera, background=None)


def test_pixel_centers_on_edges_are_gates(device):
    """Every pixel lies on the edge of a texel: either texel is right, and the oracle says so."""
    scene = square(noise(8, 8), UVS + 0.5 / 8, pixels=8)
    settings = Settings(shader="nolight")
    expected = oracle.render(scene, settings)
    colors = clshade.render(scene, settings=settings, device=device).rgb
    assert (np.abs(colors - expected.rgb) <= expected.jump + 1e-6).all()
    assert (expected.jump.max(axis=2) > 0.0).all()


@pytest.mark.parametrize(("fields", "words"), [({"filter": "best"}, "linear"), ({"lookup": "course"}, "filter")])
def test_other_filters_are_refused(fields, words):
    with pytest.raises(InputError, match=words):
        Texture(np.ones((2, 2, 3)), **{"filter": "nearest", **fields})


def test_at_vertices_it_is_not_shown_and_said():
    names = ignored(square(noise(2, 2)), Settings(texture_at="vertex"))
    assert names == ("the filter nearest of textures that are looked up at vertices",)


def test_colors_of_whole_numbers():
    """Of vertices and of textures: unsigned integers are fractions of their type's maximum; others are kept."""
    shares = np.array([[0, 51, 255], [255, 102, 0], [204, 255, 0]])
    for kind, factor in ((np.uint8, 1), (np.uint16, 257), (np.uint32, 16843009)):
        codes = (shares * factor).astype(kind)
        colors = Mesh(np.eye(3), [[0, 1, 2]], colors=codes).colors
        assert np.allclose(colors, shares / 255, rtol=1e-15)
        assert np.array_equal(Texture(codes[None]).image[0], np.float32(colors))
    for plain in ([[0, 1, 0], [1, 0, 2], [-1, 0, 0]], np.eye(3, dtype=bool), np.eye(3, dtype=np.int8)):
        assert np.array_equal(Mesh(np.eye(3), [[0, 1, 2]], colors=plain).colors, np.float64(plain))


@pytest.mark.parametrize("exponent", [24, 26, 32, 39])
@pytest.mark.parametrize("wrap", ["repeat", "mirror"])
def test_as_far_as_coordinates_go(device, exponent, wrap):
    """From 2^24 on float32 has no fractions: only the low parts hold them. At 2^39 they are accurate to 2^-9."""
    material = Material(texture=Texture(np.random.default_rng(5).random((8, 4, 3)), wrap))
    verts, faces = np.random.default_rng(1).uniform(-1, 1, (36, 3)), np.arange(36).reshape(-1, 3)
    uvs = np.random.default_rng(2).uniform(-1, 1, (36, 2)) * 2.0**exponent
    camera = Camera.from_fov((0, 0, 3), (0, 0, 0), (0, 1, 0), 45, (61, 47))
    scene = Scene(Mesh(verts, faces, uvs=uvs, material=material), camera)
    report = clshade.check(rendered(scene, device=device, shader="nolight", layers=("Z", "id", "uv", "albedo")), "all")
    assert report.passed
    assert report.error < 2.0 ** (exponent - 44)


def flat_scene(pixels: np.ndarray, z: np.ndarray, uvs: np.ndarray, size: int, focal: float, **material: Any) -> Scene:
    """Return lit triangles with these corners (3F, 2) in an image of size x size pixels, and depths (3F,)."""
    matrix = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1.0]])
    camera = Camera.from_matrix(matrix, np.eye(4), (size, size))
    verts = np.column_stack([(pixels - size / 2) / focal * z[:, None], z])
    mesh = Mesh(verts, np.arange(len(z)).reshape(-1, 3), uvs=uvs, material=Material(**material))
    return Scene(mesh, camera, lights=PointLight((0, 0, 0), (1, 1, 1)))


def cells(size: int, side: float, corners: list[tuple[int, int]]) -> np.ndarray:
    """Return the corners of each cell (K, 6, 2) of an image, in pixels."""
    x, y = np.meshgrid(*[np.arange(0, size - 1, side)] * 2)
    return np.stack([x, y], axis=-1).reshape(-1, 1, 2) + side * np.array(corners)


def patches(side: float, size: int = 256, focal: float = 300.0) -> Scene:
    """Return triangles of `side` pixels on a wavy sheet, with a noisy texture: from some tiles their corners are farther
    than edge functions of 31 bits allow, from others not."""
    pixels = cells(size, side, [(0, 0), (1, 0), (0, 1), (1, 0), (1, 1), (0, 1)]).reshape(-1, 2)
    z = 2.0 + 0.3 * np.sin(pixels[:, 0] * 0.013) + 0.2 * np.cos(pixels[:, 1] * 0.017)
    texture = Texture(np.random.default_rng(1).random((2048, 2048, 3)).astype(np.float32))
    return flat_scene(pixels, z, pixels / size * [0.97, 0.93] + [0.013, 0.021], size, focal, texture=texture)


@pytest.mark.long
@pytest.mark.parametrize("options", [{"lanes": 4}, {"forced": {"MIPMAPS"}}, {"forced": {"SORTED"}}], ids=str)
def test_the_choice_depends_on_triangle_and_tile_alone(device, options):
    """Work-items take tiles in another order each time; lanes and features that are not needed change nothing."""
    scene = patches(75.0)
    with Renderer(scene, device=device) as renderer:
        expected = renderer.render()
        assert all(same_bits(renderer.render(), expected) for _ in range(12))
    assert same_bits(rendered(scene, device=device, **options), expected)


@pytest.mark.long
def test_coefficients_just_below_a_power_of_two_keep_their_digits(device):
    """A coordinate of -1 at a tile's corner: the plane's first coefficient is next to -2^23 units, and its values beyond."""
    size, rng = 512, np.random.default_rng(3)
    corners = [(0, 1), (1, 1), (1, 0), (0, 1), (1, 0), (0, 0)]
    pixels = cells(size, 16, corners)
    slopes, least = rng.uniform(1e-4, 5e-4, (len(pixels), 1, 2)), rng.uniform(0, 1.5e-6, (len(pixels), 1))
    u = least - 1.0 + (slopes * ([15.5, -0.5] + [-16, 16] * np.array(corners))).sum(axis=-1)
    uvs = np.stack([u, np.full_like(u, 0.5)], axis=-1).reshape(-1, 2)
    texture = Texture(rng.random((4, 8192, 3)).astype(np.float32))
    scene = flat_scene(pixels.reshape(-1, 2), np.ones(u.size), uvs, size, 256.0, texture=texture, ks=0.0)
    assert clshade.check(clshade.render(scene, device=device), pixels=size * size).bounds < 2.0


@pytest.mark.sampled
@pytest.mark.parametrize("side", [5.0, 1.3, 17.0, 40.0])
def test_small_and_large_triangles_are_within_the_bound(device, side):
    assert clshade.check(clshade.render(patches(side, size=128), device=device), pixels=128 * 128).bounds < 4.0


# Trilinear


UNIT = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def draw(device, scene: Scene, **options: Any) -> Frame:
    arguments = {"shader": "nolight", "texture_filter": "trilinear", "layers": ("Z", "id"), **options}
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
DETAIL = {np.float32: 4 * 2.0**-24, np.float64: 4 * 2.0**-53}


def details(device, slopes: np.ndarray, real: type = np.float32) -> np.ndarray:
    """Return level and fraction (K, 2) for slopes (K, 4): u and v to the right, u and v up."""
    table, _ = texture_tables([Texture(noise(*SIZE))], mipmaps=True)
    probe, columns = Probe(device, TEXT, MIPMAPS=1, DOUBLE=int(real is np.float64)), slopes.T.astype(real, "C")
    return probe("detail", *columns, table, width=2, dtype=real)


@pytest.mark.sampled
@pytest.mark.parametrize("real", DETAIL)
def test_level_of_detail(device, real):
    skip_unsupported(device, {"precision": real.__name__})
    rng = np.random.default_rng(1)
    slopes = np.exp2(rng.uniform(-9, 3, (20_000, 1))) * rng.normal(size=(20_000, 4))
    slopes = slopes.astype(real).astype(np.float64)
    levels = details(device, slopes, real).astype(np.float64)
    expected = reference.level_of_detail(slopes[:, :2], slopes[:, 2:], SIZE, LAST)
    assert np.unique(levels[:, 0]).tolist() == list(range(LAST + 1))
    assert ((levels[:, 1] >= 0.0) & (levels[:, 1] <= 1.0)).all()
    assert np.abs(levels.sum(axis=1) - expected).max() <= DETAIL[real] + 4 * 2.0**-53
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


# Whole frames


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
        assert oracle_asserts.assert_drawn(frame).bounds < 12.5


# Closed forms

ABOVE = Camera((0, 0, 5.0), (0, 0, 0), (0, 1, 0), 1.0, (2.0, 2.0), (16, 16), orthographic=True)


def aligned(image: np.ndarray, repeats: float = 1.0) -> Scene:
    """Return a square that fills the image of 16 x 16 pixels."""
    return Scene(layer_scenes.square(uvs=repeats * UNIT, material=Material(texture=Texture(image))), ABOVE)


@pytest.mark.sampled
@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_a_power_of_two_texels_a_pixel_gives_that_level(device, level):
    """Bit for bit, with the level's texels at the pixels' centers."""
    image = noise(16 << level, 16 << level)
    expected = [image, *smaller_levels(image)][level]
    frame = draw(device, aligned(image))
    assert np.array_equal(frame.rgb, expected[::-1])  # v goes up
    assert np.array_equal(oracle.render(frame.scene, frame.settings).rgb, expected[::-1])


def test_magnified_is_bilinear_bit_for_bit(device):
    """At least a pixel per texel, up to exactly one."""
    scenes = [aligned(noise(16, 16)), aligned(noise(5, 3)), aligned(noise(16, 8), 0.5)]
    mesh = lit.patch(uvs=None)
    mesh = replace(mesh, uvs=0.2 * mesh.verts[:, :2], material=Material(texture=Texture(noise(37, 53))))
    for scene in (*scenes, lit.scene_of(replace(mesh, colors=None))):
        frames = [draw(device, scene, texture_filter=name) for name in ("bilinear", "trilinear")]
        assert "MIPMAPS" in frames[1].stats["features"]
        assert same_bits(*frames)


@pytest.mark.sampled
@pytest.mark.parametrize("real", DETAIL)
def test_a_texel_a_pixel_is_bilinear_whatever_rounding_makes_of_the_one(device, real):
    """Slopes of one texel, up to a few roundings either way: level 0, and nothing of the next."""
    off = 1.0 + DETAIL[real] / 4.0 * np.arange(-6.0, 7.0)
    slopes = np.stack([off / SIZE[0], 0.0 * off, 0.0 * off, off[::-1] / SIZE[1]], axis=1)
    assert (details(device, slopes, real) == 0.0).all()
    slopes[:, 0] *= 1.0 + 2.0**-16  # exceeds rounding
    assert (details(device, slopes, real)[:, 1] > 0.0).all()


def test_it_needs_lookups_at_pixels():
    with pytest.raises(InputError, match="texture_filter: expected bilinear with texture_at vertex"):
        Settings.from_preset("course", texture_filter="trilinear")
    assert Settings.from_preset("course", texture_filter="trilinear", texture_at="pixel").texture_filter == "trilinear"


# Maps of shader pbr


def with_maps(mesh: Mesh, **changes: Any) -> Mesh:
    return replace(mesh, material=replace(mesh.material, pbr=mapped(**changes)))


def test_maps_that_are_looked_up_alike_agree_with_the_oracle(device):
    """Of the size and the wrap modes of the normal map, which share its lookup; and of its size alone."""
    names = "metallic_roughness_texture", "emission_texture"
    shared = {name: Texture(texels(8, 11, seed)) for seed, name in enumerate(names)}
    scene = mapped_scene(with_maps(sheet(), **shared, occlusion_texture=Texture(texels(8, 11, 7), wrap="clamp")))
    oracle_asserts.assert_all(rendered(scene, device=device, shader="pbr", layers=("Z", "id", "N")))
    facets = scene.meshes[0].material.pbr
    alike = texture_tables([getattr(facets, name) for name in list(MAPS)[:4]])[0]["alike"]
    assert alike.tolist() == [0, 0, 2, 0]  # all but the map of occlusion
    others = {"wrap": "mirror", "filter": "nearest", "coordinates": 1, "image": texels(11, 8), "lookup": "course"}
    alone = [replace(facets.normal_texture, **{name: value}) for name, value in others.items()]
    assert texture_tables([facets.normal_texture, *alone])[0]["alike"].tolist() == list(range(6))


@pytest.mark.long
def test_a_flat_map_changes_no_bit(device):
    """Its texels are exactly (1/2, 1/2, 1)."""
    plain: dict[str, Any] = dict.fromkeys(("occlusion_texture", "emission_texture", "metallic_roughness_texture"))
    flat = with_maps(sheet(), **plain, normal_texture=Texture(np.full((2, 2, 3), [0.5, 0.5, 1.0])))
    bare = with_maps(sheet(), **plain, normal_texture=None)
    assert same_bits(*(clshade.render(mapped_scene(mesh), shader="pbr", device=device) for mesh in (flat, bare)))


# Mipmap levels: of the host, of the oracle, and in the tables that the kernels read


SIZES = ((1, 1), (1, 5), (7, 1), (2, 2), (3, 3), (16, 9), (37, 53), (64, 64), (96, 80))  # columns, rows


@pytest.mark.parametrize("size", SIZES)
def test_levels_of_any_size(size):
    """Sizes are halved and rounded down (OpenGL 4.6, section 8.14.3). Host and oracle compute the same means in float64:
    rounded they are equal but for ties, which random texels do not have; 8-bit values do, but their sums are exact. Each
    texel is weighted by its area, so that no size loses or doubles a row; a constant stays the same to the last bit."""
    image = noise(*size)
    shapes = [level.shape[1::-1] for level in smaller_levels(image)]
    assert shapes == [tuple(max(extent >> k, 1) for extent in size) for k in range(1, max(size).bit_length())]
    for shades in (image, np.rint(image * 255).astype(np.float32) / 255):
        first, *expected = reference.levels(shades)
        assert np.array_equal(first, shades)
        for mipmap, level in zip(smaller_levels(shades), expected, strict=True):
            assert np.array_equal(mipmap, level)
            mean, of_image = (a.mean(axis=(0, 1), dtype=np.float64) for a in (mipmap, shades))
            assert np.abs(mean - of_image).max() < 2.0**-24
    color = np.float32([0.1, 1 / 3, 3.4e38])
    for shape in (size[::-1], (1, 32767)):
        assert all((level == color).all() for level in smaller_levels(np.broadcast_to(color, (*shape, 3))))


def test_odd_sizes_weigh_by_area():
    """Of five rows, the first new one covers two and a half; of three rows, the only one covers all."""
    rows = np.float32([1, 10, 100, 1000, 10000]).reshape(5, 1, 1)
    first, second = smaller_levels(rows)
    assert first[:, 0, 0] == pytest.approx([(1 + 10 + 50) / 2.5, (50 + 1000 + 10000) / 2.5])
    assert second[0, 0, 0] == pytest.approx(11111 / 5)
    assert smaller_levels(np.float32([1, 2, 6]).reshape(1, 3, 1))[0].item() == 3.0


@pytest.mark.parametrize("size", [(BAND // 6 - 1, 12), (901, 701)])
def test_bands_of_rows_change_no_bit(monkeypatch, size):
    """One row per band, or all; and images that need several bands by default."""
    image = noise(*size)
    levels = smaller_levels(image)
    for band in (1, 1 << 40):
        monkeypatch.setattr("clshade.pipeline.shading_tables.BAND", band)
        for level, same in zip(levels, smaller_levels(image), strict=True):
            assert level.tobytes() == same.tobytes()


def test_a_large_image_takes_little_memory():
    """Relative to the float32 image: the first level in float64 1/2, all in float32 1/3, the next in float64 1/8 while
    it is computed; and a few bands."""
    image = np.ones((2047, 2047, 3), np.float32)
    tracemalloc.start()
    try:
        smaller_levels(image)
        assert tracemalloc.get_traced_memory()[1] < 1.0 * image.nbytes + 4 * 8 * BAND
    finally:
        tracemalloc.stop()


def test_levels_are_kept_as_long_as_their_texture():
    texture = Texture(noise(16, 9, 4))
    levels = levels_below(texture)
    assert levels_below(texture) is levels
    assert levels_below(Texture(texture.image)) is not levels
    assert [level.shape[2] for level in levels] == [3] * 4
    kept = weakref.ref(levels[0])
    del texture, levels
    gc.collect()
    assert kept() is None


def test_levels_lie_behind_their_texture():
    """Each texture's own texels come first, with its alpha; levels are opaque, and exist only for the standard
    lookup."""
    textures = [Texture(noise(5, 4, 4)), Texture(noise(6, 3), lookup="course"), Texture(noise(16, 9))]
    table, texels = texture_tables(textures, mipmaps=True)
    assert table["levels"].tolist() == [3, 1, 5]
    end = 0
    for row, chosen in zip(table, textures, strict=True):
        for number, level in enumerate([chosen.image, *smaller_levels(chosen.image[..., :3])][: row["levels"]]):
            count = level.shape[0] * level.shape[1]
            assert row["offset"][number] == end
            stored = texels[end : end + count]
            assert np.array_equal(stored[:, :3], level[..., :3].reshape(count, 3))
            assert np.array_equal(stored[:, 3], level[..., 3].ravel() if level.shape[2] == 4 else np.ones(count))
            end += count
    assert len(texels) == end
    plain, plain_texels = texture_tables(textures)
    assert plain["levels"].tolist() == [1, 1, 1]
    assert len(plain_texels) == sum(chosen.image[..., 0].size for chosen in textures)
    # The largest texture has room for all its levels.
    table, texels = texture_tables([Texture(np.ones((1, 32768, 3), np.float32))], mipmaps=True)
    assert table["levels"][0] == struct_layout.MOST_LEVELS
    assert len(texels) == 65535
