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
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO

from ..errors import OutputError
from . import interrupts

Path = str | os.PathLike[str]

LEFT_SECONDS = 3600.0  # a temporary file unchanged for this long was left by a killed process


def shown(path: Path) -> str:
    """Return a path for a message: as it is, or quoted where it would break the line."""
    text = os.fspath(path)
    return text if text.isprintable() and text else ascii(text)


def write_error(path: Path, reason: str) -> OutputError:
    return OutputError(f"{shown(path)}: cannot be written: {reason}")


def _reason(error: OSError | MemoryError, path: Path) -> str:
    if isinstance(error, MemoryError):
        return "out of memory"
    folder = os.path.dirname(os.path.realpath(path))
    if error.errno == errno.ENOENT and not os.path.exists(folder):
        return f"there is no folder {shown(folder)}"
    if error.errno == errno.ENOTDIR:
        return f"{shown(folder)} is not a folder"
    return error.strerror or " ".join(str(error).split()) or type(error).__name__


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
        status = os.stat(target)
        if not stat.S_ISREG(status.st_mode):  # renaming over /dev/null would put a file in its place
            raise write_error(path, "it is not a regular file")
        if not os.access(target, os.W_OK):
            if os.path.samestat(status, os.stat(target)):
                raise write_error(path, os.strerror(errno.EACCES))
            return _permissions(path, target)  # another process has replaced it meanwhile
    except FileNotFoundError:
        return None
    return stat.S_IMODE(status.st_mode)


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
                status = entry.stat(follow_symlinks=False)
                is_users = user is None or status.st_uid == user
                if is_users and stat.S_ISREG(status.st_mode) and status.st_mtime < time.time() - LEFT_SECONDS:
                    os.unlink(entry.path)


def _beside(target: str) -> str:
    # A short name of its own: a long one derived from the target's could exceed the file system's limit.
    return os.path.join(os.path.dirname(target), f".clshade-{secrets.token_hex(8)}.tmp")


_under_way: dict[contextlib.ExitStack, int] = {}  # what undoes unfinished work, and the process whose work it is


@contextlib.contextmanager
def _undoing() -> Iterator[contextlib.ExitStack]:
    """Yield a stack of callbacks, for the end of the block or of the process, which may not wait for its threads."""
    stack = contextlib.ExitStack()
    _under_way[stack] = os.getpid()
    try:
        with stack:
            yield stack
    finally:
        del _under_way[stack]


@interrupts.at_end
def _abandon_all() -> None:
    for stack, process in reversed(list(_under_way.items())):
        if process == os.getpid():
            stack.close()


def _try(function: Callable[..., Any], *arguments: Any) -> None:
    with contextlib.suppress(OSError):
        function(*arguments)


@contextlib.contextmanager
def folder_made(path: Path | None) -> Iterator[None]:
    """Create the folder and its parents for the block; those created are removed at the end if they are empty.

    None: no folder. Raises OutputError if the folder cannot be created.
    """
    with _undoing() as undo:
        if path is not None:
            with naming(path):
                missing = [_resolved(path)]
                while not os.path.lexists(missing[-1]):
                    missing.append(os.path.dirname(missing[-1]))
                for folder in reversed(missing[:-1]):
                    with contextlib.suppress(FileExistsError):  # created by another process
                        os.mkdir(folder)
                        undo.callback(_try, os.rmdir, folder)
        yield


@contextlib.contextmanager
def replacing_all(*paths: Path) -> Iterator[list[BinaryIO]]:
    """Open binary files that replace `paths` when the `with` block ends without an error: all of them or none.

    They are renamed once every one is on the disk, and a rename that fails undoes those before it (if the file system
    has hard links, or the file was new). An error of the block passes unchanged: `naming` says which file it was about.
    Otherwise like `replacing`.
    """
    with _undoing() as names, _undoing() as undo, contextlib.ExitStack() as closing:
        targets = [(path, _resolved(path)) for path in paths]
        temporaries = [_beside(target) for _, target in targets]
        files: list[BinaryIO] = []
        for (path, target), temporary in zip(targets, temporaries, strict=True):
            with naming(path):
                mode = _permissions(path, target)
                names.callback(_try, os.unlink, temporary)
                flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
                files.append(os.fdopen(os.open(temporary, flags, 0o666), "wb", buffering=1 << 20))
                closing.callback(_try, files[-1].close)  # which flushes once more, onto a full disk
                if mode is not None and hasattr(os, "fchmod"):
                    os.fchmod(files[-1].fileno(), mode)
                _sweep(os.path.dirname(target))
        yield files
        for path, file in zip(paths, files, strict=True):
            with naming(path):
                _sync(file)
        for (path, target), temporary in zip(targets, temporaries, strict=True):
            with naming(path):
                is_new = not os.path.lexists(target)
                if not is_new and len(paths) > 1:
                    _keep(target, names, undo)
                os.replace(temporary, target)
                if is_new:
                    undo.callback(_try, os.unlink, target)
        undo.pop_all()


def _sync(file: BinaryIO) -> None:
    """Write all of a file to the disk, and close it."""
    file.flush()
    try:
        os.fsync(file.fileno())
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # a file system that cannot sync
            raise
    file.close()


def _keep(target: str, names: contextlib.ExitStack, undo: contextlib.ExitStack) -> None:
    """Link a file that is to be replaced under a second name, so that `undo` can restore it."""
    link = _beside(target)
    names.callback(_try, os.unlink, link)
    with contextlib.suppress(OSError):  # a file system without hard links
        os.link(target, link)
        undo.callback(_try, os.replace, link, target)


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
    """Lock a folder for the block, and wait for other processes and threads that have locked it. Yield whether it is
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
