"""`coco`: masks of the instances in rendered images as a COCO data set."""

from __future__ import annotations

import argparse
import json
import os

from . import DONE
from .arguments import check_output_file, output_name


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files", metavar="FILE", nargs="+", help="EXR files rendered with --layers instance_id,object_id"
    )
    parser.add_argument(
        "-o", "--output", type=output_name, default="annotations.json", metavar="JSON", help="(default: %(default)s)"
    )


def run(arguments: argparse.Namespace) -> int:
    from ...base import atomic_files
    from ...images.coco import data_set

    check_output_file(arguments.output, arguments.files, (".json",))
    found = data_set(arguments.files, os.path.dirname(arguments.output) or ".")
    with atomic_files.replacing(arguments.output) as file:
        file.write(json.dumps(found, ensure_ascii=False).encode("utf-8", "backslashreplace"))  # as JSON escapes
    parts = (("images", "image"), ("annotations", "annotation"), ("categories", "category"))
    counts = ((len(found[several]), one, several) for several, one in parts)
    counted = ", ".join(f"{count} {one if count == 1 else several}" for count, one, several in counts)
    print(f"wrote {atomic_files.shown(arguments.output)}: {counted}")
    return DONE
