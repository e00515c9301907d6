"""A folder of submissions, graded in parallel."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from ...base.atomic_files import shown
from ...base.input_files import file_error
from ...errors import ClshadeError
from . import pictures
from .grade import Right, grade
from .reading import ENDINGS


class Row(NamedTuple):
    """A submission. facts: see `Grade.facts`, `image` being its name in the folder; of one that cannot be graded beside that
    only `error`, one line. picture: see `pictures.draw`, a PNG, if there is one."""

    facts: dict[str, Any]
    picture: bytes = b""


def submissions(folder: str | Path) -> list[str]:
    """Return the names in a folder of its image files, and of those in folders within it, in order: those with ENDINGS whose
    names, and folders' names, begin with no dot. Links to folders are not followed. Raises InputError for a folder that
    cannot be read."""
    paths = []
    for where, folders, names in os.walk(folder, onerror=_refuse):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        paths += [os.path.relpath(Path(where, name), folder) for name in sorted(names) if not name.startswith(".")]
    return [name for name in paths if name.lower().endswith(ENDINGS)]


def _refuse(error: OSError) -> None:
    raise file_error(shown(error.filename), "folder", "a readable folder", error.strerror or str(error))


def grade_all(folder: str | Path, names: list[str], right: Right, drawn: bool = False) -> Iterator[Row]:
    """Grade files of a folder in parallel. drawn: whether their pictures are wanted."""
    workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with ProcessPoolExecutor(min(workers, len(names)), get_context("forkserver"), _keep, (right, drawn)) as pool:
        for name, future in [(name, pool.submit(_row, Path(folder, name), shown(name))) for name in names]:
            try:
                yield future.result()
            except BrokenExecutor:
                yield _failed(shown(name), "a process that grades was ended, perhaps for want of memory")


_kept: list[tuple[Right, bool]] = []


def _keep(right: Right, drawn: bool) -> None:
    """Keep the right image in a worker."""
    _kept[:] = [(right, drawn)]


def _failed(name: str, error: str) -> Row:
    return Row({"image": name, "error": error})


def _row(path: Path, name: str) -> Row:
    """Grade a file in a worker."""
    right, drawn = _kept[0]
    try:
        result = grade(path, right)
        return Row({**result.facts(), "image": name}, pictures.as_png(result, right) if drawn else b"")
    except ClshadeError as error:
        return _failed(name, str(error).removeprefix(f"{shown(path)}: "))
    except MemoryError:
        return _failed(name, "expected an image that fits into memory, found none left")
