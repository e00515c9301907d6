"""The error of one image: recompute some or all of its pixels in float64 with the oracle.

The largest errors occur in small regions, so the sample is stratified: silhouettes, highlights, edges between faces,
the rest of the surfaces, the background. The result is a lower bound of the image's largest error, unless every pixel
is checked.
"""

from __future__ import annotations

import time
from functools import partial
from typing import Literal

import numpy as np

from ... import oracle
from ...base.arrays import Array, Bools
from ...base.validation import arguments, count_or_all, integer
from ...oracle import OracleFrame
from ...oracle.layers import instance_numbers
from ...pipeline.frame import Frame
from ...pipeline.frame_results import Check
from ..defaults import PIXELS
from . import oracle_bounds
from .flow_bounds import flow_errors
from .layer_bounds import layer_errors

STRATA = ("not finite", "silhouettes", "highlights", "edges", "surfaces", "background")
SHARES = (16, 4, 5, 3, 3, 1)  # proportions of the sample; what exceeds a stratum's size goes to the others
BRIGHTEST = 0.05  # fraction of the covered pixels, without silhouettes, that counts as highlights


@arguments(frame=Frame, seed=partial(integer, least=0, most=2**64 - 1))
def check(frame: Frame, pixels: int | Literal["all"] = PIXELS, *, seed: int = 0) -> Check:
    """Measure the error of a rendered image against the float64 oracle.

    Parameters
    ----------
    frame : Frame
        A rendered frame. Its layers `id`, `Z` and `instance_id` are checked too if present, and with
        `id` its `flows`.
    pixels : int or "all", default 4096
        Number of pixels to check, at least 1, or "all" for every pixel. Fewer pixels than the image
        has are a stratified sample: silhouettes, highlights, edges between faces, surfaces and
        background each have their share.
    seed : int, default 0
        Seed of the sample. The same seed gives the same pixels.

    Returns
    -------
    Check
        The errors, the bounds allowed, and whether the image `passed`. It is also stored in
        `frame.check`, and `frame.save` writes it into the EXR's header. If every pixel was checked,
        it includes the error of each pixel, which is saved as the layer `error`.

    Raises
    ------
    InputError
        If an argument is refused.

    Notes
    -----
    A color's error is counted in bounds of sqrt(max(n, 1)) * 2^-24 * kappa * B (in float64
    1e-12 * kappa * B): n is the specular exponent, kappa the condition number of the geometry, and B
    the most light that the point can send. float32 is allowed 32 bounds, `fast` 512, float64 1, and
    more with large textures or several samples. A sample gives a lower bound of the image's largest
    error: pixels not checked may be worse.

    Examples
    --------
    >>> frame = clshade.render(clshade.builtin("teapot"), layers=("Z", "id"))
    >>> found = clshade.check(frame)
    >>> found.passed
    True
    """
    start = time.perf_counter()
    count = count_or_all("check", "pixels", pixels, frame.alpha.size)
    comparison = compare(frame, sample(frame, count, seed))
    frame.check = summary(comparison, time.perf_counter() - start)
    return frame.check


def compare(frame: Frame, index: Array) -> Comparison:
    """Compare the pixels of these indices (K,), in reading order, with the oracle."""
    rows, columns = np.divmod(index, frame.alpha.shape[1])
    return Comparison(frame, oracle.render(frame.scene, frame.settings, rows, columns), rows, columns)


def summary(comparison: Comparison, seconds: float) -> Check:
    """Return the result of comparing pixels, in reading order if they are all; seconds: what that took."""
    frame, rows, columns, expected = comparison.frame, comparison.rows, comparison.columns, comparison.oracle
    strata = _strata(frame)[rows, columns]
    worst = int(np.argmax(comparison.counted))
    per_stratum = {}
    for number, name in enumerate(STRATA):
        mine = strata == number
        per_stratum[name] = (int(mine.sum()), float(comparison.counted[mine].max(initial=0.0)))
    image = None
    if len(rows) == frame.alpha.size:
        with np.errstate(over="ignore"):
            image = np.where(comparison.wrong, np.inf, comparison.error).astype(np.float32).reshape(frame.alpha.shape)
    return Check(
        pixels=len(rows),
        of=frame.alpha.size,
        bounds=float(comparison.counted.max(initial=0.0)),
        allowed=comparison.allowed,
        error=float(comparison.relative.max(initial=0.0)),
        rms=float(np.sqrt(np.square(comparison.relative).mean())),
        kappa=float(expected.kappa[worst]),
        worst=(int(rows[worst]), int(columns[worst])),
        strata=per_stratum,
        wrong=int(comparison.wrong.sum()),
        ties=int(comparison.ties.sum()),
        gates=int(comparison.gates.sum()),
        depth=comparison.depth,
        depth_allowed=oracle_bounds.depth_roundings(frame.alpha),
        ids="id" in frame.layers,
        precision=frame.settings.precision,
        seconds=seconds,
        image=image,
        flow=comparison.flow,
    )


class Comparison:
    """Comparison of pixels (rows from the top, columns) with the oracle; arrays are of the shape of `rows`, (K,) or (M, N).

    oracle: what they should be. faults: where a layer is wrong beyond any rounding, by its name; wrong: where any is. ties,
    gates: bool, see `Check`. error: of the color in bounds, 0 where wrong or tied. counted: the same, and 0 at gates.
    relative: `counted` as |value - oracle| / B. found: the same, also at gates, infinite where wrong. expected: the most
    that is allowed of `found`. depths: errors in roundings, infinite where only one is background; depth: the largest,
    flow: the largest of all pixels, see `Check`.
    """

    def __init__(self, frame: Frame, expected: OracleFrame, rows: Array, columns: Array) -> None:
        scene, settings, where = frame.scene, frame.settings, (rows, columns)
        self.frame, self.rows, self.columns, self.oracle = frame, rows, columns, expected
        rgb, alpha = frame.rgb[where], frame.alpha[where]
        precision = settings.precision
        self.allowed = oracle_bounds.allowed(scene, settings)
        self.faults: dict[str, Array] = {"rgb": np.asarray(~np.isfinite(rgb).all(axis=-1))}
        self.ties = np.zeros(rows.shape, bool)
        if "id" in frame.layers:
            different, unproven = oracle_bounds.different_ids(frame["id"][where], expected, scene, settings, where)
            self.faults["id"] = unproven
            self.ties = different & ~unproven
        self.faults["alpha"] = oracle_bounds.alpha_differs(alpha, expected, self.allowed, precision)
        if "instance_id" in frame.layers:
            self.faults["instance_id"] = _other_instances(frame, expected, where)
        self.wrong = np.any(list(self.faults.values()), axis=0)
        rgb = np.nan_to_num(rgb)
        absolute, ratio = oracle_bounds.color_errors(rgb, expected, precision)
        gates = oracle_bounds.excepted_at_gates(rgb, expected, self.allowed, precision)
        if "id" not in frame.layers or settings.samples > 1:
            suspects = (ratio > self.allowed) & ~gates & (expected.alpha > 0.0)
            self.ties |= oracle_bounds.depth_ties(scene, settings, suspects, where)
        self.ties |= expected.unsure & (ratio > self.allowed) & ~gates
        compared = ~self.wrong & ~self.ties
        self.error = np.where(compared, ratio, 0.0)
        self.gates = compared & gates
        self.counted = np.where(self.gates, 0.0, self.error)
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(absolute > 0.0, absolute / expected.budget, 0.0).max(axis=-1)
            jump = np.where(expected.jump > 0.0, expected.jump / expected.budget, 0.0).max(axis=-1)
        self.found = np.where(self.wrong, np.inf, np.where(compared, relative, 0.0))
        self.relative = np.where(compared & ~self.gates, relative, 0.0)
        self.expected = self.allowed * oracle_bounds.rounding(expected, precision) + jump
        self.depths = np.zeros(rows.shape)
        self.depth: float | None = None
        if "Z" in frame.layers:
            depths = oracle_bounds.depth_errors(frame["Z"][where], expected)
            self.depths = np.where(compared, np.where(np.isnan(depths), np.inf, depths), 0.0)
            self.depth = float(self.depths.max(initial=0.0))
        self.flow = _flow_error(frame, where) if frame.flows and "id" in frame.layers else None


def problem(frame: Frame, skip: Bools | None = None) -> str:
    """Return what is wrong with a frame, and its first wrong pixel; "" if all pixels of all layers are within their bounds.

    skip: (M, N) bool, pixels to leave out.
    """
    scene, settings, shape = frame.scene, frame.settings, frame.alpha.shape
    with np.errstate(all="ignore"):
        expected, layers = oracle.render(scene, settings), oracle.render_layers(scene, settings)
        comparison = Comparison(frame, expected, *np.indices(shape))
        others = {name: frame[name] for name in frame.layers if name not in ("Z", "id")}
        errors = layer_errors(others, layers, scene, settings)
    bad = {f"{name} is wrong": (name, where) for name, where in comparison.faults.items()}
    bad["colors are beyond their bounds"] = "rgb", comparison.counted > comparison.allowed
    bad["depths are beyond their bounds"] = "Z", comparison.depths > oracle_bounds.depth_roundings(frame.alpha)
    for name, error in errors.items():
        bad[f"{name} is beyond its bound"] = name, ~(error <= 1.0) & ~comparison.ties
    for what, (name, where) in bad.items():
        where = where if skip is None else where & ~skip
        if where.any():
            row, column = np.argwhere(where)[0].tolist()
            value = (getattr(frame, name) if name in ("rgb", "alpha") else frame[name])[row, column].tolist()
            right = getattr(layers if name in errors else expected, name)[row, column].tolist()
            count = f"{int(where.sum())} of {where.size} pixels"
            return f"{what}: {count}, the first at row {row}, column {column}: expected {right}, found {value}"
    return ""


def _other_instances(frame: Frame, expected: OracleFrame, where: tuple[Array, Array]) -> Array:
    """Return where instance_id is not that of the face that the frame shows, or without its id the oracle, (K,) bool; of
    two faces as near as each other either one's is right."""
    of_faces = np.append(np.uint32(0), instance_numbers(frame.scene))
    ids = frame["id"][where] if "id" in frame.layers else expected.id
    other: Array = frame["instance_id"][where] != of_faces[np.minimum(ids, len(of_faces) - 1)]
    if "id" not in frame.layers and other.any():
        other &= ~oracle_bounds.depth_ties(frame.scene, frame.settings, other, where)
    return other


def _flow_error(frame: Frame, where: tuple[Array, Array]) -> float:
    """Return the largest error of the frame's flows, see `flow_errors`; infinite where a mask is wrong."""
    largest = 0.0
    for flow in frame.flows.values():
        errors, wrong = flow_errors(flow, frame.scene, frame.settings, frame["id"][where], where)
        largest = max(largest, float(np.where(wrong, np.inf, errors).max(initial=0.0)))
    return largest


# The sample


def _strata(frame: Frame) -> Array:
    """Return the index into STRATA of each pixel, (M, N).

    silhouettes: coverage differs from one of the four neighbors'. highlights: the brightest twentieth of the other
    covered pixels. edges: the face differs from a neighbor's (with the layer id). surfaces: the rest.
    """
    covered = frame.alpha != 0.0
    silhouettes = _differs(covered)
    strata = np.where(covered, STRATA.index("surfaces"), STRATA.index("background")).astype(np.uint8)
    if "id" in frame.layers:
        strata[_differs(frame["id"])] = STRATA.index("edges")
    inside = covered & ~silhouettes
    red, green, blue = (frame.rgb[..., channel] for channel in range(3))
    at = np.flatnonzero(inside)
    if len(at):
        brightness = np.nan_to_num(np.maximum(np.maximum(red, green), blue).ravel()[at])
        last = len(at) - max(1, int(BRIGHTEST * len(at)))
        strata.reshape(-1)[at[brightness > np.partition(brightness, last)[last]]] = STRATA.index("highlights")
    strata[silhouettes] = STRATA.index("silhouettes")
    strata[~(np.isfinite(red) & np.isfinite(green) & np.isfinite(blue))] = STRATA.index("not finite")
    return strata


def _differs(values: Array) -> Array:
    """Return where the value differs from that of one of the four neighbors, (M, N) bool."""
    differs = np.zeros(values.shape, bool)
    across, down = values[:, 1:] != values[:, :-1], values[1:] != values[:-1]
    differs[:, 1:] |= across
    differs[:, :-1] |= across
    differs[1:] |= down
    differs[:-1] |= down
    return differs


def sample(frame: Frame, count: int, seed: int) -> Array:
    """Return the ascending indices, in reading order, of `count` pixels of a frame, of all if it has no more."""
    if count >= frame.alpha.size:
        return np.arange(frame.alpha.size)
    return _sample(_strata(frame).ravel(), count, seed)


def _sample(strata: Array, count: int, seed: int) -> Array:
    """Return the ascending indices of `count` pixels.

    Each stratum gets its share, spread over the image: its pixels in reading order are divided into as many runs of
    equal length, and one pixel of each run is chosen at random.
    """
    generator = np.random.default_rng(seed)
    members = [np.flatnonzero(strata == number) for number in range(len(STRATA))]
    wanted = [0] * len(STRATA)
    left = count
    open_strata = [n for n in range(len(STRATA)) if len(members[n])]
    while left and open_strata:
        shares = sum(SHARES[n] for n in open_strata)
        counts = {n: min(-(-left * SHARES[n] // shares), len(members[n]) - wanted[n]) for n in open_strata}
        for n in open_strata:
            counts[n] = min(counts[n], left)
            wanted[n] += counts[n]
            left -= counts[n]
        open_strata = [n for n in open_strata if wanted[n] < len(members[n])]
    chosen = []
    for pixels, number in zip(members, wanted, strict=True):
        ends = np.arange(number + 1) * len(pixels) // max(number, 1)
        chosen.append(pixels[generator.integers(ends[:-1], ends[1:])] if number else pixels[:0])
    return np.sort(np.concatenate(chosen))
