"""Texture images of every type, drawn by `render_object_map`: colors and positions."""

from __future__ import annotations

import warnings

import course_reference as reference
import numpy as np
import pytest
from PIL import Image
from scene_files import png16

from clshade import course
from clshade.images.decode import read_image

pytestmark = pytest.mark.usefixtures("on_each_device")


def textured_quad(texture_map, **changes) -> np.ndarray:
    """Draw the unlit quad with (u, v) = (0, 0) at its top left corner, as in course files."""
    arguments = reference.quad_arguments(shader="nolight", M=18, N=18, **changes)
    del arguments["verts_colors"]
    uvs = np.array([[0, 1, 1, 0], [1, 1, 0, 0.0]])
    return course.render_object_map(**arguments, uvs=uvs, uvs_faces=arguments["faces"], texture_map=texture_map)


TEXELS = np.array([[[200, 10, 20], [30, 210, 40]], [[50, 60, 220], [250, 90, 150]]], np.uint8)


@pytest.mark.parametrize("kind", ["RGB", "RGBA", "L", "P", "16", "16 grey"])
def test_texture_images(tmp_path, kind):
    """Texel (0, 0) is top left, (0, 1) top right, and red stays red, for every file type."""
    path = tmp_path / "texture.png"
    expected = TEXELS / 255.0
    if kind == "16":
        path.write_bytes(png16(TEXELS.astype(np.uint16) * 257))
    elif kind == "16 grey":
        path.write_bytes(png16(TEXELS[:, :, :1].astype(np.uint16) * 257))
        expected = np.repeat(expected[:, :, :1], 3, axis=2)
    else:
        image = Image.fromarray(TEXELS)
        if kind == "L":
            expected = np.repeat(np.asarray(image.convert("L"))[:, :, None], 3, axis=2) / 255.0
        image = image.quantize(4) if kind == "P" else image.convert(kind)
        if kind == "RGBA":
            image.putalpha(77)
        image.save(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about the ignored alpha
        texture_map = read_image(path, srgb=False)
    assert np.allclose(course.bilerp([0, 0], texture_map), expected[0, 0], atol=1e-6)
    found = textured_quad(texture_map)
    half = 18 / 4
    for row, column, y, x in ((-1, 0, 0, 0), (-1, -1, 0, 1), (0, 0, 1, 0), (0, -1, 1, 1)):
        inside = found[5:13, 5:13][row, column]
        # The pixel is half a pixel (of a quad of 9) inside the corner: a mean of the corners by affine weights.
        assert np.abs(inside - expected[y, x]).max() < 1.5 / half
        assert inside.argmax() == expected[y, x].argmax()


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
    found = textured_quad(texture_map)
    square = found[5:13, 5:13]
    brightest = np.unravel_index(square[:, :, 0].argmax(), (8, 8))
    assert brightest == (7, 0)
    assert square[:, :, 1:].max() == 0.0
    lit = reference.quad_arguments(shader="gouraud", M=18, N=18)
    del lit["verts_colors"]
    uvs = np.array([[0, 1, 1, 0], [1, 1, 0, 0.0]])
    lit_image = course.render_object_map(**lit, uvs=uvs, uvs_faces=lit["faces"], texture_map=texture_map)
    ambient = np.array([0.1, 0.2, 0.3])
    assert np.allclose(lit_image[5:13, 5:13], ambient + 0.5 * np.array([1, 0.5, 4]) * square, rtol=1e-5)
