"""Limits of memory: what a device says that it can allocate, and what happens beyond."""

from __future__ import annotations

from ...base.host_memory import available
from ...errors import DeviceError
from ...pipeline.bare_kernel import edge_bytes
from .case import Bench

SHARE = 4  # of the host's free memory that a test takes at most, one part in so many
MOST = 64 << 30  # bytes, where the system does not say what is free
WRITTEN = (5, 7)  # into the first and the last byte


def largest(bench: Bench) -> str:
    """The largest single buffer, as far as a quarter of the host's free memory allows: its first and last byte. A device
    may refuse what it claims, but not a quarter of it."""
    size = claimed = min(bench.device.max_allocation, bench.device.memory, _most())
    while True:
        try:
            found = edge_bytes(bench.device, size)
            return "" if found == WRITTEN else f"{size} bytes: expected {WRITTEN} at the ends, found {found}"
        except DeviceError:
            size //= 2
            if size < claimed // 4:
                raise


def powers(bench: Bench) -> str:
    """Buffers of sizes about powers of two, where sizes and addresses in 32 bits overflow."""
    for size in ((1 << power) + more for power in (16, 20, 24, 28, 31, 32) for more in (-1, 0, 1)):
        if size <= min(bench.device.max_allocation, _most()) and edge_bytes(bench.device, size) != WRITTEN:
            return f"{size} bytes: the first or the last byte is not what was written"
    return ""


def beyond(bench: Bench) -> str:
    """A buffer of four times the device's whole memory is refused by an error."""
    size = 4 * max(bench.device.memory, bench.device.max_allocation, 1 << 40)
    try:
        edge_bytes(bench.device, size)
    except DeviceError:
        return ""
    return f"{size} bytes: expected an error, found a buffer"


def _most() -> int:
    return int(min(available(), MOST)) // SHARE


TESTS = (
    ("largest_allocation", "first and last byte of the largest buffer", largest),
    ("sizes_of_buffers", "buffers of sizes about powers of two", powers),
    ("beyond_the_limit", "a buffer that is too large is refused", beyond),
)
