"""Small kernels of single constructs: integers and reals."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...base.arrays import Array
from .case import Case
from .construct import ROWS, construct, ints, reals
from .definitions import each, fused
from .operands import integers, patterns


def _some(v: Array) -> Array:
    return v[:ROWS]


def values() -> Iterator[Case]:
    """Integers and reals: what overflows, shifts, converts, compares and rounds."""
    yield from _integers()
    yield from _longs()
    yield from _reals()
    yield from _comparisons()
    yield from _doubles()


def _integers() -> Iterator[Case]:
    a, b = _some(integers(np.uint32)), _some(integers(np.uint32)[ROWS:])
    x, y = (np.where(v == 0, 1, v).view(np.int32) for v in (a, b))
    x = np.where(x == -(2**31), 7, x).astype(np.int32)
    s = ints(30, 0, 32).view(np.uint32)
    for name, expression, inputs, define in (
        ("unsigned_wraps", "a[i] * b[i] + a[i] - b[i]", [a, b], lambda a, b: a * b + a - b),
        (
            "unsigned_divides",
            "a[i] / (b[i] | 1u) + a[i] % (b[i] | 1u)",
            [a, b],
            lambda a, b: a // (b | 1) + a % (b | 1),
        ),
        ("signed_divides", "a[i] / b[i]", [x, y], lambda a, b: _wrap32(_toward_0(a, b))),
        ("signed_remains", "a[i] % b[i]", [x, y], lambda a, b: _wrap32(a.astype(np.int64) - _toward_0(a, b) * b)),
        ("shifts_left", "a[i] << b[i]", [a, s], lambda a, b: a << b),
        ("shifts_right", "a[i] >> b[i]", [a, s], lambda a, b: a >> b),
        ("shifts_signed", "a[i] >> b[i]", [x, s], lambda a, b: a >> b.view(np.int32)),
        ("shifts_by_modulo", "a[i] << b[i]", [a, s + 32], lambda a, b: a << (b & 31)),
        ("counts_bits", "popcount(a[i]) + 100 * clz(b[i])", [a, b], lambda a, b: _counted(a) + 100 * _leading(b)),
        (
            "upper_half",
            "mul_hi(a[i], b[i])",
            [a, b],
            lambda a, b: (a.astype(np.uint64) * b >> np.uint64(32)).astype(np.uint32),
        ),
        (
            "least_and_most",
            "min(a[i], b[i]) ^ max(a[i], b[i]) ^ clamp(a[i], 5u, 500u)",
            [a, b],
            lambda a, b: a ^ b ^ np.clip(a, 5, 500),
        ),
        ("absolute", "(int)abs(a[i])", [x], lambda a: np.abs(a)),
        (
            "rotates",
            "rotate(a[i], b[i])",
            [a, s],
            lambda a, b: (a << b) | np.where(b, a >> ((32 - b) & 31), 0).astype(np.uint32),
        ),
    ):
        yield construct(name, f"integers: {expression}", f"out[i] = {expression};", inputs, define)
    bytes_ = ints(31, 0, 256).astype(np.uint8)
    yield construct(
        "small_integers",
        "bytes and short integers in memory, and their conversions",
        "short s = b[i];\nout[i] = (int)a[i] * s + (uchar)(a[i] + 200) + convert_uchar_sat(s);",
        [bytes_, ints(32, -300, 300).astype(np.int16)],
        lambda a, b: a.astype(np.int32) * b + (a.astype(np.int32) + 200) % 256 + np.clip(b, 0, 255).astype(np.int32),
        out="int",
    )


def _wrap32(v: Array) -> Array:
    return v.astype(np.int64).astype(np.int32)


def _toward_0(a: Array, b: Array) -> Array:
    p, q = a.astype(np.int64), b.astype(np.int64)
    quotient: Array = np.sign(p) * np.sign(q) * (np.abs(p) // np.abs(q))
    return quotient


def _counted(v: Array) -> Array:
    return np.array([bin(x).count("1") for x in v.tolist()], np.uint32)


def _leading(v: Array) -> Array:
    return np.array([32 - int(x).bit_length() for x in v.tolist()], np.uint32)


def _longs() -> Iterator[Case]:
    a, b = _some(integers(np.int64)), _some(integers(np.int64)[ROWS:])
    s = ints(33, 0, 64)
    for name, expression, inputs, define in (
        ("long_products", "a[i] * b[i]", [a.view(np.uint64), b.view(np.uint64)], lambda a, b: a * b),
        ("long_shifts_left", "a[i] << b[i]", [a.view(np.uint64), s], lambda a, b: a << b.astype(np.uint64)),
        ("long_shifts_right", "a[i] >> b[i]", [a, s], lambda a, b: a >> b.astype(np.int64)),
        (
            "long_comparisons",
            "(a[i] < b[i]) + 2 * (a[i] == b[i])",
            [a, b],
            lambda a, b: (a < b) + 2 * (a == b).astype(np.int64),
        ),
        (
            "edge_functions",
            "a[i] * (long)b[i] - b[i] * (long)(b[i] >> 3)",
            [a >> 32, ints(34, -(2**31), 2**31)],
            lambda a, b: a * b - b.astype(np.int64) * (b >> 3),
        ),
        ("long_halves", "(long)(int)a[i] + (a[i] >> 32)", [a], lambda a: a.astype(np.int32) + (a >> 32)),
    ):
        yield construct(name, f"64 bits: {expression}", f"out[i] = {expression};", inputs, define)


def _reals() -> Iterator[Case]:
    a, b = reals(40), reals(41)
    one = np.float32(1.0)
    half = (ints(43, -(2**22), 2**22) / 2).astype(np.float32)
    small = (patterns(np.float32)[: 4 * ROWS]).reshape(4, ROWS)
    tiny = (np.ldexp(1.0 + ints(44, 0, 2**23) / 2**23, ints(45, -149, -127))).astype(np.float32)
    with np.errstate(all="ignore"):
        huge = np.where(np.isfinite(small[0]), small[0], 1.0).astype(np.float32)
    for name, expression, inputs, define in (
        ("not_contracted", "a[i] * b[i] + c[i]", [a, b, -(a * b)], lambda a, b, c: a * b + c),
        (
            "fused_multiply_add",
            "fma(a[i], b[i], c[i])",
            [a, b, -(a * b)],
            lambda a, b, c: each(fused, np.float32, a, b, c),
        ),
        ("not_reassociated", "(a[i] + b[i]) - a[i]", [a, b], lambda a, b: (a + b) - a),
        ("rounds_to_even", "rint(a[i])", [half], np.rint),
        (
            "floor_and_ceil",
            "floor(a[i]) + 2.0f * ceil(a[i]) + 4.0f * trunc(a[i])",
            [half / 64],
            lambda a: np.floor(a) + 2 * np.ceil(a) + 4 * np.trunc(a),
        ),
        ("denormals", "a[i] * 0.5f", [tiny], lambda a: a * np.float32(0.5)),
        (
            "denormals_from_normals",
            "a[i] * 0x1p-30f",
            [(tiny * np.float32(2.0**23))],
            lambda a: a * np.float32(2.0**-30),
        ),
        ("zeros_have_signs", "1.0f / (a[i] * 0.0f)", [a], lambda a: one / (a * np.float32(0.0))),
        ("overflows", "a[i] * 0x1p120f", [huge], lambda a: a * np.float32(2.0**120)),
        (
            "magic_rounding",
            "(a[i] + 12582912.0f) - 12582912.0f",
            [half / 8],
            lambda a: (a + np.float32(12582912)) - np.float32(12582912),
        ),
        ("powers_of_two", "ldexp(a[i], -7) * as_float((127 + 9) << 23)", [a], lambda a: a * np.float32(4.0)),
        ("copies_signs", "copysign(a[i], b[i])", [a, b], np.copysign),
    ):
        yield construct(name, f"float: {expression}", f"out[i] = {expression};", inputs, define)
    for name, expression, inputs, out, define in (
        ("truncates", "(int)a[i]", [half / 16], "int", lambda a: np.trunc(a).astype(np.int32)),
        ("converts_to_even", "convert_int_rte(a[i])", [half / 16], "int", lambda a: np.rint(a).astype(np.int32)),
        ("converts_down", "convert_int_rtn(a[i])", [half / 16], "int", lambda a: np.floor(a).astype(np.int32)),
        (
            "saturates",
            "convert_int_sat_rte(a[i])",
            [a * 2**14],
            "int",
            lambda a: np.clip(np.rint(a.astype(np.float64)), -(2.0**31), 2.0**31 - 1).astype(np.int32),
        ),
        ("rounds_integers", "(float)a[i]", [_some(integers(np.int32))], "float", lambda a: a.astype(np.float32)),
        ("rounds_longs", "(float)a[i]", [_some(integers(np.int64))], "float", lambda a: a.astype(np.float32)),
        ("takes_bits", "as_int(a[i]) ^ as_int(-a[i])", [a], "int", lambda a: a.view(np.int32) ^ (-a).view(np.int32)),
    ):
        yield construct(name, f"conversions: {expression}", f"out[i] = {expression};", inputs, define, out=out)


def _comparisons() -> Iterator[Case]:
    values: Array = np.array([0.0, -0.0, 1.0, -2.0, np.inf, -np.inf, np.nan], np.float32)
    a, b = np.resize(values, 980), np.resize(np.repeat(values, 7), 980)  # each with each
    bits = "(x < y) + 2 * (x <= y) + 4 * (x == y) + 8 * (x != y) + 16 * (x > y) + 32 * !(x >= y)"
    bits += " + 64 * (isnan(x) != 0) + 128 * (isfinite(y) != 0)"

    def define(a: Array, b: Array) -> Array:
        tests = a < b, a <= b, a == b, a != b, a > b, ~(a >= b), np.isnan(a), np.isfinite(b)
        bits: Array = (np.stack(tests, axis=1) << np.arange(8)).sum(axis=1)
        return bits

    yield construct(
        "comparisons",
        "comparisons of infinities, NaN and zeros",
        f"float x = a[i], y = b[i];\nout[i] = {bits};",
        [a, b],
        define,
        out="int",
    )
    yield construct(
        "minimum_without_nan",
        "fmin and fmax of NaN and a number are the number",
        "out[i] = fmin(a[i], b[i]) + 3.0f * fmax(a[i], b[i]);",
        [a + np.float32(0.0), b + np.float32(0.0)],
        lambda a, b: np.fmin(a, b) + np.float32(3.0) * np.fmax(a, b),
    )
    yield construct(
        "selected_nan",
        "a choice by a comparison that is false for NaN",
        "out[i] = a[i] > b[i] ? a[i] : b[i];",
        [a, b],
        _greater,
    )


def _greater(a: Array, b: Array) -> Array:
    return np.where(a > b, a, b)


def _doubles() -> Iterator[Case]:
    a, b, c = (reals(k, kind=np.float64) for k in (50, 51, 52))
    for name, expression, inputs, out, define in (
        (
            "double_arithmetic",
            "(a[i] + b[i]) * c[i] - a[i] / b[i]",
            [a, b, c],
            "double",
            lambda a, b, c: (a + b) * c - a / b,
        ),
        ("double_not_contracted", "a[i] * b[i] + c[i]", [a, b, -(a * b)], "double", lambda a, b, c: a * b + c),
        ("double_roots", "sqrt(fabs(a[i]))", [a], "double", lambda a: np.sqrt(np.abs(a))),
        ("double_to_float", "(float)a[i]", [a], "float", lambda a: a.astype(np.float32)),
        ("double_from_float", "(double)a[i] * 3.0", [reals(53)], "double", lambda a: a.astype(np.float64) * 3.0),
        ("double_to_int", "(int)floor(a[i])", [a / 64.0], "int", lambda a: np.floor(a).astype(np.int32)),
        ("double_to_long", "convert_long_rte(a[i])", [a * 2.0**20], "long", lambda a: np.rint(a).astype(np.int64)),
        ("double_rounds_to_even", "rint(a[i])", [ints(54, -(2**30), 2**30) / 2.0], "double", np.rint),
        ("double_from_long", "(double)a[i]", [_some(integers(np.int64))], "double", lambda a: a.astype(np.float64)),
    ):
        yield construct(name, f"float64: {expression}", f"out[i] = {expression};", inputs, define, out=out, double=True)
