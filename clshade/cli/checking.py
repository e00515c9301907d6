"""`inspect`, `compare`, `coco`, `devices`, `conform` and `verify`: what images hold; whether they and devices are right."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ..base import atomic_files, console
from ..errors import InputError
from ..measure.defaults import SAMPLE
from . import DONE, FAILED
from .options import (
    DEVICE,
    JSON,
    Arguments,
    Group,
    Option,
    Parser,
    add_options,
    check_output_file,
    check_scene_name,
    is_scene,
    join_values,
    number_from,
    numbers,
    output_name,
)

if TYPE_CHECKING:
    from ..measure.verify.recorded_image import Record, RecordedImage
    from ..scene.model import Scene

# By which a camera may differ that was chosen for a scene, on another processor: some roundings.
_CAMERA_ERROR = 2.0**-44


class Inspect:
    file = Option(
        "file FILE|SCENE: an EXR, of any program, or a PNG, whose values are code/largest code; or a scene, a file or a "
        "built-in one: its meshes, materials, textures, camera, lights, animations, and the scalars that `render "
        "--scalars` can show"
    )
    pixel = Option(
        "--pixel X,Y: the values of column X and row Y, counted from 0 at the TOP left; may be given again",
        numbers(int, [2], "a column and a row such as 10,20"),
        [],
        action="append",
    )
    output = Option(
        "-o, --output PNG: write a figure: exposures of -4 to +4 stops, luminance in stops as false color and histogram, "
        "all layers",
        output_name,
    )
    json = Option(
        "--json: print all figures as JSON: null for what is not finite, or the texts nan, inf and -inf in pixels"
    )


def run_inspect(arguments: Arguments) -> int:
    from ..base.json_values import plain
    from ..images import statistics
    from ..images.image_file import read_picture

    name = arguments.file
    if is_scene(name):
        return _inspect_scene(arguments)
    if arguments.output:
        check_output_file(arguments.output, (name,), (".png",))
    picture = read_picture(name)

    def figures() -> Any:
        pixels = statistics.pixel_stats(picture, arguments.pixel)
        channels = statistics.image_statistics(picture).stats()
        return {"file": name, **channels, "header": plain(picture.header), "pixels": pixels}

    def lines() -> list[str]:
        pixels = statistics.format_pixels(picture, arguments.pixel)
        channels = statistics.format_statistics(statistics.image_statistics(picture))
        return [channels, statistics.format_header(picture.header), *filter(None, [pixels])]

    arguments.print_result(figures, lines)
    if arguments.output:
        _save_figure(statistics.draw(picture, atomic_files.shown(name)), arguments.output)
    return DONE


def _save_figure(figure: Any, output: str) -> None:
    from ..images import figures

    figures.save(figure, output)
    console.progress(f"wrote {atomic_files.shown(output)}")


def _inspect_scene(arguments: Arguments) -> int:
    from ..scene.builtin.scenes import builtin
    from ..scene.contents import format_contents, scene_contents
    from ..scene.formats.gltf import animations_and_cameras
    from ..scene.formats.load import load
    from ..scene.formats.table import extensions_with

    name: str = arguments.file
    check_scene_name(name)
    if arguments.output or arguments.pixel:
        option = "--output" if arguments.output else "--pixel"
        raise InputError(f"{option}: is for images, not for the scene {atomic_files.shown(name)}")
    more = animations_and_cameras(name) if name.lower().endswith(extensions_with("animation")) else ()
    contents = scene_contents(load(name) if os.path.splitext(name)[1] else builtin(name), *more)
    arguments.print_result(lambda: {"file": name, **contents}, lambda: [format_contents(contents)])
    return DONE


class Compare:
    image = Option("image A: an EXR or PNG")
    reference = Option("reference B: what it should be; relMSE and FLIP are relative to it")
    layer = Option("--layer NAME: this one only, such as RGB, Z or N.X; may be given again", str, [], action="append")
    threshold = Option(
        "--threshold X: exit with 1 if any channel of any pixel is off by more than X, in the channel's units (PNG: from "
        "0 to 1), is NaN or infinite in one image alone, if any whole number differs, or if one image alone has a layer "
        "(default: exit with 0)",
        number_from(float, 0.0, "an error of 0 or more such as 1e-3"),
    )
    output = Option(
        "-o, --output PNG: write a picture of both images and their difference, layer by layer, and magnified where they "
        "differ most; of the first 40 layers that differ",
        output_name,
    )
    json = Option("--json: print all figures as JSON; an infinite PSNR is null")


def run_compare(arguments: Arguments) -> int:
    from ..images import compare
    from ..images.image_file import read_picture
    from ..images.metrics import has_flip, has_ssim

    if arguments.output:
        check_output_file(arguments.output, (arguments.image, arguments.reference), (".png",))
    image, reference = read_picture(arguments.image), read_picture(arguments.reference)
    difference = compare.compare_layers(image, reference, arguments.layer, arguments.threshold)
    if difference.lacking():
        console.warning(f"not compared: {'; '.join(difference.lacking())}")
    names = {"image": arguments.image, "reference": arguments.reference}
    arguments.print_result(lambda: {**names, **difference.stats()}, difference.lines)
    if not arguments.json:
        packages = ("SSIM", has_ssim, "scikit-image"), ("FLIP", has_flip, "flip-evaluator")
        for name, is_installed, package in packages:
            if not is_installed():
                console.detail(f"{name}: pip install {package}")
    if arguments.output:
        from ..images import compare_figure

        layers = compare.chosen_layers(image, reference, arguments.layer)
        different_first = sorted(layers, key=lambda name: not difference.layers[name].different)
        if len(layers) > compare_figure.MAX_LAYERS:
            layers = {name: layers[name] for name in different_first[: compare_figure.MAX_LAYERS]}
        clusters = {name: difference.layers[name].clusters for name in layers}
        titles = (image.name, reference.name)
        figure = compare_figure.draw(layers, encoded=bool(image.bits), titles=titles, clusters=clusters)
        _save_figure(figure, arguments.output)
    return DONE if difference.passed else FAILED


class Coco:
    files = Option("files FILE: EXR files rendered with --layers instance_id,object_id", nargs="+")
    output = Option("-o, --output JSON: the data set", output_name, "annotations.json")


def run_coco(arguments: Arguments) -> int:
    import json

    from ..images.coco import data_set

    check_output_file(arguments.output, arguments.files, (".json",))
    annotations = data_set(arguments.files, os.path.dirname(arguments.output) or ".")
    with atomic_files.replacing(arguments.output) as file:
        file.write(json.dumps(annotations, ensure_ascii=False).encode("utf-8", "backslashreplace"))  # as JSON escapes
    parts = {"images": "image", "annotations": "annotation", "categories": "category"}
    counts = ", ".join(
        f"{len(annotations[name])} {one if len(annotations[name]) == 1 else name}" for name, one in parts.items()
    )
    print(f"wrote {atomic_files.shown(arguments.output)}: {counts}")
    return DONE


def run_devices(arguments: Arguments) -> int:
    from ..base import text_tables
    from ..pipeline.opencl import device

    infos = device.list_devices()
    lines = device.format_devices(infos).splitlines()
    arguments.print_result(lambda: list(map(asdict, infos)), lambda: (text_tables.wrapped(line, 5) for line in lines))
    return DONE if any(info.works for info in infos) else FAILED


class Conform:
    only = Option(
        "--only GROUP,...: only these groups of tests: operations, constructs, structs, memory, repeatability, coverage, "
        "scenes",
        lambda text: text.split(","),
        either="what",
    )
    write_golden = Option(
        "--write-golden FILE: instead, write the golden hashes of this device's scenes, if all agree with the oracle",
        output_name,
        either="what",
    )
    out = Option(
        "-o, --out DIR: folder for the card, conform.csv, .json and .md, and for scripts that show failures",
        output_name,
        "conform",
    )


def run_conform(arguments: Arguments) -> int:
    from ..measure.conform import conform, scenes

    if arguments.write_golden is not None:
        scenes.write_golden(arguments.device, arguments.write_golden)
        return DONE
    return DONE if conform.run(arguments.device, out=arguments.out, only=arguments.only or ()) else FAILED


class Verify:
    image = Option("image OUT.exr: an image that clshade drew; OUT.png beside it is compared too")
    scene = Option("scene SCENE: what it shows: a file, or a built-in scene (default: as the header says)", nargs="?")
    pixels = Option(
        "--pixels N: random pixels to compute again: if none of the default is wrong, fewer than 0.1 %% of all are",
        int,
        SAMPLE,
        either="pixels",
    )
    all = Option("--all: compute every pixel again", either="pixels")
    seed = Option("--seed N: of the sample (default: one that nobody can foresee)", int)


OPTIONS = {
    "inspect": (Inspect,),
    "compare": (Compare,),
    "coco": (Coco,),
    "devices": (Group("", Option("--json: print a list of all figures as JSON; memory in bytes")),),
    "conform": (Conform, DEVICE),
    "verify": (Verify, JSON),
}


def run_verify(arguments: Arguments) -> int:
    from ..measure.verify.recorded_image import read_recorded
    from ..measure.verify.verify import verified

    image = read_recorded(arguments.image)
    pixels: int | Literal["all"] = "all" if arguments.all else arguments.pixels
    scenes, faults = _scenes(image, arguments.scene)
    with console.told_when_slow("computing pixels again in float64 ...", after_compiling=True):
        verification = verified(image, scenes, pixels=pixels, seed=arguments.seed)
    verification = replace(verification, faults=(*verification.faults, *faults))
    arguments.print_result(verification.stats, verification.lines)
    return DONE if verification.passed else FAILED


def _scenes(image: RecordedImage, name: str | None) -> tuple[list[Scene], list[str]]:
    """Return the scenes that the image may show, with its camera, and where the record is not what its command says. name:
    a file or a built-in scene, or None: what the header's command says. Raises InputError if there is none, or none that
    can be loaded."""
    from ..measure.verify.verify import builtin_of
    from .outputs import views_of
    from .scene import apply_options, read_scene

    record = image.record
    faults: list[str] = []
    with console.at_level(console.QUIET):
        if record.command is None and name is None:
            scenes = [builtin_of(record)]
        else:
            command = _parsed(record.command, name, image.path.parent)
            read = read_scene(command, command.scenes[0])
            scenes = [view for view, _ in views_of(apply_options(read, command), "view", command)]
            if record.command is None:  # it may show the file as it is
                scenes.insert(0, read)
            else:
                by_scene = [_command_faults(scene, record, command) for scene in scenes]
                faults = min(by_scene, key=len)
                scenes = [scene for scene, mine in zip(scenes, by_scene, strict=True) if len(mine) == len(faults)]
    camera = record.camera
    assert camera is not None
    return [replace(scene, camera=camera) for scene in scenes], faults


# The command in an image's header: what it draws, without drawing it


def _parsed(command: str | None, name: str | None, folder: Path) -> Arguments:
    """Return the options of a command that a header has, whoever wrote it: nothing but scenes is loaded by them.

    folder: where files are looked for that are not in the current one. Raises InputError for another command than `render`.
    """
    from .render import OPTIONS as RENDER

    try:
        words = shlex.split(command or "clshade render")
    except ValueError:
        words = []
    parser = Parser(prog="verify: the header's command: clshade render", add_help=False)
    add_options(parser, *RENDER["render"])
    parser.set_defaults(parser=parser)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            if words[:2] != ["clshade", "render"]:
                parser.error(f"expected clshade render ..., found {command!r}")
            arguments: Arguments = parser.parse_args(join_values(words[2:]))
            if name is None and len(arguments.scenes) != 1:
                parser.error(f"expected one scene, found {len(arguments.scenes)}")
    except SystemExit:
        raise InputError(" ".join(said.getvalue().split())) from None

    def beside(file: str | None) -> str | None:
        """Return a file's name, or its path beside the image if it exists only there."""
        if file is None or os.path.exists(file) or not os.path.exists(folder / file):
            return file
        return str(folder / file)

    arguments.scenes = [beside(arguments.scenes[0]) if name is None else name]
    arguments.texture, arguments.environment = beside(arguments.texture), beside(arguments.environment)
    return arguments


def _command_faults(scene: Scene, record: Record, arguments: Arguments) -> list[str]:
    """Return where a record's camera and settings are not those with which a command draws a scene that it made. Of settings
    that --budget and --tolerance choose nothing is known; layers may be more than the command's."""
    import numpy as np

    from ..pipeline.effective_settings import effective_settings
    from ..pipeline.frame_results import plain_value
    from .render import render_options

    options = render_options(arguments, scene)
    del options["device"]
    drawn_scene, settings = effective_settings(scene, **options)
    mine, theirs = vars(drawn_scene.camera), vars(record.camera)
    reach = max(np.abs(mine[name]).max() for name in ("eye", "lookat"))
    zeros = {"eye": reach, "lookat": reach, "up": 1.0}  # beside which a number is as good as none
    cameras = [
        name
        for name in mine
        if not np.allclose(mine[name], theirs[name], rtol=_CAMERA_ERROR, atol=_CAMERA_ERROR * zeros.get(name, 0.0))
    ]
    differences = {"camera": cameras}
    if arguments.budget is None and arguments.tolerance is None:
        values = {name: (value, getattr(record.settings, name)) for name, value in vars(settings).items()}
        differences["settings"] = [
            name for name, (a, b) in values.items() if name != "layers" and plain_value(a) != plain_value(b)
        ]
    return [
        f"{what}: the header differs from its command in {', '.join(names)}"
        for what, names in differences.items()
        if names
    ]
