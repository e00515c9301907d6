"""Geometry of scenes in float64: normals with and without creases, welding, camera axes, matrices and rays, bounding box.

Where scale matters, values are first multiplied by a power of two, which is exact: a scene scaled by a power of two
gives the same bits, and squares neither overflow nor underflow.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Array, Faces, Floats, connected_components
from ..base.validation import number
from ..errors import InputError
from .camera import Camera, axes_of
from .model import Mesh, Scene

_POOL = 1 << 14  # vertices of small meshes that are placed at once
_CANCELED = 2.0**-40  # times the faces' sizes: a smaller sum has no direction left
_SEAM = 30.0  # degrees between two faces, up to which vertices apart at one place are a seam of a smooth surface


def _exponent(values: Array) -> int:
    """Return the e for which the largest magnitude of `values` is in [2^(e-1), 2^e); 0 if all are zero."""
    return int(np.frexp(max(values.max(initial=0.0), -values.min(initial=0.0)))[1])


def normalized(vectors: Floats) -> Floats:
    """Normalize (K, 3) float64 vectors of any finite length; the zero vector is kept."""
    x, y, z = vectors.T
    exponent = np.frexp(np.maximum(np.maximum(np.abs(x), np.abs(y)), np.abs(z)))[1]
    x, y, z = (np.ldexp(column, -exponent) for column in (x, y, z))
    length = np.sqrt(x * x + y * y + z * z)
    length[length == 0.0] = 1.0
    return np.stack([x / length, y / length, z / length], axis=1)


def vertex_normals(verts: ArrayLike, faces: ArrayLike) -> Floats:
    """Return unit normals (V, 3) at vertices (V, 3) of faces (F, 3): the sums of the faces' cross products (b-a) x (c-a),
    which weight them by area, normalized.

    0 at a vertex without faces, or whose faces cancel to 2^-40 of their sizes: the rest is rounding error. Any scale from
    1e-150 to 1e150 (within a mesh, faces 1e-150 times smaller in area than the largest fade to 0) and any offset.
    """
    verts, faces = np.asarray(verts), np.asarray(faces)
    if not len(faces):
        return np.zeros((len(verts), 3))
    blocks, exponent = list(row_blocks(len(faces))), _edge_exponent(verts, faces)
    sums, areas = np.zeros((3, 3, len(verts))), np.zeros((3, len(blocks)))  # by axis and corner, and by axis and block
    for at, block in enumerate(blocks):
        index = faces[block].T.astype(np.intp, order="C")
        edges = _edges(verts, faces[block], exponent)
        for axis in range(3):
            cross = _cross(edges, axis)
            areas[axis, at] = np.abs(cross).sum()
            for corner in range(3):
                np.add.at(sums[axis, corner], index[corner], cross)
    sums[:, 0] += sums[:, 1]
    sums[:, 0] += sums[:, 2]
    normals = np.ascontiguousarray(sums[:, 0].T)
    del sums
    largest, total = np.abs(normals).max(axis=1), sum(areas.ravel().tolist())
    suspects = (largest > 0.0) & (largest <= _CANCELED * total)
    if suspects.any():
        near = faces[suspects[faces].any(axis=1)]
        edges = _edges(verts, near, exponent)
        sizes = sum(np.abs(_cross(edges, axis)) for axis in range(3))
        together = np.bincount(near.reshape(-1), np.repeat(sizes, 3), len(verts))
        normals[suspects & (largest <= _CANCELED * together)] = 0.0
    for block in row_blocks(len(normals)):
        normals[block] = normalized(normals[block])
    return normals


def _cross(edges: Array, axis: int) -> Floats:
    """Return one component of the cross products of edges (2, 3, F)."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    u, v = edges
    return np.asarray(u[j] * v[k] - u[k] * v[j])


def _edge_exponent(verts: Array, faces: Array) -> int:
    """Return the exponent, see `_exponent`, of all `_edges`."""
    largest = [np.abs(_edges(verts, faces[block])).max(initial=0.0) for block in row_blocks(len(faces))]
    return _exponent(np.array(largest))


def _edges(verts: Array, faces: Array, exponent: int = 0) -> Floats:
    """Return (2, 3, F) half of b-a and c-a of each face over 2^exponent, by axis; halves, so that they cannot overflow."""
    corners = np.multiply(verts[faces].transpose(1, 2, 0), 0.5, dtype=np.float64, order="C")
    edges: Floats = corners[1:] - corners[0]
    return np.ldexp(edges, -exponent, out=edges)


def crease_normals(verts: ArrayLike, faces: ArrayLike, degrees: float) -> tuple[Floats, Faces]:
    """Return unit normals (K, 3), and their indices (F, 3) for the corners of a mesh whose edges with more than `degrees`
    between their faces are sharp. At 0 every face is flat.

    Vertices at one position count as one. Corners there that smooth edges connect share a normal: the sum of their faces'
    cross products, normalized; 0 where these have no area. Raises InputError unless degrees is a number from 0 to 180.
    """
    degrees = crease_angle("crease_normals", "degrees", degrees)
    verts, faces = np.asarray(verts, np.float64), np.asarray(faces, np.int32)
    cross, count = _face_crosses(verts, faces), len(faces)
    if degrees == 0.0 or not count:
        return normalized(cross), np.repeat(np.arange(count, dtype=np.int32), 3).reshape(-1, 3)
    first, second = _smooth_pairs(welded(verts)[1][faces], normalized(cross), degrees)
    labels = connected_components(3 * count, first, second)
    numbers = np.cumsum(labels == np.arange(3 * count, dtype=np.int32), dtype=np.int32)
    corners = (numbers - 1)[labels]
    sums: Array = np.stack([np.bincount(corners, np.repeat(column, 3), numbers[-1]) for column in cross.T], axis=1)
    return normalized(sums), corners.reshape(-1, 3)


def seamless_normals(verts: ArrayLike, faces: ArrayLike, degrees: float = _SEAM) -> Floats | None:
    """Return `vertex_normals` of a mesh whose vertices at one position are joined where there is only a seam: an edge of two
    faces with at most `degrees` between them. None if no vertices are joined."""
    verts, faces = np.asarray(verts), np.asarray(faces, np.int32)
    points, which = welded(verts)
    if len(points) == len(verts):
        return None
    pairs = _smooth_pairs(which[faces], normalized(_face_crosses(verts, faces)), degrees)
    one, two = (faces.reshape(-1)[corners] for corners in pairs)
    apart = one != two
    if not apart.any():
        return None
    labels = connected_components(len(verts), one[apart], two[apart])
    return vertex_normals(verts, labels[faces])[labels]


def crease_angle(owner: str, name: str, value: Any) -> float:
    """Return a crease angle in degrees, from 0 to 180. Raises InputError for anything else."""
    return number(owner, name, value, least=0.0, most=180.0, expected="degrees from 0 to 180")


def flat_normals(one: Array, other: Array) -> Floats:
    """Return unit normals (F, 3) of faces with these edges, (3, F) each; 0 for one without area."""
    return normalized(_crosses(np.stack([one, other])))


def _face_crosses(verts: Array, faces: Array) -> Array:
    """Return (F, 3) cross products of the faces' edges, times a power of two that keeps them in range."""
    return _crosses(_edges(verts, faces, _edge_exponent(verts, faces)))


def _crosses(edges: Array) -> Array:
    """Return the cross products (F, 3) of edges (2, 3, F); np.cross takes ten times as long for a few."""
    return np.stack([_cross(edges, axis) for axis in range(3)], axis=1)


def _smooth_pairs(faces: Array, normals: Array, degrees: float) -> tuple[Array, Array]:
    """Return pairs of corners (numbered 3 * face + corner) that share a normal, at both ends of each edge with at most
    `degrees` between the unit normals (F, 3) of its faces. If more than two share an edge, consecutive ones are paired."""
    start = faces.reshape(-1)
    end = np.roll(faces, -1, axis=1).reshape(-1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low.astype(np.int64) << 32 | high
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(np.diff(key[order]) == 0)
    one, two = order[same], order[same + 1]
    cosine = np.einsum("ij,ij->i", normals[one // 3], normals[two // 3])
    smooth = (cosine >= math.cos(math.radians(degrees)) - 1e-12) & (low[one] != high[one])
    ends = []  # the corner at the vertex of each edge with the lower index, and the one at the other
    for edge in (one[smooth], two[smooth]):
        forward, after = start[edge] < end[edge], next_corners(edge)
        ends.append(np.concatenate([np.where(forward, edge, after), np.where(forward, after, edge)]))
    return ends[0], ends[1]


def next_corners(corners: Array) -> Array:
    """Return the corners (numbered 3 * face + corner) that follow in the same faces."""
    return np.where(corners % 3 == 2, corners - 2, corners + 1)


def welded(verts: Array) -> tuple[Array, Array]:
    """Return the indices (W,), ascending, of the first vertex at each position, where -0.0 equals 0.0, and for every vertex
    the row among these (V,). verts: (V, 3) finite."""
    bits = (np.ascontiguousarray(verts) + 0.0).view(np.uint32 if verts.dtype == np.float32 else np.uint64)
    hashed = np.zeros(len(verts), np.uint64)
    for column in bits.T:
        hashed = hashed * np.uint64(0x9E3779B97F4A7C15) + column
        for factor in (0xFF51AFD7ED558CCD, 0xC4CEB9FE1A85EC53):  # the finalizer of MurmurHash3
            hashed ^= hashed >> np.uint64(33)
            hashed *= np.uint64(factor)
        hashed ^= hashed >> np.uint64(33)
    _, first, which = np.unique(hashed, return_index=True, return_inverse=True)
    which = which.reshape(-1)
    if not (bits[first[which]] == bits).all():  # a hash collision
        _, first, which = np.unique(bits, axis=0, return_index=True, return_inverse=True)
        which = which.reshape(-1)
    rank = np.argsort(first)
    place = np.empty(len(rank), np.int32)
    place[rank] = np.arange(len(rank), dtype=np.int32)
    return first[rank], place[which]


def against_normals(verts: Array, faces: Array, normals: Array, normal_faces: Array) -> Array:
    """Return (F,) whether faces are clockwise as seen along their normals: whether the cross product of a face points away
    from the sum of the finite normals at its corners."""
    against = np.empty(len(faces), bool)
    if not np.isfinite(normals).all():
        normals = np.where(np.isfinite(normals), normals, normals.dtype.type(0.0))
    with np.errstate(over="ignore", invalid="ignore"):  # NaN compares as not against
        for block in row_blocks(len(faces)):
            a, b, c = (verts[corner] for corner in faces[block].T)
            one, two, three = (normals[corner] for corner in normal_faces[block].T)
            against[block] = (np.cross(b - a, c - a) * (one + two + three)).sum(axis=1) < 0.0
    return against


def row_blocks(count: int, size: int = 1 << 14) -> Iterator[slice]:
    """Return slices that cover range(count), short enough that temporary arrays stay in the cache."""
    return (slice(start, start + size) for start in range(0, count, size))


def camera_axes(camera: Camera) -> Floats:
    """Return the axes of a camera in world space, as the rows of an orthonormal matrix (3, 3): right, up, viewing direction.

    z = lookat - eye, y = up minus its part along z, x = z cross y, of unit length. A point p has the camera coordinates
    camera_axes(camera) @ (p - eye). Raises InputError when up is parallel to the viewing direction, to rounding.
    """
    return np.array(axes_of(camera))


def camera_matrices(camera: Camera) -> tuple[Floats, Floats]:
    """Return worldToCamera and worldToNDC, (4, 4), for row vectors: [x y z 1] @ matrix, as OpenEXR's ImfStandardAttributes.h
    defines them.

    Camera space is left-handed: +x right, +y up, +z the viewing direction, in scene units. NDC, after division by w, has
    (0, 0) at the upper left and (1, 1) at the lower right corner of the display window, y DOWN: the pixel in column c
    and row r from the top has its center at ((c+0.5)/N, (r+0.5)/M). OpenEXR leaves z open; here it is 1 - focal/depth:
    0 on the image plane, 1 at infinity; the depth itself in a parallel projection, whose w is 1.
    """
    to_camera = np.eye(4)
    to_camera[:3, :3] = camera_axes(camera).T
    to_camera[3, :3] = -np.asarray(camera.eye) @ to_camera[:3, :3]
    (height, width), (right, up) = camera.plane, camera.principal
    to_ndc = np.zeros((4, 4))
    if camera.orthographic:
        to_ndc[0, 0], to_ndc[1, 1], to_ndc[2, 2] = 1.0 / width, -1.0 / height, 1.0
        to_ndc[3] = right, 1.0 - up, 0.0, 1.0
    else:
        to_ndc[0, 0], to_ndc[1, 1] = camera.focal / width, -camera.focal / height
        to_ndc[2] = right, 1.0 - up, 1.0, 1.0
        to_ndc[3, 2] = -camera.focal
    return to_camera, to_camera @ to_ndc


def camera_metadata(camera: Camera) -> dict[str, Any]:
    """Return header attributes of a camera: worldToCamera, worldToNDC (float32), pixelAspectRatio (width / height)."""
    to_camera, to_ndc = camera_matrices(camera)
    (height, width), (columns, rows) = camera.plane, camera.resolution
    aspect = (width / columns) / (height / rows)
    with np.errstate(over="ignore"):
        matrices = {"worldToCamera": to_camera.astype(np.float32), "worldToNDC": to_ndc.astype(np.float32)}
    return {**matrices, "pixelAspectRatio": min(max(aspect, 1e-6), 1e6)}  # OpenEXR refuses anything beyond


def bounding_box(shown: Scene | Sequence[Mesh]) -> tuple[Floats, Floats]:
    """Return the lowest and highest corner, (3,) float64 each, of all vertices that faces refer to, in world space.

    Every instance counts. Both are 0 without faces. Raises InputError where a position overflows.
    """
    meshes = shown.meshes if isinstance(shown, Scene) else shown
    blocks = map(np.ascontiguousarray, placed_blocks(meshes))  # whose rows NumPy searches far faster
    ends = [(block.min(axis=1, initial=np.inf), block.max(axis=1, initial=-np.inf)) for block in blocks]
    if not ends:
        return np.zeros(3), np.zeros(3)
    lows, highs = zip(*ends, strict=True)
    low, high = np.min(lows, axis=0) + 0.0, np.max(highs, axis=0) + 0.0
    if not np.isfinite([low, high]).all():
        raise InputError("Scene: meshes: expected finite positions in world space, found an overflow of float64")
    return low, high


def placed_blocks(meshes: Sequence[Mesh]) -> Iterator[Floats]:
    """Yield the vertices that faces refer to, in world space, as (3, K) float64 blocks; every instance counts."""
    for mesh, *others in _pools(meshes):
        if others:
            yield _placed_pool([mesh, *others])
            continue
        used = np.zeros(len(mesh.verts), bool)
        used[mesh.faces.reshape(-1)] = True
        points = mesh.verts if used.all() else mesh.verts[used]
        placements = mesh.instances
        many = max(1, _POOL // max(len(points), 1))  # placements at once
        for first in range(0, len(placements), many):
            some = placements[first : first + many]
            for block in row_blocks(len(points)):
                columns = points[block].T.astype(np.float64)
                if len(some) > 1 or (some != np.eye(4)).any():
                    columns = _placed(columns, some).transpose(1, 0, 2).reshape(3, -1)
                yield columns


def _pools(meshes: Iterable[Mesh]) -> Iterator[list[Mesh]]:
    """Yield the meshes that have triangles in order, alone or as many as have together _POOL vertices: thousands of small
    ones cost as much as one."""
    pool: list[Mesh] = []
    size = 0
    for mesh in meshes:
        if not len(mesh.faces):
            continue
        count = len(mesh.verts) * max(len(mesh.instances), 1)
        if pool and size + count > _POOL:
            yield pool
            pool, size = [], 0
        pool.append(mesh)
        size += count
    if pool:
        yield pool


def _placed_pool(meshes: Sequence[Mesh]) -> Floats:
    """Return the vertices of small meshes that faces refer to, in world space, as one (3, K) block."""
    counts, copies = np.array([(len(mesh.verts), len(mesh.instances)) for mesh in meshes]).T
    starts = np.cumsum(counts) - counts
    faces = np.concatenate([mesh.faces for mesh in meshes])
    used = np.zeros(counts.sum(), bool)
    used[faces + np.repeat(starts, [len(mesh.faces) for mesh in meshes])[:, None]] = True
    sizes = np.add.reduceat(used, starts, dtype=np.int64)
    first, size = np.repeat([np.cumsum(sizes) - sizes, sizes], copies, axis=1)  # of the points of each placement
    begin = np.cumsum(size) - size
    points = np.concatenate([mesh.verts for mesh in meshes], dtype=np.float64)[used]
    placed = points[np.repeat(first - begin, size) + np.arange(size.sum())]
    matrices = np.concatenate([mesh.instances for mesh in meshes])
    moved = (matrices != np.eye(4)).any(axis=(1, 2))
    for length in sorted({*size[moved].tolist()}):
        some = np.flatnonzero(moved & (size == length))
        rows = begin[some, None] + np.arange(length)
        placed[rows] = _placed(placed[rows].transpose(0, 2, 1), matrices[some]).transpose(0, 2, 1)
    return np.ascontiguousarray(placed.T)


def _placed(columns: Floats, placements: Floats) -> Floats:
    """Return points, (3, V) or (K, 3, V), under placements (K, 4, 4): (K, 3, V)."""
    with np.errstate(over="ignore", invalid="ignore"):
        placed: Floats = placements[:, :3, :3] @ columns + placements[:, :3, 3:]
    return placed


def half_diagonal(low: Floats, high: Floats) -> float:
    """Return half the distance of two corners (3,), which may be as far apart as float64 allows."""
    half = high / 2 - low / 2
    exponent = _exponent(half)
    with np.errstate(over="ignore"):
        return float(np.ldexp(np.linalg.norm(np.ldexp(half, -exponent)), exponent))


def triangles(scene: Scene) -> tuple[Floats, Faces]:
    """Return the vertices (V, 3) of all meshes and instances in world space, and the faces (F, 3) in the order in which
    the layer `id` counts them."""
    verts, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int32)], 0
    for mesh in scene.meshes:
        for placement in mesh.instances:
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
    """Return directions and origins, (M, N, 3) each, of rays through the pixels of some rows, row 0 at the top. place: where
    in the pixel, from its lower left corner."""
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
    """Return the weights (K, 3) of triangles (K, 3, 3) where rays (K, 3) meet their planes, clamped to them."""
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
    return np.asarray(np.einsum("kx,kx->k", a, b))


def in_image(camera: Camera, offsets: Floats) -> tuple[Floats, Floats]:
    """Return where points are in the image, (K, 2), pixels to the right and down from its top left corner, and their depths
    (K,). offsets: of the points from the eye (K, 3). What is not in front of a perspective camera gets NaN."""
    (height, width), (columns, rows), principal = camera.plane, camera.resolution, camera.principal
    x, y, z = (offsets @ camera_axes(camera).T).T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        lens = 1.0 if camera.orthographic else np.where(z > 0.0, camera.focal / z, np.nan)
        across, up = (x * lens / width + principal[0]) * columns, (y * lens / height + principal[1]) * rows
    return np.stack([across, rows - up], axis=1), z
