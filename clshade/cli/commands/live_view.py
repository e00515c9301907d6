"""A scene as a live view in the browser: the part of `view` that is about scenes."""

from __future__ import annotations

import argparse
import asyncio
import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...base import console
from ...scene.camera import checked_resolution
from .arguments import device_option, given_options
from .saving_options import chosen_saving
from .scene_options import (
    CAMERA_OPTIONS,
    camera_options,
    chosen_camera,
    chosen_settings,
    lit,
    read_scene,
    refuse_grounded_edges,
    scene_changes,
    setting_options,
    with_components,
)

if TYPE_CHECKING:
    from ...scene.model import Scene
    from ...scene.settings import Look
    from ...view.live_scene import Source

SAMPLES = 64  # of a picture at rest, unless --samples says otherwise: too many to light each
# Options that commands for snapshots do not repeat: those of the live view alone, and those of which the view itself says
# what has become of them, as it does of the fields of Settings.
_OWN = ("port", "open", "stats")
_IN_VIEW = {*CAMERA_OPTIONS.values(), "light_intensity", "ground", "environment", "environment_intensity", "look"} - {
    "camera_view_angle",
    "orthographic",
}


def is_scene(name: str) -> bool:
    """Return whether a name is that of a scene: built in, or of a file with a scene's extension, or none at all."""
    from ...scene.builtin.scenes import BUILTINS
    from ...scene.formats.table import EXTENSIONS

    ending = os.path.splitext(name)[1].lower()
    return ending in EXTENSIONS or (not ending and (name in BUILTINS or not os.path.exists(name)))


def live_options(parser: argparse.ArgumentParser) -> list[str]:
    """Add the options of a live view but for its scene and the output; return their names in the namespace."""
    before = {action.dest for action in parser._actions}
    scene_changes(parser, parser.add_argument_group("scene: the file, and how it is read"))
    camera_options(parser)
    setting_options(parser, f"{SAMPLES}, when the view rests")
    served = parser.add_argument_group("live: the view in the browser")
    served.add_argument("--port", type=int, metavar="N", help="of 127.0.0.1 (default: a free one)")
    served.add_argument("--open", action="store_true", help="open the browser")
    served.add_argument("--stats", action="store_true", help="print at the end what the pictures took, stage by stage")
    device_option(parser)
    return [action.dest for action in parser._actions if action.dest not in before]


def run_live(arguments: argparse.Namespace, name: str) -> None:
    """Serve the scene of this name until Ctrl-C, which raises KeyboardInterrupt. Raises InputError if aiohttp is missing."""
    from ...view import live_server
    from ...view.live_page import live_page
    from ...view.live_scene import LiveScene

    source = source_of(arguments, name)
    listening = live_server.listen(arguments.port)
    with listening:
        opened = partial(LiveScene, source)
        server = live_server.LiveServer(opened, listening, partial(live_page, os.path.basename(name)))
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
    refuse_grounded_edges(arguments)
    output = arguments.output or Path(name).stem or "view"
    output = os.path.join(output, Path(name).stem) if output.endswith(os.sep) else output
    saving = chosen_saving(arguments)
    check_output(output, asked=("view", "--output"), **saving)
    settings = {"samples": SAMPLES, "sample_shading": False, **chosen_settings(arguments)}
    settings |= {"preset": arguments.preset, "resolution": arguments.resolution}
    return Source(
        name=name,
        load=partial(read_scene, arguments, name),
        arrange=partial(_lit, arguments),
        finish=partial(with_components, arguments=arguments),
        files=(name,) if os.path.exists(name) else (),
        camera=chosen_camera(arguments),
        fit=arguments.camera == "fit",
        settings=settings,
        lights=arguments.light_intensity or (1.0,),
        ground=arguments.ground,
        environment=arguments.environment,
        environment_intensity=arguments.environment_intensity,
        up=arguments.up,
        device=arguments.device,
        options=_repeated(arguments),
        saving=saving,
        output=output,
    )


def _lit(arguments: argparse.Namespace, scene: Scene, environment: str | None) -> tuple[Scene, Look]:
    """Return the scene with the lights of the command line, at their own intensities, and this environment, as its look
    shows it, and this look."""
    changes: dict[str, Any] = {"light_intensity": None, "environment": environment}
    if environment == "none" != arguments.environment:
        changes |= {"environment_rotation": None, "environment_intensity": None}
        changes["look"] = None if arguments.look == "studio" else arguments.look
    elif arguments.look is None and arguments.light_intensity is not None:
        changes["look"] = "plain"  # which that option means
    return lit(scene, argparse.Namespace(**{**vars(arguments), **changes}))


def _repeated(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return the options of `render` that every snapshot's command repeats."""
    from ...scene.settings import Settings
    from ...view.live_command import REPEATED

    left_out = {*_OWN, *_IN_VIEW, *(Settings.__dataclass_fields__.keys() - REPEATED)}
    return tuple(given_options(arguments, [name for name in arguments.only_scenes if name not in left_out]))
