"""The least memory that a scene takes, compared with what there is before it is allocated."""

from __future__ import annotations

import numpy as np

from ..base import host_memory
from ..errors import DeviceError, InputError
from ..scene.model import Scene
from .opencl.device import Device
from .scene_buffers import Packed
from .struct_layout import Structs

MOST_VERTICES = (1 << 31) - 1  # faces name them by int32
_LEAST_ROW = 12  # bytes: three float32 of a vertex, three int32 of a face


def check_host(scene: Scene) -> None:
    """Refuse a scene whose placed meshes have too many vertices, or do not fit into this machine's memory. Raises
    InputError."""
    placed = [(mesh, len(np.asarray(mesh.instances))) for mesh in scene.meshes]
    vertices = sum(len(mesh.verts) * count for mesh, count in placed)
    if vertices > MOST_VERTICES:
        limit = f"at most {MOST_VERTICES} vertices with instances"
        raise InputError(f"render: scene: expected {limit}, found {vertices}")
    copied = sum(_LEAST_ROW * (len(mesh.verts) + len(mesh.faces)) * count for mesh, count in placed if count > 1)
    host_memory.require("render", "scene", copied, f"{scene.face_count:,} triangles with instances")


def check_device(device: Device, packed: Packed, structs: Structs) -> None:
    """Refuse a scene that does not fit into a device's memory. Raises DeviceError.

    A CPU commits memory as it is written: there, buffers of which a frame may write little do not count.
    """
    faces, vertices = len(packed.faces), len(packed.positions)
    tables = {id(table): table for table in vars(packed).values() if isinstance(table, np.ndarray)}
    needed = sum(table.nbytes for table in tables.values())
    needed += 0 if packed.instances is None else packed.instances.rows.nbytes
    needed += vertices * (structs.Vertex.itemsize + 4 * np.dtype(structs.real).itemsize)
    if not device.is_cpu:
        needed += faces * (structs.Triangle.itemsize + structs.Bounds.itemsize + np.dtype(np.int32).itemsize)
    if needed > device.memory:
        what = f"{faces:,} triangles and {vertices:,} vertices take {needed / host_memory.GIB:.1f} GiB or more"
        raise DeviceError(f"{device.name}: {what}, the device has {device.memory / host_memory.GIB:.1f} GiB")
