"""Input files: their errors, reading with limits, and references from a scene file to others."""

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

LONGEST_FOUND = 160  # characters of what a message says was found, or of where

# Stores of links: Hugging Face's cache, git-annex, DVC. All name a file by a hash of its content, so that nobody can make a
# link to one without knowing what it holds.
_IN_STORE = re.compile(
    r"(?:(.*/(?:models|datasets|spaces)--[^/]+/blobs)/(?:[0-9a-f]{40}|[0-9a-f]{64})"
    r"|(.*/\.git/(?:.*/)?annex/objects)/[^/]+/[^/]+/([A-Z0-9_]+-s\d+--[0-9a-f]{32,}[^/]*)/\3"
    r"|(.*/(?:files/md5|\.dvc/cache))/[0-9a-f]{2}/[0-9a-f]{30})"
)


def file_error(owner: str, field: str, expected: str, found: str) -> InputError:
    """Build an InputError of one line, `owner: field: expected ..., found ...`, with unprintable characters escaped, and
    field and found cut."""
    text = f"{owner}: {_cut(field)}: expected {expected}, found {_cut(found)}"
    return InputError(text if text.isprintable() else text.encode("unicode_escape").decode("ascii"))


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST_FOUND else f"{text[:LONGEST_FOUND]}..."


def quoted(text: str | bytes, length: int = 48) -> str:
    """Return text from a file for a message: in quotes, printable, at most about `length` characters."""
    if isinstance(text, bytes):
        text = text[: length + 1].decode("utf-8", "replace")
    return repr(text) if len(text) <= length else repr(text[:length]) + "..."


def reason_of(error: BaseException) -> str:
    """Return a decoder's message in one line of at most 160 characters, without the addresses of objects."""
    if type(error).__name__ == "UnidentifiedImageError":  # Pillow's, which only names such an object
        return "something else"
    text = re.sub(r"\s*<[^<>]* object at 0x[0-9a-fA-F]+>", "", str(error))
    return " ".join(text.split())[:160]


@contextlib.contextmanager
def within(owner: str) -> Iterator[None]:
    """Prefix every InputError of the block with `owner`, the file that led to it."""
    try:
        yield
    except InputError as error:
        text = str(error)
        raise error if text.startswith(f"{owner}: ") else InputError(f"{owner}: {text}") from None


@contextlib.contextmanager
def decoding(owner: str, field: str, expected: str) -> Iterator[None]:
    """Turn the exceptions that decoders raise on damaged files, of many types, into InputErrors."""
    try:
        yield
    except (InputError, ImportError):
        raise
    except MemoryError:
        raise file_error(owner, field, "an image that fits into memory", "a larger one") from None
    except Exception as error:
        raise file_error(owner, field, expected, reason_of(error) or "damaged data") from None


def size_of(path: Path) -> int:
    """Return the size in bytes of a regular, non-empty file, without opening it. Raises InputError for others."""
    owner = shown(path)
    try:
        status = os.stat(path)
    except FileNotFoundError:
        raise file_error(owner, "file", "an existing file", "no such file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise file_error(owner, "file", "a readable file", str(reason)) from None
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device, pipe or socket"
        raise file_error(owner, "file", "a regular file", kind)
    if status.st_size == 0:
        raise file_error(owner, "file", "content", "an empty file")
    return status.st_size


def stamp(path: Path) -> tuple[int, int, int] | None:
    """Return what changes when the file is written or replaced: time, size and inode; None for a missing one."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def read_file(path: Path, limit: int) -> bytes:
    """Return the content of a regular, non-empty file of at most `limit` bytes.

    Raises InputError, one line, for a missing or unreadable file, a folder, a device or pipe (which is never opened),
    an empty file and one that is too large.
    """
    size = size_of(path)
    if size > limit:
        raise file_error(shown(path), "file", f"at most {limit} bytes", f"{size} bytes")
    return first_bytes(path, size)


def first_bytes(path: Path, count: int) -> bytes:
    """Return the first bytes of a regular, non-empty file, by which formats are recognized. Raises as `read_file`."""
    size = size_of(path)
    try:
        with open(path, "rb") as file:
            return file.read(count)
    except OSError as error:
        raise file_error(shown(path), "file", "a readable file", str(error.strerror or error)) from None
    except MemoryError:
        raise file_error(shown(path), "file", "a file that fits into memory", f"{size} bytes") from None


def beside(scene: Path, reference: str, owner: str, field: str, folder: str | None = None) -> str | None:
    r"""Return the path of a file that a scene file refers to, or None if there is no such file.

    scene: path of the scene file. Nothing outside its folder is opened; but if it is itself a link into a store, so may be
    the files beside it. reference: relative path with / or \ between its parts. owner, field: the referring file and line,
    for messages. folder: of the referring file, inside that of the scene; default: the scene's.

    Raises InputError for a path that is absolute or leaves the folder, a link that leads elsewhere, and a folder or
    device.
    """
    root = os.path.dirname(os.fspath(scene)) or "."
    parts = reference.replace("\\", "/")
    inside = "a file in the scene's folder"
    if not parts.replace("\t", " ").isprintable() or not parts:
        raise file_error(owner, field, inside, quoted(reference))
    within_root = os.path.normpath(f"./{(folder or root).removeprefix(root)}/{parts}")
    if parts.startswith("/") or re.match(r"[A-Za-z]:", parts) or within_root.split("/")[0] == "..":
        raise file_error(owner, field, f"{inside} (no absolute path, no ..)", quoted(reference))
    try:
        os.fsencode(parts)
    except UnicodeEncodeError:  # in an ASCII locale: names of files are UTF-8 nearly everywhere
        within_root = os.fsdecode(within_root.encode())
    path = os.path.join(root, within_root)
    real, top = os.path.realpath(path), os.path.realpath(root)
    if os.path.commonpath([real, top]) != top:
        store = _store(scene)
        if store is None or _store(path) != store:
            link = f"{quoted(reference)}, a link out of it (`cp -rL FOLDER COPY` copies what links lead to)"
            raise file_error(owner, field, inside, link)
    if not os.path.exists(path):
        return None
    if not os.path.isfile(path):
        raise file_error(owner, field, "a regular file", f"{quoted(reference)}, which is none")
    return path


def _store(path: Path) -> str | None:
    """Return the store that a link leads into, None if it leads elsewhere."""
    match = _IN_STORE.fullmatch(os.path.realpath(path).replace(os.sep, "/"))
    return match and (match[1] or match[2] or match[4])


def runs(data: bytes | memoryview, start: int, count: int, stride: int, kind: np.dtype, width: int) -> Array:
    """Return (count, width) values of type `kind`: `width` consecutive ones every `stride` bytes from byte `start` on.

    They are copied run by run, several times as fast as value by value, and converted to native byte order.
    """
    native = kind.newbyteorder("=")
    if not width or not count:
        return np.zeros((count, width), native)
    packed: Array = np.ndarray((count,), f"V{width * kind.itemsize}", data, start, (stride,)).copy()
    return packed.view(kind).astype(native, copy=False).reshape(count, width)
