"""Rows of texts as a table for the terminal, as CSV and as Markdown; and the folder that files go to."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from ..errors import OutputError

Row = Sequence[str]


def digits(value: float | None, count: int = 3) -> str:
    """A number with so many digits; a dash for none."""
    return "-" if value is None else f"{value:.{count}g}"


def as_lines(header: Row, rows: Sequence[Row], left: int = 1) -> list[str]:
    """The rows with columns of equal width; the first `left` are aligned to the left, the others to the right."""
    widths = [max(len(row[k]) for row in (header, *rows)) for k in range(len(header))]
    sides = [str.ljust if k < left else str.rjust for k in range(len(header))]
    cells = (
        (side(text, width) for side, text, width in zip(sides, row, widths, strict=True)) for row in (header, *rows)
    )
    return ["  ".join(row).rstrip() for row in cells]


def as_csv(header: Row, rows: Iterable[Row]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows((header, *rows))
    return text.getvalue()


def as_markdown(header: Row, rows: Iterable[Row]) -> list[str]:
    """Lines; vertical bars inside of texts are escaped."""
    body = (f"| {' | '.join(text.replace('|', chr(92) + '|') for text in row)} |" for row in (header, *rows))
    first, *others = body
    return [first, "| --- " * len(header) + "|", *others]


def made_folder(path: str | Path, option: str = "--out") -> Path:
    """The folder, made where there is none. Raises OutputError where it cannot be."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: {option}: expected a folder that can be made, found: {error.strerror}") from None
    return folder
