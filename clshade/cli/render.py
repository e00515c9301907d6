"""`render`: a scene to OUT.exr and OUT.png, or several to a folder."""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Sequence
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

from ..base import atomic_files, console, text_tables
from ..base.atomic_files import shown
from ..errors import ClshadeError, InputError
from ..measure.defaults import PIXELS
from ..pipeline.frame_files import check_output, chosen_paths, visible_path
from . import DONE, FAILED, REFUSED, outputs
from .options import DEVICE, Arguments, Group, Limits, Option, names_of, output_name, reader
from .outputs import ASKED, EYES, MASKS, OUTPUT, Saving, Stereo, Views, saving
from .scene import A_SCENE, SCENE, chosen_settings, load_scene, picture_settings, scene_options

if TYPE_CHECKING:
    from ..pipeline.frame import Frame
    from ..scene.camera import Camera
    from ..scene.model import Scene


def _pixels(text: str) -> int | str:
    if text != "all" and not (text.isascii() and text.isdigit() and int(text) > 0):
        raise ValueError(text)
    return text if text == "all" else int(text)


class Output:
    title = OUTPUT
    output = Option(
        "-o, --output OUT: writes OUT.exr and OUT.png (default: out); of several scenes, or with a slash at its end, it "
        "is a folder, made where there is none, with files named after the scenes (default: the current one)",
        output_name,
    )
    flow_to = Option(
        "--flow-to CAMERAS.json: optical flow in the EXR, pixels to the right and down: to the first camera of a list as "
        "of `animate` (flow), and to a second one (flow_back); what is occluded there (flow_occluded, "
        "flow_back_occluded), and the layer id"
    )
    save_scene = Option(
        "--save-scene FILE: also write the scene as it is drawn, with its lights, camera and preset: all of it to "
        "FILE.json, with large arrays in a file beside it, or for other programs to FILE.glb"
    )
    visible = Option(
        "--visible csv|json: also write OUT_visible.csv or .json: how much of each instance is seen, and how much of it "
        "is in the image"
    )
    json = Option(
        "--json, --stats: print all figures as JSON; of several scenes a list, with `error` for one that failed"
    )


class Measured:
    title = "measured: errors and times of the picture"
    check = Option(
        f"--check PIXELS|all: the error of this image, of some pixels (default: {PIXELS}) or all, computed again in "
        "float64; adds the layers Z and id, with `all` also `error`",
        reader(_pixels, "a number of pixels or all"),
        nargs="?",
        const=PIXELS,
    )
    explain = Option("--explain: what the kernels left out, why, and what that saves: measured")


_SCENES = Group(SCENE, Option(f"scenes SCENE: {A_SCENE} (default: teapot)", default=["teapot"], nargs="*"))
_OF_PICTURE = scene_options(Views, Stereo)
# Which the command in a header repeats.
_REPEATED = [name for name in names_of(*_OF_PICTURE, Limits) if name != "crop_zoom"]
OPTIONS = {"render": (_SCENES, *_OF_PICTURE, Output, Saving, MASKS, Measured, Group(Measured.title, Limits), DEVICE)}


def run_render(arguments: Arguments) -> int:
    # What is needed after loading is imported in parallel; not by a daemon, for an exit within a C++ module aborts.
    warming = Thread(target=_import_meanwhile, args=(arguments.check is not None,))
    warming.start()
    if not (arguments.views or arguments.sheet):
        arguments.refuse(("fixed_lights",), "needs --views or --sheet")
    if arguments.sheet:
        why = "cannot go with --sheet, which writes one picture of several views"
        arguments.refuse(outputs.NOT_WITH_SHEET, why)
    outputs.check_stereo(arguments, "views", "sheet")
    stats: Any
    folder, stems = outputs.output_stems(arguments.scenes, arguments.output)
    with atomic_files.folder_made(folder):
        for stem in stems:  # refused before rendering
            for view_stem in outputs.stems_of(stem, arguments):
                check_output(view_stem, argument=ASKED, **saving(arguments))
            for path in outputs.other_files(stem, arguments):
                atomic_files.check(path)
        outputs.check_save_scene(arguments, outputs.other_files(stems[0], arguments))
        Thread(target=_try_out_device, args=(arguments.device,)).start()
        if len(stems) == 1:
            code, stats = _render(arguments.scenes[0], stems[0], arguments, warming)
        else:
            code, stats = _render_each(stems, arguments, warming)
        if arguments.json:
            import json

            print(json.dumps(stats, indent=2))
        return code


def _try_out_device(name: str | None) -> None:
    with contextlib.suppress(Exception):  # `open_device` raises it again
        from ..pipeline.opencl.device import try_out_soon

        try_out_soon(name)


def _import_meanwhile(checked: bool) -> None:
    with contextlib.suppress(Exception):  # who needs it raises it again
        from ..pipeline import renderer  # noqa: F401

        if checked:
            from ..measure.check import check  # noqa: F401
        import OpenEXR  # noqa: F401
        import PIL.PngImagePlugin  # noqa: F401


def _render_each(stems: list[str], arguments: Arguments, warming: Thread) -> tuple[int, list[Any]]:
    """Render several scenes; print a one-line error for a refused scene and continue with the others."""
    from ..pipeline.opencl.device import shared_device

    shared_device(arguments.device)  # without a device no scene can be rendered: a single error
    worst, all_stats = DONE, []
    for name, stem in zip(arguments.scenes, stems, strict=True):
        try:
            code, stats = _render(name, stem, arguments, warming)
        except ClshadeError as error:
            if arguments.debug:
                raise
            text = " ".join(str(error).split())
            text = text if text.startswith(f"{shown(name)}: ") else f"{shown(name)}: {text}"
            console.error(text)
            code, stats = REFUSED, {"error": text}
        worst = max(worst, code)
        all_stats.append({"scene": name, "output": stem, **stats})
    return worst, all_stats


def _render(name: str, stem: str, arguments: Arguments, warming: Thread) -> tuple[int, dict[str, Any]]:
    """Load, render and save one scene; return the exit code and all figures."""
    from ..base.declare import as_argument

    scene = load_scene(arguments, name)
    options = render_options(arguments, scene)
    for crop in arguments.crop_zoom:
        crop.check("--crop-zoom", *scene.camera.resolution)
    if arguments.sheet:
        warming.join()
        facts = outputs.write_sheet(scene, stem, arguments, options)
        outputs.save_scene(scene, arguments)
        return DONE, facts
    command = shlex.join(["clshade", "render", as_argument(name), *arguments.as_options(_REPEATED)])
    views = outputs.views_of(scene, stem, arguments)
    frames = [_Drawing(arguments, view, options).run(view_stem, command, warming) for view, view_stem in views]
    outputs.save_scene(scene, arguments)
    if not arguments.views and arguments.stereo is None:
        return frames[0]
    title, names = ("views", dict.fromkeys(arguments.views)) if arguments.views else ("stereo", dict.fromkeys(EYES))
    return max(code for code, _ in frames), {title: dict(zip(names, (stats for _, stats in frames), strict=True))}


def render_options(arguments: Arguments, scene: Scene) -> dict[str, Any]:
    """Return the keyword arguments of `clshade.render`."""
    settings = picture_settings(arguments, scene)
    if arguments.budget is not None or arguments.tolerance is not None:  # which choose the samples
        chosen = {"shadows", *chosen_settings(arguments)}
        settings = {name: value for name, value in settings.items() if name in chosen}
    layers = [*(["Z", "id"] if arguments.check is not None else []), *(["id"] if arguments.flow_to is not None else [])]
    if layers:
        settings["layers"] = (*settings.get("layers", ()), *layers)
    return {"preset": arguments.preset, "device": arguments.device, "resolution": arguments.resolution, **settings}


class _Drawing:
    """One view of a scene, drawn with keyword arguments of `clshade.render`, measured and saved."""

    def __init__(self, arguments: Arguments, scene: Scene, options: dict[str, Any]) -> None:
        self.arguments, self.scene, self.options = arguments, scene, options
        self.measured: dict[str, Any] = {}  # by title
        several = arguments.stereo, arguments.budget, arguments.tolerance, arguments.check
        draws_more = arguments.views or arguments.explain or any(value is not None for value in several)
        self.is_alone = len(arguments.scenes) == 1 and not draws_more  # then it does not pay to optimize kernels

    def run(self, stem: str, command: str, warming: Thread) -> tuple[int, dict[str, Any]]:
        """Return the exit code and all figures. command: of the header."""
        from ..scene.description import describe_images

        arguments = self.arguments
        self._choose_settings()
        cameras, files = self._flow_cameras(), saving(arguments)
        if arguments.cryptomatte:
            from ..pipeline.visible import check_mattes

            check_mattes(arguments.cryptomatte, files["files"] or ())
        hashing = [Thread(target=describe_images, args=(self.scene,))] if "exr" in (files["files"] or ()) else []
        for thread in hashing:
            thread.start()
        frame = self._draw(command, cameras)
        for thread in (warming, *hashing):
            thread.join()
        for warning in frame.write(stem, **files):
            console.warning(warning)
        others = outputs.write_crops(frame, stem, arguments)
        if arguments.visible is not None:
            from ..pipeline.visible import visible

            others.append(visible_path(stem, arguments.visible, ASKED))
            visible(frame.scene, settings=frame.settings, device=arguments.device).save(others[-1])
        if arguments.explain:
            from ..measure.report.feature_savings import explain

            with console.told_when_slow("drawing without leaving things out, to compare ...", after_compiling=True):
                self.measured["explain"] = explain(self.scene, **self.options)
        if not arguments.json:
            print(summary(frame, [*chosen_paths(stem, files["files"]).values(), *others]))
            for title, result in self.measured.items():
                lines = (f"{'' if k else title:<8}{line}" for k, line in enumerate(result.lines()))
                print("\n".join(text_tables.wrapped(line, 10) for line in lines))
        if self.is_alone:
            from ..pipeline import ahead

            ahead.start(frame.scene, frame.settings, arguments.device)
        stats = {**frame.stats, **{title: result.stats() for title, result in self.measured.items()}}
        return (DONE if all(result.passed for result in self.measured.values()) else FAILED), stats

    def _choose_settings(self) -> None:
        """Replace the settings as --budget or --tolerance ask for it."""
        limits = {"budget": self.arguments.budget, "tolerance": self.arguments.tolerance}
        if any(value is not None for value in limits.values()):
            from ..measure.report.auto_settings import select

            selected = self.measured["chosen"] = select(self.scene, **limits, **self.options)
            console.table(selected.table.lines()[1:])
            fixed = {name: self.options[name] for name in ("device", "resolution")}
            self.options = {**fixed, "settings": selected.settings}

    def _flow_cameras(self) -> tuple[Camera, ...]:
        """Return the cameras of --flow-to, one or two; none without it."""
        name, formats = self.arguments.flow_to, self.arguments.formats
        if name is None:
            return ()
        if formats is not None and not {"exr", "npz"} & set(formats):
            raise InputError(f"--flow-to: needs exr or npz in --formats, which hold the flow, not {','.join(formats)}")
        from ..farm import read_cameras

        cameras = read_cameras(name, self.scene.camera)
        if len(cameras) > 2:
            raise InputError(f"--flow-to: expected one camera or two in {shown(name)}, found {len(cameras)}")
        return cameras

    def _draw(self, command: str, cameras: Sequence[Camera]) -> Frame:
        """Return the frame, with its flow to these cameras, its mattes and its errors, as far as options ask for them."""
        from ..pipeline import programs, renderer

        arguments, (columns, rows) = self.arguments, self.scene.camera.resolution
        first = programs.first_picture() if self.is_alone else contextlib.nullcontext()
        with first, console.told_when_slow(f"drawing {columns}x{rows} pixels ...", after_compiling=True):
            frame = renderer.render(self.scene, **self.options)
        frame.command = command
        if cameras:
            from ..pipeline.flow import flow
            from ..pipeline.frame_results import FLOWS

            flows = [flow(frame, camera, device=arguments.device) for camera in cameras]
            frame.flows = dict(zip(FLOWS, flows, strict=False))
        if arguments.cryptomatte:
            from ..pipeline.visible import cryptomatte

            frame.mattes = cryptomatte(frame, arguments.cryptomatte, device=arguments.device)
        if arguments.check is not None:
            from ..measure.check.check import check

            with console.told_when_slow("computing pixels again in float64 ...", after_compiling=True):
                check(frame, arguments.check)
            self.measured["check"] = frame.check
        return frame


def summary(frame: Frame, written: Sequence[Path]) -> str:
    """Return a few lines: what was drawn, the device, the time of each stage, and the files that were written."""
    from ..scene.scalar_colors import color_map_of

    stats, scalars = frame.stats, frame.settings.scalars
    times = dict(stats["times_ms"])
    columns, rows = stats["resolution"]
    total = times.pop("frame")
    fixed = {name: times.pop(name) for name in ("pack", "open", "upload")}
    fixed["build"] = stats["build_ms"]
    files = ", ".join(f"{shown(path)} ({path.stat().st_size / 1e6:.2f} MB)" for path in written)

    def listed(values: dict[str, float]) -> str:
        return ", ".join(f"{name}{text_tables.TIED}{value:.2f}" for name, value in values.items())

    name = shown(frame.scene.name or "unnamed")
    lines = [f"scene   {name}: {stats['triangles']:,} triangles, {stats['visible']:,} in view"]
    if stats["ignored"]:
        lines.append(f"ignored {', '.join(stats['ignored'])}")
    if scalars is not None:
        color_map = color_map_of(frame.scene, scalars)
        colors = scalars.colormap if isinstance(scalars.colormap, str) else f"{color_map.count} colors"
        lines.append(f"scalars {shown(scalars.name)}: {color_map.low:g} to {color_map.high:g}, {colors}")
    lines += [
        f"image   {columns}x{rows}, {frame.settings.shader}, {frame.settings.visibility}",
        f"device  {stats['device']}",
        f"once    {listed(fixed)} ms",
        f"frame   {total:.2f} ms, the first: {listed(times)}",
    ]
    return "\n".join([*(text_tables.wrapped(line, 8) for line in lines), f"wrote   {files}"])
