"""The command line of `render` that draws a view, bit for bit."""

from __future__ import annotations

import os
from collections.abc import Iterable

from ..base.declare import as_option
from ..images.tonemap import Operator
from ..pipeline.effective_settings import changed_fields
from ..scene.model import default_tonemap
from .live_scene import LiveScene, View

REPEATED = ("scalars", "edges")  # fields of Settings that no client changes: the source's options have them


def render_command(shown: LiveScene, view: View, tonemap: Operator | None, exposure: float) -> list[str]:
    """Return the arguments, from `clshade render` on, without an output."""
    source, scene, look = shown.source, shown.lit(view.environment), shown.look(view.environment)
    preset = source.settings.get("preset") or scene.preset
    arguments = ["clshade", "render", as_argument(source.name)]
    gone = view.environment == "none"  # and with it how it is turned
    arguments += [option for option in source.options if not (gone and option.startswith("--environment-"))]
    if view.environment is not None:
        arguments.append(f"--environment={view.environment}")
    given = source.environment_intensity if view.environment_intensity is None else view.environment_intensity
    if given is not None and not gone:
        arguments.append(as_option("environment_intensity", given))
    if look != "plain" or not scene.own_lights:
        arguments.append(f"--look={look}")
    if view.ground != shown.has_usual_ground(view.environment, view.settings):
        arguments.append(as_option("ground", view.ground))
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
    changed = changed_fields(view.settings, scene, preset)
    arguments += [as_option(name, value) for name, value in changed.items() if name not in REPEATED]
    if look != "studio" and any(factor != 1.0 for factor in view.lights):
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
