"""A folder of submissions, graded in parallel."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from ...base.atomic_files import shown
from ...base.input_files import file_error
from ...errors import ClshadeError
from .grade import Right, grade
from .pictures import Shot, shots
from .reading import ENDINGS


class Row(NamedTuple):
    """A submission that was graded: its facts, see `Grade.facts`, and its pictures, small."""

    facts: dict[str, Any]
    pictures: tuple[Shot, ...]


def submissions(folder: str | Path) -> list[Path]:
    """Return the image files of a folder, and of folders within it, in the order of their names: those with ENDINGS whose
    names, and folders' names, begin with no dot. Links to folders are not followed. Raises InputError for a folder that
    cannot be read."""
    found = []
    for where, folders, names in os.walk(folder, onerror=_refuse):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        found += [Path(where, name) for name in sorted(names) if not name.startswith(".")]
    return [path for path in found if path.suffix.lower() in ENDINGS]


def _refuse(error: OSError) -> None:
    raise file_error(shown(error.filename), "folder", "a readable folder", error.strerror or str(error))


def grade_all(paths: Sequence[Path], right: Right) -> Iterator[Row | str]:
    """Grade files in parallel, and yield the result of each, or in one line why it cannot be graded."""
    workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with ProcessPoolExecutor(min(workers, len(paths)), get_context("forkserver"), _keep, (right,)) as pool:
        for future in [pool.submit(_kept_one, path) for path in paths]:
            try:
                yield future.result()
            except BrokenExecutor:
                yield "a process that grades was ended, perhaps for want of memory"


_kept: list[Right] = []


def _keep(right: Right) -> None:
    """Keep the right image in a worker."""
    _kept[:] = [right]


def _kept_one(path: Path) -> Row | str:
    """Grade a file in a worker."""
    try:
        found = grade(path, _kept[0])
    except ClshadeError as error:
        return str(error).removeprefix(f"{shown(path)}: ")
    except MemoryError:
        return "expected an image that fits into memory, found none left"
    return Row(found.facts(), shots(found, _kept[0]))
