"""Small valid files of every format that clshade reads, for the fuzzer to damage."""

import base64
import io
import json
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import tifffile
from mesh_writers import Gltf, bar, pack_glb, ply, properties, stl, stl_text
from PIL import Image
from scene_files import course_dict, png16, transposed

from clshade.images import exr
from clshade.scene.camera import Camera
from clshade.scene.environment import Environment
from clshade.scene.formats.scene_json import _encoded
from clshade.scene.lights import DirectionalLight, PointLight
from clshade.scene.model import Material, Mesh, MetallicRoughness, Scene, Texture

IMAGES = (".exr", ".hdr")


@dataclass(frozen=True)
class Sample:
    """Files by name; the first is loaded, or is an environment (of IMAGES). texture: name of the file of that option."""

    files: dict[str, bytes]
    texture: str = ""
    options: dict[str, Any] = field(default_factory=dict)


@cache
def samples() -> tuple[Sample, ...]:
    """Return all samples. Each loads without error."""
    return (*_course(), *_obj(), *_ply(), *_stl(), *_gltf(), *_exr(), *_hdr(), *_saved())


def _image(mode: str, kind: str = "PNG") -> bytes:
    pixels = np.random.default_rng(len(mode)).integers(0, 256, (5, 7, 4), np.uint8)
    image = Image.fromarray(pixels, "RGBA").convert("RGB").convert(mode) if mode != "RGBA" else Image.fromarray(pixels)
    buffer = io.BytesIO()
    image.save(buffer, kind)
    return buffer.getvalue()


def _pnm(magic: str) -> bytes:
    """Return a PNM in RGB with values up to 1023, as text or binary."""
    values = (np.arange(4 * 5 * 3) * 17).astype(">u2")
    body = " ".join(map(str, values.tolist())).encode() if magic == "P3" else values.tobytes()
    return f"{magic} # a comment\n5 4\n1023\n".encode() + body


def _course() -> list[Sample]:
    files = []
    for content in (course_dict(), transposed(course_dict())):
        buffer = io.BytesIO()
        np.save(buffer, np.array(content, dtype=object), allow_pickle=True)
        files.append(buffer.getvalue())
    deep, strips = np.arange(4 * 5 * 3, dtype=np.uint16).reshape(4, 5, 3) * np.uint16(1000), io.BytesIO()
    tifffile.imwrite(strips, deep, photometric="rgb", rowsperstrip=2, metadata=None)
    pictures = {"b.png": _image("RGB"), "c.png": png16(deep), "b.tif": strips.getvalue()}
    pictures |= {"a.ppm": _pnm("P3"), "b.ppm": _pnm("P6")}
    textured = (Sample({"a.npy": files[0], name: data}, name) for name, data in pictures.items())
    return [*(Sample({"a.npy": data}) for data in files), *textured]


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


_VERTICES = "element vertex 4\n" + properties("float", "x y z") + properties("double", "nx ny nz")
_VERTICES += properties("uchar", "red green blue")
_FACES = """element face 2
property list uchar int vertex_indices
property list uchar float texcoord
element edge 1
property int vertex1
property short vertex2
"""


def _ply() -> list[Sample]:
    points = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, -0.25))
    faces = (((0, 1, 2), (0, 0, 1, 0, 0.5, 1)), ((1, 3, 2, 0), (0, 0, 1, 0, 1, 1, 0, 1)))
    corners: list[Any] = [("3f3d3B", [*point, 0, 0, 1, 40 * k, 128, 255]) for k, point in enumerate(points)]
    rows = [*corners, *((f"B{len(f)}iB{len(t)}f", [len(f), *f, len(t), *t]) for f, t in faces), ("ih", [0, 1])]
    head = "comment TextureFile b.png\n" + _VERTICES + _FACES
    strips = ply("ascii", _VERTICES + "element tristrips 1\nproperty list int int vertex_indices\n", corners)
    forms = ("ascii", "binary_little_endian", "binary_big_endian")
    seeds = [Sample({"a.ply": ply(form, head, rows), "b.png": _image("LA")}) for form in forms]
    return [*seeds, Sample({"a.ply": strips + b"6 0 1 2 -1 1 2\n"}, options={"flat": True})]


def _stl() -> list[Sample]:
    facets = np.random.default_rng(3).normal(size=(5, 3, 3)).astype(np.float32)
    return [Sample({"a.stl": stl(facets)}), Sample({"a.stl": stl_text(facets).encode()})]


def _exr() -> list[Sample]:
    rng, files = np.random.default_rng(5), []
    for compression in ("none", "zip", "dwaa", "zstd"):
        buffer = io.BytesIO()
        layers = {"RGBA": rng.random((9, 7, 4)), "Z": rng.random((9, 7)), "id": rng.integers(0, 9, (9, 7))}
        exr.encode(buffer, layers, compression=compression, window=(1, 0, 6, 7))
        files.append(buffer.getvalue())
    return [Sample({"a.exr": data}) for data in files]


def _hdr() -> list[Sample]:
    codes = np.random.default_rng(6).integers(3, 256, (3, 9, 4), np.uint8)
    codes[:, :4] = codes[:, :1]
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 3 +X 9\n"
    rows = (b"".join(bytes([132, plane[0], 5]) + plane[4:].tobytes() for plane in row.T) for row in codes)
    pixel_by_pixel = codes[0, 0].tobytes() + b"\1\1\1\3" + codes.tobytes()[16:]
    in_rows = b"".join(b"\2\2\0\x09" + row for row in rows)
    return [Sample({"a.hdr": head + pixels}) for pixels in (in_rows, pixel_by_pixel)]


def _document() -> Gltf:
    """Return two meshes of several primitives, with everything that the loader reads of a scene at rest."""
    d, rng = Gltf(), np.random.default_rng(7)
    points = d.accessor(rng.normal(size=(4, 3)).astype(np.float32))
    attributes = {
        "POSITION": points,
        "NORMAL": rng.normal(size=(4, 3)).astype(np.float32),
        "TEXCOORD_0": d.accessor(rng.integers(0, 65536, (4, 2)).astype(np.uint16), normalized=True),
        "COLOR_0": d.accessor(rng.integers(0, 256, (4, 4)).astype(np.uint8), normalized=True),
    }
    d.mesh(attributes, np.array([0, 1, 2, 1, 3, 2], np.uint16), material=0)
    moved = d.accessor(rng.integers(-99, 99, (4, 3)).astype(np.int16))
    d.json["meshes"][0]["primitives"].append({"attributes": {"POSITION": moved}, "mode": 6})
    d.mesh({"POSITION": points}, np.array([0, 1, 2, 3], np.uint8), mode=5, material=1)
    places = {"bufferView": d.view(np.array([1, 3], np.uint16).tobytes()), "componentType": 5123}
    values = {"bufferView": d.view(np.zeros((2, 3), np.float32).tobytes())}
    d.json["accessors"][points]["sparse"] = {"count": 2, "indices": places, "values": values}
    transform = {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.5, "scale": [2, 1]}}
    textured = {"baseColorTexture": {"index": 0, "extensions": transform}, "metallicFactor": 0.5}
    light, cone = {"type": "point", "color": [1, 1, 0.5], "intensity": 30, "range": 20}, {"outerConeAngle": 0.5}
    lights = [light, {"type": "directional"}, {"type": "spot", "spot": {"innerConeAngle": 0.2, **cone}}]
    shining = [{"extensions": {"KHR_lights_punctual": {"light": k}}, "translation": [k, 3, 1]} for k in range(3)]
    d.json |= {
        "images": [{"bufferView": d.view(_image("RGBA")), "mimeType": "image/png"}],
        "samplers": [{"wrapS": 33071, "wrapT": 33648, "magFilter": 9729}],
        "textures": [{"source": 0, "sampler": 0}],
        "materials": [
            {"pbrMetallicRoughness": textured, "alphaMode": "MASK", "alphaCutoff": 0.4},
            {"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0.2, 1]}, "doubleSided": True},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1, "aspectRatio": 1.5}}],
        "extensions": {"KHR_lights_punctual": {"lights": lights}},
        "extensionsUsed": ["KHR_lights_punctual", "KHR_texture_transform", "KHR_mesh_quantization"],
        "nodes": [
            {"mesh": 0, "translation": [0, 1, 0], "rotation": [0, 0, 0, 1], "scale": [1, -1, 1], "children": [1]},
            {"mesh": 1, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1]},
            {"camera": 0, "translation": [0, 0, 6]},
            *shining,
        ],
        "scenes": [{"nodes": [0, 2, 3, 4, 5]}],
        "scene": 0,
    }
    return d


def _animated() -> Gltf:
    """Return a skinned mesh with morph targets and an animation with channels of all kinds, at two times."""
    d, rng = bar(), np.random.default_rng(6)
    targets = [{"POSITION": d.accessor(rng.random((6, 3), np.float32))} for _ in range(2)]
    d.json["meshes"][0]["primitives"][0]["targets"] = targets
    d.json["meshes"][0]["weights"] = [0.5, 0]
    times = d.accessor(np.array([0, 1, 3], np.float32))
    d.animation(
        (1, "translation", times, rng.random((3, 3), np.float32), "LINEAR"),
        (2, "rotation", times, rng.random((3, 4), np.float32), "LINEAR"),
        (2, "scale", times, rng.random((3, 3), np.float32), "STEP"),
        (3, "weights", times, rng.random(18, np.float32), "CUBICSPLINE"),
    )
    return d


def _text(d: Gltf, **fields: Any) -> bytes:
    return json.dumps({**d.json, "buffers": [{"byteLength": len(d.data), **fields}]}, indent=1).encode()


def _gltf() -> list[Sample]:
    d, moving = _document(), _animated()
    uri = "data:application/octet-stream;base64," + base64.b64encode(d.data).decode()
    seeds = [Sample({"a.glb": pack_glb(_text(d), d.data)}), Sample({"a.gltf": _text(d, uri=uri)})]
    d.json["images"] = [{"uri": "b.jpg"}]
    apart = {"a.gltf": _text(d, uri="a.bin"), "a.bin": d.data, "b.jpg": _image("RGB", "JPEG")}
    posed = pack_glb(_text(moving), moving.data)
    return [*seeds, Sample(apart), *(Sample({"a.glb": posed}, options={"time": time}) for time in (0.5, 1.5))]


def _saved() -> list[Sample]:
    """Return a scene file with its arrays in the text, and one with a file of arrays."""
    rng, camera = np.random.default_rng(7), Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (0.6, 0.8), (8, 6))
    texture = Texture(rng.random((3, 4, 4), np.float32), wrap="clamp", name="t")
    pbr = MetallicRoughness(0.5, 0.25, normal_texture=Texture(rng.random((2, 2, 3), np.float32)))
    material = Material(texture=texture, pbr=pbr, alpha_cutoff=0.25, name="m")
    uvs, placements, scalars = rng.random((6, 2)), np.stack([np.eye(4)] * 2), {"s": np.arange(6.0)}
    verts, faces = rng.random((6, 3), np.float32), [[0, 1, 2], [3, 4, 5]]
    large = Mesh(verts, faces, uvs=uvs, material=material, instances=placements, scalars=scalars)
    around = Environment(rng.random((2, 4, 3), np.float32), 30.0)
    lights = (PointLight((1, 2, 3)), DirectionalLight((0, -1, 0)))
    small = Scene(Mesh(np.eye(3), [[0, 1, 2]]), camera, lights[0], name="small")
    seeds = []
    for scene in (small, Scene((large, large), camera, lights, environment=around)):
        text, file, parts = _encoded(scene, "a.json")
        seeds.append(Sample({"a.json": text, **({file: b"".join(parts)} if parts else {})}))
    return seeds
