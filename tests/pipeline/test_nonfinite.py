"""Vertices that are NaN or infinite; normals that cancel; light beyond float32."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mapped_scenes import sheet

from clshade import oracle
from clshade.errors import InputError
from clshade.scene.camera import Camera
from clshade.scene.geometry import vertex_normals
from clshade.scene.model import Mesh, Scene, Settings

VERTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
FACES = np.array([[0, 1, 2], [1, 3, 2]])


def broken(value: float, vertex: int = 3, **fields) -> Mesh:
    verts = VERTS.copy()
    verts[vertex, 1] = value
    return Mesh(verts, FACES, **fields)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_refused_unless_told(value):
    with pytest.raises(InputError, match=r"Mesh: verts: expected finite numbers, found .* in row 3"):
        broken(value)
    with pytest.raises(InputError, match="nonfinite: expected one of refuse, drop"):
        broken(value, nonfinite="keep")


def test_dropped_faces_keep_their_number_and_draw_nothing():
    mesh = broken(-np.inf, nonfinite="drop")
    assert mesh.dropped == 1
    assert len(mesh.faces) == 2
    assert np.isfinite(mesh.verts).all()
    assert np.array_equal(mesh.faces[0], FACES[0])
    assert len(set(mesh.faces[1].tolist())) == 1
    alone = Mesh(VERTS[:3], FACES[:1])
    assert np.array_equal(vertex_normals(mesh.verts, mesh.faces)[:3], vertex_normals(alone.verts, alone.faces))
    assert mesh.verts[mesh.faces].min() == 0.0
    assert mesh.verts[mesh.faces].max() == 1.0


def test_the_count_goes_with_the_mesh():
    nothing = Mesh(np.full((3, 3), np.nan), FACES[:1], nonfinite="drop")
    assert (nothing.dropped, np.isfinite(nothing.verts).all()) == (1, True)
    unused = Mesh(np.concatenate([VERTS, [[np.inf, 0, 0]]]), FACES, nonfinite="drop")
    assert (unused.dropped, np.isfinite(unused.verts).all()) == (0, True)
    mesh = broken(np.nan, nonfinite="drop", instances=np.stack([np.eye(4)] * 3))
    again = replace(mesh, name="again")
    assert again.dropped == 1
    camera = Camera(np.array([0.0, 0, 5]), np.zeros(3), np.array([0.0, 1, 0]), 1.0, (1.0, 1.0), (8, 8))
    scene = Scene((mesh, again, Mesh(VERTS, FACES)), camera)
    assert scene.nonfinite == 6
    assert (oracle.render(scene, Settings()).id > 0).any()


def test_a_sheet_with_a_back_has_no_normals():
    """Each face with its reverse: the sums leave rounding errors, not a direction."""
    bent = sheet(11)
    both = np.concatenate([bent.faces, bent.faces[:, [0, 2, 1]]])
    for scale in (1.0, 1e-20, 1e20):
        for normals_of in (vertex_normals, lambda *mesh: oracle.corners.vertex_normals(*mesh)[0]):
            assert not normals_of(bent.verts * scale, both).any()
            assert np.allclose(np.linalg.norm(normals_of(bent.verts * scale, bent.faces), axis=1), 1.0)
