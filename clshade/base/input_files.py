"""Files as input: the one form of a file_error about a file, reading with limits, and what a scene may refer to."""

from __future__ import annotations

import contextlib
import os
import re
import stat
from collections.abc import Iterator

import numpy as np

from ..errors import InputError
from .arrays import Array
from .atomic_files import Path, shown


def file_error(owner: str, field: str, expected: str, found: str) -> InputError:
    """An InputError of one line, `owner: field: expected ..., found ...`; unprintable characters are escaped."""
    text = f"{owner}: {field}: expected {expected}, found {found}"
    return InputError(text if text.isprintable() else text.encode("unicode_escape").decode("ascii"))


def quoted(text: str | bytes, most: int = 48) -> str:
    """Text from a file as it is shown in a message: in quotes, printable, at most about `most` characters."""
    if isinstance(text, bytes):
        text = text[: most + 1].decode("utf-8", "replace")
    return repr(text) if len(text) <= most else repr(text[:most]) + "..."


def reason_of(error: BaseException) -> str:
    """What a decoder says, in one line, at most 160 characters, without the objects that it names by their addresses."""
    if type(error).__name__ == "UnidentifiedImageError":  # Pillow's, which names nothing but such an object
        return "something else"
    text = re.sub(r"\s*<[^<>]* object at 0x[0-9a-fA-F]+>", "", str(error))
    return " ".join(text.split())[:160]


@contextlib.contextmanager
def within(owner: str) -> Iterator[None]:
    """Every InputError of the block names `owner`, the file that led to it, first."""
    try:
        yield
    except InputError as error:
        text = str(error)
        raise error if text.startswith(f"{owner}: ") else InputError(f"{owner}: {text}") from None


def size_of(path: Path) -> int:
    """Bytes in a regular, non-empty file, which is not opened. Raises InputError, one line, for anything else."""
    owner = shown(path)
    try:
        status = os.stat(path)
    except FileNotFoundError:
        raise file_error(owner, "file", "an existing file", "no such file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise file_error(owner, "file", "a readable file", str(reason)) from None
    if not stat.S_ISREG(status.st_mode):
        found = "a folder" if stat.S_ISDIR(status.st_mode) else "a device, pipe or socket"
        raise file_error(owner, "file", "a regular file", found)
    if status.st_size == 0:
        raise file_error(owner, "file", "content", "an empty file")
    return status.st_size


def read_file(path: Path, most: int) -> bytes:
    """The content of a regular, non-empty file of at most `most` bytes.

    Raises InputError, one line, for a missing or unreadable file, a folder, a device or pipe (which is never opened),
    an empty file and one that is too large.
    """
    owner = shown(path)
    size = size_of(path)
    if size > most:
        raise file_error(owner, "file", f"at most {most} bytes", f"{size} bytes")
    try:
        with open(path, "rb") as file:
            return file.read(size)
    except OSError as error:
        raise file_error(owner, "file", "a readable file", str(error.strerror or error)) from None
    except MemoryError:
        raise file_error(owner, "file", "a file that fits into memory", f"{size} bytes") from None


def beside(root: str, folder: str, reference: str, owner: str, field: str) -> str | None:
    """The path of a file that a scene file refers to, or None when there is none of that name.

    root: folder of the scene file: nothing outside of it is opened. folder: of the referring file, inside root.
    reference: relative path with / or \\ between its parts. owner, field: the referring file and line, for messages.

    Raises InputError for an absolute path, a path with `..`, a link that leads out of root, and a folder or device.
    """
    parts = reference.replace("\\", "/")
    inside = "a file in the scene's folder"
    if not parts.replace("\t", " ").isprintable() or not parts:
        raise file_error(owner, field, inside, quoted(reference))
    if parts.startswith("/") or re.match(r"[A-Za-z]:", parts) or ".." in parts.split("/"):
        raise file_error(owner, field, f"{inside} (no absolute path, no ..)", quoted(reference))
    path = os.path.join(folder, *parts.split("/"))
    real, top = os.path.realpath(path), os.path.realpath(root)
    if os.path.commonpath([real, top]) != top:
        raise file_error(owner, field, inside, f"{quoted(reference)}, a link out of it")
    if not os.path.exists(path):
        return None
    if not os.path.isfile(path):
        raise file_error(owner, field, "a regular file", f"{quoted(reference)}, which is none")
    return path


def runs(data: bytes, start: int, count: int, stride: int, kind: np.dtype, width: int) -> Array:
    """(count, width) values of type `kind`: a run of `width` of them every `stride` bytes from byte `start` on.

    Copied run by run, which is several times as fast as value by value, and in this machine's byte order.
    """
    native = kind.newbyteorder("=")
    if not width or not count:
        return np.zeros((count, width), native)
    packed: Array = np.ndarray((count,), f"V{width * kind.itemsize}", data, start, (stride,)).copy()
    return packed.view(kind).astype(native, copy=False).reshape(count, width)
