"""Scalars: data on meshes, and how a color map shows them as the surface's color."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Converted, Reals, kept
from ..base.validation import floats, number, sequence, set_fields, value_error
from ..images.colors import checked_colormap, encoded_rgb


@dataclass(frozen=True)
class Scalars:
    """Which scalars of the meshes give the surface its color, and how.

    The scalar is interpolated over each triangle as the image's other attributes are, and its value
    at the point is looked up in the map; colors are never interpolated. The color takes the place
    of vertex color, material color and texel, and is lit as they are; with shader="nolight" the
    image shows the map's colors as they are. Meshes without these scalars keep their own colors.

    Attributes
    ----------
    name : str
        Name of the scalars, see `Mesh.scalars`.
    colormap : str or iterable of colors, default "viridis"
        Name of a color map of Matplotlib ("viridis", "viridis_r", "coolwarm", "tab10", ...), or
        colors from low to high, each as wide as the others.
    clim : (float, float) or None, default None
        Values of the map's ends, low first; values beyond get the color of the nearer end. None:
        the least and the largest finite value in the scene. If both are equal, that value has the
        map's first color, and values above it the last.
    nan_color : color, default "darkgray"
        Color of faces one of whose corners is NaN. Colors are whatever Matplotlib understands.

    Examples
    --------
    >>> from clshade import Scalars
    >>> Scalars("height", "coolwarm", clim=(-1, 1)).clim
    (-1.0, 1.0)
    """

    name: str
    colormap: Converted[str | Iterable[Any], str | tuple[Any, ...]] = field(default=kept("viridis"))
    clim: Converted[ArrayLike | None, tuple[float, float] | None] = field(default=kept(None))
    nan_color: Converted[Any, tuple[float, float, float]] = field(default=kept("darkgray"))

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise value_error("Scalars", "name", "the name of the scalars", self.name)
        set_fields(
            self,
            colormap=checked_colormap("Scalars", "colormap", self.colormap),
            nan_color=encoded_rgb("Scalars", "nan_color", self.nan_color),
        )
        if self.clim is not None:
            ends = sequence(self.clim)
            expected = "two finite numbers, low and high"
            if ends is None or len(ends) != 2:
                raise value_error("Scalars", "clim", expected, self.clim)
            low, high = (number("Scalars", "clim", end, expected=expected) for end in ends)
            if low > high:
                raise value_error("Scalars", "clim", f"{expected}, low not above high", (low, high))
            set_fields(self, clim=(low, high))


def as_scalars(owner: str, name: str, value: Any) -> Scalars | None:
    """Return Scalars, or those of a name, or None."""
    if value is None or isinstance(value, Scalars):
        return value
    if isinstance(value, str):
        return Scalars(value)
    raise value_error(owner, name, "a name, a Scalars or None", value)


def checked_scalars(owner: str, given: Any, vertices: int, faces: int) -> dict[str, Reals]:
    """Return a mesh's scalars, read-only, infinity as NaN."""
    try:
        items = dict(() if given is None else given).items()
    except (TypeError, ValueError):
        raise value_error(owner, "scalars", "a mapping from names to arrays", given) from None
    shapes = f"({vertices},) per vertex, ({faces},) per face or ({faces}, 3) per corner"
    found: dict[str, Reals] = {}
    for name, values in items:
        if not isinstance(name, str) or not name:
            raise value_error(owner, "scalars", "names that are texts", name)
        array = floats(owner, f"scalars {name!r}", values, f"an array of numbers: {shapes}")
        if array.shape not in ((vertices,), (faces,), (faces, 3)):
            raise value_error(owner, f"scalars {name!r}", shapes, array)
        array = np.ascontiguousarray(array, None if array.dtype in (np.float32, np.float64) else np.float64)
        infinite = np.isinf(array)
        array = np.where(infinite, array.dtype.type(np.nan), array) if infinite.any() else array.view()
        array.flags.writeable = False
        found[name] = array
    return found
