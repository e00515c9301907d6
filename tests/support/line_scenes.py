"""Scenes whose edges are known."""

from __future__ import annotations

import numpy as np

from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, PointLight, Scene

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))  # normals point outwards
CUBE_FACES = np.array([corners for a, b, c, d in SIDES for corners in ((a, b, c), (a, c, d))])


def cube(shared: bool = True) -> Mesh:
    """Return a cube from (0, 0, 0) to (1, 1, 1); with `shared` False every face has vertices of its own."""
    if shared:
        return Mesh(CORNERS, CUBE_FACES)
    return Mesh(CORNERS[CUBE_FACES].reshape(-1, 3), np.arange(36).reshape(-1, 3))


def floor(height: float = 0.0) -> Mesh:
    """Return a square at y = height, seen from above."""
    verts = np.array([[-3.0, height, -3.0], [4.0, height, -3.0], [4.0, height, 4.0], [-3.0, height, 4.0]])
    return Mesh(verts, np.array([[0, 2, 1], [0, 3, 2]]))


def scene_of(*meshes: Mesh, eye=(3.1, 2.3, 4.2), lookat=(0.5, 0.5, 0.5), resolution=(60, 45)) -> Scene:
    camera = Camera(np.array(eye), np.array(lookat), np.array([0.0, 1.0, 0.0]), 1.3, (1.0, 4 / 3), resolution)
    return Scene(meshes, camera, (PointLight(np.array([3.0, 5.0, 4.0]), np.ones(3)),), np.full(3, 0.3), np.full(3, 0.5))
