"""Exact coincidences on top of random scenes: faces in one plane, vertices on pixel centers and on each other's edges, panes
on panes, lights in faces' planes, texture coordinates on texels' edges, alphas exactly at the cutoff.

The camera looks along z with pixels of a power of two, so that all of them stay exact in float32. None changes the kernel
program.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from random_kinds import Random

from clshade.base.arrays import Array
from clshade.scene.camera import Camera
from clshade.scene.lights import PlacedLight
from clshade.scene.model import Light, Mesh, Scene, Texture, with_materials

PIXEL = 2.0**-4  # side of a pixel in the plane z = 0
MOST_FACES = 1000


def aligned(camera: Camera) -> Camera:
    """Return a camera of that resolution and kind to which the grid of half pixels in the plane z = 0 is exact."""
    columns, rows = camera.resolution
    side = PIXEL if camera.orthographic else PIXEL / 4
    plane, orthographic = (rows * side, columns * side), camera.orthographic
    return Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, plane, (columns, rows), orthographic=orthographic)


def coincident(rng: Random, scene: Scene) -> Scene:
    """Return the scene, with an `aligned` camera, with none to all of the coincidences."""
    grid = PIXEL * float(rng.choice((0.5, 1.0, 4.0)))
    flat = rng.random() < 0.5
    meshes = tuple(_snapped(rng, mesh, grid, flat) if rng.random() < 0.9 else mesh for mesh in scene.meshes)
    scene = replace(scene, meshes=_stacked(rng, meshes))
    if rng.random() < 0.5:
        scene = replace(scene, lights=tuple(_in_a_plane(rng, light, scene.meshes) for light in scene.lights))
    return _at_cutoffs(rng, scene) if rng.random() < 0.5 else scene


def _snapped(rng: Random, mesh: Mesh, grid: float, flat: bool) -> Mesh:
    """Return a mesh with vertices on a grid, in one plane or at few depths, and maybe texture coordinates on edges and
    centers of texels."""
    verts = np.clip(np.round(np.asarray(mesh.verts, np.float64) / grid), -(2.0**12), 2.0**12) * grid
    how = rng.random()
    if flat or how < 0.3:
        verts[:, 2] = 0.0
    elif how < 0.6:
        verts[:, 2] = verts[:, :2] @ rng.choice((-0.25, 0.0, 0.125, 0.5), 2)
    else:
        verts[:, 2] = np.round(verts[:, 2])
    if rng.random() < 0.3:  # less in front of others than float32 tells apart
        verts[:, 2] += rng.integers(0, 3, len(verts) // 3 + 1).repeat(3)[: len(verts)] * 2.0**-22
    changed: dict[str, Any] = {"verts": verts, "instances": None}
    image = mesh.material.texture.image if mesh.material.texture is not None else None
    if image is not None and mesh.uvs is not None and rng.random() < 0.5:
        size = 2.0 * np.array(image.shape[1::-1])
        changed["uvs"] = np.round(mesh.uvs * size) / size
    return replace(mesh, **changed)


def _stacked(rng: Random, meshes: tuple[Mesh, ...]) -> tuple[Mesh, ...]:
    """Return meshes, one of them up to a thousand times: as faces, as instances or as meshes; the first and second stay,
    for their materials."""
    k = int(rng.integers(len(meshes)))
    mesh, how = meshes[k], rng.integers(4)
    limit = MOST_FACES // max(len(mesh.faces), 1)
    count = min(int(2.0 ** rng.uniform(1.0, 10.0)), limit)
    if how == 3 or count < 2:
        return meshes
    if how == 0 and not mesh.scalars:
        return (*meshes[:k], _repeated(rng, mesh, count), *meshes[k + 1 :])
    if how == 1:
        return (*meshes[:k], replace(mesh, instances=np.tile(np.eye(4), (count, 1, 1))), *meshes[k + 1 :])
    return (*meshes, *(_repeated(rng, mesh, 1) for _ in range(min(count, 12)) if not mesh.scalars))


def _repeated(rng: Random, mesh: Mesh, count: int) -> Mesh:
    """Return a mesh of copies of another, with colors and alphas of their own, and other first corners."""
    vertices, turns = len(mesh.verts), rng.integers(3, size=count)

    def turned(faces: Array, step: int) -> Array:
        return np.concatenate([np.roll(faces, turn, axis=1) + step * k for k, turn in enumerate(turns)])

    changed: dict[str, Any] = {"verts": np.tile(mesh.verts, (count, 1)), "faces": turned(mesh.faces, vertices)}
    for name in ("normals", "uvs", "tangents"):
        value, index = getattr(mesh, name), getattr(mesh, f"{name[:-1]}_faces")
        if index is not None:
            changed[f"{name[:-1]}_faces"] = turned(index, 0)
        elif value is not None:
            changed[name] = np.tile(value[:vertices], (count, 1))
            if name == "uvs":
                changed["more_uvs"] = tuple(np.tile(more[:vertices], (count, 1)) for more in mesh.more_uvs)
    for name in ("colors", "alphas"):
        value = getattr(mesh, name)
        if value is not None:
            changed[name] = rng.permutation(np.concatenate([value] * count))
    return replace(mesh, **changed)


def _in_a_plane(rng: Random, light: Light, meshes: tuple[Mesh, ...]) -> Light:
    """Return a light at a vertex, on an edge or elsewhere in the plane of a face; lights without a position stay."""
    mesh = meshes[rng.integers(len(meshes))]
    if not isinstance(light, PlacedLight) or not len(mesh.faces):
        return light
    a, b, c = np.asarray(mesh.verts, np.float64)[mesh.faces[rng.integers(len(mesh.faces))]]
    s, t = rng.integers(-4, 9, 2) / 4.0
    return replace(light, position=a + s * (b - a) + t * (c - a))


def _at_cutoffs(rng: Random, scene: Scene) -> Scene:
    """Return the scene with many texels' alpha exactly at the cutoff of their material."""

    def changed(material: Any) -> Any:
        texture: Texture | None = material.texture
        if material.alpha_cutoff is None or texture is None or texture.image.shape[2] < 4:
            return material
        cutoff = float(rng.integers(1, 8)) / 8.0
        image = texture.image.copy()
        image[..., 3] = np.where(rng.random(image.shape[:2]) < 0.7, cutoff, image[..., 3])
        return replace(material, alpha_cutoff=cutoff, texture=replace(texture, image=image))

    return with_materials(scene, changed)
