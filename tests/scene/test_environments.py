"""Environments: what is accepted, where directions lie in the image, files, and the light that is made of them."""

from __future__ import annotations

import os

import numpy as np
import pytest
from PIL import Image

import clshade
from clshade import exr
from clshade.errors import InputError
from clshade.scene.environment import Environment, nearest_axis
from clshade.scene.image_light import (
    bilinear,
    brdf_table,
    irradiance_coefficients,
    lobe,
    moments,
    radiance,
    sharp_map,
    solid_angles,
    specular_levels,
    split_sum,
    texel_directions,
    texel_indices,
    with_border,
)

RNG = np.random.default_rng(5)


def irradiance(environment: Environment, n: np.ndarray) -> np.ndarray:
    x, y, z = n
    return np.array([x, y, z, x * x, y * y, z * z, x * y, y * z, z * x]) @ irradiance_coefficients(environment)


@pytest.mark.parametrize(
    ("direction", "row", "column"),
    [((0, 1, 0), 0, None), ((0, -1, 0), 7, None), ((0, 0.1, 1), 3, 8), ((1, 0.1, 0), 3, 4), ((-1, 0.1, 0), 3, 12)],
)
def test_the_center_is_plus_z_and_plus_x_lies_to_its_left(direction, row, column):
    image = np.zeros((8, 17, 3))  # an odd number of columns: the middle one is the center
    image[row, slice(None) if column is None else column] = 1.0
    assert radiance(Environment(image), np.array(direction, float))[0] == 1.0


def test_rotation_turns_counterclockwise_seen_from_above():
    image = np.zeros((3, 9, 3))
    image[1, 4] = 1.0  # the center: +z
    turned = Environment(image, rotation=90.0)
    assert radiance(turned, np.array([1.0, 0.0, 0.0]))[0] == 1.0
    np.testing.assert_allclose(turned.axes, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-15)


@pytest.mark.parametrize("up", [(0, 0, 2), (1, 0, 0), (0, -1, 0), (0, 0, -1), (0.3, -0.5, 0.2), (1e-7, -1, 0)])
def test_another_up_turns_the_whole(up):
    axes = Environment(np.ones((1, 1, 3)), up=up).axes
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes[[1, 2, 0]]), 1.0)  # left, up, front: as x, y, z
    np.testing.assert_allclose(axes[2], np.array(up) / np.linalg.norm(up), atol=1e-15)
    if up == (0, 0, 2):
        np.testing.assert_allclose(axes[0], [0, -1, 0], atol=1e-15)
    assert nearest_axis(np.array([0.1, -0.9, 0.2])) == (0.0, -1.0, 0.0)


def test_exr_and_png(tmp_path):
    image = RNG.random((4, 8, 3)).astype(np.float32) * 9
    exr.write(tmp_path / "e.exr", image)
    np.testing.assert_array_equal(clshade.load_environment(tmp_path / "e.exr").image, image)
    Image.fromarray(np.full((2, 4, 3), 188, np.uint8)).save(tmp_path / "e.png")
    png = clshade.load_environment(tmp_path / "e.png", rotation=5)
    np.testing.assert_allclose(png.image, ((188 / 255 + 0.055) / 1.055) ** 2.4, rtol=1e-6)  # IEC 61966-2-1
    assert png.rotation == 5
    assert png.name.endswith("e.png")


def test_pixels_that_are_no_radiance_are_replaced_with_a_warning(tmp_path):
    """Half floats know no 1e30: the largest other pixel of the file takes the place of infinity."""
    image = np.ones((2, 3, 3), np.float32)
    image[0, 1, 1], image[1, 2], image[1, 1] = -3.0, np.inf, 7.0
    exr.write(tmp_path / "half.exr", image, half=True)
    image[0, 0] = np.nan
    exr.write(tmp_path / "e.exr", image)
    with pytest.warns(UserWarning, match="1 pixel that is beyond 1e30"):
        half = clshade.load_environment(tmp_path / "half.exr").image
    with pytest.warns(UserWarning, match="1 pixel that is NaN") as caught:
        pixels = clshade.load_environment(tmp_path / "e.exr").image
    assert len(caught) == 1
    np.testing.assert_array_equal(pixels[0, 0], 0.0)
    np.testing.assert_array_equal(pixels[0, 1], [1, 0, 1])
    np.testing.assert_array_equal(pixels[1, 2], 7.0)
    np.testing.assert_array_equal(half[1], pixels[1])


def test_an_image_of_another_shape_is_stretched_with_a_warning(tmp_path):
    exr.write(tmp_path / "e.exr", np.ones((6, 6, 3), np.float32))
    with pytest.warns(UserWarning, match=r"e\.exr: image: expected one twice as wide as high, found 6 x 6"):
        assert clshade.load_environment(tmp_path / "e.exr").image.shape == (6, 6, 3)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.txt").write_text("no image")
    exr.write(tmp_path / "z.exr", {"Z": np.ones((2, 2), np.float32)})
    os.mkfifo(tmp_path / "pipe.hdr")
    for name, message in {
        "a.txt": "file: expected ",
        "z.exr": "channels: expected ",
        "none.exr": "file: expected an existing file, found no such file",
        "pipe.hdr": "file: expected a regular file, found a device",
    }.items():
        with pytest.raises(InputError, match=f"{name}: {message}"):
            clshade.load_environment(tmp_path / name)


@pytest.mark.parametrize("shape", [(1, 1), (3, 7), (40, 90)])
def test_a_constant_environment_stays_constant(shape):
    environment = Environment(np.full((*shape, 3), 0.75), rotation=33, up=(0.2, 1, 0.4))
    for n in texel_directions(4).reshape(-1, 3):
        np.testing.assert_allclose(irradiance(environment, n), 0.75, rtol=1e-12)
    for level in specular_levels(environment):
        np.testing.assert_allclose(level, 0.75, rtol=1e-12)


def test_a_sun_of_one_pixel_keeps_its_energy():
    image = RNG.random((37, 91, 3))
    image[5, 80] = 1e6
    environment = Environment(image, rotation=30, up=(0.3, 1, 0.2))
    true = (environment.image * solid_angles(37, 91)[:, None, None]).sum(axis=(0, 1), dtype=np.float64)
    values, solid = sharp_map(environment)
    np.testing.assert_allclose((values * solid[..., None]).sum(axis=(0, 1)), true, rtol=1e-12)
    np.testing.assert_allclose(moments(environment)[0], true, rtol=1e-12)


def test_moments_against_quadrature():
    environment = Environment(RNG.random((5, 9, 3)), rotation=70, up=(1, 1, 0))
    side = 256
    d = texel_directions(side).reshape(-1, 3)
    # The solid angle of an area dA of the octahedron's projection is dA / |q|^3 with q on the octahedron.
    q = d / np.abs(d).sum(axis=1, keepdims=True)
    solid = (2 / side) ** 2 / np.linalg.norm(q, axis=1) ** 3
    light = radiance(environment, d) * solid[:, None]
    zeroth, first, second = moments(environment)
    np.testing.assert_allclose(zeroth, light.sum(axis=0), rtol=2e-3)
    np.testing.assert_allclose(first, light.T @ d, atol=5e-3)
    np.testing.assert_allclose(second, np.einsum("nc,nk,nl->ckl", light, d, d), atol=5e-3)


def test_irradiance_of_a_uniform_upper_half():
    environment = Environment([[[1.0] * 3], [[0.0] * 3]])
    # The true values are 1, 1/2 and 0; orders 0 and 1 are exact, and all even orders beyond 0 vanish here.
    for n, expected in (((0, 1, 0), 1.0), ((1, 0, 0), 0.5), ((0, -1, 0), 0.0)):
        np.testing.assert_allclose(irradiance(environment, np.array(n, float)), expected, atol=1e-12)


def test_octahedral_maps_are_continuous_beyond_their_edges():
    for side in (16, 64):
        d = texel_directions(side)
        np.testing.assert_array_equal(texel_indices(d, side).reshape(-1), np.arange(side * side))
        np.testing.assert_allclose(bilinear(d, d), d, atol=1e-12)
        wide = with_border(d, 5)
        assert max(np.abs(np.diff(wide, axis=axis)).max() for axis in (0, 1)) < 4.0 / side


def test_blurred_levels_against_sums_over_all_pixels():
    rows, columns = 128, 256
    image = (np.random.default_rng(2).random((8, 16, 3)) ** 4).repeat(16, 0).repeat(16, 1)
    v = (np.arange(rows) + 0.5) * np.pi / rows
    u = np.pi - (np.arange(columns) + 0.5) * 2 * np.pi / columns
    around = np.sin(v)[:, None] * np.sin(u), np.cos(v)[:, None], np.sin(v)[:, None] * np.cos(u)
    d = np.stack(np.broadcast_arrays(*around), axis=-1)
    for number, level in enumerate(specular_levels(Environment(image))[1:], 1):
        directions, alpha = texel_directions(len(level)), (number / 8) ** 2
        for at in ((3, 5), (10, 2), (-1, -1), (len(level) // 2, 7)):
            weight = lobe((1 - d @ directions[at]) / 2, alpha) * np.sin(v)[:, None]
            expected = (weight[..., None] * image).sum(axis=(0, 1)) / weight.sum()
            # Half the height of level 1's lobe is a pixel and a half wide, so that the sum itself is rough.
            np.testing.assert_allclose(level[at], expected, atol=0.06 if number == 1 else 0.015)


def test_the_split_sum_of_a_mirror_and_of_schlick():
    n_v = np.array([0.1, 0.5, 1.0])
    a, b, _ = split_sum(n_v, 0.0)
    np.testing.assert_allclose(a, 1 - (1 - n_v) ** 5, rtol=1e-12)
    np.testing.assert_allclose(b, (1 - n_v) ** 5, atol=1e-12)
    table = brdf_table()
    assert (table >= 0).all()
    assert (table[..., 0] + table[..., 1] <= 1 + 2e-3).all()
