"""Frames of a turn or of a file's cameras: numbers, file names, cameras, and refusals; progress in lines and as a bar."""

import io
import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from command_line import assert_refused, listing, needs_device, run

from clshade.base import progress_bar
from clshade.errors import InputError
from clshade.farm import Run, draw_frames, running
from clshade.farm.camera_files import read_cameras
from clshade.farm.frames import orbit, parse_frames, parse_pattern, pattern_of_eye
from clshade.farm.job import DrawnFrame, Lost, Silent
from clshade.farm.running import Progress
from clshade.images import exr
from clshade.pipeline.flow import flow
from clshade.pipeline.frame_results import RECORD, SEAL
from clshade.pipeline.renderer import render
from clshade.pipeline.visible import visible
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera

SMALL = ("--resolution", "32,24", "--preset", "course", "--deterministic")
BASE = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.5), (30, 20))
DRAWING = {"preset": "course", "progress": False}


def test_frames():
    for text, numbers, ends in (
        ("1..10..4", [1, 5, 9], (1, 10)),
        ("7,1..3, 2", [1, 2, 3, 7], (1, 7)),
        ("007..8", [7, 8], (7, 8)),
    ):
        frames = parse_frames(text)
        assert (list(frames.numbers), (frames.first, frames.last)) == (numbers, ends)
        assert frames.span == ends[1] - ends[0] + 1
    for text in ("", "1-5", "1...5", "5..1", "1..5..0", "-3..3", "1,,2", "1..1000000000", "9" * 40, "²"):
        with pytest.raises(InputError, match=r"^--frames: expected "):
            parse_frames(text)


def test_file_names():
    for text, number, stem in (
        ("out.####.exr", 7, "out.0007"),
        ("a/b_##", 123, "a/b_123"),
        ("take#3/out.##.exr", 4, "take#3/out.04"),
        ("a.exr.#.PNG", 4, "a.exr.4"),
        ("single.exr", 9, "single"),
    ):
        assert parse_pattern(text, 1).names(number) == (f"{stem}.exr", f"{stem}.png")
    for text, count in (("out.exr", 2), ("a#b#.exr", 1), ("##/out.exr", 2), ("##/", 1), ("", 1)):
        with pytest.raises(InputError):
            parse_pattern(text, count)
    for text, name in (
        ("a/b_##", "a/b.left_##"),
        ("out###.npz", "out.left.###.npz"),
        ("take#3/####.exr", "take#3/left.####.exr"),
        ("a/film.mp4", "a/film.left.mp4"),
    ):
        assert pattern_of_eye(text, "left") == name


def test_a_turn_is_closed_and_even():
    turn = parse_frames("1..8")
    cameras = orbit(BASE, turn.numbers, turn)
    eyes = np.array([camera.eye for camera in cameras.values()])
    assert (eyes[0] == BASE.eye).all()
    np.testing.assert_allclose(eyes[2], [5, 0, 0], atol=1e-14)  # to the right; some roundings of 5 * 2^-53
    np.testing.assert_allclose(eyes[4], [0, 0, -5], atol=1e-14)
    steps = np.linalg.norm(np.roll(eyes, -1, axis=0) - eyes, axis=1)
    np.testing.assert_allclose(steps, 10 * np.sin(np.pi / 8), rtol=1e-14)
    for text in ("3..5", "1..8..2", "7"):
        part = orbit(BASE, parse_frames(text).numbers, turn)
        assert all((part[k].eye == cameras[k].eye).all() for k in part)
    assert (orbit(BASE, [7], parse_frames("1..8..2"))[7].eye == cameras[7].eye).all()
    turn = parse_frames("0..3")
    np.testing.assert_allclose(orbit(BASE, [1], turn, -360.0)[1].eye, [-5, 0, 0], atol=1e-14)
    np.testing.assert_allclose(orbit(BASE, [2], turn, 180.0)[2].eye, [5, 0, 0], atol=1e-14)


@pytest.mark.long
@needs_device
def test_a_turntable_and_what_it_skips(folder, capsys):
    command = ("turntable", "icosphere", *SMALL, "--frames", "8..10", "--turn", "1..12", "-o", "new/f.####.exr")
    code, out, err = run(capsys, *command)
    assert code == 0
    new = folder / "new"
    assert listing(new) == [f"f.{k:04d}.{kind}" for k in (8, 9, 10) for kind in ("exr", "png")]
    assert "3 drawn" in out
    assert "new/f.0008.exr ... new/f.0010.exr" in out
    files = {path.name: path.read_bytes() for path in new.iterdir()}
    assert len(set(files.values())) == 6

    (new / "f.0009.exr").unlink()  # one file is not a complete frame
    (new / "f.0010.png").write_bytes(b"")
    (new / ".clshade-0123456789abcdef.tmp").write_bytes(b"of a process that was killed")
    code, out, err = run(capsys, *command, "--json")
    summary = json.loads(out)
    assert (code, summary["drawn"], summary["skipped"], summary["frames"]) == (0, 2, 1, 3)
    assert {name: (new / name).read_bytes() for name in files} == files
    assert "warning" not in "".join(err)

    (new / "f.0009.exr").write_bytes(b"something else")
    assert run(capsys, *command, "--quiet") == (0, "", [])
    assert (new / "f.0009.exr").read_bytes() == b"something else"
    assert run(capsys, *command, "--quiet", "--overwrite") == (0, "", [])
    assert (new / "f.0009.exr").read_bytes() == files["f.0009.exr"]


def test_what_is_no_camera_is_refused_by_its_frame(tmp_path):
    for kind in ("exr", "png"):
        (tmp_path / f"f.7.{kind}").write_bytes(b"some")
    with pytest.raises(InputError, match=r"^draw_frames: cameras: frame 7: expected a Camera, found 'front'$"):
        draw_frames(builtin("quads"), {7: "front", 8: None}, str(tmp_path / "f.#.exr"), **DRAWING)


@pytest.mark.parametrize(("arguments", "numbers", "warned"), [
    ("--count 3 --workers 2 --frame-timeout 2.5", [1, 2, 3], False),
    ("--frames 36..36", [36], True),
    ("--frames 36 --turn 1..120", [36], False),
    ("--frames 36 -o single.exr", [36], False),
])  # fmt: skip
def test_a_count_and_one_frame_that_may_have_been_meant_for_it(capsys, monkeypatch, arguments, numbers, warned):
    draw = Mock(return_value=Run(1, 0, 0, 1.0, 1.0, 1, 1, "a", "a"))
    monkeypatch.setattr("clshade.farm.draw_frames", draw)
    code, _, err = run(capsys, "turntable", "quads", *arguments.split())
    assert (code, list(draw.call_args.args[1])) == (0, numbers)
    assert draw.call_args.kwargs.get("frame_timeout") == (2.5 if "2.5" in arguments else None)
    line = "clshade: warning: --frames 36 is one frame, that of number 36: --count 36 draws 36 frames"
    assert err == ([line] if warned else [])


def drawn(path: Path):
    """Return the channels' bytes and the header, but for the command, which turntables do not record."""
    planes, header = exr.read(path)
    record = {name: value for name, value in json.loads(header.pop(RECORD)).items() if name != "command"}
    del header[SEAL]
    facts = {name: str(value) for name, value in header.items()} | record
    return {name: plane.tobytes() for name, plane in planes.items()}, facts


@pytest.mark.long
@needs_device
def test_a_frame_is_what_render_draws(folder, capsys):
    (folder / "c.json").write_text('[{"eye": [3, 2, 9]}, {"eye": [3, 2, 9], "orthographic": true, "plane": [6, 8]}]')
    turn = ("--frames", "2", "--turn", "1..8", "-o", "turn.exr")
    assert run(capsys, "turntable", "icosphere", *SMALL, *turn, "--quiet")[0] == 0
    assert run(capsys, "render", "icosphere", *SMALL, "-o", "a", "--camera-azimuth-angle", "45")[0] == 0
    assert drawn("turn.exr") == drawn("a.exr")
    assert run(capsys, "animate", "icosphere", *SMALL, "--quiet", "-o", "#.exr", "c.json")[0] == 0
    assert run(capsys, "render", "icosphere", *SMALL, "-o", "b", "--camera-position", "3,2,9")[0] == 0
    assert drawn("1.exr") == drawn("b.exr")
    assert Path("1.png").read_bytes() == Path("b.png").read_bytes()
    assert (exr.read("1.exr")[0]["R"] != exr.read("2.exr")[0]["R"]).any()
    (folder / "c.json").write_text('[{"resolution": [20, 10]}, {"resolution": [10, 20]}]')
    assert run(capsys, "animate", "icosphere", "c.json", *SMALL[2:], "--frames", "2", "-o", "o#.exr")[0] == 0
    assert exr.read("o2.exr")[0]["R"].shape == (20, 10)
    assert not Path("o1.exr").exists()


@needs_device
def test_flow_to_the_frames_beside(folder, capsys):
    (folder / "c.json").write_text('[{}, {"eye": [0.3, 0.1, 3]}, {"eye": [0.5, 0.3, 3.5]}]')
    command = ("animate", "icosphere", "c.json", "--resolution", "32,24", "--preset", "course", "--quiet")
    for numbers in ("1", "1..3"):
        assert run(capsys, *command, "--flow", "--frames", numbers, "-o", "f#.exr")[0] == 0
    files = [exr.read(f"f{k}.exr")[0] for k in (1, 2, 3)]
    flows = [("flow.X" in file, "flow_back.X" in file, "id" in file) for file in files]
    assert flows == [(False, False, True), (True, True, True), (False, True, True)]
    scene = builtin("icosphere", resolution=(32, 24))
    cameras = read_cameras("c.json", scene.camera)
    frame = render(replace(scene, camera=cameras[1]), preset="course", layers="id")
    for name, camera in (("flow", cameras[2]), ("flow_back", cameras[0])):
        motion = flow(frame, camera)
        for k, letter in enumerate("XY"):
            np.testing.assert_array_equal(files[1][f"{name}.{letter}"], motion.vectors[..., k])
        np.testing.assert_array_equal(files[1][f"{name}_occluded"] != 0, motion.occluded)
    for option in (["--flow"], ["--visible", "csv"]):
        refused = run(capsys, *command, *option, "-o", "a.mp4")
        assert_refused(refused, f"{option[0]}: needs frames as --output, such as out.####.exr, not")
    with pytest.raises(InputError, match="draw_frames: flow: needs exr or npz among the files, which hold it"):
        draw_frames(scene, {1: scene.camera}, "b#.exr", flow=True, saving={"files": ["png"]})


@pytest.mark.long
@needs_device
def test_tables_of_instances_beside_the_frames(tmp_path):
    scene = builtin("icosphere", resolution=(32, 24))
    cameras = {1: scene.camera, 2: replace(scene.camera, lookat=(1.0, 0.0, 0.0))}
    draw_frames(scene, cameras, str(tmp_path / "f#.exr"), visible="json", **DRAWING)
    for number, camera in cameras.items():
        (row,) = json.loads((tmp_path / f"f{number}_visible.json").read_text())
        assert row["inside"] == visible(replace(scene, camera=camera)).table["inside"][0]
        assert (row["inside"] < 1.0) == (number == 2)
    with pytest.raises(InputError, match="draw_frames: visible: expected one of csv, json, found 'txt'"):
        draw_frames(scene, cameras, str(tmp_path / "g#.exr"), visible="txt")


@needs_device
def test_one_file_of_each_frame(tmp_path):
    scene = builtin("icosphere", resolution=(32, 24))

    def draw(*files: str) -> tuple[int, int]:
        output = str(tmp_path / "a.#.exr")
        summary = draw_frames(scene, {1: scene.camera, 2: scene.camera}, output, saving={"files": files}, **DRAWING)
        assert summary.size == (summary.drawn > 0) * sum(path.stat().st_size for path in tmp_path.iterdir())
        return summary.drawn, summary.skipped

    assert (draw("png"), listing(tmp_path)) == ((2, 0), ["a.1.png", "a.2.png"])
    assert (draw("png"), draw("png", "exr")) == ((0, 2), (2, 0))
    for files in ((), ("jpg",)):
        with pytest.raises(InputError, match=r"^Frame.save: files: expected (one|some) of exr, png, npz, depth"):
            draw(*files)
    with pytest.raises(InputError, match="cameras"):
        draw_frames(scene, {}, str(tmp_path / "a.#.exr"))


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def now(monkeypatch) -> list[float]:
    now = [0.0]
    clocks = SimpleNamespace(perf_counter=lambda: now[0], time=lambda: 1e9 + now[0])
    for module in (running, progress_bar):
        monkeypatch.setattr(module, "time", clocks)
    monkeypatch.setattr("tqdm.std.time", lambda: 1e9 + now[0])
    return now


def draw(bar: Progress, number: int, *warnings: str) -> None:
    bar.advance(DrawnFrame(number, 1.0, 1.0, 1, warnings, "here:1"))


def test_silent_and_lost_workers_are_reported(capsys):
    reports = [Silent((3,), "7", 12.3), Lost((3, 4), "7 is gone"), DrawnFrame(3, 1.0, 1.0, 5, (), "8")]
    with Progress(2, 0, False) as bar:
        bar.follow(reports, limited=False)
    assert capsys.readouterr().err.splitlines() == [
        "clshade: warning: no sign of worker 7 for 12 s, at frame 3 (--frame-timeout SECONDS gives frames of such "
        "workers to others)",
        "clshade: warning: frames 3, 4 drawn again: the worker 7 is gone",
    ]
    assert (bar.drawn, bar.lost, bar.size, bar.workers) == (1, 1, 5, {"8"})


def test_lines_now_and_then_without_a_terminal(now, monkeypatch):
    """The first frame, which waits for the compiler, does not count in what is left."""
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with Progress(100, 0, True) as bar:
        now[0] += 60.0
        for number in range(1, 12):
            now[0] += 1.0
            draw(bar, number, *(["odd"] if number > 2 else []))
    lines = sys.stderr.getvalue().splitlines()
    assert [line for line in lines if "warning" in line] == ["clshade: warning: frame 3: odd"]
    assert lines[-1] == "clshade: 11/100 frames, 0.155 frames/s, about 89 s left"
    assert (bar.drawn, bar.seconds) == (11, 71.0)


def test_a_bar_on_a_terminal_and_nothing_where_nothing_is_to_be(now, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Screen())
    with Progress(4, 1, True) as bar:
        for number in (2, 3, 4):
            now[0] += 2.0
            draw(bar, number)
        now[0] += 60.0  # while workers end
    last = sys.stderr.getvalue().split("\r")[-1]
    assert "4/4 [" in last
    assert last.rstrip().endswith(", 0.5 frames/s]")
    for stream in (Screen(), None):
        monkeypatch.setattr(sys, "stderr", stream)
        with Progress(1, 0, stream is None) as bar:
            now[0] += 1.0
            draw(bar, 1)
        assert (bar.rate, stream is None or stream.getvalue()) == (1.0, stream is None or "")
