"""Small valid files of every format that clshade reads, generated for the fuzzer to damage."""

from __future__ import annotations

import base64
import io
import json
import struct
import zlib
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from PIL import Image

from ...base.arrays import Array
from ...images import exr
from ...scene.camera import Camera
from ...scene.environment import Environment
from ...scene.formats.scene_json_writer import encoded
from ...scene.lights import DirectionalLight, PointLight
from ...scene.model import Material, Mesh, MetallicRoughness, Scene, Texture

IMAGES = (".exr", ".hdr")


@dataclass(frozen=True)
class Sample:
    """Files by name; the first is passed to `load`, or, if it is an image (of IMAGES), to `load_environment`.

    texture: name of the file passed as option `texture`.
    """

    files: dict[str, bytes]
    texture: str = ""
    options: dict[str, Any] = field(default_factory=dict)


@cache
def samples() -> tuple[Sample, ...]:
    """Return all samples. Each loads without error."""
    made = [*_course(), *_obj(), *_ply(), *_stl(), *_gltf(), *_exr(), *_hdr(), *_animated(), *_saved()]
    return tuple(made)


def _image(mode: str, kind: str = "PNG") -> bytes:
    pixels = np.random.default_rng(len(mode)).integers(0, 256, (5, 7, 4), np.uint8)
    image = Image.fromarray(pixels, "RGBA").convert("RGB").convert(mode) if mode != "RGBA" else Image.fromarray(pixels)
    buffer = io.BytesIO()
    image.save(buffer, kind)
    return buffer.getvalue()


def png_chunk(kind: bytes, data: bytes) -> bytes:
    """Return a chunk of a PNG file: length, type, data, checksum."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _image16() -> bytes:
    """Return a PNG in RGB with 16 bits per channel, which Pillow does not write."""
    rows = b"".join(b"\0" + row.tobytes() for row in np.arange(4 * 5 * 3, dtype=">u2").reshape(4, 15) * 1000)
    head = struct.pack(">IIBBBBB", 5, 4, 16, 2, 0, 0, 0)
    parts = (png_chunk(b"IHDR", head), png_chunk(b"IDAT", zlib.compress(rows)), png_chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def _tiff16() -> bytes:
    """Return a TIFF in RGB with 16 bits per channel, in two strips."""
    data = np.arange(4 * 5 * 3, dtype="<u2").reshape(4, 15) * np.uint16(1000)
    start = 8 + data.nbytes
    # Width, height, bits, compression, RGB, offsets of strips, samples, rows and bytes of strips: short or long.
    tags = [(256, 3, 1, 5), (257, 3, 1, 4), (258, 3, 3, start), (259, 3, 1, 1), (262, 3, 1, 2), (273, 4, 2, start + 6)]
    tags += [(277, 3, 1, 3), (278, 3, 1, 2), (279, 4, 2, start + 14)]
    values = struct.pack("<3H4I", 16, 16, 16, 8, 8 + data.nbytes // 2, data.nbytes // 2, data.nbytes // 2)
    directory = struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags) + bytes(4)
    file: bytes = b"II*\0" + struct.pack("<I", start + len(values)) + data.tobytes() + values + directory
    return file


def _pnm(magic: str) -> bytes:
    """Return a PNM in RGB with values up to 1023, as text or binary."""
    values = (np.arange(4 * 5 * 3) * 17).astype(">u2")
    body = " ".join(map(str, values.tolist())).encode() if magic == "P3" else values.tobytes()
    return f"{magic} # a comment\n5 4\n1023\n".encode() + body


# Course scenes


def _course_content() -> dict[str, Any]:
    rng = np.random.default_rng(1)
    return {
        "verts": rng.normal(size=(3, 8)).astype(np.float32),
        "vertex_colors": rng.random((3, 8)),
        "face_indices": rng.integers(0, 8, (3, 6)),
        "uvs": rng.random((2, 5)).astype(np.float32),
        "face_uv_indices": rng.integers(0, 5, (3, 6)),
        "depth": np.ones(8, np.float32),
        "cam_eye": np.array([0, 0, 5], np.float32),
        "cam_up": np.array([0, 1, 0], np.float32),
        "cam_lookat": np.zeros(3, np.float32),
        **{"ka": 0.1, "kd": 0.8, "ks": 0.5, "n": 7, "M": 48, "N": 64, "W": 4, "H": 3, "focal": 2.0},
        "light_positions": [np.array([0.0, 0, 5]), np.array([1.0, 2, 3])],
        "light_intensities": [np.ones(3), np.array([1.0, 0.5, 0.25])],
        "Ia": np.array([0.2, 0.3, 0.4]),
        "bg_color": [1.0, 0.9, 0.8],
    }


def _course() -> list[Sample]:
    content = _course_content()
    wide = {"verts", "vertex_colors", "face_indices", "uvs", "face_uv_indices"}
    turned = {key: np.ascontiguousarray(value.T) if key in wide else value for key, value in content.items()}
    files = []
    for each in (content, turned):
        buffer = io.BytesIO()
        np.save(buffer, np.array(each, dtype=object), allow_pickle=True)
        files.append(buffer.getvalue())
    return [
        Sample({"a.npy": files[0]}),
        Sample({"a.npy": files[1]}),
        Sample({"a.npy": files[0], "b.png": _image("RGB")}, "b.png"),
        Sample({"a.npy": files[0], "b.png": _image16()}, "b.png"),
        Sample({"a.npy": files[0], "b.tif": _tiff16()}, "b.tif"),
        Sample({"a.npy": files[0], "b.ppm": _pnm("P3")}, "b.ppm"),
        Sample({"a.npy": files[0], "b.ppm": _pnm("P6")}, "b.ppm"),
    ]


# OBJ


_OBJ = """# a comment
mtllib a.mtl
o first
v 0 0 0
v 1 0 0 0.5 0.25 1
v 0 1 0
v 1 1 -0.5
vt 0 0
vt 1 0
vt 0.5 1.25
vn 0 0 1
vn 0 1e-3 -1
usemtl red
f 1/1/1 2/2/1 3/3/2
f 1//1 2//1 4//2
s off
o second
usemtl cut
f -4/-3 -3/-2 -2/-1 -1/-1
g two
usemtl plain
f 1 2 \\
  3
l 1 2
"""
_MTL = """newmtl red
Ka 0.1 0.2 0.3
Kd 0.5 0.5 0.5
Ks 1 1 1
Ns 96.078431
d 1
illum 2
map_Kd -s 2 2 1 -o 0.5 0 0 -clamp on b.png
newmtl cut
Kd 0.8
map_Kd c.png
map_d c.png
newmtl plain
Kd 0.1 0.1 0.1
Tr 0.5
Ke 1 0 0
"""


# Concave polygons; one has corners on its edges and two at one place, one has a bridge to a hole.
_POLYGONS = """v 0 0 0
v 4 0 0
v 4 4 0.1
v 2 1 0
v 0 4 0
v 2 0 0
v 1 1 0
v 1.5 1 0
v 1 1.5 0
f 1 2 3 4 5
f 1 2 4 5
f 1 6 2 2 3 4 5 5
f 1 2 3 5 1 7 9 8 7
"""


def _obj() -> list[Sample]:
    images = {"b.png": _image("P"), "c.png": _image("RGBA")}
    plain = "\n".join(line for line in _OBJ.splitlines() if not line.startswith(("mtllib", "usemtl")))
    return [
        Sample({"a.obj": _OBJ.encode(), "a.mtl": _MTL.encode(), **images}),
        Sample({"a.obj": plain.encode()}, options={"crease": 30.0}),
        Sample({"a.obj": _POLYGONS.encode()}),
        Sample({"a.obj": _OBJ.replace("\n", "\r\n").encode(), "a.mtl": _MTL.encode(), **images}, "b.png"),
    ]


# PLY


_PLY_HEAD = """ply
format {form} 1.0
comment TextureFile b.png
element vertex 4
property float x
property float y
property float z
property double nx
property double ny
property double nz
property uchar red
property uchar green
property uchar blue
element face 2
property list uchar int vertex_indices
property list uchar float texcoord
element edge 1
property int vertex1
property short vertex2
end_header
"""
_PLY_POINTS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, -0.25)]
_PLY_FACES = [((0, 1, 2), (0, 0, 1, 0, 0.5, 1)), ((1, 3, 2, 0), (0, 0, 1, 0, 1, 1, 0, 1))]


def _ply_text() -> bytes:
    lines = [f"{x} {y} {z} 0 0 1 {40 * i} 128 255" for i, (x, y, z) in enumerate(_PLY_POINTS)]
    lines += [" ".join(map(str, (len(f), *f, len(t), *t))) for f, t in _PLY_FACES]
    return (_PLY_HEAD.format(form="ascii") + "\n".join([*lines, "0 1", ""])).encode()


def _ply_binary(order: str) -> bytes:
    body = b"".join(struct.pack(order + "3f3d3B", *p, 0, 0, 1, 40, 128, 255) for p in _PLY_POINTS)
    for f, t in _PLY_FACES:
        body += struct.pack(f"{order}B{len(f)}iB{len(t)}f", len(f), *f, len(t), *t)
    form = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    return _PLY_HEAD.format(form=form).encode() + body + struct.pack(order + "ih", 0, 1)


def _ply() -> list[Sample]:
    strips = _PLY_HEAD.format(form="ascii").split("element face")[0].replace("comment TextureFile b.png\n", "")
    strips += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    strips += "\n".join([f"{x} {y} {z} 0 0 1 9 9 9" for x, y, z in _PLY_POINTS] + ["6 0 1 2 -1 1 2", ""])
    image = {"b.png": _image("LA")}
    return [
        Sample({"a.ply": _ply_text(), **image}),
        Sample({"a.ply": _ply_binary("<"), **image}),
        Sample({"a.ply": _ply_binary(">"), **image}),
        Sample({"a.ply": strips.encode()}, options={"flat": True}),
    ]


# STL


def _stl() -> list[Sample]:
    facets = np.random.default_rng(3).normal(size=(5, 3, 3)).astype(np.float32)
    binary = b"a header".ljust(80) + struct.pack("<I", len(facets))
    text = "solid name\n"
    for facet in facets:
        binary += struct.pack("<3f", 0, 0, 1) + facet.tobytes() + b"\0\0"
        corners = "".join(f"      vertex {x!r} {y!r} {z!r}\n" for x, y, z in facet.tolist())
        text += f"  facet normal 0 0 1\n    outer loop\n{corners}    endloop\n  endfacet\n"
    return [Sample({"a.stl": binary}), Sample({"a.stl": (text + "endsolid name\n").encode()})]


# OpenEXR


def _exr() -> list[Sample]:
    rng, files = np.random.default_rng(5), []
    for compression in ("none", "zip", "dwaa", "zstd"):
        buffer = io.BytesIO()
        layers = {"RGBA": rng.random((9, 7, 4)), "Z": rng.random((9, 7)), "id": rng.integers(0, 9, (9, 7))}
        exr.encode(buffer, layers, compression=compression, window=(1, 0, 6, 7))
        files.append(buffer.getvalue())
    return [Sample({"a.exr": data}) for data in files]


# Radiance HDR


def _hdr() -> list[Sample]:
    codes = np.random.default_rng(6).integers(3, 256, (3, 9, 4), np.uint8)
    codes[:, :4] = codes[:, :1]
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 3 +X 9\n"
    rows = (b"".join(bytes([132, plane[0], 5]) + plane[4:].tobytes() for plane in row.T) for row in codes)
    pixel_by_pixel = codes[0, 0].tobytes() + b"\1\1\1\3" + codes.tobytes()[16:]
    return [
        Sample({"a.hdr": head + b"".join(b"\2\2\0\x09" + row for row in rows)}),
        Sample({"a.hdr": head + pixel_by_pixel}),
    ]


# glTF


class _Document:
    """A glTF document built from accessors of one buffer."""

    def __init__(self) -> None:
        self.data = b""
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}

    def view(self, data: bytes) -> int:
        self.data += bytes(-len(self.data) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: Array, **fields: Any) -> int:
        kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}[values.shape[1] if values.ndim == 2 else 1]
        code = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
        entry = {"bufferView": self.view(values.tobytes()), "componentType": code[str(values.dtype)]}
        self.json["accessors"].append({**entry, "count": len(values), "type": kind, **fields})
        return len(self.json["accessors"]) - 1


def pack_glb(text: bytes, binary: bytes) -> bytes:
    """Return a GLB file of the JSON and the buffer."""
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _document() -> _Document:
    """Return two meshes of several primitives, with everything that the loader reads."""
    d, rng = _Document(), np.random.default_rng(7)
    points = d.accessor(rng.normal(size=(4, 3)).astype(np.float32))
    normals = d.accessor(rng.normal(size=(4, 3)).astype(np.float32))
    uvs = d.accessor(rng.integers(0, 65536, (4, 2)).astype(np.uint16), normalized=True)
    colors = d.accessor(rng.integers(0, 256, (4, 4)).astype(np.uint8), normalized=True)
    moved = d.accessor(rng.integers(-99, 99, (4, 3)).astype(np.int16))
    triangles = d.accessor(np.array([0, 1, 2, 1, 3, 2], np.uint16))
    strip = d.accessor(np.array([0, 1, 2, 3], np.uint8))
    index, values = d.view(np.array([1, 3], np.uint16).tobytes()), d.view(np.zeros((2, 3), np.float32).tobytes())
    places = {"bufferView": index, "componentType": 5123}
    d.json["accessors"][points]["sparse"] = {"count": 2, "indices": places, "values": {"bufferView": values}}
    shared = {"POSITION": points, "NORMAL": normals, "TEXCOORD_0": uvs, "COLOR_0": colors}
    d.json["meshes"] = [
        {
            "primitives": [
                {"attributes": shared, "indices": triangles, "material": 0},
                {"attributes": {"POSITION": moved}, "mode": 6},
            ]
        },
        {"primitives": [{"attributes": {"POSITION": points}, "indices": strip, "mode": 5, "material": 1}]},
    ]
    d.json["images"] = [{"bufferView": d.view(_image("RGBA")), "mimeType": "image/png"}]
    d.json["samplers"] = [{"wrapS": 33071, "wrapT": 33648, "magFilter": 9729}]
    d.json["textures"] = [{"source": 0, "sampler": 0}]
    transform = {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.5, "scale": [2, 1]}}
    d.json["materials"] = [
        {
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": transform}, "metallicFactor": 0.5},
            "alphaMode": "MASK",
            "alphaCutoff": 0.4,
        },
        {"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0.2, 1]}, "doubleSided": True},
    ]
    d.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1, "aspectRatio": 1.5}}]
    light = {"type": "point", "color": [1, 1, 0.5], "intensity": 30, "range": 20}
    spot = {"type": "spot", "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.5}}
    d.json["extensions"] = {"KHR_lights_punctual": {"lights": [light, {"type": "directional"}, spot]}}
    d.json["extensionsUsed"] = ["KHR_lights_punctual", "KHR_texture_transform", "KHR_mesh_quantization"]
    d.json["nodes"] = [
        {"mesh": 0, "translation": [0, 1, 0], "rotation": [0, 0, 0, 1], "scale": [1, -1, 1], "children": [1]},
        {"mesh": 1, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1]},
        {"camera": 0, "translation": [0, 0, 6]},
        {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [1, 2, 3]},
        {"extensions": {"KHR_lights_punctual": {"light": 1}}},
        {"extensions": {"KHR_lights_punctual": {"light": 2}}, "translation": [0, 3, 1]},
    ]
    d.json.update(scenes=[{"nodes": [0, 2, 3, 4, 5]}], scene=0)
    return d


def _gltf() -> list[Sample]:
    d = _document()
    size = len(d.data)
    uri = "data:application/octet-stream;base64," + base64.b64encode(d.data).decode()

    def text(**buffer: Any) -> bytes:
        return json.dumps({**d.json, "buffers": [{"byteLength": size, **buffer}]}, indent=1).encode()

    apart = {**d.json, "images": [{"uri": "b.jpg"}], "buffers": [{"byteLength": size, "uri": "a.bin"}]}
    files = {"a.gltf": json.dumps(apart, indent=1).encode(), "a.bin": d.data, "b.jpg": _image("RGB", "JPEG")}
    return [Sample({"a.glb": pack_glb(text(), d.data)}), Sample({"a.gltf": text(uri=uri)}), Sample(files)]


def _animated() -> list[Sample]:
    """Return a skinned mesh with morph targets and an animation with channels of all kinds, at two times."""
    d, rng = _Document(), np.random.default_rng(6)
    attributes = {
        "POSITION": d.accessor(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float32)),
        "JOINTS_0": d.accessor(np.array([[0, 1, 0, 0]] * 4, np.uint8)),
        "WEIGHTS_0": d.accessor(np.array([[0.75, 0.25, 0, 0]] * 4, np.float32)),
    }
    indices = d.accessor(np.array([0, 1, 2, 2, 1, 3], np.uint16))
    targets = [{"POSITION": d.accessor(rng.random((4, 3), np.float32))} for _ in range(2)]
    back = d.accessor(np.stack([np.eye(4, dtype=np.float32).reshape(16)] * 2))
    primitive = {"attributes": attributes, "indices": indices, "targets": targets}
    d.json["meshes"] = [{"primitives": [primitive], "weights": [0.5, 0]}]
    d.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": back, "skeleton": 1}]
    d.json["nodes"] = [{"mesh": 0, "skin": 0}, {"children": [2]}, {"translation": [0, 1, 0]}]
    d.json["scenes"] = [{"nodes": [0, 1]}]
    times = d.accessor(np.array([0, 1, 3], np.float32))
    outputs = [
        (1, "translation", "LINEAR", d.accessor(rng.random((3, 3), np.float32))),
        (2, "rotation", "LINEAR", d.accessor(rng.random((3, 4), np.float32))),
        (2, "scale", "STEP", d.accessor(rng.random((3, 3), np.float32))),
        (0, "weights", "CUBICSPLINE", d.accessor(rng.random(18, np.float32))),
    ]
    samplers = [{"input": times, "output": output, "interpolation": kind} for _, _, kind, output in outputs]
    channels = [{"sampler": k, "target": {"node": node, "path": path}} for k, (node, path, *_) in enumerate(outputs)]
    d.json["animations"] = [{"samplers": samplers, "channels": channels}]
    text = json.dumps({**d.json, "buffers": [{"byteLength": len(d.data)}]}, indent=1).encode()
    return [Sample({"a.glb": pack_glb(text, d.data)}, options={"time": time}) for time in (0.5, 1.5)]


# Scene files of clshade's own


def _saved() -> list[Sample]:
    """Return a scene with its arrays in the text, and one with a file of arrays."""
    rng, camera = np.random.default_rng(7), Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (0.6, 0.8), (8, 6))
    small = Mesh(np.eye(3), [[0, 1, 2]])
    texture = Texture(rng.random((3, 4, 4), np.float32), wrap="clamp", name="t")
    pbr = MetallicRoughness(0.5, 0.25, normal_texture=Texture(rng.random((2, 2, 3), np.float32)))
    material = Material(texture=texture, pbr=pbr, alpha_cutoff=0.25, name="m")
    uvs, placements = rng.random((6, 2)), np.stack([np.eye(4)] * 2)
    verts, faces = rng.random((6, 3), np.float32), [[0, 1, 2], [3, 4, 5]]
    large = Mesh(verts, faces, uvs=uvs, material=material, instances=placements, scalars={"s": np.arange(6.0)})
    around = Environment(rng.random((2, 4, 3), np.float32), 30.0)
    lights = (PointLight((1, 2, 3)), DirectionalLight((0, -1, 0)))
    scenes = Scene(small, camera, lights[0], name="small"), Scene((large, large), camera, lights, environment=around)
    found = []
    for scene in scenes:
        made = encoded(scene, "a.json")
        arrays = b"".join(made.binary())
        found.append(Sample({"a.json": made.text, **({made.file: arrays} if arrays else {})}))
    return found
