"""Lights: what they keep, how they turn and grow; environments: directions in the image, files, and the light of them."""

import os
import pickle

import numpy as np
import pytest
from every_light import EVERY
from PIL import Image

import clshade
from clshade import DirectionalLight, PointLight, RectangleLight, SpotLight, exr
from clshade.errors import InputError
from clshade.scene import look
from clshade.scene.adjust_camera import VIEWS, named_cameras, seen_by
from clshade.scene.contents import format_contents, scene_contents
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
from clshade.scene.lights import LIGHTS, PlacedLight
from clshade.scene.model import Mesh, Scene

LAMP = PointLight((1, 2, 3), (4, 5, 6), "inverse-square", 7)
SUN = DirectionalLight((0, -3, 4), 2 * np.ones(3))
BALL = PointLight((1, 2, 3), radius=0.25)
PANEL = RectangleLight((1, 2, 3), (0, 0, -2), (0, 0.5, 0), (4, 5, 6), "inverse-square", 7)
SPOT = SpotLight((1, 2, 3), (0, -1, 0), (1, 1, 1), 10, 20, "inverse-square", 9)
CAMERA = clshade.Camera.from_fov((0, 0, 9), (0, 0, 0), (0, 1, 0), 35.0, (40, 30))
MESH = Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]])


def test_what_is_kept():
    assert {type(light) for light in EVERY} == set(LIGHTS)
    for light in (LAMP, SUN, SPOT, BALL, PANEL, *EVERY):
        for name in ("position", "direction", "right", "up", "intensity"):
            values = getattr(light, name, None)
            assert values is None or (values.shape, values.dtype, values.flags.writeable) == ((3,), np.float64, False)
        assert repr(pickle.loads(pickle.dumps(light))) == repr(light)
    assert (LAMP.range, type(LAMP.range)) == (7.0, float)
    every = (PointLight((0, 0, 0)), LAMP, SUN, SPOT, BALL, PANEL)
    assert [light.is_plain for light in every] == [True, *[False] * 5]
    assert [light.has_size for light in every] == [*[False] * 4, True, True]
    assert PANEL.axis.tolist() == [1.0, 0.0, 0.0]
    for length in (1e-300, 1.0, 1e300):
        np.testing.assert_allclose(DirectionalLight(np.array([0, -3, 4]) * length).axis, [0, -0.6, 0.8], rtol=1e-15)


@pytest.mark.parametrize("light", EVERY, ids=lambda light: type(light).__name__)
def test_every_kind(light):
    """Whatever the kind: a turn and its opposite leave it as it is, and so do a scale and its inverse."""
    turn, center = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([1.0, 1, 1])
    assert repr(light.turned(center, turn).turned(center, turn.T)) == repr(light) != repr(light.turned(center, turn))
    assert repr(light.rescaled(4.0, 2.0).rescaled(0.25, -0.5)) == repr(light)
    assert light.facts()["kind"] in repr(light)
    if isinstance(light, PlacedLight) and light.axis is not None:
        assert np.linalg.norm(light.axis) == pytest.approx(1.0)
        assert np.all(light.profile(light.axis) >= light.profile(-light.axis))


def test_the_view_turns_positions_and_directions():
    """From the right the sun and the spot come from where they came from as seen from the front."""
    scene = Scene(Mesh(MESH.verts + [0, 0, 2], MESH.faces), CAMERA, (SUN, SPOT, LAMP, PANEL))
    cameras = named_cameras(scene, VIEWS)
    for name, place in {"front": (1, 2, 3), "back": (-1, 2, 1), "top": (1, 1, 0), "camera": (1, 2, 3)}.items():
        view = seen_by(scene, cameras[name])
        assert view.camera is cameras[name]
        np.testing.assert_allclose(view.lights[2].position, place, atol=1e-12)
    right = cameras["right"]
    sun, spot, lamp, panel = seen_by(scene, right).lights
    np.testing.assert_allclose(sun.direction, [4, -3, 0], atol=1e-12)
    np.testing.assert_allclose(spot.position, [1, 2, 1], atol=1e-12)
    np.testing.assert_allclose(spot.direction, [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(lamp.position, [1, 2, 1], atol=1e-12)
    np.testing.assert_allclose(panel.right, [-2, 0, 0], atol=1e-12)
    np.testing.assert_allclose(panel.up, [0, 0.5, 0], atol=1e-12)
    assert (spot.inner_cone, spot.outer_cone, lamp.range) == (10, 20, 7)
    assert seen_by(scene, right, fixed_lights=True).lights == scene.lights
    assert seen_by(scene, CAMERA.with_resolution((7, 5))).lights == scene.lights


def test_factors_and_growing_scenes():
    scene = Scene(MESH, CAMERA, (SUN, SPOT, LAMP))
    scaled = look.scaled_lights(scene, (0.5, 0, 2)).lights
    assert [light.intensity.tolist() for light in scaled] == [[1, 1, 1], [0, 0, 0], [8, 10, 12]]
    moved = LAMP.rescaled(10.0, 1.0)
    assert (moved.position.tolist(), moved.intensity.tolist(), moved.range) == ([11, 21, 31], [400, 500, 600], 70)
    assert repr(SUN.rescaled(10.0, 1.0)) == repr(SUN)
    assert BALL.rescaled(10.0, 1.0).radius == 2.5
    panel = PANEL.rescaled(10.0, 1.0)
    assert (panel.right.tolist(), panel.up.tolist(), panel.range) == ([0, 0, -20], [0, 5, 0], 70)
    spheres = look.sized_lights(Scene(MESH, CAMERA, (SUN, LAMP, PANEL)), 0.5).lights
    assert spheres[0] is SUN
    assert (spheres[1].radius, spheres[1].range) == (0.5, 7)
    assert spheres[2] is PANEL
    with pytest.raises(InputError, match=r"^--light-radius: the scene has no point lights"):
        look.sized_lights(Scene(MESH, CAMERA, [SUN]), 1.0, "--light-radius")


def test_what_inspect_says():
    contents = scene_contents(Scene(MESH, CAMERA, (SUN, SPOT, LAMP, BALL, PANEL), light_scale=0.25))
    assert contents["each_light"][0] == {"kind": "DirectionalLight", "direction": [0, -3, 4], "intensity": [2, 2, 2]}
    text = format_contents(contents)
    for words in ("DirectionalLight", "10 to 20", "times 0.25", "radius 0.25", "right 0 0 -2, up 0 0.5 0"):
        assert words in text
    assert "times" not in format_contents(scene_contents(Scene(MESH, CAMERA, (SUN,))))


# Environments

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
