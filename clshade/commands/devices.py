"""`devices`: what was found, and what works."""

from __future__ import annotations

import argparse

from . import DONE, FAILED


def add_options(parser: argparse.ArgumentParser) -> None:
    """There are none."""


def run(arguments: argparse.Namespace) -> int:
    from .. import device

    infos = device.list_devices()
    print(device.format_devices(infos))
    return DONE if any(info.works for info in infos) else FAILED
