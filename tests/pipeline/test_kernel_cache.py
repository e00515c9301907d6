"""Compiled programs and arrays on disk: what is stored, and that damage costs a line and time, but no wrong pixel.

And what is said while kernels are compiled.
"""

import contextlib
import os
import random
import shutil
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest.mock import Mock

import numpy as np
import pyopencl as cl
import pytest
from processes import python

from clshade.base import console
from clshade.pipeline import programs, shading_tables
from clshade.pipeline.features import Features
from clshade.pipeline.opencl import program_store
from clshade.pipeline.opencl.program_store import StoredProgram

FILES = {"AB/CD/phong/1-1-1/phong.so": bytes(range(256)) * 40, "AB/CD/program.bc": b"code", "AB/CD/empty": b""}


@pytest.fixture
def stored(tmp_path, monkeypatch) -> Path:
    monkeypatch.setattr(program_store, "_said", set())
    StoredProgram(tmp_path / "programs" / "0123").write(FILES)
    return tmp_path / "programs" / "0123"


def test_what_processes_compile_comes_together(stored):
    first, second = StoredProgram(stored), StoredProgram(stored)
    assert first.read() == second.read() == FILES
    assert "phong" in first
    assert "setup" not in first
    assert StoredProgram(stored.parent / "4567").read() == {}
    first.write({"AB/CD/setup.so": b"new"})
    second.write({"AB/CD/bin.so": b"newer"})
    assert StoredProgram(stored).read() == {**FILES, "AB/CD/setup.so": b"new", "AB/CD/bin.so": b"newer"}
    written = stored.stat().st_mtime_ns
    second.write({"AB/CD/bin.so": b"newer"})
    assert stored.stat().st_mtime_ns == written
    assert os.listdir(stored.parent) == ["0123"]


def test_what_was_not_used_for_longest_goes(stored, monkeypatch):
    monkeypatch.setattr(program_store, "MOST_BYTES", 4 * stored.stat().st_size)
    for k, name in enumerate(("old", "new", "mid")):
        StoredProgram(stored.with_name(name)).write(FILES)
        os.utime(stored.with_name(name), (k * 10, (10, 30, 20)[k]))
    assert StoredProgram(stored).read(), "reading is using"
    StoredProgram(stored.with_name("last")).write(FILES)
    assert sorted(os.listdir(stored.parent)) == ["0123", "last"]


def flip(path: Path, place: float = 0.5) -> None:
    data = bytearray(path.read_bytes())
    data[int(place * (len(data) - 1))] ^= 1
    path.write_bytes(data)


def make_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def test_damage_is_told_once_and_compiled_anew(stored, capsys):
    texts = (partial(Path.write_bytes, data=text) for text in (b"", b"x\ny\nz"))
    for damage in (*texts, *(partial(flip, place=place) for place in (0.0, 0.01, 0.5, 1.0)), make_folder):
        StoredProgram(stored).write(FILES)
        program_store._said.clear()
        damage(stored)
        for _ in range(2):
            assert StoredProgram(stored).read() == {}
        (line,) = capsys.readouterr().err.splitlines()
        assert f"warning: a compiled program in {stored.parent} is thrown away and compiled anew: it " in line
        assert not stored.exists()


def test_a_full_disk_stores_and_marks_nothing(stored, monkeypatch):
    program, refuse = StoredProgram(stored), Mock(side_effect=OSError(28, "No space left on device"))
    program.read()
    with monkeypatch.context() as patch:
        patch.setattr(os, "open", refuse)
        patch.setattr(Path, "write_bytes", refuse)
        with program.first_use():
            program.write({"AB/CD/setup.so": b"new"})
    assert StoredProgram(stored).read() == FILES


def test_a_mark_lies_there_while_code_is_used_first(stored):
    program, mark = StoredProgram(stored), stored.with_name("0123.in-use")
    with program.first_use():
        assert not mark.exists(), "nothing comes from the disk"
    program.read()
    for error in (ValueError, KeyboardInterrupt, SystemExit):
        with contextlib.suppress(error), program.first_use():
            assert mark.exists()
            with program.first_use():
                assert StoredProgram(stored).read() == FILES, "its process lives"
            raise error
        assert not mark.exists()


DYING = """
import os, signal, sys
from pathlib import Path
from clshade.base import interrupts
from clshade.pipeline.opencl.program_store import StoredProgram
program = StoredProgram(Path({path!r}))
program.read()
with program.first_use():
    print(os.path.exists({path!r} + ".in-use"), flush=True)
    {deed}
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize(
    ("deed", "died"),
    [
        ("os.kill(os.getpid(), signal.SIGKILL)", True),
        ("interrupts.leave_soon(); os.kill(os.getpid(), signal.SIGINT); __import__('time').sleep(5)", False),
        ("os.fork() or sys.exit(); os.wait(); assert list(program.path.parent.glob('*.in-use'))", False),
    ],
)
def test_how_a_process_ends_decides(stored, tmp_path, capsys, deed, died):
    done = python(DYING.format(path=str(stored), deed=deed), tmp_path)
    assert done.stdout == "True\n", done.stderr
    assert "AssertionError" not in done.stderr
    assert StoredProgram(stored).read() == ({} if died else FILES)
    assert ("a run that began to use it ended abruptly" in capsys.readouterr().err) == died
    assert os.listdir(stored.parent) == ([] if died else ["0123"])


SMALL = ["render", "quads", "--resolution", "64,48", "--shader", "nolight", "--samples", "1", "--deterministic"]


class Run(NamedTuple):
    code: int
    images: tuple[bytes, ...]
    said: list[str]


def run(folder: Path, device: str) -> Run:
    """Run with the cache in `folder`."""
    for path in folder.glob("image.*"):
        path.unlink()
    code = """
import sys; sys.argv[0] = 'clshade'
from clshade.base import console; console.SLOW = 1e6  # no word about slow steps
from clshade.__main__ import entry; entry()"""
    arguments = *SMALL, "-o", str(folder / "image"), "--device", device
    # Without a writable cache the temporary folder is used, which tests must not share.
    done = python(code, folder / "cache", *arguments, timeout=200.0, TMPDIR=str(folder))
    images = tuple(path.read_bytes() for path in sorted(folder.glob("image.*")))
    return Run(done.returncode, images, done.stderr.splitlines())


@pytest.fixture(scope="module")
def kept(opened, tmp_path_factory) -> tuple[Path, Run]:
    """Return a folder with the cache of a run, and the result of a run that finds everything in it."""
    if not opened.keeps_programs:
        pytest.skip("only PoCL keeps its kernels in our folder")
    folder = tmp_path_factory.mktemp("kept")
    first = run(folder, opened.index)
    assert first.code == 0, first.said
    second = run(folder, opened.index)
    assert (second.code, second.images, second.said) == (0, first.images, [])
    return folder, second


@pytest.fixture
def cached(kept, tmp_path) -> Path:
    shutil.copytree(kept[0] / "cache", tmp_path / "cache")
    return tmp_path


def every(change, pattern="*"):
    """Return what applies the change to every file of a cache that is not empty and matches the pattern."""
    return lambda cache: [change(p) for p in list(cache.rglob(pattern)) if p.is_file() and p.stat().st_size]


def file_instead(name):
    return lambda cache: (shutil.rmtree(cache / name), (cache / name).write_text("x"))


PROGRAMS = "[0-9a-f]" * 64
KINDS = {  # of verdicts: test_device.py
    "all garbage": every(lambda path: path.write_bytes(random.Random(path.name).randbytes(path.stat().st_size))),
    "programs flipped": every(flip, PROGRAMS),
    "clshade a file": file_instead("clshade"),
    "no folder of programs": file_instead("clshade/programs"),
}


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_damage(kept, cached, opened, kind):
    KINDS[kind](cached / "cache")
    first = run(cached, opened.index)
    assert (first.code, first.images) == (0, kept[1].images), first.said
    thrown = [line for line in first.said if "is thrown away and compiled anew: " in line]
    assert bool(thrown) == kind.startswith("programs"), "a trial of the device throws away without a word"
    remarks = [line for line in first.said if line not in thrown]
    elsewhere = "clshade: warning: compiled kernels are kept in "
    prefixes = ("clshade: compiling kernels for ", "clshade: trying out ", elsewhere)
    assert all(line.startswith(prefixes) for line in remarks), first.said
    second = run(cached, opened.index)
    assert (second.code, second.images) == (0, kept[1].images)
    assert all(line.startswith(elsewhere) for line in second.said), "the next one has nothing to compile"
    assert bool(second.said) == (kind == "clshade a file")


@pytest.mark.parametrize("level", [console.NORMAL, console.QUIET])
def test_what_takes_long_is_said_once(level, monkeypatch, capfd):
    monkeypatch.setattr(programs, "_said", False)
    monkeypatch.setattr(programs, "this_thread", type(programs.this_thread)())
    monkeypatch.setattr(programs, "SLOW", 0.24)
    device: Any = SimpleNamespace(title="PoCL: CPU")
    with console.at_level(level):
        for _ in range(3):
            with programs.first_use(device, None):
                time.sleep(0.12)
    line = "clshade: compiling kernels for PoCL: CPU ...\n" if level == console.NORMAL else ""
    assert capfd.readouterr().err == line


def test_a_build_is_tried_again_without_options_that_are_refused(opened, monkeypatch):
    def refuse(program: Any, options: list[str]) -> str:
        if programs._LESS_OPTIMIZED in options:
            raise cl.RuntimeError("invalid options")
        return "built"

    monkeypatch.setattr(programs, "_without_log", refuse)
    assert programs.compiled(opened, "", ["-DA", programs._LESS_OPTIMIZED]) == "built"


@pytest.mark.long
def test_a_warning_of_the_compiler_is_said_and_fails_a_test(opened, tmp_path, monkeypatch, capfd):
    """By `unwarned` in conftest.py. PoCL keeps the log with a program, which warns again when it is loaded."""
    place = tmp_path / "program"
    monkeypatch.setattr(programs, "_stored_program", lambda *_: StoredProgram(place))
    monkeypatch.setattr(program_store, "_said", set())
    text = "#warning planted\nkernel void warned(global int *x) { x[0] = 1; }"
    for word in ("compiled", "loaded", "compiled") if opened.keeps_programs else ("compiled",):
        with console.at_level(console.VERBOSE), pytest.raises(AssertionError, match=r"text:1:.*planted"):
            programs.build(opened, Features.of(), text)
        said = capfd.readouterr().err
        assert "clshade: the compiler warns: " in said
        assert f"clshade: {word} a program of 1 kernels" in said
        flip(place) if word == "loaded" else None
    assert "is thrown away and compiled anew: it is damaged" in said


ROW = np.zeros(2, [("a", "i4"), ("b", "f4", 3)])
TABLE = np.arange(12.0, dtype=np.float32).reshape(3, 4)


def computed(code: Path, *inputs: bytes) -> int:
    calls = []

    def compute() -> tuple[np.ndarray, np.ndarray]:
        calls.append(1)
        return ROW, TABLE

    row, table = shading_tables.kept([code], inputs, compute)
    assert (row.dtype, row.tobytes()) == (ROW.dtype, ROW.tobytes())
    assert (table.dtype, table.tolist()) == (TABLE.dtype, TABLE.tolist())
    return len(calls)


def test_arrays_are_computed_once_for_equal_inputs_and_code(fresh_cache, tmp_path):
    code, folder = tmp_path / "code.py", fresh_cache / "tables"
    code.write_text("one")
    assert [computed(code, *inputs) for inputs in ([b"ab"], [b"ab"], [b"a", b"b"], [b"ab"])] == [1, 0, 1, 0]
    code.write_text("two")
    assert [computed(code, b"ab"), computed(code, b"ab")] == [1, 0]
    for k in range(11):
        computed(code, bytes([k]))
    assert len(list(folder.iterdir())) == 8, "the last ones"
    assert computed(code, bytes([10])) == 0


def test_damaged_arrays_are_computed_again(fresh_cache):
    code = Path(__file__)
    computed(code)
    (path,) = (fresh_cache / "tables").iterdir()
    data = path.read_bytes()
    for place in (0, 40, 200, -40, -1):
        for damaged in (data[:place], data[:place] + bytes([data[place] ^ 0x55]) + data[place:][1:]):
            path.write_bytes(damaged)
            computed(code)
        assert computed(code) == 0
