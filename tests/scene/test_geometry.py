"""Vertex normals, camera axes and bounds against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from clshade.scene import geometry
from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, Scene

TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
OUTWARD = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])


def scene(*meshes) -> Scene:
    return Scene(meshes, Camera((0, 0, 9), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0)))


def test_a_face_counts_by_its_area():
    # At vertex 0: a face of twice the area in the xy plane and one in the yz plane: (1, 0, 2) / sqrt(5).
    verts = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    normals = geometry.vertex_normals(verts, [[0, 1, 2], [0, 2, 3]])
    assert np.abs(normals[0] - np.array([1, 0, 2]) / math.sqrt(5)).max() < 2e-16
    assert normals[[1, 3]].tolist() == [[0, 0, 1], [1, 0, 0]]


def test_no_area_no_faces_and_cancelling_faces_give_zero():
    verts = np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2], [5, 5, 5], [1, 0, 0]], float)
    normals = geometry.vertex_normals(verts, [[0, 1, 2], [1, 1, 0], [0, 0, 0]])
    assert not normals.any()
    assert not geometry.vertex_normals(verts, [[0, 4, 1], [0, 1, 4]]).any()
    assert geometry.vertex_normals(verts, np.zeros((0, 3), int)).shape == (5, 3)
    assert geometry.vertex_normals(np.zeros((0, 3)), np.zeros((0, 3), int)).shape == (0, 3)


@pytest.mark.parametrize("scale", [1.0, 1e-150, 1e-20, 1e20, 1e150])
def test_normals_of_a_tetrahedron_of_any_scale_point_from_its_center(scale):
    normals = geometry.vertex_normals(TETRAHEDRON * scale, OUTWARD)
    assert normals.dtype == np.float64
    assert np.abs(normals - TETRAHEDRON / math.sqrt(3)).max() < 1e-15


def test_what_keeps_the_bits():
    """A scale by a power of two, an offset that is exact, an unused vertex far away."""
    rng = np.random.default_rng(1)
    verts, faces = rng.standard_normal((50, 3)), rng.integers(0, 50, (200, 3))
    normals = geometry.vertex_normals(verts, faces)
    for exponent in (-480, -66, 1, 66, 480):
        assert np.array_equal(geometry.vertex_normals(np.ldexp(verts, exponent), faces), normals)
    normals = geometry.vertex_normals(TETRAHEDRON, OUTWARD)
    moved = (TETRAHEDRON + [1e6, -3e6, 2e6]).astype(np.float32)
    assert np.array_equal(geometry.vertex_normals(moved, OUTWARD), normals)
    verts = np.concatenate([TETRAHEDRON, [[1e300, -1e300, 0]]])
    assert np.array_equal(geometry.vertex_normals(verts, OUTWARD)[:4], normals)


def axes_of(eye, lookat, up) -> np.ndarray:
    return geometry.camera_axes(Camera(eye, lookat, up, 1.0, (1.0, 1.0)))


def test_camera_axes():
    assert axes_of((0, 0, 5), (0, 0, 0), (0, 3, 0)).tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, -1]]
    x, y, z = axes_of((1, 2, 3), (4, 6, 15), (0.1, 1, 0.2))
    assert np.abs(z - np.array([3, 4, 12]) / 13).max() < 2e-16
    # After squares, sum, root and division |y|^2 and |z|^2 are accurate to 5 * 2^-53, their product |x|^2 to twice
    # that.
    assert np.abs(np.array([x, y, z]) @ np.array([x, y, z]).T - np.eye(3)).max() < 10 * 2.0**-53
    assert np.linalg.det([x, y, -z]) == pytest.approx(1)  # right-handed with z towards the viewer: not mirrored
    assert y @ (0.1, 1, 0.2) > 0
    axes = axes_of((0, 0, 0), (0, 0, 1), (1e-9, 0, 1))  # an `up` that is nearly parallel
    assert np.abs(axes @ axes.T - np.eye(3)).max() < 4e-16


def test_camera_axes_at_any_scale():
    eye, lookat, up = np.array([1.0, -2, 3]), np.array([-4.0, 6, 1.5]), np.array([0.2, 1, 0])
    expected = axes_of(eye, lookat, up)
    for scale in (1e-300, 1e-20, 1e20, 1e307):
        assert np.abs(axes_of(eye * scale, lookat * scale, up) - expected).max() < 1e-15
        assert np.abs(axes_of(eye, lookat, up * scale) - expected).max() < 1e-15
    assert np.array_equal(axes_of(np.ldexp(eye, 99), np.ldexp(lookat, 99), up), expected)


def test_bounds_of_what_faces_use_in_every_place():
    verts = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 6], [99, 99, 99]], np.float32)
    twice = np.eye(4)
    twice[:3] *= 2
    twice[:3, 3] = [10, 0, -1]
    mesh = Mesh(verts, [[0, 1, 2]])
    low, high = geometry.bounding_box(scene(mesh))
    assert (low.tolist(), high.tolist()) == ([0, 0, 0], [2, 3, 6])
    assert geometry.half_diagonal(*geometry.bounding_box(scene(mesh))) == 3.5
    placed = Mesh(verts, [[0, 1, 2]], instances=np.stack([np.eye(4), twice]))
    low, high = geometry.bounding_box(scene(mesh, placed))
    assert (low.tolist(), high.tolist()) == ([0, 0, -1], [14, 6, 11])
