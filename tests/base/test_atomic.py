"""Files are written completely or not at all."""

import errno
import os
import stat
from unittest import mock

import pytest

from clshade.base import atomic_files
from clshade.errors import OutputError


@pytest.fixture
def kept(tmp_path):
    """Return an earlier file; check afterwards that it is unchanged and alone in its folder."""
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


def test_files_are_replaced_together_at_the_end(tmp_path):
    paths = [tmp_path / name for name in "abc"]
    atomic_files.write_bytes(str(paths[0]), b"earlier")
    with atomic_files.replacing_all(*paths) as files:
        for file in files:
            file.write(b"new")
            file.flush()
        assert paths[0].read_bytes() == b"earlier"
    assert sorted(os.listdir(tmp_path)) == ["a", "b", "c"]
    assert {path.read_bytes() for path in paths} == {b"new"}


def test_permissions_are_kept_or_what_the_umask_leaves(tmp_path):
    for umask, mode in ((0o022, 0o644), (0o077, 0o600), (0o002, 0o664)):
        path = tmp_path / f"{umask}.bin"
        before = os.umask(umask)
        try:
            atomic_files.write_bytes(path, b"")
        finally:
            os.umask(before)
        assert stat.S_IMODE(path.stat().st_mode) == mode
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
    assert os.strerror(errno.ENAMETOOLONG) in refusal(atomic_files.write_bytes, tmp_path / ("n" * 256), b"x")
    assert os.listdir(tmp_path) == ["n" * 255]


def test_refused_targets(kept):
    folder = kept.parent
    for path, message in {
        folder / "none" / "a.bin": "there is no folder",
        kept / "a.bin": "is not a folder",
        folder: "it is a folder",
        f"{folder}/new/": "it is a folder",
        os.devnull: "not a regular file",
        f"{folder}/a\0b": "null",
        folder / "two\nlines" / "a.bin": "'",
    }.items():
        text = refusal(atomic_files.write_bytes, path, b"")
        assert message in text
        assert refusal(atomic_files.check, path) == text
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)
    atomic_files.check(kept)
    atomic_files.check(folder / "new")


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
    assert (path.read_bytes(), os.listdir(tmp_path)) == (b"new", ["a.bin"])
    assert len(looks) == (2 if replaced else 1)


@pytest.mark.parametrize("operation", ["open", "fsync", "replace", "fchmod"])
def test_a_failing_step(kept, operation):
    reason = os.strerror(errno.ENOSPC)
    with mock.patch.object(os, operation, side_effect=OSError(errno.ENOSPC, reason)):
        text = refusal(atomic_files.write_bytes, kept, b"new")
    assert text == f"{kept}: cannot be written: {reason}"


def test_a_rename_that_fails_undoes_those_before_it(kept, monkeypatch):
    replace, targets = os.replace, []

    def fail_at_the_third(source, target):
        targets.append(target)
        if len(targets) == 3:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        replace(source, target)

    def write():
        with atomic_files.replacing_all(kept, kept.parent / "new.bin", kept.parent / "last.bin") as files:
            for file in files:
                file.write(b"new")

    monkeypatch.setattr(os, "replace", fail_at_the_third)
    assert refusal(write) == f"{kept.parent / 'last.bin'}: cannot be written: {os.strerror(errno.EIO)}"


def test_a_file_system_that_cannot_sync(tmp_path):
    with mock.patch.object(os, "fsync", side_effect=OSError(errno.EINVAL, "Invalid argument")):
        atomic_files.write_bytes(tmp_path / "a.bin", b"x")
    assert (tmp_path / "a.bin").read_bytes() == b"x"


@pytest.mark.parametrize(
    ("error", "raised"),
    [
        (OSError("odd"), OutputError),
        (MemoryError(), OutputError),
        (OSError(errno.ENOSPC, "No space left on device"), OutputError),
        (KeyboardInterrupt(), KeyboardInterrupt),
        (SystemExit(), SystemExit),
        (ValueError(), ValueError),
    ],
)
def test_an_error_while_writing_leaves_nothing(kept, error, raised):
    def use():
        paths = kept.parent / "a.bin", kept.parent / "b.bin"
        with atomic_files.replacing_all(*paths) as files, atomic_files.replacing(kept) as last:
            for file in (*files, last):
                file.write(b"half")
            raise error

    with pytest.raises(raised) as caught:
        use()
    if raised is OutputError:
        assert str(caught.value).startswith(f"{kept}: cannot be written: ")


def test_a_full_disk(kept):
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        texts = [refusal(atomic_files.write_bytes, kept, bytes(count)) for count in (100_001, 2_000_000)]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert texts == [f"{kept}: cannot be written: {os.strerror(errno.EFBIG)}"] * 2


def test_leftovers_of_killed_processes_are_swept_up(tmp_path, monkeypatch):
    """Old ones of our own, if their names are ours."""
    old, new, link, foreign = (tmp_path / f".clshade-{digit * 16}.tmp" for digit in "0af1")
    names = tmp_path / ".clshade-notes.tmp", tmp_path / "x.tmp"
    for file in (old, new, foreign, *names):
        file.write_bytes(b"half")
    link.symlink_to(old)
    for file in (old, foreign, *names):
        os.utime(file, (1, 1))
    if os.geteuid() == 0:  # only root can give files away
        os.chown(foreign, 12345, -1)
    else:
        foreign.unlink()
    left = {*os.listdir(tmp_path), "a.bin"} - {old.name}
    atomic_files.write_bytes(tmp_path / "a.bin", b"x")
    assert set(os.listdir(tmp_path)) == left
    monkeypatch.setattr(os, "scandir", lambda _: pytest.fail("a folder is looked through once in a process"))
    atomic_files.write_bytes(tmp_path / "a.bin", b"y")
