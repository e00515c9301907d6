"""`devices`: the OpenCL devices found, and whether they work."""

from __future__ import annotations

import argparse

from . import DONE, FAILED


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print a list of all figures as JSON; memory in bytes")


def run(arguments: argparse.Namespace) -> int:
    from ...pipeline.opencl import device

    infos = device.list_devices()
    if arguments.json:
        import json
        from dataclasses import asdict

        print(json.dumps([asdict(info) for info in infos], indent=2))
    else:
        from ...base import text_tables

        print("\n".join(text_tables.wrapped(line, 5) for line in device.format_devices(infos).splitlines()))
    return DONE if any(info.works for info in infos) else FAILED
