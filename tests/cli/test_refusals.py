"""Command lines that are refused: exit code 2, one line on standard error, and no file is made or changed."""

from __future__ import annotations

import os
import shlex

import pytest
from command_line import SMALL, assert_refused, listing, needs_device, run
from mesh_writers import triangle
from scene_files import DATA, ROOF, course_dict, save_npy, write

import clshade
from clshade.cli import render

QUADS = shlex.join(SMALL)
ROOM = "box_room --resolution 40x30 --samples 2"
HEAT = "render a.ply -o out --scalars heat"

OTHER_NAME = "--save-scene: expected a file name that ends in .json or .glb"
TURN = f"turntable{QUADS.removeprefix('render')} --count 2"

# Command line, parts of its message
REFUSED = [
    ("", "COMMAND"),
    ("inspect", "FILE"),
    ("render --help light", "expected one of all, scene, lights, camera,", "did you mean 'lights'?"),
    ("render --resolution 10,x", "--resolution", "'10,x'"),
    ("render no_such_file.obj", "no_such_file.obj"),
    ("render scene.xyz", "scene.xyz", "extension", ".npy", ".obj"),
    ("render text.npy", "text.npy"),
    ("render folder.obj", "folder.obj"),
    ("render quads --resolution 0,10", "resolution", "0"),
    ("render quads --texture x.png", "--texture", "quads"),
    ("render quads -o missing/out", "missing/out", "missing"),
    ("render quads --device 'no such platform'", "no such platform"),
    ("render quads box_room -o file/new", "file/new", "cannot be"),
    # Meshes
    ("render a.glb --no-weld", "weld", "only for .obj and .ply"),
    ("render a.obj --crease 200", "crease", "degrees from 0 to 180", "200"),
    ("render a.obj --crease 3 --flat", "--crease", "--flat"),
    ("render a.obj --up", "--up", "expected one argument"),
    ("render a.npy --crease 30", "crease", "only for .obj, "),
    ("render teapot --flat", "--flat", "'teapot'"),
    # Scalars
    (f"{HEAT} --colormap jett", "found 'jett': did you mean 'jet'"),
    (f"{HEAT} --clim 2,1", "low not above high, found (2.0, 1.0)"),
    (f"{HEAT} --nan-color x", "--nan-color: expected a name such as white"),
    # Edges
    ("render quads -o out --edge-width 3", "--edge-width: needs --edges"),
    ("render quads --edges all --edge-color 0,0,-1", "--edge-color: expected a name such as white, #rrggbb"),
    # Environments
    ("render teapot --environment none.hdr", "none.hdr: file: expected an existing file"),
    ("render teapot --environment studio --environment-rotation nan", "--environment-rotation: expected"),
    ("render teapot --environment none --environment-rotation 9", "--environment-rotation: needs --environment"),
    ("render a.glb --light-intensity 2", "--light-intensity: expected lights to multiply, found none: the environment"),
    ("render a.obj --camera file", "--camera: expected a file that has one, found none in "),
    ("render icosphere --camera file", "--camera: file needs a scene file"),
    # Looks
    ("render a.obj --look studio --edges all --ground", "--ground: cannot go with --edges"),
    ("render a.obj --look studio --preset pbr", "--look: studio cannot go with --preset, which it chooses"),
    # Saved scenes
    ("render quads --save-scene a.jsn", f"{OTHER_NAME}, found a.jsn"),
    ("render quads --save-scene 'a\nb.json'", "render: --save-scene: expected a file in the scene's folder, found "),
    ("render quads teapot --save-scene a.json", "--save-scene: is for one scene, not for 2"),
    ("render quads --save-scene folder.json", "folder.json: cannot be written: it is a folder"),
    ("render quads --sheet -o s --save-scene s.json", "--save-scene: s.json is the file of the facts of --sheet"),
    ("render a.json --save-scene a.json -o b", " is read: choose another file"),
    # Verifying
    ("verify text.exr", "text.exr", "file: expected"),
    ("verify none.exr --all --pixels 3", "not allowed with"),
]

OUTPUTS = [
    ("--compression lzma", "compression", "lzma", "zip"),
    ("--exposure nan", "exposure", "nan"),
    ("-o .", "a file name", "'.'"),
    ("-o -", "image.exr and image.png", "'-'"),
    ("-o missing/out", "missing/out.exr", "there is no folder"),
    (f"-o {'n' * 256}", "nnn.exr", "too long"),
    ("-o file/out", "file/out.exr", "not a folder"),
    ("-o taken", "taken.exr"),
    ("-o taken2", "taken2.png"),
]

FILES = [
    # Masks, before they are drawn
    (f"render {ROOM} --cryptomatte objects --quiet", "--cryptomatte", "object, material, instance", "'objects'"),
    (f"render {ROOM} --cryptomatte --formats png --quiet", "files", "exr among them", "png"),
    (f"turntable {ROOM} --cryptomatte --formats png --quiet", "files", "exr among them", "png"),
    (f"turntable {ROOM} --cryptomatte -o film.gif --quiet", "--cryptomatte", "frames as --output", "film.gif"),
    (f"{QUADS} --formats exr,pgn", "--formats", "exr, png, npz, depth", "did you mean 'png'?"),
    (f"{QUADS} --depth-scale 0.01", "--depth-scale: needs --formats depth"),
    (f"{QUADS} --formats depth,exr --depth-scale 1e-6", "depth_scale: expected ", " or more, as 65535 steps"),
    (f"{QUADS} --formats npz --sheet", "--formats: cannot go with --sheet"),
    (f"{QUADS} --formats png --flow-to c.json", "--flow-to: needs exr or npz in --formats", "not png"),
    (f"{TURN} --formats png,depth --flow", "flow: needs exr or npz among the files, which hold it"),
    (f"{QUADS} --stereo 0", "Camera.stereo: baseline: expected a finite number above 0, found 0"),
    (f"{QUADS} --stereo 1 --convergence -3", "convergence: expected a finite number above 0, found -3"),
    (f"{QUADS} --stereo 1 --views front", "--stereo: cannot go with --views"),
    (f"{QUADS} --stereo 1 --orthographic", "expected a perspective camera, found an orthographic one"),
    (f"{TURN} --formats npz -o a.mp4", "--formats: cannot go with a film, a.mp4"),
    (f"{TURN} --save-cameras out.0001.exr/c.json", "out.0001.exr", "is not a folder"),
    (f"{TURN} --formats depth --depth-scale 1e-6 -o new/#.exr", "frame 1: ", "65535 steps"),
]


@pytest.fixture
def refuse(folder, capsys):
    """Return a function that asserts how a command line is refused, in a folder with files of each kind."""
    for name in ("folder.obj", "folder.json", "taken.exr", "taken2.png"):
        (folder / name).mkdir()
    texts = {"scene.xyz": "what is this", "text.npy": "not NumPy's", "a.obj": ROOF, "a.ply": DATA, "text.exr": "text"}
    texts |= dict.fromkeys(("empty.obj", "file"), "") | dict.fromkeys(("out.exr", "out.png", "out.0001.exr"), "earlier")
    for name, text in texts.items():
        write(folder / name, text)
    save_npy(folder / "a.npy", course_dict())
    triangle().glb(folder / "a.glb")
    clshade.builtin("quads", count=1).to_json(folder / "a.json")

    def contents():
        return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}

    def check(command, *parts):
        before = contents()
        assert_refused(run(capsys, *shlex.split(command)), *parts)
        assert contents() == before

    return check


def commands(rows):
    return pytest.mark.parametrize("row", rows, ids=[row[0] for row in rows])


@commands(REFUSED)
def test_refused(refuse, row):
    refuse(*row)


@pytest.fixture
def no_loading(monkeypatch):
    """Fail if a scene is loaded: outputs that cannot be saved are refused before."""
    monkeypatch.setattr(render, "load_scene", lambda *arguments: pytest.fail("a scene was loaded"))


@pytest.mark.usefixtures("no_loading")
@commands(OUTPUTS)
def test_outputs_are_refused_before_a_scene_is_loaded(refuse, row):
    refuse(f"{QUADS} -o out {row[0]}", *row[1:])


@pytest.mark.usefixtures("no_loading")
@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(tmp_path, capsys):
    tmp_path.chmod(0o500)
    try:
        assert_refused(run(capsys, *SMALL, "-o", tmp_path / "out"), "out")
        assert listing(tmp_path) == []
    finally:
        tmp_path.chmod(0o700)


@needs_device
@commands(FILES)
def test_refused_files(refuse, row):
    refuse(*row)


def test_a_missing_package_is_named(refuse, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "mmh3", None)
    refuse(f"render {ROOM} --cryptomatte --quiet", "mmh3", "pip install")
