"""The layers of a frame: ids, depth, position, normal, color and texture coordinates at each pixel."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Array
from ..images.layers import LAYER_TABLE, Layer
from ..scene.contents import first_instances, instance_names, object_names, object_numbers
from ..scene.model import Material, Scene, Settings, Texture
from .buffers import Buffer, Pool
from .camera_space import CameraSpace
from .features import Features, uses_normal_indices
from .gather import Gatherer
from .launches import FrameInFlight, Stages, items
from .struct_layout import LAYER_BITS, MIRRORED, NAN_POSITION, surface_parameters

_BAND = 1 << 13  # pixels


class LayerTables(NamedTuple):
    """What only layers read.

    arrays: those of object_id, material_id and instance_id, (F,) uint32; and by the names of the kernel's parameters,
    normals and uvs with their indices as in scene_tables.Packed, unless those of the lighting serve; mirrored, (F,) int32;
    scalars, (3F,) reals, at the corners of faces, times 2^-scalar_exponent; NAN_POSITION for none. Where instances are drawn
    from one copy of their mesh, object_normals are in place of normals, and there is no instance_id by face.
    """

    requested: int  # bits of LAYER_BITS and MIRRORED, 0 without any
    arrays: Mapping[str, Array]
    scalar_exponent: int = 0


def _material_key(material: Material) -> tuple[Any, ...]:
    """Return a hashable key of a material: every field, but not the texels of its texture."""
    values = [getattr(material, field.name) for field in fields(Material) if field.name != "texture"]
    texture = material.texture
    described = None if texture is None else (texture.texels.shape, texture.wrap, texture.lookup, texture.filter)
    return (*(tuple(value) if isinstance(value, np.ndarray) else value for value in values), described)


def material_numbers(scene: Scene) -> tuple[int, ...]:
    """Return the number of each mesh's material, from 1 in the order of the meshes; equal materials, name and texels
    included, share one."""
    numbers: dict[int, int] = {}  # by id
    # Scenes may have thousands of materials: few pairs are compared.
    alike: dict[tuple[Any, ...], list[tuple[Texture | None, int]]] = {}
    count = 0
    for material in {id(mesh.material): mesh.material for mesh in scene.meshes}.values():
        mine, same_key = material.texture, alike.setdefault(_material_key(material), [])
        for texture, number in same_key:
            if texture is mine or (texture and mine and np.array_equal(texture.texels, mine.texels)):
                numbers[id(material)] = number
                break
        else:
            numbers[id(material)] = count = count + 1
            same_key.append((mine, count))
    return tuple(numbers[id(mesh.material)] for mesh in scene.meshes)


def number_names(scene: Scene, layer: Layer) -> Iterable[tuple[int, str]]:
    """Return the numbers of object_id, material_id or instance_id with their names, "" for none."""
    if layer == "material_id":
        return zip(material_numbers(scene), (mesh.material.name for mesh in scene.meshes), strict=True)
    return enumerate(object_names(scene) if layer == "object_id" else instance_names(scene), 1)


def layer_features(light: Features, requested: int) -> Features | None:
    """Return the features of the layers' program; None if it draws none. light: those of the image's.
    requested: see LayerTables."""
    if not requested:
        return None
    casts = any(requested & bit for name, bit in LAYER_BITS.items() if "casters" in LAYER_TABLE[name].reads)
    return light.including("CASTERS") if casts else light


def layer_tables(gatherer: Gatherer, scene: Scene, settings: Settings, light: Features) -> LayerTables:
    """Return the tables of the layers asked for. scene: with its own materials. light: the features of the image's
    program."""
    names = settings.layers
    bits = sum(bit for name, bit in LAYER_BITS.items() if name in names)
    if not gatherer.copies:
        return LayerTables(bits, {})
    reads = {table for name in names for table in LAYER_TABLE[name].reads}
    exponent, tables = 0, dict[str, Array]()
    if "normals" in reads and not light.needs_any("TERMS"):
        indexed = any(uses_normal_indices(scene, mesh) for mesh in scene.meshes if len(mesh.faces))
        tables |= gatherer.normals(indexed)
    if "uvs" in reads:
        indexed = any(mesh.uv_faces is not None for mesh in scene.meshes if len(mesh.faces))
        tables |= gatherer.uvs(indexed, untextured=True)
    if "mirrored" in reads and any(copy.mirrored.any() for copy in gatherer.copies):
        bits |= MIRRORED
        tables["mirrored"] = gatherer.mirrored()
    if "scalars" in reads:
        tables["scalars"], exponent = gatherer.corner_scalars()
    numbers = {"object_id": object_numbers, "material_id": material_numbers}
    tables |= {name: gatherer.per_face(of(scene), np.uint32) for name, of in numbers.items() if name in names}
    if "instance_id" in names and not light["INSTANCES"]:
        tables["instance_id"] = gatherer.per_copy(first_instances(scene))
    return LayerTables(bits, tables, exponent)


class Layers:
    """The layers asked for; what they read besides the image's tables stays on the device.

    names: of the layers, as in Settings. kinds: components, () or (K,), and type of each. kernel_types: those in which the
    kernels write them, which are other ones of P.
    """

    def __init__(self, stages: Stages, pool: Pool, names: tuple[Layer, ...], tables: LayerTables) -> None:
        self._stages, self._pool, real = stages, pool, stages.structs.real
        self.kinds: dict[str, tuple[tuple[int, ...], np.dtype]]
        self.kinds = {name: (LAYER_TABLE[name].shape, LAYER_TABLE[name].dtype(real)) for name in names}
        self.kernel_types = {name: np.dtype(real) if name == "P" else kind for name, (_, kind) in self.kinds.items()}
        self._requested, self._scalar_exponent = tables.requested, tables.scalar_exponent
        self._own = {name: Buffer(stages.device, array) for name, array in tables.arrays.items()}
        self._surface = {name: buffer for name, buffer in self._own.items() if name in surface_parameters("INSTANCES")}

    @property
    def nbytes(self) -> int:
        """Size of the tables that only layers read."""
        return sum(buffer.array.nbytes for buffer in self._own.values())

    def draw(self, frame: FrameInFlight) -> dict[str, Array]:
        """Draw the layers of a frame that is drawn: by name, (M, N) or (M, N, K)."""
        layers, owners = dict[str, Array](), frame.values["owners"]
        if owners is None:
            return layers
        size = owners.array.shape
        for name, (width, _) in self.kinds.items():
            frame.layers[name], layers[name] = self._pool.take((*size, *width), self.kernel_types[name])
        self.enqueue(frame)
        for buffer in (*frame.layers.values(), *([owners] if "P" in layers else [])):
            buffer.to_host()
        arrays = dict(layers)
        if "P" in layers and layers["P"].dtype != np.float64:
            arrays["P"] = self._pool.take_host((*size, 3), np.float64)
        self.finish(layers, arrays, owners.array, frame.space)
        return arrays

    def enqueue(self, frame: FrameInFlight) -> None:
        """Enqueue the drawing of the layers into the frame's buffers."""
        layers, values, owners, stages = frame.layers, frame.values, frame.values["owners"], self._stages
        if owners is None or not layers:
            return
        for name, buffer in layers.items():
            if name == "Z":
                size = stages.tiles("layer_z", frame.tiles)
                frame.events["layer_z"] = stages.run("layer_z", size, values, depths=buffer)
            elif name not in LAYER_BITS:
                of_instances = name == "instance_id" and values["instances"] is not None
                arguments = {"shown": buffer, "numbers": self._own.get(name), "count": owners.array.size}
                arguments |= {"in_table": name != "id" and not of_instances, "of_instances": of_instances}
                size = items(owners.array.size)
                frame.events[f"layer_{name}"] = stages.run("layer_number", size, values, **arguments)
        if any(name in LAYER_BITS for name in layers):
            values = {**values, **self._surface, "requested": self._requested}
            values |= {name: self._own.get(name) for name in ("mirrored", "scalars")}
            values |= {f"to_{name}": layers.get(name) for name in LAYER_BITS}
            size = stages.tiles("surface_layers", frame.tiles)
            frame.events["surface_layers"] = stages.run("surface_layers", size, values)

    def finish(self, layers: dict[str, Array], arrays: dict[str, Array], owners: Array, space: CameraSpace) -> None:
        """Complete layers that kernels have drawn: P is written to `arrays`, which for float64 may hold the same array, and
        the scalar in place."""
        if "P" in layers:
            # `points` are relative to the eye, times the scale: far away float32 would lose digits.
            points, world = layers["P"], arrays["P"]
            rows = max(1, _BAND // points.shape[1])
            for start in range(0, len(points), rows):  # in bands that fit the caches
                band = slice(start, start + rows)
                np.divide(points[band], space.scale, out=world[band], dtype=np.float64)
                world[band] += space.camera.eye
                np.copyto(world[band], 0.0, where=(owners[band] < 0)[..., None])
        if "scalar" in layers:
            scalars, exponent = layers["scalar"], self._scalar_exponent
            none = scalars >= NAN_POSITION  # what the kernel writes where there is no scalar
            if exponent:
                largest = np.finfo(scalars.dtype).max
                with np.errstate(over="ignore", under="ignore"):
                    scaled = np.ldexp(scalars.astype(np.float64), exponent)
                    np.clip(scaled, -largest, largest, out=scalars, casting="same_kind")
            scalars[none] = np.nan
