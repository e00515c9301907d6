"""Compiled programs on disk: a file for each, shared by all processes of a user.

The files hold compiled code. A damaged one would crash whatever runs it, or silently draw wrong pixels: so each begins with
a digest of the rest. While code of a file runs for the first time in a process, a locked mark lies beside it: one that no
process holds says that its user did not survive, and the file goes.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import threading
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from ...base import console, interrupts
from ...base.atomic_files import lock_file

MOST_BYTES = 128 << 20  # of all programs: beyond, those that were not used for longest go, until half of that is left
_CHANGING = "last_accessed"  # in which PoCL notes when it used a program
BINARY = "binary"  # the one file of a program of a runtime that has no cache of its own
_said: set[str] = set()  # each reason is said once
_held: dict[Path, tuple[int, int]] = {}  # marks -> the process that holds them, the descriptor of the lock


@interrupts.at_end
def _unmark_all() -> None:
    """Remove the marks of this process at its end, even a forced one, which may come while a kernel runs."""
    for mark in list(_held):
        _unmark(mark)


def _unmark(mark: Path) -> None:
    owner, lock = _held.pop(mark)
    with contextlib.suppress(OSError):
        if owner == os.getpid():
            os.ftruncate(lock, 0)
        os.close(lock)
        if owner == os.getpid():
            mark.unlink()


class StoredProgram:
    """A compiled program in the file at `path`, which is there or not; None: nowhere. names: of its own files that were read
    or written."""

    def __init__(self, path: Path | None) -> None:
        self.path, self.names = path, frozenset[str]()

    def exists(self) -> bool:
        return self.path is not None and self.path.exists()

    def __contains__(self, kernel: str) -> bool:
        """Whether a kernel's code is stored, as far as its runtime compiles kernels one by one."""
        return any(f"/{kernel}/" in name for name in self.names) or BINARY in self.names

    def read(self) -> dict[str, bytes]:
        """Return the program's files by name; empty if there is none, or none that is intact, which a line says."""
        if self.path is None:
            return {}
        with contextlib.suppress(OSError):
            mark = _mark_of(self.path)
            if mark.stat().st_size and (lock := lock_file(mark)) is not None:  # no process has locked it
                died = os.fstat(lock).st_size > 0  # or its process has ended in good order meanwhile, and truncated it
                os.close(lock)
                if died:
                    return _refuse(self.path, "a run that began to use it ended abruptly")
        try:
            digest, body = self.path.read_bytes().split(b"\n", 1)
        except (FileNotFoundError, NotADirectoryError):
            return {}
        except (OSError, ValueError) as error:
            return _refuse(self.path, f"it cannot be read ({getattr(error, 'strerror', None) or 'damaged'})")
        if hashlib.sha256(body).hexdigest().encode() != digest:
            return _refuse(self.path, "it is damaged")
        with contextlib.suppress(OSError):
            os.utime(self.path)  # the folder loses what was not used for longest
        index, content = body.split(b"\n", 1)
        files, first = {}, 0
        for name, size in json.loads(index).items():
            files[name] = content[first : first + size]
            first += size
        self.names = frozenset(files)
        return files

    def write(self, files: Mapping[str, bytes]) -> None:
        """Store the program's files, unless it has these. A folder that cannot be written only costs time."""
        if self.path is None or self.names.issuperset(files):
            return
        files = {**self.read(), **files}  # another process may have stored other kernels
        index = json.dumps({name: len(file) for name, file in files.items()}).encode()
        body = b"".join([index, b"\n", *files.values()])
        with contextlib.suppress(OSError):
            if not self.path.parent.is_dir():
                self.path.parent.unlink(missing_ok=True)
                self.path.parent.mkdir()
            _write(self.path, hashlib.sha256(body).hexdigest().encode() + b"\n" + body)
            self.names = frozenset(files)
            _shrink(self.path.parent)

    @contextlib.contextmanager
    def first_use(self) -> Iterator[None]:
        """Guard a block that uses stored code for the first time: if the process dies in it, the file goes. An exception or
        an interrupt is harmless."""
        mark = None
        if self.path is not None and self.names:
            with contextlib.suppress(OSError):  # on a full disk, or one without locks: without a mark
                lock = lock_file(_mark_of(self.path))
                if lock is not None:
                    mark = _mark_of(self.path)
                    _held[mark] = os.getpid(), lock
                    os.write(lock, b"x")
        try:
            yield
        finally:
            if mark is not None and mark in _held:
                _unmark(mark)


def _mark_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.in-use")


def _refuse(program: Path, reason: str) -> dict[str, bytes]:
    if reason not in _said:
        _said.add(reason)
        console.warning(f"a compiled program in {program.parent} is thrown away and compiled anew: {reason}")
    for path in (program, _mark_of(program)):
        with contextlib.suppress(OSError):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    return {}


def _write(path: Path, content: bytes) -> None:
    """Write a whole file or none. It is not synced: a power cut that loses content leaves a wrong digest."""
    temporary = path.with_name(f"{path.name}-{os.getpid()}-{threading.get_native_id()}")
    try:
        temporary.write_bytes(content)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _shrink(folder: Path) -> None:
    programs = [(path.stat(), path) for path in folder.iterdir()]
    if sum(status.st_size for status, _ in programs) <= MOST_BYTES:
        return
    left = 0
    for status, path in sorted(programs, key=lambda entry: entry[0].st_mtime, reverse=True):
        left += status.st_size
        if left > MOST_BYTES // 2:
            path.unlink(missing_ok=True)


# PoCL keeps a program as a folder in a folder of its cache


def programs_in(folder: Path | None) -> set[Path]:
    """Return the folders of the programs in PoCL's cache; empty for None."""
    return set(folder.glob("??/*")) if folder is not None else set()


def pack(folder: Path, programs: Iterable[Path], known: Collection[str]) -> dict[str, bytes]:
    """Return the files of programs in PoCL's cache, by their names in it, but for those known."""
    paths = (path for program in programs for path in program.rglob("*") if path.name != _CHANGING and path.is_file())
    names = {path.relative_to(folder).as_posix(): path for path in paths}
    return {name: path.read_bytes() for name, path in names.items() if name not in known}


def unpack(files: Mapping[str, bytes], folder: Path) -> None:
    """Write into PoCL's cache what `pack` returned, but for what is there: the process may have loaded it as a library."""
    for name, content in files.items():
        path = folder / name
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            _write(path, content)
