"""Images for texture mapping."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Converted, Floats32, kept
from ..base.validation import choice, floats, integer, sequence, set_fields, text, value_error

Wrap: TypeAlias = Literal["repeat", "clamp", "mirror"]
Lookup: TypeAlias = Literal["standard", "course"]
Filter: TypeAlias = Literal["linear", "nearest"]

WRAPS: tuple[Wrap, ...] = get_args(Wrap)
LOOKUPS: tuple[Lookup, ...] = get_args(Lookup)
MOST_COORDINATES = 15
FILTERS: tuple[Filter, ...] = get_args(Filter)


@dataclass(frozen=True, eq=False)
class Texture:
    """An image for texture mapping.

    Attributes
    ----------
    image : array_like, (h, w, 3) or (h, w, 4)
        Linear RGB, or RGBA; row 0 is v = 0, column 0 is u = 0; h and w from 1 to 32768. Floats are
        used as they are, integers are divided by their type's maximum. Kept as float32.
    wrap : {"repeat", "clamp", "mirror"} or a pair of these
        Wrap mode, or one each for u and v; used by the standard lookup. Kept as a pair.
    lookup : {"standard", "course"}
        `standard`: the center of texel (i, j) is at ((i+0.5)/w, (j+0.5)/h), and the texel
        multiplies the vertex color. `course`: u maps to u*(w-1), and v likewise, both clamped to
        [0, 1], and the texel replaces the vertex color.
    name : str, default ""
        Name of the texture.
    filter : {"linear", "nearest"}
        Interpolate between texels, or show each as a rectangle of one color; of the standard lookup,
        except at vertices (`texture_at`). With `texture_filter` trilinear, within each mip-map level.
    coordinates : int, default 0
        The number of the texture coordinates of a mesh: 0 is `uvs`, 1 the first of `more_uvs`. A mesh
        without them does without the texture. A material's own texture has 0.
    """

    image: Floats32
    wrap: Converted[Wrap | Iterable[Wrap], tuple[Wrap, Wrap]] = field(default=kept("repeat"))
    lookup: Lookup = "standard"
    name: str = ""
    filter: Filter = "linear"
    coordinates: int = 0

    if TYPE_CHECKING:

        def __init__(
            self,
            image: ArrayLike,
            wrap: Wrap | Iterable[Wrap] = "repeat",
            lookup: Lookup = "standard",
            name: str = "",
            filter: Filter = "linear",
            coordinates: int = 0,
        ) -> None: ...

    def __post_init__(self) -> None:
        image = floats("Texture", "image", self.image, "an array of shape (h, w, 3) or (h, w, 4)")
        if image.ndim != 3 or image.shape[2] not in (3, 4) or 0 in image.shape or max(image.shape) > 32768:
            raise value_error("Texture", "image", "an array of shape (h, w, 3|4) with h and w from 1 to 32768", image)
        if image.dtype.kind in "iu":
            image = image.astype(np.float64) / np.iinfo(image.dtype).max
        image = np.ascontiguousarray(image, dtype=np.float32).view()
        if not np.isfinite(image).all():
            raise value_error("Texture", "image", "finite numbers", "NaN, infinity or a value beyond float32")
        image.flags.writeable = False
        wraps = (self.wrap, self.wrap) if isinstance(self.wrap, str) else sequence(self.wrap)
        if wraps is None or len(wraps) != 2:
            raise value_error("Texture", "wrap", "one name or two, for u and v", self.wrap)
        set_fields(self, image=image, wrap=tuple(choice("Texture", "wrap", wrap, WRAPS) for wrap in wraps))
        choice("Texture", "lookup", self.lookup, LOOKUPS)
        text("Texture", "name", self.name)
        if choice("Texture", "filter", self.filter, FILTERS) == "nearest" and self.lookup == "course":
            raise value_error("Texture", "filter", "linear with lookup course", self.filter)
        set_fields(self, coordinates=integer("Texture", "coordinates", self.coordinates, 0, MOST_COORDINATES))

    def __repr__(self) -> str:
        rows, columns, channels = self.image.shape
        return f"<Texture {self.name or 'unnamed'}: {columns}x{rows}, {channels} channels>"
