"""The casters of shadows on the device: vertices in a frame of reference of their own, in which their differences are
exact, and lights in that frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array, Bools, Floats, Floats32
from .buffers import Buffer
from .launches import shadow_stages
from .opencl.device import Device, open_device
from .struct_layout import SHADOW_GRID, SHADOW_REACH, SINGLE

_BLOCK = 16  # arrays of receivers are padded to its multiples, for any number of lanes

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
        """Return the frame of vertices (V, 3) float64, finite."""
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
        on_grid = np.rint((positions - self.origin) * (self.unit / SHADOW_GRID)) * SHADOW_GRID
        return split(on_grid)

    def light(self, position: Floats) -> Array:
        """Return a homogeneous position (4,) float64 as a row of structs.ShadowLight: w is 0 for a directional light,
        which is given by a direction toward it, else 1."""
        row = np.zeros(1, SINGLE.ShadowLight)
        if position[3] == 0.0:
            size = float(np.abs(position[:3]).max())
            row["high"][0], row["low"][0] = np.split(split(position[None, :3] * (SHADOW_REACH / 2 / size))[0], 2)
            return row
        moved = (position[:3] - self.origin) * self.unit
        size = float(np.abs(moved).max())
        if size <= SHADOW_REACH:
            parts, row["w"] = split(np.rint(moved / SHADOW_GRID) * SHADOW_GRID), 1.0
        else:
            w = SHADOW_REACH * 2.0 ** -math.frexp(size)[1]
            parts, row["w"] = split(moved * w), w if w >= _LEAST_W else 0.0
        row["high"][0], row["low"][0] = np.split(parts, 2)
        return row


def split(values: Floats) -> Floats32:
    """Return the float32 nearest to each value, then those nearest to the remainders: (..., 2 N) of (..., N)."""
    high = values.astype(np.float32)
    return np.concatenate([high, (values - high).astype(np.float32)], axis=-1)


class Hierarchy:
    """The triangles of a scene on a device, which cast shadows; valid until a vertex moves.

    vertices: (V, 3) float64. faces: (F, 3), indices of vertices; those without area cast no shadow.
    """

    def __init__(self, device: Device, vertices: Floats, faces: Array, *, lanes: int | None = None) -> None:
        self._device, self._stages = device, shadow_stages(device, lanes)
        self.frame = CasterFrame.around(vertices)
        self.vertices = Buffer(device, self.frame.pairs(vertices))
        self.faces = Buffer(device, np.asarray(faces, np.int32))

    def shadowed(self, points: Floats, faces: Array, light: Floats) -> Bools:
        """Return whether triangles hide a light from points, (K,).

        points: (K, 3), each on a face, within 2^-45 of the casters' box. faces: (K,), indices of those faces. light: (4,)
        as of `CasterFrame.light`. Receivers are taken in their order, as many together as there are lanes.
        """
        count = len(points)
        room = -(-count // _BLOCK) * _BLOCK
        coordinates = np.zeros((6, room), np.float32)
        coordinates[:, :count] = self.frame.pairs(points).T
        receivers = np.full(room, -1, np.int32)
        receivers[:count] = faces
        inputs = Buffer(self._device, coordinates), Buffer(self._device, receivers)
        lights, dark = Buffer(self._device, self.frame.light(light)), Buffer.empty(self._device, room, np.int32)
        self._stages.shadow_rays(*inputs, self.vertices, self.faces, lights, dark, len(self.faces.array), room)
        found: Bools = dark.to_host()[:count] != 0
        return found


def build(vertices: Floats, faces: Array, device: Device | None = None, *, lanes: int | None = None) -> Hierarchy:
    """Return the hierarchy of vertices (V, 3) float64 and faces (F, 3) on a device, by default `open_device()`."""
    return Hierarchy(device or open_device(), np.asarray(vertices, np.float64), faces, lanes=lanes)
