"""Case 20b: lines along edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....scene.edges import Edges
from ....scene.model import Mesh
from . import lit
from .bench import Bench, Case, Outcome, against_oracle, worst
from .extremes import different_bits

_SHIFT = np.array([1e7, -3e7, 2e7])


def _grid(cells: int, size: float) -> Mesh:
    """Return a square in the plane z = 0 around the origin, of 2 * cells^2 triangles."""
    steps = np.linspace(-size, size, cells + 1)
    verts = np.stack([*np.meshgrid(steps, steps, indexing="ij"), np.zeros((cells + 1, cells + 1))], axis=-1).reshape(
        -1, 3
    )
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1, 1)
    faces = np.concatenate([corner + [0, cells + 1, 1], corner + [1, cells + 1, cells + 2]])
    return Mesh(verts, faces, material=lit.MATERIAL)


def lines(bench: Bench) -> Outcome:
    """Every sample shows a line exactly where the oracle's does: edges seen end-on, at coordinates of 1e7, across the near
    plane, and in a mesh finer than pixels; twice the same bits."""
    grid, fine = _grid(3, 1.0), _grid(90, 0.9)
    side = replace(grid, verts=grid.verts[:, [2, 0, 1]])  # in the plane x = 0, which these eyes see edge-on or nearly
    views = (
        ("end-on", (grid, side), np.array([0.0, 0.0, 4.0]), np.zeros(3)),
        ("nearly end-on", (grid, side), np.array([1e-6, 1e-9, 4.0]), np.zeros(3)),
        ("far", (grid, side), np.array([0.7, 0.4, 3.0]), _SHIFT),
        ("near plane", (grid, side), np.array([0.4, 0.3, 0.2]), np.zeros(3)),
        ("fine", (fine, side), np.array([0.5, 0.6, 3.0]), np.zeros(3)),
    )
    outcomes = []
    for name, meshes, eye, shift in views:
        camera = replace(lit.CAMERA, eye=eye + shift, lookat=shift)
        moved = tuple(replace(mesh, verts=mesh.verts + shift) for mesh in meshes)
        scene = replace(lit.scene_of(moved[0], camera=camera), meshes=moved)
        frames = [bench.draw(scene, edges=Edges("all", width=1.3)) for _ in range(2)]
        outcomes += [replace(against_oracle(frames[0]), detail=name), different_bits(*frames)]
    return worst(outcomes, "5 views, all edges, twice")


CASES = (
    Case(
        "20b", "lines", "edges end-on, far, near, finer than pixels", "hidden exactly, the same bits", lines, slow=True
    ),
)
