"""Agreement of the images of two renderers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.arrays import Array

# Relative to the largest value in our image. Inside a triangle two float32 renderers differ by where they snap its
# corners, up to 1/256 of a pixel (a highlight changes by up to 0.1 of its height per pixel: 4e-4), and by powers and
# reciprocal roots, which are accurate to about 1e-5.
TOLERANCE = 1e-3
# In addition, coarse OpenGL implementations have bilinear texture weights of 8 bits: 1/512 of the step between texels,
# which is at most the largest value.
TEXTURED = TOLERANCE + 1.0 / 256.0
LEAST = 0.999  # of the pixels not inside a triangle: because of rounding, a sliver may show in one image only
BAND = 256  # rows compared at a time, to limit the memory for large images


@dataclass(frozen=True)
class Agreement:
    """Agreement of a peer's image with ours.

    interior: fraction of the covered pixels whose 3x3 neighborhood shows one triangle. largest: largest difference of a
    channel there, relative to the image's largest value. tolerance: most allowed of it. others: fraction of the other
    pixels, background included, whose color is within the tolerance of the range of our image's colors in their 3x3
    neighborhood.
    """

    interior: float
    largest: float
    tolerance: float
    others: float

    @property
    def same(self) -> bool:
        return self.largest <= self.tolerance and self.others >= LEAST


def agreement(ours: Array, ids: Array, theirs: Array, tolerance: float = TOLERANCE) -> Agreement:
    """Compare two images, ours and theirs, (M, N, 3 or more). ids: (M, N), triangles in ours, 0 for the background.

    If triangles are smaller than pixels, hardly any pixel is inside one; then the ranges are more significant.
    """
    scale = max(float(np.abs(ours[row : row + BAND, :, :3]).max()) for row in range(0, len(ours), BAND)) or 1.0
    covered = exact = within = 0
    largest = 0.0
    for row in range(0, len(ours), BAND):
        above, rows = min(row, 1), min(BAND, len(ours) - row)
        wide, own = slice(row - above, row + rows + 1), slice(above, above + rows)
        inside, apart, near = (each[own] for each in _compared(ours[wide], ids[wide], theirs[wide], tolerance * scale))
        covered += int(np.count_nonzero(ids[row : row + rows]))
        exact += int(inside.sum())
        within += int((near & ~inside).sum())
        largest = max(largest, float(apart[inside].max(initial=0.0)))
    others = ids.size - exact
    return Agreement(exact / max(covered, 1), largest / scale, tolerance, within / others if others else 1.0)


def _compared(ours: Array, ids: Array, theirs: Array, margin: float) -> tuple[Array, Array, Array]:
    """Return for each pixel whether it is inside a triangle, the difference, and whether it is within the neighbors'
    range."""
    ours, theirs = (np.asarray(each[..., :3], np.float32) for each in (ours, theirs))
    inside = (ids > 0) & (_around(np.minimum, ids) == _around(np.maximum, ids))
    apart = np.nan_to_num(np.abs(theirs - ours).max(axis=2), nan=np.inf)
    low, high = _around(np.minimum, ours) - np.float32(margin), _around(np.maximum, ours) + np.float32(margin)
    return inside, apart, ((theirs >= low) & (theirs <= high)).all(axis=2)


def _around(pick: np.ufunc, image: Array) -> Array:
    """Return the minimum or maximum of each 3x3 neighborhood, clipped to the image."""
    for axis in (0, 1):
        ends = [(1, 1) if k == axis else (0, 0) for k in range(image.ndim)]
        wide = np.pad(image, ends, mode="edge")
        parts = [np.take(wide, range(k, k + image.shape[axis]), axis=axis) for k in range(3)]
        image = pick(pick(parts[0], parts[1]), parts[2])
    return image
