"""What the oracle says of the stages up to ownership, of snapped triangles and depths as the kernels see them."""

import numpy as np

from clshade.oracle import clip, coverage, frame
from clshade.oracle.corners import gather
from clshade.oracle.shot import Shot
from clshade.oracle.transform import SAMPLE_STEPS
from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, Scene, Settings

Array = np.ndarray


def owners_of(xy: Array, z: Array, resolution: tuple[int, int], visibility: str, orthographic: bool = False) -> Array:
    """Return the oracle's owner of each pixel, -1 for none, (M, N), row 0 at the BOTTOM, of snapped triangles (F, 3,
    2)."""
    pieces = clip.Pieces(np.arange(len(xy)), xy, z, np.broadcast_to(np.eye(3), (len(xy), 3, 3)))
    faces = Mesh(np.zeros((3 * len(xy), 3)), np.arange(3 * len(xy)).reshape(-1, 3))
    camera = Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), 1.0, (1.0, 1.0), resolution, orthographic=orthographic)
    scene, settings = Scene((faces,), camera, ()), Settings(visibility=visibility)  # type: ignore[arg-type]
    shot = Shot(scene, settings, gather(scene), z, pieces, coverage.places(1)[0])
    row, column = np.divmod(np.arange(resolution[0] * resolution[1]), resolution[0])
    return frame.owners(shot, column, row).reshape(resolution[::-1])


SAMPLE = coverage.SUBPIXELS // SAMPLE_STEPS  # of the samples' grid


def seen_from(xy: Array, places: Array) -> list[Array]:
    """Return snapped corners (F, 3, 2) relative to each sample position (S, 2), 1/256 px, of a pixel: moved so that the
    sample is at the pixel's center."""
    return [xy + (coverage.HALF - SAMPLE * place) for place in places]


def hull(xy: Array, places: Array, resolution: tuple[int, int]) -> Array:
    """Return the union (F, 4) of the boxes of `coverage.setup` over all sample positions."""
    boxes = np.array([coverage.setup(moved, *resolution).box for moved in seen_from(xy, places)])
    return np.concatenate([boxes[..., :2].min(axis=0), boxes[..., 2:].max(axis=0)], axis=1)
