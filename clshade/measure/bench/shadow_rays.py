"""The rays of shadows and ambient occlusion of real images: from what the pixels of a scene show, block by block, to the
lights that may reach it, and around."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from ...base.arrays import Array, Bools, Faces, Floats
from ...pipeline.effective_settings import effective_settings
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import render
from ...scene.builtin.scenes import builtin
from ...scene.lights import plain_lights
from ...scene.model import Scene
from ...scene.seen_points import pixel_rays, triangles
from .workloads import HD, knot

SIDE = 4  # pixels of a block, across and down
NOBODY = -1  # face of a lane without a ray
POINTS, EACH = 16, 8  # of a light of finite size, or rays around a point, and of how many blocks one has them
RADIUS = 0.03  # of such a light, of the largest extent of the scene


@dataclass(frozen=True, eq=False)
class ShadowWorkload:
    """A scene whose rays are traced. at_least: least speedup over Embree of rays to lights."""

    name: str
    about: str
    make: Callable[[], Scene]
    at_least: float


WORKLOADS = (
    ShadowWorkload("teapot", "the built-in teapot, 800x600", partial(builtin, "teapot"), 2.0),
    ShadowWorkload("knot", "torus knot of a million triangles, 1920x1080", partial(knot, 10**6, HD), 1.5),
)


@dataclass(frozen=True, eq=False)
class Receivers:
    """Points that one light may reach, or light from all around. Lane k of block i is a pixel of a square of SIDE x SIDE
    pixels, row by row.

    points: (B, 16, 3), world space; 0 in lanes without a ray. faces: (B, 16), the face that each lies on, NOBODY
    in lanes without a ray. light: (3,), position; None: all around. ends: (B, 16, N, 3), where the N rays of each lane end,
    at points of a light of finite size or of a hemisphere; None: one ray, at the light.
    """

    points: Floats
    faces: Faces
    light: Floats | None
    ends: Floats | None = None

    @property
    def asked(self) -> Bools:
        """(B, 16): lanes with a ray."""
        lanes: Bools = self.faces != NOBODY
        return lanes

    @property
    def many(self) -> int:
        """Rays of a lane."""
        return 1 if self.ends is None else self.ends.shape[2]

    def one_by_one(self) -> tuple[Floats, Faces, Floats]:
        """Return where all rays begin (K, 3), on which faces (K,), and where they end (K, 3), or the light (3,)."""
        points: Floats = np.repeat(self.points[self.asked], self.many, axis=0)
        faces: Faces = np.repeat(self.faces[self.asked], self.many)
        ends = self.light if self.ends is None else self.ends[self.asked].reshape(-1, 3)
        assert ends is not None
        return points, faces, ends

    def to_sphere(self, radius: float) -> Receivers:
        """Return the rays of every EACH-th block to POINTS points, drawn at random, of a sphere about the light."""
        assert self.light is not None
        points, faces = self.points[::EACH], self.faces[::EACH]
        around = np.random.default_rng(1).normal(size=(*faces.shape, POINTS, 3))
        around *= radius / np.linalg.norm(around, axis=-1, keepdims=True)
        return Receivers(points, faces, self.light, self.light + around)

    def to_hemisphere(self, normals: Floats, reach: float) -> Receivers:
        """Return POINTS rays of every EACH-th block as long as `reach`, drawn at random about normals (B, 16, 3) of any
        length with the density of their cosine."""
        points, faces = self.points[::EACH], self.faces[::EACH]
        length = np.linalg.norm(normals[::EACH], axis=-1, keepdims=True)
        about = normals[::EACH] / np.where(length > 0.0, length, 1.0)
        directions = np.random.default_rng(1).normal(size=(*faces.shape, POINTS, 3))
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        directions += about[:, :, None]  # a point of the unit sphere that touches the plane: Lambert's density
        directions *= reach / np.linalg.norm(directions, axis=-1, keepdims=True)
        return Receivers(points, faces, None, points[:, :, None] + directions)


class _Seen(NamedTuple):
    """What the pixels show. owners: (M, N), faces, NOBODY for none. points: (M, N, 3). Of the K pixels that show any: a
    corner of their faces and the normals toward the camera, (K, 3) each."""

    owners: Faces
    points: Floats
    corners: Floats
    normals: Floats


def _seen(scene: Scene, device: Device) -> _Seen:
    owners = render(scene, device=device, samples=1, layers=("id",))["id"].astype(np.int32) - 1
    verts, faces = triangles(scene)
    shown = owners >= 0
    corners = verts[faces[owners[shown]]]
    rays, origins = pixel_rays(scene.camera)
    points = np.zeros((*owners.shape, 3))
    points[shown] = _on_face(origins[shown], rays[shown], corners)
    first = corners[:, 0]
    normals = np.cross(corners[:, 1] - first, corners[:, 2] - first)
    normals *= np.sign(_height(normals, origins[shown] - first))[:, None]
    return _Seen(owners, points, first, normals)


def receivers(scene: Scene, device: Device) -> Iterator[Receivers]:
    """Draw the scene, and yield for each light the visible points on faces that it shines on.

    A face counts if light and camera are strictly on the same side of its plane. Blocks without a ray are left out.
    """
    seen = _seen(scene, device)
    for light in plain_lights("bench", scene.lights):
        facing = seen.owners >= 0
        facing[facing] = _height(seen.normals, light.position - seen.corners) > 0.0
        yield Receivers(*_kept_blocks(seen.points, seen.owners, facing), light.position)


def occlusion_receivers(scene: Scene, device: Device) -> Receivers:
    """Draw the scene, and return what it shows with rays of ambient occlusion, as long as they are by default."""
    seen = _seen(scene, device)
    toward = np.zeros_like(seen.points)
    toward[seen.owners >= 0] = seen.normals
    facing = (toward != 0.0).any(axis=2)
    around = Receivers(*_kept_blocks(seen.points, seen.owners, facing), None)
    reach = effective_settings(scene, ambient_occlusion=POINTS)[1].ao_distance
    assert reach is not None
    return around.to_hemisphere(_kept_blocks(toward, seen.owners, facing)[0], reach)


def _kept_blocks(points: Floats, owners: Faces, kept: Bools) -> tuple[Floats, Faces]:
    """Return the points (B, 16, 3) of the pixels kept and their faces (B, 16), in blocks that have any."""
    of_blocks = blocks(np.where(kept, owners, NOBODY))
    some = (of_blocks != NOBODY).any(axis=1)
    return blocks(np.where(kept[..., None], points, 0.0))[some], of_blocks[some]


def _on_face(origins: Floats, rays: Floats, corners: Floats) -> Floats:
    """Return where rays (K, 3) meet the planes of triangles (K, 3, 3): if outside of its triangle, as the image's grid
    of 1/256 px allows, the point whose negative barycentric coordinates are 0 instead."""
    a, b, c = corners.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    along = _height(normals, a - origins) / _height(normals, rays)
    points = origins + along[:, None] * rays
    opposite = ((b, c), (c, a), (a, b))
    weights = np.stack([_height(normals, np.cross(p - points, q - points)) for p, q in opposite], axis=1)
    outside = (weights < 0.0).any(axis=1)
    inner = np.maximum(weights[outside], 0.0)
    inner /= inner.sum(axis=1, keepdims=True)
    points[outside] = np.einsum("kc,kcx->kx", inner, corners[outside])
    return points


def _height(normals: Floats, offsets: Floats) -> Floats:
    """Return the dot products of rows (K, 3)."""
    products: Floats = np.einsum("kx,kx->k", normals, offsets)
    return products


def blocks(image: Array) -> Array:
    """Return an image (M, N, ...) as blocks (B, 16, ...), row by row; pixels beyond its edges are NOBODY or 0."""
    rows, columns = image.shape[:2]
    beyond = [(0, -rows % SIDE), (0, -columns % SIDE), *[(0, 0)] * (image.ndim - 2)]
    padded = np.pad(image, beyond, constant_values=NOBODY if image.ndim == 2 else 0)
    high, wide = padded.shape[0] // SIDE, padded.shape[1] // SIDE
    parts = padded.reshape(high, SIDE, wide, SIDE, *image.shape[2:]).swapaxes(1, 2)
    return np.ascontiguousarray(parts.reshape(high * wide, SIDE * SIDE, *image.shape[2:]))
