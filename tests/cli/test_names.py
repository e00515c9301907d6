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
from command_line import assert_refused, listing, needs_device, process, run, without_notices
from scene_files import TRIANGLE, course_dict, refusal, save_npy, write

from clshade.base import console
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
    assert (done.returncode, without_notices(done.stderr)) == (0, [])
    assert "2x2" in done.stdout


def test_a_current_folder_that_was_removed(tmp_path):
    code = "import os, sys; os.rmdir(os.getcwd()); from clshade.cli.main import main; sys.exit(main(sys.argv[1:]))"
    folder = tmp_path / "gone"
    folder.mkdir()
    command = [sys.executable, "-c", code, "render", "-o", "x"]
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


@pytest.mark.sampled
@needs_device
def test_such_names_are_written_and_shown(monkeypatch, capsys, name):
    """Of scenes, images, cameras and layers."""
    layer = name if "\udce9" not in name else "R"
    pixels = np.arange(12.0).reshape(3, 4)
    exr.write(f"{name}.exr", {layer: pixels}, metadata={"comment": name})
    exr.write("b.exr", {layer: pixels + 1})
    save_npy(f"{name}.npy", course_dict())
    write(Path(f"{name}.json"), json.dumps([{"eye": [0, 0, 6], "resolution": [8, 6]}]))

    def shown(*arguments: str, code: int = 0) -> str:
        """Return what a command line prints, which cannot harm a terminal."""
        capsys.readouterr()
        terminal = Terminal("ascii")
        monkeypatch.setattr("sys.stdout", terminal)
        assert main([*arguments]) == code, arguments
        err = re.sub(r"\r.*", "", capsys.readouterr().err)  # except the bar, which reports another size
        for text in (terminal.shown(), err):
            assert text.replace("\n", "").isprintable(), ascii(text)
            assert not any(line.startswith("line") for line in text.splitlines())  # from the name with a line feed
        return terminal.shown()

    shown("inspect", f"{name}.exr", "--pixel", "1,1", "-o", f"{name}.png")
    shown("view", f"{name}.exr", "b.exr", "-o", f"{name}.html")
    shown("compare", f"{name}.exr", "b.exr", "-o", f"{name} 2.png", "-v")
    assert json.loads(shown("inspect", f"{name}.exr", "--json"))["file"] == f"{name}.exr"
    shown("render", f"{name}.npy", *SIZE, "-o", f"{name}.r", "-v")
    files = {f"{name}.png", f"{name}.html", f"{name} 2.png", f"{name}.r.exr", f"{name}.r.png"}
    assert files <= set(os.listdir())
    out = shown("render", f"{name}.npy", "no.npy", *SIZE, "-o", f"{name}/", "--json", code=2)
    assert json.loads(out)[0]["output"] == os.path.join(name, name)
    assert sorted(os.listdir(name)) == sorted([f"{name}.exr", f"{name}.png"])
    frames = ("turntable", f"{name}.npy", *SIZE, "--frames", "1..2", "-o", f"{name}.##.exr", "--json")
    assert json.loads(shown(*frames))["last"] == f"{name}.02.exr"
    shown("animate", f"{name}.npy", f"{name}.json", "--verbose", "-o", f"{name}.b.##.exr")


def test_refusals_of_such_names(capsys, name):
    for command in (
        *("{}", "render {}.npy", "render --{}", "render quads --layers {}", "render {}.obj {}.glb -o {}/no/"),
        *("turntable quads --frames {}", "animate quads {}.json", "view {}.exr {}.png", "inspect a.exr -o {}.jpg"),
        *("stability --case {}", "bench {}"),
    ):
        code, out, err = run(capsys, *(argument.format(name) for argument in command.split()))
        assert (code, out) == (2, "")
        assert err
        assert all(line.isprintable() and line.startswith("clshade") for line in err), err


@pytest.mark.parametrize(
    ("text", "encoding", "expected"),
    [
        ("é…\n\n", "utf-8", "é…\n\n"),
        ("é…\n", "latin-1", "é\\u2026\n"),
        ("a\x1b[31m\r\tb\x00\x7f\x9b\n", "utf-8", "a\\x1b[31m\\r\\tb\\x00\\x7f\\x9b\n"),
        ("caf\udce9\n", "utf-8", "caf\\udce9\n"),
        ("\u202eright to left\u2028", "utf-8", "\\u202eright to left\\u2028"),
        ("\U0001f600", "ascii", "\\U0001f600"),
    ],
)
def test_what_is_printed(text, encoding, expected):
    terminal = Terminal(encoding)
    stream = _Stdout(terminal)
    assert stream.write(text) == len(text)
    stream.flush()
    assert terminal.shown() == expected == console.printable(text, encoding)


# Invalid outputs


@pytest.mark.parametrize("output", ["", os.devnull, "link"])
def test_outputs_that_are_no_files(folder, capsys, output):
    os.mkfifo("pipe")
    os.symlink("pipe", "link")
    for command in (
        *("render quads -o", "render quads box_room -o", "turntable quads --frames 1 -o", "inspect a.exr -o"),
        *("compare a.exr b.exr -o", "bench -o", "report --out", "stability --out"),
    ):
        expected = ("expected the name of a file or folder", f"found {output!r}")
        assert_refused(run(capsys, *command.split(), output), command.split()[-1], *expected)
    assert listing(folder) == ["link", "pipe"]
    assert not os.path.exists(f"{os.devnull}.exr")


# Messages of libraries


def test_decoders_name_no_objects(tmp_path, capsys):
    """Pillow and OpenEXR read from streams, whose addresses they would print."""
    write(tmp_path / "bad.png", b"no image")
    mesh = write(tmp_path / "a.obj", TRIANGLE + "vt 0 0\nf 1/1 2/1 3/1\n")
    text = refusal(mesh, "bad.png", "found something else", texture=tmp_path / "bad.png")
    assert " object at 0x" not in text
