"""Points, directions and spots: what they keep, how they turn and grow with their scene."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from every_light import EVERY

import clshade
from clshade import DirectionalLight, PointLight, RectangleLight, SpotLight
from clshade.errors import InputError
from clshade.scene import look
from clshade.scene.adjust_camera import VIEWS, named_cameras, seen_by
from clshade.scene.contents import format_contents, scene_contents
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
