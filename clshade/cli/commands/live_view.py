"""A scene as a live view in the browser: the part of `view` that is about scenes."""

from __future__ import annotations

import argparse
import asyncio
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...base import console
from ...errors import InputError
from ...scene.camera import checked_resolution
from .arguments import device_option
from .saving_options import chosen_saving
from .scene_options import (
    camera_options,
    chosen_camera,
    chosen_settings,
    load_scene,
    scene_changes,
    setting_options,
)

if TYPE_CHECKING:
    from ...scene.model import Scene
    from ...view.live_scene import Source

SAMPLES = 64  # of a picture at rest, unless --samples says otherwise
# Options that the source of a scene repeats in each command, as they change what is loaded or how it is saved.
_WITH_VALUES = (
    *("environment", "environment_rotation", "environment_intensity"),
    *("texture", "focal", "crease", "up", "time", "animation", "preset", "camera_view_angle", "device"),
    *("scalars", "colormap", "nan_color", "edge_angle", "edge_width", "edge_color"),
    "depth_scale",
)
_LISTS = ("lights", "components", "resolution", "clim", "edges", "formats")
_FLAGS = ("fit", "ground", "flat", "orthographic", "half", "crop", "deterministic", "colorbar", "edges_only")


def is_scene(name: str) -> bool:
    """Return whether a name is that of a scene: built in, or of a file with a scene's extension, or none at all."""
    from ...scene.builtin.scenes import BUILTINS
    from ...scene.formats.load import EXTENSIONS

    ending = os.path.splitext(name)[1].lower()
    return ending in EXTENSIONS or (not ending and (name in BUILTINS or not os.path.exists(name)))


def live_options(parser: argparse.ArgumentParser) -> list[str]:
    """Add the options of a live view but for its scene and the output; return their names in the namespace."""
    before = {action.dest for action in parser._actions}
    scene_changes(parser.add_argument_group("scene"))
    camera_options(parser)
    setting_options(parser, f"{SAMPLES}, when the view rests")
    served = parser.add_argument_group("live view")
    served.add_argument("--port", type=int, metavar="N", help="of 127.0.0.1 (default: a free one)")
    served.add_argument("--open", action="store_true", help="open the browser")
    served.add_argument("--stats", action="store_true", help="print at the end what the pictures took, stage by stage")
    device_option(parser)
    return [action.dest for action in parser._actions if action.dest not in before]


def refuse_live_options(arguments: argparse.Namespace) -> None:
    """Raise InputError for an option that was given and is about scenes alone."""
    for name in arguments.only_scenes:
        if getattr(arguments, name) != arguments.parser.get_default(name):
            raise InputError(f"{_option(name)}: expected a scene to view, found images")


def run_live(arguments: argparse.Namespace, name: str) -> None:
    """Serve the scene of this name until Ctrl-C, which raises KeyboardInterrupt. Raises InputError if aiohttp is missing."""
    from ...view import live_server
    from ...view.live_page import live_page
    from ...view.live_scene import LiveScene

    source = source_of(arguments, name)
    listening = live_server.listen(arguments.port)
    with listening:
        scene = LiveScene(source)
        scene.prepare()
        server = live_server.LiveServer(scene, listening, partial(live_page, os.path.basename(name)))
        try:
            asyncio.run(server.serve(partial(_announce, server.url, arguments.open)))
        finally:
            if arguments.stats:
                print("\n".join(server.stats.lines()), flush=True)
    raise KeyboardInterrupt


def _announce(url: str, in_browser: bool) -> None:
    print(url, flush=True)
    console.progress("Ctrl-C ends the view")
    if in_browser:
        import threading
        import webbrowser

        # A browser of the terminal would run until it is closed.
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


def source_of(arguments: argparse.Namespace, name: str) -> Source:
    """Return the source of the scene of this name, with the command line's options. Raises InputError for a refused
    value."""
    from ...pipeline.frame_files import check_output
    from ...view.live_scene import Source

    if arguments.resolution is not None:
        checked_resolution("--resolution", arguments.resolution)
    output = arguments.output or Path(name).stem or "view"
    output = os.path.join(output, Path(name).stem) if output.endswith(os.sep) else output
    saving = chosen_saving(arguments)
    checks: Any = {key: saving[key] for key in ("tonemap", "exposure", "compression", "files", "depth_scale")}
    check_output(output, asked=("view", "--output"), **checks)
    settings = {"samples": SAMPLES, **chosen_settings(arguments)}
    settings |= {"preset": arguments.preset, "resolution": arguments.resolution}
    return Source(
        name=name,
        load=_loader(arguments, name),
        files=(name,) if os.path.exists(name) else (),
        camera=chosen_camera(arguments),
        fit=arguments.fit,
        settings=settings,
        lights=arguments.light_intensity or (1.0,),
        device=arguments.device,
        options=_repeated(arguments),
        saving=saving,
        output=output,
    )


def _loader(arguments: argparse.Namespace, name: str) -> Callable[[], Scene]:
    """Return a function that loads the scene with its own camera and the lights as they are in the file."""
    camera = dict.fromkeys(("camera_position", "camera_focal_point", "camera_view_up", "camera_view_angle"))
    camera |= {"camera_azimuth_angle": 0.0, "camera_elevation_angle": 0.0, "orthographic": False}
    own = argparse.Namespace(**{**vars(arguments), **camera, "light_intensity": None})
    return partial(load_scene, own, name)


def _repeated(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return the options of `render` that every snapshot's command repeats."""
    found: list[str] = []
    for name in _WITH_VALUES:
        value = getattr(arguments, name)
        if value is not None:
            found.append(f"{_option(name)}={value!r}" if isinstance(value, float) else f"{_option(name)}={value}")
    for name in _LISTS:
        value = getattr(arguments, name)
        if value is not None:
            found.append(f"{_option(name)}={','.join(map(str, value))}")
    found += [_option(name) for name in _FLAGS if getattr(arguments, name)]
    if arguments.two_sided is not None:
        found.append("--two-sided" if arguments.two_sided else "--no-two-sided")
    if arguments.compression != "zip":
        found.append(f"--compression={arguments.compression}")
    return tuple(found)


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")
