"""Scenes of more than 2^24 triangles: their images are those of the few that show, whose indices are beyond."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, PointLight, Scene

pytestmark = pytest.mark.long

BEFORE = 1 << 24  # faces without area before the others
CAMERA = Camera.from_fov((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 60.0, (96, 64))
OPTIONS = [{}, {"visibility": "painter", "interpolation": "affine"}, {"shader": "gouraud", "shadows": True}]


def soup(before: int) -> Scene:
    """Return 600 triangles, a third of them twice in one plane, some across the near plane, after others without area."""
    rng = np.random.default_rng(1)
    corners = rng.uniform(-1.0, 1.0, (400, 1, 3)) + rng.uniform(-0.5, 0.5, (400, 3, 3))
    corners[::20, 0, 2] += 4.0
    verts, triangles = corners.reshape(-1, 3).astype(np.float32), np.arange(1200).reshape(-1, 3)
    faces = np.zeros((before + 600, 3), np.int32)
    faces[before:] = np.concatenate([triangles, triangles[:200, [1, 2, 0]]])
    normals = rng.normal(size=verts.shape)
    mesh = Mesh(verts, faces, normals=normals, colors=rng.random(verts.shape), material=Material(n=8.0))
    return Scene((mesh,), CAMERA, (PointLight((2.0, 3.0, 4.0), np.ones(3)),))


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_the_image_is_that_of_the_faces_that_show(device, options):
    if device.memory < 4 << 30:
        pytest.skip("needs a device with 4 GiB")
    frames = []
    for before in (0, BEFORE):
        with Renderer(soup(before), device=device, layers=("Z", "id"), near=0.1, **options) as renderer:
            frames += [renderer.render(), renderer.render(replace(CAMERA, eye=CAMERA.eye + [0.1, 0.2, 0.0]))]
    for few, many in zip(frames[:2], frames[2:], strict=True):
        assert few.stats["clipped"] > 10
        assert many.stats["triangles"] == BEFORE + few.stats["triangles"]
        assert many.stats["visible"] == few.stats["visible"]
        assert len(np.unique(few["id"])) > 100
        assert np.array_equal(few.rgba, many.rgba)
        assert np.array_equal(few["Z"], many["Z"])
        assert np.array_equal(np.where(few["id"] > 0, few["id"] + np.uint32(BEFORE), np.uint32(0)), many["id"])
