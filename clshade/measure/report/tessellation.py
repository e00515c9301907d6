"""Error of Gouraud and Phong shading of a sphere against its number of triangles; finer versions of built-in shapes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ...errors import InputError
from ...images.metrics import rmse
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer, render
from ...scene.builtin.scenes import builtin
from ...scene.model import Mesh, Scene
from ...scene.settings import Shader
from ..timing import Spread, in_turns, spread
from .measure import frame_ms
from .power_law import Power, fitted

SHADERS: tuple[Shader, ...] = ("gouraud", "phong")
LEVELS = range(7)  # subdivision levels: 20 to 81,920 triangles
FINEST = 7  # level of the reference: 327,680 triangles, phong
FRAMES, SECONDS = 9, 4.0  # of each sphere, in turns
FINER = 16  # times as many triangles: edges are a quarter as long, and errors of second order a sixteenth
MOST_FINER = 1 << 22  # triangles
# Built-in shapes: the option that makes them finer, its value from the number of triangles, and the value for FINER as many.
SHAPES: dict[str, tuple[str, Callable[[int], float], Callable[[int], int]]] = {
    "teapot": ("level", lambda faces: math.sqrt(max(faces - 4248, 0) / 64), lambda level: 4 * level),
    "course": ("level", lambda faces: math.sqrt(faces / 64), lambda level: 4 * level),
    "icosphere": ("level", lambda faces: math.log(faces / 20, 4), lambda level: level + 2),
    "torus_knot": ("triangles", float, lambda triangles: FINER * triangles),
}


@dataclass(frozen=True)
class Tessellation:
    """Errors by level.

    triangles: number at each level. finest: number of the reference. errors: shader -> RMSE at each level, over the
    pixels that both spheres cover: the error at the silhouette is that of the shape, the same for both shaders. ms:
    shader -> milliseconds of a frame at each level.
    """

    triangles: tuple[int, ...]
    finest: int
    errors: dict[str, tuple[float, ...]]
    ms: dict[str, tuple[Spread, ...]]

    def slope(self, shader: str) -> Power:
        """Return the fitted power of the error in the number of triangles: -1 is second order."""
        return fitted(self.triangles, self.errors[shader])

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        times = {shader: [each._asdict() for each in ms] for shader, ms in self.ms.items()}
        return {**vars(self), "ms": times, "slopes": {shader: self.slope(shader)._asdict() for shader in self.errors}}


def tessellation(
    device: Device, resolution: tuple[int, int] = (256, 256), *, levels: Iterable[int] = LEVELS, finest: int = FINEST
) -> Tessellation:
    """Measure the errors and times of the built-in icosphere."""
    fine = builtin("icosphere", level=finest, resolution=resolution)
    truth = render(fine, device=device, shader="phong")
    scenes = [builtin("icosphere", level=level, resolution=resolution) for level in levels]
    errors: dict[str, list[float]] = {shader: [] for shader in SHADERS}
    with ExitStack() as stack:
        renderers = []
        for shader in SHADERS:
            for scene in scenes:
                renderers.append(stack.enter_context(Renderer(scene, device=device, shader=shader)))
                errors[shader].append(_shading_error(renderers[-1].render(), truth))
        turns = in_turns([lambda _, each=each: frame_ms(each) for each in renderers], FRAMES, SECONDS)  # type: ignore[misc]
    times = [spread(ms) for ms in zip(*turns, strict=True)]
    return Tessellation(
        tuple(scene.face_count for scene in scenes),
        fine.face_count,
        {shader: tuple(each) for shader, each in errors.items()},
        {shader: tuple(times[k * len(scenes) : (k + 1) * len(scenes)]) for k, shader in enumerate(SHADERS)},
    )


def _shading_error(frame: Frame, truth: Frame) -> float:
    both = (frame.alpha == 1.0) & (truth.alpha == 1.0)
    return rmse(frame.rgb[both], truth.rgb[both]) if both.any() else math.nan


def finer_builtin(scene: Scene) -> Scene | None:
    """Return the scene with FINER times as many triangles, if its meshes are those of a built-in scene; else None."""
    if scene.name not in SHAPES or not 0 < FINER * scene.face_count <= MOST_FINER:
        return None
    option, value_of, finer_value = SHAPES[scene.name]
    value = round(value_of(scene.face_count))
    try:
        same, finer = (builtin(scene.name, **{option: each}) for each in (value, finer_value(value)))
    except InputError:
        return None
    if len(same.meshes) != len(scene.meshes):
        return None
    if not all(_same_shape(one, other) for one, other in zip(same.meshes, scene.meshes, strict=True)):
        return None
    meshes = (replace(one, material=own.material) for one, own in zip(finer.meshes, scene.meshes, strict=True))
    return replace(scene, meshes=tuple(meshes))


def _same_shape(one: Mesh, other: Mesh) -> bool:
    """Return whether two meshes differ in name and material at most."""
    names = [field.name for field in fields(Mesh) if field.name not in ("name", "material")]
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)
