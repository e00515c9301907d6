"""Instances whose placements flatten or mirror: winding of faces, and orientation of normals."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np

from clshade.oracle import transform
from clshade.oracle.corners import placed_normals
from clshade.pipeline import placements as packing

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
