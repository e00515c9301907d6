"""The command line: files, exit codes, one line on stderr for any refusal, and nothing left behind."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from command_line import SMALL, assert_refused, listing, needs_device, process, run, scene_of, without_notices
from devices import is_tested, working_devices
from processes import ROOT

from clshade.base import interrupts
from clshade.cli import render
from clshade.cli.main import main
from clshade.images import exr, png
from clshade.pipeline.drawing_record import RECORD, SEAL

# Rendering


@needs_device
@pytest.mark.parametrize(
    ("output", "stem"),
    [("picture", "picture"), ("picture.exr", "picture"), ("a.png", "a"), ("v1.2", "v1.2"), ("sub/x", "sub/x")],
)
def test_render_writes_an_exr_and_a_png(tmp_path, capsys, output, stem):
    (tmp_path / "sub").mkdir()
    code, out, err = run(capsys, *SMALL, "-o", tmp_path / output)
    assert (code, err) == (0, [])
    assert listing(tmp_path) == sorted([f"{stem}.exr", f"{stem}.png", "sub"])
    assert "32x24" in out
    assert f"{stem}.exr" in out
    channels, _ = exr.read(tmp_path / f"{stem}.exr")
    assert set(channels) == {"R", "G", "B", "A", "Z", "id"}
    assert channels["R"].shape == (24, 32)
    assert png.read(tmp_path / f"{stem}.png").shape == (24, 32, 3)


@needs_device
def test_options_reach_the_image(tmp_path, capsys):
    options = ("--deterministic", "--stats")
    code, out, err = run(capsys, *SMALL, "-o", tmp_path / "a", *options)
    assert (code, err) == (0, [])
    stats = json.loads(out)
    assert stats["resolution"] == [32, 24]
    assert "phong" in stats["times_ms"]
    channels, header = exr.read(tmp_path / "a.exr")
    assert channels["id"].min() > 0
    assert "renderTimeSeconds" not in header
    first = (tmp_path / "a.exr").read_bytes()
    assert run(capsys, *SMALL, "-o", tmp_path / "b", *options)[0] == 0
    assert (tmp_path / "b.exr").read_bytes() == first
    assert run(capsys, *SMALL, "-o", tmp_path / "c", *options, "--lights", "1")[0] == 0
    assert exr.read(tmp_path / "c.exr")[0]["G"].mean() < channels["G"].mean()


def test_options_reach_the_scene():
    plain, chosen = scene_of("quads"), scene_of("quads", "--lights", "1", "--components", "ambient,specular")
    assert len(plain.lights) == 2
    assert [light.position.tolist() for light in chosen.lights] == [plain.lights[1].position.tolist()]
    was, now = plain.meshes[0].material, chosen.meshes[0].material
    assert (now.ka.tolist(), now.kd.tolist(), now.ks.tolist()) == (was.ka.tolist(), [0, 0, 0], was.ks.tolist())


@needs_device
def test_exposure_and_tone_map_change_the_png_alone(tmp_path, capsys):
    run(capsys, *SMALL, "-o", tmp_path / "a", "--deterministic")
    run(capsys, *SMALL, "-o", tmp_path / "b", "--deterministic", "--exposure", "-2", "--tonemap", "aces")
    (planes, header), (others, other) = (exr.read(tmp_path / f"{name}.exr") for name in "ab")
    assert all(planes[name].tobytes() == others[name].tobytes() for name in planes)
    assert {name for name in header if str(header[name]) != str(other[name])} == {RECORD, SEAL}  # how the PNG is made
    assert png.read(tmp_path / "a.png").mean() > png.read(tmp_path / "b.png").mean() + 5


# Refusals


USAGE = [
    (("render", "--preset", "fancy"), ("--preset", "fancy")),
    (("render", "--resolution", "10,x"), ("--resolution", "'10,x'")),
    (("render", "--near", "far"), ("--near", "far")),
    (("render", "--precision", "float16"), ("--precision", "float16")),
    ((), ("COMMAND",)),
    (("inspect",), ("FILE",)),
    (("view",), ("FILE",)),
    (("devices", "--quiet", "--verbose"), ("--verbose", "--quiet")),
]


@pytest.mark.parametrize(("arguments", "parts"), USAGE, ids=[" ".join(arguments) for arguments, _ in USAGE])
def test_bad_usage(capsys, arguments, parts):
    assert_refused(run(capsys, *arguments), *parts)


BAD = [
    (("no_such_file.obj",), ("no_such_file.obj",)),
    (("no_such_file.npy",), ("no_such_file.npy",)),
    (("n" * 5000,), ("nnn", "a file or one of")),
    (("scene.xyz",), ("scene.xyz", "extension", ".npy", ".obj")),
    (("empty.obj",), ("empty.obj",)),
    (("text.npy",), ("text.npy",)),
    (("folder.obj",), ("folder.obj",)),
    (("quads", "--resolution", "0,10"), ("resolution", "0")),
    (("quads", "--resolution", "10,99999"), ("resolution", "99999")),
    (("quads", "--near", "-1"), ("near", "-1")),
    (("quads", "--near", "nan"), ("near", "nan")),
    (("quads", "--lights", "5"), ("--lights", "0 to 1", "5")),
    (("quads", "--texture", "x.png"), ("--texture", "quads")),
    (("quads", "--focal", "3"), ("--focal", "quads")),
    (("quads", "-o", "missing/out"), ("missing/out", "missing")),
    (("quads", "--device", "no such platform"), ("no such platform",)),
]


@pytest.mark.parametrize(("arguments", "parts"), BAD, ids=[" ".join(arguments) for arguments, _ in BAD])
def test_refused_input_leaves_nothing(folder, capsys, arguments, parts):
    (folder / "scene.xyz").write_text("what is this")
    (folder / "empty.obj").write_text("")
    (folder / "text.npy").write_text("not NumPy's")
    (folder / "folder.obj").mkdir()
    before = listing(folder)
    assert_refused(run(capsys, "render", *arguments), *parts)
    assert listing(folder) == before


@pytest.fixture
def no_loading(monkeypatch):
    """Fail if a scene is loaded: outputs that cannot be saved are refused before."""
    monkeypatch.setattr(render, "load_scene", lambda *arguments: pytest.fail("a scene was loaded"))


@pytest.mark.usefixtures("no_loading")
@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (("--compression", "lzma"), ("compression", "lzma", "zip")),
        (("--exposure", "nan"), ("exposure", "nan")),
        (("--exposure", "1000"), ("exposure", "1000")),
        (("-o", "."), ("a file name", "'.'")),
        (("-o", "out.jpg"), ("out.exr and out.png", "'out.jpg'")),
        (("-o", "-"), ("image.exr and image.png", "'-'")),
        (("-o", "missing/out"), ("missing/out.exr", "there is no folder")),
        (("-o", "n" * 256), ("nnn.exr", "too long")),
        (("-o", "file/out"), ("file/out.exr", "not a folder")),
    ],
)
def test_refused_output_options_leave_nothing(folder, capsys, options, parts):
    (folder / "file").touch()
    assert_refused(run(capsys, *SMALL, "-o", folder / "out", *options), *parts)
    assert listing(folder) == ["file"]


@pytest.mark.usefixtures("no_loading")
@pytest.mark.parametrize("taken", ["out.exr", "out.png"])
def test_unwritable_output_leaves_nothing(tmp_path, capsys, taken):
    """If a folder has the name of either file, the other is not left behind alone."""
    (tmp_path / taken).mkdir()
    assert_refused(run(capsys, *SMALL, "-o", tmp_path / "out"), taken)
    assert listing(tmp_path) == [taken]


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
def test_earlier_files_survive_a_refusal(tmp_path, capsys):
    (tmp_path / "out.exr").write_text("kept")
    (tmp_path / "out.png").write_text("kept too")
    assert_refused(run(capsys, *SMALL, "-o", tmp_path / "out", "--device", "no such platform"), "no such platform")
    assert (tmp_path / "out.exr").read_text() == "kept"
    assert (tmp_path / "out.png").read_text() == "kept too"


def test_refusals_as_a_process(tmp_path):
    """Exit code, one line, no traceback, as seen by a shell."""
    for arguments in (("render", "none.obj"), ("render", "--shader", "flat")):
        done = process(*arguments, cwd=tmp_path)
        assert done.returncode == 2
        assert done.stdout == ""
        assert len(without_notices(done.stderr)) == 1
        assert done.stderr.startswith("clshade")
    assert listing(tmp_path) == []


def test_debug_shows_the_traceback(tmp_path):
    done = process("--debug", "render", "none.obj", cwd=tmp_path)
    assert done.returncode != 0
    assert "Traceback" in done.stderr
    assert "none.obj" in done.stderr


def test_interrupted(capsys, monkeypatch):
    def stop(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(render, "load_scene", stop)
    monkeypatch.setattr(interrupts, "_told", threading.Lock())  # another test of this process may have been interrupted
    code, out, err = run(capsys, *SMALL)
    assert (code, out) == (130, "")
    assert len(err) == 1


@pytest.mark.parametrize(("error", "line"), [(MemoryError(), ""), (MemoryError("9 GiB\nwanted"), ": 9 GiB wanted")])
def test_out_of_memory(capsys, monkeypatch, error, line):
    def stop(*arguments):
        raise error

    monkeypatch.setattr(render, "load_scene", stop)
    assert run(capsys, *SMALL) == (2, "", [f"clshade: out of memory{line}"])
    with pytest.raises(MemoryError):
        run(capsys, "--debug", *SMALL)


def interrupted(code: str, cwd: Path) -> tuple[int, str]:
    """Run `python -m clshade render` after `code`, which sends SIGINT; return exit code and standard error."""
    (cwd / "sitecustomize.py").write_text(code)
    path = os.pathsep.join([str(cwd), str(ROOT)])
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "clshade", "render", "quads"]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stderr


@pytest.mark.sampled
@pytest.mark.parametrize(
    "module", ["argparse", "clshade.errors", "clshade.cli.main", "clshade.scene.model", "numpy", "_signal"]
)
def test_interrupted_while_importing(tmp_path, module):
    code = f"""
import os, signal, sys
def interrupt(*arguments):
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1_000_000_000):  # until the interrupt comes
        pass
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            interrupt()
sys.meta_path.insert(0, Interrupt())
if {module!r} == "_signal":  # not imported any more: between the imports and the scene
    import clshade.cli.main
    clshade.cli.main.with_values = interrupt
"""
    status, err = interrupted(code, tmp_path)
    assert status == 130, err
    assert err in ("", "clshade: interrupted\n")
    assert listing(tmp_path) == ["sitecustomize.py"]


# Standard output


@pytest.mark.sampled
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
@pytest.mark.parametrize("arguments", [("--help",), ("--version",), ("inspect", "a.exr"), ("render", *SMALL[1:])])
def test_a_full_disk_behind_standard_output(tmp_path, arguments):
    if arguments[0] == "render" and not working_devices():
        pytest.skip("no OpenCL device works here")
    exr.write(tmp_path / "a.exr", np.zeros((4, 4, 3), np.float32))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "clshade", *arguments]
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60
        )
    assert without_notices(done.stderr) == ["clshade: standard output: cannot be written: No space left on device"]
    assert done.returncode == 2


@pytest.mark.parametrize("arguments", [("--help",), ("inspect", "a.exr")])
def test_nobody_reads_standard_output(tmp_path, arguments):
    exr.write(tmp_path / "a.exr", np.zeros((4, 4, 3), np.float32))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "clshade", *arguments]
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, stdout=writer, stderr=subprocess.PIPE, text=True, timeout=60
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


def test_without_standard_output(tmp_path, capsys, monkeypatch):
    exr.write(tmp_path / "a.exr", np.zeros((4, 4, 3), np.float32))
    monkeypatch.setattr(sys, "stdout", None)
    assert main(["inspect", str(tmp_path / "a.exr")]) == 0


# The other commands


def test_help_and_version(capsys):
    for arguments in (("--help",), ("render", "--help"), ("devices", "--help"), ("inspect", "--help"), ("--version",)):
        code, out, err = run(capsys, *arguments)
        assert (code, err) == (0, [])
        assert out.startswith(("usage: clshade", "clshade "))
    help_text = run(capsys, "render", "--help", "all")[1]
    for option in (
        "--shader",
        "--preset",
        "--resolution",
        "--layers",
        "--tonemap",
        "--exposure",
        "--device",
        "--stats",
    ):
        assert option in help_text


def options_in(help_text):
    return re.findall(r"^  (?:-\w\b[^-]*)?(--[a-z-]+)", help_text, re.M)


@pytest.mark.parametrize("command", ["render", "turntable", "animate", "poster", "view", "report", "stability"])
def test_help_begins_with_the_options_that_people_use_first(command, capsys):
    code, out, err = run(capsys, command, "--help")
    assert (code, err) == (0, [])
    assert 10 <= len(options_in(out)) <= 16
    assert options_in(out)[0] in ("--output", "--out")
    assert len(out.splitlines()) < 80
    topics = re.findall(r"^  ([a-z]+)(?:  .*)?$", out.split("--help TOPIC\n")[1], re.M)
    assert topics[-1] == "general"
    every = set(options_in(run(capsys, command, "--help", "all")[1]))
    assert f"all {len(every)} options" in out
    by_topic = [options_in(run(capsys, command, "--help", topic)[1]) for topic in topics]
    assert all(by_topic)
    assert every == {"--help", *options_in(out)}.union(*by_topic)


def test_help_on_an_unknown_topic_names_them(capsys):
    code, out, err = run(capsys, "render", "--help", "light")
    assert (code, out, len(err)) == (2, "", 1)
    assert "expected one of all, scene, lights, camera," in err[0]
    assert "did you mean 'lights'?" in err[0]


def test_help_on_few_options_shows_all(capsys):
    out = run(capsys, "inspect", "--help")[1]
    assert out == run(capsys, "inspect", "--help", "all")[1]
    assert "--pixel" in out


def test_inspect_reads_the_file_once(tmp_path, capsys, monkeypatch):
    exr.write(tmp_path / "a.exr", np.zeros((4, 4, 3), np.float32))
    reads, read = [], exr.read
    monkeypatch.setattr(exr, "read", lambda path: reads.append(path) or read(path))
    assert run(capsys, "inspect", tmp_path / "a.exr")[0] == 0
    assert reads == [str(tmp_path / "a.exr")]


@pytest.mark.long
def test_devices_as_json(capsys):
    code, out, err = run(capsys, "devices", "--json")
    assert (code == 0, err) == (bool(working_devices()), [])
    listed = (info for info in json.loads(out) if info["works"] and is_tested(info["platform"]))
    assert tuple(info["index"] for info in listed) == working_devices()
