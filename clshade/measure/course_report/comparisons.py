"""One approximation of the course's preset at a time, beside the image without it: what differs, where most, and why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Bools, Bytes, Floats
from ...images.metrics import rms, scale_end
from ...images.tonemap import tonemap
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import render
from ...scene.model import Scene, Settings
from .pictures import Part, worst_parts
from .triangles import Triangles, affine_shift, half_angle, measured
from .wording import percent, rounded

PLACES = 3  # details shown of each comparison
ACROSS = 9  # details side by side along the object
SIDES = (12, 64)  # pixels of a detail's side, least and most
UNSEEN = "No triangle is visible."


class Approximation(NamedTuple):
    """A field of Settings, what its two values are called, the title of the comparison, what it is about."""

    field: str
    values: tuple[str, str]
    names: tuple[str, str]
    title: str
    about: str


APPROXIMATIONS = (
    Approximation(
        "visibility",
        ("painter", "depth"),
        ("painter’s order", "depth per pixel"),
        "Painter’s order",
        "Painter’s order compares one depth a triangle, the mean of its corners; a triangle that leans away from the eye "
        "may so cover another that is nearer at a pixel.",
    ),
    Approximation(
        "interpolation",
        ("affine", "perspective"),
        ("affine", "perspective"),
        "Affine and perspective interpolation",
        "Interpolation that is linear in the image is right only where the corners of a triangle are equally far away.",
    ),
    Approximation(
        "shader",
        ("gouraud", "phong"),
        ("Gouraud", "Phong"),
        "Gouraud and Phong shading",
        "Gouraud shading lights the corners and interpolates their colors; Phong shading interpolates the normal and lights "
        "every pixel.",
    ),
    Approximation(
        "texture_at",
        ("vertex", "pixel"),
        ("at the corners", "at every pixel"),
        "Texture at the corners and at every pixel",
        "A texture that is looked up at the corners alone is lost between them.",
    ),
    Approximation(
        "lighting_at",
        ("centroid", "position"),
        ("from the centroid", "from every pixel"),
        "Directions from the centroid and from every pixel",
        "The directions to the eye and to the lights are taken at the triangle’s center of mass, once for all its pixels.",
    ),
)


class Place(NamedTuple):
    """Where much differs: a part of the image, and what differs there, a sentence or two."""

    part: Part
    said: str


@dataclass(frozen=True, eq=False)
class Comparison:
    """The image with an approximation and the one without it, all else as in the preset `course`.

    images: as shown, (M, N, 3) uint8 each. covered: where the object is, (M, N). difference: of the values that are shown,
    clamped to 1, in the channel that differs most, (M, N). rmse: of all their channels. changed: number of pixels whose
    8-bit colors differ. dark: the difference that is drawn darkest. places: where the error is largest, worst first.
    why: what was measured, a sentence or two.
    """

    approximation: Approximation
    images: tuple[Bytes, Bytes]
    covered: Bools
    difference: Floats
    rmse: float
    changed: int
    dark: float
    places: tuple[Place, ...]
    why: str

    @property
    def largest(self) -> float:
        return float(self.difference.max())


class Pair(NamedTuple):
    """The frames with an approximation and without it, and the visible triangles."""

    scene: Scene
    frames: tuple[Frame, Frame]
    triangles: Triangles


def compare(scene: Scene, device: Device, side: int) -> list[Comparison]:
    """Compare the approximations that change anything of the scene. side: of the details, in pixels."""
    base = Settings.from_preset("course", layers=("id", "Z"))
    textured = scene.meshes[0].material.texture is not None
    triangles = measured(scene, _drawn(scene, device, replace(base, visibility="depth"))["id"])
    return [
        _compared(scene, device, each, base, triangles, side)
        for each in APPROXIMATIONS
        if textured or each.field != "texture_at"
    ]


def _drawn(scene: Scene, device: Device, settings: Settings) -> Frame:
    return render(scene, settings=settings, device=device)


def _compared(
    scene: Scene, device: Device, each: Approximation, base: Settings, triangles: Triangles, side: int
) -> Comparison:
    with_it, without = (_drawn(scene, device, _changed(base, each.field, value)) for value in each.values)
    values = [np.clip(frame.rgb.astype(np.float64), 0.0, 1.0) for frame in (with_it, without)]
    off: Floats = values[0] - values[1]
    difference, rms_of_channels = np.abs(off).max(axis=2), np.sqrt(np.square(off).mean(axis=2))
    images = tonemap(with_it.rgb, "none"), tonemap(without.rgb, "none")
    pair = Pair(scene, (with_it, without), triangles)
    return Comparison(
        approximation=each,
        images=images,
        covered=without.alpha > 0.0,
        difference=difference,
        rmse=rms(off),
        changed=int((images[0] != images[1]).any(axis=2).sum()),
        dark=scale_end(difference),
        places=tuple(_place(pair, each, off, part) for part in worst_parts(rms_of_channels, side, PLACES)),
        why=_WHY[each.field](pair) if len(triangles.depths) else UNSEEN,
    )


def _place(pair: Pair, each: Approximation, off: Floats, part: Part) -> Place:
    """off: what the image with the approximation is off by, (M, N, 3)."""
    inside = np.abs(part.of(off)).max(axis=2)
    row, column = np.unravel_index(int(inside.argmax()), inside.shape)
    said = (
        f"Columns {part.left} to {part.left + part.width - 1}, rows {part.top} to {part.top + part.height - 1}: RMSE "
        f"{rounded(rms(part.of(off)), 2)}, largest difference {rounded(inside.max(), 2)}."
    )
    if each.field == "visibility":
        said += _swapped(pair, part.top + int(row), part.left + int(column))
    return Place(part, said)


def _changed(base: Settings, field: str, value: Any) -> Settings:
    return replace(base, **{field: value})


def detail_side(part: Part) -> int:
    """Return the side of details of an object that lies in this part of the image, in pixels."""
    low, high = SIDES
    return min(max(max(part.width, part.height) // ACROSS, low), high)


# Why


def _painter(pair: Pair) -> str:
    wrong, right = pair.frames
    covered, apart = int((right["id"] > 0).sum()), int((wrong["id"] != right["id"]).sum())
    if not apart:
        return f"Here both show the same triangle in each of the {covered:,} pixels that the object covers."
    return f"Here {apart:,} of the {covered:,} pixels that the object covers show another triangle than the nearest."


def _swapped(pair: Pair, row: int, column: int) -> str:
    """Return which triangle painter's order shows at a pixel in place of the nearest one; "" if it shows that."""
    wrong, right = pair.frames
    first, second = (int(frame["id"][row, column]) for frame in pair.frames)
    behind = float(wrong["Z"][row, column]) - float(right["Z"][row, column])
    if first == second or not behind > 0.0:
        return ""
    mean_first, mean_second = (pair.triangles.mean_depths[face - 1] for face in (first, second))
    return (
        f" At column {column}, row {row} triangle {first - 1}, of mean depth {mean_first:#.6g}, covers triangle "
        f"{second - 1}, of mean depth {mean_second:#.6g}, although it lies {rounded(behind, 2)} behind it there."
    )


def _affine(pair: Pair) -> str:
    depths = pair.triangles.depths
    if pair.scene.camera.orthographic:
        return "The projection is parallel: the two are the same."
    whole = depths[depths.min(axis=1, initial=np.inf) > 0.0]
    if not len(whole):
        return "No visible triangle lies before the eye as a whole."
    ratio = whole.max(axis=1) / whole.min(axis=1)
    largest, median = float(ratio.max()), float(np.median(ratio))
    return (
        f"Within a visible triangle depths differ by at most {percent(largest - 1.0)} (median {percent(median - 1.0)}), "
        f"which moves a point of an edge by at most {percent(affine_shift(largest))} of the edge’s length."
    )


def _shading(pair: Pair) -> str:
    turns = pair.triangles.turns
    material = pair.scene.meshes[0].material
    said = f"Within a visible triangle the normal turns by up to {rounded(turns.max())}° "
    said += f"(median {rounded(np.median(turns), 2)}°)"
    if not np.any(material.ks) or material.n <= 0.0 or not pair.scene.lights:
        return f"{said}."
    return (
        f"{said}, and the reflected direction by up to twice as much; a highlight of exponent {material.n:g} falls to half "
        f"at {half_angle(material.n):.3g}°. What happens between the corners, such as the edge of a highlight, is lost or "
        "spread over the triangle."
    )


def _texture(pair: Pair) -> str:
    texels = pair.triangles.texels
    return (
        f"The median visible triangle spans {rounded(np.median(texels), 2)} texels, the largest {rounded(texels.max())}; "
        "four are read about each of its corners."
    )


def _centroid(pair: Pair) -> str:
    turns = pair.triangles.light_turns
    return (
        f"From the center of a visible triangle to its corners these directions turn by up to {rounded(turns.max())}° "
        f"(median {rounded(np.median(turns), 2)}°)."
    )


_WHY: dict[str, Callable[[Pair], str]] = {
    "visibility": _painter,
    "interpolation": _affine,
    "shader": _shading,
    "texture_at": _texture,
    "lighting_at": _centroid,
}
