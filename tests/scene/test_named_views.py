"""Named views: what they see from where, and that they show the whole scene at one scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import clshade
from clshade.errors import InputError
from clshade.scene import geometry
from clshade.scene.adjust_camera import VIEWS, named_cameras, seen_by, towards_eye, units_per_pixel, up_of
from clshade.scene.framing import FILL
from clshade.scene.model import Mesh, PointLight, Scene

NAMED = VIEWS[:-1]


def box(size, up=(0.0, 1.0, 0.0), resolution=(80, 60)):
    """Return a scene with two triangles that span a box of this size about (10, 20, 30)."""
    half = np.array(size, np.float64) / 2.0
    verts = np.array([10.0, 20.0, 30.0]) + half * [(-1, -1, -1), (1, -1, -1), (1, 1, 1), (-1, 1, 1)]
    camera = clshade.Camera.from_fov((13.0, 25.0, 49.0), (10.0, 20.0, 30.0), up, 35.0, resolution)
    return Scene(Mesh(verts, [(0, 1, 2), (0, 2, 3)]), camera, PointLight((10.0, 20.0, 60.0)))


@pytest.mark.parametrize(
    ("up", "eyes"),
    [
        ((0.1, 1.0, 0.2), ("+z", "-z", "-x", "+x", "+y", "-y", "+x +y +z")),
        ((0.0, 0.1, 1.0), ("-y", "+y", "-x", "+x", "+z", "-z", "+x -y +z")),
        ((0.0, -1.0, 0.1), ("+z", "-z", "+x", "-x", "-y", "+y", "-x -y +z")),
    ],
)
def test_where_the_eye_is(up, eyes):
    cameras = named_cameras(box((2.0, 3.0, 4.0), up), NAMED)
    assert tuple(map(towards_eye, cameras.values())) == eyes
    assert all(camera.orthographic and (camera.lookat == (10, 20, 30)).all() for camera in cameras.values())
    upward = geometry.camera_axes(cameras["front"])[1]
    assert upward.round(12).tolist() == np.sign(np.round(up)).tolist()
    assert (
        up_of(clshade.Camera.from_fov((5, 6, 7), (0, 0, 0), upward, 30.0))
        == ("-" * bool(min(up) < 0)) + ("xyz"[int(np.argmax(np.abs(up)))])
    )


@pytest.mark.parametrize(
    "size", [(2.0, 3.0, 4.0), (100.0, 1.0, 0.01), (0.0, 5.0, 0.0), (0.0, 0.0, 0.0), (1e-30, 1e-30, 0)]
)
@pytest.mark.parametrize("resolution", [(80, 60), (60, 80), (512, 1)])
def test_the_whole_scene_fits_at_one_scale(size, resolution):
    scene = box(size, resolution=resolution)
    cameras = named_cameras(scene, NAMED)
    assert len({camera.plane for camera in cameras.values()}) == 1
    low, high = geometry.bounding_box(scene)
    fill = 0.0
    for camera in cameras.values():
        half = np.abs(geometry.camera_axes(camera)[:2] @ (scene.meshes[0].verts - camera.lookat).T).max(axis=1)
        assert (half <= np.array(camera.plane[::-1]) / 2.0).all()
        fill = max(fill, *(2.0 * half / camera.plane[::-1]))
        assert np.linalg.norm(camera.eye - camera.lookat) > np.linalg.norm(high - low) / 2.0
    assert fill == pytest.approx(FILL if (high > low).any() else 0.0)


def test_the_scenes_own_camera_and_another_resolution():
    scene = box((2.0, 3.0, 4.0))
    cameras = named_cameras(scene, ("camera", "top", "camera"))
    assert list(cameras) == ["camera", "top"]
    assert cameras["camera"] is scene.camera
    cameras = named_cameras(scene, ("camera", "top"), (30, 40))
    assert {camera.resolution for camera in cameras.values()} == {(30, 40)}
    for names in (("front", "side"), ("",)):
        with pytest.raises(InputError, match="one of front, back, left, right"):
            named_cameras(scene, names)


def test_units_per_pixel():
    scene = box((2.0, 3.0, 4.0))
    flat = replace(scene.camera, orthographic=True, plane=(6.0, 8.0))
    assert units_per_pixel(flat) == 8.0 / 80
    distance = np.linalg.norm(scene.camera.lookat - scene.camera.eye)
    assert units_per_pixel(scene.camera) == pytest.approx(2.0 * distance * np.tan(np.radians(17.5)) / 60)


def test_the_lights_turn_with_the_view():
    scene = box((2.0, 3.0, 4.0))
    scene = replace(scene, camera=clshade.Camera.from_fov((10, 20, 90), (10, 20, 30), (0, 1, 0), 20.0, (80, 60)))
    cameras = named_cameras(scene, VIEWS)
    for name, place in (
        ("front", (10, 20, 60)),
        ("back", (10, 20, 0)),
        ("right", (40, 20, 30)),
        ("top", (10, 50, 30)),
        ("camera", (10, 20, 60)),
    ):
        view = seen_by(scene, cameras[name])
        assert view.camera is cameras[name]
        np.testing.assert_allclose(view.lights[0].position, place, atol=1e-12)
        assert seen_by(scene, cameras[name], fixed_lights=True).lights == scene.lights
    assert seen_by(scene, scene.camera.with_resolution((7, 5))).lights == scene.lights
