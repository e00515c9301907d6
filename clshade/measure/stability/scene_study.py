"""Where and why one scene amplifies rounding: kappa and errors of its pixels, the worst ones, and what helps there."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.arrays import Array, Floats, Floats32, Integers
from ...base.json_values import plain
from ...pipeline.frame import Frame
from ...pipeline.image_check import Check
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import render
from ...scene.model import Scene, Settings
from ...scene.settings import Layer
from ..check.check import Comparison, compare, sample, summary
from ..rounding import spread
from ..rounding.spread import Spread
from . import causes

WORST = 10  # pixels named
SPREAD = 8.0  # of the drawn part's longer side: worst pixels are as far apart as this part of it
EVERY = 1 << 21  # pixels: a larger image is sampled. Some 5 us each
SAMPLED = 1 << 18  # pixels of a larger image
TILE, TILES = 16, 512  # and all pixels of so many tiles of that side, where rounding is amplified most
LAYERS: tuple[Layer, ...] = ("Z", "id", "P")


@dataclass(frozen=True, eq=False)
class WorstPixel:
    """A pixel where rounding is amplified most.

    row: from the top. face: in the scene's face order, from 0. point: the visible point, world space. found, expected:
    error and bound, relative to the light budget B. factors: see `causes.factors`. cause: a key of `causes.CAUSES`, or
    `causes.NONE`. why: a sentence. others: found and expected with other settings, by name.
    """

    row: int
    column: int
    face: int
    mesh: str
    point: tuple[float, float, float]
    kappa: float
    exponent: float
    found: float
    expected: float
    factors: dict[str, float]
    cause: str
    why: str
    others: dict[str, tuple[float, float]]

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        others = {name: {"found": found, "expected": expected} for name, (found, expected) in self.others.items()}
        return {**vars(self), "others": others}


@dataclass(frozen=True, eq=False)
class RoundingStudy:
    """The scene under random rounding.

    digits, promised: (M, N) float32, digits left by the spread and by the bound; 0 in the background, NaN where a covered
    pixel was not counted. too_small, too_large: up to WORST of those pixels, the worst first, found
    being the largest error.
    """

    spread: Spread
    digits: Floats32
    promised: Floats32
    too_small: tuple[WorstPixel, ...]
    too_large: tuple[WorstPixel, ...]

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        pixels = {name: [each.stats() for each in getattr(self, name)] for name in ("too_small", "too_large")}
        return {**self.spread.stats(), "worst_pixels": pixels}


@dataclass(frozen=True, eq=False)
class SceneStudy:
    """The stability of one scene.

    kappa, found, expected: (M, N) float32, row 0 at the top: the condition number, the error and its bound, both relative
    to the light budget; 0 in the background, NaN where a covered pixel was not checked. others: the settings that the
    worst pixels were drawn with as well, by name. notes: what was not measured, and why. rounding: if it was asked for.
    """

    frame: Frame
    device: str
    check: Check
    kappa: Floats32
    found: Floats32
    expected: Floats32
    within: float
    worst: tuple[WorstPixel, ...]
    others: dict[str, Settings]
    notes: tuple[str, ...]
    rounding: RoundingStudy | None = None

    @property
    def passed(self) -> bool:
        return self.check.passed and (self.rounding is None or self.rounding.spread.passed)

    @property
    def share(self) -> Floats:
        """(M, N) error in parts of what is allowed; NaN where `kappa` is, 0 in the background without an error."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.found == 0.0, 0.0, self.found / np.asarray(self.expected, np.float64))

    def quantiles(self) -> dict[str, float]:
        """Return median, 99th percentile and largest kappa of the covered pixels checked; empty without any."""
        known = self.kappa[self.kappa > 0.0]
        if not len(known):
            return {}
        return {
            "median": float(np.median(known)),
            "p99": float(np.quantile(known, 0.99, method="inverted_cdf")),
            "max": float(known.max()),
        }

    def channels(self) -> dict[str, Array]:
        """Return the EXR's channels: the image and its layers, kappa, found, expected, and the digits of `rounding`."""
        own = {"kappa": self.kappa, "found": self.found, "expected": self.expected}
        if self.rounding is not None:
            own |= {"digits": self.rounding.digits, "promised": self.rounding.promised}
        return {**self.frame.channels(), **own}

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        scene = self.frame.scene
        found = {
            "scene": scene.name,
            "triangles": scene.face_count,
            "resolution": scene.camera.resolution,
            "device": self.device,
            "settings": vars(self.frame.settings),
            "passed": self.passed,
            "pixels": {"checked": self.check.pixels, "of": self.check.of, "covered": int((self.kappa != 0.0).sum())},
            "kappa": self.quantiles(),
            "within": self.within,
            "bounds": self.check.bounds,
            "allowed": self.check.allowed,
            "worst": [each.stats() for each in self.worst],
            "others": {name: vars(settings) for name, settings in self.others.items()},
            "check": self.check.stats(),
            "notes": self.notes,
            "rounding": None if self.rounding is None else self.rounding.stats(),
        }
        result: dict[str, Any] = plain(found)
        return result


def study(scene: Scene, settings: Settings, device: Device, runs: int | None = None) -> SceneStudy:
    """Draw the scene, compare its pixels with the oracle, and name the worst ones. runs: with random rounding, None for none
    at all. Raises InputError and DeviceError."""
    frame = render(scene, settings=replace(settings, layers=(*settings.layers, *LAYERS)), device=device)
    start = time.perf_counter()
    index = _index(frame)
    found = compare(frame, index)
    frame.check = summary(found, time.perf_counter() - start)
    covered = found.oracle.alpha > 0.0
    seen = _seen(found)
    factors = causes.factors(found, seen, scene, frame.settings)
    good = ~found.wrong & (found.counted <= found.allowed)
    chosen = worst_pixels(found, np.where(good, causes.amplification(factors), np.inf))
    others, notes = alternatives(frame.settings, device)
    errors = (
        {name: errors_at(scene, each, device, index[chosen]) for name, each in others.items()} if len(chosen) else {}
    )
    worst = [_named(found, int(k), seen, {name: float(each[k]) for name, each in factors.items()}) for k in chosen]
    return SceneStudy(
        frame,
        device.title,
        frame.check,
        *_maps(found, index),
        within=float(good[covered].mean()) if covered.any() else 1.0,
        worst=tuple(
            replace(each, others={name: (float(pair[0][k]), float(pair[1][k])) for name, pair in errors.items()})
            for k, each in enumerate(worst)
        ),
        others=others,
        notes=notes,
        rounding=None if runs is None else _rounding(found, index, seen, factors, spread.measure(found, device, runs)),
    )


def _rounding(
    found: Comparison, index: Integers, seen: causes.Faces, factors: Mapping[str, Floats], measured: Spread
) -> RoundingStudy:
    """Name the pixels whose bounds are too small or far too large."""
    maps = []
    for values in (measured.spread, measured.expected):
        whole = np.where(found.frame.alpha.ravel() > 0.0, np.nan, 0.0).astype(np.float32)
        whole[index[measured.counted]] = spread.digits(values)[measured.counted]
        maps.append(whole.reshape(found.frame.alpha.shape))
    named = []
    for chosen, order in ((measured.too_small, -measured.ratio), (measured.too_large, measured.ratio)):
        at = np.flatnonzero(chosen)
        at = at[np.argsort(order[at], kind="stable")][:WORST]
        pixels = [_named(found, int(k), seen, {name: float(each[k]) for name, each in factors.items()}) for k in at]
        errors = measured.found[at]
        named.append(tuple(replace(each, found=float(e)) for each, e in zip(pixels, errors, strict=True)))
    return RoundingStudy(measured, maps[0], maps[1], named[0], named[1])


def _seen(found: Comparison) -> causes.Faces:
    """Return the faces that own a pixel."""
    ids = np.unique(found.oracle.id)
    return causes.faces(found.frame.scene, ids[ids > 0].astype(np.int64) - 1)


def _index(frame: Frame) -> Integers:
    """Return the indices of the pixels to check, ascending: all, or of a large image a sample and the tiles where the sample
    found rounding amplified most."""
    index = sample(frame, SAMPLED if frame.alpha.size > EVERY else frame.alpha.size, 0)
    if len(index) == frame.alpha.size:
        return index
    found = compare(frame, index)
    score = causes.amplification(causes.factors(found, _seen(found), frame.scene, frame.settings))
    rows, columns = frame.alpha.shape
    across = -(-columns // TILE)
    tile = found.rows // TILE * across + found.columns // TILE
    most = np.zeros(-(-rows // TILE) * across)
    np.maximum.at(most, tile, score)
    chosen = np.isin(np.arange(len(most)), np.argsort(-most, kind="stable")[:TILES])
    inside = chosen.reshape(-1, across).repeat(TILE, axis=0).repeat(TILE, axis=1)[:rows, :columns]
    return np.union1d(index, np.flatnonzero(inside))


def _maps(found: Comparison, index: Integers) -> tuple[Floats32, Floats32, Floats32]:
    """Return kappa, found and expected, (M, N) each."""
    frame = found.frame
    covered = found.oracle.alpha > 0.0
    maps = []
    for values in (found.oracle.kappa, found.found, found.expected):
        whole = np.where(frame.alpha.ravel() > 0.0, np.nan, 0.0).astype(np.float32)
        with np.errstate(over="ignore"):
            whole[index] = np.where(covered | found.wrong, values, 0.0)
        maps.append(whole.reshape(frame.alpha.shape))
    return maps[0], maps[1], maps[2]


def worst_pixels(found: Comparison, score: Floats, count: int = WORST) -> Integers:
    """Return up to `count` of the compared pixels whose center is covered, spread over what is drawn: the largest score (K,)
    first, and of equal ones the largest error."""
    alive: Integers = np.flatnonzero((found.oracle.id > 0) | found.wrong)
    if not len(alive):
        return alive
    rows, columns = found.rows, found.columns
    score = np.where(np.isnan(score), np.inf, score)
    apart = max(np.ptp(rows[alive]), np.ptp(columns[alive])) / SPREAD
    chosen: list[int] = []
    while len(alive) and len(chosen) < count:
        first = alive[score[alive] == score[alive].max()]
        worst = int(first[found.found[first].argmax()])
        chosen.append(worst)
        away = np.hypot(rows[alive] - rows[worst], columns[alive] - columns[worst])
        alive = alive[(away > apart) & (alive != worst)]
    return np.array(chosen)


def _named(found: Comparison, k: int, seen: causes.Faces, factors: Mapping[str, float]) -> WorstPixel:
    """Return compared pixel k with its cause. A wrong pixel may show a face that the oracle does not see."""
    frame, expected = found.frame, found.oracle
    row, column = int(found.rows[k]), int(found.columns[k])
    face = int(expected.id[k]) - 1
    point = frame["P"][row, column]
    cause, sentence, mesh = causes.NONE, "nothing belongs here", ""
    if face >= 0:
        at = int(np.searchsorted(seen.index, face))
        cause, mesh = causes.cause_of(factors), frame.scene.meshes[seen.mesh[at]].name
        exponent = float(expected.exponent[k])
        pixel = causes.Pixel(frame.scene, seen, at, point, expected.conditions[k], exponent, factors)
        sentence = causes.why(cause, pixel)
    return WorstPixel(
        row=row,
        column=column,
        face=face,
        mesh=mesh,
        point=(float(point[0]), float(point[1]), float(point[2])),
        kappa=float(expected.kappa[k]),
        exponent=float(expected.exponent[k]),
        found=float(found.found[k]),
        expected=float(found.expected[k]),
        factors=dict(factors),
        cause=cause,
        why=sentence,
        others={},
    )


def alternatives(settings: Settings, device: Device) -> tuple[dict[str, Settings], tuple[str, ...]]:
    """Return settings that may be more exact, by name, and notes on those that the device lacks."""
    found: dict[str, Settings] = {}
    notes: list[str] = []
    base = replace(settings, layers=("Z", "id"))
    standard = Settings.from_preset("standard")
    pieces = ["visibility", "lighting_at", "interpolation", "texture_at"]
    if base.shader not in ("nolight", "pbr"):  # no approximation, but another picture
        pieces.append("shader")
    if base.precision == "fast":
        found["float32"] = replace(base, precision="float32")
    changes = {name: getattr(standard, name) for name in pieces}
    if any(getattr(base, name) != value for name, value in changes.items()):
        found["standard"] = replace(base, **changes)
    if base.precision != "float64":
        if device.has_fp64:
            found["float64"] = replace(base, precision="float64")
        else:
            notes.append("float64 was not drawn: the device has none")
    return found, tuple(notes)


def errors_at(scene: Scene, settings: Settings, device: Device, index: Integers) -> tuple[Floats, Floats]:
    """Return errors found and expected, (K,) each, of the pixels of these indices, drawn with other settings."""
    found = compare(render(scene, settings=settings, device=device), index)
    return found.found, found.expected
