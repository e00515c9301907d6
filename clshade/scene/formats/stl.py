"""Scenes from STL files, ascii and binary."""

from __future__ import annotations

import os
import re
import warnings

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error, quoted, read_file, runs
from .. import framing
from ..model import MAX_FACES, Mesh, Scene
from ..normals import crease_normals, welded
from .options import DEFAULT_MATERIAL, Options, warn_ignored
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
    ascii, if it is text; else it is binary. A count of 0 or 2^32 - 1, which stands for an unknown one, is that of the whole
    facets in the file; bytes after the last facet are left out; both with a warning. Raises InputError, one line that names
    the file and the facet, see clshade.scene.formats.load.load.
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
    mesh = _mesh(verts, owner, options)
    scene = framing.framed((mesh,), mesh.name, options.resolution, up=options.up)
    return warn_ignored(scene, owner, ignored)


def _counted(count: int, size: int, owner: str) -> int:
    """Return the number of facets of a binary file. count: as it says. size: bytes after the head."""
    held = size // _RECORD
    if count in (0, 0xFFFFFFFF) and held:
        warnings.warn(f"{owner}: facet count: {count} was read as {held}, the facets in the file", stacklevel=2)
        count = held
    if count > held:
        expected = f"{_HEAD + _RECORD * count} bytes for its {count} facets, or ASCII text that begins with solid"
        raise file_error(owner, "facet count", expected, f"{_HEAD + size} bytes")
    if size > _RECORD * count:
        rest = size - _RECORD * count
        warnings.warn(
            f"{owner}: facet count: bytes after the last of {count} facets are left out: {rest}", stacklevel=2
        )
    return count


def _mesh(verts: Array, owner: str, options: Options) -> Mesh:
    """Return the Mesh. verts: (3F, 3), corners of the facets."""
    count = len(verts) // 3
    if not 0 < count <= MAX_FACES:
        raise file_error(owner, "facet count", f"from 1 to {MAX_FACES}", str(count))
    if not np.isfinite(verts).all():
        row = int(np.flatnonzero(~np.isfinite(verts).all(axis=1))[0])
        found = f"{verts[row].tolist()}"
        raise file_error(owner, f"facet {row // 3}: vertex {row % 3}", "finite numbers", found)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    normals = normal_faces = None
    if options.crease:
        kept, which = welded(verts)
        verts, faces = verts[kept], which[faces]
        normals, normal_faces = crease_normals(verts, faces, options.crease)
    name = os.path.splitext(os.path.basename(owner))[0]
    return Mesh(verts, faces, None, normals, normal_faces, material=options.lit(DEFAULT_MATERIAL), name=name)


def _ascii(data: bytes, owner: str) -> Array:
    """Return (3F, 3) float32 corners of an ascii file."""
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    start, facets, parts = 0, 0, []
    while start < len(data):
        end = start + _CHUNK
        if end < len(data):
            found = _FACET_END.search(data, end)
            end = found.end() if found else len(data)
        end = min(end, len(data))
        part = _facets(data[start:end], owner, facets)
        parts.append(part)
        facets += len(part) // 3
        if facets > MAX_FACES:
            raise file_error(owner, "facet count", f"at most {MAX_FACES}", "more")
        start = end
    return np.concatenate(parts)


def _facets(text: bytes, owner: str, before: int) -> Array:
    """Return (3F, 3) float32 corners of whole facets. before: facets in the file before these."""
    text = _NAMES.sub(b"", text.lower())
    words = (_ENDS.sub(b"end", text) if b"end " in text or b"end\t" in text else text).split()
    length = len(_FACET)
    for place, word in enumerate(_FACET):
        if word is not None and words[place::length].count(word) != -(-len(words) // length):
            break
    else:
        if len(words) % length == 0:
            columns = [place for place in range(7, 19) if _FACET[place] is None]
            rows = np.empty((len(words) // length, 9), object)
            for column, place in enumerate(columns):
                rows[:, column] = words[place::length]
            values = numbers(b" ".join(rows.reshape(-1).tolist()), float, rows.size)
            if values is not None:
                with np.errstate(over="ignore"):
                    return values.reshape(-1, 3).astype(np.float32)
    raise _first_fault(words, owner, before)


def _first_fault(words: list[bytes], owner: str, before: int) -> Exception:
    """Build the error for the first word that is out of place."""
    for place, word in enumerate(words):
        facet, expected = before + place // len(_FACET), _FACET[place % len(_FACET)]
        if expected is None and place % len(_FACET) > 5 and numbers(word, float, 1) is None:
            return file_error(owner, f"facet {facet}: vertex", "numbers", quoted(word))
        if expected is not None and word != expected:
            return file_error(owner, f"facet {facet}", expected.decode(), quoted(word))
    return file_error(owner, f"facet {before + len(words) // len(_FACET)}", "endfacet", "the end of the file")
