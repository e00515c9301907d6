"""Files that appear whole or not at all: written beside their target under another name, synced, then renamed."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import stat
import time
from collections.abc import Iterator
from typing import BinaryIO

from ..errors import OutputError
from . import interrupts

Path = str | os.PathLike[str]

LEFT_SECONDS = 3600.0  # a temporary file that has not changed for so long was left by a process that was killed


def shown(path: Path) -> str:
    """A path as it is named in a message: as it is, or quoted where it would break the line."""
    text = os.fspath(path)
    return text if text.isprintable() and text else ascii(text)


def write_error(path: Path, reason: str) -> OutputError:
    """The one form of every error about a file that cannot be written."""
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
    """An OSError or MemoryError of the block becomes an OutputError, one line that names `path` and the reason."""
    try:
        yield
    except OutputError:
        raise
    except (OSError, MemoryError) as error:
        raise write_error(path, _reason(error, path)) from None


def _resolved(path: Path) -> str:
    """The file that `path` leads to, links followed."""
    try:
        if "\0" in os.fspath(path):
            raise ValueError("embedded null character")
        return os.path.realpath(path)
    except ValueError as error:  # or what the file system's encoding does not have
        raise write_error(path, str(error)) from None


def _permissions(path: Path, target: str) -> int | None:
    """The permissions of the file that is to be replaced, None where there is none yet. `target`: links followed."""
    if os.path.isdir(target) or os.fspath(path).endswith(os.sep):
        raise write_error(path, "it is a folder")
    try:
        mode = os.stat(target).st_mode
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(mode):  # renaming over /dev/null would put a file in its place
        raise write_error(path, "it is not a regular file")
    if not os.access(target, os.W_OK):
        raise write_error(path, os.strerror(errno.EACCES))
    return stat.S_IMODE(mode)


def check(path: Path) -> None:
    """Raises the OutputError that `replacing` would, as far as can be told without writing: a full disk cannot."""
    target = _resolved(path)
    folder = os.path.dirname(target)
    with naming(path):
        _permissions(path, target)
        os.stat(folder)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise write_error(path, os.strerror(errno.EACCES))


_swept: set[str] = set()


def _sweep(folder: str) -> None:
    """Removes temporary files of this user that killed processes left there; once in a process for each folder."""
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


_folders: list[str] = []  # made for files that are not there yet


@interrupts.at_end
def _remove_folders() -> None:
    """After `_abandon_all`, which empties them: what was told of last comes first."""
    for folder in reversed(list(_folders)):
        with contextlib.suppress(OSError):
            os.rmdir(folder)


@contextlib.contextmanager
def folder_made(path: Path | None) -> Iterator[None]:
    """The folder is there in the block, and those that it lies in; those that were made for it, and have nothing in them at
    the end, go again. None: no folder. Raises OutputError where it cannot be made."""
    made: list[str] = []
    try:
        if path is not None:
            with naming(path):
                for folder in _missing(_resolved(path)):
                    with contextlib.suppress(FileExistsError):  # of another process
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
    """The folder, and those that it lies in, which are not there; the outermost first."""
    found: list[str] = []
    while not os.path.lexists(folder):
        found.insert(0, folder)
        folder = os.path.dirname(folder)
    return found


_under_way: set[_Replacement] = set()


@interrupts.at_end
def _abandon_all() -> None:
    """At the end of a process that does not wait for its threads: nothing of what they were writing stays."""
    for each in list(_under_way):
        if each.owner == os.getpid():
            each.undo()


class _Replacement:
    """One file under way: open, then finished (all of it on disk), then placed; or discarded, whatever came before."""

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
        """Gives the file that is to be replaced a second name, so that `discard` can bring it back."""
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
    """Binary files, open for writing, that take the places of `paths` when the `with` block ends without an error: all
    of them, or, after any error, none: they are renamed once every one is on the disk, and a rename that fails undoes
    those before it (where the file system knows hard links, or the file was new).

    An error of the block passes unchanged: `naming` says which file it was about. Otherwise like `replacing`.
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
    """A binary file, open for writing, that takes the place of `path` when the `with` block ends without an error.

    Until then the earlier file at `path` stays as it was; after any error or Ctrl-C it still does, and nothing else is
    left in the folder. A new file gets the permissions that the umask leaves, a replaced one keeps its own; a symbolic
    link is followed. What a killed process left in the folder goes when the next one writes there an hour later.

    Raises OutputError, one line naming the file and the reason, for an OSError (full disk, missing or unwritable
    folder, target is a folder or a device ...) or a MemoryError, in here or in the block. Any other exception of the
    block, KeyboardInterrupt included, passes unchanged.
    """
    with replacing_all(path) as (file,), naming(path):
        yield file


def write_bytes(path: Path, data: bytes | bytearray | memoryview) -> None:
    """Write `data` as the file `path`, whole or not at all. Raises OutputError, see `replacing`."""
    with replacing(path) as file:
        file.write(data)
