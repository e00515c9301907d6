"""`bench`, `report`, `stability` and `grade`: times and errors of scenes."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Mapping
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
    DEVICE,
    Arguments,
    Group,
    Limits,
    Option,
    check_output_file,
    from_1,
    names,
    names_of,
    output_name,
)
from .scene import (
    A_SCENE,
    SCENE,
    TEAPOT,
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

RESOLUTION = (320, 240)  # default of `report --resolution`: it then takes less than half a minute


_SCENE = Group(SCENE, Option(f"scene SCENE: {A_SCENE}", nargs="?"))
_AT_CENTER = scene_options(samples="1, its center")
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


def run_bench(arguments: Arguments) -> int:
    from ..measure.bench import bench
    from ..measure.bench.workloads import WORKLOADS

    if arguments.list:
        print(bench.listing())
        return DONE
    named = {workload.name: workload for workload in WORKLOADS}
    workloads = [_workload(arguments, name, named) for name in dict.fromkeys(arguments.scenes or named)]
    options = {"frames": arguments.frames, "against": arguments.against, "out": arguments.out}
    return DONE if bench.run(workloads, arguments.device, **options) else FAILED


def _workload(arguments: Arguments, name: str, named: Mapping[str, Workload]) -> Workload:
    """Return the workload of this name, unless there is such a file, or the scene with the options of the command line."""
    from ..measure.bench.workloads import Workload
    from ..scene.builtin.scenes import BUILTINS

    if not Path(name).is_file():
        if name in named:
            arguments.refuse(names_of(*_AT_CENTER), f"cannot go with {name!r}, a workload, whose scene is fixed")
            return named[name]
        if not Path(name).suffix and name not in BUILTINS:
            near = hint(name, (*named, *BUILTINS))
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


_STUDY = scene_options(size="{},{}".format(*RESOLUTION), samples=None)
# Which the commands of variants repeat.
_REPEATED = [name for name in names_of(*_STUDY, DEVICE) if name != "resolution"]


def run_report(arguments: Arguments) -> int:
    from ..base.declare import as_argument, as_option
    from ..measure.report import report
    from ..measure.report.tables import render_fields, render_options

    if arguments.list:
        print(report.listing())
        return DONE
    if arguments.course:
        return _course(arguments)
    arguments.resolution = arguments.resolution or RESOLUTION
    read = read_scene(arguments, arguments.scene)
    look, scene = choose_look(read, arguments), apply_options(read, arguments)

    def command(settings: Settings) -> str:
        """Return the command that draws the scene with these settings."""
        presets = PRESETS if look == "plain" else (scene.preset,)
        light = {name: getattr(arguments, name) for name in LIGHT_FIELDS}
        light = {name: value for name, value in light.items() if value is not None and value == getattr(settings, name)}
        changed = render_fields(settings, scene, presets, **light)
        options = [as_argument(arguments.scene), *arguments.as_options(_REPEATED)]
        drawn = {**vars(arguments), **dict.fromkeys(vars(settings)), **changed}
        if choose_look(read, Arguments(**drawn)) != look:
            options.append(as_option("look", look))
        return shlex.join(["clshade", "render", *options, *render_options(scene, changed)])

    options = {**arguments.keywords(Report), **arguments.keywords(Limits)}
    passed = report.run(scene, arguments.device, command=command, settings=chosen_settings(arguments), **options)
    return DONE if passed else FAILED


def _course(arguments: Arguments) -> int:
    """Write the page of a course scene."""
    from .. import __version__
    from ..measure.course_report import course_report

    unused = [name for name in names_of(Report, Limits) if name != "out"]
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


def run_stability(arguments: Arguments) -> int:
    if arguments.scene is not None:
        from ..measure.stability import scene_stability

        why = f"is for the cases, and cannot go with {arguments.scene!r}"
        arguments.refuse(names_of(Cases), why)
        scene = load_scene(arguments)
        settings = Settings.from_preset(arguments.preset or scene.preset, **chosen_settings(arguments))
        return DONE if scene_stability.run(scene, settings, arguments.device, out=arguments.out) else FAILED
    from ..measure.stability import stability

    arguments.refuse(names_of(*_AT_CENTER), "needs a SCENE")
    if arguments.list:
        print(stability.listing())
        return DONE
    options = arguments.keywords(Cases)
    if {"names", "formats"} <= options.keys():
        raise InputError("stability: --format: is for the figure that all cases have, and cannot go with --case")
    return DONE if stability.run(arguments.device, out=arguments.out, **options) else FAILED


class Grade:
    title = "grade: what is right, and what is written"
    preset = Option("--preset: how the right image is drawn (default: course)", choices=PRESETS[:2])
    shader = Option("--shader gouraud|phong|nolight: of the right image (default: phong)")
    output = Option("-o, --output FILE: a picture of the comparison, .png; of a folder a .csv", output_name)
    html = Option("--html FILE: of a folder: a page with a picture of each image", output_name)
    json = Option("--json: print all figures as JSON")
    list = Option("--list: name the mistakes that are modeled")


_WORKLOADS = Option(
    "scenes SCENE: files, workloads of --list, or built-in scenes, sought in this order (default: all workloads)",
    nargs="*",
)
_IMAGE = Option(
    "image IMAGE: a PNG or other lossless 8-bit image of linear values, round(255*x), an EXR or .npz of linear floats, row "
    "0 at the top; an .npy as the course's functions return images, row 0 at the bottom; or a folder of them",
    nargs="?",
)
_LIGHT = Group(Report.title, *light_options(), Limits)
OPTIONS = {
    "bench": (Group(SCENE, _WORKLOADS), *_AT_CENTER, Bench, DEVICE),
    "report": (TEAPOT, *_STUDY, Report, _LIGHT, ReportInstead, DEVICE),
    "stability": (_SCENE, *_AT_CENTER, Cases, Stability),
    "grade": (Group("", _IMAGE), _SCENE, *scene_options(size="the scene's own", samples=None), Grade),
}


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
