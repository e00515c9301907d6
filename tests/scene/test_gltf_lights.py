"""KHR_lights_punctual: kinds, units, placement by nodes, exposure and refusals; a scene after Khronos' light test."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from mesh_writers import triangle
from scene_files import refusal

from clshade.scene.formats.load import load
from clshade.scene.model import DirectionalLight, PointLight, SpotLight


def file_with(tmp_path, *lights, nodes=()):
    """Write the triangle (0, 0, 0) (1, 0, 0) (0, 1, 0), whose center is (0.5, 0.5, 0), lit by these lights, a node each."""
    document = triangle()
    document.add("nodes", {"mesh": 0})
    for index in range(len(lights)):
        node = nodes[index] if nodes else {}
        document.add("nodes", {**node, "extensions": {"KHR_lights_punctual": {"light": index}}})
    document.json["extensions"] = {"KHR_lights_punctual": {"lights": list(lights)}}
    return document.glb(tmp_path / "a.glb")


def test_kinds_places_and_ratios(tmp_path):
    half = math.sqrt(0.5)
    path = file_with(
        tmp_path,
        {"type": "point", "intensity": 100, "range": 30},
        {"type": "point", "intensity": 100, "color": [1, 0.5, 0]},
        {"type": "directional", "intensity": 0.5},
        {"type": "spot", "intensity": 4, "spot": {"innerConeAngle": 0.1, "outerConeAngle": math.pi / 2}},
        {"type": "spot"},
        nodes=(
            {"translation": [0.5, 0.5, 10], "scale": [9, 9, 9]},  # the range is not scaled
            {"translation": [0.5, 20.5, 0]},
            {"rotation": [-half, 0, 0, half]},  # -z turned to -y
            {"translation": [0, 0, 5], "scale": [1, 1, 2]},
            {"translation": [0, 0, 50]},
        ),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = load(path)
    assert scene.ignored == ()
    lamp, warm, sun, spot, default = scene.lights
    assert isinstance(lamp, PointLight)
    assert scene.light_scale == pytest.approx(1.0)  # 100 candela at 10: 1 lux already
    assert (lamp.position.tolist(), lamp.attenuation, lamp.range) == ([0.5, 0.5, 10], "inverse-square", 30)
    np.testing.assert_allclose(lamp.intensity, [100] * 3)
    np.testing.assert_allclose(warm.intensity, [100, 50, 0])
    assert warm.range is None
    assert isinstance(sun, DirectionalLight)
    np.testing.assert_allclose(sun.direction, [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(sun.intensity, [0.5] * 3)
    assert isinstance(spot, SpotLight)
    assert (spot.position.tolist(), (spot.direction / 2).tolist()) == ([0, 0, 5], [0, 0, -1])
    assert (spot.inner_cone, spot.outer_cone) == (pytest.approx(math.degrees(0.1)), 90.0)
    assert (default.inner_cone, default.outer_cone) == (0.0, pytest.approx(45.0))


@pytest.mark.parametrize("lux", [1e-3, 1.0, 1e5])
def test_one_factor_exposes_them_all(tmp_path, lux):
    """Whatever the sun's lux, it arrives with 1, and the lamp keeps its ratio."""
    path = file_with(
        tmp_path,
        {"type": "directional", "intensity": lux},
        {"type": "point", "intensity": lux},
        nodes=({}, {"translation": [0.5, 0.5, 2]}),
    )
    scene = load(path)
    assert scene.light_scale == pytest.approx(1.0 / lux)
    assert scene.lights[0].intensity.tolist() == [pytest.approx(1.0)] * 3
    assert scene.lights[1].intensity.tolist() == [pytest.approx(1.0)] * 3


def test_a_lamp_among_the_meshes_is_measured_at_their_radius(tmp_path):
    scene = load(file_with(tmp_path, {"type": "point", "intensity": 8}, nodes=({"translation": [0.5, 0.5, 0.01]},)))
    assert scene.lights[0].intensity[0] == pytest.approx(0.5)  # the radius is sqrt(0.5)


def test_lights_that_do_not_shine_leave_the_default_ones(tmp_path):
    scene = load(file_with(tmp_path, {"type": "directional", "intensity": 0.0}))
    assert (len(scene.lights), scene.light_scale) == (3, 1.0)
    flat = load(file_with(tmp_path, {"type": "directional"}, nodes=({"scale": [1, 1, 0]},)))
    assert len(flat.lights) == 3


def test_of_an_unknown_type(tmp_path):
    with pytest.warns(UserWarning, match="lights of an unknown type"):
        assert load(file_with(tmp_path, {"type": "area"})).ignored == ("lights of an unknown type",)


@pytest.mark.parametrize(
    ("light", "words"),
    [
        ({"type": "point", "range": 0}, "range: expected a number above 0, found 0"),
        ({"type": "point", "range": -1}, "range: expected a number above 0, found -1"),
        ({"type": "point", "range": "far"}, "range: expected a finite number"),
        ({"type": "point", "intensity": -1}, "intensity: expected a finite number of at least 0"),
        (
            {"type": "spot", "spot": {"outerConeAngle": 2}},
            "spot.outerConeAngle: expected radians from 0 to pi/2, found 2",
        ),
        (
            {"type": "spot", "spot": {"innerConeAngle": -1}},
            "spot.innerConeAngle: expected a finite number of at least 0",
        ),
        (
            {"type": "spot", "spot": {"innerConeAngle": 1, "outerConeAngle": 0.5}},
            "spot.innerConeAngle: expected at most outerConeAngle, 0.5, found 1",
        ),
    ],
)
def test_refusals(tmp_path, light, words):
    refusal(file_with(tmp_path, light), words)
