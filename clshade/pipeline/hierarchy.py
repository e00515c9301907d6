"""The casters of shadows on the device: a hierarchy of boxes over triangles, in a frame of reference in which differences
of vertices are exact, and lights in that frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..base.arrays import Array, Bools, Floats, Floats32
from .buffers import Buffer, finish
from .launches import Stages, items, stages_of
from .opencl.device import Device
from .struct_layout import CURVE_BITS, HIERARCHY_RUN, SHADOW_GRID, SHADOW_REACH, SINGLE, SIZE_BITS

_WIDTH = 16  # triangles of a leaf, children of a node; arrays of receivers are padded to its multiples
_LEAF_FLOATS, _NODE_FLOATS = 10 * _WIDTH, 6 * _WIDTH
_TOGETHER = 1 << 20  # keys that are reordered at a time, whole runs of them, which takes 32 bytes each
_BLOCK = 1 << 14  # vertices whose temporary arrays stay in the cache
_NO_CASTER = np.uint64(2**64 - 1)

_LEAST_W = 2.0**-100  # a light so far away that its w would be less counts as directional


@dataclass(frozen=True)
class CasterFrame:
    """The frame of reference of shadows: (position - origin) * unit, at most SHADOW_REACH in each coordinate.

    origin: (3,) float64, the center of the casters' box. unit: a power of two. Both depend on the mesh alone.
    """

    origin: Floats
    unit: float

    @classmethod
    def around(cls, vertices: Floats) -> CasterFrame:
        """Return the frame of vertices (V, 3) float64, of which those count that are finite."""
        low, high = _extremes(vertices)
        if not np.isfinite([low, high]).all():
            low, high = _extremes(vertices[np.isfinite(vertices).all(axis=1)])
        if not (low <= high).all():
            return cls(np.zeros(3), 1.0)
        origin = low + (high - low) / 2
        reach = float(max((high - origin).max(), (origin - low).max()))
        exponent = math.frexp(reach)[1] if reach > 0.0 else 0
        return cls(origin, 2.0 ** (math.frexp(SHADOW_REACH)[1] - 1 - exponent))

    def pairs(self, positions: Floats) -> Floats32:
        """Return positions (K, 3) in this frame to the nearest multiple of SHADOW_GRID, (K, 6) float32: the rounded
        coordinates, then what rounding leaves of them."""
        with np.errstate(invalid="ignore"):
            return split(np.rint((positions - self.origin) * (self.unit / SHADOW_GRID)) * SHADOW_GRID)

    def light(self, position: Floats, size: float = 0.0) -> Array:
        """Return a homogeneous position (4,) float64 as a row of structs.ShadowLight: w is 0 for a directional light,
        which is given by a direction toward it, else 1, or less where it or points as far from it as `size` are far
        away."""
        row = np.zeros(1, SINGLE.ShadowLight)
        if position[3] == 0.0:
            size = float(np.abs(position[:3]).max())
            row["high"][0], row["low"][0] = np.split(split(position[None, :3] * (SHADOW_REACH / 2 / size))[0], 2)
            return row
        moved = (position[:3] - self.origin) * self.unit
        size = float(np.abs(moved).max()) + size * self.unit
        if size <= SHADOW_REACH:
            parts, row["w"] = split(np.rint(moved / SHADOW_GRID) * SHADOW_GRID), 1.0
        else:
            w = SHADOW_REACH * 2.0 ** -math.frexp(size)[1]
            parts, row["w"] = split(moved * w), w if w >= _LEAST_W else 0.0
        row["high"][0], row["low"][0] = np.split(parts, 2)
        return row


def _extremes(vertices: Floats) -> tuple[Floats, Floats]:
    """Return the least and the largest coordinates, (3,) each; infinity and -infinity without vertices."""
    many = len(vertices) // 64 * 64  # NumPy reduces long rows faster than columns of three
    low, high = np.full((2, 3), np.inf) * [[1.0], [-1.0]]
    for part in (vertices[:many].reshape(-1, 64 * 3), vertices[many:]):
        if len(part):
            low = np.minimum(low, part.min(axis=0).reshape(-1, 3).min(axis=0))
            high = np.maximum(high, part.max(axis=0).reshape(-1, 3).max(axis=0))
    return low, high


def split(values: Floats) -> Floats32:
    """Return the float32 nearest to each value, then those nearest to the remainders: (..., 2 N) of (..., N)."""
    high = values.astype(np.float32)
    return np.concatenate([high, (values - high).astype(np.float32)], axis=-1)


class Hierarchy:
    """The triangles of a scene on a device, which cast shadows; valid until a vertex moves.

    A tree of boxes over leaves of 16 triangles: each node has 16 children, whose numbers follow from its own. The
    triangles are sorted along Hilbert's curve; then each run of HIERARCHY_RUN of them is halved along its longest axis, so
    is each half, and so on down to the leaves. Built on the device, but for the sort.

    vertices: (V, 3) float64. faces: (F, 3), indices of vertices; those without area, and those with a corner that is not
    finite, cast no shadow (the tree leaves out the latter, and those with two equal indices). veils: (F,) bool, faces that
    are not opaque, which have a tree of their own.
    """

    def __init__(
        self, device: Device, vertices: Floats, faces: Array, *, lanes: int | None = None, veils: Bools | None = None
    ) -> None:
        self._device, self._lanes = device, lanes
        self.frame = CasterFrame.around(vertices)
        rows = np.zeros((len(vertices), 2, 4), np.float32)
        for start in range(0, len(vertices), _BLOCK):
            part = vertices[start : start + _BLOCK]
            rows[start : start + _BLOCK, :, :3] = self.frame.pairs(part).reshape(-1, 2, 3)
        self.vertices = Buffer(device, rows)
        self.faces = Buffer(device, np.ascontiguousarray(faces, np.int32))
        self._build(stages_of(device, "hierarchy.cl", 1), veils)

    def _build(self, stages: Stages, veils: Bools | None) -> None:
        """Make the trees of opaque faces and of the others: leaves, nodes, the table of trees."""
        device, count = self._device, len(self.faces.array)
        keys = Buffer.empty(device, count, np.uint64)
        mesh = {"vertices": self.vertices, "faces": self.faces, "index_bits": _index_bits(count)}
        stages.run("hierarchy_keys", items(count, 16), mesh, keys=keys, face_count=count)
        found = keys.to_host()
        parts = [found] if veils is None else [found[~veils], found[veils]]
        for part in parts:
            part.sort()
        trees = [Buffer(device, part[: np.searchsorted(part, _NO_CASTER)]) for part in parts]
        counts = [len(tree.array) for tree in trees]
        leaves, levels = [-(-many // _WIDTH) for many in counts], list(map(_level_sizes, counts))
        self.leaves = Buffer.empty(device, (sum(leaves), _LEAF_FLOATS), np.float32)
        self.nodes = Buffer.empty(device, (sum(map(sum, levels)), _NODE_FLOATS), np.float32)
        room = Buffer.empty(device, (2 * min(_TOGETHER, max(counts)), 4), np.float32)
        table, leaf, node = np.zeros(2, SINGLE.Casters), 0, 0
        try:
            for row, tree, many, sizes in zip(table, trees, leaves, levels, strict=False):
                row["levels"], row["first_leaf"] = len(sizes), leaf
                first = row["first_node"][: len(sizes)] = node + np.cumsum([0, *sizes])[:-1]
                for start in range(0, len(tree.array), _TOGETHER):
                    together = min(_TOGETHER, len(tree.array) - start)
                    size = (-(-together // HIERARCHY_RUN), 1)
                    stages.run("hierarchy_runs", size, mesh, keys=tree, rows=room, first=start, count=together)
                if sizes:
                    tables = {"keys": tree, "leaves": self.leaves, "nodes": self.nodes, "count": len(tree.array)}
                    ends = {"first_leaf": leaf, "leaf_count": many, "first_node": node}
                    stages.run("hierarchy_leaves", (sizes[0] * _WIDTH, 16), {**mesh, **tables}, **ends)
                for k in range(1, len(sizes)):
                    ends = {"first": first[k - 1], "above": first[k], "below_count": sizes[k - 1]}
                    stages.run("hierarchy_level", (sizes[k] * _WIDTH, 16), nodes=self.nodes, **ends)
                leaf, node = leaf + many, node + sum(sizes)
        finally:
            finish(device)  # kernels use what is freed on return
        self.casters = Buffer(device, table)

    @property
    def nbytes(self) -> int:
        """Device memory of the hierarchy: what the faces need besides, a renderer has anyway."""
        return sum(buffer.array.nbytes for buffer in (self.vertices, self.leaves, self.nodes, self.casters))

    @cached_property
    def _stages(self) -> Stages:
        return stages_of(self._device, "shadow.cl", self._lanes)

    def shadowed(self, points: Floats, faces: Array, light: Floats) -> Bools:
        """Return whether triangles hide a light from points, (K,).

        points: (K, 3), each on a face, within 2^-45 of the casters' box. faces: (K,), indices of those faces, -1: not
        asked. light: (4,) as of `CasterFrame.light`. Receivers are taken in their order, as many together as there are
        lanes.
        """
        room, stages = max(-(-len(points) // _WIDTH), 1) * _WIDTH, self._stages
        coordinates, receivers = np.zeros((6, room), np.float32), np.full(room, -1, np.int32)
        coordinates[:, : len(points)] = self.frame.pairs(points).T
        receivers[: len(points)] = faces
        arrays = {"points": coordinates, "receivers": receivers, "lights": self.frame.light(light)}
        values = {**vars(self), **{name: Buffer(self._device, array) for name, array in arrays.items()}}
        dark = Buffer.empty(self._device, room, np.int32)
        stages.run("shadow_rays", stages.runs(room, stages.lanes), values, dark=dark, stride=room)
        finish(self._device)
        hidden: Bools = dark.to_host()[: len(points)] != 0
        return hidden


def _index_bits(count: int) -> int:
    """Return how many low bits of casters' keys hold the index of a face, of so many."""
    return max((count - 1).bit_length(), 64 - SIZE_BITS - CURVE_BITS)


def _level_sizes(count: int) -> list[int]:
    """Return the number of nodes of each level above `count` triangles, the parents of leaves first."""
    sizes: list[int] = []
    below = -(-count // _WIDTH)
    while below and (not sizes or below > 1):
        below = -(-below // _WIDTH)
        sizes.append(below)
    return sizes
