"""A lit scene that several cases modify: colored triangles of all sizes around the origin, two lights."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ....base.arrays import Array
from ....scene.camera import Camera
from ....scene.model import Material, Mesh, PointLight, Scene

LIGHTS = (
    PointLight(np.array([3.0, 4.0, 5.0]), np.array([1.0, 0.9, 0.7])),
    PointLight(np.array([-4.0, 1.0, 2.0]), np.array([0.2, 0.3, 0.8])),
)
CAMERA = Camera(
    np.array([0.3, 0.2, 5.0]), np.array([0.05, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), 1.3, (1.0, 1.0), (61, 61)
)
MATERIAL = Material()  # shared by all meshes: a second one would need another program


def blob(count: int = 250, seed: int = 6, material: Material = MATERIAL, **fields: Any) -> Mesh:
    """Return triangles without shared vertices, in coordinates that need float64."""
    rng = np.random.default_rng(seed)
    verts = rng.normal(size=(count, 1, 3)) + rng.uniform(0.05, 1, (count, 1, 1)) * rng.normal(size=(count, 3, 3))
    colors = rng.uniform(0, 1, (3 * count, 3))
    faces = np.arange(3 * count).reshape(-1, 3)
    return Mesh(verts.reshape(-1, 3), faces, colors=colors, material=material, **fields)


def scene_of(*meshes: Mesh, **fields: Any) -> Scene:
    """Return a scene of the meshes (default: the blob) with CAMERA and LIGHTS, over a background."""
    defaults = {"meshes": meshes or (blob(),), "camera": CAMERA, "lights": LIGHTS, "background": (0.25, 0.5, 2.0)}
    return Scene(**{**defaults, **fields})


def triangle(*corners: tuple[float, float, float]) -> Mesh:
    """Return one colored triangle, drawn by the blob's program."""
    colors = np.array([[1.0, 0.5, 0.2], [0.1, 0.9, 0.3], [0.2, 0.3, 0.7]])
    return Mesh(np.array(corners) * (1 + 2.0**-40), np.array([[0, 1, 2]]), colors=colors, material=MATERIAL)


def patch(size: float = 1.0, cells: int = 6, bend: float = 0.15, material: Material = MATERIAL, **fields: Any) -> Mesh:
    """Return a colored sheet of 2*cells^2 triangles in front of the camera, `size` wide around the origin, bent so that
    normals differ."""
    line = np.linspace(-1.0, 1.0, cells + 1)
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    verts = size * np.stack([x, y, bend * (1.0 - x * x - 0.5 * y * y)], axis=1) * (1 + 2.0**-40)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1)
    a, b, c, d = corner, corner + 1, corner + cells + 2, corner + cells + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    colors = np.random.default_rng(1).uniform(0.2, 1.0, (len(verts), 3))
    return Mesh(verts, faces, colors=colors, material=material, **fields)


def shifted(scene: Scene, scale: float, shift: float | Array) -> Scene:
    """Return the scene with vertices, camera and lights times `scale` plus `shift`."""
    camera = scene.camera
    eye, lookat = camera.eye * scale + shift, camera.lookat * scale + shift
    lights = tuple(light.rescaled(scale, shift) for light in scene.lights)
    meshes = tuple(replace(mesh, verts=mesh.verts * scale + shift) for mesh in scene.meshes)
    return replace(scene, meshes=meshes, lights=lights, camera=replace(camera, eye=eye, lookat=lookat))


def on_a_grid(mesh: Mesh, bits: int) -> Mesh:
    """Round vertices to multiples of 2^-bits and move them by half of one, so that float32 cannot represent them."""
    return replace(mesh, verts=np.round(mesh.verts * 2.0**bits) / 2.0**bits + 2.0 ** -(bits + 1))
