"""Comparison of optical flow with the float64 oracle's; see `oracle_bounds`."""

from __future__ import annotations

import numpy as np

from ... import oracle
from ...base.arrays import Array, Bools, Floats
from ...pipeline.frame_results import Flow
from ...scene.model import Scene, Settings
from .oracle_bounds import HALF_ULP


def flow_errors(
    flow: Flow, scene: Scene, settings: Settings, ids: Array, where: tuple[Array, Array]
) -> tuple[Floats, Bools]:
    """Return the errors (K,) of a flow's vectors at pixels, relative to the bound, and where its mask is wrong (K,).

    scene, settings: of the frame from which it leads. ids: (K,), what the pixels show, as in the layer id. where: rows and
    columns of the pixels. The bound is what rounding in float64 may change, and half an ulp of float32. Where only one of
    both is NaN the error is infinite, unless rounding decides; in the background it is 0, or infinite of a number.
    """
    errors, wrong = np.zeros(len(ids)), np.zeros(len(ids), bool)
    visible = ids > 0
    at = where[0][visible], where[1][visible]
    vectors, occluded = flow.vectors[where], flow.occluded[where]
    errors[~visible] = np.where(np.isnan(vectors[~visible]).all(axis=1), 0.0, np.inf)
    wrong[~visible] = ~occluded[~visible]
    if not visible.any():
        return errors, wrong
    expected = oracle.flow(scene, settings, flow.to, flow.settings, ids[visible].astype(np.int64) - 1, at)
    vectors = vectors[visible].astype(np.float64)
    bound = expected.off + HALF_ULP * np.abs(expected.vectors).max(axis=1)
    missing = np.isnan(vectors).any(axis=1), np.isnan(expected.vectors).any(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(vectors - expected.vectors).max(axis=1)
        ratio = np.where(off > 0.0, off / bound, 0.0)
    one = np.where(missing[0] & missing[1], 0.0, np.where(expected.unsure, 0.0, np.inf))
    errors[visible] = np.where(missing[0] | missing[1], one, ratio)
    wrong[visible] = (occluded[visible] != expected.occluded) & ~expected.unsure
    return errors, wrong
