"""Programs that another process of this user has compiled, taken over from its cache folder.

Processes that run at once have a folder each. One that needs a program looks into the others' before it compiles: it
copies what their seals name and what has the digest that the seal says.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

from ...base.atomic_files import lock_file
from ...errors import ClshadeError
from .cache_slots import LOCK, MARK, UNFINISHED, Slot, read_seal

_FOLDER = "pocl/"


def runtime_folders(slot: Slot) -> set[str]:
    """Return the names, relative to the slot, of the folders of programs in PoCL's cache."""
    return {f"{_FOLDER}{path.parent.name}/{path.name}" for path in slot.pocl.glob("*/*")}


def note(folders: Iterable[str]) -> bytes:
    """Return what a file of `binaries` says of a program that PoCL keeps: its folders, as `take_over` reads it."""
    return "\n".join(sorted(folders)).encode()


def take_over(slot: Slot, name: str) -> bool:
    """Copy the program of that name, relative to the slot, from another slot beside it; return whether one had it.

    A program that PoCL keeps is a note of its folders, whose files come along as far as they have been sealed; what is
    missing is compiled.
    """
    if slot.lock is None:
        return False
    for other in sorted(slot.folder.parent.glob("slot-*")):
        with contextlib.suppress(OSError):
            if other != slot.folder and _own(other) and not _died(other) and _copied(slot, other, name):
                return True
    return False


def take_all(slot: Slot, other: Path) -> None:
    """Copy all programs of another slot, whose process has ended. A cache that cannot be written only costs time."""
    with contextlib.suppress(OSError, ClshadeError):
        for name in read_seal(other) or ():
            if name.startswith("binaries/"):
                _copied(slot, other, name)
        slot.seal()


def _own(folder: Path) -> bool:
    return not hasattr(os, "getuid") or folder.lstat().st_uid == os.getuid()


def _died(folder: Path) -> bool:
    """Return whether the folder's last process ended abruptly while it used code for the first time."""
    if not os.path.lexists(folder / MARK):
        return False
    lock = lock_file(folder / LOCK)
    if lock is not None:
        os.close(lock)
    return lock is not None


def _copied(slot: Slot, other: Path, name: str) -> bool:
    sealed = read_seal(other) or {}
    program = _intact(other, name, sealed)
    if program is None:
        return False
    noted = program.decode("utf-8", "replace").split("\n")[1:]
    folders = tuple(f"{each}/" for each in noted if each.startswith(_FOLDER))
    for each in sealed:
        if each.startswith(folders) and ".." not in each and not (slot.folder / each).exists():
            content = _intact(other, each, sealed)
            if content is not None:
                _write(slot.folder / each, content)
    _write(slot.folder / name, program)
    return True


def _intact(folder: Path, name: str, sealed: dict[str, str]) -> bytes | None:
    """Return the file's content; None if the folder's owner has removed or changed it meanwhile."""
    with contextlib.suppress(OSError):
        content = (folder / name).read_bytes()
        if hashlib.sha256(content).hexdigest() == sealed.get(name):
            return content
    return None


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    made = path.with_name(f"{UNFINISHED}_{path.name}")
    made.write_bytes(content)
    os.replace(made, path)
