"""`stability --functions`: the functions of one number that kernels and tone maps are made of, for every float32."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TextIO, get_args

import numpy as np

from ...base import atomic_files, console, text_tables
from ...base.arrays import Array, Floats, Floats32, Integers
from ...base.atomic_files import shown
from ...base.json_values import plain
from ...base.progress_bar import Bar
from ...base.text_tables import digits
from ...images.joint_tonemaps import JOINT
from ...images.tonemap import OPERATORS, Operator, display_values, mapped
from ...pipeline.buffers import Buffer
from ...pipeline.features import Features
from ...pipeline.opencl.device import Device
from ...pipeline.programs import build_text
from ...scene.settings import Precision
from .stability import devices

CHUNK = 1 << 22  # numbers at a time
EDGES = (0.5, 1.0, 2.0, 16.0)  # of the histogram, ulp
BLACK, WHITE = 2.0**-16, 2.0**16  # below and from which on every tone map has its first or last code
PRECISIONS = tuple(name for name in get_args(Precision) if name != "float64")  # no computer tries all of float64
HEADER = ("function", "precision", "inputs", "largest", "at", *(f"% to {e:g} ulp" for e in EDGES), "G/s")
ABOUT = (
    "Every float32 of the domain; largest: error in units in the last place of the exact result, ! where more than is "
    "allowed; at: the first input that has it; % to 0.5 ulp, ...: share of the inputs with no larger error; G/s: 1e9 "
    "numbers a second, of the kernel. Tone maps: the error in 8-bit codes against the formula in float64, for every float32."
)
FILES = ("functions.csv", "functions.json", "functions.md")
TEXT = """
#include "numerics.clh"
#define FUNCTION(name, call)                                                             \\
    kernel void name(uint first, global float *out)                                      \\
    {                                                                                    \\
        uint at = get_global_id(0) * LANES;                                              \\
        reals x = AS_REALS((ints)((int)(first + at)) + LANE_INDEX), y;                   \\
        call(&y, &x, 1);                                                                 \\
        STORE_LANES(y, out + at);                                                        \\
    }
#define ROOT(y, x, many) *(y) = sqrt(*(x))
#define RECIPROCAL(y, x, many) *(y) = 1.0f / *(x)
FUNCTION(reciprocal_root, reciprocal_sqrt_each)
FUNCTION(log2_one_minus, log2_one_minus_each)
FUNCTION(exp2_negative, exp2_negative_each)
FUNCTION(root, ROOT)
FUNCTION(reciprocal, RECIPROCAL)
"""


@dataclass(frozen=True)
class Function:
    """A function of kernels. kernel: in TEXT. first, last: its domain, both included, of one sign. exact: of float64.
    allowed: largest error in ulp, by precision: as kernels/numerics.clh and its tests say."""

    name: str
    kernel: str
    first: float
    last: float
    exact: Callable[[Floats], Floats]
    allowed: dict[Precision, float]

    @property
    def chunks(self) -> range:
        """The bit patterns that chunks begin with."""
        low, high = sorted(int(np.float32(end).view(np.uint32)) for end in (self.first, self.last))
        return range(low, high + 1, CHUNK)


def _log2_one_minus(t: Floats) -> Floats:
    found: Floats = np.log1p(-t) / np.log(2.0)
    return found


LARGEST = float(np.finfo(np.float32).max)
FUNCTIONS = (
    Function(
        "1/sqrt(x)", "reciprocal_root", 2.0**-100, 2.0**126, lambda x: 1.0 / np.sqrt(x), {"float32": 2.0, "fast": 80.0}
    ),
    Function(
        "log2(1 - t)",
        "log2_one_minus",
        2.0**-126,
        float(np.nextafter(np.float32(1.0), np.float32(0.0))),
        _log2_one_minus,
        {"float32": 6.0, "fast": 130.0},
    ),
    Function("2^y", "exp2_negative", -(2.0**-126), -100.0, np.exp2, {"float32": 1.6, "fast": 107.0}),
    Function("sqrt(x)", "root", 2.0**-126, LARGEST, np.sqrt, {"float32": 0.5}),
    Function("1/x", "reciprocal", 2.0**-126, 2.0**126, lambda x: 1.0 / x, {"float32": 0.5}),
)


@dataclass(frozen=True)
class Histogram:
    """Errors of a function. inputs: how many. largest: in ulp or codes; at: the first input that has it, None without any
    error. within: how many inputs have errors up to each of EDGES. rate: numbers per second; None of tone maps."""

    name: str
    precision: str
    inputs: int
    largest: float
    at: float | None
    within: tuple[int, ...]
    allowed: float
    rate: float | None = None

    @property
    def passed(self) -> bool:
        return self.largest <= self.allowed

    def row(self) -> text_tables.Row:
        shares = (f"{100.0 * count / max(self.inputs, 1):.4g}" for count in self.within)
        largest = f"{digits(self.largest)}{'' if self.passed else ' !'} of {self.allowed:g}"
        ends = (f"{self.inputs:,}", largest, digits(self.at, 9), *shares)
        return (self.name, self.precision, *ends, "-" if self.rate is None else digits(self.rate / 1e9))


def histogram(name: str, precision: str, allowed: float, parts: Iterator[tuple[Floats32, Array]]) -> Histogram:
    """Return the histogram of parts: inputs and their errors, (N,) each; an error that is NaN counts as infinite."""
    inputs, largest, within = 0, 0.0, np.zeros(len(EDGES), np.int64)
    at: float | None = None
    for x, error in parts:
        worst = int(np.argmax(error))
        if np.isnan(error[worst]) or error[worst] > largest:
            largest, at = float(np.nan_to_num(error[worst], nan=np.inf)), float(x[worst])
        inputs += len(x)
        within += [int(np.count_nonzero(error <= edge)) for edge in EDGES]
    return Histogram(name, precision, inputs, largest, at, tuple(within.tolist()), allowed)


class Kernels:
    """The functions on a device in one precision, called by one thread at a time."""

    def __init__(self, device: Device, precision: Precision) -> None:
        self._program = build_text(device, Features.of(["FAST"] if precision == "fast" else []), TEXT)
        self._queue, self._items = device.queue, CHUNK // self._program.lanes
        self._out, self._lock = Buffer.empty(device, (CHUNK,), np.float32), threading.Lock()
        self.seconds = 0.0

    def __call__(self, name: str, first: int) -> Floats32:
        """Return the function of the CHUNK bit patterns from `first` on."""
        with self._lock:
            event = self._program[name](self._queue, (self._items,), None, np.uint32(first), self._out.memory)
            found: Floats32 = self._out.to_host().copy()
            self.seconds += (event.profile.end - event.profile.start) / 1e9
        return found


def _chunk(function: Function, kernels: Kernels, first: int) -> tuple[Floats32, Floats]:
    """Return the inputs of one chunk and the errors of the function in ulp."""
    bits = np.arange(first, min(first + CHUNK, function.chunks.stop), dtype=np.uint32)
    x, found = bits.view(np.float32), kernels(function.kernel, first)[: len(bits)]
    expected = function.exact(x.astype(np.float64))
    with np.errstate(invalid="ignore", over="ignore"):
        return x, np.abs(found - expected) / np.spacing(np.abs(expected).astype(np.float32))


def of_function(function: Function, kernels: Kernels, precision: Precision, firsts: Sequence[int]) -> Histogram:
    """Return the errors of a function for the chunks that begin with these bit patterns."""
    kernels.seconds = 0.0
    parts = _in_threads(partial(_chunk, function, kernels), firsts)
    found = histogram(function.name, precision, function.allowed[precision], parts)
    return Histogram(**{**vars(found), "rate": CHUNK * len(firsts) / max(kernels.seconds, 1e-9)})


def _codes(operator: Operator, first: int) -> tuple[Floats32, Integers]:
    """Return the inputs of one chunk and the errors of a tone map's codes."""
    x = np.arange(first, first + CHUNK, dtype=np.uint32).view(np.float32)
    expected: Array = np.zeros(1, np.int16)  # also of NaN and of negative numbers
    if BLACK <= x[0] < WHITE:  # a chunk has one exponent: all of it is
        expected = np.floor(255.0 * display_values(x, operator) + 0.5).astype(np.int16)
    elif x[0] >= WHITE:
        expected = np.where(np.isnan(x), 0, 255).astype(np.int16)
    return x, np.abs(mapped(x, operator, 0.0) - expected)


def of_tonemap(operator: Operator, firsts: Sequence[int]) -> Histogram:
    """Return the errors of a tone map for the chunks that begin with these bit patterns."""
    return histogram(f"tone map {operator}", "8 bit", 0.0, _in_threads(partial(_codes, operator), firsts))


def _in_threads(work: Callable[[int], Any], firsts: Sequence[int]) -> Iterator[Any]:
    """Yield the work on each of these, in order, by a few threads: a few are at work at a time, as memory allows."""
    with (
        Bar(len(firsts), "functions", clock=time.perf_counter, hidden=console.quiet() or None) as bar,
        ThreadPoolExecutor(os.cpu_count()) as pool,
    ):
        waiting: list[Any] = []
        for first in firsts:
            waiting.append(pool.submit(work, first))
            if len(waiting) > 2 * (os.cpu_count() or 1):
                yield waiting.pop(0).result()
                bar.advance()
        for each in waiting:
            yield each.result()
            bar.advance()


def measure(device: Device, every: int = 1) -> Iterator[Histogram]:
    """Yield the errors of all functions on a device. every: of so many chunks one is measured."""
    for precision in PRECISIONS:
        kernels = Kernels(device, precision)
        for function in FUNCTIONS:
            if precision in function.allowed:
                yield of_function(function, kernels, precision, function.chunks[::every])


def tone_maps(every: int = 1) -> Iterator[Histogram]:
    """Yield the errors of all tone maps of single channels. every: as of `measure`."""
    for operator in OPERATORS:
        if operator not in JOINT:
            yield of_tonemap(operator, range(0, 1 << 32, CHUNK)[::every])


def run(
    device: str | None = None, *, out: str | Path = "stability", every: int = 1, stream: TextIO | None = None
) -> bool:
    """Measure all functions, print the tables, and write FILES. Returns True if no error is above what is allowed.

    device: a name, or `all`. every: as of `measure`. Raises DeviceError and OutputError.
    """
    stream = stream or sys.stdout
    opened = devices(device)
    folder = text_tables.create_folder(out)
    paths = [folder / name for name in FILES]
    for path in paths:
        atomic_files.check(path)
    found = [(each.title, list(measure(each, every))) for each in opened]
    found.append(("NumPy", list(tone_maps(every))))
    markdown: list[str] = []
    for title, histograms in found:
        rows = [each.row() for each in histograms]
        print("\n".join(["", title, *text_tables.as_lines(HEADER, rows, left=2)]), file=stream)
        markdown += ["", f"## {title}", "", *text_tables.as_markdown(HEADER, rows)]
    print("\n".join(["", text_tables.wrapped(ABOUT, 2)]), file=stream)
    rows = [(title, *each.row()) for title, histograms in found for each in histograms]
    figures = plain(
        [{"device": title, "functions": [vars(each) for each in histograms]} for title, histograms in found]
    )
    texts = (text_tables.as_csv(("device", *HEADER), rows), json.dumps(figures, indent=2) + "\n")
    for path, text in zip(paths, (*texts, "\n".join([ABOUT, *markdown, ""])), strict=True):
        atomic_files.write_bytes(path, text.encode())
        print(f"wrote {shown(path)}", file=stream)
    return all(each.passed for _, histograms in found for each in histograms)
