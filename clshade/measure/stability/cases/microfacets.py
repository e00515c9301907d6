"""Case 23b: the metallic-roughness model where its lobe is narrowest, and where light or eye lies behind the normal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....scene.model import LEAST_ROUGHNESS, Material, Mesh, MetallicRoughness, PointLight
from . import lit
from .bench import Bench, Case, Outcome, all_against_oracle

ROUGHNESSES = (0.0, 1e-4, LEAST_ROUGHNESS, 0.1, 1.0)
_MIRRORED = PointLight(lit.CAMERA.eye * [-1.0, -1.0, 1.0], np.array([1.0, 0.8, 0.6]))
_BEHIND = PointLight(np.array([-0.5, 0.3, -3.0]), np.array([0.5, 1.0, 0.8]))


def _sheet(metallic: float, roughness: float, emission: float) -> Mesh:
    """Return a sheet whose normals, along its middle row, point between the eye and the light that it mirrors."""
    pbr = MetallicRoughness(metallic, roughness, emission=(emission, 0.1, 0.0))
    return lit.patch(cells=10, bend=-0.5 / lit.CAMERA.eye[2], material=Material(ka=0.2, pbr=pbr))


def _turned(mesh: Mesh) -> Mesh:
    """Return the sheet with normals that lean away from the eye, to all sides."""
    x, y, _ = mesh.verts.T
    return replace(mesh, normals=np.column_stack([3.0 * x + 0.5, 2.0 * y, np.full(len(x), -0.4)]))


def narrow_lobes(bench: Bench) -> Outcome:
    """Roughness 0 to 1 in highlights as wide as the sheet, and where normals lean away from the eye; emission of 1e30."""
    sheets = [_sheet(k % 3 / 2.0, roughness, 0.1) for k, roughness in enumerate(ROUGHNESSES)]
    sheets += [_turned(_sheet(0.5, roughness, 0.1)) for roughness in (0.0, 0.5)]
    sheets += [_sheet(0.5, roughness, 1e30) for roughness in (0.0, 1.0)]
    scenes = [lit.scene_of(sheet, lights=(_MIRRORED, _BEHIND, lit.LIGHTS[1])) for sheet in sheets]
    return all_against_oracle(bench, scenes, "sheets", shader="pbr", forced=("DIFFUSE", "SPECULAR"))


CASES = (
    Case("23b", "roughness", "shader pbr, roughness 0 and 1e-4, emission 1e30", "within the bound", narrow_lobes, True),
)
