"""The scene as flat tables with one row per face, in the scene's face order: mesh, then instance, then face."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers, Reals
from ..scene.model import Mesh, Scene, Settings, Texture
from ..scene.scalar_colors import at_corners
from .normals import placed_normal_errors, placed_normals, vertex_normal_errors, vertex_normals
from .tangents import corner_tangents
from .texture import bilerp, brightest, levels, spread, trilinear
from .transform import mirroring, world_vertices
from .vectors import cross, length, power_of_two, unit

MOST_BEND, THINNEST = 0.25, 2.0**-20
FACES = 1 << 14  # placed at a time
MOST_UV = 2.0**40  # beyond 2^24 float32 no longer distinguishes texels


@dataclass(frozen=True, eq=False)
class Corners:
    """Attributes at the corners of each of F faces.

    world: (F, 3, 3) positions. normals: (F, 3, 3), unit or 0, world space. normal_error: (F,) how much rounding in float64
    may change the worst of them. colors: (F, 3, 3) vertex colors, white if the mesh has none. uvs: (F, 3, 2), `usable_uvs`,
    0 if the mesh has none. scalars: (F, 3), NaN if the mesh has none. mesh: (F,) index into scene.meshes.
    tangents: (F, 3, 4) of faces with a normal map, in world space: unit or 0, and the side of the bitangent; 0 for others.
    more_uvs: of each further set of texture coordinates as uvs.
    alphas: (F, 3) of the vertices. bends: (F, 3), see `placed_bends`.
    """

    world: Floats
    normals: Floats
    normal_error: Floats
    colors: Floats
    uvs: Floats
    scalars: Floats
    mesh: Integers
    tangents: Floats
    more_uvs: tuple[Floats, ...]
    alphas: Floats
    bends: Floats

    def uvs_for(self, texture: Texture) -> Floats:
        """Return the texture coordinates (F, 3, 2) at which a texture is looked up."""
        return (self.uvs, *self.more_uvs)[texture.coordinates]


def _own_normals(mesh: Mesh, compute: bool) -> tuple[Reals, Floats, Integers]:
    """Return the normals (K, 3) of a mesh in object space, how far two computations of them may differ, (K,), and their
    indices (F, 3)."""
    if mesh.normals is None or compute:
        return vertex_normals(mesh.verts, mesh.faces), vertex_normal_errors(mesh.verts, mesh.faces), mesh.faces
    return mesh.normals, np.zeros(len(mesh.normals)), mesh.faces if mesh.normal_faces is None else mesh.normal_faces


def placed_bends(world: Floats, normals: Floats, index: Integers) -> Floats:
    """Return at the corners of faces (F, 3) the sine of the largest angle between the normal there, (F, 3, 3), and any face
    that has the same one, by index (F, 3), at most MOST_BEND. Faces of an angle below THINNEST at the first corner do not
    count."""
    one, other = world[:, 1] - world[:, 0], world[:, 2] - world[:, 0]
    faces = unit(cross(unit(one), unit(other)))
    thin = length(cross(unit(one), unit(other))) <= THINNEST
    sines = np.where(thin[:, None], 0.0, np.minimum(length(cross(normals, faces[:, None])), MOST_BEND))
    largest = np.zeros(int(index.max(initial=-1)) + 1)
    np.maximum.at(largest, index.reshape(-1), sines.reshape(-1))
    return largest[index]


def usable_uvs(uvs: Reals) -> Floats:
    """Return texture coordinates in float64, with NaN and infinity replaced by 0, clamped to MOST_UV."""
    return np.clip(np.where(np.isfinite(uvs), uvs, 0.0), -MOST_UV, MOST_UV).astype(np.float64)


_tangents: WeakKeyDictionary[Mesh, Floats] = WeakKeyDictionary()


def own_tangents(mesh: Mesh) -> Floats:
    """Return the tangents (F, 3, 4) at the corners of a mesh in object space: its own, or computed; kept as long as the mesh
    lives."""
    texture = mesh.material.microfacets.normal_texture
    if texture is None or mesh.uvs is None or texture.coordinates > len(mesh.more_uvs):
        return np.zeros((len(mesh.faces), 3, 4))
    if mesh.tangents is not None:
        return np.asarray(mesh.tangents, np.float64)[mesh.faces if mesh.tangent_faces is None else mesh.tangent_faces]
    if mesh not in _tangents:
        if mesh.normals is None:
            normals = vertex_normals(mesh.verts, mesh.faces)[mesh.faces]
        else:
            normals = unit(np.asarray(mesh.normals, np.float64))
            normals = normals[mesh.faces if mesh.normal_faces is None else mesh.normal_faces]
        uvs = usable_uvs((mesh.uvs, *mesh.more_uvs)[texture.coordinates])
        uvs = uvs[mesh.faces if mesh.uv_faces is None else mesh.uv_faces]
        _tangents[mesh] = corner_tangents(np.asarray(mesh.verts, np.float64)[mesh.faces], normals, uvs)
    return _tangents[mesh]


def placed_tangents(tangents: Floats, matrices: Floats) -> Floats:
    """Place tangents (F, 3, 4) by placements (K, 4, 4): (K, F, 3, 4). Where a placement mirrors, normal, tangent and
    bitangent change from a right-handed to a left-handed system, or back."""
    placed = np.zeros((len(matrices), *tangents.shape))
    if not tangents.any():
        return placed
    scale = power_of_two(np.abs(matrices[:, :3, :3]).max(axis=1))[:, None, None]
    placed[..., :3] = unit(unit(tangents[..., :3]) @ np.swapaxes(matrices[:, :3, :3] / scale, 1, 2)[:, None])
    side = np.where(tangents[..., 3] < 0.0, -1.0, 1.0) * np.where(mirroring(matrices), -1.0, 1.0)[:, None, None]
    placed[..., 3] = np.where(placed[..., :3].any(axis=-1), side, 0.0)
    return placed


def _of_copies(rows: Array, mirrored: Bools) -> Array:
    """Return what belongs to the corners of the faces of K copies of a mesh, (K F, 3, ...), of rows for each copy, (K, F, 3,
    ...), or for all, (F, 3, ...) in an array of one. A placement that mirrors reverses the winding: what was the front stays
    the front."""
    each = np.broadcast_to(rows, (len(mirrored), *rows.shape[1:]))
    turned = mirrored.reshape(-1, *[1] * (rows.ndim - 1))
    return np.where(turned, each[:, :, [0, 2, 1]], each).reshape(-1, *rows.shape[2:])


def gather(scene: Scene, scalars: str | None = None, *, bent: bool = False) -> Corners:
    """Return all faces of a scene, instances placed. Scenes of the preset `course` always have their normals computed.
    scalars: the name of those to gather. bent: whether bends are needed; else they are 0."""
    world, normals, errors, colors, uvs, numbers, owner, alphas = [], [], [], [], [], [], [], []
    bends: list[Floats] = []
    tangents: list[Floats] = []
    sets = max((len(mesh.more_uvs) for mesh in scene.meshes), default=0)
    more: list[list[Floats]] = [[] for _ in range(sets)]
    for index, mesh in enumerate(scene.meshes):
        count = len(mesh.faces)
        mesh_colors = np.ones((count, 3, 3)) if mesh.colors is None else mesh.colors[mesh.faces].astype(np.float64)
        if mesh.uvs is None:
            mesh_uvs = np.zeros((count, 3, 2))
        else:
            mesh_uvs = usable_uvs(mesh.uvs)[mesh.faces if mesh.uv_faces is None else mesh.uv_faces]
        uv_faces = mesh.faces if mesh.uv_faces is None else mesh.uv_faces
        mesh_more = [usable_uvs(each)[uv_faces] for each in mesh.more_uvs]
        mesh_more += [np.zeros((count, 3, 2))] * (sets - len(mesh_more))
        mesh_tangents = own_tangents(mesh)
        mesh_alphas = np.ones((count, 3)) if mesh.alphas is None else mesh.alphas[mesh.faces].astype(np.float64)
        mesh_scalars = at_corners(mesh, scalars) if scalars in mesh.scalars else np.full((count, 3), np.nan)
        own, own_errors, index_of = _own_normals(mesh, scene.preset == "course")
        placements = np.asarray(mesh.instances)
        many = max(1, FACES // max(count, 1))
        for first in range(0, len(placements), many):
            matrices = placements[first : first + many]
            mirrored = mirroring(matrices)
            placed = world_vertices(mesh.verts, matrices)[:, mesh.faces]
            placed_normal = placed_normals(own, matrices)[:, index_of]
            of_faces = np.zeros((len(matrices), count, 3))
            if bent:
                pairs = zip(placed, placed_normal, strict=True)
                of_faces = np.stack([placed_bends(points, each, index_of) for points, each in pairs])
            world.append(_of_copies(placed, mirrored))
            normals.append(_of_copies(placed_normal, mirrored))
            own_error = placed_normal_errors(own, matrices, own_errors)[:, index_of]
            errors.append(own_error.max(axis=2, initial=0.0).reshape(-1))
            bends.append(_of_copies(of_faces, mirrored))
            colors.append(_of_copies(mesh_colors[None], mirrored))
            uvs.append(_of_copies(mesh_uvs[None], mirrored))
            numbers.append(_of_copies(mesh_scalars[None], mirrored))
            owner.append(np.full(len(matrices) * count, index))
            tangents.append(_of_copies(placed_tangents(mesh_tangents, matrices), mirrored))
            for parts, part in zip(more, mesh_more, strict=True):
                parts.append(_of_copies(part[None], mirrored))
            alphas.append(_of_copies(mesh_alphas[None], mirrored))
    empty = np.zeros((0, 3, 3))
    return Corners(
        np.concatenate([empty, *world]),
        np.concatenate([empty, *normals]),
        np.concatenate([np.zeros(0), *errors]),
        np.concatenate([empty, *colors]),
        np.concatenate([np.zeros((0, 3, 2)), *uvs]),
        np.concatenate([np.zeros((0, 3)), *numbers]),
        np.concatenate([np.zeros(0, np.int64), *owner]),
        np.concatenate([np.zeros((0, 3, 4)), *tangents]),
        tuple(np.concatenate([np.zeros((0, 3, 2)), *parts]) for parts in more),
        np.concatenate([np.zeros((0, 3)), *alphas]),
        np.concatenate([np.zeros((0, 3)), *bends]),
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


def textured(mesh: Mesh) -> bool:
    """Return whether there is a texture to look up; without texture coordinates there is not."""
    return mesh.material.texture is not None and mesh.uvs is not None


def lookup_of(texture: Texture) -> str:
    """Return the lookup of `texture.bilerp`: the texture's own, or `nearest`."""
    return "nearest" if texture.filter == "nearest" else texture.lookup


def uv_slack(settings: Settings, uvs: Floats, condition: Floats, size: tuple[int, int]) -> Floats:
    """Return how far interpolated texture coordinates may be off, (K, 2), with those of the corners (K, 3, 2), `condition`
    (K,) of `shade_pixels`, and a texture of `size` columns and rows.

    In float32 they are accurate to 2^-42 of the largest one at a corner, with another 2^-25 of a texel from planes
    (kernels/texture.clh), twice that with the oracle's own. Rounding of positions in float64 counts as for the weights,
    76 * 2^-53.
    """
    own, of_texel = (0.0, 0.0) if settings.precision == "float64" else (2.0**-41, 2.0**-24)
    most: Floats = np.abs(uvs).max(axis=(1, 2)) * np.maximum(own, 76.0 * 2.0**-53 * condition)
    return most[:, None] + of_texel / np.array(size)


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
            uv = corners.uvs_for(texture)[face[mine]]
            colors[mine] = colors[mine] * bilerp(uv, texture.image[..., :3], texture.lookup, texture.wrap)
    return colors


@dataclass(frozen=True, eq=False)
class Texels:
    """Texels of pixels, (K, 3) each: the color; the largest magnitude among the texels it is a mean of; and by how much
    rounding may change the color where it is that of the nearest texel. found: (K,) where a texture is looked up. slack:
    (K,) how many texels the place may be off by."""

    color: Floats
    most: Floats
    spread: Floats
    found: Bools
    slack: Floats


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
    condition: Floats,
    textures: Sequence[Texture | None] | None = None,
) -> Texels:
    """Return texels of pixels on faces `face` (K,) at corner weights (K, 3), 1 where none is looked up per pixel.

    steps: derivatives of the weights from pixel to pixel, to the right and up, (K, 3) each; None with texture_filter
    bilinear. condition: (K,), see `uv_slack`. textures: of the meshes, by default those of their materials' colors.
    """
    count, ones = len(face), np.ones((len(face), 3))
    found = Texels(ones, ones.copy(), np.zeros((count, 3)), np.zeros(count, bool), np.zeros(count))
    if textures is None:
        if settings.texture_at == "vertex":
            return found
        textures = [mesh.material.texture for mesh in scene.meshes]
    for index in np.unique(corners.mesh[face]):
        mesh, texture = scene.meshes[index], textures[index]
        if texture is None or mesh.uvs is None or texture.coordinates > len(mesh.more_uvs):
            continue
        mine = np.flatnonzero(corners.mesh[face] == index)
        corner_uvs = corners.uvs_for(texture)[face[mine]]
        uv = interpolated(weights[mine], corner_uvs)
        slack = uv_slack(settings, corner_uvs, condition[mine], texture.image.shape[1::-1])
        found.found[mine], found.slack[mine] = True, (slack * texture.image.shape[1::-1]).max(axis=1)
        lookup, wrap, image = lookup_of(texture), texture.wrap, texture.image[..., :3]
        if steps is not None and texture.lookup == "standard":
            with np.errstate(invalid="ignore", over="ignore"):
                right, up = (from_first(step[mine], corner_uvs) for step in steps)
            looked_up = trilinear(uv, right, up, mipmap_of(texture), lookup, wrap, slack)
            found.color[mine], found.most[mine], found.spread[mine] = looked_up
            continue
        found.color[mine], found.most[mine] = bilerp(uv, image, lookup, wrap), brightest(uv, image, lookup, wrap)
        if lookup == "nearest":
            found.spread[mine] = spread(uv, image, wrap, slack)
            found.most[mine] += found.spread[mine]
    return found
