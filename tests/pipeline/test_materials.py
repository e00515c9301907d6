"""Sides, alpha tests and colors of vertices, in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from devices import rendered

from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, PointLight, Scene, Texture


@pytest.mark.long
def test_front_only_leaves_out_what_is_seen_from_behind(device):
    quad = Mesh(
        [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]], material=Material(sides="front")
    )
    for eye, covered in (([0, 0, 3], 1.0), ([0, 0, -3], 0.0)):
        camera = Camera(eye, [0, 0, 0], [0, 1, 0], 1.0, (0.2, 0.2), (8, 8))
        assert (rendered(Scene((quad,), camera), device=device).alpha == covered).all()


@pytest.mark.sampled
@pytest.mark.parametrize("alpha", [0.5, 0.3, 1.0])
def test_alpha_at_the_cutoff_is_seen(device, alpha):
    """Only alphas below the cutoff are discarded: a cutoff one float32 above the texture's alpha leaves nothing."""
    at = float(np.float32(alpha))
    image = np.concatenate([np.ones((3, 3, 3)), np.full((3, 3, 1), at)], axis=2)
    card = Mesh([[-1, -1, 0], [3, -1, 0], [-1, 3, 0]], [[0, 1, 2]], uvs=[[0, 0], [2, 0], [0, 2]])
    camera = Camera([0, 0, 3], [0, 0, 0], [0, 1, 0], 1.0, (0.2, 0.2), (8, 8))
    for cutoff, covered in ((at, 1.0), (float(np.nextafter(np.float32(at), np.float32(2.0))), 0.0)):
        mesh = replace(card, material=Material(texture=Texture(image), alpha_cutoff=cutoff))
        assert (rendered(Scene((mesh,), camera), device=device, shader="nolight").alpha == covered).all()


@pytest.mark.long
def test_two_sided_light_is_the_same_from_both_sides(device):
    quad = Mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])

    def seen(side: float, two_sided: bool) -> np.ndarray:
        camera = Camera([0, 0, 3 * side], [0, 0, 0], [0, 1, 0], 1.0, (0.2, 0.2), (9, 9))
        material = Material(0.0, 1.0, 0.0, two_sided=two_sided)
        scene = Scene((replace(quad, material=material),), camera, (PointLight([0, 0, 2 * side]),))
        return rendered(scene, device=device).rgb.copy()

    assert np.array_equal(seen(1.0, True), seen(-1.0, True)[:, ::-1])
    assert not seen(-1.0, False).any()


def test_vertex_colors_of_whole_numbers():
    """Unsigned integers are fractions of their type's maximum, as in textures; ones and zeros of a list are kept."""
    shares = np.array([[0, 51, 255], [255, 102, 0], [204, 255, 0]])
    for kind, factor in ((np.uint8, 1), (np.uint16, 257), (np.uint32, 16843009)):
        codes = (shares * factor).astype(kind)
        colors = Mesh(np.eye(3), [[0, 1, 2]], colors=codes).colors
        assert np.allclose(colors, shares / 255, rtol=1e-15)
        assert np.array_equal(Texture(codes[None]).image[0], np.float32(colors))
    for plain in ([[0, 1, 0], [1, 0, 2], [-1, 0, 0]], np.eye(3, dtype=bool), np.eye(3, dtype=np.int8)):
        assert np.array_equal(Mesh(np.eye(3), [[0, 1, 2]], colors=plain).colors, np.float64(plain))
