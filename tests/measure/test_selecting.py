"""Limits of `render`: the choices, kept settings and refusals of `--budget` and `--tolerance`."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from command_line import assert_refused, run
from studies import small_study, sphere

from clshade.images import exr
from clshade.images.metrics import rmse
from clshade.measure.report import auto_settings, study
from clshade.measure.report import reference_image as reference_module
from clshade.measure.report.auto_settings import Candidate, select
from clshade.measure.report.variants import BASE
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
    monkeypatch.setattr(auto_settings, "FRAMES", 2)


@pytest.mark.usefixtures("quick")
def test_render_obeys(device, capsys, tmp_path):
    """The image is written with the settings chosen for the limit."""
    command = ("render", "icosphere", "--device", device.index, "--resolution", "48,36", "-o", tmp_path / "a")
    code, out, err = run(capsys, *command, "--tolerance", "1000", "--stats", "--deterministic")
    assert (code, err) == (0, [])
    chosen = json.loads(out)["chosen"]
    settings = exr.read(tmp_path / "a.exr")[1]["settings"]
    for name, value in chosen["settings"].items():
        assert f"{name}={value}" in settings
    code, out, err = run(capsys, *command, "--budget", "100s", "--near", "0.25")
    assert (code, err) == (0, [])
    assert "\nchosen  samples-4 (samples=4): " in out
    assert "kept as they are: near=0.25\n" in out
    assert "of 3 ways tried" in out
    assert "RMSE" in out


@pytest.mark.long
def test_a_real_study_chooses(device):
    """All of SHORT, with a reference of 256 samples; no budget is met reliably enough to be asserted."""
    scene = builtin("icosphere", level=2)
    best = select(scene, budget=1e6, device=device, resolution=(48, 36))
    assert set(best.tried) == {"unchanged", *auto_settings.SHORT} - {BASE, "vertex-texture", "trilinear", "trilinear-4"}
    assert best.used.name == "shaded-16"
    tolerance = 2.0 * best.used.error
    kept = select(scene, tolerance=tolerance, device=device, resolution=(48, 36))
    drawn = render(scene, settings=kept.settings, resolution=(48, 36), device=device)
    assert rmse(drawn.rgb, kept.reference.rgb) == kept.used.error <= tolerance


@pytest.fixture
def unmeasured(monkeypatch, found):
    """Give every variant the same cost and error; record the reference's settings."""
    monkeypatch.setattr(auto_settings, "_tried", lambda scene, each, *_: Candidate(each, 1.0, (1.0, 1.0), 0.5))
    monkeypatch.setattr(auto_settings, "_timed", lambda scene, tried, *_: tried)

    def reference_of(scene, base, device, fixed):
        return replace(found.reference, settings=reference_module.best_settings(base, device, fixed))

    monkeypatch.setattr(auto_settings, "reference", reference_of)


@pytest.mark.usefixtures("unmeasured")
def test_settings_that_are_given_stay(device):
    chosen = select(sphere(), budget=1e6, device=device, shader="gouraud", samples=2)
    assert (chosen.settings.shader, chosen.settings.samples) == ("gouraud", 2)
    assert (chosen.reference.settings.shader, chosen.reference.settings.samples) == ("gouraud", 1)
    assert chosen.kept == ("samples", "shader")
    assert not any(name.startswith(("gouraud", "samples")) for name in chosen.tried)


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("given", [{"scene": sphere(), "preset": "course"}, {"scene": builtin("course")}])
def test_a_preset_stays(device, given):
    """Whether it is given or the scene's own: the choice and the reference both follow the course."""
    chosen = select(**given, budget=1e6, device=device, near=0.25)
    course = Settings.from_preset("course", near=0.25)
    assert chosen.settings == chosen.used.variant.settings(course)
    for name in auto_settings.preset_fields():
        assert getattr(chosen.settings, name) == getattr(chosen.reference.settings, name) == getattr(course, name)
    assert auto_settings.preset_fields() == {"visibility", "lighting_at", "interpolation", "texture_at", "ambient"}
    assert set(chosen.kept) == {*auto_settings.preset_fields(), "near"}
    assert "unchanged" in chosen.tried
    assert "gouraud" in chosen.tried
    assert not {"course", "vertex-texture", BASE} & set(chosen.tried)


def test_only_what_may_be_chosen_is_timed(found):
    one = found.measured[0].variant
    tried = [Candidate(one, ms, (ms, ms), error) for ms, error in ((2.0, 0.5), (5.0, 0.1), (9.0, 0.02), (100.0, 0.01))]
    assert auto_settings.worth_timing(tried, 5.0, None) == tried[:3]
    assert auto_settings.worth_timing(tried, 0.1, None) == tried[:1]
    assert auto_settings.worth_timing(tried, None, 0.1) == tried[1:3]
    assert auto_settings.worth_timing(tried, None, 0.001) == tried[3:]


@pytest.mark.usefixtures("quick")
def test_render_refuses_what_nothing_keeps(device, capsys, tmp_path):
    command = ("render", "icosphere", "--device", device.index, "--resolution", "48,36", "-o", tmp_path / "a")
    assert_refused(run(capsys, *command, "--tolerance", "1e-30"), "--tolerance", "the best, ", "found 1e-30")
    assert_refused(run(capsys, *command, "--budget", "1us"), "--budget", "the fastest, ", "found 0.001 ms")
    assert not list(tmp_path.iterdir())
