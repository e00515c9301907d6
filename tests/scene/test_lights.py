"""Points, directions and spots: what they keep, what they refuse, how they turn and grow with their scene."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from every_light import EVERY

import clshade
from clshade import DirectionalLight, PointLight, RectangleLight, Settings, SpotLight
from clshade.errors import InputError
from clshade.scene import look
from clshade.scene.adjust_camera import named_cameras, seen_by
from clshade.scene.contents import format_contents, scene_contents
from clshade.scene.lights import LIGHTS, PlacedLight, plain_lights
from clshade.scene.model import Mesh, Scene

LAMP = PointLight((1, 2, 3), (4, 5, 6), "inverse-square", 7)
SUN = DirectionalLight((0, -3, 4), 2 * np.ones(3))
BALL = PointLight((1, 2, 3), radius=0.25)
PANEL = RectangleLight((1, 2, 3), (0, 0, -2), (0, 0.5, 0), (4, 5, 6), "inverse-square", 7)
SPOT = SpotLight((1, 2, 3), (0, -1, 0), (1, 1, 1), 10, 20, "inverse-square", 9)
CAMERA = clshade.Camera.from_fov((0, 0, 9), (0, 0, 0), (0, 1, 0), 35.0, (40, 30))
MESH = Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]])


def test_what_is_kept():
    for light in (LAMP, SUN, SPOT, BALL, PANEL, *EVERY):
        for name in ("position", "direction", "right", "up", "intensity"):
            if hasattr(light, name):
                values = getattr(light, name)
                assert (values.shape, values.dtype, values.flags.writeable) == ((3,), np.float64, False)
        copy = pickle.loads(pickle.dumps(light))
        assert repr(copy) == repr(light)
    assert (LAMP.range, type(LAMP.range)) == (7.0, float)
    plain = SpotLight((0, 0, 0), (0, 0, 1))
    assert (plain.inner_cone, plain.outer_cone, plain.attenuation, plain.range) == (0.0, 45.0, "none", None)
    every = (PointLight((0, 0, 0)), LAMP, SUN, SPOT, plain, BALL, PANEL)
    assert [light.is_plain for light in every] == [True, *[False] * 6]
    assert [light.has_size for light in every] == [*[False] * 5, True, True]
    assert PANEL.axis.tolist() == [1.0, 0.0, 0.0]


def test_their_texts():
    assert repr(PointLight((1, 2, 3))) == "<PointLight at 1 2 3, intensity 1 1 1>"
    assert repr(LAMP) == "<PointLight at 1 2 3, intensity 4 5 6, inverse-square up to 7>"
    assert repr(SUN) == "<DirectionalLight along 0 -3 4, intensity 2 2 2>"
    expected = "at 1 2 3, along 0 -1 0, cone 10 to 20 degrees, intensity 1 1 1, inverse-square up to 9"
    assert repr(BALL) == "<PointLight at 1 2 3, radius 0.25, intensity 1 1 1>"
    where = "at 1 2 3, right 0 0 -2, up 0 0.5 0"
    assert repr(PANEL) == f"<RectangleLight {where}, intensity 4 5 6, inverse-square up to 7>"
    assert repr(SPOT) == f"<SpotLight {expected}>"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PointLight((0, 0, np.nan)), "PointLight: position: expected three finite numbers"),
        (lambda: PointLight((0, 0, 0), (1, 1, 1e39)), "PointLight: intensity: expected numbers within float32"),
        (
            lambda: PointLight((0, 0, 0), (1, 1, 1), "linear"),
            "PointLight: attenuation: expected one of none, inverse-square",
        ),
        (lambda: PointLight((0, 0, 0), (1, 1, 1), "none", 3.0), "PointLight: range: expected None without attenuation"),
        (lambda: replace(LAMP, range=0.0), "PointLight: range: expected a finite number above 0"),
        (lambda: replace(LAMP, range=math.inf), "PointLight: range: expected a finite number above 0"),
        (lambda: DirectionalLight((0, 0, 0)), "DirectionalLight: direction: expected a vector other than 0"),
        (lambda: DirectionalLight((0, 1, np.inf)), "DirectionalLight: direction: expected three finite numbers"),
        (lambda: replace(SPOT, direction=(0, 0, 0)), "SpotLight: direction: expected a vector other than 0"),
        (lambda: replace(SPOT, inner_cone=-1), "SpotLight: inner_cone: expected degrees from 0 to 90"),
        (lambda: replace(SPOT, outer_cone=90.1), "SpotLight: outer_cone: expected degrees from 0 to 90"),
        (lambda: replace(BALL, radius=-1e-9), "PointLight: radius: expected a finite number of at least 0"),
        (lambda: replace(BALL, radius=np.nan), "PointLight: radius: expected a finite number of at least 0"),
        (lambda: replace(BALL, radius=math.inf), "PointLight: radius: expected a finite number of at least 0"),
        (lambda: replace(PANEL, right=(0, 0, 0)), "RectangleLight: right: expected a vector other than 0"),
        (lambda: replace(PANEL, up=(0, np.nan, 0)), "RectangleLight: up: expected three finite numbers"),
        (lambda: replace(PANEL, up=(0, 0, 3)), "RectangleLight: up: expected a vector that is not parallel to right"),
        (
            lambda: replace(PANEL, up=(0, 1e-9, 3)),
            "RectangleLight: up: expected a vector that is not parallel to right",
        ),
        (lambda: replace(PANEL, range=-1), "RectangleLight: range: expected a finite number above 0"),
        (lambda: Settings(light_samples=0), "Settings: light_samples: expected"),
        (lambda: Settings(light_samples=257), "Settings: light_samples: expected"),
        (lambda: Settings(light_samples=2.5), "Settings: light_samples: expected"),
        (lambda: plain_lights("bench", (BALL,)), "bench: lights: expected points without attenuation"),
        (
            lambda: look.sized_lights(Scene(MESH, CAMERA, [BALL]), -1.0, "--light-radius"),
            "scene: --light-radius: expected a finite number of at least 0",
        ),
        (
            lambda: look.sized_lights(Scene(MESH, CAMERA, [SUN]), 1.0, "--light-radius"),
            "--light-radius: the scene has no point lights",
        ),
        (
            lambda: replace(SPOT, inner_cone=30),
            "SpotLight: inner_cone: expected an angle of at most outer_cone, 20 degrees",
        ),
        (
            lambda: Scene(MESH, CAMERA, [SUN, 3]),
            "Scene: lights: expected a sequence of PointLight or DirectionalLight or",
        ),
        (
            lambda: plain_lights("bench", (PointLight((0, 0, 0)), SUN)),
            "bench: lights: expected points without attenuation",
        ),
    ],
)
def test_refusals(make, message):
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


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


def test_every_kind_has_an_example():
    assert {type(light) for light in EVERY} == set(LIGHTS)


@pytest.mark.parametrize("length", [1e-300, 1.0, 1e300])
def test_directions_of_any_length(length):
    np.testing.assert_allclose(DirectionalLight(np.array([0, -3, 4]) * length).axis, [0, -0.6, 0.8], rtol=1e-15)


def test_the_view_turns_positions_and_directions():
    """From the right the sun and the spot come from where they came from as seen from the front."""
    scene = Scene(MESH, CAMERA, (SUN, SPOT, LAMP, PANEL))
    right = named_cameras(scene, ("right",))["right"]
    sun, spot, lamp, panel = seen_by(scene, right).lights
    np.testing.assert_allclose(sun.direction, [4, -3, 0], atol=1e-12)
    np.testing.assert_allclose(spot.position, [3, 2, -1], atol=1e-12)
    np.testing.assert_allclose(spot.direction, [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(lamp.position, [3, 2, -1], atol=1e-12)
    np.testing.assert_allclose(panel.right, [-2, 0, 0], atol=1e-12)
    np.testing.assert_allclose(panel.up, [0, 0.5, 0], atol=1e-12)
    assert (spot.inner_cone, spot.outer_cone, lamp.range) == (10, 20, 7)
    assert seen_by(scene, right, fixed_lights=True).lights == scene.lights


def test_factors_and_growing_scenes():
    scene = Scene(MESH, CAMERA, (SUN, SPOT, LAMP))
    assert [light.intensity.tolist() for light in look.scaled_lights(scene, (0.5, 0, 2)).lights] == [
        [1, 1, 1],
        [0, 0, 0],
        [8, 10, 12],
    ]
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


def test_what_inspect_says():
    scene = Scene(MESH, CAMERA, (SUN, SPOT, LAMP), light_scale=0.25)
    contents = scene_contents(scene)
    sized = format_contents(scene_contents(Scene(MESH, CAMERA, (BALL, PANEL))))
    assert "radius 0.25" in sized
    assert "right 0 0 -2, up 0 0.5 0" in sized
    assert contents["lights"] == 3
    assert contents["each_light"][0] == {"kind": "DirectionalLight", "direction": [0, -3, 4], "intensity": [2, 2, 2]}
    text = format_contents(contents)
    for words in ("DirectionalLight", "0 -3 4", "10 to 20", "inverse-square", "times 0.25"):
        assert words in text
    assert "times" not in format_contents(scene_contents(replace(scene, light_scale=1.0)))
