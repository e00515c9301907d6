"""Textures with the filter nearest: closed forms, whole frames against the oracle, and texels at edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import oracle_asserts
import pytest
from devices import rendered
from kernel_stages import OTHER_LANES, Probe

import clshade
from clshade import Camera, Material, Mesh, PointLight, Scene, Texture
from clshade.errors import InputError
from clshade.oracle import frame as oracle
from clshade.oracle import texture as reference
from clshade.pipeline.frame import same_bits
from clshade.scene.model import Settings
from clshade.scene.texture import WRAPS

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


def tilted(wrap: str = "repeat") -> Scene:
    """Return three lit squares, one behind the other, seen askew, with up to 16 texels per pixel."""
    scene = square(noise(48, 37), UVS * 3.7 - 1.2, wrap=wrap)
    mesh = scene.meshes[0]
    meshes = [replace(mesh, verts=CORNERS * [1.0, 1.0, 1.0] + [0.3 * k, 0.2 * k, -0.5 * k]) for k in range(3)]
    camera = Camera((1.6, 0.9, 1.2), (0.2, 0.1, -0.2), (0, 1, 0), 3.0, (3.0, 3.0), (57, 43))
    return Scene(meshes, camera, PointLight((1, 2, 4)), background=0.2)


def assert_equals_oracle(scene: Scene, device, gate_fraction: float = 0.01, **options) -> None:
    settings = Settings(layers=("Z", "id"), **options)
    frame = rendered(scene, settings=settings, device=device)
    oracle_asserts.assert_drawn(frame, gate_fraction=gate_fraction)
    assert len(np.unique(frame.rgb)) > 100


@pytest.mark.long
def test_texels_are_squares(device):
    image = noise(4, 3)
    frame = clshade.render(square(image, pixels=36), shader="nolight", device=device)
    assert np.array_equal(frame.rgb, np.kron(image, np.ones((12, 9, 1), np.float32)))


@pytest.mark.sampled
@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_frames_agree_with_the_oracle(device, wrap, precision):
    assert_equals_oracle(tilted(wrap), device, precision=precision)


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({"texture_filter": "trilinear"}, marks=pytest.mark.long),
        pytest.param({"shader": "gouraud"}, marks=pytest.mark.long),
        pytest.param({"samples": 4}, marks=pytest.mark.long),
    ],
    ids=str,
)
def test_other_settings_agree_with_the_oracle(device, options):
    assert_equals_oracle(tilted("mirror"), device, **options)


@pytest.mark.long
def test_alpha_is_that_of_the_nearest_texel(device):
    image = noise(4, 4, 4)
    image[..., 3] = np.arange(16).reshape(4, 4) % 3 / 2
    frame = clshade.render(square(image, alpha_cutoff=0.5), shader="nolight", device=device)
    assert np.array_equal(frame.alpha, np.kron(image[..., 3] >= 0.5, np.ones((9, 9), np.float32)))


def test_forced_on_it_changes_no_bit(device):
    scene = square(noise(5, 6, 4), UVS * 2.3)
    linear = replace(scene.meshes[0].material, texture=replace(scene.meshes[0].material.texture, filter="linear"))
    scene = replace(scene, meshes=replace(scene.meshes[0], material=linear))
    lean = clshade.render(scene, shader="nolight", device=device)
    assert same_bits(lean, rendered(scene, shader="nolight", device=device, forced={"NEAREST"}))
    assert "NEAREST" in lean.stats["left_out"]


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
