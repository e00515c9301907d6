"""Lights over a floor in closed form: directions, cones, attenuation, sizes, and the shadows of each of their points."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import oracle_asserts
import pytest
from devices import rendered

from clshade import DirectionalLight, PointLight, RectangleLight, SpotLight
from clshade.oracle import lights as points_of_oracle
from clshade.pipeline import light_points, struct_layout
from clshade.pipeline.frame import Frame
from clshade.pipeline.hierarchy import CasterFrame, shadow_lights
from clshade.scene.camera import Camera
from clshade.scene.model import Light, Material, Mesh, Scene

CAMERA = Camera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, (1.0, 1.0), (41, 41))
MATTE = Material(ka=0.0, kd=1.0, ks=0.0)
GLOSSY = Material(ka=0.1, kd=0.7, ks=0.4, n=30.0)


def floor(material: Material, cells: int = 4) -> Mesh:
    line = np.linspace(-2.5, 2.5, cells + 1)
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = [
        np.stack([first, first + 1, first + cells + 2], 1),
        np.stack([first, first + cells + 2, first + cells + 1], 1),
    ]
    return Mesh(np.stack([x, y, 0.0 * x], 1), np.concatenate(faces), material=material)


def lit_by(*lights: Light, material: Material = GLOSSY) -> Scene:
    return Scene(floor(material), CAMERA, lights)


def draw(device, scene: Scene, **options: Any) -> Frame:
    return rendered(scene, device=device, **{"layers": ("Z", "id"), "shader": "phong", **options})


def bounds_of(frame: Frame) -> float:
    return oracle_asserts.assert_drawn(frame).bounds


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


def at_center(device, light: Light, points: int = 16) -> float:
    return float(draw(device, lit_by(light, material=MATTE), light_samples=points).rgb[20, 20, 0])


def test_closed_forms(device):
    """At the center, which faces the light, on white: I/d^2, times the window, times the cone's factor."""
    brightness = partial(at_center, device)
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


@pytest.mark.parametrize("intensity", [3e38, -3e38])
def test_what_is_too_bright_saturates(device, intensity):
    near = PointLight((0.0, 0.0, 1e-3), (intensity,) * 3, "inverse-square")
    frame = draw(device, lit_by(near, replace(near, intensity=(1, 1, 1))))
    assert np.isfinite(frame.rgb).all()
    assert frame.rgb[20, 20, 0] == math.copysign(float(np.finfo(np.float32).max), intensity)


def form_factor(a: float, b: float) -> float:
    """Return the form factor of a rectangle, a x b, to a small area parallel to it below a corner, at a distance of 1 (J. R.
    Howell, A catalog of radiation heat transfer configuration factors, B-3)."""
    x, y = math.hypot(1.0, a), math.hypot(1.0, b)
    return (a / x * math.atan(b / x) + b / y * math.atan(a / y)) / (2.0 * math.pi)


def convergence(errors: list[float], counts: tuple[int, ...]) -> float:
    """Return the slope of a line through the logarithms."""
    return float(np.polyfit(np.log(counts), np.log(errors), 1)[0])


@pytest.mark.parametrize(("half_width", "half_height"), [(0.5, 0.5), (1.0, 0.25)])
def test_the_form_factor_of_a_rectangle(device, half_width, half_height):
    """A matte surface opposite its middle sends pi times the form factor times the radiance, I over the area; the error
    falls about as 1/N, as quadrature by points of low discrepancy does, not as 1/sqrt(N)."""
    light = RectangleLight((0, 0, 2), (2 * half_width, 0, 0), (0, -2 * half_height, 0), (1, 1, 1), "inverse-square")
    radiance = 1.0 / (16.0 * half_width * half_height)
    expected = math.pi * 4.0 * form_factor(half_width, half_height) * radiance
    counts = (4, 16, 64, 256)
    errors = [abs(at_center(device, light, points) / expected - 1.0) for points in counts]
    assert errors[-1] < 1e-3
    assert convergence(errors, counts) < -0.7


def test_a_sphere_above_a_floor(device):
    """The mean of the cosine over the disc, 2 d (sqrt(d^2 + r^2) - d) / r^2; with attenuation of cos/l^2,
    2 (1 - d / sqrt(d^2 + r^2)) / r^2."""
    d, r = 2.0, 0.8
    away = math.hypot(d, r)
    plain = at_center(device, PointLight((0, 0, d), radius=r), 256)
    assert plain == pytest.approx(2.0 * d * (away - d) / r**2, rel=2e-4)
    near = at_center(device, PointLight((0, 0, d), (1, 1, 1), "inverse-square", radius=r), 256)
    assert near == pytest.approx(2.0 * (1.0 - d / away) / r**2, rel=1e-3)


def test_a_small_or_distant_sphere_is_a_point(device):
    far = PointLight((2e5, 0.0, 1e6), (0.5, 1.0, 0.7))
    point = draw(device, lit_by(far))
    sphere = draw(device, lit_by(replace(far, radius=1.0)))
    assert np.abs(sphere.rgb - point.rgb).max() < 5e-6
    small = draw(device, lit_by(replace(LIGHTS["sphere"], radius=1e-7)))
    assert np.abs(small.rgb - draw(device, lit_by(replace(LIGHTS["sphere"], radius=0.0))).rgb).max() < 5e-6


@pytest.mark.long
def test_a_rectangle_shines_from_its_front_only(device):
    # right x up points up, away from the floor.
    light = RectangleLight((0.3, -0.2, 1.5), (0.5, 0.1, 0.0), (-0.1, 0.4, 0.0))
    turned = replace(light, right=light.up, up=light.right)
    assert draw(device, lit_by(turned, material=MATTE)).rgb.max() > 0.2
    assert (draw(device, lit_by(light, material=MATTE)).rgb == 0.0).all()
    beside = RectangleLight((0, 0, 0), (0, 1, 0), (1, 0, 0))  # in the floor, shining down
    assert (draw(device, lit_by(beside, material=MATTE)).rgb == 0.0).all()


@pytest.mark.parametrize("scale", [2.0**-60, 2.0**40])
def test_the_unit_of_length_does_not_matter(device, scale):
    """Times a power of two, lights with it: the same bits."""
    scene = lit_by(*LIGHTS.values())
    camera = replace(CAMERA, eye=CAMERA.eye * scale)
    mesh = replace(scene.meshes[0], verts=scene.meshes[0].verts * scale)
    rescaled = Scene(mesh, camera, tuple(light.rescaled(scale, 0.0) for light in scene.lights))
    assert np.array_equal(draw(device, scene).rgb, draw(device, rescaled).rgb)


@pytest.mark.parametrize("points", [1, 2, 5, 16, 100, 256])
def test_host_and_oracle_mean_the_same_points(points):
    first, step = light_points.pattern(points)
    i = np.arange(points)[:, None]
    assert np.array_equal((np.array(first) + i * np.array(step)) % 2**32, points_of_oracle.coordinates(points))
    u, v = points_of_oracle.coordinates(points).T / 2.0**32
    np.testing.assert_allclose(u, (i[:, 0] + 0.5) / points, atol=1e-7)
    np.testing.assert_allclose(v, (0.5 + (i[:, 0] - (points - 1) / 2) * (math.sqrt(5) - 1) / 2) % 1.0, atol=1e-7)


def test_the_shifts_are_those_of_the_constants():
    place = np.array([[256, 0], [0, 256], [5 * 256 + 64, 7 * 256 + 192]])
    named = struct_layout.CONSTANTS
    column, row = (np.array([named[f"SHIFT_{c}_{way}"] for c in "UV"]) for way in ("COLUMN", "ROW"))
    shifts = points_of_oracle.shifts(place) / 2**8
    assert shifts[:2].tolist() == [column.tolist(), row.tolist()]
    assert shifts[2].tolist() == ((5 * column + 7 * row + [2**24 * 3 // 4, 2**24 // 4]) % 2**24).tolist()


@pytest.mark.long
def test_neighbors_complement_each_other(device):
    """Of a half-covered light, the mean over 4 x 4 pixels is nearer to the truth than pixels with as many points in all
    placed at random would be."""
    wide = RectangleLight((0, 0, 1), (1.5, 0, 0), (0, -1.5, 0), (1, 1, 1), "inverse-square")
    true = draw(device, lit_by(wide, material=MATTE), light_samples=256).rgb[8:32, 8:32, 0]
    estimate = draw(device, lit_by(wide, material=MATTE), light_samples=4).rgb[8:32, 8:32, 0]
    error = estimate.astype(np.float64) - true
    means = error.reshape(6, 4, 6, 4).mean(axis=(1, 3))
    assert error.std() > 1e-3
    assert np.sqrt((means**2).mean()) < 0.5 * error.std() / 4.0


# Shadows: each point of a light casts its own.


def roofed(light, material: Material = GLOSSY) -> Scene:
    """Return the floor below a small roof of two triangles."""
    roof = Mesh([[-0.5, -0.5, 0.4], [0.6, -0.5, 0.4], [0.1, 0.6, 0.5], [-1, 1, 0.2]], [[0, 1, 2], [0, 2, 3]])
    scene = lit_by(light, material=material)
    return replace(scene, meshes=(*scene.meshes, replace(roof, material=material)))


def lit_part(x: np.ndarray) -> np.ndarray:
    """Return what part of a square light, 1 x 1, 2 above places x (K,) of a floor, arrives where a half-plane halfway
    between hides its points p < -x: each counts with the product of the cosines at both ends, 4/(4 + distance^2)."""
    line = (np.arange(1000) + 0.5) / 1000 - 0.5
    squares = (line - x[:, None])[:, :, None] ** 2 + line**2
    weights = (4.0 / (4.0 + squares)).sum(axis=2)
    return (weights * (line > -x[:, None])).sum(axis=1) / weights.sum(axis=1)


@pytest.mark.long
def test_a_penumbra_in_closed_form(device):
    """Below the edge of a half-plane at half the height of a rectangle, the lit part of the light grows linearly from one
    end of the penumbra, as wide as the light, to the other. One of 256 points may lie on the wrong side of the edge; the
    tolerance is two."""
    half = Mesh([[0, -30, 1], [0, 30, 1], [-60, 0, 1]], [[0, 1, 2]], material=MATTE)
    light = RectangleLight((0, 0, 2), (0.5, 0, 0), (0, -0.5, 0))
    open_ = lit_by(light, material=MATTE)
    camera = replace(CAMERA, eye=(0, 0, 0.9), focal=0.45, resolution=(21, 21))  # below the half-plane
    hidden = replace(open_, meshes=(*open_.meshes, half), camera=camera)
    ratio = (
        draw(device, hidden, shadows=True, light_samples=256).rgb[10, :, 0]
        / draw(device, replace(open_, camera=camera), light_samples=256).rgb[10, :, 0]
    )
    x = (np.arange(21) + 0.5 - 10.5) / 21 * 2.0  # on the floor
    inside = np.abs(x) < 0.5
    assert inside.sum() > 8
    assert np.abs(ratio - lit_part(x))[inside].max() < 2.0 / 256
    assert np.abs(lit_part(x) - (0.5 + x))[inside].max() < 0.03  # the cosines' share of it
    assert (ratio[x < -0.5] == 0.0).all()
    assert ratio[x > 0.5] == pytest.approx(1.0, abs=1e-6)
    assert (np.diff(ratio) > -0.01).all()


@pytest.mark.parametrize("far", [1e18, 1e20, 1e25])
def test_a_sphere_so_far_away_that_it_counts_as_directional_casts_a_penumbra(device, far):
    """Half as large as it is far away, above a scene 1e-12 across: each of its points has its own direction."""
    scene = roofed(PointLight((0.1 * far, -0.2 * far, far), radius=0.5 * far), material=MATTE)
    meshes = tuple(replace(mesh, verts=mesh.verts * 1e-12) for mesh in scene.meshes)
    tiny = replace(scene, meshes=meshes, camera=replace(CAMERA, eye=CAMERA.eye * 1e-12))
    frame = draw(device, tiny, shadows=True, light_samples=16)
    assert bounds_of(frame) < 3.0
    assert len(np.unique(np.round(frame.rgb[..., 0], 3))) > 30
    assert light_rows_are_directional(tiny) == (far > 1e18)


def light_rows_are_directional(scene: Scene) -> bool:
    frame = CasterFrame.around(np.concatenate([mesh.verts for mesh in scene.meshes]))
    (row,), (factor,) = shadow_lights(scene.lights, frame)
    assert row["w"] in (0.0, factor / frame.unit)
    return bool(row["w"] == 0.0)


@pytest.mark.sampled
@pytest.mark.parametrize("radius", [1e17, 1e20, 1e40])
@pytest.mark.parametrize("shadows", [False, True])
def test_a_sphere_far_larger_than_the_scene_turns_its_disc_toward_each_point(device, radius, shadows):
    """The radius is scaled down into float32's range, but not the center, which each disc's direction depends on."""
    place, light = (1.0, 2.0, 1.5), np.array([1.0, 0.9, 0.7])
    plain = roofed(PointLight(place, light, radius=radius))
    frame = draw(device, plain, shadows=shadows, light_samples=4)
    assert bounds_of(frame) < 3.0
    assert np.ptp(frame.rgb[20, :, 0]) > 0.05
    bright = light * min(radius, 1e18) ** 2
    attenuated = roofed(PointLight(place, bright, "inverse-square", radius=radius))
    assert bounds_of(draw(device, attenuated, shadows=shadows, light_samples=4)) < 3.0


@pytest.mark.long
def test_a_tiny_sphere_casts_the_shadow_of_a_point(device):
    point = draw(device, roofed(PointLight((0.31, -0.23, 2.0))), shadows=True)
    sphere = draw(device, roofed(PointLight((0.31, -0.23, 2.0), radius=1e-6)), shadows=True, light_samples=2)
    assert (np.abs(point.rgb - sphere.rgb).max(axis=-1) < 1e-4).mean() > 0.998
