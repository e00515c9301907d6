"""The numbers beside a color bar."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.images.colorbar import _ticks, with_colorbar


@pytest.mark.parametrize(
    ("ends", "labels"),
    [
        ((50.0, 320.0), ["50", "100", "150", "200", "250", "300"]),
        ((-1.0, 1.0), ["-1", "-0.5", "0", "0.5", "1"]),
        ((1e9, 1e9 + 1), ["1000000000", "1000000000.2", "1000000000.4", "1000000000.6", "1000000000.8", "1000000001"]),
        ((2.0, 2.0), ["2"]),
        ((-1.7e308, 1.7e308), ["-1.7e+308", "1.7e+308"]),
        ((0.0, 5e-324), ["0", "4.94066e-324"]),
    ],
)
def test_numbers_are_round_and_all_there(ends, labels):
    places, found = _ticks(*ends, 6)
    assert found == labels
    assert len(places) == len(labels)
    assert all(0.0 <= place <= 1.0 for place in places)


def test_any_ends_and_titles():
    image, ground = np.zeros((90, 7, 3), np.uint8), np.array([255, 255, 255], np.uint8)
    for ends in ((0.0, 0.0), (-1e308, 1e308), (0.0, 1e-310), (1e30, 1.00000001e30)):
        assert with_colorbar(image, "jet", ends, "a $\\frac name\n" * 20, ground).shape[0] == 90
