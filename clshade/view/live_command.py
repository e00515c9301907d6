"""The command line of `render` that draws a view, bit for bit."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import fields
from typing import Any

from ..images.tonemap import Operator
from ..scene.model import Scene, default_tonemap
from ..scene.settings import Settings, picture_samples
from .live_scene import Source, View

REPEATED = ("scalars", "edges")  # fields of Settings that no client changes: the source's options have them


def render_command(source: Source, scene: Scene, view: View, tonemap: Operator | None, exposure: float) -> list[str]:
    """Return the arguments, from `clshade render` on, without an output."""
    preset = source.settings.get("preset") or scene.preset
    arguments = ["clshade", "render", as_argument(source.name), *source.options]
    for option, value in (
        ("position", view.camera.eye),
        ("focal-point", view.camera.lookat),
        ("view-up", view.camera.up),
    ):
        arguments.append(f"--camera-{option}={_listed(value.tolist())}")
    usual = Settings.from_preset(preset, samples=picture_samples(scene.preset, preset))
    for field in fields(Settings):
        value = getattr(view.settings, field.name)
        if field.name not in REPEATED and value != getattr(usual, field.name):
            arguments += _setting(field.name, value)
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


def _setting(name: str, value: Any) -> list[str]:
    option = "--" + name.replace("_", "-")
    if value is True:
        return [option]
    if value is None:
        return [option, "none"]
    if isinstance(value, tuple):
        return [option, ",".join(each if isinstance(each, str) else repr(each) for each in value)]
    return [option, repr(value) if isinstance(value, float) else str(value)]


def _listed(values: Iterable[float]) -> str:
    return ",".join(map(repr, values))
