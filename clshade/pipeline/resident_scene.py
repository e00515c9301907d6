"""A scene on a device: what does not change from frame to frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..scene.model import Scene, Settings
from . import light_points, scene_buffers
from .buffers import Buffer
from .camera_space import Extent
from .features import Features, casts_alpha, looks_up
from .hierarchy import CasterFrame, Hierarchy
from .instances import Instances
from .launches import Stages, lookup_stages
from .light_table import LightTable
from .scene_buffers import Packed
from .shadow_view import shadow_factors, shadow_lights
from .struct_layout import SHADOW_REACH, Structs
from .triangle_source import SceneFaces, TriangleSource

# Tables of Packed that pixel stages read under the same names.
_TABLES = (
    *("normal_faces", "color_map", "uvs", "uv_faces", "tangent_faces", "face_materials", "environment", "radiance"),
    *("backdrop", "alphas"),
)
_PLACED = ("normals", "tangents")  # read as object_normals and object_tangents of instances
_FARTHEST = 4.0 * SHADOW_REACH  # longer than any diagonal of the casters' box, so that longer rays meet no more
_LEAST = 2.0**-60  # shorter rays end where they begin


def hemisphere_row(settings: Settings, frame: CasterFrame, structs: Structs) -> Array:
    """Return one row of structs.Light whose points are those of the unit disc below the hemisphere. shadow_scale is the
    rays' length in the units of shadows; no points without ambient occlusion."""
    rows = np.zeros(1, structs.Light)
    if not settings.ambient_occlusion or settings.ao_distance is None:
        return rows
    row = rows[0]
    row["points"], row["sphere"], row["axis"] = settings.ambient_occlusion, 1, light_points.AXIS
    row["right"], row["up"] = light_points.disc_radii()
    with np.errstate(over="ignore"):
        distance = float(np.minimum(np.float64(settings.ao_distance) * frame.unit, _FARTHEST))
    row["shadow_scale"] = distance if distance >= _LEAST else 0.0
    light_points.write_pattern(row, settings.ambient_occlusion)
    return rows


class ResidentScene:
    """The buffers of a scene, for as long as it is drawn.

    Parameters are those of `SceneDrawing`, and of_layers: features of the layers' program, None without one. Raises
    DeviceError if the scene does not fit into the device's memory.

    structs: of the kernels. extent: of the scene, None without faces. source: of its triangles. inputs: of the pixel stages,
    by name, all but those that a frame makes. faces: (F, 3). lights, casters: what the tables of a frame are made from;
    casters None where nothing casts shadows. map_colors: number of colors of the color map. nbytes: of device memory.
    """

    def __init__(
        self,
        stages: Stages,
        scene: Scene,
        settings: Settings,
        features: Features,
        packed: Packed,
        of_layers: Features | None,
    ) -> None:
        self.stages, self.scene, self.settings, self.features = stages, scene, settings, features
        self.device, self.structs = stages.device, stages.structs
        scene_buffers.check_device(self.device, packed, self.structs)
        self.extent = Extent.of(packed.low, packed.high) if len(packed.faces) else None
        self.map_colors = 0 if packed.color_map is None else len(packed.color_map) - 4
        self.faces = Buffer(self.device, packed.faces)
        self.lights = LightTable(scene.lights, packed.light_unit, self.structs, settings.light_samples)
        self.inputs: dict[str, Any] = {"faces": self.faces, **self._surface(packed)}
        self.source, source_bytes = self._source_of(packed)
        self.nbytes = source_bytes + sum(each.array.nbytes for each in self.inputs.values() if each is not None)
        self.casters: Hierarchy | None = None
        if features["CASTERS"] or (of_layers is not None and of_layers["CASTERS"]):
            positions = packed.positions.astype(np.float64)
            veils = scene_buffers.faces_with(packed, "blends", "alpha_tested") if casts_alpha(self.scene) else None
            self.casters = Hierarchy(self.device, positions, packed.faces, lanes=self.stages.lanes, veils=veils)
            self.lights.shadow_factors = shadow_factors(self.scene.lights, self.casters.frame)
            self.nbytes += self.casters.nbytes
            self.inputs.update(self._shadow_inputs(self.casters))

    def _surface(self, packed: Packed) -> dict[str, Buffer | None]:
        arrays = {name: getattr(packed, name) for name in _TABLES}
        prefix = "" if packed.instances is None else "object_"
        arrays |= {prefix + name: getattr(packed, name) for name in _PLACED}
        arrays["colors"] = packed.colors if packed.corner_uvs is None else self._corner_colors(packed)
        if looks_up(self.features):
            arrays |= {"textures": packed.textures, "texels": packed.texels}
        arrays["materials"] = packed.materials
        return {name: None if array is None else Buffer(self.device, array) for name, array in arrays.items()}

    def _source_of(self, packed: Packed) -> tuple[TriangleSource, int]:
        """Return where the triangles come from, and the size of what stays of it."""
        positions = Buffer(self.device, packed.positions)
        sided = self.features["SIDES"]
        sides = (self.inputs["face_materials"], self.inputs["materials"]) if sided else (None, None)
        if packed.instances is None:
            return SceneFaces(self.stages, positions, self.faces, sides), positions.array.nbytes
        pixels, painter = math.prod(self.scene.camera.resolution), not self.features["DEPTH_TEST"]
        arguments = (self.stages, packed.instances, positions, self.faces, sides, pixels)
        instances = Instances(*arguments, painter=painter)
        return instances, positions.array.nbytes + instances.resident_bytes

    def _shadow_inputs(self, casters: Hierarchy) -> dict[str, Buffer]:
        every = casters.casters.array
        of_lights = every if self.settings.shadows else np.zeros_like(every)
        return {
            "shadow_vertices": casters.vertices,
            "shadow_nodes": casters.nodes,
            "shadow_leaves": casters.leaves,
            "shadow_casters": Buffer(self.device, np.concatenate([of_lights, every])),
            "shadow_lights": Buffer(self.device, shadow_lights(self.scene.lights, casters.frame)),
            "shadow_hemisphere": Buffer(self.device, hemisphere_row(self.settings, casters.frame, self.structs)),
        }

    def _corner_colors(self, packed: Packed) -> Array:
        """Return the (3F, 4) colors for texture_at vertex: the texel at each corner times the vertex color."""
        colors: Array = packed.colors  # type: ignore[assignment]
        rows = np.flatnonzero(packed.corner_textures >= 0)  # type: ignore[operator]
        looked_up = Buffer.empty(self.device, (len(rows), 4), self.structs.real)
        uvs = Buffer(self.device, packed.corner_uvs[rows])  # type: ignore[index]
        texture_of = Buffer(self.device, packed.corner_textures[rows])  # type: ignore[index]
        table = np.array(packed.textures)
        table["nearest"] = 0  # see `ignored`
        textures, texels = Buffer(self.device, table), Buffer(self.device, np.asarray(packed.texels))
        stages = lookup_stages(self.device, self.features, self.stages.lanes)
        stages.bilerp(uvs, texture_of, textures, texels, looked_up, len(rows))
        colors[rows, :3] *= looked_up.to_host()[:, :3]
        return colors
