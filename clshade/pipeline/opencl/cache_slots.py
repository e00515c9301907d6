"""Cache folders for one process at a time, and how a process knows that what the previous one left there is intact.

The cache holds compiled code. A damaged file crashes whatever runs it, or silently draws wrong pixels. So each folder
has a seal, the digests of its files, rewritten whenever something was compiled. A process that takes the folder keeps
only what the seal names, and nothing at all if a file differs from its digest. While code is used for the first time in
a process, a mark lies in the folder: a process that finds one knows that its user did not survive that.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import stat
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ...base import interrupts
from ...base.atomic_files import lock_file
from ...errors import DeviceError

SLOTS = 256  # cache folders before a process gets a temporary one
MOST_BYTES = 128 << 20  # of a folder: beyond, what was not used for longest goes, until half of that is left
LEFT_SECONDS = 24 * 3600.0  # an unlocked folder of that age was left by a process that was killed
LOCK, SEAL, MARK = "lock", "seal", "in-use"
_OWN = {LOCK, SEAL, MARK}
_CHANGING = "last_accessed"  # in which PoCL notes when it used a program
UNFINISHED = "tempfile"  # prefix of files that are being written, PoCL's among them
_DIED = "a run that began to use it ended abruptly"


@dataclass
class Slot:
    """A cache folder that only this process uses while it lives.

    folder: holds `pocl` (PoCL's kernel cache) and `binaries` (programs that other runtimes built, or which of PoCL's
        folders hold a program).
    lock: descriptor of the locked file; None for a temporary folder, which needs neither seal nor mark.
    emptied: why what an earlier process had left was removed, a clause; "" if it was not.
    """

    folder: Path
    lock: int | None
    emptied: str = ""
    _owner: int = field(default_factory=os.getpid)
    _guard: threading.RLock = field(default_factory=threading.RLock)
    _users: int = 0
    _sealed: dict[str, tuple[str, int, int]] = field(default_factory=dict)  # name -> digest, size, modification time

    @property
    def pocl(self) -> Path:
        return self.folder / "pocl"

    @contextlib.contextmanager
    def using(self) -> Iterator[None]:
        """Guard a block that uses cached code for the first time: if the process dies in it, the next one to take the
        folder removes all of it. Leaving the block by an exception or an interrupt is harmless."""
        with self._guard:
            self._users += 1
            if self._users == 1 and self.lock is not None:
                with contextlib.suppress(OSError):  # on a full disk: without the mark
                    os.close(os.open(self.folder / MARK, os.O_WRONLY | os.O_CREAT, 0o600))
        try:
            yield
        finally:
            with self._guard:
                self._users -= 1
                if not self._users:
                    self._unmark()

    def release(self) -> None:
        """Leave the folder to other processes."""
        self._end()
        if self.lock is not None:
            os.close(self.lock)
        self.lock = None

    def _unmark(self) -> None:
        if self.lock is not None and self._owner == os.getpid():
            with contextlib.suppress(OSError):
                os.unlink(self.folder / MARK)

    def seal(self) -> bool:
        """Seal the folder's present files as intact; return whether any is new. What cannot be sealed, as on a full
        disk, is compiled again by the next process."""
        if self.lock is None or self._owner != os.getpid():
            return False
        with self._guard, contextlib.suppress(OSError):
            known, self._sealed = self._sealed, {}
            for name, status in _files(self.folder):
                if os.path.basename(name).startswith(UNFINISHED):
                    continue
                before = known.get(name)
                if before is None or before[1:] != (status.st_size, status.st_mtime_ns):
                    before = (_digest(self.folder / name), status.st_size, status.st_mtime_ns)
                self._sealed[name] = before
            if self._sealed != known:
                _write_seal(self.folder, {name: digest for name, (digest, *_) in self._sealed.items()})
                return True
        return False

    def _end(self) -> None:
        """Seal the folder at the end of the process, even a forced one, which may come during a compilation."""
        self._unmark()
        if not self._users:
            self.seal()

    def _examine(self) -> None:
        """Remove what an earlier process left if it is not reliable. Raises OSError if that is impossible."""
        self.emptied = self._fault()
        if self.emptied:
            for path in self.folder.iterdir():
                if path.name != LOCK:
                    _remove(path)
        elif sum(size for _, size, _ in self._sealed.values()) > MOST_BYTES:
            self._shrink()

    def _shrink(self) -> None:
        """Remove the programs that were not used for longest: every file is read when a process takes the folder."""
        programs: dict[str, list[str]] = {}
        for name in self._sealed:
            programs.setdefault(_program(name), []).append(name)
        left = 0
        for program in sorted(programs, key=lambda each: _last_use(self.folder / each), reverse=True):
            size = sum(self._sealed[name][1] for name in programs[program])
            if left and left + size > MOST_BYTES // 2:
                with contextlib.suppress(OSError):  # too large a folder serves as well
                    _remove(self.folder / program)
                    for name in programs[program]:
                        del self._sealed[name]
            else:
                left += size
        with contextlib.suppress(OSError):  # the old seal names files that are gone, which is no damage
            _write_seal(self.folder, {name: digest for name, (digest, *_) in self._sealed.items()})

    def _fault(self) -> str:
        if os.path.lexists(self.folder / MARK):
            return _DIED
        expected = read_seal(self.folder)
        if expected is None:
            return f"{SEAL} is damaged"
        try:
            for name, status in _files(self.folder):
                path = self.folder / name
                if name not in expected:  # its process was killed before it could seal the file
                    path.unlink()
                    continue
                if not stat.S_ISREG(status.st_mode) or _digest(path) != expected[name]:
                    return f"{path.name} is damaged"
                self._sealed[name] = (expected[name], status.st_size, status.st_mtime_ns)
        except OSError as error:
            return f"{os.path.basename(error.filename or '')} cannot be read ({error.strerror})"
        other = (name for name in expected if name not in self._sealed and os.path.lexists(self.folder / name))
        return next((f"{os.path.basename(name)} is damaged" for name in other), "")  # replaced by a folder


# Contents of a folder


def _files(folder: Path) -> Iterator[tuple[str, os.stat_result]]:
    """Yield every file of the folder that does not change by itself: its relative name and its status."""

    def refuse(error: OSError) -> None:
        raise error

    for where, _, names in os.walk(folder, onerror=refuse):
        for name in names:
            path = os.path.join(where, name)
            relative = path[len(os.fspath(folder)) + 1 :]
            if name != _CHANGING and relative not in _OWN:
                yield relative, os.lstat(path)


def _program(name: str) -> str:
    """Return the name of PoCL's folder of a program, or of another runtime's file, that a file belongs to."""
    parts = name.split("/")
    return "/".join(parts[: min(3, len(parts) - 1)]) if parts[0] == "pocl" and len(parts) > 2 else name


def _last_use(path: Path) -> float:
    """Return when a program was used last, as far as its runtime notes it, or made."""
    noted = path / _CHANGING
    return (noted if noted.exists() else path).stat().st_mtime


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _write_seal(folder: Path, digests: dict[str, str]) -> None:
    lines = "".join(f"{digest} {name}\n" for name, digest in digests.items() if "\n" not in name)
    body = os.fsencode(lines)
    made = folder / f"{SEAL}.new"
    made.write_bytes(hashlib.sha256(body).hexdigest().encode() + b"\n" + body)
    # Not synced: a power cut that loses it may lose the files it vouches for as well.
    os.replace(made, folder / SEAL)


def read_seal(folder: Path) -> dict[str, str] | None:
    """Read the seal: name -> digest; empty if there is none yet; None if it is damaged."""
    try:
        digest, body = (folder / SEAL).read_bytes().split(b"\n", 1)
    except FileNotFoundError:
        return {}
    except (OSError, ValueError):
        return None
    if hashlib.sha256(body).hexdigest().encode() != digest:
        return None
    pairs = (line.split(" ", 1) for line in os.fsdecode(body).split("\n") if line)
    return {name: digest for digest, name in pairs}


# Taking a folder


def take(folder: Path) -> Slot | None:
    """Claim the folder for this process, creating it if need be; None: another process has it. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    lock = lock_file(folder / LOCK)
    if lock is None:
        return None
    slot = Slot(folder, lock)
    try:
        slot._examine()
        slot.pocl.mkdir(exist_ok=True, mode=0o700)
    except OSError:
        os.close(lock)
        raise
    interrupts.at_end(slot._end)
    return slot


def unusable(folder: Path, error: OSError) -> DeviceError:
    """Build the error for a cache folder that cannot be used."""
    return DeviceError(f"the cache folder {folder} cannot be used: {error.strerror or error}")


def throw_away(root: Path) -> Slot:
    """Return a folder for this process only, removed when it exits. Raises DeviceError."""
    try:
        slot = Slot(private_folder(root, "once-"), None)
        slot.pocl.mkdir()
    except OSError as error:
        raise unusable(root, error) from None
    return slot


def claim(root: Path) -> Slot:
    """Claim the first folder of `slot-0`, `slot-1`, ... that no running process has and this one can use. Two processes
    that share PoCL's cache can crash; a process on its own always gets slot-0, and so finds what the previous one
    compiled."""
    with contextlib.suppress(OSError):
        for number in range(SLOTS):
            try:
                slot = take(root / f"slot-{number}")
            except (PermissionError, FileExistsError, NotADirectoryError, IsADirectoryError):
                continue  # another user's, as after `sudo`, or not a folder
            if slot is not None:
                return slot
    return throw_away(root)


# Folders for one process


def private_folder(parent: Path, prefix: str) -> Path:
    """Create a folder that is removed when this process exits. Those of processes that were killed are removed first.

    Raises OSError if it cannot be created.
    """
    import tempfile

    for left in parent.glob(f"{prefix}*"):
        with contextlib.suppress(OSError):
            _remove_if_left(left)
    folder, owner = Path(tempfile.mkdtemp(prefix=prefix, dir=parent)), os.getpid()

    @interrupts.at_end
    def remove() -> None:
        if os.getpid() == owner:
            shutil.rmtree(folder, ignore_errors=True)

    try:
        lock = lock_file(folder / LOCK)  # held until the process exits
    except OSError:  # a file system without locks: if left behind, it is removed once it is old
        return folder
    if lock is not None and (folder / LOCK).is_file():
        return folder
    return private_folder(parent, prefix)  # before it was locked another process took it for a leftover


def _remove_if_left(folder: Path) -> None:
    status = folder.lstat()
    own = not hasattr(os, "getuid") or status.st_uid == os.getuid()
    if not (own and stat.S_ISDIR(status.st_mode)):
        return
    if not (folder / LOCK).is_file():  # just created, or its file system has no locks
        if status.st_mtime < time.time() - LEFT_SECONDS:
            shutil.rmtree(folder, ignore_errors=True)
        return
    lock = lock_file(folder / LOCK)
    if lock is not None:
        try:
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(lock)
