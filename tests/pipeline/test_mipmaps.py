"""Mipmap levels: of the host, of the oracle, and in the tables that the kernels read."""

from __future__ import annotations

import gc
import tracemalloc
import weakref

import numpy as np
import pytest

from clshade.oracle import texture
from clshade.pipeline import struct_layout
from clshade.pipeline.shading_tables import BAND, levels_below, smaller_levels, texture_tables
from clshade.scene.model import Texture

SIZES = ((1, 1), (1, 5), (7, 1), (2, 2), (3, 3), (16, 9), (37, 53), (64, 64), (96, 80))  # columns, rows


def image_of(size: tuple[int, int], channels: int = 3) -> np.ndarray:
    columns, rows = size
    return np.random.default_rng(columns + 100 * rows).uniform(0, 1, (rows, columns, channels)).astype(np.float32)


@pytest.mark.parametrize("size", SIZES)
def test_sizes_are_halved_and_rounded_down_to_a_single_texel(size):
    shapes = [level.shape[1::-1] for level in smaller_levels(image_of(size))]
    assert shapes == [
        tuple(max(extent >> k, 1) for extent in size) for k in range(1, max(size).bit_length())
    ]  # OpenGL 4.6, section 8.14.3


@pytest.mark.parametrize("size", SIZES)
def test_host_and_oracle_agree(size):
    """Two float64 computations of the same means: rounded to float32 they are equal except for ties, which random
    texels do not have. 8-bit values do have ties, but their sums are exact, so they are rounded alike."""
    for image in (image_of(size), np.rint(image_of(size) * 255).astype(np.float32) / 255):
        first, *expected = texture.levels(image)
        assert np.array_equal(first, image)
        for mipmap, level in zip(smaller_levels(image), expected, strict=True):
            assert np.array_equal(mipmap, level)


@pytest.mark.parametrize("size", SIZES)
def test_every_level_has_the_mean_of_the_image(size):
    """Each texel is weighted by its area, so that no size loses or doubles a row. Rounded to float32: 2^-24 of at most
    1."""
    image = image_of(size)
    for level in smaller_levels(image):
        assert (
            np.abs(level.mean(axis=(0, 1), dtype=np.float64) - image.mean(axis=(0, 1), dtype=np.float64)).max()
            < 2.0**-24
        )


def test_odd_sizes_weigh_by_area():
    """Of five rows, the first new one covers two and a half; of three rows, the only one covers all."""
    rows = np.float32([1, 10, 100, 1000, 10000]).reshape(5, 1, 1)
    first, second = smaller_levels(rows)
    assert first[:, 0, 0] == pytest.approx([(1 + 10 + 50) / 2.5, (50 + 1000 + 10000) / 2.5])
    assert second[0, 0, 0] == pytest.approx(11111 / 5)
    assert smaller_levels(np.float32([1, 2, 6]).reshape(1, 3, 1))[0].item() == 3.0


@pytest.mark.parametrize("size", SIZES)
def test_a_constant_stays_the_same_to_the_last_bit(size):
    """Also after fifteen levels, and for values that are not sums of few powers of two."""
    color = np.float32([0.1, 1 / 3, 3.4e38])
    for level in smaller_levels(np.broadcast_to(color, (*size[::-1], 3))):
        assert (level == color).all()
    for level in smaller_levels(np.broadcast_to(color, (1, 32767, 3))):
        assert (level == color).all()


@pytest.mark.parametrize("size", [(2 * BAND // 30, 11), (BAND // 6 - 1, 12), (700, 900), (901, 701)])
def test_bands_of_rows_change_no_bit(monkeypatch, size):
    """One row per band, several, or all; and images that need several bands by default."""
    image = image_of(size)
    levels = smaller_levels(image)
    for band in (1, 1 << 40):
        monkeypatch.setattr("clshade.pipeline.shading_tables.BAND", band)
        for level, same in zip(levels, smaller_levels(image), strict=True):
            assert level.tobytes() == same.tobytes()


@pytest.mark.parametrize("side", [2048, 2047])
def test_a_large_image_takes_little_memory(side):
    """Relative to the float32 image: the first level in float64 1/2, all in float32 1/3, the next in float64 1/8 while
    it is computed; and a few bands."""
    image = np.ones((side, side, 3), np.float32)
    tracemalloc.start()
    try:
        smaller_levels(image)
        assert tracemalloc.get_traced_memory()[1] < 1.0 * image.nbytes + 4 * 8 * BAND
    finally:
        tracemalloc.stop()


def test_levels_are_kept_as_long_as_their_texture():
    texture = Texture(image_of((16, 9), 4))
    levels = levels_below(texture)
    assert levels_below(texture) is levels
    assert levels_below(Texture(texture.image)) is not levels
    assert [level.shape[2] for level in levels] == [3] * 4
    kept = weakref.ref(levels[0])
    del texture, levels
    gc.collect()
    assert kept() is None


def test_levels_lie_behind_their_texture():
    """Each texture's own texels come first, with its alpha; levels are opaque, and exist only for the standard
    lookup."""
    textures = [Texture(image_of((5, 4), 4)), Texture(image_of((6, 3)), lookup="course"), Texture(image_of((16, 9)))]
    table, texels = texture_tables(textures, mipmaps=True)
    assert table["levels"].tolist() == [3, 1, 5]
    end = 0
    for row, chosen in zip(table, textures, strict=True):
        levels = [chosen.image, *smaller_levels(chosen.image[..., :3])][: row["levels"]]
        for number, level in enumerate(levels):
            count = level.shape[0] * level.shape[1]
            assert row["offset"][number] == end
            stored = texels[end : end + count]
            assert np.array_equal(stored[:, :3], level[..., :3].reshape(count, 3))
            assert np.array_equal(stored[:, 3], level[..., 3].ravel() if level.shape[2] == 4 else np.ones(count))
            end += count
    assert len(texels) == end
    plain, plain_texels = texture_tables(textures)
    assert plain["levels"].tolist() == [1, 1, 1]
    assert len(plain_texels) == sum(chosen.image[..., 0].size for chosen in textures)


def test_the_largest_texture_has_room_for_its_levels():
    table, texels = texture_tables([Texture(np.ones((1, 32768, 3), np.float32))], mipmaps=True)
    assert table["levels"][0] == struct_layout.MOST_LEVELS
    assert len(texels) == 65535
