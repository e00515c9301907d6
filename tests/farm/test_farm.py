"""Frames of a turn or of a file's cameras: numbers, file names, cameras, and refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from devices import working_devices

from clshade.cli.main import main
from clshade.errors import InputError
from clshade.farm import Run, draw_frames
from clshade.farm.camera_files import FIELDS, read_cameras
from clshade.farm.frames import orbit, parse_frames, parse_pattern, pattern_of_eye
from clshade.images import exr
from clshade.pipeline.flow import flow
from clshade.pipeline.frame_results import RECORD, SEAL
from clshade.pipeline.renderer import render
from clshade.pipeline.visible import visible
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera

SMALL = ("--resolution", "32,24", "--preset", "course", "--deterministic")
BASE = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.5), (30, 20))

needs_device = pytest.mark.skipif(not working_devices(), reason="no OpenCL device works here")


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Run a command line; return exit code, standard output and standard error."""
    capsys.readouterr()
    code = main([str(argument) for argument in arguments])
    return code, *capsys.readouterr()


def assert_refused(outcome: tuple[int, str, str], *parts: str) -> None:
    code, out, err = outcome
    assert (code, out, len(err.splitlines())) == (2, "", 1), outcome
    assert all(part in err for part in parts), err


# Numbers and names


@pytest.mark.parametrize(
    ("text", "numbers", "ends"),
    [
        ("5", [5], (5, 5)),
        ("3..6", [3, 4, 5, 6], (3, 6)),
        ("1..10..4", [1, 5, 9], (1, 10)),
        ("7,1..3, 2", [1, 2, 3, 7], (1, 7)),
        ("007..8", [7, 8], (7, 8)),
        ("0", [0], (0, 0)),
    ],
)
def test_frames(text, numbers, ends):
    frames = parse_frames(text)
    assert (list(frames.numbers), (frames.first, frames.last)) == (numbers, ends)
    assert frames.span == ends[1] - ends[0] + 1


@pytest.mark.parametrize(
    "text", ["", "a", "1-5", "1...5", "5..1", "1..5..0", "-3..3", "1..", "1,,2", "1..1000000000", "9" * 40, "1.5", "²"]
)
def test_refused_frames(text):
    with pytest.raises(InputError, match=r"^--frames: expected "):
        parse_frames(text)


@pytest.mark.parametrize(
    ("text", "number", "stem"),
    [
        ("out.####.exr", 7, "out.0007"),
        ("a/b_##", 123, "a/b_123"),
        ("###.png", 0, "000"),
        ("v1.2.#.exr", 10, "v1.2.10"),
        ("take#3/out.##.exr", 4, "take#3/out.04"),
        ("/a/#", 4, "/a/4"),
        ("a.exr.#.PNG", 4, "a.exr.4"),
        ("single.exr", 9, "single"),
    ],
)
def test_file_names(text, number, stem):
    assert parse_pattern(text, 1).names(number) == (f"{stem}.exr", f"{stem}.png")


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("out.####.exr", "out.left.####.exr"),
        ("a/b_##", "a/b.left_##"),
        ("out###.npz", "out.left.###.npz"),
        ("take#3/####.exr", "take#3/left.####.exr"),
        ("a/film.mp4", "a/film.left.mp4"),
        ("single", "single.left"),
    ],
)
def test_names_of_an_eye(text, name):
    assert pattern_of_eye(text, "left") == name


@pytest.mark.parametrize(("text", "count"), [("out.exr", 2), ("a#b#.exr", 1), ("##/out.exr", 2), ("##/", 1), ("", 1)])
def test_refused_file_names(text, count):
    with pytest.raises(InputError):
        parse_pattern(text, count)


# Cameras


def test_a_turn_is_closed_and_even():
    turn = parse_frames("1..8")
    eyes = np.array([camera.eye for camera in orbit(BASE, turn.numbers, turn).values()])
    assert (eyes[0] == BASE.eye).all()
    np.testing.assert_allclose(eyes[2], [5, 0, 0], atol=1e-14)  # to the right; some roundings of 5 * 2^-53
    np.testing.assert_allclose(eyes[4], [0, 0, -5], atol=1e-14)
    steps = np.linalg.norm(np.roll(eyes, -1, axis=0) - eyes, axis=1)
    np.testing.assert_allclose(steps, 10 * np.sin(np.pi / 8), rtol=1e-14)


def test_some_frames_of_a_turn_are_where_all_of_them_are():
    turn = parse_frames("1..8")
    cameras = orbit(BASE, turn.numbers, turn)
    for text in ("3..5", "1..8..2", "7"):
        part = orbit(BASE, parse_frames(text).numbers, turn)
        assert all((part[k].eye == cameras[k].eye).all() for k in part)
    later = orbit(BASE, [9], turn)
    assert (later[9].eye == BASE.eye).all()
    every_second = parse_frames("1..8..2")
    assert (orbit(BASE, [7], every_second)[7].eye == cameras[7].eye).all()


def test_cameras_of_a_turn_are_made_when_they_are_asked_for(monkeypatch):
    made: list[float] = []
    monkeypatch.setattr("clshade.farm.frames.adjusted", lambda camera, azimuth: made.append(azimuth))
    turn = parse_frames("1..1000000")
    cameras = orbit(BASE, turn.numbers, turn)
    assert (len(cameras), next(iter(cameras)), 0 in cameras) == (1_000_000, 1, False)
    assert cameras[250_001] is None
    assert made == [90.0]
    with pytest.raises(KeyError):
        cameras[0]


def test_a_turn_the_other_way_and_a_part_of_one():
    turn = parse_frames("0..3")
    np.testing.assert_allclose(orbit(BASE, [1], turn, -360.0)[1].eye, [-5, 0, 0], atol=1e-14)
    np.testing.assert_allclose(orbit(BASE, [2], turn, 180.0)[2].eye, [5, 0, 0], atol=1e-14)


def cameras_of(folder: Path, value: object) -> tuple[Camera, ...]:
    path = folder / "cameras.json"
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return read_cameras(path, BASE)


def test_cameras_of_a_file(tmp_path):
    every = {
        "eye": [1, 2, 3],
        "lookat": [0, 1, 0],
        "up": [0, 0, 1],
        "focal": 2,
        "plane": [2, 3],
        "resolution": [40, 20],
        "principal": [0.25, 0.5],
        "orthographic": True,
    }
    assert {*every, "fov", "K", "pose", "convention", "pixel_center"} == set(FIELDS)
    first, second, third, fourth = cameras_of(
        tmp_path, [every, {}, {"eye": [0, 0, 9], "fov": 90}, {"resolution": [60, 20]}]
    )
    for name, value in every.items():
        assert np.array_equal(getattr(first, name), value), name
    assert all(np.array_equal(getattr(second, name), getattr(BASE, name)) for name in every)
    assert third.eye.tolist() == [0, 0, 9]
    assert third.plane[0] / third.focal == pytest.approx(2.0, rel=1e-15)
    assert fourth.plane == (1.0, 3.0)


REFUSED = [
    ([{"eye": [1, 2, 3]}, {"lokat": [0, 0, 0]}], ("camera 2", "'lokat'", "did you mean 'lookat'?")),
    ([{"Eye": [1, 2, 3]}], ("camera 1", "'Eye'", "did you mean 'eye'?")),
    ([{"zzzzzzzz": 1}], ("camera 1", "'zzzzzzzz'", "eye, lookat, up")),
    ([{"eye": [1, 2]}], ("camera 1", "eye", "three finite numbers")),
    ([{"eye": [1, 2, "3"]}], ("camera 1", "eye", "numbers")),
    ([{"eye": None}], ("camera 1", "eye")),
    ([{"eye": [[1, 2], [3]]}], ("camera 1", "eye")),
    ([{"focal": True}], ("camera 1", "focal", "number")),
    ([{"focal": -1}], ("camera 1", "focal", "above 0")),
    ([{"fov": 180}], ("camera 1", "fov", "to less than 180")),
    ([{"fov": 1e-320}], ("camera 1", "fov", "from 1e-6")),
    ([{"fov": 40, "focal": 1}], ("camera 1", "fov", "either fov or focal")),
    ([{"orthographic": 1}], ("camera 1", "orthographic", "True or False")),
    ([{"resolution": [40, 0]}], ("camera 1", "resolution")),
    ([{"resolution": [1e9, 20]}], ("camera 1", "resolution")),
    ([{"eye": [0, 0, 0]}], ("camera 1", "lookat", "other than eye")),
    ([{"up": [0, 0, 1]}], ("camera 1", "up", "parallel")),
    ([[1, 2, 3]], ("camera 1", "an object")),
    ({"eye": [1, 2, 3]}, ("a list of cameras",)),
    ([], ("a list of cameras", "empty")),
    ("3", ("a list of cameras",)),
    ('[{"eye": [NaN, 0, 1]}]', ("NaN",)),
    ('[{"eye": [1e999, 0, 1]}]', ("camera 1", "eye")),
    (f'[{{"focal": 1{"0" * 400}}}]', ("camera 1", "focal")),
    (f'[{{"focal": 1{"0" * 5000}}}]', ("JSON",)),
    ('[{"eye": [1,2,3], "eye": [3,2,1]}]', ("the key eye twice",)),
    ("[{}", ("line 1, column 4",)),
    ("[" * 100_000, ("nesting",)),
    ("[" + "1," * 2_200_000 + "1]", ("at most",)),
]


@pytest.mark.parametrize(("value", "parts"), REFUSED)
def test_refused_camera_files(tmp_path, value, parts):
    with pytest.raises(InputError) as caught:
        cameras_of(tmp_path, value)
    message = str(caught.value)
    assert message.startswith(f"{tmp_path}/cameras.json: ")
    assert "\n" not in message
    assert all(part in message for part in parts), message


def test_the_readme_s_cameras(tmp_path):
    text = (Path(__file__).resolve().parents[2] / "clshade" / "farm" / "README.md").read_text()
    example = text.split("```json cameras.json\n")[1].split("```")[0]
    first, second, third = cameras_of(tmp_path, example)
    assert (first.eye.tolist(), second.resolution) == ([-2.4, 4.9, 9.2], (640, 480))
    assert (third.plane, third.principal) == ((0.6, 0.8), (0.5, 0.45))


# Commands


@pytest.mark.long
@needs_device
def test_a_turntable_and_what_it_skips(folder, capsys):
    command = ("turntable", "icosphere", *SMALL, "--frames", "8..10", "--turn", "1..12")
    code, out, err = run(capsys, *command)
    assert code == 0
    names = sorted(path.name for path in folder.iterdir())
    assert names == [f"out.{k:04d}.{kind}" for k in (8, 9, 10) for kind in ("exr", "png")]
    assert "3/3 frames, " in err
    assert "frames/s" in err
    assert "3 drawn" in out
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert len(set(files.values())) == 6

    (folder / "out.0009.exr").unlink()  # one file is not a complete frame
    (folder / "out.0010.png").write_bytes(b"")
    (folder / ".clshade-0123456789abcdef.tmp").write_bytes(b"of a process that was killed")
    code, out, err = run(capsys, *command, "--json")
    summary = json.loads(out)
    assert (code, summary["drawn"], summary["skipped"], summary["frames"]) == (0, 2, 1, 3)
    assert {name: (folder / name).read_bytes() for name in files} == files

    assert "warning" not in err
    (folder / "out.0010.png").unlink()
    refused = (
        "out.0008.png: expected 64x48 of the frames to draw, found 32x24 of an earlier run: --overwrite draws it again"
    )
    assert_refused(run(capsys, *command, "--resolution", "64,48"), refused)
    assert not (folder / "out.0010.png").exists()
    assert run(capsys, *command, "--quiet") == (0, "", "")

    (folder / "out.0009.exr").write_bytes(b"something else")
    assert run(capsys, *command, "--quiet") == (0, "", "")
    assert (folder / "out.0009.exr").read_bytes() == b"something else"
    assert run(capsys, *command, "--quiet", "--overwrite") == (0, "", "")
    assert (folder / "out.0009.exr").read_bytes() == files["out.0009.exr"]


@pytest.mark.parametrize("options", [{}, {"workers": 2}], ids=["one process", "workers"])
@pytest.mark.parametrize("drawn_before", [False, True])
def test_what_is_no_camera_is_refused_by_its_frame(tmp_path, options, drawn_before):
    """Before it reaches a worker, also if the frame exists already and its size is compared."""
    if drawn_before:
        for kind in ("exr", "png"):
            (tmp_path / f"f.7.{kind}").write_bytes(b"some")
    with pytest.raises(InputError, match=r"^draw_frames: cameras: frame 7: expected a Camera, found 'front'$"):
        draw_frames(builtin("quads"), {7: "front", 8: None}, str(tmp_path / "f.#.exr"), progress=False, **options)


@needs_device
def test_the_folder_of_the_frames_is_made(folder, capsys):
    code, out, err = run(capsys, "turntable", "icosphere", *SMALL, "--count", "2", "-o", "new/deep/f.#.exr")
    assert code == 0, err
    assert sorted(path.name for path in (folder / "new" / "deep").iterdir()) == [
        "f.1.exr",
        "f.1.png",
        "f.2.exr",
        "f.2.png",
    ]
    assert "new/deep/f.1.exr ... new/deep/f.2.exr" in out


def drawn_with(monkeypatch: pytest.MonkeyPatch) -> list[tuple[list[int], dict[str, object]]]:
    """Record the arguments of `draw_frames` from now on, without drawing."""
    calls: list[tuple[list[int], dict[str, object]]] = []

    def note(scene: object, cameras: dict[int, Camera], output: str, **options: object) -> Run:
        calls.append((list(cameras), options))
        return Run(len(cameras), 0, 0, 1.0, 1.0, 1, 1, output, output)

    monkeypatch.setattr("clshade.farm.draw_frames", note)
    return calls


@pytest.mark.parametrize(
    ("arguments", "numbers", "warned"),
    [
        (("--count", "3"), [1, 2, 3], False),
        (("--frames", "36"), [36], True),
        (("--frames", "36..36"), [36], True),
        (("--frames", "1"), [1], False),
        (("--frames", "36", "--turn", "1..120"), [36], False),
        (("--frames", "36", "-o", "single.exr"), [36], False),
        (("--frames", "1..3"), [1, 2, 3], False),
        (("--frames", "2,7"), [2, 7], False),
    ],
)
def test_a_count_and_one_frame_that_may_have_been_meant_for_it(capsys, monkeypatch, arguments, numbers, warned):
    calls = drawn_with(monkeypatch)
    code, _, err = run(capsys, "turntable", "quads", *arguments)
    assert (code, calls[0][0]) == (0, numbers)
    line = "clshade: warning: --frames 36 is one frame, that of number 36: --count 36 draws 36 frames\n"
    assert err == (line if warned else "")


def test_the_limit_of_a_frame_s_time_is_handed_on(capsys, monkeypatch):
    calls = drawn_with(monkeypatch)
    for command in (("turntable", "quads"), ("turntable", "quads", "--workers", "2", "--frame-timeout", "2.5")):
        assert run(capsys, *command)[0] == 0
    assert [options.get("frame_timeout") for _, options in calls] == [None, 2.5]


def drawn(path: Path):
    """Return the channels' bytes and the header, but for the command, which turntables do not record."""
    planes, header = exr.read(path)
    record = {name: value for name, value in json.loads(header.pop(RECORD)).items() if name != "command"}
    del header[SEAL]
    return {name: plane.tobytes() for name, plane in planes.items()}, {
        **{k: str(v) for k, v in header.items()},
        **record,
    }


@pytest.mark.long
@needs_device
def test_a_frame_is_what_render_draws(tmp_path, capsys):
    """An eighth of a turn, and the first camera of a file, bit for bit."""
    (tmp_path / "c.json").write_text('[{"eye": [3, 2, 9]}, {"eye": [3, 2, 9], "orthographic": true, "plane": [6, 8]}]')
    turn = ("--frames", "2", "--turn", "1..8", "-o", tmp_path / "turn.exr")
    assert run(capsys, "turntable", "icosphere", *SMALL, *turn, "--quiet")[0] == 0
    assert run(capsys, "render", "icosphere", *SMALL, "-o", tmp_path / "a", "--camera-azimuth-angle", "45")[0] == 0
    assert drawn(tmp_path / "turn.exr") == drawn(tmp_path / "a.exr")
    code, *_ = run(capsys, "animate", "icosphere", *SMALL, "--quiet", "-o", tmp_path / "#.exr", tmp_path / "c.json")
    assert code == 0
    assert run(capsys, "render", "icosphere", *SMALL, "-o", tmp_path / "b", "--camera-position", "3,2,9")[0] == 0
    assert drawn(tmp_path / "1.exr") == drawn(tmp_path / "b.exr")
    assert (tmp_path / "1.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    first, second = (exr.read(tmp_path / f"{k}.exr")[0]["R"] for k in (1, 2))
    assert first.shape == second.shape
    assert (first != second).any()


@needs_device
def test_cameras_choose_their_resolutions(tmp_path, capsys):
    (tmp_path / "c.json").write_text('[{"resolution": [20, 10]}, {"resolution": [10, 20]}]')
    command = ("animate", "icosphere", tmp_path / "c.json", "--preset", "course", "--quiet")
    assert run(capsys, *command, "-o", tmp_path / "own#.exr")[0] == 0
    assert [exr.read(tmp_path / f"own{k}.exr")[0]["R"].shape for k in (1, 2)] == [(10, 20), (20, 10)]
    assert run(capsys, *command, "-o", tmp_path / "one#.exr", "--resolution", "16,8", "--frames", "2")[0] == 0
    assert exr.read(tmp_path / "one2.exr")[0]["R"].shape == (8, 16)
    assert not (tmp_path / "one1.exr").exists()


COMMANDS = [
    (("turntable", "--frames", "9..3"), ("--frames", "'9..3'", "not before the first")),
    (("turntable", "--frames", "1-9"), ("--frames", "'1-9'", "1..120")),
    (("turntable", "--turn", "x"), ("--turn", "'x'")),
    (("turntable", "--degrees", "nan"), ("--degrees", "nan")),
    (("turntable", "-o", "out.exr"), ("--output", "'out.exr'", "out.####.exr")),
    (("turntable", "--workers", "0"), ("workers", "0")),
    (("turntable", "--timeout", "0"), ("timeout", "above 0")),
    (("turntable", "--count", "0"), ("--count", "from 1 to 1000000", "0")),
    (("turntable", "--count", "two"), ("--count", "'two'")),
    (("turntable", "--count", "3", "--frames", "3"), ("--count", "not allowed with")),
    (("turntable", "--frame-timeout", "3"), ("--frame-timeout", "two --workers or more", "--scheduler")),
    *(
        (
            ("turntable", "--workers", "2", "--frame-timeout", value),
            ("--frame-timeout", "seconds above 0", f"'{value}'"),
        )
        for value in ("0", "-1", "nan", "inf", "x")
    ),
    (("turntable", "-o", "new/f.##.exr", "--compression", "rar"), ("compression", "'rar'")),
    (("turntable", "-o", "c.json/f.##.exr"), ("c.json is not a folder",)),
    (("turntable", "--workers", "two"), ("--workers", "'two'")),
    (("turntable", "--device", "no-such"), ("frame 1", "no OpenCL device matches 'no-such'")),
    (("animate", "icosphere"), ("CAMERAS.json",)),
    (("animate", "icosphere", "none.json"), ("none.json", "no such file")),
    (("animate", "icosphere", "c.json", "--frames", "1..3"), ("--frames", "1..2")),
    (("animate", "icosphere", "c.json", "--frames", "0"), ("--frames", "1..2")),
    (("animate", "icosphere", "bad.json"), ("bad.json", "camera 1", "'focl'", "did you mean 'focal'?")),
]


@pytest.mark.parametrize(("arguments", "parts"), COMMANDS)
def test_refused_command_lines(folder, capsys, arguments, parts):
    (folder / "c.json").write_text("[{}, {}]")
    (folder / "bad.json").write_text('[{"focl": 2}]')
    assert_refused(run(capsys, *arguments, *SMALL), *parts)
    assert sorted(path.name for path in folder.iterdir()) == ["bad.json", "c.json"]


@needs_device
def test_from_python(tmp_path):
    scene = builtin("icosphere")
    camera = replace(scene.camera, resolution=(32, 24))
    summary = draw_frames(scene, {4: camera}, str(tmp_path / "a.#.exr"), preset="course", progress=False)
    assert (summary.drawn, summary.skipped, summary.lost, summary.workers) == (1, 0, 0, 1)
    assert summary.size == sum(path.stat().st_size for path in tmp_path.iterdir())
    with pytest.raises(InputError, match="cameras"):
        draw_frames(scene, {}, str(tmp_path / "a.#.exr"))


@needs_device
def test_flow_to_the_frames_beside(tmp_path, capsys):
    """What `clshade.flow` gives between them, also where one exists already."""
    (tmp_path / "c.json").write_text('[{}, {"eye": [0.3, 0.1, 3]}, {"eye": [0.5, 0.3, 3.5]}]')
    pattern = tmp_path / "f#.exr"
    command = ("animate", "icosphere", tmp_path / "c.json", "--resolution", "32,24", "--preset", "course", "--quiet")
    for numbers in ("1", "1..3"):
        assert run(capsys, *command, "--flow", "--frames", numbers, "-o", pattern)[0] == 0
    files = [exr.read(tmp_path / f"f{k}.exr")[0] for k in (1, 2, 3)]
    assert [("flow.X" in file, "flow_back.X" in file) for file in files] == [
        (False, False),
        (True, True),
        (False, True),
    ]
    assert all("id" in file for file in files)
    scene = builtin("icosphere", resolution=(32, 24))
    cameras = read_cameras(tmp_path / "c.json", scene.camera)
    frame = render(replace(scene, camera=cameras[1]), preset="course", layers="id")
    for name, camera in (("flow", cameras[2]), ("flow_back", cameras[0])):
        motion = flow(frame, camera)
        for k, letter in enumerate("XY"):
            np.testing.assert_array_equal(files[1][f"{name}.{letter}"], motion.vectors[..., k])
        np.testing.assert_array_equal(files[1][f"{name}_occluded"] != 0, motion.occluded)
    for option in (["--flow"], ["--visible", "csv"]):
        refused = run(capsys, *command, *option, "-o", tmp_path / "a.mp4")
        assert_refused(refused, f"{option[0]}: needs frames as --output, such as out.####.exr, not")
    with pytest.raises(InputError, match="draw_frames: flow: needs exr or npz among the files, which hold it"):
        draw_frames(scene, {1: scene.camera}, str(tmp_path / "b#.exr"), flow=True, saving={"files": ["png"]})


@pytest.mark.long
@needs_device
def test_tables_of_instances_beside_the_frames(tmp_path):
    scene = builtin("icosphere", resolution=(32, 24))
    cameras = {1: scene.camera, 2: replace(scene.camera, lookat=(1.0, 0.0, 0.0))}
    draw_frames(scene, cameras, str(tmp_path / "f#.exr"), preset="course", progress=False, visible="json")
    assert sorted(path.name for path in tmp_path.glob("f2*")) == ["f2.exr", "f2.png", "f2_visible.json"]
    for number, camera in cameras.items():
        (row,) = json.loads((tmp_path / f"f{number}_visible.json").read_text())
        assert row["inside"] == visible(replace(scene, camera=camera)).table["inside"][0]
        assert (row["inside"] < 1.0) == (number == 2)
    with pytest.raises(InputError, match="draw_frames: visible: expected one of csv, json, found 'txt'"):
        draw_frames(scene, cameras, str(tmp_path / "g#.exr"), visible="txt")


@needs_device
def test_one_file_of_each_frame(tmp_path):
    """A frame with this file counts as drawn; one that is to have both does not."""
    scene = builtin("icosphere", resolution=(32, 24))
    cameras = {1: scene.camera, 2: scene.camera}

    def draw(files: object) -> tuple[int, int]:
        saving = {"files": files}
        summary = draw_frames(scene, cameras, str(tmp_path / "a.#.exr"), preset="course", progress=False, saving=saving)
        assert summary.size == (summary.drawn > 0) * sum(path.stat().st_size for path in tmp_path.iterdir())
        return summary.drawn, summary.skipped

    assert draw(["png"]) == (2, 0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.1.png", "a.2.png"]
    assert draw(("png",)) == (0, 2)
    assert draw(("png", "exr")) == (2, 0)
    for files in ((), "png", ["jpg"]):
        with pytest.raises(InputError, match=r"^Frame.save: files: expected (one|some) of exr, png, npz, depth"):
            draw(files)
