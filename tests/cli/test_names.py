"""Names that must be escaped on terminals: bytes that are not UTF-8, line feeds, escape sequences; ASCII terminals;
invalid output names; messages of decoders. The exit code is 0, or 2 with a one-line error."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused, listing, needs_device, process, run
from scene_files import TRIANGLE, course_dict, refusal, save_npy, write

from clshade.base import console
from clshade.base.input_files import reason_of
from clshade.cli.main import _Stdout, main
from clshade.images import exr, png

NAMES = [b"caf\xe9", "café".encode(), b"esc\x1b[31m\r\t\x07", b"new\nline"]
SIZE = ("--resolution", "16,12")


@pytest.fixture(params=NAMES, ids=ascii)
def name(request, tmp_path, monkeypatch):
    """Return a name without its extension, in the current folder."""
    monkeypatch.chdir(tmp_path)
    file_name = os.fsdecode(request.param)
    try:
        os.stat(file_name)
    except FileNotFoundError:
        return file_name
    except (OSError, ValueError):
        pytest.skip("a name that this file system does not take")


def test_references_to_names_that_the_locale_cannot_express(tmp_path):
    """They are UTF-8 on the disk, as they are in the file."""
    png.write(tmp_path / "café.png", np.full((2, 2, 3), 200, np.uint8))
    (tmp_path / "é.mtl").write_text("newmtl red\nKd 1 1 1\nmap_Kd café.png\n", "utf-8")
    (tmp_path / "a.obj").write_text(f"mtllib é.mtl\nusemtl red\n{TRIANGLE}vt 0 0\nf 1/1 2/1 3/1\n", "utf-8")
    ascii_locale = {"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LC_ALL": "C"}
    done = process("inspect", "a.obj", cwd=tmp_path, **ascii_locale)
    assert (done.returncode, done.stderr) == (0, "")
    assert "2x2" in done.stdout


def test_a_current_folder_that_was_removed(tmp_path):
    code = "import os, sys; os.rmdir(os.getcwd()); from clshade.cli.main import main; sys.exit(main(sys.argv[1:]))"
    for arguments in (("devices",), ("inspect", "a.exr"), ("render", "-o", "x")):
        folder = tmp_path / "gone"
        folder.mkdir()
        command = [sys.executable, "-c", code, *arguments]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)
        assert done.returncode == 2
        assert done.stderr == "clshade: the current folder: No such file or directory: go to one that exists\n"


class Terminal(io.TextIOWrapper):
    """Standard output with a given encoding, and Python's strict error handler."""

    def __init__(self, encoding: str) -> None:
        super().__init__(io.BytesIO(), encoding=encoding, errors="strict")

    def shown(self) -> str:
        self.flush()
        return self.buffer.getvalue().decode(self.encoding)  # type: ignore[attr-defined]


def on_terminal(monkeypatch, encoding: str, *arguments: str) -> tuple[int, str]:
    terminal = Terminal(encoding)
    monkeypatch.setattr("sys.stdout", terminal)
    code = main([*arguments])
    return code, terminal.shown()


def assert_harmless(text: str) -> None:
    assert text.replace("\n", "").isprintable(), ascii(text)
    assert not any(line.startswith("line") for line in text.splitlines())  # from the name with a line feed


@needs_device
@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_rendering_to_such_names(monkeypatch, capsys, name, encoding):
    save_npy(f"{name}.npy", course_dict())
    code, out = on_terminal(monkeypatch, encoding, "render", f"{name}.npy", *SIZE, "-o", name, "-v")
    assert code == 0
    assert_harmless(out)
    assert_harmless(capsys.readouterr().err)
    assert sum(not line.startswith(" ") for line in out.splitlines()) == 6  # long lines are continued with indentation
    assert sorted(os.listdir()) == sorted(f"{name}{kind}" for kind in (".exr", ".npy", ".png"))
    code, out = on_terminal(monkeypatch, encoding, "render", f"{name}.npy", "no.npy", *SIZE, "-o", f"{name}/", "--json")
    assert code == 2
    assert json.loads(out)[0]["output"] == os.path.join(name, name)
    assert sorted(os.listdir(name)) == sorted([f"{name}.exr", f"{name}.png"])


@needs_device
@pytest.mark.parametrize("form", ["--json", "--verbose"])
def test_frames_of_such_names(monkeypatch, capsys, name, form):
    save_npy("a.npy", course_dict())
    arguments = ("turntable", "a.npy", *SIZE, "--frames", "1..2", "-o", f"{name}.##.exr", form)
    code, out = on_terminal(monkeypatch, "ascii", *arguments)
    assert code == 0
    assert_harmless(out)
    if form == "--json":
        assert json.loads(out)["last"] == f"{name}.02.exr"
    assert os.path.exists(f"{name}.02.png")
    write(Path(f"{name}.json"), json.dumps([{"eye": [0, 0, 6], "resolution": [8, 6]}]))
    capsys.readouterr()
    animate = ("animate", "a.npy", f"{name}.json", form, "-o")
    assert on_terminal(monkeypatch, "ascii", *animate, f"{name}.##.exr") == (2, "")
    err = capsys.readouterr().err
    assert "expected 8x6 of the frames to draw, found 16x12" in err.splitlines()[-1]
    assert_harmless(err)
    code, out = on_terminal(monkeypatch, "ascii", *animate, f"{name}.b.##.exr")
    assert code == 0
    assert_harmless(out)
    assert_harmless(re.sub(r"\r.*", "", capsys.readouterr().err))  # except the bar, which reports another size


@pytest.mark.sampled
def test_looking_into_such_names(monkeypatch, capsys, name):
    """Files and layers with such names."""
    layer = name if "\udce9" not in name else "R"
    pixels = np.arange(12.0).reshape(3, 4)
    exr.write(f"{name}.exr", {layer: pixels}, metadata={"comment": name})
    exr.write("b.exr", {layer: pixels + 1})
    for arguments in (
        ("inspect", f"{name}.exr", "--pixel", "1,1"),
        ("inspect", f"{name}.exr", "-o", f"{name}.png"),
        ("view", f"{name}.exr", "b.exr", "-o", f"{name}.html"),
        ("compare", f"{name}.exr", "b.exr", "-o", f"{name} 2.png", "-v"),
    ):
        code, out = on_terminal(monkeypatch, "ascii", *arguments)
        assert code == 0, arguments
        assert_harmless(out)
        assert_harmless(capsys.readouterr().err)
    code, out = on_terminal(monkeypatch, "utf-8", "inspect", f"{name}.exr", "--json")
    assert (code, json.loads(out)["file"]) == (0, f"{name}.exr")
    code, out = on_terminal(monkeypatch, "ascii", "compare", "b.exr", f"{name}.exr", "--json")
    assert (code, json.loads(out)["reference"]) == (0, f"{name}.exr")
    assert os.path.exists(f"{name}.png")
    assert os.path.exists(f"{name} 2.png")


@pytest.mark.parametrize(
    "arguments",
    [
        ("{}",),
        ("render", "{}"),
        ("render", "{}.npy"),
        ("render", "--{}"),
        ("render", "quads", "--texture", "{}.png"),
        ("render", "quads", "--compression", "{}"),
        ("render", "quads", "--layers", "{}"),
        ("render", "{}.obj", "{}.glb", "-o", "{}/no/"),
        ("turntable", "quads", "--frames", "{}"),
        ("animate", "quads", "{}.json"),
        ("inspect", "{}.exr"),
        ("view", "{}.exr", "{}.png"),
        ("inspect", "a.exr", "-o", "{}.jpg"),
        ("compare", "{}.exr", "{}.exr"),
        ("stability", "--case", "{}"),
        ("bench", "{}"),
        ("report", "quads", "--lights", "{}"),
    ],
    ids=" ".join,
)
def test_refusals_of_such_names(capsys, name, arguments):
    code, out, err = run(capsys, *(argument.format(name) for argument in arguments))
    assert (code, out) == (2, "")
    assert err
    assert all(line.isprintable() and line.startswith("clshade") for line in err), err


@pytest.mark.parametrize(
    ("text", "encoding", "expected"),
    [
        ("plain\n", "utf-8", "plain\n"),
        ("é…\n\n", "utf-8", "é…\n\n"),
        ("é…\n", "ascii", "\\xe9\\u2026\n"),
        ("é…\n", "latin-1", "é\\u2026\n"),
        ("a\x1b[31m\r\tb\x00\x7f\x9b\n", "utf-8", "a\\x1b[31m\\r\\tb\\x00\\x7f\\x9b\n"),
        ("caf\udce9\n", "utf-8", "caf\\udce9\n"),
        ("\u202eright to left\u2028", "utf-8", "\\u202eright to left\\u2028"),
        ("\U0001f600", "ascii", "\\U0001f600"),
    ],
)
def test_what_is_printed(text, encoding, expected):
    assert console.printable(text, encoding) == expected
    terminal = Terminal(encoding)
    stream = _Stdout(terminal)
    assert stream.write(text) == len(text)
    stream.flush()
    assert terminal.shown() == expected
    assert (stream.encoding, stream.isatty()) == (encoding, False)


# Invalid outputs


@pytest.mark.parametrize(
    "command",
    [
        ("render", "quads", "-o"),
        ("render", "quads", "box_room", "-o"),
        ("turntable", "quads", "--frames", "1", "-o"),
        ("animate", "quads", "none.json", "-o"),
        ("inspect", "a.exr", "-o"),
        ("compare", "a.exr", "b.exr", "-o"),
        ("bench", "-o"),
        ("report", "--out"),
        ("stability", "--out"),
    ],
    ids=" ".join,
)
@pytest.mark.parametrize("output", ["", os.devnull, "pipe", "link"])
def test_outputs_that_are_no_files(folder, capsys, command, output):
    os.mkfifo("pipe")
    os.symlink("pipe", "link")
    expected = ("expected the name of a file or folder", f"found {output!r}")
    assert_refused(run(capsys, *command, output), command[-1], *expected)
    assert listing(folder) == ["link", "pipe"]
    assert not os.path.exists(f"{os.devnull}.exr")


# Messages of libraries


def nested(depth: int, opening: str = "[", closing: str = "]") -> str:
    return opening * depth + "1" + closing * depth


@pytest.mark.parametrize("depth", [2, 450, 900, 100_000])
@pytest.mark.parametrize("field", ["eye", "focal", "resolution", "fov", "orthographic"])
def test_cameras_nested_deeply(tmp_path, capsys, field, depth):
    for value in (nested(depth), nested(depth, '{"a": ', "}"), "[0, 1, " + nested(depth) + "]"):
        path = write(tmp_path / "c.json", f'[{{"{field}": {value}}}]')
        assert_refused(run(capsys, "animate", "quads", path, "-o", tmp_path / "f.exr"), "c.json", "expected", "found")


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ('[{"focal": ' + "1" * 1_000_000 + "}]", "a whole number of 1000000 digits"),
        ('[{"focal": -' + "1" * 1001 + "}]", "a whole number of 1002 digits"),
        ('[{"focal": ' + "1" * 400 + "}]", "focal"),
        ('[{"focal": 1e400}]', "focal"),
        ('[{"focal": NaN}]', "a number that is NaN"),
        ('[{"focal": -Infinity}]', "a number that is -Infinity"),
        ('[{"focal": 1, "focal": 2}]', "the key focal twice"),
        ('[{"\\u001b[31m": 1}]', "camera 1"),
        ('[{"\\udce9": 1}]', "camera 1"),
        ('[{"' + "a" * 1_000_000 + '": 1}]', "camera 1"),
        ('[{"eye": [' + "1," * 500_000 + "1]}]", "three finite numbers"),
        ('[{"eye": null}]', "eye: expected three finite numbers, found None"),
    ],
)
def test_strange_numbers_and_names_in_cameras(tmp_path, capsys, text, part):
    path = write(tmp_path / "c.json", text)
    assert_refused(run(capsys, "animate", "quads", path, "-o", tmp_path / "f.exr"), "c.json", part)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ('{"asset": {"version": "2.0"}, "extras": ' + nested(100_000) + "}", "too deep a nesting"),
        ('{"asset": {"version": "2.0"}, "scene": ' + "1" * 1_000_000 + "}", "a whole number of 1000000 digits"),
        ('{"asset": {"version": "2.0"}, "asset": {"version": "2.0"}}', "the key asset twice"),
        ('{"asset": {"version": "2.0"}, "scene": NaN}', "a number that is NaN"),
        ('{"asset": {"version": "2.0"}, "meshes": [' + nested(900) + "]}", "meshes[0]: expected an object"),
        ('{"asset": {"version": "2.0"}, "scene": ' + nested(900) + "}", "expected"),
    ],
)
def test_strange_numbers_and_nesting_in_gltf(tmp_path, text, part):
    refusal(write(tmp_path / "a.gltf", text), "a.gltf: ", part)


def test_decoders_name_no_objects(tmp_path, capsys):
    """Pillow and OpenEXR read from streams, whose addresses they would print."""
    write(tmp_path / "bad.png", b"no image")
    mesh = write(tmp_path / "a.obj", TRIANGLE + "vt 0 0\nf 1/1 2/1 3/1\n")
    text = refusal(mesh, "bad.png", "found something else", texture=tmp_path / "bad.png")
    assert " object at 0x" not in text
    error = ValueError("cannot read <_io.BytesIO object at 0x7f0a1b2c3d4e>:\n no <a> 'x'")
    assert reason_of(error) == "cannot read: no <a> 'x'"
    assert len(reason_of(ValueError("x" * 1000))) == 160
