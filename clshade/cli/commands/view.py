"""`view`."""

from __future__ import annotations

import argparse

from . import DONE
from .live_view import live_options, run_live
from .scene_options import scene_options


def add_options(parser: argparse.ArgumentParser) -> None:
    scene_options(parser)
    live_options(parser)


def run(arguments: argparse.Namespace) -> int:
    run_live(arguments)
    return DONE
