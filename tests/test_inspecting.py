"""Statistics of images with planted values, and the exposure ladder."""

from __future__ import annotations

import math
import os
import sys

import numpy as np
import pytest

from clshade import exr, inspecting, png
from clshade.errors import InputError, OutputError
from clshade.tonemap import tonemap


def planted():
    """1..100 in a random order, then NaNs, infinities and negative values."""
    values = np.random.default_rng(6).permutation(np.arange(1.0, 101.0, dtype=np.float32))
    return np.concatenate([values, np.float32([np.nan, np.nan, np.inf, -np.inf, np.inf, -0.5, -2, -0.0])]).reshape(
        9, 12
    )


def test_statistics_of_a_channel():
    found = inspecting.statistics({"Z": planted()})
    assert found.shape == (9, 12)
    channel = found.channels["Z"]
    assert (channel.nan, channel.inf, channel.negative) == (2, 3, 2)
    assert (channel.minimum, channel.maximum) == (-2.0, 100.0)
    assert channel.mean == (5050 - 2.5) / 103
    assert channel.percentiles == (-0.5, 49.0, 99.0)  # ranks 1.02, 51, 100.98 of 0..102
    assert found.stops is None


def test_a_file_and_its_arrays_have_the_same_statistics(tmp_path):
    given = {"RGB": np.dstack([planted()] * 3), "id": np.arange(108, dtype=np.uint32).reshape(9, 12)}
    exr.write(tmp_path / "a.exr", given)
    found = inspecting.statistics(tmp_path / "a.exr")
    assert found == inspecting.statistics(given)
    assert list(found.channels) == ["R", "G", "B", "id"]
    assert found.channels["id"] == inspecting.ChannelStatistics(0, 107, 53.5, (1, 54, 106), 0, 0, 0)
    assert inspecting.statistics(str(tmp_path / "a.exr")) == found


def test_nothing_finite():
    channel = inspecting.statistics({"Z": np.full((2, 2), np.inf, np.float32)}).channels["Z"]
    assert (channel.nan, channel.inf, channel.negative) == (0, 4, 0)
    assert all(math.isnan(v) for v in (channel.minimum, channel.maximum, channel.mean, *channel.percentiles))


def test_dynamic_range():
    """Gray from 2^-3 to 2^5: 8 stops. Black, negative, NaN and infinite pixels do not count."""
    gray = np.full((100, 100), 1.0, np.float32)
    gray[0] = 2.0**-3
    gray[1] = 2.0**5
    gray[2, :5] = 0, -1, np.nan, np.inf, -np.inf
    found = inspecting.statistics(np.dstack([gray] * 3))
    assert found.stops == pytest.approx(8, abs=1e-12)
    assert found.stops_most == pytest.approx(8, abs=1e-12)
    gray[2, 5] = 1e30
    found = inspecting.statistics(np.dstack([gray] * 3))
    assert found.stops == pytest.approx(math.log2(1e30) + 3, abs=1e-6)
    assert found.stops_most == pytest.approx(8, abs=1e-12)
    assert inspecting.statistics({"Y": gray}).stops == pytest.approx(found.stops)
    assert inspecting.statistics(np.zeros((2, 2, 3))).stops is None


@pytest.mark.parametrize(("one", "other", "ratio"), [(0, 1, 0.7152 / 0.2126), (0, 2, 0.2126 / 0.0722)])
def test_dynamic_range_weighs_the_colors(one, other, ratio):
    pixels = np.zeros((1, 2, 3), np.float32)
    pixels[0, 0, one] = pixels[0, 1, other] = 1.0
    assert inspecting.statistics(pixels).stops == pytest.approx(math.log2(ratio))


def test_the_table():
    text = inspecting.format_statistics(inspecting.statistics({"R": planted(), "id": np.uint32([[7] * 12] * 9)}))
    lines = text.splitlines()
    assert lines[0] == "12 x 9 pixels"
    assert lines[1].split() == [
        "channel",
        "min",
        "1",
        "%",
        "median",
        "mean",
        "99",
        "%",
        "max",
        "NaN",
        "Inf",
        "negative",
    ]
    assert lines[2].split() == ["R", "-2", "-0.5", "49", "49.0049", "99", "100", "2", "3", "2"]
    assert lines[3].split() == ["id", "7", "7", "7", "7", "7", "7", "0", "0", "0"]
    assert len({len(line) for line in lines[1:4]}) == 1
    assert lines[4] == "dynamic range: none (no pixel of positive luminance)"
    text = inspecting.format_statistics(inspecting.statistics(np.float32([[[1] * 3, [8] * 3]])))
    assert text.endswith("dynamic range: 3.0 stops, 3.0 without 0.1 % at either end")


def panels(path):
    """The nine panels' codes at their centers, from the left and the top."""
    picture = png.read(path)
    height, width = picture.shape[:2]
    return [
        picture[int(height * (2 * i + 1.1) / 6), int(width * (2 * j + 1) / 6)].tolist()
        for i in range(3)
        for j in range(3)
    ]


@pytest.mark.parametrize("shape", [(1200, 1600), (300, 2)])
def test_exposure_ladder(tmp_path, shape):
    color = np.float32([0.4, 0.1, 0.02])
    exr.write(tmp_path / "a.exr", np.broadcast_to(color, (*shape, 3)))
    inspecting.exposure_ladder(tmp_path / "a.exr", tmp_path / "a.png")
    expected = [tonemap(color.reshape(1, 1, 3), "srgb", stops)[0, 0].tolist() for stops in range(-4, 5)]
    assert panels(tmp_path / "a.png") == expected
    assert sorted(os.listdir(tmp_path)) == ["a.exr", "a.png"]


def test_exposure_ladder_is_upright_and_labeled(tmp_path):
    pixels = np.zeros((40, 40, 3), np.float32)
    pixels[:20, :20, 0] = 16.0  # red, upper left
    inspecting.exposure_ladder(pixels, tmp_path / "a.png")
    picture = png.read(tmp_path / "a.png").astype(int)
    red = (picture[..., 0] == 255) & (picture[..., 1] == 0)
    rows, columns = np.nonzero(red[: len(red) // 3, : red.shape[1] // 3])
    height, width = picture.shape[0] / 3, picture.shape[1] / 3
    assert rows.max() < 0.6 * height
    assert columns.max() < 0.55 * width
    label = picture[: rows.min(), : int(width)]
    assert (label.max(axis=2) < 60).sum() > 20  # the ink of "-4 stops" above the panel


def test_exposure_ladder_does_not_use_pyplot(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # importing it now raises ImportError
    inspecting.exposure_ladder(np.ones((3, 3, 3)), tmp_path / "a.png")


def test_refused(tmp_path):
    with pytest.raises(InputError, match="expected channels R, G, B"):
        inspecting.exposure_ladder({"Z": np.zeros((2, 2))}, tmp_path / "a.png")
    with pytest.raises(InputError, match="no such file"):
        inspecting.statistics(tmp_path / "none.exr")
    with pytest.raises(OutputError, match="there is no folder"):
        inspecting.exposure_ladder(np.zeros((2, 2, 3)), tmp_path / "none" / "a.png")
    assert os.listdir(tmp_path) == []
