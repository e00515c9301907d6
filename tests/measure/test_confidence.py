"""A random sample, and its bound."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from clshade.measure.verify.confidence import rounded_up, sampled, upper_bound


@pytest.mark.parametrize(("faults", "looked_at"), [(0, 10), (1, 10), (3, 40), (39, 40), (0, 4605)])
def test_the_bound_is_where_so_few_are_found_with_one_percent(faults, looked_at):
    share = Fraction(upper_bound(faults, looked_at, 10**6))
    ways = (math.comb(looked_at, k) * share**k * (1 - share) ** (looked_at - k) for k in range(faults + 1))
    assert float(sum(ways)) == pytest.approx(0.01, rel=1e-9)


def test_the_bound_of_all_pixels_is_their_share():
    assert upper_bound(3, 12, 12) == 0.25
    assert upper_bound(12, 12, 13) == 1.0


def test_4605_pixels_are_the_fewest_that_bound_a_thousandth():
    assert upper_bound(0, 4605, 480000) < 0.001 < upper_bound(0, 4602, 480000)
    assert rounded_up(upper_bound(0, 4605, 480000)) == "0.1 %"
    assert [rounded_up(share) for share in (0.0, 0.01001, 0.5, 0.999)] == ["0 %", "1.1 %", "50 %", "100 %"]


@pytest.mark.parametrize(("of", "count"), [(1000, 900), (7, 7), (7, 9), (1, 1)])
def test_a_sample_has_no_pixel_twice(of, count):
    index = sampled(of, count, 3)
    assert np.array_equal(index, sampled(of, count, 3))
    assert len(index) == min(of, count)
    assert 0 <= index[0] <= index[-1] < of
    assert (np.diff(index) > 0).all()


def test_every_pixel_is_as_likely_to_be_in_the_sample():
    drawn = np.bincount(np.concatenate([sampled(20, 5, seed) for seed in range(800)]), minlength=20)
    assert np.abs(drawn - 200).max() < 80  # 6.5 standard deviations
