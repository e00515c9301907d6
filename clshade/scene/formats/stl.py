"""Scenes from STL files, ascii and binary."""

from __future__ import annotations

import re
import warnings

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error, quoted, read_file, runs
from ..geometry import crease_normals, welded
from ..model import MAX_FACES, Mesh, Scene
from .reading import DEFAULT_MATERIAL, Options, framed, name_of
from .text_tokens import numbers

MAX_BYTES = 1 << 31
_HEAD, _RECORD = 84, 50  # bytes of a binary file's head, and of a facet: normal, corners, attribute
_CHUNK = 1 << 20  # bytes of text taken at once
_WORDS = (b"facet", b"normal", None, None, None, b"outer", b"loop") + (b"vertex", None, None, None) * 3
_FACET = (*_WORDS, b"endloop", b"endfacet")
_NAMES = re.compile(rb"^[ \t]*(?:end[ \t]*)?solid\b.*$", re.MULTILINE)
_FACET_END = re.compile(rb"end[ \t]*facet", re.IGNORECASE)
_ENDS = re.compile(rb"\bend[ \t]+(?=(?:loop|facet)\b)")


def read_stl(path: Path, options: Options) -> Scene:
    """Read an STL file: one Mesh with three float32 vertices of its own for each facet, in the file's order.

    Facets are flat, as the format intends; with options.crease vertices at equal positions are welded and edges up
    to that angle are smooth. The file's normals, which many programs write wrong, are ignored.

    A file of exactly 84 + 50 * count bytes is binary, whatever it begins with; another that begins with `solid` is
    ascii, if it is text; else it is binary.
    """
    owner = shown(path)
    if options.texture is not None:
        raise file_error(owner, "texture", "no texture, for an STL file has no texture coordinates", "one")
    data = read_file(path, MAX_BYTES)
    ignored = []
    size, count = len(data) - _HEAD, int.from_bytes(data[80:_HEAD], "little")
    is_text = data[:512].removeprefix(b"\xef\xbb\xbf").lstrip().lower().startswith((b"solid", b"facet"))
    if size != _RECORD * count and is_text and b"\0" not in data.rstrip(b"\0"):
        verts = _ascii(data.removeprefix(b"\xef\xbb\xbf").rstrip(b"\0"), owner)
    elif size < 0:
        raise file_error(owner, "facet count", f"at least {_HEAD} bytes, or solid", f"{len(data)} bytes")
    else:
        count = _counted(count, size, owner)
        if runs(data, _HEAD + 48, count, _RECORD, np.dtype("<u2"), 1).any() or b"COLOR=" in data[:80]:
            ignored.append("colors or attributes of facets")
        verts = runs(data, _HEAD + 12, count, _RECORD, np.dtype("<f4"), 9).reshape(-1, 3)
    count = len(verts) // 3
    if not 0 < count <= MAX_FACES:
        raise file_error(owner, "facet count", f"from 1 to {MAX_FACES}", str(count))
    if not np.isfinite(verts).all():
        row = int(np.flatnonzero(~np.isfinite(verts).all(axis=1))[0])
        raise file_error(owner, f"facet {row // 3}: vertex {row % 3}", "finite numbers", f"{verts[row].tolist()}")
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    normals = normal_faces = None
    if options.crease:
        vertices, index = welded(verts)
        verts, faces = verts[vertices], index[faces]
        normals, normal_faces = crease_normals(verts, faces, options.crease)
    mesh = Mesh(verts, faces, None, normals, normal_faces, material=options.lit(DEFAULT_MATERIAL), name=name_of(path))
    return framed((mesh,), path, options, ignored)


def _counted(count: int, size: int, owner: str) -> int:
    """Return the number of facets of a binary file. count: as it says. size: bytes after the head."""
    available = size // _RECORD
    if count in (0, 0xFFFFFFFF) and available:
        warnings.warn(f"{owner}: facet count: {count} was read as {available}, the facets in the file", stacklevel=2)
        count = available
    if count > available:
        expected = f"{_HEAD + _RECORD * count} bytes for its {count} facets, or ASCII text that begins with solid"
        raise file_error(owner, "facet count", expected, f"{_HEAD + size} bytes")
    if excess := size - _RECORD * count:
        line = f"{owner}: facet count: bytes after the last of {count} facets are left out: {excess}"
        warnings.warn(line, stacklevel=2)
    return count


def _ascii(data: bytes, owner: str) -> Array:
    """Return (3F, 3) float32 corners of an ascii file."""
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    start, facets, parts = 0, 0, []
    while start < len(data):
        last = _FACET_END.search(data, start + _CHUNK)
        end = last.end() if last else len(data)
        parts.append(_facets(data[start:end], owner, facets))
        facets += len(parts[-1]) // 3
        if facets > MAX_FACES:
            raise file_error(owner, "facet count", f"at most {MAX_FACES}", "more")
        start = end
    return np.concatenate(parts)


def _facets(text: bytes, owner: str, before: int) -> Array:
    """Return (3F, 3) float32 corners of whole facets. before: facets in the file before these."""
    text = _NAMES.sub(b"", text.lower())
    words = (_ENDS.sub(b"end", text) if b"end " in text or b"end\t" in text else text).split()
    length = len(_FACET)
    keywords = ((place, word) for place, word in enumerate(_FACET) if word is not None)
    if len(words) % length == 0 and all(words[k::length].count(word) == len(words) // length for k, word in keywords):
        rows = np.empty((len(words) // length, 9), object)
        for column, place in enumerate(place for place in range(7, length) if _FACET[place] is None):
            rows[:, column] = words[place::length]
        values = numbers(b" ".join(rows.reshape(-1).tolist()), float, rows.size)
        if values is not None:
            with np.errstate(over="ignore"):
                return values.reshape(-1, 3).astype(np.float32)
    for place, word in enumerate(words):  # the first that is out of place
        facet, expected = before + place // length, _FACET[place % length]
        if expected is None and place % length > 5 and numbers(word, float, 1) is None:
            raise file_error(owner, f"facet {facet}: vertex", "numbers", quoted(word))
        if expected is not None and word != expected:
            raise file_error(owner, f"facet {facet}", expected.decode(), quoted(word))
    raise file_error(owner, f"facet {before + len(words) // length}", "endfacet", "the end of the file")
