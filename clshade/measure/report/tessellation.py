"""The subject's classic curve: how the error of Gouraud's and of Phong's shading falls as a sphere gets more triangles."""

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
LEVELS = range(7)  # of the sphere: 20 to 81,920 triangles
FINEST = 7  # what they are compared with: 327,680 triangles, phong


@dataclass(frozen=True)
class Tessellation:
    """triangles: of each level. finest: of the sphere compared with. errors: shader -> RMSE at each level, over the pixels
    that both spheres cover: the silhouette's own error is that of the shape and the same for both shaders.
    """

    triangles: tuple[int, ...]
    finest: int
    errors: dict[str, tuple[float, ...]]

    def slope(self, shader: str) -> float:
        """Fitted power of the number of triangles by which the error grows: -1 is what second order gives."""
        return loglog_slope(self.triangles, self.errors[shader])

    def stats(self) -> dict[str, Any]:
        """The figures, as JSON takes them."""
        return {**vars(self), "slopes": {shader: self.slope(shader) for shader in self.errors}}


def loglog_slope(x: Any, y: Any) -> float:
    """Exponent of the power law that fits best, in logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def tessellation(
    device: Device, resolution: tuple[int, int] = (256, 256), *, levels: Iterable[int] = LEVELS, finest: int = FINEST
) -> Tessellation:
    """Measured on the built-in icosphere."""
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
