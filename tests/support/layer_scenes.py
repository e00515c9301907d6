"""A scene with every feature that layers show, and scenes that take all ways to a frame."""

from dataclasses import replace
from typing import Any

import numpy as np

from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, PointLight, Scene, Texture

CAMERA = Camera((0.3, 0.4, 3.0), (0.0, 0.1, 0.0), (0.1, 1.0, 0.0), 1.0, (0.9, 1.2), (64, 48))
CHECKERS = Texture(np.indices((8, 8)).sum(axis=0)[..., None] % 2 * np.float32([0.9, 0.5, 0.2]) + np.float32(0.05))
MIRRORED = np.array([[-0.8, 0.1, 0.0, 0.6], [0.0, 0.7, 0.0, 0.2], [0.1, 0.0, 0.9, 0.4], [0.0, 0.0, 0.0, 1.0]])
TURNED = np.array([[0.5, 0.0, 0.3, -0.7], [0.0, 0.6, 0.0, 0.5], [-0.3, 0.0, 0.5, 0.2], [0.0, 0.0, 0.0, 1.0]])


def at(x: float, y: float, z: float = 0.0) -> np.ndarray:
    """Return the placement (4, 4) of what is moved."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def square(half: float = 1.0, z: float = 0.0, **fields: Any) -> Mesh:
    """Return a square of two triangles about the z axis, facing it."""
    verts = np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]])
    return Mesh(verts, [[0, 1, 2], [0, 2, 3]], **fields)


def floor() -> Mesh:
    """Return a textured quad from far away to behind the eye: both its triangles are clipped."""
    verts = np.float32([[-9, -1, -30], [9, -1, -30], [9, -1, 9], [-9, -1, 9]])
    uvs = np.float32([[0, 12], [6, 12], [6, 0], [0, 0]])
    return Mesh(verts, [[0, 2, 1], [0, 3, 2]], uvs=uvs, material=Material(texture=CHECKERS), name="floor")


def dome(count: int = 14) -> Mesh:
    """Return a fan, open below, with a two-sided material without texture, and separately indexed normals and texture
    coordinates."""
    angle = 2.0 * np.pi * np.arange(count) / count
    # Rounded, so that the scene does not depend on the last bit of the platform's sine.
    ring = np.round(np.stack([0.6 * np.cos(angle), 0.6 * np.sin(angle), 0.1 * np.sin(3 * angle)], axis=1), 6)
    verts = np.concatenate([[[0.0, 0.0, 0.5]], ring])
    faces = [[0, 1 + k, 1 + (k + 1) % count] for k in range(count)]
    normals = np.concatenate([[[0.0, 0.0, 1.0]], ring + [0.0, 0.0, 0.2]])[::-1].copy()
    normal_faces = count - np.array(faces)
    uvs = np.stack([np.arange(3 * count), -np.arange(3 * count)], axis=1) * 0.25
    colors = np.arange(3 * (count + 1)).reshape(-1, 3) % 7 / 8.0
    indexed = {
        "normals": normals,
        "normal_faces": normal_faces,
        "uvs": uvs,
        "uv_faces": np.arange(3 * count).reshape(-1, 3),
    }
    material = Material(two_sided=True, color=(0.9, 0.5, 1.0), name="shell")
    instances = np.array([MIRRORED, TURNED, np.diag([1.0, 1.0, -1.0, 1.0])])
    return Mesh(verts, faces, colors=colors, material=material, instances=instances, name="dome", **indexed)


def wedge() -> Mesh:
    """Return a mesh without normals and texture coordinates; its material equals that of another mesh."""
    verts = np.float32([[-1, -0.9, -1], [1, -0.9, -1], [0, -0.9, 0.6], [0, 0.9, -0.8]])
    return Mesh(verts, [[0, 3, 2], [2, 3, 1], [1, 3, 0]], material=Material(name="clay"), name="wedge")


def mixed(**fields: Any) -> Scene:
    """Return a scene of all these meshes, and a mesh without faces."""
    corners = np.float32([[0.2, -0.8, 1.2], [0.9, -0.8, 1.2], [0.5, -0.2, 1.0]])
    tile = Mesh(corners, [[0, 1, 2]], material=Material(name="clay"))
    nothing = Mesh(np.zeros((1, 3)), np.zeros((0, 3), int), material=Material(kd=0.3))
    meshes = (floor(), nothing, dome(), wedge(), tile)
    defaults: dict[str, Any] = {"camera": CAMERA, "lights": (PointLight((2, 3, 4)),), "background": None}
    return Scene(meshes, **{**defaults, **fields})


def matrices(count: int, rng: np.random.Generator, *, reach: float = 6.0, size: float = 0.6) -> np.ndarray:
    """Return random placements, half of which mirror; the last one is the identity."""
    placements = np.tile(np.eye(4), (count, 1, 1))
    placements[:, :3, :3] = size * rng.normal(size=(count, 3, 3))
    placements[:, :3, 3] = rng.uniform(-reach, reach, (count, 3))
    placements[-1] = np.eye(4)
    return placements


def crowd(count: int = 100) -> Scene:
    """Return many instances of the meshes of `mixed`, some of which are behind the camera, beside the image, or cross the
    near plane."""
    rng = np.random.default_rng(1)
    floor, nothing, dome, wedge, tile = mixed().meshes
    many, some = replace(dome, instances=matrices(count, rng)), replace(wedge, instances=matrices(20, rng))
    return replace(mixed(), meshes=(floor, nothing, many, some, tile))
