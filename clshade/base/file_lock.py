"""Locks on files and folders, which end with the process that holds them."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator

from .atomic_files import Path


@contextlib.contextmanager
def folder_locked(folder: Path) -> Iterator[bool]:
    """Lock a folder for the block, among processes and threads that lock it too, and wait for those. Yield whether it is
    locked: Windows and some file systems cannot."""
    descriptor = _lock_folder(folder)
    try:
        yield descriptor is not None
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _lock_folder(folder: Path) -> int | None:
    if sys.platform == "win32":
        return None
    import fcntl

    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    except BaseException as error:  # also Ctrl-C while it waits
        os.close(descriptor)
        if isinstance(error, OSError):
            return None
        raise
    return descriptor


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
    except (BlockingIOError, PermissionError):
        os.close(descriptor)
        return None
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
