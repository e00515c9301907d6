"""A scene of one mesh as arrays for other renderers: float32, one index for all attributes of a vertex."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....base.arrays import Array, Floats, Integers
from ....errors import InputError
from ....scene.camera import Camera
from ....scene.geometry import camera_axes, vertex_normals
from ....scene.model import Material, Scene


class MeshArrays(NamedTuple):
    """Vertex attributes and faces.

    verts, normals (unit or 0), colors: (V, 3) float32, world space, linear RGB. uvs: (V, 2) float32 or None.
    faces: (F, 3) int32, into all of them.
    """

    verts: Array
    normals: Array
    colors: Array
    uvs: Array | None
    faces: Array
    material: Material


def mesh_arrays(scene: Scene) -> MeshArrays:
    """Convert a scene. Raises InputError unless it is one mesh without placements, with one material, lit on its
    front."""
    mesh = scene.meshes[0] if len(scene.meshes) == 1 else None
    if mesh is None or not np.array_equal(mesh.instances, np.eye(4)[None]) or mesh.material.two_sided:
        raise InputError(f"bench: scene {scene.name!r}: expected one mesh in its own place, lit from one side")
    normals = vertex_normals(mesh.verts, mesh.faces) if mesh.normals is None else mesh.normals
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    colors = np.ones_like(mesh.verts) if mesh.colors is None else mesh.colors
    colors = colors * mesh.material.color
    uvs = mesh.uvs if mesh.material.texture is not None else None
    indices = [mesh.faces, mesh.faces if mesh.normal_faces is None else mesh.normal_faces]
    if uvs is not None:
        indices.append(mesh.faces if mesh.uv_faces is None else mesh.uv_faces)
    faces: Integers = mesh.faces
    at = np.arange(len(mesh.verts))
    own = [at] * len(indices)
    if any(each is not mesh.faces for each in indices):
        corners = np.stack([each.reshape(-1) for each in indices], axis=1)
        unique, inverse = np.unique(corners, axis=0, return_inverse=True)
        faces, own = inverse.reshape(-1, 3), list(unique.T)
    verts, normals, colors = mesh.verts[own[0]], normals[own[1]], colors[own[0]]
    return MeshArrays(
        _float32(verts),
        _float32(normals),
        _float32(colors),
        None if uvs is None else _float32(uvs[own[2]]),
        np.ascontiguousarray(faces, np.int32),
        mesh.material,
    )


def _float32(table: Array) -> Array:
    return np.ascontiguousarray(table, np.float32)


def view_axes(camera: Camera) -> tuple[Array, Array]:
    """Return the camera's axes as rows (3, 3), and the scale (2,) from x/z and y/z to image coordinates in [-1, 1]."""
    height, width = camera.plane
    return camera_axes(camera), np.array([2.0 * camera.focal / width, 2.0 * camera.focal / height])


def depths(verts: Array, camera: Camera) -> Floats:
    """Return the camera z (V,) of positions (V, 3). Raises InputError if one is not in front of the eye."""
    z = (verts - camera.eye) @ camera_axes(camera)[2]
    if z.min(initial=1.0) <= 0.0:
        raise InputError("bench: scene: expected all of it before the eye, for peers clip nothing")
    found: Floats = z
    return found
