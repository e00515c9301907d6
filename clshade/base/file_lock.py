"""A lock on a file, which ends with the process that holds it."""

from __future__ import annotations

import os
import sys

from .atomic_files import Path


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
