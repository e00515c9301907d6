"""`--shadows` and `--no-shadows`: the image, its header, and what `--explain` says."""

from __future__ import annotations

import pytest
from command_line import needs_device, run
from mesh_writers import triangle

from clshade import exr
from clshade.cli.main import _parser
from clshade.cli.scene import load_scene, picture_settings
from clshade.pipeline.effective_settings import effective_settings

SMALL = ("render", "teapot", "--resolution", "48,36", "--samples", "1")


def drawn(capsys, tmp_path, *options: str):
    """Return the pixels, the settings in the header, and standard output."""
    code, out, err = run(capsys, *SMALL, *options, "-o", tmp_path / "image")
    assert code == 0, err
    channels, header = exr.read(tmp_path / "image.exr")
    return channels["G"], header["settings"], out


@pytest.mark.long
@needs_device
def test_shadows_darken_and_stand_in_the_header(capsys, tmp_path):
    plain, without, _ = drawn(capsys, tmp_path)
    shadowed, settings, out = drawn(capsys, tmp_path, "--shadows", "--explain")
    assert "shadows" not in without
    assert "shadows=True" in settings
    assert (shadowed < plain - 1e-3).mean() > 0.05
    assert "images: the same bits" in out
    assert "shadows" in " ".join(out.split()).split(" needed: ")[1].split(" saved: ")[0]


def test_those_of_metallic_roughness_have_them(tmp_path):
    path = triangle().glb(tmp_path / "a.glb")
    for options, shadows in (
        ((), True),
        (("--no-shadows",), False),
        (("--preset", "standard"), False),
        (("--preset", "course"), False),
        (("--preset", "standard", "--shadows"), True),
    ):
        parsed = _parser(["render"]).parse_args(["render", path, *options])
        scene = load_scene(parsed, path)
        settings = effective_settings(scene, parsed.preset, **picture_settings(parsed, scene))[1]
        assert settings.shadows == shadows, options
