"""Creases, welding and face orientation, against plain loops and shapes with known normals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from clshade.scene import geometry
from clshade.scene.builtin.scenes import builtin
from clshade.scene.geometry import against_normals, crease_normals, seamless_normals, welded
from clshade.scene.triangulate import triangulated

RNG = np.random.default_rng(8)
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SQUARES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
FACES = triangulated(CUBE, SQUARES.reshape(-1), np.full(6, 4)).triangles(SQUARES.reshape(-1))


def test_a_cube():
    for degrees in (1, 89):
        normals, index = crease_normals(CUBE, FACES, degrees)
        assert len(normals) == 24  # the two triangles of a side share theirs
        flat, flat_index = crease_normals(CUBE, FACES, 0)
        assert len(flat) == 12
        np.testing.assert_allclose(normals[index], flat[flat_index], atol=1e-15)
    smooth, index = crease_normals(CUBE, FACES, 91)
    np.testing.assert_allclose(smooth[index], geometry.vertex_normals(CUBE, FACES)[FACES], atol=1e-15)


def roof(degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """Return two triangles on one edge, whose normals are `degrees` apart."""
    angle = math.radians(degrees)
    verts = np.array([[0, 0, 0], [0, 1, 0], [-1, 0, 0], [math.cos(angle), 0, -math.sin(angle)]])
    return verts, np.array([[0, 1, 2], [1, 0, 3]])


def test_seams_of_a_sphere_vanish_and_edges_of_a_cube_stay():
    mesh = builtin("icosphere", level=3).meshes[0]
    pieces = np.asarray(mesh.verts, float)[mesh.faces].reshape(-1, 3)
    apart = np.arange(len(pieces), dtype=np.int32).reshape(-1, 3)
    smooth_normals = geometry.vertex_normals(np.asarray(mesh.verts, float), mesh.faces)[mesh.faces]
    np.testing.assert_allclose(seamless_normals(pieces, apart)[apart], smooth_normals, atol=1e-12)
    corners, sides = CUBE[FACES].reshape(-1, 3), np.arange(36, dtype=np.int32).reshape(-1, 3)
    flat = geometry.vertex_normals(corners, sides)
    np.testing.assert_allclose(seamless_normals(corners, sides), flat, atol=1e-15)
    assert seamless_normals(CUBE, FACES) is None
    for degrees in (29, 31):
        verts, faces = roof(degrees)
        normals = seamless_normals(verts[faces].reshape(-1, 3), np.arange(6).reshape(2, 3))
        assert (normals is None) == (degrees == 31)


@pytest.mark.parametrize(("angle", "crease", "count"), [(20, 30, 4), (40, 30, 6), (30, 30, 4), (179, 178, 6)])
def test_the_angle_of_a_crease_also_where_vertices_are_split(angle, crease, count):
    verts, faces = roof(angle)
    normals, index = crease_normals(verts, faces, crease)
    assert len(normals) == count
    assert (index[0, 0] == index[1, 1]) == (count == 4)
    split, split_index = crease_normals(verts[faces].reshape(-1, 3), np.arange(6).reshape(2, 3), crease)
    np.testing.assert_allclose(normals[index], split[split_index], atol=1e-15)


def test_degenerate_meshes():
    for faces in (np.zeros((0, 3), int), np.array([[0, 0, 0]]), np.array([[0, 1, 1], [1, 0, 0]])):
        normals, index = crease_normals(CUBE, faces, 30)
        assert index.shape == faces.shape
        assert not normals.any()
    tiny, index = crease_normals(CUBE * 1e-140, FACES, 30)
    np.testing.assert_allclose(np.linalg.norm(tiny, axis=1), 1, atol=1e-12)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_welding(kind):
    verts = RNG.integers(-2, 3, (500, 3)).astype(kind) * kind(0.1)
    verts[::7] *= -1.0  # gives -0.0 too
    kept, which = welded(verts)
    assert np.array_equal(verts[kept][which], verts)
    assert len(kept) == len(np.unique(verts + 0.0, axis=0))
    assert (np.diff(kept) > 0).all()
    assert (kept <= np.arange(500)[[np.flatnonzero(which == k)[0] for k in range(len(kept))]]).all()


def test_faces_against_their_normals():
    normals = CUBE - 0.5
    wrong = RNG.random(12) < 0.5
    faces = np.where(wrong[:, None], FACES[:, ::-1], FACES)
    assert against_normals(CUBE, FACES, normals, FACES).sum() in (0, 12)
    inside_out = against_normals(CUBE, FACES, normals, FACES)[0]
    assert (against_normals(CUBE, faces, normals, faces) == (wrong != inside_out)).all()
    broken = np.where(np.arange(8)[:, None] == 0, np.nan, normals)  # the finite normals of a face decide
    assert (against_normals(CUBE, faces, broken, faces) == (wrong != inside_out)).all()
    no_area = np.array([[0, 0, 5], [1, 1, 1]])
    assert not against_normals(CUBE, no_area, normals, no_area).any()
    assert not against_normals(CUBE, FACES, 0 * normals, FACES).any()
