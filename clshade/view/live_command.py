"""The command line of `render` that draws a view, bit for bit."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import fields

from ..base.declare import as_option
from ..images.tonemap import Operator
from ..scene.model import Scene, default_tonemap
from ..scene.settings import Settings, picture_fields
from .live_scene import Source, View

REPEATED = ("scalars", "edges")  # fields of Settings that no client changes: the source's options have them


def render_command(source: Source, scene: Scene, view: View, tonemap: Operator | None, exposure: float) -> list[str]:
    """Return the arguments, from `clshade render` on, without an output. scene: in the view's environment."""
    preset = source.settings.get("preset") or scene.preset
    arguments = ["clshade", "render", as_argument(source.name)]
    gone = view.environment == "none"  # and with it how it is turned
    arguments += [option for option in source.options if not (gone and option.startswith("--environment-"))]
    if view.environment is not None:
        arguments.append(f"--environment={view.environment}")
    if not scene.own_lights:
        arguments.append("--look=plain")
    if view.ground:
        arguments.append("--ground")
    for option, value in (
        ("position", view.camera.eye),
        ("focal-point", view.camera.lookat),
        ("view-up", view.camera.up),
    ):
        arguments.append(f"--camera-{option}={_listed(value.tolist())}")
    if view.view_angle is not None:
        arguments.append(f"--camera-view-angle={view.view_angle!r}")
    if source.settings.get("resolution") is None and view.camera.resolution != scene.camera.resolution:
        arguments.append(as_option("resolution", view.camera.resolution))
    usual = Settings.from_preset(preset, **picture_fields(scene.lights, scene.preset, preset))
    for field in fields(Settings):
        value = getattr(view.settings, field.name)
        if field.name not in REPEATED and value != getattr(usual, field.name):
            arguments.append(as_option(field.name, value))
    if any(factor != 1.0 for factor in view.lights):
        arguments.append(f"--light-intensity={_listed(view.lights)}")
    if tonemap is not None and tonemap != default_tonemap(scene):
        arguments += ["--tonemap", tonemap]
    if exposure:
        arguments.append(f"--exposure={exposure!r}")
    return arguments


def as_argument(path: str) -> str:
    """Return a path that no program takes for an option."""
    return os.path.join(os.curdir, path) if path.startswith("-") else path


def _listed(values: Iterable[float]) -> str:
    return ",".join(map(repr, values))
