"""Cases 20c, 23b and 26e: transparent surfaces, many and faint; shader pbr with narrow lobes and extreme maps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ....base.arrays import Floats
from ....scene.model import LEAST_ROUGHNESS, Material, Mesh, MetallicRoughness, PointLight, Texture
from . import lit
from .bench import Bench, Case, Outcomes, against_oracle, all_against_oracle, different_bits

_LAYERS = 1000


def _squares(z: Floats, **fields: Any) -> Mesh:
    """Return squares at depths z (K,), cut along one diagonal or the other in turn, of random colors and alphas."""
    rng = np.random.default_rng(20)
    verts = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + z[:, None, None] * [0, 0, 1]
    cuts = np.array([[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]])
    faces = cuts[np.arange(len(z)) % 2] + 4 * np.arange(len(z))[:, None, None]
    colors, alphas = rng.uniform(0, 1, (4 * len(z), 3)), rng.uniform(0.5, 1, 4 * len(z))
    material = Material(two_sided=True, blend=True, **fields)
    return Mesh(verts.reshape(-1, 3), faces.reshape(-1, 3), colors, alphas=alphas, material=material)


def transparency(bench: Bench) -> Outcomes:
    """1000 layers behind each other and in one plane, alphas from 1e-7 to 1, triangles that intersect: within the bound, and
    twice the same bits."""
    apart, camera = np.linspace(-1.0, 1.0, _LAYERS), replace(lit.CAMERA, resolution=(20, 20))
    soup = lit.blob(150)
    alphas = np.random.default_rng(7).uniform(0, 1, len(soup.verts))
    wall = lit.patch(material=Material(two_sided=True))
    scenes = (
        ("1000 layers", (_squares(apart, opacity=1 / 256),)),
        ("alpha 1e-7", (_squares(apart[::10], opacity=1e-7),)),
        ("alpha to 1", (_squares(apart[::10], opacity=1.0),)),
        ("in one plane", (_squares(np.zeros(12), opacity=0.3),)),
        ("1000 in one plane", tuple(_squares(np.zeros(1), opacity=1 / 64) for _ in range(_LAYERS))),
        ("intersecting", (replace(soup, alphas=alphas, material=Material(blend=True)), wall)),
    )
    for name, meshes in scenes:
        frames = [bench.draw(lit.scene_of(*meshes, camera=camera)) for _ in range(2)]
        yield from [against_oracle(frames[0], name), different_bits(*frames)]


# Microfacets

ROUGHNESSES = (0.0, 1e-4, LEAST_ROUGHNESS, 0.1, 1.0)
_MIRRORED = PointLight(lit.CAMERA.eye * [-1.0, -1.0, 1.0], np.array([1.0, 0.8, 0.6]))
_BEHIND = PointLight(np.array([-0.5, 0.3, -3.0]), np.array([0.5, 1.0, 0.8]))


def _sheet(metallic: float, roughness: float, emission: float) -> Mesh:
    """Return a sheet whose normals, along its middle row, point between the eye and the light that it mirrors."""
    pbr = MetallicRoughness(metallic, roughness, emission=(emission, 0.1, 0.0))
    return lit.patch(cells=10, bend=-0.5 / lit.CAMERA.eye[2], material=Material(ka=0.2, pbr=pbr))


def narrow_lobes(bench: Bench) -> Outcomes:
    """Roughness 0 to 1 in highlights as wide as the sheet, and where normals lean away from the eye; emission of 1e30."""
    sheets = [_sheet(k % 3 / 2.0, roughness, 0.1) for k, roughness in enumerate(ROUGHNESSES)]
    away = sheets[0].verts * [3.0, 2.0, 0.0] + [0.5, 0.0, -0.4]
    sheets += [replace(_sheet(0.5, roughness, 0.1), normals=away) for roughness in (0.0, 0.5)]
    sheets += [_sheet(0.5, roughness, 1e30) for roughness in (0.0, 1.0)]
    scenes = [lit.scene_of(sheet, lights=(_MIRRORED, _BEHIND, lit.LIGHTS[1])) for sheet in sheets]
    return all_against_oracle(bench, scenes, shader="pbr", forced=("DIFFUSE", "SPECULAR"))


# Maps

_UVS = np.array([1.1, -0.8])  # texture coordinates per scene unit


def _image(seed: int, low: float = 0.0) -> Texture:
    return Texture(np.random.default_rng(seed).uniform(low, 1.0, (7, 9, 3)).astype(np.float32))


def _mapped(changes: dict[str, Any], **fields: Any) -> Mesh:
    """Return a bent sheet with all maps, some of whose parameters change."""
    defaults: dict[str, Any] = {
        "metallic": 0.2,
        "roughness": 0.5,
        "emission": 0.3,
        "normal_texture": _image(1, 0.3),
        "occlusion_texture": _image(2),
        "emission_texture": _image(3),
    }
    mesh = lit.patch(material=Material(ka=0.2, pbr=MetallicRoughness(**{**defaults, **changes})))
    return replace(mesh, **{"uvs": mesh.verts[:, :2] * _UVS, **fields})


def maps(bench: Bench) -> Outcomes:
    """Tangents that cancel or are missing, maps without a normal, emission beyond float32, steep and mirrored maps."""
    count = len(lit.patch().verts)
    turned = np.ones((count, 4)) * (1.0 - 2.0 * (np.arange(count) % 2))[:, None]  # neighbors against each other
    turned[::5] = 0.0
    mirrored = np.diag([1.0, -1.0, 1.0, 1.0])
    mirrored[2, 3] = 0.4
    sheets = [
        _mapped({}, uvs=np.zeros((count, 2))),
        _mapped({}, uvs=np.full((count, 2), np.nan)),
        _mapped({}, tangents=np.zeros((count, 4))),
        _mapped({}, tangents=turned),
        _mapped({}, normals=np.zeros((count, 3))),
        _mapped({"normal_texture": Texture(np.zeros((1, 1, 3)))}),
        _mapped({"normal_texture": Texture(np.full((1, 1, 3), 0.5))}),
        _mapped({"normal_scale": 1e6}),
        _mapped({"emission": 1e30}),
        _mapped({"emission": 3e38, "emission_texture": Texture(np.full((1, 1, 3), 3e38))}),
        _mapped({}, uvs=np.abs(lit.patch().verts[:, :2]) * _UVS, instances=[np.eye(4), mirrored]),
    ]
    return all_against_oracle(bench, [lit.scene_of(sheet) for sheet in sheets], shader="pbr")


CASES = (
    Case("20c", "transparency", "1000 layers, alpha 1e-7 to 1, in one plane", "within the bound", transparency, True),
    Case("23b", "roughness", "shader pbr, roughness 0 and 1e-4, emission 1e30", "within the bound", narrow_lobes, True),
    Case("26e", "maps", "no tangents, no normal in a map, emission 1e30", "finite, within the bound", maps, True),
)
