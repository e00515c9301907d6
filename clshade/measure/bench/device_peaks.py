"""Measured peak rates of a device: memory copy and fill, and float32 multiply-add."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...pipeline.buffers import Buffer
from ...pipeline.features import Features
from ...pipeline.opencl.device import Device
from ...pipeline.programs import build_text

COPIED = 1 << 26  # bytes of each of the two arrays: larger than caches
CHAINS = 10  # independent, to hide the latency of an fma, four or five cycles
FMAS = 1 << 14  # per chain
ITEMS = {True: 64, False: 2048}  # work-items per compute unit, by whether it is a CPU
ROUNDS = 7

# The vector width is the device's for float32, at least 4: GPUs copy fastest 16 bytes at a time.
SOURCE = """
kernel void copy(global const VECTOR *from, global VECTOR *to)
{
    size_t i = get_global_id(0);
    to[i] = from[i];
}

#ifdef __has_builtin
#if __has_builtin(__builtin_nontemporal_store)
#define STORE(value, p) __builtin_nontemporal_store(value, p)
#endif
#endif
#ifndef STORE
#define STORE(value, p) (*(p) = (value))
#endif

kernel void fill(global VECTOR *to)
{
    STORE((VECTOR)(1.0f), to + get_global_id(0));
}

kernel void fmas(global VECTOR *result, float factor, int count)
{
    VECTOR STARTS;
    for (int i = 0; i < count; ++i) {
        STEPS;
    }
    result[get_global_id(0)] = SUM;
}
"""


def _source(width: int) -> str:
    """Return the kernels for that vector width, with a variable for each chain: an array would stay in memory."""
    chains = [f"x{k}" for k in range(CHAINS)]
    parts = {
        "VECTOR": f"float{width}",
        "STARTS": ", ".join(f"{x} = (float{width})({k}.0f)" for k, x in enumerate(chains)),
        "STEPS": "; ".join(f"{x} = fma({x}, (float{width})(factor), (float{width})(1.0f))" for x in chains),
        "SUM": " + ".join(chains),
    }
    text = SOURCE
    for name, part in parts.items():
        text = text.replace(name, part)
    return text


class Peaks(NamedTuple):
    """Peak rates. copy: bytes per second, reads plus writes. flops: float32 operations per second, an fma counts as
    2. fill: bytes per second written past the caches."""

    copy: float
    flops: float
    fill: float


def peaks(device: Device) -> Peaks:
    """Measure the peaks of a device with a profiling queue: the best of several rounds."""
    width = max(device.lanes, 4)
    program = build_text(device, Features.of(), _source(width))
    items = ITEMS[device.is_cpu] * device.compute_units
    source, target, sums = (
        Buffer.empty(device, (n, width), np.float32) for n in (*(COPIED // (4 * width),) * 2, items)
    )
    with source.writing() as rows:
        rows[:] = 1.0
    size = (COPIED // (4 * width),)
    fmas = program["fmas"], (items,), (sums.memory, np.float32(0.5), np.int32(FMAS))
    return Peaks(
        copy=2.0 * COPIED / _best_seconds(device, program["copy"], size, (source.memory, target.memory)),
        flops=2.0 * items * width * CHAINS * FMAS / _best_seconds(device, *fmas),
        fill=COPIED / _best_seconds(device, program["fill"], size, (target.memory,)),
    )


def _best_seconds(device: Device, kernel: Any, size: tuple[int, ...], arguments: tuple[Any, ...]) -> float:
    local = (1 if device.is_cpu else 64,)
    least = float("inf")
    for _ in range(ROUNDS):
        event = kernel(device.queue, size, local, *arguments)
        event.wait()
        least = min(least, (event.profile.end - event.profile.start) / 1e9)
    return least
