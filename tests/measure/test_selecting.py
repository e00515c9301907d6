"""Limits of `render`: the choices, kept settings and refusals of `--budget` and `--tolerance`."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from command_line import run
from studies import sphere

from clshade.errors import InputError
from clshade.images import exr
from clshade.images.metrics import rmse
from clshade.measure.report import auto_settings, thinned_image
from clshade.measure.report import reference_image as reference_module
from clshade.measure.report.auto_settings import LADDER, Tried, select
from clshade.measure.report.reference_image import Reference, averaged, best_settings, reference
from clshade.measure.report.thinned_image import Estimate, thinned
from clshade.measure.report.variants import BASE, VARIANTS, Variant, base_settings
from clshade.pipeline.effective_settings import effective_settings
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Settings


@pytest.fixture
def quick(monkeypatch):
    """Use three variants, and a reference of 16 samples."""
    monkeypatch.setattr(auto_settings, "LADDER", ((BASE, "samples-4"), ("gouraud",)))
    monkeypatch.setattr(reference_module, "STEPS", ((2, 4), (2, 1), (1, 1)))
    monkeypatch.setattr(auto_settings, "FRAMES", 2)


@pytest.mark.usefixtures("quick")
def test_render_obeys(device, capsys, tmp_path):
    """The image is written with the settings chosen for the limit."""
    command = ("render", "icosphere", "--device", device.index, "--resolution", "48,36", "-o", tmp_path / "a")
    code, out, err = run(capsys, *command, "--tolerance", "1000", "--stats", "--deterministic")
    assert code == 0
    chosen = json.loads(out)["chosen"]
    assert err[0] == "Variants tried"
    assert " ".join(err[4:]).endswith("accurate enough: 4 samples")
    assert [trial["variant"] for trial in chosen["tried"]] == ["unchanged", "gouraud"]
    assert chosen["variant"] in ("unchanged", "gouraud")
    settings = exr.read(tmp_path / "a.exr")[1]["settings"]
    assert all(f"{name}={value}" in settings for name, value in chosen["settings"].items())
    code, out, err = run(capsys, *command, "--budget", "100s", "--near", "0.25")
    assert code == 0
    for words in (
        "\nchosen  4 samples (samples=4): ",
        "kept as they are: near=0.25\n",
        "3 of 3 variants drawn, in ",
        "RMSE",
    ):
        assert words in out
    assert run(capsys, "--quiet", *command, "--budget", "100s")[2] == []


@pytest.mark.long
def test_nine_of_ten_tolerances_are_kept_to_a_tenth(device):
    """Those of `select`, measured anew on all of more than 65,536 pixels: it estimates errors from windows."""
    ratios = []
    for name in ("teapot", "icosphere", "quads"):
        scene = effective_settings(builtin(name), resolution=(400, 300))[0]
        converged = reference(scene, effective_settings(scene)[1], device).rgb
        for tolerance in (0.03, 0.02, 0.01, 0.005):
            try:
                settings = select(scene, device=device, tolerance=tolerance).settings
            except InputError:
                continue
            ratios.append(rmse(np.asarray(render(scene, settings=settings, device=device).rgb), converged) / tolerance)
    assert len(ratios) >= 9
    assert np.mean(np.array(ratios) <= 1.1) >= 0.9, ratios


def test_a_family_is_of_rising_work():
    """What is not drawn is no faster: it differs from what was drawn before only in more samples, or more work for each."""
    changes = {variant.name: variant.changes for variant in VARIANTS}
    for family in LADDER:
        for less, more in pairwise(changes[name] for name in family):
            fields = {"samples", "sample_shading"} & {*less, *more}
            assert {**less, **{name: more[name] for name in fields}} == more
            assert auto_settings._work(Variant("", "", less)) < auto_settings._work(Variant("", "", more))
            assert less.get("sample_shading", False) <= more.get("sample_shading", False)


class Planted(auto_settings._Trials):
    """A study in which every variant has the time and the error that `figures` give by name."""

    figures: dict[str, tuple[float, float]]

    def _draw(self, variant: Variant) -> Tried:
        ms, error = self.figures[variant.name]
        return Tried(variant, [ms, 1.01 * ms], Estimate(error, 0.9 * error, 1.1 * error))

    def _time(self, chosen) -> None:
        for tried in chosen:
            tried.ms = [tried.ms[0], 1.01 * tried.ms[0], 1.02 * tried.ms[0]]


# Milliseconds and RMSE, as on a textured scene.
FIGURES = {
    "unchanged": (6.0, 0.0104),
    "samples-4": (18.0, 0.0074),
    "samples-16": (60.0, 0.0068),
    "samples-64": (200.0, 0.0066),
    "shaded-4": (26.0, 0.0033),
    "shaded-16": (100.0, 0.0012),
    "shaded-64": (400.0, 0.0009),
    "gouraud": (6.0, 0.0232),
    "gouraud-4": (7.0, 0.02),
    "gouraud-16": (9.0, 0.019),
    "course": (4.0, 0.08),
}


@pytest.fixture
def unmeasured(monkeypatch):
    """Plant times and errors; the reference is not drawn."""
    monkeypatch.setattr(auto_settings, "_Trials", Planted)
    monkeypatch.setattr(Planted, "figures", FIGURES, raising=False)

    def reference_of(scene, base, device, fixed, thinned):
        return Reference(np.zeros((1, 3)), 256, best_settings(base, device, fixed), error=1e-4)

    monkeypatch.setattr(auto_settings, "reference", reference_of)


def drawn(selection) -> list[str]:
    return [tried.variant.name for tried in selection.tried]


@pytest.mark.usefixtures("unmeasured")
def test_the_most_accurate_within_a_budget(device):
    chosen = select(sphere(), budget=20.0, device=device)
    assert set(drawn(chosen)) == FIGURES.keys() - {"samples-64", "shaded-64"}
    assert sorted(chosen.not_drawn) == ["64 samples", "64 shaded samples"]
    assert chosen.settings.samples == 4
    lines = chosen.table.lines()
    used = next(line for line in lines if line.startswith("4 samples "))
    assert " ".join(used.split()) == "4 samples 18.2 18.1 to 18.3 0.0074 0.00666 to 0.00814"
    assert select(sphere(), budget=16.5, device=device).used.variant.name == "samples-4"  # nearly 18
    assert select(sphere(), budget=16.0, device=device).used.variant.name == "unchanged"


@pytest.mark.usefixtures("unmeasured")
def test_the_fastest_within_a_tolerance(device):
    chosen = select(sphere(), tolerance=0.0095, device=device)
    assert chosen.used.variant.name == "samples-4"
    assert set(drawn(chosen)) == FIGURES.keys() - {"samples-64", "shaded-4", "shaded-16", "shaded-64"}
    assert select(sphere(), tolerance=0.00735, device=device).used.variant.name == "samples-4"  # as errors are known
    assert select(sphere(), tolerance=0.0072, device=device).used.variant.name == "shaded-4"
    # Of equally fast ones the best:
    assert select(sphere(), tolerance=0.05, device=device).used.variant.name == "unchanged"


@pytest.mark.usefixtures("unmeasured")
def test_a_limit_that_nothing_keeps_names_the_best(device):
    with pytest.raises(InputError, match=r"no variant has 0\.0005 or less: the best, 64 shaded samples, has 0\.0009"):
        select(sphere(), tolerance=0.0005, device=device)
    with pytest.raises(InputError, match=r"1 ms is too short: the fastest variant, preset course, takes 4\.02 ms"):
        select(sphere(), budget=1.0, device=device)
    with pytest.raises(InputError, match=r"is below what errors are known to, 0\.0001 "):
        select(sphere(), tolerance=0.00005, device=device)


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
    assert len(windows.windows) > 1
    assert 0.05 < windows.count / windows.pixels < 0.6
    assert {(window.width, window.height) for window in windows.windows} > {(16, 16)}
    parts = [
        render(replace(scene, camera=window.camera(scene.camera)), settings=base, device=device).rgb
        for window in windows.windows
    ]
    assert np.array_equal(np.concatenate([part.reshape(-1, 3) for part in parts]), windows.of(image))
    best = best_settings(base, device)
    exact = averaged(scene, device, best, 2, 4)
    assert np.array_equal(averaged(scene, device, best, 2, 4, windows), windows.of(exact))
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
    squares = []
    for _ in range(400):
        windows = thinned(image, 10**9)
        assert sum(windows.times) == 12
        squares.append(windows.estimate(windows.of(image), windows.of(expected)).rmse ** 2)
    assert np.mean(squares) == pytest.approx(rmse(image, expected) ** 2, abs=4.0 * np.std(squares) / math.sqrt(400))


def test_small_images_are_whole(device):
    """Also one of a single pixel, and one of a single color; nothing is thinned but large images."""
    scene = sphere()
    base = base_settings(scene)
    image = render(scene, settings=base, device=device).rgb
    windows = thinned(image, scene.face_count)
    assert windows.about() == "the whole image"
    full, part = reference(scene, base, device), reference(scene, base, device, thinned=windows)
    assert np.array_equal(full.rgb.reshape(-1, 3), part.rgb)
    assert full.error == pytest.approx(part.error, rel=1e-12)
    estimate = windows.estimate(windows.of(image), part.rgb)
    assert estimate.rmse == pytest.approx(rmse(image, full.rgb), rel=1e-12)
    assert estimate.low == estimate.high == estimate.rmse
    assert len(thinned(np.zeros((1, 1, 3)), 0).windows) == 1
    flat = thinned(np.zeros((400, 400, 3)), 0)
    assert flat.estimate(flat.of(np.ones((400, 400, 3))), flat.of(np.zeros((400, 400, 3)))).rmse == pytest.approx(1.0)
    with pytest.raises(InputError, match="either a budget or a tolerance"):
        select(scene, device=device)


@pytest.mark.usefixtures("unmeasured")
def test_settings_that_are_given_stay(device):
    chosen = select(sphere(), budget=1e6, device=device, shader="gouraud", samples=2)
    assert (chosen.settings.shader, chosen.settings.samples) == ("gouraud", 2)
    assert (chosen.reference.settings.shader, chosen.reference.settings.samples) == ("gouraud", 1)
    assert chosen.kept == {"samples": 2, "shader": "gouraud"}
    assert not any(name.startswith(("gouraud", "samples")) for name in drawn(chosen))


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("arguments", [{"scene": sphere(), "preset": "course"}, {"scene": builtin("course")}])
def test_a_preset_stays(device, arguments):
    """Whether it is given or the scene's own: the choice and the reference both follow the course."""
    chosen = select(**arguments, budget=1e6, device=device, near=0.25)
    course = Settings.from_preset("course", near=0.25)
    assert chosen.settings == chosen.used.variant.settings(course)
    fields = {"visibility", "lighting_at", "interpolation", "texture_at", "ambient"}
    for name in fields:
        assert getattr(chosen.settings, name) == getattr(chosen.reference.settings, name) == getattr(course, name)
    assert set(chosen.kept) == {*fields, "near"}
    assert {"unchanged", "gouraud"} <= set(drawn(chosen))
    assert not {"course", "vertex-texture", BASE} & set(drawn(chosen))
