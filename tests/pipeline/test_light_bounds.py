"""Colors within their bounds in ill-conditioned cases: colors far beyond 1, lights that nearly touch the surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import oracle_asserts
import pytest
from devices import rendered

import clshade
from clshade import oracle
from clshade.measure.check import oracle_bounds
from clshade.pipeline import features
from clshade.pipeline.frame import Frame
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, PointLight, Scene, Settings

CAMERA = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (32, 32))
MATTE = Material(ka=0.2, kd=0.7, ks=0.3, n=8.0)


def draw(device, scene: Scene, **options) -> Frame:
    return rendered(scene, device=device, **{"layers": ("Z", "id"), **options})


# Colors beyond 1


def triangle(colors, moved=(0.0, 0.0, 0.0), **fields) -> Mesh:
    """Return a triangle that covers most of CAMERA's image."""
    verts = np.array([[-1.9, -1.9, 0.4], [1.9, -1.7, -0.5], [-1.5, 1.9, 0.1]]) + moved
    return Mesh(verts, [[0, 1, 2]], colors=np.asarray(colors, np.float64), material=MATTE, **fields)


def lit(*meshes: Mesh, **fields) -> Scene:
    return Scene(meshes, CAMERA, (PointLight((1.0, 2.0, 3.0), (1, 1, 1)),), np.full(3, 0.5), **fields)


GLARING = [[1e6, 0.1, 0.5], [0.2, 1e6, 0.4], [0.3, 0.3, 1e6]]


@pytest.mark.long
def test_a_constant_beyond_one_stays_exact(device):
    """Only ambient light, 0.5 * 0.2 * 5, the same at every pixel."""
    mesh = replace(triangle(np.full((3, 3), 5.0)), material=Material(ka=0.25, kd=0.0, ks=0.0))
    frame = draw(device, lit(mesh), shader="phong")
    assert np.unique(frame.rgb[frame.alpha == 1.0]).tolist() == [0.625]


@pytest.mark.parametrize(
    ("mesh", "options", "bright"),
    [
        (triangle(np.ones((3, 3))), {}, False),
        (triangle(np.ones((3, 3)) * 1.001), {}, True),
        (triangle(-np.ones((3, 3)) * 1.001), {}, True),
        (triangle(GLARING), {"shader": "gouraud"}, False),
        (triangle(GLARING), {"shader": "nolight"}, False),
        (replace(triangle(np.ones((3, 3))), material=Material(color=2.0)), {}, True),
        (replace(triangle(np.ones((3, 3))), colors=None, material=Material(color=2.0)), {}, False),
    ],
)
def test_only_colors_beyond_one_take_more_care(mesh, options, bright):
    settings = Settings(**{"shader": "phong", **options})
    assert features.derive(lit(mesh), settings, double_positions=False)["BRIGHT"] is int(bright)


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


@pytest.mark.long
@pytest.mark.parametrize(
    ("shader", "n", "orthographic"),
    [("phong", 0.0, False), ("phong", 0.3, True), ("phong", 20.0, False), ("gouraud", 0.0, False)],
)
def test_a_light_that_grazes_opens_and_closes_highlights_within_rounding(device, shader, n, orthographic):
    frame = draw(device, grazed(n, orthographic=orthographic), shader=shader)
    assert frame.alpha.all()
    report = clshade.check(frame, "all")
    assert report.passed, report.lines()
    if shader == "phong" and n < 1.0:
        assert 0 < report.gates < 0.2 * report.of


@pytest.mark.parametrize("height", [1e-5, 1e-4, 1e-3])
def test_highlights_that_are_wrong_are_found_beside_grazing_lights(height):
    """Planted: no highlights where N.L exceeds rounding."""
    scene = grazed(0.0, height)
    expected = oracle.render(scene, Settings(shader="phong"))
    assert (expected.jump <= expected.budget).all()
    rgb = expected.rgb.astype(np.float32)
    assert oracle_asserts.assert_colors_within(rgb, expected, gate_fraction=1.0) < 1.0
    clear = (expected.kappa < 1e5) & ~expected.gate
    without = rgb - np.where(clear[..., None], 0.5, 0.0).astype(np.float32)
    assert clear.sum() > 0.2 * clear.size
    with pytest.raises(AssertionError, match=f"colors off by more than 32 bounds: {clear.sum()} of"):
        oracle_asserts.assert_colors_within(without, expected, gate_fraction=1.0)


def test_what_exceeds_the_highlight_is_found_at_its_gate():
    """Planted at a single pixel at a gate: the highlight, which is excepted, plus twice the allowed error."""
    expected = oracle.render(grazed(), Settings(shader="phong"))
    bound = oracle_bounds.color_bound(expected)
    at = tuple(np.argwhere(expected.gate & (expected.kappa < 1e4))[0])
    rgb = expected.rgb.copy()
    rgb[at] += expected.jump[at]
    assert oracle_asserts.assert_colors_within(rgb, expected, 32.0, dtype=np.float64, gate_fraction=1.0) < 32.0
    rgb[at] += 64.0 * bound[at]
    with pytest.raises(AssertionError, match="colors off by more than 32 bounds: 1 of"):
        oracle_asserts.assert_colors_within(rgb, expected, 32.0, dtype=np.float64, gate_fraction=1.0)


@pytest.mark.parametrize("orthographic", [False, True])
def test_the_oracle_does_not_depend_on_the_unit_of_length(orthographic):
    """A scene in another unit, a power of two, looks the same and is equally conditioned, with any camera."""
    scene = grazed(0.5, 1e-4, orthographic=orthographic)
    first = oracle.render(scene, Settings(shader="phong"))
    assert first.kappa.min() < 1e3

    def scaled(unit: float) -> Scene:
        mesh, camera = scene.meshes[0], scene.camera
        plane = tuple(unit * size for size in camera.plane) if orthographic else camera.plane
        camera = replace(camera, eye=camera.eye * unit, lookat=camera.lookat * unit, plane=plane)
        lights = tuple(replace(light, position=light.position * unit) for light in scene.lights)
        return replace(scene, meshes=(replace(mesh, verts=mesh.verts * unit),), camera=camera, lights=lights)

    for unit in (2.0**-60, 2.0**20, 2.0**60):
        rescaled = oracle.render(scaled(unit), Settings(shader="phong"))
        assert np.allclose(rescaled.rgb, first.rgb, rtol=1e-9)
        assert np.allclose(rescaled.kappa, first.kappa, rtol=1e-9)
        assert np.allclose(rescaled.jump, first.jump, rtol=1e-9)
