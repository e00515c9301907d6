"""Cameras moved by angles, and named views: what they see from where, and that they show the whole scene at one scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.scene import geometry
from clshade.scene.adjust_camera import VIEWS, adjusted, named_cameras, towards_eye, up_of
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera
from clshade.scene.framing import FILL, UPS
from clshade.scene.geometry import camera_axes
from clshade.scene.model import Mesh, Scene

NAMED = VIEWS[:-1]


def box(size, up=(0.0, 1.0, 0.0), resolution=(80, 60)):
    """Return a scene with two triangles that span a box of this size about (10, 20, 30)."""
    half = np.array(size, np.float64) / 2.0
    verts = np.array([10.0, 20.0, 30.0]) + half * [(-1, -1, -1), (1, -1, -1), (1, 1, 1), (-1, 1, 1)]
    camera = Camera.from_fov((13.0, 25.0, 49.0), (10.0, 20.0, 30.0), up, 35.0, resolution)
    return Scene(Mesh(verts, [(0, 1, 2), (0, 2, 3)]), camera)


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
    upward = camera_axes(cameras["front"])[1]
    assert upward.round(12).tolist() == np.sign(np.round(up)).tolist()
    assert (
        up_of(Camera.from_fov((5, 6, 7), (0, 0, 0), upward, 30.0)) == "-" * (min(up) < 0) + "xyz"[np.argmax(np.abs(up))]
    )


@pytest.mark.parametrize("size", [(2, 3, 4), (100, 1, 0.01), (0, 5, 0), (0, 0, 0), (1e-30, 1e-30, 0)])
@pytest.mark.parametrize("resolution", [(80, 60), (60, 80), (512, 1)])
def test_the_whole_scene_fits_at_one_scale(size, resolution):
    scene = box(size, resolution=resolution)
    cameras = named_cameras(scene, NAMED)
    assert len({camera.plane for camera in cameras.values()}) == 1
    low, high = geometry.bounding_box(scene)
    fill = 0.0
    for camera in cameras.values():
        half = np.abs(camera_axes(camera)[:2] @ (scene.meshes[0].verts - camera.lookat).T).max(axis=1)
        assert (half <= np.array(camera.plane[::-1]) / 2.0).all()
        fill = max(fill, *(2.0 * half / camera.plane[::-1]))
        assert np.linalg.norm(camera.eye - camera.lookat) > np.linalg.norm(high - low) / 2.0
    assert fill == pytest.approx(FILL if (high > low).any() else 0.0)


# Moved by angles


FRONT = Camera([0.0, 0.0, 5.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0, (1.0, 1.0), (100, 50))


@pytest.mark.parametrize("elevation", [30.0, 90.0, -90.0, 120.0, -135.0, 180.0, 270.0, 400.0, -1e9])
@pytest.mark.parametrize("azimuth", [0.0, 50.0])
def test_elevation_turns_the_camera_over_the_poles(elevation, azimuth):
    """The camera as a whole turns about the axis to its right, then about the scene's vertical, which stays its `up`."""
    camera = adjusted(FRONT, elevation=elevation, azimuth=azimuth)
    up, round_ = np.radians(elevation), np.radians(azimuth)
    turn = np.array([[np.cos(round_), 0, np.sin(round_)], [0, 1, 0], [-np.sin(round_), 0, np.cos(round_)]])
    turn = turn @ [[1, 0, 0], [0, np.cos(up), np.sin(up)], [0, -np.sin(up), np.cos(up)]]
    assert np.allclose(camera.eye, turn @ FRONT.eye, atol=1e-6)
    assert np.allclose(camera_axes(camera), np.array(camera_axes(FRONT)) @ turn.T, atol=1e-6)
    assert np.allclose(np.abs(camera.up), [0.0, 1.0, 0.0], atol=2e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("up", UPS)
def test_a_camera_above_or_below_what_it_looks_at_sees_the_view_of_that_name(capsys, up, sign):
    """Its `up` stays the scene's, so that it goes round the scene's vertical."""
    above = np.array(UPS[up][1], float) * sign
    front = replace(FRONT, eye=np.array(UPS[up][2]) * 5.0, up=UPS[up][1])
    camera = adjusted(front, position=above * 3.0)
    view = named_cameras(replace(builtin("icosphere"), camera=front), ["top" if sign > 0 else "bottom"])
    assert np.allclose(camera_axes(camera), camera_axes(*view.values()), atol=1e-9)
    assert up_of(camera) == up
    upward = ",".join(f"{axis + 0.0:g}" for axis in np.array(camera_axes(camera)[1]).round())
    assert f"its up vector: {upward} is up in the image" in capsys.readouterr().err
    quarter = adjusted(camera, azimuth=90.0)
    assert np.allclose(quarter.eye, camera.eye, atol=1e-5)
    turned = np.cross(above * sign, camera_axes(camera)[0])
    assert np.allclose(camera_axes(quarter)[0], turned, atol=1e-5)
    with pytest.raises(InputError, match="a vector not parallel to lookat - eye"):
        adjusted(front, position=above * 3.0, up=above)


def test_other_changes_of_a_camera():
    """A view angle makes square pixels; an orthographic camera keeps the size at the focal point."""
    assert np.linalg.norm(adjusted(FRONT, azimuth=33, elevation=-20).eye) == pytest.approx(5.0, rel=1e-14)
    wide = adjusted(FRONT, view_angle=90)
    assert (wide.plane[0] / wide.focal, wide.plane[1] / wide.plane[0]) == pytest.approx((2.0, 2.0))
    flat = adjusted(FRONT, orthographic=True)
    assert (flat.orthographic, flat.plane) == (True, (5.0, 5.0))
    placed = adjusted(FRONT, position=[1, 2, 3], focal_point=[1, 2, 0], up=[1, 0, 0])
    assert [vector.tolist() for vector in (placed.eye, placed.lookat, placed.up)] == [[1, 2, 3], [1, 2, 0], [1, 0, 0]]
