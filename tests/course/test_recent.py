"""Results cached between calls: found by content, the oldest dropped first."""

from __future__ import annotations

import numpy as np

from clshade.course import ContentCache, are_equal


def make_recent(**limits):
    made, dropped = [], []

    def make(*arguments):
        made.append(arguments)
        return f"result {len(made)}"

    return ContentCache(make, dropped.append, **limits), made, dropped


def test_equal_arguments_give_the_kept_result():
    recent, made, _ = make_recent()
    array = np.arange(6.0).reshape(2, 3)
    assert recent.get("a", array, 1.0) == "result 1"
    assert recent.get("a", array.copy(), 1.0) == "result 1"
    assert recent.get("b", array, 1.0) == "result 2"
    assert recent.get("a", array.astype(np.float32), 1.0) == "result 3"
    assert recent.get("a", array.reshape(3, 2), 1.0) == "result 4"
    assert len(made) == 4


def test_changed_arrays_are_not_mistaken():
    recent, made, _ = make_recent()
    array = np.zeros(5)
    recent.get(array)
    array[3] = -0.0
    assert recent.get(array) == "result 2"
    array[3] = 0.0
    assert recent.get(array) == "result 1"
    assert made[0][0] is not array


def test_the_oldest_go_first():
    recent, _, dropped = make_recent(max_count=2)
    for name in "abac":
        recent.get(name)
    assert dropped == ["result 2"]
    assert recent.get("a") == "result 1"
    recent.clear()
    assert sorted(dropped) == ["result 1", "result 2", "result 3"]


def test_large_arrays_push_others_out():
    recent, _, dropped = make_recent(max_count=9, max_bytes=1000)
    recent.get(np.zeros(50))
    recent.get(np.zeros(60))
    assert recent.get(np.zeros(500)) == "result 3"
    assert dropped == ["result 1", "result 2"]
    assert recent.get(np.zeros(500)) == "result 3"


def test_equality():
    assert are_equal(np.array([np.nan]), np.array([np.nan]))
    assert are_equal(np.zeros((0, 3)), np.zeros((0, 3)))
    assert are_equal(np.zeros(3, np.uint8), np.zeros(3, np.uint8))
    assert not are_equal(np.zeros(1), 0.0)
    assert not are_equal(0.0, np.zeros(1))
    assert not are_equal(1, 1.0)
    assert not are_equal(None, 0)
