"""Faults that are planted in a device, to see whether the tests find them: rewritten sources and disturbed launches."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Array
from ...pipeline import programs
from ...pipeline.bare_kernel import Grid
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device
from .case import Bench

Rewrite = Callable[[str], str]


def _swap(found: str, instead: str) -> Rewrite:
    """Return a rewriting of a regular expression in a source."""
    return lambda source: re.sub(found, instead, source)


def _prefix(text: str) -> Rewrite:
    """Return a rewriting that puts a text before a source."""
    return lambda source: text + source


class Fault(NamedTuple):
    """A fault. group, part, test: the test that should find it. rewrite: of sources; None: `Faulty` disturbs launches."""

    what: str
    group: str
    test: str
    rewrite: Rewrite | None = None
    part: str = ""


FAULTS = {
    "fma-twice-rounded": Fault(
        "fma rounds its product",
        "constructs",
        "fused_multiply_add",
        _prefix("#define fma(a, b, c) ((a) * (b) + (c))\n"),
    ),
    "fma-one-ulp": Fault(
        "the last bit of fma is flipped",
        "constructs",
        "fused_multiply_add",
        _swap(r"= fma\((.*)\);", r"= as_float(as_int(fma(\1)) ^ 1);"),
    ),
    "contraction": Fault(
        "a * b + c becomes fma",
        "constructs",
        "not_contracted",
        lambda s: re.sub(r"a\[i\] \* b\[i\] \+ c\[i\]", "fma(a[i], b[i], c[i])", s),
    ),
    "reassociation": Fault(
        "(a + b) - a becomes b", "constructs", "not_reassociated", _swap(r"\(a\[i\] \+ b\[i\]\) - a\[i\]", "b[i]")
    ),
    "division": Fault(
        "division is a product with a reciprocal",
        "operations",
        "float32-library-1/divided",
        _swap(r"\{a / b\}", "{a * (1.0f / b)}"),
        "float32-library",
    ),
    "root": Fault(
        "roots are not correctly rounded",
        "operations",
        "float32-library-1/divided",
        _swap(r"\{sqrt\(a\)\}", "{a * rsqrt(a)}"),
        "float32-library",
    ),
    "rint-away": Fault(
        "rint rounds ties away from 0", "constructs", "rounds_to_even", _prefix("#define rint(x) round(x)\n")
    ),
    "truncation": Fault(
        "conversion to int rounds", "constructs", "truncates", _swap(r"\(int\)a\[i\]", "convert_int_rte(a[i])")
    ),
    "saturation": Fault(
        "a saturating conversion wraps",
        "constructs",
        "saturates",
        _swap("convert_int_sat_rte", "(int)convert_long_rte"),
    ),
    "fmin-nan": Fault(
        "fmin of NaN is NaN",
        "constructs",
        "minimum_without_nan",
        _prefix("#define fmin(a, b) ((b) < (a) ? (b) : (a))\n"),
    ),
    "comparison": Fault(
        "comparisons are taken for those without NaN", "constructs", "comparisons", _swap(r"!\(x >= y\)", "(x < y)")
    ),
    "denormals": Fault(
        "denormals are flushed to 0",
        "constructs",
        "denormals",
        _swap(r"a\[i\] \* 0.5f", "(fabs(a[i]) < 0x1p-126f ? 0.0f : a[i] * 0.5f)"),
    ),
    "mul-hi": Fault(
        "mul_hi is the lower half", "constructs", "upper_half", _swap(r"mul_hi\((.*?), (.*?)\)", r"((\1) * (\2))")
    ),
    "popcount": Fault(
        "popcount leaves out the highest bit",
        "constructs",
        "counts_bits",
        _swap(r"popcount\(a\[i\]\)", "popcount(a[i] & 0x7fffffffu)"),
    ),
    "shift": Fault(
        "shifts by 31 are by 30", "constructs", "shifts_left", _swap(r"a\[i\] << b\[i\]", "a[i] << min(b[i], 30u)")
    ),
    "long-shift": Fault(
        "64-bit shifts take 5 bits of their distance",
        "constructs",
        "long_shifts_left",
        _swap(r"a\[i\] << b\[i\]", "a[i] << (b[i] & 31)"),
    ),
    "signed-division": Fault(
        "signed division rounds down",
        "constructs",
        "signed_divides",
        _swap(r"= a\[i\] / b\[i\]", "= a[i] / b[i] - (a[i] % b[i] != 0 && (a[i] < 0) != (b[i] < 0))"),
    ),
    "select": Fault(
        "select is inverted", "constructs", "selected", _swap(r"select\(x, y, x > 5\)", "select(x, y, x <= 5)")
    ),
    "divergent-loop": Fault(
        "a divergent loop runs as often as in the group's first item",
        "constructs",
        "divergent_loop",
        _swap(r"k < a\[i\]", "k < a[i - get_local_id(0)]"),
    ),
    "lane-loop": Fault(
        "a loop over lanes ends with the first lane",
        "constructs",
        "lanes_until_all_4",
        _swap(r"any\(active\)", "active.x"),
    ),
    "early-return": Fault("items that returned go on", "constructs", "early_return", _swap(r"return;", ";")),
    "barrier": Fault(
        "a barrier is removed",
        "constructs",
        "reversed_in_group",
        lambda s: re.sub(r"barrier\([^)]*\);\n    out\[i\] = kept\[63", "out[i] = kept[63", s),
    ),
    "local-shared": Fault("work-groups share local memory", "constructs", "groups_apart", _swap(r"kept\[l\] = 0;", "")),
    "atomic-dropped": Fault(
        "one of 64 atomic additions is dropped",
        "constructs",
        "local_atomics",
        _swap(r"atomic_add\(&sum, a\[i\]\);", "if (l) atomic_add(&sum, a[i]);"),
    ),
    "atomic-lost": Fault(
        "an atomic addition to global memory is lost",
        "operations",
        "float32-library-1/count",
        _swap(r"atomic_add\(out \+ 3, x\[item\]\);", "if (item) atomic_add(out + 3, x[item]);"),
        "float32-library",
    ),
    "atomic-inc-new": Fault(
        "atomic_inc returns the new value",
        "operations",
        "float32-library-1/count",
        _swap(r"4 \* atomic_inc\(scratch\)", "4 * min(atomic_inc(scratch) + 1, (int)get_global_size(0) * LANES - 1)"),
        "float32-library",
    ),
    "struct-padding": Fault(
        "structs are padded to 64 bytes",
        "structs",
        "View_float32",
        _swap(r"\} View;", "} __attribute__((aligned(64))) View;"),
    ),
    "vector-of-3": Fault(
        "vectors of 3 lie 4 apart", "constructs", "vector_of_3", _swap(r"vload3\(i, a\)", "vload4(i, a).xyz")
    ),
    "offset": Fault("global offsets are ignored", "constructs", "ids_in_2_dimensions"),
    "stale": Fault("an input is that of the launch before", "constructs", "unsigned_wraps"),
    "second-run": Fault("every 50th launch loses a number", "repeatability", "launches"),
    "frame": Fault("a pixel of a frame has another owner", "coverage", "half_pixel_grid"),
    "last-bit": Fault("a color of a frame has another last bit", "scenes", "062-nolight", part="nolight"),
    "abort": Fault("the compiler aborts", "constructs", "divergent_loop"),
    "hang": Fault("a launch does not end", "constructs", "divergent_loop"),
    "crash": Fault("a launch crashes", "constructs", "divergent_loop"),
    "allocation": Fault("the last byte of a buffer is lost", "memory", "sizes_of_buffers"),
    "limit": Fault("too large a buffer is not refused", "memory", "beyond_the_limit"),
}


@dataclass
class Faulty(Bench):
    """A bench of a device with a fault that no source shows."""

    fault: str = ""
    launches: int = 0
    before: Array | None = None

    def build(self, source: str, options: Sequence[str]) -> dict[str, Any]:
        if self.fault == "abort":
            os.abort()
        return super().build(source, options)

    def launch(self, kernel: Any, grid: Grid, arguments: Sequence[Any]) -> None:
        self.launches += 1
        if self.fault == "hang":
            time.sleep(3600.0)
        if self.fault == "crash":
            signal.signal(signal.SIGSEGV, signal.SIG_DFL)  # LLVM may handle it
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.fault == "offset":
            grid = replace(grid, offset=None)
        if self.fault == "stale":
            arguments = [np.roll(arguments[0], 1), *arguments[1:]]
        super().launch(kernel, grid, arguments)
        if self.fault == "second-run" and self.launches % 50 == 0:
            arguments[-1][7] += 1

    def edge_bytes(self, size: int) -> tuple[int, int]:
        if self.fault == "limit":
            return 5, 7
        first, last = super().edge_bytes(size)
        return first, 0 if self.fault == "allocation" else last

    def draw(self, scene: Any, **options: Any) -> Any:
        frame = super().draw(scene, **options)
        layers, rgba = {name: frame[name].copy() for name in frame.layers}, frame.rgba.copy()
        if self.fault == "frame":
            layers["id"].reshape(-1)[3] += 1
        if self.fault == "last-bit":
            rgba.reshape(-1).view(np.uint32)[4] ^= 1
        return Frame(rgba, layers, frame.scene, frame.settings, lambda: frame.stats)


@contextlib.contextmanager
def planted(name: str, device: Device) -> Iterator[Bench]:
    """Yield a bench of the device with a fault planted for the block; "" for none."""
    if not name:
        yield Bench(device)
        return
    rewrite = FAULTS[name].rewrite
    if rewrite is None:
        yield Faulty(device, fault=name)
        return
    with programs.rewriting(lambda source, options: rewrite(source)):
        yield Bench(device)
