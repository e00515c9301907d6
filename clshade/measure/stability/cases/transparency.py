"""Case 20c: transparent surfaces, many, faint, in one plane."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ....base.arrays import Floats
from ....scene.model import Material, Mesh
from . import lit
from .bench import Bench, Case, Outcome, against_oracle, different_bits, worst

_LAYERS = 1000
_CAMERA = replace(lit.CAMERA, resolution=(20, 20))


def _squares(z: Floats, **fields: Any) -> Mesh:
    """Return squares at depths z (K,), cut along one diagonal or the other in turn, of random colors and alphas."""
    rng = np.random.default_rng(20)
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    verts = square + np.stack([np.zeros((len(z), 1)), np.zeros((len(z), 1)), z[:, None]], axis=-1)
    cuts = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]])
    faces = cuts[np.arange(len(z)) % 2] + 4 * np.arange(len(z))[:, None, None]
    colors, alphas = rng.uniform(0, 1, (4 * len(z), 3)), rng.uniform(0.5, 1, 4 * len(z))
    material = Material(two_sided=True, blend=True, **fields)
    return Mesh(verts.reshape(-1, 3), faces.reshape(-1, 3), colors, alphas=alphas, material=material)


def transparency(bench: Bench) -> Outcome:
    """1000 layers behind each other and in one plane, alphas from 1e-7 to 1, triangles that intersect: within the bound, and
    twice the same bits."""
    apart, flat = np.linspace(-1.0, 1.0, _LAYERS), np.zeros(12)
    soup = lit.blob(150)
    alphas = np.random.default_rng(7).uniform(0, 1, len(soup.verts))
    wall = lit.patch(material=Material(two_sided=True))
    scenes = (
        ("1000 layers", (_squares(apart, opacity=1 / 256),)),
        ("alpha 1e-7", (_squares(apart[::10], opacity=1e-7),)),
        ("alpha to 1", (_squares(apart[::10], opacity=1.0),)),
        ("in one plane", (_squares(flat, opacity=0.3),)),
        ("1000 in one plane", tuple(_squares(np.zeros(1), opacity=1 / 64) for _ in range(_LAYERS))),
        ("intersecting", (replace(soup, alphas=alphas, material=Material(blend=True)), wall)),
    )
    outcomes = []
    for name, meshes in scenes:
        frames = [bench.draw(replace(lit.scene_of(camera=_CAMERA), meshes=meshes)) for _ in range(2)]
        outcomes += [against_oracle(frames[0], name), different_bits(*frames)]
    return worst(outcomes, "6 scenes, twice")


CASES = (
    Case("20c", "transparency", "1000 layers, alpha 1e-7 to 1, in one plane", "within the bound", transparency, True),
)
