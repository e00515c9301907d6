"""Where and why one scene amplifies rounding: kappa and errors of its pixels, and the worst ones."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...base.arrays import Floats, Floats32, Integers
from ...pipeline.frame import Frame
from ...pipeline.frame_results import Check
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import render
from ...scene.model import Scene, Settings
from ...scene.settings import Layer
from ..check.check import Comparison, compare, sample, summary
from . import causes

WORST = 10  # pixels named
SPREAD = 8.0  # of the drawn part's longer side: worst pixels are as far apart as this part of it
EVERY = 1 << 21  # pixels: a larger image is sampled. Some 5 us each
SAMPLED = 1 << 18  # pixels of a larger image
LAYERS: tuple[Layer, ...] = ("Z", "id", "P")


class WorstPixel(NamedTuple):
    """A pixel where rounding is amplified most.

    number: 1 is the worst. row: from the top. face: in the scene's face order, from 0. point: visible there, world space.
    error, bound: relative to the light budget B. factors: see `causes.factors`. cause, why: see `causes.explain`.
    """

    number: int
    row: int
    column: int
    point: list[float]
    face: int
    mesh: str
    cause: str
    why: str
    factors: dict[str, float]
    kappa: float
    exponent: float
    error: float
    bound: float


@dataclass(frozen=True, eq=False)
class SceneStudy:
    """The stability of one scene.

    kappa, error, bound: (M, N) float32, row 0 at the top: the condition number, the error and its bound, both relative to
    the light budget; 0 in the background, NaN where a covered pixel was not checked. within: share of the covered pixels.
    """

    frame: Frame
    check: Check
    kappa: Floats32
    error: Floats32
    bound: Floats32
    within: float
    worst: tuple[WorstPixel, ...]

    @property
    def share(self) -> Floats:
        """(M, N) error in parts of the bound; NaN where `kappa` is, 0 in the background without an error."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.error == 0.0, 0.0, self.error / np.asarray(self.bound, np.float64))

    def quantiles(self) -> dict[str, float]:
        """Return median, 99th percentile and largest kappa of the covered pixels checked; empty without any."""
        positive = self.kappa[self.kappa > 0.0]
        if not len(positive):
            return {}
        values = np.quantile(positive, (0.5, 0.99, 1.0), method="inverted_cdf").tolist()
        return dict(zip(("median", "p99", "max"), values, strict=True))


def study(scene: Scene, settings: Settings, device: Device) -> SceneStudy:
    """Draw the scene, compare its pixels with the oracle, all or of a large image a sample, and name the worst ones. Raises
    InputError and DeviceError."""
    frame = render(scene, settings=replace(settings, layers=(*settings.layers, *LAYERS)), device=device)
    start = time.perf_counter()
    index = sample(frame, SAMPLED if frame.alpha.size > EVERY else frame.alpha.size, 0)
    compared = compare(frame, index)
    frame.check = summary(compared, time.perf_counter() - start)
    covered = compared.oracle.alpha > 0.0
    faces = causes.visible_faces(compared)
    factors = causes.factors(compared, faces)
    good = ~compared.wrong & (compared.counted <= compared.allowed)
    chosen = _worst(compared, np.where(good, causes.amplification(factors), np.inf))
    return SceneStudy(
        frame,
        frame.check,
        *_maps(compared, index),
        within=float(good[covered].mean()) if covered.any() else 1.0,
        worst=tuple(
            _named(compared, number, int(k), faces, {name: float(factor[k]) for name, factor in factors.items()})
            for number, k in enumerate(chosen, 1)
        ),
    )


def _maps(compared: Comparison, index: Integers) -> tuple[Floats32, Floats32, Floats32]:
    """Return kappa, errors and bounds, (M, N) each."""
    frame = compared.frame
    covered = compared.oracle.alpha > 0.0
    maps = []
    for values in (compared.oracle.kappa, compared.found, compared.expected):
        background = np.where(frame.alpha.ravel() > 0.0, np.nan, 0.0).astype(np.float32)
        with np.errstate(over="ignore"):
            background[index] = np.where(covered | compared.wrong, values, 0.0)
        maps.append(background.reshape(frame.alpha.shape))
    return maps[0], maps[1], maps[2]


def _worst(compared: Comparison, score: Floats) -> Integers:
    """Return up to WORST of the compared pixels whose center is covered, spread over what is drawn: the largest score (K,)
    first, and of equal ones the largest error."""
    alive: Integers = np.flatnonzero((compared.oracle.id > 0) | compared.wrong)
    if not len(alive):
        return alive
    rows, columns = compared.rows, compared.columns
    score = np.where(np.isnan(score), np.inf, score)
    apart = max(np.ptp(rows[alive]), np.ptp(columns[alive])) / SPREAD
    chosen: list[int] = []
    while len(alive) and len(chosen) < WORST:
        first = alive[score[alive] == score[alive].max()]
        worst = int(first[compared.found[first].argmax()])
        chosen.append(worst)
        away = np.hypot(rows[alive] - rows[worst], columns[alive] - columns[worst])
        alive = alive[(away > apart) & (alive != worst)]
    return np.array(chosen)


def _named(compared: Comparison, number: int, k: int, faces: causes.Faces, factors: dict[str, float]) -> WorstPixel:
    """Return compared pixel k with its cause. A wrong pixel may show a face that the oracle does not see."""
    frame, expected = compared.frame, compared.oracle
    row, column = int(compared.rows[k]), int(compared.columns[k])
    face = int(expected.id[k]) - 1
    cause, why, mesh = causes.NONE, "nothing belongs here", ""
    if face >= 0:
        cause, why = causes.explain(compared, faces, k, factors)
        mesh = frame.scene.meshes[faces.mesh[np.searchsorted(faces.face, face)]].name
    values = (float(array[k]) for array in (expected.kappa, expected.exponent, compared.found, compared.expected))
    return WorstPixel(number, row, column, frame["P"][row, column].tolist(), face, mesh, cause, why, factors, *values)
