"""Fuzzing campaigns: ranges of scenes and files of some seeds, their results, and a log to resume an interrupted
run."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TextIO

from ...base import console
from ...base.atomic_files import naming, shown
from ...errors import InputError
from ...pipeline.opencl.device import Device, open_device
from . import fuzz
from .fuzz import Tally

STEP = 200  # scenes or files per line of the log: the most that a resumed run repeats


@dataclass(frozen=True)
class Range:
    """Numbers first, ..., first + count - 1 of the scenes or files of a seed."""

    what: str
    seed: int
    first: int
    count: int


@dataclass(frozen=True)
class Done:
    """A completed range and its result."""

    range: Range
    failures: tuple[str, ...]
    seconds: float
    tally: Tally


class Log:
    """The completed ranges, one line of JSON each in a file; without a file, kept for this run only.

    Raises OutputError if the file cannot be written, InputError if it was not written by a run on this device.
    """

    def __init__(self, path: str | None, device: str) -> None:
        self.path, self._device = None if path is None else Path(path), device
        self.done: dict[Range, Done] = {}
        if self.path is not None:
            with naming(self.path), self.path.open("a+b") as file:  # fails before hours of work if it is not writable
                file.seek(0)
                text = file.read().decode("utf-8", "replace")
            for number, line in enumerate(text.splitlines(), 1):
                self._read(line, f"{shown(self.path)}, line {number}")

    def _read(self, line: str, where: str) -> None:
        try:
            fields = json.loads(line)
            tally, device = Tally(**fields.pop("tally")), fields.pop("device")
            failures, seconds = tuple(map(str, fields.pop("failures"))), float(fields.pop("seconds"))
            done = Done(Range(**fields), failures, seconds, tally)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            raise InputError(
                f"fuzz: --log: expected lines that an earlier run wrote, found another in {where}"
            ) from None
        if device != self._device:
            raise InputError(f"fuzz: --log: expected a log of {self._device}, found one of {device} in {where}")
        self.done[done.range] = done

    def add(self, done: Done) -> None:
        self.done[done.range] = done
        if self.path is not None:
            fields: dict[str, Any] = asdict(done)
            line = {**fields.pop("range"), **fields, "device": self._device}
            with naming(self.path), self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")


def ranges(what: str, seeds: Sequence[int], first: int, count: int) -> Iterator[Range]:
    """Yield for each seed the numbers first to first + count - 1 in ranges of at most STEP."""
    for seed in seeds:
        for start in range(first, first + count, STEP):
            yield Range(what, seed, start, min(STEP, first + count - start))


def run(
    device: str | None = None,
    *,
    scenes: int = 1000,
    files: int = 1000,
    seed: int | Sequence[int] = 0,
    first: int = 0,
    log: str | None = None,
    stream: TextIO | None = None,
) -> bool:
    """Render scenes and load files `first`, `first` + 1, ... of each seed; print each failure as it is found, then the
    counts of each seed and the totals. Returns True if there is no failure.

    log: a file; ranges that an earlier run completed are not repeated, but counted. Raises InputError, OutputError and
    DeviceError.
    """
    stream = stream or sys.stdout
    seeds = [seed] if isinstance(seed, int) else list(seed)
    for name, value in (("scenes", scenes), ("files", files), ("seed", min(seeds, default=0)), ("first", first)):
        if value < 0:
            raise InputError(f"fuzz: --{name}: expected a whole number from 0, found {value}")
    opened = open_device(device) if scenes else None
    book = Log(log, opened.name if opened else "files")
    failed = 0
    for what, count in (("files", files), ("scenes", scenes)):
        failed += _run_one(what, seeds, first, count, book, opened, stream)
    return failed == 0


def _run_one(
    what: str, seeds: Sequence[int], first: int, count: int, book: Log, device: Device | None, stream: TextIO
) -> int:
    """Run the scenes or the files of all seeds, and return the number of failures."""
    from ...base.progress_bar import Bar
    from ...pipeline.programs import running_time

    found: list[Done] = []
    with Bar(count * len(seeds), what, clock=running_time, hidden=console.quiet() or None) as bar:
        for seed in seeds:
            mine = []
            for span in ranges(what, [seed], first, count):
                if span not in book.done:
                    book.add(_look_at(span, device, stream, bar))
                else:
                    bar.skip(span.count)
                    for failure in book.done[span].failures:
                        bar.write(failure, stream)
                mine.append(book.done[span])
            print(_summary(what, f"seed {seed}", mine), file=stream, flush=True)
            found += mine
    if len(seeds) > 1:
        print(_summary(what, f"{len(seeds)} seeds", found), file=stream)
    return sum(len(done.failures) for done in found)


def _look_at(span: Range, device: Device | None, stream: TextIO, bar: Any) -> Done:
    start, wrong, tally = time.perf_counter(), [], Tally()
    for number in range(span.first, span.first + span.count):
        if device is not None and span.what == "scenes":
            failures = fuzz.scene_failures(device, [number], span.seed, tally)
        else:
            failures = fuzz.file_failures([number], span.seed)
        for failure in failures:
            wrong.append(str(failure))
            bar.write(wrong[-1], stream)
        bar.advance()
    return Done(span, tuple(wrong), round(time.perf_counter() - start, 3), tally)


def _summary(what: str, which: str, found: Sequence[Done]) -> str:
    count, failed = sum(done.range.count for done in found), sum(len(done.failures) for done in found)
    line = f"{count} {what} ({which}): {failed} failed, {sum(done.seconds for done in found):.1f} s"
    total = sum((done.tally for done in found), Tally())
    return f"{line}; {total}" if total.pixels else line
