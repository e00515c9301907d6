"""Texture images of every type, drawn by `render_object_map`: colors and positions."""

from __future__ import annotations

import course_reference as reference
import numpy as np
import pytest

from clshade import course

pytestmark = pytest.mark.usefixtures("on_each_device")


def textured_quad(texture_map, **changes) -> np.ndarray:
    """Draw the unlit quad with (u, v) = (0, 0) at its top left corner, as in course files."""
    arguments = reference.quad_arguments(shader="nolight", M=18, N=18, **changes)
    del arguments["verts_colors"]
    uvs = np.array([[0, 1, 1, 0], [1, 1, 0, 0.0]])
    return course.render_object_map(**arguments, uvs=uvs, uvs_faces=arguments["faces"], texture_map=texture_map)


TEXELS = np.array([[[200, 10, 20], [30, 210, 40]], [[50, 60, 220], [250, 90, 150]]], np.uint8)


def test_integer_textures_are_divided_by_their_maximum():
    as_bytes = textured_quad(TEXELS)
    assert np.allclose(as_bytes, textured_quad(TEXELS / 255.0), atol=1e-6)
    assert np.allclose(as_bytes, textured_quad(TEXELS.astype(np.uint16) * 257), atol=1e-6)
    assert textured_quad(TEXELS.astype(np.float64)).max() > 200.0


@pytest.mark.long
def test_a_texture_replaces_the_color_and_lies_as_it_should():
    """Gouraud under a far light: ka*Ia + Ip*kd*texel at the corners, whose texels are those of the image."""
    texture_map = np.zeros((5, 7, 3))
    texture_map[0, 0] = [1, 0, 0]
    image = textured_quad(texture_map)
    square = image[5:13, 5:13]
    brightest = np.unravel_index(square[:, :, 0].argmax(), (8, 8))
    assert brightest == (7, 0)
    assert square[:, :, 1:].max() == 0.0
    lit = reference.quad_arguments(shader="gouraud", M=18, N=18)
    del lit["verts_colors"]
    uvs = np.array([[0, 1, 1, 0], [1, 1, 0, 0.0]])
    lit_image = course.render_object_map(**lit, uvs=uvs, uvs_faces=lit["faces"], texture_map=texture_map)
    ambient = np.array([0.1, 0.2, 0.3])
    assert np.allclose(lit_image[5:13, 5:13], ambient + 0.5 * np.array([1, 0.5, 4]) * square, rtol=1e-5)
