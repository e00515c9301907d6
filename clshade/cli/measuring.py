"""`bench`, `report`, `stability` and `grade`: times and errors of scenes."""

from __future__ import annotations

import os
import shlex
import time
from argparse import ArgumentParser
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..base import atomic_files, console
from ..base.spelling import hint
from ..errors import InputError
from ..images.figures import FORMATS
from ..measure.defaults import BENCH_FRAMES, FRAMES
from ..scene.model import Settings
from ..scene.settings import LIGHT_FIELDS, PRESETS
from . import DONE, FAILED
from .options import (
    Arguments,
    Device,
    Json,
    Limits,
    Option,
    add_options,
    check_output_file,
    declared,
    from_1,
    names,
    output_name,
)
from .scene import (
    A_SCENE,
    apply_options,
    choose_look,
    chosen_settings,
    light_options,
    load_scene,
    read_scene,
    scene_options,
)

if TYPE_CHECKING:
    from ..measure.bench.workloads import Workload
    from ..measure.grade.grade import Right
    from ..scene.model import Scene
    from ..scene.settings import Look

RESOLUTION = (320, 240)  # default of `report --resolution`: it then takes less than half a minute


SOME_SCENE = Option(f"scene SCENE: {A_SCENE}", nargs="?")
_formats = names(FORMATS)


class Bench:
    title = "measurement: what is timed, and what is written"
    list = Option("--list: name all workloads")
    frames = Option("--frames N: of each scene", from_1, BENCH_FRAMES)
    against = Option(
        "--against llvmpipe|opengl: draw in turns with Mesa's software rasterizer, or with the machine's OpenGL (PyPI's "
        "moderngl)"
    )
    out = Option("-o, --out PREFIX: write PREFIX.csv, .json and .md", output_name)


def add_bench_options(parser: ArgumentParser) -> None:
    about = "files, workloads of --list, or built-in scenes, sought in this order (default: all workloads)"
    scene_options(parser, Option(f"scenes SCENE: {about}", nargs="*"), samples="1, its center")
    of_scene = [action.dest for action in parser._actions if action.dest not in ("help", "scenes")]
    parser.set_defaults(of_scene=of_scene)
    add_options(parser, Bench, Device)


def run_bench(arguments: Arguments) -> int:
    from ..measure.bench import bench
    from ..measure.bench.workloads import WORKLOADS

    if arguments.list:
        print(bench.listing())
        return DONE
    known = {workload.name: workload for workload in WORKLOADS}
    workloads = [_workload(arguments, name, known) for name in dict.fromkeys(arguments.scenes or known)]
    options = {"frames": arguments.frames, "against": arguments.against, "out": arguments.out}
    return DONE if bench.run(workloads, arguments.device, **options) else FAILED


def _workload(arguments: Arguments, name: str, known: Mapping[str, Workload]) -> Workload:
    """Return the workload of this name, unless there is such a file, or the scene with the options of the command line."""
    from ..measure.bench.workloads import Workload
    from ..scene.builtin.scenes import BUILTINS

    if not Path(name).is_file():
        if name in known:
            arguments.refuse(arguments.of_scene, f"cannot go with {name!r}, a workload, whose scene is fixed")
            return known[name]
        if not Path(name).suffix and name not in BUILTINS:
            near = hint(name, (*known, *BUILTINS))
            raise InputError(f"SCENE: expected a file, a built-in scene or a workload of --list, found {name!r}{near}")
    scene = load_scene(arguments, name)
    return Workload(name, "", lambda: scene, {"preset": arguments.preset, **chosen_settings(arguments)})


class Report:
    """Arguments of `measure.report.report.run`."""

    title = "study: what is compared, and what is written"
    out = Option("-o, --out DIR: folder for tables and figure", output_name, "report")
    formats = Option(f"--format NAME,...: of the figure: {','.join(FORMATS)} (default: png)", _formats)
    html = Option("--html: also one page with tables and pictures")
    names = Option("--only NAME: these variants only", nargs="+")
    details = Option("--details: all variants, causes of the error; print all tables")
    frames = Option(f"--frames N: of each variant (default: {FRAMES!s})", int)


class ReportInstead:
    title = Report.title
    list = Option("--list: name all variants")
    course = Option(
        "--course: of a course scene instead: its figures 1 to 19, errors and times on one HTML page, --out"
    )


def add_report_options(parser: ArgumentParser) -> None:
    first = len(parser._actions)
    scene_options(parser, size="{},{}".format(*RESOLUTION), samples=None)
    repeated = [action.dest for action in parser._actions[first:] if action.dest not in ("scene", "resolution")]
    parser.set_defaults(repeated=[*repeated, "device"])
    add_options(parser, Report, light_options(), Limits, ReportInstead, title=Report.title)
    add_options(parser, Device)


def run_report(arguments: Arguments) -> int:
    from ..measure.report import report

    if arguments.list:
        print(report.listing())
        return DONE
    if arguments.course:
        return _course(arguments)
    arguments.resolution = arguments.resolution or RESOLUTION
    read = read_scene(arguments, arguments.scene)
    look, scene = choose_look(read, arguments), apply_options(read, arguments)
    options = {**arguments.keywords(Report), **arguments.keywords(Limits)}
    command = partial(_command, arguments, read, scene, look)
    passed = report.run(scene, arguments.device, command=command, settings=chosen_settings(arguments), **options)
    return DONE if passed else FAILED


def _command(arguments: Arguments, read: Scene, scene: Scene, look: Look, settings: Settings) -> str:
    """Return the command that draws the scene with these settings. read: the scene without its look."""
    from ..base.declare import as_argument, as_option
    from ..measure.report.tables import render_fields, render_options

    presets = PRESETS if look == "plain" else (scene.preset,)
    light = {name: getattr(arguments, name) for name in LIGHT_FIELDS}
    light = {name: value for name, value in light.items() if value is not None and value == getattr(settings, name)}
    changed = render_fields(settings, scene, presets, **light)
    options = [as_argument(arguments.scene), *arguments.as_options(arguments.repeated)]
    drawn = {**vars(arguments), **dict.fromkeys(vars(settings)), **changed}
    if choose_look(read, Arguments(**drawn)) != look:
        options.append(as_option("look", look))
    return shlex.join(["clshade", "render", *options, *render_options(scene, changed)])


def _course(arguments: Arguments) -> int:
    """Write the page of a course scene."""
    from .. import __version__
    from ..measure.course_report import course_report

    unused = [each.dest for each in (*declared(Report).values(), *declared(Limits).values()) if each.dest != "out"]
    arguments.refuse([*unused, *LIGHT_FIELDS], "cannot go with --course, which studies no variants")
    course_report.output_path(arguments.out)  # its errors come before the scene's
    if arguments.device:
        os.environ["CLSHADE_DEVICE"] = arguments.device
    path = course_report.run(load_scene(arguments), arguments.scene, arguments.out, __version__)
    print(f"wrote {atomic_files.shown(path)}")
    return DONE


class Cases:
    title = "cases: without a SCENE"
    names = Option("--case NAME: only these, by name or number", nargs="+")
    triangles = Option("--triangles TRIANGLES: random ones to draw", int, 50000)
    list = Option("--list: name all cases, and what is expected of each")
    formats = Option(
        f"--format NAME,...: of the figure of errors against stiffness: {','.join(FORMATS)} (default: png)",
        _formats,
        ("png",),
    )


class Stability:
    device = Option("--device DEVICE: as for render, or `all` for the cases: every device that works")
    out = Option("-o, --out DIR: folder for tables, figures and pictures", output_name, "stability")


def add_stability_options(parser: ArgumentParser) -> None:
    before = len(parser._actions)
    scene_options(parser, SOME_SCENE, samples="1, its center")
    parser.set_defaults(of_scene=[action.dest for action in parser._actions[before:]])
    add_options(parser, Cases, Stability)


def run_stability(arguments: Arguments) -> int:
    if arguments.scene is not None:
        from ..measure.stability import scene_stability

        why = f"is for the cases, and cannot go with {arguments.scene!r}"
        arguments.refuse([each.dest for each in declared(Cases).values()], why)
        scene = load_scene(arguments)
        settings = Settings.from_preset(arguments.preset or scene.preset, **chosen_settings(arguments))
        return DONE if scene_stability.run(scene, settings, arguments.device, out=arguments.out) else FAILED
    from ..measure.stability import stability

    arguments.refuse(arguments.of_scene, "needs a SCENE")
    if arguments.list:
        print(stability.listing())
        return DONE
    options = arguments.keywords(Cases)
    if {"names", "formats"} <= options.keys():
        raise InputError("stability: --format: is for the figure that all cases have, and cannot go with --case")
    return DONE if stability.run(arguments.device, out=arguments.out, **options) else FAILED


IMAGE = Option(
    "image IMAGE: a PNG or other lossless 8-bit image of linear values, round(255*x), an EXR or .npz of linear floats, row "
    "0 at the top; an .npy as the course's functions return images, row 0 at the bottom; or a folder of them",
    nargs="?",
)


class Grade:
    title = "grade: what is right, and what is written"
    preset = Option("--preset: how the right image is drawn (default: course)", choices=PRESETS[:2])
    shader = Option("--shader gouraud|phong|nolight: of the right image (default: phong)")
    output = Option("-o, --output FILE: a picture of the comparison, .png; of a folder a .csv", output_name)
    html = Option("--html FILE: of a folder: a page with a picture of each image", output_name)
    json = Json.json
    list = Option("--list: name the mistakes that are modeled")


def add_grade_options(parser: ArgumentParser) -> None:
    add_options(parser, [IMAGE])
    scene_options(parser, SOME_SCENE, size="the scene's own", samples=None)
    add_options(parser, Grade)


def run_grade(arguments: Arguments) -> int:
    arguments.refuse(("look", "ground"), "the right image is drawn as --preset says")
    if arguments.list:
        from ..measure.grade.mistakes import MISTAKES

        if arguments.image is not None:
            raise InputError(f"IMAGE: expected none with --list, found {arguments.image!r}")
        unused = vars(arguments).keys() & vars(arguments.parser.parse_args([])).keys() - {"list", "image"}
        arguments.refuse(sorted(unused), "cannot go with --list, which reads no image")
        print("\n".join(f"{mistake.name}: {mistake.advice}" for mistake in MISTAKES))
        return DONE
    for name in ("image", "scene"):
        if getattr(arguments, name) is None:
            raise InputError(f"{name.upper()}: expected `grade IMAGE SCENE`, found none")
    folder = os.path.isdir(arguments.image)
    if arguments.output:
        check_output_file(arguments.output, (arguments.image,), (".csv",) if folder else (".png",))
    if not folder:
        arguments.refuse(("html",), "needs a folder of images")
    elif arguments.html:
        check_output_file(arguments.html, (), (".html",), "--html")
    from ..measure.grade.grade import right_of

    settings = Settings.from_preset(arguments.preset or "course", **chosen_settings(arguments))
    right = right_of(load_scene(arguments), settings)
    return _grade_folder(arguments, right) if folder else _grade_image(arguments, right)


def _grade_image(arguments: Arguments, right: Right) -> int:
    from ..measure.grade import grade, tables
    from ..measure.results import wrote

    graded = grade.grade(arguments.image, right)
    facts = graded.facts()
    print(tables.results([facts], right.name).json() if arguments.json else "\n".join(tables.lines(facts)))
    if arguments.output:
        from ..images import figures
        from ..measure.grade import pictures

        figures.save(pictures.draw(graded, right), arguments.output)
        console.progress(wrote([arguments.output])[0])
    return DONE if graded.right else FAILED


def _grade_folder(arguments: Arguments, right: Right) -> int:
    from ..base.progress_bar import Bar
    from ..measure.grade import folder, tables
    from ..measure.results import wrote

    images = folder.submissions(arguments.image)
    if not images:
        raise InputError(f"{atomic_files.shown(arguments.image)}: expected images in the folder, found none")
    rows = []
    with Bar(len(images), "grade", clock=time.time) as bar:
        for row in folder.grade_all(arguments.image, images, right, drawn=bool(arguments.html)):
            rows.append(row)
            bar.advance()
    submissions = [row.facts for row in rows]
    results = tables.results(submissions, right.name)
    print(results.json() if arguments.json else "\n".join(tables.summary(submissions)))
    if arguments.output:
        atomic_files.write_bytes(arguments.output, tables.csv(submissions).encode())
    if arguments.html:
        atomic_files.write_bytes(arguments.html, tables.page(rows, right.name))
    for line in wrote(path for path in (arguments.output, arguments.html) if path):
        console.progress(line)
    return FAILED if any("error" in facts for facts in submissions) else DONE
