"""Vertex normals, creases, welding, camera axes, bounds and tangents, against closed forms and plain loops."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clshade.oracle.corners import corner_tangents as reference_tangents
from clshade.scene import geometry
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera
from clshade.scene.geometry import against_normals, crease_normals, seamless_normals, vertex_normals, welded
from clshade.scene.model import Mesh, Scene
from clshade.scene.tangents import corner_tangents
from clshade.scene.triangulate import triangulated

TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
OUTWARD = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])


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
    low, high = geometry.bounding_box(Scene(mesh))
    assert (low.tolist(), high.tolist()) == ([0, 0, 0], [2, 3, 6])
    assert geometry.half_diagonal(low, high) == 3.5
    placed = Mesh(verts, [[0, 1, 2]], instances=np.stack([np.eye(4), twice]))
    low, high = geometry.bounding_box(Scene((mesh, placed)))
    assert (low.tolist(), high.tolist()) == ([0, 0, -1], [14, 6, 11])


# Creases

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


# Tangents: MikkTSpace's groups, sides and weights

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
HALVES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
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


def grid(rows, columns, seed=0):
    """Return a bumpy surface: vertices, faces, normals, texture coordinates."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    verts = np.stack([x, y, 0.3 * rng.random((rows, columns))], -1).reshape(-1, 3)
    corner = np.arange(rows * columns).reshape(rows, columns)[:-1, :-1].reshape(-1, 1)
    faces = np.concatenate([corner + [0, 1, columns + 1], corner + [0, columns + 1, columns]]).astype(np.int32)
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
    tangents = at_corners(SQUARE, HALVES, UP, uvs)
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
    tangents = at_corners(SQUARE, HALVES, UP, np.full((4, 2), bad))
    assert not tangents.any()
    assert not at_corners(SQUARE * 0.0, HALVES, UP, UPRIGHT).any()
    empty = corner_tangents(SQUARE, HALVES[:0], UP, HALVES[:0], UPRIGHT, HALVES[:0])
    assert empty[1].shape == (0, 3)
