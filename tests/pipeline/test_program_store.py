"""Compiled programs on disk, marks that tell of runs that did not survive them, and folders for single processes."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from pathlib import Path

import pytest
from processes import python

from clshade.pipeline.opencl import environment, program_store
from clshade.pipeline.opencl.program_store import StoredProgram

FILES = {"AB/CD/phong/1-1-1/phong.so": bytes(range(256)) * 40, "AB/CD/program.bc": b"code", "AB/CD/empty": b""}


@pytest.fixture
def stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the path of a stored program."""
    monkeypatch.setattr(program_store, "_said", set())
    StoredProgram(tmp_path / "programs" / "0123").write(FILES)
    return tmp_path / "programs" / "0123"


def test_a_program_is_read_as_it_was_written(stored: Path) -> None:
    program = StoredProgram(stored)
    assert program.read() == FILES
    assert "phong" in program
    assert "setup" not in program
    assert StoredProgram(stored.parent / "4567").read() == {}
    assert sorted(path.name for path in stored.parent.iterdir()) == ["0123"]


def test_what_processes_compile_comes_together(stored: Path) -> None:
    """A file whose name is known is not written again."""
    first, second = StoredProgram(stored), StoredProgram(stored)
    for program in (first, second):
        program.read()
    first.write({"AB/CD/setup.so": b"new"})
    second.write({"AB/CD/bin.so": b"newer"})
    assert StoredProgram(stored).read() == {**FILES, "AB/CD/setup.so": b"new", "AB/CD/bin.so": b"newer"}
    written = stored.stat().st_mtime_ns
    second.write({"AB/CD/bin.so": b"newer"})
    assert stored.stat().st_mtime_ns == written


def test_what_was_not_used_for_longest_goes(stored: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    size = stored.stat().st_size
    monkeypatch.setattr(program_store, "MOST_BYTES", 4 * size)
    for k, name in enumerate(("old", "new", "mid")):
        StoredProgram(stored.with_name(name)).write(FILES)
        os.utime(stored.with_name(name), (k * 10, (10, 30, 20)[k]))
    assert StoredProgram(stored).read(), "reading is using"
    StoredProgram(stored.with_name("last")).write(FILES)
    assert sorted(path.name for path in stored.parent.iterdir()) == ["0123", "last"]


@pytest.mark.parametrize("damage", [b"", b"x", b"x\ny\nz", None], ids=["empty", "short", "garbage", "a folder"])
def test_damage_is_told_and_compiled_anew(
    stored: Path, capsys: pytest.CaptureFixture[str], damage: bytes | None
) -> None:
    stored.unlink()
    if damage is None:
        stored.mkdir()
    else:
        stored.write_bytes(damage)
    for _ in range(2):
        assert StoredProgram(stored).read() == {}
        StoredProgram(stored.with_name("other")).read()
    line = f"clshade: warning: a compiled program in {stored.parent} is thrown away and compiled anew: it "
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(line)
    assert damage is None or not stored.exists()


def test_a_flipped_bit_is_found(stored: Path) -> None:
    data = bytearray(stored.read_bytes())
    for place in (0, 70, len(data) // 2, len(data) - 1):
        data[place] ^= 1
        stored.write_bytes(data)
        assert StoredProgram(stored).read() == {}, place
        data[place] ^= 1


def test_a_full_disk_stores_and_marks_nothing(stored: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = StoredProgram(stored)
    program.read()

    def refuse(*arguments: object, **options: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "open", refuse)
    monkeypatch.setattr(Path, "write_bytes", refuse)
    with program.first_use():
        program.write({"AB/CD/setup.so": b"new"})
    monkeypatch.undo()
    assert StoredProgram(stored).read() == FILES


# Marks


def mark_of(stored: Path) -> Path:
    return stored.with_name("0123.in-use")


def test_a_mark_lies_there_while_code_is_used_first(stored: Path) -> None:
    program = StoredProgram(stored)
    with program.first_use():
        assert not mark_of(stored).exists(), "nothing comes from the disk"
    program.read()
    for error in (ValueError, KeyboardInterrupt, SystemExit):
        with contextlib.suppress(error), program.first_use():
            assert mark_of(stored).exists()
            with program.first_use():
                assert StoredProgram(stored).read() == FILES, "its process lives"
            raise error
        assert not mark_of(stored).exists()


DYING = """
import os, signal, sys
from pathlib import Path
from clshade.base import interrupts
from clshade.pipeline.opencl.program_store import StoredProgram
import resource; resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
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
        ("os.kill(os.getpid(), signal.SIGSEGV)", True),
        ("os.kill(os.getpid(), signal.SIGKILL)", True),
        ("os.abort()", True),
        ("sys.exit(3)", False),
        ("raise KeyboardInterrupt", False),
        ("interrupts.leave_soon(); os.kill(os.getpid(), signal.SIGINT); __import__('time').sleep(5)", False),
        ("os.fork() or sys.exit(); os.wait(); assert list(program.path.parent.glob('*.in-use'))", False),
    ],
)
def test_how_a_process_ends_decides(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], deed: str, died: bool
) -> None:
    done = python(DYING.format(path=str(stored), deed=deed), tmp_path)
    assert done.stdout == "True\n", done.stderr
    assert "AssertionError" not in done.stderr
    assert StoredProgram(stored).read() == ({} if died else FILES)
    assert ("a run that began to use it ended abruptly" in capsys.readouterr().err) == died
    assert not mark_of(stored).exists()


# Folders for single processes

PRIVATE = """
import os, signal, sys
from pathlib import Path
from clshade.pipeline.opencl import environment
print(environment.private_folder(Path({folder!r}), "once-"), flush=True)
{deed}
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_private_folders_go_with_their_process_or_with_the_next(tmp_path: Path) -> None:
    def run(deed: str) -> Path:
        return Path(python(PRIVATE.format(folder=str(tmp_path), deed=deed), tmp_path / "home").stdout.strip())

    assert not run("").exists()
    left = run("os.kill(os.getpid(), signal.SIGKILL)")
    assert left.is_dir()
    used = environment.private_folder(tmp_path, "once-")
    assert not left.exists()
    forked = run("os.fork() or os._exit(0); os.wait()")
    assert used.is_dir(), "its process lives"
    assert not forked.exists()


@pytest.mark.parametrize("locked", [False, True])
def test_a_private_folder_that_another_process_removes_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, locked: bool
) -> None:
    """Between creating the lock file and locking it; locked: or while it holds the lock."""
    lock_file, robbed = environment.lock_file, list[Path]()

    def lock_too_late(path: Path) -> int | None:
        if robbed:
            return lock_file(path)
        robbed.append(path.parent)
        path.touch()
        with path.open("rb") as file:
            shutil.rmtree(path.parent)
            return None if locked else os.dup(file.fileno())

    monkeypatch.setattr(environment, "lock_file", lock_too_late)
    folder = environment.private_folder(tmp_path, "once-")
    assert folder.is_dir()
    assert robbed != [folder]


def test_private_folders_without_locks_go_when_they_are_old(tmp_path: Path) -> None:
    for name in ("once-old", "once-new", "other"):
        (tmp_path / name).mkdir()
    for name in ("once-old", "other"):
        os.utime(tmp_path / name, (1, 1))
    (tmp_path / "once-link").symlink_to(tmp_path / "other")
    used = environment.private_folder(tmp_path, "once-")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["once-new", "once-link", "other", used.name])
