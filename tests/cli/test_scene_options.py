"""Options for edges, occlusion, shadows and environments: the scene and the settings that they make, and the image."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import needs_device, run, scene_of, settings_of
from mesh_writers import triangle
from scene_files import TRIANGLE, write

import clshade
from clshade import exr
from clshade.cli.main import _parser
from clshade.cli.scene import chosen_settings, load_scene
from clshade.pipeline.effective_settings import effective_settings
from clshade.scene.builtin.scenes import builtin
from clshade.scene.geometry import bounding_box, half_diagonal
from clshade.scene.settings import Edges


def test_options_become_edges():
    every = "--edges all --edge-angle 45 --edge-width 2 --edge-color 1,0.5,0 --edges-only"
    for options, edges in (
        ("", None),
        ("--edges silhouette,feature", Edges(("feature", "silhouette"))),
        (every, Edges("all", angle=45, width=2, color=(1, 0.5, 0), only=True)),
    ):
        arguments = ["render", *options.split()]
        assert chosen_settings(_parser(arguments).parse_args(arguments)).get("edges") == edges


def drawn(capsys, tmp_path, *command: str):
    """Return the channels, the settings in the header, and standard output."""
    code, out, err = run(capsys, "render", *command, "-o", tmp_path / "image")
    assert code == 0, err
    channels, header = exr.read(tmp_path / "image.exr")
    return channels, header["settings"], out


@pytest.mark.long
@needs_device
def test_only_files_with_edges_name_them(capsys, tmp_path):
    small = ("quads", "--resolution", "32,24")
    assert "edges" not in drawn(capsys, tmp_path, *small)[1]
    assert "edges=Edges(kinds=('all',)" in drawn(capsys, tmp_path, *small, "--edges", "all")[1]


@pytest.mark.long
@needs_device
def test_ambient_occlusion_stands_in_the_header(capsys, tmp_path):
    small = ("icosphere", "--resolution", "40,30", "--samples", "1")
    assert "ambient_occlusion" not in drawn(capsys, tmp_path, *small)[1]
    channels, settings, _ = drawn(capsys, tmp_path, *small, "--ambient-occlusion", "4", "--layers", "AO")
    assert "ambient_occlusion=4" in settings
    distance = 0.4 * half_diagonal(*bounding_box(builtin("icosphere")))
    assert f"ao_distance={distance!r}" in settings
    covered = channels["A"] == 1.0
    assert (channels["AO"][covered] == 1.0).all()  # it is convex
    assert not channels["AO"][~covered].any()


@pytest.mark.long
@needs_device
def test_shadows_darken_and_stand_in_the_header(capsys, tmp_path):
    small = ("teapot", "--resolution", "48,36", "--samples", "1")
    plain, without, _ = drawn(capsys, tmp_path, *small)
    shadowed, settings, out = drawn(capsys, tmp_path, *small, "--shadows", "--explain")
    assert "shadows" not in without
    assert "shadows=True" in settings
    assert (shadowed["G"] < plain["G"] - 1e-3).mean() > 0.05
    assert "images: the same bits" in out
    assert "shadows" in " ".join(out.split()).split(" needed: ")[1].split(" saved: ")[0]


def test_pictures_of_metallic_roughness_have_shadows(tmp_path):
    path = triangle().glb(tmp_path / "a.glb")
    for options, shadows in (
        ((), True),
        (("--no-shadows",), False),
        (("--preset", "standard"), False),
        (("--preset", "course"), False),
        (("--preset", "standard", "--shadows"), True),
    ):
        parsed = _parser(["render"]).parse_args(["render", path, *options])
        settings = effective_settings(load_scene(parsed, path), parsed.preset, **settings_of(path, *options))[1]
        assert settings.shadows == shadows, options


# Environments


@pytest.fixture
def mesh(tmp_path) -> str:
    return write(tmp_path / "t.obj", TRIANGLE + "f 1 2 3\n")


def test_the_studio_and_its_changes():
    studio = ("teapot", "--environment", "studio")
    scene = scene_of(*studio)
    assert scene.environment is clshade.studio()
    assert scene.preset == "pbr"
    assert scene_of(*studio, "--preset", "standard").preset == "standard"
    assert scene_of(*studio, "--shader", "phong").preset == "standard"
    turned = scene_of(*studio, "--environment-rotation", "30", "--environment-intensity", "2").environment
    assert (turned.rotation, turned.intensity) == (30.0, 2.0)


def test_a_file_and_the_scenes_up(tmp_path, mesh):
    exr.write(tmp_path / "sky.exr", np.ones((2, 4, 3), np.float32))
    environment = scene_of(mesh, "--environment", tmp_path / "sky.exr", "--up", "z").environment
    assert environment.image.shape == (2, 4, 3)
    np.testing.assert_array_equal(environment.up, [0, 0, 1])


def test_default_lights_stand_in_until_they_are_asked_for(mesh):
    assert not scene_of(mesh).own_lights
    assert scene_of(mesh, "--lights", "0").own_lights
    plain = scene_of(mesh, "--environment", "none")
    assert plain.own_lights
    assert plain.environment is None
    assert scene_of(mesh, "--environment-intensity", "2").environment.intensity == 2.0
