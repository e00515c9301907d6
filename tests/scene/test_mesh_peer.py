"""Files written by trimesh are read back: an independent implementation of each format."""

import numpy as np
import pytest
from scene_files import corners_in_world, write

from clshade.scene.formats.load import load

trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")

KNOBBLY = trimesh.creation.icosphere(subdivisions=3, radius=2.0)
KNOBBLY.vertices += 0.1 * np.sin(5 * KNOBBLY.vertices[:, ::-1])


@pytest.mark.parametrize("kind", ["obj", "ply", "ply_ascii", "stl", "stl_ascii", "glb"])
def test_corners_come_back(tmp_path, kind):
    name, _, text = kind.partition("_")
    if name == "ply":
        data = trimesh.exchange.ply.export_ply(KNOBBLY, encoding="ascii" if text else "binary")
    else:
        data = KNOBBLY.export(file_type=kind)
    triangles = corners_in_world(load(write(tmp_path / f"a.{name}", data)).meshes)
    tolerance = 3e-7 if kind in ("ply", "stl", "glb") else 3e-6  # float32 at 2.1, or the digits of the text
    np.testing.assert_allclose(triangles, KNOBBLY.triangles, atol=tolerance)


def test_a_tree_of_nodes(tmp_path):
    scene = trimesh.Scene()
    placements = [*map(trimesh.transformations.random_rotation_matrix, np.random.default_rng(2).random((3, 3)))]
    placements[1][:3, 3], placements[2][:3, 0] = [3, 1, 2], -placements[2][:3, 0]  # the last one mirrors
    scene.add_geometry(KNOBBLY, node_name="a", geom_name="k", transform=placements[0])
    for parent, node, placement in (("a", "b", placements[1]), ("b", "c", placements[2])):
        scene.graph.update(node, frame_from=parent, matrix=placement, geometry="k")
    triangles = corners_in_world(load(write(tmp_path / "a.glb", scene.export(file_type="glb"))).meshes)
    world = [placements[0], placements[0] @ placements[1], placements[0] @ placements[1] @ placements[2]]
    expected = [KNOBBLY.triangles @ matrix[:3, :3].T + matrix[:3, 3] for matrix in world]
    assert len(triangles) == 3 * len(KNOBBLY.faces)
    thirds = triangles.reshape(3, -1, 3, 3)
    order = [min(range(3), key=lambda k: np.abs(third - expected[k]).max()) for third in thirds]
    assert sorted(order) == [0, 1, 2]
    for third, k in zip(thirds, order, strict=True):
        np.testing.assert_allclose(third, expected[k], atol=1e-5)
