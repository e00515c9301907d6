"""`--environment`: the scene that it makes, and refusals in one line."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import run, scene_of

import clshade
from clshade import exr
from clshade.cli.main import REFUSED
from clshade.scene.model import Scene


def loaded(*options: str, scene: str = "teapot") -> Scene:
    return scene_of(scene, *options)


@pytest.fixture
def triangle(tmp_path) -> str:
    path = tmp_path / "t.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return str(path)


def test_the_studio_and_its_changes():
    scene = loaded("--environment", "studio")
    assert scene.environment is clshade.studio()
    assert scene.preset == "pbr"
    assert loaded("--environment", "studio", "--preset", "standard").preset == "standard"
    assert loaded("--environment", "studio", "--shader", "phong").preset == "standard"
    turned = loaded(
        "--environment", "studio", "--environment-rotation", "30", "--environment-intensity", "2"
    ).environment
    assert (turned.rotation, turned.intensity) == (30.0, 2.0)


def test_a_file_and_the_scenes_up(tmp_path, triangle):
    exr.write(tmp_path / "sky.exr", np.ones((2, 4, 3), np.float32))
    environment = loaded("--environment", str(tmp_path / "sky.exr"), "--up", "z", scene=triangle).environment
    assert environment.image.shape == (2, 4, 3)
    np.testing.assert_array_equal(environment.up, [0, 0, 1])


def test_default_lights_stand_in_until_they_are_asked_for(triangle):
    assert not loaded(scene=triangle).own_lights
    assert loaded("--lights", "0", scene=triangle).own_lights
    plain = loaded("--environment", "none", scene=triangle)
    assert plain.own_lights
    assert plain.environment is None
    assert loaded("--environment-intensity", "2", scene=triangle).environment.intensity == 2.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--environment", "none.hdr"), "none.hdr: file: expected an existing file"),
        (("--environment", "studio", "--environment-intensity", "-1"), "--environment-intensity: expected"),
        (("--environment", "studio", "--environment-rotation", "nan"), "--environment-rotation: expected"),
        (("--environment", "none", "--environment-rotation", "9"), "--environment-rotation: needs --environment"),
        (("--environment-intensity", "2"), "--environment-intensity: needs --environment"),
    ],
)
def test_refusals(options, message, folder, capsys):
    code, out, lines = run(capsys, "render", "teapot", *options)
    assert (code, out, len(lines)) == (REFUSED, "", 1)
    assert message in lines[0]
    assert not list(folder.iterdir())
