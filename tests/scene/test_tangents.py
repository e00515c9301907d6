"""Tangents of meshes: MikkTSpace's groups, sides and weights."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clshade.oracle.corners import corner_tangents as reference_tangents
from clshade.scene.geometry import vertex_normals
from clshade.scene.tangents import corner_tangents

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
UP = np.tile([0.0, 0.0, 1.0], (4, 1))
UPRIGHT = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], float)  # the image stands as the square does: v = 0 is at the top


def at_corners(verts, faces, normals, uvs, normal_faces=None, uv_faces=None):
    normal_faces, uv_faces = (faces if index is None else index for index in (normal_faces, uv_faces))
    tangents, index = corner_tangents(verts, faces, normals, normal_faces, uvs, uv_faces)
    return tangents[index]


def assert_as_reference(verts, faces, normals, uvs):
    tangents = at_corners(verts, faces, normals, uvs)
    assert not np.isnan(tangents).any()
    np.testing.assert_allclose(tangents, reference_tangents(verts[faces], normals[faces], uvs[faces]), atol=1e-9)
    return tangents


def grid(rows, columns, height=0.3, seed=0):
    """Return a bumpy surface: vertices, faces, normals, texture coordinates."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    verts = np.stack([x, y, height * rng.random((rows, columns))], -1).reshape(-1, 3)
    at = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.reshape(-1) for part in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    return verts, faces, vertex_normals(verts, faces), np.stack([x, 1 - y], -1).reshape(-1, 2)


@pytest.mark.parametrize(
    ("uvs", "tangent"),
    [
        (UPRIGHT, [1.0, 0.0, 0.0, 1.0]),  # to the right, and the bitangent up
        (UPRIGHT * [-1.0, 1.0], [-1.0, 0.0, 0.0, -1.0]),  # mirrored
        (UPRIGHT[:, ::-1] * [1.0, -1.0], [0.0, -1.0, 0.0, 1.0]),  # turned
    ],
)
def test_upright_mirrored_and_turned_images(uvs, tangent):
    tangents = at_corners(SQUARE, FACES, UP, uvs)
    np.testing.assert_allclose(tangents, np.broadcast_to(tangent, (2, 3, 4)), atol=1e-15)


def test_mirrored_halves_split_the_vertices_of_their_seam():
    verts = np.array([[-1, 0, 0], [0, 0, 0.5], [1, 0, 0], [-1, 1, 0], [0, 1, 0.5], [1, 1, 0]], float)
    faces = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]], np.int32)
    uvs = np.column_stack([np.abs(verts[:, 0]), 1.0 - verts[:, 1]])
    tangents = assert_as_reference(verts, faces, vertex_normals(verts, faces), uvs)
    np.testing.assert_array_equal(tangents[..., 3], np.repeat([-1.0, 1.0], [2, 2])[:, None] * np.ones(3))
    assert (tangents[:2, :, 0] < 0.0).all()
    assert (tangents[2:, :, 0] > 0.0).all()


def test_angles_weigh_not_areas():
    """A corner between a small face with 90 degrees and a large one with 45, whose directions of u differ."""
    verts = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-9, 9, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    uvs = np.array([[0, 0], [1, 0], [0, -1], [-9, -20]], float)
    first, second = (reference_tangents(verts[[face]], UP[None, :3], uvs[[face]])[0, 0, :3] for face in faces)
    expected = np.pi / 2 * first + np.pi / 4 * second
    tangent = at_corners(verts, faces, UP, uvs)[0, 0, :3]
    np.testing.assert_allclose(tangent, expected / np.linalg.norm(expected), atol=1e-15)


@pytest.mark.parametrize("seed", range(3))
def test_surfaces_agree_with_the_reference(seed):
    verts, faces, normals, uvs = grid(5, 6, seed=seed)
    tangents = assert_as_reference(verts, faces, normals, uvs)
    np.testing.assert_allclose((tangents[..., :3] * normals[faces]).sum(axis=2), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(tangents[..., :3], axis=2), 1.0, atol=1e-12)
    mirrored = uvs + 0.4 * np.random.default_rng(seed).random(uvs.shape)
    assert_as_reference(verts, faces, normals, mirrored)  # of some faces


@given(st.integers(0, 2**32 - 1))
def test_any_triangles_agree_with_the_reference(seed):
    rng = np.random.default_rng(seed)
    verts = rng.integers(-2, 3, (6, 3)).astype(float)
    faces = rng.integers(0, 6, (rng.integers(1, 12), 3)).astype(np.int32)
    uvs = rng.integers(-1, 2, (6, 2)).astype(float)
    assert_as_reference(verts, faces, vertex_normals(verts, faces), uvs)


def test_separate_indices_are_as_shared_ones_and_scale_does_not_matter():
    verts, faces, normals, uvs = grid(4, 4)
    rng = np.random.default_rng(1)
    orders = [rng.permutation(len(verts)).astype(np.int32) for _ in range(2)]
    moved = [np.argsort(order).astype(np.int32)[faces] for order in orders]
    tangents = at_corners(verts, faces, normals[orders[0]], uvs[orders[1]], *moved)
    expected = at_corners(verts, faces, normals, uvs)
    np.testing.assert_allclose(tangents, expected, atol=1e-12)
    for scale in (2.0**-600, 2.0**600):
        np.testing.assert_array_equal(at_corners(verts * scale, faces, normals, uvs), expected)


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf, -3e38])
def test_no_direction_gives_zero(bad):
    tangents = at_corners(SQUARE, FACES, UP, np.full((4, 2), bad))
    assert not tangents.any()
    assert not at_corners(SQUARE * 0.0, FACES, UP, UPRIGHT).any()
    empty = corner_tangents(SQUARE, FACES[:0], UP, FACES[:0], UPRIGHT, FACES[:0])
    assert empty[1].shape == (0, 3)
