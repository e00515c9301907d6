"""Cameras moved by angles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.scene.adjust_camera import adjusted, named_cameras
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera
from clshade.scene.framing import UPS, up_of
from clshade.scene.geometry import camera_axes

FRONT = Camera([0.0, 0.0, 5.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0, (1.0, 1.0), (100, 50))


def test_azimuth_goes_to_the_cameras_right():
    assert np.allclose(adjusted(FRONT, azimuth=90).eye, [5.0, 0.0, 0.0], atol=1e-12)
    assert np.allclose(adjusted(FRONT, azimuth=180).eye, [0.0, 0.0, -5.0], atol=1e-12)


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


def test_distance_is_kept():
    camera = adjusted(FRONT, azimuth=33, elevation=-20)
    assert np.linalg.norm(camera.eye - camera.lookat) == pytest.approx(5.0, rel=1e-14)


def test_view_angle_makes_square_pixels():
    camera = adjusted(FRONT, view_angle=90)
    assert camera.plane[0] / camera.focal == pytest.approx(2.0)
    assert camera.plane[1] / camera.plane[0] == pytest.approx(2.0)
    for wrong in (0.0, 180.0, float("nan")):
        with pytest.raises(InputError, match="view angle"):
            adjusted(FRONT, view_angle=wrong)


def test_orthographic_keeps_the_size_at_the_focal_point():
    camera = adjusted(FRONT, orthographic=True)
    assert camera.orthographic
    assert camera.plane == (5.0, 5.0)


def test_position_focal_point_and_up():
    camera = adjusted(FRONT, position=[1, 2, 3], focal_point=[1, 2, 0], up=[1, 0, 0])
    assert camera.eye.tolist() == [1, 2, 3]
    assert camera.lookat.tolist() == [1, 2, 0]
    assert camera.up.tolist() == [1, 0, 0]
    with pytest.raises(InputError):
        adjusted(FRONT, up=[0, 0, 1])
