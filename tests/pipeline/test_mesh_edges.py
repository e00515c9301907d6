"""The edges of meshes and their kinds, against counts that are known, and against the oracle's."""

from __future__ import annotations

import numpy as np
import pytest
from line_scenes import CUBE_FACES, cube

from clshade.errors import InputError
from clshade.oracle import lines as oracle
from clshade.pipeline.lines import always_drawn, face_normals, facing, mesh_edges, outlines
from clshade.scene.model import Settings
from clshade.scene.settings import Edges


def drawn(mesh, edge_options: Edges) -> int:
    edges = mesh_edges(mesh.verts, mesh.faces)
    return int(always_drawn(edges, edge_options, face_normals(mesh.verts, mesh.faces)).sum())


@pytest.mark.parametrize("shared", [True, False])
def test_a_cube_has_12_features_and_6_diagonals(shared):
    mesh = cube(shared)
    assert [drawn(mesh, Edges(kind)) for kind in ("all", "feature", "boundary", "nonmanifold")] == [18, 12, 0, 0]
    assert drawn(mesh, Edges("feature", angle=91)) == 0


def test_a_face_that_winds_the_other_way_makes_no_feature():
    mesh = cube()
    faces = mesh.faces.copy()
    faces[0] = faces[0][::-1]
    normals = face_normals(mesh.verts, faces)
    assert always_drawn(mesh_edges(mesh.verts, faces), Edges("feature"), normals).sum() == 12


def test_open_and_triple_edges():
    """Without one triangle three edges are boundaries; a fin on an edge makes that one non-manifold, two more open."""
    assert drawn_of(CUBE_FACES[1:], "boundary") == 3
    fin = np.vstack([cube().verts, [[2.0, 2.0, 2.0]]])
    faces = np.vstack([CUBE_FACES, [[0, 1, 8]]])
    edges, normals = mesh_edges(fin, faces), face_normals(fin, faces)
    counts = {kind: int(always_drawn(edges, Edges(kind), normals).sum()) for kind in ("boundary", "nonmanifold")}
    assert counts == {"boundary": 2, "nonmanifold": 1}


def drawn_of(faces, kind) -> int:
    verts = cube().verts
    return int(always_drawn(mesh_edges(verts, faces), Edges(kind), face_normals(verts, faces)).sum())


def test_silhouettes():
    """From a corner's direction a cube's outline has six edges, from before a side, in perspective, four; no diagonal."""
    mesh = cube()
    edges, normals = mesh_edges(mesh.verts, mesh.faces), face_normals(mesh.verts, mesh.faces)
    for eye, expected in (((5.0, 6.0, 7.0), 6), ((0.5, 0.4, 7.0), 4), ((0.5, 0.4, 0.6), 0)):
        front = facing(mesh.verts, mesh.faces, normals, np.array(eye), None)
        assert outlines(edges, front).sum() == expected
    front = facing(mesh.verts, mesh.faces, normals, np.zeros(3), np.array([-1.0, -1.0, -1.0]))
    assert outlines(edges, front).sum() == 6


def test_equal_positions_are_one_vertex_and_minus_zero_is_zero():
    verts = np.array([[0.0, 1, 2], [3, 4, 5], [6, 7, 9], [-0.0, 1, 2], [5, 3, 1]])
    assert mesh_edges(verts, np.array([[0, 1, 2], [1, 3, 4]])).ends.tolist() == [[0, 1], [0, 2], [0, 4], [1, 2], [1, 4]]
    assert len(mesh_edges(np.zeros((0, 3)), np.zeros((0, 3), np.int32))) == 0


def test_host_and_oracle_agree():
    rng = np.random.default_rng(3)
    verts = rng.integers(0, 3, (40, 3)).astype(float)  # many equal ones
    faces = rng.integers(0, 40, (120, 3))
    edges, expected = mesh_edges(verts, faces), oracle.mesh_edges(verts[faces])
    ours = {frozenset(map(tuple, verts[pair].tolist())): set() for pair in edges.ends}
    theirs = {frozenset(map(tuple, pair.tolist())): set() for pair in expected.ends}
    for pair, start, count in zip(edges.ends, edges.starts, edges.counts, strict=True):
        ours[frozenset(map(tuple, verts[pair].tolist()))].update(edges.faces[start : start + count].tolist())
    for face, edge in zip(expected.face, expected.edge, strict=True):
        theirs[frozenset(map(tuple, expected.ends[edge].tolist()))].add(int(face))
    assert ours == theirs
    assert len(ours) > 50


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"kinds": "crease"}, "Edges: kinds: expected one of all, feature"),
        ({"kinds": ()}, "Edges: kinds: expected names of all"),
        ({"width": 0}, "Edges: width: expected pixels above 0, at most 64"),
        ({"width": 65}, "Edges: width: expected pixels above 0, at most 64"),
        ({"angle": 181}, "Edges: angle: expected degrees from 0 to 180"),
        ({"color": (0, -1, 0)}, "Edges: color: expected a name such as white, #rrggbb .sRGB., or three linear numbers"),
        ({"only": 1}, "Edges: only: expected True or False"),
    ],
)
def test_refused_values(fields, expected):
    with pytest.raises(InputError, match=expected):
        Edges(**fields)


def test_kinds_alone_are_edges():
    assert Settings(edges=["boundary", "feature"]).edges == Edges(("feature", "boundary"))
    with pytest.raises(InputError, match="Settings: edges: expected Edges, names of all"):
        Settings(edges=3)
