"""Counts and area of surfaces, in closed form and against trimesh."""

from __future__ import annotations

import numpy as np
import pytest

import clshade
from clshade.scene import contents as module
from clshade.scene.contents import SurfaceFacts, surface_facts
from clshade.scene.model import Mesh, Scene

CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([triangle for a, b, c, d in SIDES for triangle in ((a, b, c), (a, c, d))])
CAMERA = clshade.Camera.from_fov((0, 0, 9), (0, 0, 0), (0, 1, 0), 40.0)


def scene_of(*meshes):
    return Scene(meshes, CAMERA)


def placement(scale=1.0, shift=(0.0, 0.0, 0.0)):
    matrix = np.diag([scale, scale, scale, 1.0])
    matrix[:3, 3] = shift
    return matrix


def test_a_cube():
    facts = surface_facts(scene_of(Mesh(CORNERS, FACES)))
    assert facts == SurfaceFacts(8, 12, 6.0, 8, 1, 0, 0)
    assert facts.closed


def test_corners_that_are_stored_several_times_count_as_one():
    facts = surface_facts(scene_of(Mesh(CORNERS[FACES].reshape(-1, 3), np.arange(36).reshape(-1, 3))))
    assert facts == SurfaceFacts(36, 12, 6.0, 8, 1, 0, 0)


def test_an_open_cube_and_a_fin():
    assert surface_facts(scene_of(Mesh(CORNERS, FACES[:-2]))) == SurfaceFacts(8, 10, 5.0, 8, 1, 4, 0)
    fin = np.concatenate([CORNERS, [(0.0, 0.5, -1.0)]])
    facts = surface_facts(scene_of(Mesh(fin, np.concatenate([FACES, [(0, 2, 8)]]))))
    assert (facts.boundary_edges, facts.non_manifold_edges, facts.shapes, facts.closed) == (2, 1, 1, False)


def test_instances_and_meshes():
    """Two cubes of sides 1 and 2 apart, and one that another mesh adds to the first."""
    two = np.stack([placement(), placement(2.0, (5.0, 0.0, 0.0))])
    facts = surface_facts(scene_of(Mesh(CORNERS, FACES, instances=two), Mesh(CORNERS + (1.0, 0.0, 0.0), FACES)))
    assert facts.area == 6.0 + 24.0 + 6.0
    assert (facts.vertices, facts.triangles, facts.positions, facts.shapes) == (24, 36, 20, 2)
    assert (facts.boundary_edges, facts.non_manifold_edges) == (0, 4 + 1)  # the common side, and its diagonal


def test_triangles_without_area_and_unused_vertices():
    verts = np.concatenate([CORNERS, [(9.0, 9.0, 9.0)]])
    facts = surface_facts(scene_of(Mesh(verts, np.concatenate([FACES, [(3, 3, 5)]]))))
    assert facts == SurfaceFacts(9, 13, 6.0, 8, 1, 0, 0)
    assert surface_facts(scene_of()) == SurfaceFacts(0, 0, 0.0, 0, 0, 0, 0)
    assert surface_facts(scene_of(Mesh(CORNERS, np.zeros((0, 3), int)))) == SurfaceFacts(8, 0, 0.0, 0, 0, 0, 0)


@pytest.mark.parametrize("meshes", [(), (Mesh(CORNERS, [(3, 3, 5)]),)])
def test_a_scene_without_surface_is_not_closed(meshes):
    facts = surface_facts(scene_of(*meshes))
    assert facts.closed is False
    assert isinstance(facts.area, float)


@pytest.mark.parametrize("scale", [1e-150, 2.0**-500, 1e100])
def test_any_scale(scale):
    facts = surface_facts(scene_of(Mesh(CORNERS * scale, FACES)))
    assert facts.area == pytest.approx(6.0 * scale**2, rel=1e-12)
    assert facts.closed


def test_edges_of_large_scenes_are_not_counted(monkeypatch):
    monkeypatch.setattr(module, "MAX_COUNTED_FACES", 11)
    facts = surface_facts(scene_of(Mesh(CORNERS, FACES)))
    assert facts == SurfaceFacts(8, 12, 6.0)
    assert facts.closed is None


@pytest.mark.parametrize("name", ["teapot", "icosphere", "box_room"])
def test_against_trimesh(name):
    trimesh = pytest.importorskip("trimesh")
    scene = clshade.builtin(name)
    parts = [
        trimesh.Trimesh(mesh.verts @ m[:3, :3].T + m[:3, 3], mesh.faces, process=False)
        for mesh in scene.meshes
        for m in mesh.instances
    ]
    merged = trimesh.util.concatenate(parts)
    merged = trimesh.Trimesh(
        np.unique(merged.vertices, axis=0, return_inverse=True)[0],
        np.unique(merged.vertices, axis=0, return_inverse=True)[1].reshape(-1)[merged.faces],
        process=False,
    )
    facts = surface_facts(scene)
    assert facts.area == pytest.approx(merged.area, rel=1e-9)
    _, uses = np.unique(merged.edges_sorted, axis=0, return_counts=True)
    assert (facts.boundary_edges, facts.non_manifold_edges) == ((uses == 1).sum(), (uses > 2).sum())
    labels, before = np.arange(len(merged.vertices)), None  # the least vertex that edges lead to
    while not np.array_equal(labels, before):
        before = labels.copy()
        np.minimum.at(labels, merged.edges[:, 0], before[merged.edges[:, 1]])
        np.minimum.at(labels, merged.edges[:, 1], labels[merged.edges[:, 0]])
        labels = labels[labels]
    assert facts.shapes == len(np.unique(labels[merged.faces]))
