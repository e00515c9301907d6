"""`report`: errors and times of variants, tables, figure, what to render with, the command."""

import json
import shlex
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from command_line import assert_refused, run
from pages import parsed
from studies import small_study, sphere

from clshade.cli import render as render_command
from clshade.cli import scene as selected
from clshade.cli.main import _parser
from clshade.errors import InputError
from clshade.images import figures, png
from clshade.measure import timing
from clshade.measure.report import figure, report, study, variants
from clshade.measure.report.answer import CLOSE, FLIP, answer, criterion
from clshade.measure.report.labels import places
from clshade.measure.report.measure import CODES, close_share, measure
from clshade.measure.report.model_errors import ModelErrors
from clshade.measure.report.power_law import fitted
from clshade.measure.report.reference_image import reference
from clshade.measure.report.variants import BASE, Variant, base_settings, default_variant, named, variants_for
from clshade.pipeline.effective_settings import effective_settings, picture_fields
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.description import part_digests
from clshade.scene.model import Settings


@pytest.mark.long
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
    assert [warning.message for warning in recwarn if not issubclass(warning.category, DeprecationWarning)] == []


@pytest.fixture
def measured(studied, monkeypatch) -> list[tuple]:
    """Skip measuring and the figure, which takes seconds to draw; return the arguments of each study."""
    calls: list[tuple] = []
    monkeypatch.setattr(report, "study", lambda *arguments: calls.append(arguments) or studied)
    monkeypatch.setattr(figure, "draw", lambda study: figures.blank(0.2, 0.2))
    return calls


INSIDE = ("#", "data:image/png;base64,", "data:image/svg+xml;base64,")
HOSTILE = '<script>alert("x")</script>&$1$\x1b[31m\u202e'


@pytest.mark.long
@pytest.mark.usefixtures("measured")
def test_run_writes_all(studied, device, capsys, tmp_path, monkeypatch):
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


@pytest.mark.sampled
@pytest.mark.usefixtures("measured")
def test_details_failures_and_limits_that_nothing_keeps(studied, device, capsys, tmp_path, monkeypatch):
    for details in (False, True):
        assert report.run(sphere(), device.index, command=str, out=tmp_path, details=details)
        assert ("8-bit PNG" in capsys.readouterr().out) == details
    message = r"--tolerance: 1e-12 is below what errors are known to, .* \(the best variant, .* has .*\)"
    with pytest.raises(InputError, match=message):
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


# What to render with

# Name of a variant: milliseconds, RMSE, share of pixels within CODES, FLIP.
FIGURES = {
    "standard": (6.0, 0.02, 0.7, 0.02),
    "samples-4": (9.0, 0.016, 0.75, 0.015),
    "shaded-4": (14.0, 0.01, 0.92, 0.008),
    "samples-64": (40.0, 0.015, 0.76, 0.014),
    "shaded-16": (50.0, 0.003, 0.995, 0.003),
    "shaded-64": (180.0, 0.001, 0.999, 0.001),
}
SLOW = {name: (20.0 * ms, error, 0.8 * close, flip) for name, (ms, error, close, flip) in FIGURES.items()}
FEW = {name: FIGURES[name] for name in ("standard", "samples-4", "samples-64")}
MODELS = {"standard": FIGURES["standard"], **dict.fromkeys(("gouraud-4", "trilinear-4"), FIGURES["shaded-64"])}


def planted(device, figures=FIGURES, usual: str = "shaded-4") -> study.Study:
    study = small_study(device)
    one, base = study.measured[0], base_settings(sphere())
    by_name = {variant.name: variant for variant in variants.VARIANTS}
    measured = []
    for name, (ms, error, close, flip) in figures.items():
        approximation = replace(one.approximation, rmse=error, flip=flip)
        fields = {"times": (0.97 * ms, ms, 1.03 * ms), "approximation": approximation, "close": close}
        measured.append(replace(one, variant=by_name[name], settings=by_name[name].settings(base), **fields))
    return replace(study, measured=tuple(measured), usual=usual, reference=replace(study.reference, error=1e-4))


def used(chosen: study.Study) -> dict[str, str]:
    return {advice.purpose: advice.used.variant.name for advice in answer(chosen)}


def test_five_lines(device):
    study = planted(device)
    purposes = ("no visible error", "within 16 ms", "within 100 ms", "the default", "more samples")
    names = ("shaded-16", "shaded-4", "shaded-16", "shaded-4", "shaded-16")
    assert tuple(used(study).items()) == tuple(zip(purposes, names, strict=True))
    lines = [advice.line(lambda settings: f"draw {settings.samples}") for advice in answer(study)]
    assert lines[0] == "no visible error: 50 ms, RMSE 0.003: draw 16"
    compared = "time x0.28, x1, x0.28, error x3.3, x1, x3.3"
    assert lines[3] == f"the default:      14 ms, RMSE 0.01; compared with the lines above: {compared}: draw 4"
    assert lines[4] == "more samples:     worth it, time x3.6, error x0.3, which is not visible: draw 16"
    limits = "at least 99% of pixels within 2 of 255 codes of the converged image, and FLIP at most 0.005"
    assert criterion(study) == f"no visible error: {limits}; the first line has 99.5% and 0.003"
    fastest = answer(planted(device, SLOW))[1]
    assert (fastest.used.variant.name, fastest.found) == ("standard", "none; the fastest takes 120 ms, RMSE 0.02")
    assert used(planted(device, SLOW))["closest"] == "shaded-64"
    assert len(answer(planted(device, FEW, usual="shaded-64"))) == 3  # the default was not measured


@pytest.mark.parametrize(("figures", "usual", "best", "expected"), [
    (FIGURES, "shaded-16", "shaded-16", "not worth it, the error is not visible"),
    (SLOW, "shaded-4", "shaded-64", "worth it, time x13, error x0.1, which is still visible"),
    (FEW, "samples-4", "samples-64", "not worth it, time x4.4, error x0.94"),
    (MODELS, "standard", "standard", "not measured"),  # but of other models
])  # fmt: skip
def test_more_samples(device, figures, usual, best, expected):
    more = answer(planted(device, figures, usual))[4]
    assert (more.used.variant.name, more.found) == (best, expected)


@pytest.mark.parametrize(("close", "flip", "unseen"), [
    (CLOSE, FLIP, True), (0.99 * CLOSE, FLIP, False), (CLOSE, 1.01 * FLIP, False), (CLOSE, None, True),
])  # fmt: skip
def test_an_error_is_not_visible_by_both_measures(device, close, flip, unseen):
    study = planted(device, {**FIGURES, "shaded-16": (50.0, 0.003, close, flip)})
    assert used(study)["no visible error"] == ("shaded-16" if unseen else "shaded-64")
    assert criterion(study).endswith("the first line has 99.0% (FLIP is not measured)") == (flip is None)


def test_the_share_of_pixels_that_are_close():
    codes = np.full((2, 2, 3), 100, np.uint8)
    changed = codes.copy()
    changed[0, 0], changed[0, 1, 2], changed[1, 1, 0] = 100 + CODES, 100 + CODES + 1, 0
    assert close_share(codes, changed) == close_share(changed, codes) == 0.5


@pytest.mark.parametrize(("name", "expected"), [
    ("teapot", "shaded-4"), ("course", "course"), ("icosphere", "samples-4"), ("box_room", "shaded-4"),
])  # fmt: skip
def test_the_default_is_what_render_draws(device, name, expected):
    scene = builtin(name, **({"soft": True} if name == "box_room" else {}))
    base = base_settings(scene)
    candidates = variants_for(scene, base, device)
    default = default_variant(scene, base, candidates)
    assert default.name == expected
    assert default.settings(base) == Settings.from_preset(scene.preset, **picture_fields(scene))
    new = default_variant(scene, base, [variant for variant in candidates if variant.name != expected])
    assert (new.name, new.settings(base)) == ("default", default.settings(base))


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n"
SCENES = [
    "'a mesh.obj' --look studio --shadows",
    "teapot",
    "course",
    "box_room --light-intensity 0.5",
    "'a mesh.obj' --flat --camera-azimuth-angle 20",
    "'a mesh.obj' --ambient-occlusion 4",
    "./-mesh.obj --look plain --no-weld --fit",
]


@pytest.mark.sampled
@pytest.mark.parametrize("given", SCENES)
def test_commands_draw_what_was_measured(device, capsys, folder, monkeypatch, given):
    """Also of scenes in the studio, of options that would take them out of it, and of names that need quotes."""
    for name in ("a mesh.obj", "-mesh.obj"):
        Path(name).write_text(OBJ)
    run_report = Mock(return_value=True)
    monkeypatch.setattr(report, "run", run_report)
    assert run(capsys, "report", *shlex.split(given), "--resolution", "48,36", "--device", device.index)[0] == 0
    (scene, *_), keywords = run_report.call_args
    base, expected = base_settings(scene, **keywords["settings"]), effective_settings(scene)[0]
    for variant in variants_for(scene, base, device):
        program, verb, *arguments = shlex.split(keywords["command"](variant.settings(base)))
        assert (program, verb) == ("clshade", "render")
        parsed = _parser(["render"]).parse_args(["render", *arguments])
        again = selected.load_scene(parsed, parsed.scenes[0])
        kept = render_command.render_options(parsed, again)
        kept.pop("device")
        drawn, settings = effective_settings(again, **kept)
        assert replace(settings, ao_distance=None) == variant.settings(base), variant.name  # the scene's, if not given
        assert part_digests(drawn) == part_digests(expected)
