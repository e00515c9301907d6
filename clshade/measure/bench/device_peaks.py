"""Measured peak rates of a device: memory fill, and float32 multiply-add."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...pipeline.buffers import Buffer
from ...pipeline.features import Features
from ...pipeline.opencl.device import Device
from ...pipeline.programs import build

FILLED = 1 << 26  # bytes: more than caches hold
CHAINS = 10  # independent, to hide the latency of an fma, four or five cycles
FMAS = 1 << 14  # per chain
ITEMS = {True: 64, False: 2048}  # work-items per compute unit, by whether it is a CPU
ROUNDS = 7

# The vector width is the device's for float32, at least 4: GPUs write fastest 16 bytes at a time.
SOURCE = """
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

// A variable for each chain: an array would stay in memory.
#define EACH(DO) DO(0) DO(1) DO(2) DO(3) DO(4) DO(5) DO(6) DO(7) DO(8) DO(9)
#define START(k) VECTOR x##k = (VECTOR)(k);
#define STEP(k) x##k = fma(x##k, (VECTOR)(factor), (VECTOR)(1.0f));
#define PLUS(k) + x##k

kernel void fmas(global VECTOR *result, float factor, int count)
{
    EACH(START)
    for (int i = 0; i < count; ++i) {
        EACH(STEP)
    }
    result[get_global_id(0)] = EACH(PLUS);
}
"""


class Peaks(NamedTuple):
    """Peak rates. flops: float32 operations per second, an fma counts as 2. fill: bytes per second written past the
    caches."""

    flops: float
    fill: float


def peaks(device: Device) -> Peaks:
    """Measure the peaks of a device with a profiling queue: the best of several rounds."""
    width = max(device.lanes, 4)
    program = build(device, Features.of(), f"#define VECTOR float{width}\n{SOURCE}")
    items, vectors = ITEMS[device.is_cpu] * device.compute_units, FILLED // (4 * width)
    target, sums = (Buffer.empty(device, (n, width), np.float32) for n in (vectors, items))
    fmas = sums.memory, np.float32(0.5), np.int32(FMAS)
    return Peaks(
        flops=2.0 * items * width * CHAINS * FMAS / _best_seconds(device, program["fmas"], items, *fmas),
        fill=FILLED / _best_seconds(device, program["fill"], vectors, target.memory),
    )


def _best_seconds(device: Device, kernel: Any, items: int, *arguments: Any) -> float:
    local = (1 if device.is_cpu else 64,)
    best = float("inf")
    for _ in range(ROUNDS):
        event = kernel(device.queue, (items,), local, *arguments)
        event.wait()
        best = min(best, (event.profile.end - event.profile.start) / 1e9)
    return best
