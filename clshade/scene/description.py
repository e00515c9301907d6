"""Canonical descriptions of scenes: digests that are the same for equal scenes on every machine, in every process.

A digest covers every field of a scene that can change its image, names included: numbers exactly, arrays by type, shape
and bytes (little-endian, in C order).
"""

from __future__ import annotations

import functools
import hashlib
import operator
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ..images.decode import BAND, CodedImage
from .environment import Environment
from .model import Mesh, Scene
from .texture import Texture

PARTS = ("meshes", "materials", "camera", "lights", "environment", "others")  # of a scene, each with a digest

# Fields that say where a scene comes from, or how it is drawn unless that is said otherwise.
_LEFT_OUT: dict[type, tuple[str, ...]] = {
    Scene: ("preset", "ignored", "own_lights", "fitted", "light_scale", "animations"),
    Mesh: ("material", "nonfinite", "dropped"),
}
_LARGE = (Mesh, Texture, Environment)  # described by their digests
_images: WeakKeyDictionary[CodedImage, bytes] = WeakKeyDictionary()  # those that were described


def part_digests(scene: Scene) -> dict[str, str]:
    """Return the SHA-256 of each of PARTS, in hexadecimal.

    Meshes are without their materials, which have a part of their own; `others` are the name, the ambient light, the
    background, and whether it is a scene of the course, whose normals are its own.
    """
    parts = {name: getattr(scene, name) for name in ("meshes", "camera", "lights", "environment")}
    parts["materials"] = tuple(mesh.material for mesh in scene.meshes)
    others = [item.name for item in fields(Scene) if item.name not in (*parts, *_LEFT_OUT[Scene])]
    parts["others"] = {**{name: getattr(scene, name) for name in others}, "course": scene.preset == "course"}
    done: dict[int, bytes] = {}
    return {name: hashlib.sha256(_described(parts[name], done)).hexdigest() for name in PARTS}


def describe_images(scene: Scene) -> None:
    """Compute what `part_digests` needs of a scene's textures, which takes longest, so that it need not."""
    _described([mesh.material for mesh in scene.meshes], {})


def digest_of(value: Any) -> str:
    """Return the SHA-256, in hexadecimal, of plain values, arrays and dataclasses, nested in any way. Raises TypeError."""
    return hashlib.sha256(_described(value, {})).hexdigest()


def _described(value: Any, done: dict[int, bytes]) -> bytes:
    """Return bytes from which the value could be told: each begins with its kind and, if that varies, its length.

    done: descriptions of arrays and dataclasses by id: meshes by the thousand share materials and placements.
    """
    if id(value) in done:
        return done[id(value)]
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int)):
        return b"%a;" % value
    if isinstance(value, float):
        return f"{value.hex()};".encode()
    if isinstance(value, str):
        text = value.encode("utf-8", "surrogatepass")
        return b"text %d:%s" % (len(text), text)
    if isinstance(value, (tuple, list)):
        return b"list %d:" % len(value) + b"".join([_described(item, done) for item in value])
    if isinstance(value, Mapping):
        pairs = sorted((_described(key, done), _described(item, done)) for key, item in value.items())
        return b"map %d:" % len(pairs) + b"".join(key + item for key, item in pairs)
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        little = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
        data = hashlib.sha256(little.reshape(-1).view(np.uint8).data).digest()
        return done.setdefault(id(value), f"array {little.dtype.str} {value.shape}:".encode() + data)
    if isinstance(value, CodedImage):  # as its numbers, which are not held whole
        if value not in _images:
            numbers = hashlib.sha256()
            for start in range(0, len(value), BAND):
                numbers.update(np.ascontiguousarray(value[start : start + BAND], "<f4").data)
            _images[value] = f"array <f4 {value.shape}:".encode() + numbers.digest()
        return _images[value]
    if is_dataclass(value) and not isinstance(value, type):
        return done.setdefault(id(value), _described_fields(value, done))
    raise TypeError(f"digest_of: value: expected plain values, arrays or dataclasses, found {type(value).__name__}")


def _described_fields(value: Any, done: dict[int, bytes]) -> bytes:
    kind: Any = type(value)
    names = _named(kind)
    if kind is Mesh and not value.part_of:  # as before the field existed, so that older digests stay valid
        names = [pair for pair in names if pair[0] != "part_of"]
    content = b"".join([key + _described(getattr(value, name), done) for name, key in names])
    text = f"{kind.__name__} map {len(names)}:".encode() + content
    return hashlib.sha256(text).digest() if isinstance(value, _LARGE) else text


@functools.cache
def _named(kind: type) -> list[tuple[str, bytes]]:
    """Return where a dataclass has the fields that count, and their names as `_described`, in the order of these."""
    names = [item.name for item in fields(kind) if item.name not in _LEFT_OUT.get(kind, ())]
    pairs = [("texels" if (kind, name) == (Texture, "image") else name, _described(name, {})) for name in names]
    return sorted(pairs, key=operator.itemgetter(1))
