"""Images for texture mapping."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Converted, Floats, Floats32
from ..base.declare import check_fields, checked, record, required
from ..base.validation import choice, floats, integer, items, read_only, text, value_error
from ..images.decode import BAND, CodedImage

Wrap: TypeAlias = Literal["repeat", "clamp", "mirror"]
Lookup: TypeAlias = Literal["standard", "course"]
Filter: TypeAlias = Literal["linear", "nearest"]

WRAPS: tuple[Wrap, ...] = get_args(Wrap)
MAX_COORDINATES = 15


def _image(owner: str, name: str, value: Any) -> CodedImage | Floats32:
    if isinstance(value, CodedImage) and 0 not in value.shape:
        return value
    image = floats(owner, name, value, "an array of shape (h, w, 3) or (h, w, 4)")
    if image.ndim != 3 or image.shape[2] not in (3, 4) or 0 in image.shape or max(image.shape) > 32768:
        raise value_error(owner, name, "an array of shape (h, w, 3|4) with h and w from 1 to 32768", image)
    if image.dtype.kind in "iu":
        image = image.astype(np.float64) / np.iinfo(image.dtype).max
    numbers = np.ascontiguousarray(image, dtype=np.float32).view()
    if not np.isfinite(numbers).all():
        raise value_error(owner, name, "finite numbers", "NaN, infinity or a value beyond float32")
    return read_only(numbers)


def _wraps(owner: str, name: str, value: Any) -> tuple[str, ...]:
    value = (value, value) if isinstance(value, str) else value
    return tuple(
        choice(owner, name, wrap, WRAPS) for wrap in items(owner, name, value, "one name or two, for u and v", 2)
    )


@record
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

    image: Converted[ArrayLike, Floats32] = required(check=_image)
    wrap: Converted[Wrap | Iterable[Wrap], tuple[Wrap, Wrap]] = checked("repeat", _wraps)
    lookup: Lookup = checked("standard", partial(choice, allowed=get_args(Lookup)))
    name: str = checked("", text)
    filter: Filter = checked("linear", partial(choice, allowed=get_args(Filter)))
    coordinates: int = checked(0, partial(integer, least=0, most=MAX_COORDINATES))

    def __post_init__(self) -> None:
        check_fields(self)
        if self.filter == "nearest" and self.lookup == "course":
            raise value_error("Texture", "filter", "linear with lookup course", self.filter)
        vars(self)["_texels"] = vars(self)["image"]
        if isinstance(self.texels, CodedImage):
            del vars(self)["image"]  # it is computed where it is read

    def __getattr__(self, name: str) -> Any:
        if name != "image" or "_texels" not in vars(self):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        vars(self)["image"] = image = read_only(np.asarray(self.texels))
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
