"""Files that appear whole or not at all: written beside their target under another name, synced, then renamed."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import stat
from collections.abc import Iterator
from typing import BinaryIO

from .errors import OutputError

Path = str | os.PathLike[str]


def shown(path: Path) -> str:
    """A path as it is named in a message: as it is, or quoted where it would break the line."""
    text = os.fspath(path)
    return text if text.isprintable() and text else ascii(text)


def refused(path: Path, reason: str) -> OutputError:
    """The one form of every complaint about a file that cannot be written."""
    return OutputError(f"{shown(path)}: cannot be written: {reason}")


def _reason(error: BaseException, folder: str) -> str:
    if isinstance(error, MemoryError):
        return "out of memory"
    if isinstance(error, OSError):
        if error.errno == errno.ENOENT and not os.path.exists(folder):
            return f"there is no folder {shown(folder)}"
        if error.errno == errno.ENOTDIR:
            return f"{shown(folder)} is not a folder"
        if error.strerror:
            return error.strerror
    return " ".join(str(error).split()) or type(error).__name__


def _permissions(path: Path, target: str) -> int | None:
    """The permissions of the file that is to be replaced, None where there is none yet. `target`: links followed."""
    if os.path.isdir(target) or os.fspath(path).endswith(os.sep):
        raise refused(path, "it is a folder")
    try:
        mode = os.stat(target).st_mode
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(mode):  # renaming over /dev/null would put a file in its place
        raise refused(path, "it is not a regular file")
    if not os.access(target, os.W_OK):
        raise refused(path, os.strerror(errno.EACCES))
    return stat.S_IMODE(mode)


def _finish(file: BinaryIO) -> None:
    file.flush()
    try:
        os.fsync(file.fileno())
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # a file system that cannot sync
            raise
    file.close()


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A binary file, open for writing, that takes the place of `path` when the `with` block ends without an error.

    Until then the earlier file at `path` stays as it was; after any error or Ctrl-C it still does, and nothing else is
    left in the folder. A new file gets the permissions that the umask leaves, a replaced one keeps its own; a symbolic
    link is followed.

    Raises OutputError, one line naming the file and the reason, for an OSError (full disk, missing or unwritable
    folder, target is a folder or a device ...) or a MemoryError, in here or in the block. Any other exception of the
    block, KeyboardInterrupt included, passes unchanged.
    """
    temporary, folder, file, done = "", "", None, False
    try:
        target = os.path.realpath(path)
        folder = os.path.dirname(target)
        mode = _permissions(path, target)
        # A short name of its own: a long one derived from the target's could exceed the file system's limit.
        temporary = os.path.join(folder, f".clshade-{secrets.token_hex(8)}.tmp")
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
        file = os.fdopen(os.open(temporary, flags, 0o666), "wb", buffering=1 << 20)
        if mode is not None and hasattr(os, "fchmod"):
            os.fchmod(file.fileno(), mode)
        yield file
        _finish(file)
        os.replace(temporary, target)
        done = True
    except OutputError:
        raise
    except (OSError, MemoryError) as error:
        raise refused(path, _reason(error, folder)) from None
    except ValueError as error:
        if file is None:  # a NUL in the path
            raise refused(path, _reason(error, folder)) from None
        raise
    finally:
        if not done:
            if file is not None:
                with contextlib.suppress(OSError):  # closing flushes once more, onto the same full disk
                    file.close()
            if temporary:
                with contextlib.suppress(OSError, ValueError):
                    os.unlink(temporary)


def write_bytes(path: Path, data: bytes | bytearray | memoryview) -> None:
    """Write `data` as the file `path`, whole or not at all. Raises OutputError, see `replacing`."""
    with replacing(path) as file:
        file.write(data)
