"""`render`: a scene to OUT.exr and OUT.png, or several to a folder."""

from __future__ import annotations

import argparse
import contextlib
import shlex
from collections.abc import Sequence
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

from ...base import console, text_tables
from ...base.atomic_files import folder_made, shown
from ...errors import ClshadeError, InputError
from ...measure.defaults import PIXELS
from . import DONE, FAILED, REFUSED
from .arguments import device_option, given_options, limit_options, output_name
from .saving_options import OUTPUT, chosen_saving, matte_option, saving_options
from .scene_options import (
    SAMPLES_HELP,
    camera_options,
    chosen_settings,
    load_scene,
    picture_settings,
    scene_options,
    setting_options,
)
from .scene_outputs import check_save_scene, output_stems, save_scene, save_scene_option
from .stereo_options import EYES, check_stereo, stereo_options
from .view_options import (
    check_crops,
    check_view_options,
    files_of,
    stems_of,
    view_options,
    views_of,
    write_crops,
    write_sheet,
    write_visible,
)

if TYPE_CHECKING:
    from ...pipeline.frame import Frame
    from ...scene.camera import Camera
    from ...scene.model import Scene


def _checked(text: str) -> int | str:
    if text != "all" and not (text.isascii() and text.isdigit() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"expected a number of pixels or all, found {text!r}")
    return text if text == "all" else int(text)


def add_options(parser: argparse.ArgumentParser) -> None:
    scene_options(parser, several=True)
    camera_options(parser)
    view_options(parser)
    stereo_options(parser)
    setting_options(parser, SAMPLES_HELP)
    parser.set_defaults(
        repeated=[each.dest for each in parser._actions if each.dest not in ("help", "scenes", "crop_zoom")]
    )
    output = parser.add_argument_group(OUTPUT)
    output.add_argument(
        "-o",
        "--output",
        type=output_name,
        metavar="OUT",
        help="writes OUT.exr and OUT.png (default: out); of several scenes, or with a slash at its end, it is a folder, "
        "made where there is none, with files named after the scenes (default: the current one)",
    )
    saving_options(output)
    output.add_argument(
        "--flow-to",
        metavar="CAMERAS.json",
        help="optical flow in the EXR, pixels to the right and down: to the first camera of a list as of `animate` (flow), "
        "and to a second one (flow_back); what is occluded there (flow_occluded, flow_back_occluded), and the layer id",
    )
    matte_option(output)
    save_scene_option(output)
    output.add_argument(
        "--visible",
        choices=("csv", "json"),
        help="also write OUT_visible.csv or .json: how much of each instance is seen, and how much of it is in the image",
    )
    output.add_argument(
        "--json",
        "--stats",
        action="store_true",
        help="print all figures as JSON; of several scenes a list, with `error` for one that failed",
    )
    measured = parser.add_argument_group("measured: errors and times of the picture")
    measured.add_argument(
        "--check",
        nargs="?",
        const=PIXELS,
        type=_checked,
        metavar="PIXELS|all",
        help=f"the error of this image, of some pixels (default: {PIXELS}) or all, computed again in float64; "
        "adds the layers Z and id, with `all` also `error`",
    )
    measured.add_argument(
        "--explain", action="store_true", help="what the kernels left out, why, and what that saves: measured"
    )
    limit_options(measured)
    parser.set_defaults(repeated=[*parser.get_default("repeated"), "budget", "tolerance"])
    device_option(parser)


def run(arguments: argparse.Namespace) -> int:
    # What is needed after loading is imported in parallel; not by a daemon, for an exit within a C++ module aborts.
    warming = Thread(target=_import_meanwhile, args=(arguments.check is not None,))
    warming.start()
    check_view_options(arguments)
    check_stereo(arguments, "views", "sheet")
    folder, outputs = output_stems(arguments.scenes, arguments.output)
    with folder_made(folder):
        for output in outputs:
            _check_output(output, arguments)
        check_save_scene(arguments, files_of(outputs[0], arguments))
        Thread(target=_try_out_device, args=(arguments.device,)).start()
        if len(outputs) == 1:
            code, stats = _render(arguments.scenes[0], outputs[0], arguments, warming)
            _print_json(stats, arguments)
            return code
        return _render_each(outputs, arguments, warming)


def _render_each(outputs: list[str], arguments: argparse.Namespace, warming: Thread) -> int:
    """Render several scenes; print a one-line error for a refused scene and continue with the others."""
    from ...pipeline.opencl.device import shared_device

    shared_device(arguments.device, profiling=True)  # without a device no scene can be rendered: a single error
    worst, all_stats = DONE, []
    for name, output in zip(arguments.scenes, outputs, strict=True):
        try:
            code, stats = _render(name, output, arguments, warming)
        except ClshadeError as error:
            if arguments.debug:
                raise
            text = " ".join(str(error).split())
            text = text if text.startswith(f"{shown(name)}: ") else f"{shown(name)}: {text}"
            console.error(text)
            code, stats = REFUSED, {"error": text}
        worst = max(worst, code)
        all_stats.append({"scene": name, "output": output, **stats})
    _print_json(all_stats, arguments)
    return worst


def _render(name: str, output: str, arguments: argparse.Namespace, warming: Thread) -> tuple[int, dict[str, Any]]:
    """Load, render and save one scene; return the exit code and all figures."""
    scene = load_scene(arguments, name)
    options = render_options(arguments, scene)
    check_crops(scene, arguments)
    if arguments.sheet:
        warming.join()
        facts = write_sheet(scene, output, arguments, options)
        save_scene(scene, arguments)
        return DONE, facts
    drawn = []
    for view, stem in views_of(scene, output, arguments):
        drawn.append(_draw(view, stem, arguments, options, warming, _command(name, arguments)))
    save_scene(scene, arguments)
    if not arguments.views and arguments.stereo is None:
        return drawn[0]
    title, names = ("views", dict.fromkeys(arguments.views)) if arguments.views else ("stereo", dict.fromkeys(EYES))
    return max(code for code, _ in drawn), {title: dict(zip(names, (stats for _, stats in drawn), strict=True))}


def _draws_once(arguments: argparse.Namespace) -> bool:
    """Return whether one frame is drawn, for which it does not pay to optimize kernels."""
    several = arguments.stereo, arguments.budget, arguments.tolerance, arguments.check
    draws_more = arguments.views or arguments.explain or any(each is not None for each in several)
    return len(arguments.scenes) == 1 and not draws_more


def _command(name: str, arguments: argparse.Namespace) -> str:
    """Return the command that draws one scene so, with the options that were given, but for those of files."""
    from ...view.live_command import as_argument

    return shlex.join(["clshade", "render", as_argument(name), *given_options(arguments, arguments.repeated)])


def _draw(
    scene: Scene, output: str, arguments: argparse.Namespace, options: dict[str, Any], warming: Thread, command: str
) -> tuple[int, dict[str, Any]]:
    """Render and save one view of a scene; return the exit code and all figures. command: that draws it."""
    from ...pipeline import programs, renderer
    from ...pipeline.frame_files import chosen_paths
    from ...scene.description import describe_images

    found: dict[str, Any] = {}
    if arguments.budget is not None or arguments.tolerance is not None:
        from ...measure.report.auto_settings import select

        selected = found["chosen"] = select(scene, budget=arguments.budget, tolerance=arguments.tolerance, **options)
        console.table(selected.table.lines()[1:])
        options = {**{name: options[name] for name in ("device", "resolution")}, "settings": selected.settings}
    cameras = _flow_cameras(scene, arguments)
    saving = chosen_saving(arguments)
    if arguments.cryptomatte:
        from ...pipeline.mattes import check_mattes, cryptomatte

        check_mattes(arguments.cryptomatte, saving["files"] or ())
    hashing = [Thread(target=describe_images, args=(scene,))] if "exr" in (saving["files"] or ()) else []
    for thread in hashing:
        thread.start()
    columns, rows = options["resolution"] or scene.camera.resolution
    first = programs.first_picture() if _draws_once(arguments) else contextlib.nullcontext()
    with first, console.told_when_slow(f"drawing {columns}x{rows} pixels ...", after_compiling=True):
        frame = renderer.render(scene, **options)
    frame.command = command
    if cameras:
        from ...pipeline.flow import flow
        from ...pipeline.frame_results import FLOWS

        flows = [flow(frame, camera, device=arguments.device) for camera in cameras]
        frame.flows = dict(zip(FLOWS, flows, strict=False))
    if arguments.cryptomatte:
        frame.mattes = cryptomatte(frame, arguments.cryptomatte, device=arguments.device)
    if arguments.check is not None:
        from ...measure.check.check import check

        with console.told_when_slow("computing pixels again in float64 ...", after_compiling=True):
            check(frame, arguments.check)
    for thread in (warming, *hashing):
        thread.join()
    for warning in frame.write(output, **saving):
        console.warning(warning)
    others = [*write_crops(frame, output, arguments), *write_visible(frame, output, arguments)]
    if frame.check is not None:
        found["check"] = frame.check
    if arguments.explain:
        from ...measure.report.feature_savings import explain

        with console.told_when_slow("drawing without leaving things out, to compare ...", after_compiling=True):
            found["explain"] = explain(scene, **options)
    if not arguments.json:
        print(summary(frame, [*chosen_paths(output, saving["files"]).values(), *others]))
        for title, each in found.items():
            lines = (
                text_tables.wrapped(f"{title if not k else '':<8}{line}", 10) for k, line in enumerate(each.lines())
            )
            print("\n".join(lines))
    if _draws_once(arguments):
        from ...pipeline import ahead

        ahead.start(frame.scene, frame.settings, arguments.device)
    stats = {**frame.stats, **{title: each.stats() for title, each in found.items()}}
    return (DONE if all(each.passed for each in found.values()) else FAILED), stats


def _flow_cameras(scene: Scene, arguments: argparse.Namespace) -> tuple[Camera, ...]:
    """Return the cameras of --flow-to, one or two; none without it."""
    if arguments.flow_to is None:
        return ()
    if arguments.formats is not None and not {"exr", "npz"} & set(arguments.formats):
        formats = ",".join(arguments.formats)
        raise InputError(f"--flow-to: needs exr or npz in --formats, which hold the flow, not {formats}")
    from ...farm import read_cameras

    base = scene.camera if arguments.resolution is None else scene.camera.with_resolution(arguments.resolution)
    cameras = read_cameras(arguments.flow_to, base)
    if len(cameras) > 2:
        raise InputError(f"--flow-to: expected one camera or two in {shown(arguments.flow_to)}, found {len(cameras)}")
    return cameras


def render_options(arguments: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Return the keyword arguments of `clshade.render`."""
    limited = arguments.budget is not None or arguments.tolerance is not None  # which choose the samples
    chosen = picture_settings(arguments, scene)
    if limited:
        kept = {"shadows", *chosen_settings(arguments)}
        chosen = {name: value for name, value in chosen.items() if name in kept}
    if arguments.check is not None:
        chosen["layers"] = (*chosen.get("layers", ()), "Z", "id")
    if arguments.flow_to is not None:
        chosen["layers"] = (*chosen.get("layers", ()), "id")
    return {"preset": arguments.preset, "device": arguments.device, "resolution": arguments.resolution, **chosen}


def _print_json(stats: Any, arguments: argparse.Namespace) -> None:
    if arguments.json:
        import json

        print(json.dumps(stats, indent=2))


def _try_out_device(name: str | None) -> None:
    with contextlib.suppress(Exception):  # `open_device` raises it again
        from ...pipeline.opencl.device import try_out_soon

        try_out_soon(name)


def _import_meanwhile(checked: bool) -> None:
    with contextlib.suppress(Exception):  # who needs it raises it again
        from ...pipeline import renderer  # noqa: F401

        if checked:
            from ...measure.check import check  # noqa: F401
        import OpenEXR  # noqa: F401
        import PIL.PngImagePlugin  # noqa: F401


def _check_output(output: str, arguments: argparse.Namespace) -> None:
    """Refuse, before rendering, an output that could not be saved afterwards."""
    from ...base import atomic_files
    from ...pipeline.frame_files import check_output

    for stem in stems_of(output, arguments):
        check_output(stem, asked=("render", "--output"), **chosen_saving(arguments))
    for path in files_of(output, arguments):
        atomic_files.check(path)


def summary(frame: Frame, written: Sequence[Path]) -> str:
    """Return a few lines: what was drawn, the device, the time of each stage, and the files that were written."""
    stats = frame.stats
    times = dict(stats["times_ms"])
    columns, rows = stats["resolution"]
    whole = times.pop("frame")
    fixed = {name: times.pop(name) for name in ("pack", "open", "upload")}
    fixed["build"] = stats["build_ms"]
    files = ", ".join(f"{shown(path)} ({path.stat().st_size / 1e6:.2f} MB)" for path in written)

    def listed(values: dict[str, float]) -> str:
        return ", ".join(f"{name}{text_tables.TIED}{value:.2f}" for name, value in values.items())

    name = shown(frame.scene.name or "unnamed")
    ignored = [f"ignored {', '.join(stats['ignored'])}"] if stats["ignored"] else []
    lines = [
        f"scene   {name}: {stats['triangles']:,} triangles, {stats['visible']:,} in view",
        *ignored,
        *_scalars(frame),
        f"image   {columns}x{rows}, {frame.settings.shader}, {frame.settings.visibility}",
        f"device  {stats['device']}",
        f"once    {listed(fixed)} ms",
        f"frame   {whole:.2f} ms, the first: {listed(times)}",
    ]
    return "\n".join([*(text_tables.wrapped(line, 8) for line in lines), f"wrote   {files}"])


def _scalars(frame: Frame) -> list[str]:
    """Return a line on the scalars shown, if there are any."""
    from ...scene.scalar_colors import color_map_of

    scalars = frame.settings.scalars
    if scalars is None:
        return []
    color_map = color_map_of(frame.scene, scalars)
    colors = scalars.colormap if isinstance(scalars.colormap, str) else f"{color_map.count} colors"
    return [f"scalars {shown(scalars.name)}: {color_map.low:g} to {color_map.high:g}, {colors}"]
