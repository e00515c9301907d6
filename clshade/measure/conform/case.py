"""A kernel with its input and what it has to write, and the bench on which it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from ...base.arrays import Array, Bools
from ...pipeline import bare_kernel, programs
from ...pipeline.bare_kernel import Grid
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene.model import Scene

GROUP = 64  # rows of a work-group
UNWRITTEN = 0xA5  # the bytes of an output before the kernel runs
PRAGMA = "#pragma OPENCL FP_CONTRACT OFF\n"
_NAMES = {"f4": "float", "f8": "double", "i4": "int", "u4": "uint", "i8": "long", "u8": "ulong"}
C_TYPES = {np.dtype(kind): name for kind, name in _NAMES.items()}


@dataclass(frozen=True, eq=False)
class Case:
    """A kernel, K rows of input, and a definition of the K rows of output.

    name: of the kernel too. head: OpenCL C before it, which may include kernel files. text: the kernel; its arguments are
    the inputs, (K, ...) each, then the output. define: returns the output, (K, ...), for any rows of the inputs.
    options: of the compiler. lanes: rows of a work-item. grid: the whole launch; None: work-groups of GROUP rows, of which
    K is a multiple. divides: whether float32 divisions and roots have to be correctly rounded, as a device may claim or
    not. program: the text that is built if it holds other kernels too, "" for head and text.
    """

    name: str
    title: str
    text: str
    inputs: tuple[Array, ...]
    define: Callable[..., Array]
    head: str = ""
    options: tuple[str, ...] = ()
    lanes: int = 1
    grid: Grid | None = None
    divides: bool = False
    program: str = ""

    @property
    def launched(self) -> Grid:
        return self.grid or Grid((len(self.inputs[0]) // self.lanes,), (GROUP // self.lanes,))

    @property
    def source(self) -> str:
        """The text of this kernel alone."""
        return PRAGMA + _flattened(self.head) + self.text

    def expected(self) -> Array:
        with np.errstate(all="ignore"):
            return np.ascontiguousarray(self.define(*self.inputs))


@cache
def _flattened(head: str) -> str:
    return programs.flatten_text(head) if "#include" in head else head


def in_one_program(cases: Sequence[Case]) -> list[Case]:
    """Return cases of one head and the same options, built together."""
    program = cases[0].source + "".join(case.text for case in cases[1:])
    return [replace(case, program=program) for case in cases]


def signature(name: str, names: Iterable[str], inputs: Sequence[Array], kind: Any) -> str:
    """Return the first line of a kernel with arguments of these names, and `out`, of a NumPy type."""
    types = (C_TYPES[v.dtype] for v in inputs)
    arguments = "".join(f"global const {c} *{letter}, " for c, letter in zip(types, names, strict=False))
    return f"kernel void {name}({arguments}global {C_TYPES[np.dtype(kind)]} *out)"


@dataclass(frozen=True, eq=False)
class Wrong:
    """A case whose output is wrong. rows: (K,) whether anything is wrong in a row."""

    case: Case
    found: Array
    expected: Array
    rows: Bools

    def __str__(self) -> str:
        """Return in a line what is wrong with the first wrong row."""
        row = int(self.rows.argmax())
        of = ", ".join(_shown(v[row]) for v in self.case.inputs)
        pair = f"expected {_shown(self.expected[row])}, found {_shown(self.found[row])}"
        return f"{int(self.rows.sum())} of {len(self.rows)} rows; of {of}: {pair}"


def _shown(v: object) -> str:
    flat = np.asarray(v).reshape(-1)
    words = [float(x).hex() if flat.dtype.kind == "f" else str(x) for x in flat[:4]]
    return words[0] if len(flat) == 1 else f"({', '.join(words)}{', ...' if len(flat) > 4 else ''})"


class Skipped(Exception):
    """A test that a device cannot take; the message says why."""


@dataclass
class Bench:
    """A device and what the tests ask of it. built: kernels by source and options."""

    device: Device
    built: dict[tuple[str, ...], dict[str, Any]] = field(default_factory=dict)

    def draw(self, scene: Scene, **options: Any) -> Frame:
        with Renderer(scene, device=self.device, **options) as renderer:
            return renderer.render()

    def run(self, case: Case, expected: Array) -> Array:
        """Return what a case's kernel writes. expected: an output of that shape and type."""
        key = (case.program or case.source, *case.options)
        if key not in self.built:
            self.built[key] = programs.build_alone(self.device, key[0], case.options)
        found = np.full(expected.nbytes, UNWRITTEN, np.uint8).view(expected.dtype).reshape(expected.shape)
        inputs = [v.copy() for v in case.inputs]
        for v in inputs:
            v.flags.writeable = False
        bare_kernel.launch(self.device, self.built[key][case.name], case.launched, [*inputs, found])
        return found

    def wrong(self, case: Case) -> Wrong | None:
        """Run a case, and return what is wrong; None if nothing. Raises Skipped."""
        if case.divides and not divides(self.device):
            raise Skipped(
                "the device does not claim correctly rounded division and roots: clshade's bits may differ there"
            )
        expected = case.expected()
        found = self.run(case, expected)
        right = same(found, expected)
        if flushes(self.device):
            right |= _flushed(case, found, expected)
        rows = np.any(~right.reshape(len(right), -1), axis=1)
        return Wrong(case, found, expected, rows) if rows.any() else None


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


def _flushed(case: Case, found: Array, expected: Array) -> Bools:
    """Return where an output is right on a device that takes denormal operands and results as 0: a zero in place of one
    has any sign, and the least normal number may be rounded from one."""
    with np.errstate(all="ignore"):
        of_zeros = np.ascontiguousarray(case.define(*map(without_denormals, case.inputs)))
    tiny = np.any([_is_tiny(v).reshape(len(v), -1).any(axis=1) for v in (*case.inputs, expected)], axis=0)
    zero = tiny.reshape(-1, *[1] * (found.ndim - 1)) & (found == 0)
    right = np.zeros(found.shape, bool)
    for taken in (expected, of_zeros):
        small = without_denormals(taken)
        right |= same(found, taken) | same(found, small) | (zero & ((small == 0) | _is_tiny(small)))
    return right


def _is_tiny(v: Array) -> Bools:
    """Return where a float32 number is a denormal or the least normal number."""
    if v.dtype != np.float32:
        return np.zeros(v.shape, bool)
    found: Bools = (v != 0.0) & (np.abs(v) <= np.finfo(np.float32).tiny)
    return found


def without_denormals(v: Array) -> Array:
    """Return float32 numbers with denormals replaced by zeros of their sign; other types as they are."""
    if v.dtype != np.float32:
        return v
    return np.where(np.abs(v) < np.finfo(np.float32).tiny, np.copysign(np.float32(0.0), v), v)
