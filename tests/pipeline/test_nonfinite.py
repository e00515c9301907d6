"""Vertices that are NaN or infinite; normals that cancel; placements that flatten or mirror."""

from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from mapped_scenes import sheet

from clshade import oracle
from clshade.errors import InputError
from clshade.oracle import transform
from clshade.oracle.corners import placed_normals
from clshade.pipeline import placements as packing
from clshade.scene.camera import Camera
from clshade.scene.geometry import vertex_normals
from clshade.scene.model import Mesh, Scene, Settings

VERTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
FACES = np.array([[0, 1, 2], [1, 3, 2]])


def broken(value: float, vertex: int = 3, **fields) -> Mesh:
    verts = VERTS.copy()
    verts[vertex, 1] = value
    return Mesh(verts, FACES, **fields)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_refused_unless_told(value):
    with pytest.raises(InputError, match=r"Mesh: verts: expected finite numbers, found .* in row 3"):
        broken(value)
    with pytest.raises(InputError, match="nonfinite: expected one of refuse, drop"):
        broken(value, nonfinite="keep")


def test_dropped_faces_keep_their_number_and_draw_nothing():
    mesh = broken(-np.inf, nonfinite="drop")
    assert mesh.dropped == 1
    assert len(mesh.faces) == 2
    assert np.isfinite(mesh.verts).all()
    assert np.array_equal(mesh.faces[0], FACES[0])
    assert len(set(mesh.faces[1].tolist())) == 1
    alone = Mesh(VERTS[:3], FACES[:1])
    assert np.array_equal(vertex_normals(mesh.verts, mesh.faces)[:3], vertex_normals(alone.verts, alone.faces))
    assert mesh.verts[mesh.faces].min() == 0.0
    assert mesh.verts[mesh.faces].max() == 1.0


def test_the_count_goes_with_the_mesh():
    nothing = Mesh(np.full((3, 3), np.nan), FACES[:1], nonfinite="drop")
    assert (nothing.dropped, np.isfinite(nothing.verts).all()) == (1, True)
    unused = Mesh(np.concatenate([VERTS, [[np.inf, 0, 0]]]), FACES, nonfinite="drop")
    assert (unused.dropped, np.isfinite(unused.verts).all()) == (0, True)
    mesh = broken(np.nan, nonfinite="drop", instances=np.stack([np.eye(4)] * 3))
    again = replace(mesh, name="again")
    assert again.dropped == 1
    camera = Camera(np.array([0.0, 0, 5]), np.zeros(3), np.array([0.0, 1, 0]), 1.0, (1.0, 1.0), (8, 8))
    scene = Scene((mesh, again, Mesh(VERTS, FACES)), camera)
    assert scene.nonfinite == 6
    assert (oracle.render(scene, Settings()).id > 0).any()


def test_a_sheet_with_a_back_has_no_normals():
    """Each face with its reverse: the sums leave rounding errors, not a direction."""
    bent = sheet(11)
    both = np.concatenate([bent.faces, bent.faces[:, [0, 2, 1]]])
    for scale in (1.0, 1e-20, 1e20):
        for normals_of in (vertex_normals, lambda *mesh: oracle.corners.vertex_normals(*mesh)[0]):
            assert not normals_of(bent.verts * scale, both).any()
            assert np.allclose(np.linalg.norm(normals_of(bent.verts * scale, bent.faces), axis=1), 1.0)


# Placements that flatten or mirror: winding of faces, and orientation of normals


SPECIAL = [
    [[1, 0, 0], [0, 1, 0], [0, 0, 0]],
    [[-1, 0, 0], [0, 1, 0], [0, 0, -0.0]],
    [[1, 2, 3], [4, 5, 6], [7, 8, 9 + 2.0**-49]],
    [[1, 2, 3], [4, 5, 6], [7, 8, 9 - 2.0**-49]],
    [[1e-200, 0, 0], [0, 1e-200, 0], [0, 0, -1e-200]],
    [[1e200, 0, 0], [0, -1e200, 0], [0, 0, 1e200]],
    [[1, 1e-200, 0], [1e-200, 0, 0], [0, 0, 1]],
]


def test_mirroring_is_decided_exactly():
    """Also of placements that flatten space, for which float64 gives determinants of either sign: as fractions say."""
    rng, signs = np.random.default_rng(3), []
    matrices = [np.array(rows, np.float64) for rows in SPECIAL]
    for number in range(300):
        rows = rng.normal(size=(3, 3))
        if number % 3 < 2:
            rows[:, 2] = rows[:, :2] @ rng.normal(size=2)
        matrices.append(rows * 10.0 ** rng.uniform(-120, 100))
    for rows in matrices:
        matrix = np.eye(4)
        matrix[:3, :3] = rows
        a, b, c = ([Fraction(x) for x in row] for row in rows.tolist())
        signs.append(sum(x * y for x, y in zip(a, cross(b, c), strict=True)) < 0)
        assert packing.mirroring(matrix[None])[0] == transform.mirroring(matrix) == signs[-1]
    assert 50 < sum(signs) < 250


def cross(a: list, b: list) -> list:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def test_normals_under_placements_that_nearly_flatten():
    """Found by the fuzzer: there cofactors, and hence normals, are differences of larger numbers. The bound of the
    float64 error is known: errors against fractions are within half of it, and packing and oracle differ by no more."""
    rng = np.random.default_rng(8)
    normals, worst = rng.normal(size=(50, 3)), 0.0
    for _ in range(20):
        matrix = np.eye(4)
        matrix[:3, :3] = rng.normal(size=(3, 3))
        matrix[2, :3] = rng.normal(size=2) @ matrix[:2, :3] + 1e-9 * rng.normal(size=3)  # nearly a mean of the others
        mirrors, (oracles, allowed) = packing.mirroring(matrix[None]), placed_normals(normals, matrix)
        with mpmath.workdps(60):
            a, b, c = ([mpmath.mpf(x) for x in row] for row in matrix[:3, :3].tolist())
            cofactors = mpmath.matrix([cross(b, c), cross(c, a), cross(a, b)]) * (-1 if mirrors[0] else 1)
            exact = [cofactors * mpmath.matrix(normal) for normal in normals.tolist()]
            true = np.array([[float(x / mpmath.norm(v)) for x in v] for v in exact])
        for candidate in (oracles, packing.placed_normals(normals, matrix[None], mirrors)):
            off = np.abs(candidate - true).max(axis=1)
            assert (off <= allowed / 2.0).all()
            worst = max(worst, off.max())
    assert worst > 5e-14  # units of 2^-53 are 1e-16
    assert not placed_normals(normals, np.eye(4))[1].any()
    assert not placed_normals(np.zeros((2, 3)), matrix)[1].any()
