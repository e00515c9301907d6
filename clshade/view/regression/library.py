"""Libraries of images: a JSON file of hashes beside each file of tests, and an EXR of each image."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import folder_made, lock_file, naming, replacing_all, shown, write_error
from ...base.input_files import file_error, quoted, read_file
from ...base.json_values import found_text, parse_text
from ...base.spelling import hint
from ...pipeline.frame import Frame
from ...scene.settings import LAYERS

VERSION = 1
HASHES = "imageHashes"  # attribute of a reference's header: its entry as JSON
IMAGE = "rgba"  # the name of the image itself, beside those of layers
_KEYS = ("clshade_images", "images")  # the version, and key of an image -> Entry
_ARRAYS = (IMAGE, *LAYERS)
_DIGEST = re.compile(r"[a-z]+\d+ \d+(x\d+)+ [0-9a-f]{64}")
_MOST_BYTES = 1 << 26
_PATIENCE = 60.0  # seconds to wait for other processes that write the same library
_MOST_NAME = 80  # characters of a file's name that are taken from a test's

Entry: TypeAlias = dict[str, str]  # name of an array -> `digest`


def digest(array: Array) -> str:
    """Return type, shape and SHA-256 of an array's bytes in C order, little-endian: `float32 240x320x4 9f86...`."""
    ordered = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    return f"{array.dtype.name} {'x'.join(map(str, array.shape))} {hashlib.sha256(ordered.data).hexdigest()}"


def entry_of(frame: Frame) -> Entry:
    return {IMAGE: digest(frame.rgba), **{name: digest(frame[name]) for name in frame.layers}}


def reference_path(library: Path, key: str) -> Path:
    """Return the EXR of an image, in a folder beside its library."""
    return library.with_suffix("") / f"{file_name(key)}.exr"


def file_name(key: str) -> str:
    """Return the key as a file's name; with a hash if it is too long for one, has characters that some file systems
    refuse, or upper case letters, which some do not tell from lower case."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", key).strip(".-")[:_MOST_NAME]
    return name if name.lower() == key else f"{name}-{hashlib.sha256(key.encode('utf-8', 'replace')).hexdigest()[:8]}"


def read(library: Path) -> dict[str, Entry]:
    """Return the entries of a library, key -> Entry; none if there is no such file.

    Raises InputError, one line that names the file and the place, for a file that is no library.
    """
    try:
        data = read_file(library, _MOST_BYTES)
    except ValueError:
        if os.path.lexists(library):
            raise
        return {}
    owner = shown(library)
    content = _object(owner, "", parse_text(data, owner, "a library of images", unique=True), _KEYS)
    for key in _KEYS:
        if key not in content:
            raise file_error(owner, key, "this key", "none")
    version, images = (content[key] for key in _KEYS)
    if version != VERSION or isinstance(version, bool):
        raise file_error(owner, _KEYS[0], f"version {VERSION}", found_text(version))
    entries = _object(owner, _KEYS[1], images)
    for key, entry in entries.items():
        place = f"images, {quoted(key)}"
        for name, text in _object(owner, place, entry, _ARRAYS).items():
            if not isinstance(text, str) or not _DIGEST.fullmatch(text):
                raise file_error(owner, f"{place}, {name}", "type, shape and SHA-256", found_text(text))
        if IMAGE not in entry:
            raise file_error(owner, place, f"{IMAGE} among its keys", ", ".join(entry) or "none")
    return entries


def _object(owner: str, place: str, value: Any, keys: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return an object of JSON. keys: the allowed ones; none: all. Raises InputError for anything else."""
    if not isinstance(value, dict):
        raise file_error(owner, place or "JSON", "an object", found_text(value))
    for key in value:
        if keys and key not in keys:
            expected = f"one of {', '.join(keys)}"
            raise file_error(owner, f"{place}, key" if place else "key", expected, f"{quoted(key)}{hint(key, keys)}")
    return value


def put(library: Path, key: str, entry: Entry, encode: Callable[[BinaryIO], Any] | None) -> None:
    """Put an entry into a library, and what `encode` writes into the file of its reference image, both or neither.

    Entries that other processes put there at the same time are kept. Raises OutputError if a file cannot be written, and
    as `read`.
    """
    with _locked(library):
        entries = {**read(library), key: entry}
        content = dict(zip(_KEYS, (VERSION, dict(sorted(entries.items()))), strict=True))
        text = json.dumps(content, indent=2) + "\n"
        reference = reference_path(library, key) if encode else None
        paths = [library] if reference is None else [reference, library]
        with folder_made(reference and reference.parent), replacing_all(*paths) as files:
            if encode is not None:
                with naming(paths[0]):
                    encode(files[0])
            with naming(library):
                files[-1].write(text.encode())


@contextlib.contextmanager
def _locked(library: Path) -> Iterator[None]:
    """Hold the lock of a library, a file in the folder for temporary ones: nothing is left beside the tests."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    name = hashlib.sha256(os.fsencode(os.path.realpath(library))).hexdigest()[:16]
    path = os.path.join(tempfile.gettempdir(), f"clshade-{user}-{name}.lock")
    with naming(path):
        descriptor, until = lock_file(path), time.monotonic() + _PATIENCE
        while descriptor is None:
            if time.monotonic() > until:
                raise write_error(library, f"another process has held {shown(path)} for {_PATIENCE:.0f} s")
            time.sleep(0.01)
            descriptor = lock_file(path)
    try:
        yield
    finally:
        os.close(descriptor)
