"""The view of a frame: the camera, its axes, the near plane, and the scale that brings the scene within float32's
range."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..base.arrays import Array
from ..errors import InputError
from ..scene.camera import Camera
from ..scene.geometry import bounding_box, camera_axes
from ..scene.image_part import Raster, raster_of
from ..scene.model import Scene
from .shading_tables import scale_for
from .struct_layout import SUBPIXEL_BITS


class Extent(NamedTuple):
    """The bounding box of a scene's vertices, (3,) each, and half its diagonal."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    radius: float

    @classmethod
    def of(cls, low: Array, high: Array) -> Extent:
        return cls(tuple(low.tolist()), tuple(high.tolist()), math.hypot(*(high / 2.0 - low / 2.0)))


class CameraSpace(NamedTuple):
    """A camera; its axes, rows are camera x, y, z in world space; the distance of the near plane, scene units; the power of
    two that brings eye-relative positions to about 1; and the raster of the image that is drawn in whole or in part."""

    camera: Camera
    axes: Array
    near: float
    scale: float
    raster: Raster

    @classmethod
    def of(cls, camera: Camera, extent: Extent | None, near: float | None) -> CameraSpace:
        """Return the space of a camera. near: as in Settings; None: 1e-4 of the scene's radius. Raises InputError if
        float64 cannot hold the scene."""
        farthest = 1.0
        if extent is not None:
            corners = zip(camera.eye.tolist(), extent.low, extent.high, strict=True)
            farthest = max(max(abs(low - at), abs(high - at)) for at, low, high in corners)
        near = near or 1e-4 * ((extent and extent.radius) or math.dist(camera.eye, camera.lookat))
        if not math.isfinite(farthest) or not math.isfinite(near):
            raise InputError("render: scene: expected coordinates whose differences float64 can hold")
        # A vertex 2^40 times as far away as the near plane must not push near ones out of float32's range.
        return cls(camera, camera_axes(camera), near, scale_for(min(farthest, 2.0**40 * near)), raster_of(camera))

    def write_view(self, view: np.void) -> None:
        """Fill a row of structs.View, but for what the frame needs."""
        raster = self.raster
        view["eye"], view["axes"] = self.camera.eye, self.axes.reshape(-1)
        view["principal"], view["focal"] = raster.principal, self.camera.focal
        view["plane_height"], view["plane_width"] = raster.plane
        view["columns"], view["rows"] = raster.resolution
        view["guarded"] = raster.corner
        view["first"] = [place << SUBPIXEL_BITS for place in raster.first]
        view["near"], view["scale"] = self.near, self.scale

    def points(self, positions: Array) -> Array:
        """Transform world positions (..., 3) to camera space, float64."""
        d = positions.astype(np.float64) - self.camera.eye
        return np.stack([(d[..., 0] * a[0] + d[..., 1] * a[1]) + d[..., 2] * a[2] for a in self.axes], axis=-1)


def near_plane(scene: Scene) -> float:
    """Return the distance of the near plane of a scene whose settings give none."""
    low, high = bounding_box(scene)
    return CameraSpace.of(scene.camera, Extent.of(low, high) if scene.face_count else None, None).near
