"""Atomic file writes (beside the target under another name, synced, then renamed), and locks that end with a process."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import stat
import sys
import time
from collections.abc import Iterator
from typing import BinaryIO

from ..errors import OutputError
from . import interrupts

Path = str | os.PathLike[str]

LEFT_SECONDS = 3600.0  # a temporary file unchanged for this long was left by a killed process


def shown(path: Path) -> str:
    """Return a path for a message: as it is, or quoted where it would break the line."""
    text = os.fspath(path)
    return text if text.isprintable() and text else ascii(text)


def write_error(path: Path, reason: str) -> OutputError:
    """Build the error for a file that cannot be written."""
    return OutputError(f"{shown(path)}: cannot be written: {reason}")


def _reason(error: BaseException, path: Path) -> str:
    if isinstance(error, MemoryError):
        return "out of memory"
    if isinstance(error, OSError):
        folder = os.path.dirname(os.path.realpath(path))
        if error.errno == errno.ENOENT and not os.path.exists(folder):
            return f"there is no folder {shown(folder)}"
        if error.errno == errno.ENOTDIR:
            return f"{shown(folder)} is not a folder"
        if error.strerror:
            return error.strerror
    return " ".join(str(error).split()) or type(error).__name__


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Turn an OSError or MemoryError of the block into an OutputError, one line that names `path` and the reason."""
    try:
        yield
    except OutputError:
        raise
    except (OSError, MemoryError) as error:
        raise write_error(path, _reason(error, path)) from None


def _resolved(path: Path) -> str:
    """Return the file that `path` leads to, following links."""
    try:
        if "\0" in os.fspath(path):
            raise ValueError("embedded null character")
        return os.path.realpath(path)
    except (OSError, ValueError) as error:  # no current folder; a null, or a character that the encoding lacks
        raise write_error(path, str(error)) from None


def _permissions(path: Path, target: str) -> int | None:
    """Return the permissions of the file to be replaced, or None if there is none. `target`: `path`, links followed."""
    if os.path.isdir(target) or os.fspath(path).endswith(os.sep):
        raise write_error(path, "it is a folder")
    try:
        found = os.stat(target)
        if not stat.S_ISREG(found.st_mode):  # renaming over /dev/null would put a file in its place
            raise write_error(path, "it is not a regular file")
        if not os.access(target, os.W_OK):
            if os.path.samestat(found, os.stat(target)):
                raise write_error(path, os.strerror(errno.EACCES))
            return _permissions(path, target)  # another process has replaced it meanwhile
    except FileNotFoundError:
        return None
    return stat.S_IMODE(found.st_mode)


def check(path: Path) -> None:
    """Raise the OutputError that `replacing` would, as far as possible without writing: a full disk goes unnoticed."""
    target = _resolved(path)
    folder = os.path.dirname(target)
    with naming(path):
        _permissions(path, target)
        os.stat(folder)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise write_error(path, os.strerror(errno.EACCES))


_swept: set[str] = set()


def _sweep(folder: str) -> None:
    """Remove temporary files of this user left there by killed processes; once per process and folder."""
    if folder in _swept:
        return
    _swept.add(folder)
    user = os.geteuid() if hasattr(os, "geteuid") else None
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if not re.fullmatch(r"\.clshade-[0-9a-f]{16}\.tmp", entry.name):
                continue
            with contextlib.suppress(OSError):
                found = entry.stat(follow_symlinks=False)
                own = user is None or found.st_uid == user
                if own and stat.S_ISREG(found.st_mode) and found.st_mtime < time.time() - LEFT_SECONDS:
                    os.unlink(entry.path)


def _beside(target: str) -> str:
    # A short name of its own: a long one derived from the target's could exceed the file system's limit.
    return os.path.join(os.path.dirname(target), f".clshade-{secrets.token_hex(8)}.tmp")


_folders: list[str] = []  # created for files that do not exist yet


@interrupts.at_end
def _remove_folders() -> None:
    """Remove empty folders, after `_abandon_all` has emptied them: exit handlers run last in, first out."""
    for folder in reversed(list(_folders)):
        with contextlib.suppress(OSError):
            os.rmdir(folder)


@contextlib.contextmanager
def folder_made(path: Path | None) -> Iterator[None]:
    """Create the folder and its parents for the block; those created are removed at the end if they are empty.

    None: no folder. Raises OutputError if the folder cannot be created.
    """
    made: list[str] = []
    try:
        if path is not None:
            with naming(path):
                for folder in _missing(_resolved(path)):
                    with contextlib.suppress(FileExistsError):  # created by another process
                        os.mkdir(folder)
                        made.append(folder)
                        _folders.append(folder)
        yield
    finally:
        for folder in reversed(made):
            with contextlib.suppress(OSError):
                os.rmdir(folder)
            _folders.remove(folder)


def _missing(folder: str) -> list[str]:
    """Return the folders of the path that do not exist, outermost first."""
    found: list[str] = []
    while not os.path.lexists(folder):
        found.insert(0, folder)
        folder = os.path.dirname(folder)
    return found


_under_way: set[_Replacement] = set()


@interrupts.at_end
def _abandon_all() -> None:
    """Undo unfinished writes when the process ends without waiting for its threads."""
    for each in list(_under_way):
        if each.owner == os.getpid():
            each.undo()


class _Replacement:
    """One file being written: opened, finished (all of it on disk) and placed; or discarded at any point before."""

    def __init__(self, path: Path) -> None:
        self.path, self.target = path, _resolved(path)
        self.temporary, self.earlier, self.placed = _beside(self.target), "", False
        self.file: BinaryIO | None = None
        self.owner = os.getpid()

    def open(self) -> BinaryIO:
        mode = _permissions(self.path, self.target)
        _under_way.add(self)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
        self.file = os.fdopen(os.open(self.temporary, flags, 0o666), "wb", buffering=1 << 20)
        if mode is not None and hasattr(os, "fchmod"):
            os.fchmod(self.file.fileno(), mode)
        _sweep(os.path.dirname(self.target))
        return self.file

    def finish(self) -> None:
        assert self.file is not None
        self.file.flush()
        try:
            os.fsync(self.file.fileno())
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # a file system that cannot sync
                raise
        self.file.close()

    def keep_earlier(self) -> None:
        """Link the file to be replaced under a second name, so that `undo` can restore it."""
        if os.path.lexists(self.target):
            kept = _beside(self.target)
            with contextlib.suppress(OSError):  # a file system without hard links
                os.link(self.target, kept)
                self.earlier = kept

    def place(self) -> None:
        new = not os.path.lexists(self.target)
        os.replace(self.temporary, self.target)
        self.placed = new or bool(self.earlier)

    def discard(self) -> None:
        if self.file is not None:
            with contextlib.suppress(OSError):  # closing flushes once more, onto the same full disk
                self.file.close()
        self.undo()

    def undo(self) -> None:
        with contextlib.suppress(OSError):
            if self.placed and self.earlier:
                os.replace(self.earlier, self.target)
            elif self.placed:
                os.unlink(self.target)
        self.drop_names()

    def drop_names(self) -> None:
        for name in (self.temporary, self.earlier):
            if name:
                with contextlib.suppress(OSError):
                    os.unlink(name)
        _under_way.discard(self)


@contextlib.contextmanager
def replacing_all(*paths: Path) -> Iterator[list[BinaryIO]]:
    """Open binary files that replace `paths` when the `with` block ends without an error: all of them or none.

    They are renamed once every one is on the disk, and a rename that fails undoes those before it (if the file system
    has hard links, or the file was new). An error of the block passes unchanged: `naming` says which file it was about.
    Otherwise like `replacing`.
    """
    with contextlib.ExitStack() as stack:
        under_way = [_Replacement(path) for path in paths]
        files = []
        for each in under_way:
            stack.callback(each.discard)
            with naming(each.path):
                files.append(each.open())
        yield files
        for each in under_way:
            with naming(each.path):
                each.finish()
        if len(under_way) > 1:
            for each in under_way:
                each.keep_earlier()
        for each in under_way:
            with naming(each.path):
                each.place()
        stack.pop_all()
        for each in under_way:
            each.drop_names()


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Open a binary file that replaces `path` when the `with` block ends without an error.

    Until then, and after any error or Ctrl-C, an existing file at `path` is unchanged, and nothing else is left in the
    folder. A new file gets the permissions that the umask allows, a replaced one keeps its own; symbolic links are
    followed. Temporary files of a killed process are removed by the first write to the folder at least an hour later.

    Raises OutputError, one line naming the file and the reason, for an OSError (full disk, missing or unwritable
    folder, target is a folder or a device ...) or a MemoryError, in here or in the block. Any other exception of the
    block, including KeyboardInterrupt, passes unchanged.
    """
    with replacing_all(path) as (file,), naming(path):
        yield file


def write_bytes(path: Path, data: bytes | bytearray | memoryview) -> None:
    """Write `data` to the file `path` atomically. Raises OutputError, see `replacing`."""
    with replacing(path) as file:
        file.write(data)


@contextlib.contextmanager
def folder_locked(folder: Path) -> Iterator[bool]:
    """Lock a folder for the block, among processes and threads that lock it too, and wait for those. Yield whether it is
    locked: Windows and some file systems cannot."""
    with contextlib.ExitStack() as stack:
        is_locked = False
        with contextlib.suppress(ImportError, OSError):
            import fcntl

            descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
            stack.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            is_locked = True
        yield is_locked


def lock_file(path: Path) -> int | None:
    """Return the descriptor of the file at `path`, locked until it is closed or the process ends. None: another has it.

    Raises OSError if the file cannot be created, or its file system has no locks. A forked child that closes its copy
    leaves the lock in place; with filelock before release 4 its end took it from the parent, and importing that package
    takes a tenth of the time of a small render.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)  # not inherited by child programs
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        if not isinstance(error, (BlockingIOError, PermissionError)):
            raise
        return None
    return descriptor
