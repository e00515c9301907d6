"""`stability --functions`: errors of every function of one number, for every float32."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import assert_refused, run

from clshade.measure.stability import functions
from clshade.measure.stability.functions import CHUNK, FUNCTIONS, Kernels, histogram, of_function, of_tonemap

ONE = int(np.float32(1.0).view(np.uint32))


def test_a_histogram_counts_and_names_the_worst():
    x = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], np.float32)
    error = np.array([[0.5, 0.25, 1.5], [0.75, 20.0, 20.0]])
    found = histogram("f", "float32", 20.0, iter(zip(x, error, strict=True)))
    assert (found.inputs, found.largest, found.at, found.within) == (6, 20.0, 5.0, (2, 3, 4, 4))
    assert found.passed
    assert not replace(found, allowed=19.9).passed
    assert replace(found, allowed=19.9).row()[3] == "20 ! of 19.9"


def test_an_error_that_is_no_number_is_infinite():
    found = histogram("f", "float32", 9.0, iter([(np.ones(2, np.float32), np.array([0.5, np.nan]))]))
    assert (found.largest, found.within[-1], found.passed) == (np.inf, 1, False)


def test_domains_are_whole_and_of_one_sign():
    domains = [(each.chunks[0], each.chunks.stop - 1) for each in FUNCTIONS]
    assert domains == [
        (0x0D800000, 0x7E800000),  # 2^-100 to 2^126
        (0x00800000, 0x3F7FFFFF),  # the least normal number to the last below 1
        (0x80800000, 0xC2C80000),  # -2^-126 to -100
        (0x00800000, 0x7F7FFFFF),  # all normal numbers
        (0x00800000, 0x7E800000),  # to 2^126, whose reciprocal is normal
    ]


@pytest.mark.parametrize("first", [0, ONE - CHUNK, 0x7F800000, 0xFFC00000])
def test_tone_maps_are_exact(first):
    """Around black, 1, infinity and the last NaN."""
    found = of_tonemap("srgb", [first])
    assert (found.inputs, found.largest, found.within[0]) == (CHUNK, 0.0, CHUNK)


def test_a_tone_map_that_is_off_by_one_is_found(monkeypatch):
    true = functions.mapped
    monkeypatch.setattr(functions, "mapped", lambda x, *rest: true(x, *rest) + (x == np.float32(0.75)))
    found = of_tonemap("aces", [ONE - CHUNK])
    assert (found.largest, found.at, found.within[0], found.passed) == (1.0, 0.75, CHUNK - 1, False)


@pytest.mark.long
def test_kernels_keep_what_is_said_of_them(device):
    """In the last two chunks of each domain, of which the last ends at its end."""
    kernels = Kernels(device, "float32")
    for each in FUNCTIONS:
        found = of_function(each, kernels, "float32", each.chunks[-2:])
        assert found.passed, found
        assert found.inputs == each.chunks.stop - each.chunks[-2]
        assert found.largest > 0.25
        assert not replace(found, allowed=0.9 * found.largest).passed
        assert found.rate > 0.0


@pytest.mark.long
def test_the_tables_are_printed_and_written(device, tmp_path, monkeypatch):
    text = io.StringIO()
    options = {"out": tmp_path, "every": 1 << 9, "stream": text}
    assert functions.run(device.index, **options)
    assert max(map(len, text.getvalue().splitlines())) <= 100
    found = json.loads((tmp_path / "functions.json").read_text())
    own, maps = found
    assert (own["device"], maps["device"]) == (device.title, "NumPy")
    assert [each["name"] for each in maps["functions"]] == [
        f"tone map {name}" for name in ("none", "srgb", "reinhard", "hable", "aces")
    ]
    assert len(own["functions"]) == 8
    monkeypatch.setattr(functions, "FUNCTIONS", (replace(FUNCTIONS[0], allowed={"float32": 0.1}),))
    assert not functions.run(device.index, **options)
    assert " ! of 0.1" in text.getvalue()


@pytest.mark.parametrize("options", [("--case", "1"), ("--list",), ("--triangles", "5")], ids=" ".join)
def test_options_of_the_cases_are_refused(capsys, options):
    assert_refused(run(capsys, "stability", "--functions", *options), "--functions", options[0])


def test_a_scene_has_no_functions(capsys):
    assert_refused(run(capsys, "stability", "teapot", "--functions"), "--functions", "teapot")
