"""The layers of a frame: ids, depth, position, normal, color and texture coordinates at each pixel."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.arrays import Array
from .buffer_pool import Pool
from .buffers import Buffer
from .camera_space import CameraSpace
from .launches import Stages
from .layer_buffers import MACROS, LayerTables
from .struct_layout import NAN_POSITION
from .surface_inputs import SurfaceInputs

_BAND = 1 << 13  # pixels
_WIDTHS = {"N": 3, "P": 3, "albedo": 3, "uv": 2, "barycentrics": 3}  # components of a pixel, in the kernel's order
_SURFACE = (*_WIDTHS, "scalar", "AO")
_NUMBERS = {"object_id": "objects", "material_id": "materials", "instance_id": "instances"}  # tables by face


class Layers:
    """The layers asked for; what they read besides the image's tables stays on the device.

    names: of the layers, as in Settings.
    """

    def __init__(self, stages: Stages, pool: Pool, names: tuple[str, ...], tables: LayerTables) -> None:
        self._stages, self._pool, self._names = stages, pool, names
        self._scalar_exponent = tables.scalar_exponent
        arrays = tables._asdict()
        self._own = {
            name: Buffer(stages.device, array) for name, array in arrays.items() if isinstance(array, np.ndarray)
        }
        shared = ("normals", "object_normals", "normal_faces", "uvs", "uv_faces")
        self._surface = {name: self._own[name] for name in shared if name in self._own}

    @property
    def nbytes(self) -> int:
        """Size of the tables that only layers read."""
        return sum(buffer.array.nbytes for buffer in self._own.values())

    def kinds(self) -> dict[str, tuple[tuple[int, ...], np.dtype]]:
        """Return the components and the type of each layer, by name: () or (K,)."""
        real = self._stages.structs.real
        found: dict[str, tuple[tuple[int, ...], np.dtype]] = {}
        for name in self._names:
            kind = np.float64 if name == "P" else real if name == "Z" or name in _SURFACE else np.uint32
            found[name] = ((_WIDTHS[name],) if name in _WIDTHS else ()), np.dtype(kind)
        return found

    def kernel_type(self, name: str) -> np.dtype:
        """Return the type in which the kernels write a layer: that of `kinds`, but for P."""
        return np.dtype(self._stages.structs.real) if name == "P" else self.kinds()[name][1]

    def draw(
        self, surface: SurfaceInputs, owners: Buffer, tiles: int, space: CameraSpace, events: dict[str, Any]
    ) -> dict[str, Array]:
        """Draw the layers: by name, (M, N) or (M, N, K). surface: the image's inputs. owners: (M, N) triangles."""
        columns, rows = space.camera.resolution
        found: dict[str, Buffer] = {}
        arrays: dict[str, Array] = {}
        for name, (width, _) in self.kinds().items():
            found[name], arrays[name] = self._pool.take((rows, columns, *width), self.kernel_type(name))
        self.enqueue(found, surface, owners, tiles, events)
        for buffer in found.values():
            buffer.to_host()
        drawn = dict(arrays)
        if "P" in arrays and arrays["P"].dtype != np.float64:
            arrays["P"] = self._pool.take_host((rows, columns, 3), np.float64)
        self.finish(drawn, arrays, owners.to_host() if "P" in drawn else owners.array, space)
        return arrays

    def enqueue(
        self, found: dict[str, Buffer], surface: SurfaceInputs, owners: Buffer, tiles: int, events: dict[str, Any]
    ) -> None:
        """Enqueue the drawing of the layers into buffers; see `draw`."""
        count = owners.array.size
        for name, buffer in found.items():
            if name == "Z":
                events["layer_z"] = self._stages.layer_z(owners, surface.triangles, surface.image, buffer, tiles)
            elif name == "id":
                if surface.instances is None:
                    events["layer_id"] = self._stages.layer_id(owners, surface.triangles, buffer, count)
                else:
                    events["layer_id"] = self._stages.layer_id_of_instances(owners, surface, buffer, count)
            elif name == "instance_id" and surface.instances is not None:
                events["layer_instance_id"] = self._stages.layer_instance_id(owners, surface, buffer, count)
            elif name not in _SURFACE:
                numbers = self._own.get(_NUMBERS[name])
                events[f"layer_{name}"] = self._stages.layer_number(owners, surface.triangles, numbers, buffer, count)
        if any(name in MACROS for name in found):
            inputs = surface._replace(**self._surface)
            outputs = tuple(found.get(name) for name in _SURFACE)
            own = self._own.get("mirrored"), self._own.get("scalars")
            events["surface_layers"] = self._stages.surface_layers(inputs, owners, own, outputs, tiles)

    def finish(self, drawn: dict[str, Array], arrays: dict[str, Array], owners: Array, space: CameraSpace) -> None:
        """Complete layers that kernels have drawn: P is written to `arrays`, which for float64 may hold the same array, and
        the scalar in place."""
        if "P" in drawn:
            _put_in_the_world(drawn["P"], owners, space.camera.eye, space.scale, arrays["P"])
        if "scalar" in drawn:
            _put_into_numbers(drawn["scalar"], self._scalar_exponent)


def _put_in_the_world(points: Array, owners: Array, eye: Array, scale: float, world: Array) -> None:
    """Convert eye-relative points (M, N, 3), times `scale`, to world space, float64 (M, N, 3): far from the origin
    float32 would lose their accuracy. 0 where no triangle owns the pixel. `world` may be `points`."""
    rows = max(1, _BAND // points.shape[1])
    for start in range(0, len(points), rows):  # in bands that fit the caches
        band = slice(start, start + rows)
        np.divide(points[band], scale, out=world[band], dtype=np.float64)
        world[band] += eye
        np.copyto(world[band], 0.0, where=(owners[band] < 0)[..., None])


def _put_into_numbers(scalars: Array, exponent: int) -> None:
    """Turn what the kernel wrote into the scalars themselves, in place: times 2^exponent, NaN where there are none."""
    none = scalars >= NAN_POSITION
    if exponent:
        most = np.finfo(scalars.dtype).max
        with np.errstate(over="ignore", under="ignore"):
            np.clip(np.ldexp(scalars.astype(np.float64), exponent), -most, most, out=scalars, casting="same_kind")
    scalars[none] = np.nan
