"""Statistics of images with planted values; the output and the figure of `inspect`."""

import json
import math
import os
import sys

import numpy as np
import pytest
from command_line import assert_refused, run
from PIL import Image

from clshade.errors import InputError
from clshade.images import exr, png, statistics
from clshade.images.image_file import Picture
from clshade.images.tonemap import tonemap


def planted():
    """Return 1..100 in random order, then NaNs, infinities and negative values."""
    values = np.random.default_rng(6).permutation(np.arange(1.0, 101.0, dtype=np.float32))
    return np.append(values, np.float32([np.nan, np.nan, np.inf, -np.inf, np.inf, -0.5, -2, -0.0])).reshape(9, 12)


def test_statistics_of_a_channel():
    stats = statistics.image_statistics({"Z": planted()})
    assert stats.shape == (9, 12)
    channel = stats.channels["Z"]
    assert (channel.nan, channel.inf, channel.negative) == (2, 3, 2)
    assert (channel.minimum, channel.maximum, channel.mean) == (-2.0, 100.0, (5050 - 2.5) / 103)
    assert channel.percentiles == (-0.5, 3.0, 49.0, 95.0, 99.0)  # ranks 1.02, 5.1, 51, 96.9, 100.98 of 0..102
    assert stats.stops is None


def test_a_file_and_its_arrays_have_the_same_statistics(tmp_path):
    layers = {"RGB": np.dstack([planted()] * 3), "id": np.arange(108, dtype=np.uint32).reshape(9, 12)}
    exr.write(tmp_path / "a.exr", layers)
    stats = statistics.image_statistics(tmp_path / "a.exr")
    assert stats == statistics.image_statistics(layers) == statistics.image_statistics(str(tmp_path / "a.exr"))
    assert list(stats.channels) == ["R", "G", "B", "id"]
    assert stats.channels["id"] == statistics.ChannelStatistics("uint", 0, 107, 53.5, (1, 5, 54, 102, 106), 0, 0, 0)
    with pytest.raises(InputError, match="no such file"):
        statistics.image_statistics(tmp_path / "none.exr")


def test_dynamic_range():
    """Gray from 2^-3 to 2^5: 8 stops. Black, negative, NaN and infinite pixels do not count."""
    gray = np.full((100, 100), 1.0, np.float32)
    gray[0], gray[1] = 2.0**-3, 2.0**5
    gray[2, :5] = 0, -1, np.nan, np.inf, -np.inf
    for brightest, stops in ((32.0, 8.0), (1e30, math.log2(1e30) + 3)):
        gray[2, 5] = brightest
        stats = statistics.image_statistics(np.dstack([gray] * 3))
        assert stats.stops == pytest.approx(stops, abs=1e-6)
        assert stats.robust_stops == pytest.approx(8, abs=1e-12)
    assert statistics.image_statistics({"Y": gray}).stops == pytest.approx(stats.stops)
    assert statistics.image_statistics(np.zeros((2, 2, 3))).stops is None


@pytest.mark.parametrize(("one", "second", "ratio"), [(0, 1, 0.7152 / 0.2126), (0, 2, 0.2126 / 0.0722)])
def test_dynamic_range_weighs_the_colors(one, second, ratio):
    pixels = np.zeros((1, 2, 3), np.float32)
    pixels[0, 0, one] = pixels[0, 1, second] = 1.0
    assert statistics.image_statistics(pixels).stops == pytest.approx(math.log2(ratio))


def inspected(capsys, *arguments):
    code, out, err = run(capsys, "inspect", *arguments, "--json")
    return code, json.loads(out, parse_constant=pytest.fail), err


def test_a_pixel_is_counted_from_the_top_left(tmp_path, capsys):
    values = np.arange(12, dtype=np.float32).reshape(3, 4)
    values[0, 1], values[0, 2], values[0, 3] = np.nan, np.inf, -np.inf
    exr.write(tmp_path / "a.exr", {"Z": values, "id": (np.arange(12).reshape(3, 4) + 2**32 - 12).astype(np.uint32)})
    places = "3,1", "0,2", "1,0", "2,0"
    _, report, _ = inspected(capsys, tmp_path / "a.exr", *(f"--pixel={place}" for place in places))
    assert report["pixels"][0] == {"x": 3, "y": 1, "values": {"Z": 7.0, "id": 2**32 - 5}}
    assert [pixel["values"]["Z"] for pixel in report["pixels"][1:]] == [8.0, "nan", "inf"]
    assert (report["channels"]["Z"]["nan"], report["channels"]["Z"]["inf"]) == (1, 2)
    code, out, _ = run(capsys, "inspect", tmp_path / "a.exr", "--pixel", "3,1")
    assert code == 0
    assert "pixel 3,1 (column, row from the top): Z 7.0, id 4294967291" in out
    for outside in ("4,0", "0,3", "-1,0"):
        line = f"clshade: {tmp_path / 'a.exr'}: pixel: expected X from 0 to 3 and Y from 0 to 2, found {outside}"
        assert run(capsys, "inspect", tmp_path / "a.exr", f"--pixel={outside}") == (2, "", [line])


def test_what_json_has_no_numbers_for_is_null(tmp_path, capsys):
    exr.write(tmp_path / "a.exr", {"Z": np.full((2, 2), np.inf, np.float32)})
    code, report, _ = inspected(capsys, tmp_path / "a.exr")
    channel = report["channels"]["Z"]
    assert (code, channel["nan"], channel["inf"], channel["minimum"], channel["mean"]) == (0, 0, 4, None, None)
    assert set(channel["percentiles"].values()) == {None}
    assert report["dynamic_range_stops"] == {"layer": None, "all": None, "without_0.1_percent": None}


@pytest.mark.parametrize(("mode", "names"), [("L", "Y"), ("LA", "YA"), ("RGB", "RGB"), ("RGBA", "RGBA")])
def test_a_png_has_its_codes_over_the_largest(tmp_path, capsys, mode, names):
    Image.new(mode, (3, 2), (51,) * len(names) if len(names) > 1 else 51).save(tmp_path / "a.png")
    _, report, _ = inspected(capsys, tmp_path / "a.png")
    assert list(report["channels"]) == list(names)
    assert {channel["type"] for channel in report["channels"].values()} == {"8-bit"}
    assert report["channels"][names[0]]["maximum"] == pytest.approx(0.2, rel=1e-7)  # in float32


def test_a_header_cannot_write_to_the_terminal(tmp_path, capsys):
    exr.write(tmp_path / "a.exr", np.zeros((1, 1, 3)), metadata={"note": "red \x1b[31m\nand more"})
    code, out, (line,) = run(capsys, "inspect", tmp_path / "a.exr", "--verbose")
    assert code == 0
    assert "\x1b" not in out
    assert "  note: red \\x1b[31m\\nand more" in out.splitlines()
    assert line.startswith(f"clshade: read {tmp_path / 'a.exr'}: 3 channels, ")


@pytest.mark.parametrize("content", [b"GIF89a", b"v/1\x01" + bytes(60)])
def test_no_image(tmp_path, capsys, content):
    (tmp_path / "a.exr").write_bytes(content)
    assert_refused(run(capsys, "inspect", tmp_path / "a.exr", "-o", tmp_path / "a.png"), "a.exr")
    assert os.listdir(tmp_path) == ["a.exr"]


def test_the_figure_is_upright_and_has_every_layer(tmp_path):
    pixels = np.zeros((40, 60, 3), np.float32)
    pixels[:20, :20, 0] = 4.0  # red, upper left: 4 * 0.2126 is 0.23 stops below 1
    others = {"Z": np.full((40, 60), np.inf, np.float32), "id": np.eye(40, 60, dtype=np.uint32)}
    figure = statistics.draw(Picture({**exr.flatten(pixels), **others}), "a $name_ of\nothers")
    shown = {axes.get_title().split("\n")[0]: axes.images[0].get_array() for axes in figure.axes if axes.images}
    assert {"RGB", "Z", "id"} <= set(shown)
    for stops in range(-4, 5):
        name = {0: "as it is", 1: "+1 stop", -1: "-1 stop"}.get(stops, f"{stops:+d} stops")
        assert np.array_equal(shown[name], tonemap(pixels, "srgb", stops)), name
    (histogram,) = (axes for axes in figure.axes if axes.get_xlabel().startswith("luminance in stops"))
    bars = {round(bar.get_x() + bar.get_width() / 2, 3): bar.get_height() for bar in histogram.patches}
    assert sum(bars.values()) == pytest.approx(100 * 400 / 2400)
    (place,) = (x for x, height in bars.items() if height)
    assert place == pytest.approx(math.log2(4 * 0.2126), abs=0.07)  # half of a bin
    figure.savefig(tmp_path / "a.png")


def test_the_figure_of_the_command(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # importing it now raises ImportError
    exr.write(tmp_path / "a.exr", {"Z": planted(), "id": np.ones((9, 12), np.uint32)})
    code, _, err = inspected(capsys, tmp_path / "a.exr", "-o", tmp_path / "b.png")
    assert (code, err) == (0, [f"clshade: wrote {tmp_path / 'b.png'}"])
    assert sorted(os.listdir(tmp_path)) == ["a.exr", "b.png"]
    assert png.read(tmp_path / "b.png").std() > 10
    assert_refused(run(capsys, "inspect", tmp_path / "b.png", "-o", tmp_path / "b.png"), "another file")
