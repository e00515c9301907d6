"""Command lines that are refused: exit code 2, one line on standard error, and no file is made or changed."""

import os
import shlex
import sys

import numpy as np
import pytest
from command_line import SMALL, assert_refused, listing, needs_device, run
from mesh_writers import triangle
from scene_files import DATA, ROOF, course_dict, save_npy, write

import clshade
from clshade.cli import render
from clshade.images import exr
from clshade.measure.bench import bench
from clshade.measure.report import report

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
    ("render a.glb --no-weld", "weld", "only for .obj and .ply"),
    ("render a.obj --crease 200", "crease", "degrees from 0 to 180", "200"),
    ("render a.obj --crease 3 --flat", "--crease", "--flat"),
    ("render a.obj --up", "--up", "expected one argument"),
    ("render a.npy --crease 30", "crease", "only for .obj, "),
    ("render teapot --flat", "--flat", "'teapot'"),
    (f"{HEAT} --colormap jett", "found 'jett': did you mean 'jet'"),
    (f"{HEAT} --clim 2,1", "low not above high, found (2.0, 1.0)"),
    (f"{HEAT} --nan-color x", "--nan-color: expected a name such as white"),
    ("render quads -o out --edge-width 3", "--edge-width: needs --edges"),
    ("render quads --edges all --edge-color 0,0,-1", "--edge-color: expected a name such as white, #rrggbb"),
    ("render teapot --environment none.hdr", "none.hdr: file: expected an existing file"),
    ("render teapot --environment studio --environment-rotation nan", "--environment-rotation: expected"),
    ("render teapot --environment none --environment-rotation 9", "--environment-rotation: needs --environment"),
    ("render a.glb --light-intensity 2", "--light-intensity: expected lights to multiply, found none: the environment"),
    ("render a.obj --camera file", "--camera: expected a file that has one, found none in "),
    ("render icosphere --camera file", "--camera: file needs a scene file"),
    ("render a.obj --look studio --edges all --ground", "--ground: cannot go with --edges"),
    ("render a.obj --look studio --preset pbr", "--look: studio cannot go with --preset, which it chooses"),
    ("render quads --save-scene a.jsn", f"{OTHER_NAME}, found a.jsn"),
    ("render quads --save-scene 'a\nb.json'", "render: --save-scene: expected a file in the scene's folder, found "),
    ("render quads teapot --save-scene a.json", "--save-scene: is for one scene, not for 2"),
    ("render quads --save-scene folder.json", "folder.json: cannot be written: it is a folder"),
    ("render quads --sheet -o s --save-scene s.json", "--save-scene: s.json is the file of the facts of --sheet"),
    ("render a.json --save-scene a.json -o b", " is read: choose another file"),
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

# Frames, sheets, posters and pages
VIEWS = [
    ("turntable --frames 9..3", "--frames", "'9..3'", "not before the first"),
    ("turntable -o out.exr", "--output", "'out.exr'", "out.####.exr"),
    ("turntable --workers 0", "workers", "0"),
    ("turntable --workers 2 --scheduler tcp://host:1", "not allowed with"),
    ("turntable --count 3 --frames 3", "--count", "not allowed with"),
    ("turntable --frame-timeout 3", "--frame-timeout", "two --workers or more", "--scheduler"),
    ("turntable --workers 2 --frame-timeout inf", "--frame-timeout", "seconds above 0", "'inf'"),
    ("turntable --device no-such", "frame 1", "no OpenCL device matches 'no-such'"),
    ("animate icosphere", "CAMERAS.json"),
    ("animate icosphere cameras.json --frames 0", "--frames", "1..2"),
    ("animate icosphere bad.json", "bad.json", "camera 1", "'focl'", "did you mean 'focal'?"),
    (f"{QUADS} --views font", "--views", "did you mean 'front'"),
    (f"{QUADS} --crop-zoom 1,2,3", "--crop-zoom", "X,Y,W,H", "'1,2,3'"),
    (f"{QUADS} --crop-zoom 1,2,32,3", "--crop-zoom", "within 32 x 24 pixels", "1,2,32,3"),
    (f"{QUADS} --sheet --crop-zoom 1,2,4,3", "--crop-zoom", "--sheet"),
    (f"{QUADS} --sheet --compression zips", "--compression", "--sheet"),
    (f"{QUADS} --fixed-lights", "--fixed-lights", "--views or --sheet"),
    (f"{QUADS} --sheet -o none/s", "none/s.png", "there is no folder"),
    (f"{QUADS} --crop-zoom 1,2,4,3 -o marked", "marked_crop.png", "it is a folder"),
    ("poster icosphere --quiet", "--resolution", "found none"),
    ("poster icosphere --quiet --resolution 200000x5", "resolution N", "200000"),
    ("poster icosphere --quiet --resolution 90x70 --formats depth", "files", "exr, png or both", "depth"),
    ("view image.exr scene.xyz", "scene.xyz", "expected an OpenEXR or PNG image"),
    ("view image.exr -o link.html", "--output", "is read: choose another file"),
    ("view image.exr --exposure nan", "exposure", "nan"),
    ("view image.exr --tonemap film", "tonemap", "expected one of none, srgb", "film"),
]

# Reports, measurements and judges
MEASURES = [
    ("bench object-1024", "workload", "'object-1024'", "did you mean 'object-"),
    ("bench quads --samples 4", "--samples", "'quads'", "workload"),
    ("bench --against lvmpipe", "--against", "'lvmpipe'", "'llvmpipe'"),
    ("bench -o file/x", "file", "not a folder"),
    ("conform --only operation", "--only", "did you mean 'operations'?"),
    ("conform --device none_such", "'none_such'"),
    ("grade file course --html x.html", "--html"),
    ("grade --list x.png", "IMAGE: expected none with --list, found 'x.png'"),
    ("grade x.png course --look studio", "--look: the right image is drawn as --preset says"),
    ("render --check 1e4", "expected a number of pixels or all"),
    ("report icosphere --only guro", "--only", "standard", "'guro'"),
    ("report icosphere --format png,gif", "--format", "png, pdf, svg", "'gif'"),
    ("report icosphere --out figure.pdf", "--out", "expected a folder", "--format pdf"),
    ("report icosphere --budget -3", "--budget", "'-3'"),
    ("report icosphere --budget 5ms --tolerance 1e-3", "--tolerance", "not allowed with", "--budget"),
    ("report icosphere --out file/x", "file/x", "--out"),
    ("report icosphere --out full", "report.json"),
    ("report teapot --course", "--course: expected a course scene"),
    ("report course --course -o a.pdf", "a browser prints the page as PDF"),
    ("report course --course -o no/a.html", "there is no folder"),
    ("report course --course --no-shadows", "--no-shadows: cannot go with --course"),
    ("stability --case nothing", "--case: expected names or numbers of shared-edges", "'nothing'"),
    ("stability --case 6 --format pdf", "--format", "--case"),
    ("stability --case 6 --out file/x", "file/x", "--out"),
    ("stability no_such_scene", "SCENE: expected a file or one of teapot", "'no_such_scene'"),
    ("stability --samples 4", "--samples: needs a SCENE"),
]


@pytest.fixture
def refuse(folder, capsys):
    """Return a function that asserts how a command line is refused, in a folder with files of each kind."""
    for name in ("folder.obj", "folder.json", "taken.exr", "taken2.png", "marked_crop.png", "full/report.json"):
        (folder / name).mkdir(parents=True)
    texts = {"scene.xyz": "what is this", "text.npy": "not NumPy's", "a.obj": ROOF, "a.ply": DATA, "text.exr": "text"}
    texts |= dict.fromkeys(("empty.obj", "file"), "") | dict.fromkeys(("out.exr", "out.png", "out.0001.exr"), "earlier")
    texts |= {"cameras.json": "[{}, {}]", "bad.json": '[{"focl": 2}]'}
    for name, text in texts.items():
        write(folder / name, text)
    save_npy(folder / "a.npy", course_dict())
    triangle().glb(folder / "a.glb")
    clshade.builtin("quads", count=1).to_json(folder / "a.json")
    exr.write(folder / "image.exr", {name: np.ones((2, 3)) for name in "RGB"})
    (folder / "link.html").hardlink_to(folder / "image.exr")

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
@commands([*FILES, *VIEWS])
def test_refused_files(refuse, row):
    refuse(*row)


@needs_device
@commands(MEASURES)
def test_nothing_is_measured(refuse, monkeypatch, row):
    for module, name in ((report, "study"), (bench, "measure")):
        monkeypatch.setattr(module, name, lambda *arguments: pytest.fail("something was measured"))
    refuse(*row)


def test_a_missing_package_is_named(refuse, monkeypatch):
    monkeypatch.setitem(sys.modules, "mmh3", None)
    refuse(f"render {ROOM} --cryptomatte --quiet", "mmh3", "pip install")
