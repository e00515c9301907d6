"""Error of Gouraud and Phong shading of a sphere against its number of triangles."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...images.metrics import rmse
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import render
from ...scene.builtin.scenes import builtin
from ...scene.settings import Shader

SHADERS: tuple[Shader, ...] = ("gouraud", "phong")
LEVELS = range(7)  # subdivision levels: 20 to 81,920 triangles
FINEST = 7  # level of the reference: 327,680 triangles, phong


@dataclass(frozen=True)
class Tessellation:
    """Errors by level.

    triangles: number at each level. finest: number of the reference. errors: shader -> RMSE at each level, over the
    pixels that both spheres cover: the error at the silhouette is that of the shape, the same for both shaders.
    """

    triangles: tuple[int, ...]
    finest: int
    errors: dict[str, tuple[float, ...]]

    def slope(self, shader: str) -> float:
        """Return the fitted power of the error in the number of triangles: -1 is second order."""
        return loglog_slope(self.triangles, self.errors[shader])

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {**vars(self), "slopes": {shader: self.slope(shader) for shader in self.errors}}


def loglog_slope(x: Any, y: Any) -> float:
    """Return the exponent of the power law fitted in logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def tessellation(
    device: Device, resolution: tuple[int, int] = (256, 256), *, levels: Iterable[int] = LEVELS, finest: int = FINEST
) -> Tessellation:
    """Measure the errors of the built-in icosphere."""
    fine = builtin("icosphere", level=finest, resolution=resolution)
    truth = render(fine, device=device, shader="phong")
    triangles: list[int] = []
    errors: dict[str, list[float]] = {shader: [] for shader in SHADERS}
    for level in levels:
        scene = builtin("icosphere", level=level, resolution=resolution)
        triangles.append(scene.face_count)
        for shader in SHADERS:
            errors[shader].append(_shading_error(render(scene, device=device, shader=shader), truth))
    return Tessellation(tuple(triangles), fine.face_count, {name: tuple(each) for name, each in errors.items()})


def _shading_error(frame: Frame, truth: Frame) -> float:
    both = (frame.alpha == 1.0) & (truth.alpha == 1.0)
    return rmse(frame.rgb[both], truth.rgb[both]) if both.any() else math.nan
