"""Skins and morph targets of glTF files against poses in closed form."""

import math

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, REMOVED, UP, Gltf, bar, changed, cubic, triangle
from scene_files import corners_in_world, scene_and_warnings

from clshade.scene.formats.gltf_meshes import Influences, deform
from clshade.scene.formats.load import load

pytestmark = pytest.mark.filterwarnings("error")

P = "meshes.0.primitives.0"
JOINTS, WEIGHTS, TARGET = f"{P}.attributes.JOINTS_0", f"{P}.attributes.WEIGHTS_0", f"{P}.targets.0"


def bent() -> Gltf:
    """Return a bar whose upper joint an animation of one time turns by 90 degrees about z."""
    document = bar()
    turned = np.array([[0, 0, math.sqrt(0.5), math.sqrt(0.5)]], np.float32)
    document.animation((2, "rotation", np.float32([0]), turned, "STEP"))
    return document


def normal_map(document: Gltf) -> int:
    """Add a material that needs tangents."""
    return document.add("materials", {"normalTexture": {"index": document.texture(np.zeros((1, 1, 3), np.uint8))}})


# Skins

STRAIGHT = np.array([[x, y, 0] for y in (0, 1, 2) for x in (-0.1, 0.1)])
# The upper end turns about (0, 1, 0); the middle is the mean of where both joints put it.
BENT = np.array([[-0.1, 0, 0], [0.1, 0, 0], [-0.05, 0.95, 0], [0.05, 1.05, 0], [-1, 0.9, 0], [-1, 1.1, 0]])
SHARES = np.array([[1, 0, 0, 0]] * 2 + [[0.5, 0.5, 0, 0]] * 2 + [[0, 1, 0, 0]] * 2)
FAR_ROOT = {"children": [1], "translation": [0, 0, 5]}
EIGHTHS = np.full((6, 4), 0.125, np.float32)
ALL_OF_BOTH = {
    **{JOINTS: np.zeros((6, 4), np.uint16), WEIGHTS: EIGHTHS},
    **{f"{P}.attributes.JOINTS_1": np.ones((6, 4), np.uint16), f"{P}.attributes.WEIGHTS_1": EIGHTHS},
}
# Everything is the mean of both joints: (x, y) and (1 - y, 1 + x).
MEAN = [[(x + 1 - y) / 2, (y + 1 + x) / 2, 0] for x, y, _ in STRAIGHT]
RAISED = {f"{P}.targets": [{}], f"{TARGET}.POSITION": np.float32([[0, 1, 0]] * 6), "meshes.0.weights": [1]}
RAISED_AND_BENT = [[-0.1, 1, 0], [0.1, 1, 0], [-0.55, 1.45, 0], [-0.45, 1.55, 0], [-2, 0.9, 0], [-2, 1.1, 0]]
POSES = {
    "as it was bound": ({}, None, STRAIGHT),
    "bent": ({}, 0, BENT),
    "joints outside the scene": ({"nodes.0": FAR_ROOT, "scenes.0.nodes": [3]}, None, STRAIGHT + [0, 0, 5]),
    # The upper joint is at y = 1.
    "identities": ({"skins.0.inverseBindMatrices": REMOVED}, None, STRAIGHT * [1, 1.5, 1]),
    "several sets": (ALL_OF_BOTH, 0, MEAN),
    "weights of 8 bits": ({WEIGHTS: (np.uint8(SHARES * 255), {"normalized": True})}, 0, BENT),
    "any number without weight": ({JOINTS: np.uint8([[0, 1, 9, 9]] * 6)}, 0, BENT),
    "tiny": ({"nodes.0.scale": [1e-24] * 3}, None, STRAIGHT * 1e-24),
    "huge": ({"nodes.0.scale": [1e20] * 3}, None, STRAIGHT * 1e20),
    "morphed first": (RAISED, 0, RAISED_AND_BENT),
}


@pytest.mark.parametrize("pose", POSES)
def test_a_bar_with_two_joints(tmp_path, pose):
    """The transform of its own node does not count."""
    changes, time, expected = POSES[pose]
    scene = load(changed(bent(), changes, tmp_path / "a.glb"), time=time)
    (mesh,) = scene.meshes
    assert (mesh.verts.dtype, mesh.instances.tolist(), scene.ignored) == (np.float32, [np.eye(4).tolist()], ())
    np.testing.assert_allclose(mesh.verts, expected, atol=2e-7 * np.abs(expected).max())
    normals = mesh.normals / np.linalg.norm(mesh.normals, axis=1)[:, None]
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 6, atol=1e-7)


@pytest.mark.parametrize(("share", "warned"), [(0.985, True), (0.992, False), (1.009, False), (0.0, True)])
def test_weights_are_scaled_to_a_sum_of_1(tmp_path, share, warned):
    weights, expected = np.float32(SHARES), BENT
    weights[3] *= share
    if share == 0.0:
        weights, expected = share * weights, STRAIGHT  # they follow the first joint
    scene, messages = scene_and_warnings(changed(bent(), {WEIGHTS: weights}, tmp_path / "a.glb"), time=0)
    np.testing.assert_allclose(scene.meshes[0].verts, expected, atol=2e-7)
    line = "a.glb: meshes[0].primitives[0].attributes.WEIGHTS: expected a sum of 1 for each vertex, found"
    assert [line in message and f"in row {3 if share else 0}" in message for message in messages] == [True] * warned


def test_normals_and_tangents_of_a_stretched_joint(tmp_path):
    document = bar()
    attributes = {
        "NORMAL": np.array([[0.6, 0.8, 0]] * 6, np.float32),
        "TANGENT": np.array([[0.8, -0.6, 0, -1]] * 6, np.float32),
        "TEXCOORD_0": np.zeros((6, 2), np.float32),
    }
    changes = {f"{P}.attributes.{name}": values for name, values in attributes.items()}
    changes |= {f"{P}.material": normal_map(document), "nodes.1.scale": [2, 1, 1]}  # of both joints
    (mesh,) = load(changed(document, changes, tmp_path / "a.glb")).meshes
    np.testing.assert_allclose(mesh.verts[:, 0], [-0.2, 0.2] * 3, rtol=1e-6)
    normals = mesh.normals / np.linalg.norm(mesh.normals, axis=1)[:, None]
    np.testing.assert_allclose(normals, [[0.3 / math.hypot(0.3, 0.8), 0.8 / math.hypot(0.3, 0.8), 0]] * 6, rtol=1e-6)
    np.testing.assert_allclose(mesh.tangents, [[1.6, -0.6, 0, -1]] * 6, rtol=1e-6)


def test_flat_normals_are_those_of_the_pose(tmp_path):
    about_x = [math.sin(math.pi / 4), 0, 0, math.cos(math.pi / 4)]
    changes = {"nodes.2.rotation": about_x, f"{P}.attributes.NORMAL": REMOVED}
    (mesh,) = load(changed(bar(), changes, tmp_path / "a.glb")).meshes
    corners = mesh.verts[mesh.faces]
    expected = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    expected /= np.linalg.norm(expected, axis=1)[:, None]
    assert np.ptp(expected, axis=0).max() > 0.5
    np.testing.assert_allclose(mesh.normals[mesh.normal_faces][:, 0], expected, atol=1e-6)


def test_a_mirrored_skin_keeps_its_front(tmp_path):
    changes = {"nodes.0.scale": [1, 1, -1], "nodes.0.translation": [0, 3, 4]}
    scene = load(changed(bar(), changes, tmp_path / "a.glb"))
    (mesh,) = scene.meshes
    (matrix,) = mesh.instances
    np.testing.assert_allclose(corners_in_world(scene.meshes), (STRAIGHT + [0, 3, 4])[mesh.faces], rtol=1e-6)
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
    for row in (0, (1 << 15) - 1, 1 << 15, count - 1):
        blended = sum(w * matrices[j] for w, j in zip(weights[row], influences.joints[row], strict=True))
        moved = blended[:, :3] @ attributes["POSITION"][row] + blended[:, 3]
        np.testing.assert_allclose(deformed["POSITION"][row], moved, rtol=1e-12, atol=1e-12)
        normal = np.linalg.inv(blended[:, :3]).T @ attributes["NORMAL"][row] * np.linalg.det(blended[:, :3])
        np.testing.assert_allclose(deformed["NORMAL"][row], normal / np.linalg.norm(normal), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("scale", [1e-200, 3e-7, 1e200])
def test_the_scale_of_a_joint_does_not_count_for_normals(scale):
    turned = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    influences = Influences(np.zeros((3, 1), int), np.ones((3, 1)))
    attributes = {"POSITION": np.zeros((3, 3)), "NORMAL": np.float32([[0.6, 0.8, 0], [0, 0, 5], [0, 0, 0]])}
    normals = deform(attributes, influences, scale * turned[None])[0]["NORMAL"]
    np.testing.assert_allclose(normals, [[-0.8, 0.6, 0], [0, 0, 1], [0, 0, 0]], atol=1e-7)


def test_bars_of_one_mesh_with_skins_of_their_own_or_none(tmp_path):
    document = bar()
    document.add("nodes", {"translation": [9, 0, 0]})
    document.add("nodes", {"mesh": 0, "skin": 1})
    document.add("nodes", {"mesh": 0, "translation": [0, 0, 4]})
    document.add("skins", {"joints": [4, 4]})
    document.json["nodes"][0]["children"] += [4, 5, 6]
    with pytest.warns(UserWarning, match="not rendered: joints of meshes without a skin$"):
        corners = corners_in_world(load(document.glb(tmp_path / "a.glb")).meshes)
    assert corners[::4, 0].tolist() == np.float32([[-0.1, 0, 0], [8.9, 0, 0], [-0.1, 0, 4]]).tolist()
    document = triangle({"mesh": 0, "skin": 0, "translation": [50, 60, 70]})
    document.add("skins", {"joints": [0]})
    with pytest.warns(UserWarning, match="not rendered: skins of meshes without joints$"):
        (mesh,) = load(document.glb(tmp_path / "a.glb")).meshes
    assert mesh.instances[0, :3, 3].tolist() == [50, 60, 70]


# Morph targets


def morphed(*targets) -> Gltf:
    """Return a triangle with morph targets, dicts of arrays."""
    document = Gltf()
    listed = [{name: document.accessor(np.asarray(values)) for name, values in target.items()} for target in targets]
    document.mesh({"POSITION": CORNERS, "NORMAL": UP}, INDICES, targets=listed)
    document.add("nodes", {"mesh": 0})
    return document


WIDE = np.float32([[0, 0, 0], [2, 0, 0], [0, 0, 0]])


def test_animated_weights(tmp_path):
    document = morphed({"POSITION": UP}, {"POSITION": WIDE})
    keys, slopes = np.float32([[0, 1], [1, -1]]), np.float32([[0.5, 2], [-1, 3]])
    rows = np.stack([slopes, keys, slopes], axis=1)
    document.animation((0, "weights", np.float32([0, 2]), rows.ravel(), "CUBICSPLINE"))
    (mesh,) = load(document.glb(tmp_path / "a.glb"), time=0.5).meshes
    first, second = cubic(0.25, 2.0, keys[0], slopes[0], keys[1], slopes[1])
    np.testing.assert_allclose(mesh.verts, CORNERS + first * UP + second * WIDE, atol=1e-7)


def test_all_attributes_are_morphed(tmp_path):
    """A normalized or sparse displacement, too."""
    target = {"TANGENT": np.float32([[0, 2, 0]] * 3), "TEXCOORD_0": np.float32([[0.5, -0.5]] * 3)}
    document = morphed({**target, "COLOR_0": np.float32([[0.5, -1, 0.25]] * 3)})
    attributes = {
        "TANGENT": np.float32([[1, 0, 0, -1]] * 3),
        "TEXCOORD_0": CORNERS[:, :2].copy(),
        "COLOR_0": np.float32([[0.75, 0.25, 0.5]] * 3),
    }
    changes = {f"{P}.attributes.{name}": values for name, values in attributes.items()} | {
        f"{TARGET}.NORMAL": (np.int8([[127, 0, 0]] * 3), {"normalized": True}),
        f"{TARGET}.POSITION": document.sparse(np.uint16([2]), np.float32([[0, 0, 3]]), 3),
        f"{P}.material": normal_map(document),
        "meshes.0.weights": [0.5],
    }
    (mesh,) = load(changed(document, changes, tmp_path / "a.glb")).meshes
    assert mesh.tangents.tolist() == [[1, 1, 0, -1]] * 3
    assert mesh.uvs.tolist() == (CORNERS[:, :2] + [0.25, -0.25]).tolist()
    assert mesh.colors.tolist() == [[1, 0, 0.625]] * 3  # clamped
    assert mesh.verts.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 1.5]]
    assert mesh.normals.tolist() == [[0.5, 0, 1]] * 3


def test_placements_share_a_mesh_but_for_those_with_weights_of_their_own(tmp_path):
    document = morphed({"POSITION": UP, "NORMAL": UP}, {"POSITION": WIDE})
    document.json["meshes"][0]["weights"] = [0.5, 0.25]
    document.add("nodes", {"mesh": 0, "weights": [-1, 2], "translation": [3, 0, 0]})
    document.add("nodes", {"mesh": 0, "translation": [6, 0, 0]})
    meshes = load(document.glb(tmp_path / "a.glb")).meshes
    assert [mesh.instances[:, 0, 3].tolist() for mesh in meshes] == [[0, 6], [3]]
    for mesh, first, second in zip(meshes, (0.5, -1), (0.25, 2), strict=True):
        assert mesh.verts.tolist() == (CORNERS + first * UP + second * WIDE).tolist()
        assert mesh.normals.tolist() == [[0, 0, 1 + first]] * 3


def test_weights_of_a_mesh_without_morph_targets_do_not_count(tmp_path):
    document = triangle()
    for x, weights in ((0, [1, 2]), (5, "none")):
        document.add("nodes", {"mesh": 0, "translation": [x, 0, 0], "weights": weights})
    (mesh,) = load(changed(document, {"meshes.0.weights": [1, 2]}, tmp_path / "a.glb")).meshes
    assert mesh.instances[:, 0, 3].tolist() == [0, 5]
