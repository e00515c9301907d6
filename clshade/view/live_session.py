"""A client of a live view: its camera and settings, what to draw next, probe and snapshot. No network, no thread.

A picture is a binary message: the length of the header with its padding as uint64, little-endian; the header, JSON,
padded to whole 8 bytes; the arrays, each padded to 8 bytes.
"""

from __future__ import annotations

import json
import math
import os
import shlex
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import Any

import numpy as np

from ..base.arrays import Array, Bytes
from ..base.declare import as_argument
from ..base.json_values import plain
from ..base.validation import integer, value_error
from ..images import exr
from ..images.tonemap import JOINT, Operator, mapped
from ..images.tonemap import checked as checked_exposure
from ..pipeline.frame import Frame
from ..pipeline.frame_files import KINDS, chosen_paths
from ..scene.camera import Camera
from ..scene.model import default_tonemap
from ..scene.settings import SHADERS, Settings
from .live_input import ANSWERED, checked, dolly, fly, orbit, pan
from .live_scene import LiveScene, View, in_motion

SAMPLES = (1, 4, 16, 64)
SCALES = (1, 2, 4)  # pixels of a full picture per pixel of a coarse one, across and down
FRAME_MS = 33.0  # of a picture while the view moves: 30 frames/s
LARGE = 1_000_000  # triangles: larger scenes get no renderers for the steps in between
_ALIGNMENT = 8  # bytes: typed arrays of a browser begin at multiples of their elements' size
_POSE = ("eye", "lookat", "up")


@dataclass(frozen=True)
class Step:
    """A kind of picture."""

    samples: int  # per pixel
    scale: int = 1  # how much coarser it is in both directions
    last: bool = False  # nothing follows it


@dataclass(frozen=True)
class Display:
    """How a client sees pictures. as_floats: it wants all channels of every picture, not only of the last."""

    tonemap: Operator | None
    exposure: float
    as_floats: bool = False


@dataclass(frozen=True)
class Task:
    """A picture to draw: everything it depends on, so that it may be drawn while the session goes on."""

    step: Step
    view: View
    display: Display
    version: int
    is_first: bool  # of its version, drawn while the view moves


@dataclass(frozen=True)
class Drawing:
    """A drawn picture."""

    task: Task
    frame: Frame
    message: bytes  # for the client
    times_ms: dict[str, float]  # stages of the frame, then `frame`, `convert` and `total`

    @property
    def ms(self) -> float:
        """What such a picture takes again: the frame and its encoding, without making a renderer for it."""
        return self.times_ms["frame"] + self.times_ms["convert"]


class Session:
    """What one client sees.

    `due`, `drawn` and `handle` belong to one thread; `draw`, and `handle` of `live_input.ANSWERED`, to the one that
    draws, at the same time or not.
    """

    def __init__(self, scene: LiveScene, clock: Callable[[], float] = time.monotonic) -> None:
        self._scene, self._clock = scene, clock
        saving = scene.source.saving
        self.display = Display(saving.get("tonemap"), saving.get("exposure", 0.0))
        self.view = scene.first_view()
        self._first, self._scene_version, self.version = self.view, scene.version, 0
        self._window: tuple[int, int] | None = None
        self._final: tuple[View, int, Frame] | None = None  # the latest, with every sample
        self._probed: tuple[View, int, Frame] | None = None  # with all layers
        self._refinement = Refinement()
        self._change(self.view)

    # Input

    def handle(self, message: Mapping[str, Any]) -> dict[str, Any] | None:
        """Apply an input or answer it, see `live_input.MESSAGES`; return the message for the client, if there is one.

        Raises InputError, and OutputError from a snapshot; nothing changes then.
        """
        kind, fields = checked(message)
        moves: dict[str, Callable[..., Camera]] = {"orbit": orbit, "pan": pan, "fly": fly}
        moves["dolly"] = partial(dolly, first=self._first.camera)
        if kind == "command":
            return {"type": kind, "command": self.command()}
        if kind in ANSWERED:
            return {"type": kind, **getattr(self, kind)(**fields)}
        if kind in moves:
            camera = self._scene.placed(moves[kind](self.view.camera, **fields), self.view.view_angle)
            self._change(replace(self.view, camera=camera))
        elif kind == "reset":
            self._change(replace(self.view, camera=self._first.camera))
        elif kind == "size":
            self._window = fields["columns"], fields["rows"]  # of pictures too, unless the source has a resolution
            self._first = self._scene.first_view(self._window)
            view = self._placed(self.view)
            if view.camera.resolution != self.view.camera.resolution:
                self._change(view)
        elif kind == "set":
            before = self.options()
            self._set(fields)
            if self.options() != before:  # not those that the client knows, or others are allowed
                return {"type": "options", **self.options()}
        return None

    def _placed(self, view: View) -> View:
        """Return a view with the resolution and the lens of the first one."""
        angle, pose = self._first.view_angle, {name: getattr(view.camera, name) for name in _POSE}
        return replace(view, camera=self._scene.placed(replace(self._first.camera, **pose), angle), view_angle=angle)

    def _set(self, fields: Mapping[str, Any]) -> None:
        """Change settings (fields of Settings), lights, surroundings, and what the display shows."""

        def changed(instance: Any) -> Any:
            return replace(instance, **{name: value for name, value in fields.items() if hasattr(instance, name)})

        display: Display = changed(self.display)
        stops = checked_exposure("srgb" if display.tonemap is None else display.tonemap, display.exposure)
        view: View = changed(self.view)
        if len(view.lights) != len(self.view.lights):
            raise value_error("set", "lights", f"{len(self.view.lights)} factors", view.lights)
        if fields.get("ground") and view.settings.edges is not None:
            raise value_error("set", "ground", "none with edges, which would draw its edges too", True)
        if "environment" in fields:
            self.checked_environment(view.environment)
        view = replace(view, settings=changed(view.settings))
        if view.settings.background == "environment" and self._scene.surroundings(view) is None:
            if "background" in fields:
                raise value_error("set", "background", "another one, or an environment", "environment, and none")
            view = replace(view, settings=replace(view.settings, background="scene"))
        before, self.display = self.display, replace(display, exposure=stops)
        if view != self.view or self.display.as_floats != before.as_floats:
            self._change(view)

    def _environments(self) -> dict[str | None, str]:
        """Return the names of environments that may light the scene, the source's first, with what people read."""
        scene, name = self._scene.scene, self._scene.source.environment
        first = "none" if scene.own_lights else "studio"
        if scene.environment is not None:
            first = os.path.basename(name or "") or scene.environment.name or "the scene’s"
        return {name: first} | {choice: choice for choice in ("studio", "none") if choice != first}

    def checked_environment(self, name: Any) -> None:
        """Load an environment, which may take the time to read a file. Raises InputError for another name."""
        environments = self._environments()
        if name not in list(environments):
            raise value_error("set", "environment", f"one of {', '.join(environments.values())}", name)
        self._scene.lit(name)

    def _change(self, view: View) -> None:
        self.view = view
        self.version += 1
        self._probed = None
        self._refinement.restart(view.settings.samples, self._scene.scene.face_count, self._clock())

    def reloaded(self) -> None:
        """Take over the scene that was read again: the camera stays, lights do if there are as many."""
        self._first = first = self._scene.first_view(self._window)
        lights = self.view.lights if len(self.view.lights) == len(first.lights) else first.lights
        self._final, self._scene_version = None, self._scene.version
        self._change(replace(self._placed(self.view), lights=lights))

    # Drawing

    def due(self) -> Task | float | None:
        """Return what to draw now, or the seconds until something is due, or None: nothing, until an input comes."""
        step = self._refinement.due(self._clock())
        if not isinstance(step, Step):
            return step
        return Task(step, self.view, self.display, self.version, self._refinement.is_first)

    def draw(self, task: Task) -> Drawing:
        """Draw a picture and encode it for the client."""
        start = time.perf_counter()
        step, view, settings = task.step, task.view, task.view.settings
        floats = step.last or task.display.as_floats
        if not step.last:
            settings = in_motion(settings, layers=settings.layers if floats else (), samples=step.samples)
        columns, rows = full = view.camera.resolution
        coarse = (max(columns // step.scale, 1), max(rows // step.scale, 1))
        small = replace(view, camera=replace(view.camera, resolution=coarse), settings=settings)
        frame = self._scene.render(small, self)
        end = time.perf_counter()
        if floats:
            arrays = {name: enlarge(plane, (rows, columns)) for name, plane in planes(frame.channels()).items()}
        else:
            arrays = {"rgba": rgba8(frame, self._tonemap(view, task.display), task.display.exposure)}
        stages = {name: ms for name, ms in frame.stats["times_ms"].items() if name not in ("pack", "open", "upload")}
        now = time.perf_counter()
        times = {**stages, "convert": (now - end) * 1e3, "total": (now - start) * 1e3}
        if step.last:
            self._final = view, self._scene_version, frame
        width, height = full if floats else coarse
        header = {
            "type": "image" if floats else "picture",
            **{"width": width, "height": height, "full": full, "drawn": coarse},
            **{"samples": step.samples, "last": step.last, "moving": task.is_first, "version": task.version},
            "times_ms": {name: round(ms, 3) for name, ms in times.items()},
            "camera": _pose(view.camera),
        }
        return Drawing(task, frame, pack_picture(header, arrays), times)

    def _tonemap(self, view: View, display: Display) -> Operator:
        return display.tonemap or default_tonemap(self._scene.lit(view.environment)[0])

    def drawn(self, task: Task, ms: float) -> None:
        """Note that a task was drawn, or failed, and its time."""
        self._refinement.drawn(task.step, ms, current=task.version == self.version)

    # Answers

    def probe(self, column: Any, row: Any) -> dict[str, Any]:
        """Return the values of a pixel of the final picture, all layers, by channel, as an EXR holds them.

        Row 0 is at the top. JSON lacks infinity and NaN: they are text. Raises InputError.
        """
        view, version = self.view, self.version
        columns, rows = view.camera.resolution
        column = integer("probe", "column", column, 0, columns - 1)
        row = integer("probe", "row", row, 0, rows - 1)
        probed = self._probed  # another thread may set it to None
        if probed is None or probed[:2] != (view, self._scene_version):
            frame = self._scene.render(replace(view, settings=_with_all_layers(view.settings)), self)
            self._probed = probed = view, self._scene_version, frame
        pixel = np.s_[row : row + 1, column : column + 1]
        layers = {name: layer[pixel] for name, layer in probed[2].channels().items()}
        values = {name: plain(plane.item(), words=True) for name, plane in planes(layers).items()}
        return {"version": version, "column": column, "row": row, "values": values}

    def snapshot(self) -> dict[str, Any]:
        """Write the EXR and PNG that `render` writes for this view; return their names, the command and warnings.

        A number is added to the name, so that no file is replaced. Raises OutputError.
        """
        view, display, source = self.view, self.display, self._scene.source
        final = self._final
        frame = final[2] if final and final[:2] == (view, self._scene_version) else self._scene.render(view, self)
        names = (f"{source.output}-{number}" for number in count(1))
        output = next(name for name in names if not any(path.exists() for path in chosen_paths(name, KINDS).values()))
        saving = {**source.saving, "tonemap": display.tonemap, "exposure": display.exposure}
        warnings = frame.write(output, **saving)  # type: ignore[arg-type]
        files = [str(path) for path in chosen_paths(output, source.saving.get("files")).values()]
        return {"files": files, "command": self.command(output), "warnings": warnings}

    def command(self, output: str | None = None) -> str:
        """Return the command line of `render` that draws this view."""
        arguments = self._scene.command(self.view, self.display.tonemap, self.display.exposure)
        return shlex.join([*arguments, *([] if output is None else ["-o", as_argument(output)])])

    def close(self) -> None:
        """Release frames and renderers; in the thread that draws."""
        self._final = self._probed = None
        self._scene.release(self)

    # What the client knows

    def description(self) -> dict[str, Any]:
        """Return what a client needs at first."""
        scene, view = self._scene.scene, self.view
        return {
            "name": os.path.basename(self._scene.source.name),
            "triangles": scene.face_count,
            "resolution": list(view.camera.resolution),
            "fills": self._scene.takes_sizes,
            "lights": list(view.lights),
            "lightNames": [repr(light).strip("<>") for light in scene.lights],
            "tonemap": self._tonemap(view, self.display),
            "exposure": self.display.exposure,
            "camera": _pose(view.camera),
            **self.options(),
        }

    def options(self) -> dict[str, Any]:
        """Return the settings that a client may change, besides lights and display, and which values are allowed now."""
        view, settings = self.view, self.view.settings
        is_lit, is_pbr = settings.shader != "nolight", settings.shader == "pbr"
        has_lights = is_lit and bool(view.lights) and (not is_pbr or self._scene.lit(view.environment)[0].own_lights)
        surroundings = self._scene.surroundings(view)
        names = ("shader", "samples", "layers", "shadows", "ambient_occlusion", "background")
        return {
            "settings": {
                **{name: getattr(settings, name) for name in names},
                "ground": view.ground,
                "environment": view.environment,
                "environment_intensity": surroundings.intensity if surroundings else None,
            },
            "choices": {
                "shader": SHADERS,
                "layers": _with_all_layers(settings).layers,
                "background": ["scene", *(["environment"] if surroundings else []), None, "color"],
                "environment": list(self._environments().items()) if is_pbr else [],
                "lights": has_lights,
                "environment_intensity": is_pbr and surroundings is not None,
                "shadows": has_lights,
                "ambient_occlusion": is_lit,
                "ground": settings.edges is None,
            },
        }


def _with_all_layers(settings: Settings) -> Settings:
    all_: Any = "all"  # those that these settings can have
    return replace(settings, layers=all_)


def _pose(camera: Camera) -> dict[str, list[float]]:
    return {name: getattr(camera, name).tolist() for name in _POSE}


# Pictures as messages


def rgba8(frame: Frame, operator: Operator, exposure: float) -> Bytes:
    """Return the tone-mapped image, (M, N, 4) uint8 with alpha 255, as a canvas takes it; its colors are the PNG's."""
    if operator in JOINT:
        return np.dstack([mapped(frame.rgb, operator, exposure), np.full(frame.alpha.shape, 255, np.uint8)])
    codes = mapped(frame.rgba, operator, exposure)  # alpha too: that is faster than leaving it out
    codes[..., 3] = 255
    return codes


def planes(layers: Mapping[str, Array]) -> dict[str, Array]:
    """Return the channels of layers by their names in an EXR, (M, N) each: float32, numbers uint32."""
    with np.errstate(over="ignore", invalid="ignore"):
        return {
            name: np.ascontiguousarray(plane, np.uint32 if plane.dtype.kind in "iu" else np.float32)
            for name, plane in exr.flatten(layers).items()
        }


def enlarge(plane: Array, shape: tuple[int, int]) -> Array:
    """Return a coarse channel at the full number of rows and columns, each pixel repeated."""
    if plane.shape == shape:
        return plane
    rows, columns = (np.arange(full) * coarse // full for full, coarse in zip(shape, plane.shape, strict=True))
    repeated: Array = plane[np.ix_(rows, columns)]
    return repeated


def pack_picture(header: Mapping[str, Any], arrays: Mapping[str, Array]) -> bytes:
    """Return a picture's message. Its header lists the arrays: name, type, and offset behind the header."""
    listed, end = [], 0
    pieces: list[Any] = []  # the arrays and what pads them
    for name, array in arrays.items():
        listed.append({"name": name, "type": array.dtype.name, "offset": end})
        pieces += [array.reshape(-1).view(np.uint8).data, bytes(-array.nbytes % _ALIGNMENT)]
        end += sum(map(len, pieces[-2:]))
    text = json.dumps({**header, "arrays": listed}).encode()
    text += b" " * (-len(text) % _ALIGNMENT)
    return b"".join([len(text).to_bytes(_ALIGNMENT, "little"), text, *pieces])


# Which picture to draw next


class Refinement:
    """The steps of a view, from the latest change on, and the time that a kind of picture took.

    A step begins only when the view has been still for as long as the step is expected to take: an input never waits
    much longer than it already did.
    """

    def __init__(self) -> None:
        self._ms: dict[tuple[int, int], float] = {}  # (samples, scale) -> time of the latest picture
        self._steps: list[Step] = []
        self._changed, self.is_first = 0.0, False  # whether no picture of the view was drawn yet

    def restart(self, samples: int, triangles: int, now: float) -> None:
        """Begin again, for a view that changed at the time `now`, s, and is to end with so many samples."""
        scale = self._coarse_scale()
        between = [count for count in SAMPLES if 1 < count < samples and triangles <= LARGE]
        steps = [Step(1, scale), *([Step(1)] if scale > 1 else []), *map(Step, between)]
        self._steps = [*steps, Step(samples, last=True)]
        self._changed, self.is_first = now, True

    def due(self, now: float) -> Step | float | None:
        """Return the next step, or the seconds until it is due, or None if all are drawn."""
        if not self._steps:
            return None
        step = self._steps[0]
        wait = 0.0 if self.is_first else self._changed + self._expected_ms(step) / 1e3 - now
        return step if wait <= 0.0 else wait

    def drawn(self, step: Step, ms: float, *, current: bool) -> None:
        """Note a step's time. current: whether it shows this view, not an earlier one."""
        key = step.samples, step.scale
        self._ms[key] = 0.5 * (self._ms.get(key, ms) + ms)
        if current and self._steps and self._steps[0] == step:
            del self._steps[0]
            self.is_first = False

    def _expected_ms(self, step: Step) -> float:
        """Return a step's expected time: measured on such pictures, or estimated from pictures with fewer samples."""
        measured = [(count, ms) for (count, scale), ms in self._ms.items() if scale == 1 and count <= step.samples]
        count, ms = max(measured, default=(1, 0.0))
        return ms * math.sqrt(step.samples / count)  # as a rule: edges alone have samples to light

    def _coarse_scale(self) -> int:
        """Return the finest scale whose pictures come fast enough, else the one beyond which nothing is gained."""
        coarsest = SCALES[-1]
        expected = {coarsest: self._ms.get((1, coarsest), 0.0)}
        for scale in reversed(SCALES[:-1]):
            # At most in proportion to the pixels: what a scale took once, on a busy machine, does not hold forever.
            by_pixels = 4.0 * expected[2 * scale] if expected[2 * scale] else math.inf
            expected[scale] = min(self._ms.get((1, scale), math.inf), by_pixels)
        expected = {scale: ms for scale, ms in expected.items() if 0.0 < ms < math.inf}
        fast = [scale for scale, ms in expected.items() if ms <= FRAME_MS]
        if fast or not expected:
            return min(fast, default=1)
        coarser = SCALES[min(SCALES.index(max(expected)) + 1, len(SCALES) - 1)]  # the first without a time
        fastest = min(expected.values())
        return coarser if coarser not in expected else min(s for s, ms in expected.items() if ms <= 1.5 * fastest)
