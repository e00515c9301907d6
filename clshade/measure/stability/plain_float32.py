"""A naive renderer of one mesh in float32 from world coordinates on, in NumPy: what plain float32 does to a stiff scene."""

from __future__ import annotations

import numpy as np

from ...base.arrays import Array, Floats32
from ...scene.geometry import camera_axes, vertex_normals
from ...scene.model import PointLight, Scene
from .cases.flat import SUB
from .cases.light import unit


def plain_float32(scene: Scene) -> Floats32 | None:
    """Return the image (M, N, 4), with corners on the grid of 1/256 px that the oracle has too; None where corners lie
    behind the eye."""
    mesh, camera = scene.meshes[0], scene.camera
    columns, rows = camera.resolution
    normals = vertex_normals(mesh.verts, mesh.faces) if mesh.normals is None else mesh.normals
    colors = np.ones_like(mesh.verts) if mesh.colors is None else mesh.colors
    attributes = _float32(np.hstack([mesh.verts, normals, colors]))
    seen = (attributes[:, :3] - _float32(camera.eye)) @ _float32(camera_axes(camera)).T
    if seen[:, 2].min() <= 0.0:
        return None
    plane, size = _float32(camera.plane[::-1]), _float32(camera.resolution)
    uv = (_float32(camera.focal) * seen[:, :2] / seen[:, 2:] / plane + np.float32(0.5)) * size
    uv = np.rint(uv * np.float32(SUB)) / np.float32(SUB)
    centers = _float32(np.stack(np.meshgrid(np.arange(columns), np.arange(rows)[::-1]), axis=-1) + 0.5)
    image, nearest = np.zeros((rows, columns, 4), np.float32), np.zeros((rows, columns), np.float32)
    for face in mesh.faces:
        at = uv[face] - centers[..., None, :]
        edges = np.stack([_cross(at[..., i - 2, :], at[..., i - 1, :]) for i in range(3)], axis=-1)
        weights = edges / seen[face, 2]
        total = weights.sum(axis=-1)
        inverse = total / _cross(uv[face[1]] - uv[face[0]], uv[face[2]] - uv[face[0]])
        closer = (edges >= 0.0).all(axis=-1) & (inverse > nearest)
        nearest[closer] = inverse[closer]
        image[closer, :3] = _reflected(scene, (weights[closer] / total[closer, None]) @ attributes[face])
        image[closer, 3] = 1.0
    return image


def _reflected(scene: Scene, points: Array) -> Array:
    """Return the light of points (K, 9): position, normal and color."""
    material = scene.meshes[0].material
    position, normal, color = np.split(points, 3, axis=1)
    normal, to_eye = unit(normal), unit(_float32(scene.camera.eye) - position)
    total = _float32(material.ka * scene.ambient)
    for source in (light for light in scene.lights if isinstance(light, PointLight)):
        to_light = unit(_float32(source.position) - position)
        cosine = (normal * to_light).sum(axis=1, keepdims=True)
        toward = np.maximum(((2.0 * cosine * normal - to_light) * to_eye).sum(axis=1, keepdims=True), 0.0)
        shine = np.where(cosine > 0.0, toward ** np.float32(material.n), 0.0)
        diffuse = _float32(material.kd) * np.maximum(cosine, 0.0)
        total = total + _float32(source.intensity) * (diffuse + _float32(material.ks) * shine)
    return color * total


def _float32(values: object) -> Floats32:
    return np.asarray(values, np.float32)


def _cross(a: Array, b: Array) -> Array:
    product: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
