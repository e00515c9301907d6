"""The scene as flat tables with one row per face, in the scene's face order: mesh, then instance, then face. Normals of
vertices, how they are placed, and tangents at the corners of faces as MikkTSpace defines them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers, Reals
from ..scene.model import Mesh, Scene, Texture
from ..scene.scalar_colors import at_corners
from .transform import cross, dot, is_identity, length, mirroring, power_of_two, unit, world_vertices

CANCELED = 2.0**-40  # relative to the sizes of a vertex's faces: a smaller sum has no direction left
MAX_BEND, THINNEST = 0.25, 2.0**-20
FACES = 1 << 14  # placed at a time
MAX_UV = 2.0**40  # beyond 2^24 float32 no longer distinguishes texels


@dataclass(frozen=True, eq=False)
class Corners:
    """Attributes at the corners of each of F faces."""

    scene: Scene
    world: Floats  # (F, 3, 3) positions
    normals: Floats  # (F, 3, 3), unit or 0, world space
    normal_error: Floats  # (F,) how much rounding in float64 may change the worst of them
    colors: Floats  # (F, 3, 3) of the vertices, white if the mesh has none
    scalars: Floats  # (F, 3), NaN if the mesh has none
    alphas: Floats  # (F, 3) of the vertices
    bends: Floats  # (F, 3), see `placed_bends`
    tangents: Floats  # (F, 3, 4), world space: unit or 0, and the side of the bitangent; 0 without a normal map
    mesh: Integers  # (F,) index into scene.meshes
    uv_sets: Floats  # (F, 3, sets, 2), `usable_uvs`, 0 if the mesh has none

    @property
    def uvs(self) -> Floats:
        """The first set of texture coordinates, (F, 3, 2)."""
        return self.uv_sets[:, :, 0]

    def uvs_for(self, texture: Texture) -> Floats:
        """Return the texture coordinates (F, 3, 2) at which a texture is looked up."""
        return self.uv_sets[:, :, texture.coordinates]

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


def _uv_sets(mesh: Mesh, sets: int) -> Floats:
    """Return as many sets of texture coordinates at the corners of a mesh, (F, 3, sets, 2), 0 for those it has not."""
    faces = mesh.faces if mesh.uv_faces is None else mesh.uv_faces
    rows = np.zeros((len(mesh.faces), 3, sets, 2))
    for k, uvs in enumerate((mesh.uvs, *mesh.more_uvs)):
        if uvs is not None:
            rows[:, :, k] = usable_uvs(uvs)[faces]
    return rows


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
        uvs = _uv_sets(mesh, 1 + len(mesh.more_uvs))[:, :, texture.coordinates]
        _tangents[mesh] = corner_tangents(corners, np.asarray(normals[index], np.float64), uvs)
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
    all, (1, F, 3, ...). Winding is reversed by placements that mirror, so that the front stays the front."""
    copies = np.broadcast_to(rows, (len(mirrored), *rows.shape[1:]))
    turned = mirrored.reshape(-1, *[1] * (rows.ndim - 1))
    return np.where(turned, copies[:, :, [0, 2, 1]], copies).reshape(-1, *rows.shape[2:])


def _placed(mesh: Mesh, computed: bool, scalars: str | None, bent: bool, sets: int) -> Iterator[dict[str, Array]]:
    """Yield the fields of `Corners` but `mesh` of copies of a mesh, with so many sets of texture coordinates."""
    count, placements = len(mesh.faces), np.asarray(mesh.instances)
    shared = {
        "colors": np.ones((count, 3, 3)) if mesh.colors is None else mesh.colors[mesh.faces].astype(np.float64),
        "scalars": at_corners(mesh, scalars) if scalars in mesh.scalars else np.full((count, 3), np.nan),
        "alphas": np.ones((count, 3)) if mesh.alphas is None else mesh.alphas[mesh.faces].astype(np.float64),
        "uv_sets": _uv_sets(mesh, sets),
    }
    tangents = mesh_tangents(mesh)
    normals, errors, index = _mesh_normals(mesh, computed)
    many = max(1, FACES // max(count, 1))
    for first in range(0, len(placements), many):
        matrices = placements[first : first + many]
        world = world_vertices(mesh.verts, matrices)[:, mesh.faces]
        normal, error = (part[:, index] for part in placed_normals(normals, matrices, errors))
        bends = np.zeros((len(matrices), count, 3))
        if bent:
            bends = np.stack([placed_bends(*copy, index) for copy in zip(world, normal, strict=True)])
        rows = {"world": world, "normals": normal, "bends": bends, "tangents": placed_tangents(tangents, matrices)}
        rows |= {name: values[None] for name, values in shared.items()}
        mirrored, errors_of_faces = mirroring(matrices), error.max(axis=2, initial=0.0).reshape(-1)
        yield {"normal_error": errors_of_faces} | {name: _of_copies(part, mirrored) for name, part in rows.items()}


def gather(scene: Scene, scalars: str | None = None, *, bent: bool = False) -> Corners:
    """Return all faces of a scene, instances placed. Scenes of the preset `course` always have their normals computed.
    scalars: the name of those to gather. bent: whether bends are needed; else they are 0."""
    meshes = *scene.meshes, Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))  # there may be no others
    sets, computed = max(1 + len(mesh.more_uvs) for mesh in meshes), scene.preset == "course"
    parts = []
    for number, mesh in enumerate(meshes):
        for part in _placed(mesh, computed, scalars, bent, sets):
            parts.append({"mesh": np.full(len(part["world"]), number), **part})
    return Corners(scene, **{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


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


# Normals


def vertex_normals(verts: Reals, faces: Array) -> tuple[Floats, Floats]:
    """Return the normals of a mesh from its shape: at each vertex the sum of its faces' cross products, normalized. Also
    return how far two computations in float64 may differ: (V,), absolute; 0 where there is no normal.

    verts: (V, 3), faces: (F, 3) indices. Normals are (V, 3): unit vectors, or 0 at a vertex that has no face, only faces
    without area, or faces that cancel up to rounding (2^-40 of their sizes). A larger face weighs more: its cross
    product is twice its area.

    A component of a x b is a difference of two products whose factors are rounded differences of coordinates: each
    product is accurate to 3 units of 2^-53, the difference to one more, so the vector to sqrt(2)*3 + 1 < 6 units of
    |a| |b|. That is much more than of |a x b| if a face is a sliver. A sum of m of them rounds m - 1 times. All this
    is relative to the length of the sum, and counts for both sides.
    """
    corners = np.asarray(verts, dtype=np.float64)[faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    scale = power_of_two(np.maximum(np.abs(first), np.abs(second)).max(axis=0, initial=0.0))
    first, second = first / scale, second / scale  # no product overflows
    products = cross(first, second)
    total, areas, sizes, count = np.zeros((len(verts), 3)), *np.zeros((3, len(verts)))
    np.add.at(total, faces, products[:, None, :])
    np.add.at(areas, faces, np.abs(products).sum(axis=1)[:, None])
    np.add.at(sizes, faces, (length(first) * length(second))[:, None])
    np.add.at(count, faces, 1.0)
    canceled = np.abs(total).max(axis=1) <= CANCELED * areas
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = 2.0 * 2.0**-53 * (6.0 + count) * sizes / length(total)
    return unit(np.where(canceled[:, None], 0.0, total)), np.where(canceled, 0.0, errors)


def placed_normals(normals: Reals, matrix: Floats, error: Floats | float = 0.0) -> tuple[Floats, Floats]:
    """Transform normals (K, 3) by placements (..., 4, 4) and normalize them, (..., K, 3): directions go by the inverse
    transpose. Also return how far two computations in float64 may differ: (..., K), absolute; 0 where there is no normal.
    error: how far the normals themselves may differ, (K,).

    The inverse transpose is the matrix of cofactors divided by the determinant, of which only the sign matters here: a
    singular placement needs no special case. Zero normals stay zero.

    A cofactor is a difference of two products, accurate to 2 units of 2^-53 of the sum of their sizes, which is much more
    than the cofactor where the placement is nearly singular. A component of the normal is a sum of three products with
    a normalized direction: 4 units of the direction's components, 1 of each product and 2 of the sums add up to 9. All
    this is relative to the length of the sum, and counts for both sides. What the normals differ by themselves grows at
    most as the cofactors' norm.
    """
    directions, same = unit(np.asarray(normals, dtype=np.float64)), is_identity(matrix)[..., None]
    rows = matrix[..., :3, :3] / power_of_two(np.abs(matrix[..., :3, :3]).max(axis=-2))[..., None, None]
    a, b = rows[..., [1, 2, 0], :], rows[..., [2, 0, 1], :]
    cofactors = np.swapaxes(cross(a, b), -2, -1)
    placed = unit(directions @ np.where(mirroring(matrix)[..., None, None], -cofactors, cofactors))
    after, before = (np.roll(np.abs(a), -k, axis=-1) * np.roll(np.abs(b), k, axis=-1) for k in (1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        rounding = 2.0 * 2.0**-53 * 9.0 * length(np.abs(directions) @ np.swapaxes(after + before, -2, -1))
        growth = np.linalg.norm(cofactors, axis=(-2, -1))[..., None]
        errors = np.where(placed.any(axis=-1), (rounding + error * growth) / length(directions @ cofactors), 0.0)
    return np.where(same[..., None], directions, placed), np.where(same, error, errors)


# Tangents


def corner_tangents(points: Floats, normals: Floats, uvs: Floats) -> Floats:
    """Return tangents (F, 3, 4) at the corners of F faces, 0 where they have none.

    points, normals (unit or 0): (F, 3, 3), uvs: (F, 3, 2) at the corners; v = 0 is the top row of the image, and the
    bitangent w * cross(normal, tangent) points up in it. After M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited"
    (2008), section 3.2 and appendix C, with the default threshold of 180 degrees.
    """
    tangents = np.zeros((len(points), 3, 4))
    if not len(points):
        return tangents
    vertex = _vertices(points, normals, uvs)
    faces = [f for f in range(len(points)) if len({tuple(p) for p in points[f].tolist()}) == 3]
    along, counter_clockwise, free = _directions(points, uvs)
    shares = np.where(np.array(free)[:, None, None], 0.0, _shares(points, normals, along))
    for members in _groups(vertex, faces, counter_clockwise, free):
        tangent = unit(np.sum([shares[member] for member in members], axis=0))
        if tangent.any():
            side = -1.0 if counter_clockwise[members[0][0]] else 1.0
            for face, corner in members:
                tangents[face, corner] = *tangent, side
    return tangents


def _vertices(points: Floats, normals: Floats, uvs: Floats) -> list[list[int]]:
    """Return the number of the vertex at each corner; equal corners are one."""
    numbers: dict[tuple[float, ...], int] = {}
    rows = np.concatenate([points, normals, uvs.astype(np.float32)], axis=2) + 0.0
    return [[numbers.setdefault(tuple(corner), len(numbers)) for corner in face] for face in rows.tolist()]


def _directions(points: Floats, uvs: Floats) -> tuple[Floats, list[bool], list[bool]]:
    """Return per face the unit direction in which u grows, whether its texture coordinates are counter-clockwise, and
    whether they have no area and leave both open. That is decided in float32, as the reference does."""
    texture = uvs.astype(np.float32)
    t1, t2 = texture[:, 1] - texture[:, 0], texture[:, 2] - texture[:, 0]
    area = t1[:, 0] * t2[:, 1] - t1[:, 1] * t2[:, 0]
    t1, t2 = t1.astype(np.float64), t2.astype(np.float64)
    d1, d2 = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    along = t2[:, 1, None] * d1 - t1[:, 1, None] * d2
    down = t1[:, 0, None] * d2 - t2[:, 0, None] * d1
    free = (area == 0.0) | ~along.any(axis=1) | ~down.any(axis=1)
    return unit(np.where(area > 0.0, 1.0, -1.0)[:, None] * along), (area > 0.0).tolist(), free.tolist()


def _neighbors(vertex: list[list[int]], faces: list[int]) -> dict[tuple[int, int], tuple[int, int]]:
    """Return for the edge from a face's corner to the next, (face, corner), the edge of another face that runs the
    other way. An edge that more faces share goes to the first that are free."""
    waiting: dict[tuple[int, int], list[tuple[int, int]]] = {}
    opposite = {}
    for face in faces:
        for corner in range(3):
            start, end = vertex[face][corner], vertex[face][(corner + 1) % 3]
            others = waiting.get((end, start), [])
            if others:
                neighbor = others.pop(0)
                opposite[face, corner], opposite[neighbor] = neighbor, (face, corner)
            else:
                waiting.setdefault((start, end), []).append((face, corner))
    return opposite


def _groups(
    vertex: list[list[int]], faces: list[int], counter_clockwise: list[bool], free: list[bool]
) -> list[list[tuple[int, int]]]:
    """Return the groups of corners (face, corner) that share a tangent. A free face takes the side of the first group that
    reaches it, which is noted in `counter_clockwise`."""
    neighbor = _neighbors(vertex, faces)
    assigned: set[tuple[int, int]] = set()
    groups = []
    for face in faces:
        for corner in range(3):
            if free[face] or (face, corner) in assigned:
                continue
            side, members, todo = counter_clockwise[face], [], [(face, corner)]
            while todo:
                f, k = todo.pop()
                if (f, k) in assigned:
                    continue
                if free[f] and not any((f, c) in assigned for c in range(3)):
                    counter_clockwise[f] = side
                if counter_clockwise[f] != side:
                    continue
                assigned.add((f, k))
                members.append((f, k))
                for edge in ((f, k), (f, (k + 2) % 3)):  # the two edges at this corner
                    if edge in neighbor:
                        other = neighbor[edge][0]
                        todo.append((other, vertex[other].index(vertex[face][corner])))
            groups.append(members)
    return groups


def _shares(points: Floats, normals: Floats, along: Floats) -> Floats:
    """Return (F, 3, 3) the direction of u in the plane of each corner's normal, normalized, times the face's angle
    there."""
    first, second = (unit(_in_plane(points[:, [k % 3 for k in (n, n + 1, n + 2)]] - points, normals)) for n in (1, 2))
    angle = np.arccos(np.clip(dot(first, second), -1.0, 1.0))
    return np.asarray(unit(_in_plane(along[:, None], normals)) * angle[..., None])


def _in_plane(vector: Floats, normal: Floats) -> Floats:
    return vector - dot(vector, normal)[..., None] * normal
