"""A single triangle, point or texture lookup, on the kernels that draw whole scenes."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.model import Material, Texture
from ..scene.settings import Shader
from . import shading_tables, struct_layout
from .buffers import Buffer, TriangleBuffers
from .draw import TileLists
from .features import Features, derive_alone
from .launches import FrameInFlight, scene_stages, stages_of
from .opencl.device import Device
from .triangle_source import set_up_pieces

_SUBPIXELS = 1 << struct_layout.SUBPIXEL_BITS


@dataclass(frozen=True)
class PointLighting:
    """The lights and the material at a point."""

    point: Floats  # (3,), world space, and the eye
    eye: Floats
    positions: Floats  # (L, 3), of the lights
    intensities: Floats
    material: Material  # its ka is already ka*Ia


NOWHERE = PointLighting(np.zeros(3), np.zeros(3), np.zeros((0, 3)), np.zeros((0, 3)), Material(0.0, 0.0, 0.0, 1.0))


def reach(around: PointLighting) -> float:
    """Return the largest absolute coordinate of the point relative to the eye; infinite if it overflows float64."""
    with np.errstate(over="ignore"):
        return float(np.abs(around.point - around.eye).max())


def _lit(around: PointLighting, colors: Array) -> dict[str, Any]:
    """Return what the reflection model reads for one point, by name; lights of intensity 0 are left out."""
    shining = around.intensities.any(axis=1)
    brightest = float(colors.max(initial=0.0))
    light_unit = shading_tables.light_unit([around.material], around.intensities, np.zeros(3), brightest)
    scale, count = shading_tables.scale_for(reach(around)), int(shining.sum())
    lights = np.zeros(max(count, 1), struct_layout.SINGLE.Light)
    if count:
        lights["position"] = shading_tables.relative_lights(around.positions[shining], around.eye, scale)
        lights["intensity"] = shading_tables.to_real(around.intensities[shining] / light_unit)
    materials = shading_tables.material_table([around.material], [], np.ones(3))
    points = _four((around.point - around.eye)[None] * scale)
    return {"points": points, "lights": lights, "materials": materials, "light_count": count, "unit": light_unit}


_light_stages = cache(lambda device, features: stages_of(device, "light.cl", features=features))


def _four(vectors: Array) -> Array:
    wide = np.zeros((len(vectors), 4), np.float32)
    wide[:, :3] = shading_tables.to_real(vectors)
    return wide


def _on_device(device: Device, values: dict[str, Any]) -> dict[str, Any]:
    """Return arguments of kernels with buffers in place of arrays. They stay referenced until the kernels are done: memory
    is freed with its buffer."""
    return {name: Buffer(device, value) if isinstance(value, np.ndarray) else value for name, value in values.items()}


def unit(vectors: Array) -> Floats:
    """Normalize (K, 3) float64 directions of any length; 0 stays 0."""
    size = np.ldexp(1.0, -np.frexp(np.abs(vectors).max(axis=1, keepdims=True))[1])
    scaled = vectors * np.minimum(size, 2.0**1000)
    length = np.sqrt((scaled * scaled).sum(axis=1, keepdims=True))
    return np.asarray(scaled / np.where(length > 0.0, length, 1.0))


def light_point(device: Device, around: PointLighting, normal: Floats, color: Floats) -> Floats:
    """Return the light that a point sends to the eye, (3,) float64. normal: any length, 0 reflects nothing. color:
    (3,)."""
    features = derive_alone("phong", around.material, bool(around.intensities.any()))
    vectors = {"normals": _four(unit(normal[None])), "colors": _four(color[None]), "lit": np.zeros((1, 4), np.float32)}
    values = _on_device(device, {**_lit(around, color), **vectors})
    _light_stages(device, features).run("light", (1, 1), values, needs=features.needs, count=1)
    return np.asarray(values["lit"].to_host()[0, :3].astype(np.float64))


class Lookup:
    """A texture that stays on the device."""

    def __init__(self, device: Device, texture: Texture) -> None:
        self._stages = stages_of(device, "bilerp.cl")
        table, texels = shading_tables.texture_tables([texture])
        self._tables = _on_device(device, {"textures": table, "texels": texels})

    def __call__(self, uvs: Floats) -> Floats:
        """Return the colors (K, 3), float64, at texture coordinates (K, 2)."""
        count = len(uvs)
        arrays = {"uvs": shading_tables.split_uvs(uvs), "texture_of": np.zeros(count, np.int32)}
        values = _on_device(self._stages.device, {**arrays, "colors": np.zeros((count, 4), np.float32)})
        self._stages.run("bilerp", self._stages.vectors(count), {**self._tables, **values}, count=count)
        return np.asarray(values["colors"].to_host()[:, :3].astype(np.float64))


# One triangle


def _clipped(polygon: list[list[Any]]) -> list[list[Any]]:
    """Clip a polygon to the guard band; its rows are u, v and the weights of a triangle's corners.

    Sutherland and Hodgman's algorithm in rational numbers: a corner may be as far away as float64 allows.
    """
    polygon = [[Fraction(x) for x in row] for row in polygon]
    for axis in (0, 1):
        for side, limit in ((1, struct_layout.GUARD_LOW), (-1, struct_layout.GUARD_HIGH)):
            distance = [side * (corner[axis] - limit) for corner in polygon]
            pieces = []
            for i, (corner, d) in enumerate(zip(polygon, distance, strict=True)):
                following, d_following = polygon[i + 1 - len(polygon)], distance[i + 1 - len(polygon)]
                if d >= 0:
                    pieces.append(corner)
                if (d >= 0) != (d_following >= 0):
                    t = d / (d - d_following)
                    pieces.append([a + t * (b - a) for a, b in zip(corner, following, strict=True)])
            polygon = pieces
    return polygon


def _pieces(corners: Array) -> Array:
    """Return `struct_layout.SINGLE.Piece` rows of a triangle (3, 2), image coordinates: itself, or its parts in the guard
    band."""
    polygon = np.concatenate([corners, np.eye(3)], axis=1).tolist()
    if not ((corners >= struct_layout.GUARD_LOW) & (corners <= struct_layout.GUARD_HIGH)).all():
        polygon = _clipped(polygon)
    table = np.zeros(max(len(polygon) - 2, 0), struct_layout.SINGLE.Piece)
    for i, row in enumerate(table, 1):
        piece = polygon[0], polygon[i], polygon[i + 1]
        row["x"], row["y"] = ([round(corner[axis] * _SUBPIXELS) for corner in piece] for axis in (0, 1))
        row["weights"] = [float(weight) for corner in piece for weight in corner[2:]]
    table["w"], table["key_depth"] = 1.0, 1.0
    return table


def _covered(places: Array, size: int) -> slice:
    """Return the columns, or rows, of so many that pieces with corners at these places may cover."""
    half = _SUBPIXELS // 2
    first = max(-((half - int(places.min())) // _SUBPIXELS), 0)
    return slice(first, max(first, min((int(places.max()) - half) // _SUBPIXELS + 1, size)))


def draw_triangle(
    device: Device, shader: Shader, corners: Array, normals: Array, colors: Array, around: PointLighting, image: Array
) -> None:
    """Draw a triangle over an image, (M, N, 3) float64 with row 0 at the BOTTOM, in place.

    shader: gouraud, phong or nolight. corners: (3, 2) image coordinates. normals, colors: (3, 3), rows are corners.
    around: of the whole triangle: the directions to eye and lights are those at its point. Normals of any length:
    gouraud uses the direction of each, phong interpolates them as they are.
    """
    pieces = _pieces(corners)
    if not len(pieces):
        return
    columns, rows = (_covered(pieces[name], size) for name, size in zip("xy", image.shape[1::-1], strict=True))
    target = image[rows, columns]
    if not target.size:
        return
    pieces["x"] -= columns.start * _SUBPIXELS
    pieces["y"] -= rows.start * _SUBPIXELS
    normals = unit(normals) if shader == "gouraud" else np.ldexp(normals, -np.frexp(np.abs(normals).max())[1])
    arrays = {**_lit(around, colors), "normals": _four(normals), "colors": _four(colors)}
    bright = bool((np.abs(colors) > 1.0).any())
    features = derive_alone(shader, around.material, bool(around.intensities.any()), bright)
    rgba = _draw(device, features, pieces, arrays, target.shape[:2])
    if rgba is not None:
        upward = rgba[::-1]
        np.copyto(target, upward[:, :, :3], where=upward[:, :, 3:] > 0.0)


def _draw(
    device: Device, features: Features, pieces: Array, arrays: dict[str, Any], shape: tuple[int, ...]
) -> Array | None:
    """Draw only the pieces: RGBA of a shape (M, N), row 0 at the top; None if no pixel is covered. arrays: of `_lit`, and of
    the corners."""
    stages, buffers = scene_stages(device, features), TriangleBuffers(device, 1, len(pieces))
    image = np.zeros(1, struct_layout.SINGLE.Image)
    image["needs"], image["lights"] = features.needs, arrays["light_count"]
    image["unscale"], image["light_unit"] = 1.0, arrays["unit"]
    image["rows"], image["columns"] = rows, columns = shape
    image["tiles_x"] = -(-columns // struct_layout.TILE_SIZE)
    image["tiles"] = image["tiles_x"] * -(-rows // struct_layout.TILE_SIZE)
    # All corners are at the point, and so is the triangle's centroid.
    arrays |= {"relative": np.repeat(arrays["points"], 3, axis=0), "faces": np.arange(3, dtype=np.int32)[None]}
    arrays |= {"counters": np.zeros(1, struct_layout.SINGLE.Counters), "rgba": np.empty((*shape, 4), np.float32)}
    arrays["image"] = image
    values = {**struct_layout.surface_inputs(**_on_device(device, arrays)), "owners": None, "shown": None}
    values |= {**buffers.values, "keys": buffers.keys, "sorted": buffers.sorted_bounds}
    frame = FrameInFlight(values)
    set_up_pieces(stages, Buffer(device, pieces), frame, 1)
    frame.visible = int(frame.read_counters()["visible"])
    if not frame.visible:
        return None
    TileLists(stages).draw_sorted(frame)
    return np.asarray(values["rgba"].to_host())
