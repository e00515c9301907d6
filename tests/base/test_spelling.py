"""Unknown names, on the command line and in Python: one line with the nearest valid one, or with what to do instead."""

import numpy as np
import pytest
from command_line import assert_refused, listing, run
from scene_files import TRIANGLE, write

import clshade
from clshade.base.spelling import hint, nearest
from clshade.cli.main import COMMANDS, _parser
from clshade.errors import InputError
from clshade.farm import draw_frames
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
    assert nearest("OBJECT-ID", names) == "object_id"
    assert nearest("abledo", names) == "albedo"
    assert nearest("world position", names, words) == nearest("World-Position", names, words) == ""  # P is not allowed
    assert nearest("", names) == nearest("velocity", names) == ""
    assert hint("z", names) == ": did you mean 'Z'?"
    assert hint("velocity", names) == hint(5, names) == hint(None, names) == ""
    assert hint("Rgb", names, remarks={"rgb": "that is there"}) == ": that is there"


USAGE = [
    (("render", "--shader", "fong"), ("one of gouraud, phong, nolight", "did you mean 'phong'?")),
    (("render", "--layers", "rgb"), ("'rgb': the image and its coverage are always there",)),
    (("render", "--layers", "flow"), ("'flow': optical flow leads to another image: clshade.flow",)),
    (("render", "--lights", "all"), ("--lights", "0,2", "all without this option", "'all'")),
    (("render", "--resolution", "64", "48"), ("--resolution", "800,600 or 800x600", "'64'")),
    (("render", "--size", "64,48"), ("clshade render: ", "no option --size: did you mean --resolution?")),
    (("render", "quads", "--layers", "Z", "N"), ("SCENE", "'N'", "commas between them")),
    (("render", "tepot"), ("a file or one of", "'tepot': did you mean 'teapot'?")),
    (("render", "image.exr"), ("image.exr: ", "'.exr', an image", "inspect", "-o")),
    (("render", "none.blend"), ("none.blend", ".npy, .obj", "no such file", "'.blend'")),
    (("compare", "a.exr", "b.exr", "--layers", "Z"), ("did you mean --layer?",)),
    (("compare", "a.exr", "b.exr", "c.exr"), ("clshade compare: ", "A and B alone", "'c.exr'")),
    (("inspect", "mesh.txt"), ("mesh.txt", "an OpenEXR or PNG image")),
    (("inspect", "mesh.obj", "-o", "a.png"), ("--output: is for images, not for the scene mesh.obj",)),
    (("rendr", "a.obj"), ("one of render, turntable", "'rendr': did you mean 'render'?")),
    (("a.obj",), ("did you mean `clshade render a.obj`?",)),
    (("a.exr",), ("did you mean `clshade inspect a.exr`?",)),
    (("--resolution", "64,48", "render", "a.obj"), ("--resolution belongs after the command",)),
    (("help",), ("`clshade --help`",)),
    (("--quiet",), ("COMMAND", "render", "`clshade --help`")),
]


@pytest.mark.parametrize(("arguments", "parts"), USAGE, ids=[" ".join(arguments) for arguments, _ in USAGE])
def test_one_line_says_what_to_do(folder, capsys, arguments, parts):
    write(folder / "mesh.obj", TRIANGLE)
    write(folder / "mesh.txt", TRIANGLE)
    exr.write("image.exr", np.zeros((2, 2, 3), np.float32))
    before = listing(folder)
    assert_refused(run(capsys, *arguments), *parts)
    assert listing(folder) == before


def test_arguments_that_are_taken(capsys):
    for text in ("64,48", "64x48", "64X48", "64 x 48", " 64×48"):
        assert _parser(["render"]).parse_args(["render", "--resolution", text]).resolution == (64, 48)
    parsed = _parser(["render"]).parse_args(["render", "a.obj", "--flat", "b.obj", "quads", "--quiet", "c.ply"])
    assert parsed.scenes == ["a.obj", "b.obj", "quads", "c.ply"]
    assert _parser(["render"]).parse_args(["render", "--flat"]).scenes == ["teapot"]
    assert run(capsys, "-V") == (0, f"clshade {clshade.__version__}\n", [])
    assert not set(BUILTINS) & set(COMMANDS)


def frame_with(*layers: str) -> Frame:
    return Frame(np.zeros((2, 3, 4), np.float32), {name: np.zeros((2, 3)) for name in layers}, SCENE, Settings(), dict)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: frame_with("Z")["depth"], "layers= (Z), found 'depth': did you mean 'Z'?"),
        (lambda: frame_with("Z")["rgb"], "frame.rgba"),
        (lambda: frame_with("Z")[np.zeros(3)], "found an array of shape (3,)"),
        (lambda: effective_settings(SCENE, sampels=4), "render: sampels: expected one of shader, visibility, "),
        (lambda: effective_settings(SCENE, camera=SCENE.camera), "a part of the scene, see dataclasses.replace"),
        (lambda: Settings.from_preset("standard", shaders="phong"), "Settings: shaders: "),
        (lambda: clshade.render("bunny.obj"), "render: scene: expected a Scene, such as clshade.load(path)"),
        (lambda: clshade.render(SCENE, device=0), "render: device: expected a Device, a name such as pocl or 0:0"),
        (lambda: frame_with().save("a", tonemapp="aces"), "Frame.save: tonemapp: "),
        (lambda: exr.write(5, np.zeros((2, 2, 3))), "exr.write: path: expected a path (text), found 5"),
        (lambda: clshade.load(b"a.obj"), "load: path: expected a path (text), found b'a.obj'"),
        (lambda: draw_frames(SCENE, [SCENE.camera], "a.#"), "draw_frames: cameras: expected "),
        (lambda: draw_frames(SCENE, {1: SCENE.camera}, "a.#", saving={"halve": 1}), "draw_frames: saving: halve: "),
    ],
)
def test_keywords_and_values(call, message):
    with pytest.raises(InputError) as caught:
        call()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
