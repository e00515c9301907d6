"""Scene files of clshade's own: every field comes back bit for bit, and everything else is refused in one line."""

import dataclasses
import hashlib
import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from every_light import EVERY, default_of
from mapped_scenes import mapped, normal_image
from mesh_writers import REMOVED, change
from processes import python
from scene_files import refusal, same, write

import clshade
from clshade import Camera, Environment, Material, Mesh, MetallicRoughness, PointLight, Scene, Texture
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
    """Return a scene in which every field of every class has another value than its default; the up of its environment
    would change if it were normalized twice."""
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
    around = Environment(np.arange(24, dtype=np.float32).reshape(2, 4, 3), 33.3, 0.5, (0.3, 0.9, -0.2), "sky")
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


def test_the_same_scene_gives_the_same_bytes(tmp_path):
    for name in ("a.json", "b.json"):
        full_scene().to_json(tmp_path / name)
    load(tmp_path / "a.json").to_json(tmp_path / "c.json")
    texts = [(tmp_path / f"{name}.json").read_text().replace(f"{name}.json", "x") for name in "abc"]
    binaries = [arrays_of(tmp_path / f"{name}.json").read_bytes() for name in "abc"]
    assert len(set(texts)) == len(set(binaries)) == 1
    assert "Löwe" in texts[0]
    assert max(map(len, texts[0].splitlines())) < 120 < len(texts[0].splitlines())
    assert not texts[0].endswith("\n\n")


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


def test_options_of_loading(tmp_path):
    scene = full_scene()
    path = tmp_path / "a.json"
    scene.to_json(path)
    assert same(load(path, resolution=(7, 5)).camera, scene.camera.with_resolution((7, 5)))
    assert same(load(path, lights=[2, 0]).lights, (scene.lights[2], scene.lights[0]))
    assert all(mesh.material.two_sided for mesh in load(path, two_sided=True).meshes)
    assert load(path, fit=True).camera.resolution == scene.camera.resolution


# Refusals

MESH = ("scene", "meshes", 0)
WIDE = {"type": "float64", "shape": [0, (1 << 30) - 1, (1 << 30) - 1], "offset": 0}


def changed(path, *keys: Any, value: Any) -> str:
    document = json.loads(path.read_text())
    change(document, keys, value)
    return write(path, json.dumps(document))


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


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (("format",), "other", "format: expected 'clshade scene', found other"),
        (("version",), 2, "version: expected 1, found 2"),
        (("matrials",), [], "keys: expected one of format, version, scene, textures, materials, arrays, found"),
        (("scene",), REMOVED, "scene: expected this key, found none"),
        (("scene", "camra"), 1, "found 'camra': did you mean 'camera'?"),
        (("scene", "camera", "eye"), [1, 2], "scene.camera: Camera: eye: expected three finite numbers"),
        ((*MESH, "verts"), WIDE, "verts: expected an array of shape (K, 3)"),
        ((*MESH, "verts"), [[[[[1]]]]], "scene.meshes[0].verts: expected at most 4 lists in each other, found more"),
        ((*MESH, "material"), -1, "scene.meshes[0].material: expected an index of the 2 materials"),
        (("scene", "lights", 1, "kind"), "SunLight", "found SunLight: did you mean"),
        (("scene", "lights", 1, "radius"), 1, "scene.lights[1]: expected one of direction, intensity, found 'radius'"),
        (("materials", 0, "texture"), "x", "materials[0].texture: expected an index of the 6 textures, from 0"),
        ((*MESH, "faces", "type"), "float16", "faces.type: expected one of float32, float64, int32, found float16"),
        ((*MESH, "faces", "shape"), [], "scene.meshes[0].faces: expected 1 to 3 dimensions"),
        ((*MESH, "faces", "shape"), [1 << 29, 1 << 29], "scene.meshes[0].faces: expected 1 to 3 dimensions"),
        ((*MESH, "faces", "offset"), 2, "scene.meshes[0].faces: expected 1 to 3 dimensions of whole values within"),
        (("arrays", "bytes"), 1 << 40, "arrays.bytes: expected a whole number from 0 to 34359738368, found 1"),
        (("arrays", "bytes"), 8, "arrays.bytes: expected 8 bytes in 'a.json."),
        (("arrays", "file"), "no.bin", "arrays.file: expected an existing file, found no file 'no.bin'"),
        (("arrays", "file"), "/etc/passwd", "arrays.file: expected a file in the scene's folder (no absolute path"),
    ],
)
def test_what_is_refused(saved, keys, value, message):
    refusal(changed(saved, *keys, value=value), "a.json: ", message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2]", "format: expected 'clshade scene', found 2 values"),
        ("{", "JSON: expected a scene file, found "),
        (MINIMAL.replace("0.6", "NaN"), "JSON: expected a scene file, found 'a number that is NaN'"),
        (MINIMAL.replace("0.6", "9" * 400), "scene.camera: Camera: plane H: expected a finite number above 0"),
        (MINIMAL.replace('"scene"', '"version": 1, "scene"'), "found 'the key version twice'"),
        ("[" * 100_000, "JSON: expected a scene file, found too deep a nesting"),
        (b"\xff", "JSON: expected UTF-8 text"),
    ],
)
def test_texts_that_are_no_scene(tmp_path, text, message):
    refusal(write(tmp_path / "a.json", text), "a.json: ", message)


def test_another_file_of_arrays_is_refused(saved):
    binary = arrays_of(saved)
    data = bytearray(binary.read_bytes())
    data[-1] ^= 1
    binary.write_bytes(data)
    refusal(saved, "arrays.sha256: expected '", hashlib.sha256(data).hexdigest())
    os.truncate(binary, 1 << 40)  # a sparse file, which is not read
    refusal(saved, "arrays.bytes: expected ", f"found {1 << 40}")


# Writing


def test_names_that_are_refused(folder):
    for name, expected in (
        *((name, r"a name ending in \.json, found") for name in ("a", "a.jsn", "a.json.bin", ".json")),
        *((name, "a file in the scene's folder") for name in ("a\nb.json", "C:a.json", "a\\..\\b.json")),
        (None, "a path"),
    ):
        with pytest.raises(InputError, match=rf"Scene\.to_json: path: expected {expected}"):
            full_scene().to_json(name)
    assert os.listdir() == []


def test_both_files_are_written_or_none(tmp_path):
    with pytest.raises(OutputError, match="there is no folder"):
        full_scene().to_json(tmp_path / "none" / "a.json")
    (tmp_path / "b.json").mkdir()
    with pytest.raises(OutputError, match="it is a folder"):
        full_scene().to_json(tmp_path / "b.json")
    assert os.listdir(tmp_path) == ["b.json"]


KILLED = """
import os, signal, sys, clshade
place, calls = os.replace, []
def replaced(*names):
    calls.append(names)
    if len(calls) == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    place(*names)
os.replace = replaced
clshade.builtin("icosphere", level=2).to_json(sys.argv[1])
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="processes are killed by signals")
def test_a_killed_process_leaves_the_earlier_scene_and_the_next_one_no_other_file(tmp_path):
    """Killed before the second of two files is renamed."""
    path, other = tmp_path / "a.json", tmp_path / "a.json.json"  # a name that begins alike
    for file in (path, other):
        clshade.builtin("quads", count=20).to_json(file)
    assert python(KILLED, "", str(path)).returncode == -signal.SIGKILL
    assert same(load(path), clshade.builtin("quads", count=20))
    full_scene().to_json(path)
    assert same(load(path), full_scene())
    assert same(load(other).meshes, clshade.builtin("quads", count=20).meshes)
    left = {name for name in os.listdir(tmp_path) if name.endswith(".bin")}
    assert left == {arrays_of(path).name, arrays_of(other).name}


@pytest.mark.parametrize(
    ("name", "message"),
    [("MAX_VALUES", "values and"), ("MAX_BYTES", "bytes beside"), ("MAX_BINARY_BYTES", "bytes of arrays")],
)
def test_limits_of_the_format(tmp_path, monkeypatch, name, message):
    monkeypatch.setattr(scene_json, name, 100)
    with pytest.raises(InputError, match=f"Scene.to_json: scene: expected at most .*100 {message}"):
        full_scene().to_json(tmp_path / "a.json")
    assert os.listdir(tmp_path) == []
