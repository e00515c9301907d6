"""Colors as people write them; Y'CbCr planes of BT.709 against the recommendation's formulas, places of chroma samples."""

import numpy as np
import pytest

from clshade import Edges, Scalars, Settings
from clshade.errors import InputError
from clshade.images.colors import encoded_rgb, linear_rgb
from clshade.images.decode import srgb_to_linear
from clshade.view.video import even, planes_420

GRAY = float(srgb_to_linear(np.array([128 / 255]))[0])


@pytest.mark.parametrize(
    ("color", "expected"),
    [
        ("#ff8000", (1.0, GRAY, 0.0)),
        ("#F00", (1.0, 0.0, 0.0)),
        ("gray", (GRAY, GRAY, GRAY)),
        ((0.25, 0, 7), (0.25, 0.0, 7.0)),
        (np.array([1, 2, 3]), (1.0, 2.0, 3.0)),
    ],
)
def test_linear(color, expected):
    assert linear_rgb("", "", color) == pytest.approx(expected, abs=1e-12)
    assert Edges(color=color).color == pytest.approx(expected, abs=1e-12)
    assert Settings(background=color).background == pytest.approx(expected, abs=1e-12)


def test_encoded():
    assert encoded_rgb("", "", "#ff8000") == (1.0, 128 / 255, 0.0)
    assert encoded_rgb("", "", f"1,{GRAY},0") == pytest.approx((1.0, 128 / 255, 0.0), abs=1e-12)
    assert Scalars("a", nan_color=f"0,0,{GRAY}").nan_color == pytest.approx((0.0, 0.0, 128 / 255), abs=1e-12)
    assert encoded_rgb("", "", (0.5, 0.25, 1)) == (0.5, 0.25, 1.0)  # as Matplotlib takes it
    with pytest.raises(InputError, match="from 0 to 1"):
        encoded_rgb("", "", "0,0,1.5")


@pytest.mark.parametrize("wrong", ["", "0.5", "1,2,x", "-1,0,0", "nan,0,0", "1e39,0,0", "#12345", "blau", (1, 2), True])
def test_what_is_no_color(wrong):
    for make in (lambda: linear_rgb("x", "y", wrong), lambda: Settings(background=wrong), lambda: Edges(color=wrong)):
        with pytest.raises(InputError, match="expected a name such as white, #rrggbb"):
            make()


def formula(rgb: np.ndarray, bits: int) -> np.ndarray:
    """Items 3.2 to 3.4 of BT.709-6, written out: codes, not rounded."""
    r, g, b = np.moveaxis(np.asarray(rgb, np.float64), -1, 0)
    y = 0.2126 * r + 0.7152 * g + 0.0722 * b
    return np.stack([219 * y + 16, 224 * (b - y) / 1.8556 + 128, 224 * (r - y) / 1.5748 + 128]) * (2.0 ** (bits - 8))


@pytest.mark.parametrize("bits", [8, 10])
def test_codes_are_the_formula_rounded_once(bits):
    """The largest error is half a code, and the roundings of float32: 1e-4 of a code of 10 bits."""
    blocks = np.random.default_rng(1).uniform(0, 1, (20, 30, 3))
    y, cb, cr = planes_420(np.repeat(np.repeat(blocks, 4, axis=0), 4, axis=1), bits)
    assert y.dtype == cb.dtype == cr.dtype == (np.uint8 if bits == 8 else np.uint16)
    codes = y[1::4, 1::4], cb[1::2, 1::2], cr[1::2, 1::2]  # right halves: no weight on a neighboring block
    errors = np.abs(np.array(codes, np.float64) - formula(blocks, bits)).max(axis=(1, 2))
    assert errors.max() <= 0.5 + 1e-3
    assert errors[0] > 0.4


def test_a_chroma_sample_lies_on_the_left_column_between_the_rows():
    """Of a ramp in x its value is that at the even column; of a ramp in y, that halfway between two rows."""
    across, down = np.meshgrid(np.linspace(0, 1, 64), np.linspace(0, 1, 32))
    _, cb, cr = planes_420(np.stack([across, np.zeros_like(across), down], axis=-1), 16)
    rows, columns = (down[0::2] + down[1::2])[:, 0::2] / 2, across[0::2, 0::2]
    expected = formula(np.stack([columns, np.zeros_like(columns), rows], axis=-1), 16)[1:]
    # float32 rounds codes near 2^16 to 2^-8 of one; the first column has its own copy as left neighbor.
    assert np.abs(np.array([cb, cr], np.float64) - expected)[..., 1:].max() <= 0.5 + 2.0**-6


def test_odd_sides_are_made_even():
    image = np.arange(3 * 5 * 3, dtype=np.uint8).reshape(3, 5, 3)
    assert np.array_equal(even(image), np.pad(image, ((0, 1), (0, 1), (0, 0)), "edge"))
    assert [even(part).shape for part in (image[:2, :4], image[:1, :1])] == [(2, 4, 3), (2, 2, 3)]


@pytest.mark.parametrize("shape", [(3, 2, 3), (2, 2, 4), (0, 2, 3)])
def test_refused_images(shape):
    with pytest.raises(InputError, match="ycbcr: rgb: expected shape"):
        planes_420(np.zeros(shape, np.uint8))
