"""Conversion of command-line arguments to values, and options shared by several commands."""

from __future__ import annotations

import argparse
import math
import os
import re
import stat
from collections.abc import Iterable, Sequence
from typing import Any

from ...base.spelling import hint
from ...errors import InputError
from ...measure.defaults import PIXELS


def _parsed(kind: type, form: str) -> Any:
    """Return an option type: a number of this kind."""

    def parse(text: str) -> Any:
        try:
            return kind(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"expected {form}, found {text!r}") from None

    return parse


whole, real = _parsed(int, "a whole number"), _parsed(float, "a number")


def from_1(text: str) -> int:
    """Parse an integer above 0."""
    value: int = whole(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number from 1 on, found {text!r}")
    return value


def numbers(kind: type, count: int | None, form: str, separators: str = ",") -> Any:
    """Return an option type: `count` numbers, or any number of them, with one of the separators between them."""

    def parse(text: str) -> tuple[Any, ...]:
        try:
            values = tuple(kind(part) for part in re.split(f"[{separators}]", text)) if text else ()
        except ValueError:
            values = ()
        if not values or (count is not None and len(values) != count):
            raise argparse.ArgumentTypeError(f"expected {form}, found {text!r}")
        return values

    return parse


resolution = numbers(int, 2, "two whole numbers such as 800,600 or 800x600", ",xX×")


def color(text: str) -> str:
    """Check a color, see `images.colors.linear_rgb`, and return it as it was given."""
    from ...images.colors import linear_rgb

    try:
        linear_rgb("", "", text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix(": : ")) from None
    return text


def background(text: str) -> str:
    """Check a background: a color, `none`, `scene` or `environment`."""
    return text if text in ("none", "scene", "environment") else color(text)


def names(allowed: Sequence[str], **others: Any) -> Any:
    """Return an option type: names separated by commas. others: further names known to `spelling.hint`."""

    def parse(text: str) -> tuple[str, ...]:
        values = tuple(part.strip() for part in text.split(",") if part.strip())
        for value in values or ("",):
            if value not in allowed:
                near = hint(value, allowed, **others)
                raise argparse.ArgumentTypeError(f"expected names of {', '.join(allowed)}, found {value!r}{near}")
        return values

    return parse


def milliseconds(text: str) -> float:
    """Parse a time such as 5ms, 0.005s, 200us or 5 (milliseconds)."""
    found = re.fullmatch(r"\s*([0-9.]+(?:e[+-]?[0-9]+)?)\s*(s|ms|us|)\s*", text, re.IGNORECASE)
    scale = {"s": 1e3, "ms": 1.0, "us": 1e-3, "": 1.0}
    return _above_0(found and found[1], text, "a time above 0 such as 5ms or 0.005s") * scale[found[2].lower()]  # type: ignore[index]


def tolerance(text: str) -> float:
    """Parse an error above 0."""
    return _above_0(text, text, "an error above 0 such as 1e-3")


def _above_0(number: str | None, text: str, form: str) -> float:
    try:
        value = float(number or "")
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"expected {form}, found {text!r}")
    return value


def seconds(text: str) -> float:
    """Parse a time in seconds, above 0."""
    return _above_0(text, text, "seconds above 0 such as 30")


def limit_options(group: argparse._ArgumentGroup) -> None:
    """Add --budget and --tolerance, which are mutually exclusive."""
    either = group.add_mutually_exclusive_group()
    either.add_argument(
        "--budget",
        type=milliseconds,
        metavar="TIME",
        help="the most accurate variant within 5ms, 0.005s or 5 (ms) a frame",
    )
    either.add_argument(
        "--tolerance", type=tolerance, metavar="RMSE", help="the fastest variant with at most this error, such as 1e-3"
    )


def given_options(arguments: argparse.Namespace, names: Iterable[str]) -> list[str]:
    """Return those of these options that were given, as arguments of a command."""
    from ...base.declare import as_option

    given = {name: getattr(arguments, name) for name in names}
    return [as_option(name, value) for name, value in given.items() if value != arguments.parser.get_default(name)]


def refuse(arguments: argparse.Namespace, names: Iterable[str], why: str) -> None:
    """Raise InputError for the first of these options that was given. why: what it needs, or cannot go with."""
    for name in names:
        value = getattr(arguments, name, None)
        if value != arguments.parser.get_default(name):
            raise InputError(f"--{'no-' * (value is False)}{name.replace('_', '-')}: {why}")


def device_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--device",
        help="pocl, intel, nvidia, rusticl, part of a platform's name, or P:D (default: CLSHADE_DEVICE, PoCL)",
    )


def output_name(text: str) -> str:
    """Validate an output name.

    It must not be empty, which would become the default or `.exr`, nor a device, pipe or socket, beside which files
    would appear: `/dev/null` would become /dev/null.exr.
    """
    if not text:
        raise argparse.ArgumentTypeError("expected the name of a file or folder, found ''")
    try:
        mode = os.stat(text).st_mode
    except (OSError, ValueError):  # does not exist, or fails when written
        return text
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        found = f"{text!r}, a device, pipe or socket"
        raise argparse.ArgumentTypeError(f"expected the name of a file or folder, found {found}")
    return text


def check_picture(output: str, inputs: Sequence[str]) -> None:
    """Check the name of an output image, see `check_output_file`."""
    check_output_file(output, inputs, (".png",))


def check_output_file(output: str, inputs: Sequence[str], endings: Sequence[str], option: str = "--output") -> None:
    """Refuse, before anything is read, an output file that cannot be written, has none of the endings, or would
    overwrite one of the input files."""
    from ...base import atomic_files

    if os.path.splitext(output)[1].lower() not in endings:
        expected = f"a file name that ends in {' or '.join(endings)}"
        raise InputError(f"{option}: expected {expected}, found {atomic_files.shown(output)}")
    atomic_files.check(output)
    for name in inputs:
        if os.path.exists(output) and os.path.exists(name) and os.path.samefile(output, name):
            raise InputError(f"{option}: {atomic_files.shown(output)} is read: choose another file")


def with_values(arguments: Sequence[str]) -> list[str]:
    """Join options with values that argparse would misread.

    `--up -x` becomes `--up=-x`, and `--camera-position -1,2,3` likewise: argparse takes any argument that begins with a
    dash and is not a single number for an option. `--check SCENE` becomes `--check=4096 SCENE`, unless it is a number.
    """
    joined: list[str] = []
    for argument in arguments:
        if (
            joined
            and joined[-1] == "--check"
            and not (argument == "all" or argument.startswith("-") or _is_number(argument))
        ):
            joined[-1] = f"--check={PIXELS}"  # the next argument is the scene
            joined.append(argument)
        elif joined and re.fullmatch(r"-([xyz]|\.?\d.*)", argument) and re.fullmatch(r"--[a-z-]+", joined[-1]):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
