"""Vertex normals, camera axes and bounds against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.scene import geometry
from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, Scene

TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
OUTWARD = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])


def scene(*meshes) -> Scene:
    return Scene(meshes, Camera((0, 0, 9), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0)))


def test_normals_of_a_tetrahedron_point_from_its_center():
    normals = geometry.vertex_normals(TETRAHEDRON, OUTWARD)
    assert normals.dtype == np.float64
    assert np.abs(normals - TETRAHEDRON / math.sqrt(3)).max() < 4e-16


def test_a_face_counts_by_its_area():
    # At vertex 0: a face of twice the area in the xy plane and one in the yz plane: (1, 0, 2) / sqrt(5).
    verts = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    normals = geometry.vertex_normals(verts, [[0, 1, 2], [0, 2, 3]])
    assert np.abs(normals[0] - np.array([1, 0, 2]) / math.sqrt(5)).max() < 2e-16
    assert normals[1].tolist() == [0, 0, 1]
    assert normals[3].tolist() == [1, 0, 0]


def test_no_area_no_faces_and_cancelling_faces_give_zero():
    verts = np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2], [5, 5, 5], [1, 0, 0]], float)
    normals = geometry.vertex_normals(verts, [[0, 1, 2], [1, 1, 0], [0, 0, 0]])
    assert not normals.any()
    assert not geometry.vertex_normals(verts, [[0, 4, 1], [0, 1, 4]]).any()
    assert geometry.vertex_normals(verts, np.zeros((0, 3), int)).shape == (5, 3)
    assert geometry.vertex_normals(np.zeros((0, 3)), np.zeros((0, 3), int)).shape == (0, 3)


@pytest.mark.parametrize("exponent", [-480, -66, 1, 66, 480])
def test_scale_by_a_power_of_two_keeps_the_bits(exponent):
    rng = np.random.default_rng(1)
    verts, faces = rng.standard_normal((50, 3)), rng.integers(0, 50, (200, 3))
    expected = geometry.vertex_normals(verts, faces)
    assert np.array_equal(geometry.vertex_normals(np.ldexp(verts, exponent), faces), expected)


@pytest.mark.parametrize("scale", [1e-150, 1e-20, 1e20, 1e150])
def test_any_scale(scale):
    normals = geometry.vertex_normals(TETRAHEDRON * scale, OUTWARD)
    assert np.abs(normals - TETRAHEDRON / math.sqrt(3)).max() < 1e-15


def test_an_offset_that_is_exact_keeps_the_bits():
    expected = geometry.vertex_normals(TETRAHEDRON, OUTWARD)
    moved = (TETRAHEDRON + [1e6, -3e6, 2e6]).astype(np.float32)
    assert np.array_equal(geometry.vertex_normals(moved, OUTWARD), expected)


def test_an_unused_far_vertex_changes_nothing():
    verts = np.concatenate([TETRAHEDRON, [[1e300, -1e300, 0]]])
    assert np.array_equal(geometry.vertex_normals(verts, OUTWARD)[:4], geometry.vertex_normals(TETRAHEDRON, OUTWARD))


def test_many_faces_in_blocks_are_the_plain_sum():
    rng = np.random.default_rng(2)
    verts, faces = rng.standard_normal((3000, 3)), rng.integers(0, 3000, (40000, 3))
    a, b, c = verts[faces].transpose(1, 0, 2)
    sums = np.zeros((3000, 3))
    np.add.at(sums, faces, np.cross(b - a, c - a)[:, None])
    expected = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    # Sums of some 40 terms, which cancel to a fraction of their size: 40 roundings, relative to the smallest sum.
    bound = 40 * 2**-52 * np.abs(sums).max() / np.linalg.norm(sums, axis=1).min()
    assert np.abs(geometry.vertex_normals(verts, faces) - expected).max() < bound


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


@pytest.mark.parametrize("scale", [1e-300, 1e-20, 1.0, 1e20, 1e307])
def test_camera_axes_at_any_scale(scale):
    eye, lookat, up = np.array([1.0, -2, 3]), np.array([-4.0, 6, 1.5]), np.array([0.2, 1, 0])
    expected = axes_of(eye, lookat, up)
    assert np.abs(axes_of(eye * scale, lookat * scale, up) - expected).max() < 1e-15
    assert np.abs(axes_of(eye, lookat, up * scale) - expected).max() < 1e-15
    assert np.array_equal(axes_of(np.ldexp(eye, 99), np.ldexp(lookat, 99), up), expected)


def test_camera_axes_with_nearly_parallel_up_are_still_orthonormal():
    axes = axes_of((0, 0, 0), (0, 0, 1), (1e-9, 0, 1))
    assert np.abs(axes @ axes.T - np.eye(3)).max() < 4e-16
    assert np.abs(axes[1] - [1, 0, 0]).max() < 1e-15


@pytest.mark.parametrize(
    ("field", "eye", "lookat", "up"),
    [
        ("lookat", (1, 2, 3), (1, 2, 3), (0, 1, 0)),
        ("up", (0, 0, 0), (0, 0, 1), (0, 0, 2)),
        ("up", (0, 0, 0), (0, 0, 1), (0, 0, 0)),
        ("eye", (0, 0, math.nan), (0, 0, 1), (0, 1, 0)),
    ],
)
def test_camera_axes_refuse(field, eye, lookat, up):
    with pytest.raises(InputError, match=f": {field}: expected"):
        axes_of(eye, lookat, up)


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


def test_bounds_of_nothing_and_of_large_scenes():
    empty = scene(Mesh(np.ones((3, 3)), np.zeros((0, 3), int)))
    assert geometry.half_diagonal(*geometry.bounding_box(empty)) == 0.0
    assert not np.array(geometry.bounding_box(empty)).any()
    large = scene(Mesh(np.array([[-1e308, 0, 0], [1e308, 0, 0], [0, 1, 0]]), [[0, 1, 2]]))
    assert geometry.half_diagonal(*geometry.bounding_box(large)) == 1e308
    far = np.eye(4) * [1e300, 1, 1, 1]
    with pytest.raises(InputError, match="overflow"):
        geometry.bounding_box(scene(Mesh(np.full((3, 3), 1e300), [[0, 1, 2]], instances=far[None])))
