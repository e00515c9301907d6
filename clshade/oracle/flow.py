"""Optical flow: where the points that pixels show are in another image, and whether that shows them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.camera import Camera
from ..scene.model import DirectionalLight, Light, PointLight, Scene, Settings
from . import sampling, shadows
from .corners import Corners, gather
from .signs import orientation
from .transform import SAMPLE_STEPS, camera_frame, lens_of, near_distance, project, to_camera
from .vectors import cross, dot, length, power_of_two

ROUNDING = 2.0**-48  # of places and depths, relative to the lengths that they come from


@dataclass(frozen=True, eq=False)
class OracleFlow:
    """The flow at K pixels.

    vectors: (K, 2) pixels to the right and down, NaN where the point is not in front of the other near plane. occluded: (K,)
    where the other image does not show it. off: (K,) pixels, how far rounding may move a vector. unsure: (K,) where
    rounding may change what is occluded.
    """

    vectors: Floats
    occluded: Bools
    off: Floats
    unsure: Bools


def flow(
    scene: Scene,
    settings: Settings,
    other: Scene,
    other_settings: Settings,
    face: Integers,
    pixel: tuple[Integers, Integers],
) -> OracleFlow:
    """Return the flow from a scene's camera to that of another one, of what shows faces (K,) at pixels (rows from the TOP,
    columns), (K,) each."""
    start, end = _corners(scene), _corners(other)
    casters, corners = shadows.Casters.of(gather(scene)), gather(other)
    place = sampling.places(settings.samples)[0]
    rows, columns = pixel
    x, y = SAMPLE_STEPS * columns + place[0], SAMPLE_STEPS * (scene.camera.resolution[1] - 1 - rows) + place[1]
    at = shadows.at_pixels(casters, scene.camera, face, x, y)
    weights = _areas((start[face] - casters.origin) / casters.scale, at.point)

    def moved(center: Floats) -> Floats:
        offsets: Floats = (weights[:, :, None] * (end[face] - center)).sum(axis=1)
        return offsets

    sizes = _size(start[face]), _size(end[face])
    off = at.off * casters.scale * np.maximum(sizes[1] / np.maximum(sizes[0], 1e-290), 1.0)
    from_eye = (weights[:, :, None] * (start[face] - scene.camera.eye)).sum(axis=1)
    place_before, _, per_length = _seen(scene.camera, from_eye)
    error = per_length * (off + ROUNDING * (length(from_eye) + sizes[0]))
    from_eye = moved(other.camera.eye)
    place_after, depth, per_length = _seen(other.camera, from_eye)
    slack = off + ROUNDING * (length(from_eye) + sizes[1])
    error = error + per_length * slack + ROUNDING * (np.abs(place_before) + np.abs(place_after)).sum(axis=1)

    near = near_distance(end.reshape(-1, 3), other.camera.eye, other.camera.lookat, other_settings.near)
    ahead = depth >= near
    inside = ((place_after >= 0.0) & (place_after < other.camera.resolution)).all(axis=1)
    borders = np.stack([place_after, place_after - other.camera.resolution])
    unsure = (np.abs(depth - near) <= slack) | (np.abs(borders).min(axis=(0, 2)) <= error)
    culled = _culled(other, other_settings, corners)
    without = culled | _without(other, other_settings, corners, near)
    hiding = shadows.Casters.of(corners, without)
    receivers = shadows.Receivers(moved(hiding.origin) / hiding.scale, face, off / hiding.scale + shadows.OFF)
    hidden, doubtful = shadows.shadowed(hiding, _eye(other.camera), receivers)
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
        second, third = (
            dot(cross(*sides), normal) / dot(normal, normal) for sides in ((point - a, c - a), (b - a, point - a))
        )
    second, third = np.nan_to_num(second), np.nan_to_num(third)
    return np.stack([1.0 - second - third, second, third], axis=1)


def _size(corners: Floats) -> Floats:
    """Return the longest sides of triangles (K, 3, 3)."""
    longest: Floats = length(corners - np.roll(corners, 1, axis=1)).max(axis=1)
    return longest


def _seen(camera: Camera, offsets: Floats) -> tuple[Floats, Floats, Floats]:
    """Return places in the image, (K, 2), to the right and down, of points at offsets from the eye (K, 3); depths (K,); and
    how many pixels a place moves with the point, at most, per length (K,)."""
    axes = camera_frame(camera.eye, camera.lookat, camera.up)
    x, y, z = np.moveaxis(to_camera(offsets, np.zeros(3), axes), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        places = project(np.stack([x, y, z], axis=-1), *lens_of(camera))
        pixels = max(camera.resolution[0] / camera.plane[1], camera.resolution[1] / camera.plane[0])
        lens = np.ones_like(z) if camera.orthographic else camera.focal / np.abs(z)
        slope = np.zeros_like(z) if camera.orthographic else np.maximum(np.abs(x), np.abs(y)) / np.abs(z)
        per_length = pixels * lens * (1.0 + slope)
    return np.stack([places[:, 0], camera.resolution[1] - places[:, 1]], axis=1), z, per_length


def _culled(scene: Scene, settings: Settings, corners: Corners) -> Bools:
    """Return the faces whose back is seen, where backs are not drawn, (F,)."""
    a, b, c = np.moveaxis(corners.world, 1, 0)
    eye = np.broadcast_to(scene.camera.eye, a.shape)
    if scene.camera.orthographic:
        direction = camera_frame(scene.camera.eye, scene.camera.lookat, scene.camera.up)[2]
        eye = a - direction * power_of_two(a)[:, None]  # neither beside the corners nor lost in their rounding
    front_only = np.array([mesh.material.sides == "front" or settings.cull for mesh in scene.meshes], bool)[
        corners.mesh
    ]
    behind: Bools = front_only & (orientation(a, b, c, eye) < 0)
    return behind


def _without(scene: Scene, settings: Settings, corners: Corners, near: float) -> Bools:
    """Return the faces that hide nothing: those nearer than the near plane, and those through which layers look, (F,)."""
    camera = scene.camera
    depths = to_camera(corners.world, camera.eye, camera_frame(camera.eye, camera.lookat, camera.up))[..., 2]
    clear = np.array([mesh.blends and mesh.material.opacity < settings.layer_alpha for mesh in scene.meshes], bool)
    found: Bools = (depths < near).all(axis=1) | clear[corners.mesh]
    return found


def _eye(camera: Camera) -> Light:
    """Return a light where the eye is."""
    if camera.orthographic:
        return DirectionalLight(camera_frame(camera.eye, camera.lookat, camera.up)[2])
    return PointLight(camera.eye)
