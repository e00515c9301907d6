"""Limits of memory: what a device says that it can allocate, and what happens beyond."""

from __future__ import annotations

from collections.abc import Callable

from ...base.host_memory import available
from ...errors import DeviceError
from .case import Bench

SHARE = 4  # of the host's free memory that a test takes at most, one part in so many
MOST = 64 << 30  # bytes, where the system does not say what is free


def largest(bench: Bench) -> str:
    """The largest single buffer, as far as a quarter of the host's free memory allows: its first and last byte. A device
    may refuse what it claims, but not a quarter of it."""
    device = bench.device
    size = claimed = min(device.max_allocation, device.memory, _most())
    while True:
        try:
            found = bench.edge_bytes(size)
            break
        except DeviceError:
            size //= 2
            if size < claimed // 4:
                raise
    return "" if found == (5, 7) else f"{size} bytes: expected 5 and 7 in the first and the last byte, found {found}"


def powers(bench: Bench) -> str:
    """Buffers of sizes about powers of two, where sizes and addresses in 32 bits overflow."""
    for power in (16, 20, 24, 28, 31, 32):
        for size in ((1 << power) - 1, 1 << power, (1 << power) + 1):
            if size <= min(bench.device.max_allocation, _most()) and bench.edge_bytes(size) != (5, 7):
                return f"{size} bytes: the first or the last byte is not what was written"
    return ""


def beyond(bench: Bench) -> str:
    """A buffer of four times the device's whole memory is refused by an error."""
    size = 4 * max(bench.device.memory, bench.device.max_allocation, 1 << 40)
    try:
        bench.edge_bytes(size)
    except DeviceError:
        return ""
    return f"{size} bytes: expected an error, found a buffer"


def _most() -> int:
    return int(min(available(), MOST)) // SHARE


def tests() -> list[tuple[str, str, Callable[[Bench], str]]]:
    """Return names, titles and functions."""
    return [
        ("largest_allocation", "first and last byte of the largest buffer", largest),
        ("sizes_of_buffers", "buffers of sizes about powers of two", powers),
        ("beyond_the_limit", "a buffer that is too large is refused", beyond),
    ]
