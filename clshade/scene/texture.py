"""Images for texture mapping."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Converted, Floats, Floats32, kept
from ..base.validation import choice, floats, integer, sequence, set_fields, text, value_error
from ..images.decode import BAND, CodedImage

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
        if isinstance(self.image, CodedImage) and 0 not in self.image.shape:
            set_fields(self, _texels=self.image)
            object.__delattr__(self, "image")  # it is computed where it is read
        else:
            set_fields(self, _texels=_checked_image(self.image))
            set_fields(self, image=self.texels)
        wraps = (self.wrap, self.wrap) if isinstance(self.wrap, str) else sequence(self.wrap)
        if wraps is None or len(wraps) != 2:
            raise value_error("Texture", "wrap", "one name or two, for u and v", self.wrap)
        set_fields(self, wrap=tuple(choice("Texture", "wrap", wrap, WRAPS) for wrap in wraps))
        choice("Texture", "lookup", self.lookup, LOOKUPS)
        text("Texture", "name", self.name)
        if choice("Texture", "filter", self.filter, FILTERS) == "nearest" and self.lookup == "course":
            raise value_error("Texture", "filter", "linear with lookup course", self.filter)
        set_fields(self, coordinates=integer("Texture", "coordinates", self.coordinates, 0, MOST_COORDINATES))

    def __getattr__(self, name: str) -> Any:
        if name != "image" or "_texels" not in vars(self):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        image = np.asarray(self.texels)
        image.flags.writeable = False
        set_fields(self, image=image)
        return image

    @property
    def texels(self) -> CodedImage | Floats32:
        """The image, in codes where a file has it so."""
        texels: CodedImage | Floats32 = vars(self)["_texels"]
        return texels

    @property
    def extremes(self) -> tuple[float, float]:
        """The least and the largest number of the image; of codes, 0 and 1, which bound them."""
        return (0.0, 1.0) if isinstance(self.texels, CodedImage) else (float(self.image.min()), float(self.image.max()))

    def mean(self) -> Floats:
        """Return the mean color, (3,)."""
        (height, width, channels), total = self.texels.shape, np.zeros(3)
        for start in range(0, height, BAND):  # summed one after the other, so that the bits depend on nothing else
            band = np.asarray(self.texels[start : start + BAND]).reshape(-1, channels)
            colors = np.array(band.T[:3], np.float64, order="C")
            colors[:, 0] += total
            total = np.add.accumulate(colors, axis=1, out=colors)[:, -1].copy()
        return total / (height * width)

    def __repr__(self) -> str:
        rows, columns, channels = self.texels.shape
        return f"<Texture {self.name or 'unnamed'}: {columns}x{rows}, {channels} channels>"


def _checked_image(given: ArrayLike) -> Floats32:
    image = floats("Texture", "image", given, "an array of shape (h, w, 3) or (h, w, 4)")
    if image.ndim != 3 or image.shape[2] not in (3, 4) or 0 in image.shape or max(image.shape) > 32768:
        raise value_error("Texture", "image", "an array of shape (h, w, 3|4) with h and w from 1 to 32768", image)
    if image.dtype.kind in "iu":
        image = image.astype(np.float64) / np.iinfo(image.dtype).max
    numbers: Floats32 = np.ascontiguousarray(image, dtype=np.float32).view()
    if not np.isfinite(numbers).all():
        raise value_error("Texture", "image", "finite numbers", "NaN, infinity or a value beyond float32")
    numbers.flags.writeable = False
    return numbers
