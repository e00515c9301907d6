"""What kernels read of a kind of light: the members of its row, and how they are written. Zeros are a plain point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..scene.lights import NARROWEST_EDGE, Light, PlacedLight

# The struct Light: type, name, count and meaning, see struct_layout.py.
MEMBERS = [
    ("real", "position", 3, "relative to the eye, world axes, scaled; directional: unit, toward the light"),
    ("real", "directional", 1, "1 for a directional light, else 0"),
    ("real", "intensity", 3, "linear RGB; attenuated: at a scaled distance of 1"),
    ("real", "inverse_range", 1, "1/range, scaled; 0 for none"),
    ("real", "axis", 3, "unit, world axes: of the cone, away from the light; or of a light of finite size"),
    ("real", "cone_cosine", 1, "of the outer angle"),
    ("real", "cone_scale", 1, "1 over the difference of the inner and the outer cosine"),
    ("int", "cone", 1, "whether it is a spot"),
    ("int", "attenuated", 1, "whether it decreases with the square of the distance"),
    ("int", "points", 1, "that stand for a light of finite size, 0 for none"),
    ("int", "sphere", 1, "whether it is a sphere, else a rectangle whose normal is axis"),
    ("real", "right", 3, "scaled: half a side of a rectangle, or a radius of a sphere's disc that axis is normal to"),
    ("real", "up", 3, "scaled: half the other side, or the radius at right angles"),
    ("real", "shadow_scale", 1, "turns right and up into the units of its ShadowLight; with SHADOWS"),
    ("real", "center_scale", 1, "turns position into the units of right and up, a power of two, 1 or less"),
    ("int", "first_point", 2, "in the unit square, fractions of 2^32"),
    ("int", "point_step", 2, "from point to point"),
]


def rows_of(lights: Sequence[Light], struct: np.dtype[Any]) -> Array:
    """Return a row of each light, at least one, with what only its kind says, so that no camera changes it."""
    rows = np.zeros(max(len(lights), 1), struct)
    for row, light in zip(rows, lights, strict=False):
        row["attenuated"] = light.attenuates
        if not isinstance(light, PlacedLight):
            row["directional"], row["position"] = 1.0, -light.axis
        elif light.axis is not None:
            row["axis"] = light.axis
        if light.cone is not None:
            inner, outer = (math.cos(math.radians(angle)) for angle in light.cone)
            row["cone"], row["cone_cosine"] = 1, outer
            row["cone_scale"] = 1.0 / max(inner - outer, NARROWEST_EDGE)
    return rows
