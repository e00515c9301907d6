"""Case 26e: maps of shader pbr on surfaces without a direction, and with extreme numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ....scene.model import Material, Mesh, MetallicRoughness, Texture
from . import lit
from .bench import Bench, Case, Outcome, all_against_oracle

_UVS = np.array([1.1, -0.8])  # texture coordinates per scene unit


def _image(seed: int, low: float = 0.0) -> Texture:
    return Texture(np.random.default_rng(seed).uniform(low, 1.0, (7, 9, 3)).astype(np.float32))


def _sheet(changes: dict[str, Any], **fields: Any) -> Mesh:
    """Return a bent sheet with all maps, some of whose parameters change."""
    given: dict[str, Any] = {
        "metallic": 0.2,
        "roughness": 0.5,
        "emission": 0.3,
        "normal_texture": _image(1, 0.3),
        "occlusion_texture": _image(2),
        "emission_texture": _image(3),
    }
    mesh = lit.patch(material=Material(ka=0.2, pbr=MetallicRoughness(**{**given, **changes})))
    return replace(mesh, **{"uvs": mesh.verts[:, :2] * _UVS, **fields})


def _mirrored() -> Mesh:
    """Return a sheet whose texture coordinates are mirrored at its middle, placed twice, once mirrored."""
    mirrored = np.diag([1.0, -1.0, 1.0, 1.0])
    mirrored[2, 3] = 0.4
    sheet = _sheet({})
    return replace(sheet, uvs=np.abs(sheet.verts[:, :2]) * _UVS, instances=[np.eye(4), mirrored])


def maps(bench: Bench) -> Outcome:
    """Tangents that cancel or are missing, maps without a normal, emission beyond float32, steep and mirrored maps."""
    count = len(lit.patch().verts)
    turned = np.ones((count, 4)) * (1.0 - 2.0 * (np.arange(count) % 2))[:, None]  # neighbors against each other
    turned[::5] = 0.0
    sheets = [
        _sheet({}, uvs=np.zeros((count, 2))),
        _sheet({}, uvs=np.full((count, 2), np.nan)),
        _sheet({}, tangents=np.zeros((count, 4))),
        _sheet({}, tangents=turned),
        _sheet({}, normals=np.zeros((count, 3))),
        _sheet({"normal_texture": Texture(np.zeros((1, 1, 3)))}),
        _sheet({"normal_texture": Texture(np.full((1, 1, 3), 0.5))}),
        _sheet({"normal_scale": 1e6}),
        _sheet({"emission": 1e30}),
        _sheet({"emission": 3e38, "emission_texture": Texture(np.full((1, 1, 3), 3e38))}),
        _mirrored(),
    ]
    return all_against_oracle(bench, [lit.scene_of(sheet) for sheet in sheets], "surfaces", shader="pbr")


CASES = (Case("26e", "maps", "no tangents, no normal in a map, emission 1e30", "finite, within the bound", maps, True),)
