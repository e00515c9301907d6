"""`report`: errors and times of variants, tables, figure, the command."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import assert_refused, run
from pages import parsed
from studies import small_study, sphere

from clshade.errors import InputError, OutputError
from clshade.images import figures, metrics, png
from clshade.measure import timing
from clshade.measure.report import figure, report, study, tables, variants
from clshade.measure.report.answer import answer
from clshade.measure.report.labels import places
from clshade.measure.report.measure import frame_times, measure
from clshade.measure.report.model_errors import ModelErrors
from clshade.measure.report.power_law import fitted
from clshade.measure.report.reference_image import reference
from clshade.measure.report.variants import BASE, Variant, base_settings, named, variants_for
from clshade.pipeline.effective_settings import SAMPLES
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Settings

# Measuring


def test_measured_errors_are_those_of_the_images(device):
    """A planted error in the reference is found, and not attributed to the image's own arithmetic."""
    scene = sphere()
    base = base_settings(scene)
    image = render(scene, settings=base, device=device).rgb.astype(np.float64)
    planted = replace(reference(scene, base, device), rgb=image + 0.125)
    chosen = named(variants_for(scene, base_settings(scene), device), [BASE, "gouraud"])
    models = ModelErrors(scene, planted.settings, device)
    standard, gouraud = measure(scene, chosen, base, device, planted, models, frames=3)
    assert standard.error == pytest.approx(0.125, rel=1e-6)
    assert gouraud.error != standard.error
    for measurement in (standard, gouraud):
        assert measurement.arithmetic.wrong == 0
        assert 0.0 < measurement.arithmetic.rms < measurement.arithmetic.error < 1e-5
        assert measurement.frame_ms.low > 0.0
    assert (standard.settings, gouraud.settings) == (base, replace(base, shader="gouraud"))


def test_each_renderer_has_its_own_times():
    """Whichever begins a round; all draw the same cameras."""
    drawn: list[tuple[float, tuple[float, ...]]] = []

    class Fake:
        scene = sphere()

        def __init__(self, ms):
            self.ms = ms

        def render(self, camera):
            drawn.append((self.ms, tuple(camera.eye)))
            return SimpleNamespace(stats={"times_ms": {"frame": self.ms}})

    renderers = [Fake(float(ms)) for ms in range(3)]
    assert frame_times(renderers, 4) == [(0.0,) * 4, (1.0,) * 4, (2.0,) * 4]
    assert [ms for ms, _ in drawn] == [0, 1, 2, 1, 2, 0, 2, 0, 1, 0, 1, 2]
    assert [len({eye for _, eye in drawn[k : k + 3]}) for k in range(0, 12, 3)] == [1] * 4
    assert len({eye for _, eye in drawn}) == 4
    assert frame_times([], 4) == []


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


def test_the_interval_of_a_power_holds_it():
    """In 95 of 100 samples of points that scatter about a power law."""
    x = np.array([1.0, 4.0, 16.0, 64.0, 256.0])
    assert fitted(x, 7.0 * x**-1.5) == pytest.approx((-1.5, -1.5, -1.5))
    rng = np.random.default_rng(3)
    powers = [fitted(x, x**-0.75 * np.exp(rng.normal(0.0, 0.2, 5))) for _ in range(1000)]
    assert np.mean([low <= -0.75 <= high for _, low, high in powers]) == pytest.approx(0.95, abs=0.03)


# Tables and the figure


def test_labels_lie_apart():
    """Eighteen labels, six of them of nearly coincident points, with a line through the middle."""
    rng = np.random.default_rng(2)
    near = np.array([300.0, 200.0]) + rng.uniform(-6, 6, (6, 2))
    points = np.concatenate([rng.uniform([40, 40], [560, 410], (12, 2)), near])
    sizes = np.column_stack([rng.uniform(30, 90, 18), np.full(18, 11.0)])
    dots = np.concatenate([points, np.column_stack([np.arange(600.0), np.full(600, 225.0)])])
    middles = places(points, sizes, np.array([0.0, 0.0, 600.0, 450.0]), dots)
    low, high = middles - sizes / 2.0, middles + sizes / 2.0
    assert (low >= 0.0).all()
    assert (high <= (600.0, 450.0)).all()
    assert not ((low[:, None] <= dots) & (dots <= high[:, None])).all(axis=2).any()
    apart = ((low[:, None] >= high) | (high[:, None] <= low)).any(axis=2)
    assert (apart | np.eye(18, dtype=bool)).all()
    crowded = places(np.full((3, 2), 5.0), np.full((3, 2), 50.0), np.array([0.0, 0.0, 10.0, 10.0]), np.empty((0, 2)))
    assert len({tuple(middle) for middle in crowded}) == 3


def made_up(studied: study.Study, costs: list[tuple[float, float]]) -> study.Study:
    """Return the study with variants of these times and errors."""
    one = studied.measured[0]
    error = one.approximation
    measured = [
        replace(
            one,
            variant=Variant(f"variant-{k}", f"variant-{k}", {}),
            times=(0.95 * cost, cost, 1.05 * cost),
            approximation=replace(error, rmse=rmse_of),
        )
        for k, (cost, rmse_of) in enumerate(costs)
    ]
    return replace(studied, measured=tuple(measured))


@pytest.fixture
def studied(device) -> study.Study:
    return small_study(device)


def test_the_tables_fit_a_terminal(studied):
    """Also with very long names, and times of minutes."""
    long = [
        replace(measurement, variant=replace(measurement.variant, title="many_letters" * 9))
        for measurement in studied.measured
    ]
    slow = [replace(measurement, times=tuple(1e5 * ms for ms in measurement.times)) for measurement in long]
    lines = "\n".join(tables.results(replace(studied, measured=tuple(slow))).lines()).splitlines()
    assert max(map(len, lines)) <= 100
    for word in ("many_letters", "half of them", "arithmetic", "share"):
        assert any(word in line for line in lines)


def test_causes_are_those_of_the_image_that_render_draws(studied):
    assert studied.causes.settings.samples == SAMPLES


def test_the_front_of_a_study(studied):
    several = made_up(studied, [(5.0, 0.1), (1.0, 0.2), (9.0, 0.01), (2.0, 0.9), (6.0, 0.05), (7.0, 0.4)])
    assert [measurement.cost for measurement in several.front] == [1.0, 5.0, 6.0, 9.0]
    rows = tables.results(several).tables[0].rows()
    assert [row[0] for row in rows if row[0].endswith(" *")] == [f"variant-{k} *" for k in (0, 1, 2, 4)]


def test_families_are_joined_where_their_errors_are_known(studied):
    floor = studied.reference.error
    errors = {BASE: 64.0 * floor, "samples-64": 0.9 * floor, "samples-4": 16.0 * floor, "samples-16": 4.0 * floor}
    samples = {BASE: 1, "samples-4": 4, "samples-16": 16, "samples-64": 64}
    several = [
        replace(measurement, variant=Variant(name, name, {}), settings=Settings(samples=samples[name]))
        for measurement, name in zip(
            made_up(studied, [(samples[name], errors[name]) for name in errors]).measured, errors, strict=True
        )
    ]
    assert figure._curves(replace(studied, measured=tuple(several))) == {
        "shaded once": [(1.0, 64.0 * floor), (4.0, 16.0 * floor), (16.0, 4.0 * floor)]
    }
    assert figure._curves(replace(studied, measured=tuple(several[1:]))) == {}


def test_pictures_show_the_first_way_and_the_front(studied, device):
    standard, gouraud = studied.measured
    best = replace(gouraud, approximation=replace(gouraud.approximation, rmse=0.1 * standard.error))
    shown = study.pictures(sphere(), device, (standard, best), studied.reference)
    assert list(shown) == ["1 sample, off by", "Gouraud, off by"]
    assert metrics.rms(shown["1 sample, off by"]) == standard.error
    assert metrics.rms(shown["Gouraud, off by"]) == gouraud.error
    planted = {"off": np.full((3, 4, 3), [0.0, 0.25, -0.5]), "by half": np.full((3, 4, 3), 0.5)}
    _, off, half = figure.colored(replace(studied, pictures=planted)).values()
    assert (off == half).all()
    assert off.any()


@pytest.mark.long
def test_the_figure_names_every_point(studied, tmp_path, monkeypatch, recwarn):
    """Also of one way, drawn once, with the reference's error."""
    monkeypatch.setattr(figure, "DPI", 60)
    drawn = figure.draw(made_up(studied, [(1.0 + k, 0.5 / (1 + k)) for k in range(9)] + [(3.0, 0.0)]))
    figures.save(drawn, tmp_path / "a.png")
    assert {f"variant-{k}" for k in range(10)} <= {text.get_text() for text in drawn.axes[0].texts}
    assert png.read(tmp_path / "a.png").std() > 20.0
    (one,) = made_up(studied, [(2.0, studied.reference.error)]).measured
    drawn = figure.draw(replace(studied, measured=(replace(one, times=(2.0,)),), pictures={}))
    for low, high in (drawn.axes[0].get_xlim(), drawn.axes[0].get_ylim()):
        assert low < 0.8 * high
    ours = [warning.message for warning in recwarn if not issubclass(warning.category, DeprecationWarning)]
    assert ours == []


def test_the_figure_of_ways_with_the_same_error(studied):
    """To the last bit but one, as of a scene without lights; the reference's own error is in sight, too."""
    error = 40.0 * studied.reference.error
    study = made_up(studied, [(1.0, error), (2.0, np.nextafter(error, 1.0))])
    axes = figures.blank(1.0, 1.0).add_subplot()
    figure._errors_against_time(axes, study)
    low, high = axes.get_ylim()
    assert 0.0 < low < studied.reference.error < error < 0.9 * high


# The command


@pytest.fixture
def no_figure(monkeypatch):
    """Skip the figure, which takes seconds to draw."""
    monkeypatch.setattr(figure, "draw", lambda study: figures.blank(0.2, 0.2))


HOSTILE = '<script>alert("x")</script>&$1$\x1b[31m\u202e'


@pytest.mark.usefixtures("no_figure")
def test_run_writes_all(studied, device, capsys, tmp_path, monkeypatch):
    """The page loads nothing, and a hostile name is text."""
    named = replace(studied, scene=replace(studied.scene, name=HOSTILE))
    monkeypatch.setattr(report, "study", lambda *arguments: named)
    options = {"out": tmp_path / "new" / "folder", "budget": 1e6, "formats": ("png", "pdf", "svg"), "html": True}
    assert report.run(sphere(), device.index, command=lambda settings: f"draw <{settings.samples}>", **options)
    folder = tmp_path / "new" / "folder"
    endings = ("csv", "json", "md", "png", "pdf", "svg", "html")
    assert {path.name for path in folder.iterdir()} == {f"report.{ending}" for ending in endings}
    written = json.loads((folder / "report.json").read_text())
    for entry, one in zip(written["variants"], studied.measured, strict=True):
        assert (entry["name"], entry["rmse"]) == (one.variant.name, one.error)
        assert entry["ms_low"] <= entry["ms"] <= entry["ms_high"]
    causes = [entry["cause"] for entry in written["where_the_error_comes_from"]]
    assert causes == ["sampling", "arithmetic", "8-bit PNG"]
    assert written["use"] == min(studied.measured, key=lambda measurement: measurement.error).variant.name
    assert (written["machine"], written["resolution"], written["default"]) == (study.machine(), [64, 48], None)
    shown = capsys.readouterr().out
    assert "\nuse 1 sample: " in shown
    assert "no visible error: at least 99% of pixels" in shown
    for entry in answer(studied):
        command = f"draw <{entry.used.settings.samples}>"
        assert written[entry.purpose].endswith(command)
        assert any(line.startswith(entry.purpose) and line.endswith(command) for line in shown.splitlines())
    page = parsed((folder / "report.html").read_bytes())
    for node in page.all():
        assert node.tag not in ("script", "link", "iframe", "object", "embed")
        for name in ("src", "href"):
            assert node.attributes.get(name, "#").startswith(
                ("#", "data:image/png;base64,", "data:image/svg+xml;base64,")
            )
    assert all("<script>alert(" in page.all(tag)[0].text for tag in ("title", "h1"))
    assert page.all("dt")[0].text in ("no visible error", "closest")
    assert page.all("dd")[0].text.endswith("draw <1>")
    assert [node.text for node in page.all("h2")] == ["Variants", "Where the error comes from"]
    assert len(page.all("img")) == 1


@pytest.mark.usefixtures("no_figure")
def test_details_are_shown_where_they_are_asked_for(studied, device, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "study", lambda *arguments: studied)
    for details in (False, True):
        assert report.run(sphere(), device.index, command=str, out=tmp_path, details=details)
        assert ("8-bit PNG" in capsys.readouterr().out) == details


def test_the_options_named_are_relative_to_the_preset():
    scene = builtin("quads")
    assert tables.render_options(scene, tables.render_fields(Settings(), scene))[1:] == ["--samples=1"]
    course = builtin("course")
    assert tables.render_options(course, tables.render_fields(Settings(), course))[1:] == ["--preset=standard"]
    unshadowed = {"samples": 1, "shadows": False}
    assert tables.render_fields(Settings(shader="pbr"), replace(scene, preset="pbr")) == unshadowed
    shadowed = {"samples": 1, "shadows": True}
    assert tables.render_fields(Settings(shadows=True), scene) == shadowed


@pytest.mark.usefixtures("no_figure")
def test_a_limit_that_nothing_keeps(studied, device, tmp_path, monkeypatch):
    """The measurements are written all the same."""
    monkeypatch.setattr(report, "study", lambda *arguments: studied)
    with pytest.raises(
        InputError, match=r"--tolerance: 1e-12 is below what errors are known to, .* \(the best variant, .* has .*\)"
    ):
        report.run(sphere(), device.index, command=str, out=tmp_path, tolerance=1e-12)
    assert (tmp_path / "report.png").exists()
    assert json.loads((tmp_path / "report.json").read_text())["use"] is None


@pytest.mark.parametrize("name", ["report.json", "report.svg", "report.html"])
def test_files_that_cannot_be_written_are_found_before_measuring(device, tmp_path, monkeypatch, name):
    monkeypatch.setattr(report, "study", lambda *arguments: pytest.fail("something was measured"))
    (tmp_path / name).mkdir()
    with pytest.raises(OutputError, match=name):
        report.run(sphere(), device.index, command=str, out=tmp_path, formats=("svg",), html=True)
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.usefixtures("no_figure")
def test_wrong_coverage_fails(studied, device, tmp_path, monkeypatch):
    one = studied.measured[0]
    spoiled = replace(one, arithmetic=replace(one.arithmetic, wrong=1))
    monkeypatch.setattr(report, "study", lambda *arguments: replace(studied, measured=(spoiled,)))
    assert not report.run(sphere(), device.index, command=str, out=tmp_path)


@pytest.mark.usefixtures("no_figure")
def test_the_command_line(studied, device, capsys, tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(report, "study", lambda *arguments: calls.append(arguments) or studied)
    command = ("report", "icosphere", "--device", device.index, "--out", tmp_path, "--only", BASE, "--frames", "2")
    code, out, err = run(capsys, *command, "--budget", "1000s")
    assert (code, err) == (0, [])
    assert "use " in out
    scene, _, chosen, frames, settings, details = calls[0]
    assert details
    assert (scene.camera.resolution, [variant.name for variant in chosen], frames) == ((320, 240), [BASE], 2)
    assert settings == {}
    code, out, err = run(capsys, "report", "--list")
    assert (code, err) == (0, [])
    listed = [line.split()[0] for line in out.splitlines() if not line.startswith(" ")]
    assert listed == [variant.name for variant in variants.VARIANTS]
    assert "4 shaded samples: --samples=4 --sample-shading" in out


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
        for variant in chosen:
            drawn = vars(variant.settings(base_settings(scene, **settings)))
            assert {name: drawn[name] for name in expected} == {
                **expected,
                **{name: variant.changes[name] for name in expected if name in variant.changes},
            }
        raise InputError("measured")

    monkeypatch.setattr(report, "study", measured)
    command = ("report", "icosphere", "--light-radius", "0.25", "--device", device.index, "-o", tmp_path / "out")
    assert_refused(run(capsys, *command, *options), "measured")


@pytest.mark.long
def test_points_of_lights_below_a_lamp(device, capsys, tmp_path):
    """Of shadows; the whole report of a small image."""
    options = ("--resolution", "48,36", "--shadows", "--light-radius", "0.3", "--only", "light-1", "light-64")
    code, out, _ = run(
        capsys, "report", "box_room", *options, "--frames", "1", "-o", tmp_path, "--device", device.index
    )
    assert code == 0
    record = json.loads((tmp_path / "report.json").read_text())
    assert record["settings"] == {"shadows": True}
    one, many = record["variants"]
    assert many["rmse"] < 0.6 * one["rmse"]  # edges of one sample a pixel remain
    assert (tmp_path / "report.png").stat().st_size > 10000
    assert "Where the error comes from" in out
