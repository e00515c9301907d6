"""Frames of scenes after Khronos' glTF sample models: what each of them tests, by cells that pass or in closed form."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import khronos_cards as cards
import numpy as np
import pytest
from devices import rendered

from clshade.pipeline.features import OPTIONAL
from clshade.scene.camera import Camera
from clshade.scene.formats.load import load
from clshade.scene.lights import DirectionalLight
from clshade.scene.model import Light

HEADLIGHT = DirectionalLight((0, 0, -1), (1, 1, 1))
ASLANT = DirectionalLight((0.5, -0.6, -0.8), (1, 1, 1))


def inner(image: np.ndarray) -> np.ndarray:
    """Return the pixels of each cell but for a margin around it."""
    edge = math.ceil(0.15 * image.shape[2])
    return image[:, :, edge:-edge, edge:-edge]


@pytest.fixture
def drawn(tmp_path: Path, device) -> Callable[..., np.ndarray]:
    """Return a function that draws cells, (rows, columns, side, side, 3) float32. All kernels have every feature on, so that
    one program serves all."""

    def draw(write, columns, rows, *lights: Light, side: int = 15, ambient: float | None = None, **settings: bool):
        scene = load(write(tmp_path / "card.glb"))
        assert scene.ignored == ()
        at = (0.5 * (columns - 1), -0.5 * (rows - 1))
        size, resolution = (float(rows), float(columns)), (columns * side, rows * side)
        camera = Camera((*at, 5.0), (*at, 0.0), (0, 1, 0), 1.0, size, resolution, orthographic=True)
        around = scene.ambient if ambient is None else ambient
        scene = replace(scene, camera=camera, background=0.25, own_lights=True, lights=lights, ambient=around)
        rgb = rendered(scene, device=device, forced=OPTIONAL, **settings).rgb
        return rgb.reshape(rows, side, columns, side, 3).swapaxes(1, 2)

    return draw


def passing(cells: np.ndarray) -> np.ndarray:
    """Return whether each cell is green all over."""
    return (np.abs(cells - cards.GREEN) < 1e-5).all(axis=(2, 3, 4))


PASS_OR_FAIL = {  # what is written, columns and rows, and which of them
    "texture_settings": (cards.texture_settings, 4, 3, np.s_[:]),
    "alpha_modes": (cards.alpha_modes, 6, 3, np.s_[:2]),
    "multi_uv": (cards.multi_uv, 5, 1, np.s_[:, :2]),
}


@pytest.mark.sampled
@pytest.mark.parametrize("name", PASS_OR_FAIL)
def test_cells_pass_and_notice_wrong_settings(drawn, name):
    """In the file with wrong settings no cell passes: each is able to fail."""
    write, columns, rows, which = PASS_OR_FAIL[name]
    right, wrong = (passing(inner(drawn(w, columns, rows)))[which] for w in (write, partial(write, wrong=True)))
    assert right.all(), np.argwhere(~right).tolist()
    assert not wrong.any(), np.argwhere(wrong).tolist()


SHARES, STRENGTHS = np.array([[0.25], [0.5], [0.75]]), np.float32(cards.STRENGTHS)[:, None]
COLORS = {  # what is written, columns and rows, ambient light; a row, its cells, and their colors; the tolerance
    # Linear.
    "blending": (cards.alpha_modes, 6, 3, None, 2, np.s_[:3], [1.0, 0.0, 0.0] + SHARES * [-1.0, 1.0, 0.0], 1e-6),
    # Ambient light of 2 on white, times 1, 0.4 and 0.
    "occlusion": (cards.multi_uv, 5, 1, 2.0, 0, np.s_[2:], 2.0 * np.array([[1.0], [cards.OCCLUSION], [0.0]]), 1e-6),
    # Those of each type equal the factor below.
    "vertex colors": (cards.vertex_colors, 4, 2, None, 0, np.s_[:3], [cards.VERTEX_COLOR], 1e-6),
    "factors": (cards.vertex_colors, 4, 2, None, 1, np.s_[:3], [cards.VERTEX_COLOR], 1e-6),
    # Powers of two, far beyond white.
    "emission": (cards.emissive_strength, 6, 1, None, 0, np.s_[:], STRENGTHS * np.float32(cards.EMISSION), 0.0),
}


@pytest.mark.parametrize("case", COLORS.values(), ids=COLORS)
def test_cells_have_their_colors(drawn, case):
    write, columns, rows, ambient, row, which, expected, tolerance = case
    cells = inner(drawn(write, columns, rows, ambient=ambient))[row, which]
    expected = np.broadcast_to(np.asarray(expected)[:, None, None], cells.shape)
    np.testing.assert_allclose(cells, expected, rtol=tolerance, atol=tolerance)


def test_spheres_reflect_a_headlight_in_closed_form(drawn):
    """Where N = V = L, glTF's D is 1/(pi alpha^2), V is 1/4 and F is F0; a light of 1 is one of pi in its units. The pole
    of each sphere is the center of a pixel."""
    image = drawn(cards.metal_rough_spheres, 5, 3, HEADLIGHT, side=31, ambient=0.0)
    base, alpha = np.array(cards.METAL), np.array(cards.ROUGHNESS)[:, None] ** 2
    metals = base / (4.0 * alpha * alpha)
    dielectrics = 0.96 * base + 0.04 / (4.0 * alpha * alpha)
    np.testing.assert_allclose(image[:2, :, 15, 15], [metals, dielectrics], rtol=1e-5)
    np.testing.assert_allclose(image[2], image[0], rtol=1e-5, atol=1e-6)  # from textures


# A code of 8 bits is off by 1/510, a component of a normal by 1/255, the normal by 0.0055 at most. Diffuse light changes by
# as much; the highlight, F0/(4 alpha^2) = 0.16 high and alpha = 0.25 wide, by at most 1.3 times that; both under 0.013.
QUANTIZED = 0.013


@pytest.mark.parametrize("tangents", [False, True], ids=["computed", "from the file"])
def test_maps_shade_as_geometry_does(drawn, tangents):
    """Turned, mirrored and half mirrored coordinates. A wrong sign of a tangent changes cells by more than ten times the
    bound. Without shadows, whose terminator is softened by the faces, which lie otherwise below maps."""
    write = partial(cards.normal_tangent, tangents=tangents)
    image = drawn(write, 4, 4, ASLANT, side=cards.GRID, ambient=0.0, shadows=False)[:, :, 2:-2, 2:-2]
    geometry = image[0, 0]
    assert np.abs(geometry[:, ::-1] - geometry).max() > 20.0 * QUANTIZED
    assert np.abs(geometry[::-1] - geometry).max() > 20.0 * QUANTIZED
    assert np.abs(image - geometry).max() < QUANTIZED
