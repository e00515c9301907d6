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
from clshade.measure.report.variants import COMMON, base_settings, default_variant, variants_for
from clshade.pipeline.effective_settings import effective_settings, picture_fields
from clshade.scene.builtin.scenes import builtin
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


def planted(device, figures=FIGURES, usual: str = "shaded-4") -> Study:
    """Return a study with these figures."""
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
    assert used(study) == {
        "no visible error": "shaded-16",
        "within 16 ms": "shaded-4",
        "within 100 ms": "shaded-16",
        "the default": "shaded-4",
        "more samples": "shaded-16",
    }
    lines = [advice.line(lambda settings: f"draw {settings.samples}") for advice in answer(study)]
    assert lines[0] == "no visible error: 50 ms, RMSE 0.003: draw 16"
    assert lines[3] == (
        "the default:      14 ms, RMSE 0.01; compared with the lines above: time x0.28, x1, x0.28, error x3.3, x1, x3.3: "
        "draw 4"
    )
    assert lines[4] == "more samples:     worth it, time x3.6, error x0.3, which is not visible: draw 16"
    limits = "at least 99% of pixels within 2 of 255 codes of the converged image, and FLIP at most 0.005"
    assert criterion(study) == f"no visible error: {limits}; the first line has 99.5% and 0.003"


def test_nothing_is_without_visible_error_and_nothing_is_fast_enough(device):
    figures = {name: (20.0 * ms, error, 0.8 * close, flip) for name, (ms, error, close, flip) in FIGURES.items()}
    study = planted(device, figures)
    assert used(study)["closest"] == "shaded-64"
    fastest = answer(study)[1]
    assert (fastest.used.variant.name, fastest.found) == ("standard", "none; the fastest takes 120 ms, RMSE 0.02")
    assert answer(study)[4].found == "worth it, time x13, error x0.1, which is still visible"


def test_samples_that_are_not_worth_their_time(device):
    assert answer(planted(device, usual="shaded-16"))[4].found == "not worth it, the error is not visible"
    few = {name: FIGURES[name] for name in ("standard", "samples-4", "samples-64")}
    (*_, more) = answer(planted(device, few, usual="samples-4"))
    assert (more.found, more.used.variant.name) == ("not worth it, time x4.4, error x0.94", "samples-64")
    (*_, more) = answer(planted(device, {"standard": FIGURES["standard"]}, usual="standard"))
    assert (more.found, more.used.variant.name) == ("not measured", "standard")
    models = {"standard": FIGURES["standard"], "gouraud-4": FIGURES["shaded-64"], "trilinear-4": FIGURES["shaded-64"]}
    (*_, more) = answer(planted(device, models, usual="standard"))  # of other models
    assert more.found == "not measured"
    assert len(answer(planted(device, few, usual="shaded-64"))) == 3  # the default was not measured


def test_the_share_of_pixels_that_are_close():
    codes = np.full((2, 2, 3), 100, np.uint8)
    changed = codes.copy()
    changed[0, 0] = 100 + CODES
    changed[0, 1, 2] = 100 + CODES + 1
    changed[1, 1, 0] = 0
    assert close_share(codes, changed) == close_share(changed, codes) == 0.5


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("teapot", {}, "shaded-4"),
        ("course", {}, "course"),
        ("icosphere", {}, "samples-4"),
        ("box_room", {"soft": True}, "shaded-4"),
    ],
)
def test_the_default_is_what_render_draws(device, name, options, expected):
    scene = builtin(name, **options)
    base = base_settings(scene)
    candidates = variants_for(scene, base, device)
    default = default_variant(scene, base, candidates)
    assert default.name == expected
    assert default.settings(base) == Settings.from_preset(scene.preset, **picture_fields(scene))
    rest = [variant for variant in candidates if variant.name != expected]
    new = default_variant(scene, base, rest)
    assert (new.name, new.settings(base)) == ("default", default.settings(base))


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n"
SCENES = [
    ("teapot", ()),
    ("course", ()),
    ("box_room", ("--light-intensity", "0.5")),
    ("a mesh.obj", ("--flat", "--camera-azimuth-angle", "20")),
    ("a mesh.obj", ("--lights", "0")),
    ("a mesh.obj", ("--ambient-occlusion", "4")),
    ("a mesh.obj", ("--look", "studio", "--shadows")),
    ("a mesh.obj", ("--look", "course")),
    ("teapot", ("--look", "course")),
    ("-mesh.obj", ("--look", "plain", "--no-weld", "--fit")),
]


@pytest.mark.parametrize(("name", "options"), SCENES, ids=[" ".join((name, *options)) for name, options in SCENES])
def test_commands_draw_what_was_measured(device, capsys, tmp_path, monkeypatch, name, options):
    """Also of scenes in the studio, of options that would take them out of it, and of names that need quotes."""
    monkeypatch.chdir(tmp_path)
    if name.endswith(".obj"):
        Path(name).write_text(OBJ)
    run_report = Mock(return_value=True)
    monkeypatch.setattr(report, "run", run_report)
    scene_name = f"./{name}" if name.startswith("-") else name
    code, _, _ = run(capsys, "report", scene_name, *options, "--resolution", "48,36", "--device", device.index)
    assert code == 0
    (scene, *_), keywords = run_report.call_args
    base, expected = base_settings(scene, **keywords["settings"]), effective_settings(scene)[0]
    for variant in variants_for(scene, base, device):
        program, verb, *arguments = shlex.split(keywords["command"](variant.settings(base)))
        assert (program, verb) == ("clshade", "render")
        parsed = _parser(["render"]).parse_args(["render", *arguments])
        again = selected.load_scene(parsed, parsed.scenes[0])
        kept = render_command.render_options(parsed, again)
        kept.pop("device")
        drawn, its_settings = effective_settings(again, **kept)
        its_own = replace(its_settings, ao_distance=None)  # which is the scene's, where none is given
        assert its_own == variant.settings(base), variant.name
        for one, target in ((drawn.camera, expected.camera), *zip(drawn.lights, expected.lights, strict=True)):
            assert all(np.array_equal(value, getattr(target, field)) for field, value in vars(one).items())
        for mesh, target in zip(drawn.meshes, expected.meshes, strict=True):
            assert mesh.vertices.shape == target.vertices.shape
            textures = [variant.material.texture for variant in (mesh, target)]
            assert len({None if texture is None else texture.image.tobytes() for texture in textures}) == 1
        assert (drawn.environment is None) == (expected.environment is None)


def test_without_details_only_variants_that_may_be_worth_their_time_are_measured(device, tmp_path, monkeypatch):
    study = Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr(report, "study", study)

    def measured(scene, **options) -> tuple[set[str], bool]:
        """Return the names of the variants that are to be measured, and whether with details."""
        with pytest.raises(KeyboardInterrupt):
            report.run(scene, device.index, command=str, out=tmp_path, **options)
        _, _, chosen, _, _, details = study.call_args.args
        return {variant.name for variant in chosen}, details

    common, details = measured(sphere())
    assert {"samples-4"} < common < set(COMMON)
    assert not details
    every, details = measured(sphere(), details=True)
    assert every > {*common, "float64", "painter"}
    assert details
    assert measured(sphere(), names=["painter"]) == ({"painter"}, True)
    assert {"course", "course-16"} < measured(builtin("course"))[0]
    assert {"course", "vertex-texture"} < measured(builtin("teapot"), budget=1.0)[0]


@pytest.mark.parametrize(
    ("close", "flip", "unseen"),
    [(CLOSE, FLIP, True), (0.99 * CLOSE, FLIP, False), (CLOSE, 1.01 * FLIP, False), (CLOSE, None, True)],
)
def test_an_error_is_not_visible_by_both_measures(device, close, flip, unseen):
    """Without FLIP the codes decide."""
    study = planted(device, {**FIGURES, "shaded-16": (50.0, 0.003, close, flip)})
    assert used(study)["no visible error"] == ("shaded-16" if unseen else "shaded-64")
    assert criterion(study).endswith("the first line has 99.0% (FLIP is not measured)") == (flip is None)
