"""What is printed: names are escaped that terminals might obey or cannot show, and tables fit 100 columns."""

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
from hypothesis import given
from hypothesis import strategies as st
from scene_files import TRIANGLE, course_dict, refusal, save_npy, write

from clshade.base import console, text_tables
from clshade.cli.main import _Stdout, main
from clshade.images import compare, exr, png, statistics
from clshade.images.image_file import Picture
from clshade.pipeline.opencl import device as devices

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
    done = process("inspect", "a.obj", cwd=tmp_path, PYTHONUTF8="0", PYTHONCOERCECLOCALE="0", LC_ALL="C")
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


@pytest.mark.long
@needs_device
def test_such_names_are_written_and_shown(monkeypatch, capsys, name):
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
    assert {f"{name}.png", f"{name}.html", f"{name} 2.png", f"{name}.r.exr", f"{name}.r.png"} <= set(os.listdir())
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


@pytest.mark.parametrize(("text", "encoding", "expected"), [
    ("é…\n\n", "utf-8", "é…\n\n"),
    ("é…\n", "latin-1", "é\\u2026\n"),
    ("a\x1b[31m\r\tb\x00\x7f\x9b\n", "utf-8", "a\\x1b[31m\\r\\tb\\x00\\x7f\\x9b\n"),
    ("caf\udce9\n", "utf-8", "caf\\udce9\n"),
    ("\u202eright to left\u2028", "utf-8", "\\u202eright to left\\u2028"),
    ("\U0001f600", "ascii", "\\U0001f600"),
])  # fmt: skip
def test_what_is_printed(text, encoding, expected):
    terminal = Terminal(encoding)
    stream = _Stdout(terminal)
    assert stream.write(text) == len(text)
    stream.flush()
    assert terminal.shown() == expected == console.printable(text, encoding)


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


def test_decoders_name_no_objects(tmp_path, capsys):
    """Pillow and OpenEXR read from streams, whose addresses they would print."""
    write(tmp_path / "bad.png", b"no image")
    mesh = write(tmp_path / "a.obj", TRIANGLE + "vt 0 0\nf 1/1 2/1 3/1\n")
    assert " object at 0x" not in refusal(mesh, "bad.png", "found something else", texture=tmp_path / "bad.png")


LONG = "a_name_with_very_many_letters" * 8
CELLS = st.text(alphabet="abc|. ", max_size=30).map(str.strip)


def assert_fits(text: str | list[str]) -> None:
    lines = text.splitlines() if isinstance(text, str) else "\n".join(text).splitlines()
    assert lines
    too_long = [line for line in lines if len(line) > 100]
    assert not too_long, too_long


@given(st.data(), st.integers(1, 14), st.integers(1, 4), st.integers(1, 2))
def test_any_table_fits_and_holds_every_cell(data, columns, count, left):
    left = min(left, columns)
    header, *rows = [[data.draw(CELLS) for _ in range(columns)] for _ in range(count)]
    lines = text_tables.as_lines(header, rows, left)
    assert_fits([*lines, "."])
    blocks = len(lines) // count
    assert len(lines) == blocks * count
    for k, row in enumerate((header, *rows)):
        words = " ".join(lines[block * count + k] for block in range(blocks)).split()
        for cell in row:
            assert all(word in words for word in cell.split()), (cell, words)


def test_names_without_end_are_cut_in_the_middle():
    (head, line) = text_tables.as_lines(("name", "n"), [("start" + LONG + "end", "12345")])
    assert_fits([head, line])
    assert line.startswith("start")
    assert line.endswith("end  12345")


def long_layers() -> dict[str, np.ndarray]:
    wild = np.float32([[1.2345678e-38, -9.8765432e37, np.nan, np.inf]])
    return dict.fromkeys(("R", "G", "B", "A", LONG, f"{LONG}.X", f"{LONG}.Y"), wild) | {
        "id": np.uint32([[2**32 - 1] * 4])
    }


def test_statistics_and_comparisons():
    assert_fits(statistics.format_statistics(statistics.image_statistics(long_layers())))
    halves = {name: plane / 2 if plane.dtype == np.float32 else plane for name, plane in long_layers().items()}
    comparison = compare.compare_layers(Picture(halves, name="a"), Picture(long_layers(), name="b"), (), 1.2345678e-30)
    table = [line for line in comparison.lines() if not any(LONG in word for word in line.split())]
    assert len(table) > 10
    assert_fits(table)


def test_devices(monkeypatch, capsys):
    name = "Some Processor " * 9
    infos = [devices.DeviceInfo("0:0", "A Platform", name, driver="1.2.3 " * 20, works=True, problem="")]
    infos += [devices.DeviceInfo("1:0", "Another", name, problem="it does not build a program, " * 9)]
    monkeypatch.setattr(devices, "list_devices", lambda: infos)
    assert_fits(run(capsys, "devices", "--verbose")[1])
