"""What `inspect` says of scenes."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import run
from mesh_writers import CORNERS, INDICES, Gltf

import clshade
from clshade.scene.contents import format_contents, scene_contents


def test_what_is_added_is_not_the_files(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 2 0 0\nv 0 3 -1\nf 1 2 3\n")
    contents = scene_contents(clshade.load(path))
    assert (contents["lights"], contents["added_lights"], contents["each_light"]) == (0, 3, [])
    assert (contents["cameras"], contents["camera"]) == (0, None)
    assert contents["bounds"] == [[0, 0, -1], [2, 3, 0]]
    text = format_contents(contents)
    assert "bounds  0 0 -1 to 2 3 0, size 2 3 1" in text
    assert "camera  none: one that shows all is added" in text
    assert "no lights: 3 are added" in text
    assert "PointLight" not in text


def test_materials_and_textures():
    images = [clshade.Texture(np.ones((2, 4, 3)), name=name) for name in ("wood", "dents")]
    shiny = clshade.MetallicRoughness(metallic=0.25, roughness=0.5, normal_texture=images[1])
    materials = [
        clshade.Material(kd=0.7, name="oak", texture=images[0]),
        clshade.Material(name="glass", opacity=0.5, blend=True, texture=images[0], pbr=shiny),
    ]
    triangle = {"uvs": np.zeros((3, 2))}
    meshes = [clshade.Mesh(CORNERS, [[0, 1, 2]], material=materials[k], **triangle) for k in (0, 1, 0)]
    contents = scene_contents(clshade.Scene(meshes, clshade.builtin("quads").camera))
    assert [mesh["material_number"] for mesh in contents["meshes"]] == [1, 2, 1]
    assert contents["materials"][1]["textures"] == {"color": 1, "normal": 2}
    assert contents["textures"][1] == {"number": 2, "name": "dents", "size": [4, 2], "channels": 3}
    lines = [line.split() for line in format_contents(contents).splitlines()]
    assert ["oak", "1", "1", "1", "1", "ka", "0.1,", "kd", "0.7,", "ks", "0.5,", "n", "20", "opaque"] in lines
    assert ["glass", "2", "1", "1", "1", "metallic", "0.25,", "roughness", "0.5", "blend", "0.5"] in lines
    assert ["wood", "1", "4x2", "3", "color", "of", "1,2"] in lines
    assert ["dents", "2", "4x2", "3", "normal", "of", "2"] in lines


@pytest.mark.parametrize("used", [0, 2])
def test_cameras_of_gltf_files(used, tmp_path, capsys):
    document = Gltf()
    document.mesh({"POSITION": CORNERS}, INDICES)
    document.add("nodes", {"mesh": 0})
    for _ in range(2):
        camera = document.add("cameras", {"type": "perspective", "perspective": {"yfov": np.pi / 4, "znear": 0.1}})
        if used:
            document.add("nodes", {"camera": camera, "translation": [0, 0, 5]})
    path = document.glb(tmp_path / "a.glb")
    line = run(capsys, "inspect", path)[1].splitlines()[2]
    assert ("view angle 45, 800x600, the first of 2" if used else "none, 2 without use") in line
    assert json.loads(run(capsys, "inspect", path, "--json")[1])["cameras"] == 2


def test_builtin_scenes(capsys):
    code, out, err = run(capsys, "inspect", "quads")
    assert (code, err) == (0, [])
    assert out.startswith("scene   quads: ")
    assert "light 0: PointLight" in out
