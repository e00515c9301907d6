"""`inspect`, `compare` and `coco`: what images hold."""

from __future__ import annotations

import os
from argparse import ArgumentParser
from typing import TYPE_CHECKING, Any

from ..base import atomic_files, console
from ..errors import InputError
from . import DONE, FAILED
from .options import (
    Arguments,
    Option,
    add_options,
    check_output_file,
    check_scene_name,
    is_scene,
    number_from,
    numbers,
    output_name,
)

if TYPE_CHECKING:
    from ..images.compare import Comparison
    from ..images.image_file import Picture


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


def add_inspect_options(parser: ArgumentParser) -> None:
    add_options(parser, Inspect)


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


def add_compare_options(parser: ArgumentParser) -> None:
    add_options(parser, Compare)


def run_compare(arguments: Arguments) -> int:
    from ..images import compare
    from ..images.image_file import read_picture
    from ..images.metrics import has_flip, has_ssim

    if arguments.output:
        check_output_file(arguments.output, (arguments.image, arguments.reference), (".png",))
    image, reference = read_picture(arguments.image), read_picture(arguments.reference)
    difference = compare.compared(image, reference, arguments.layer, arguments.threshold)
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
        _save_figure(_comparison_figure(image, reference, difference, arguments.layer), arguments.output)
    return DONE if difference.passed else FAILED


def _comparison_figure(image: Picture, reference: Picture, difference: Comparison, names: list[str]) -> Any:
    from ..images import compare, compare_figure

    layers = compare.chosen_layers(image, reference, names)
    if len(layers) > compare_figure.MAX_LAYERS:
        different_first = sorted(layers, key=lambda name: not difference.layers[name].different)
        layers = {name: layers[name] for name in different_first[: compare_figure.MAX_LAYERS]}
    clusters = {name: difference.layers[name].clusters for name in layers}
    titles = (image.name, reference.name)
    return compare_figure.draw(layers, encoded=bool(image.bits), titles=titles, clusters=clusters)


class Coco:
    files = Option("files FILE: EXR files rendered with --layers instance_id,object_id", nargs="+")
    output = Option("-o, --output JSON: the data set", output_name, "annotations.json")


def add_coco_options(parser: ArgumentParser) -> None:
    add_options(parser, Coco)


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
