"""The line that says why an image shows nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from devices import rendered

from clshade.pipeline.frame_results import why_unseen
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.ground import with_ground
from clshade.scene.model import Material, Mesh, PointLight, Scene, Texture

TRIANGLE = Mesh(np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
CAMERA = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (24, 20))
LIGHT = PointLight((0, 0, 4))
UNSEEN, BLACK = "nothing can be seen: ", "the image is black: "


def with_material(**fields: object) -> Mesh:
    return replace(TRIANGLE, material=Material(**fields))


def line_of(device, mesh: Mesh, *lights: PointLight, camera: Camera = CAMERA, **fields: object) -> str:
    scene = Scene((mesh,), camera, lights, **{"ambient": 0.0, "background": None, **fields})
    frame = rendered(scene, device=device, shader="gouraud")
    return why_unseen(frame.rgba, frame.scene, frame.settings, frame.stats)


def test_what_can_be_seen_needs_no_line(device):
    assert line_of(device, TRIANGLE, LIGHT) == ""
    assert line_of(device, TRIANGLE, background=(0.5, 0.5, 0.5)) == ""  # black before gray
    assert line_of(device, Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), LIGHT) == ""


NOT_COVERED = [
    (with_material(blend=True, opacity=0.0), {}, "the opacity of all materials is 0"),
    (
        replace(with_material(alpha_cutoff=0.5, texture=Texture(np.zeros((1, 1, 4)))), uvs=np.zeros((3, 2))),
        {},
        "alpha is 0, or below its cutoff, wherever there is a face",
    ),
    (TRIANGLE, {"lookat": (0, 0, 9)}, "every triangle is behind the camera"),
    (TRIANGLE, {"eye": (50, 0, 4), "lookat": (50, 0, 0)}, "every triangle is beside the image"),
    (
        replace(with_material(sides="front"), faces=np.array([[0, 2, 1]])),
        {},
        "every triangle is seen from behind, which is not drawn",
    ),
    (
        replace(TRIANGLE, verts=TRIANGLE.verts * 1e-2 + 0.05),
        {},
        "every triangle is smaller than a pixel and between its samples",
    ),
    (replace(TRIANGLE, faces=np.array([[0, 1, 1]])), {}, "every triangle is without area"),
]


@pytest.mark.parametrize(("mesh", "camera", "reason"), NOT_COVERED)
def test_nothing_is_covered(device, mesh, camera, reason):
    line = line_of(device, mesh, LIGHT, camera=replace(CAMERA, **camera))
    assert line.startswith(UNSEEN)
    assert line.endswith(reason)


@pytest.mark.parametrize(
    ("mesh", "lights", "fields", "reason"),
    [
        (TRIANGLE, (), {}, "the scene has no light"),
        (TRIANGLE, (PointLight((0, 0, -4)),), {}, "no light reaches the faces in view, and there is no ambient light"),
        (
            with_material(ka=0, kd=0, ks=0),
            (LIGHT,),
            {"ambient": 1.0},
            "materials or colors of all faces in view are black",
        ),
    ],
)
def test_all_is_black(device, mesh, lights, fields, reason):
    assert line_of(device, mesh, *lights, **fields) == BLACK + reason


def test_the_color_of_the_background(device):
    mesh = with_material(ka=0.5, kd=0, ks=0)
    line = line_of(device, mesh, ambient=1.0, background=0.5)
    assert line == UNSEEN + "all that is drawn has the color of the background"


def test_the_line_is_a_warning_of_the_files(device, tmp_path):
    frame = rendered(Scene((TRIANGLE,), CAMERA, (), ambient=0.0), device=device)
    with pytest.warns(UserWarning, match=BLACK):
        assert frame.save(tmp_path / "dark") == [BLACK + "the scene has no light"]


MIRRORED = replace(with_material(sides="front"), instances=np.diag([-1.0, 1, 1, 1])[None])


@pytest.mark.parametrize(
    ("mesh", "camera", "reason"),
    [case for case in NOT_COVERED if "sample" not in case[2] and "alpha" not in case[2]]
    + [
        (replace(TRIANGLE, verts=TRIANGLE.verts[:, [0, 2, 1]]), {}, "every triangle is without area"),  # edge-on
        (TRIANGLE, {"lookat": (0, 0, 9), "orthographic": True}, "every triangle is behind the camera"),
        (MIRRORED, {"eye": (0, 0, -4)}, "every triangle is seen from behind, which is not drawn"),
        (MIRRORED, {}, ""),
        (TRIANGLE, {}, ""),
        (replace(TRIANGLE, verts=TRIANGLE.verts * [1, 1, 20]), {}, ""),
    ],
)
def test_a_ground_is_not_what_a_scene_shows(device, mesh, camera, reason):
    scene = with_ground(Scene((mesh,), replace(CAMERA, **camera), (LIGHT,), background=0.5), "y")
    with Renderer(scene, device=device, shader="gouraud") as renderer:
        frame = renderer.render()
        ids = Renderer(scene, device=device, shader="gouraud", layers=("id",)).render()["id"]
    assert bool(((ids > 0) & (ids <= scene.meshes[0].faces.shape[0])).any()) == (reason == "")
    line = why_unseen(frame.rgba, frame.scene, frame.settings, frame.stats)
    but = " but the ground" if frame.alpha.any() else ""
    assert line == (f"nothing can be seen{but}: {reason}" if reason else "")
