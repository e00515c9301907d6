"""`report`: errors and times of variants, tables, figure, the command."""

from __future__ import annotations

import csv
import io
import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused, run
from studies import SMALL, small_study, sphere

from clshade.base import text_tables
from clshade.cli.main import _parser
from clshade.errors import InputError, OutputError
from clshade.images import figures, metrics, png
from clshade.measure import timing
from clshade.measure.report import figure, labels, report, study, tables, variants
from clshade.measure.report.format_errors import formats
from clshade.measure.report.labels import Box, placed
from clshade.measure.report.measure import measure
from clshade.measure.report.pareto import tied, ties
from clshade.measure.report.power_law import exponent, fitted
from clshade.measure.report.reference_image import reference
from clshade.measure.report.tessellation import tessellation
from clshade.measure.report.variants import BASE, Variant, base_settings, named, variants_for
from clshade.pipeline.effective_settings import effective_settings
from clshade.pipeline.picture import SAMPLES
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Settings

# Measuring


def test_measured_errors_are_those_of_the_images(device):
    """A planted error in the reference is found, and not attributed to the image's own arithmetic."""
    scene = sphere()
    base = base_settings(scene)
    own = render(scene, settings=base, device=device).rgb.astype(np.float64)
    planted = replace(reference(scene, base, device), rgb=own + 0.125)
    chosen = named(variants_for(scene, base_settings(scene), device), [BASE, "gouraud"])
    standard, gouraud = measure(scene, chosen, base, device, planted, frames=3)
    assert standard.error == pytest.approx(0.125, rel=1e-6)
    assert gouraud.error != standard.error
    for each in (standard, gouraud):
        assert each.arithmetic.wrong == 0
        assert 0.0 < each.arithmetic.rms < each.arithmetic.error < 1e-5
        assert each.frame_ms.low > 0.0
        assert each.upload_ms > 0.0
    assert (standard.settings, gouraud.settings) == (base, replace(base, shader="gouraud"))


def test_the_root_mean_square_of_the_arithmetic():
    """It is not above the largest error, and includes the pixels without error."""
    from clshade import check

    frame = render(sphere())
    found = check(frame, "all")
    assert 0.0 < found.rms < found.error / 2


def test_turns_alternate_and_end():
    seen: list[tuple[str, int]] = []
    draws = [lambda k, name=name: seen.append((name, k)) or k for name in "ab"]
    assert timing.in_turns(draws, 3, seconds=60.0) == [(0, 0), (1, 1), (2, 2)]
    assert seen == [("a", 0), ("b", 0), ("a", 1), ("b", 1), ("a", 2), ("b", 2)]
    assert len(timing.in_turns(draws, 100, seconds=0.0)) == timing.FEWEST


def test_turns_of_several_frames_drop_the_first():
    draws = [timing.turns_of(1, lambda number: number), timing.turns_of(3, lambda number: number)]
    assert timing.in_turns(draws, 2, seconds=60.0) == [([0], [1, 2, 3]), ([1], [5, 6, 7])]


def test_the_interval_of_a_ratio():
    """It contains the ratio, is a point without spread, and is as wide as the rounds differ."""
    assert timing.ratio_interval([6.0] * 5, [2.0] * 5) == (3.0, 3.0)
    rng = np.random.default_rng(3)
    theirs, ours = rng.normal(10.0, 0.5, 40), rng.normal(2.0, 0.1, 40)
    low, high = timing.ratio_interval(theirs, ours)
    assert 4.5 < low < np.median(theirs) / np.median(ours) < high < 5.5
    # A pair's frames share the machine's load: rounds slowed together leave the ratio.
    slowed = np.exp(rng.normal(0.0, 0.5, 40))
    low, high = timing.ratio_interval(theirs * slowed, ours * slowed)
    assert 3.0 < low < high < 8.0

    assert timing.spread([4.0, 1.0, 2.0, 3.0, 5.0]) == (2.0, 3.0, 4.0)


def test_power_laws():
    x = np.array([1.0, 10.0, 40.0, 1000.0])
    assert exponent(x, 7.0 * x**-1.5) == pytest.approx(-1.5)
    assert fitted(x, 7.0 * x**-1.5) == pytest.approx((-1.5, -1.5, -1.5))


def test_the_interval_of_a_power_holds_it():
    """In 95 of 100 samples of points that scatter about a power law."""
    rng = np.random.default_rng(3)
    x = np.array([1.0, 4.0, 16.0, 64.0, 256.0])
    held = [fitted(x, x**-0.75 * np.exp(rng.normal(0.0, 0.2, 5))).contains(-0.75) for _ in range(1000)]
    assert np.mean(held) == pytest.approx(0.95, abs=0.03)
    assert str(fitted(x, x**-0.75)) == "-0.75 (-0.75 to -0.75)"


def test_tessellation(device):
    """Both shadings are of second order in the edge length, hence of first order in the number of triangles, once the
    sphere's highlight, about 20 degrees wide, contains some of them."""
    found = tessellation(device, SMALL)
    gouraud, phong = found.errors["gouraud"], found.errors["phong"]
    assert found.triangles == tuple(20 * 4**level for level in range(7))
    assert found.finest == 20 * 4**7
    assert all(p < g for p, g in zip(phong, gouraud, strict=True))
    assert all(b < a for each in (gouraud, phong) for a, b in itertools.pairwise(each))
    assert exponent(found.triangles[3:], phong[3:]) == pytest.approx(-1.0, abs=0.25)
    assert found.slope("gouraud").exponent == pytest.approx(-0.9, abs=0.25)


def test_formats(device):
    frame = render(sphere(), device=device)
    found = {each.name: each for each in formats(frame)}
    brightest = float(frame.rgb.max())
    assert (found["EXR float"].rmse, found["EXR float"].largest) == (0.0, 0.0)
    assert 0.0 < found["EXR half"].largest <= brightest * 2.0**-11  # half a unit in the last of 11 bits
    assert 0.0 < found["EXR pxr24"].largest <= brightest * 2.0**-16  # 15 bits are kept after the first
    for name in ("EXR half b44", "EXR half dwaa"):
        assert found["EXR half"].rmse < found[name].rmse < 0.1
    # A step of the sRGB curve is at most 2.4/1.055 / 255 wide at white; brighter values are lost.
    assert found["PNG 8 bit srgb"].largest <= max(brightest - 1.0 + 0.005, 0.005)
    assert all(each.bytes > 100 and each.write_ms.median > 0.0 for each in found.values())


# Tables and the figure


def test_tables():
    header, rows = ("name", "n"), [("a", "10"), ("long|er", "5")]
    assert text_tables.as_lines(header, rows) == ["name      n", "a        10", "long|er   5"]
    assert text_tables.as_markdown(header, rows)[1:] == ["| --- | --- |", "| a | 10 |", "| long\\|er | 5 |"]
    assert list(csv.reader(io.StringIO(text_tables.as_csv(header, [("a,b", '"')])))) == [["name", "n"], ["a,b", '"']]
    assert (text_tables.digits(0.00123456), text_tables.digits(None)) == ("0.00123", "-")


def test_labels_lie_apart():
    """Eighteen labels, six of them of nearly coincident points, with a line through the middle."""
    rng = np.random.default_rng(2)
    points = [*rng.uniform([40, 40], [560, 410], (12, 2)), *(np.array([300.0, 200.0]) + rng.uniform(-6, 6, (6, 2)))]
    sizes = [(w, 11.0) for w in rng.uniform(30, 90, 18)]
    frame, line = Box(0, 0, 600, 450), Box(0, 224, 600, 226)
    boxes = placed([tuple(p) for p in points], sizes, frame, [line])
    dots = [Box(x, y, x + 1e-9, y + 1e-9) for x, y in points]
    for box, size in zip(boxes, sizes, strict=True):
        assert (box.right - box.left, box.top - box.bottom) == pytest.approx(size)
        assert box.overlap(frame) == pytest.approx(box.area)
        assert not box.overlap(line)
        assert not any(box.overlap(dot) for dot in dots)
    assert not any(a.overlap(b) for a, b in itertools.combinations(boxes, 2))


def test_labels_where_there_is_no_room():
    boxes = placed([(5.0, 5.0)] * 3, [(50.0, 50.0)] * 3, Box(0, 0, 10, 10))
    assert len(boxes) == 3


def made_up(found: study.Study, costs: list[tuple[float, float]]) -> study.Study:
    """Return the study with variants of these times and errors."""
    one = found.measured[0]
    error = one.approximation
    measured = [
        replace(
            one,
            variant=Variant(f"variant-{k}", f"variant-{k}", {}),
            frame_ms=timing.Spread(0.95 * cost, cost, 1.05 * cost),
            approximation=replace(error, rmse=rmse_of),
        )
        for k, (cost, rmse_of) in enumerate(costs)
    ]
    return replace(found, measured=tuple(measured))


@pytest.fixture
def found(device) -> study.Study:
    return small_study(device)


def test_the_tables_fit_a_terminal(found):
    """Also with very long names, and times of minutes."""
    long = [replace(each, variant=replace(each.variant, title="many_letters" * 9)) for each in found.measured]
    slow = [replace(each, frame_ms=timing.Spread(*(1e5 * ms for ms in each.frame_ms))) for each in long]
    lines = "\n".join(tables.lines(replace(found, measured=tuple(slow)))).splitlines()
    assert max(map(len, lines)) <= 100
    for word in ("many_letters", "half of them", "arithmetic", "upload ms", "power of size", "write ms"):
        assert any(word in line for line in lines)


def test_two_equal_ways_tie(device):
    """Frames enough that medians of equal distributions lie within each other's interquartile range."""
    scene = sphere()
    base = base_settings(scene)
    ways = [Variant(name, "", {}) for name in ("one", "other")]
    ways.append(Variant("coarse", "", {"shader": "gouraud"}))
    one, other, coarse = measure(scene, ways, base, device, reference(scene, base, device), frames=101)
    known = abs(coarse.error - one.error) / 2
    assert tied(one, other, known)
    assert not tied(one, coarse, known)
    assert [one.name, other.name] in [sorted(each.name for each in group) for group in ties([one, other], known)]
    assert one.interval[0] <= one.cost <= one.interval[1]


def test_ties_are_marked_and_named(found):
    tied_ones = made_up(found, [(1.0, 0.5), (2.0, 0.1), (2.04, 0.1)])
    lines = tables.lines(tied_ones)
    for name, mark in (("variant-0", "*"), ("variant-1", "*="), ("variant-2", "*=")):
        assert {line.split()[1] for line in lines if line.startswith(name)} == {mark}
    assert any(line.startswith("= variant-1, variant-2 are ties") for line in lines)
    assert tied_ones.stats()["ties"] == [["variant-1", "variant-2"]]


def test_causes_are_those_of_the_image_that_render_draws(found):
    assert found.details.decomposition.settings.samples == SAMPLES


def test_the_front_of_a_study(found):
    several = made_up(found, [(5.0, 0.1), (1.0, 0.2), (9.0, 0.01), (2.0, 0.9), (6.0, 0.05), (7.0, 0.4)])
    assert [each.cost for each in several.front] == [1.0, 5.0, 6.0, 9.0]


def test_pictures_show_the_first_way_the_worst_model_and_the_best_way(found):
    standard, gouraud = found.measured
    assert list(found.pictures) == ["1 sample, off by", "Gouraud, its model off by"]
    off, model = found.pictures.values()
    drawn = render(sphere(), settings=standard.settings).rgb
    assert (off == drawn - found.reference.rgb).all()
    assert metrics.rms(off) == standard.error
    assert metrics.rms(model) == gouraud.model
    assert figure.size(np.full((3, 4, 3), [0.0, 0.25, -0.5])) == pytest.approx(np.full((3, 4), 0.5))


@pytest.mark.long
def test_the_figure_names_every_point(found, tmp_path, monkeypatch):
    monkeypatch.setattr(figure, "DPI", 60)
    several = made_up(found, [(1.0 + k, 0.5 / (1 + k)) for k in range(9)] + [(3.0, 0.0)])
    written: list[str] = []
    original = labels.label_points
    monkeypatch.setattr(
        figure,
        "label_points",
        lambda axes, x, y, names, lines: written.extend(names) or original(axes, x, y, names, lines),
    )
    figures.save(figure.draw(several), tmp_path / "a.png")
    assert written[:10] == [f"variant-{k}" for k in range(10)]
    assert png.read(tmp_path / "a.png").std() > 20.0


@pytest.mark.long
def test_the_figure_of_one_way(found, recwarn):
    """Drawn once, with the reference's error, and none of its arithmetic."""
    (one,) = made_up(found, [(2.0, found.reference.error)]).measured
    one = replace(one, frame_ms=timing.Spread(2.0, 2.0, 2.0), arithmetic=replace(one.arithmetic, rms=0.0))
    drawn = figure.draw(replace(found, measured=(one,), pictures={}))
    for low, high in (drawn.axes[0].get_xlim(), drawn.axes[0].get_ylim()):
        assert low < 0.8 * high
    assert not [each.message for each in recwarn if not issubclass(each.category, DeprecationWarning)]  # of others


def test_axes_of_a_single_value(found):
    axes = figures.blank(1.0, 1.0).add_subplot()
    figure._limit(axes, found.measured[:1], [1e-7])
    np.testing.assert_allclose(axes.get_ylim(), [0.5e-7, 2e-7])


def test_the_figure_of_ways_with_the_same_error(found):
    """To the last bit but one, as of a scene without lights; the reference's own error is in sight, too."""
    error = 40.0 * found.reference.error
    study = made_up(found, [(1.0, error), (2.0, np.nextafter(error, 1.0))])
    axes = figures.blank(1.0, 1.0).add_subplot()
    figure._errors_against_time(axes, study)
    low, high = axes.get_ylim()
    assert 0.0 < low < found.reference.error < error < 0.9 * high


# The command


def no_constants(text: str) -> float:
    raise AssertionError(f"{text} is no JSON")


@pytest.fixture
def no_figure(monkeypatch):
    """Skip the figure, which takes seconds to draw."""
    monkeypatch.setattr(figure, "draw", lambda study: figures.blank(0.2, 0.2))


@pytest.mark.usefixtures("no_figure")
def test_run_writes_all(found, device, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "study", lambda *arguments: found)
    text = io.StringIO()
    options = {"out": tmp_path / "new" / "folder", "stream": text, "budget": 1e6}
    options |= {"formats": ("png", "pdf", "svg"), "html": True}
    assert report.run(sphere(), device.index, **options)
    folder = tmp_path / "new" / "folder"
    assert {path.name for path in folder.iterdir()} == {
        f"report.{suffix}" for suffix in ("csv", "json", "md", "png", "pdf", "svg", "html")
    }
    written = json.loads((folder / "report.json").read_text(), parse_constant=no_constants)
    assert [each["variant"] for each in written["variants"]] == [BASE, "gouraud"]
    assert written["variants"][0]["approximation"]["rmse"] == found.measured[0].error
    assert written["use"] == min(found.measured, key=lambda each: each.error).variant.name
    assert written["machine"] == study.machine()
    rows = list(csv.DictReader((folder / "report.csv").open()))
    assert [row["name"] for row in rows if row["study"] == "variant"] == [BASE, "gouraud"]
    assert float(rows[0]["rmse"]) == found.measured[0].error
    assert {row["study"] for row in rows} == {"variant", "cause", "format", "tessellation", "family"}
    shown = text.getvalue()
    page = (folder / "report.md").read_text()
    assert "use 1 sample: " in shown
    for part in (found.device, found.machine, "use 1 sample: ", "PNG 8 bit srgb", "320 triangles"):
        assert part in page
    for each in written["answer"]:
        assert each["command"] in page
        assert any(line.startswith(each["purpose"]) and line.endswith(each["command"]) for line in shown.splitlines())
    assert "PNG 8 bit srgb" not in shown
    assert report.run(sphere(), device.index, out=tmp_path, details=True, stream=text)
    assert "PNG 8 bit srgb" in text.getvalue()


@pytest.mark.parametrize("name", ["course", "teapot", "quads"])
def test_the_options_named_draw_what_was_measured(device, name):
    """For any preset that `render` would use for the scene."""
    from clshade.cli.commands import render as command

    own = builtin(name)
    scene = replace(own, camera=own.camera.with_resolution((48, 36)))
    base = base_settings(scene)
    parser = _parser(["render"])
    for each in variants_for(scene, base, device):
        options = tables.render_options(scene, tables.render_fields(each.settings(base), scene))
        arguments = parser.parse_args(["render", name, *options])
        kept = command.render_options(arguments, own)
        kept.pop("device")
        again, settings = effective_settings(own, **kept)
        assert settings == each.settings(base), each.name
        assert again.camera.resolution == (48, 36)
    standard = ["--samples=1"] if own.preset == "standard" else ["--preset=standard"]
    assert tables.render_options(scene, tables.render_fields(Settings(), scene))[1:] == standard
    unshadowed = {"samples": 1, "shadows": False}
    assert tables.render_fields(Settings(shader="pbr"), replace(scene, preset="pbr")) == unshadowed
    shadowed = {"samples": 1, "shadows": True}
    assert tables.render_fields(Settings(shadows=True), replace(scene, preset="standard")) == shadowed


@pytest.mark.usefixtures("no_figure")
def test_a_limit_that_nothing_keeps(found, device, tmp_path, monkeypatch):
    """The measurements are written all the same."""
    monkeypatch.setattr(report, "study", lambda *arguments: found)
    with pytest.raises(
        InputError, match=r"--tolerance: 1e-12 is below what errors are known to, .* \(the best variant, .* has .*\)"
    ):
        report.run(sphere(), device.index, out=tmp_path, tolerance=1e-12, stream=io.StringIO())
    assert (tmp_path / "report.png").exists()
    assert json.loads((tmp_path / "report.json").read_text())["use"] is None


@pytest.mark.parametrize("name", ["report.json", "report.svg", "report.html"])
def test_files_that_cannot_be_written_are_found_before_measuring(device, tmp_path, monkeypatch, name):
    monkeypatch.setattr(report, "study", lambda *arguments: pytest.fail("something was measured"))
    (tmp_path / name).mkdir()
    with pytest.raises(OutputError, match=name):
        report.run(sphere(), device.index, out=tmp_path, formats=("svg",), html=True, stream=io.StringIO())
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.usefixtures("no_figure")
def test_wrong_coverage_fails(found, device, tmp_path, monkeypatch):
    one = found.measured[0]
    spoiled = replace(one, arithmetic=replace(one.arithmetic, wrong=1))
    monkeypatch.setattr(report, "study", lambda *arguments: replace(found, measured=(spoiled,)))
    assert not report.run(sphere(), device.index, out=tmp_path, stream=io.StringIO())


@pytest.mark.usefixtures("no_figure")
def test_the_command_line(found, device, capsys, tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr(report, "study", lambda *arguments: given.append(arguments) or found)
    command = ("report", "icosphere", "--device", device.index, "--out", tmp_path, "--only", BASE, "--frames", "2")
    code, out, err = run(capsys, *command, "--budget", "1000s")
    assert (code, err) == (0, [])
    assert "use " in out
    scene, _, chosen, frames, settings, details = given[0]
    assert details
    assert (scene.camera.resolution, [each.name for each in chosen], frames) == ((320, 240), [BASE], 2)
    assert settings == {}
    code, out, err = run(capsys, "report", "--list")
    assert (code, err) == (0, [])
    listed = [line.split()[0] for line in out.splitlines() if not line.startswith(" ")]
    assert listed == [each.name for each in variants.VARIANTS]
    assert "4 shaded samples: --samples=4 --sample-shading" in out


REFUSED = [
    (("--only", "guro"), ("--only", "standard", "'guro'")),
    (("--frames", "0"), ("--frames", "0")),
    (("--format", "png,gif"), ("--format", "png, pdf, svg", "'gif'")),
    (
        ("--family", "samplse"),
        (
            "--family",
            "samples, shaded, gouraud, filter, light-samples, occlusion-rays, precision",
            "did you mean 'samples'",
        ),
    ),
    (("--family", "filter"), ("--family", "three variants that change this scene are needed", "filter has none")),
    (("--out", "figure.pdf"), ("--out", "expected a folder", "--format pdf")),
    (("--out", "page.html"), ("--out", "expected a folder", "--html")),
    (("--budget", "0ms"), ("--budget", "'0ms'")),
    (("--budget", "-3"), ("--budget", "'-3'")),
    (("--tolerance", "0"), ("--tolerance", "'0'")),
    (("--budget", "5ms", "--tolerance", "1e-3"), ("--tolerance", "not allowed with", "--budget")),
    (("--resolution", "0,5"), ("resolution", "0")),
    (("--light-samples", "0"), ("light_samples", "0")),
    (("--out", "file/x"), ("file/x", "--out")),
]


@pytest.mark.parametrize(("options", "parts"), REFUSED, ids=[" ".join(options) for options, _ in REFUSED])
def test_refused(device, capsys, tmp_path, monkeypatch, options, parts):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    monkeypatch.setattr(report, "study", lambda *arguments: pytest.fail("something was measured"))
    assert_refused(run(capsys, "report", "icosphere", "--device", device.index, *options), *parts)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ((), {}),
        (("--shadows", "--light-samples", "4"), {"shadows": True, "light_samples": 4}),
        (("--no-shadows",), {"shadows": False}),
        (("--ambient-occlusion", "4", "--ao-distance", "0.5"), {"ambient_occlusion": 4, "ao_distance": 0.5}),
    ],
    ids=str,
)
def test_settings_that_all_ways_share(device, capsys, tmp_path, monkeypatch, options, expected):
    def measured(scene, opened, chosen, frames, settings, details):
        assert scene.lights[0].radius == 0.25
        assert settings == expected
        for each in chosen:
            drawn = vars(each.settings(base_settings(scene, **settings)))
            assert {name: drawn[name] for name in expected} == {
                **expected,
                **{name: each.changes[name] for name in expected if name in each.changes},
            }
        raise InputError("measured")

    monkeypatch.setattr(report, "study", measured)
    given = ("report", "icosphere", "--light-radius", "0.25", "--device", device.index, "-o", tmp_path / "out")
    assert_refused(run(capsys, *given, *options), "measured")


@pytest.mark.long
def test_points_of_lights_below_a_lamp(device, capsys, tmp_path):
    """Of shadows; the whole report of a small image."""
    options = ("--resolution", "48,36", "--shadows", "--light-radius", "0.3", "--family", "light-samples")
    code, out, _ = run(
        capsys, "report", "box_room", *options, "--frames", "1", "-o", tmp_path, "--device", device.index
    )
    assert code == 0
    found = json.loads((tmp_path / "report.json").read_text())
    assert found["settings"] == {"shadows": True}
    (family,) = (each for each in found["families"] if each["family"] == "light-samples")
    assert -1.2 < family["slope"]["exponent"] < -0.5
    assert [each["known"] for each in family["members"]] == [True, True, True, True]
    assert "light-samples (points of each light" in " ".join(out.split())
