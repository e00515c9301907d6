"""Scenes with maps of shader pbr."""

from typing import Any

import numpy as np

from clshade import Camera, Material, Mesh, MetallicRoughness, PointLight, Scene, Texture
from clshade.scene.material import MAPS

CAMERA = Camera((0.4, 0.3, 4.0), (0.05, 0.0, 0.0), (0, 1, 0), 1.6, (1.0, 1.0), (61, 47))
LIGHTS = (PointLight((3, 4, 5), (1.0, 0.9, 0.7)), PointLight((-4, 1, 2), (0.2, 0.3, 0.8)))


def normal_image(rows: int, columns: int, seed: int = 1, tilt: float = 0.5) -> np.ndarray:
    """Return a smooth normal map whose normals lean by up to `tilt`."""
    lean = np.random.default_rng(seed).uniform(-tilt, tilt, (rows, columns, 2))
    return np.float32(0.5 + 0.5 * np.dstack([lean, np.sqrt(1.0 - (lean**2).sum(axis=2))]))


def noise(rows: int, columns: int, seed: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, 1.0, (rows, columns, 3)).astype(np.float32)


def mapped(**changes: Any) -> MetallicRoughness:
    """Return parameters with all maps, each of another size."""
    defaults: dict[str, Any] = {
        "metallic": 0.3,
        "roughness": 0.5,
        "emission": (0.2, 0.1, 0.4),
        "normal_texture": Texture(normal_image(8, 11)),
        "normal_scale": 0.8,
        "occlusion_texture": Texture(noise(5, 9), wrap="clamp"),
        "occlusion_strength": 0.7,
        "emission_texture": Texture(noise(7, 6, 3), wrap="mirror"),
        "metallic_roughness_texture": Texture(noise(6, 4, 4)),
        **{name: Texture(noise(4, number, 5)) for number, name in enumerate(MAPS) if number > 3},
    }
    return MetallicRoughness(**{**defaults, **changes})


def sheet(cells: int = 5, shift: tuple[float, float, float] = (0.0, 0.0, 0.0), **fields: Any) -> Mesh:
    """Return a bent sheet with two sets of texture coordinates."""
    line = np.linspace(-1.0, 1.0, cells + 1)
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    verts = np.stack([x, y, 0.3 * (1.0 - x * x - 0.5 * y * y)], axis=1) + shift
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1)
    a, b, c, d = corner, corner + 1, corner + cells + 2, corner + cells + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    uvs = np.stack([1.3 * x + 0.1, 0.7 - 1.1 * y], axis=1)
    defaults = {"uvs": uvs, "more_uvs": (uvs[:, ::-1] * 2.0,), "material": Material(ka=0.3, pbr=mapped())}
    return Mesh(verts, faces, **{**defaults, **fields})


def mapped_scene(*meshes: Mesh, **fields: Any) -> Scene:
    defaults = {"meshes": meshes or (sheet(),), "camera": CAMERA, "lights": LIGHTS, "background": 0.1}
    return Scene(**{**defaults, **fields})
