"""The scene as flat tables with one row per face, in the scene's face order: mesh, then instance, then face."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ..base.arrays import Bools, Floats, Integers, Reals
from ..scene.model import Mesh, Scene, Settings, Texture
from ..scene.scalar_colors import at_corners
from .normals import placed_normal_errors, placed_normals, vertex_normal_errors, vertex_normals
from .texture import bilerp, brightest, levels, trilinear
from .transform import mirrors, world_vertices

MOST_UV = 2.0**40  # beyond 2^24 float32 no longer distinguishes texels


@dataclass(frozen=True, eq=False)
class Corners:
    """Attributes at the corners of each of F faces.

    world: (F, 3, 3) positions. normals: (F, 3, 3), unit or 0, world space. normal_error: (F,) how much rounding in float64
    may change the worst of them. colors: (F, 3, 3) vertex colors, white if the mesh has none. uvs: (F, 3, 2), `usable_uvs`,
    0 if the mesh has none. scalars: (F, 3), NaN if the mesh has none. mesh: (F,) index into scene.meshes.
    """

    world: Floats
    normals: Floats
    normal_error: Floats
    colors: Floats
    uvs: Floats
    scalars: Floats
    mesh: Integers


def _placed(mesh: Mesh, matrix: Floats, compute_normals: bool) -> tuple[Floats, Floats, Floats]:
    """Return positions (F, 3, 3), normals (F, 3, 3) and their errors (F,) of a mesh's faces."""
    verts = world_vertices(mesh.verts, matrix)
    if mesh.normals is None or compute_normals:
        normals = vertex_normals(verts, mesh.faces)[mesh.faces]
        errors = vertex_normal_errors(verts, mesh.faces)[mesh.faces].max(axis=1)
        if mirrors(matrix):
            normals = -normals
    else:
        used = mesh.faces if mesh.normal_faces is None else mesh.normal_faces
        normals = placed_normals(mesh.normals, matrix)[used]
        errors = placed_normal_errors(mesh.normals, matrix)[used].max(axis=1, initial=0.0)
    return verts[mesh.faces], normals, errors


def usable_uvs(uvs: Reals) -> Floats:
    """Return texture coordinates in float64, with NaN and infinity replaced by 0, clamped to MOST_UV."""
    return np.clip(np.where(np.isfinite(uvs), uvs, 0.0), -MOST_UV, MOST_UV).astype(np.float64)


def gather(scene: Scene, scalars: str | None = None) -> Corners:
    """Return all faces of a scene, instances placed. Scenes of the preset `course` always have their normals computed.
    scalars: the name of those to gather."""
    world, normals, errors, colors, uvs, numbers, owner = [], [], [], [], [], [], []
    for index, mesh in enumerate(scene.meshes):
        count = len(mesh.faces)
        mesh_colors = np.ones((count, 3, 3)) if mesh.colors is None else mesh.colors[mesh.faces].astype(np.float64)
        if mesh.uvs is None:
            mesh_uvs = np.zeros((count, 3, 2))
        else:
            mesh_uvs = usable_uvs(mesh.uvs)[mesh.faces if mesh.uv_faces is None else mesh.uv_faces]
        mesh_scalars = at_corners(mesh, scalars) if scalars in mesh.scalars else np.full((count, 3), np.nan)
        for matrix in np.asarray(mesh.instances):
            placed, placed_normal, normal_error = _placed(mesh, matrix, scene.preset == "course")
            # A placement that mirrors reverses the winding: what was the front stays the front.
            turned = [0, 2, 1] if mirrors(matrix) else slice(None)
            world.append(placed[:, turned])
            normals.append(placed_normal[:, turned])
            errors.append(normal_error)
            colors.append(mesh_colors[:, turned])
            uvs.append(mesh_uvs[:, turned])
            numbers.append(mesh_scalars[:, turned])
            owner.append(np.full(count, index))
    empty = np.zeros((0, 3, 3))
    return Corners(
        np.concatenate([empty, *world]),
        np.concatenate([empty, *normals]),
        np.concatenate([np.zeros(0), *errors]),
        np.concatenate([empty, *colors]),
        np.concatenate([np.zeros((0, 3, 2)), *uvs]),
        np.concatenate([np.zeros((0, 3)), *numbers]),
        np.concatenate([np.zeros(0, np.int64), *owner]),
    )


def from_first(weights: Floats, uvs: Floats) -> Floats:
    """Interpolate texture coordinates (K, 3, 2) at corner weights (K, 3), relative to the first corner: (K, 2)."""
    difference: Floats = (weights[:, 1:, None] * (uvs[:, 1:] - uvs[:, :1])).sum(axis=1)
    return difference


def interpolated(weights: Floats, uvs: Floats) -> Floats:
    """Interpolate texture coordinates (K, 3, 2) at corner weights (K, 3) whose sum is 1: (K, 2).

    Relative to the first corner, as weighted means of large coordinates that differ by little would lose the difference.
    """
    return uvs[:, 0] + from_first(weights, uvs)


def alpha_passes(scene: Scene, corners: Corners, face: Integers, weights: Floats) -> Bools:
    """Return (K,) bool: where the texture's alpha on faces (K,), at corner weights (K, 3), reaches the material's
    cutoff."""
    passes = np.ones(len(face), bool)
    for index in np.unique(corners.mesh[face]):
        mesh = scene.meshes[index]
        texture = mesh.material.texture
        if not textured(mesh) or mesh.material.alpha_cutoff is None or texture.image.shape[2] < 4:
            continue
        mine = np.flatnonzero(corners.mesh[face] == index)
        uv = interpolated(weights[mine], corners.uvs[face[mine]])
        alpha = bilerp(uv, texture.image[..., 3:], texture.lookup, texture.wrap)[:, 0]
        passes[mine] = alpha >= mesh.material.alpha_cutoff
    return passes


def textured(mesh: Mesh) -> bool:
    """Return whether there is a texture to look up; without texture coordinates there is not."""
    return mesh.material.texture is not None and mesh.uvs is not None


def corner_colors(scene: Scene, settings: Settings, corners: Corners, face: Integers) -> Floats:
    """Return colors at the corners of faces `face` (U,): (U, 3, 3).

    With texture_at=vertex the texel replaces (course lookup) or multiplies the vertex color; with texture_at=pixel a
    course texture leaves white, to be multiplied by the texel later.
    """
    colors: Floats = corners.colors[face].copy()
    for index in np.unique(corners.mesh[face]):
        mesh = scene.meshes[index]
        mine = corners.mesh[face] == index
        if not textured(mesh):
            colors[mine] = colors[mine] * mesh.material.color
            continue
        texture = mesh.material.texture
        if texture.lookup == "course":
            colors[mine] = 1.0
        colors[mine] = colors[mine] * mesh.material.color
        if settings.texture_at == "vertex":
            uv = corners.uvs[face[mine]]
            colors[mine] = colors[mine] * bilerp(uv, texture.image[..., :3], texture.lookup, texture.wrap)
    return colors


@dataclass(frozen=True, eq=False)
class Texels:
    """Texels of pixels, (K, 3) each: the color, and the largest magnitude among the texels it is a mean of."""

    color: Floats
    most: Floats


_mipmaps: WeakKeyDictionary[Texture, list[Reals]] = WeakKeyDictionary()


def mipmap_of(texture: Texture) -> list[Reals]:
    """Return the levels of a texture without its alpha; kept as long as the texture lives."""
    if texture not in _mipmaps:
        _mipmaps[texture] = levels(texture.image[..., :3])
    return _mipmaps[texture]


def texels(
    scene: Scene,
    settings: Settings,
    corners: Corners,
    face: Integers,
    weights: Floats,
    steps: tuple[Floats, Floats] | None,
) -> Texels:
    """Return texels of pixels on faces `face` (K,) at corner weights (K, 3), 1 where none is looked up per pixel.

    steps: derivatives of the weights from pixel to pixel, to the right and up, (K, 3) each; None with texture_filter
    bilinear.
    """
    found = Texels(np.ones((len(face), 3)), np.ones((len(face), 3)))
    if settings.texture_at == "vertex":
        return found
    for index in np.unique(corners.mesh[face]):
        mesh = scene.meshes[index]
        if not textured(mesh):
            continue
        texture = mesh.material.texture
        mine = np.flatnonzero(corners.mesh[face] == index)
        corner_uvs = corners.uvs[face[mine]]
        uv = interpolated(weights[mine], corner_uvs)
        if steps is not None and texture.lookup == "standard":
            with np.errstate(invalid="ignore", over="ignore"):
                right, up = (from_first(step[mine], corner_uvs) for step in steps)
            found.color[mine], found.most[mine] = trilinear(uv, right, up, mipmap_of(texture), texture.wrap)
            continue
        looked_up = uv, texture.image[..., :3], texture.lookup, texture.wrap
        found.color[mine], found.most[mine] = bilerp(*looked_up), brightest(*looked_up)
    return found
