"""Agreement of the images of two renderers."""

from __future__ import annotations

from typing import NamedTuple

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


class Agreement(NamedTuple):
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
    scale = max(float(np.abs(ours[..., k]).max()) for k in range(3)) or 1.0
    margin = np.float32(tolerance * scale)
    inside = (ids > 0) & (_around(np.minimum, ids) == _around(np.maximum, ids))
    near = ~inside
    largest = 0.0
    for k in range(3):  # by channel, to limit the memory for large images
        our, their = ours[..., k], theirs[..., k]
        near &= (their >= _around(np.minimum, our) - margin) & (their <= _around(np.maximum, our) + margin)
        apart = np.nan_to_num(np.abs(their - our)[inside], nan=np.inf)
        largest = max(largest, float(apart.max(initial=0.0)))
    exact = int(inside.sum())
    others = np.count_nonzero(near) / (ids.size - exact) if exact < ids.size else 1.0
    return Agreement(exact / max(int(np.count_nonzero(ids)), 1), largest / scale, tolerance, others)


def _around(pick: np.ufunc, image: Array) -> Array:
    """Return the minimum or maximum of each 3x3 neighborhood of (M, N) values, clipped to the image."""
    wide = np.pad(image, 1, mode="edge")
    wide = pick(pick(wide[:-2], wide[1:-1]), wide[2:])
    middle: Array = pick(pick(wide[:, :-2], wide[:, 1:-1]), wide[:, 2:])
    return middle
