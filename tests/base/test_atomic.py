"""Files are written completely or not at all."""

from __future__ import annotations

import errno
import os
import stat

import pytest

from clshade.base import atomic_files
from clshade.errors import OutputError


@pytest.fixture
def kept(tmp_path):
    """Return a folder with one earlier file; check afterwards that both are unchanged."""
    earlier = tmp_path / "earlier.bin"
    earlier.write_bytes(b"earlier")
    yield earlier
    assert earlier.read_bytes() == b"earlier"
    assert os.listdir(tmp_path) == ["earlier.bin"]


def refusal(call, *arguments) -> str:
    with pytest.raises(OutputError) as caught:
        call(*arguments)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_writes_and_replaces(tmp_path):
    path = tmp_path / "a.bin"
    atomic_files.write_bytes(path, b"one")
    atomic_files.write_bytes(str(path), b"two")
    assert path.read_bytes() == b"two"
    assert os.listdir(tmp_path) == ["a.bin"]


def test_the_earlier_file_stays_until_the_end(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"one")
    with atomic_files.replacing(path) as file:
        file.write(b"two")
        file.flush()
        assert path.read_bytes() == b"one"
    assert path.read_bytes() == b"two"


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_new_file_has_the_permissions_the_umask_leaves(tmp_path, umask, mode):
    before = os.umask(umask)
    try:
        atomic_files.write_bytes(tmp_path / "a.bin", b"")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.bin").stat().st_mode) == mode


def test_a_replaced_file_keeps_its_permissions(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"")
    path.chmod(0o640)
    atomic_files.write_bytes(path, b"new")
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_a_link_is_followed(tmp_path):
    (tmp_path / "real.bin").write_bytes(b"old")
    (tmp_path / "link.bin").symlink_to("real.bin")
    atomic_files.write_bytes(tmp_path / "link.bin", b"new")
    assert (tmp_path / "link.bin").is_symlink()
    assert (tmp_path / "real.bin").read_bytes() == b"new"


def test_a_name_as_long_as_the_file_system_takes(tmp_path):
    atomic_files.write_bytes(tmp_path / ("n" * 255), b"x")
    text = refusal(atomic_files.write_bytes, tmp_path / ("n" * 256), b"x")
    assert os.strerror(errno.ENAMETOOLONG) in text
    assert os.listdir(tmp_path) == ["n" * 255]


def test_refused_targets(kept):
    folder = kept.parent
    assert "there is no folder" in refusal(atomic_files.write_bytes, folder / "none" / "a.bin", b"")
    assert "is not a folder" in refusal(atomic_files.write_bytes, kept / "a.bin", b"")
    assert "it is a folder" in refusal(atomic_files.write_bytes, folder, b"")
    assert "it is a folder" in refusal(atomic_files.write_bytes, f"{folder}/new/", b"")
    assert "not a regular file" in refusal(atomic_files.write_bytes, os.devnull, b"")
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)
    assert "null" in refusal(atomic_files.write_bytes, f"{folder}/a\0b", b"")
    assert refusal(atomic_files.write_bytes, folder / "two\nlines" / "a.bin", b"").startswith("'")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_an_unwritable_folder(tmp_path):
    tmp_path.chmod(0o500)
    assert os.strerror(errno.EACCES) in refusal(atomic_files.write_bytes, tmp_path / "a.bin", b"")


@pytest.mark.parametrize("replaced", [False, True])
def test_a_file_removed_between_two_looks_at_it(tmp_path, monkeypatch, replaced):
    """Another process that writes the same files removes or replaces it: nothing is in the way of writing."""
    path, substitute = tmp_path / "a.bin", tmp_path / "other"
    path.write_bytes(b"earlier")
    access, looks = os.access, []

    def removing(target, mode):
        looks.append(target)
        if len(looks) > 1:
            return access(target, mode)
        substitute.write_bytes(b"other")
        os.replace(substitute, path)
        if not replaced:
            os.unlink(path)
        return False

    monkeypatch.setattr(os, "access", removing)
    atomic_files.write_bytes(path, b"new")
    assert path.read_bytes() == b"new"
    assert os.listdir(tmp_path) == ["a.bin"]
    assert len(looks) == (2 if replaced else 1)


@pytest.mark.parametrize("operation", ["open", "fsync", "replace", "fchmod"])
@pytest.mark.parametrize("number", [errno.EACCES, errno.ENOSPC, errno.EROFS, errno.EIO])
def test_a_failing_step(kept, monkeypatch, operation, number):
    def fail(*arguments, **options):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, operation, fail)
    text = refusal(atomic_files.write_bytes, kept, b"new")
    monkeypatch.undo()
    assert text == f"{kept}: cannot be written: {os.strerror(number)}"


def test_a_file_system_that_cannot_sync(tmp_path, monkeypatch):
    def fail(descriptor):
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(os, "fsync", fail)
    atomic_files.write_bytes(tmp_path / "a.bin", b"x")
    assert (tmp_path / "a.bin").read_bytes() == b"x"


@pytest.mark.parametrize("error", [OSError("odd"), MemoryError(), OSError(errno.ENOSPC, "No space left on device")])
def test_an_error_in_the_block(kept, error):
    def use():
        with atomic_files.replacing(kept) as file:
            file.write(b"half")
            raise error

    assert refusal(use).startswith(f"{kept}: cannot be written: ")


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, ValueError, ZeroDivisionError])
def test_other_errors_pass_and_leave_nothing(kept, error):
    def use():
        with atomic_files.replacing(kept) as file:
            file.write(b"half")
            raise error

    with pytest.raises(error):
        use()


def test_a_full_disk(kept):
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        text = refusal(atomic_files.write_bytes, kept, bytes(100_001))
        small = refusal(atomic_files.write_bytes, kept, bytes(2_000_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert text == small == f"{kept}: cannot be written: {os.strerror(errno.EFBIG)}"


# Leftovers of killed processes


def test_leftovers_of_killed_processes_are_swept_up(tmp_path, monkeypatch):
    old, new, link = (tmp_path / f".clshade-{digit * 16}.tmp" for digit in "0af")
    names = tmp_path / ".clshade-notes.tmp", tmp_path / "x.tmp"
    for file in (old, new, *names):
        file.write_bytes(b"half")
    link.symlink_to(old)
    for file in (old, *names):
        os.utime(file, (1, 1))
    atomic_files.write_bytes(tmp_path / "a.bin", b"x")
    left = {".clshade-notes.tmp", "x.tmp", new.name, link.name, "a.bin"}
    assert set(os.listdir(tmp_path)) == left
    monkeypatch.setattr(os, "scandir", lambda _: pytest.fail("a folder is looked through once in a process"))
    atomic_files.write_bytes(tmp_path / "a.bin", b"y")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")
def test_leftovers_of_others_stay(tmp_path):
    left = tmp_path / f".clshade-{'1' * 16}.tmp"
    left.touch()
    os.chown(left, 12345, -1)
    os.utime(left, (1, 1))
    atomic_files.write_bytes(tmp_path / "a.bin", b"x")
    assert left.exists()


# Several at once


def test_all_or_none(tmp_path):
    paths = [tmp_path / name for name in "abc"]
    paths[0].write_bytes(b"earlier")

    def fail():
        with atomic_files.replacing_all(*paths) as files:
            for file in files:
                file.write(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    with atomic_files.replacing_all(*paths) as files:
        for file in files:
            file.write(b"new")
        assert paths[0].read_bytes() == b"earlier"
    assert sorted(os.listdir(tmp_path)) == ["a", "b", "c"]
    assert {path.read_bytes() for path in paths} == {b"new"}


def test_check_refuses_what_replacing_refuses(kept):
    for path in (kept.parent / "none" / "a", kept / "a", kept.parent, f"{kept.parent}/new/", os.devnull, "a\0b"):
        assert refusal(atomic_files.check, path) == refusal(atomic_files.write_bytes, path, b"")
    atomic_files.check(kept)
    atomic_files.check(kept.parent / "new")
