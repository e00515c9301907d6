"""Broken and hostile glTF files: refused in one line that names the field."""

from __future__ import annotations

import json
import struct
import warnings

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, Gltf, pack_glb, triangle
from scene_files import refusal

from clshade import load


@pytest.mark.parametrize(
    "uri",
    ["/etc/passwd", "../a.bin", "%2e%2e/a.bin", "http://localhost/a.bin", "file:///dev/zero", "C:\\a", "/dev/zero"],
)
def test_references_out_of_the_folder(tmp_path, uri):
    (tmp_path / "a.bin").write_bytes(bytes(100))
    (tmp_path / "scene").mkdir()
    document = triangle()
    path = document.gltf(tmp_path / "scene" / "a.gltf", "own.bin")
    document.json["buffers"][0]["uri"] = uri
    (tmp_path / "scene" / "a.gltf").write_text(json.dumps(document.json))
    nothing = ("(nothing is fetched)",) if ":/" in uri else ()
    refusal(path, "buffers[0].uri: ", "scene's folder", *nothing)


BROKEN = [
    ({"accessors": 5}, "accessors: expected a list"),
    ({"accessors.0.count": 4}, "accessors[0].count: "),
    ({"accessors.0.count": 1 << 40}, "accessors[0].count: "),
    ({"accessors.0.count": -1}, "accessors[0].count: "),
    ({"accessors.0.count": 2.5}, "accessors[0].count: "),
    ({"accessors.0.bufferView": 9}, "accessors[0].bufferView: expected an index of the 2 bufferViews, found 9"),
    ({"accessors.0.componentType": 5124}, "accessors[0].componentType: "),
    ({"accessors.0.type": "VEC9"}, "accessors[0].type: "),
    ({"accessors.0.type": "VEC2"}, "attributes.POSITION: "),
    ({"accessors.0.byteOffset": -4}, "accessors[0].byteOffset: "),
    ({"accessors.1.componentType": 5126}, "accessors[1].count: "),
    ({"bufferViews.0.byteLength": 1 << 50}, "bufferViews[0].byteLength: "),
    ({"bufferViews.0.byteOffset": 1 << 50}, "bufferViews[0].byteLength: "),
    ({"bufferViews.0.byteStride": 4}, "accessors[0].bufferView: expected a byteStride of at least 12"),
    ({"bufferViews.0.buffer": 3}, "bufferViews[0].buffer: "),
    # One byte beyond the 36 of the corners, the 42 of the arrays and the 44 of the chunk.
    ({"bufferViews.0.byteLength": 35}, "accessors[0].count: expected rows of 12 bytes that fit into the 35 bytes"),
    ({"accessors.0.byteOffset": 1}, "accessors[0].count: "),
    ({"accessors.1.byteOffset": 2}, "accessors[1].count: "),
    ({"bufferViews.0.byteStride": 13}, "accessors[0].count: "),
    ({"bufferViews.1.byteLength": 7}, "bufferViews[1].byteLength: "),
    ({"buffers.0.byteLength": 45}, "buffers[0].byteLength: expected at most the 44 bytes"),
    ({"buffers.0.byteLength": 41}, "bufferViews[1].byteLength: "),
    ({"buffers.0.byteLength": 4096}, "buffers[0].byteLength: "),
    ({"meshes.0.primitives.0.attributes.POSITION": "x"}, "meshes[0].primitives[0].attributes.POSITION: "),
    ({"meshes.0.primitives.0.mode": 7}, "meshes[0].primitives[0].mode: "),
    ({"meshes.0.primitives.0.material": 0}, "material: expected an index of the 0 materials"),
    ({"meshes.0.primitives.0": []}, "meshes[0].primitives[0]: expected an object"),
    ({"asset.version": "1.0"}, "asset.version: "),
    ({"nodes": [{"mesh": 0, "children": [0]}], "scenes": [{"nodes": [0]}]}, "nodes[0]: expected a tree"),
    ({"nodes": [{"mesh": 7}]}, "nodes[0].mesh: "),
    ({"nodes": [{"mesh": 0, "matrix": [0] * 15}]}, "nodes[0].matrix: "),
    ({"nodes": [{"mesh": 0, "matrix": [0] * 16}]}, "nodes[0].matrix: "),
    ({"nodes": [{"mesh": 0, "rotation": [0, 0, 0, 0]}]}, "nodes[0].rotation: "),
    ({"nodes": [{"mesh": 0, "scale": [1e300, 1e300, True]}]}, "nodes[0].scale: "),
    ({"scene": 3, "scenes": [{}]}, "scene: "),
    (
        {"nodes": [{"children": [1], "scale": [1e200] * 3}, {"mesh": 0, "scale": [1e200] * 3}]},
        "nodes[1].matrix: expected a finite placement in the world, found an overflow",
    ),
    (
        {"materials": [{"pbrMetallicRoughness": {"roughnessFactor": -1}}], "meshes.0.primitives.0.material": 0},
        "roughnessFactor: expected a finite number of at least 0, found -1",
    ),
    (
        {"nodes": [{"mesh": 0}, {"camera": 0}], "cameras": [{"type": "perspective", "perspective": {"yfov": "wide"}}]},
        "cameras[0].perspective.yfov: expected a finite number, found",
    ),
]


@pytest.mark.parametrize(("changes", "part"), BROKEN)
def test_broken_fields(tmp_path, changes, part):
    document = triangle()
    document.glb(tmp_path / "a.glb")
    for place, value in changes.items():
        *keys, last = place.split(".")
        target = document.json
        for key in keys:
            target = target[int(key)] if key.isdigit() else target[key]
        target[int(last) if last.isdigit() else last] = value
    (tmp_path / "a.glb").write_bytes(pack_glb(json.dumps(document.json).encode(), document.data))
    refusal(tmp_path / "a.glb", "a.glb: ", part)


def test_broken_values(tmp_path):
    for bad in (np.nan, np.inf):
        document = Gltf()
        verts = CORNERS.copy()
        verts[1, 2] = bad
        document.mesh({"POSITION": verts}, INDICES)
        refusal(document.glb(tmp_path / "a.glb"), "POSITION: expected finite numbers", "in row 1")
    document = Gltf()
    document.mesh({"POSITION": CORNERS}, np.array([0, 1, 3], np.uint16))
    refusal(document.glb(tmp_path / "a.glb"), "indices: expected indices below 3, found 3 at place 2")
    document = Gltf()
    document.mesh({"POSITION": CORNERS}, np.array([0, 1], np.uint16))
    refusal(document.glb(tmp_path / "a.glb"), "indices: expected a multiple of 3")
    document = Gltf()
    document.mesh({"POSITION": CORNERS, "NORMAL": CORNERS[:2]}, INDICES)
    refusal(document.glb(tmp_path / "a.glb"), "attributes.NORMAL: ")


def sparse(rows: list[int], count: int) -> Gltf:
    """Return a triangle with an accessor of four rows, all 0 except the first `count` of the given rows."""
    document = Gltf()
    parts = {
        "count": count,
        "indices": {"bufferView": document.view(np.array(rows, np.uint8).tobytes()), "componentType": 5121},
        "values": {"bufferView": document.view(np.ones((len(rows), 3), np.float32).tobytes())},
    }
    entry = {"componentType": 5126, "type": "VEC3", "count": 4, "sparse": parts}
    document.mesh({"POSITION": document.add("accessors", entry)}, INDICES)
    return document


def test_sparse_rows_up_to_the_last(tmp_path):
    meshes = load(sparse([0, 1, 2, 3], 4).glb(tmp_path / "a.glb")).meshes
    assert (meshes[0].verts == 1.0).all()
    for rows in ([4], [0, 4], [0, 255]):
        path = sparse(rows, len(rows)).glb(tmp_path / "a.glb")
        refusal(path, "accessors[0].sparse.indices: expected indices below 4", str(rows[-1]))
    refusal(
        sparse([0, 1, 2, 3, 3], 5).glb(tmp_path / "a.glb"), "accessors[0].sparse.count: expected at most 4, found 5"
    )
    refusal(sparse([1], 2).glb(tmp_path / "a.glb"), "accessors[0].sparse.indices.count: ")


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("mode", [4, 5, 6])
def test_the_largest_index_of_a_type_is_refused(tmp_path, kind, mode):
    """glTF forbids it even if there are so many vertices, because it restarts a strip on some devices."""
    largest = int(np.iinfo(kind).max)
    verts = np.zeros((largest + 1, 3), np.float32)
    verts[[1, largest - 1, largest], [0, 1, 1]] = 1
    for last, good in ((largest - 1, True), (largest, False)):
        document = Gltf()
        document.mesh({"POSITION": verts}, np.array([0, 1, last], kind), mode=mode)
        path = document.glb(tmp_path / "a.glb")
        if good:
            assert sorted(load(path).meshes[0].verts.max(axis=0).tolist()) == [0, 1, 1]
        else:
            expected = (
                f"a.glb: meshes[0].primitives[0].indices: expected indices below {largest}, the largest of their type"
            )
            refusal(path, expected, f"found {largest} at place 2 of accessors[1]")


def test_broken_containers(tmp_path):
    good = (tmp_path / "good.glb", triangle().glb(tmp_path / "good.glb"))[0].read_bytes()
    text = b'{"asset":{"version":"2.0"}}'
    for data, part in (
        (b"gltf" + good[4:], "magic: "),
        (good[:4] + struct.pack("<I", 1) + good[8:], "GLB version: "),
        (good[:-1], "GLB length: "),
        (good[:16], "GLB header: "),
        (good[:12] + struct.pack("<I", 1 << 31) + good[16:], "GLB chunk 0 length: "),
        (good[:16] + b"BIN\0" + good[20:], "GLB chunk 0 type: "),
        (pack_glb(b"{", None), "JSON: "),
        (pack_glb(b"[]", None), "JSON: expected an object"),
        (pack_glb(b"\xff\xfe", None), "JSON: expected UTF-8"),
        (pack_glb(b"[" * 100000, None), "JSON: "),
        (pack_glb(b'{"a":NaN}', None), "JSON: "),
        (pack_glb(b'{"a":1' + b"0" * 5000 + b"}", None), "JSON: "),
        (pack_glb(b"[" + b"{}," * 3000000 + b"{}]", None), "JSON: expected at most"),
        (pack_glb(text, None), "meshes: expected at least one triangle"),
    ):
        (tmp_path / "a.glb").write_bytes(data)
        refusal(tmp_path / "a.glb", "a.glb: ", part)


COMPRESSED = "extensions: expected geometry that needs no extension (export it without compression), found "


@pytest.mark.parametrize("required", [False, True])
@pytest.mark.parametrize("name", ["KHR_draco_mesh_compression", "EXT_any_other"])
def test_geometry_in_an_extension_of_a_primitive(tmp_path, name, required):
    document = triangle(extensions={name: {"bufferView": 0, "attributes": {"POSITION": 0}}})
    document.json["extensionsUsed"] = [name]
    if required and "draco" in name:
        document.json["extensionsRequired"] = [name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if "other" in name else "error")
        assert load(document.glb(tmp_path / "a.glb")).meshes[0].verts.tolist() == CORNERS.tolist()  # stored beside it
        del document.json["accessors"][1]["bufferView"]
        refusal(document.glb(tmp_path / "a.glb"), f"meshes[0].primitives[0].{COMPRESSED}'{name}'")
    del document.json["accessors"][0]["bufferView"]
    refusal(document.glb(tmp_path / "a.glb"), f"meshes[0].primitives[0].{COMPRESSED}'{name}'")


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_compressed_buffer_views(tmp_path, name):
    document = triangle()
    document.gltf(tmp_path / "a.gltf", "fallback.bin")
    for view in document.json["bufferViews"]:
        view["extensions"] = {name: {"buffer": 0, "mode": "ATTRIBUTES"}}
    document.json["extensionsUsed"] = [name]
    (tmp_path / "a.gltf").write_text(json.dumps(document.json))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load(tmp_path / "a.gltf").meshes[0].verts.tolist() == CORNERS.tolist()
    (tmp_path / "fallback.bin").unlink()
    refusal(tmp_path / "a.gltf", f"bufferViews[0].{COMPRESSED}'{name}'")
    document.json["buffers"][0] = {"byteLength": 44, "extensions": {name: {"fallback": True}}}
    (tmp_path / "a.gltf").write_text(json.dumps(document.json))
    refusal(tmp_path / "a.gltf", f"bufferViews[0].{COMPRESSED}'{name}'")


def test_a_file_without_triangles_names_what_else_it_holds(tmp_path):
    document = Gltf()
    document.mesh({"POSITION": CORNERS}, None, mode=0)
    document.json["extensionsUsed"] = ["KHR_gaussian_splatting"]
    ending = "found none besides KHR_gaussian_splatting, points and lines"
    refusal(document.glb(tmp_path / "a.glb"), f"meshes: expected at least one triangle in the scene, {ending}")


def test_required_extensions_of_textures_cost_no_picture(tmp_path):
    document = triangle(material=0)
    document.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    document.add("textures", {"extensions": {"KHR_texture_basisu": {"source": 0}}})
    document.json["extensionsUsed"] = document.json["extensionsRequired"] = ["KHR_texture_basisu"]
    with pytest.warns(UserWarning, match="not rendered: KHR_texture_basisu"):
        assert load(document.glb(tmp_path / "a.glb")).meshes[0].material.texture is None


@pytest.mark.parametrize("padding", [b"\0", b"\0\0\0", b" \0", b"\n"])
def test_padding_of_json(tmp_path, padding):
    document = triangle()
    document.glb(tmp_path / "a.glb")
    text = json.dumps(document.json).encode()
    (tmp_path / "a.glb").write_bytes(pack_glb(text + padding, document.data))
    assert load(tmp_path / "a.glb").face_count == 1
    (tmp_path / "a.glb").write_bytes(pack_glb(b"\0" + text + padding, document.data))
    refusal(tmp_path / "a.glb", "JSON: ")


@pytest.mark.parametrize("padded", [False, True])
@pytest.mark.parametrize("between", [b"", struct.pack("<I4s", 4, b"XTRA") + b"1234"])
def test_chunks_whose_length_leaves_out_the_padding_or_with_others_between(tmp_path, padded, between):
    document = triangle()
    document.glb(tmp_path / "a.glb")
    text = json.dumps(document.json).encode()
    text += b" " * (1 - len(text) % 4)  # not a multiple of 4
    body = (
        struct.pack("<I4s", len(text), b"JSON") + text + b" " * (-len(text) % 4 if padded or between else 0) + between
    )
    body += struct.pack("<I4s", len(document.data), b"BIN\0") + document.data
    (tmp_path / "a.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    assert load(tmp_path / "a.glb").meshes[0].verts.tolist() == CORNERS.tolist()


def test_too_many_triangles_are_refused_before_they_are_made(tmp_path):
    document = triangle()
    primitive = document.json["meshes"][0]["primitives"][0]
    document.json["meshes"][0]["primitives"] = [primitive] * 600
    for _ in range(600):
        document.add("nodes", {"mesh": 0})
    refusal(document.glb(tmp_path / "a.glb"), "at most", "placements")
