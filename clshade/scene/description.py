"""Canonical descriptions of scenes: digests that are the same for equal scenes on every machine, in every process.

A digest covers every field of a scene that can change its image, names included: numbers exactly, arrays by type, shape
and bytes (little-endian, in C order).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

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


def part_digests(scene: Scene) -> dict[str, str]:
    """Return the SHA-256 of each of PARTS, in hexadecimal.

    Meshes are without their materials, which have a part of their own; `others` are the name, the ambient light, the
    background, and whether it is a scene of the course, whose normals are its own.
    """
    parts = {name: getattr(scene, name) for name in ("meshes", "camera", "lights", "environment")}
    parts["materials"] = tuple(mesh.material for mesh in scene.meshes)
    left = [each.name for each in fields(Scene) if each.name not in (*parts, *_LEFT_OUT[Scene])]
    parts["others"] = {**{name: getattr(scene, name) for name in left}, "course": scene.preset == "course"}
    return {name: hashlib.sha256(_described(parts[name])).hexdigest() for name in PARTS}


def digest_of(value: Any) -> str:
    """Return the SHA-256 of plain values, arrays and dataclasses of these, nested in any way, in hexadecimal. Raises
    TypeError for others."""
    return hashlib.sha256(_described(value)).hexdigest()


def _described(value: Any) -> bytes:
    """Return bytes from which the value could be told: each begins with its kind and, if that varies, its length."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int)):
        return f"{value};".encode()
    if isinstance(value, float):
        return f"{value.hex()};".encode()
    if isinstance(value, str):
        text = value.encode("utf-8", "surrogatepass")
        return b"text %d:%s" % (len(text), text)
    if isinstance(value, (tuple, list)):
        return b"list %d:" % len(value) + b"".join(map(_described, value))
    if isinstance(value, Mapping):
        pairs = sorted((_described(key), _described(each)) for key, each in value.items())
        return b"map %d:" % len(pairs) + b"".join(key + each for key, each in pairs)
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return _described_array(value)
    if is_dataclass(value) and not isinstance(value, type):
        return _described_fields(value)
    raise TypeError(f"digest_of: value: expected plain values, arrays or dataclasses, found {type(value).__name__}")


def _described_array(array: Any) -> bytes:
    little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    data = hashlib.sha256(little.reshape(-1).view(np.uint8).data).digest()
    return f"array {little.dtype.str} {array.shape}:".encode() + data


def _described_fields(value: Any) -> bytes:
    left_out = _LEFT_OUT.get(type(value), ())
    named = {each.name: getattr(value, each.name) for each in fields(value) if each.name not in left_out}
    found = f"{type(value).__name__} ".encode() + _described(named)
    return hashlib.sha256(found).digest() if isinstance(value, _LARGE) else found
