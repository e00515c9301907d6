"""A binary glTF 2.0 file while it is put together: its JSON, the bytes that accessors and images name, and its nodes."""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import numpy as np

from ...base.arrays import Array, Floats
from ...base.atomic_files import Path, replacing
from ...base.input_files import file_error
from ...base.validation import value_error
from ..camera import Camera
from ..geometry import camera_axes
from ..lights import PlacedLight
from ..model import Light

MAX_BYTES = (1 << 32) - 1  # of a GLB file, whose lengths have 32 bits
VERTICES, INDICES = 34962, 34963  # targets of buffer views
_COMPONENTS = {"uint16": 5123, "uint32": 5125, "float32": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_SQUARE = 1e-6  # cosine between the axes of a matrix that is a rotation and a scale
_MAX_NUMBER = 1e300  # of a number in the file: readers refuse larger ones
_MIN_CONE = 1e-6  # radians, of a cone
_HALF_PI = math.pi / 2
_IN_GLTF = ("kind", "position", "direction", "intensity", "inner_cone", "outer_cone", "range")  # fields of lights

Sphere = tuple[Array, float]


class Glb:
    """Lists of JSON objects by name, and one binary chunk. The same calls give the same bytes.

    lost: collects a few words for what the file does not say of a scene.
    """

    def __init__(self) -> None:
        self.lost: list[str] = []
        self.lists: dict[str, list[dict[str, Any]]] = {}
        self.extensions: dict[str, dict[str, Any]] = {}
        self.used: set[str] = set()
        self._parts: list[bytes] = []
        self._length = 0

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Append an object to a list such as `meshes`, and return its index."""
        entries = self.lists.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def shared(self, kind: str, entry: dict[str, Any]) -> int:
        """Return the index of an equal object in a list; append the object if there is none."""
        entries = self.lists.get(kind, [])
        return entries.index(entry) if entry in entries else self.add(kind, entry)

    def use(self, extension: str, entry: dict[str, Any]) -> dict[str, Any]:
        """Note that the file uses an extension; return the `extensions` of an object, {extension: entry}."""
        self.used.add(extension)
        return {extension: entry}

    def view(self, data: bytes, target: int | None = None) -> int:
        """Append bytes, from a multiple of four on, and return the index of their buffer view."""
        padding = bytes(-self._length % 4)
        start = self._length + len(padding)
        self._parts += [padding, data]
        self._length = start + len(data)
        entry = {"buffer": 0, "byteOffset": start, "byteLength": len(data)}
        return self.add("bufferViews", entry if target is None else {**entry, "target": target})

    def accessor(self, values: Array, target: int = VERTICES, *, extent: bool = False) -> int:
        """Append an array, (K,) or (K, 2 to 4), of uint16, uint32 or float32. extent: with the least and the largest of
        each column, which positions need."""
        columns = values.reshape(len(values), -1)
        little = np.ascontiguousarray(columns, columns.dtype.newbyteorder("<"))
        entry = {
            "bufferView": self.view(little.tobytes(), target),
            "componentType": _COMPONENTS[values.dtype.name],
            "count": len(values),
            "type": _TYPES[columns.shape[1]],
        }
        if extent:
            entry |= {"min": columns.min(axis=0).tolist(), "max": columns.max(axis=0).tolist()}
        return self.add("accessors", entry)

    def write(self, path: Path, owner: str) -> None:
        """Write the file atomically. Raises InputError, naming `owner`, for one of 4 GiB or more and for numbers beyond
        float64, OutputError if it cannot be written."""
        document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "clshade"}}
        if self.used:
            document["extensionsUsed"] = sorted(self.used)
        if self.extensions:
            document["extensions"] = self.extensions
        document |= {"scene": 0, **self.lists}
        length = self._length + -self._length % 4
        if length:
            document["buffers"] = [{"byteLength": length}]
        try:
            text = json.dumps(document, allow_nan=False, separators=(",", ":")).encode("ascii")
        except ValueError:
            raise file_error(owner, "scene", "materials and lights within the range of float64", "others") from None
        text += b" " * (-len(text) % 4)
        whole = 12 + 8 + len(text) + (8 + length if length else 0)
        if whole > MAX_BYTES:
            raise file_error(owner, "scene", f"a file of at most {MAX_BYTES} bytes", f"{whole} bytes")
        with replacing(path) as file:
            file.write(struct.pack("<4sII", b"glTF", 2, whole))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            if length:
                file.write(struct.pack("<I4s", length, b"BIN\0"))
                for part in self._parts:
                    file.write(part)
                file.write(bytes(length - self._length))


def add_placement(glb: Glb, matrix: Floats, **content: Any) -> int:
    """Add a node, in two steps where its matrix shears, which nodes may not; return the index of the outer one."""
    linear = _checked(matrix, "meshes")[:3, :3]
    columns = linear / (np.abs(linear).max() or 1.0)
    lengths = np.sqrt((columns * columns).sum(axis=0))
    cosines = np.abs(columns.T @ columns) - np.diag(lengths * lengths)
    if (cosines <= _SQUARE * np.outer(lengths, lengths)).all():
        return glb.add("nodes", {**content, **_placed(matrix)})
    left, sizes, right = np.linalg.svd(linear)
    outer, inner = matrix.copy(), np.eye(4)
    outer[:3, :3], inner[:3, :3] = left * sizes, right
    child = glb.add("nodes", {**content, **_placed(inner)})
    return glb.add("nodes", {"children": [child], **_placed(outer)})


def _checked(matrix: Floats, field: str) -> Floats:
    """Return a placement. Raises InputError, naming the scene's field, for one beyond what readers take."""
    if not (np.isfinite(matrix).all() and np.abs(matrix).max() <= _MAX_NUMBER):
        raise value_error("to_glb", field, f"placements within {_MAX_NUMBER:g}", matrix.tolist())
    return matrix


def _placed(matrix: Floats) -> dict[str, list[float]]:
    """Return the placement of a node, as short as it can be said exactly."""
    if (matrix[:3, :3] != np.eye(3)).any():
        return {"matrix": (matrix.T.reshape(-1) + 0.0).tolist()}
    return {"translation": (matrix[:3, 3] + 0.0).tolist()} if matrix[:3, 3].any() else {}


def add_camera(glb: Glb, camera: Camera, sphere: Sphere) -> int:
    """Add the camera; return the index of its node. sphere: of the meshes, which lie between near and far plane."""
    (height, width), (right, up, forward) = camera.plane, camera_axes(camera)
    if camera.principal != (0.5, 0.5):
        glb.lost.append("the camera's principal point (the middle of the image)")
    center, radius = sphere
    depth = float((center - camera.eye) @ forward)
    facts: dict[str, Any] = {name: np.asarray(getattr(camera, name)).tolist() for name in ("eye", "lookat", "up")}
    facts |= {name: list(getattr(camera, name)) for name in ("plane", "resolution", "principal")}
    extras = {"clshade": {**facts, "focal": camera.focal}}
    if camera.orthographic:
        near = max(depth - 1.5 * radius, 0.0)
        lens = {"xmag": width / 2.0, "ymag": height / 2.0, "znear": near, "zfar": max(depth, 0.0) + 2.0 * radius}
        entry: dict[str, Any] = {"type": "orthographic", "orthographic": lens, "extras": extras}
    else:
        near = max(0.5 * (depth - radius), 1e-3 * radius)
        fov, aspect = 2.0 * math.atan(height / camera.focal / 2.0), width / height
        if not (0.0 < fov < math.pi and 0.0 < aspect <= _MAX_NUMBER):
            raise value_error("to_glb", "camera", "angles of view above 0 and below 180 degrees", camera.plane)
        lens = {"yfov": fov, "aspectRatio": aspect, "znear": near}
        entry = {"type": "perspective", "perspective": lens, "extras": extras}
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.stack([right, up, -forward], axis=1), camera.eye
    content = {"name": "camera", "camera": glb.add("cameras", entry)}
    return glb.add("nodes", {**content, **_placed(_checked(matrix, "camera"))})


def add_lights(glb: Glb, lights: tuple[Light, ...], sphere: Sphere, light_scale: float) -> list[int]:
    """Add the lights; return the indices of their nodes. sphere: of the meshes. light_scale: see Scene."""
    nodes: list[int] = []
    entries = glb.extensions.setdefault("KHR_lights_punctual", {"lights": []})["lights"]
    for number, light in enumerate(lights):
        entry, matrix = _light(glb, light, sphere, light_scale)
        entries.append(entry)
        content = {"name": f"light {number}", "extensions": glb.use("KHR_lights_punctual", {"light": number})}
        nodes.append(glb.add("nodes", {**content, **_placed(_checked(matrix, "lights"))}))
    return nodes


def _light(glb: Glb, light: Light, sphere: Sphere, light_scale: float) -> tuple[dict[str, Any], Floats]:
    """Return a light of the file and its (4, 4) matrix in the world."""
    intensity = np.maximum(light.intensity, 0.0)
    if (light.intensity < 0.0).any():
        glb.lost.append("negative light (none)")
    strength = float(intensity.max())
    color = (intensity / strength).tolist() if strength else [1.0, 1.0, 1.0]
    strength /= light_scale
    entry: dict[str, Any] = {"type": light.gltf, "color": color, "intensity": strength}
    matrix = np.eye(4)
    if light.axis is not None:  # a rotation that turns -z into it
        back = -np.asarray(light.axis)
        right = np.cross(np.eye(3)[int(np.argmin(np.abs(back)))], back)
        right /= np.linalg.norm(right)
        matrix[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    if not isinstance(light, PlacedLight):
        return entry, matrix
    if light.gltf_loss:
        glb.lost.append(light.gltf_loss)
    if not light.attenuates:  # as bright at the center of the meshes
        center, radius = sphere
        away = max(math.dist(light.position, center), radius)
        entry["intensity"] = min(strength * away * away, _MAX_NUMBER)
    if light.range is not None:
        entry["range"] = light.range
    if light.gltf == "spot":
        angles = np.radians(light.cone or (0.0, 90.0)).tolist()
        outer = max(min(angles[1], _HALF_PI), _MIN_CONE)
        entry["spot"] = {"innerConeAngle": min(angles[0], outer * (1.0 - _MIN_CONE)), "outerConeAngle": outer}
    matrix[:3, 3] = light.position
    others = {name: value for name, value in light.facts().items() if name not in _IN_GLTF}
    return {**entry, "extras": {"clshade": others}}, matrix
