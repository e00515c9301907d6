"""Operands that tell an operation from one that is nearly right."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from ...base.arrays import Array

COUNT, HARD = 100_000, 16_000  # operands of all kinds, and of each kind that is hard to round


def rng(*seed: int) -> np.random.Generator:
    """Return random numbers that are the same in every run."""
    return np.random.default_rng([31, *seed])


def spread(low: float, high: float, kind: Any, seed: int) -> Array:
    """Return numbers of both signs with exponents from `low` to `high`."""
    random = rng(1, seed)
    exponents = random.integers(int(low), int(high) + 1, HARD)
    numbers: Array = (np.ldexp(random.uniform(1.0, 2.0, HARD), exponents) * random.choice([-1.0, 1.0], HARD)).astype(
        kind
    )
    return numbers


@cache
def patterns(kind: Any) -> Array:
    """Return numbers of all kinds: signs, exponents and mantissas of a sample, all combinations; random bits; and halves."""
    info, random = np.finfo(kind), rng(2)
    bias = info.maxexp - 1
    exponents = [0, 1, 2, 60, bias - 1, bias, bias + 1, bias + info.nmant, 2 * bias - 1, 2 * bias, 2 * bias + 1]
    shifted = np.array([*exponents, *random.integers(0, 2 * bias, 8)], np.uint64) << np.uint64(info.nmant)
    mantissas = [0, 1, 1 << (info.nmant - 1), (1 << info.nmant) - 1, *random.integers(0, 1 << info.nmant, 8)]
    signs = np.array([0, 1 << (info.bits - 1)], np.uint64)
    grid = np.sum(np.meshgrid(signs, shifted, np.array(mantissas, np.uint64)), axis=0).reshape(-1)
    more = random.choice(grid, COUNT // 2), random.integers(0, 1 << info.bits, COUNT // 2, np.uint64)
    numbers = np.concatenate([grid, *more]).astype(f"u{info.bits // 8}").view(kind)
    starts = np.array([[-1.0], [-0.5], [0.0], [0.25], [0.5], [1.0]]) * 2.0**info.nmant
    shuffled: Array = random.permutation(np.append(numbers, (starts + np.arange(-100, 101) / 2).astype(kind)))
    return shuffled


@cache
def ties(kind: Any) -> tuple[Array, Array, Array]:
    """Return a, b, c: a * b is half of c's last digit, or less by so little, x^2 in (1 + x) (1 - x), that sums in a type of
    twice as many digits are rounded to the tie. An eighth has a denormal c, and another one the largest number."""
    info, random = np.finfo(kind), rng(3)
    digits, lowest, highest = info.nmant + 1, info.minexp - info.nmant, info.maxexp - info.nmant - 1
    x = np.ldexp(random.choice([0.0, 1.0, 1.0, 1.0], HARD), -random.integers(digits // 2, digits, HARD))
    last, mantissas = random.integers(lowest, highest + 1, HARD), random.integers(1 << info.nmant, 1 << digits, HARD)
    last[: HARD // 8], last[-HARD // 8 :] = lowest, highest
    mantissas[: HARD // 8] >>= random.integers(1, digits, HARD // 8)
    mantissas[-HARD // 8 :] = (1 << digits) - 1
    half, signs = (last - 1) // 2, random.choice([-1.0, 1.0], (2, HARD))
    a, b = np.ldexp(1.0 + x, half), np.ldexp(1.0 - x, last - 1 - half) * signs[0]
    return a.astype(kind), b.astype(kind), (np.ldexp(mantissas.astype(np.float64), last) * signs[1]).astype(kind)


@cache
def factors(kind: Any) -> tuple[Array, ...]:
    """Return a, b and c for a * b + c: of all kinds, ties, and sums that cancel, are denormal or overflow."""
    info, random = np.finfo(kind), rng(4)
    lowest, highest = info.minexp - info.nmant, info.maxexp
    free = tuple(random.permutation(patterns(kind)) for _ in "abc")
    with np.errstate(all="ignore"):
        a, b = spread(-highest / 4, highest / 4, kind, 1), spread(-highest / 4, highest / 4, kind, 2)
        near = a, b, a * b * spread(-2 * info.nmant, 2 * info.nmant, kind, 3)
        cancel = a, b, np.nextafter(-a * b, random.choice([-2.0, -1.0, 0.0], HARD).astype(kind) * a * b)
        small = (spread(lowest / 2 - 9, info.minexp / 2 + 1, kind, k) for k in (4, 5))
        tiny = *small, spread(lowest, info.minexp + 2, kind, 6)
        huge = (
            *(spread(highest / 2 - 2, highest / 2, kind, k) for k in (7, 8)),
            spread(highest - 4, highest - 1, kind, 9),
        )
    return tuple(map(np.concatenate, zip(free, ties(kind), near, cancel, tiny, huge, strict=True)))


@cache
def integers(kind: Any) -> Array:
    """Return integers of a type: the outermost ones, ties between reals and those beside them, and any of each length."""
    bits, random = np.iinfo(kind).bits, rng(5)
    chosen = [(1 << bits) - 1, 1 << (bits - 1), (1 << (bits - 1)) - 1, (1 << bits // 2) - 1, *range(8)]
    for digits in (24, 53):
        for k in list(range(bits - digits)) * 4:
            tie = (1 << digits | int(random.integers(1 << digits)) | 1) << k
            chosen += [tie, tie - 1, tie + 1]
    both = np.array([v % (1 << bits) for v in (*chosen, *(-v for v in chosen))], np.uint64)
    free = random.integers(0, 1 << bits, (2, COUNT // 2), np.uint64)
    shifts = random.integers(0, bits, COUNT // 2, np.uint64)
    values = np.concatenate([both, free[0] >> shifts, free[1] >> shifts << shifts])
    shuffled: Array = random.permutation(values).astype(f"u{bits // 8}").view(kind)
    return shuffled
