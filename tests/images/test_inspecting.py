"""Statistics of images with planted values; the output and the figure of `inspect`."""

from __future__ import annotations

import json
import math
import os
import sys
import tracemalloc
import warnings

import numpy as np
import pytest
from command_line import assert_refused, run
from processes import python

from clshade.errors import ClshadeError, InputError
from clshade.images import exr, png, statistics
from clshade.images.image_file import Picture
from clshade.images.tonemap import tonemap
from clshade.scene.formats.load import load
from clshade.scene.formats.table import EXTENSIONS


def words(text):
    return text.split()


def planted():
    """Return 1..100 in random order, then NaNs, infinities and negative values."""
    values = np.random.default_rng(6).permutation(np.arange(1.0, 101.0, dtype=np.float32))
    return np.concatenate([values, np.float32([np.nan, np.nan, np.inf, -np.inf, np.inf, -0.5, -2, -0.0])]).reshape(
        9, 12
    )


def test_statistics_of_a_channel():
    stats = statistics.image_statistics({"Z": planted()})
    assert stats.shape == (9, 12)
    channel = stats.channels["Z"]
    assert (channel.nan, channel.inf, channel.negative) == (2, 3, 2)
    assert (channel.minimum, channel.maximum) == (-2.0, 100.0)
    assert channel.mean == (5050 - 2.5) / 103
    assert channel.percentiles == (-0.5, 3.0, 49.0, 95.0, 99.0)  # ranks 1.02, 5.1, 51, 96.9, 100.98 of 0..102
    assert stats.stops is None


def test_a_file_and_its_arrays_have_the_same_statistics(tmp_path):
    layers = {"RGB": np.dstack([planted()] * 3), "id": np.arange(108, dtype=np.uint32).reshape(9, 12)}
    exr.write(tmp_path / "a.exr", layers)
    stats = statistics.image_statistics(tmp_path / "a.exr")
    assert stats == statistics.image_statistics(layers)
    assert list(stats.channels) == ["R", "G", "B", "id"]
    assert stats.channels["id"] == statistics.ChannelStatistics("uint", 0, 107, 53.5, (1, 5, 54, 102, 106), 0, 0, 0)
    assert statistics.image_statistics(str(tmp_path / "a.exr")) == stats


def test_nothing_finite():
    channel = statistics.image_statistics({"Z": np.full((2, 2), np.inf, np.float32)}).channels["Z"]
    assert (channel.nan, channel.inf, channel.negative) == (0, 4, 0)
    assert all(math.isnan(v) for v in (channel.minimum, channel.maximum, channel.mean, *channel.percentiles))


def test_dynamic_range():
    """Gray from 2^-3 to 2^5: 8 stops. Black, negative, NaN and infinite pixels do not count."""
    gray = np.full((100, 100), 1.0, np.float32)
    gray[0] = 2.0**-3
    gray[1] = 2.0**5
    gray[2, :5] = 0, -1, np.nan, np.inf, -np.inf
    stats = statistics.image_statistics(np.dstack([gray] * 3))
    assert stats.stops == pytest.approx(8, abs=1e-12)
    assert stats.robust_stops == pytest.approx(8, abs=1e-12)
    gray[2, 5] = 1e30
    stats = statistics.image_statistics(np.dstack([gray] * 3))
    assert stats.stops == pytest.approx(math.log2(1e30) + 3, abs=1e-6)
    assert stats.robust_stops == pytest.approx(8, abs=1e-12)
    assert statistics.image_statistics({"Y": gray}).stops == pytest.approx(stats.stops)
    assert statistics.image_statistics(np.zeros((2, 2, 3))).stops is None


@pytest.mark.parametrize(("one", "second", "ratio"), [(0, 1, 0.7152 / 0.2126), (0, 2, 0.2126 / 0.0722)])
def test_dynamic_range_weighs_the_colors(one, second, ratio):
    pixels = np.zeros((1, 2, 3), np.float32)
    pixels[0, 0, one] = pixels[0, 1, second] = 1.0
    assert statistics.image_statistics(pixels).stops == pytest.approx(math.log2(ratio))


def test_the_table():
    text = statistics.format_statistics(statistics.image_statistics({"R": planted(), "id": np.uint32([[7] * 12] * 9)}))
    lines = text.splitlines()
    assert lines[0] == "12 x 9 pixels"
    assert lines[1].split() == words("channel type min 1 % 5 % median mean 95 % 99 % max NaN Inf negative")
    assert lines[2].split() == words("R float -2 -0.5 3 49 49.0049 95 99 100 2 3 2")
    assert lines[3].split() == words("id uint 7 7 7 7 7 7 7 7 0 0 0")
    assert len({len(line) for line in lines[1:4]}) == 1
    assert lines[4] == "dynamic range: none (no pixel of positive luminance)"
    text = statistics.format_statistics(statistics.image_statistics({"id": np.uint32([[0, 2**32 - 1, 12345678]])}))
    assert text.splitlines()[2].split()[2:10] == words("0 0 0 12345678 1.43577e+09 4294967295 4294967295 4294967295")
    text = statistics.format_statistics(statistics.image_statistics(np.float32([[[1] * 3, [8] * 3]])))
    assert text.endswith("dynamic range: 3.0 stops, 3.0 without 0.1 % at either end")


# Files


def inspected(capsys, *arguments):
    """Run `inspect`; return its exit code, the parsed JSON, and the lines of standard error."""
    code, out, err = run(capsys, "inspect", *arguments, "--json")
    return code, json.loads(out, parse_constant=pytest.fail), err


def test_a_file_of_half_floats_in_a_window_of_its_own(tmp_path, capsys):
    pixels = np.zeros((6, 8, 3))
    pixels[2:4, 5:8] = 0.5
    exr.write(tmp_path / "a.exr", pixels, half=True, window=(5, 2, 7, 3))
    code, report, err = inspected(capsys, tmp_path / "a.exr", "--pixel", "5,2", "--pixel", "5,4")
    assert (code, err) == (0, [])
    assert (report["width"], report["height"]) == (8, 6)
    assert report["channels"]["R"]["type"] == "half"
    assert report["channels"]["R"]["mean"] == 0.5 * 6 / 48
    assert report["header"]["dataWindow"] == [5, 2, 7, 3]
    assert report["header"]["displayWindow"] == [0, 0, 7, 5]
    assert [pixel["values"]["G"] for pixel in report["pixels"]] == [0.5, 0.0]


def test_a_pixel_is_counted_from_the_top_left(tmp_path, capsys):
    values = np.arange(12, dtype=np.float32).reshape(3, 4)
    values[0, 1], values[0, 2], values[0, 3] = np.nan, np.inf, -np.inf
    ids = (np.arange(12).reshape(3, 4) + 2**32 - 12).astype(np.uint32)
    exr.write(tmp_path / "a.exr", {"Z": values, "id": ids})
    _, report, _ = inspected(
        capsys, tmp_path / "a.exr", *(f"--pixel={x},{y}" for x, y in [(3, 1), (0, 2), (1, 0), (2, 0)])
    )
    assert report["pixels"][0] == {"x": 3, "y": 1, "values": {"Z": 7.0, "id": 2**32 - 5}}
    assert report["pixels"][1]["values"]["Z"] == 8.0
    assert [pixel["values"]["Z"] for pixel in report["pixels"][2:]] == ["nan", "inf"]
    assert (report["channels"]["Z"]["nan"], report["channels"]["Z"]["inf"]) == (1, 2)
    code, out, _ = run(capsys, "inspect", tmp_path / "a.exr", "--pixel", "3,1")
    assert code == 0
    assert "pixel 3,1 (column, row from the top): Z 7.0, id 4294967291" in out
    for outside in ("4,0", "0,3", "-1,0"):
        line = f"clshade: {tmp_path / 'a.exr'}: pixel: expected X from 0 to 3 and Y from 0 to 2, found {outside}"
        assert run(capsys, "inspect", tmp_path / "a.exr", f"--pixel={outside}") == (2, "", [line])


def test_what_json_has_no_numbers_for_is_null(tmp_path, capsys):
    exr.write(tmp_path / "a.exr", {"Z": np.full((2, 2), np.inf, np.float32)})
    _, report, _ = inspected(capsys, tmp_path / "a.exr")
    assert report["channels"]["Z"]["minimum"] is None
    assert set(report["channels"]["Z"]["percentiles"].values()) == {None}
    assert report["dynamic_range_stops"] == {"layer": None, "all": None, "without_0.1_percent": None}


@pytest.mark.parametrize(("mode", "names"), [("L", "Y"), ("LA", "YA"), ("RGB", "RGB"), ("RGBA", "RGBA")])
def test_a_png_has_its_codes_over_the_largest(tmp_path, capsys, mode, names):
    from PIL import Image

    Image.new(mode, (3, 2), (51,) * len(names) if len(names) > 1 else 51).save(tmp_path / "a.png")
    _, report, _ = inspected(capsys, tmp_path / "a.png")
    assert list(report["channels"]) == list(names)
    assert {channel["type"] for channel in report["channels"].values()} == {"8-bit"}
    assert report["channels"][names[0]]["maximum"] == pytest.approx(0.2, rel=1e-7)  # in float32


def test_sixteen_bits_of_a_png_are_kept(tmp_path):
    from PIL import Image

    Image.fromarray(np.uint16([[1, 65535]])).save(tmp_path / "a.png")
    stats = statistics.image_statistics(tmp_path / "a.png")
    assert stats.channels["Y"].minimum == pytest.approx(1 / 65535, rel=1e-6)
    # The sRGB curve is linear there, with slope 12.92.
    assert stats.stops == pytest.approx(math.log2(65535 * 12.92), rel=1e-6)


def test_a_header_cannot_write_to_the_terminal(tmp_path, capsys):
    exr.write(tmp_path / "a.exr", np.zeros((1, 1, 3)), metadata={"note": "red \x1b[31m\nand more"})
    code, out, _ = run(capsys, "inspect", tmp_path / "a.exr")
    assert code == 0
    assert "\x1b" not in out
    assert "  note: red \\x1b[31m\\nand more" in out.splitlines()


@pytest.mark.parametrize("content", [b"", b"GIF89a", b"v/1\x01" + bytes(60), b"\x89PNG\r\n\x1a\n" + bytes(30)])
def test_no_image(tmp_path, capsys, content):
    (tmp_path / "a.exr").write_bytes(content)
    assert_refused(run(capsys, "inspect", tmp_path / "a.exr", "-o", tmp_path / "a.png"), "a.exr")
    assert os.listdir(tmp_path) == ["a.exr"]


def test_bad_files_of_others(data_folder, capsys):
    """One line each; images, and scenes that can be loaded, are listed."""
    for path in sorted((data_folder / "bad").iterdir()):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            expected = 0 if path.name == "self_tex_1x1.png" or loads(path) else 2
            code, _, err = run(capsys, "inspect", path)
        assert code == expected, path
        assert not expected or len(err) == 1, path


def loads(path):
    try:
        return path.suffix in EXTENSIONS and bool(load(path))
    except ClshadeError:
        return False


# The figure


def panels_of(figure):
    """Return the panels' images by title."""
    return {
        axes.get_title().split("\n")[0]: np.asarray(axes.images[0].get_array()) for axes in figure.axes if axes.images
    }


@pytest.mark.parametrize("shape", [(1200, 1600), (300, 2), (1, 1)])
def test_exposures(shape):
    color = np.float32([0.4, 0.1, 0.02])
    shown = panels_of(statistics.draw(Picture(exr.flatten(np.broadcast_to(color, (*shape, 3)))), "a"))
    for stops in range(-4, 5):
        name = {0: "as it is", 1: "+1 stop", -1: "-1 stop"}.get(stops, f"{stops:+d} stops")
        assert (shown[name] == tonemap(color.reshape(1, 1, 3), "srgb", stops)).all(), name


def test_the_figure_is_upright_and_has_every_layer(tmp_path):
    pixels = np.zeros((40, 60, 3), np.float32)
    pixels[:20, :20, 0] = 4.0  # red, upper left: 4 * 0.2126 is 0.23 stops below 1
    channels = {
        **exr.flatten(pixels),
        "Z": np.full((40, 60), np.inf, np.float32),
        "id": np.eye(40, 60, dtype=np.uint32),
    }
    figure = statistics.draw(Picture(channels), "a $name_ of\nothers")
    shown = panels_of(figure)
    assert {"RGB", "Z", "id"} <= set(shown)
    red = (shown["as it is"] == [255, 0, 0]).all(axis=-1)
    assert red[:20, :20].all()
    assert red.sum() == 400
    (histogram,) = (axes for axes in figure.axes if axes.get_xlabel().startswith("luminance in stops"))
    bars = {round(bar.get_x() + bar.get_width() / 2, 3): bar.get_height() for bar in histogram.patches}
    assert sum(bars.values()) == pytest.approx(100 * 400 / 2400)
    (place,) = (x for x, height in bars.items() if height)
    assert place == pytest.approx(math.log2(4 * 0.2126), abs=0.07)  # half of a bin
    figure.savefig(tmp_path / "a.png")


@pytest.mark.long
def test_a_thousand_layers(tmp_path):
    """No more than fit into the figure; the number of omitted ones is reported."""
    channels = {f"L{k:04}": np.zeros((2, 200), np.float32) for k in range(1000)}
    figure = statistics.draw(Picture(channels), "a")
    titles = [axes.get_title() for axes in figure.axes if axes.images]
    assert len(titles) == 60
    assert titles[-1].replace("\n", " ").endswith("; 940 more layers")
    figure.savefig(tmp_path / "a.png")


def test_false_colors():
    values = np.array([[0.0, -1.0, np.nan, np.inf], [0.25, 1.0, 4.0, 1e30]])
    pixels = statistics.false_colors(values, -2.0, 2.0).pixels
    assert pixels[0].tolist() == [[0, 0, 0], [0, 0, 0], [255, 0, 255], [255, 255, 255]]
    assert len({tuple(pixel) for pixel in pixels[1].tolist()}) == 3
    assert (pixels[1, 2] == pixels[1, 3]).all()  # clamped to the highest


def test_the_figure_of_the_command(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # importing it now raises ImportError
    exr.write(tmp_path / "a.exr", {"Z": planted(), "id": np.ones((9, 12), np.uint32)})
    code, _, err = inspected(capsys, tmp_path / "a.exr", "-o", tmp_path / "b.png")
    assert (code, err) == (0, [f"clshade: wrote {tmp_path / 'b.png'}"])
    assert sorted(os.listdir(tmp_path)) == ["a.exr", "b.png"]
    assert png.read(tmp_path / "b.png").std() > 10
    for image, output, expected in (
        ("a.exr", "none/a.png", "there is no folder"),
        ("b.png", "a.exr", "ends in .png"),
        ("b.png", "b.png", "another file"),
    ):
        assert_refused(run(capsys, "inspect", tmp_path / image, "-o", tmp_path / output), expected)
    assert inspected(capsys, tmp_path / "a.exr")[0] == 0


def test_no_figure_costs_no_matplotlib(tmp_path):
    exr.write(tmp_path / "a.exr", np.ones((3, 3, 3)))
    code = "import sys; from clshade.cli.main import main; main(sys.argv[1:]); print('matplotlib' in sys.modules)"
    done = python(code, "", "inspect", str(tmp_path / "a.exr"), "-q")
    assert done.stdout.split() == ["False"]


def test_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        statistics.image_statistics(tmp_path / "none.exr")


def test_verbose_names_what_was_read(tmp_path, capsys):
    exr.write(tmp_path / "a.exr", np.zeros((2, 2, 3)))
    code, _, (line,) = run(capsys, "inspect", tmp_path / "a.exr", "--verbose")
    assert code == 0
    assert line.startswith(f"clshade: read {tmp_path / 'a.exr'}: 3 channels, ")


@pytest.mark.parametrize("names", ["Y", "RGB"])
def test_the_memory_that_statistics_take(names):
    rng = np.random.default_rng(9)
    image = {name: rng.random((1024, 1024), np.float32) for name in names}
    statistics.image_statistics(image)
    tracemalloc.start()
    statistics.image_statistics(image)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    plane = image[names[0]].nbytes
    blocks = 6 * 8 * statistics._BLOCK  # a few float64 arrays of a block
    # The stops of all pixels, twice as large, and with three channels also those side by side.
    assert peak < (2.2 + (3 if len(names) > 1 else 0)) * plane + blocks
