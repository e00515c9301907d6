"""Cache folders: seals and marks that detect damage, folders for single processes, and obstacles."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest
from processes import python

from clshade.pipeline.opencl import cache_slots, environment
from clshade.pipeline.opencl.cache_slots import MARK, SEAL, Slot

CODE = bytes(range(256)) * 40


def take(folder: Path) -> Slot:
    slot = cache_slots.take(folder)
    assert slot is not None
    return slot


@pytest.fixture
def sealed(tmp_path: Path) -> Path:
    """Return a slot with two compiled files and a program, left in order."""
    slot = take(tmp_path / "slot-0")
    for name in ("pocl/AB/phong.so", "pocl/AB/program.bc", "binaries/0123"):
        (slot.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (slot.folder / name).write_bytes(CODE)
    (slot.pocl / "AB" / "last_accessed").touch()
    slot.seal()
    slot.release()
    return slot.folder


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


# Undamaged files are kept


def test_what_was_sealed_is_kept(sealed):
    before = files(sealed)
    slot = take(sealed)
    assert slot.emptied == ""
    assert files(sealed) == before
    assert {"pocl/AB/phong.so", "pocl/AB/program.bc", "binaries/0123", SEAL} <= before
    slot.release()


def test_what_is_compiled_later_is_sealed_too(sealed):
    slot = take(sealed)
    assert not slot.seal()
    (slot.pocl / "AB" / "setup.so").write_bytes(b"new")
    assert slot.seal()
    assert not slot.seal()
    slot.release()
    slot = take(sealed)
    assert slot.emptied == ""
    assert (slot.pocl / "AB" / "setup.so").read_bytes() == b"new"
    slot.release()


def test_a_file_that_changed_rightly_is_sealed_anew(sealed):
    slot = take(sealed)
    (slot.pocl / "AB" / "phong.so").write_bytes(b"another")
    slot.release()
    assert take(sealed).emptied == ""


def test_notes_of_the_runtime_and_missing_files_are_no_damage(sealed):
    (sealed / "pocl/AB/last_accessed").write_text("changes with every use")
    (sealed / "pocl/AB/phong.so").unlink()
    assert take(sealed).emptied == ""
    assert (sealed / "pocl/AB/program.bc").exists()


def test_a_large_folder_loses_what_was_not_used_for_longest(sealed, monkeypatch):
    """It is not taken for damaged, then or later."""
    slot = take(sealed)
    for k, name in enumerate(("OLD", "NEW", "MID")):
        program = slot.pocl / "CD" / name
        program.mkdir(parents=True)
        for file in ("program.bc", "phong.so", "last_accessed"):
            (program / file).write_bytes(bytes(100_000))
        os.utime(program / "last_accessed", ns=(0, 10**18 * (1, 3, 2)[k] // 10))
    (slot.folder / "binaries" / "4567").write_bytes(bytes(100_000))
    os.utime(slot.folder / "binaries" / "4567", ns=(0, 0))
    slot.release()
    before = files(sealed)
    take(sealed).release()
    assert files(sealed) == before
    others = {name for name in before if not name.startswith("pocl/CD/") and name != "binaries/4567"}
    room = sum((sealed / name).stat().st_size for name in others - {SEAL}) + 250_000  # for one of the programs
    monkeypatch.setattr(cache_slots, "MOST_BYTES", 2 * room)
    for kept in range(2):  # the rest is small enough
        slot = take(sealed)
        assert slot.emptied == ""
        assert {name.split("/")[2] for name in files(sealed) if name.startswith("pocl/CD/")} == {"NEW"}
        assert files(sealed) >= others, kept
        assert "binaries/4567" not in files(sealed)
        slot.release()


def test_what_a_killed_process_left_goes_alone(sealed):
    """They were not yet marked as complete."""
    for name in ("pocl/AB/setup.so", "pocl/tempfile_x", f"{SEAL}.new", "programs/lock"):
        (sealed / name).parent.mkdir(exist_ok=True)
        (sealed / name).write_bytes(b"half")
    slot = take(sealed)
    assert slot.emptied == ""
    assert files(sealed) == {
        "lock",
        SEAL,
        "pocl/AB/last_accessed",
        "pocl/AB/phong.so",
        "pocl/AB/program.bc",
        "binaries/0123",
    }


def test_files_under_way_are_not_sealed(sealed):
    slot = take(sealed)
    (slot.pocl / "tempfile_x").write_bytes(b"half")
    slot.release()
    take(sealed)
    assert not (sealed / "pocl/tempfile_x").exists()


# Damage


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def make_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def link(path: Path) -> None:
    path.rename(path.with_name("elsewhere"))
    path.symlink_to(path.with_name("elsewhere"))


@pytest.mark.parametrize("name", ["pocl/AB/phong.so", "pocl/AB/program.bc", "binaries/0123"])
@pytest.mark.parametrize(
    "damage",
    [flip, lambda path: os.truncate(path, 0), lambda path: os.truncate(path, 5000), make_folder, link],
    ids=["flipped", "empty", "half", "folder", "link"],
)
def test_damage_throws_everything_away(sealed, name, damage):
    status = (sealed / name).stat()
    damage(sealed / name)
    if (sealed / name).is_file():
        os.utime(sealed / name, ns=(status.st_atime_ns, status.st_mtime_ns))  # even the time is the same
    slot = take(sealed)
    assert slot.emptied == f"{Path(name).name} is damaged"
    assert files(sealed) == {"lock"}
    assert slot.pocl.is_dir()


@pytest.mark.parametrize(
    "damage",
    [
        flip,
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(os.urandom(900)),
        lambda path: path.write_bytes(path.read_bytes()[: -len("0" * 64 + " binaries/0123\n")]),
        make_folder,
    ],
    ids=["flipped", "empty", "garbage", "a line less", "folder"],
)
def test_a_damaged_seal(sealed, damage):
    damage(sealed / SEAL)
    assert take(sealed).emptied == "seal is damaged"
    assert files(sealed) == {"lock"}


def test_what_cannot_be_read(sealed, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(cache_slots, "_digest", refuse)
    assert take(sealed).emptied.endswith(" cannot be read (Permission denied)")


def test_it_is_said_in_a_line(sealed, tmp_path, capsys, monkeypatch):
    flip(sealed / "pocl/AB/phong.so")
    for name in ("POCL_CACHE_DIR", "CLSHADE_SET_POCL_CACHE_DIR"):  # which `_adopt` sets
        monkeypatch.setenv(name, "")
    monkeypatch.setattr(environment, "_slot", None)
    environment._adopt(take(sealed))
    said = f"clshade: warning: the kernel cache {sealed} is thrown away and compiled anew: phong.so is damaged\n"
    assert capsys.readouterr().err == said
    again = take_again(sealed)
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path / "own"))
    monkeypatch.setenv("CLSHADE_SET_POCL_CACHE_DIR", "")
    environment._adopt(again)
    assert f"compiled anew, but for POCL_CACHE_DIR, {tmp_path}/own: a run that began" in capsys.readouterr().err


def take_again(folder: Path) -> Slot:
    """Take the slot again after a run that died in it."""
    environment._slot.release()
    (folder / MARK).touch()
    return take(folder)


# Marks


def test_a_mark_lies_there_while_code_is_used_first(sealed):
    slot = take(sealed)
    mark = sealed / MARK
    with slot.using():
        assert mark.exists()
        with slot.using():
            pass
        assert mark.exists(), "the outer one goes on"
    assert not mark.exists()
    for error in (ValueError, KeyboardInterrupt, SystemExit):
        with pytest.raises(error), slot.using():
            raise error
        assert not mark.exists()


DYING = """
import os, signal, sys
from clshade.base import interrupts; from clshade.pipeline.opencl import cache_slots as slots
from pathlib import Path
slot = slots.take(Path({folder!r}))
print(slot.emptied, flush=True)
with slot.using():
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
        ("os.fork() or os._exit(0); os.wait()", False),
    ],
)
def test_how_a_process_ends_decides(sealed, tmp_path, deed, died):
    code = "import resource; resource.setrlimit(resource.RLIMIT_CORE, (0, 0))\n" + DYING
    done = python(code.format(folder=str(sealed), deed=deed), tmp_path)
    assert done.stdout == "\n", done.stderr
    slot = take(sealed)
    assert slot.emptied == ("a run that began to use it ended abruptly" if died else "")
    assert (files(sealed) == {"lock"}) == died
    slot.release()
    assert take(sealed).emptied == "", "once only"


def test_a_forked_child_leaves_mark_and_seal_alone(sealed):
    if not hasattr(os, "fork"):
        pytest.skip("no fork here")
    slot = take(sealed)
    with slot.using():
        child = os.fork()
        if child == 0:
            slot._end()
            os._exit(0)
        os.waitpid(child, 0)
        assert (sealed / MARK).exists()


def test_a_full_disk_takes_neither_mark_nor_seal(sealed, monkeypatch):
    slot = take(sealed)

    def refuse(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "open", refuse)
    monkeypatch.setattr(Path, "write_bytes", refuse)
    with slot.using():
        os.truncate(slot.pocl / "AB" / "phong.so", 5)
    slot.seal()


# Obstacles


@pytest.mark.parametrize("obstacle", ["file", "lock is a folder", "link to nowhere", "of another user"])
def test_a_slot_that_cannot_be_used_is_passed_over(tmp_path, monkeypatch, obstacle):
    if obstacle == "file":
        (tmp_path / "slot-0").write_text("x")
    elif obstacle == "lock is a folder":
        (tmp_path / "slot-0" / "lock").mkdir(parents=True)
    elif obstacle == "link to nowhere":
        (tmp_path / "slot-0").symlink_to(tmp_path / "nowhere" / "there")
    else:
        lock_file = cache_slots.lock_file

        def refuse(path):
            if path.parent.name == "slot-0":
                raise PermissionError(13, "Permission denied")
            return lock_file(path)

        monkeypatch.setattr(cache_slots, "lock_file", refuse)
    for _ in range(2):
        slot = cache_slots.claim(tmp_path)
        assert slot.folder == tmp_path / "slot-1", "kept from run to run"
        slot.release()
    assert not list(tmp_path.glob("once-*"))


def test_a_damaged_slot_that_cannot_be_emptied_is_passed_over(sealed, monkeypatch):
    flip(sealed / "pocl/AB/phong.so")

    def refuse(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(shutil, "rmtree", refuse)
    assert cache_slots.claim(sealed.parent).folder.name == "slot-1"


def test_no_slots_are_tried_where_files_cannot_be_locked(tmp_path, monkeypatch):
    def refuse(path):
        raise OSError(37, "No locks available")

    monkeypatch.setattr(cache_slots, "lock_file", refuse)
    slot = cache_slots.claim(tmp_path)
    assert slot.folder.name.startswith("once-")
    assert len(list(tmp_path.glob("slot-*"))) == 1
    with slot.using():
        assert not (slot.folder / MARK).exists(), "nobody will look"


# Folders for single processes

PRIVATE = """
import os, signal, sys
from pathlib import Path
from clshade.pipeline.opencl import cache_slots as slots
print(slots.private_folder(Path({folder!r}), "once-"), flush=True)
{deed}
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_private_folders_go_with_their_process_or_with_the_next(tmp_path):
    def run(deed: str) -> Path:
        return Path(python(PRIVATE.format(folder=str(tmp_path), deed=deed), tmp_path / "home").stdout.strip())

    assert not run("").exists()
    left = run("os.kill(os.getpid(), signal.SIGKILL)")
    assert left.is_dir()
    used = cache_slots.private_folder(tmp_path, "once-")
    assert not left.exists()
    other = run("os.fork() or os._exit(0); os.wait()")
    assert used.is_dir(), "its process lives"
    assert not other.exists()


@pytest.mark.parametrize("locked", [False, True])
def test_a_private_folder_that_another_process_removes_is_made_anew(tmp_path, monkeypatch, locked):
    """Between creating the lock file and locking it; locked: or while it holds the lock."""
    lock_file, robbed = cache_slots.lock_file, []

    def lock_too_late(path: Path) -> int | None:
        if robbed:
            return lock_file(path)
        robbed.append(path.parent)
        path.touch()
        with path.open("rb") as file:
            shutil.rmtree(path.parent)
            return None if locked else os.dup(file.fileno())

    monkeypatch.setattr(cache_slots, "lock_file", lock_too_late)
    folder = cache_slots.private_folder(tmp_path, "once-")
    assert folder.is_dir()
    assert robbed != [folder]


def test_private_folders_without_locks_go_when_they_are_old(tmp_path):
    for name in ("once-old", "once-new", "other"):
        (tmp_path / name).mkdir()
    for name in ("once-old", "other"):
        os.utime(tmp_path / name, (1, 1))
    (tmp_path / "once-link").symlink_to(tmp_path / "other")
    used = cache_slots.private_folder(tmp_path, "once-")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["once-new", "once-link", "other", used.name])
