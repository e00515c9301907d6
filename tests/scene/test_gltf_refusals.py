"""Broken and hostile glTF files: refused in one line that names the field."""

import json
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, PLACES, REMOVED, TIMES, UP, Gltf, bar, changed, pack_glb, triangle
from scene_files import refusal, write

from clshade import load

# Documents that are sound before they are changed


def placed() -> Gltf:
    """Return a triangle at a node, with a camera and a light."""
    document = triangle()
    document.add("nodes", {"children": [1]})
    document.add("nodes", {"mesh": 0})
    document.add("nodes", {"camera": 0})
    document.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0}})
    document.add("nodes", {"extensions": {"KHR_lights_punctual": {"light": 0}}})
    document.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "spot"}]}}
    return document


def animated() -> Gltf:
    document = placed()
    document.animation((0, "translation", TIMES, PLACES, "LINEAR"))
    return document


def morphed() -> Gltf:
    document = triangle(targets=[{}])
    document.json["meshes"][0]["primitives"][0]["targets"][0]["POSITION"] = document.accessor(UP)
    document.json["meshes"][0]["weights"] = [1]
    document.add("nodes", {"mesh": 0})
    return document


def textured() -> Gltf:
    document = Gltf()
    document.texture(np.zeros((3, 2, 3), np.uint8))
    document.add("materials", {"normalTexture": {"index": 0}, "pbrMetallicRoughness": {}})
    attributes = {"POSITION": CORNERS, "NORMAL": UP, "TEXCOORD_0": CORNERS[:, :2].copy()}
    document.mesh(attributes, INDICES, material=0)
    return document


P = "meshes.0.primitives.0"
A = f"{P}.attributes"
SKIN, INVERSE, IN_INVERSE = "skins.0", "skins.0.inverseBindMatrices", "skins[0].inverseBindMatrices: expected"
LENS, FLAT = "cameras.0", {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 0}}
LIGHT, SPOT = "extensions.KHR_lights_punctual.lights.0", "extensions.KHR_lights_punctual.lights.0.spot"
SAMPLER, CHANNEL = "animations.0.samplers.0", "animations.0.channels.0"
OUTPUT, PATH = f"{SAMPLER}.output", f"{CHANNEL}.target.path"
BAD = np.zeros((2, 16), np.float32)
HUGE = np.full((3, 3), 3e38, np.float32)
WEIGHT = np.full((6, 4), 0.25, np.float32)
NOT_FINITE_POSE = "primitives[0].attributes: expected finite positions and directions"
NOT_FINITE = np.float32([[1, 0, 0, 1], [np.nan, 0, 0, 1], [1, 0, 0, 1]])
FINITE = "a finite number of at least 0"
IN_JOINTS = "attributes.JOINTS_0: expected 6 of 4 whole numbers, found"
IN_WEIGHTS = "attributes.WEIGHTS_0: expected 6 of 4 float32 or normalized"
IN_INPUT, IN_OUTPUT = "samplers[0].input: expected", "samplers[0].output: expected"
IN_TARGET, IN_WORLD = "channels[0].target", "nodes[1].matrix: expected a finite placement in the world"
CYCLE, LARGE = {"scenes.0.nodes": [3], "nodes.0.children": [], "nodes.2.children": [1]}, {"scale": [1e200] * 3}

# A document, its changes, parts of the message
BROKEN: dict[Callable[[], Gltf], list[tuple[Any, ...]]] = {
    triangle: [
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
        ({"bufferViews.0.byteLength": 35}, "accessors[0].count: expected rows of 12 bytes that fit into the 35 bytes"),
        ({"accessors.0.byteOffset": 1}, "accessors[0].count: "),
        ({"accessors.1.byteOffset": 2}, "accessors[1].count: "),
        ({"bufferViews.0.byteStride": 13}, "accessors[0].count: "),
        ({"bufferViews.1.byteLength": 7}, "bufferViews[1].byteLength: "),
        ({"buffers.0.byteLength": 45}, "buffers[0].byteLength: expected at most the 44 bytes"),
        ({"buffers.0.byteLength": 41}, "bufferViews[1].byteLength: "),
        ({"asset.version": "1.0"}, "asset.version: "),
        ({"extensionsRequired": ["KHR_x"]}, "extensionsRequired: ", "'KHR_x'"),
        ({f"{A}.POSITION": "x"}, "meshes[0].primitives[0].attributes.POSITION: "),
        ({f"{A}.POSITION": NOT_FINITE[:, :3].copy()}, "POSITION: expected finite numbers", "in row 1"),
        ({f"{A}.NORMAL": CORNERS[:2]}, "attributes.NORMAL: "),
        ({f"{P}.indices": np.uint16([0, 1, 3])}, "indices: expected indices below 3, found 3 at place 2"),
        ({f"{P}.indices": np.uint16([0, 1])}, "indices: expected a multiple of 3"),
        ({f"{P}.mode": 7}, "meshes[0].primitives[0].mode: "),
        ({f"{P}.material": 0}, "material: expected an index of the 0 materials"),
        ({P: []}, "meshes[0].primitives[0]: expected an object"),
        ({"nodes": [{"mesh": 0, "children": [0]}], "scenes": [{"nodes": [0]}]}, "nodes[0]: expected a tree"),
        ({"nodes": [{"children": [1], **LARGE}, {"mesh": 0, **LARGE}]}, f"{IN_WORLD}, found an overflow"),
    ],
    placed: [
        ({"nodes.1.mesh": 7}, "nodes[1].mesh: "),
        ({"nodes.0.matrix": [0] * 15}, "nodes[0].matrix: "),
        ({"nodes.0.matrix": [0] * 16}, "nodes[0].matrix: "),
        ({"nodes.0.rotation": [0, 0, 0, 0]}, "nodes[0].rotation: "),
        ({"nodes.0.scale": [1e300, 1e300, True]}, "nodes[0].scale: "),
        ({"scene": 3, "scenes": [{}]}, "scene: "),
        ({f"{LENS}.perspective.yfov": "wide"}, "cameras[0].perspective.yfov: expected a finite number, found"),
        ({f"{LENS}.perspective.yfov": 0.0}, "cameras[0].perspective.yfov: "),
        ({f"{LENS}.perspective.yfov": np.pi}, "cameras[0].perspective.yfov: "),
        ({f"{LENS}.perspective": {"aspectRatio": 1.0}}, "cameras[0].perspective.yfov: "),
        ({f"{LENS}.perspective": REMOVED}, "cameras[0].type: "),
        ({LENS: FLAT}, "ymag: expected a number other than 0"),
        ({f"{LIGHT}.range": 0}, "range: expected a number above 0, found 0"),
        ({f"{LIGHT}.range": -1}, "range: expected a number above 0, found -1"),
        ({f"{LIGHT}.range": "far"}, "range: expected a finite number"),
        ({f"{LIGHT}.intensity": -1}, f"intensity: expected {FINITE}"),
        ({SPOT: {"outerConeAngle": 2}}, "spot.outerConeAngle: expected radians from 0 to pi/2, found 2"),
        ({SPOT: {"innerConeAngle": -1}}, f"spot.innerConeAngle: expected {FINITE}"),
        ({SPOT: {"innerConeAngle": 1, "outerConeAngle": 0.5}}, "expected at most outerConeAngle, 0.5, found 1"),
    ],
    textured: [
        ({"materials.0.pbrMetallicRoughness.roughnessFactor": -1}, f"roughnessFactor: expected {FINITE}, found -1"),
        ({"materials.0.alphaMode": "SHINE"}, "materials[0].alphaMode: expected one of OPAQUE, MASK, BLEND"),
        ({f"{A}.TANGENT": NOT_FINITE}, "TANGENT: expected finite numbers"),
        ({f"{A}.TANGENT": CORNERS}, "TANGENT: expected 3 of 4 numbers"),
        ({"materials.0.normalTexture.scale": "x"}, "normalTexture.scale"),
        ({"materials.0.normalTexture.index": 4}, "normalTexture.index: expected an index of the 1 textures"),
        ({"materials.0.occlusionTexture": {}}, "occlusionTexture.index: expected an index"),
        ({"materials.0.occlusionTexture": {"index": 0, "strength": -1}}, "occlusionTexture.strength"),
        ({"materials.0.emissiveFactor": [1, 1]}, "emissiveFactor"),
        ({"materials.0.extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": -1}}}, "emissiveStrength"),
    ],
    bar: [
        ({f"{A}.JOINTS_0": np.uint8([[2] * 4] * 6)}, "JOINTS: expected indices below 2, found [2, 0, 0, 0] in row 0"),
        ({f"{A}.JOINTS_0": np.zeros((5, 4), np.uint8)}, f"{IN_JOINTS} 5 of 4"),
        ({f"{A}.JOINTS_0": WEIGHT}, f"{IN_JOINTS} 6 of 4 float32"),
        ({f"{A}.WEIGHTS_0": WEIGHT[:, :3].copy()}, IN_WEIGHTS),
        ({f"{A}.WEIGHTS_0": np.zeros((6, 4), np.uint8)}, IN_WEIGHTS),
        ({f"{A}.WEIGHTS_0": np.float32(np.where(np.eye(6, 4), np.nan, 0.25))}, "WEIGHTS: expected finite numbers of"),
        ({f"{A}.WEIGHTS_0": -WEIGHT}, "attributes.WEIGHTS: expected finite numbers of at least 0", "in row 0"),
        ({f"{A}.WEIGHTS_0": REMOVED}, "attributes.WEIGHTS_0: expected an index, found none"),
        ({f"{SKIN}.joints": []}, "skins[0].joints: expected a skeleton of one node or more, found none"),
        ({f"{SKIN}.joints": REMOVED}, "skins[0].joints: expected a skeleton"),
        ({f"{SKIN}.joints": [1, 9]}, "skins[0].joints: expected indices of the 4 nodes, found 9"),
        ({f"{SKIN}.skeleton": 9}, "skins[0].skeleton: expected an index of the 4 nodes, found 9"),
        ({INVERSE: BAD[:1]}, f"{IN_INVERSE} 2 matrices of 16 float32, found 1 of"),
        ({INVERSE: CORNERS}, f"{IN_INVERSE} 2 matrices of 16 float32, found 3 of"),
        ({INVERSE: BAD}, f"{IN_INVERSE} finite matrices", "in row 0"),
        ({INVERSE: BAD + np.float32(np.nan)}, f"{IN_INVERSE} finite matrices"),
        ({"nodes.3.skin": 3}, "nodes[3].skin: expected an index of the 1 skins"),
        (CYCLE, "nodes[1]: expected a tree of nodes, found a cycle"),
    ],
    morphed: [
        ({"meshes.0.weights": [1, 2]}, "meshes[0].weights: expected 1 finite numbers"),
        ({"nodes.0.weights": []}, "nodes[0].weights: expected 1 finite numbers"),
        ({"nodes.0.weights": ["x"]}, "nodes[0].weights: expected 1 finite numbers"),
        (
            {"meshes.0.primitives": [{"attributes": {"POSITION": 0}, "targets": [{}] * count} for count in (1, 0)]},
            "meshes[0].primitives[1].targets: expected 1, as many as the mesh's first primitive has, found 0",
        ),
        ({f"{P}.targets": [3]}, "targets[0]: expected an object"),
        ({f"{P}.targets.0.POSITION": UP[:2]}, "targets[0].POSITION: expected 3 of 3 numbers, found 2 of 3"),
        ({f"{P}.targets.0.POSITION": NOT_FINITE}, "targets[0].POSITION: expected 3 of 3 numbers, found 3 of 4"),
        ({f"{P}.targets.0.POSITION": HUGE * np.inf}, "targets[0].POSITION: expected finite numbers"),
        ({f"{P}.targets.0.POSITION": HUGE, "nodes.0.weights": [1e30]}, NOT_FINITE_POSE),
        ({f"{A}.NORMAL": UP, f"{P}.targets.0.NORMAL": HUGE, "nodes.0.weights": [1e30]}, NOT_FINITE_POSE),
    ],
    animated: [
        ({f"{SAMPLER}.input": np.float32([0, np.nan, 1])}, f"{IN_INPUT} finite times from 0 on, found nan in row 1"),
        ({f"{SAMPLER}.input": np.float32([0, 1, np.inf])}, f"{IN_INPUT} finite times from 0 on, found inf in row 2"),
        ({f"{SAMPLER}.input": np.float32([-1, 0, 1])}, f"{IN_INPUT} finite times from 0 on, found -1.0 in row 0"),
        ({f"{SAMPLER}.input": np.float32([0, 2, 1])}, f"{IN_INPUT} times that increase, found 1 after 2 in row 2"),
        ({f"{SAMPLER}.input": np.float32([0, 1, 1])}, f"{IN_INPUT} times that increase, found 1 after 1 in row 2"),
        ({f"{SAMPLER}.input": np.uint16([0, 1, 2])}, f"{IN_INPUT} float32 of type SCALAR"),
        ({f"{SAMPLER}.input": PLACES}, f"{IN_INPUT} float32 of type SCALAR"),
        ({f"{SAMPLER}.input": REMOVED}, f"{IN_INPUT} an index, found none"),
        ({OUTPUT: REMOVED}, f"{IN_OUTPUT} an index, found none"),
        ({OUTPUT: 99}, f"{IN_OUTPUT} an index of the 4 accessors, found 99"),
        ({OUTPUT: PLACES[:2]}, f"{IN_OUTPUT} 3 rows of 3 for 3 times, ", "found 2 of 3"),
        ({OUTPUT: NOT_FINITE}, f"{IN_OUTPUT} 3 rows of 3 for 3 times, ", "found 3 of 4 float32"),
        ({OUTPUT: NOT_FINITE[:, :3].copy()}, f"{IN_OUTPUT} finite numbers", "in row 1"),
        ({OUTPUT: PLACES.astype(np.int16)}, "float32 or normalized integers, found 3 of 3 int16"),
        ({f"{SAMPLER}.interpolation": "CUBICSPLINE"}, f"{IN_OUTPUT} 9 rows of 3 for 3 times, ", "found 3 of 3"),
        ({f"{SAMPLER}.interpolation": "CUBIC"}, "expected one of LINEAR, STEP, CUBICSPLINE, found 'CUBIC'"),
        ({OUTPUT: np.zeros((3, 4), np.float32), PATH: "rotation"}, f"{IN_OUTPUT} quaternions other than 0", "row 0"),
        ({f"{CHANNEL}.sampler": 1}, "channels[0].sampler: expected an index of the 1 samplers, found 1"),
        ({f"{CHANNEL}.sampler": REMOVED}, "channels[0].sampler: expected a whole number of at least 0"),
        ({f"{CHANNEL}.target": REMOVED}, f"{IN_TARGET}: expected an object, found none"),
        ({PATH: REMOVED}, f"{IN_TARGET}.path: expected one of translation"),
        ({PATH: "color"}, f"{IN_TARGET}.path: expected one of translation, rotation", "'color'"),
        ({PATH: "weights"}, f"{IN_TARGET}.node: expected a node whose mesh has morph targets"),
        ({f"{CHANNEL}.target.node": 4}, f"{IN_TARGET}.node: expected an index of the 4 nodes, found 4"),
        ({"nodes.0.matrix": np.eye(4).ravel().tolist()}, f"{IN_TARGET}.node: expected a node without a matrix"),
        (
            {"animations.0.channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}] * 2},
            "channels[1].target.path: expected one channel for each property",
        ),
        ({"animations.0.name": 5}, "animations[0].name: expected text, found 5"),
        ({"animations.0": 3}, "animations[0]: expected an object, found 3"),
        ({"animations": {"name": "Run"}}, "animations: expected a list"),
        ({OUTPUT: HUGE, PATH: "scale", "nodes.1.scale": [1e300] * 3}, IN_WORLD),
    ],
}


ROWS = [(make, *row) for make, rows in BROKEN.items() for row in rows]


@pytest.mark.parametrize("row", ROWS, ids=[f"{row[0].__name__} {' '.join(row[1])}" for row in ROWS])
def test_broken_fields(tmp_path, row):
    """Broken animations are refused where they are asked for, and only there."""
    make, changes, *words = row
    path = changed(make(), changes, tmp_path / "a.glb")
    if make is not animated:
        refusal(path, "a.glb: ", *words)
        return
    assert load(path).face_count == 1
    for options in ({"time": 0.5}, {"animation": 0}, {"animation": "all"}):
        refusal(path, "a.glb: ", *words, **options)


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


def sparse(rows: list[int], count: int) -> Gltf:
    """Return a triangle with an accessor of four rows, all 0 except `count` of some rows."""
    document = Gltf()
    accessor = document.sparse(np.uint8(rows), np.ones((len(rows), 3), np.float32), 4)
    document.json["accessors"][accessor]["sparse"]["count"] = count
    document.mesh({"POSITION": accessor}, INDICES)
    return document


def test_sparse_rows_up_to_the_last(tmp_path):
    assert (load(sparse([0, 1, 2, 3], 4).glb(tmp_path / "a.glb")).meshes[0].verts == 1.0).all()
    for rows, count, words in (
        ([4], 1, ("indices: expected indices below 4", "4")),
        ([0, 255], 2, ("indices: expected indices below 4", "255")),
        ([0, 1, 2, 3, 3], 5, ("count: expected at most 4, found 5",)),
        ([1], 2, ("indices.count: ",)),
    ):
        refusal(sparse(rows, count).glb(tmp_path / "a.glb"), "accessors[0].sparse.", *words)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("mode", [4, 5, 6])
def test_the_largest_index_of_a_type_is_refused(tmp_path, kind, mode):
    """glTF forbids it even if there are so many vertices, because it restarts a strip on some devices."""
    largest = int(np.iinfo(kind).max)
    verts = np.zeros((largest + 1, 3), np.float32)
    verts[[1, largest - 1, largest], [0, 1, 1]] = 1
    good, bad = Gltf(), Gltf()
    good.mesh({"POSITION": verts}, np.array([0, 1, largest - 1], kind), mode=mode)
    bad.mesh({"POSITION": verts}, np.array([0, 1, largest], kind), mode=mode)
    assert sorted(load(good.glb(tmp_path / "a.glb")).meshes[0].verts.max(axis=0).tolist()) == [0, 1, 1]
    expected = f"a.glb: meshes[0].primitives[0].indices: expected indices below {largest}, the largest of their type"
    refusal(bad.glb(tmp_path / "a.glb"), expected, f"found {largest} at place 2 of accessors[1]")


# Containers


def nested(depth: int) -> str:
    return "[" * depth + "1" + "]" * depth


def test_broken_containers(tmp_path):
    good = (tmp_path / "good.glb", triangle().glb(tmp_path / "good.glb"))[0].read_bytes()
    for data, part in (
        (b"gltf" + good[4:], "magic: "),
        (good[:4] + struct.pack("<I", 1) + good[8:], "GLB version: "),
        (good[:-1], "GLB length: "),
        (good[:8] + struct.pack("<I", 19) + good[12:], "GLB length: "),
        (good[:8] + struct.pack("<I", 20) + good[12:], "GLB chunk 0"),
        (good[:16], "GLB header: "),
        (good[:12] + struct.pack("<I", 1 << 31) + good[16:], "GLB chunk 0 length: "),
        (good[:16] + b"BIN\0" + good[20:], "GLB chunk 0 type: "),
        (pack_glb(b"{", None), "JSON: "),
        (pack_glb(b"[]", None), "JSON: expected an object"),
        (pack_glb(b"\xff\xfe", None), "JSON: expected UTF-8"),
        (pack_glb(b"\0{}", None), "JSON: "),
        (pack_glb(b"[" * 100000, None), "JSON: "),
        (pack_glb(b"[" + b"{}," * 3000000 + b"{}]", None), "JSON: expected at most"),
    ):
        (tmp_path / "a.glb").write_bytes(data)
        refusal(tmp_path / "a.glb", "a.glb: ", part)
    for text, part in (
        ("", "meshes: expected at least one triangle"),
        (', "extras": ' + nested(100_000), "too deep a nesting"),
        (', "scene": ' + "1" * 1_000_000, "a whole number of 1000000 digits"),
        (', "asset": {"version": "2.0"}', "the key asset twice"),
        (', "scene": NaN', "a number that is NaN"),
        (', "meshes": [' + nested(900) + "]", "meshes[0]: expected an object"),
        (', "scene": ' + nested(900), "expected"),
    ):
        refusal(write(tmp_path / "a.gltf", '{"asset": {"version": "2.0"}' + text + "}"), "a.gltf: ", part)


@pytest.mark.parametrize("padding", [b"", b"\0", b"\0\0\0", b" \0", b"\n"])
@pytest.mark.parametrize("padded", [False, True])
@pytest.mark.parametrize("between", [b"", struct.pack("<I4s", 4, b"XTRA") + b"1234"])
def test_chunks_of_any_padding_and_with_others_between_and_behind_them(tmp_path, padding, padded, between):
    """Lengths may leave out the padding; unknown chunks are an extension's."""
    document = triangle()
    document.glb(tmp_path / "a.glb")
    text = json.dumps(document.json).encode() + padding
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += b" " * (-len(text) % 4 if padded or between else 0) + between
    body += struct.pack("<I4s", len(document.data), b"BIN\0") + document.data
    body += struct.pack("<I4s", 1 << 30, b"MORE") if between else b""
    (tmp_path / "a.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    assert load(tmp_path / "a.glb").meshes[0].verts.tolist() == CORNERS.tolist()


# Extensions

COMPRESSED = "extensions: expected geometry that needs no extension (export it without compression), found "


@pytest.mark.filterwarnings("error", "ignore:.*EXT_any_other")
@pytest.mark.parametrize(("name", "required"), [("KHR_draco_mesh_compression", True), ("EXT_any_other", False)])
def test_geometry_in_an_extension_of_a_primitive(tmp_path, name, required):
    document = triangle(extensions={name: {"bufferView": 0, "attributes": {"POSITION": 0}}})
    document.json["extensionsUsed"] = [name]
    if required:
        document.json["extensionsRequired"] = [name]
    assert load(document.glb(tmp_path / "a.glb")).meshes[0].verts.tolist() == CORNERS.tolist()  # stored beside it
    for accessor in (1, 0):
        del document.json["accessors"][accessor]["bufferView"]
        refusal(document.glb(tmp_path / "a.glb"), f"meshes[0].primitives[0].{COMPRESSED}'{name}'")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_compressed_buffer_views(tmp_path, name):
    document = triangle()
    document.gltf(tmp_path / "a.gltf", "fallback.bin")
    for view in document.json["bufferViews"]:
        view["extensions"] = {name: {"buffer": 0, "mode": "ATTRIBUTES"}}
    document.json["extensionsUsed"] = [name]
    (tmp_path / "a.gltf").write_text(json.dumps(document.json))
    assert load(tmp_path / "a.gltf").meshes[0].verts.tolist() == CORNERS.tolist()
    (tmp_path / "fallback.bin").unlink()
    refusal(tmp_path / "a.gltf", f"bufferViews[0].{COMPRESSED}'{name}'")
    document.json["buffers"][0] = {"byteLength": 44, "extensions": {name: {"fallback": True}}}
    (tmp_path / "a.gltf").write_text(json.dumps(document.json))
    refusal(tmp_path / "a.gltf", f"bufferViews[0].{COMPRESSED}'{name}'")


def test_required_extensions_of_textures_cost_no_picture(tmp_path):
    names = ["KHR_texture_basisu"]
    changes = {"textures.0": {"extensions": {"KHR_texture_basisu": {"source": 0}}}}
    changes |= {"extensionsUsed": names, "extensionsRequired": names}
    with pytest.warns(UserWarning, match="not rendered: KHR_texture_basisu"):
        scene = load(changed(textured(), changes, tmp_path / "a.glb"))
    assert scene.meshes[0].material.pbr.normal_texture is None


def test_a_file_without_triangles_names_what_else_it_holds(tmp_path):
    changes = {f"{P}.mode": 0, "extensionsUsed": ["KHR_gaussian_splatting"]}
    ending = "found none besides KHR_gaussian_splatting, points and lines"
    path = changed(triangle(), changes, tmp_path / "a.glb")
    refusal(path, f"meshes: expected at least one triangle in the scene, {ending}")


def test_too_many_triangles_are_refused_before_they_are_made(tmp_path):
    document = triangle()
    document.json["meshes"][0]["primitives"] *= 600
    for _ in range(600):
        document.add("nodes", {"mesh": 0})
    refusal(document.glb(tmp_path / "a.glb"), "at most", "placements")
