"""A kernel with its input and what it has to write, and the bench on which it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Array, Bools
from ...pipeline import programs
from ...pipeline.opencl.device import Device
from .bare_kernel import Grid, launch

GROUP = 64  # rows of a work-group
UNWRITTEN = 0xA5  # the bytes of an output before the kernel runs
PRAGMA = "#pragma OPENCL FP_CONTRACT OFF\n"
_NAMES = {"f4": "float", "f8": "double", "i4": "int", "u4": "uint", "i8": "long", "u8": "ulong"}
C_TYPES = {np.dtype(kind): name for kind, name in _NAMES.items()}


@dataclass(frozen=True, eq=False)
class Case:
    """A kernel, K rows of input, and a definition of the K rows of output.

    name: of the kernel too. head: OpenCL C before it. text: the kernel; its arguments are the inputs, (K, ...) each, then
    the output. define: returns the output, (K, ...), for any rows of the inputs. options: of the compiler. lanes: rows of
    a work-item; a work-group has GROUP rows, of which K is a multiple. program: the text that is built if it holds other
    kernels too, "" for head and text.
    """

    name: str
    title: str
    text: str
    inputs: tuple[Array, ...]
    define: Callable[..., Array]
    head: str = ""
    options: tuple[str, ...] = ()
    lanes: int = 1
    program: str = ""

    @property
    def grid(self) -> Grid:
        return Grid((len(self.inputs[0]) // self.lanes,), (GROUP // self.lanes,))

    @property
    def source(self) -> str:
        """The text of this kernel alone."""
        return PRAGMA + self.head + self.text

    def expected(self) -> Array:
        with np.errstate(all="ignore"):
            return np.ascontiguousarray(self.define(*self.inputs))


def in_one_program(cases: Sequence[Case]) -> list[Case]:
    """Return cases of one head and the same options, built together."""
    program = cases[0].source + "".join(case.text for case in cases[1:])
    return [replace(case, program=program) for case in cases]


def signature(name: str, names: Iterable[str], inputs: Sequence[Array], kind: Any) -> str:
    """Return the first line of a kernel with arguments of these names, and `out`, of a NumPy type."""
    types = (C_TYPES[v.dtype] for v in inputs)
    arguments = "".join(f"global const {c} *{letter}, " for c, letter in zip(types, names, strict=False))
    return f"kernel void {name}({arguments}global {C_TYPES[np.dtype(kind)]} *out)"


@dataclass
class Bench:
    """A device and what the tests ask of it. built: kernels by source and options."""

    device: Device
    built: dict[tuple[str, ...], dict[str, Any]] = field(default_factory=dict)

    def run(self, case: Case, expected: Array) -> Array:
        """Return what a case's kernel writes. expected: an output of that shape and type."""
        key = (case.program or case.source, *case.options)
        if key not in self.built:
            options = [*case.options, *programs.compiler_options(self.device)]
            kernels = programs.compiled(self.device, key[0], options).all_kernels()
            self.built[key] = {kernel.function_name: kernel for kernel in kernels}
        output = np.full(expected.nbytes, UNWRITTEN, np.uint8).view(expected.dtype).reshape(expected.shape)
        inputs = [v.copy() for v in case.inputs]
        for v in inputs:
            v.flags.writeable = False
        launch(self.device, self.built[key][case.name], case.grid, [*inputs, output])
        return output

    def wrong(self, case: Case) -> tuple[str, int] | None:
        """Run a case, and return what is wrong and the first wrong row; None if nothing. Rows with denormals are right on a
        device that takes them as 0."""
        expected = case.expected()
        output = self.run(case, expected)
        rows: Bools = np.any(~same(output, expected).reshape(len(output), -1), axis=1)
        if flushes(self.device):
            for v in (*case.inputs, expected):
                rows[_denormal(v)] = False
        if not rows.any():
            return None
        row = int(rows.argmax())
        of = ", ".join(str(v[row].tolist()) for v in case.inputs)
        pair = f"expected {expected[row].tolist()}, found {output[row].tolist()}"
        return f"{rows.sum()} of {len(rows)} rows; of {of}: {pair}", row


class Check(NamedTuple):
    """A test of a device: a case, or a function that returns what is wrong, "" if nothing."""

    name: str
    title: str
    test: Case | Callable[[Bench], str]


def divides(device: Device) -> bool:
    """Return whether a device rounds float32 divisions and square roots correctly, as it says itself."""
    return bool(int(device.device.single_fp_config) & 128)  # CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT


def flushes(device: Device) -> bool:
    """Return whether a device may take float32 denormals as 0, as it says itself."""
    return not int(device.device.single_fp_config) & 1  # CL_FP_DENORM


def same(actual: Array, expected: Array) -> Bools:
    """Return where the bits are equal, or both are NaN."""
    bits = f"u{expected.dtype.itemsize}"
    equal: Bools = np.ascontiguousarray(actual).view(bits) == np.ascontiguousarray(expected).view(bits)
    return equal | (np.isnan(actual) & np.isnan(expected)) if expected.dtype.kind == "f" else equal


def _denormal(v: Array) -> Bools:
    """Return which rows hold a float32 denormal, or the least normal number, which may be rounded from one."""
    tiny = (v != 0) & (np.abs(v) <= np.finfo(np.float32).tiny) & (v.dtype == np.float32)
    rows: Bools = tiny.reshape(len(v), -1).any(axis=1)
    return rows
