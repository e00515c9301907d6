"""Extremes and exact coincidences on top of random scenes. None changes the kernel program, except that colors beyond 1
select the one that interpolates them.

Extremes: coordinates, placements, normals, cameras and lights at their ranges' ends. Coincidences: faces in one plane,
vertices on pixel centers and on each other's edges, panes on panes, lights in faces' planes, texture coordinates on texels'
edges, alphas exactly at the cutoff; the camera looks along z with pixels of a power of two, so that all stay exact.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from random_kinds import Random

from clshade.base.arrays import Array, Floats
from clshade.oracle.transform import world_vertices
from clshade.scene.camera import Camera
from clshade.scene.lights import DirectionalLight, PlacedLight
from clshade.scene.model import Light, Mesh, Scene, Texture, with_materials

PIXEL = 2.0**-4  # side of a pixel in the plane z = 0
MOST_FACES = 1000
SHARE = 0.3  # fraction of the scenes that get each extreme


def stiffened(rng: Random, scene: Scene, double: bool, dim: bool) -> Scene:
    """Add none to all extremes. double: whether positions may need float64. dim: whether colors stay within 1."""
    for change in EXTREMES:
        if rng.random() < SHARE and not (dim and change is _colors):
            scene = change(rng, scene, double)
    return scene


def _changed(scene: Scene, change: Callable[[Mesh], dict[str, Any]]) -> Scene:
    return replace(scene, meshes=tuple(replace(mesh, **change(mesh)) for mesh in scene.meshes))


def _coordinates(rng: Random, scene: Scene, _: bool) -> Scene:
    def far(mesh: Mesh) -> dict[str, Any]:
        if mesh.uvs is None or rng.random() < 0.5:
            return {}
        largest = float(np.abs(mesh.uvs[np.isfinite(mesh.uvs)]).max(initial=1.0))
        with np.errstate(over="ignore"):
            return {"uvs": mesh.uvs * min(10.0 ** rng.uniform(0, 9), 1e9 / largest)}

    return _changed(scene, far)


def _linear_map(rng: Random, double: bool) -> Floats:
    """Return a singular, mirrored, sheared or nearly singular matrix (3, 3); without `double`, with powers of two
    only."""
    if not double:
        powers = 2.0 ** rng.integers(-2, 3, 3) * rng.choice((-1.0, 1.0), 3) * (rng.random(3) < 0.7)
        return np.diag(powers)[rng.permutation(3)]
    left, right = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
    sizes = rng.uniform(0.2, 2.0, 3)
    how = rng.integers(4)
    if how == 0:
        sizes[: rng.integers(1, 4)] = 0.0  # flattened to a plane, a line or a point
    elif how == 1:
        sizes[0] *= 10.0 ** rng.uniform(-15, -2)
    elif how == 2:
        sizes[0] *= -1.0
    matrix: Floats = (left * sizes) @ right
    return matrix


def _placements(rng: Random, scene: Scene, double: bool) -> Scene:
    """Replace placements by linear maps about the mesh's center. The first mesh stays: it decides the program."""

    def placed(mesh: Mesh) -> dict[str, Any]:
        if mesh is scene.meshes[0] or not len(mesh.verts) or rng.random() < 0.5:
            return {}
        matrices = np.array(mesh.instances)
        for matrix in matrices:
            linear = _linear_map(rng, double)
            middle = world_vertices(mesh.verts, matrix).mean(axis=0) if double else np.zeros(3)
            matrix[:3, 3] = middle + linear @ (matrix[:3, 3] - middle)
            matrix[:3, :3] = linear @ matrix[:3, :3]
        return {"instances": matrices}

    return _changed(scene, placed)


def _normals(rng: Random, scene: Scene, _: bool) -> Scene:
    """Add normals of lengths from 1e-30 to 1e30, also within one mesh; some almost opposite to their neighbors'."""

    def lengths(mesh: Mesh) -> dict[str, Any]:
        if mesh.normals is None:
            return {}
        normals = mesh.normals / np.maximum(np.abs(mesh.normals).max(axis=1, keepdims=True), 1e-300)
        if rng.random() < 0.3 and len(normals) > 1:
            normals[1::2] = -normals[: len(normals[1::2]) * 2 : 2] + 10.0 ** rng.uniform(-6, -1) * rng.normal(size=3)
        count = len(normals) if rng.random() < 0.5 else 1
        return {"normals": normals * 10.0 ** rng.uniform(-30, 30, (count, 1))}

    return _changed(scene, lengths)


def _camera(rng: Random, scene: Scene, _: bool) -> Scene:
    """Move the principal point far outside, and give the image plane any aspect."""
    camera = scene.camera
    plane = np.array(camera.plane) * 10.0 ** (rng.uniform(-3, 3, 2) if rng.random() < 0.5 else np.zeros(2))
    principal = rng.uniform(-4.0, 5.0, 2) if rng.random() < 0.7 else camera.principal
    return replace(scene, camera=replace(camera, plane=tuple(plane), principal=tuple(principal)))


def _thin(rng: Random, scene: Scene, _: bool) -> Scene:
    count = int(rng.integers(1, 200))
    return replace(scene, camera=scene.camera.with_resolution((1, count) if rng.random() < 0.5 else (count, 1)))


def _lights(rng: Random, scene: Scene, _: bool) -> Scene:
    """Put lights at the eye, at a vertex, and 1e-9 to 0.3 of a face's size away from the face."""

    def moved(light: Light) -> Light:
        if isinstance(light, DirectionalLight):
            return light
        where = rng.random()
        if where < 0.3:
            return replace(light, position=scene.camera.eye.copy())
        filled = [mesh for mesh in scene.meshes if len(mesh.faces)]
        mesh = filled[rng.integers(len(filled))]
        matrix = np.asarray(mesh.instances)[rng.integers(len(np.asarray(mesh.instances)))]
        corners = world_vertices(mesh.verts, matrix)[mesh.faces[rng.integers(len(mesh.faces))]]
        if where < 0.5:
            return replace(light, position=corners[rng.integers(3)])
        inside = rng.dirichlet(np.ones(3)) @ corners
        size = float(np.abs(corners - inside).max())
        away = rng.normal(size=3) * size * 10.0 ** rng.uniform(-9, -0.5)
        return replace(light, position=inside + away)

    return replace(scene, lights=tuple(moved(light) if rng.random() < 0.5 else light for light in scene.lights))


def _colors(rng: Random, scene: Scene, _: bool) -> Scene:
    def bright(mesh: Mesh) -> dict[str, Any]:
        if mesh.colors is None:
            return {}
        return {"colors": mesh.colors * 10.0 ** rng.uniform(0, 4) * (rng.random(mesh.colors.shape) < 0.9)}

    return _changed(scene, bright)


EXTREMES = (_coordinates, _placements, _normals, _camera, _thin, _lights, _colors)


# Coincidences


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
