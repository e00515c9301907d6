"""`stability --axes`: scenes that grow stiff, their errors and powers, the oracle's own limit, the command and its files."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from command_line import assert_refused, run

from clshade import oracle
from clshade.errors import OutputError
from clshade.images import figures
from clshade.measure.stability import axes, axes_figure, axes_stability, axes_tables
from clshade.measure.stability.axes import AXES, PLAIN, Point, Series
from clshade.measure.stability.cases.light import exact_highlights, in_the_lobe
from clshade.measure.timing import Spread
from clshade.oracle import terms
from clshade.scene.model import Settings

BY_NAME = {axis.name: axis for axis in AXES}
SOME = {"exponent": (1.0, 1e3, 1e6), "distance": (1.0, 1e4, 1e9), "aspect": (1.0, 1e3, 1e6)}


@pytest.fixture(scope="module")
def found(device):
    """Return all axes at three places each, as small images."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(axes, "SIDE", 48)
        patch.setattr(axes, "FRAMES", 2)
        some = [replace(axis, stiffness=SOME[axis.name]) for axis in AXES]
        return {axis: axes.measure(axis, device) for axis in some}


def rms(found, name):
    """Return the errors along the axis, by way."""
    axis = next(each for each in found if each.name == name)
    return {each.way: [point.rms for point in each.points] for each in found[axis]}


@pytest.mark.long
def test_the_exponent(found):
    errors = rms(found, "exponent")
    for way in ("standard", "fast"):
        assert 100.0 < errors[way][2] / errors[way][0] < 1e4  # sqrt(n) is 1000
        assert errors[way][2] < 0.01
    assert errors["standard"][2] < 1e-4
    assert errors[PLAIN][1] / errors[PLAIN][0] > 100.0
    assert errors[PLAIN][2] > 0.02  # no digit is left


@pytest.mark.long
def test_the_distance(found):
    errors = rms(found, "distance")
    for way in ("standard", "fast", "float64"):
        assert errors.get(way, [1.0] * 3) == pytest.approx([errors.get(way, [1.0])[0]] * 3, rel=0.05)
    assert errors[PLAIN][0] < 1e-6 < 1e-5 < errors[PLAIN][1]
    assert errors[PLAIN][2] is None  # rounded corners lie behind the eye


@pytest.mark.long
def test_the_aspect(found):
    errors = rms(found, "aspect")
    assert errors["standard"][0] < 1e-7 < errors["standard"][1] < 1e-5 < errors["standard"][2] < 1e-2
    assert errors[PLAIN][2] > 2.0 * errors["standard"][2]


@pytest.mark.long
def test_no_way_but_plain_float32_has_a_wrong_pixel(found):
    for series in found.values():
        for each in series:
            wrong = [point.wrong for point in each.points]
            assert each.way == PLAIN or wrong == [0, 0, 0]


@pytest.mark.long
def test_float64_is_within_the_oracle_s_own_error(found):
    """So that its curve says that both agree, no more."""
    for axis, series in found.items():
        for each in (each for each in series if each.way == "float64"):
            assert all(point.rms < axis.own(point.stiffness) for point in each.points)


@pytest.mark.parametrize("n", [1.0, 1e4, 1e9])
def test_the_oracle_s_own_error_of_a_highlight(n):
    """Against 50 digits."""
    pytest.importorskip("mpmath")
    points, normals, light = in_the_lobe(n, 60)
    found = terms.specular(terms.Directions.at(points, normals, np.zeros(3), light), np.float64(n))
    error = np.abs(found - exact_highlights(points, normals, light, n)).max()
    assert error < BY_NAME["exponent"].own(n)


def test_the_oracle_s_image_does_not_move(monkeypatch):
    """The moved scene is the same one, exactly."""
    monkeypatch.setattr(axes, "SIDE", 24)
    settings = Settings.from_preset("standard", near=axes.NEAR)
    near, far = (oracle.render(axes.moved(distance), settings) for distance in (1.0, 1e9))
    assert near.alpha.any()
    assert (near.id == far.id).all()
    assert np.abs(near.rgb - far.rgb).max() <= near.budget.max() * BY_NAME["distance"].own(1e9)


@pytest.mark.parametrize("n", [1.0, 1e9])
def test_the_highlight_fills_the_image(monkeypatch, n):
    monkeypatch.setattr(axes, "SIDE", 24)
    scene = axes.highlight(n)
    rgb = oracle.render(scene, Settings.from_preset("standard", near=axes.NEAR)).rgb
    assert rgb.min() > 0.0
    assert rgb.max() == pytest.approx(1.0, abs=0.1)  # ka, kd and ks add up to 1.1
    assert rgb.max() > 1.1 * rgb.min()


def test_aspects_are_as_named():
    for aspect in (1.0, 1e6):
        corners = axes.needle(aspect).meshes[0].verts
        edges = np.roll(corners, -1, axis=0) - corners
        longest = np.linalg.norm(edges, axis=1).max()
        height = np.linalg.norm(np.cross(edges[0], edges[1])) / longest
        assert longest / height == pytest.approx(aspect, rel=0.4)


def series(way, errors, ms=1.0):
    points = [Point(10.0**k, rms, rms, 0, Spread(ms, ms, ms)) for k, rms in enumerate(errors)]
    return Series(way, tuple(points))


def test_powers_leave_out_useless_images_and_none():
    assert series("fast", [1e-6, 1e-5, 1e-4, 0.5, 3.0]).power().exponent == pytest.approx(1.0)
    assert series("fast", [0.0, 1e-6, 1e-5, 1e-4]).power().exponent == pytest.approx(1.0)
    assert series("fast", [1e-6, 1e-5, 0.5]).power() is None
    assert series("fast", [1e-6] * 4).time_power().exponent == pytest.approx(0.0)
    gone = Point(1.0, None, None, None, None)
    assert Series(PLAIN, (gone, gone)).power() is Series(PLAIN, (gone,)).time_power() is None


def test_pixels_that_are_not_finite_are_all_wrong():
    expected = oracle.render(axes.needle(1.0), Settings.from_preset("standard", near=axes.NEAR))
    for bad in (np.nan, np.inf):
        point = axes._point(1.0, np.full_like(expected.rgb, bad), expected.alpha, expected)
        assert point.rms == point.largest == 1.0
    assert axes._point(1.0, expected.rgb, 1.0 - expected.alpha, expected).wrong == expected.alpha.size


# The command


@pytest.mark.long
def test_files(found, tmp_path, monkeypatch, device):
    monkeypatch.setattr(axes_stability, "AXES", tuple(found))
    monkeypatch.setattr(axes_figure, "draw", lambda found, device: figures.blank(0.2, 0.2))  # it takes a second
    monkeypatch.setattr(axes_stability, "measure", lambda axis, device: found[axis])
    text = io.StringIO()
    axes_stability.run(device.index, out=tmp_path / "new", formats=("png", "svg"), stream=text)
    names = {"axes.csv", "axes.json", "axes.md", "axes.png", "axes.svg"}
    assert {path.name for path in (tmp_path / "new").iterdir()} == names
    shown = text.getvalue()
    assert all(f"new/{name}" in shown for name in names)
    assert max(map(len, shown.splitlines()[:-6])) <= 100
    rows = list(csv.DictReader((tmp_path / "new" / "axes.csv").open()))
    measured = [row for row in rows if row["rms"]]
    ways = len(next(iter(found.values())))
    assert len(measured) == 9 * ways - 1  # plain float32 cannot draw one
    assert {row["of"] for row in rows if not row["stiffness"]} == {"error", "time"}
    assert all(float(row["ms_low"]) <= float(row["ms"]) <= float(row["ms_high"]) for row in measured)
    written = json.loads((tmp_path / "new" / "axes.json").read_text())
    assert [each["axis"] for each in written["axes"]] == list(SOME)
    assert (tmp_path / "new" / "axes.md").read_text().count("\n| 1 |") == 3


def test_a_file_that_cannot_be_written_is_found_before_measuring(device, tmp_path, monkeypatch):
    monkeypatch.setattr(axes_stability, "measure", lambda axis, device: pytest.fail("something was measured"))
    (tmp_path / "axes.pdf").mkdir()
    with pytest.raises(OutputError, match=r"axes\.pdf"):
        axes_stability.run(device.index, out=tmp_path, formats=("pdf",), stream=io.StringIO())


def test_what_is_said(found):
    axis = BY_NAME["exponent"]
    made = [series("standard", [10.0 ** (k / 2 - 7) for k in range(10)])]
    made += [series(PLAIN, [10.0 ** (k - 4) for k in range(10)])]
    first, second = axes_tables.notes(made, axis)
    assert first.startswith("standard: error: power 0.50 (0.50 to 0.50); expected 0.5, that of directions")
    assert "power 1.00 (1.00 to 1.00) up to 100; beyond it images are useless" in second
    (close,) = axes_tables.notes([series("float64", [1e-17 * 10.0 ** (k / 2) for k in range(10)])], axis)
    assert "power 0.50 (0.50 to 0.50); all within the oracle's own error" in close
    assert math.isclose(axis.own(1e4), 1600 * 2.0**-53)


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (("quads", "--axes"), ("--axes: is for the cases, and cannot go with 'quads'",)),
        (("--axes", "--case", "slivers"), ("--axes: cannot go with --case",)),
        (("--axes", "--list"), ("--axes: cannot go with --list",)),
        (("--axes", "--device", "all"), ("--axes: cannot go with --device all",)),
        (("--axes", "--triangles", "7"), ("--axes: cannot go with --triangles",)),
        (("--axes", "--format", "gif"), ("--format", "png, pdf, svg", "'gif'")),
        (("--format", "pdf"), ("--format: needs --axes",)),
        (("--axes", "--out", "file/x"), ("file/x", "--out")),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)
def test_bad_input(capsys, tmp_path, monkeypatch, options, parts):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert_refused(run(capsys, "stability", *options), *parts)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_command(capsys, monkeypatch):
    given = {}
    monkeypatch.setattr(axes_stability, "run", lambda device, **options: given.update(options, device=device))
    assert run(capsys, "stability", "--axes", "-o", "there", "--format", "pdf,svg", "--device", "x")[0] == 0
    assert given == {"out": "there", "formats": ("pdf", "svg"), "device": "x"}


def test_the_figure_draws_errors_of_0_and_of_nonsense():
    axis = replace(BY_NAME["aspect"], stiffness=(1.0, 10.0, 100.0))
    drawn = axes_figure.draw({axis: [series("standard", [0.0, 1e-5, 1e-4]), series(PLAIN, [1e-5, 1e19, 1.0])]}, "$x$")
    low, high = drawn.axes[0].get_ylim()
    for line in drawn.axes[0].lines[:2]:
        assert low <= line.get_ydata().min() <= line.get_ydata().max() <= high
