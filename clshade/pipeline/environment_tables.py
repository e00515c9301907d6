"""An environment as the kernels read it."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array
from ..scene.environment import Environment
from ..scene.image_light.brdf_table import brdf_table
from ..scene.image_light.light import image_light
from ..scene.image_light.octahedral import padded
from .shading_tables import to_real
from .struct_layout import Structs

_BLACK = Environment(np.zeros((1, 1, 3)))


def environment_tables(environment: Environment | None, unit: float, structs: Structs) -> tuple[Array, Array]:
    """Return a row of structs.Environment, and the table that it points into, (R, 4) reals: that of the BRDF, with its
    last row and column twice, then the levels with a border of one texel. unit: of light. None: black."""
    light = image_light(environment or _BLACK)
    row = np.zeros(1, structs.Environment)
    row["irradiance"] = to_real(light.irradiance / unit, structs.real).reshape(-1)
    share = brdf_table().copy()
    share[..., 2] = 1.0 - share[..., 2]
    parts = [np.pad(share, ((0, 1), (0, 1), (0, 0)), mode="edge").reshape(-1, 3)]
    offset = len(parts[0])
    for number, level in enumerate(light.levels):
        row["offset"][0, number], row["side"][0, number] = offset, len(level)
        parts.append(padded(level).reshape(-1, 3) / unit)
        offset += len(parts[-1])
    table = np.zeros((offset, 4), structs.real)
    table[:, :3] = to_real(np.concatenate(parts), structs.real)
    return row, table
