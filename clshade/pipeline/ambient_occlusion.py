"""The rays of ambient occlusion as the kernels read them."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array
from ..scene.settings import Settings
from . import light_points
from .hierarchy import CasterFrame
from .struct_layout import SHADOW_REACH, Structs

FARTHEST = 4.0 * SHADOW_REACH  # longer than any diagonal of the casters' box, so that longer rays meet no more
_LEAST = 2.0**-60  # shorter rays end where they begin


def hemisphere_row(settings: Settings, frame: CasterFrame, structs: Structs) -> Array:
    """Return one row of structs.Light whose points are those of the unit disc below the hemisphere. shadow_scale is the
    rays' length in the units of shadows; no points without ambient occlusion."""
    rows = np.zeros(1, structs.Light)
    if not settings.ambient_occlusion or settings.ao_distance is None:
        return rows
    row = rows[0]
    row["points"], row["sphere"], row["axis"] = settings.ambient_occlusion, 1, light_points.AXIS
    row["right"], row["up"] = light_points.disc_radii()
    with np.errstate(over="ignore"):
        distance = float(np.minimum(np.float64(settings.ao_distance) * frame.unit, FARTHEST))
    row["shadow_scale"] = distance if distance >= _LEAST else 0.0
    light_points.write_pattern(row, settings.ambient_occlusion)
    return rows
