"""Cameras moved by angles."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.scene.adjust_camera import adjusted
from clshade.scene.camera import Camera

FRONT = Camera([0.0, 0.0, 5.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0, (1.0, 1.0), (100, 50))


def test_azimuth_goes_to_the_cameras_right():
    assert np.allclose(adjusted(FRONT, azimuth=90).eye, [5.0, 0.0, 0.0], atol=1e-12)
    assert np.allclose(adjusted(FRONT, azimuth=180).eye, [0.0, 0.0, -5.0], atol=1e-12)


def test_elevation_goes_up_and_stops_short_of_the_pole():
    eye = adjusted(FRONT, elevation=30).eye
    assert np.allclose(eye, [0.0, 2.5, 5.0 * np.sqrt(0.75)], atol=1e-12)
    with pytest.raises(InputError, match="elevation"):
        adjusted(FRONT, elevation=90)
    with pytest.raises(InputError, match="elevation"):
        adjusted(adjusted(FRONT, elevation=60), elevation=40)


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
