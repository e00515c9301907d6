"""Lights over a floor in closed form: directions, cones, attenuation, sizes, and the shadows of each of their points."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import oracle_asserts
import pytest
from caster_meshes import lattice, moved
from devices import rendered

import clshade
from clshade import DirectionalLight, PointLight, RectangleLight, SpotLight, oracle
from clshade.pipeline.frame import Frame
from clshade.scene.camera import Camera
from clshade.scene.model import Light, Material, Mesh, Scene, Settings

CAMERA = Camera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, (1.0, 1.0), (41, 41))
MATTE = Material(ka=0.0, kd=1.0, ks=0.0)
GLOSSY = Material(ka=0.1, kd=0.7, ks=0.4, n=30.0)


def lit_by(*lights: Light, material: Material = GLOSSY) -> Scene:
    return Scene(Mesh(*moved(lattice(4), 0.0, 5.0), material=material), CAMERA, lights)


def draw(device, scene: Scene, **options: Any) -> Frame:
    return rendered(scene, device=device, **{"layers": ("Z", "id"), "shader": "phong", **options})


ABOVE, DOWN = (0.3, -0.2, 1.5), (0.0, 0.1, -1.0)
LIGHTS = {
    "directional": DirectionalLight((0.2, 0.3, -2.0), (1.0, 0.9, 0.7)),
    "attenuated": PointLight(ABOVE, (2.0, 1.5, 1.0), "inverse-square"),
    "ranged": PointLight(ABOVE, (2.0, 1.5, 1.0), "inverse-square", 2.0),
    "spot": SpotLight(ABOVE, DOWN, (1.0, 1.0, 1.0), 15.0, 30.0),
    "all": SpotLight(ABOVE, DOWN, (2.0, 2.0, 2.0), 0.0, 60.0, "inverse-square", 2.5),
    "sphere": PointLight((0.3, -0.2, 1.5), (1.0, 0.9, 0.7), radius=0.5),
    "attenuated sphere": PointLight((0.3, -0.2, 1.0), (1.0, 1.2, 1.4), "inverse-square", 2.5, 0.2),
    "rectangle": RectangleLight((0.3, -0.2, 1.5), (0.5, 0.1, 0.0), (0.1, -0.4, 0.2), (1.0, 0.9, 0.7)),
    "attenuated rectangle": RectangleLight(
        (-0.4, 0.0, 1.0), (0.0, 0.5, 0.0), (0.3, 0.0, 0.2), (1.5, 1.5, 1.5), "inverse-square", 2.5
    ),
}


def at_center(device, light: Light, points: int = 16, material: Material = MATTE) -> float:
    return float(draw(device, lit_by(light, material=material), light_samples=points).rgb[20, 20, 0])


def point_at(distance: float, *fields: Any) -> PointLight:
    return PointLight((0, 0, distance), (1, 1, 1), *fields)


def at_angle(degrees: float, inner: float, outer: float) -> SpotLight:
    """Return a spot above the center, toward which its axis is off by an angle."""
    angle = math.radians(degrees)
    return SpotLight((0, 0, 2), (0, math.sin(angle), -math.cos(angle)), (1, 1, 1), inner, outer)


INNER, OFF, OUTER = (math.cos(math.radians(degrees)) for degrees in (10, 20, 30))
SHINY, FADING = [Material(ka=0.0, kd=0.0, ks=1.0, n=n) for n in (0.0, 1.0, 1e9)], "inverse-square"
CLOSED_FORMS = {  # at the center, which faces eye and light, on white: I/d^2, times the window, times the cone's factor
    "a sun": (DirectionalLight((0, 0, -7), (0.5, 0.5, 0.5)), MATTE, 0.5),
    "aslant": (DirectionalLight((0, 3, -4)), MATTE, 0.8),
    "from behind": (DirectionalLight((0, 0, 1)), MATTE, 0.0),
    "along the surface": (PointLight((2, 0, 0), (1, 1, 1)), Material(ka=0.0, kd=1.0, ks=1.0, n=0.0), 0.0),
    "attenuated": (point_at(2, FADING), MATTE, 0.25),
    "far away": (point_at(2.0**30, FADING), MATTE, 2.0**-60),
    "in range": (point_at(2, FADING, 4.0), MATTE, 0.25 * 15 / 16),
    "out of range": (point_at(2, FADING, 2.0 * (1 - 1e-6)), MATTE, 0.0),
    "at the point itself": (point_at(0), MATTE, 0.0),
    "at the point itself, attenuated": (point_at(0, FADING), MATTE, 0.0),
    "negative": (PointLight((0, 0, 2), (-2, 0, 0)), MATTE, -2.0),
    "in a fading cone": (at_angle(20, 10, 30), MATTE, ((OFF - OUTER) / (INNER - OUTER)) ** 2),
    "beside a cone": (at_angle(20, 0, 19.9), MATTE, 0.0),
    "within a cone": (at_angle(20, 21, 40), MATTE, 1.0),
    "a cone without width": (at_angle(0, 0, 0), MATTE, 0.0),
    "half of all directions": (at_angle(0, 90, 90), MATTE, 1.0),
    "a sharp cone": (at_angle(0, 5, 5), MATTE, 1.0),
    **{f"a highlight, n = {material.n:g}": (point_at(2), material, 1.0) for material in SHINY},
    "a highlight aslant": (DirectionalLight((-1, 0, -1)), Material(ka=0.0, kd=0.0, ks=1.0, n=0.5), 0.5**0.25),
}


@pytest.mark.parametrize(("light", "material", "expected"), CLOSED_FORMS.values(), ids=CLOSED_FORMS)
def test_closed_forms(device, light, material, expected):
    assert at_center(device, light, material=material) == pytest.approx(expected, rel=1e-5, abs=0.0)


@pytest.mark.parametrize("intensity", [3e38, -3e38])
def test_what_is_too_bright_saturates(device, intensity):
    near = PointLight((0.0, 0.0, 1e-3), (intensity,) * 3, "inverse-square")
    frame = draw(device, lit_by(near, replace(near, intensity=(1, 1, 1))))
    assert np.isfinite(frame.rgb).all()
    assert frame.stats["saturated"] > 0
    assert frame.rgb[20, 20, 0] == math.copysign(float(np.finfo(np.float32).max), intensity)


def form_factor(a: float, b: float) -> float:
    """Return the form factor of a rectangle, a x b, to a small area parallel to it below a corner, at a distance of 1 (J. R.
    Howell, A catalog of radiation heat transfer configuration factors, B-3)."""
    x, y = math.hypot(1.0, a), math.hypot(1.0, b)
    return (a / x * math.atan(b / x) + b / y * math.atan(a / y)) / (2.0 * math.pi)


@pytest.mark.parametrize(("half_width", "half_height"), [(0.5, 0.5), (1.0, 0.25)])
def test_the_form_factor_of_a_rectangle(device, half_width, half_height):
    """A matte surface opposite its middle sends pi times the form factor times the radiance, I over the area; the error
    falls about as 1/N, as quadrature by points of low discrepancy does, not as 1/sqrt(N)."""
    light = RectangleLight((0, 0, 2), (2 * half_width, 0, 0), (0, -2 * half_height, 0), (1, 1, 1), "inverse-square")
    expected = math.pi * 4.0 * form_factor(half_width, half_height) / (16.0 * half_width * half_height)
    counts = (4, 16, 64, 256)
    errors = [abs(at_center(device, light, points) / expected - 1.0) for points in counts]
    assert errors[-1] < 1e-3
    assert np.polyfit(np.log(counts), np.log(errors), 1)[0] < -0.7


def test_a_sphere_above_a_floor(device):
    """The mean of the cosine over the disc, 2 d (sqrt(d^2 + r^2) - d) / r^2; with attenuation of cos/l^2,
    2 (1 - d / sqrt(d^2 + r^2)) / r^2."""
    d, r, light = 2.0, 0.8, PointLight((0, 0, 2.0), (1, 1, 1), radius=0.8)
    away = math.hypot(d, r)
    assert at_center(device, light, 256) == pytest.approx(2.0 * d * (away - d) / r**2, rel=2e-4)
    near = at_center(device, replace(light, attenuation="inverse-square"), 256)
    assert near == pytest.approx(2.0 * (1.0 - d / away) / r**2, rel=1e-3)


def test_a_small_or_distant_sphere_is_a_point(device):
    for light, radius in ((PointLight((2e5, 0.0, 1e6), (0.5, 1.0, 0.7)), 1.0), (LIGHTS["sphere"], 1e-7)):
        sphere, point = (draw(device, lit_by(replace(light, radius=size))) for size in (radius, 0.0))
        assert np.abs(sphere.rgb - point.rgb).max() < 5e-6


@pytest.mark.long
def test_a_rectangle_shines_from_its_front_only(device):
    # right x up points up, away from the floor.
    light = RectangleLight((0.3, -0.2, 1.5), (0.5, 0.1, 0.0), (-0.1, 0.4, 0.0))
    assert draw(device, lit_by(replace(light, right=light.up, up=light.right), material=MATTE)).rgb.max() > 0.2
    for away in (light, RectangleLight((0, 0, 0), (0, 1, 0), (1, 0, 0))):  # the second in the floor, shining down
        assert not draw(device, lit_by(away, material=MATTE)).rgb.any()


@pytest.mark.parametrize("scale", [2.0**-60, 2.0**40])
def test_the_unit_of_length_does_not_matter(device, scale):
    """Times a power of two, lights with it: the same bits."""
    scene = lit_by(*LIGHTS.values())
    mesh, lights = scene.meshes[0], [light.rescaled(scale, 0.0) for light in scene.lights]
    rescaled = Scene(replace(mesh, verts=mesh.verts * scale), replace(CAMERA, eye=CAMERA.eye * scale), lights)
    assert np.array_equal(draw(device, scene).rgb, draw(device, rescaled).rgb)


# Shadows: each point of a light casts its own.


def roofed(light, material: Material = GLOSSY) -> Scene:
    """Return the floor below a small roof of two triangles."""
    roof = Mesh([[-0.5, -0.5, 0.4], [0.6, -0.5, 0.4], [0.1, 0.6, 0.5], [-1, 1, 0.2]], [[0, 1, 2], [0, 2, 3]])
    floor = lit_by(light, material=material)
    return replace(floor, meshes=(*floor.meshes, replace(roof, material=material)))


@pytest.mark.sampled
@pytest.mark.parametrize("far", [1e18, 1e20, 1e25])
def test_a_sphere_so_far_away_that_it_counts_as_directional_casts_a_penumbra(device, far):
    """Half as large as it is far away, above a scene 1e-12 across: each of its points has its own direction."""
    scene = roofed(PointLight((0.1 * far, -0.2 * far, far), radius=0.5 * far), material=MATTE)
    meshes = tuple(replace(mesh, verts=mesh.verts * 1e-12) for mesh in scene.meshes)
    tiny = replace(scene, meshes=meshes, camera=replace(CAMERA, eye=CAMERA.eye * 1e-12))
    frame = draw(device, tiny, shadows=True, light_samples=16)
    assert oracle_asserts.assert_drawn(frame).bounds < 3.0
    assert len(np.unique(np.round(frame.rgb[..., 0], 3))) > 30


@pytest.mark.sampled
@pytest.mark.parametrize("shadows", [False, True])
@pytest.mark.parametrize("radius", [1e17, 1e40])
def test_a_sphere_far_larger_than_the_scene_turns_its_disc_toward_each_point(device, radius, shadows):
    """The radius is scaled down into float32's range, but not the center, which each disc's direction depends on."""
    light = PointLight((1.0, 2.0, 1.5), (1.0, 0.9, 0.7), radius=radius)
    attenuated = replace(light, intensity=light.intensity * min(radius, 1e18) ** 2, attenuation="inverse-square")
    frames = [draw(device, roofed(lamp), shadows=shadows, light_samples=4) for lamp in (light, attenuated)]
    assert all(oracle_asserts.assert_drawn(frame).bounds < 3.0 for frame in frames)
    assert np.ptp(frames[0].rgb[20, :, 0]) > 0.05


# Lights that nearly touch the surface


def grazed(n: float = 0.0, height: float = 1e-7, *, orthographic: bool = False) -> Scene:
    """Return a tilted square 2 wide, of which the image shows 0.1, with a light `height` above its center. Around it
    N.L is height over distance, where P, a mean of corners some 3 from the eye, is off by some 1e-7."""
    x, y = np.array([0.48, 0.6, -0.64]), np.array([-0.8, 0.6, 0.0])
    normal = np.cross(x, y)
    verts = np.array([-x - y, x - y, x + y, y - x]) + [0.1, 0.2, 0.3]
    material = Material(ka=0.2, kd=0.3, ks=0.5, n=n)
    mesh = Mesh(verts, [[0, 1, 2], [0, 2, 3]], normals=np.tile(normal, (4, 1)), material=material)
    at = verts.mean(axis=0) + 0.013 * x + 0.017 * y
    eye = at + 1.5 * normal + 1.1 * x
    plane = (0.1, 0.1) if orthographic else (0.05, 0.05)
    camera = Camera(eye, at, (0, 0.1, 1), 1.0, plane, (48, 48), orthographic=orthographic)
    return Scene((mesh,), camera, (PointLight(at + height * normal, (1, 1, 1)),), np.full(3, 0.5))


@pytest.mark.parametrize(("n", "orthographic"), [(0.0, False), (0.3, True), (20.0, False)])
def test_a_light_that_grazes_opens_and_closes_highlights_within_rounding(device, n, orthographic):
    frame = draw(device, grazed(n, orthographic=orthographic))
    assert frame.alpha.all()
    report = clshade.check(frame, "all")
    assert report.passed, report.lines()
    if n < 1.0:
        assert 0 < report.gates < 0.2 * report.of


def test_highlights_that_are_wrong_are_found_beside_grazing_lights():
    """Planted: no highlights where N.L exceeds rounding."""
    expected = oracle.render(grazed(0.0, 1e-4), Settings(shader="phong"))
    assert (expected.jump <= expected.budget).all()
    rgb = expected.rgb.astype(np.float32)
    assert oracle_asserts.assert_colors_within(rgb, expected, gate_fraction=1.0) < 1.0
    clear = (expected.kappa < 1e5) & ~expected.gate
    without = rgb - np.where(clear[..., None], 0.5, 0.0).astype(np.float32)
    assert clear.sum() > 0.2 * clear.size
    with pytest.raises(AssertionError, match=f"colors off by more than 32 bounds: {clear.sum()} of"):
        oracle_asserts.assert_colors_within(without, expected, gate_fraction=1.0)
