"""A kernel with its input and what it has to write, and the bench on which it runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...base.arrays import Array, Bools
from ...pipeline import bare_kernel, programs
from ...pipeline.bare_kernel import Grid
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene.model import Scene
from ..digest import digest

GROUP = 64  # rows of a work-group
UNWRITTEN = 0xA5  # the bytes of an output before the kernel runs
PRAGMA = "#pragma OPENCL FP_CONTRACT OFF\n"


@dataclass(frozen=True, eq=False)
class Case:
    """A kernel, K rows of input, and a definition of the K rows of output.

    name: of the kernel too. head: OpenCL C before it, which may include kernel files. text: the kernel; its arguments are
    the inputs, (K, ...) each, then the output. define: returns the output, (K, ...), for any rows of the inputs.
    columns: what each column of the output is, if several expressions are evaluated at once, and `alone` returns the case
    of one of them. options: of the compiler. lanes: rows of a work-item. group: work-items of a work-group: rows are
    left out by whole groups. grid: the whole launch, where rows say too little of it.
    double: whether it needs float64. allowed: returns the rows, (K,), of inputs for which the kernel is defined; None: all.
    between: returns results that are rounded again, as the output; devices that flush may do so in between.
    divides: whether float32 divisions and roots have to be correctly rounded, as a device may claim or not.
    """

    name: str
    title: str
    text: str
    inputs: tuple[Array, ...]
    define: Callable[..., Array]
    head: str = ""
    columns: tuple[str, ...] = ()
    alone: Callable[[int], Case] | None = None
    options: tuple[str, ...] = ()
    lanes: int = 1
    group: int = 1
    grid: Grid | None = None
    double: bool = False
    allowed: Callable[..., Bools] | None = None
    between: Callable[..., Array] | None = None
    divides: bool = False

    @property
    def rows(self) -> int:
        """The least number of rows that a launch can have."""
        return self.lanes * self.group

    @property
    def launched(self) -> Grid:
        count = len(self.inputs[0]) // self.lanes
        return self.grid or Grid((count,), (self.group,))

    @property
    def needs_group(self) -> bool:
        """Whether a work-item uses more than its own rows: those of its work-group, or memory that all share."""
        return any(word in self.text for word in ("local", "group", "atomic"))

    @cached_property
    def source(self) -> str:
        """The whole text that is built."""
        return PRAGMA + (programs.flatten_text(self.head) if "#include" in self.head else self.head) + self.text

    def in_groups(self) -> Case:
        """Return the case in work-groups of GROUP rows, with copies of its last row where one would not be full."""
        more, alone = -len(self.inputs[0]) % GROUP, self.alone
        case = self.with_inputs([np.concatenate([v, np.repeat(v[-1:], more, axis=0)]) for v in self.inputs])
        return replace(case, group=GROUP // self.lanes, alone=alone and (lambda column: alone(column).in_groups()))

    def with_inputs(self, inputs: Sequence[Array]) -> Case:
        return replace(self, inputs=tuple(np.ascontiguousarray(v) for v in inputs))

    def expected(self) -> Array:
        with np.errstate(all="ignore"):
            return np.ascontiguousarray(self.define(*self.inputs))


@dataclass(frozen=True, eq=False)
class Wrong:
    """A case whose output is wrong. rows: (K,) whether anything is wrong in a row. column: the first of the output's
    columns that is wrong."""

    case: Case
    found: Array
    expected: Array
    rows: Bools
    column: int = 0


@dataclass
class Bench:
    """A device and what the tests ask of it; planted faults override the methods.

    built: kernels by source and options.
    """

    device: Device
    built: dict[tuple[str, ...], dict[str, Any]] = field(default_factory=dict)

    def build(self, source: str, options: Sequence[str]) -> dict[str, Any]:
        return programs.build_alone(self.device, source, options)

    def launch(self, kernel: Any, grid: Grid, arguments: Sequence[Any]) -> None:
        bare_kernel.launch(self.device, kernel, grid, arguments)

    def edge_bytes(self, size: int) -> tuple[int, int]:
        return bare_kernel.edge_bytes(self.device, size)

    def draw(self, scene: Scene, **options: Any) -> Frame:
        with Renderer(scene, device=self.device, **options) as renderer:
            return renderer.render()

    def draw_again(self, scene: Scene, times: int, **options: Any) -> list[str]:
        """Draw the same frame some times; return the digest of each."""
        with Renderer(scene, device=self.device, **options) as renderer:
            return [digest(renderer.render()) for _ in range(times)]

    def run(self, case: Case, source: str = "", expected: Array | None = None) -> Array:
        """Return what a case's kernel writes. source: another text with this kernel. expected: of the case, if known."""
        key = (source or case.source, *case.options)
        if key not in self.built:
            self.built[key] = self.build(source or case.source, case.options)
        expected = case.expected() if expected is None else expected
        found = np.full(expected.nbytes, UNWRITTEN, np.uint8).view(expected.dtype).reshape(expected.shape)
        inputs = [v.copy() for v in case.inputs]
        for v in inputs:
            v.flags.writeable = False
        self.launch(self.built[key][case.name], case.launched, [*inputs, found])
        return found

    def wrong(self, case: Case, source: str = "") -> Wrong | None:
        """Run a case, and return what is wrong; None if nothing. Raises Skipped."""
        if case.divides and not divides(self.device):
            raise Skipped(
                "the device does not claim correctly rounded division and roots: clshade's bits may differ there"
            )
        expected = case.expected()
        found = self.run(case, source, expected)
        right = same(found, expected)
        if flushes(self.device):
            with np.errstate(all="ignore"):
                flushed = np.ascontiguousarray(case.define(*map(without_denormals, case.inputs)))
                if case.between is not None:
                    right |= _is_tiny(np.ascontiguousarray(case.between(*case.inputs)), True)
            tiny = np.any([_is_tiny(v, True).reshape(len(v), -1).any(axis=1) for v in (*case.inputs, expected)], axis=0)
            # A zero in place of a denormal has any sign; the least normal number may be rounded from one.
            zero = tiny.reshape(-1, *[1] * (found.ndim - 1)) & (found == 0)
            for taken in (expected, flushed):
                small = without_denormals(taken)
                right |= same(found, taken) | same(found, small) | (zero & ((small == 0) | _is_tiny(small, True)))
        if right.all():
            return None
        by_row = ~right.reshape(len(right), -1)
        column = int(by_row.any(axis=0).argmax()) if case.columns else 0
        rows: Bools = by_row[:, column] if case.columns else np.any(by_row, axis=1)
        return Wrong(case, found, expected, rows, column)


class Skipped(Exception):
    """A test that a device cannot take; the message says why."""


def divides(device: Device) -> bool:
    """Return whether a device rounds float32 divisions and square roots correctly, as it says itself."""
    return bool(int(device.device.single_fp_config) & 128)  # CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT


def flushes(device: Device) -> bool:
    """Return whether a device may take float32 denormals as 0, as it says itself."""
    return not int(device.device.single_fp_config) & 1  # CL_FP_DENORM


def same(found: Array, expected: Array) -> Bools:
    """Return where the bits are equal, or both are NaN."""
    whole = f"u{expected.dtype.itemsize}"
    equal: Bools = np.ascontiguousarray(found).view(whole) == np.ascontiguousarray(expected).view(whole)
    return equal | (np.isnan(found) & np.isnan(expected)) if expected.dtype.kind == "f" else equal


def _is_tiny(v: Array, least_normal: bool = False) -> Bools:
    """Return where a float32 number is a denormal. least_normal: whether to count the least normal number too."""
    if v.dtype != np.float32:
        return np.zeros(v.shape, bool)
    least = np.finfo(v.dtype).tiny
    found: Bools = (v != 0.0) & (np.abs(v) < (np.nextafter(least, np.float32(1.0)) if least_normal else least))
    return found


def without_denormals(v: Array) -> Array:
    """Return float32 numbers with denormals replaced by zeros of their sign; other types as they are."""
    if v.dtype != np.float32:
        return v
    return np.where(_is_tiny(v), np.copysign(v.dtype.type(0), v), v)
