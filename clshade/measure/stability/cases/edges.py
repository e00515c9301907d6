"""Case 20b: lines along edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....scene.edges import Edges
from ....scene.model import Mesh
from . import lit
from .bench import Bench, Case, Outcome, against_oracle, different_bits, worst
from .coverage import grid

_SHIFT = np.array([1e7, -3e7, 2e7])


def _sheet(cells: int, size: float) -> Mesh:
    """Return a square in the plane z = 0 around the origin, of 2 * cells^2 triangles."""
    points, faces = grid(cells)
    return Mesh(np.column_stack([2.0 * size * points, np.zeros(len(points))]), faces, material=lit.MATERIAL)


def lines(bench: Bench) -> Outcome:
    """Every sample shows a line exactly where the oracle's does: edges seen end-on, at coordinates of 1e7, across the near
    plane, and in a mesh finer than pixels; twice the same bits."""
    coarse, fine = _sheet(3, 1.0), _sheet(90, 0.9)
    side = replace(
        coarse, verts=coarse.verts[:, [2, 0, 1]]
    )  # in the plane x = 0, which these eyes see edge-on or nearly
    views = (
        ("end-on", coarse, [0.0, 0.0, 4.0], 0.0),
        ("nearly end-on", coarse, [1e-6, 1e-9, 4.0], 0.0),
        ("far", coarse, [0.7, 0.4, 3.0], _SHIFT),
        ("near plane", coarse, [0.4, 0.3, 0.2], 0.0),
        ("fine", fine, [0.5, 0.6, 3.0], 0.0),
    )
    outcomes = []
    for name, mesh, eye, shift in views:
        camera = replace(lit.CAMERA, eye=np.array(eye), lookat=np.zeros(3))
        scene = lit.shifted(lit.scene_of(mesh, side, camera=camera), 1.0, shift)
        frames = [bench.draw(scene, edges=Edges("all", width=1.3)) for _ in range(2)]
        outcomes += [against_oracle(frames[0], name), different_bits(*frames)]
    return worst(outcomes, "5 views, all edges, twice")


CASES = (
    Case("20b", "lines", "edges end-on, far, near, finer than pixels", "hidden exactly, the same bits", lines, True),
)
