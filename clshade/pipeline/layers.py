"""The layers of a frame: ids, depth, position, normal, color and texture coordinates at each pixel."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.arrays import Array
from ..images.layers import LAYER_TABLE, Layer
from .buffers import Buffer, Pool
from .camera_space import CameraSpace
from .launches import Stages, items
from .layer_buffers import LayerTables
from .layer_outputs import SURFACE_LAYERS
from .struct_layout import NAN_POSITION
from .surface_inputs import SurfaceInputs

_BAND = 1 << 13  # pixels


class Layers:
    """The layers asked for; what they read besides the image's tables stays on the device.

    names: of the layers, as in Settings.
    """

    def __init__(self, stages: Stages, pool: Pool, names: tuple[Layer, ...], tables: LayerTables) -> None:
        self._stages, self._pool, self._names = stages, pool, names
        self._asked, self._scalar_exponent = tables.asked, tables.scalar_exponent
        self._own = {name: Buffer(stages.device, array) for name, array in tables.arrays.items()}
        self._surface = {name: buffer for name, buffer in self._own.items() if name in SurfaceInputs._fields}

    @property
    def nbytes(self) -> int:
        """Size of the tables that only layers read."""
        return sum(buffer.array.nbytes for buffer in self._own.values())

    def kinds(self) -> dict[str, tuple[tuple[int, ...], np.dtype]]:
        """Return the components and the type of each layer, by name: () or (K,)."""
        real = self._stages.structs.real
        return {name: (LAYER_TABLE[name].shape, LAYER_TABLE[name].dtype(real)) for name in self._names}

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
        count, stages = owners.array.size, self._stages
        values: dict[str, Any] = {"owners": owners, "triangles": surface.triangles, "image": surface.image}
        values |= {"triangle_instances": surface.triangle_instances, "instances": surface.instances}
        for name, buffer in found.items():
            if name == "Z":
                events["layer_z"] = stages.run("layer_z", stages.tiles("layer_z", tiles), values, depths=buffer)
            elif name not in SURFACE_LAYERS:
                kernel = "layer_id" if name == "id" else "layer_number"
                if name == "instance_id" and surface.instances is not None:
                    kernel = "layer_instance_id"
                own = {"ids": buffer, "shown": buffer, "numbers": self._own.get(name)}
                events[f"layer_{name}"] = stages.run(kernel, items(count), values, **own, count=count)
        if any(name in SURFACE_LAYERS for name in found):
            values |= surface._replace(**self._surface).values()
            values |= {"mirrored": self._own.get("mirrored"), "scalars": self._own.get("scalars"), "asked": self._asked}
            values |= {f"to_{name}": found.get(name) for name in SURFACE_LAYERS}
            events["surface_layers"] = stages.run("surface_layers", stages.tiles("surface_layers", tiles), values)

    def finish(self, drawn: dict[str, Array], arrays: dict[str, Array], owners: Array, space: CameraSpace) -> None:
        """Complete layers that kernels have drawn: P is written to `arrays`, which for float64 may hold the same array, and
        the scalar in place."""
        if "P" in drawn:
            points, world = drawn["P"], arrays["P"]  # eye-relative, times the scale: far away float32 would lose digits
            rows = max(1, _BAND // points.shape[1])
            for start in range(0, len(points), rows):  # in bands that fit the caches
                band = slice(start, start + rows)
                np.divide(points[band], space.scale, out=world[band], dtype=np.float64)
                world[band] += space.camera.eye
                np.copyto(world[band], 0.0, where=(owners[band] < 0)[..., None])
        if "scalar" in drawn:
            scalars, exponent = drawn["scalar"], self._scalar_exponent
            none = scalars >= NAN_POSITION  # what the kernel writes where there is no scalar
            if exponent:
                most = np.finfo(scalars.dtype).max
                with np.errstate(over="ignore", under="ignore"):
                    scaled = np.ldexp(scalars.astype(np.float64), exponent)
                    np.clip(scaled, -most, most, out=scalars, casting="same_kind")
            scalars[none] = np.nan
