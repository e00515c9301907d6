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
    with contextlib.ExitStack() as stack:
        is_locked = False
        if sys.platform != "win32":
            import fcntl

            with contextlib.suppress(OSError):
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
    except (BlockingIOError, PermissionError):
        os.close(descriptor)
        return None
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
