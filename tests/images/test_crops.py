"""Magnified crops, and the image with their places."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.images.crops import COLORS, SIDE, Crop, magnified, marked

IMAGE = np.random.default_rng(5).integers(0, 256, (40, 60, 3), dtype=np.uint8)


def test_every_pixel_becomes_a_square():
    large = magnified(IMAGE, Crop(10, 20, 3, 2, 5))
    assert large.shape == (10, 15, 3)
    for row in range(10):
        for column in range(15):
            assert (large[row, column] == IMAGE[20 + row // 5, 10 + column // 5]).all()


@pytest.mark.parametrize(
    ("crop", "scale"), [((0, 0, 60, 40), 8), ((0, 0, 1, 1), 64), ((0, 0, 60, 40, 3), 3), ((0, 0, 600, 10), 1)]
)
def test_scale(crop, scale):
    found = Crop(*crop).scale
    assert found == scale
    assert found in (1, 3, 64) or found * 60 <= SIDE < (found + 1) * 60


def test_marks_lie_outside_the_crops():
    crops = [Crop(24, 20, 12, 9), Crop(40, 0, 20, 8), Crop(0, 30, 5, 10)]
    found = marked(IMAGE, crops)
    for crop in crops:
        inside = np.s_[crop.y : crop.y + crop.height, crop.x : crop.x + crop.width]
        assert (found[inside] == IMAGE[inside]).all()
    assert (found[29, 24:36] == COLORS[0]).all()  # below the first
    assert (found[30, 26:36] == 0).all()
    assert (found[20:30, 36] == COLORS[0]).all()
    assert IMAGE.flags.writeable  # a copy was drawn into
    assert (marked(IMAGE, []) == IMAGE).all()


def test_one_crop_has_no_number():
    changed = (marked(IMAGE, [Crop(20, 20, 4, 4)]) != IMAGE).any(axis=-1)
    rows, columns = np.nonzero(changed)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (18, 25, 18, 25)


@pytest.mark.parametrize(
    ("crop", "part"),
    [
        ((0, 0, 61, 10), "within 60 x 40 pixels"),
        ((0, 35, 6, 6), "within 60 x 40 pixels"),
        ((-1, 0, 6, 6), "within 60 x 40 pixels"),
        ((0, 0, 6, 6, 65), "a factor from 1 to 64"),
    ],
)
def test_refused(crop, part):
    with pytest.raises(InputError, match=part):
        Crop(*crop).check("--crop-zoom", 60, 40)
    Crop(54, 34, 6, 6, 64).check("--crop-zoom", 60, 40)
