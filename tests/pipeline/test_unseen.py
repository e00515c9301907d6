"""The line that says why an image shows nothing."""

from dataclasses import replace

import numpy as np
import pytest
from devices import rendered

from clshade.pipeline.frame import Frame
from clshade.pipeline.frame_results import why_unseen
from clshade.scene.camera import Camera
from clshade.scene.ground import with_ground
from clshade.scene.model import Material, Mesh, PointLight, Scene, Texture

TRIANGLE = Mesh(np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
CAMERA = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (24, 20))
LIGHT = PointLight((0, 0, 4))
UNSEEN, BLACK = "nothing can be seen: ", "the image is black: "


def with_material(**fields: object) -> Mesh:
    return replace(TRIANGLE, material=Material(**fields))


def line_of(frame: Frame) -> str:
    return why_unseen(frame.rgba, frame.scene, frame.settings, frame.stats)


def draw(device, mesh: Mesh, *lights: PointLight, camera: Camera = CAMERA, **fields: object) -> Frame:
    return rendered(Scene(mesh, camera, lights, **{"ambient": 0.0, "background": None, **fields}), device=device)


SIDES, BACK, TURNED = with_material(sides="front"), {"eye": (0, 0, -4)}, np.array([[0, 2, 1]])
HOLES = replace(with_material(alpha_cutoff=0.5, texture=Texture(np.zeros((1, 1, 4)))), uvs=np.zeros((3, 2)))
MIRRORED = replace(SIDES, instances=np.diag([-1.0, 1, 1, 1])[None])
BEHIND, FROM_BEHIND = "every triangle is behind the camera", "every triangle is seen from behind, which is not drawn"
SMALL = "every triangle is smaller than a pixel and between its samples"
NOT_COVERED = [  # mesh; changes of the camera; the reason, "": it is seen
    (with_material(blend=True, opacity=0.0), {}, "the opacity of all materials is 0"),
    (HOLES, {}, "alpha is 0, or below its cutoff, wherever there is a face"),
    (TRIANGLE, {"lookat": (0, 0, 9)}, BEHIND),
    (TRIANGLE, {"lookat": (0, 0, 9), "orthographic": True}, BEHIND),
    (TRIANGLE, {"eye": (50, 0, 4), "lookat": (50, 0, 0)}, "every triangle is beside the image"),
    (replace(SIDES, faces=TURNED), {}, FROM_BEHIND),
    (MIRRORED, BACK, FROM_BEHIND),
    (MIRRORED, {}, ""),
    (replace(TRIANGLE, verts=TRIANGLE.verts * 1e-2 + 0.05), {}, SMALL),
    (replace(TRIANGLE, faces=np.array([[0, 1, 1]])), {}, "every triangle is without area"),
    (replace(TRIANGLE, verts=TRIANGLE.verts[:, [0, 2, 1]]), {}, "every triangle is without area"),  # edge-on
    (TRIANGLE, {}, ""),
    (replace(TRIANGLE, verts=TRIANGLE.verts * [1, 1, 20]), {}, ""),
]


@pytest.mark.parametrize(("mesh", "camera", "reason"), NOT_COVERED)
def test_nothing_is_covered_alone_or_but_a_ground(device, mesh, camera, reason):
    camera = replace(CAMERA, **camera)
    assert line_of(draw(device, mesh, LIGHT, camera=camera)) == (UNSEEN + reason if reason else "")
    if "sample" in reason or "alpha" in reason or "opacity" in reason:
        return
    frame = rendered(with_ground(Scene(mesh, camera, LIGHT, background=0.5), "y"), device=device)
    but = " but the ground" if frame.alpha.any() else ""
    assert line_of(frame) == (f"nothing can be seen{but}: {reason}" if reason else "")


BELOW = replace(LIGHT, position=(0, 0, -4))
DARK, GRAY = with_material(ka=0, kd=0, ks=0), with_material(ka=0.5, kd=0, ks=0)


@pytest.mark.parametrize(
    ("mesh", "lights", "fields", "reason"),
    [
        (TRIANGLE, (), {}, BLACK + "the scene has no light"),
        (TRIANGLE, (BELOW,), {}, BLACK + "no light reaches the faces in view, and there is no ambient light"),
        (DARK, (LIGHT,), {"ambient": 1.0}, BLACK + "materials or colors of all faces in view are black"),
        (GRAY, (), {"ambient": 1.0, "background": 0.5}, UNSEEN + "all that is drawn has the color of the background"),
        (TRIANGLE, (LIGHT,), {"background": (0.5, 0.5, 0.5)}, ""),  # black before gray
        (Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), (LIGHT,), {}, ""),
    ],
)
def test_all_is_black(device, mesh, lights, fields, reason):
    assert line_of(draw(device, mesh, *lights, **fields)) == reason


def test_the_line_is_a_warning_of_the_files(device, tmp_path):
    frame = draw(device, TRIANGLE)
    with pytest.warns(UserWarning, match=BLACK):
        assert frame.save(tmp_path / "dark") == [BLACK + "the scene has no light"]
