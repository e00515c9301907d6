"""Small glTF, PLY and STL files for the tests, written according to the formats' specifications."""

import base64
import io
import json
import struct
from collections.abc import Iterable
from typing import Any

import numpy as np
from PIL import Image

_COMPONENTS = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
INDICES = np.array([0, 1, 2], np.uint16)
UP, UVS = np.float32([[0, 0, 1]] * 3), np.float32([[0, 0], [1, 0], [0, 1]])
TIMES = np.array([0.5, 1.0, 3.0], np.float32)
PLACES = np.array([[1, 0, 0], [3, -2, 5], [-1, 4, 5]], np.float32)  # at these times
REMOVED = object()


class Gltf:
    """A document built step by step: arrays become accessors of one buffer."""

    def __init__(self) -> None:
        self.data = b""
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": []}

    def view(self, data: bytes) -> int:
        self.data += bytes(-len(self.data) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: Any, **fields: Any) -> int:
        values = np.asarray(values)
        width = values.shape[1] if values.ndim == 2 else 1
        entry = {
            "bufferView": self.view(values.tobytes()),
            "componentType": _COMPONENTS[str(values.dtype)],
            "count": len(values),
            "type": _KINDS[width],
            **fields,
        }
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1

    def sparse(self, rows: Any, values: Any, count: int) -> int:
        """Add an accessor of vectors that are 0 except in some rows."""
        indices = {"bufferView": self.view(rows.tobytes()), "componentType": _COMPONENTS[str(rows.dtype)]}
        parts = {"count": len(rows), "indices": indices, "values": {"bufferView": self.view(values.tobytes())}}
        return self.add("accessors", {"componentType": 5126, "type": "VEC3", "count": count, "sparse": parts})

    def texture(self, pixels: np.ndarray) -> int:
        """Add a texture with an image of its own."""
        image = {"bufferView": self.view(png(pixels)), "mimeType": "image/png"}
        return self.add("textures", {"source": self.add("images", image)})

    def mesh(self, attributes: dict[str, Any], indices: Any = None, **fields: Any) -> int:
        """Add a mesh of one primitive; arrays become accessors, integers are indices of accessors."""
        accessors = {k: v if isinstance(v, int) else self.accessor(v) for k, v in attributes.items()}
        primitive = {"attributes": accessors, **fields}
        if indices is not None:
            primitive["indices"] = self.accessor(indices)
        self.json.setdefault("meshes", []).append({"primitives": [primitive]})
        return len(self.json["meshes"]) - 1

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        self.json.setdefault(kind, []).append(entry)
        return len(self.json[kind]) - 1

    def animation(self, *channels: tuple[int, str, Any, Any, str], name: str = "") -> int:
        """Add an animation of channels (node, path, times, values, interpolation); arrays as they are stored, an accessor by
        its index."""
        entry: dict[str, Any] = {"channels": [], "samplers": [], **({"name": name} if name else {})}
        for number, (node, path, times, values, interpolation) in enumerate(channels):
            accessors = [data if isinstance(data, int) else self.accessor(np.array(data)) for data in (times, values)]
            entry["samplers"].append({"input": accessors[0], "output": accessors[1], "interpolation": interpolation})
            entry["channels"].append({"sampler": number, "target": {"node": node, "path": path}})
        return self.add("animations", entry)

    def glb(self, path) -> str:
        self.json["buffers"] = [{"byteLength": max(len(self.data), 1)}]
        path.write_bytes(pack_glb(json.dumps(self.json).encode(), self.data or b"\0"))
        return str(path)

    def gltf(self, path, uri: str | None = None) -> str:
        """Write a .gltf file with a data URI, or with a separate buffer file."""
        encoded = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        if uri is not None:
            (path.parent / uri).write_bytes(self.data)
        self.json["buffers"] = [{"byteLength": len(self.data), "uri": uri or encoded}]
        path.write_text(json.dumps(self.json))
        return str(path)


def change(document: Any, keys: Iterable[Any], value: Any) -> None:
    """Change one value of a document of JSON, or remove its key."""
    *outer, last = keys
    for key in outer:
        document = document[key]
    if value is REMOVED:
        del document[last]
    else:
        document[last] = value


def changed(document: Gltf, changes: dict[str, Any], path) -> str:
    """Write a document of which values were changed by their places, with dots between keys. Arrays become accessors, as do
    pairs of an array and fields of its accessor."""
    accessors = {}
    for place, value in changes.items():
        if isinstance(value, np.ndarray):
            accessors[place] = document.accessor(value)
        elif isinstance(value, tuple):
            accessors[place] = document.accessor(value[0], **value[1])
    document.glb(path)
    for place, value in {**changes, **accessors}.items():
        change(document.json, (int(key) if key.isdigit() else key for key in place.split(".")), value)
    path.write_bytes(pack_glb(json.dumps(document.json).encode(), document.data))
    return str(path)


def pack_glb(text: bytes, binary: bytes | None) -> bytes:
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    if binary is not None:
        binary += bytes(-len(binary) % 4)
        body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def triangle(node: dict[str, Any] | None = None, **fields: Any) -> Gltf:
    """Return a document of one triangle, with one node or none. fields: of its primitive."""
    document = Gltf()
    document.mesh({"POSITION": CORNERS}, INDICES, **fields)
    if node is not None:
        document.add("nodes", node)
    return document


def bar(inverse: bool = True, **fields: Any) -> Gltf:
    """Return a document of a bar along y with two joints, at its foot and at (0, 1, 0): nodes 1 and 2. Node 3 is the bar,
    which a transform of its own would move far away. inverse: with inverse bind matrices. fields: of its primitive."""
    document = Gltf()
    verts = np.array([[x, y, 0] for y in (0, 1, 2) for x in (-0.1, 0.1)], np.float32)
    faces = np.array([0, 1, 3, 0, 3, 2, 2, 3, 5, 2, 5, 4], np.uint16)
    joints = np.array([[0, 1, 0, 0]] * 6, np.uint8)
    weights = np.array([[1, 0, 0, 0]] * 2 + [[0.5, 0.5, 0, 0]] * 2 + [[0, 1, 0, 0]] * 2, np.float32)
    normals = np.array([[0, 0, 1]] * 6, np.float32)
    document.mesh({"POSITION": verts, "NORMAL": normals, "JOINTS_0": joints, "WEIGHTS_0": weights}, faces, **fields)
    back = np.stack([np.eye(4), np.eye(4)]).astype(np.float32)
    back[1, 1, 3] = -1.0
    matrices = document.accessor(back.transpose(0, 2, 1).reshape(2, 16).copy())
    document.add("nodes", {"children": [1, 3]})
    document.add("nodes", {"children": [2]})
    document.add("nodes", {"translation": [0, 1, 0]})
    document.add("nodes", {"mesh": 0, "skin": 0, "translation": [50, 60, 70], "scale": [9, 9, 9]})
    document.add("skins", {"joints": [1, 2], **({"inverseBindMatrices": matrices} if inverse else {})})
    document.add("scenes", {"nodes": [0]})
    return document


def cubic(t: float, step: float, before: Any, leaving: Any, after: Any, arriving: Any) -> Any:
    """Return what lies at t of a cubic spline between two times: the specification's sum, appendix C.5, in another order."""
    keys = (2 * t**3 - 3 * t**2 + 1) * before + (3 * t**2 - 2 * t**3) * after
    return keys + step * ((t**3 - 2 * t**2 + t) * leaving + (t**3 - t**2) * arriving)


def png(pixels: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "PNG")
    return buffer.getvalue()


def properties(kind: str, names: str) -> str:
    return "".join(f"property {kind} {name}\n" for name in names.split())


def ply(form: str, header: str, rows: list[tuple[str, list]]) -> bytes:
    """Return a PLY file. rows: (struct format without byte order, values) in file order."""
    text = f"ply\nformat {form} 1.0\n{header}end_header\n".encode()
    if form == "ascii":
        return text + "".join(" ".join(map(str, values)) + "\n" for _, values in rows).encode()
    order = "<" if "little" in form else ">"
    return text + b"".join(struct.pack(order + kind, *values) for kind, values in rows)


def stl(triangles: Any, attribute: int = 0) -> bytes:
    """Return a binary STL file of corners (F, 3, 3), with wrong normals."""
    facets = np.asarray(triangles, np.float32)
    body = b"".join(struct.pack("<3f", 9, 9, 9) + facet.tobytes() + struct.pack("<H", attribute) for facet in facets)
    return b"solid but binary".ljust(80) + struct.pack("<I", len(facets)) + body


def stl_text(triangles: Any) -> str:
    lines = ["solid a name of facets"]
    for facet in np.asarray(triangles).tolist():
        corners = [f"      vertex {x!r} {y!r} {z!r}" for x, y, z in facet]
        lines += ["  facet normal 0 0 0", "    outer loop", *corners, "    endloop", "  endfacet"]
    return "\n".join([*lines, "endsolid a name of facets", ""])


def spheres(path) -> str:
    """Write a .glb of small spheres, metallic upwards and rough to the right, as Khronos' metal-rough spheres are, one of
    them with maps of base color and of metallic and roughness."""
    document, nodes = Gltf(), []
    across, up = 7, 5
    phi, theta = (a.ravel() for a in np.meshgrid(np.linspace(0, 2 * np.pi, across), np.linspace(0, np.pi, up)))
    normals = np.stack([np.sin(theta) * np.cos(phi), -np.cos(theta), np.sin(theta) * np.sin(phi)], 1)
    uvs = np.stack([phi / (2 * np.pi), theta / np.pi], 1)
    first = (np.arange(up - 1)[:, None] * across + np.arange(across - 1)).reshape(-1, 1)
    faces = np.concatenate([first + [0, across, 1], first + [1, across, across + 1]])
    shape = {
        "POSITION": document.accessor((0.45 * normals).astype(np.float32)),
        "NORMAL": document.accessor(normals.astype(np.float32)),
        "TEXCOORD_0": document.accessor(uvs.astype(np.float32)),
    }
    pixels = np.random.default_rng(5).integers(0, 256, (4, 6, 3)).astype(np.uint8)
    document.texture(pixels)
    for row, column in np.ndindex(2, 3):
        worn: dict[str, Any] = {"metallicFactor": float(row), "roughnessFactor": 0.1 + 0.4 * column}
        worn["baseColorFactor"] = [0.9, 0.6, 0.3, 1.0]
        if (row, column) == (1, 2):
            worn |= {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}}
        material = document.add("materials", {"pbrMetallicRoughness": worn, "emissiveFactor": [0.0, 0.0, 0.1 * column]})
        mesh = document.mesh(shape, faces.astype(np.uint16).reshape(-1), material=material)
        nodes.append(document.add("nodes", {"mesh": mesh, "translation": [column, row, 0]}))
    document.json["scenes"], document.json["scene"] = [{"nodes": nodes}], 0
    return document.glb(path)
