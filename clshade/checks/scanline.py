"""The course's renderer in plain Python: triangles painted back to front, every pixel of a scanline lit by itself.

This is what speed is compared with, so it is written as the course teaches it: whole arrays at once for the vertices,
a loop over triangles, scanlines and pixels, NumPy for 3-vectors. Its image is that of preset `course` but for pixels on
the triangles' edges: nothing is snapped here. The near plane is not clipped: the whole scene has to lie before the eye.
"""

from __future__ import annotations

import math

import numpy as np

from ..camera import Camera
from ..geometry import camera_axes, vertex_normals
from ..scene import Scene
from ..validation import Array, refuse

Lights = list[tuple[Array, Array]]  # position and intensity of each


def project(points: Array, camera: Camera) -> tuple[Array, Array]:
    """Image coordinates (V, 2) and depths (V,) of world positions (V, 3)."""
    x, y, z = camera_axes(camera) @ (points - camera.eye).T
    (height, width), (columns, rows) = camera.plane, camera.resolution
    u = (camera.focal * x / (z * width) + 0.5) * columns
    v = (camera.focal * y / (z * height) + 0.5) * rows
    return np.stack([u, v], axis=1), z


def light(
    point: Array, normal: Array, color: Array, eye: Array, k_a: Array, k_d: Array, k_s: Array, n: float, lights: Lights
) -> Array:
    """Phong's model at one point, (3,). k_a is multiplied by the ambient intensity already."""
    result = k_a.copy()
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


def _spans(corners: Array, columns: int, rows: int):
    """The scanlines of a triangle (3, 2): row, columns first to last, and there the weights (2, 3) of the corners at
    the scanline's left and right end and the ends' positions."""
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


def _shade_phong(image: Array, corners: Array, normals: Array, colors: Array, center: Array, light_arguments: tuple):
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


def _shade_gouraud(image: Array, corners: Array, normals: Array, colors: Array, center: Array, light_arguments: tuple):
    lit = np.array([light(center, normals[k], colors[k], *light_arguments) for k in range(3)])
    _fill(image, corners, lit)


def _fill(image: Array, corners: Array, colors: Array) -> None:
    rows, columns = image.shape[:2]
    for row, first, last, left, right, from_weights, to_weights in _spans(corners, columns, rows):
        from_color, to_color = from_weights @ colors, to_weights @ colors
        for column in range(first, last + 1):
            t = (column + 0.5 - left) / (right - left) if right > left else 0.0
            image[row, column] = from_color + t * (to_color - from_color)


def render(scene: Scene, shader: str = "phong") -> Array:
    """The image of a course scene of one mesh without texture, (M, N, 3) float64, row 0 at the BOTTOM.

    shader: gouraud, phong or nolight. Raises InputError for a scene that it cannot draw.
    """
    owner = "scanline.render"
    if scene.preset != "course" or len(scene.meshes) != 1 or scene.background is None:
        raise refuse(owner, "scene", "a course scene of one mesh, with a background", scene.name)
    mesh, camera = scene.meshes[0], scene.camera
    material = mesh.material
    if material.texture is not None:
        raise refuse(owner, "material.texture", "none", material.texture.name)
    verts = mesh.verts.astype(np.float64)
    colors = np.ones_like(verts) if mesh.colors is None else mesh.colors.astype(np.float64)
    normals = vertex_normals(verts, mesh.faces)
    positions, depths = project(verts, camera)
    if depths.min(initial=1.0) <= 0.0:
        raise refuse(owner, "verts", "positions before the eye", f"depth {depths.min():g}")
    lights = [(source.position, source.intensity) for source in scene.lights]
    light_arguments = (camera.eye, material.ka * scene.ambient, material.kd, material.ks, material.n, lights)
    columns, rows = camera.resolution
    image = np.tile(scene.background, (rows, columns, 1))
    for face in mesh.faces[np.argsort(-depths[mesh.faces].mean(axis=1), kind="stable")]:
        if shader == "nolight":
            _fill(image, positions[face], colors[face])
            continue
        shade = _shade_phong if shader == "phong" else _shade_gouraud
        shade(image, positions[face], normals[face], colors[face], verts[face].mean(axis=0), light_arguments)
    return image
