"""Camera attributes for the header of an OpenEXR file."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.arrays import Floats
from .camera import Camera
from .geometry import camera_axes


def camera_matrices(camera: Camera) -> tuple[Floats, Floats]:
    """Return (worldToCamera, worldToNDC) of a camera, float64 (4, 4), for row vectors: [x y z 1] @ matrix.

    As defined in OpenEXR's ImfStandardAttributes.h: camera space is left-handed, the eye at the origin, +x right,
    +y up, +z the viewing direction, in scene units: the camera frame of this renderer. NDC, after division by w, has
    (0, 0) at the upper left and (1, 1) at the lower right corner of the display window, y DOWN: the pixel in column c
    and row r from the top has its center at ((c+0.5)/N, (r+0.5)/M). OpenEXR leaves z open; here it is 1 - focal/depth:
    0 on the image plane, 1 at infinity; the depth itself in a parallel projection, whose w is 1.
    """
    to_camera = np.eye(4)
    to_camera[:3, :3] = camera_axes(camera).T
    to_camera[3, :3] = -np.asarray(camera.eye) @ to_camera[:3, :3]
    (height, width), (right, up) = camera.plane, camera.principal
    to_ndc = np.zeros((4, 4))
    if camera.orthographic:
        to_ndc[0, 0], to_ndc[1, 1], to_ndc[2, 2] = 1.0 / width, -1.0 / height, 1.0
        to_ndc[3] = right, 1.0 - up, 0.0, 1.0
    else:
        to_ndc[0, 0], to_ndc[1, 1] = camera.focal / width, -camera.focal / height
        to_ndc[2] = right, 1.0 - up, 1.0, 1.0
        to_ndc[3, 2] = -camera.focal
    return to_camera, to_camera @ to_ndc


def camera_metadata(camera: Camera) -> dict[str, Any]:
    """Return header attributes of a camera: worldToCamera, worldToNDC (float32), pixelAspectRatio (width / height)."""
    to_camera, to_ndc = camera_matrices(camera)
    (height, width), (columns, rows) = camera.plane, camera.resolution
    aspect = (width / columns) / (height / rows)
    with np.errstate(over="ignore"):
        matrices = {"worldToCamera": to_camera.astype(np.float32), "worldToNDC": to_ndc.astype(np.float32)}
    return {**matrices, "pixelAspectRatio": min(max(aspect, 1e-6), 1e6)}  # OpenEXR refuses anything beyond
