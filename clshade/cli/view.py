"""`view`: a scene live in the browser, or an HTML page for inspecting images."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base import atomic_files, console
from ..errors import InputError
from ..pipeline.frame_files import check_output
from ..scene.camera import checked_resolution
from ..scene.settings import Settings
from . import DONE
from .options import DEVICE, Arguments, Group, Option, check_output_file, is_scene, names_of, options_of, output_name
from .outputs import OUTPUT, Saving, saving
from .scene import (
    CameraFields,
    apply_lights,
    chosen_settings,
    read_scene,
    refuse_grounded_edges,
    scene_options,
    with_components,
)

if TYPE_CHECKING:
    from ..images.image_file import Picture
    from ..images.tonemap import Operator
    from ..scene.model import Scene
    from ..scene.settings import Look
    from ..view.live_scene import Source

HTML = (".html", ".htm")
TONEMAP: Operator = "srgb"  # of images
SAMPLES = 64  # of a picture at rest, unless --samples says otherwise: too many to light each


class Output:
    title = OUTPUT
    output = Option(
        "-o, --output OUT: of images: the page, which needs no other file and no network (default: FILE.html here, unless "
        "there is one); of a scene: the name of snapshots, OUT-1.exr and OUT-1.png and so on (default: the scene's, here)",
        output_name,
    )


class Live:
    title = "live: the view in the browser"
    port = Option("--port N: of 127.0.0.1 (default: a free one)", int)
    open = Option("--open: open the browser")
    stats = Option("--stats: print at the end what the pictures took, stage by stage")


# Options that commands for snapshots do not repeat: those of the live view alone, and those of which the view itself says
# what has become of them, as it does of the fields of Settings.
_IN_VIEW = {
    *options_of(Live),
    *(option.dest for name, option in options_of(CameraFields).items() if name not in ("view_angle", "orthographic")),
    *("light_intensity", "ground", "environment", "environment_intensity", "look"),
}


_OF_SCENES = scene_options(Live, DEVICE, samples=f"{SAMPLES}, when the view rests")
_ONLY_SCENES = [name for name in names_of(*_OF_SCENES, Saving) if name not in ("tonemap", "exposure")]
_FILES = Option(
    "files SCENE|FILE: a scene, as for `render`: a file or a built-in one, shown live; or images, each an EXR of any "
    "program or a PNG: several are compared, side by side of a line, in turn, their difference",
    nargs="+",
)
OPTIONS = {"view": (Group("", _FILES), Output, Saving, *_OF_SCENES)}


def run_view(arguments: Arguments) -> int:
    scenes = [file for file in arguments.files if is_scene(file)]
    if not scenes:
        arguments.refuse(_ONLY_SCENES, "is for a scene, not for images")
        return _write_page(arguments)
    if len(arguments.files) > 1:
        names = console.printable(" and ".join(arguments.files))
        raise InputError(f"view: expected one scene, or images, found {names}")
    _serve(arguments, scenes[0])
    return DONE


def _write_page(arguments: Arguments) -> int:
    from ..view import page

    files: list[str] = arguments.files
    output = arguments.output or os.path.splitext(os.path.basename(files[0]))[0] + ".html"
    check_output_file(output, files if arguments.output else (), HTML)
    if arguments.output is None and os.path.lexists(output):
        name = atomic_files.shown(output)
        raise InputError(f"view: {name} exists already: -o {name} replaces it, -o NAME.html writes another file")
    tonemap: Operator = arguments.tonemap or TONEMAP
    page.checked_settings(tonemap, arguments.exposure)
    images = _pictures(files)
    size = page.view(images, ", ".join(images), tonemap=tonemap, exposure=arguments.exposure).save(output)
    console.progress(f"wrote {atomic_files.shown(output)} ({size / 1e6:.1f} MB)")
    return DONE


def _pictures(files: Sequence[str]) -> dict[str, Picture]:
    """Read files, by name: without the folder where that tells them apart."""
    from ..images.image_file import read_picture

    bases = [os.path.basename(file) for file in files]
    pictures: dict[str, Picture] = {}
    for file, base in zip(files, bases, strict=True):
        name = base if bases.count(base) == 1 else file
        number = 2
        while name in pictures:  # a file named twice
            name, number = f"{file} ({number})", number + 1
        pictures[name] = read_picture(file)
    return pictures


def _serve(arguments: Arguments, name: str) -> None:
    """Serve the scene of this name until Ctrl-C, which raises KeyboardInterrupt. Raises InputError if aiohttp is missing."""
    from ..view import live_server
    from ..view.live_scene import LiveScene
    from ..view.page import live_page

    source = source_of(arguments, name)
    with live_server.listen(arguments.port) as listening:
        opened = partial(LiveScene, source)
        server = live_server.LiveServer(opened, listening, partial(live_page, os.path.basename(name)))
        try:
            asyncio.run(server.serve(partial(_announce, server.url, bool(arguments.open))))
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


def source_of(arguments: Arguments, name: str) -> Source:
    """Return the source of the scene of this name, with the command line's options. Raises InputError for a refused
    value."""
    from ..view.live_scene import REPEATED, Source

    if arguments.resolution is not None:
        checked_resolution("--resolution", arguments.resolution)
    refuse_grounded_edges(arguments)
    output = arguments.output or Path(name).stem or "view"
    output = os.path.join(output, Path(name).stem) if output.endswith(os.sep) else output
    saved = saving(arguments)
    check_output(output, argument=("view", "--output"), **saved)
    settings = {"samples": SAMPLES, "sample_shading": False, **chosen_settings(arguments)}
    settings |= {"preset": arguments.preset, "resolution": arguments.resolution}
    in_view = {*_IN_VIEW, *(Settings.__dataclass_fields__.keys() - REPEATED)}
    return Source(
        name=name,
        load=partial(read_scene, arguments, name),
        arrange=partial(_arrange, arguments),
        finish=partial(with_components, arguments=arguments),
        files=(name,) if os.path.exists(name) else (),
        camera=arguments.keywords(CameraFields),
        fit=arguments.camera == "fit",
        settings=settings,
        lights=arguments.light_intensity or (1.0,),
        ground=arguments.ground,
        environment=arguments.environment,
        environment_intensity=arguments.environment_intensity,
        up=arguments.up,
        device=arguments.device,
        options=tuple(arguments.as_options([name for name in _ONLY_SCENES if name not in in_view])),
        saving=saved,
        output=output,
    )


def _arrange(arguments: Arguments, scene: Scene, environment: str | None) -> tuple[Scene, Look]:
    """Return the scene with the lights of the command line, at their own intensities, and this environment, as its look
    shows it, and this look."""
    changes: dict[str, Any] = {"light_intensity": None, "environment": environment}
    if environment == "none" != arguments.environment:
        changes |= {"environment_rotation": None, "environment_intensity": None}
        changes["look"] = None if arguments.look == "studio" else arguments.look
    elif arguments.look is None and arguments.light_intensity is not None:
        changes["look"] = "plain"  # which that option means
    return apply_lights(scene, Arguments(**{**vars(arguments), **changes}))
