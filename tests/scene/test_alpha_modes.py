"""A glTF file after Khronos' AlphaBlendModeTest: a row of panels whose alpha falls from bottom to top, one of each mode."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mesh_writers import Gltf, png

from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.formats.load import load
from clshade.scene.material import Material
from clshade.scene.model import Mesh

MODES = [
    {"alphaMode": "OPAQUE"},
    {"alphaMode": "BLEND"},
    {"alphaMode": "MASK", "alphaCutoff": 0.25},
    {"alphaMode": "MASK"},
    {"alphaMode": "MASK", "alphaCutoff": 0.75},
]
SIZE = 24  # pixels of a panel
CAMERA = Camera([5, 1, 10], [5, 1, 0], [0, 1, 0], 10.0, (2.4, 12.0), (6 * SIZE, SIZE * 6 // 5))
FACES = np.array([0, 1, 2, 0, 2, 3], np.uint16)


def panel(left: float, right: float, z: float) -> np.ndarray:
    return np.array([[left, 0, z], [right, 0, z], [right, 2, z], [left, 2, z]], np.float32)


def alpha_modes(path) -> str:
    """Write five panels of 2 x 2 before a bar of gray at half height. Vertex alphas go on from 1 to 0.5."""
    document = Gltf()
    rows = np.linspace(0, 255, 256).astype(np.uint8)[:, None]  # row 0, v = 0, is the top
    pixels = np.dstack([np.full_like(rows, code) for code in (80, 160, 255)] + [rows])
    document.add("images", {"bufferView": document.view(png(pixels)), "mimeType": "image/png"})
    document.add("samplers", {"wrapS": 33071, "wrapT": 33071})
    document.add("textures", {"source": 0, "sampler": 0})
    uvs = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    for number, mode in enumerate(MODES):
        unlit = {"extensions": {"KHR_materials_unlit": {}}, "doubleSided": True}
        document.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, **unlit, **mode})
        corners = panel(2.0 * number + 0.1, 2.0 * number + 1.9, 1.0)
        document.mesh({"POSITION": corners, "TEXCOORD_0": uvs}, FACES, material=number)
    wall = document.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 0.2]}, **unlit})
    bar = panel(0, 10, 0.0) * np.float32([1, 0.5, 1])
    document.mesh({"POSITION": bar}, FACES, material=wall)
    return document.glb(path)


def test_panels_show_their_alpha(tmp_path, device):
    scene = load(alpha_modes(tmp_path / "modes.glb"))
    assert scene.ignored == ()
    with Renderer(scene, shader="nolight", device=device) as renderer:
        frame = renderer.render(camera=CAMERA)
    middles = SIZE // 2 + SIZE // 2 + np.arange(5) * SIZE
    top = frame.alpha.shape[0] // 2 - SIZE // 2
    columns = frame.alpha[top : top + SIZE // 2, middles]  # above the bar
    heights = 0.5 * (np.arange(SIZE // 2) + 0.5) / (SIZE // 2)  # of alpha
    assert (columns[:, 0] == 1.0).all()
    np.testing.assert_allclose(columns[1:-1, 1], heights[1:-1], atol=0.07)  # the panels are nearer than the bar
    assert (np.diff(columns[1:-1, 1]) > 0.0).all()
    for k, cutoff in ((2, 0.25), (3, 0.5), (4, 0.75)):
        sure = np.abs(heights - cutoff) > 0.08
        np.testing.assert_array_equal(columns[sure, k], (heights > cutoff)[sure])
    below = frame.rgb[top + SIZE // 2 + 4, middles]
    alpha = 0.5 + 0.5 * 4.5 / (SIZE // 2)
    np.testing.assert_allclose(below[1], alpha * below[0] + (1.0 - alpha) * 0.5, atol=0.05)
    assert (frame.alpha[top + SIZE // 2 + 4, middles] == 1.0).all()


@pytest.mark.parametrize("cutoff", [None, 0.0, -1.0])
def test_a_cutoff_of_0_discards_nothing(cutoff):
    """No alpha is below it, but rounding may make an interpolated one -1e-9."""
    colors = np.ones((3, 4)) * [1.0, 1.0, 1.0, 0.0]
    mesh = Mesh(np.eye(3), [[0, 1, 2]], colors=colors, material=Material(alpha_cutoff=cutoff))
    assert not mesh.tests_alpha
    assert replace(mesh, material=Material(alpha_cutoff=1e-9)).tests_alpha
