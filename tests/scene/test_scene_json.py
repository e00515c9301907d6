"""Scene files of clshade's own: every field comes back bit for bit, and everything else is refused in one line."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import signal
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from every_light import EVERY, default_of
from mapped_scenes import mapped, normal_image
from processes import python, started
from scene_files import refusal

import clshade
from clshade import Camera, DirectionalLight, Environment, Material, Mesh, MetallicRoughness, PointLight, Scene, Texture
from clshade.errors import InputError, OutputError
from clshade.scene.formats import scene_json
from clshade.scene.formats.load import load
from clshade.scene.lights import LIGHTS
from clshade.scene.material import MAPS, TERMS

VERTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.1]])
FACES = [[0, 1, 2], [1, 3, 2]]
CAMERA = Camera((0.5, 0.5, 4), (0.5, 0.5, 0), (0, 1, 0), 1.0, (0.6, 0.8), (32, 24))
CLASSES = (*(Scene, Mesh, Material, MetallicRoughness, Texture, Camera, Environment), *LIGHTS)


def texture(seed: int = 0, **fields: Any) -> Texture:
    return Texture(np.random.default_rng(seed).random((3, 4, 3 + seed % 2), np.float32), **fields)


def moved(*shifts: float) -> np.ndarray:
    placements = np.tile(np.eye(4), (len(shifts), 1, 1))
    placements[:, 0, 3] = shifts
    return placements


def full_scene() -> Scene:
    """Return a scene in which every field of every class has another value than its default."""
    pbr = MetallicRoughness(
        *(0.25, 1 / 3, texture(2), 1.4, 0.5, (0.1, 0.2, 0.3), 0.7),
        *(Texture(normal_image(4, 5), coordinates=1), 0.1 + 0.2, texture(4, filter="nearest"), 0.75, texture(6)),
        **{name: texture(6) for name in list(MAPS)[4:]},
    )
    material = Material(
        *((0.1, 0.2, 1e-320), 0.3, 0.4, 7.5, texture(1, wrap=("clamp", "mirror"), name="Löwe"), "Ω \ud800 \u2028", 0.9),
        *("front", True, 0.3, pbr, True, 0.5),
        **dict.fromkeys(list(TERMS)[2:], 0.7),
    )
    broken = np.array([*VERTS.tolist(), [np.nan, 0, 0]])
    mesh = Mesh(
        *(broken, [*FACES, [0, 1, 4]], np.float32(np.linspace(0, 1, 15).reshape(5, 3)), [[0, 0, 2.0]]),
        *(np.zeros((3, 3), int), np.array([[0, -0.0], [np.nan, 1], [0.1, 5e-324]], np.float32)),
        *([[0, 1, 2]] * 3, material, moved(0.1, -0.3), 'a "mesh"\n', "drop", 2),
        *({"height": np.array([1.5, np.nan, 3, 4, 5]), "of corners": np.eye(3, dtype=np.float32)},),
        *([[1.0, 0, 0, -1]], np.zeros((3, 3), int), (np.ones((3, 2), np.float32),), [0.1, 1, 1, 0.3, 1]),
    )
    names = ("left", "\u00e9", "")
    material = Material(texture=texture(1, lookup="course"))
    shiny = Mesh(VERTS, FACES, material=material, instances=moved(2.0, 3.0, 4.0), instance_names=names, part_of="x")
    camera = dataclasses.replace(CAMERA, principal=(0.4, 0.6), orthographic=True, focal=2.0)
    around = Environment(np.arange(24, dtype=np.float32).reshape(2, 4, 3), 33.3, 0.5, (0.3, 0.7, -0.2), "sky")
    return Scene(
        *((mesh, shiny, shiny), camera, EVERY, (0.1, 0.2, 0.3), None, "pbr", "all of it", ("points", "lines"), around),
        *(False, True, 0.125, ("walk", "")),
    )


def parts_of(value: Any) -> list[Any]:
    """Return all instances of dataclasses in a value."""
    if isinstance(value, (tuple, list)):
        return [part for entry in value for part in parts_of(entry)]
    if not dataclasses.is_dataclass(value):
        return []
    inner = [part for field in dataclasses.fields(value) for part in parts_of(getattr(value, field.name))]
    return [value, *inner]


def same(a: Any, b: Any) -> bool:
    """Return whether two values are of the same type and have the same bits."""
    if type(a) is not type(b):
        return False
    if dataclasses.is_dataclass(a):
        return all(same(getattr(a, field.name), getattr(b, field.name)) for field in dataclasses.fields(a))
    if isinstance(a, np.ndarray):
        return (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return struct.pack("d", a) == struct.pack("d", b) if isinstance(a, float) else a == b


def again(scene: Scene, folder) -> Scene:
    scene.to_json(folder / "again.json")
    return load(folder / "again.json")


# Round trips


def test_every_field_comes_back(tmp_path):
    scene = full_scene()
    copy = again(scene, tmp_path)
    assert same(scene, copy)
    for part in parts_of(copy):
        for field in dataclasses.fields(part):
            value = getattr(part, field.name)
            assert not isinstance(value, np.ndarray) or not value.flags.writeable


def test_the_scene_of_this_test_has_every_field():
    """A field that is added must have a value here other than its default; then the test above says if it is held."""
    plain: dict[type, Any] = {
        Scene: Scene((), CAMERA),
        Mesh: Mesh(VERTS, FACES),
        Material: Material(),
        MetallicRoughness: MetallicRoughness(),
        Texture: Texture(np.zeros((1, 1, 3))),
        Camera: Camera((0, 0, 5), (0, 0, 0), (0, 1, 1), 1.5, (1, 1)),
        Environment: Environment(np.zeros((1, 1, 3))),
        **{type(light): default_of(light) for light in EVERY},
    }
    assert set(plain) == set(CLASSES)
    parts = parts_of(full_scene())
    assert {type(part) for part in parts} == set(CLASSES)
    for kind, default in plain.items():
        for field in dataclasses.fields(kind):
            values = [getattr(part, field.name) for part in parts if type(part) is kind]
            assert any(not same(value, getattr(default, field.name)) for value in values), (kind.__name__, field.name)


def test_what_is_shared_is_shared_again(tmp_path):
    """Layers and tables number materials and textures by identity."""
    image, worn = texture(1), Material(pbr=mapped())
    glazed = [Material(texture=image, name=name) for name in "ab"]
    meshes = [Mesh(VERTS, FACES, material=material) for material in (glazed[0], worn, glazed[1], glazed[0], worn)]
    copies = again(Scene(meshes, CAMERA), tmp_path).meshes
    numbers = {id(mesh.material): number for number, mesh in enumerate(copies)}
    assert [numbers[id(mesh.material)] for mesh in copies] == [3, 4, 2, 3, 4]
    assert copies[0].material.texture is copies[2].material.texture
    written = json.loads((tmp_path / "again.json").read_text())
    assert (len(written["materials"]), len(written["textures"])) == (3, 1 + len(MAPS))


def test_directions_are_not_normalized_twice(tmp_path):
    rng, changed = np.random.default_rng(1), 0
    for _ in range(40):
        environment = Environment(np.zeros((1, 1, 3)), up=rng.normal(size=3))
        changed += dataclasses.replace(environment).up.tobytes() != environment.up.tobytes()
        copy = again(Scene((), CAMERA, environment=environment), tmp_path)
        assert same(copy.environment, environment)
    assert changed  # or this test could not fail


def test_the_same_scene_gives_the_same_bytes(tmp_path):
    for name in ("a.json", "b.json"):
        full_scene().to_json(tmp_path / name)
    load(tmp_path / "a.json").to_json(tmp_path / "c.json")
    texts = [(tmp_path / f"{name}.json").read_text().replace(f"{name}.json", "x") for name in "abc"]
    binaries = [arrays_of(tmp_path / f"{name}.json").read_bytes() for name in "abc"]
    assert len(set(texts)) == len(set(binaries)) == 1


MINIMAL = """{
  "format": "clshade scene",
  "version": 1,
  "scene": {
    "camera": {"eye": [0, 0, 5], "lookat": [0, 0, 0], "up": [0, 1, 0], "focal": 1, "plane": [0.6, 0.8]},
    "meshes": [{"verts": [[-1, -1, 0], [1, -1, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}],
    "lights": [{"kind": "PointLight", "position": [1, 2, 3]}]
  }
}
"""


def test_a_file_written_by_hand(tmp_path):
    """What has a default may be missing, and small arrays stand in the text."""
    (tmp_path / "a.json").write_text(MINIMAL)
    scene = load(tmp_path / "a.json")
    mesh = Mesh(np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]), [[0, 1, 2]])
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1, (0.6, 0.8))
    assert same(scene, Scene(mesh, camera, PointLight((1, 2, 3))))


def test_the_text_as_it_is_written(tmp_path):
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1, (0.6, 0.8))
    Scene((), camera, DirectionalLight((0, -1, 0)), name="ü").to_json(tmp_path / "a.json")
    assert (tmp_path / "a.json").read_text(encoding="utf-8") == (
        '{\n  "format": "clshade scene",\n  "version": 1,\n  "scene": {\n    "meshes": [],\n    "camera": {\n'
        '      "eye": [0.0, 0.0, 5.0],\n      "lookat": [0.0, 0.0, 0.0],\n      "up": [0.0, 1.0, 0.0],\n'
        '      "focal": 1.0,\n      "plane": [0.6, 0.8],\n      "resolution": [800, 600],\n'
        '      "principal": [0.5, 0.5],\n      "orthographic": false\n    },\n    "lights": '
        '[{"kind": "DirectionalLight", "direction": [0.0, -1.0, 0.0], "intensity": [1.0, 1.0, 1.0]}],\n'
        '    "ambient": [1.0, 1.0, 1.0],\n    "background": [0.0, 0.0, 0.0],\n    "preset": "standard",\n'
        '    "name": "ü",\n    "ignored": [],\n    "environment": null,\n    "own_lights": true,\n'
        '    "fitted": false,\n    "light_scale": 1.0,\n    "animations": []\n  },\n  "materials": [],\n'
        '  "textures": [],\n  "arrays": null\n}\n'
    )
    assert os.listdir(tmp_path) == ["a.json"]


def test_empty_arrays_need_no_file(tmp_path):
    mesh = Mesh(np.zeros((0, 3)), np.zeros((0, 3), int), instances=np.zeros((0, 4, 4)), uvs=np.zeros((0, 2)))
    assert same(again(Scene(mesh, CAMERA), tmp_path).meshes, (mesh,))
    assert os.listdir(tmp_path) == ["again.json"]


def seen_through() -> Scene:
    """Return transparent and textured squares in two places each, before another."""
    image = Texture(np.random.default_rng(2).random((4, 5, 4), np.float32))
    glass = Material(texture=image, blend=True, opacity=0.75)
    pane = Mesh(VERTS, FACES, uvs=VERTS[:, :2], material=glass, instances=moved(0.0, 0.4), alphas=[1, 0.5, 0.2, 1])
    wall = Mesh(VERTS - (0.2, 0.2, 1.0), FACES, colors=np.eye(4)[:, :3], instances=moved(0.0, 0.7))
    return Scene((pane, wall), CAMERA, PointLight((1, 2, 3)), background=0.1)


def test_scenes_of_files_come_back(tmp_path, data_folder):
    for name in ("Duck.glb", "2CylinderEngine.glb", "cat.npy", "teapot.obj"):
        scene = load(data_folder / name)
        assert same(again(scene, tmp_path), scene), name


def test_options_of_loading(tmp_path):
    scene = full_scene()
    path = tmp_path / "a.json"
    scene.to_json(path)
    assert same(load(path, resolution=(7, 5)).camera, scene.camera.with_resolution((7, 5)))
    assert same(load(path, lights=[2, 0]).lights, (scene.lights[2], scene.lights[0]))
    assert all(mesh.material.two_sided for mesh in load(path, two_sided=True).meshes)
    assert load(path, fit=True).camera.resolution == scene.camera.resolution
    for name, value in {"texture": np.zeros((1, 1, 3)), "focal": 2.0, "time": 1.0, "animation": "walk"}.items():
        refusal(path, f"load: {name}: expected ", **{name: value})
    for name, value in {"crease": 30.0, "up": "z", "flat": True}.items():
        refusal(path, f"load: {name}: expected one only for .obj, .gltf, .glb, .ply", **{name: value})


# Refusals

REMOVED = object()


def changed(path, *keys: Any, value: Any) -> str:
    """Change one value of a scene file, or remove its key."""
    document = json.loads(path.read_text())
    inner = document
    for key in keys[:-1]:
        inner = inner[key]
    if value is REMOVED:
        del inner[keys[-1]]
    else:
        inner[keys[-1]] = value
    path.write_text(json.dumps(document))
    return str(path)


def arrays_of(path: Path) -> Path:
    """Return the file of arrays that a scene file names."""
    return path.with_name(json.loads(path.read_text())["arrays"]["file"])


@pytest.fixture
def saved(tmp_path):
    """Return the path of a scene file with all that a scene may hold."""
    full_scene().to_json(tmp_path / "a.json")
    return tmp_path / "a.json"


@pytest.mark.parametrize("value", [REMOVED, None])
def test_a_file_without_a_camera_gets_a_fitted_one(saved, value):
    changed(saved, "scene", "camera", value=value)
    scene = clshade.load(saved)
    assert scene.fitted
    assert scene.camera.eye.tolist() == Scene(scene.meshes).camera.eye.tolist()


MESH = ("scene", "meshes", 0)
OUTSIDE = "arrays.file: expected a file in the scene's folder (no absolute path, no ..)"


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (("format",), REMOVED, "format: expected 'clshade scene', found none"),
        (("format",), "other", "format: expected 'clshade scene', found other"),
        (("version",), REMOVED, "version: expected 1, found none"),
        (("version",), 2, "version: expected 1, found 2"),
        (("version",), "1", "version: expected 1, found 1"),
        (("version",), True, "version: expected 1, found True"),
        (("extra",), 1, "keys: expected one of format, version, scene, textures, materials, arrays, found 'extra'"),
        (("matrials",), [], "found 'matrials': did you mean 'materials'?"),
        (("scene",), REMOVED, "scene: expected this key, found none"),
        (("scene",), [1], "scene: expected an object, found 1 values"),
        (("scene", "camra"), 1, "scene: expected one of meshes, camera, "),
        (("scene", "camra"), 1, "found 'camra': did you mean 'camera'?"),
        (("scene", "camera"), 1, "scene.camera: expected an object"),
        (("scene", "camera", "eyes"), 1, "scene.camera: expected one of eye, lookat"),
        (("scene", "camera", "eye"), REMOVED, "scene.camera.eye: expected this key, found none"),
        (("scene", "camera", "eye"), [1, 2], "scene.camera: Camera: eye: expected three finite numbers"),
        (("scene", "camera", "eye"), [1, 2, True], "scene.camera.eye: expected a list of numbers or texts, found True"),
        (("scene", "camera", "focal"), "1", "scene.camera: Camera: focal: expected a finite number above 0"),
        (("scene", "camera", "resolution"), [0, 5], "scene.camera: Camera: resolution N: expected a whole number"),
        (("scene", "meshes"), {}, "scene.meshes: expected a list, found 0 values"),
        (("scene", "meshes", 1), 5, "scene.meshes[1]: expected an object, found 5"),
        ((*MESH, "vert"), 1, "scene.meshes[0]: expected one of verts"),
        ((*MESH, "verts"), REMOVED, "scene.meshes[0].verts: expected this key, found none"),
        ((*MESH, "verts"), [[1, 2]], "scene.meshes[0]: Mesh 'a \"mesh\"\\n': verts: expected an array of shape (K, 3)"),
        ((*MESH, "verts"), [[[[[1]]]]], "scene.meshes[0].verts: expected at most 4 lists in each other, found more"),
        ((*MESH, "faces"), [[0, 1, 5]], "faces: expected indices from 0 to 4, found '5 in face 0'"),
        ((*MESH, "material"), 2, "scene.meshes[0].material: expected an index of the 2 materials, from 0, found 2"),
        ((*MESH, "material"), -1, "scene.meshes[0].material: expected an index of the 2 materials"),
        ((*MESH, "material"), True, "scene.meshes[0].material: expected an index of the 2 materials"),
        ((*MESH, "material"), None, "scene.meshes[0]: Mesh 'a \"mesh\"\\n': material: expected a Material, found None"),
        ((*MESH, "dropped"), "2", "dropped: expected a whole number from 0 to"),
        ((*MESH, "name"), 5, "scene.meshes[0]: Mesh: name: expected a text, found 5"),
        ((*MESH, "scalars"), [], "scene.meshes[0].scalars: expected an object, found 0 values"),
        ((*MESH, "scalars", "height"), [1], "scene.meshes[0]: Mesh 'a \"mesh\"\\n': scalars 'height': expected (5,)"),
        ((*MESH, "scalars", "height", "shap"), 1, "scene.meshes[0].scalars 'height': expected one of type, shape"),
        (("scene", "lights", 0), 5, "scene.lights[0].kind: expected one of PointLight, "),
        (("scene", "lights", 1, "kind"), "SunLight", "found SunLight: did you mean"),
        (("scene", "lights", 1, "kind"), REMOVED, "scene.lights[1].kind: expected one of PointLight, "),
        (("scene", "lights", 1, "radius"), 1, "scene.lights[1]: expected one of direction, intensity, found 'radius'"),
        (("scene", "lights", 0, "radius"), -1, "scene.lights[0]: PointLight: radius: expected"),
        (("scene", "preset"), "pb", "scene: Scene: preset: expected one of course, standard, pbr, found 'pb'"),
        (("scene", "environment", "up"), [0, 0, 0], "scene.environment: Environment: up: expected a direction"),
        (
            ("materials", 0, "texture"),
            "x",
            "materials[0].texture: expected an index of the 6 textures, from 0, found x",
        ),
        (("materials", 0, "pbr", "ior"), 0.5, "materials[0].pbr: MetallicRoughness: ior: expected"),
        (("materials", 0, "sides"), "back", "materials[0]: Material: sides: expected one of both, front"),
        (("textures",), 3, "textures: expected a list, found 3"),
        (("textures", 0, "wrap"), ["clamp", 3], "textures[0]: Texture: wrap: expected one of"),
        (("textures", 0, "image"), REMOVED, "textures[0].image: expected this key, found none"),
        ((*MESH, "faces", "type"), "float16", "faces.type: expected one of float32, float64, int32, found float16"),
        ((*MESH, "faces", "type"), [], "scene.meshes[0].faces.type: expected one of float32"),
        ((*MESH, "faces", "shape"), 5, "scene.meshes[0].faces.shape: expected a list, found 5"),
        ((*MESH, "faces", "shape"), [], "scene.meshes[0].faces: expected 1 to 3 dimensions"),
        ((*MESH, "faces", "shape"), [1, 1, 1, 1], "scene.meshes[0].faces: expected 1 to 3 dimensions"),
        ((*MESH, "faces", "shape"), [1] * 1000, "scene.meshes[0].faces: expected 1 to 3 dimensions"),
        ((*MESH, "faces", "shape"), [-1, 3], "scene.meshes[0].faces.shape: expected a whole number from 0 to"),
        ((*MESH, "faces", "shape"), [1 << 29, 1 << 29], "scene.meshes[0].faces: expected 1 to 3 dimensions"),
        ((*MESH, "faces", "shape"), [1 << 30, 0], "scene.meshes[0].faces.shape: expected a whole number from 0 to"),
        ((*MESH, "faces", "offset"), 2, "scene.meshes[0].faces: expected 1 to 3 dimensions of whole values within"),
        ((*MESH, "faces", "offset"), 1 << 40, "scene.meshes[0].faces.offset: expected a whole number from 0 to"),
        ((*MESH, "faces", "offset"), REMOVED, "scene.meshes[0].faces.offset: expected this key, found none"),
        (("arrays",), None, "textures[0].image"),
        (("arrays",), 5, "arrays: expected an object, found 5"),
        (("arrays", "sha"), 5, "arrays: expected one of file, bytes, sha256, found 'sha'"),
        (("arrays", "sha256"), REMOVED, "arrays.sha256: expected this key, found none"),
        (("arrays", "sha256"), 5, "arrays.sha256: expected a text, found 5"),
        (("arrays", "bytes"), 1.5, "arrays.bytes: expected a whole number from 0 to 34359738368, found 1.5"),
        (("arrays", "bytes"), 8, "arrays.bytes: expected 8 bytes in 'a.json."),
        (("arrays", "file"), None, "arrays.file: expected a text, found none"),
        (("arrays", "file"), "no.bin", "arrays.file: expected an existing file, found no file 'no.bin'"),
        (("arrays", "file"), "/etc/passwd", OUTSIDE),
        (("arrays", "file"), "../a.bin", OUTSIDE),
        (("arrays", "file"), "C:\\a.bin", OUTSIDE),
        (("arrays", "file"), ".", "arrays.file: expected a regular file"),
    ],
)
def test_what_is_refused(saved, keys, value, message):
    refusal(changed(saved, *keys, value=value), "a.json: ", message)


def test_zero_rows_of_any_width_are_refused_by_the_mesh(saved):
    width = (1 << 30) - 1
    empty = {"type": "float64", "shape": [0, width, width], "offset": 0}
    refusal(changed(saved, *MESH, "verts", value=empty), "verts: expected an array of shape (K, 3)")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "file: expected content, found an empty file"),
        ("[1, 2]", "format: expected 'clshade scene', found 2 values"),
        ('[{"eye": [0, 1, 5]}]', "format: expected 'clshade scene', found 1 values"),
        ("3", "format: expected 'clshade scene', found 3"),
        ('"clshade scene"', "format: expected 'clshade scene', found clshade scene"),
        ("{", "JSON: expected a scene file, found "),
        (MINIMAL.replace("0.6", "NaN"), "JSON: expected a scene file, found 'a number that is NaN'"),
        (MINIMAL.replace("[1, 2, 3]", "[1, 2, 1e999]"), "scene.lights[0]: PointLight: position: expected three finite"),
        (MINIMAL.replace("0.6", "1e999"), "scene.camera: Camera: plane H: expected a finite number above 0"),
        (MINIMAL.replace("0.6", "9" * 400), "scene.camera: Camera: plane H: expected a finite number above 0"),
        (MINIMAL.replace('"scene"', '"version": 1, "scene"'), "found 'the key version twice'"),
        ("[" * 100_000, "JSON: expected a scene file, found too deep a nesting"),
        ("\xff", "JSON: expected UTF-8 text"),
    ],
)
def test_texts_that_are_no_scene(tmp_path, text, message):
    (tmp_path / "a.json").write_bytes(text.encode("latin-1"))
    refusal(tmp_path / "a.json", "a.json: ", message)


def test_another_file_of_arrays_is_refused(saved):
    binary = arrays_of(saved)
    data = bytearray(binary.read_bytes())
    data[-1] ^= 1
    binary.write_bytes(data)
    refusal(saved, "arrays.sha256: expected '", hashlib.sha256(data).hexdigest())
    binary.write_bytes(data + b"\0")
    refusal(saved, "arrays.bytes: expected ", f"found {len(data) + 1}")
    binary.unlink()
    refusal(saved, "arrays.file: expected an existing file")


def test_a_link_out_of_the_folder_is_refused(saved, tmp_path_factory):
    binary = arrays_of(saved)
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "a.bin"
    binary.rename(elsewhere)
    binary.symlink_to(elsewhere)
    refusal(saved, "arrays.file: expected a file in the scene's folder", "a link out of it")


def test_a_file_of_arrays_is_not_read_unless_its_size_is_right(saved, monkeypatch):
    """A sparse file of 1 TiB."""
    os.truncate(arrays_of(saved), 1 << 40)
    refusal(saved, "arrays.bytes: expected ", f"found {1 << 40}")
    refusal(changed(saved, "arrays", "bytes", value=1 << 40), "arrays.bytes: expected a whole number from 0 to")


# Writing


@pytest.mark.parametrize("name", ["a", "a.jsn", "a.json.bin", "json", ".json"])
def test_endings_of_names(tmp_path, name):
    with pytest.raises(InputError, match=r"Scene\.to_json: path: expected a name ending in \.json, found "):
        full_scene().to_json(tmp_path / name)
    assert os.listdir(tmp_path) == []


def test_names_that_no_file_could_refer_to(tmp_path):
    for name in ("a\nb.json", "C:a.json", "a\\..\\b.json", "a\\b.json"):
        with pytest.raises(InputError, match=r"Scene\.to_json: path: expected a file in the scene's folder"):
            full_scene().to_json(tmp_path / name)
    assert os.listdir(tmp_path) == []
    with pytest.raises(InputError, match=r"Scene\.to_json: path: expected a path"):
        full_scene().to_json(None)  # type: ignore[arg-type]


def test_both_files_are_written_or_none(tmp_path):
    with pytest.raises(OutputError, match="there is no folder"):
        full_scene().to_json(tmp_path / "none" / "a.json")
    (tmp_path / "b.json").mkdir()
    with pytest.raises(OutputError, match="it is a folder"):
        full_scene().to_json(tmp_path / "b.json")
    assert os.listdir(tmp_path) == ["b.json"]


def test_earlier_files_are_replaced(tmp_path):
    full_scene().to_json(tmp_path / "a.json")
    full_scene().to_json(tmp_path / "a.json.json")  # a name that begins alike
    scene = seen_through()
    scene.to_json(tmp_path / "a.json")
    assert same(load(tmp_path / "a.json"), scene)
    assert same(load(tmp_path / "a.json.json"), full_scene())
    names = {path.name for file in ("a.json", "a.json.json") for path in (tmp_path / file, arrays_of(tmp_path / file))}
    assert set(os.listdir(tmp_path)) == names


KILLED = """
import os, signal, sys, clshade
place, calls = os.replace, []
def replaced(*names):
    calls.append(names)
    if len(calls) == int(sys.argv[2]):
        os.kill(os.getpid(), signal.SIGKILL)
    place(*names)
os.replace = replaced
clshade.builtin("icosphere", level=2).to_json(sys.argv[1])
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="processes are killed by signals")
@pytest.mark.parametrize("call", [1, 2])
def test_a_killed_process_leaves_the_earlier_scene(tmp_path, call):
    """Killed before the first or the second of two files is renamed."""
    path, earlier = tmp_path / "a.json", seen_through()
    earlier.to_json(path)
    done = python(KILLED, "", str(path), str(call))
    assert done.returncode == -signal.SIGKILL
    assert same(load(path), earlier)
    full_scene().to_json(path)
    assert same(load(path), full_scene())
    left = {name for name in os.listdir(tmp_path) if name.endswith(".bin")}
    assert left == {arrays_of(path).name}


def test_a_scene_replaced_twice_while_it_is_read(tmp_path, monkeypatch):
    """By another and by the same again: its JSON is what it was, the arrays were missing in between."""
    path = tmp_path / "a.json"
    first, second = (clshade.builtin("quads", count=count) for count in (20, 30))
    first.to_json(path)
    read, reads = scene_json.read_file, []

    def replacing(name, limit):
        data = read(name, limit)
        reads.append(name)
        if len(reads) == 1:
            second.to_json(path)
        return data

    def restoring(*arguments):
        arrays_path = beside(*arguments)
        if len(reads) == 1 and arguments[3] == "arrays.file":
            first.to_json(path)
        return arrays_path

    beside = scene_json.beside
    monkeypatch.setattr(scene_json, "read_file", replacing)
    monkeypatch.setattr(scene_json, "beside", restoring)
    assert same(load(path), first)


WRITING = """
import sys, clshade
scenes = [clshade.builtin("quads", count=count) for count in (20, int(sys.argv[2]))]
for k in range(40):
    scenes[k % 2].to_json(sys.argv[1])
"""


def test_several_processes_write_one_scene_file(tmp_path):
    """Whoever reads it meanwhile finds a whole scene."""
    path = tmp_path / "a.json"
    clshade.builtin("quads", count=20).to_json(path)
    writers = [started(WRITING, "", str(path), str(count)) for count in (30, 40, 30)]
    seen = set()
    while any(writer.poll() is None for writer in writers):
        seen.add(load(path).face_count)
    assert [writer.wait() for writer in writers] == [0, 0, 0]
    assert seen >= {load(path).face_count}
    assert seen <= {40, 60, 80}
    assert len([name for name in os.listdir(tmp_path) if name.endswith(".bin")]) == 1


@pytest.mark.parametrize(
    ("name", "message"),
    [("MAX_VALUES", "values and"), ("MAX_BYTES", "bytes beside"), ("MAX_BINARY_BYTES", "bytes of arrays")],
)
def test_limits_of_the_format(tmp_path, monkeypatch, name, message):
    monkeypatch.setattr(scene_json, name, 100)
    with pytest.raises(InputError, match=f"Scene.to_json: scene: expected at most .*100 {message}"):
        full_scene().to_json(tmp_path / "a.json")
    assert os.listdir(tmp_path) == []


def test_a_text_that_is_too_long(tmp_path):
    (tmp_path / "a.json").touch()
    os.truncate(tmp_path / "a.json", scene_json.MAX_BYTES + 1)
    refusal(tmp_path / "a.json", f"file: expected at most {scene_json.MAX_BYTES} bytes")
