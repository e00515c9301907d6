"""A client of a live view: its camera and settings, what to draw next, probe and snapshot. No network, no thread."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..base.validation import flag, integer, known, number, sequence, value_error
from ..images.tonemap import Operator
from ..images.tonemap import checked as checked_exposure
from ..pipeline.frame import Frame
from ..pipeline.frame_files import KINDS, chosen_paths
from ..scene.camera import MAX_RESOLUTION
from ..scene.model import default_tonemap
from ..scene.settings import SHADERS, Settings
from . import orbit_controls
from .live_command import REPEATED, as_argument, render_command
from .live_message import enlarged, packed, pixel, planes, rgba8
from .live_scene import LiveScene, View, in_motion
from .refinement import Refinement, Step


@dataclass(frozen=True)
class Display:
    """How a client sees pictures. as_floats: it wants all channels of every picture, not only of the last."""

    tonemap: Operator | None
    exposure: float
    as_floats: bool = False


@dataclass(frozen=True)
class Task:
    """A picture to draw: everything it depends on, so that it may be drawn while the session goes on.

    is_first: the first of its version, drawn while the view moves.
    """

    step: Step
    view: View
    display: Display
    version: int
    is_first: bool


@dataclass(frozen=True)
class Drawing:
    """A drawn picture. message: for the client. times_ms: stages of the frame, then `frame`, `convert` and `total`."""

    task: Task
    frame: Frame
    message: bytes
    times_ms: dict[str, float]

    @property
    def ms(self) -> float:
        """What such a picture takes again: the frame and its encoding, without making a renderer for it."""
        return self.times_ms["frame"] + self.times_ms["convert"]


class Session:
    """What one client sees.

    `handle`, `due` and `drawn` belong to one thread; `draw`, `probe` and `snapshot` to the one that draws, at the same
    time or not.
    """

    def __init__(self, scene: LiveScene, clock: Callable[[], float] = time.monotonic) -> None:
        self._scene, self._clock = scene, clock
        saving = scene.source.saving
        self.display = Display(saving.get("tonemap"), saving.get("exposure", 0.0))
        self.view = scene.first_view()
        self._first, self._scene_version, self.version = self.view, scene.version, 0
        self._window: tuple[int, int] | None = None
        self._final: tuple[View, int, Frame] | None = None  # the latest, with every sample
        self._probed: tuple[View, int, Frame] | None = None  # the same with all layers
        self._refinement = Refinement()
        self._change(self.view)

    # Input

    def handle(self, message: Mapping[str, Any]) -> None:
        """Apply an input: what the page sends, see `clshade/view/README.md`. Raises InputError; nothing changes then."""
        kind = str(message.get("type"))
        inputs = {"orbit": self._orbit, "pan": self._pan, "dolly": self._dolly, "fly": self._fly}
        if kind in inputs:
            fields = {name: value for name, value in message.items() if name != "type"}
            camera = self._scene.placed(inputs[kind](fields), self.view.view_angle)
            self._change(replace(self.view, camera=camera))
        elif kind == "reset":
            self._change(replace(self.view, camera=self._first.camera))
        elif kind == "size":
            self._resize(message)
        elif kind == "set":
            self._set({name: value for name, value in message.items() if name != "type"})
        else:
            raise value_error("view", "type", "orbit, pan, dolly, fly, reset, size or set", kind)

    def _orbit(self, fields: dict[str, Any]) -> Any:
        right, up = _numbers("orbit", fields, "right", "up")
        return orbit_controls.orbit(self.view.camera, right, up)

    def _pan(self, fields: dict[str, Any]) -> Any:
        return orbit_controls.pan(self.view.camera, *_numbers("pan", fields, "right", "up"))

    def _dolly(self, fields: dict[str, Any]) -> Any:
        factor = number("dolly", "factor", fields.get("factor"), above=0.0)
        return orbit_controls.dolly(self.view.camera, factor, self._first.camera)

    def _fly(self, fields: dict[str, Any]) -> Any:
        return orbit_controls.fly(self.view.camera, *_numbers("fly", fields, "right", "up", "forward"))

    def _resize(self, fields: Mapping[str, Any]) -> None:
        """Take over the size of the client's window, pixels: that of pictures, unless the source says another."""
        columns, rows = (integer("size", name, fields.get(name), 1, MAX_RESOLUTION) for name in ("columns", "rows"))
        self._window = columns, rows
        self._first = self._scene.first_view(self._window)
        view = self._placed(self.view)
        if view.camera.resolution != self.view.camera.resolution:
            self._change(view)

    def _placed(self, view: View) -> View:
        """Return a view with the resolution and the lens of the first one."""
        angle, camera = self._first.view_angle, self._first.camera
        camera = replace(camera, eye=view.camera.eye, lookat=view.camera.lookat, up=view.camera.up)
        return replace(view, camera=self._scene.placed(camera, angle), view_angle=angle)

    def _set(self, fields: dict[str, Any]) -> None:
        """Change settings (fields of Settings), lights, and what the display shows."""
        display, view = self.display, self.view
        if "tonemap" in fields or "exposure" in fields:
            operator = fields.pop("tonemap", display.tonemap)
            exposure = fields.pop("exposure", display.exposure)
            display = replace(
                display, tonemap=operator, exposure=checked_exposure("srgb" if operator is None else operator, exposure)
            )
        if "as_floats" in fields:
            display = replace(display, as_floats=fields.pop("as_floats") is True)
        if "lights" in fields:
            factors = sequence(fields.pop("lights"))
            if factors is None or len(factors) != len(view.lights):
                raise value_error("view", "lights", f"{len(view.lights)} factors", factors)
            scales = tuple(number("view", "lights", factor, least=0.0) for factor in factors)
            view = replace(view, lights=scales)
        if "ground" in fields:
            ground = flag("view", "ground", fields.pop("ground"))
            if ground and view.settings.edges is not None:
                raise value_error("view", "ground", "none with edges, which would draw its edges too", ground)
            view = replace(view, ground=ground)
        if "environment" in fields:
            view = replace(view, environment=self.checked_environment(fields.pop("environment")))
        if "environment_intensity" in fields:
            intensity = number("view", "environment_intensity", fields.pop("environment_intensity"), least=0.0)
            view = replace(view, environment_intensity=intensity)
        asked = "background" in fields
        if fields:
            known("view", fields, Settings.__dataclass_fields__.keys() - REPEATED)
            view = replace(view, settings=replace(view.settings, **fields))
        if view.settings.background == "environment" and self._scene.surroundings(view) is None:
            if asked:
                raise value_error("view", "background", "another one, or an environment", "environment, and none")
            view = replace(view, settings=replace(view.settings, background="scene"))
        other = display.as_floats != self.display.as_floats
        self.display = display
        if view != self.view or other:
            self._change(view)

    def _environments(self) -> dict[str | None, str]:
        """Return what the scene may be lit by from all around, the source's first, and how it is called."""
        scene, own = self._scene.scene, self._scene.source.environment
        first = "none" if scene.own_lights else "studio"
        if scene.environment is not None:
            first = os.path.basename(own or "") or scene.environment.name or "the scene’s"
        return {own: first} | {name: name for name in ("studio", "none") if name != first}

    def checked_environment(self, name: Any) -> str | None:
        """Return the name of an environment once it is there, which may take the time to read a file."""
        allowed = self._environments()
        if name not in list(allowed):
            raise value_error("view", "environment", f"one of {', '.join(allowed.values())}", name)
        self._scene.lit(name)
        return name  # type: ignore[no-any-return]

    def _change(self, view: View) -> None:
        self.view = view
        self.version += 1
        self._probed = None
        self._refinement.restart(view.settings.samples, self._scene.scene.face_count, self._clock())

    def reloaded(self) -> None:
        """Take over the scene that was read again: the camera stays, lights do if there are as many."""
        scene = self._scene
        self._first = first = scene.first_view(self._window)
        lights = self.view.lights if len(self.view.lights) == len(first.lights) else first.lights
        self._final = None
        self._scene_version = scene.version
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
        last, floats = step.last, step.last or task.display.as_floats
        if not last:
            settings = in_motion(settings, layers=settings.layers if floats else (), samples=step.samples)
        columns, rows = full = view.camera.resolution
        coarse = (max(columns // step.scale, 1), max(rows // step.scale, 1))
        frame = self._scene.render(replace(view, camera=_at(view.camera, coarse), settings=settings), self)
        drawn = time.perf_counter()
        if floats:
            size, arrays = full, {name: enlarged(plane, (rows, columns)) for name, plane in planes(frame).items()}
        else:
            size, arrays = coarse, {"rgba": rgba8(frame, self._tonemap(view, task.display), task.display.exposure)}
        stages = {name: ms for name, ms in frame.stats["times_ms"].items() if name not in ("pack", "open", "upload")}
        now = time.perf_counter()
        times = {**stages, "convert": (now - drawn) * 1e3, "total": (now - start) * 1e3}
        if last:
            self._final = view, self._scene_version, frame
        header = {
            "type": "image" if floats else "picture",
            "width": size[0],
            "height": size[1],
            "full": full,
            "drawn": coarse,
            "samples": step.samples,
            "last": last,
            "moving": task.is_first,
            "version": task.version,
            "times_ms": {name: round(ms, 3) for name, ms in times.items()},
            "camera": _pose(view.camera),
        }
        return Drawing(task, frame, packed(header, arrays), times)

    def _tonemap(self, view: View, display: Display) -> Operator:
        return display.tonemap or default_tonemap(self._scene.lit(view.environment))

    def drawn(self, task: Task, ms: float) -> None:
        """Take note of a task that was drawn, or that failed, and of its time."""
        self._refinement.drawn(task.step, ms, current=task.version == self.version)

    # Looking closer

    def probe(self, column: Any, row: Any) -> dict[str, Any]:
        """Return the values of a pixel of the final picture, all layers. Row 0 is at the top. Raises InputError."""
        view, version = self.view, self.version
        columns, rows = view.camera.resolution
        column = integer("probe", "column", column, 0, columns - 1)
        row = integer("probe", "row", row, 0, rows - 1)
        probed = self._probed
        if probed is None or probed[:2] != (view, self._scene_version):
            frame = self._scene.render(replace(view, settings=_with_all_layers(view.settings)), self)
            self._probed = probed = view, self._scene_version, frame
        return {"version": version, "column": column, "row": row, "values": pixel(probed[2], column, row)}

    def snapshot(self) -> dict[str, Any]:
        """Write the EXR and PNG that `render` writes for this view; return their names, the command and warnings.

        A number is added to the name, so that no file is replaced. Raises OutputError.
        """
        view, display, source = self.view, self.display, self._scene.source
        final = self._final
        frame = final[2] if final and final[:2] == (view, self._scene_version) else self._scene.render(view, self)
        output = _free_name(source.output)
        saving = {**source.saving, "tonemap": display.tonemap, "exposure": display.exposure}
        warnings = frame.write(output, **saving)  # type: ignore[arg-type]
        files = [str(path) for path in chosen_paths(output, source.saving.get("files")).values()]
        return {"files": files, "command": self.command(output), "warnings": warnings}

    def command(self, output: str | None = None) -> str:
        """Return the command line of `render` that draws this view."""
        arguments = render_command(self._scene, self.view, self.display.tonemap, self.display.exposure)
        return shlex.join([*arguments, *([] if output is None else ["-o", as_argument(output)])])

    def close(self) -> None:
        """Release frames and renderers; in the thread that draws."""
        self._final = self._probed = None
        self._scene.release(self)

    def description(self) -> dict[str, Any]:
        """Return what a client has to know at first."""
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
        """Return what a client may set, besides lights and display, and what is allowed now."""
        view, settings = self.view, self.view.settings
        lit = settings.shader != "nolight"
        has_lights = (
            lit and bool(view.lights) and (settings.shader != "pbr" or self._scene.lit(view.environment).own_lights)
        )
        surroundings = self._scene.surroundings(view)
        backgrounds = ["scene", *(["environment"] if surroundings else []), None, "color"]
        return {
            "settings": {
                **{name: getattr(settings, name) for name in ("shader", "samples", "layers", "shadows")},
                **{name: getattr(settings, name) for name in ("ambient_occlusion", "background")},
                "ground": view.ground,
                "environment": view.environment,
                "environment_intensity": surroundings.intensity if surroundings else None,
            },
            "choices": {
                "shader": SHADERS,
                "layers": _with_all_layers(settings).layers,
                "background": backgrounds,
                "environment": list(self._environments().items()) if settings.shader == "pbr" else [],
                "lights": has_lights,
                "environment_intensity": settings.shader == "pbr" and surroundings is not None,
                "shadows": has_lights,
                "ambient_occlusion": lit,
                "ground": settings.edges is None,
            },
        }


def _numbers(kind: str, fields: Mapping[str, Any], *names: str) -> list[float]:
    return [number(kind, name, fields.get(name, 0.0)) for name in names]


def _with_all_layers(settings: Settings) -> Settings:
    all_: Any = "all"  # those that these settings can have
    return replace(settings, layers=all_)


def _at(camera: Any, resolution: tuple[int, int]) -> Any:
    """Return the camera with another number of pixels in the same image plane."""
    return camera if camera.resolution == resolution else replace(camera, resolution=resolution)


def _pose(camera: Any) -> dict[str, list[float]]:
    return {name: getattr(camera, name).tolist() for name in ("eye", "lookat", "up")}


def _free_name(output: str) -> str:
    """Return the first of output-1, output-2, ... of which no file exists."""
    number_ = 1
    while any(path.exists() for path in chosen_paths(f"{output}-{number_}", KINDS).values()):
        number_ += 1
    return f"{output}-{number_}"
