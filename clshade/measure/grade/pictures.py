"""The picture of a graded image: image, right one and difference; and what is left after the best explanation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Bytes, Floats
from ...images import compare_figure
from ...images.channels import Group
from .grade import Grade, Right, explained_codes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _group(codes: Floats) -> Group:
    planes = np.moveaxis(codes.astype(np.float32) / np.float32(255.0), 2, 0)
    return Group("RGB", ("R", "G", "B"), tuple(planes))


def draw(found: Grade, right: Right) -> Figure:
    """Draw image, right one and difference; below them the right one with the mistakes in its place."""
    image, expected = _group(found.image), _group(right.codes)
    layers = {"image": (image, expected)}
    if found.best is not None:
        layers["explained"] = image, _group(explained_codes(right, found.best))
    return compare_figure.draw(layers, encoded=True, titles=(found.name, "the oracle"))


def difference(image: Bytes, expected: Bytes) -> Bytes:
    """Return a picture of what differs by more than one code, (M, N, 3) uint8: the brighter, the more."""
    apart = np.abs(image.astype(np.int16) - expected.astype(np.int16)).max(axis=2)
    level = np.where(apart > 1, 64 + 3 * apart // 4, 0)
    return np.repeat(np.clip(level, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
