"""Scalars of meshes and their settings: what is kept, what is refused, and what files give."""

import pickle

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, Gltf

import clshade
from clshade import Camera, Material, Mesh, Scalars, Scene, Texture
from clshade.scene.scalar_colors import at_corners, color_map_of, scalar_range, without_colors

VERTS = np.eye(4, 3, dtype=np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]])
CAMERA = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 2.0, (1.0, 1.0), (8, 8))


def mesh(**scalars) -> Mesh:
    return Mesh(VERTS, FACES, scalars=scalars)


def test_what_is_kept():
    kept = mesh(v=np.arange(4), f=np.float32([1, np.inf, np.nan]), c=np.arange(9.0).reshape(3, 3)).scalars
    assert [kept[name].dtype for name in "vfc"] == [np.float64, np.float32, np.float64]
    assert np.array_equal(kept["f"], np.float32([1, np.nan, np.nan]), equal_nan=True)
    assert not kept["v"].flags.writeable
    assert mesh().scalars == {}
    assert np.array_equal(at_corners(mesh(v=np.arange(4)), "v"), FACES)
    assert np.array_equal(at_corners(mesh(f=np.arange(3)), "f"), np.repeat([[0], [1], [2]], 3, axis=1))
    surface = Mesh(VERTS, [*FACES.tolist(), [1, 2, 3]], scalars={"a": np.arange(4)})  # as many vertices as faces
    assert np.array_equal(at_corners(surface, "a"), surface.faces)
    assert "scalars v" in repr(mesh(v=np.arange(4)))
    assert np.array_equal(pickle.loads(pickle.dumps(mesh(v=np.arange(4)))).scalars["v"], np.arange(4))


def test_the_color_map_of_a_scene():
    scene = Scene((mesh(a=[1.0, np.nan, 5.0, 2.0]), mesh(a=[-1.0, 0.0, np.inf]), mesh()), CAMERA)
    assert scalar_range(scene, "a") == (-1.0, 5.0)
    color_map = color_map_of(scene, Scalars("a", ["black", "#808080"], nan_color=(1, 0, 0)))
    assert (color_map.low, color_map.high, color_map.count) == (-1.0, 5.0, 2)
    gray = ((128 / 255 + 0.055) / 1.055) ** 2.4
    rows = [[0] * 3, [0] * 3, [gray] * 3, [gray] * 3, [1, 0, 0]]
    assert np.array_equal(color_map.table, np.float32(rows))
    course = color_map_of(Scene(mesh(a=np.zeros(4)), CAMERA, preset="course"), Scalars("a", ["#808080"]))
    assert course.table[1, 0] == np.float32(128 / 255)
    nothing = color_map_of(Scene(mesh(a=np.full(4, np.nan)), CAMERA), Scalars("a"))
    assert (nothing.low, nothing.high) == (0.0, 1.0)


def test_meshes_lose_their_colors_but_not_their_alpha():
    image = np.random.default_rng(0).random((2, 2, 4))
    cut = Material(texture=Texture(image), alpha_cutoff=0.5, color=0.3)
    colored = Mesh(VERTS, FACES, np.ones((4, 3)), uvs=np.zeros((4, 2)), material=cut, scalars={"a": np.zeros(4)})
    scene = Scene((colored, mesh(b=np.zeros(4))), CAMERA)
    bare = without_colors(scene, Scalars("a"))
    assert bare.meshes[0].colors is None
    assert np.array_equal(bare.meshes[0].material.color, np.ones(3))
    assert np.array_equal(bare.meshes[0].material.texture.image[..., 3], image[..., 3].astype(np.float32))
    assert (bare.meshes[0].material.texture.image[..., :3] == 1).all()
    assert bare.meshes[1] is scene.meshes[1]
    assert without_colors(scene, None) is scene


HEADER = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "property double heat\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n"
    "property short label\nelement face {faces}\nproperty list uchar int vertex_indices\nproperty int label\n"
    "property float area\nend_header\n"
    "0 0 0 1.5 1 2 3 4 -7\n1 0 0 nan 1 2 3 4 8\n1 1 0 2.5 1 2 3 4 9\n0 1 0 1e300 1 2 3 4 300\n"
)


@pytest.mark.parametrize("rows", ["4 0 1 2 3 70000 0.5\n", "3 0 1 2 1 0.5\n3 0 2 3 2 inf\n3 0 1 3 3 1\n3 1 2 3 4 2\n"])
def test_properties_of_a_ply_file(tmp_path, rows):
    (tmp_path / "a.ply").write_text(HEADER.format(faces=rows.count("\n")) + rows)
    scene = clshade.load(tmp_path / "a.ply")
    scalars = scene.meshes[0].scalars
    assert set(scalars) == {"heat", "label", "face_label", "area"}
    assert np.array_equal(scalars["heat"], [1.5, np.nan, 2.5, 1e300], equal_nan=True)
    assert np.array_equal(scalars["label"], [-7, 8, 9, 300])
    labels = at_corners(scene.meshes[0], "face_label")
    assert np.array_equal(labels[:, 0], [70000, 70000] if len(labels) == 2 else [1, 2, 3, 4])
    assert (labels == labels[:, :1]).all()
    assert scene.ignored == ()


def test_faces_with_colors_keep_the_vertices_scalars(tmp_path):
    colors = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    text = HEADER.replace(colors + "property uchar alpha\n", "").replace(" 1 2 3 4 ", " ")
    text = text.replace("property float area\n", colors)
    (tmp_path / "a.ply").write_text(text.format(faces=1) + "4 0 1 2 3 5 9 9 9\n")
    surface = clshade.load(tmp_path / "a.ply").meshes[0]
    assert np.array_equal(at_corners(surface, "label"), [[-7, 8, 9], [-7, 9, 300]])
    assert (surface.scalars["face_label"] == 5).all()


def test_attributes_of_a_gltf_file(tmp_path):
    document = Gltf()
    numbers = {"_HEAT": np.float32([0.5, np.nan, 3]), "_LABEL": np.uint16([7, 8, 65535]), "_FLOW": CORNERS}
    document.add("nodes", {"mesh": document.mesh({"POSITION": CORNERS, **numbers}, INDICES)})
    with pytest.warns(UserWarning, match="not rendered: attribute _FLOW"):
        scalars = clshade.load(document.glb(tmp_path / "a.glb")).meshes[0].scalars
    assert set(scalars) == {"HEAT", "LABEL"}
    assert np.array_equal(scalars["HEAT"], [0.5, np.nan, 3], equal_nan=True)
    assert np.array_equal(scalars["LABEL"], [7, 8, 65535])
