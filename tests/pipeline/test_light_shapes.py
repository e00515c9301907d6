"""Directional, spot and attenuated lights in whole frames: against the oracle, in closed form, and left out without them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from lit_floor import CAMERA, MATTE, assert_lights, bounds_of, draw, lit_by

from clshade import DirectionalLight, PointLight, SpotLight
from clshade.pipeline.frame import Frame, same_bits
from clshade.pipeline.renderer import Renderer
from clshade.scene.model import Scene

ABOVE, DOWN = (0.3, -0.2, 1.5), (0.0, 0.1, -1.0)
LIGHTS = {
    "directional": DirectionalLight((0.2, 0.3, -2.0), (1.0, 0.9, 0.7)),
    "attenuated": PointLight(ABOVE, (2.0, 1.5, 1.0), "inverse-square"),
    "ranged": PointLight(ABOVE, (2.0, 1.5, 1.0), "inverse-square", 2.0),
    "spot": SpotLight(ABOVE, DOWN, (1.0, 1.0, 1.0), 15.0, 30.0),
    "all": SpotLight(ABOVE, DOWN, (2.0, 2.0, 2.0), 0.0, 60.0, "inverse-square", 2.5),
}


@pytest.mark.sampled
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"shader": "gouraud"},
        {"preset": "course"},
        {"precision": "float64"},
        {"samples": 4, "sample_shading": True},
    ],
    ids=str,
)
def test_against_the_oracle(device, options):
    assert_lights(device, LIGHTS.values(), **options)


def test_an_error_in_any_of_them_is_noticed(device):
    """What is off by 1e-3 of the intensity, a degree of the cone or a percent of the range is beyond the bounds."""
    for light in (
        replace(LIGHTS["attenuated"], intensity=(2.002, 1.5, 1.0)),
        replace(LIGHTS["ranged"], range=2.02),
        replace(LIGHTS["spot"], outer_cone=31.0),
        replace(LIGHTS["spot"], inner_cone=16.0),
        replace(LIGHTS["directional"], direction=(0.21, 0.3, -2.0)),
    ):
        right = next(lamp for name, lamp in LIGHTS.items() if type(lamp) is type(light) and name != "all")
        right = LIGHTS["ranged"] if getattr(light, "range", None) else right
        frame = draw(device, lit_by(light))
        frame.scene = lit_by(right)
        with pytest.raises(AssertionError, match="bounds"):
            bounds_of(frame)


def center_of(frame: Frame) -> float:
    return float(frame.rgb[20, 20, 0])


def test_closed_forms(device):
    """At the center, which faces the light, on white: I/d^2, times the window, times the cone's factor."""

    def brightness(light) -> float:
        forced = {"AMBIENT", "SPECULAR", "POWER"}  # of 0: the program of the tests above
        return center_of(draw(device, lit_by(light, material=MATTE), forced=forced))

    above = (0.0, 0.0, 2.0)
    assert brightness(DirectionalLight((0, 0, -7), (0.5, 0.5, 0.5))) == 0.5
    assert brightness(DirectionalLight((0, 3, -4))) == pytest.approx(0.8, rel=1e-6)
    assert brightness(DirectionalLight((0, 0, 1))) == 0.0
    assert brightness(PointLight(above, (1, 1, 1), "inverse-square")) == pytest.approx(0.25, rel=1e-6)
    assert brightness(PointLight(above, (1, 1, 1), "inverse-square", 4.0)) == pytest.approx(0.25 * 15 / 16, rel=1e-6)
    assert brightness(PointLight(above, (1, 1, 1), "inverse-square", 2.0 * (1 - 1e-6))) == 0.0
    inner, outer, off = math.cos(math.radians(10)), math.cos(math.radians(30)), math.cos(math.radians(20))
    axis = (0.0, math.sin(math.radians(20)), -off)
    fading = ((off - outer) / (inner - outer)) ** 2
    assert brightness(SpotLight(above, axis, (1, 1, 1), 10, 30)) == pytest.approx(fading, rel=1e-5)
    assert brightness(SpotLight(above, axis, (1, 1, 1), 0, 19.9)) == 0.0
    assert brightness(SpotLight(above, axis, (1, 1, 1), 21, 40)) == 1.0
    assert brightness(SpotLight(above, (0, 0, -1), (1, 1, 1), 0, 0)) == 0.0
    assert brightness(SpotLight(above, (0, 0, -1), (1, 1, 1), 90, 90)) == 1.0
    assert brightness(SpotLight(above, (0, 0, -1), (1, 1, 1), 5, 5)) == 1.0
    assert brightness(PointLight((0, 0, 0), (1, 1, 1), "inverse-square")) == 0.0  # at the point itself


@pytest.mark.parametrize("scale", [2.0**-60, 2.0**40])
def test_the_unit_of_length_does_not_matter(device, scale):
    """Times a power of two, lights with it: the same bits."""
    scene = lit_by(LIGHTS["all"], LIGHTS["ranged"], LIGHTS["directional"])
    camera = replace(CAMERA, eye=CAMERA.eye * scale)
    mesh = replace(scene.meshes[0], verts=scene.meshes[0].verts * scale)
    rescaled = Scene(mesh, camera, tuple(light.rescaled(scale, 0.0) for light in scene.lights))
    assert np.array_equal(draw(device, scene).rgb, draw(device, rescaled).rgb)


@pytest.mark.parametrize("intensity", [3e38, -3e38])
def test_what_is_too_bright_saturates(device, intensity):
    near = PointLight((0.0, 0.0, 1e-3), (intensity,) * 3, "inverse-square")
    frame = draw(device, lit_by(near, replace(near, intensity=(1, 1, 1))))
    assert np.isfinite(frame.rgb).all()
    assert center_of(frame) == math.copysign(float(np.finfo(np.float32).max), intensity)


@pytest.mark.parametrize("light", [LIGHTS["all"], LIGHTS["directional"]], ids=["spot", "directional"])
def test_a_light_far_away(device, light):
    far = light if isinstance(light, DirectionalLight) else replace(light, position=(0, 0, 1e30), range=3e30)
    bright = replace(far, intensity=(1, 1, 1) if far is light else (3e38,) * 3)
    frame = draw(device, lit_by(bright))
    assert bounds_of(frame) < 3.0


def test_plain_points_leave_it_out_and_have_the_same_bits_with_it(device):
    scene = lit_by(PointLight(ABOVE), PointLight((-3.0, 1.0, 1e6), (0.5, 1.0, 2.0)))
    lean = draw(device, scene)
    assert dict(lean.stats["left_out"])["LIGHT_SHAPES"] == "only points without attenuation shine"
    assert same_bits(lean, draw(device, scene, forced={"LIGHT_SHAPES"}))
    dark = lit_by(PointLight(ABOVE), replace(LIGHTS["spot"], intensity=(0, 0, 0)))
    assert "LIGHT_SHAPES" in draw(device, dark).stats["left_out"]


def test_a_camera_that_moves(device):
    """One renderer, other eyes: lights stay where they are in the scene."""
    scene = lit_by(*LIGHTS.values())
    with Renderer(scene, device=device, shader="phong", layers=("Z", "id")) as renderer:
        for eye in ((1.0, 2.0, 5.0), (0.0, -300.0, 200.0)):
            frame = renderer.render(replace(CAMERA, eye=eye, focal=0.2 * math.dist(eye, (0, 0, 0))))
            assert bounds_of(frame) < 3.0
