"""Devices without float64: the host projects, and no bit changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kernel_stages import project
from view_cameras import CAMERAS, around, cameras

import clshade
from clshade.pipeline import struct_layout
from clshade.pipeline.camera_space import CameraSpace, project_on_host
from clshade.scene.camera import raster_of
from clshade.scene.geometry import camera_axes


@pytest.mark.sampled
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("camera", cameras(), ids=CAMERAS)
def test_the_host_projects_as_the_kernel_does(device, camera, dtype):
    points = around(camera, dtype=dtype)
    points[:50] *= 1e9
    distance = np.linalg.norm(camera.lookat - camera.eye)
    near, scale = 1e-3 * distance, 2.0 ** -np.ceil(np.log2(distance))
    made = project(device, points, camera, near, scale)
    vertices, relative = np.empty(len(points), struct_layout.SINGLE.Vertex), np.empty((len(points), 4), np.float32)
    project_on_host(
        points, CameraSpace(camera, camera_axes(camera), near, scale, raster_of(camera)), vertices, relative
    )
    assert vertices.tobytes() == made.projected.to_host().tobytes()
    assert relative.tobytes() == made.relative.to_host().tobytes()


@pytest.mark.long
@pytest.mark.parametrize("preset", ["standard", "course"])
def test_frames_without_float64_have_the_same_bits(device, preset):
    scene = clshade.builtin("course")
    options = {"preset": preset, "layers": ("Z", "id"), "resolution": (161, 97)}
    without, with_it = (
        clshade.render(scene, device=replace(device, has_fp64=has), **options) for has in (False, device.has_fp64)
    )
    assert without["id"].any()
    for a, b in zip(without.channels().values(), with_it.channels().values(), strict=True):
        assert a.tobytes() == b.tobytes()
