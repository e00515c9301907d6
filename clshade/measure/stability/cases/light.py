"""Cases 21 to 24: the reflection model at single points where it is ill-conditioned or undefined."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ....base.arrays import Array
from ....errors import InputError
from ....oracle import terms
from ....pipeline.features import OPTIONAL
from ....scene.model import Material
from . import lit
from .bench import Bench, Case, Outcome, against_oracle, color_outcome, expected_light, worst

EXPONENTS = (0.0, 1.0, 20.0, 1e3, 1e5, 1e9)
HALF_ULP = 2.0**-24
LOBE = 16.0  # times sqrt(n) * 2^-24: relative error of the highlight alone where it is at least 1/e
DIGITS = 50  # of the reference that exceeds float64
Points = tuple[Array, Array, Array]


def unit(vectors: Array) -> Array:
    units: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return units


def _float32(values: Array) -> Array:
    return np.asarray(values, np.float32).astype(np.float64)


def in_the_lobe(n: float, count: int = 4000) -> Points:
    """Return points (K, 3) relative to the eye, unit normals (K, 3) and a light's position (3,), all float32 values,
    with R.V throughout the lobe (R.V)^n >= 1/e."""
    rng = np.random.default_rng(int(n))
    light = _float32(np.array([0.7, -0.4, 0.9]))
    points = _float32(unit(rng.normal(size=(count, 3))) * rng.uniform(1.0, 2.0, (count, 1)))
    points = points[np.linalg.norm(points - light, axis=1) > 0.7]
    to_eye, to_light = unit(-points), unit(light - points)
    kept = (to_eye * to_light).sum(axis=1) > -0.8
    points, middle = points[kept], unit(to_eye + to_light)[kept]
    # R.V is cos(2a) for a normal rotated by a from the lobe's axis; it is e^(-1/n) at n (2a)^2 / 2 = 1.
    turned = rng.uniform(0, 1, (len(points), 1)) * math.sqrt(0.5 / max(n, 4.0)) * unit(rng.normal(size=points.shape))
    return points, _float32(unit(middle + turned)), light


def exact_highlights(points: Array, normals: Array, light: Array, n: float) -> Array:
    """Compute (R.V)^n, (K,), of roughly unit normals, normalized first, to DIGITS digits with mpmath, else in
    float64."""
    try:
        import mpmath
    except ImportError:
        return terms.specular(terms.Directions.at(points, normals, np.zeros(3), light), np.float64(n))
    found = np.zeros(len(points))
    with mpmath.workdps(DIGITS):
        for k in range(len(points)):
            p, m, q = (mpmath.matrix(v.tolist()) for v in (points[k], normals[k], light))
            m, v, to = m / mpmath.norm(m), -p / mpmath.norm(p), (q - p) / mpmath.norm(q - p)
            n_l = (m.T * to)[0]
            r_v = ((2 * n_l * m - to).T * v)[0]
            found[k] = float(r_v**n) if n_l > 0 and r_v > 0 else 0.0
    return found


def lobe_error(found: Array, exact: Array, n: float) -> float:
    """Return the largest relative error inside the lobe, in sqrt(n) * 2^-24; infinite if a value is not finite."""
    inside = exact >= math.exp(-1.0)
    error = np.abs(found[inside] / exact[inside] - 1.0) / (math.sqrt(max(n, 1.0)) * HALF_ULP)
    return float(np.where(np.isfinite(error), error, np.inf).max(initial=0.0))


def exponents(bench: Bench) -> Outcome:
    """Highlights with n from 0 to 1e9: in the lobe against the exact power, on a sheet against the oracle."""
    outcomes = []
    for n in EXPONENTS:
        points, normals, light = in_the_lobe(n, 600)
        found = bench.light(points, normals, (light[None], np.ones((1, 3))), n=n, kd=0.0)[:, 0].astype(np.float64)
        exact = exact_highlights(points, normals, light, n)
        error = lobe_error(found, exact, n)
        amplified = error * math.sqrt(max(n, 1.0))
        outcomes.append(Outcome(0, error, LOBE, "sqrt(n)*2^-24", amplified, f"lobe, n = {n:g}"))
        material = Material(n=n) if n != 20.0 else lit.MATERIAL
        # n = 1 needs no power, hence another program; with every feature on, an existing one serves.
        frame = bench.draw(lit.scene_of(lit.patch(material=material)), forced=OPTIONAL if n == 1.0 else ())
        outcomes.append(replace(against_oracle(frame), detail=f"sheet, n = {n:g}"))
    for bad in (math.nan, -1.0, math.inf, 1e10):
        try:
            Material(n=bad)
        except InputError:
            continue
        outcomes.append(Outcome(1))
    return worst(outcomes, "n = 0, 1, 20, 1e3, 1e5, 1e9; NaN, -1, inf, 1e10 refused")


def _values(found: list[Array], expected: list[list[float]]) -> Outcome:
    """Count the values that are not exactly as expected."""
    wrong = [not np.array_equal(f, np.asarray(e, np.float32)) for f, e in zip(found, expected, strict=True)]
    return Outcome(sum(wrong), detail=f"{len(wrong)} closed forms")


def _one(bench: Bench, point: object, normal: object, light: object, **options: Any) -> Array:
    vectors = [np.array([v], np.float64) for v in (point, normal, light)]
    lit: Array = bench.light(vectors[0], vectors[1], (vectors[2], np.ones((1, 3))), **options)[0]
    return lit


def zero_power(bench: Bench) -> Outcome:
    """Inputs exact in float32. R.V <= 0: no highlight for any n, 0^0 included; R.V = 1: 1 for any n."""
    found, expected = [], []
    for n in EXPONENTS:
        found.append(_one(bench, (-2, 0, 0), (0, 0, 1), (-2, 0, 1), n=n))  # N.L = 1, R.V = 0
        expected.append([1.0] * 3)
        found.append(_one(bench, (-2, 0, -0.5), (0, 0, 1), (-1, 0, 0.5), n=n, kd=0.0))  # R.V < 0
        expected.append([0.0] * 3)
        found.append(_one(bench, (0, 0, -2), (0, 0, 1), (0, 0, 0), n=n, kd=0.0))  # R.V = 1
        expected.append([1.0] * 3)
    return _values(found, expected)


def negative_cosine(bench: Bench) -> Outcome:
    """Lights behind the surface and in its plane: exactly 0 for any n."""
    rng = np.random.default_rng(22)
    points, normals = _float32(rng.uniform(-2, 2, (4000, 3))), unit(rng.normal(size=(4000, 3)))
    light = np.array([0.5, 0.25, 1.5])
    below = ((light - points) * normals).sum(axis=1)
    normals = _float32(np.where(below[:, None] > 0, -normals, normals))[np.abs(below) > 1e-3]
    points = points[np.abs(below) > 1e-3]
    wrong = 0
    for n in EXPONENTS:
        wrong += int((bench.light(points, normals, (light[None], np.ones((1, 3))), n=n) != 0.0).any(axis=1).sum())
    flat = _one(bench, (0, 0, -2), (1, 0, 0), (0, 0, 0))
    return Outcome(wrong + int((flat != 0.0).any()), detail=f"{len(points)} points, {len(EXPONENTS)} exponents")


def grazing(bench: Bench) -> Outcome:
    """Light and eye 1e-7 to 0.1 above the surface's plane."""
    outcomes = []
    rng = np.random.default_rng(23)
    for power in range(-7, 0):
        height, count = 10.0**power, 2000
        normals = _float32(unit(rng.normal(size=(count, 3))))
        exact = unit(normals)
        along = unit(np.cross(exact, rng.normal(size=(count, 3))))
        points = _float32(-2.0 * along - 2.0 * height * exact * rng.uniform(0.5, 2.0, (count, 1)))
        # One light per cluster of points, opposite the eye and equally low above the plane.
        for k in range(0, count, 200):
            light = points[k] + 1.5 * along[k] * -1.0 + 1.5 * height * exact[k]
            lights = _float32(light[None]), np.ones((1, 3))
            some = slice(k, k + 1)
            spread = points[some] + rng.normal(size=(64, 3)) * height * 0.3
            near, toward = _float32(spread), np.repeat(normals[some], 64, axis=0)
            for n in (1.0, 20.0, 1e3):
                found = bench.light(near, toward, lights, n=n)
                outcomes.append(color_outcome(found[None], expected_light(near, toward, lights, n)))
    return worst(outcomes, "7 heights, n = 1, 20, 1e3")


def at_the_point(bench: Bench) -> Outcome:
    """A light or the eye, or both, at the point or too close for a direction: the contribution is 0, never NaN."""
    found = [
        _one(bench, (1, 1, -2), (0, 0, 1), (1, 1, -2)),
        _one(bench, (0, 0, 0), (0, 0, 1), (0, 0, 2)),  # the diffuse term stays
        _one(bench, (0, 0, 0), (0, 0, 1), (0, 0, 0)),
        _one(bench, (1e-30, 0, 0), (0, 0, 1), (0, 0, 2), n=0.0),
        _one(bench, (0, 0, -2), (0, 0, 0), (0, 0, 0)),
        _one(bench, (0, 0, 0), (0, 0, 0), (0, 0, 0), n=1e9),
    ]
    values = _values(found, [[0] * 3, [1] * 3, [0] * 3, [1] * 3, [0] * 3, [0] * 3])
    mesh = lit.patch()
    at_vertex = replace(lit.LIGHTS[0], position=mesh.verts[24])
    frames = [
        bench.draw(lit.scene_of(mesh, lights=(at_vertex, lit.LIGHTS[1]), camera=replace(lit.CAMERA, resolution=size)))
        for size in ((61, 61), (60, 60))
    ]
    return worst([values, *(against_oracle(frame) for frame in frames)], "6 closed forms, a light in the surface")


DISTANCES = tuple(10.0**power for power in range(-6, 10))


def near_light(distance: float) -> tuple[Array, Array]:
    """Return the positions (2, 3) and intensities of a light `distance` in front of the sheet's center, and a second
    one."""
    middle = np.array([0.013, 0.021, 0.15 * (1.0 - 0.013**2 - 0.5 * 0.021**2)])
    return np.stack([middle + distance * np.array([0.1, -0.2, 0.97]), [-4.0, 1.0, 2.0]]), np.ones((2, 3))


def light_distance(bench: Bench) -> Outcome:
    """A light 1e-6 to 1e9 away from a sheet two units wide."""
    mesh, outcomes = lit.patch(cells=20), []
    for distance in DISTANCES:
        position = near_light(distance)[0][0]
        scene = lit.scene_of(mesh, lights=(replace(lit.LIGHTS[0], position=position), lit.LIGHTS[1]))
        outcomes.append(against_oracle(bench.draw(scene)))
    return worst(outcomes, "16 distances")


CASES = (
    Case("21", "zero-power", "pow(0, 0), base <= 0", "no highlight where R.V <= 0", zero_power),
    Case("22", "negative-cosine", "lights behind the surface", "exactly nothing", negative_cosine),
    Case("22b", "grazing", "light and eye 1e-7..0.1 above the surface", "within the bound", grazing),
    Case("23", "exponents", "exponents 0 to 1e9", "lobe within 16 sqrt(n) 2^-24", exponents, True),
    Case("24", "at-the-point", "light or eye at the point", "contributes 0", at_the_point),
    Case("24b", "light-distance", "lights 1e-6..1e9 away", "within the bound", light_distance),
)
