"""Texts of the command line to values; what several commands take."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any

CHECKED = 4096  # pixels of --check


def numbers(kind: type, count: int | None, form: str) -> Any:
    def parse(text: str) -> tuple:
        try:
            values = tuple(kind(part) for part in text.split(",")) if text else ()
        except ValueError:
            values = ()
        if not values or (count is not None and len(values) != count):
            raise argparse.ArgumentTypeError(f"expected {form}, found {text!r}")
        return values

    return parse


def names(allowed: Sequence[str]) -> Any:
    def parse(text: str) -> tuple[str, ...]:
        values = tuple(part.strip() for part in text.split(",") if part.strip())
        for value in values:
            if value not in allowed:
                raise argparse.ArgumentTypeError(f"expected names of {', '.join(allowed)}, found {value!r}")
        return values

    return parse


def device_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--device",
        help="pocl, intel, nvidia, rusticl, part of a platform's name, or P:D (default: CLSHADE_DEVICE, PoCL)",
    )


def with_values(arguments: Sequence[str]) -> list[str]:
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
