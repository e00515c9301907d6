"""A single triangle, point or texture lookup, on the kernels that draw whole scenes."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.model import Material, Texture
from ..scene.settings import Shader
from . import shading_tables, struct_layout, surface_inputs
from .buffers import Buffer, TriangleBuffers
from .features import Features, derive_alone
from .frame_state import FrameInFlight
from .launches import Stages, lookup_stages, scene_stages
from .opencl.device import Device
from .programs import build
from .tile_lists import DepthOrder, TileLists, draw_sorted
from .triangle_source import Triangles, set_up_pieces

_SUBPIXELS = 1 << struct_layout.SUBPIXEL_BITS
_ONES = np.ones(3)
_ORIGIN = np.zeros(3)


@dataclass(frozen=True)
class PointLighting:
    """The lights and the material at a point.

    point, eye: (3,) world space. positions, intensities: (L, 3) of the lights. material: its ka is already ka*Ia.
    """

    point: Floats
    eye: Floats
    positions: Floats
    intensities: Floats
    material: Material


NOWHERE = PointLighting(_ORIGIN, _ORIGIN, np.zeros((0, 3)), np.zeros((0, 3)), Material(0.0, 0.0, 0.0, 1.0))


def reach(around: PointLighting) -> float:
    """Return the largest absolute coordinate of the point relative to the eye; infinite if it overflows float64."""
    with np.errstate(over="ignore"):
        return float(np.abs(around.point - around.eye).max())


class _Lit:
    """The buffers that the reflection model reads, for one point; lights of intensity 0 are left out."""

    def __init__(self, device: Device, around: PointLighting, colors: Array) -> None:
        shining = around.intensities.any(axis=1)
        self.count = int(shining.sum())
        brightest = float(colors.max(initial=0.0))
        self.unit = shading_tables.light_unit([around.material], around.intensities, np.zeros(3), brightest)
        scale = shading_tables.scale_for(reach(around))
        self.relative = np.zeros((1, 4), np.float32)
        self.relative[0, :3] = shading_tables.to_real((around.point - around.eye) * scale)
        lights = np.zeros(max(self.count, 1), struct_layout.SINGLE.Light)
        if self.count:
            lights["position"] = shading_tables.relative_lights(around.positions[shining], around.eye, scale)
            lights["intensity"] = shading_tables.to_real(around.intensities[shining] / self.unit)
        self.lights = Buffer(device, lights)
        self.materials = Buffer(device, shading_tables.material_table([around.material], [], _ONES))


def _features(shader: Shader, around: PointLighting, bright: bool = False) -> Features:
    """Return the features of `derive_alone`, see there for `bright`."""
    return derive_alone(shader, around.material, bool(around.intensities.any()), bright)


@cache
def _light_stages(device: Device, features: Features) -> Stages:
    return Stages(device, build(device, features, ("light.cl",)))


def _four(device: Device, vectors: Array) -> Buffer:
    wide = np.zeros((len(vectors), 4), np.float32)
    wide[:, :3] = shading_tables.to_real(vectors)
    return Buffer(device, wide)


def unit(vectors: Array) -> Floats:
    """Normalize (K, 3) float64 directions of any length; 0 stays 0."""
    size = np.ldexp(1.0, -np.frexp(np.abs(vectors).max(axis=1, keepdims=True))[1])
    scaled = vectors * np.minimum(size, 2.0**1000)
    length = np.sqrt((scaled * scaled).sum(axis=1, keepdims=True))
    units: Floats = scaled / np.where(length > 0.0, length, 1.0)
    return units


def light_point(device: Device, around: PointLighting, normal: Floats, color: Floats) -> Floats:
    """Return the light that a point sends to the eye, (3,) float64. normal: any length, 0 reflects nothing. color:
    (3,)."""
    stages = _light_stages(device, _features("phong", around))
    lit = _Lit(device, around, color)
    # Every buffer stays referenced until the kernels are done: its memory is freed with it.
    points, normals = Buffer(device, lit.relative), _four(device, unit(normal[None]))
    colors = _four(device, color[None])
    result = Buffer.empty(device, (1, 4), np.float32)
    inputs = {"points": points, "normals": normals, "colors": colors, "materials": lit.materials, "lights": lit.lights}
    numbers = {"needs": _features("phong", around).needs, "unit": lit.unit, "light_count": lit.count, "count": 1}
    stages.run("light", stages.vectors(1), inputs, lit=result, **numbers)
    return result.to_host()[0, :3].astype(np.float64)


class Lookup:
    """A texture that stays on the device."""

    def __init__(self, device: Device, texture: Texture) -> None:
        self._device = device
        self._stages = lookup_stages(device, _features("nolight", NOWHERE))
        table, texels = shading_tables.texture_tables([texture])
        self._tables = {"textures": Buffer(device, table), "texels": Buffer(device, texels)}

    def __call__(self, uvs: Floats) -> Floats:
        """Return the colors (K, 3), float64, at texture coordinates (K, 2)."""
        device, count = self._device, len(uvs)
        colors = Buffer.empty(device, (count, 4), np.float32)
        own = {
            "uvs": Buffer(device, shading_tables.split(uvs)),
            "texture_of": Buffer(device, np.zeros(count, np.int32)),
        }
        self._stages.run("bilerp", self._stages.vectors(count), {**self._tables, **own}, colors=colors, count=count)
        return colors.to_host()[:, :3].astype(np.float64)


# One triangle


def _clipped(corners: Array) -> list[list[Fraction]]:
    """Clip a triangle (3, 2) to the guard band: rows u, v and the three corners' weights.

    Sutherland and Hodgman's algorithm in rational numbers: a corner may be as far away as float64 allows.
    """
    polygon = [[Fraction(x) for x in (*uv, *row)] for uv, row in zip(corners.tolist(), np.eye(3).tolist(), strict=True)]
    for axis in (0, 1):
        for side, limit in ((1, struct_layout.GUARD_LOW), (-1, struct_layout.GUARD_HIGH)):
            distance = [side * (corner[axis] - limit) for corner in polygon]
            kept = []
            for i, (corner, d) in enumerate(zip(polygon, distance, strict=True)):
                following, d_following = polygon[i + 1 - len(polygon)], distance[i + 1 - len(polygon)]
                if d >= 0:
                    kept.append(corner)
                if (d >= 0) != (d_following >= 0):
                    t = d / (d - d_following)
                    kept.append([a + t * (b - a) for a, b in zip(corner, following, strict=True)])
            polygon = kept
    return polygon


def _pieces(corners: Array) -> Array:
    """Return `struct_layout.SINGLE.Piece` rows of a triangle (3, 2), image coordinates: itself, or its parts in the guard
    band."""
    if ((corners >= struct_layout.GUARD_LOW) & (corners <= struct_layout.GUARD_HIGH)).all():
        table = np.zeros(1, struct_layout.SINGLE.Piece)
        snapped = np.rint(corners * _SUBPIXELS)
        table["x"], table["y"], table["weights"] = snapped[:, 0], snapped[:, 1], np.eye(3).reshape(-1)
    else:
        polygon = _clipped(corners)
        fan = [[polygon[0], polygon[i], polygon[i + 1]] for i in range(1, len(polygon) - 1)]
        table = np.zeros(len(fan), struct_layout.SINGLE.Piece)
        for row, piece in zip(table, fan, strict=True):
            row["x"], row["y"] = ([round(corner[axis] * _SUBPIXELS) for corner in piece] for axis in (0, 1))
            row["weights"] = [float(weight) for corner in piece for weight in corner[2:]]
    table["w"], table["key_depth"] = 1.0, 1.0
    return table


def _window(pieces: Array, columns: int, rows: int) -> tuple[int, int, int, int]:
    """Return the first column, the first row, and the numbers of columns and rows that may be covered; not positive if
    none is."""
    half = _SUBPIXELS // 2
    bounds = []
    for name, size in (("x", columns), ("y", rows)):
        first = max(-((half - int(pieces[name].min())) // _SUBPIXELS), 0)
        bounds.append((first, min((int(pieces[name].max()) - half) // _SUBPIXELS, size - 1) - first + 1))
    (column, width), (row, height) = bounds
    return column, row, width, height


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
    column, row, width, height = _window(pieces, image.shape[1], image.shape[0])
    if width <= 0 or height <= 0:
        return
    pieces["x"] -= column * _SUBPIXELS
    pieces["y"] -= row * _SUBPIXELS
    rgba = _draw(device, shader, pieces, (normals, colors), around, (width, height))
    if rgba is not None:
        upward = rgba[::-1]
        drawn = upward[:, :, 3] > 0.0
        for channel in range(3):
            target = image[row : row + height, column : column + width, channel]
            np.copyto(target, upward[:, :, channel], where=drawn)


def _draw(
    device: Device,
    shader: Shader,
    pieces: Array,
    attributes: tuple[Array, Array],
    around: PointLighting,
    resolution: tuple[int, int],
) -> Array | None:
    """Draw only the pieces: RGBA at that resolution, row 0 at the top; None if no pixel is covered."""
    features = _features(shader, around, bool((np.abs(attributes[1]) > 1.0).any()))
    stages = scene_stages(device, features)
    lit = _Lit(device, around, attributes[1])
    table = np.zeros(1, struct_layout.SINGLE.Image)
    table["needs"] = features.needs
    table["columns"], table["rows"] = columns, rows = resolution
    table["tiles_x"] = -(-columns // struct_layout.TILE_SIZE)
    table["tiles"] = -(-columns // struct_layout.TILE_SIZE) * -(-rows // struct_layout.TILE_SIZE)
    table["lights"], table["unscale"], table["light_unit"] = lit.count, 1.0, lit.unit
    image, made = Buffer(device, table), TriangleBuffers(device, 1, len(pieces))
    rgba = Buffer.empty(device, (rows, columns, 4), np.float32)
    frame = FrameInFlight(image, Buffer(device, np.zeros(1, struct_layout.SINGLE.Counters)), rgba)
    on_device = Buffer(device, pieces)
    set_up_pieces(stages, on_device, frame, made, 1)
    visible = int(frame.read_counters()["visible"])
    if not visible:
        return None
    normals, colors = attributes
    normals = unit(normals) if shader == "gouraud" else np.ldexp(normals, -np.frexp(np.abs(normals).max())[1])
    inputs = surface_inputs.surface(
        triangles=made.triangles,
        pieces=on_device,
        faces=Buffer(device, np.arange(3, dtype=np.int32).reshape(1, 3)),
        # All corners are at the point, and so is the triangle's centroid.
        relative=Buffer(device, np.repeat(lit.relative, 3, axis=0)),
        normals=_four(device, normals),
        colors=_four(device, colors),
        materials=lit.materials,
        lights=lit.lights,
        image=image,
    )
    draw_sorted(DepthOrder(device), TileLists(stages), Triangles(made, visible, on_device), inputs, frame)
    return rgba.to_host()
