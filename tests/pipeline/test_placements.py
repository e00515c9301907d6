"""Instances whose placements flatten or mirror: winding of faces, and orientation of normals."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from devices import rendered

import clshade
from clshade.oracle import transform
from clshade.oracle.corners import placed_normals
from clshade.oracle.transform import unit
from clshade.pipeline import placements as packing
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, PointLight, Scene


def packed(normals: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return packing.placed_normals(normals, matrix[None], packing.mirroring(matrix[None]))


def test_mirroring_is_decided_exactly():
    """For placements that flatten space float64 gives determinants of either sign; packing and oracle must agree."""
    rng = np.random.default_rng(3)
    signs = []
    for number in range(300):
        matrix = np.eye(4)
        matrix[:3, :3] = rng.normal(size=(3, 3))
        if number % 3 < 2:
            matrix[:3, 2] = matrix[:3, :2] @ rng.normal(size=2)
        matrix[:3, :3] *= 10.0 ** rng.uniform(-120, 100)
        signs.append(transform.mirroring(matrix))
        assert packing.mirroring(matrix[None])[0] == signs[-1]
        mirrored = matrix[:, [1, 0, 2, 3]]
        if number % 3 == 2:
            assert signs[-1] == (np.linalg.det(matrix[:3, :3] / np.abs(matrix[:3, :3]).max()) < 0)
            assert transform.mirroring(mirrored) == packing.mirroring(mirrored[None])[0] == (not signs[-1])
    assert 50 < sum(signs) < 250


@pytest.mark.parametrize(
    ("rows", "mirrored"),
    [
        ([[1, 0, 0], [0, 1, 0], [0, 0, -1]], True),
        ([[1, 0, 0], [0, 1, 0], [0, 0, 0]], False),
        ([[-1, 0, 0], [0, 1, 0], [0, 0, -0.0]], False),
        ([[1, 2, 3], [4, 5, 6], [7, 8, 9]], False),
        ([[1, 2, 3], [4, 5, 6], [7, 8, 9 + 2.0**-49]], True),
        ([[1, 2, 3], [4, 5, 6], [7, 8, 9 - 2.0**-49]], False),
        ([[1e-200, 0, 0], [0, 1e-200, 0], [0, 0, -1e-200]], True),
        ([[1e200, 0, 0], [0, -1e200, 0], [0, 0, 1e200]], True),
        ([[1, 1e-200, 0], [1e-200, 0, 0], [0, 0, 1]], True),
    ],
)
def test_whether_a_placement_mirrors(rows, mirrored):
    matrix = np.eye(4)
    matrix[:3, :3] = rows
    assert packing.mirroring(matrix[None])[0] == mirrored
    assert transform.mirroring(matrix) == mirrored


@pytest.mark.parametrize("size", [1e-200, 1e-30, 1.0, 1e30, 1e200])
def test_placed_normals_of_any_length(size):
    """Under matrices of any scale, in packing and in the oracle."""
    rng = np.random.default_rng(4)
    normals, matrix = size * rng.normal(size=(20, 3)), np.eye(4)
    matrix[:3, :3] = rng.normal(size=(3, 3))
    expected = unit(unit(normals) @ np.linalg.inv(matrix[:3, :3]))
    for scale in (1e-160, 1.0, 1e160):
        placed = matrix * [[scale] * 3 + [1]]
        assert np.allclose(packed(normals, placed), expected, rtol=1e-9, atol=1e-12)
        assert np.allclose(placed_normals(normals, placed)[0], expected, rtol=1e-9, atol=1e-12)


def cross(a: list, b: list) -> list:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def nearly_flat(rng: np.random.Generator) -> np.ndarray:
    """Return a placement whose third row is nearly a mean of the others."""
    matrix = np.eye(4)
    matrix[:3, :3] = rng.normal(size=(3, 3))
    matrix[2, :3] = rng.normal(size=2) @ matrix[:2, :3] + 1e-9 * rng.normal(size=3)
    return matrix


def test_normals_under_placements_that_nearly_flatten():
    """Found by the fuzzer: there cofactors, and hence normals, are differences of larger numbers. The bound of the
    float64 error is known: errors against fractions are within half of it, and packing and oracle differ by no more."""
    rng = np.random.default_rng(8)
    normals, worst = rng.normal(size=(50, 3)), 0.0
    for _ in range(20):
        matrix = nearly_flat(rng)
        oracles, allowed = placed_normals(normals, matrix)
        with mpmath.workdps(60):
            a, b, c = ([mpmath.mpf(x) for x in row] for row in matrix[:3, :3].tolist())
            cofactors = mpmath.matrix([cross(b, c), cross(c, a), cross(a, b)]) * (
                -1 if packing.mirroring(matrix[None])[0] else 1
            )
            exact = [cofactors * mpmath.matrix(normal) for normal in normals.tolist()]
            true = np.array([[float(x / mpmath.norm(v)) for x in v] for v in exact])
        for candidate in (oracles, packed(normals, matrix)):
            off = np.abs(candidate - true).max(axis=1)
            assert (off <= allowed / 2.0).all()
            worst = max(worst, off.max())
    assert worst > 5e-14  # units of 2^-53 are 1e-16
    assert not placed_normals(normals, np.eye(4))[1].any()
    assert not placed_normals(np.zeros((2, 3)), matrix)[1].any()


def test_instances_flattened_at_random_are_lit_from_the_oracles_side(device):
    """Quads with given normals, flattened along random directions: the exact sign of the determinant decides the side
    of each normal, and two-sided materials flip it by the same rule."""
    rng = np.random.default_rng(5)
    placements = np.tile(np.eye(4), (12, 1, 1))
    for k, placement in enumerate(placements):
        placement[:3, :3] = rng.normal(size=(3, 3))
        placement[:3, 2] = placement[:3, :2] @ rng.normal(size=2)
        placement[:3, 3] = 3 * (k % 4) - 4.5, 3 * (k // 4) - 3, 0
    assert 2 < packing.mirroring(np.asarray(placements)).sum() < 10
    verts, directions = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), rng.normal(size=(4, 3))
    material = Material(ka=0.1, kd=0.5, ks=0.5, n=5.0, two_sided=True)
    mesh = Mesh(verts, [[0, 1, 2], [0, 2, 3]], normals=directions, instances=placements, material=material)
    camera = Camera((0, 0, 20), (0, 0, 0), (0, 1, 0), 1.0, (0.6, 0.8), (40, 30))
    scene = Scene(
        (mesh,), camera, (PointLight((5, 9, 20), (1, 1, 1)), PointLight((5, -9, -20), (0, 0, 1))), np.full(3, 0.3)
    )
    frame = rendered(scene, device=device, layers=("id", "N"))
    assert len(np.unique(frame["id"])) > 12
    report = clshade.check(frame, "all")
    assert report.passed, report.lines()
