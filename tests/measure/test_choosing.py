"""Properties of the Pareto front, and the variant chosen for a budget or a tolerance."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from clshade.cli.options import max_error, milliseconds
from clshade.measure.report.pareto import front, within_budget, within_tolerance
from clshade.measure.timing import Spread


@dataclass(frozen=True)
class Alternative:
    """spread: how far the quartiles lie from the median."""

    name: str
    cost: float
    error: float
    spread: float = 0.0

    @property
    def frame_ms(self) -> Spread:
        return Spread(self.cost - self.spread, self.cost, self.cost + self.spread)


# Few values, so that many are equal.
VALUES = st.sampled_from([0.5, 1.0, 2.0, 3.0, 7.0])
SOME = st.lists(st.tuples(VALUES, VALUES), min_size=1, max_size=12).map(
    lambda pairs: [Alternative(str(k), *pair) for k, pair in enumerate(pairs)]
)


def beats(a: Alternative, b: Alternative) -> bool:
    return a.cost <= b.cost and a.error <= b.error and (a.cost, a.error) != (b.cost, b.error)


@given(SOME)
def test_nothing_beats_the_front_and_it_leaves_nothing_out(some):
    frontier = front(some)
    assert not any(beats(rival, option) for option in frontier for rival in some)
    for option in some:
        assert any(rival.cost <= option.cost and rival.error <= option.error for rival in frontier)
    assert [option.cost for option in frontier] == sorted(option.cost for option in frontier)
    assert [option.error for option in frontier] == sorted((option.error for option in frontier), reverse=True)


def test_a_front_leaves_out_what_errors_are_not_known_to():
    some = [Alternative(str(k), 1.0 + k, error) for k, error in enumerate((0.5, 0.49, 0.47, 0.46, 0.1))]
    assert [option.error for option in front(some, 0.02)] == [0.5, 0.47, 0.1]


@given(SOME, VALUES)
def test_the_limits_are_kept_and_nothing_better_keeps_them(some, limit):
    affordable, exact = [p for p in some if p.cost <= limit], [p for p in some if p.error <= limit]
    if affordable:
        used = within_budget(some, limit)
        assert used in affordable
        assert used.error == min(option.error for option in affordable)
    if exact:
        used = within_tolerance(some, limit)
        assert used in exact
        assert used.cost == min(option.cost for option in exact)


def test_choices_within_noise():
    """A budget prefers the more accurate, a tolerance the faster."""
    quick, exact = Alternative("quick", 1.0, 0.5, 0.1), Alternative("exact", 5.2, 0.1, 0.4)
    assert within_budget([quick, exact], 4.4) == exact  # 4.8 is nearly 4.4
    assert within_budget([quick, exact], 4.3) == quick
    assert within_tolerance([quick, exact], 0.49, 0.02) == quick
    assert within_tolerance([quick, exact], 0.47, 0.02) == exact
    # Of two nearly as fast, the more accurate.
    closer = Alternative("closer", 1.05, 0.3, 0.1)
    assert within_tolerance([quick, closer], 0.6) == closer
    assert within_tolerance([quick, Alternative("slower", 1.2, 0.3, 0.1)], 0.6) == quick


def test_of_equally_accurate_ones_the_first():
    """However long each takes: the choice is the same when times are measured again."""
    first, second = Alternative("first", 1.0, 0.1001), Alternative("second", 0.97, 0.1)
    assert within_budget([first, second], 5.0, 0.01) == first
    assert within_budget([second, first], 5.0, 0.01) == second
    assert within_tolerance([first, second], 0.2, 0.01) == first
    assert within_budget([first, second], 5.0) == second


@pytest.mark.parametrize(
    ("text", "expected"),
    [("5ms", 5.0), ("0.005s", 5.0), ("5", 5.0), (" 2.5 MS ", 2.5), ("200us", 0.2), ("1e-2s", 10.0), (".5", 0.5)],
)
def test_times(text, expected):
    assert milliseconds(text) == pytest.approx(expected)


@pytest.mark.parametrize(
    "text", ["0", "0ms", "-5ms", "5m", "ms", "", "1.2.3s", "nan", "inf", "1e400s", "5 ms 3", "1e-400s"]
)
def test_times_that_are_none(text):
    with pytest.raises(argparse.ArgumentTypeError, match="expected a time above 0"):
        milliseconds(text)


def test_tolerances():
    assert max_error("1e-3") == 1e-3
    for text in ("0", "-1", "nan", "inf", "small", ""):
        with pytest.raises(argparse.ArgumentTypeError, match="expected an error above 0"):
            max_error(text)
