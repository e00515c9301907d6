"""What is measured of the visible triangles, to say why approximations of the course's preset are off by so much."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Floats, Integers, UInt32s
from ...oracle import transform
from ...oracle.corners import gather
from ...oracle.vectors import dot, unit
from ...scene.lights import plain_lights
from ...scene.model import Scene


@dataclass(frozen=True, eq=False)
class Triangles:
    """Measurements of the U triangles that own a pixel. depths: of the corners, (U, 3). mean_depths: of all faces, (F,),
    as painter's order compares them. turns: largest angle between two corners' normals; light_turns: largest angle between
    the directions from the centroid and from a corner, to the eye or a light; both (U,), degrees. texels: area of each in
    the texture, (U,), 0 without one."""

    depths: Floats
    mean_depths: Floats
    turns: Floats
    light_turns: Floats
    texels: Floats


def measured(scene: Scene, ids: UInt32s) -> Triangles:
    """Measure the triangles that own a pixel. ids: layer `id`, 0 where there is none."""
    seen = np.unique(ids[ids > 0]).astype(np.int64) - 1
    corners, camera = gather(scene), scene.camera
    axes = transform.camera_frame(camera.eye, camera.lookat, camera.up)
    depths = transform.to_camera(corners.world, camera.eye, axes)[..., 2]
    world = corners.world[seen]
    points = np.stack([camera.eye, *(light.position for light in plain_lights(scene.name, scene.lights))])
    return Triangles(
        depths=depths[seen],
        mean_depths=transform.painter_depth(depths),
        turns=_turns(corners.normals[seen]),
        light_turns=_light_turns(world, points),
        texels=_texels(scene, corners.uvs[seen], corners.mesh[seen]),
    )


def _degrees(a: Floats, b: Floats) -> Floats:
    """Return the angles between unit vectors (..., 3), 0 where one of them is 0."""
    missing = (dot(a, a) == 0.0) | (dot(b, b) == 0.0)
    found: Floats = np.degrees(np.arccos(np.clip(np.where(missing, 1.0, dot(a, b)), -1.0, 1.0)))
    return found


def _turns(normals: Floats) -> Floats:
    largest: Floats = _degrees(normals, np.roll(normals, -1, axis=1)).max(axis=1, initial=0.0)
    return largest


def _light_turns(world: Floats, points: Floats) -> Floats:
    """world: (U, 3, 3). points: (K, 3), the eye and the lights."""
    largest = np.zeros(len(world))
    centers = world.mean(axis=1, keepdims=True)
    for point in points:
        turned = _degrees(unit(point - world), unit(point - centers))
        largest = np.maximum(largest, turned.max(axis=1, initial=0.0))
    return largest


def _texels(scene: Scene, uvs: Floats, mesh: Integers) -> Floats:
    """Return the areas of triangles (U, 3, 2) in texels."""
    sizes = np.zeros((len(scene.meshes), 2))
    for k, each in enumerate(scene.meshes):
        if each.material.texture is not None and each.uvs is not None:
            sizes[k] = each.material.texture.image.shape[1::-1]
    edges = (uvs[:, 1:] - uvs[:, :1]) * sizes[mesh][:, None]
    areas: Floats = 0.5 * np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    return areas


def affine_shift(ratio: float) -> float:
    """Return by how much of its length affine interpolation moves a point of an edge, at most.

    ratio: of the depths at the edge's ends, above 1. At the fraction t of the edge in the image perspective stands at
    t/(t + ratio*(1 - t)) of the edge in space; the two are furthest apart where t + ratio*(1 - t) = sqrt(ratio).
    """
    root = math.sqrt(ratio)
    return (root - 1.0) / (root + 1.0)


def half_angle(exponent: float) -> float:
    """Return the degrees from the center of a highlight at which cos^exponent is a half."""
    return math.degrees(math.acos(0.5 ** (1.0 / exponent)))
