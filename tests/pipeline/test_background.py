"""`Settings.background`: in the image, the oracle, the header, the PNG, and whatever else shows PNGs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from command_line import needs_device, run
from PIL import Image

import clshade
from clshade.errors import InputError
from clshade.images import png
from clshade.images.tonemap import over, over_checkers, straight, tonemap, tonemap_rgba
from clshade.pipeline.effective_settings import effective_settings
from clshade.scene.settings import Settings, SettingsFields
from clshade.view.sheet import draw_sheet

SMALL = clshade.builtin("icosphere", level=1, resolution=(40, 30))
UNLIT: SettingsFields = {"shader": "nolight"}  # light does not matter here, and the kernels build faster without


def test_the_scenes_background_a_color_and_none():
    assert Settings().background == "scene"
    for option, expected in (("scene", SMALL.background), (None, None), ((1, 0.5, 0), [1, 0.5, 0]), ("red", [1, 0, 0])):
        color = effective_settings(SMALL, background=option)[0].background
        assert color is expected if expected is None else np.array_equal(color, expected)
    only = clshade.Edges(only=True)
    assert effective_settings(SMALL, edges=only)[0].background.tolist() == [1, 1, 1]
    assert effective_settings(SMALL, edges=only, background=None)[0].background is None


def test_straight_alpha():
    rgba = np.array([[[0.25, 0.5, 1.0, 0.5], [0, 0, 0, 0], [3.0, 0, 0, 1.0], [0.1, 0.1, 0.1, 0.25]]], np.float32)
    assert straight(rgba)[0].tolist() == pytest.approx(np.array([[0.5, 1, 2], [0, 0, 0], [3, 0, 0], [0.4, 0.4, 0.4]]))
    for operator in ("none", "aces", "neutral"):
        codes = tonemap_rgba(rgba, operator, 1.0)
        assert codes[0, :, 3].tolist() == [128, 0, 255, 64]
        assert np.array_equal(codes[..., :3], tonemap(straight(rgba), operator, 1.0))
    shown = over(np.array([[[200, 100, 0, 128], [9, 9, 9, 0], [1, 2, 3, 255]]], np.uint8), (255, 255, 255))
    assert shown.tolist() == [[[227, 177, 127], [255, 255, 255], [1, 2, 3]]]
    assert {tuple(pixel) for pixel in over_checkers(np.zeros((20, 20, 4), np.uint8)).reshape(-1, 3).tolist()} == {
        (204, 204, 204),
        (153, 153, 153),
    }


@pytest.mark.sampled
@needs_device
@pytest.mark.parametrize("samples", [1, 4])
def test_images_over_nothing_and_over_a_color(samples, tmp_path):
    nothing = clshade.render(SMALL, background=None, samples=samples, **UNLIT)
    assert clshade.check(nothing, "all").passed
    assert nothing.scene.background is None
    color = clshade.render(SMALL, background=(0.5, 0.25, 2.0), samples=samples, **UNLIT)
    assert clshade.check(color, "all").passed
    behind = (1.0 - nothing.alpha[..., None]) * np.array([0.5, 0.25, 2.0])
    assert color.rgb == pytest.approx(nothing.rgb + behind, abs=1e-5)
    assert "background=None" in nothing.metadata()["settings"]
    assert "background=(0.5, 0.25, 2.0)" in color.metadata()["settings"]
    usual = clshade.render(SMALL, samples=samples, **UNLIT).metadata()["settings"]
    assert "background" not in usual
    assert "layer_alpha" not in usual
    nothing.save(tmp_path / "a")
    with Image.open(tmp_path / "a.png") as image:
        assert image.mode == "RGBA"
        assert np.array_equal(np.asarray(image), nothing.to_png8())
    alpha = nothing.to_png8()[..., 3]
    assert np.array_equal(alpha, np.floor(255 * nothing.alpha.astype(float) + 0.5))
    same = replace(SMALL, background=None)
    assert clshade.render(same, samples=samples, **UNLIT).rgba.tobytes() == nothing.rgba.tobytes()


@needs_device
def test_the_command_line(tmp_path, capsys):
    command = ("render", "icosphere", "--resolution", "24,18", "--shader", "nolight", "--quiet", "-o", tmp_path / "a")
    assert run(capsys, *command, "--background", "none", "--crop-zoom", "0,0,8,8")[0] == 0
    assert png.read(tmp_path / "a.png", alpha=True)[0, 0].tolist() == [0, 0, 0, 0]
    assert png.read(tmp_path / "a_crop.png")[0, 0].tolist() == [204, 204, 204]
    for text, code in (("#336699", (0x33, 0x66, 0x99)), ("white", (255, 255, 255)), ("1,0,0", (255, 0, 0))):
        assert run(capsys, *command, "--background", text)[0] == 0
        assert png.read(tmp_path / "a.png", alpha=True)[0, 0].tolist() == list(code)
    for option in ("--background", "--edge-color", "--nan-color"):
        code, out, lines = run(capsys, "render", "icosphere", option, "1,2")
        assert (code, out, len(lines)) == (2, "", 1)
        assert f"argument {option}: expected a name such as white, #rrggbb (sRGB), or three linear" in lines[0]


@pytest.mark.long
@needs_device
def test_sheets_stand_on_white_and_films_keep_alpha_where_they_can(tmp_path, capsys):
    sheet = draw_sheet(SMALL, ("front",), background=None, **UNLIT)
    x, y = sheet.facts["views"][0]["panel"][:2]
    assert sheet.picture[y, x].tolist() == [255, 255, 255]
    command = ("turntable", "torus_knot", "--count", "2", "--resolution", "16,12", "--background", "none", "--quiet")
    command = (*command, "--shader", "nolight")
    for ending, alpha in (("webp", 0), ("apng", 0), ("gif", 255)):
        assert run(capsys, *command, "-o", tmp_path / f"a.{ending}")[0] == 0
        with Image.open(tmp_path / f"a.{ending}") as film:
            film.seek(1)
            corner = film.convert("RGBA").getpixel((0, 0))
        assert corner[3] == alpha
        assert alpha == 0 or corner[:3] == (0, 0, 0)


@pytest.mark.long
@needs_device
def test_the_colorbar_beside_an_image_over_nothing(tmp_path):
    scene = replace(SMALL, meshes=[replace(mesh, scalars={"h": mesh.verts[:, 1]}) for mesh in SMALL.meshes])
    frame = clshade.render(scene, background=None, scalars="h", **UNLIT)
    frame.save(tmp_path / "a", colorbar=True)
    picture = png.read(tmp_path / "a.png", alpha=True)
    assert picture[0, 0].tolist() == [0, 0, 0, 0]
    assert picture[0, -1].tolist() == [255, 255, 255, 255]


def test_a_wrong_size_is_no_png(tmp_path):
    with pytest.raises(InputError, match="or \\(M, N, 4\\)"):
        png.write(tmp_path / "a.png", np.zeros((2, 2, 2), np.uint8))
