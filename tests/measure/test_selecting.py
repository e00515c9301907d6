"""Limits of `render`: the Pareto front, choices, kept settings and refusals of `--budget` and `--tolerance`."""

import argparse
import json
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from command_line import run
from hypothesis import given
from hypothesis import strategies as st
from studies import sphere

from clshade.cli.options import max_error, milliseconds
from clshade.errors import InputError
from clshade.images import exr
from clshade.images.metrics import rmse
from clshade.measure.report import auto_settings, thinned_image
from clshade.measure.report import reference_image as reference_module
from clshade.measure.report.auto_settings import Tried, select
from clshade.measure.report.pareto import front, within_budget, within_tolerance
from clshade.measure.report.reference_image import Reference, averaged, best_settings, reference
from clshade.measure.report.thinned_image import Estimate, thinned
from clshade.measure.report.variants import BASE, Variant, base_settings
from clshade.measure.timing import Spread
from clshade.pipeline.effective_settings import effective_settings
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Settings


@dataclass(frozen=True)
class Alternative:
    """spread: how far the quartiles lie from the median."""

    name: str
    cost: float
    error: float
    spread: float = 0.0

    @property
    def frame_ms(self) -> Spread:
        return Spread(self.cost - self.spread, self.cost, self.cost + self.spread)


VALUES = st.sampled_from([0.5, 1.0, 2.0, 3.0, 7.0])  # few, so that many are equal


@given(st.lists(st.tuples(VALUES, VALUES), min_size=1, max_size=12), VALUES)
def test_nothing_beats_the_front_and_what_is_chosen(pairs, limit):
    some = [Alternative(str(k), *pair) for k, pair in enumerate(pairs)]
    frontier = front(some)
    costs, errors = ([getattr(option, name) for option in frontier] for name in ("cost", "error"))
    assert (costs, errors) == (sorted(costs), sorted(errors, reverse=True))
    assert set(frontier) <= set(some)
    for option in some:
        assert any(better.cost <= option.cost and better.error <= option.error for better in frontier)
        for better in frontier:
            pair, other = (better.cost, better.error), (option.cost, option.error)
            assert pair == other or option.cost > better.cost or option.error > better.error
    affordable, exact = [p for p in some if p.cost <= limit], [p for p in some if p.error <= limit]
    if affordable:
        used = within_budget(some, limit)
        assert (used in affordable, used.error) == (True, min(option.error for option in affordable))
    if exact:
        used = within_tolerance(some, limit)
        assert (used in exact, used.cost) == (True, min(option.cost for option in exact))


def test_choices_within_noise():
    """A budget prefers the more accurate, a tolerance the faster; errors are told apart as far as they are known."""
    some = [Alternative(str(k), 1.0 + k, error) for k, error in enumerate((0.5, 0.49, 0.47, 0.46, 0.1))]
    assert [option.error for option in front(some, 0.02)] == [0.5, 0.47, 0.1]
    quick, exact = Alternative("quick", 1.0, 0.5, 0.1), Alternative("exact", 5.2, 0.1, 0.4)
    assert within_budget([quick, exact], 4.4) == exact  # 4.8 is nearly 4.4
    assert within_budget([quick, exact], 4.3) == quick
    assert within_tolerance([quick, exact], 0.49, 0.02) == quick
    assert within_tolerance([quick, exact], 0.47, 0.02) == exact
    # Of two nearly as fast, the more accurate.
    closer, slower = Alternative("closer", 1.05, 0.3, 0.1), Alternative("slower", 1.2, 0.3, 0.1)
    assert within_tolerance([quick, closer], 0.6) == closer
    assert within_tolerance([quick, slower], 0.6) == quick
    # Of equally accurate ones the first, however long each takes: the same when times are measured again.
    first, second = Alternative("first", 1.0, 0.1001), Alternative("second", 0.97, 0.1)
    assert within_budget([first, second], 5.0, 0.01) == first
    assert within_budget([second, first], 5.0, 0.01) == second
    assert within_tolerance([first, second], 0.2, 0.01) == first
    assert within_budget([first, second], 5.0) == second


TIMES = {"5ms": 5.0, "0.005s": 5.0, "5": 5.0, " 2.5 MS ": 2.5, "200us": 0.2, "1e-2s": 10.0, ".5": 0.5}
NO_TIMES = ("0", "0ms", "-5ms", "5m", "ms", "", "1.2.3s", "nan", "inf", "1e400s", "5 ms 3", "1e-400s")


def test_times_and_tolerances():
    assert {text: milliseconds(text) for text in TIMES} == pytest.approx(TIMES)
    assert max_error("1e-3") == 1e-3
    for texts, read, message in (
        (NO_TIMES, milliseconds, "expected a time above 0"),
        (("0", "-1", "nan", "inf", "small", ""), max_error, "expected an error above 0"),
    ):
        for text in texts:
            with pytest.raises(argparse.ArgumentTypeError, match=message):
                read(text)


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(auto_settings, "LADDER", ((BASE, "samples-4"), ("gouraud",)))
    monkeypatch.setattr(reference_module, "STEPS", ((2, 4), (2, 1), (1, 1)))
    monkeypatch.setattr(auto_settings, "FRAMES", 2)


@pytest.mark.long
@pytest.mark.usefixtures("quick")
def test_render_obeys(device, capsys, tmp_path):
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
    chosen = "\nchosen  4 samples (samples=4): "
    for words in (chosen, "kept as they are: near=0.25\n", "3 of 3 variants drawn, in ", "RMSE"):
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


class Planted(auto_settings._Trials):
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
def test_limits_choose(device):
    chosen = select(sphere(), budget=20.0, device=device)
    assert set(drawn(chosen)) == FIGURES.keys() - {"samples-64", "shaded-64"}
    assert sorted(chosen.not_drawn) == ["64 samples", "64 shaded samples"]
    assert chosen.settings.samples == 4
    used = next(line for line in chosen.table.lines() if line.startswith("4 samples "))
    assert " ".join(used.split()) == "4 samples 18.2 18.1 to 18.3 0.0074 0.00666 to 0.00814"
    chosen = select(sphere(), tolerance=0.0095, device=device)
    assert set(drawn(chosen)) == FIGURES.keys() - {"samples-64", "shaded-4", "shaded-16", "shaded-64"}
    for limit, name in (
        ({"budget": 16.5}, "samples-4"),  # 18 is nearly that
        ({"budget": 16.0}, "unchanged"),
        ({"tolerance": 0.0095}, "samples-4"),
        ({"tolerance": 0.00735}, "samples-4"),  # as errors are known
        ({"tolerance": 0.0072}, "shaded-4"),
        ({"tolerance": 0.05}, "unchanged"),  # of equally fast ones the best
    ):
        assert select(sphere(), **limit, device=device).used.variant.name == name, limit
    for limit, message in (
        ({"tolerance": 0.0005}, r"no variant has 0\.0005 or less: the best, 64 shaded samples, has 0\.0009"),
        ({"budget": 1.0}, r"1 ms is too short: the fastest variant, preset course, takes 4\.02 ms"),
        ({"tolerance": 0.00005}, r"is below what errors are known to, 0\.0001 "),
        ({}, "either a budget or a tolerance"),
    ):
        with pytest.raises(InputError, match=message):
            select(sphere(), **limit, device=device)


@pytest.mark.usefixtures("unmeasured")
def test_settings_that_are_given_stay(device):
    """As does a preset, whether it is given or the scene's own: the choice and the reference both follow it."""
    chosen = select(sphere(), budget=1e6, device=device, shader="gouraud", samples=2)
    assert (chosen.settings.shader, chosen.settings.samples) == ("gouraud", 2)
    assert (chosen.reference.settings.shader, chosen.reference.settings.samples) == ("gouraud", 1)
    assert chosen.kept == {"samples": 2, "shader": "gouraud"}
    assert not any(name.startswith(("gouraud", "samples")) for name in drawn(chosen))
    course = Settings.from_preset("course", near=0.25)
    fields = {"visibility", "lighting_at", "interpolation", "texture_at", "ambient"}
    for arguments in ({"scene": sphere(), "preset": "course"}, {"scene": builtin("course")}):
        chosen = select(**arguments, budget=1e6, device=device, near=0.25)
        assert chosen.settings == chosen.used.variant.settings(course)
        for name in fields:
            assert getattr(chosen.settings, name) == getattr(chosen.reference.settings, name) == getattr(course, name)
        assert set(chosen.kept) == {*fields, "near"}
        assert {"unchanged", "gouraud"} <= set(drawn(chosen))
        assert not {"course", "vertex-texture", BASE} & set(drawn(chosen))


@pytest.fixture
def thin(monkeypatch):
    monkeypatch.setattr(thinned_image, "WHOLE", 1 << 12)
    monkeypatch.setattr(thinned_image, "PIXELS", 1 << 13)
    monkeypatch.setattr(thinned_image, "WINDOWS", (12, 48))


SHAPE = (200, 136)  # not multiples of a tile's side


@pytest.mark.long
@pytest.mark.usefixtures("thin")
def test_the_windows_are_the_image(device):
    """Bit by bit, also of the reference; the estimates hold the errors of the whole image."""
    scene = builtin("icosphere", resolution=SHAPE)
    base = base_settings(scene)
    image = render(scene, settings=base, device=device).rgb
    windows = thinned(image, scene.face_count)
    assert len(windows.windows) > 1
    assert 0.05 < windows.count / windows.pixels < 0.6
    assert {(window.width, window.height) for window in windows.windows} > {(16, 16)}
    cameras = [window.camera(scene.camera) for window in windows.windows]
    parts = [render(replace(scene, camera=camera), settings=base, device=device).rgb for camera in cameras]
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
