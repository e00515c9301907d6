"""`render --save-scene FILE.json`: the scene as it was drawn, which draws the same picture again; what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import SMALL, assert_refused, listing, needs_device, run

import clshade
from clshade import exr


@pytest.mark.long
@needs_device
def test_the_scene_draws_the_same_picture(capsys, tmp_path):
    saved = tmp_path / "scene.json"
    options = ("--lights", "1", "--light-intensity", "0.5", "--camera-azimuth-angle", "20")
    code, out, err = run(capsys, *SMALL, *options, "--save-scene", saved, "-o", tmp_path / "a")
    assert code == 0, err
    assert err[-1].endswith(f"wrote {saved}")
    assert "wrote" in out
    scene = clshade.load(saved)
    assert (scene.preset, scene.camera.resolution, len(scene.lights)) == ("course", (32, 24), 1)
    binary = json.loads(saved.read_text())["arrays"]["file"]
    assert listing(tmp_path) == ["a.exr", "a.png", "scene.json", binary]
    code, _, err = run(capsys, "render", saved, "--layers", "Z,id", "-o", tmp_path / "b")
    assert code == 0, err
    (first, _), (second, _) = (exr.read(tmp_path / f"{name}.exr") for name in "ab")
    assert set(first) == set(second)
    for name, channel in first.items():
        assert np.array_equal(channel.view(np.uint32), second[name].view(np.uint32)), name


@pytest.mark.long
@needs_device
def test_a_scene_for_other_programs(capsys, tmp_path):
    saved = tmp_path / "scene.GLB"
    code, _, err = run(capsys, "render", "teapot", "--resolution", "40,20", "--save-scene", saved, "-o", tmp_path / "a")
    assert code == 0, err
    assert listing(tmp_path) == ["a.exr", "a.png", "scene.GLB"]
    scene = clshade.load(saved)
    columns, rows = scene.camera.resolution
    assert columns == 2 * rows
    assert scene.face_count == clshade.builtin("teapot").face_count


@needs_device
def test_standard_output_stays_json(capsys, tmp_path):
    code, out, _ = run(capsys, *SMALL, "--json", "--save-scene", tmp_path / "s.json", "-o", tmp_path / "a")
    assert code == 0
    assert json.loads(out)["resolution"] == [32, 24]


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("--save-scene", "a.jsn"), ("--save-scene: expected a file name that ends in .json or .glb, found a.jsn",)),
        (("--save-scene", ".glb"), ("--save-scene: expected a file name that ends in .json or .glb, found .glb",)),
        (("--save-scene", "a\nb.json"), ("render: --save-scene: expected a file in the scene's folder, found ",)),
        (("--save-scene", ""), ("--save-scene: expected a file name that ends in .json or .glb",)),
        (("teapot", "--save-scene", "a.json"), ("--save-scene: is for one scene, not for 2",)),
        (("--save-scene", "none/a.json"), ("none/a.json: cannot be written: there is no folder ",)),
        (("--save-scene", "folder.json"), ("folder.json: cannot be written: it is a folder",)),
        (
            ("--sheet", "-o", "s", "--save-scene", "s.json"),
            ("--save-scene: s.json is the file of the facts of --sheet",),
        ),
    ],
)
def test_what_is_refused_before_anything_is_drawn(capsys, folder, arguments, parts):
    (folder / "folder.json").mkdir()
    assert_refused(run(capsys, "render", "quads", *arguments), *parts)
    assert listing(folder) == ["folder.json"]


def test_the_file_that_is_read_is_not_replaced(capsys, tmp_path):
    clshade.builtin("quads", count=1).to_json(tmp_path / "a.json")
    found = run(capsys, "render", tmp_path / "a.json", "--save-scene", tmp_path / "a.json", "-o", tmp_path / "b")
    assert_refused(found, " is read: choose another file")
