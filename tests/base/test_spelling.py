"""Unknown names, on the command line and in Python: one line with the nearest valid one, or with what to do instead."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import assert_refused, listing, run
from scene_files import TRIANGLE, write

import clshade
from clshade.base.spelling import hint, nearest
from clshade.cli.main import COMMANDS, _parser
from clshade.errors import InputError
from clshade.images import exr
from clshade.pipeline.effective_settings import effective_settings
from clshade.pipeline.frame import Frame
from clshade.scene.builtin.scenes import BUILTINS, builtin
from clshade.scene.model import Settings

SCENE = builtin("quads", count=1)


def test_the_nearest_name():
    names = ("Z", "id", "N", "albedo", "object_id")
    words = {"depth": "Z", "world_position": "P"}
    assert nearest("z", names) == nearest(" Z ", names) == nearest("Depth", names, words) == "Z"
    assert nearest("objectid", names) == nearest("OBJECT-ID", names) == "object_id"
    assert nearest("abledo", names) == "albedo"
    assert nearest("world position", names, words) == nearest("World-Position", names, words) == ""  # P is not allowed
    assert nearest("", names) == nearest("velocity", names) == ""
    assert hint("z", names) == ": did you mean 'Z'?"
    assert hint("velocity", names) == hint(5, names) == hint(None, names) == ""
    assert hint("Rgb", names, remarks={"rgb": "that is there"}) == ": that is there"


USAGE = [
    (("render", "--shader", "Phong"), ("--shader", "'Phong': did you mean 'phong'?")),
    (("render", "--shader", "fong"), ("one of gouraud, phong, nolight", "did you mean 'phong'?")),
    (("render", "--up", "Z"), ("--up", "one of y, z, x, -y, -z, -x", "'Z': did you mean 'z'?")),
    (("render", "--tonemap", "ACES"), ("--tonemap", "did you mean 'aces'?")),
    (("render", "--layers", "z"), ("--layers", "'z': did you mean 'Z'?")),
    (("render", "--layers", "Z,depth"), ("--layers", "'depth': did you mean 'Z'?")),
    (("render", "--layers", "normal"), ("'normal': did you mean 'N'?",)),
    (("render", "--layers", "Position"), ("'Position': did you mean 'P'?",)),
    (("render", "--layers", "rgb"), ("'rgb': the image and its coverage are always there",)),
    (("render", "--layers", "flow"), ("'flow': optical flow leads to another image: clshade.flow",)),
    (("render", "--layers", "instance"), ("did you mean 'instance_id'?",)),
    (("render", "--layers", ""), ("--layers", "names of Z, id", "''")),
    (("render", "--components", "ambiant"), ("did you mean 'ambient'?",)),
    (("render", "--samples", "3.5"), ("--samples", "a whole number", "'3.5'")),
    (("render", "--exposure", "1ev"), ("--exposure", "a number", "'1ev'")),
    (("render", "--lights", "all"), ("--lights", "0,2", "all without this option", "'all'")),
    (("render", "--resolution", "64", "48"), ("--resolution", "800,600 or 800x600", "'64'")),
    (("render", "--resolution", "64x48x3"), ("--resolution", "'64x48x3'")),
    (("render", "--size", "64,48"), ("clshade render: ", "no option --size: did you mean --resolution?")),
    (("render", "--fov=30"), ("no option --fov: did you mean --camera-view-angle?",)),
    (("render", "--sampels", "4"), ("no option --sampels: did you mean --samples?",)),
    (("render", "-x"), ("clshade render: ", "no option -x")),
    (("render", "quads", "--layers", "Z", "N"), ("SCENE", "'N'", "commas between them")),
    (("render", "quads", "--flat", "tepot"), ("SCENE", "'tepot': did you mean 'teapot'?")),
    (("render", "tepot"), ("a file or one of", "'tepot': did you mean 'teapot'?")),
    (("render", "Teapot"), ("did you mean 'teapot'?",)),
    (("render", "image.exr"), ("image.exr: ", "'.exr', an image", "inspect", "-o")),
    (("render", "folder"), ("folder", "found a folder")),
    (("render", "none.blend"), ("none.blend", ".npy, .obj", "no such file", "'.blend'")),
    (("render", "quads", "--compression", "ZIP"), ("compression", "'ZIP': did you mean 'zip'?")),
    (("compare", "a.exr", "b.exr", "--treshold", "1"), ("clshade compare: ", "did you mean --threshold?")),
    (("compare", "a.exr", "b.exr", "--layers", "Z"), ("did you mean --layer?",)),
    (("compare", "a.exr", "b.exr", "c.exr"), ("clshade compare: ", "A and B alone", "'c.exr'")),
    (("inspect", "a.exr", "b.exr"), ("clshade inspect: ", "FILE|SCENE alone", "'b.exr'")),
    (("inspect", "mesh.txt"), ("mesh.txt", "an OpenEXR or PNG image")),
    (("inspect", "mesh.obj", "-o", "a.png"), ("--output: is for images, not for the scene mesh.obj",)),
    (("devices", "pocl"), ("clshade devices: ", "'pocl'")),
    (("rendr", "a.obj"), ("one of render, turntable", "'rendr': did you mean 'render'?")),
    (("diff", "a.exr", "b.exr"), ("did you mean 'compare'?",)),
    (("a.obj",), ("did you mean `clshade render a.obj`?",)),
    (("teapot",), ("did you mean `clshade render teapot`?",)),
    (("a.exr",), ("did you mean `clshade inspect a.exr`?",)),
    (("--resolution", "64,48", "render", "a.obj"), ("--resolution belongs after the command",)),
    (("-o", "out", "render"), ("-o belongs after the command",)),
    (("--colour",), ("clshade: there is no option --colour",)),
    (("help",), ("`clshade --help`",)),
    (("version",), ("`clshade --version`",)),
    (("--quiet",), ("COMMAND", "render", "`clshade --help`")),
    (("stability", "--case", "slver"), ("--case", "did you mean 'slivers'?")),
]


@pytest.mark.parametrize(("arguments", "parts"), USAGE, ids=[" ".join(arguments) for arguments, _ in USAGE])
def test_one_line_says_what_to_do(folder, capsys, arguments, parts):
    (folder / "folder").mkdir()
    write(folder / "mesh.obj", TRIANGLE)
    write(folder / "mesh.txt", TRIANGLE)
    exr.write("image.exr", np.zeros((2, 2, 3), np.float32))
    before = listing(folder)
    assert_refused(run(capsys, *arguments), *parts)
    assert listing(folder) == before


@pytest.mark.parametrize("text", ["64,48", "64x48", "64X48", "64 x 48", "64, 48", " 64×48"])
def test_resolutions(text):
    parsed = _parser(["render"]).parse_args(["render", "--resolution", text])
    assert parsed.resolution == (64, 48)


def test_scenes_before_and_after_options():
    parsed = _parser(["render"]).parse_args(["render", "a.obj", "--flat", "b.obj", "quads", "--quiet", "c.ply"])
    assert parsed.scenes == ["a.obj", "b.obj", "quads", "c.ply"]
    assert _parser(["render"]).parse_args(["render", "--flat"]).scenes == ["teapot"]


def test_the_version_has_a_short_option(capsys):
    assert run(capsys, "-V") == (0, f"clshade {clshade.__version__}\n", [])


def test_no_command_has_the_name_of_a_scene():
    assert not set(BUILTINS) & set(COMMANDS)


# Python


def frame_with(*layers: str) -> Frame:
    planes = {name: np.zeros((2, 3)) for name in layers}
    return Frame(np.zeros((2, 3, 4), np.float32), planes, SCENE, Settings(), dict)


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("z", ("layers= (Z)", "'z': did you mean 'Z'?")),
        ("depth", ("'depth': did you mean 'Z'?",)),
        ("normals", ("'normals': did you mean 'N'?",)),
        ("rgb", ("frame.rgba",)),
        ("alpha", ("frame.rgba",)),
        (0, ("found 0",)),
        (slice(0, 1), ("found slice(0, 1, None)",)),
        (np.zeros(3), ("found an array of shape (3,)",)),
    ],
)
def test_layers_of_a_frame(name, parts):
    with pytest.raises(InputError) as caught:
        frame_with("Z")[name]
    assert all(part in str(caught.value) for part in parts), caught.value


def test_a_frame_names_its_layers():
    frame = frame_with("Z", "id")
    assert "Z" in frame
    assert "N" not in frame
    assert list(frame) == ["Z", "id"]
    with pytest.raises(InputError, match=r"layers= \(none were\), found 'N'"):
        frame_with()["N"]


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda: effective_settings(SCENE, sampels=4), ("render: sampels: ", "no such field: did you mean 'samples'?")),
        (
            lambda: effective_settings(SCENE, settings=Settings(), sampels=4),
            ("render: sampels: ", "did you mean 'samples'?"),
        ),
        (lambda: effective_settings(SCENE, size=(4, 4)), ("render: size: ", "did you mean 'resolution'?")),
        (lambda: Settings.from_preset("standard", shaders="phong"), ("Settings: shaders: ", "did you mean 'shader'?")),
        (lambda: effective_settings(SCENE, shader="Phong"), ("Settings: shader: ", "did you mean 'phong'?")),
        (lambda: effective_settings(SCENE, layers="depth"), ("Settings: layers: ", "did you mean 'Z'?")),
        (lambda: effective_settings(SCENE, layers=("rgb",)), ("Settings: layers: ", "frame.rgba")),
        (lambda: clshade.render("bunny.obj"), ("render: scene: ", "clshade.load(path)", "'bunny.obj'")),
        (lambda: clshade.Renderer(SCENE.meshes[0]), ("render: scene: ", "<Mesh quads: ")),
        (
            lambda: effective_settings(SCENE, camera=SCENE.camera),
            ("render: camera: ", "a part of the scene, see dataclasses.replace"),
        ),
        (lambda: clshade.render(SCENE, device=0), ("render: device: ", "a name such as pocl or 0:0", "found 0")),
        (lambda: frame_with().save("a", tonemapp="aces"), ("Frame.save: tonemapp: ", "did you mean 'tonemap'?")),
        (lambda: frame_with().save("a", half="no"), ("Frame.save: half: expected True or False, found 'no'",)),
        (lambda: frame_with().save(None), ("Frame.save: path: expected a path (text), found None",)),
        (lambda: frame_with().save(b"a"), ("Frame.save: path: expected a path (text), found b'a'",)),
        (lambda: exr.read(None), ("exr.read: path: ", "found None")),
        (lambda: exr.write(5, np.zeros((2, 2, 3))), ("exr.write: path: ", "found 5")),
        (lambda: clshade.load(b"a.obj"), ("load: path: ", "found b'a.obj'")),
        (lambda: clshade.Mesh(np.zeros((3, 3)), [[0, 1, 2]], name=5), ("Mesh: name: expected a text, found 5",)),
        (lambda: clshade.Material(name=5), ("Material: name: ",)),
        (lambda: clshade.farm.draw_frames(SCENE, [SCENE.camera], "a.#"), ("draw_frames: cameras: ", "{1: camera}")),
        (lambda: clshade.farm.draw_frames(SCENE, {"a": SCENE.camera}, "a.#"), ("draw_frames: cameras: ",)),
        (
            lambda: clshade.farm.draw_frames(SCENE, {1: SCENE.camera}, "a.#", saving={"halve": True}),
            ("draw_frames: saving: halve: ", "did you mean 'half'?"),
        ),
        (lambda: builtin("Teapot"), ("builtin: name: ", "did you mean 'teapot'?")),
        (lambda: builtin("quads", cuont=3), ("builtin 'quads': cuont: ", "did you mean 'count'?")),
    ],
)
def test_keywords_and_values(call, parts):
    with pytest.raises(InputError) as caught:
        call()
    assert all(part in str(caught.value) for part in parts), caught.value
    assert "\n" not in str(caught.value)
