"""The first lines of `report`: what to render with."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from command_line import run
from studies import small_study, sphere

from clshade.cli import render as render_command
from clshade.cli import scene as selected
from clshade.cli.main import _parser
from clshade.measure.report import report, variants
from clshade.measure.report.answer import CLOSE, FLIP, answer, criterion
from clshade.measure.report.measure import CODES, close_share
from clshade.measure.report.study import Study
from clshade.measure.report.variants import base_settings, default_variant, variants_for
from clshade.pipeline.effective_settings import effective_settings, picture_fields
from clshade.scene.builtin.scenes import builtin
from clshade.scene.description import part_digests
from clshade.scene.model import Settings

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


def planted(device, figures=FIGURES, usual: str = "shaded-4") -> Study:
    study = small_study(device)
    one, base = study.measured[0], base_settings(sphere())
    by_name = {variant.name: variant for variant in variants.VARIANTS}
    measured = []
    for name, (ms, error, close, flip) in figures.items():
        approximation = replace(one.approximation, rmse=error, flip=flip)
        fields = {"times": (0.97 * ms, ms, 1.03 * ms), "approximation": approximation, "close": close}
        measured.append(replace(one, variant=by_name[name], settings=by_name[name].settings(base), **fields))
    return replace(study, measured=tuple(measured), usual=usual, reference=replace(study.reference, error=1e-4))


def used(study: Study) -> dict[str, str]:
    return {advice.purpose: advice.used.variant.name for advice in answer(study)}


def test_five_lines(device):
    study = planted(device)
    purposes = ("no visible error", "within 16 ms", "within 100 ms", "the default", "more samples")
    assert tuple(used(study).items()) == tuple(
        zip(purposes, ("shaded-16", "shaded-4", "shaded-16", "shaded-4", "shaded-16"), strict=True)
    )
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


@pytest.mark.parametrize(
    ("figures", "usual", "best", "expected"),
    [
        (FIGURES, "shaded-16", "shaded-16", "not worth it, the error is not visible"),
        (SLOW, "shaded-4", "shaded-64", "worth it, time x13, error x0.1, which is still visible"),
        (FEW, "samples-4", "samples-64", "not worth it, time x4.4, error x0.94"),
        (MODELS, "standard", "standard", "not measured"),  # but of other models
    ],
)
def test_more_samples(device, figures, usual, best, expected):
    more = answer(planted(device, figures, usual))[4]
    assert (more.used.variant.name, more.found) == (best, expected)


@pytest.mark.parametrize(
    ("close", "flip", "unseen"),
    [(CLOSE, FLIP, True), (0.99 * CLOSE, FLIP, False), (CLOSE, 1.01 * FLIP, False), (CLOSE, None, True)],
)
def test_an_error_is_not_visible_by_both_measures(device, close, flip, unseen):
    study = planted(device, {**FIGURES, "shaded-16": (50.0, 0.003, close, flip)})
    assert used(study)["no visible error"] == ("shaded-16" if unseen else "shaded-64")
    assert criterion(study).endswith("the first line has 99.0% (FLIP is not measured)") == (flip is None)


def test_the_share_of_pixels_that_are_close():
    codes = np.full((2, 2, 3), 100, np.uint8)
    changed = codes.copy()
    changed[0, 0], changed[0, 1, 2], changed[1, 1, 0] = 100 + CODES, 100 + CODES + 1, 0
    assert close_share(codes, changed) == close_share(changed, codes) == 0.5


@pytest.mark.parametrize(
    ("name", "expected"),
    [("teapot", "shaded-4"), ("course", "course"), ("icosphere", "samples-4"), ("box_room", "shaded-4")],
)
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
    options = ("--resolution", "48,36", "--device", device.index)
    assert run(capsys, "report", *shlex.split(given), *options)[0] == 0
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
