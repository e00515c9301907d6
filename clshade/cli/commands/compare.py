"""`compare`: the difference of two images."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from . import DONE, FAILED
from .arguments import check_picture, output_name

if TYPE_CHECKING:
    from ...images.compare import Comparison


def _threshold(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"expected an error of 0 or more such as 1e-3, found {text!r}")
    return value


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("image", metavar="A", help="an EXR or PNG")
    parser.add_argument("reference", metavar="B", help="what it should be; relMSE and FLIP are relative to it")
    parser.add_argument(
        "--layer",
        action="append",
        default=[],
        metavar="NAME",
        help="this one only, such as RGB, Z or N.X; may be given again",
    )
    parser.add_argument(
        "--threshold",
        type=_threshold,
        metavar="X",
        help="exit with 1 if any channel of any pixel is off by more than X, in the channel's units (PNG: from 0 to 1), "
        "is NaN or infinite in one image alone, if any whole number differs, or if one image alone has a layer "
        "(default: exit with 0)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=output_name,
        metavar="PNG",
        help="write a picture of both images and their difference, layer by layer, and magnified where they differ most; "
        "of the first 40 layers that differ",
    )
    parser.add_argument("--json", action="store_true", help="print all figures as JSON; an infinite PSNR is null")


def run(arguments: argparse.Namespace) -> int:
    from ...base import atomic_files, console
    from ...images import compare
    from ...images.image_file import read_picture

    if arguments.output:
        check_picture(arguments.output, (arguments.image, arguments.reference))
    image, reference = read_picture(arguments.image), read_picture(arguments.reference)
    found = compare.compared(image, reference, arguments.layer, arguments.threshold)
    if found.lacking():
        console.warning(f"not compared: {'; '.join(found.lacking())}")
    _print(found, arguments)
    if arguments.output:
        from ...images import compare_figure, figures

        layers = compare.chosen_layers(image, reference, arguments.layer)
        different_first = sorted(layers, key=lambda name: not found.layers[name].different)
        if len(layers) > compare_figure.MOST:
            layers = {name: layers[name] for name in different_first[: compare_figure.MOST]}
        clusters = {name: found.layers[name].clusters for name in layers}
        titles = (image.name, reference.name)
        figure = compare_figure.draw(layers, encoded=bool(image.bits), titles=titles, clusters=clusters)
        figures.save(figure, arguments.output)
        console.progress(f"wrote {atomic_files.shown(arguments.output)}")
    return DONE if found.passed else FAILED


def _print(found: Comparison, arguments: argparse.Namespace) -> None:
    if arguments.json:
        import json

        print(json.dumps({"image": arguments.image, "reference": arguments.reference, **found.stats()}, indent=2))
        return
    from ...base import console
    from ...images.metrics import has_flip, has_ssim

    print("\n".join(found.lines()))
    packages = ("SSIM", has_ssim(), "scikit-image"), ("FLIP", has_flip(), "flip-evaluator")
    for name, there, package in packages:
        if not there:
            console.detail(f"{name}: pip install {package}")
