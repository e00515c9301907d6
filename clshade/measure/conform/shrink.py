"""The smallest input and the shortest text with which a case still fails."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ...base.arrays import Array
from ...errors import DeviceError
from .case import PRAGMA, Bench, Case, Wrong

SECONDS = 40.0  # for one failure
DIGITS = (1, 2, 4, 8, 12, 16, 20, 24, 32, 40, 48)  # significant bits of simpler reals


class _Attempts:
    """Cases that are tried until the time is over; the last that failed."""

    def __init__(self, bench: Bench, wrong: Wrong, seconds: float) -> None:
        self.bench, self.wrong, self._end = bench, wrong, time.perf_counter() + seconds

    def fails(self, case: Case) -> bool:
        """Whether a case fails too; it is the smallest so far then."""
        if time.perf_counter() > self._end or not (case.allowed is None or case.allowed(*case.inputs).all()):
            return False
        try:
            found = self.bench.wrong(case)
        except (DeviceError, IndexError, ValueError, OverflowError):  # the kernel or the definition does not take it
            return False
        self.wrong = found or self.wrong
        return found is not None


def smallest(bench: Bench, wrong: Wrong, seconds: float = SECONDS) -> Wrong:
    """Return a smaller case that fails: one expression, fewest rows, simplest values, and only the lines of text that it
    needs. seconds: the time after which the smallest so far is returned."""
    attempts = _Attempts(bench, wrong, seconds)
    if wrong.case.alone is not None:
        attempts.fails(wrong.case.alone(wrong.column))
    if not wrong.case.needs_group:
        attempts.fails(replace(attempts.wrong.case, group=1))
    if attempts.wrong.case.grid is None:
        _fewer_rows(attempts)
        _simpler_values(attempts)
    if attempts.wrong.case.head:
        _shorter_text(attempts)
    return attempts.wrong


def _fewer_rows(attempts: _Attempts) -> None:
    case, unit = attempts.wrong.case, attempts.wrong.case.rows
    row = int(np.flatnonzero(attempts.wrong.rows)[0])
    block = row // unit * unit
    if attempts.fails(case.with_inputs([np.repeat(v[row : row + 1], unit, axis=0) for v in case.inputs])):
        return
    if attempts.fails(case.with_inputs([v[block : block + unit] for v in case.inputs])):
        return
    count = len(case.inputs[0]) // unit // 2
    while count:
        kept = [v[: count * unit] for v in attempts.wrong.case.inputs]
        if not attempts.fails(case.with_inputs(kept)):
            return
        count //= 2


def _simpler_values(attempts: _Attempts) -> None:
    for k in range(len(attempts.wrong.case.inputs)):
        for simpler in _simpler(attempts.wrong.case.inputs[k]):
            inputs = list(attempts.wrong.case.inputs)
            inputs[k] = simpler
            if attempts.fails(attempts.wrong.case.with_inputs(inputs)):
                break


def _simpler(v: Array) -> Iterator[Array]:
    """Yield simpler arrays of the same shape: 1, 2, 3, and for reals the same numbers with fewer digits."""
    yield from (np.full_like(v, value) for value in (1, 2, 3))
    if v.dtype.kind == "f":
        mantissa, exponent = np.frexp(v)
        for digits in DIGITS:
            with np.errstate(all="ignore"):
                yield np.ldexp(np.trunc(np.ldexp(mantissa, digits)), exponent - digits).astype(v.dtype)


# Text


def _shorter_text(attempts: _Attempts) -> None:
    """Leave out lines before the kernel, as long as what it writes is wrong in the same way."""
    case, found = attempts.wrong.case, attempts.wrong.found
    try:
        repeats = attempts.bench.run(case).tobytes() == found.tobytes()
    except DeviceError:
        return

    def fails(lines: list[str]) -> bool:
        shorter = replace(case, head="\n".join([*lines, ""]))
        before = attempts.wrong
        if attempts.fails(shorter) and not (repeats and attempts.wrong.found.tobytes() != found.tobytes()):
            return True
        attempts.wrong = before
        return False

    kept = units(case.source.removeprefix(PRAGMA).removesuffix(case.text))
    used = reachable(kept, case.text)
    kept = used if fails(used) else kept
    if kept is used or fails(kept):
        fewer(kept, fails)


def units(text: str) -> list[str]:
    """Return the parts of a text that can be left out: directives, and whole functions, structs and other declarations;
    without comments and #line."""
    joined = re.sub(r"\\\n\s*", " ", re.sub(r"//.*", "", text))
    found: list[str] = []
    depth = 0
    for line in joined.splitlines():
        line = re.sub(r"[ \t]+", " ", line).rstrip()
        directive = line.lstrip().startswith("#")
        if not line.strip() or line.startswith("#line"):
            continue
        begun = (
            bool(found)
            and not found[-1].lstrip().startswith("#")
            and not re.search(r"[;}]$|^[A-Z_]+\(.*\)$", found[-1])
        )
        if found and not directive and (depth or begun):
            found[-1] += f"\n{line}"
        else:
            found.append(line)
        depth += 0 if directive else line.count("{") - line.count("}")
    return found


def reachable(found: list[str], text: str) -> list[str]:
    """Return the units whose names the text uses, and what these use, with all conditionals."""
    words = set(re.findall(r"\w+", text))
    kept: set[int] = set()
    while True:
        more = {k for k, unit in enumerate(found) if k not in kept and (_names(unit) & words or _stays(unit))}
        if not more:
            return [found[k] for k in sorted(kept)]
        kept |= more
        words.update(*(re.findall(r"\w+", found[k]) for k in more if not _stays(found[k])))


def _stays(unit: str) -> bool:
    return re.match(r"\s*#\s*(if|el|endif|pragma)", unit) is not None


def _names(unit: str) -> set[str]:
    """Return the names that a unit defines; those of a macro that makes functions are the words it is given."""
    directive = re.match(r"\s*#\s*(?:define|undef)\s+(\w+)", unit)
    if directive:
        return {directive[1]}
    head = unit.split("{")[0]
    made = re.match(r"([A-Z_]+)\(", unit)
    ends = re.findall(r"(\w+)\s*(?:\[\w*\])?;\s*$", unit) if unit.startswith(("typedef", "constant")) else []
    return {
        *re.findall(r"(\w+)\s*\(", head),
        *ends,
        *re.findall(r"constant \w+ (\w+)", unit),
        *([made[1]] if made else []),
    }


def fewer(lines: list[str], fails: Callable[[list[str]], bool]) -> list[str]:
    """Return the fewest lines that still fail, found by leaving out conditionals, then halves, quarters, ... of the rest."""
    for _ in range(2):
        lines = _without_conditionals(lines, fails)
        size = len(lines) // 2
        while size:
            start = 0
            while start < len(lines):
                rest = lines[:start] + lines[start + size :]
                if fails(rest):
                    lines = rest
                else:
                    start += size
            size //= 2
    return lines


def _without_conditionals(lines: list[str], fails: Callable[[list[str]], bool]) -> list[str]:
    """Leave out whole blocks from #if to #endif, or else only the directives and one branch."""
    start = 0
    while start < len(lines):
        end = _end_of(lines, start)
        if end is None:
            start += 1
            continue
        marks = [start, *_branches(lines, start, end), end]
        bodies = [lines[a + 1 : b] for a, b in pairwise(marks)]
        for body in ([], *bodies):
            if fails(lines[:start] + body + lines[end + 1 :]):
                lines = lines[:start] + body + lines[end + 1 :]
                break
        else:
            start += 1
    return lines


def _end_of(lines: list[str], start: int) -> int | None:
    """Return the line of the #endif of a conditional that begins at `start`; None if none does."""
    if not lines[start].lstrip().startswith("#if"):
        return None
    depth = 0
    for k in range(start, len(lines)):
        depth += lines[k].lstrip().startswith("#if") - lines[k].lstrip().startswith("#endif")
        if depth == 0:
            return k
    return None


def _branches(lines: list[str], start: int, end: int) -> list[int]:
    """Return the lines of the #else and #elif of a conditional."""
    depth, found = 0, []
    for k in range(start, end):
        word = lines[k].lstrip()
        depth += word.startswith("#if") - word.startswith("#endif")
        if depth == 1 and word.startswith("#el"):
            found.append(k)
    return found
