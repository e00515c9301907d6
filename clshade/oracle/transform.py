"""Vectors, the exact sign of a determinant, and the way from world space to the image: camera axes, projection, snapping,
depth. All float64, no fused operations.

Vectors have three components in the last axis and keep their digits at any scale. Image coordinates (u, v) are in pixels
with (0, 0) at the bottom-left corner; snapped ones are whole 1/65536 pixels.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..base.arrays import Bools, Floats, Integers, Reals
from ..scene.camera import Camera

SUBPIXELS = 1 << 16  # snapped steps per pixel
SAMPLE_STEPS = 256  # samples lie at multiples of 1/256 pixel
NEAR_FRACTION = 1e-4  # of the scene's bounding radius


def dot(a: Floats, b: Floats) -> Floats:
    """Return the scalar product, summed as (a0*b0 + a1*b1) + a2*b2."""
    return (a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]) + a[..., 2] * b[..., 2]


def cross(a: Floats, b: Floats) -> Floats:
    """Return the vector product; cross(b, a) is exactly -cross(a, b)."""
    pairs = (1, 2), (2, 0), (0, 1)
    return np.stack([a[..., i] * b[..., j] - a[..., j] * b[..., i] for i, j in pairs], axis=-1)


def power_of_two(v: Floats) -> Floats:
    """Return a power of two of the size of the largest component of v, 1 where v is 0. Dividing by it is exact."""
    largest = np.maximum(np.maximum(np.abs(v[..., 0]), np.abs(v[..., 1])), np.abs(v[..., 2]))
    _, exponent = np.frexp(largest)
    return np.asarray(np.ldexp(1.0, np.clip(exponent, -1000, 1000)))


def length(v: Floats) -> Floats:
    """Return the Euclidean length; no intermediate result of 1e-200 or 1e200 under- or overflows."""
    scale = power_of_two(v)
    w = v / scale[..., None]
    return np.sqrt(dot(w, w)) * scale


def unit(v: Floats) -> Floats:
    """Return v divided by its length; the zero vector stays zero."""
    w = v / power_of_two(v)[..., None]
    size = np.sqrt(dot(w, w))
    return w / np.where(size > 0.0, size, 1.0)[..., None]


# Of the sum of the magnitudes of a determinant's six products: three differences, a product and a difference of each
# minor, a product and two sums are 8 roundings of at most 2^-53 each. As much again is left for those of that sum itself.
SURE = 16.0 * 2.0**-53


def orientation(a: Floats, b: Floats, c: Floats, d: Floats) -> Integers:
    """Return the sign (K,) of the volume (b - a) x (c - a) . (d - a) of points (K, 3): 1 where d lies on the side from
    which a, b, c run counter-clockwise, 0 where the four lie in a plane.

    J. R. Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997: what the
    rounding of float64 leaves open is decided exactly.
    """
    a, b, c, d = np.broadcast_arrays(*(np.atleast_2d(np.asarray(v, np.float64)) for v in (a, b, c, d)))
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        p, q, r = b - a, c - a, d - a
        scale = power_of_two(np.maximum(np.maximum(np.abs(p), np.abs(q)), np.abs(r)))[:, None]
        p, q, r = p / scale, q / scale, r / scale
        after, before = (np.abs(np.roll(p, -k, axis=-1) * np.roll(q, k, axis=-1)) for k in (1, 2))
        volume, magnitude = dot(cross(p, q), r), dot(after + before, np.abs(r))
        sure = np.abs(volume) > SURE * magnitude + 1e-290
    signs: Integers = np.sign(np.where(sure, volume, 0.0)).astype(np.int64)
    for k in np.flatnonzero(~sure):
        signs[k] = _exact_sign(*(tuple(point[k].tolist()) for point in (a, b, c, d)))
    return signs


@lru_cache(1 << 18)  # rays from a face meet the same others
def _exact_sign(*points: tuple[float, ...]) -> int:
    ratios = [x.as_integer_ratio() for point in points for x in point]
    unit = max(below for _, below in ratios)  # all are powers of two
    integers = [above * (unit // below) for above, below in ratios]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (
        [x - y for x, y in zip(integers[k : k + 3], integers[:3], strict=True)] for k in (3, 6, 9)
    )
    volume = cx * (ay * bz - az * by) + cy * (az * bx - ax * bz) + cz * (ax * by - ay * bx)
    return (volume > 0) - (volume < 0)


def camera_frame(camera: Camera) -> Floats:
    """Return the camera's axes in world space as rows of a (3, 3) array: x (right), y (up), z (forward)."""
    z = unit(camera.lookat - camera.eye)
    up = camera.up / power_of_two(camera.up)
    y = unit(up - dot(up, z) * z)
    return np.stack([cross(z, y), y, z])


def world_vertices(verts: Reals, matrix: Floats) -> Floats:
    """Transform positions (V, 3) by placements (..., 4, 4): (..., V, 3); an identity leaves them as they are."""
    points = np.asarray(verts, dtype=np.float64)
    rows = matrix[..., None, :, :]
    placed = np.stack([dot(points, rows[..., k, :3]) + rows[..., k, 3] for k in range(3)], axis=-1)
    return np.where(is_identity(matrix)[..., None, None], points, placed)


def is_identity(matrix: Floats) -> Bools:
    """Return which placements (..., 4, 4) are identities."""
    return np.asarray((matrix == np.eye(4)).all(axis=(-2, -1)))


def mirroring(matrices: Floats) -> Bools:
    """Return which placements (..., 4, 4) mirror: those of a determinant below 0. For one that flattens, rounding would
    leave a random sign."""
    a, b, c = np.moveaxis(matrices.reshape(-1, 4, 4)[:, :3, :3], 1, 0)
    return (orientation(np.zeros(3), a, b, c) < 0).reshape(matrices.shape[:-2])


def to_camera(points: Floats, camera: Camera) -> Floats:
    """Transform world points (..., 3) to camera coordinates: x to the right, y up, z = depth."""
    offset = np.asarray(points, dtype=np.float64) - camera.eye
    return np.stack([dot(offset, axis) for axis in camera_frame(camera)], axis=-1)


def project(points: Floats, camera: Camera) -> Floats:
    """Project camera-space points (..., 3), z > 0, to continuous image coordinates (..., 2), in pixels."""
    (height, width), (columns, rows), principal = camera.plane, camera.resolution, camera.principal
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    if camera.orthographic:
        return np.stack([(x / width + principal[0]) * columns, (y / height + principal[1]) * rows], axis=-1)
    u = ((camera.focal * x) / (z * width) + principal[0]) * columns
    v = ((camera.focal * y) / (z * height) + principal[1]) * rows
    return np.stack([u, v], axis=-1)


def snap(uv: Floats) -> Integers:
    """Round image coordinates to whole 1/65536 pixels, int64: the nearest, halves to even."""
    return np.rint(uv * SUBPIXELS).astype(np.int64)


def painter_depth(z: Floats) -> Floats:
    """Return the mean depth of triangles with corner depths z (..., 3)."""
    return ((z[..., 0] + z[..., 1]) + z[..., 2]) / 3.0


def near_distance(points: Floats, camera: Camera, near: float | None = None) -> float:
    """Return the distance of the near plane: `near`, or a fraction of the bounding radius of the points (K, 3) that faces
    use; where that is 0, of the distance from eye to lookat."""
    if near is not None:
        return near
    radius = 0.5 * float(length(np.ptp(points, axis=0))) if len(points) else 0.0
    return NEAR_FRACTION * (radius or float(length(camera.lookat - camera.eye)))
