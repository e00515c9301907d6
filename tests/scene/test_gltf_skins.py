"""Skins and morph targets of glTF files against poses in closed form, and broken ones."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, Gltf, bar, png, triangle
from scene_files import refusal

from clshade.scene.formats.gltf_meshes import Influences, deform
from clshade.scene.formats.load import load
from clshade.scene.geometry import bounding_box

FAR = {"translation": [50, 60, 70]}
HALF = math.sqrt(0.5)
NOW = np.array([0], np.float32)


def quietly(path, **options):
    """Load a file, which may not warn."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return load(path, **options)


def world(mesh) -> np.ndarray:
    """Return the vertices of a mesh that is placed once, in the world."""
    (matrix,) = mesh.instances
    return mesh.verts.astype(float) @ matrix[:3, :3].T + matrix[:3, 3]


def bent(document: Gltf, degrees: float = 90.0) -> Gltf:
    """Turn the upper joint of a bar about z, as an animation that has one time."""
    half = math.radians(degrees) / 2
    turned = np.array([[0, 0, math.sin(half), math.cos(half)]], np.float32)
    document.animation((2, "rotation", NOW, turned, "STEP"))
    return document


# Skins


def test_a_skin_at_rest_is_as_it_was_bound(tmp_path):
    path = bent(bar()).glb(tmp_path / "a.glb")
    scene = quietly(path)
    (mesh,) = scene.meshes
    assert mesh.verts.dtype == np.float32
    assert mesh.verts.tolist() == np.float32([[x, y, 0] for y in (0, 1, 2) for x in (-0.1, 0.1)]).tolist()
    assert mesh.normals.tolist() == [[0, 0, 1]] * 6
    assert mesh.instances.tolist() == [np.eye(4).tolist()]  # the transform of its own node does not count
    assert scene.ignored == ()


def test_a_bar_bent_by_90_degrees(tmp_path):
    path = bent(bar()).glb(tmp_path / "a.glb")
    (mesh,) = quietly(path, time=0).meshes
    # The upper end turns about (0, 1, 0); the middle is the mean of where both joints put it.
    expected = [[-0.1, 0, 0], [0.1, 0, 0], [-0.05, 0.95, 0], [0.05, 1.05, 0], [-1, 0.9, 0], [-1, 1.1, 0]]
    np.testing.assert_allclose(mesh.verts, expected, atol=1e-7)
    np.testing.assert_allclose(mesh.normals / np.linalg.norm(mesh.normals, axis=1)[:, None], [[0, 0, 1]] * 6, atol=1e-7)


def test_joints_move_with_the_nodes_above_them_and_may_lie_outside_the_scene(tmp_path):
    document = bar()
    document.json["nodes"][0] = {"children": [1, 3], "translation": [0, 0, 5]}
    (mesh,) = quietly(document.glb(tmp_path / "a.glb")).meshes
    np.testing.assert_allclose(mesh.verts[:, 2], 5.0)
    document.json["nodes"][0]["children"] = [1]
    document.json["scenes"][0]["nodes"] = [3]
    (mesh,) = quietly(document.glb(tmp_path / "a.glb")).meshes
    np.testing.assert_allclose(mesh.verts[:, 2], 5.0)


def test_without_inverse_bind_matrices_they_are_identities(tmp_path):
    (mesh,) = quietly(bar(inverse=False).glb(tmp_path / "a.glb")).meshes
    np.testing.assert_allclose(mesh.verts[:, 1], [0, 0, 1.5, 1.5, 3, 3])  # the upper joint is at y = 1


def test_joints_of_several_sets(tmp_path):
    document = bent(bar())
    attributes = document.json["meshes"][0]["primitives"][0]["attributes"]
    no_joints, halves = np.zeros((6, 4), np.uint16), np.full((6, 4), 0.125, np.float32)
    attributes["JOINTS_0"] = document.accessor(no_joints)
    attributes["WEIGHTS_0"] = document.accessor(halves)
    attributes["JOINTS_1"] = document.accessor(no_joints + np.uint16(1))
    attributes["WEIGHTS_1"] = document.accessor(halves)
    (mesh,) = quietly(document.glb(tmp_path / "a.glb"), time=0).meshes
    # Everything is the mean of both joints: (x, y) and (1 - y, 1 + x).
    expected = [[(x + 1 - y) / 2, (y + 1 + x) / 2, 0] for y in (0, 1, 2) for x in (-0.1, 0.1)]
    np.testing.assert_allclose(mesh.verts, expected, atol=1e-7)


@pytest.mark.parametrize(("dtype", "unit"), [(np.uint8, 255), (np.uint16, 65535)])
def test_normalized_weights(tmp_path, dtype, unit):
    document = bent(bar())
    weights = np.array([[unit, 0, 0, 0]] * 2 + [[unit // 2, unit // 2, 0, 0]] * 2 + [[0, unit, 0, 0]] * 2, dtype)
    attributes = document.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["WEIGHTS_0"] = document.accessor(weights, normalized=True)
    (mesh,) = quietly(document.glb(tmp_path / "a.glb"), time=0).meshes
    np.testing.assert_allclose(mesh.verts[2:4], [[-0.05, 0.95, 0], [0.05, 1.05, 0]], atol=1e-7)


@pytest.mark.parametrize(("share", "warned"), [(0.9, True), (0.985, True), (0.992, False), (1.009, False), (3.0, True)])
def test_weights_are_scaled_to_a_sum_of_1(tmp_path, share, warned):
    document = bent(bar())
    weights = np.array([[1, 0, 0, 0]] * 2 + [[0.5, 0.5, 0, 0]] * 2 + [[0, 1, 0, 0]] * 2, np.float32)
    weights[3] *= share
    attributes = document.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["WEIGHTS_0"] = document.accessor(weights)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        (mesh,) = load(document.glb(tmp_path / "a.glb"), time=0).meshes
    np.testing.assert_allclose(mesh.verts[2:4], [[-0.05, 0.95, 0], [0.05, 1.05, 0]], atol=1e-7)
    line = "a.glb: meshes[0].primitives[0].attributes.WEIGHTS: expected a sum of 1 for each vertex, found"
    assert [line in str(record.message) and "in row 3" in str(record.message) for record in caught] == [True] * warned


def test_a_vertex_without_weights_follows_the_first_joint(tmp_path):
    document = bent(bar())
    attributes = document.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["WEIGHTS_0"] = document.accessor(np.zeros((6, 4), np.float32))
    with pytest.warns(UserWarning, match="found 0 in row 0: scaled"):
        (mesh,) = load(document.glb(tmp_path / "a.glb"), time=0).meshes
    assert mesh.verts[:, 1].tolist() == [0, 0, 1, 1, 2, 2]


def test_a_joint_without_weight_may_have_any_number(tmp_path):
    document = bar()
    attributes = document.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = document.accessor(np.array([[0, 1, 9, 9]] * 6, np.uint8))
    assert quietly(document.glb(tmp_path / "a.glb")).meshes[0].verts[5].tolist() == np.float32([0.1, 2, 0]).tolist()


def test_normals_and_tangents_of_a_stretched_joint(tmp_path):
    document = bar()
    primitive = document.json["meshes"][0]["primitives"][0]
    slanted = np.array([[0.6, 0.8, 0]] * 6, np.float32)
    primitive["attributes"]["NORMAL"] = document.accessor(slanted)
    along = np.array([[0.8, -0.6, 0, -1]] * 6, np.float32)
    primitive["attributes"]["TANGENT"] = document.accessor(along)
    primitive["attributes"]["TEXCOORD_0"] = document.accessor(np.zeros((6, 2), np.float32))
    primitive["material"] = document.add(
        "materials", {"normalTexture": {"index": document.add("textures", {"source": 0})}}
    )
    document.add("images", {"bufferView": document.view(png(np.zeros((1, 1, 3), np.uint8))), "mimeType": "image/png"})
    document.json["nodes"][1]["scale"] = [2, 1, 1]  # the lower joint, and so the upper one
    (mesh,) = quietly(document.glb(tmp_path / "a.glb")).meshes
    np.testing.assert_allclose(mesh.verts[:, 0], [-0.2, 0.2] * 3, rtol=1e-6)
    normals = mesh.normals / np.linalg.norm(mesh.normals, axis=1)[:, None]
    np.testing.assert_allclose(normals, [[0.3 / math.hypot(0.3, 0.8), 0.8 / math.hypot(0.3, 0.8), 0]] * 6, rtol=1e-6)
    np.testing.assert_allclose(mesh.tangents, [[1.6, -0.6, 0, -1]] * 6, rtol=1e-6)
    assert abs(np.sum(normals * mesh.tangents[:, :3], axis=1)).max() < 1e-6


def test_flat_normals_are_those_of_the_pose(tmp_path):
    document = bent(bar())
    document.json["nodes"][2]["rotation"] = [math.sin(math.pi / 4), 0, 0, math.cos(math.pi / 4)]  # about x
    document.json["meshes"][0]["primitives"][0]["attributes"].pop("NORMAL")
    (mesh,) = quietly(document.glb(tmp_path / "a.glb")).meshes
    corners = mesh.verts[mesh.faces]
    expected = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    expected /= np.linalg.norm(expected, axis=1)[:, None]
    assert np.ptp(expected, axis=0).max() > 0.5
    np.testing.assert_allclose(mesh.normals[mesh.normal_faces][:, 0], expected, atol=1e-6)


def test_a_mirrored_skin_keeps_its_front(tmp_path):
    document = bar()
    document.json["nodes"][0] |= {"scale": [1, 1, -1], "translation": [0, 3, 4]}
    (mesh,) = quietly(document.glb(tmp_path / "a.glb")).meshes
    (matrix,) = mesh.instances
    np.testing.assert_allclose(world(mesh), [[x, y, 4] for y in (3, 4, 5) for x in (-0.1, 0.1)], rtol=1e-6)
    assert np.linalg.det(matrix[:3, :3]) < 0.0  # as for a placement that mirrors: winding is reversed
    inverse_transpose = np.linalg.inv(matrix[:3, :3]).T
    assert (mesh.normals @ inverse_transpose.T).tolist() == [[0, 0, -1]] * 6


def test_blending_against_a_loop_over_vertices():
    rng = np.random.default_rng(3)
    matrices = rng.normal(size=(5, 3, 4))
    matrices[:, :, :3] += 3.0 * np.eye(3)
    count = (1 << 15) + 7  # more than one block
    weights = rng.random((count, 8))
    weights /= weights.sum(axis=1)[:, None]
    influences = Influences(rng.integers(0, 5, (count, 8)), weights)
    attributes = {"POSITION": rng.normal(size=(count, 3)), "NORMAL": rng.normal(size=(count, 3))}
    deformed, placement = deform(attributes, influences, matrices)
    assert (placement == np.eye(4)).all()
    for row in (0, 1, 1000, (1 << 15) - 1, 1 << 15, count - 1):
        blended = sum(w * matrices[j] for w, j in zip(weights[row], influences.joints[row], strict=True))
        moved = blended[:, :3] @ attributes["POSITION"][row] + blended[:, 3]
        np.testing.assert_allclose(deformed["POSITION"][row], moved, rtol=1e-12, atol=1e-12)
        normal = np.linalg.inv(blended[:, :3]).T @ attributes["NORMAL"][row] * np.linalg.det(blended[:, :3])
        np.testing.assert_allclose(deformed["NORMAL"][row], normal / np.linalg.norm(normal), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("scale", [1e-200, 1e-24, 3e-7, 1e20, 1e200])
def test_the_scale_of_a_joint_does_not_count_for_normals(scale):
    turned = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    influences = Influences(np.zeros((3, 1), int), np.ones((3, 1)))
    attributes = {"POSITION": np.zeros((3, 3)), "NORMAL": np.float32([[0.6, 0.8, 0], [0, 0, 5], [0, 0, 0]])}
    normals = deform(attributes, influences, scale * turned[None])[0]["NORMAL"]
    np.testing.assert_allclose(normals, [[-0.8, 0.6, 0], [0, 0, 1], [0, 0, 0]], atol=1e-7)


@pytest.mark.parametrize("scale", [1e-24, 1e20])
def test_a_file_with_a_tiny_or_huge_joint(tmp_path, scale):
    document = bar()
    document.json["nodes"][0]["scale"] = [scale] * 3
    assert quietly(document.glb(tmp_path / "a.glb")).meshes[0].normals.tolist() == [[0, 0, 1]] * 6


def test_a_share_of_a_large_array_is_skinned_too(tmp_path):
    document = bent(bar())
    primitive = document.json["meshes"][0]["primitives"][0]
    for name in ("POSITION", "NORMAL", "JOINTS_0", "WEIGHTS_0"):
        rows = {"POSITION": [1, 2, 0], "NORMAL": [0, 0, 1], "JOINTS_0": [1, 7, 7, 7], "WEIGHTS_0": [1, 0, 0, 0]}[name]
        dtype = np.uint8 if name == "JOINTS_0" else np.float32
        primitive["attributes"][name] = document.accessor(np.array([rows] * 100, dtype))
    primitive["indices"] = document.accessor(np.array([50, 3, 90], np.uint16))
    (mesh,) = quietly(document.glb(tmp_path / "a.glb"), time=0).meshes
    np.testing.assert_allclose(mesh.verts, [[-1, 2, 0]] * 3, atol=1e-6)


def test_two_bars_of_one_mesh_with_skins_of_their_own(tmp_path):
    document = bar()
    document.add("nodes", {"translation": [9, 0, 0]})
    document.add("nodes", {"mesh": 0, "skin": 1})
    document.add("nodes", {"mesh": 0, "translation": [0, 0, 4]})
    document.add("skins", {"joints": [4, 4]})
    document.json["nodes"][0]["children"] += [4, 5, 6]
    with pytest.warns(UserWarning, match="not rendered: joints of meshes without a skin$"):
        meshes = load(document.glb(tmp_path / "a.glb")).meshes
    assert [world(mesh)[0].tolist() for mesh in meshes] == np.float32(
        [[-0.1, 0, 0], [8.9, 0, 0], [-0.1, 0, 4]]
    ).tolist()


def test_a_skin_of_a_mesh_without_joints_is_named(tmp_path):
    document = triangle()
    document.add("nodes", {"mesh": 0, "skin": 0, **FAR})
    document.add("skins", {"joints": [0]})
    with pytest.warns(UserWarning, match="not rendered: skins of meshes without joints$"):
        (mesh,) = load(document.glb(tmp_path / "a.glb")).meshes
    assert mesh.instances[0, :3, 3].tolist() == FAR["translation"]


def attribute(name, values, **fields):
    def change(document):
        accessor = document.accessor(np.asarray(values), **fields)
        document.json["meshes"][0]["primitives"][0]["attributes"][name] = accessor

    return change


def skin(**fields):
    return lambda document: document.json["skins"][0].update(fields)


def inverse(values):
    return lambda document: skin(inverseBindMatrices=document.accessor(values))(document)


def without(name):
    return lambda document: document.json["meshes"][0]["primitives"][0]["attributes"].pop(name)


def cycle(document):
    document.json["scenes"][0]["nodes"] = [3]
    document.json["nodes"][0]["children"] = []
    document.json["nodes"][2]["children"] = [1]


BAD = np.zeros((2, 16), np.float32)
WEIGHT = np.full((6, 4), 0.25, np.float32)
BROKEN = [
    (
        attribute("JOINTS_0", np.full((6, 4), 2, np.uint8)),
        "attributes.JOINTS: expected indices below 2, found [2, 0, 0, 0] in row 0",
    ),
    (
        attribute("JOINTS_0", np.zeros((5, 4), np.uint8)),
        "attributes.JOINTS_0: expected 6 of 4 whole numbers, found 5 of 4",
    ),
    (attribute("JOINTS_0", WEIGHT), "attributes.JOINTS_0: expected 6 of 4 whole numbers, found 6 of 4 float32"),
    (attribute("WEIGHTS_0", WEIGHT[:, :3].copy()), "attributes.WEIGHTS_0: expected 6 of 4 float32 or normalized"),
    (attribute("WEIGHTS_0", np.zeros((6, 4), np.uint8)), "attributes.WEIGHTS_0: expected 6 of 4 float32 or normalized"),
    (
        attribute("WEIGHTS_0", np.where(np.eye(6, 4), np.nan, WEIGHT).astype("f4")),
        "WEIGHTS: expected finite numbers of",
    ),
    (attribute("WEIGHTS_0", -WEIGHT), "attributes.WEIGHTS: expected finite numbers of at least 0", "in row 0"),
    (without("WEIGHTS_0"), "attributes.WEIGHTS_0: expected an index, found none"),
    (skin(joints=[]), "skins[0].joints: expected a skeleton of one node or more, found none"),
    (lambda document: document.json["skins"][0].pop("joints"), "skins[0].joints: expected a skeleton"),
    (skin(joints=[1, 9]), "skins[0].joints: expected indices of the 4 nodes, found 9"),
    (skin(skeleton=9), "skins[0].skeleton: expected an index of the 4 nodes, found 9"),
    (inverse(BAD[:1]), "skins[0].inverseBindMatrices: expected 2 matrices of 16 float32, found 1 of 16"),
    (inverse(CORNERS), "skins[0].inverseBindMatrices: expected 2 matrices of 16 float32, found 3 of 3"),
    (inverse(BAD), "skins[0].inverseBindMatrices: expected finite matrices", "in row 0"),
    (inverse(BAD + np.float32(np.nan)), "skins[0].inverseBindMatrices: expected finite matrices"),
    (lambda document: document.json["nodes"][3].update(skin=3), "nodes[3].skin: expected an index of the 1 skins"),
    (cycle, "nodes[1]: expected a tree of nodes, found a cycle"),
]


@pytest.mark.parametrize(("change", "words"), [(change, words) for change, *words in BROKEN])
def test_broken_skins(tmp_path, change, words):
    document = bar()
    change(document)
    refusal(document.glb(tmp_path / "a.glb"), "a.glb: ", *words)


# Morph targets


def morphed(*targets, **fields) -> Gltf:
    """Return a triangle with morph targets, dicts of arrays."""
    document = Gltf()
    listed = [{name: document.accessor(np.asarray(values)) for name, values in target.items()} for target in targets]
    normals = np.array([[0, 0, 1]] * 3, np.float32)
    document.mesh({"POSITION": CORNERS, "NORMAL": normals}, INDICES, targets=listed, **fields)
    document.add("nodes", {"mesh": 0})
    return document


UP = np.float32([[0, 0, 1]] * 3)
WIDE = np.float32([[0, 0, 0], [2, 0, 0], [0, 0, 0]])


def test_weights_of_morph_targets(tmp_path):
    document = morphed({"POSITION": UP, "NORMAL": UP}, {"POSITION": WIDE})
    path = document.glb(tmp_path / "a.glb")
    assert quietly(path).meshes[0].verts.tolist() == CORNERS.tolist()  # 0 unless the file has others
    document.json["meshes"][0]["weights"] = [0.5, 0.25]
    document.glb(tmp_path / "a.glb")
    (mesh,) = quietly(path).meshes
    assert mesh.verts.tolist() == [[0, 0, 0.5], [1.5, 0, 0.5], [0, 1, 0.5]]
    assert mesh.normals.tolist() == [[0, 0, 1.5]] * 3
    assert quietly(path).ignored == ()
    document.json["nodes"][0]["weights"] = [-1, 2]
    document.glb(tmp_path / "a.glb")
    assert quietly(path).meshes[0].verts.tolist() == [[0, 0, -1], [5, 0, -1], [0, 1, -1]]


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_animated_weights(tmp_path, interpolation):
    document = morphed({"POSITION": UP}, {"POSITION": WIDE})
    keys, slopes = np.float32([[0, 1], [1, -1]]), np.float32([[0.5, 2], [-1, 3]])
    output = keys if interpolation != "CUBICSPLINE" else np.stack([slopes, keys, slopes], axis=1)
    times = np.float32([0, 2])
    document.animation((0, "weights", times, output.ravel(), interpolation))
    (mesh,) = quietly(document.glb(tmp_path / "a.glb"), time=0.5).meshes
    t = 0.25
    first, second = {
        "LINEAR": (1 - t) * keys[0] + t * keys[1],
        "STEP": keys[0],
        "CUBICSPLINE": (2 * t**3 - 3 * t**2 + 1) * keys[0]
        + 2 * (t**3 - 2 * t**2 + t) * slopes[0]
        + (3 * t**2 - 2 * t**3) * keys[1]
        + 2 * (t**3 - t**2) * slopes[1],
    }[interpolation]
    np.testing.assert_allclose(mesh.verts, CORNERS + first * UP + second * WIDE, atol=1e-7)


def test_all_attributes_are_morphed(tmp_path):
    document = morphed(
        {
            "TANGENT": np.float32([[0, 2, 0]] * 3),
            "TEXCOORD_0": np.float32([[0.5, -0.5]] * 3),
            "COLOR_0": np.float32([[0.5, -1, 0.25]] * 3),
        }
    )
    primitive = document.json["meshes"][0]["primitives"][0]
    primitive["attributes"]["TANGENT"] = document.accessor(np.float32([[1, 0, 0, -1]] * 3))
    primitive["attributes"]["TEXCOORD_0"] = document.accessor(CORNERS[:, :2].copy())
    primitive["attributes"]["COLOR_0"] = document.accessor(np.float32([[0.75, 0.25, 0.5]] * 3))
    primitive["material"] = document.add(
        "materials", {"normalTexture": {"index": document.add("textures", {"source": 0})}}
    )
    document.add("images", {"bufferView": document.view(png(np.zeros((1, 1, 3), np.uint8))), "mimeType": "image/png"})
    document.json["meshes"][0]["weights"] = [0.5]
    (mesh,) = quietly(document.glb(tmp_path / "a.glb")).meshes
    assert mesh.tangents.tolist() == [[1, 1, 0, -1]] * 3
    assert mesh.uvs.tolist() == (CORNERS[:, :2] + [0.25, -0.25]).tolist()
    assert mesh.colors.tolist() == [[1, 0, 0.625]] * 3  # clamped


def test_sparse_and_normalized_displacements(tmp_path):
    document = morphed({"NORMAL": np.int8([[127, 0, 0]] * 3)})
    document.json["accessors"][0]["normalized"] = True
    sparse = {
        "count": 1,
        "indices": {"bufferView": document.view(np.uint16([2]).tobytes()), "componentType": 5123},
        "values": {"bufferView": document.view(np.float32([0, 0, 3]).tobytes()), "byteOffset": 0},
    }
    empty = document.add("accessors", {"componentType": 5126, "type": "VEC3", "count": 3, "sparse": sparse})
    document.json["meshes"][0]["primitives"][0]["targets"][0]["POSITION"] = empty
    document.json["meshes"][0]["weights"] = [2]
    (mesh,) = quietly(document.glb(tmp_path / "a.glb")).meshes
    assert mesh.verts.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 6]]
    assert mesh.normals.tolist() == [[2, 0, 1]] * 3


def test_placements_share_a_mesh_but_for_those_with_weights_of_their_own(tmp_path):
    document = morphed({"POSITION": UP})
    document.add("nodes", {"mesh": 0, "weights": [1], "translation": [3, 0, 0]})
    document.add("nodes", {"mesh": 0, "translation": [6, 0, 0]})
    meshes = quietly(document.glb(tmp_path / "a.glb")).meshes
    assert [len(mesh.instances) for mesh in meshes] == [2, 1]
    assert [mesh.verts[0, 2] for mesh in meshes] == [0, 1]
    assert meshes[1].instances[0, 0, 3] == 3


@pytest.mark.parametrize("weights", [[], [0.0], [1, 2], "none"])
def test_weights_of_a_mesh_without_morph_targets_do_not_count(tmp_path, weights):
    document = triangle()
    for x in (0, 5):
        document.add("nodes", {"mesh": 0, "translation": [x, 0, 0], "weights": weights})
    document.json["meshes"][0]["weights"] = weights
    (mesh,) = quietly(document.glb(tmp_path / "a.glb")).meshes
    assert mesh.instances[:, 0, 3].tolist() == [0, 5]


def test_a_skinned_mesh_is_morphed_first(tmp_path):
    document = bar()
    primitive = document.json["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": document.accessor(np.float32([[0, 1, 0]] * 6))}]
    document.json["meshes"][0]["weights"] = [1]
    (mesh,) = quietly(bent(document).glb(tmp_path / "a.glb"), time=0).meshes
    np.testing.assert_allclose(mesh.verts[4:], [[-2, 0.9, 0], [-2, 1.1, 0]], atol=1e-6)
    low, high = bounding_box(quietly(tmp_path / "a.glb"))
    np.testing.assert_allclose([low, high], [[-0.1, 1, 0], [0.1, 3, 0]], rtol=1e-6)


@pytest.mark.parametrize("attribute", ["POSITION", "NORMAL"])
def test_an_overflow_is_refused(tmp_path, attribute):
    document = morphed({attribute: np.full((3, 3), np.float32(3e38))})
    document.json["meshes"][0]["weights"] = [1e30]
    if attribute == "POSITION":  # whose flat normals are those of the pose
        document.json["meshes"][0]["primitives"][0]["attributes"].pop("NORMAL")
    refusal(document.glb(tmp_path / "a.glb"), "primitives[0].attributes: expected finite positions and directions")


def weights(where, values):
    return lambda document: document.json[where][0].update(weights=values)


MORPHS = [
    (weights("meshes", [1, 2]), "meshes[0].weights: expected 1 finite numbers"),
    (weights("nodes", []), "nodes[0].weights: expected 1 finite numbers"),
    (weights("nodes", ["x"]), "nodes[0].weights: expected 1 finite numbers"),
    (
        lambda document: document.json["meshes"][0]["primitives"].append(
            document.json["meshes"][0]["primitives"][0] | {"targets": []}
        ),
        "meshes[0].primitives[1].targets: expected 1, as many as the mesh's first primitive has, found 0",
    ),
    (
        lambda document: document.json["meshes"][0]["primitives"][0].update(targets=[3]),
        "targets[0]: expected an object",
    ),
]


@pytest.mark.parametrize(("change", "words"), MORPHS)
def test_broken_weights(tmp_path, change, words):
    document = morphed({"POSITION": UP})
    change(document)
    refusal(document.glb(tmp_path / "a.glb"), "a.glb: ", words)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ({"POSITION": UP[:2]}, "targets[0].POSITION: expected 3 of 3 numbers, found 2 of 3"),
        ({"NORMAL": np.ones((3, 4), np.float32)}, "targets[0].NORMAL: expected 3 of 3 numbers, found 3 of 4"),
        ({"POSITION": np.full((3, 3), np.float32(np.inf))}, "targets[0].POSITION: expected finite numbers"),
    ],
)
def test_broken_displacements(tmp_path, target, words):
    document = morphed(target)
    document.json["meshes"][0]["weights"] = [1]
    refusal(document.glb(tmp_path / "a.glb"), "a.glb: meshes[0].primitives[0].", words)
