"""The course's renderer in plain Python: triangles painted back to front, scanline by scanline, each pixel lit by itself.

It is written as the course teaches it: array operations for the vertices, a loop over triangles, scanlines and pixels, NumPy
for 3-vectors. Nothing is snapped, so pixels on the triangles' edges may be others than in preset `course`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from clshade.base.arrays import Array, Floats
from clshade.scene.camera import Camera
from clshade.scene.geometry import camera_axes, vertex_normals
from clshade.scene.model import Scene

Lights = list[tuple[Array, Array]]  # position and intensity of each
LightArguments = tuple[Array, Array, Array, Array, float, Lights]  # arguments of `light` from `eye` on


def project(points: Array, camera: Camera) -> tuple[Array, Array]:
    """Return image coordinates (V, 2) and depths (V,) of world positions (V, 3)."""
    x, y, z = camera_axes(camera) @ (points - camera.eye).T
    (height, width), (columns, rows) = camera.plane, camera.resolution
    u = (camera.focal * x / (z * width) + 0.5) * columns
    v = (camera.focal * y / (z * height) + 0.5) * rows
    return np.stack([u, v], axis=1), z


def light(
    point: Array, normal: Array, color: Array, eye: Array, k_a: Array, k_d: Array, k_s: Array, n: float, lights: Lights
) -> Floats:
    """Evaluate the Phong model at one point, (3,). k_a includes the ambient intensity."""
    result: Floats = k_a.copy()
    to_eye = eye - point
    to_eye = to_eye / np.linalg.norm(to_eye)
    for position, intensity in lights:
        to_light = position - point
        to_light = to_light / np.linalg.norm(to_light)
        cosine = np.dot(normal, to_light)
        if cosine > 0.0:
            result += intensity * color * k_d * cosine
            mirrored = 2.0 * cosine * normal - to_light
            towards = np.dot(mirrored, to_eye)
            if towards > 0.0:
                result += intensity * color * k_s * towards**n
    return result


def _spans(corners: Array, columns: int, rows: int) -> Iterator[tuple[int, int, int, float, float, Floats, Floats]]:
    """Yield the scanlines of a triangle (3, 2): row, first and last column, the positions of the left and right end,
    and the corners' weights (2, 3) there."""
    v = corners[:, 1]
    for row in range(max(math.ceil(v.min() - 0.5), 0), min(math.floor(v.max() - 0.5), rows - 1) + 1):
        crossings = []
        for i in range(3):
            j = (i + 1) % 3
            if (corners[i, 1] <= row + 0.5) != (corners[j, 1] <= row + 0.5):
                t = (row + 0.5 - corners[i, 1]) / (corners[j, 1] - corners[i, 1])
                weights = np.zeros(3)
                weights[i], weights[j] = 1.0 - t, t
                crossings.append((corners[i, 0] + t * (corners[j, 0] - corners[i, 0]), weights))
        if len(crossings) == 2:
            (left, from_weights), (right, to_weights) = sorted(crossings, key=lambda crossing: crossing[0])
            first, last = max(math.ceil(left - 0.5), 0), min(math.floor(right - 0.5), columns - 1)
            yield row, first, last, left, right, from_weights, to_weights


def _shade_phong(
    image: Array, corners: Array, normals: Array, colors: Array, center: Array, light_arguments: LightArguments
) -> None:
    rows, columns = image.shape[:2]
    for row, first, last, left, right, from_weights, to_weights in _spans(corners, columns, rows):
        from_normal, to_normal = from_weights @ normals, to_weights @ normals
        from_color, to_color = from_weights @ colors, to_weights @ colors
        for column in range(first, last + 1):
            t = (column + 0.5 - left) / (right - left) if right > left else 0.0
            normal = from_normal + t * (to_normal - from_normal)
            length = np.linalg.norm(normal)
            color = from_color + t * (to_color - from_color)
            image[row, column] = light(center, normal / length if length else normal, color, *light_arguments)


def _shade_gouraud(
    image: Array, corners: Array, normals: Array, colors: Array, center: Array, light_arguments: LightArguments
) -> None:
    rows, columns = image.shape[:2]
    lit = np.array([light(center, normals[k], colors[k], *light_arguments) for k in range(3)])
    for row, first, last, left, right, from_weights, to_weights in _spans(corners, columns, rows):
        from_color, to_color = from_weights @ lit, to_weights @ lit
        for column in range(first, last + 1):
            t = (column + 0.5 - left) / (right - left) if right > left else 0.0
            image[row, column] = from_color + t * (to_color - from_color)


def render(scene: Scene, shader: str) -> Array:
    """Render a course scene of one mesh without texture, lit by points, by shader gouraud or phong.

    Returns (M, N, 3) float64, row 0 at the BOTTOM.
    """
    (mesh,), camera = scene.meshes, scene.camera
    material, verts = mesh.material, mesh.verts.astype(np.float64)
    colors, normals = mesh.colors.astype(np.float64), vertex_normals(verts, mesh.faces)
    positions, depths = project(verts, camera)
    lights = [(source.position, source.intensity) for source in scene.lights]
    light_arguments = (camera.eye, material.ka * scene.ambient, material.kd, material.ks, material.n, lights)
    columns, rows = camera.resolution
    image = np.tile(scene.background, (rows, columns, 1))
    shade = _shade_phong if shader == "phong" else _shade_gouraud
    for face in mesh.faces[np.argsort(-depths[mesh.faces].mean(axis=1), kind="stable")]:
        shade(image, positions[face], normals[face], colors[face], verts[face].mean(axis=0), light_arguments)
    return image
