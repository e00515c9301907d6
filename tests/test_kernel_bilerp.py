"""bilerp.cl and texture.clh against the oracle's texture lookups."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from devices import skip_unsupported
from kernel_stages import Probe, float32, mask, split

from clshade.oracle import texture
from clshade.pipeline import struct_layout
from clshade.pipeline.buffers import Buffer
from clshade.pipeline.launches import Stages
from clshade.pipeline.programs import build
from clshade.pipeline.shading_tables import texture_tables
from clshade.scene.model import Texture

SIZES = ((1, 1), (1, 5), (7, 1), (2, 2), (16, 9), (1024, 1))  # columns, rows
WRAPS = ("repeat", "clamp", "mirror")
KINDS = [("standard", wrap) for wrap in WRAPS] + [("standard", ("clamp", "mirror")), ("course", "repeat")]
# A mean of four texels: three differences and three sums, each rounded by 2^-24 of at most twice the largest texel.
MEAN = 8 * 2.0**-24


def image_of(size: tuple[int, int]) -> np.ndarray:
    """Return an image (h, w, 3) float32 from -1 to 1, with large differences between neighbors."""
    columns, rows = size
    return np.random.default_rng(columns + 100 * rows).uniform(-1, 1, (rows, columns, 3)).astype(np.float32)


TEXTURES = [Texture(image_of(size), wrap, lookup) for size in SIZES for lookup, wrap in KINDS]


def look_up(device, pairs: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Run the stage: colors (K, 3) of lookups in TEXTURES[which] at u, v and their low parts (K, 4)."""
    stages = Stages(device, build(device, mask(), ("bilerp.cl",)))
    inputs = pairs, which.astype(np.int32), *texture_tables(TEXTURES)
    names = ("uvs", "texture_of", "textures", "texels")
    values = {name: Buffer(device, array) for name, array in zip(names, inputs, strict=True)}
    colors = Buffer(device, np.full((len(pairs), 4), np.nan, np.float32))
    stages.run("bilerp", stages.vectors(len(pairs)), values, colors=colors, count=len(pairs))
    return colors.to_host()[:, :3]


def expected_of(uv: np.ndarray, which: np.ndarray) -> np.ndarray:
    colors = np.zeros((len(uv), 3))
    for index, chosen in enumerate(TEXTURES):
        colors[which == index] = texture.bilerp(uv[which == index], chosen.image, chosen.lookup, chosen.wrap)
    return colors


def test_every_wrap_and_lookup_at_random_coordinates(device):
    """In textures that differ from lane to lane. Coordinates have 48 bits: u * size errs by 4 * 2^-48 * |u| * size of a
    texel, and a color by 2 per texel."""
    rng = np.random.default_rng(1)
    count = 20_003
    uv = np.where(rng.random((count, 2)) < 0.5, rng.uniform(-0.2, 1.2, (count, 2)), rng.uniform(-300, 300, (count, 2)))
    uv[::4] *= np.exp2(rng.uniform(0, 30, uv[::4].shape))
    which = rng.integers(0, len(TEXTURES), count)
    colors, expected = look_up(device, np.concatenate(split(uv), axis=1), which), expected_of(uv, which)
    size = np.array([chosen.image.shape[1::-1] for chosen in TEXTURES])[which]
    moved = 2.0 * 4.0 * 2.0**-48 * (np.maximum(np.abs(uv), 1.0) * size).sum(axis=1)
    assert (np.abs(colors - expected).max(axis=1) <= MEAN + moved).all()
    # Coordinates in plain float32 would fail.
    rough = expected_of(float32(uv).astype(np.float64), which)
    assert np.abs(rough - expected).max() > 1e-3


FINITE = (0.0, -0.0, 1.0, -1.0, 2.0, 0.5, 1e-30, -1e-30, 1 - 2.0**-40, 1 + 2.0**-40, 1e30, -1e30, 3e38, -3e38, 1e-45)
SPECIAL = (*FINITE, np.nan, np.inf, -np.inf)
LOW = (np.nan, np.inf, 2.0, -1e30)  # after an overflow on the host


def test_special_coordinates(device):
    """0, 1, -0.0, huge, denormal, NaN and infinite coordinates: the oracle's texel, always inside the image. Low parts that
    are undefined or too large count as 0. Beyond 2^48 texels a coordinate is an integer: float64 and double-single agree."""
    uv = np.array([*itertools.product(SPECIAL, repeat=2), *[(0.25, 0.25)] * len(LOW)])
    high, low = split(uv)
    low[-len(LOW) :] = np.array(LOW)[:, None]
    count, textures = len(uv), np.arange(len(TEXTURES))
    which = np.repeat(textures, count)
    colors = look_up(device, np.tile(np.concatenate([high, low], axis=1), (len(textures), 1)), which)
    wrong = np.abs(colors - expected_of(np.tile(uv, (len(textures), 1)), which)).max(axis=1) > MEAN
    assert not wrong.any(), [(TEXTURES[k // count].wrap, *uv[k % count]) for k in np.flatnonzero(wrong)]
    limits = np.array([(chosen.image.min() - MEAN, chosen.image.max() + MEAN) for chosen in TEXTURES])[which]
    assert ((colors >= limits[:, :1]) & (colors <= limits[:, 1:])).all()


FOOTPRINT = """
#include "texture.clh"
kernel void texels(global const REAL *high, global const REAL *low, global const int *size, global const int *wrap,
                   global const int *lookup, global REAL *out)
{
    int i = get_global_id(0) * LANES;
    double_single u = {LOAD_LANES(high + i), LOAD_LANES(low + i)};
    Span span = texels_along(wrapped(u, wrap[i], lookup[i]), (ints)(size[i]), wrap[i], lookup[i], 0);
    REAL fraction[LANES];
    integer first[LANES], second[LANES];
    STORE_LANES(span.fraction, fraction);
    STORE_LANES(span.first, first);
    STORE_LANES(span.second, second);
    for (int k = 0; k < LANES; ++k) {
        out[3 * (i + k)] = first[k];
        out[3 * (i + k) + 1] = second[k];
        out[3 * (i + k) + 2] = fraction[k];
    }
}
"""


def shares_of(u: Fraction, size: int, lookup: str, wrap: str) -> dict[int, Fraction]:
    """Return the exact weight of each texel of a row at coordinate u."""
    held = min(max(u, Fraction(0)), Fraction(1))
    if lookup == "course":
        x = held * (size - 1)
    else:
        x = (held if wrap == "clamp" else u) * size - Fraction(1, 2)
    first, shares = math.floor(x), {}
    for i, share in ((first, first + 1 - x), (first + 1, x - first)):
        i = int(texture.wrapped_index(np.array(i), size, "clamp" if lookup == "course" else wrap))
        shares[i] = shares.get(i, Fraction(0)) + share
    return shares


def seam_coordinates(kind: type, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return double-single values of all magnitudes that the host admits, every other one within a few roundings of an
    integer."""
    rng = np.random.default_rng(4)
    unit = np.finfo(kind).epsneg
    high = (rng.choice([-1, 1], count) * np.exp2(rng.triangular(-4, 40, 40, count))).astype(kind)
    high[::2] = np.rint(high[::2]) + (rng.integers(-2, 3, count // 2) * unit * np.abs(np.rint(high[::2]))).astype(kind)
    low = (rng.choice([0.0, 1.0, -1.0, 0.5, 0.3], count) * unit * np.abs(high)).astype(kind)
    return high + low, low - ((high + low) - high)


@pytest.mark.sampled
@pytest.mark.parametrize("lanes", [None, 1])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_texels_across_the_seam(device, precision, lanes):
    """Texel weights at coordinates of 1/16 to 2^40, many of them next to an integer.

    A unit is 2^-24, in float64 2^-53: one for the fraction's rounding, one if a weight is 1 minus the fraction. As
    derived in texture.clh, 3 unit^2 of the coordinate and 4 of the position within the image, times texels.
    """
    skip_unsupported(device, {"precision": precision})
    kind = np.float64 if precision == "float64" else np.float32
    unit, count = float(np.finfo(kind).epsneg), 16 * 120
    high, low = seam_coordinates(kind, count)
    rng = np.random.default_rng(5)
    which = [rng.integers(len(WRAPS), size=count // 16), rng.integers(4, size=count // 16) // 3]
    sizes = np.repeat(rng.choice([1, 2, 3, 8, 1000, 32768], count // 16), 16)
    wraps, lookups = (np.repeat(a, 16) for a in which)
    numbers = np.array([struct_layout.CONSTANTS[f"WRAP_{wrap.upper()}"] for wrap in WRAPS])[wraps]
    modes = np.array([struct_layout.CONSTANTS[f"LOOKUP_{name}"] for name in ("STANDARD", "COURSE")])[lookups]
    arrays = (a.astype(np.int32) for a in (sizes, numbers, modes))
    probe = Probe(device, FOOTPRINT, lanes=lanes, DOUBLE=int(precision == "float64"))
    texels = probe("texels", high, low, *arrays, width=3, dtype=kind)
    for k in range(count):
        u = Fraction(float(high[k])) + Fraction(float(low[k]))
        expected = shares_of(u, int(sizes[k]), ("standard", "course")[lookups[k]], WRAPS[wraps[k]])
        first, second, fraction = (float(value) for value in texels[k])
        shares = {int(first): 1.0 - fraction}
        shares[int(second)] = shares.get(int(second), 0.0) + fraction
        wrong = max(abs(float(expected.get(i, 0)) - shares.get(i, 0.0)) for i in {*expected, *shares})
        within = unit * unit * (3.0 * abs(float(u)) + 4.0)
        assert wrong <= 2.0 * unit + within * int(sizes[k]), (float(high[k]), float(low[k]), k)
