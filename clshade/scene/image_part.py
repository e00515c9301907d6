"""Cameras of parts of an image: what they show has the bits of that part of the whole image.

Their lens alone would not do: positions computed from it are rounded otherwise, now and then across a step of 1/256 px.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import NamedTuple

from ..base.validation import set_fields, value_error
from .camera import MAX_RESOLUTION, Camera, checked_resolution

MAX_WHOLE = 1 << 17  # pixels a side of an image drawn in parts: float32 holds positions from its center in 1/256 px


class Raster(NamedTuple):
    """The pixels of the image that a camera's image is, or is a part of.

    plane, principal, resolution: as in `Camera`, of the whole. region: column and row of the lower left corner, columns
    and rows of the region that contains the part: corners far outside of it are clipped. first: column and row of
    the part's lower left pixel. Rows count from the bottom of the whole.
    """

    plane: tuple[float, float]
    principal: tuple[float, float]
    resolution: tuple[int, int]
    region: tuple[tuple[int, int], tuple[int, int]]
    first: tuple[int, int]


@dataclass(frozen=True, eq=False)
class PartCamera(Camera):
    """The camera of a part of an image, see `part_of`. Its lens is that of the part.

    Attributes
    ----------
    whole : Camera
        The camera of the whole image, whose resolution may be up to 131072 pixels a side.
    left, top : int
        Column and row of the part's first pixel, from the top left of the whole.
    """

    whole: Camera | None = None
    left: int = 0
    top: int = 0

    def with_resolution(self, resolution: tuple[int, int]) -> Camera:
        """Return the view of the whole image at another resolution, see `Camera`."""
        assert self.whole is not None
        return self.whole.with_resolution(resolution)


def whole_camera(camera: Camera, resolution: tuple[int, int]) -> Camera:
    """Return the same view at a resolution (N, M) of up to 131072 pixels a side, more than can be drawn at once. Raises
    InputError."""
    columns, rows = checked_resolution("whole_camera", resolution, MAX_WHOLE)
    if (columns, rows) == camera.resolution:
        return camera
    whole = copy.copy(camera)
    height = camera.plane[0]
    set_fields(whole, plane=(height, height * columns / rows), resolution=(columns, rows))
    return whole


def part_of(whole: Camera, left: int, top: int, columns: int, rows: int) -> PartCamera:
    """Return the camera of a part of an image.

    Parameters
    ----------
    whole : Camera
        The camera of the whole image, as of `whole_camera`.
    left, top : int
        Column and row of the part's first pixel, from the top left of the whole.
    columns, rows : int
        Pixels of the part, inside the whole, 1 to 16384 each. Parts of an image of more than 16384
        pixels a side lie within 16384 pixels from a multiple of 16384.

    Returns
    -------
    PartCamera

    Raises
    ------
    InputError
        If the part is not one of the whole.
    """
    ends = []
    for name, start, count, size in zip(("left", "top"), (left, top), (columns, rows), whole.resolution, strict=True):
        region_end = min((start // MAX_RESOLUTION + 1) * MAX_RESOLUTION, size)
        if start < 0 or count < 1 or start + count > region_end:
            expected = f"a part that ends within {region_end} of {size} pixels"
            raise value_error("part_of", name, expected, f"{count} from {start} on")
        ends.append(size - start - count)
    (height, width), (all_columns, all_rows), (u, v) = whole.plane, whole.resolution, whole.principal
    fields = {name: getattr(whole, name) for name in Camera.__dataclass_fields__}
    fields |= {
        "plane": (height * rows / all_rows, width * columns / all_columns),
        "resolution": (columns, rows),
        "principal": ((u * all_columns - left) / columns, (v * all_rows - ends[1]) / rows),
    }
    return PartCamera(**fields, whole=whole, left=left, top=top)


def raster_of(camera: Camera) -> Raster:
    """Return the pixels of the image that a camera's image is, or is a part of."""
    if not isinstance(camera, PartCamera):
        return Raster(camera.plane, camera.principal, camera.resolution, ((0, 0), camera.resolution), (0, 0))
    whole = camera.whole
    assert whole is not None
    columns, rows = whole.resolution
    region_left, region_top = (place - place % MAX_RESOLUTION for place in (camera.left, camera.top))
    region_size = min(columns - region_left, MAX_RESOLUTION), min(rows - region_top, MAX_RESOLUTION)
    return Raster(
        whole.plane,
        whole.principal,
        whole.resolution,
        ((region_left, rows - region_top - region_size[1]), region_size),
        (camera.left, rows - camera.top - camera.resolution[1]),
    )
