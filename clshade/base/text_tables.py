"""Rows of text as tables for the terminal and CSV; and the output folder."""

from __future__ import annotations

import csv
import io
import textwrap
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from ..errors import OutputError
from .atomic_files import shown

Row = Sequence[str]
WIDTH = 100  # terminal columns that tables fit into
TIED = "\xa0"  # a non-breaking space, for `wrapped`
_GAP = "  "


def digits(value: float | None, count: int = 3) -> str:
    """Format a number with `count` significant digits; a dash for None."""
    return "-" if value is None else f"{value:.{count}g}"


def as_lines(header: Row, rows: Sequence[Row], left: int = 1) -> list[str]:
    """Return the rows with aligned columns: the first `left` to the left, the others to the right.

    No line is longer than WIDTH: the table continues below with the remaining columns, repeating the first ones.
    Texts that leave no room for others are cut in the middle.
    """
    columns = [list(column) for column in zip(header, *rows, strict=True)]
    values = [[cut(text, WIDTH // 2 - len(_GAP)) for text in column] for column in columns[left:]]
    room = WIDTH - max((len(_GAP) + max(map(len, column)) for column in values), default=0)
    names = columns[:left]
    if sum(max(map(len, column)) for column in names) + len(_GAP) * (left - 1) > room:
        names = [[cut(text, room // left - len(_GAP)) for text in column] for column in names]
    names = [_padded(column, str.ljust) for column in names]
    values = [_padded(column, str.rjust) for column in values]
    lines: list[str] = []
    while values or not lines:
        block = list(names)
        while values and sum(len(column[0]) + len(_GAP) for column in block) + len(values[0][0]) <= WIDTH:
            block.append(values.pop(0))
        lines += [_GAP.join(row).rstrip() for row in zip(*block, strict=True)]
    return lines


def _padded(column: Sequence[str], pad: Callable[[str, int], str]) -> list[str]:
    width = max(map(len, column))
    return [pad(text, width) for text in column]


def cut(text: str, width: int) -> str:
    """Return a text of at most `width` characters, a longer one with dots in its middle."""
    end = (width - 3) // 2
    return text if len(text) <= width else f"{text[: width - 3 - end]}...{text[-end:]}"


def wrapped(text: str, indent: int = 0) -> str:
    """Wrap a paragraph at WIDTH, indenting all lines but the first; words, such as paths, stay whole."""
    further = " " * indent
    lines = textwrap.wrap(text, WIDTH, subsequent_indent=further, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines).replace(TIED, " ")


def as_csv(header: Row, rows: Iterable[Row]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows((header, *rows))
    return text.getvalue()


def create_folder(path: str | Path, option: str = "--out") -> Path:
    """Create the folder if it is missing. Raises OutputError if that fails."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{shown(folder)}: {option}: expected a folder that can be made, found: {error.strerror}"
        ) from None
    return folder
