"""Shadows in whole frames: against the oracle, which tries every triangle, and bit by bit against each other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import oracle_asserts
import pytest
from devices import rendered

from clshade import oracle
from clshade.measure.stability.cases.lit import blob, patch
from clshade.pipeline.frame import Frame, same_bits
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.material import MetallicRoughness
from clshade.scene.model import DirectionalLight, Light, Material, Mesh, PointLight, Scene, SpotLight, Texture

CAMERA = Camera((0.3, 3.0, 4.5), (0.0, -0.3, 0.0), (0.0, 1.0, 0.0), 1.3, (1.0, 1.0), (61, 61))
LIGHTS: dict[str, tuple[Light, ...]] = {
    "points": (PointLight((3.0, 4.0, 2.0), (1.0, 0.9, 0.7)), PointLight((-4.0, 3.0, 1.0), (0.2, 0.3, 0.8))),
    "sun": (DirectionalLight((-1.0, -2.0, -0.5), (1.0, 0.9, 0.7)),),
    "spot": (
        SpotLight((1.0, 4.0, 1.0), (-0.2, -1.0, -0.2), (9.0, 9.0, 9.0), 10.0, 35.0, "inverse-square"),
        PointLight((-2.0, 2.0, 2.0), (3.0, 4.0, 5.0), "inverse-square", 9.0),
    ),
}
MATERIAL = Material(ka=0.1, kd=0.6, ks=0.4, n=20.0)


def ground(**fields: Any) -> Mesh:
    """Return a square below the rest, of two triangles."""
    corners = np.array([[-4.0, -1.5, -4.0], [-4.0, -1.5, 4.0], [4.0, -1.5, 4.0], [4.0, -1.5, -4.0]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), colors=np.full((4, 3), 0.8), material=MATERIAL, **fields)


def scene_of(lights: str = "points", *meshes: Mesh, **fields: Any) -> Scene:
    """Return triangles of all sizes and a bent sheet with smooth normals over a ground."""
    sheet = patch(size=0.8, cells=5, bend=0.5, material=MATERIAL)
    objects = meshes or (ground(), replace(blob(40, material=MATERIAL), verts=0.5 * blob(40).verts), sheet)
    return Scene(objects, **{"camera": CAMERA, "lights": LIGHTS[lights], "background": (0.1, 0.2, 0.3), **fields})


def draw(device, scene: Scene, **options: Any) -> Frame:
    return rendered(scene, device=device, **{"layers": ("Z", "id"), "shadows": True, **options})


def assert_equals_oracle(frame: Frame) -> Any:
    """Assert that a frame is the oracle's within the bounds, and that few pixels need the exception of shadows' edges."""
    expected = oracle.render(frame.scene, frame.settings)
    agreement = oracle_asserts.assert_frame(frame, expected, frame.scene, frame.settings)
    assert agreement.gates.mean() < 2e-3
    return expected


def glass(scene: Scene) -> Scene:
    """Return the scene with a transparent sheet."""
    *rest, sheet = scene.meshes
    clear = replace(sheet, material=replace(MATERIAL, blend=True, opacity=0.5, kd=0.3))
    return replace(scene, meshes=(*rest, clear))


def mapped() -> Scene:
    """Return a sheet with a normal map below triangles."""
    image = np.array([0.5, 0.5, 0.9]) + np.random.default_rng(3).normal(size=(8, 8, 3)) * [0.15, 0.15, 0.02]
    facets = MetallicRoughness(0.2, 0.5, normal_texture=Texture(np.clip(image, 0.0, 1.0)))
    flat = patch(size=2.0, cells=5, bend=0.5)
    lying = flat.verts[:, [0, 2, 1]] * [1.0, 1.0, -1.0] - [0.0, 1.0, 0.0]
    sheet = Mesh(lying, flat.faces, uvs=flat.verts[:, :2], material=Material(color=(0.8, 0.7, 0.6), pbr=facets))
    return scene_of("points", sheet, replace(blob(20), verts=0.4 * blob(20).verts + [0.0, 0.3, 0.0]))


def two_sided(scene: Scene) -> Scene:
    meshes = (replace(mesh, material=replace(MATERIAL, two_sided=True)) for mesh in scene.meshes)
    return replace(scene, meshes=tuple(meshes))


def parallel(scene: Scene) -> Scene:
    camera = replace(CAMERA, orthographic=True, plane=(5.0, 5.0), principal=(0.4, 0.6))
    return replace(scene, camera=camera)


CASES = {
    "phong": ({}, scene_of),
    "gouraud": ({"shader": "gouraud"}, scene_of),
    "sun": ({}, lambda: scene_of("sun")),
    "spot": ({}, lambda: scene_of("spot")),
    "pbr": ({"preset": "pbr"}, scene_of),
    "pbr, sun": ({"preset": "pbr"}, lambda: scene_of("sun")),
    "normal map": ({"preset": "pbr"}, mapped),
    "samples": ({"samples": 4}, scene_of),
    "every sample": ({"samples": 3, "sample_shading": True}, scene_of),
    "glass": ({}, lambda: glass(scene_of())),
    "two-sided": ({}, lambda: two_sided(scene_of())),
    "parallel": ({}, lambda: parallel(scene_of())),
    "clipped": ({"near": 4.0}, scene_of),
    "course": ({"preset": "course"}, scene_of),
    "float64": ({"precision": "float64"}, scene_of),
    "gouraud, course": ({"preset": "course", "shader": "gouraud"}, scene_of),
    "gouraud, sun": ({"shader": "gouraud"}, lambda: scene_of("sun")),
}


@pytest.mark.sampled
@pytest.mark.parametrize("name", CASES)
def test_shadows_equal_the_oracle(device, name):
    options, scene = CASES[name]
    frame = draw(device, scene(), **options)
    assert "SHADOWS" in frame.stats["features"]
    assert_equals_oracle(frame)
    plain = draw(device, scene(), **{**options, "shadows": False})
    assert "SHADOWS" not in plain.stats["features"]
    darker = (frame.rgb < plain.rgb - 1e-3).any(axis=-1)
    assert darker.mean() > 0.08
    assert not (frame.rgb > plain.rgb + 1e-6).any()


def test_the_comparison_notices_a_missing_caster_and_a_moved_light(device):
    scene = scene_of()
    frame = draw(device, scene)
    away = replace(
        scene, meshes=(*scene.meshes[:2], replace(scene.meshes[2], verts=scene.meshes[2].verts + [0, 0.05, 0]))
    )
    moved = replace(scene, lights=(replace(scene.lights[0], position=(3.0, 4.0, 2.02)), scene.lights[1]))
    for wrong in (away, moved):
        expected = oracle.render(wrong, frame.settings)
        skip = frame["id"] != expected.id
        with pytest.raises(AssertionError, match="colors off"):
            oracle_asserts.assert_colors_within(frame.rgb, expected, skip=skip)


@pytest.mark.long
@pytest.mark.parametrize("lanes", [4, 1])
@pytest.mark.parametrize("shader", ["phong", "gouraud", "pbr"])
def test_any_number_of_lanes_gives_the_same_bits(device, lanes, shader):
    scene = scene_of()
    assert same_bits(draw(device, scene, shader=shader), draw(device, scene, shader=shader, lanes=lanes))


def test_shadows_that_are_not_asked_for_change_no_bit(device):
    scene = scene_of()
    plain = draw(device, scene, shadows=False)
    assert same_bits(plain, draw(device, scene, shadows=False, forced={"SHADOWS"}))


@pytest.mark.long
@pytest.mark.parametrize(
    ("changes", "options", "reason"),
    [
        ({}, {"shadows": False}, "no shadows asked for"),
        ({"lights": ()}, {}, "no light shines"),
        ({}, {"shader": "nolight"}, "shader nolight"),
        ({"meshes": ()}, {}, "no triangle"),
    ],
)
def test_scenes_that_need_no_shadows_leave_them_out(device, changes, options, reason):
    frame = draw(device, replace(scene_of(), **changes), **options)
    assert frame.stats["left_out"]["SHADOWS"] == reason


def test_a_camera_that_moves_sees_the_same_shadow(device):
    """A point of the ground is lit or not wherever it is seen from."""
    scene = scene_of()
    with Renderer(scene, device=device, shadows=True, layers=("Z", "id")) as renderer:
        for eye in ((0.3, 3.0, 4.5), (-3.0, 4.0, 2.0)):
            frame = renderer.render(replace(CAMERA, eye=eye))
            oracle_asserts.assert_drawn(frame)


@pytest.mark.long
def test_the_hierarchy_counts_as_memory_of_the_scene(device):
    scene = scene_of()
    with Renderer(scene, device=device, shader="phong", shadows=True) as renderer:
        nbytes = renderer.render().stats["bytes"]["scene"]
        hierarchy = renderer._drawing.resident.casters.nbytes
    assert hierarchy > 0
    assert nbytes == draw(device, scene, layers=(), shader="phong", shadows=False).stats["bytes"]["scene"] + hierarchy
