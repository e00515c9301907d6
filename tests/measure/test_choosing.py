"""Properties of the Pareto front, and the variant chosen for a budget or a tolerance."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from clshade.cli.commands.arguments import milliseconds, tolerance
from clshade.errors import InputError
from clshade.measure.report.pareto import chosen, front, within_budget, within_tolerance


@dataclass(frozen=True)
class Alternative:
    name: str
    cost: float
    error: float


# Few values, so that many are equal.
VALUES = st.sampled_from([0.5, 1.0, 2.0, 3.0, 7.0])
SOME = st.lists(st.tuples(VALUES, VALUES), min_size=1, max_size=12).map(
    lambda pairs: [Alternative(str(k), *pair) for k, pair in enumerate(pairs)]
)


def beats(a: Alternative, b: Alternative) -> bool:
    return a.cost <= b.cost and a.error <= b.error and (a.cost, a.error) != (b.cost, b.error)


@given(SOME)
def test_nothing_beats_the_front_and_it_leaves_nothing_out(some):
    found = front(some)
    assert not any(beats(other, each) for each in found for other in some)
    for each in some:
        assert any(beats(other, each) or (other.cost, other.error) == (each.cost, each.error) for other in found)
    assert [each.cost for each in found] == sorted({each.cost for each in found})
    assert [each.error for each in found] == sorted({each.error for each in found}, reverse=True)


@given(SOME, VALUES)
def test_the_limits_are_kept_and_nothing_better_keeps_them(some, limit):
    affordable, exact = [p for p in some if p.cost <= limit], [p for p in some if p.error <= limit]
    if affordable:
        used = within_budget(some, limit)
        assert used in affordable
        assert used.error == min(each.error for each in affordable)
        assert chosen(some, limit, None, 9.0) == used
    if exact:
        used = within_tolerance(some, limit)
        assert used in exact
        assert used.cost == min(each.cost for each in exact)
        assert chosen(some, None, limit, limit) == used
    assert chosen(some, None, None, 0.0) is None


def test_limits_that_nothing_keeps_name_the_best():
    some = [Alternative("slow", 9.0, 0.001), Alternative("quick", 2.0, 0.1)]
    with pytest.raises(InputError, match=r"--budget: .*the fastest, quick, takes 2 ms, found 1\.5 ms"):
        within_budget(some, 1.5)
    with pytest.raises(InputError, match=r"--tolerance: .*the best, slow, has 0\.001, found 0\.0001"):
        within_tolerance(some, 1e-4)


def test_a_tolerance_below_what_is_known_is_refused():
    """Even if a measured error is smaller."""
    some = [Alternative("slow", 9.0, 0.001), Alternative("quick", 2.0, 0.1)]
    assert within_tolerance(some, 0.01, 0.01).name == "slow"
    expected = r"--tolerance: expected at least 0\.02, which is .*the best, slow, has 0\.001\), found 0\.01"
    with pytest.raises(InputError, match=expected):
        within_tolerance(some, 0.01, 0.02)


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
    assert tolerance("1e-3") == 1e-3
    for text in ("0", "-1", "nan", "inf", "small", ""):
        with pytest.raises(argparse.ArgumentTypeError, match="expected an error above 0"):
            tolerance(text)
