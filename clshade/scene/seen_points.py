"""The triangles of a scene in world space, and where the rays of a camera's pixels meet them."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Faces, Floats
from .camera import Camera
from .geometry import camera_axes
from .model import Scene


def triangles(scene: Scene) -> tuple[Floats, Faces]:
    """Return the vertices (V, 3) of all meshes and instances in world space, and the faces (F, 3) in the order in which
    the layer `id` counts them."""
    verts: list[Floats] = [np.zeros((0, 3))]
    faces: list[Faces] = [np.zeros((0, 3), np.int32)]
    count = 0
    for mesh in scene.meshes:
        for placement in np.asarray(mesh.instances):
            placed = mesh.verts.astype(np.float64)
            if (placement != np.eye(4)).any():
                placed = placed @ placement[:3, :3].T + placement[:3, 3]
            verts.append(placed)
            faces.append(mesh.faces + np.int32(count))
            count += len(placed)
    return np.concatenate(verts), np.concatenate(faces)


def pixel_rays(
    camera: Camera, place: tuple[float, float] = (0.5, 0.5), rows: slice = slice(None)
) -> tuple[Floats, Floats]:
    """Return directions and origins, (M, N, 3) each, of rays through pixels, row 0 at the top.

    place: where in the pixel, from its lower left corner. rows: of the image; default: all.
    """
    (height, width), (columns, count) = camera.plane, camera.resolution
    upward = count - 1 - np.arange(count)[rows]
    x = ((np.arange(columns) + place[0]) / columns - camera.principal[0]) * width
    y = ((upward + place[1]) / count - camera.principal[1]) * height
    across, up = np.broadcast_arrays(x, y[:, None])
    axes = camera_axes(camera)
    if camera.orthographic:
        origins = camera.eye + across[..., None] * axes[0] + up[..., None] * axes[1]
        return np.broadcast_to(axes[2], origins.shape), origins
    forward = np.full_like(across, camera.focal)
    rays = np.stack([across, up, forward], axis=-1) @ axes
    return rays, np.broadcast_to(camera.eye, rays.shape)


def face_weights(origins: Floats, rays: Floats, corners: Floats) -> Floats:
    """Return the weights (K, 3) of triangles' corners (K, 3, 3) where rays (K, 3) meet their planes, clamped to the
    triangles."""
    first = corners[:, 0]
    one, other = corners[:, 1] - first, corners[:, 2] - first
    moment = np.cross(origins - first, rays)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        facing = -_dot(np.cross(one, other), rays)
        second, third = _dot(other, moment) / facing, -_dot(one, moment) / facing
    second, third = (np.clip(np.nan_to_num(share), 0.0, 1.0) for share in (second, third))
    beyond = np.maximum(second + third, 1.0)
    second, third = second / beyond, third / beyond
    return np.stack([1.0 - second - third, second, third], axis=1)


def _dot(a: Floats, b: Floats) -> Floats:
    products: Floats = np.einsum("kx,kx->k", a, b)
    return products


def in_image(camera: Camera, offsets: Floats) -> tuple[Floats, Floats]:
    """Return where points are in the image, (K, 2), pixels to the right and down from its top left corner, and their depths
    (K,). offsets: of the points from the eye (K, 3). What is not in front of a perspective camera gets NaN."""
    (height, width), (columns, rows), principal = camera.plane, camera.resolution, camera.principal
    x, y, z = (offsets @ camera_axes(camera).T).T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        lens = 1.0 if camera.orthographic else np.where(z > 0.0, camera.focal / z, np.nan)
        across, up = (x * lens / width + principal[0]) * columns, (y * lens / height + principal[1]) * rows
    return np.stack([across, rows - up], axis=1), z
