"""Extreme values on top of random scenes: coordinates, placements, normals, cameras and lights at their ranges' ends.

None changes the kernel program, except that colors beyond 1 select the one that interpolates them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from random_kinds import Random

from clshade.base.arrays import Floats
from clshade.oracle.transform import world_vertices
from clshade.scene.lights import DirectionalLight
from clshade.scene.model import Light, Mesh, Scene

SHARE = 0.3  # fraction of the scenes that get each extreme


def stiffened(rng: Random, scene: Scene, double: bool, dim: bool) -> Scene:
    """Return the scene with none to all of the extremes below.

    double: whether positions may need float64. dim: whether colors stay within 1.
    """
    for change in EXTREMES:
        if rng.random() < SHARE and not (dim and change is _colors):
            scene = change(rng, scene, double)
    return scene


def _changed(scene: Scene, change: Callable[[Mesh], dict[str, Any]]) -> Scene:
    """Return the scene with fields of its meshes replaced."""
    return replace(scene, meshes=tuple(replace(mesh, **change(mesh)) for mesh in scene.meshes))


def _coordinates(rng: Random, scene: Scene, _: bool) -> Scene:
    """Scale texture coordinates up to 1e9."""

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
    """Make the image one column or one row."""
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
    """Set vertex colors up to 1e4, some channels 0."""

    def bright(mesh: Mesh) -> dict[str, Any]:
        if mesh.colors is None:
            return {}
        return {"colors": mesh.colors * 10.0 ** rng.uniform(0, 4) * (rng.random(mesh.colors.shape) < 0.9)}

    return _changed(scene, bright)


EXTREMES = (_coordinates, _placements, _normals, _camera, _thin, _lights, _colors)
