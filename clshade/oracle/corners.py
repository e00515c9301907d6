"""The scene as flat tables with one row per face, in the scene's face order: mesh, then instance, then face."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers, Reals
from ..scene.model import Mesh, Scene, Texture
from ..scene.scalar_colors import at_corners
from .normals import corner_tangents, placed_normals, vertex_normals
from .transform import cross, length, mirroring, power_of_two, unit, world_vertices

MAX_BEND, THINNEST = 0.25, 2.0**-20
FACES = 1 << 14  # placed at a time
MAX_UV = 2.0**40  # beyond 2^24 float32 no longer distinguishes texels


@dataclass(frozen=True, eq=False)
class Corners:
    """Attributes at the corners of each of F faces.

    world: (F, 3, 3) positions. normals: (F, 3, 3), unit or 0, world space. normal_error: (F,) how much rounding in float64
    may change the worst of them. colors: (F, 3, 3) vertex colors, white if the mesh has none. scalars: (F, 3), NaN if the
    mesh has none. alphas: (F, 3) of the vertices. bends: (F, 3), see `placed_bends`. tangents: (F, 3, 4) of faces with a
    normal map, in world space: unit or 0, and the side of the bitangent; 0 for others. mesh: (F,) index into scene.meshes.
    uvs: (F, 3, 2), `usable_uvs`, 0 if the mesh has none; more_uvs: further sets of texture coordinates.
    """

    scene: Scene
    world: Floats
    normals: Floats
    normal_error: Floats
    colors: Floats
    scalars: Floats
    alphas: Floats
    bends: Floats
    tangents: Floats
    mesh: Integers
    uvs: Floats
    more_uvs: tuple[Floats, ...]

    def uvs_for(self, texture: Texture) -> Floats:
        """Return the texture coordinates (F, 3, 2) at which a texture is looked up."""
        return (self.uvs, *self.more_uvs)[texture.coordinates]

    def of_meshes(self, holds: Callable[[Mesh], bool]) -> Bools:
        """Return (F,) bool: the faces of meshes for which something holds."""
        return np.array([holds(mesh) for mesh in self.scene.meshes], bool)[self.mesh]

    def by_mesh(self, face: Integers) -> Iterator[tuple[Mesh, Integers]]:
        """Yield the meshes of faces (K,), and the indices of their faces among these."""
        for number in np.unique(self.mesh[face]):
            yield self.scene.meshes[number], np.flatnonzero(self.mesh[face] == number)


def placed_bends(world: Floats, normals: Floats, index: Integers) -> Floats:
    """Return at the corners of faces (F, 3) the sine of the largest angle between the normal there, (F, 3, 3), and any face
    that has the same one, by index (F, 3), at most MAX_BEND. Faces of an angle below THINNEST at the first corner do not
    count."""
    one, other = world[:, 1] - world[:, 0], world[:, 2] - world[:, 0]
    product = cross(unit(one), unit(other))
    thin, faces = length(product) <= THINNEST, unit(product)
    sines = np.where(thin[:, None], 0.0, np.minimum(length(cross(normals, faces[:, None])), MAX_BEND))
    largest = np.zeros(int(index.max(initial=-1)) + 1)
    np.maximum.at(largest, index.reshape(-1), sines.reshape(-1))
    return largest[index]


def usable_uvs(uvs: Reals) -> Floats:
    """Return texture coordinates in float64, with NaN and infinity replaced by 0, clamped to MAX_UV."""
    return np.clip(np.where(np.isfinite(uvs), uvs, 0.0), -MAX_UV, MAX_UV).astype(np.float64)


def _uv_sets(mesh: Mesh) -> list[Floats]:
    """Return the sets of texture coordinates at the corners of a mesh, (F, 3, 2) each; the first is 0 without any."""
    faces = mesh.faces if mesh.uv_faces is None else mesh.uv_faces
    first = np.zeros((len(mesh.faces), 3, 2)) if mesh.uvs is None else usable_uvs(mesh.uvs)[faces]
    return [first, *(usable_uvs(uvs)[faces] for uvs in mesh.more_uvs)]


def has_uvs(mesh: Mesh, texture: Texture | None) -> bool:
    """Return whether a mesh has the coordinates at which a texture is looked up."""
    return texture is not None and mesh.uvs is not None and texture.coordinates <= len(mesh.more_uvs)


_tangents: WeakKeyDictionary[Mesh, Floats] = WeakKeyDictionary()


def mesh_tangents(mesh: Mesh) -> Floats:
    """Return the tangents (F, 3, 4) at the corners of a mesh in object space: its own, or computed; kept as long as the
    mesh lives."""
    texture = mesh.material.microfacets.normal_texture
    if texture is None or not has_uvs(mesh, texture):
        return np.zeros((len(mesh.faces), 3, 4))
    if mesh.tangents is not None:
        return np.asarray(mesh.tangents, np.float64)[mesh.faces if mesh.tangent_faces is None else mesh.tangent_faces]
    if mesh not in _tangents:
        normals, _, index = _mesh_normals(mesh, compute=False)
        corners = np.asarray(mesh.verts, np.float64)[mesh.faces]
        normals = normals if mesh.normals is None else unit(np.asarray(normals, np.float64))
        _tangents[mesh] = corner_tangents(
            corners, np.asarray(normals[index], np.float64), _uv_sets(mesh)[texture.coordinates]
        )
    return _tangents[mesh]


def _mesh_normals(mesh: Mesh, compute: bool) -> tuple[Reals, Floats, Integers]:
    """Return the normals (K, 3) of a mesh in object space, how far two computations of them may differ, (K,), and their
    indices (F, 3)."""
    if mesh.normals is None or compute:
        return *vertex_normals(mesh.verts, mesh.faces), mesh.faces
    return mesh.normals, np.zeros(len(mesh.normals)), mesh.faces if mesh.normal_faces is None else mesh.normal_faces


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
    """Return corners of the faces of K copies of a mesh, (K F, 3, ...), from rows for each copy, (K, F, 3, ...), or for
    all, (1, F, 3, ...). A placement that mirrors reverses the winding: what was the front stays the front."""
    copies = np.broadcast_to(rows, (len(mirrored), *rows.shape[1:]))
    turned = mirrored.reshape(-1, *[1] * (rows.ndim - 1))
    return np.where(turned, copies[:, :, [0, 2, 1]], copies).reshape(-1, *rows.shape[2:])


def _placed(mesh: Mesh, computed: bool, scalars: str | None, bent: bool, sets: int) -> Iterator[list[Array]]:
    """Yield the fields of `Corners` but `mesh`, (F, ...), of copies of a mesh; of texture coordinates as many sets."""
    count, placements = len(mesh.faces), np.asarray(mesh.instances)
    uv_sets = _uv_sets(mesh) + [np.zeros((count, 3, 2))] * (sets - 1 - len(mesh.more_uvs))
    colors = np.ones((count, 3, 3)) if mesh.colors is None else mesh.colors[mesh.faces].astype(np.float64)
    values = at_corners(mesh, scalars) if scalars in mesh.scalars else np.full((count, 3), np.nan)
    alphas = np.ones((count, 3)) if mesh.alphas is None else mesh.alphas[mesh.faces].astype(np.float64)
    tangents = mesh_tangents(mesh)
    normals, errors, index = _mesh_normals(mesh, computed)
    many = max(1, FACES // max(count, 1))
    for first in range(0, len(placements), many):
        matrices = placements[first : first + many]
        mirrored = mirroring(matrices)
        world = world_vertices(mesh.verts, matrices)[:, mesh.faces]
        normal, error = (part[:, index] for part in placed_normals(normals, matrices, errors))
        bends = np.zeros((len(matrices), count, 3))
        if bent:
            bends = np.stack([placed_bends(*copy, index) for copy in zip(world, normal, strict=True)])
        constant = (_of_copies(rows[None], mirrored) for rows in (colors, values, alphas))
        yield [
            _of_copies(world, mirrored),
            _of_copies(normal, mirrored),
            error.max(axis=2, initial=0.0).reshape(-1),
            *constant,
            _of_copies(bends, mirrored),
            _of_copies(placed_tangents(tangents, matrices), mirrored),
            *(_of_copies(uvs[None], mirrored) for uvs in uv_sets),
        ]


def gather(scene: Scene, scalars: str | None = None, *, bent: bool = False) -> Corners:
    """Return all faces of a scene, instances placed. Scenes of the preset `course` always have their normals computed.
    scalars: the name of those to gather. bent: whether bends are needed; else they are 0."""
    sets = max((1 + len(mesh.more_uvs) for mesh in scene.meshes), default=1)
    shapes = ((3, 3), (3, 3), (), (3, 3), (3,), (3,), (3,), (3, 4), *[(3, 2)] * sets)
    parts: list[list[Array]] = [[np.zeros((0, *shape)) for shape in shapes]]
    meshes = [np.zeros(0, np.int64)]
    for number, mesh in enumerate(scene.meshes):
        for part in _placed(mesh, scene.preset == "course", scalars, bent, sets):
            parts.append(part)
            meshes.append(np.full(len(part[0]), number))
    attributes: list[Any] = [np.concatenate(rows) for rows in zip(*(part[:8] for part in parts), strict=True)]
    uv_sets = [np.concatenate([part[k] for part in parts]) for k in range(8, 8 + sets)]
    attributes += [np.concatenate(meshes), uv_sets[0], tuple(uv_sets[1:])]
    return Corners(scene, *attributes)


def from_first(weights: Floats, values: Floats) -> Floats:
    """Interpolate values (K, 3, C) at corner weights (K, 3), relative to the first corner: (K, C)."""
    return np.asarray((weights[:, 1:, None] * (values[:, 1:] - values[:, :1])).sum(axis=1))


def interpolated(weights: Floats, values: Floats) -> Floats:
    """Interpolate values (K, 3, C) at corner weights (K, 3) whose sum is 1: (K, C).

    Relative to the first corner, as weighted means of large coordinates that differ by little would lose the difference.
    """
    return values[:, 0] + from_first(weights, values)


def blend(weights: Floats, values: Floats) -> Floats:
    """Return the weighted sums of values (K, 3, C) at corners, in their order: (K, C). weights: (K, 3)."""
    a, b, c = (weights[:, corner, None] * values[:, corner] for corner in range(3))
    return (a + b) + c
