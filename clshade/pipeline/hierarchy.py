"""The casters of shadows on the device: a hierarchy of boxes over triangles, in a frame of reference in which differences
of vertices are exact; lights, cameras and occlusion in that frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array, Bools, Floats, Floats32
from ..scene.lights import Light, PlacedLight
from ..scene.model import Settings
from .buffers import Buffer, finish
from .camera_space import CameraSpace
from .launches import Stages, items, stages_of
from .light_points import RADII, sides_of, write_points
from .opencl.device import Device
from .shading_tables import split
from .struct_layout import CURVE_BITS, HIERARCHY_RUN, SAMPLE_BITS, SHADOW_GRID, SHADOW_REACH, SINGLE, SIZE_BITS, Structs

_WIDTH = 16  # triangles of a leaf, children of a node; arrays of receivers are padded to its multiples
_LEAF_FLOATS, _NODE_FLOATS = 10 * _WIDTH, 6 * _WIDTH
_TOGETHER = 1 << 20  # keys that are reordered at a time, whole runs of them, which takes 32 bytes each
_BLOCK = 1 << 14  # vertices whose temporary arrays stay in the cache
_NO_CASTER = np.uint64(2**64 - 1)
_LEAST_W = 2.0**-100  # a light so far away that its w would be less counts as directional
_LARGEST = 2.0**90  # products of three coordinates stay within float32's range
_LONGEST = 4.0 * SHADOW_REACH  # longer than any diagonal of the casters' box, so that longer rays meet no more
_LEAST = 2.0**-60  # shorter rays end where they begin


@dataclass(frozen=True)
class CasterFrame:
    """The frame of reference of shadows: (position - origin) * unit, at most SHADOW_REACH in each coordinate. It depends on
    the mesh alone."""

    origin: Floats  # (3,) float64, the center of the casters' box
    unit: float  # a power of two

    @classmethod
    def around(cls, vertices: Floats) -> CasterFrame:
        """Return the frame of vertices (V, 3) float64, of which those count that are finite."""
        finite = np.isfinite(vertices).all(axis=1)
        vertices = vertices if finite.all() else vertices[finite]
        if not len(vertices):
            return cls(np.zeros(3), 1.0)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        origin = low + (high - low) / 2
        reach = float(max((high - origin).max(), (origin - low).max()))
        exponent = math.frexp(reach)[1] if reach > 0.0 else 0
        return cls(origin, 2.0 ** (math.frexp(SHADOW_REACH)[1] - 1 - exponent))

    def pairs(self, positions: Floats) -> Floats32:
        """Return positions (K, 3) in this frame to the nearest multiple of SHADOW_GRID, (K, 6) float32: the rounded
        coordinates, then what rounding leaves of them."""
        with np.errstate(invalid="ignore"):
            return split(np.rint((positions - self.origin) * (self.unit / SHADOW_GRID)) * SHADOW_GRID)

    def place(self, position: Floats, size: float = 0.0) -> tuple[Floats, float]:
        """Return a position (3,) in this frame, and 1, or less if it or points as far from it as `size` are far away: w."""
        moved = (position - self.origin) * self.unit
        reach = float(np.abs(moved).max()) + size * self.unit
        return moved, 1.0 if reach <= SHADOW_REACH else SHADOW_REACH * 2.0 ** -math.frexp(reach)[1]

    def light(self, position: Floats, size: float = 0.0) -> Array:
        """Return a homogeneous position (4,) float64 as a row of structs.ShadowLight: w is 0 for a directional light,
        which is given by a direction toward it, else as of `place`."""
        row = np.zeros(1, SINGLE.ShadowLight)
        if position[3] == 0.0:
            parts = split(position[:3] * (SHADOW_REACH / 2 / float(np.abs(position[:3]).max())))
        else:
            moved, w = self.place(position[:3], size)
            parts = split(moved * w if w < 1.0 else np.rint(moved / SHADOW_GRID) * SHADOW_GRID)
            row["w"] = w if w >= _LEAST_W else 0.0
        row["high"][0], row["low"][0] = np.split(parts, 2)
        return row


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
        sorted_keys = keys.to_host()
        parts = [sorted_keys] if veils is None else [sorted_keys[~veils], sorted_keys[veils]]
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

    def shadowed(self, points: Floats, faces: Array, light: Floats) -> Bools:
        """Return whether triangles hide a light from points, (K,).

        points: (K, 3), each on a face, within 2^-45 of the casters' box. faces: (K,), indices of those faces, -1: not
        asked. light: (4,) as of `CasterFrame.light`. Receivers are taken in their order, as many together as there are
        lanes.
        """
        room, stages = max(-(-len(points) // _WIDTH), 1) * _WIDTH, stages_of(self._device, "shadow.cl", self._lanes)
        coordinates, receivers = np.zeros((6, room), np.float32), np.full(room, -1, np.int32)
        coordinates[:, : len(points)] = self.frame.pairs(points).T
        receivers[: len(points)] = faces
        arrays = {"points": coordinates, "receivers": receivers, "lights": self.frame.light(light)}
        values = {**vars(self), **{name: Buffer(self._device, array) for name, array in arrays.items()}}
        dark = Buffer.empty(self._device, room, np.int32)
        stages.run("shadow_rays", stages.runs(room, stages.lanes), values, dark=dark, stride=room)
        finish(self._device)
        return np.asarray(dark.to_host()[: len(points)] != 0)


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


def write_shadow_view(row: np.void, space: CameraSpace, frame: CasterFrame) -> None:
    """Fill a row of structs.ShadowView for a camera.

    Rays are counted from the pixel at the whole image's center, by whole 1/256 px that float32 holds.
    """
    camera, raster, steps = space.camera, space.raster, 1 << SAMPLE_BITS
    across, upward, forward = space.axes
    columns, rows = raster.resolution
    center = columns * steps // 2, rows * steps // 2
    (height, width), principal = raster.plane, raster.principal
    start = (camera.eye - frame.origin) * frame.unit
    right, up = width / (columns * steps) * across, height / (rows * steps) * upward
    middle = (center[0] - principal[0] * columns * steps) * right + (center[1] - principal[1] * rows * steps) * up
    if camera.orthographic:
        start, along = start + middle * frame.unit, forward
        right, up = right * frame.unit, up * frame.unit
    else:
        along = middle + camera.focal * forward
        largest = max(float(np.abs(along).max()), width, height)
        along, right, up = along / largest, right / largest, up / largest
    for name, vector in (("start", start), ("along", along), ("right", right), ("up", up)):
        row[name], row[f"{name}_low"] = np.split(split(np.clip(vector, -_LARGEST, _LARGEST)), 2)
    row["center"] = [middle - steps * first for middle, first in zip(center, raster.first, strict=True)]


def shadow_lights(lights: tuple[Light, ...], frame: CasterFrame) -> tuple[Array, Floats]:
    """Return rows of structs.ShadowLight of the lights that shine, in their order, at least one; and what turns lengths into
    the units of each: the frame's unit times w, which the row has as 0 if it is too small."""
    shining = [light for light in lights if light.intensity.any()]
    rows, factors = np.zeros(max(len(shining), 1), SINGLE.ShadowLight), np.zeros(len(shining))
    for k, light in enumerate(shining):
        if isinstance(light, PlacedLight):
            size = float(np.abs(sides_of(light)).sum())
            rows[k] = frame.light(np.append(light.position, 1.0), size)[0]
            factors[k] = frame.unit * frame.place(np.asarray(light.position, np.float64), size)[1]
        else:
            rows[k] = frame.light(np.append(-light.axis, 0.0))[0]
    return rows, factors


def hemisphere_row(settings: Settings, frame: CasterFrame, structs: Structs) -> Array:
    """Return one row of structs.Light whose points are those of the unit disc below the hemisphere. shadow_scale is the
    rays' length in the units of shadows; no points without ambient occlusion."""
    rows = np.zeros(1, structs.Light)
    if not settings.ambient_occlusion or settings.ao_distance is None:
        return rows
    write_points(rows[0], settings.ambient_occlusion, sphere=True)
    rows["right"], rows["up"] = RADII
    with np.errstate(over="ignore"):
        distance = float(np.minimum(np.float64(settings.ao_distance) * frame.unit, _LONGEST))
    rows["shadow_scale"] = distance if distance >= _LEAST else 0.0
    return rows
