"""Cameras of parts of an image: what they show has the bits of that part of the whole image.

Their lens alone would not do: positions computed from it are rounded otherwise, now and then to another 1/65536 px.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import NamedTuple

from ..base.validation import value_error
from .camera import MAX_RESOLUTION, Camera, checked_resolution

MAX_WHOLE = 1 << 17  # pixels a side of an image drawn in parts: float32 holds positions from its center in 1/256 px


class Raster(NamedTuple):
    """The pixels of the image that a camera shows all or a part of.

    plane, principal, resolution: as in `Camera`, of the whole. corner: column and row of the lower left corner of the
    region that contains the part: corners of triangles far outside of it are clipped. first: column and row of the
    part's lower left pixel. Rows count from the bottom of the whole.
    """

    plane: tuple[float, float]
    principal: tuple[float, float]
    resolution: tuple[int, int]
    corner: tuple[int, int]
    first: tuple[int, int]


@dataclass(frozen=True, eq=False)
class PartCamera(Camera):
    """The camera of a part of an image, see `part_of`. Its lens is that of the part.

    whole: the camera of the whole image, whose resolution may be up to 131072 pixels a side. left, top: column and row of
    the part's first pixel, from the top left of the whole.
    """

    whole: Camera | None = None
    left: int = 0
    top: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        lens = self.plane, self.principal
        if self.whole is None or lens != _lens(self.whole, self.left, self.top, self.resolution):
            raise value_error("PartCamera", "plane, principal", "those of `part_of`", lens)

    def with_resolution(self, resolution: tuple[int, int]) -> Camera:
        """Return the view of the whole image at another resolution, see `Camera`."""
        assert self.whole is not None
        return self.whole.with_resolution(resolution)


def whole_camera(camera: Camera, resolution: tuple[int, int]) -> Camera:
    """Return the camera at a resolution (N, M) of up to 131072 pixels a side, more than can be drawn at once.

    Raises InputError.
    """
    columns, rows = checked_resolution("whole_camera", resolution, MAX_WHOLE)
    if isinstance(camera, PartCamera):
        raise value_error("whole_camera", "camera", "one of a whole image", camera)
    if (columns, rows) == camera.resolution:
        return camera
    uncropped = copy.copy(camera)
    height = camera.plane[0]
    vars(uncropped).update(plane=(height, height * columns / rows), resolution=(columns, rows))
    return uncropped


def part_of(whole: Camera, left: int, top: int, columns: int, rows: int) -> PartCamera:
    """Return the camera of a part of an image, as large as `columns` and `rows`, 1 to 16384 pixels each.

    left, top: column and row of its first pixel, from the top left of the whole. Parts of an image of more than 16384
    pixels a side lie within 16384 pixels from a multiple of 16384. Raises InputError for a part that is not one of the
    whole.
    """
    for name, start, count, size in zip(("left", "top"), (left, top), (columns, rows), whole.resolution, strict=True):
        region_end = min((start // MAX_RESOLUTION + 1) * MAX_RESOLUTION, size)
        if start < 0 or count < 1 or start + count > region_end:
            expected = f"a part that ends within {region_end} of {size} pixels"
            raise value_error("part_of", name, expected, f"{count} from {start} on")
    if isinstance(whole, PartCamera):
        raise value_error("part_of", "whole", "the camera of a whole image", whole)
    plane, principal = _lens(whole, left, top, (columns, rows))
    fields = {name: getattr(whole, name) for name in Camera.__dataclass_fields__}
    fields |= {"plane": plane, "resolution": (columns, rows), "principal": principal}
    return PartCamera(**fields, whole=whole, left=left, top=top)


def _lens(whole: Camera, left: int, top: int, resolution: tuple[int, int]) -> tuple[tuple[float, float], ...]:
    """Return plane and principal point of a part."""
    (height, width), (all_columns, all_rows), (u, v) = whole.plane, whole.resolution, whole.principal
    columns, rows = resolution
    bottom = all_rows - top - rows
    plane = height * rows / all_rows, width * columns / all_columns
    return plane, ((u * all_columns - left) / columns, (v * all_rows - bottom) / rows)


def raster_of(camera: Camera) -> Raster:
    if not isinstance(camera, PartCamera):
        return Raster(camera.plane, camera.principal, camera.resolution, (0, 0), (0, 0))
    uncropped = camera.whole
    assert uncropped is not None
    rows = uncropped.resolution[1]
    region_end = min(camera.top - camera.top % MAX_RESOLUTION + MAX_RESOLUTION, rows)
    corner = camera.left - camera.left % MAX_RESOLUTION, rows - region_end
    first = camera.left, rows - camera.top - camera.resolution[1]
    return Raster(uncropped.plane, uncropped.principal, uncropped.resolution, corner, first)
