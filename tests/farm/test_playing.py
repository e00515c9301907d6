"""`animate` plays animations of glTF files: frames, films, workers, refusals."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused, needs_device, run
from mesh_writers import bar, triangle
from PIL import Image
from scene_files import same

from clshade.errors import InputError
from clshade.farm import draw_frames
from clshade.images import exr
from clshade.scene.description import digest_of
from clshade.scene.formats.load import load_animation
from clshade.view.film import _source

SMALL = ("--resolution", "48,32", "--preset", "course", "--deterministic", "--quiet")
VIEW = ("--camera-position", "0,1,6", "--camera-focal-point", "0,1,0")


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A current folder with a bar that bends by 90 degrees in three seconds, in its second animation."""
    monkeypatch.chdir(tmp_path)
    document = bar()
    times, half = np.float32([0, 3]), np.sqrt(0.5)
    document.animation((2, "scale", times, np.float32([[1, 1, 1], [2, 2, 2]]), "LINEAR"))
    document.animation((2, "rotation", times, np.float32([[0, 0, 0, 1], [0, 0, half, half]]), "LINEAR"), name="Bend")
    document.glb(tmp_path / "bar.glb")
    triangle().glb(tmp_path / "still.glb")
    return tmp_path


def assert_same(one: str, expected: str) -> None:
    assert same(*(exr.read(name)[0] for name in (one, expected)))


@pytest.mark.long
@needs_device
def test_flow_of_what_moves(folder, capsys):
    command = ("animate", "bar.glb", "--animation", "Bend", "--count", "3", *VIEW, *SMALL, "--shader", "nolight")
    assert run(capsys, *command, "--flow", "-o", "f.#.exr")[0] == 0
    files = [exr.read(f"f.{k}.exr")[0] for k in (1, 2, 3)]
    assert [("flow.X" in file, "flow_back.X" in file) for file in files] == [(True, False), (True, True), (False, True)]
    there, back = (np.stack([files[1][f"{name}.{k}"] for k in "XY"], axis=-1) for name in ("flow", "flow_back"))
    moved = np.abs(there).max(axis=-1) > 1e-4
    assert moved.sum() > 20
    assert np.array_equal(np.isfinite(there).all(axis=-1), files[1]["id"] > 0)
    assert ((there * back).sum(axis=-1) < 0.0)[moved].all()


@pytest.mark.long
@needs_device
def test_frames_are_what_render_draws_at_their_times(folder, capsys):
    # Lights of a scene without any depend on its size, which is that of all frames.
    look = (*VIEW, *SMALL, "--shader", "nolight", "--layers", "Z,N")
    played = ("animate", "bar.glb", "--animation", "Bend", "--count", "3", *look)
    assert run(capsys, *played, "-o", "f.#.exr")[0] == 0
    assert sorted(path.name for path in folder.glob("f.*.png")) == ["f.1.png", "f.2.png", "f.3.png"]
    for frame, time in ((1, 0), (2, 1), (3, 2)):
        assert run(capsys, "render", "bar.glb", "--animation", "Bend", "--time", time, *look, "-o", "still")[0] == 0
        assert_same(f"f.{frame}.exr", "still.exr")
    alphas = [exr.read(f"f.{frame}.exr")[0]["A"] for frame in (1, 2, 3)]
    assert all((one != later).any() for one, later in pairwise(alphas))
    assert run(capsys, *played, "--frames", "2", "-o", "g.#.exr")[0] == 2  # either a count or frames
    rate = ("animate", "bar.glb", "--animation", "1", "--fps", "1", *look)
    assert run(capsys, *rate, "--frames", "2", "-o", "g.#.exr")[0] == 0
    assert_same("f.2.exr", "g.2.exr")
    assert not (folder / "g.1.exr").exists()
    assert run(capsys, *played, "-o", "two.#.exr", "--workers", "2", "--frame-timeout", "500")[0] == 0
    assert all(Path(f"f.{k}.exr").read_bytes() == Path(f"two.{k}.exr").read_bytes() for k in (1, 2, 3))


@needs_device
def test_a_film_of_an_animation(folder, capsys):
    command = ("animate", "bar.glb", "--animation", "Bend", "--fps", "1", *SMALL, "-o", "bend.gif")
    assert run(capsys, *command, "--keep-frames")[0] == 0
    with Image.open("bend.gif") as film:
        assert (film.n_frames, film.size) == (3, (48, 32))
    frames = sorted(folder.glob("bend.gif.frames/*.exr"))
    before = [path.stat().st_mtime_ns for path in frames]
    assert len(before) == 3
    assert run(capsys, *command)[0] == 0  # the frames are there
    assert [path.stat().st_mtime_ns for path in frames] == before
    assert run(capsys, "animate", "bar.glb", "--animation", "0", *command[4:])[0] == 0  # others are of another film
    assert not set(before) & {path.stat().st_mtime_ns for path in frames}


def test_a_film_tells_poses_by_their_source(folder, capsys, monkeypatch):
    calls = []
    monkeypatch.setattr("clshade.cli.frames.draw", lambda *arguments: calls.append(arguments[3]) or 0)
    command = ("animate", "bar.glb", "--count", "3", *SMALL, "-o", "f.#.exr")
    for options in ((), (), ("--animation", "Bend"), ("--lights", "1"), ("--light-intensity", "2"), ("--flat",)):
        assert run(capsys, *command, *options)[0] == 0
    sources = [digest_of(_source(poses, {1: None})) for poses in calls]
    assert sources[0] == sources[1]
    assert len(set(sources)) == 5
    pairs = [{1: poses[1], 2: poses[2]} for poses in calls[2:4]]
    plain = [source for poses in pairs for frame in (1, 2) for source in _source(poses, {frame: None})]
    assert len(set(plain)) == 3  # the first pose changes nothing in either


@pytest.mark.long
@needs_device
def test_options_of_the_scene_hold_in_every_frame(folder, capsys):
    document = bar()
    document.animation((1, "translation", np.float32([0, 1]), np.float32([[0, 0, 0], [0, -4, 0]]), "LINEAR"))
    document.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "directional"}] * 2}}
    document.json["extensionsUsed"] = ["KHR_lights_punctual"]
    for light in range(2):
        index = document.add("nodes", {"extensions": {"KHR_lights_punctual": {"light": light}}})
        document.json["nodes"][0]["children"].append(index)
    document.glb(folder / "fall.glb")
    command = ("animate", "fall.glb", "--count", "2", "--lights", "1", "--components", "diffuse", *SMALL, "-o")
    assert run(capsys, *command, "f.#.exr")[0] == 0
    plain = exr.read("f.1.exr")[0]
    assert run(capsys, *command, "g.#.exr", "--light-intensity", "0.5", "--ground")[0] == 0
    inside = exr.read("f.1.exr")[0]["A"] == 1.0
    half = exr.read("g.1.exr")[0]
    assert inside.any()
    np.testing.assert_allclose(half["R"][inside], 0.5 * plain["R"][inside], rtol=1e-5)
    moved = [exr.read(f"g.{frame}.exr")[0]["R"] for frame in (1, 2)]
    assert (moved[0] != moved[1]).any()


def test_what_is_said(folder, capsys, monkeypatch):
    calls = []
    monkeypatch.setattr("clshade.cli.frames.draw", lambda *arguments: calls.append(arguments) or 0)
    told = ["clshade: bar.glb: animation 0, 3 s: frames 1..90"]
    assert run(capsys, "animate", "bar.glb", "--fps", "30000/1001")[::2] == (0, told)
    _, scene, cameras, poses = calls[0]
    assert (len(scene.meshes), len(cameras), len(poses), list(poses) == list(cameras)) == (2, 90, 90, True)
    assert scene.meshes[-1].material.texture is None  # no contact shadow below what moves
    assert 1 in poses
    assert 91 not in poses
    with pytest.raises(KeyError):
        poses[91]


def test_animations_are_listed(folder, capsys):
    _, out, _ = run(capsys, "inspect", "bar.glb")
    words = [" ".join(line.split()) for line in out.splitlines()][-4:-1]
    assert words == ["animation number seconds", "unnamed 0 3", "Bend 1 3"]
    listed = json.loads(run(capsys, "inspect", "bar.glb", "--json")[1])["animations"]
    assert listed == [{"name": name, "seconds": 3.0} for name in ("", "Bend")]
    assert "animation" not in run(capsys, "inspect", "still.glb")[1]


@needs_device
def test_a_pose_is_offered_once(folder, capsys):
    drawn = ("render", "bar.glb", "--resolution", "48,32", "--preset", "course")
    _, _, err = run(capsys, *drawn)
    assert [line for line in err if "at rest" in line] == [
        "clshade: bar.glb: at rest: --time SECONDS shows a pose of its animations (number 0, Bend), `clshade animate` "
        "plays one"
    ]
    assert not any("at rest" in line for line in run(capsys, *drawn, "--animation", "Bend")[2])


@pytest.mark.parametrize(("arguments", "parts"), [
    (("still.glb",), ("still.glb: animations: expected an animation to show, found none",)),
    (("teapot",), ("CAMERAS.json: a file of cameras is missing, and teapot has no animation to play",)),
    (("bar.glb", "--animation", "bend"), ("bar.glb: animation: expected one of Bend", "did you mean 'Bend'?")),
    (("bar.glb", "--time", "1"), ("--time: cannot go with an animation that is played",)),
    (("bar.glb", "--focal", "1"), ("--focal: cannot go with an animation that is played",)),
    (("bar.glb", "--fps", "0"), ("--fps: expected a number above 0", "'0'")),
    (("bar.glb", "--fps", "1/0"), ("--fps: expected a number above 0", "'1/0'")),
    (("bar.glb", "--count", "0"), ("count: expected a whole number from 1 to 1000000, found 0",)),
    (("bar.glb", "--count", "4", "--frames", "2"), ("--frames", "not allowed with", "--count")),
    (("bar.glb", "--frames", "90..91"), ("--frames: 90..91 goes beyond the frames of the animation, 1..90",)),
    (("bar.glb", "c.json", "--count", "4"), ("--count: is for the animation of a glTF file",)),
    (("bar.glb", "--bit-depth", "10"), ("--bit-depth: needs a film as --output",)),
    (("render", "teapot", "--time", "1"), ("--time: needs a scene file, not the built-in scene 'teapot'",)),
    (("render", "still.glb", "--animation", "x"), ("still.glb: animations: expected an animation to show",)),
])  # fmt: skip
def test_refused_command_lines(folder, capsys, arguments, parts):
    (folder / "c.json").write_text(json.dumps([{}, {}]))
    command = arguments if arguments[0] == "render" else ("animate", *arguments)
    assert_refused(run(capsys, *command, *SMALL), *parts)
    assert not list(folder.glob("out*"))


def test_each_frame_has_a_pose(folder):
    played = load_animation("bar.glb", count=2)
    for poses in ({1: played.poses[1]}, [1, 2], 5):
        with pytest.raises(InputError, match="draw_frames: poses: expected a pose for the number of each camera"):
            draw_frames(played.scene, played.cameras, "f.#.exr", poses=poses, progress=False)
