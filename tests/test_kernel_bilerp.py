"""bilerp.cl and texture.clh against the oracle's texture lookups."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from clshade import layout
from clshade.oracle import texture
from clshade.packing import texture_tables
from clshade.programs import build
from clshade.scene import Texture
from clshade.stages import Buffer, Stages
from kernels import OTHER_LANES, Probe, bits, float32, mask, split

SIZES = ((1, 1), (1, 5), (7, 1), (2, 2), (16, 9), (1024, 1))  # columns, rows
WRAPS = ("repeat", "clamp", "mirror")
KINDS = [("standard", wrap) for wrap in WRAPS] + [("standard", ("clamp", "mirror")), ("course", "repeat")]
# A mean of four texels: three differences and three sums, each rounded by 2^-24 of at most twice the largest texel.
MEAN = 8 * 2.0**-24


def image_of(size: tuple[int, int]) -> np.ndarray:
    """(h, w, 3) float32 from -1 to 1, neighbors far apart."""
    columns, rows = size
    return np.random.default_rng(columns + 100 * rows).uniform(-1, 1, (rows, columns, 3)).astype(np.float32)


TEXTURES = [Texture(image_of(size), wrap, lookup) for size in SIZES for lookup, wrap in KINDS]


def look_up(device, uv: np.ndarray, which: np.ndarray, lanes: int | None = None) -> np.ndarray:
    """(K, 3) colors of lookups uv (K, 2) float64 in TEXTURES[which], by the stage."""
    stages = Stages(device, build(device, mask(), ("bilerp.cl",), lanes=lanes))
    u, v = (split(column) for column in uv.T)
    pairs = np.stack([u[0], v[0], u[1], v[1]], axis=1)
    table, texels = texture_tables(TEXTURES)
    inputs = [Buffer(device, array) for array in (pairs, which.astype(np.int32), table, texels)]
    colors = Buffer(device, np.full((len(uv), 4), np.nan, np.float32))
    stages.bilerp(*inputs, colors, len(uv))
    return colors.to_host()[:, :3]


def expected_of(uv: np.ndarray, which: np.ndarray) -> np.ndarray:
    found = np.zeros((len(uv), 3))
    for index, chosen in enumerate(TEXTURES):
        mine = which == index
        found[mine] = texture.bilerp(uv[mine], chosen.image, chosen.lookup, chosen.wrap)
    return found


def test_every_wrap_and_lookup_at_random_coordinates(device):
    """Coordinates reach 48 bits: u * size moves by 4 * 2^-48 * |u| * size of a texel, and a color by 2 per texel."""
    rng = np.random.default_rng(1)
    count = 20_000
    uv = np.where(rng.random((count, 2)) < 0.5, rng.uniform(-0.2, 1.2, (count, 2)), rng.uniform(-300, 300, (count, 2)))
    which = rng.integers(0, len(TEXTURES), count)
    found, expected = look_up(device, uv, which), expected_of(uv, which)
    size = np.array([chosen.image.shape[1::-1] for chosen in TEXTURES])[which]
    moved = 2.0 * 4.0 * 2.0**-48 * (np.maximum(np.abs(uv), 1.0) * size).sum(axis=1)
    assert (np.abs(found - expected).max(axis=1) <= MEAN + moved).all()
    # A coordinate in float32 alone would not do.
    rough = expected_of(float32(uv).astype(np.float64), which)
    assert np.abs(rough - expected).max() > 1e-3


def test_texel_centers_are_exact(device):
    """At its own center (standard), or at i/(w-1) where that is a float32 (course), a texel comes out to the last bit."""
    for index, chosen in enumerate(TEXTURES):
        rows, columns, _ = chosen.image.shape
        if columns not in (1, 2, 16, 1024) or rows not in (1, 2):
            continue
        i, j = (a.ravel() for a in np.meshgrid(np.arange(columns), np.arange(rows)))
        if chosen.lookup == "standard":
            uv = np.stack([(i + 0.5) / columns, (j + 0.5) / rows], axis=1)
        elif columns == 1024:
            continue
        else:
            uv = np.stack([i / max(columns - 1, 1), j / max(rows - 1, 1)], axis=1)
        found = look_up(device, uv, np.full(len(uv), index))
        assert np.array_equal(found, chosen.image[j, i]), (chosen.lookup, chosen.wrap, columns, rows)


SPECIAL = (0.0, -0.0, 1.0, -1.0, 2.0, 0.5, 1e-30, -1e-30, 1 - 2.0**-40, 1 + 2.0**-40, 1e30, -1e30, 3e38, -3e38, 1e-45)
UNDEFINED = (np.nan, np.inf, -np.inf)


@pytest.mark.parametrize("kind", range(len(KINDS)), ids=["repeat", "clamp", "mirror", "clamp-mirror", "course"])
def test_special_coordinates(device, kind):
    """0, 1, -0.0, far beyond, denormal, NaN and infinite: the oracle's texel, all of them inside the image.

    Beyond 2^48 texels a coordinate is a whole number: float64 and the pair agree on the texel.
    """
    uv = np.array(list(itertools.product(SPECIAL + UNDEFINED, repeat=2)))
    for size in range(len(SIZES)):
        index = size * len(KINDS) + kind
        which = np.full(len(uv), index)
        found, expected = look_up(device, uv, which), expected_of(uv, which)
        assert np.abs(found - expected).max() <= MEAN, SIZES[size]
        image = TEXTURES[index].image
        assert (found >= image.min() - MEAN).all()
        assert (found <= image.max() + MEAN).all()


def test_undefined_low_parts_count_as_zero(device):
    """What the host leaves of an overflow is NaN or infinite: of no effect."""
    uv = np.array([[0.25, 0.25]])
    stages = Stages(device, build(device, mask(), ("bilerp.cl",)))
    table, texels = texture_tables(TEXTURES)
    for low in (np.nan, np.inf, 2.0, -1e30):
        pairs = float32([[0.25, 0.25, low, low]])
        for index in range(len(KINDS) * 4, len(KINDS) * 5):  # those of 16 x 9 texels
            inputs = [Buffer(device, a) for a in (pairs, np.array([index], np.int32), table, texels)]
            colors = Buffer(device, np.zeros((1, 4), np.float32))
            stages.bilerp(*inputs, colors, 1)
            assert np.abs(colors.to_host()[0, :3] - expected_of(uv, np.array([index]))).max() <= MEAN


FOOTPRINT = """
#include "texture.clh"
kernel void texels(global const float *high, global const float *low, global const int *size, global const int *wrap,
                   global const int *lookup, global float *out)
{
    int i = get_global_id(0) * LANES;
    pairs u = {LOAD_LANES(high + i), LOAD_LANES(low + i)};
    Span span = texels_along(wrapped(u, wrap[i], lookup[i]), (ints)(size[i]), wrap[i], lookup[i]);
    float fraction[LANES];
    int first[LANES], second[LANES];
    STORE_LANES(span.fraction, fraction);
    STORE_LANES(span.first, first);
    STORE_LANES(span.second, second);
    for (int k = 0; k < LANES; ++k)
        vstore3((float3)(first[k], second[k], fraction[k]), i + k, out);
}
"""


def test_indices_stay_in_the_image_and_fractions_between_0_and_1(device):
    """All bit patterns as coordinates, whatever they mean; sizes up to the largest."""
    rng = np.random.default_rng(2)
    count = 16 * 2000
    high, low = (rng.integers(0, 2**32, count, np.uint32).view(np.float32) for _ in range(2))
    low[::2] = 0.0
    near = rng.uniform(-3, 3, count // 2).astype(np.float32)
    high[: count // 2] = near
    low[: count // 2] = near * rng.uniform(-(2.0**-24), 2.0**-24, count // 2).astype(np.float32)
    per_block = [
        np.repeat(a, 16).astype(np.int32)
        for a in (
            rng.choice([1, 2, 3, 1000, 32768], count // 16),
            rng.integers(0, 3, count // 16),
            rng.integers(0, 2, count // 16),
        )
    ]
    found = Probe(device, FOOTPRINT)("texels", high, low, *per_block, width=3)
    assert ((found[:, :2] >= 0) & (found[:, :2] < per_block[0][:, None])).all()
    assert ((found[:, 2] >= 0.0) & (found[:, 2] <= 1.0)).all()


@pytest.mark.parametrize("lanes", OTHER_LANES)
def test_lanes_and_mixed_textures_do_not_change_a_bit(device, lanes):
    """Lookups in different textures side by side, in a number that fills no group, come out as those alone."""
    rng = np.random.default_rng(3)
    count = 1003
    uv, which = rng.uniform(-2, 3, (count, 2)), rng.integers(0, len(TEXTURES), count)
    first, other = (bits(look_up(device, uv, which, count)) for count in (16, lanes))
    assert np.array_equal(first, other)
    order = np.argsort(which, kind="stable")
    assert np.array_equal(first[order], bits(look_up(device, uv[order], which[order])))


def test_the_tables_hold_what_the_textures_say():
    table, texels = texture_tables(TEXTURES[: len(KINDS) * 2])
    offset = 0
    for row, chosen in zip(table, TEXTURES[: len(KINDS) * 2], strict=True):
        rows, columns, _ = chosen.image.shape
        assert (row["offset"][0], row["width"], row["height"]) == (offset, columns, rows)
        assert row["wrap"].tolist() == [layout.CONSTANTS[f"WRAP_{wrap.upper()}"] for wrap in chosen.wrap]
        assert row["lookup"] == layout.CONSTANTS[f"LOOKUP_{chosen.lookup.upper()}"]
        assert np.array_equal(texels[offset : offset + rows * columns, :3], chosen.image.reshape(-1, 3))
        offset += rows * columns
    assert len(texels) == offset
