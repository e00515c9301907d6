"""`report`: errors and times of variants, tables, figure, the command."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import assert_refused, run
from pages import parsed
from studies import small_study, sphere

from clshade.errors import InputError
from clshade.images import figures, png
from clshade.measure import timing
from clshade.measure.report import figure, report, study, variants
from clshade.measure.report.answer import answer
from clshade.measure.report.labels import places
from clshade.measure.report.measure import measure
from clshade.measure.report.model_errors import ModelErrors
from clshade.measure.report.power_law import fitted
from clshade.measure.report.reference_image import reference
from clshade.measure.report.variants import BASE, Variant, base_settings, named, variants_for
from clshade.pipeline.renderer import render

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


def test_intervals_of_ratios_and_powers():
    """They contain the ratio, are a point without spread, and are as wide as the rounds differ."""
    assert timing.ratio_interval([6.0] * 5, [2.0] * 5) == (3.0, 3.0)
    rng = np.random.default_rng(3)
    theirs, ours = rng.normal(10.0, 0.5, 40), rng.normal(2.0, 0.1, 40)
    low, high = timing.ratio_interval(theirs, ours)
    assert 4.5 < low < np.median(theirs) / np.median(ours) < high < 5.5
    # The interval of a fitted power holds it in 95 of 100 samples of points that scatter about it.
    x = np.array([1.0, 4.0, 16.0, 64.0, 256.0])
    assert fitted(x, 7.0 * x**-1.5) == pytest.approx((-1.5, -1.5, -1.5))
    powers = [fitted(x, x**-0.75 * np.exp(rng.normal(0.0, 0.2, 5))) for _ in range(1000)]
    assert np.mean([low <= -0.75 <= high for _, low, high in powers]) == pytest.approx(0.95, abs=0.03)


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


def made_up(studied: study.Study, costs: list[tuple[float, float]]) -> study.Study:
    (one, *_), measured = studied.measured, []
    for k, (cost, error) in enumerate(costs):
        variant, times = Variant(f"variant-{k}", f"variant-{k}", {}), (0.95 * cost, cost, 1.05 * cost)
        approximation = replace(one.approximation, rmse=error)
        measured.append(replace(one, variant=variant, times=times, approximation=approximation))
    return replace(studied, measured=tuple(measured))


@pytest.fixture
def studied(device) -> study.Study:
    return small_study(device)


@pytest.mark.long
def test_the_figure_names_every_point(studied, tmp_path, monkeypatch, recwarn):
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


@pytest.fixture
def measured(studied, monkeypatch) -> list[tuple]:
    """Skip measuring and the figure, which takes seconds to draw; return the arguments of each study."""
    calls: list[tuple] = []
    monkeypatch.setattr(report, "study", lambda *arguments: calls.append(arguments) or studied)
    monkeypatch.setattr(figure, "draw", lambda study: figures.blank(0.2, 0.2))
    return calls


INSIDE = ("#", "data:image/png;base64,", "data:image/svg+xml;base64,")
HOSTILE = '<script>alert("x")</script>&$1$\x1b[31m\u202e'


@pytest.mark.usefixtures("measured")
def test_run_writes_all(studied, device, capsys, tmp_path, monkeypatch):
    """The page loads nothing, and a hostile name is text."""
    named = replace(studied, scene=replace(studied.scene, name=HOSTILE))
    monkeypatch.setattr(report, "study", lambda *arguments: named)
    folder = tmp_path / "new" / "folder"
    options = {"out": folder, "budget": 1e6, "formats": ("png", "pdf", "svg"), "html": True}
    assert report.run(sphere(), device.index, command=lambda settings: f"draw <{settings.samples}>", **options)
    endings = ("csv", "json", "md", "png", "pdf", "svg", "html")
    assert {path.name for path in folder.iterdir()} == {f"report.{ending}" for ending in endings}
    written = json.loads((folder / "report.json").read_text())
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
            assert node.attributes.get(name, "#").startswith(INSIDE)
    assert all("<script>alert(" in page.all(tag)[0].text for tag in ("title", "h1"))
    assert len(page.all("img")) == 1


@pytest.mark.usefixtures("measured")
def test_details_failures_and_limits_that_nothing_keeps(studied, device, capsys, tmp_path, monkeypatch):
    for details in (False, True):
        assert report.run(sphere(), device.index, command=str, out=tmp_path, details=details)
        assert ("8-bit PNG" in capsys.readouterr().out) == details
    with pytest.raises(
        InputError, match=r"--tolerance: 1e-12 is below what errors are known to, .* \(the best variant, .* has .*\)"
    ):
        report.run(sphere(), device.index, command=str, out=tmp_path / "new", tolerance=1e-12)
    assert (tmp_path / "new" / "report.png").exists()
    assert json.loads((tmp_path / "new" / "report.json").read_text())["use"] is None
    one = studied.measured[0]
    spoiled = replace(studied, measured=(replace(one, arithmetic=replace(one.arithmetic, wrong=1)),))
    monkeypatch.setattr(report, "study", lambda *arguments: spoiled)
    assert not report.run(sphere(), device.index, command=str, out=tmp_path)


def test_the_command_line(measured, device, capsys, tmp_path):
    command = ("report", "icosphere", "--device", device.index, "--out", tmp_path, "--only", BASE, "--frames", "2")
    code, out, err = run(capsys, *command, "--budget", "1000s")
    assert (code, err, "use " in out) == (0, [], True)
    ((scene, _, chosen, frames, settings, details),) = measured
    assert (scene.camera.resolution, [variant.name for variant in chosen], frames) == ((320, 240), [BASE], 2)
    assert (settings, details) == ({}, True)
    code, out, err = run(capsys, "report", "--list")
    assert (code, err) == (0, [])
    listed = [line.split()[0] for line in out.splitlines() if not line.startswith(" ")]
    assert listed == [variant.name for variant in variants.VARIANTS]
    assert "4 shaded samples: --samples=4 --sample-shading" in out


SHARED = {
    "--shadows --light-samples 4": {"shadows": True, "light_samples": 4},
    "--no-shadows": {"shadows": False},
    "--ambient-occlusion 4 --ao-distance 0.5": {"ambient_occlusion": 4, "ao_distance": 0.5},
}


@pytest.mark.parametrize("options", SHARED)
def test_settings_that_all_ways_share(device, capsys, tmp_path, monkeypatch, options):
    def check(scene, opened, chosen, frames, settings, details):
        assert scene.lights[0].radius == 0.25
        assert settings == SHARED[options]
        for variant in chosen:
            drawn = vars(variant.settings(base_settings(scene, **settings)))
            expected = {name: variant.changes.get(name, value) for name, value in settings.items()}
            assert {name: drawn[name] for name in expected} == expected
        raise InputError("measured")

    monkeypatch.setattr(report, "study", check)
    command = ("report", "icosphere", "--light-radius", "0.25", "--device", device.index, "-o", tmp_path / "out")
    assert_refused(run(capsys, *command, *options.split()), "measured")
