"""Command line: arguments to calls, exit codes, one-line errors. Whatever is slow to import is imported where used."""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from .errors import ClshadeError, InputError

if TYPE_CHECKING:
    from .frame import Frame
    from .scene import Scene

DONE, FAILED, REFUSED, INTERRUPTED, UNREAD = 0, 1, 2, 130, 141


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage in front."""

    def error(self, message: str) -> NoReturn:
        self.exit(REFUSED, f"{self.prog}: {' '.join(message.split())}\n")


def _numbers(kind: type, count: int | None, form: str) -> Any:
    def parse(text: str) -> tuple:
        try:
            values = tuple(kind(part) for part in text.split(",")) if text else ()
        except ValueError:
            values = ()
        if not values or (count is not None and len(values) != count):
            raise argparse.ArgumentTypeError(f"expected {form}, found {text!r}")
        return values

    return parse


def _names(allowed: Sequence[str]) -> Any:
    def parse(text: str) -> tuple[str, ...]:
        values = tuple(part.strip() for part in text.split(",") if part.strip())
        for value in values:
            if value not in allowed:
                raise argparse.ArgumentTypeError(f"expected names of {', '.join(allowed)}, found {value!r}")
        return values

    return parse


def _checked(text: str) -> int | str:
    if text != "all" and not (text.isascii() and text.isdigit() and int(text) > 0):
        raise argparse.ArgumentTypeError(f"expected a number of pixels or all, found {text!r}")
    return text if text == "all" else int(text)


CHECKED = 4096  # pixels of --check
LOAD_OPTIONS = ("texture", "focal", "crease", "flat", "up", "two_sided")  # of clshade.loading.load
COMPONENTS = {"ambient": "ka", "diffuse": "kd", "specular": "ks"}


def _scene_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("scene")
    group.add_argument(
        "scene",
        nargs="?",
        default="teapot",
        help="a file (.npy course scene; .obj .gltf .glb .ply .stl meshes), or a built-in scene (teapot)",
    )
    group.add_argument("--texture", metavar="FILE", help="image to use as the texture")
    group.add_argument("--focal", type=float, help="focal length of a course file, scene units")
    edges = group.add_mutually_exclusive_group()
    edges.add_argument(
        "--crease", type=float, metavar="DEGREES", help="edges above this angle are sharp, where a mesh has no normals"
    )
    edges.add_argument(
        "--flat", action="store_true", default=None, help="every face is flat, where a mesh has no normals"
    )
    group.add_argument(
        "--up", choices=("x", "y", "z", "-x", "-y", "-z"), help="axis that points up (z for STL, else y)"
    )
    group.add_argument(
        "--two-sided",
        action=argparse.BooleanOptionalAction,
        help="light both sides of surfaces (default: as glTF files ask, on for OBJ, PLY and STL)",
    )
    group.add_argument("--lights", type=_numbers(int, None, "indices such as 0,2"), help="use these lights only: 0,2")
    group.add_argument("--components", type=_names(tuple(COMPONENTS)), help="use these only: ambient,diffuse,specular")
    group.add_argument(
        "--resolution", type=_numbers(int, 2, "two whole numbers such as 800,600"), metavar="W,H", help="pixels"
    )


def _camera_options(parser: argparse.ArgumentParser) -> None:
    point = _numbers(float, 3, "three numbers such as 1,2,3")
    group = parser.add_argument_group("camera (default: the scene's, or chosen from its size)")
    group.add_argument("--camera-position", type=point, metavar="X,Y,Z", help="the eye, scene units")
    group.add_argument("--camera-focal-point", type=point, metavar="X,Y,Z", help="what is looked at, scene units")
    group.add_argument("--camera-view-up", type=point, metavar="X,Y,Z", help="what points up in the image")
    group.add_argument("--camera-azimuth-angle", type=float, default=0.0, metavar="DEG", help="go round to the right")
    group.add_argument("--camera-elevation-angle", type=float, default=0.0, metavar="DEG", help="go up")
    group.add_argument("--camera-view-angle", type=float, metavar="DEG", help="vertical field of view")
    group.add_argument("--orthographic", action="store_true", help="parallel projection")


def _setting_options(parser: argparse.ArgumentParser) -> None:
    from . import scene

    group = parser.add_argument_group("settings (default: those of the preset)")
    group.add_argument("--preset", choices=scene.PRESETS, help="course for course files, else standard")
    group.add_argument("--shader", choices=scene.SHADERS)
    group.add_argument("--visibility", choices=scene.VISIBILITIES)
    group.add_argument("--lighting-at", choices=scene.LIGHTING_AT)
    group.add_argument("--interpolation", choices=scene.INTERPOLATIONS)
    group.add_argument("--texture-at", choices=scene.TEXTURE_AT)
    group.add_argument("--ambient", choices=scene.AMBIENTS)
    group.add_argument("--layers", type=_names(scene.LAYERS), help=f"further layers: {','.join(scene.LAYERS)}")
    group.add_argument("--cull", action="store_true", default=None, help="leave out triangles seen from behind")
    group.add_argument("--near", type=float, help="near plane, scene units (default: 1e-4 of the scene's radius)")
    group.add_argument("--precision", choices=("float32",))


def _device_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--device",
        help="pocl, intel, nvidia, rusticl, part of a platform's name, or P:D (default: CLSHADE_DEVICE, PoCL)",
    )


def _stability_options(commands: Any) -> None:
    stability = commands.add_parser("stability", help="stiff and extreme cases, each with its measured error")
    stability.add_argument("--device", help="as for render, or `all`: every device that works")
    stability.add_argument(
        "--out", default="stability", metavar="DIR", help="folder for table, figure and pictures (default: stability)"
    )
    stability.add_argument("--case", nargs="+", default=(), metavar="NAME", help="only these, by name or number")
    stability.add_argument("--triangles", type=int, default=50_000, help="random ones to draw (default: 50000)")
    stability.add_argument("--list", action="store_true", help="name all cases, and what is expected of each")
    stability.set_defaults(run=_stability)


def _fuzz_options(commands: Any) -> None:
    fuzz = commands.add_parser("fuzz", help="random scenes against the oracle, damaged files against the loaders")
    for name, count, what in (
        ("scenes", 1000, "random scenes to draw"),
        ("files", 1000, "damaged files to load"),
        ("seed", 0, "another seed gives other scenes and files"),
        ("first", 0, "number of the first scene and file: `--first 7 --scenes 1` draws scene 7 again"),
    ):
        fuzz.add_argument(f"--{name}", type=int, default=count, metavar="N", help=f"{what} (default: {count})")
    _device_option(fuzz)
    fuzz.set_defaults(run=_fuzz)


def _parser() -> argparse.ArgumentParser:
    from . import __version__

    parser = _Parser(prog="clshade", description="Render triangle meshes with OpenCL kernels to linear HDR images.")
    parser.add_argument("--version", action="version", version=f"clshade {__version__}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=_Parser)
    render = commands.add_parser("render", help="render a scene to OUT.exr and OUT.png")
    _scene_options(render)
    _camera_options(render)
    _setting_options(render)
    output = render.add_argument_group("output")
    output.add_argument(
        "-o", "--output", default="out", metavar="OUT", help="writes OUT.exr and OUT.png (default: out)"
    )
    output.add_argument("--tonemap", choices=("none", "srgb", "reinhard", "hable", "aces"), help="of the PNG")
    output.add_argument("--exposure", type=float, default=0.0, metavar="STOPS", help="of the PNG (default: 0)")
    output.add_argument("--half", action="store_true", help="16-bit floats in the EXR")
    output.add_argument("--compression", default="zip", help="of the EXR (default: zip)")
    output.add_argument("--deterministic", action="store_true", help="leave times out of the EXR")
    output.add_argument("--stats", action="store_true", help="print all figures as JSON")
    measured = render.add_argument_group("measured")
    measured.add_argument(
        "--check",
        nargs="?",
        const=CHECKED,
        type=_checked,
        metavar="PIXELS|all",
        help=f"the error of this image, of some pixels (default: {CHECKED}) or all, computed again in float64; "
        "adds the layers Z and id, with `all` also `error`",
    )
    measured.add_argument(
        "--explain", action="store_true", help="what the kernels left out, why, and what that saves: measured"
    )
    _device_option(render)
    render.set_defaults(run=_render)
    devices = commands.add_parser("devices", help="what OpenCL devices were found, and which work")
    devices.set_defaults(run=_devices)
    _stability_options(commands)
    _fuzz_options(commands)
    inspect = commands.add_parser("inspect", help="statistics per channel of an EXR, and an exposure ladder")
    inspect.add_argument("file", metavar="FILE.exr")
    inspect.add_argument("-o", "--output", metavar="PNG", help="exposure ladder (default: FILE-ladder.png)")
    inspect.set_defaults(run=_inspect)
    return parser


# Commands


def load_scene(arguments: argparse.Namespace) -> Scene:
    """The scene of the command line: a file, or a built-in one where no such file exists."""
    from . import scenes, viewpoint

    name = arguments.scene
    options = {name: getattr(arguments, name) for name in LOAD_OPTIONS if getattr(arguments, name) is not None}
    if name in scenes.BUILTINS and not Path(name).exists():
        for option in options:
            flag = option.replace("_", "-")
            raise InputError(f"--{flag}: expected a scene file to apply it to, found the built-in scene {name!r}")
        scene = scenes.builtin(name)
    else:
        from . import loading

        scene = loading.load(name, resolution=arguments.resolution, **options)
    if arguments.lights is not None:
        for index in arguments.lights:
            if not 0 <= index < len(scene.lights):
                expected = (
                    f"indices from 0 to {len(scene.lights) - 1}" if scene.lights else "none, the scene has no lights"
                )
                raise InputError(f"--lights: expected {expected}, found {index}")
        scene = replace(scene, lights=tuple(scene.lights[i] for i in dict.fromkeys(arguments.lights)))
    if arguments.components is not None:
        off: dict[str, Any] = {
            name: 0.0 for component, name in COMPONENTS.items() if component not in arguments.components
        }
        changed = {id(mesh.material): replace(mesh.material, **off) for mesh in scene.meshes}
        meshes = tuple(replace(mesh, material=changed[id(mesh.material)]) for mesh in scene.meshes)
        scene = replace(scene, meshes=meshes)
    camera = viewpoint.moved(
        scene.camera,
        position=arguments.camera_position,
        focal_point=arguments.camera_focal_point,
        up=arguments.camera_view_up,
        azimuth=arguments.camera_azimuth_angle,
        elevation=arguments.camera_elevation_angle,
        view_angle=arguments.camera_view_angle,
        orthographic=arguments.orthographic,
    )
    return replace(scene, camera=camera)


def _render(arguments: argparse.Namespace) -> int:
    from threading import Thread

    from .scene import Settings

    # The writers' imports cost as much as the rendering: they happen beside it.
    warming = Thread(target=_import_writers, daemon=True)
    warming.start()
    given = {f.name: getattr(arguments, f.name, None) for f in fields(Settings)}
    chosen = {name: value for name, value in given.items() if value is not None}
    _check_output(arguments)
    if arguments.check is not None:
        chosen["layers"] = (*chosen.get("layers", ()), "Z", "id")
    scene = load_scene(arguments)
    from . import renderer

    options = {"preset": arguments.preset, "device": arguments.device, "resolution": arguments.resolution, **chosen}
    frame = renderer.render(scene, **options)
    if arguments.check is not None:
        from .checks.checking import check

        check(frame, arguments.check)
    warming.join()
    for warning in frame.save(
        arguments.output,
        tonemap=arguments.tonemap,
        exposure=arguments.exposure,
        half=arguments.half,
        compression=arguments.compression,
        deterministic=arguments.deterministic,
    ):
        print(f"clshade: warning: {warning}", file=sys.stderr)
    found: dict[str, Any] = {} if frame.check is None else {"check": frame.check}
    if arguments.explain:
        from .checks.explaining import explain

        found["explain"] = explain(scene, **options)
    _print_found(frame, found, arguments)
    return DONE if all(each.passed for each in found.values()) else FAILED


def _print_found(frame: Frame, found: dict[str, Any], arguments: argparse.Namespace) -> None:
    """The figures of a frame, and what `check` and `explain` found, as lines or as JSON."""
    if arguments.stats:
        import json

        print(json.dumps({**frame.stats, **{name: each.stats() for name, each in found.items()}}, indent=2))
        return
    print(summary(frame, arguments.output))
    for name, each in found.items():
        print(f"{name:<8}" + "\n        ".join(each.lines()))


def _import_writers() -> None:
    import OpenEXR  # noqa: F401
    import PIL.Image  # noqa: F401


def _check_output(arguments: argparse.Namespace) -> None:
    """Refuses before the rendering what could not be saved after it."""
    from .frame import check_output

    check_output(
        arguments.output, tonemap=arguments.tonemap, exposure=arguments.exposure, compression=arguments.compression
    )


def summary(frame: Frame, output: str) -> str:
    """What was drawn, on what, how long each stage took, and the files: a few lines."""
    from .frame import output_paths

    stats = frame.stats
    times = dict(stats["times_ms"])
    columns, rows = stats["resolution"]
    whole = times.pop("frame")
    fixed = {name: times.pop(name) for name in ("pack", "open", "build", "upload")}
    shown = ", ".join(f"{path} ({path.stat().st_size / 1e6:.2f} MB)" for path in output_paths(output))

    def listed(values: dict[str, float]) -> str:
        return ", ".join(f"{name} {value:.2f}" for name, value in values.items())

    ignored = [f"ignored {', '.join(stats['ignored'])}"] if stats["ignored"] else []
    return "\n".join(
        [
            f"scene   {frame.scene.name or 'unnamed'}: {stats['triangles']:,} triangles, {stats['visible']:,} in view",
            *ignored,
            f"image   {columns}x{rows}, {frame.settings.shader}, {frame.settings.visibility}",
            f"device  {stats['device']}",
            f"once    {listed(fixed)} ms",
            f"frame   {whole:.2f} ms: {listed(times)}",
            f"wrote   {shown}",
        ]
    )


def _devices(arguments: argparse.Namespace) -> int:
    from . import device

    infos = device.list_devices()
    print(device.format_devices(infos))
    return DONE if any(info.works for info in infos) else FAILED


def _stability(arguments: argparse.Namespace) -> int:
    from .checks import stability

    if arguments.list:
        print(stability.listing())
        return DONE
    options = {"out": arguments.out, "names": arguments.case, "triangles": arguments.triangles}
    return DONE if stability.run(arguments.device, **options) else FAILED


def _fuzz(arguments: argparse.Namespace) -> int:
    from .checks import fuzz

    counts = {name: getattr(arguments, name) for name in ("scenes", "files", "seed", "first")}
    return DONE if fuzz.run(arguments.device, **counts) else FAILED


def _inspect(arguments: argparse.Namespace) -> int:
    from . import exr, inspecting

    path = Path(arguments.file)
    channels, _ = exr.read(path)
    print(inspecting.format_statistics(inspecting.statistics(channels)))
    picture = Path(arguments.output) if arguments.output else path.with_name(path.stem + "-ladder.png")
    inspecting.exposure_ladder(channels, picture)
    print(f"wrote {picture}")
    return DONE


def _with_values(arguments: Sequence[str]) -> list[str]:
    """The arguments with `--up -x` as `--up=-x`, and `--camera-position -1,2,3` likewise: argparse takes what begins
    with a dash, and is not one number, for an option. And `--check SCENE` as `--check=4096 SCENE`."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] == "--check" and not re.fullmatch(r"all|\d+|-.*", argument):
            joined[-1] = f"--check={CHECKED}"  # what follows is the scene
            joined.append(argument)
        elif joined and re.fullmatch(r"-([xyz]|\.?\d.*)", argument) and re.fullmatch(r"--[a-z-]+", joined[-1]):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


@contextlib.contextmanager
def _warnings_in_one_line() -> Iterator[None]:
    """Every warning that Python's filters let through is one line on stderr, without the place in the code."""

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        print(f"clshade: warning: {' '.join(str(message).split())}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = show  # type: ignore[assignment]
        yield


class _Unwritable(Exception):
    """Standard output cannot be written; its cause says why."""


class _Stdout:
    """Standard output; an error of its own is told from the errors of files."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        try:
            return self.stream.write(text)
        except OSError as error:
            raise _Unwritable from error

    def flush(self) -> None:
        try:
            self.stream.flush()
        except OSError as error:
            raise _Unwritable from error

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def _discard(stream: TextIO) -> None:
    """What the stream still holds goes nowhere: Python would try to write it once more at its end, and complain."""
    with contextlib.suppress(OSError, ValueError), open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command line (default: the process's own); returns its exit code: 0 done, 1 a check failed, 2 bad usage or
    input, 130 interrupted, 141 (as a shell counts it) when nobody reads the output any more."""
    arguments = sys.argv[1:] if arguments is None else arguments
    stdout = sys.stdout  # None where there is none
    try:
        with contextlib.redirect_stdout(_Stdout(stdout) if stdout else None):  # type: ignore[type-var]
            code = _run(arguments)
            if stdout:
                sys.stdout.flush()
            return code
    except _Unwritable as error:
        _discard(stdout)
        if isinstance(error.__cause__, BrokenPipeError):
            return UNREAD
        reason = getattr(error.__cause__, "strerror", None) or error.__cause__
        print(f"clshade: standard output: cannot be written: {reason}", file=sys.stderr)
        return REFUSED
    except KeyboardInterrupt:
        print("clshade: interrupted", file=sys.stderr)
        return INTERRUPTED


def _run(arguments: Sequence[str]) -> int:
    try:
        parsed = _parser().parse_args(_with_values(arguments))
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else REFUSED
    try:
        with contextlib.nullcontext() if parsed.debug else _warnings_in_one_line():
            return parsed.run(parsed)
    except ClshadeError as error:
        if parsed.debug:
            raise
        print(f"clshade: {' '.join(str(error).split())}", file=sys.stderr)
        return REFUSED


def entry() -> NoReturn:
    """The console script."""
    try:
        code = main()
    except KeyboardInterrupt:  # once more
        code = INTERRUPTED
    if code == INTERRUPTED:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # what is left is clearing up
    sys.exit(code)
