"""Y'CbCr planes of BT.709 against the formulas of the recommendation, and the place of chroma samples."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.images.ycbcr import even, planes_420


def formula(rgb: np.ndarray, bits: int) -> np.ndarray:
    """Items 3.2 to 3.4 of BT.709-6, written out: codes, not rounded."""
    r, g, b = np.moveaxis(np.asarray(rgb, np.float64), -1, 0)
    y = 0.2126 * r + 0.7152 * g + 0.0722 * b
    scale = 2.0 ** (bits - 8)
    return np.stack([219 * y + 16, 224 * (b - y) / 1.8556 + 128, 224 * (r - y) / 1.5748 + 128]) * scale


@pytest.mark.parametrize(
    ("color", "codes"),
    [
        ((0, 0, 0), (16, 128, 128)),
        ((255, 255, 255), (235, 128, 128)),
        ((255, 0, 0), (63, 102, 240)),
        ((0, 255, 0), (173, 42, 26)),
        ((0, 0, 255), (32, 240, 118)),
    ],
)
def test_colors_of_a_test_card(color, codes):
    planes = planes_420(np.full((2, 2, 3), color, np.uint8))
    assert tuple(int(plane[0, 0]) for plane in planes) == codes


@pytest.mark.parametrize("bits", [8, 10])
def test_codes_are_the_formula_rounded_once(bits):
    """The largest error is half a code, and the roundings of float32: 1e-4 of a code of 10 bits."""
    blocks = np.random.default_rng(1).uniform(0, 1, (20, 30, 3))
    image = np.repeat(np.repeat(blocks, 4, axis=0), 4, axis=1)
    y, cb, cr = planes_420(image, bits)
    assert y.dtype == cb.dtype == cr.dtype == (np.uint8 if bits == 8 else np.uint16)
    expected = formula(blocks, bits)
    assert np.abs(y[1::4, 1::4] - expected[0]).max() <= 0.5 + 1e-3
    assert np.abs(cb[1::2, 1::2] - expected[1]).max() <= 0.5 + 1e-3  # right halves: no weight on a neighboring block
    assert np.abs(cr[1::2, 1::2] - expected[2]).max() <= 0.5 + 1e-3
    assert np.abs(y[1::4, 1::4] - expected[0]).max() > 0.4


def test_a_chroma_sample_lies_on_the_left_column_between_the_rows():
    """Of a ramp in x its value is that at the even column; of a ramp in y, that halfway between two rows."""
    across, down = np.meshgrid(np.linspace(0, 1, 64), np.linspace(0, 1, 32))
    _, cb, cr = planes_420(np.stack([across, np.zeros_like(across), down], axis=-1), 16)
    rows, columns = (down[0::2] + down[1::2])[:, 0::2] / 2, across[0::2, 0::2]
    expected = formula(np.stack([columns, np.zeros_like(columns), rows], axis=-1), 16)
    # float32 rounds codes near 2^16 to 2^-8 of one; the first column has its own copy as left neighbor.
    assert np.abs(cb - expected[1])[:, 1:].max() <= 0.5 + 2.0**-6
    assert np.abs(cr - expected[2])[:, 1:].max() <= 0.5 + 2.0**-6


def test_odd_sides_are_made_even():
    image = np.arange(3 * 5 * 3, dtype=np.uint8).reshape(3, 5, 3)
    whole = even(image)
    assert whole.shape == (4, 6, 3)
    assert (whole[:3, :5] == image).all()
    assert (whole[3, :5] == image[2]).all()
    assert (whole[:, 5] == whole[:, 4]).all()
    assert even(image[:2, :4]).shape == (2, 4, 3)
    assert even(image[:1, :1]).shape == (2, 2, 3)


@pytest.mark.parametrize("shape", [(3, 2, 3), (2, 3, 3), (2, 2), (2, 2, 4), (0, 2, 3)])
def test_refused_images(shape):
    with pytest.raises(InputError, match="ycbcr: rgb: expected shape"):
        planes_420(np.zeros(shape, np.uint8))
