"""operations.clh: each operation, the compiler's own and the runtime's function, against its definition in exact integers
or in NumPy."""

from __future__ import annotations

import math
import os
import platform
import sys
from collections.abc import Callable
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from devices import needs_float64
from kernel_stages import LANES, Array, Probe
from processes import python

from clshade.pipeline.opencl.device import Device
from clshade.pipeline.opencl.pocl_target import FORCED

TEXT = """
#include "pair_vectors.clh"
#include "light_points.clh"

#define FIRST int i = get_global_id(0) * LANES
#define EACH for (int lane = 0; lane < LANES; ++lane)
#if LANES == 1
#define IN(p) (p)[i]
#else
#define IN(p) JOIN(vload, LANES)(0, (p) + i)
#endif
// Writes column k of n. Nothing that is tested here stores or loads the vectors of another test.
#define PUT(type, v, k, n)                                                                                   \\
    {                                                                                                        \\
        union {                                                                                              \\
            LANES_OF(type) all;                                                                              \\
            type each[LANES];                                                                                \\
        } column = {v};                                                                                      \\
        EACH out[n * (i + lane) + k] = column.each[lane];                                                    \\
    }

kernel void kind(global const int *x, global int *out)
{
    FIRST;
    EACH out[2 * (i + lane)] = HAS_OWN_OPERATIONS;
#ifdef __FMA__
    EACH out[2 * (i + lane) + 1] = 1;
#endif
}

kernel void fused_lanes(global const REAL *a, global const REAL *b, global const REAL *c, global REAL *out)
{
    FIRST;
    PUT(REAL, fma(IN(a), IN(b), IN(c)), 0, 1)
}

#define FUSED_ROWS(n)                                                                                        \\
    kernel void JOIN(fused_, n)(global const REAL *a, global const REAL *b, global const REAL *c, global REAL *out) \\
    {                                                                                                        \\
        FIRST;                                                                                               \\
        for (int k = i; i % 16 == 0 && k < i + 16; k += n)                                                   \\
            JOIN(vstore, n)(fma(JOIN(vload, n)(0, a + k), JOIN(vload, n)(0, b + k), JOIN(vload, n)(0, c + k)), 0, out + k); \\
    }
FUSED_ROWS(4)
FUSED_ROWS(8)

kernel void of_one(global const REAL *x, global REAL *out)
{
    FIRST;
    reals v = IN(x);
    PUT(REAL, fabs(v), 0, 5)
    PUT(REAL, floor(v), 1, 5)
    PUT(REAL, ceil(v), 2, 5)
    PUT(REAL, rint(v), 3, 5)
    PUT(REAL, sqrt(v), 4, 5)
}

kernel void of_some(global const REAL *a, global const REAL *b, global const REAL *c, global REAL *out)
{
    FIRST;
    PUT(REAL, fmin(IN(a), IN(b)), 0, 3)
    PUT(REAL, fmax(IN(a), IN(b)), 1, 3)
    PUT(REAL, clamp(IN(a), IN(b), IN(c)), 2, 3)
}

#define OF_INTEGERS(type)                                                                                    \\
    kernel void of_##type(global const type *a, global const type *b, global const type *c, global type *out) \\
    {                                                                                                        \\
        FIRST;                                                                                               \\
        PUT(type, min(IN(a), IN(b)), 0, 4)                                                                   \\
        PUT(type, max(IN(a), IN(b)), 1, 4)                                                                   \\
        PUT(type, clamp(IN(a), IN(b), IN(c)), 2, 4)                                                          \\
        LANES_OF(type) v = IN(a);                                                                            \\
        PUT(JOIN(u, type), abs(v), 3, 4)                                                                     \\
    }
OF_INTEGERS(int)
OF_INTEGERS(long)

kernel void of_bits(global const ulong *a, global const ulong *b, global ulong *out)
{
    FIRST;
    EACH {
        ulong x = a[i + lane], y = b[i + lane];
        global ulong *row = out + 5 * (i + lane);
        row[0] = (ulong)popcount(x);
        row[1] = (ulong)popcount((uint)x);
        row[2] = mul_hi(x, y);
        row[3] = (ulong)LOWEST_BIT(x);
        row[4] = (ulong)LOWEST_BIT((uint)y);
    }
}

kernel void reals_of(global const int *a, global const long *b, global const float *c, global REAL *out)
{
    FIRST;
    PUT(REAL, TO_REALS(IN(a)), 0, 5)
    PUT(REAL, TO_REALS(IN((global const uint *)a)), 1, 5)
    PUT(REAL, TO_REALS(IN(b)), 2, 5)
    PUT(REAL, TO_REALS(IN(c)), 3, 5)
    PUT(float, TO_FLOATS(IN(a)), 4, 5)
}

kernel void integers_of(global const int *a, global const long *b, global const REAL *c, global const REAL *d, global long *out)
{
    FIRST;
    PUT(long, TO_LONGS(IN(a)), 0, 6)
    PUT(uint, TO_UINTS(IN(a)), 1, 6)
    PUT(int, TO_FIXEDS(IN(b)), 2, 6)
    PUT(INTEGER, TO_INTS(IN(b)), 3, 6)
    PUT(int, TO_FIXEDS(IN(c)), 4, 6)
    PUT(INTEGER, TO_INTS(IN(d)), 5, 6)
}

kernel void floats_of(global const REAL *x, global float *out)
{
    FIRST;
    PUT(float, TO_FLOATS(IN(x)), 0, 1)
}

// From global memory through private memory to global memory, at addresses that suit a number only.
#define MOVE(type, n)                                                                                        \\
    kernel void JOIN(move_##type, n)(global const int *places, global const type *from, global type *out)    \\
    {                                                                                                        \\
        FIRST;                                                                                               \\
        EACH {                                                                                               \\
            int place = places[i + lane], shift = place % 4;                                                 \\
            type own[n + 4];                                                                                 \\
            JOIN(store, n)(JOIN(load, n)(from + place), own + shift);                                        \\
            JOIN(store, n)(JOIN(load, n)(own + shift), out + (n + 4) * (i + lane) + shift);                  \\
        }                                                                                                    \\
    }
MOVE(float, 4)
MOVE(float, 16)
MOVE(int, 4)
#if LANES > 4
MOVE(int, LANES)
#endif
#if DOUBLE
MOVE(double, 4)
MOVE(double, 8)
#if LANES > 1
MOVE(long, LANES)
#endif
#if LANES == 16
MOVE(double, 16)
#endif
#else
MOVE(float, 8)
#endif

// Row 0 has the counters, the rows' other columns what was there before; column 3 a bit of each work-item.
kernel void count(global const int *x, global int *out)
{
    FIRST;
    EACH {
        int item = i + lane;
        global int *row = out + 4 * (item + 1);
        row[0] = atomic_add(out, x[item]);
        row[1] = atomic_inc(out + 1);
        row[2] = (int)(atomic_or((global uint *)out + 4 * (item / 32) + 3, 1u << item % 32) >> item % 32 & 1);
    }
}
"""
