"""Cases 22b to 24b: the reflection model where it is ill-conditioned."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ....base.arrays import Array
from ....oracle import shade
from ....oracle.lights import Directions
from ....pipeline.features import OPTIONAL
from ....scene.camera import Camera
from ....scene.model import Material
from ...check import oracle_bounds
from . import lit
from .bench import Bench, Case, Outcome, Outcomes, against_oracle, all_against_oracle

LOBE = 16.0  # times sqrt(n) * 2^-24: relative error of the highlight alone where it is at least 1/e
DIGITS = 50  # of the reference that exceeds float64


def unit(vectors: Array) -> Array:
    units: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return units


def _float32(values: Array) -> Array:
    return values.astype(np.float32).astype(np.float64)


def in_the_lobe(n: float, count: int = 4000) -> tuple[Array, Array, Array]:
    """Return points (K, 3) relative to the eye, unit normals (K, 3) and a light's position (3,), all float32 values,
    with R.V throughout the lobe (R.V)^n >= 1/e."""
    rng = np.random.default_rng(int(n))
    light = _float32(np.array([0.7, -0.4, 0.9]))
    points = _float32(unit(rng.normal(size=(count, 3))) * rng.uniform(1.0, 2.0, (count, 1)))
    points = points[np.linalg.norm(points - light, axis=1) > 0.7]
    to_eye, to_light = unit(-points), unit(light - points)
    in_front = (to_eye * to_light).sum(axis=1) > -0.8
    points, middle = points[in_front], unit(to_eye + to_light)[in_front]
    # R.V is cos(2a) for a normal rotated by a from the lobe's axis; it is e^(-1/n) at n (2a)^2 / 2 = 1.
    turned = rng.uniform(0, 1, (len(points), 1)) * math.sqrt(0.5 / max(n, 4.0)) * unit(rng.normal(size=points.shape))
    return points, _float32(unit(middle + turned)), light


def exact_highlights(points: Array, normals: Array, light: Array, n: float) -> Array:
    """Compute (R.V)^n, (K,), of roughly unit normals, normalized first, to DIGITS digits with mpmath, else in
    float64."""
    try:
        import mpmath
    except ImportError:
        return shade.specular(Directions.at(points, normals, np.zeros(3), light), np.array(n, np.float64))
    exact = np.zeros(len(points))
    with mpmath.workdps(DIGITS):
        for k in range(len(points)):
            p, m, q = (mpmath.matrix(v.tolist()) for v in (points[k], normals[k], light))
            m, v, to = m / mpmath.norm(m), -p / mpmath.norm(p), (q - p) / mpmath.norm(q - p)
            n_l = (m.T * to)[0]
            r_v = ((2 * n_l * m - to).T * v)[0]
            exact[k] = float(r_v**n) if n_l > 0 and r_v > 0 else 0.0
    return exact


def exponents(bench: Bench) -> Outcomes:
    """Highlights with n from 0 to 1e9: in the lobe against the exact power, on a sheet against the oracle."""
    for n in (0.0, 1.0, 20.0, 1e3, 1e5, 1e9):
        points, normals, light = in_the_lobe(n, 600)
        exact, steepness = exact_highlights(points, normals, light, n), math.sqrt(max(n, 1.0))
        inside = exact >= math.exp(-1.0)
        relative = bench.highlights(points, normals, light, n)[inside] / exact[inside] - 1.0
        amplified = float(np.abs(relative).max()) / oracle_bounds.HALF_ULP  # NaN fails
        yield Outcome(0, amplified / steepness, LOBE, "sqrt(n)*2^-24", amplified, f"lobe, n = {n:g}")
        # n = 1 needs no power, hence another program; with every feature on, an existing one serves.
        frame = bench.draw(lit.scene_of(lit.patch(material=Material(n=n))), forced=OPTIONAL if n == 1.0 else ())
        yield against_oracle(frame, f"sheet, n = {n:g}")


def grazing(bench: Bench) -> Outcomes:
    """Eye and light 1e-7 to 0.1 above a sheet's plane, opposite each other, turned at random. Pixels are as much lower than
    wide, so that the sheet fills the image. Below 1e-5 every highlight is at its gate: only ids and ambient light count."""
    rng = np.random.default_rng(23)
    sheet = lit.patch(bend=0.0)
    for height in 10.0 ** np.arange(-7, 0):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        eye, lookat, light = np.array([[-2.0, 0.1, height], [0.0, 0.1, 0.0], [1.5, -0.2, 1.5 * height]]) @ turn
        camera = Camera(eye, lookat, turn[2], 1.0, (height, 1.0), (61, 61))
        lights = (replace(lit.LIGHTS[0], position=light),)
        for n in (2.0, 20.0, 1e3):
            mesh = replace(sheet, verts=sheet.verts @ turn, material=Material(n=n))
            yield against_oracle(bench.draw(lit.scene_of(mesh, camera=camera, lights=lights)))


def light_distance(bench: Bench) -> Outcomes:
    """A light 1e-6 to 1e9 in front of the center of a sheet two units wide."""
    mesh = lit.patch(cells=20)
    middle = np.array([0.013, 0.021, 0.15 * (1.0 - 0.013**2 - 0.5 * 0.021**2)])
    places = [middle + distance * np.array([0.1, -0.2, 0.97]) for distance in 10.0 ** np.arange(-6, 10)]
    scenes = [lit.scene_of(mesh, lights=(replace(lit.LIGHTS[0], position=at), lit.LIGHTS[1])) for at in places]
    return all_against_oracle(bench, scenes)


CASES = (
    Case("22b", "grazing", "light and eye 1e-7..0.1 above the surface", "within the bound", grazing),
    Case("23", "exponents", "exponents 0 to 1e9", "lobe within 16 sqrt(n) 2^-24", exponents, True),
    Case("24b", "light-distance", "lights 1e-6..1e9 away", "within the bound", light_distance),
)
