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
def test_levels_of_any_size(size):
    """Sizes are halved and rounded down (OpenGL 4.6, section 8.14.3). Host and oracle compute the same means in float64:
    rounded they are equal but for ties, which random texels do not have; 8-bit values do, but their sums are exact. Each
    texel is weighted by its area, so that no size loses or doubles a row; a constant stays the same to the last bit."""
    image = image_of(size)
    shapes = [level.shape[1::-1] for level in smaller_levels(image)]
    assert shapes == [tuple(max(extent >> k, 1) for extent in size) for k in range(1, max(size).bit_length())]
    for texels in (image, np.rint(image * 255).astype(np.float32) / 255):
        first, *expected = texture.levels(texels)
        assert np.array_equal(first, texels)
        for mipmap, level in zip(smaller_levels(texels), expected, strict=True):
            assert np.array_equal(mipmap, level)
            mean, of_image = (a.mean(axis=(0, 1), dtype=np.float64) for a in (mipmap, texels))
            assert np.abs(mean - of_image).max() < 2.0**-24
    color = np.float32([0.1, 1 / 3, 3.4e38])
    for shape in (size[::-1], (1, 32767)):
        assert all((level == color).all() for level in smaller_levels(np.broadcast_to(color, (*shape, 3))))


def test_odd_sizes_weigh_by_area():
    """Of five rows, the first new one covers two and a half; of three rows, the only one covers all."""
    rows = np.float32([1, 10, 100, 1000, 10000]).reshape(5, 1, 1)
    first, second = smaller_levels(rows)
    assert first[:, 0, 0] == pytest.approx([(1 + 10 + 50) / 2.5, (50 + 1000 + 10000) / 2.5])
    assert second[0, 0, 0] == pytest.approx(11111 / 5)
    assert smaller_levels(np.float32([1, 2, 6]).reshape(1, 3, 1))[0].item() == 3.0


@pytest.mark.parametrize("size", [(BAND // 6 - 1, 12), (901, 701)])
def test_bands_of_rows_change_no_bit(monkeypatch, size):
    """One row per band, or all; and images that need several bands by default."""
    image = image_of(size)
    levels = smaller_levels(image)
    for band in (1, 1 << 40):
        monkeypatch.setattr("clshade.pipeline.shading_tables.BAND", band)
        for level, same in zip(levels, smaller_levels(image), strict=True):
            assert level.tobytes() == same.tobytes()


def test_a_large_image_takes_little_memory():
    """Relative to the float32 image: the first level in float64 1/2, all in float32 1/3, the next in float64 1/8 while
    it is computed; and a few bands."""
    image = np.ones((2047, 2047, 3), np.float32)
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
        for number, level in enumerate([chosen.image, *smaller_levels(chosen.image[..., :3])][: row["levels"]]):
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
    # The largest texture has room for all its levels.
    table, texels = texture_tables([Texture(np.ones((1, 32768, 3), np.float32))], mipmaps=True)
    assert table["levels"][0] == struct_layout.MOST_LEVELS
    assert len(texels) == 65535
