"""Limits of `render`: the choices, kept settings and refusals of `--budget` and `--tolerance`."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from command_line import assert_refused, run
from studies import small_study, sphere

from clshade.errors import InputError
from clshade.images import exr
from clshade.images.metrics import rmse
from clshade.measure import timing
from clshade.measure.report import auto_settings, short_study, study, thinned_image
from clshade.measure.report import reference_image as reference_module
from clshade.measure.report.auto_settings import select
from clshade.measure.report.reference_image import averaged, best_settings, reference, reference_windows
from clshade.measure.report.short_study import Candidate, least_ms, likely_error
from clshade.measure.report.thinned_image import Estimate, Thinned, Window, thinned
from clshade.measure.report.variants import BASE, VARIANTS, Variant, base_settings
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Settings


@pytest.fixture
def found(device) -> study.Study:
    return small_study(device)


@pytest.fixture
def quick(monkeypatch):
    """Use three variants, and a reference of 16 samples."""
    monkeypatch.setattr(auto_settings, "SHORT", (BASE, "samples-4", "gouraud"))
    monkeypatch.setattr(reference_module, "STEPS", ((2, 4), (2, 1), (1, 1)))
    monkeypatch.setattr(short_study, "FRAMES", 2)


@pytest.mark.long
@pytest.mark.usefixtures("quick")
def test_render_obeys(device, capsys, tmp_path):
    """The image is written with the settings chosen for the limit."""
    command = ("render", "icosphere", "--device", device.index, "--resolution", "48,36", "-o", tmp_path / "a")
    code, out, err = run(capsys, *command, "--tolerance", "1000", "--stats", "--deterministic")
    assert code == 0
    err = [line for line in err if not line.startswith("clshade: warning: within noise: ")]
    assert err[0].split() == ["variant", "outcome", "ms", "a", "frame", "95", "%", "RMSE", "95", "%"]
    chosen = json.loads(out)["chosen"]
    for line, each in zip(err[1:], chosen["tried"], strict=True):
        assert line.startswith(f"{each['about']} ")
    assert chosen["tried"][1] == {
        "variant": "gouraud",
        "about": "Gouraud",
        "settings": {"shader": "gouraud"},
        **{name: chosen["tried"][1][name] for name in ("outcome", "frames", "frame_ms", "frame_ms_quartiles")},
        **{name: chosen["tried"][1][name] for name in ("frame_ms_95", "rmse", "rmse_95")},
    }
    assert chosen["tried"][2]["outcome"] == "no faster than unchanged"
    settings = exr.read(tmp_path / "a.exr")[1]["settings"]
    for name, value in chosen["settings"].items():
        assert f"{name}={value}" in settings
    code, out, err = run(capsys, *command, "--budget", "100s", "--near", "0.25")
    assert code == 0
    assert "\nchosen  4 samples (samples=4): " in out
    assert "kept as they are: near=0.25\n" in out
    assert "3 of 3 variants drawn, in " in out
    assert "RMSE" in out
    assert run(capsys, "--quiet", *command, "--budget", "100s")[2] == []


@pytest.mark.long
def test_a_real_study_chooses(device):
    """All of SHORT, with a reference of 256 samples; no budget is met reliably enough to be asserted."""
    scene = builtin("icosphere", level=2)
    best = select(scene, budget=1e6, device=device, resolution=(48, 36))
    assert {each["variant"] for each in best.tried} == NAMES
    assert best.used.variant.name == "shaded-16"
    tolerance = 2.0 * best.used.error
    kept = select(scene, tolerance=tolerance, device=device, resolution=(48, 36))
    drawn = render(scene, settings=kept.settings, resolution=(48, 36), device=device)
    assert kept.thinned.whole
    assert rmse(drawn.rgb.reshape(-1, 3), kept.reference.rgb) == pytest.approx(kept.used.error, rel=1e-12)
    assert kept.used.error <= tolerance


NAMES = {"unchanged", *auto_settings.SHORT} - {BASE, "vertex-texture", "trilinear", "trilinear-4"}


class Planted(short_study.ShortStudy):
    """A study in which every variant has the time and the error that `figures` give by name, or a usual one."""

    figures: dict[str, tuple[float, float]]

    def _drawn(self, variant: Variant) -> Candidate:
        ms, error = self.figures.get(variant.shown_name, (1.0, 0.5))
        self._thinned = Thinned(1, (Window(0, 0, 1, 1),), np.ones(1, np.int64), np.ones(1))
        return Candidate(
            variant, [ms, 1.01 * ms, 1.02 * ms], np.zeros((1, 3)), Estimate(error, 0.9 * error, 1.1 * error)
        )

    def _time(self, candidates) -> None:
        pass


@pytest.fixture
def unmeasured(monkeypatch, found):
    """Plant times and errors; the reference is not drawn."""
    monkeypatch.setattr(auto_settings, "ShortStudy", Planted)
    monkeypatch.setattr(Planted, "figures", {}, raising=False)

    def reference_of(scene, base, device, thinned, fixed):
        return replace(found.reference, settings=best_settings(base, device, fixed), error=1e-4)

    monkeypatch.setattr(short_study, "reference_windows", reference_of)


# Milliseconds and RMSE, as on a textured scene; what is not here must not be drawn.
FIGURES = {
    "unchanged": (6.0, 0.0104),
    "fast": (5.8, 0.0104),
    "samples-4": (18.0, 0.0074),
    "samples-16": (60.0, 0.0068),
    "samples-64": (200.0, 0.0066),
    "shaded-4": (26.0, 0.0033),
    "shaded-16": (100.0, 0.0012),
    "gouraud": (6.0, 0.0232),
    "course": (4.0, 0.08),
}


def outcomes(selection) -> dict[str, str]:
    return {each["variant"]: each["outcome"] for each in selection.tried}


@pytest.mark.usefixtures("unmeasured")
def test_what_cannot_fit_a_budget_is_not_drawn(device, monkeypatch):
    monkeypatch.setattr(Planted, "figures", FIGURES)
    chosen = select(sphere(), budget=20.0, device=device)
    assert outcomes(chosen) == {
        "unchanged": "less accurate",
        "gouraud": "less accurate",
        "samples-4": "used",
        "shaded-4": "too slow",
        "samples-16": "too slow",
        "fast": "RMSE likely above 0.01",
        "course": "RMSE likely above 0.01",
        "gouraud-4": "RMSE likely above 0.016",
        "gouraud-16": "RMSE likely above 0.016",
        "shaded-16": "cannot fit: at least 60 ms",
        "samples-64": "cannot fit: at least 110 ms",
    }
    assert chosen.settings.samples == 4
    assert chosen.doubt == ""
    assert outcomes(select(sphere(), budget=20.0, device=device)) == outcomes(chosen)
    lines = chosen.table()
    for line, each in zip(lines[1:], chosen.tried, strict=True):
        assert line.startswith(each["about"])
    used = next(line for line in lines if line.startswith("4 samples "))
    assert " ".join(used.split()) == "4 samples used 18.2 18 to 18.4 0.0074 0.00666 to 0.00814"


@pytest.mark.usefixtures("unmeasured")
def test_what_cannot_be_faster_within_a_tolerance_is_not_drawn(device, monkeypatch):
    monkeypatch.setattr(Planted, "figures", FIGURES)
    chosen = select(sphere(), tolerance=0.0095, device=device)
    assert chosen.used.variant.name == "samples-4"
    assert outcomes(chosen) == {
        "unchanged": "not accurate enough",
        "gouraud": "not accurate enough",
        "samples-4": "used",
        "fast": "RMSE likely above 0.01",
        "course": "RMSE likely above 0.01",
        "gouraud-4": "RMSE likely above 0.016",
        "gouraud-16": "RMSE likely above 0.016",
        **dict.fromkeys(("shaded-4", "samples-16", "shaded-16", "samples-64"), "no faster than 4 samples"),
    }
    near = select(sphere(), tolerance=0.0075, device=device)
    assert near.used.variant.name == "samples-4"
    assert near.doubt == "the error of 4 samples is known to 0.0001, and is that near the tolerance"
    near = select(sphere(), tolerance=0.0078, device=device)
    assert near.doubt == "the error of 4 samples is 0.00666 to 0.00814, about the tolerance"


@pytest.mark.usefixtures("unmeasured")
def test_what_is_only_likely_is_drawn_before_a_refusal(device, monkeypatch):
    """Here an approximation is more accurate than what it approximates."""
    odd = {"unchanged": (6.0, 0.02), "course": (4.0, 0.01), "gouraud": (6.0, 0.05)}
    monkeypatch.setattr(Planted, "figures", {**dict.fromkeys(NAMES, (30.0, 0.02)), **odd})
    chosen = select(sphere(), tolerance=0.015, device=device)
    assert chosen.used.variant.name == "course"
    with pytest.raises(InputError, match=r"no variant has 0\.005 or less: the best, preset course, has 0\.01"):
        select(sphere(), tolerance=0.005, device=device)
    with pytest.raises(InputError, match=r"1 ms is too short: the fastest variant, preset course, takes 4\.04 ms"):
        select(sphere(), budget=1.0, device=device)
    with pytest.raises(InputError, match=r"is below what errors are known to, 0\.0001 "):
        select(sphere(), tolerance=0.00005, device=device)


def candidate(name: str, ms: float, error: float = 0.1) -> Candidate:
    variant = next(each for each in VARIANTS if each.name == name)
    return Candidate(variant, [ms], np.zeros((1, 3)), Estimate(error, error, error))


def named(name: str) -> Variant:
    return candidate(name, 1.0).variant


def test_bounds_of_times():
    """Of what does no more work, and the power of the number of samples, halved."""
    drawn = [candidate(BASE, 6.0), candidate("samples-4", 10.0)]
    assert least_ms(named("samples-16"), drawn) == least_ms(named("shaded-4"), drawn) == 10.0
    assert least_ms(named("gouraud-4"), drawn) == least_ms(named("fast"), drawn) == 0.0
    drawn.append(candidate("samples-16", 40.0))
    assert least_ms(named("samples-64"), drawn) == pytest.approx(80.0)
    assert least_ms(named("shaded-16"), drawn) == 40.0
    drawn[-1] = candidate("samples-16", 9.0)  # measured in a quieter moment
    assert least_ms(named("samples-64"), drawn) == 10.0


def test_likely_errors():
    drawn = [candidate(BASE, 6.0, 0.3), candidate("gouraud", 6.0, 0.5)]
    assert likely_error(named("fast"), drawn) == 0.3
    assert likely_error(named("gouraud-4"), drawn) == pytest.approx(0.75 * 0.4)
    assert likely_error(named("samples-4"), drawn) == likely_error(named("trilinear-4"), drawn) == 0.0
    assert likely_error(named("gouraud-4"), drawn[1:]) == pytest.approx(0.75 * 0.5)


def test_a_busy_machine_is_told(monkeypatch):
    """By the longest wait of a thread, if the system tells."""
    waits = iter([{"1": 2.0, "2": 0.5}, {"1": 2.2, "2": 1.5, "3": 0.1}, {}, {}])
    clock = iter([10.0, 12.0, 20.0, 21.0])
    monkeypatch.setattr(timing, "_waits", lambda: next(waits))
    monkeypatch.setattr(timing.time, "perf_counter", lambda: next(clock))
    with timing.Waiting() as busy:
        pass
    with timing.Waiting() as unknown:
        pass
    monkeypatch.undo()
    assert (busy.share, unknown.share) == (0.5, 0.0)
    assert auto_settings.busy_doubt(0.5) == "other programs kept this one waiting for 50% of the time"
    assert auto_settings.busy_doubt(0.05) == ""
    assert all(wait >= 0.0 for wait in timing._waits().values())


@pytest.fixture
def thin(monkeypatch):
    """Thin images of this test's size, to about a third."""
    monkeypatch.setattr(thinned_image, "WHOLE", 1 << 12)
    monkeypatch.setattr(thinned_image, "PIXELS", 1 << 13)
    monkeypatch.setattr(thinned_image, "WINDOWS", (12, 48))


SHAPE = (200, 136)  # not multiples of a tile's side


@pytest.mark.usefixtures("thin")
@pytest.mark.parametrize("name", [pytest.param("teapot", marks=pytest.mark.long), "icosphere"])
def test_the_windows_are_the_image(device, name):
    """Bit by bit, also of the reference; the estimates hold the errors of the whole image."""
    scene = builtin(name, resolution=SHAPE)
    base = base_settings(scene)
    image = render(scene, settings=base, device=device).rgb
    windows = thinned(image, scene.face_count)
    assert not windows.whole
    assert 0.05 < windows.count / windows.pixels < 0.6
    assert {(each.width, each.height) for each in windows.windows} > {(16, 16)}
    parts = [
        render(replace(scene, camera=each.camera(scene.camera)), settings=base, device=device).rgb
        for each in windows.windows
    ]
    assert np.array_equal(np.concatenate([part.reshape(-1, 3) for part in parts]), windows.of(image))
    best = best_settings(base, device)
    exact = averaged(scene, device, best, 2, 4)
    found = [means for _, means in reference_module.window_means(scene, device, best, 2, 4, windows.windows)]
    assert np.array_equal(np.concatenate([each.reshape(-1, 3) for each in found]), windows.of(exact))
    for changes in ({}, {"samples": 4}, {"shader": "gouraud"}):
        drawn = render(scene, settings=replace(base, **changes), device=device).rgb
        rms, low, high = windows.estimate(windows.of(drawn), windows.of(exact))
        assert low <= rms <= high < 4.0 * low
        assert low <= rmse(drawn, exact) <= high
    same = thinned(image, scene.face_count)
    assert same.windows == windows.windows
    assert np.array_equal(same.chances, windows.chances)


@pytest.mark.long
@pytest.mark.usefixtures("thin")
def test_the_estimate_is_unbiased(monkeypatch):
    """Over many seeds the mean squared error is that of the image; a large mesh has few windows."""
    rng = np.random.default_rng(5)
    image, expected = rng.random((2, SHAPE[1], SHAPE[0], 3))
    image[:40, :50] += 3.0
    seeds = iter(range(400))
    default = np.random.default_rng
    monkeypatch.setattr(thinned_image.np.random, "default_rng", lambda _: default(next(seeds)))
    monkeypatch.setattr(thinned_image, "mean_interval", lambda values: (0.0, 0.0))
    found = []
    for _ in range(400):
        windows = thinned(image, 10**9)
        assert sum(windows.times) == 12
        found.append(windows.estimate(windows.of(image), windows.of(expected)).rmse ** 2)
    assert np.mean(found) == pytest.approx(rmse(image, expected) ** 2, abs=4.0 * np.std(found) / math.sqrt(400))


def test_small_images_are_whole(device):
    """Also one of a single pixel, and one of a single color; nothing is thinned but large images."""
    scene = sphere()
    base = base_settings(scene)
    image = render(scene, settings=base, device=device).rgb
    windows = thinned(image, scene.face_count)
    assert windows.whole
    assert windows.about() == "the whole image"
    whole, part = reference(scene, base, device), reference_windows(scene, base, device, windows)
    assert np.array_equal(whole.rgb.reshape(-1, 3), part.rgb)
    assert whole.error == pytest.approx(part.error, rel=1e-12)
    found = windows.estimate(windows.of(image), part.rgb)
    assert found.rmse == pytest.approx(rmse(image, whole.rgb), rel=1e-12)
    assert found.low == found.high == found.rmse
    assert found.widened(0.01) == (found.rmse, max(found.rmse - 0.01, 0.0), found.rmse + 0.01)
    assert thinned(np.zeros((1, 1, 3)), 0).whole
    flat = thinned(np.zeros((400, 400, 3)), 0)
    assert flat.estimate(flat.of(np.ones((400, 400, 3))), flat.of(np.zeros((400, 400, 3)))).rmse == pytest.approx(1.0)
    with pytest.raises(InputError, match="either a budget or a tolerance"):
        select(scene, device=device)


@pytest.mark.usefixtures("unmeasured")
def test_settings_that_are_given_stay(device):
    chosen = select(sphere(), budget=1e6, device=device, shader="gouraud", samples=2)
    assert (chosen.settings.shader, chosen.settings.samples) == ("gouraud", 2)
    assert (chosen.reference.settings.shader, chosen.reference.settings.samples) == ("gouraud", 1)
    assert chosen.kept == ("samples", "shader")
    assert not any(name.startswith(("gouraud", "samples")) for name in outcomes(chosen))


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("given", [{"scene": sphere(), "preset": "course"}, {"scene": builtin("course")}])
def test_a_preset_stays(device, given):
    """Whether it is given or the scene's own: the choice and the reference both follow the course."""
    chosen = select(**given, budget=1e6, device=device, near=0.25)
    course = Settings.from_preset("course", near=0.25)
    assert chosen.settings == chosen.used.variant.settings(course)
    fields = auto_settings.preset_fields("course")
    for name in fields:
        assert getattr(chosen.settings, name) == getattr(chosen.reference.settings, name) == getattr(course, name)
    assert fields == {"visibility", "lighting_at", "interpolation", "texture_at", "ambient"}
    assert set(chosen.kept) == {*fields, "near"}
    assert auto_settings.preset_fields("pbr") == {"shader", "shadows"}
    assert "unchanged" in outcomes(chosen)
    assert "gouraud" in outcomes(chosen)
    assert not {"course", "vertex-texture", BASE} & set(outcomes(chosen))


@pytest.mark.usefixtures("quick")
def test_render_refuses_what_nothing_keeps(device, capsys, tmp_path):
    command = ("render", "icosphere", "--device", device.index, "--resolution", "48,36", "-o", tmp_path / "a")
    assert_refused(run(capsys, *command, "--tolerance", "1e-30"), "--tolerance: ", "1e-30", "the best")
    assert_refused(run(capsys, *command, "--budget", "1us"), "--budget: 0.001 ms is too short: the fastest variant, ")
    assert not list(tmp_path.iterdir())
