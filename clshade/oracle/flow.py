"""Optical flow: where the points that pixels show are in another image, and whether that shows them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.camera import Camera
from ..scene.model import DirectionalLight, PointLight, Scene, Settings
from . import transform
from .corners import Corners, gather
from .coverage import places
from .shadows import OFF, Casters, Rays, Receivers, at_pixels, met
from .transform import SAMPLE_STEPS, camera_frame, cross, dot, length, orientation, power_of_two

ROUNDING = 2.0**-48  # of places and depths, relative to the lengths that they come from


@dataclass(frozen=True, eq=False)
class OracleFlow:
    """The flow at K pixels."""

    vectors: Floats  # (K, 2) pixels to the right and down, NaN where the point is not in front of the other near plane
    occluded: Bools  # (K,) where the other image does not show it
    off: Floats  # (K,) pixels, how far rounding may move a vector
    unsure: Bools  # (K,) where rounding may change `occluded`


def flow(
    scene: Scene,
    settings: Settings,
    other: Scene,
    other_settings: Settings,
    face: Integers,
    pixel: tuple[Integers, Integers],
) -> OracleFlow:
    """Return the flow from a scene's camera to another scene's, at pixels (rows from the TOP, columns), (K,) each, that
    show faces (K,)."""
    start, end = _corners(scene), _corners(other)
    casters, corners = Casters.of(gather(scene)), gather(other)
    place, (rows, columns) = places(settings.samples)[0], pixel
    x, y = SAMPLE_STEPS * columns + place[0], SAMPLE_STEPS * (scene.camera.resolution[1] - 1 - rows) + place[1]
    at = at_pixels(casters, scene.camera, face, x, y)
    weights = _areas((start[face] - casters.origin) / casters.scale, at.point)[:, :, None]
    from_eye = (weights * (start[face] - scene.camera.eye)).sum(axis=1)
    end_from_eye = (weights * (end[face] - other.camera.eye)).sum(axis=1)
    sizes = [length(c - np.roll(c, 1, axis=1)).max(axis=1) for c in (start[face], end[face])]  # longest sides
    off = at.off * casters.scale * np.maximum(sizes[1] / np.maximum(sizes[0], 1e-290), 1.0)
    slack = off + ROUNDING * (length(end_from_eye) + sizes[1])
    place_before, _, per_length = _seen(scene.camera, from_eye)
    error = per_length * (off + ROUNDING * (length(from_eye) + sizes[0]))
    place_after, depth, per_length = _seen(other.camera, end_from_eye)
    error = error + per_length * slack + ROUNDING * (np.abs(place_before) + np.abs(place_after)).sum(axis=1)

    near = transform.near_distance(end.reshape(-1, 3), other.camera, other_settings.near)
    ahead = depth >= near
    inside = ((place_after >= 0.0) & (place_after < other.camera.resolution)).all(axis=1)
    borders = np.stack([place_after, place_after - other.camera.resolution])
    unsure = (np.abs(depth - near) <= slack) | (np.abs(borders).min(axis=(0, 2)) <= error)
    culled = _culled(corners, other_settings)
    hiding = Casters.of(corners, culled | _clear(corners, other_settings, near))
    point = (weights * (end[face] - hiding.origin)).sum(axis=1) / hiding.scale
    receivers = Receivers(hiding, point, face, off / hiding.scale + OFF)
    axis = camera_frame(other.camera)[2]
    eye = DirectionalLight(axis) if other.camera.orthographic else PointLight(other.camera.eye)
    hidden, doubtful = met(Rays.to(eye, receivers))
    return OracleFlow(
        vectors=np.where(ahead[:, None], place_after - place_before, np.nan),
        occluded=~ahead | ~inside | culled[face] | hidden,
        off=error,
        unsure=unsure | doubtful,
    )


def _corners(scene: Scene) -> Floats:
    """Return the corners of all faces, (F, 3, 3), in the order of the mesh."""
    corners = [np.zeros((0, 3, 3))]
    for mesh in scene.meshes:
        for matrix in np.asarray(mesh.instances):
            placed = np.asarray(mesh.verts, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
            corners.append(placed[mesh.faces])
    return np.concatenate(corners)


def _areas(corners: Floats, point: Floats) -> Floats:
    """Return the barycentric coordinates (K, 3) of points (K, 3) of triangles (K, 3, 3): shares of their areas."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        volumes = dot(cross(point - a, c - a), normal), dot(cross(b - a, point - a), normal)
        second, third = (np.nan_to_num(volume / dot(normal, normal)) for volume in volumes)
    return np.stack([1.0 - second - third, second, third], axis=1)


def _seen(camera: Camera, offsets: Floats) -> tuple[Floats, Floats, Floats]:
    """Return places in the image, (K, 2), to the right and down, of points at offsets from the eye (K, 3); depths (K,); and
    how many pixels a place moves with the point, at most, per length (K,)."""
    x, y, z = (dot(offsets, axis) for axis in camera_frame(camera))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        places = transform.project(np.stack([x, y, z], axis=-1), camera)
        pixels = max(camera.resolution[0] / camera.plane[1], camera.resolution[1] / camera.plane[0])
        lens = np.ones_like(z) if camera.orthographic else camera.focal / np.abs(z)
        slope = np.zeros_like(z) if camera.orthographic else np.maximum(np.abs(x), np.abs(y)) / np.abs(z)
        per_length = pixels * lens * (1.0 + slope)
    return np.stack([places[:, 0], camera.resolution[1] - places[:, 1]], axis=1), z, per_length


def _culled(corners: Corners, settings: Settings) -> Bools:
    """Return the faces whose back is seen, where backs are not drawn, (F,)."""
    a, b, c = np.moveaxis(corners.world, 1, 0)
    camera = corners.scene.camera
    eye = np.broadcast_to(camera.eye, a.shape)
    if camera.orthographic:  # neither beside the corners nor lost in their rounding
        eye = a - camera_frame(camera)[2] * power_of_two(a)[:, None]
    front_only = settings.cull | corners.of_meshes(lambda mesh: mesh.material.sides == "front")
    return np.asarray(front_only & (orientation(a, b, c, eye) < 0))


def _clear(corners: Corners, settings: Settings, near: float) -> Bools:
    """Return the faces that hide nothing: those nearer than the near plane, and those through which layers look, (F,)."""
    depths = transform.to_camera(corners.world, corners.scene.camera)[..., 2]
    clear = corners.of_meshes(lambda mesh: mesh.blends and mesh.material.opacity < settings.layer_alpha)
    return np.asarray((depths < near).all(axis=1) | clear)
