"""`--shadows` and `--no-shadows`: the image, its header, and what `--explain` says."""

from __future__ import annotations

import pytest
from command_line import needs_device, run

from clshade import exr
from clshade.scene.settings import Settings

SMALL = ("render", "teapot", "--resolution", "48,36", "--samples", "1")


def drawn(capsys, tmp_path, *options: str):
    """Return the pixels, the settings in the header, and standard output."""
    code, out, err = run(capsys, *SMALL, *options, "-o", tmp_path / "image")
    assert code == 0, err
    channels, header = exr.read(tmp_path / "image.exr")
    return channels["G"], header["settings"], out


@needs_device
def test_shadows_darken_and_stand_in_the_header(capsys, tmp_path):
    plain, without, _ = drawn(capsys, tmp_path)
    shadowed, settings, out = drawn(capsys, tmp_path, "--shadows", "--explain")
    assert "shadows" not in without
    assert "shadows=True" in settings
    assert (shadowed < plain - 1e-3).mean() > 0.05
    assert "shadows" in next(line for line in out.splitlines() if line.startswith("needed: "))


@needs_device
def test_no_shadows_is_the_image_without(capsys, tmp_path):
    plain = drawn(capsys, tmp_path)
    assert (drawn(capsys, tmp_path, "--no-shadows")[0] == plain[0]).all()


@needs_device
def test_explain_says_why_there_are_none(capsys, tmp_path):
    assert "left out: shadows (SHADOWS): no shadows asked for" in drawn(capsys, tmp_path, "--explain")[2]


@pytest.mark.parametrize("preset", ["course", "standard"])
def test_presets_of_phongs_model_have_no_shadows(preset):
    assert not Settings.from_preset(preset).shadows
