"""What amplifies rounding at a pixel: the factors of its bound, and a sentence about the largest.

The derivations are in `clshade/measure/README.md`. kappa counts only the worst of normals, eye and light, so one of these
is a factor at a pixel, and the others are 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Array, Floats, Integers
from ...oracle import shade
from ...oracle.corners import Corners, gather
from ...oracle.pixels import scene_lights
from ...oracle.shade import CONDITIONS
from ...oracle.vectors import cross, length
from ...scene.model import Scene, Settings
from ..check import oracle_bounds
from ..check.check import Comparison
from ..check.layer_bounds import half_ulp

CAUSES = {
    "light": "light near the surface",
    "eye": "eye near the surface",
    "needle": "needle triangle",
    "normals": "cancelling normals",
    "exponent": "large exponent",
    "steepness": "exponent below 1",
    "texture": "texture coordinates",
    "origin": "far from the origin",
    "grazing": "grazing light",
}
NONE = "none"
LEAST = 4.0  # a factor below it costs less than two bits, and is no cause
SQUARE = 2.0  # longest edge over smallest height of half a square: no needle


@dataclass(frozen=True, eq=False)
class Faces:
    """Properties of U faces, (U,) each.

    index: in the scene's face order. extent: the largest coordinate of the corners relative to the eye. aspect: the longest
    edge over the smallest height, 1 for half a square. size: the largest side of the box around all U faces. rounding: of
    the coordinates as they are stored, absolute. reach: largest texture coordinate. texels: along the texture's larger
    side, 0 without one. mesh: index into scene.meshes.
    """

    index: Integers
    extent: Floats
    aspect: Floats
    size: float
    rounding: Floats
    reach: Floats
    texels: Integers
    mesh: Integers


def faces(scene: Scene, index: Integers) -> Faces:
    """Measure the faces of these indices, (U,)."""
    corners = gather(scene)
    world = corners.world[index]
    edges = np.roll(world, -1, axis=1) - world
    longest = length(edges).max(axis=1, initial=0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = length(cross(edges[:, 0], edges[:, 1])) / longest
        aspect = np.fmax(longest / height / SQUARE, 1.0)
    box = np.ptp(world.reshape(-1, 3), axis=0) if len(index) else np.zeros(3)
    mesh = corners.mesh[index]
    texels = np.array([oracle_bounds.texture_side(each) for each in scene.meshes], np.int64)
    return Faces(
        index=index,
        extent=np.abs(world - scene.camera.eye).max(axis=(1, 2), initial=0.0),
        aspect=aspect,
        size=float(box.max()),
        rounding=_stored_rounding(scene, corners, index),
        reach=np.abs(corners.uvs[index]).max(axis=(1, 2), initial=0.0),
        texels=texels[mesh] if len(mesh) else np.zeros(0, np.int64),
        mesh=mesh,
    )


def _stored_rounding(scene: Scene, corners: Corners, index: Integers) -> Floats:
    """Return how far rounding moves the corners of faces, (U,): of the mesh's array, times the size of its placement, and
    of world coordinates in float64."""
    stored = []
    for mesh in scene.meshes:
        unit = np.finfo(mesh.verts.dtype).eps / 2.0
        reach = np.abs(np.asarray(mesh.verts, np.float64)[mesh.faces]).max(axis=(1, 2), initial=0.0)
        stored += [unit * reach * np.abs(matrix[:3, :3]).sum(axis=1).max() for matrix in np.asarray(mesh.instances)]
    world = np.abs(corners.world[index]).max(axis=(1, 2), initial=0.0) + np.abs(scene.camera.eye).max()
    found: Floats = np.maximum(np.concatenate([np.zeros(0), *stored])[index], 2.0**-53 * world)
    return found


def factors(found: Comparison, seen: Faces, scene: Scene, settings: Settings) -> dict[str, Floats]:
    """Return how much each cause amplifies rounding at the compared pixels, (K,) of at least 1, by the names of CAUSES.

    seen: all faces that own a pixel. Their product without `origin` and `grazing` is the bound relative to
    ALLOWED * 2^-24 of the light budget; 1 for the background.
    """
    expected = found.oracle
    covered = expected.id > 0
    at = np.searchsorted(seen.index, expected.id[covered].astype(np.int64) - 1)
    count, precision = len(covered), settings.precision
    result = {name: np.ones(count) for name in CAUSES}

    terms = expected.conditions[covered]
    kappa = np.fmax.reduce(terms[:, :3], axis=1, initial=1.0)
    worst = np.where(kappa > 1.0, np.nan_to_num(terms[:, :3]).argmax(axis=1), -1)
    # If the corners were no farther away than the point, s would be so much smaller; no term knows that in parallel
    # projection. kappa is at least the eye's term.
    needle = np.where(worst >= 1, np.clip(terms[:, CONDITIONS.index("eye")], 1.0, seen.aspect[at]), 1.0)
    for k, name in enumerate(CONDITIONS[:3]):
        result[name][covered] = np.where(worst == k, kappa / needle, 1.0)
    result["needle"][covered] = needle
    result["steepness"][covered] = terms[:, 3]
    result["exponent"][covered] = oracle_bounds.exponent_condition(expected.exponent[covered], precision)
    more = oracle_bounds.texture_bounds(seen.texels, seen.reach, precision)
    result["texture"][covered] = (1.0 + more / oracle_bounds.ALLOWED[precision])[at]
    if seen.size > 0.0:
        result["origin"][covered] = np.maximum(seen.rounding / (half_ulp(settings) * seen.size), 1.0)[at]
    without = found.allowed * oracle_bounds.rounding(expected, precision)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Where kappa is infinite, so is all that is expected.
        result["grazing"] = np.where(expected.gate & np.isfinite(without), found.expected / without, 1.0)
    return result


def amplification(of: Mapping[str, Floats]) -> Floats:
    """Return the product of the factors, (K,)."""
    with np.errstate(over="ignore"):
        product: Floats = np.multiply.reduce(list(of.values()))
        return product


def bits_lost(factors: Sequence[float]) -> Floats:
    """Return the bits that a cause costs where it is one, log2 of its factors, at most 64; 0 elsewhere."""
    given = np.asarray(factors, np.float64)
    with np.errstate(invalid="ignore"):
        bits: Floats = np.where(given >= LEAST, np.clip(np.log2(given), 0.0, 64.0), 0.0)
    return bits


def cause_of(of: Mapping[str, float]) -> str:
    """Return the name of the largest factor, NONE if it is below LEAST."""
    name = max(of, key=lambda key: of[key])
    return name if of[name] >= LEAST else NONE


@dataclass(frozen=True, eq=False)
class Pixel:
    """What the sentence about a pixel needs. face: row of `seen`. point: in the world. terms: (4,) of kappa."""

    scene: Scene
    seen: Faces
    face: int
    point: Array
    terms: Floats
    exponent: float
    factors: Mapping[str, float]

    @property
    def extent(self) -> float:
        return float(self.seen.extent[self.face])


def why(cause: str, pixel: Pixel) -> str:
    """Return a sentence about the cause at a pixel, with its numbers."""
    return _SENTENCES[cause](pixel)


def _light(pixel: Pixel) -> str:
    lights = scene_lights(pixel.scene, Settings())
    point, one = pixel.point - pixel.scene.camera.eye, np.ones(())
    around = point, pixel.extent * one, one, np.zeros(3)
    each = zip(lights.positions, lights.shapes, strict=True)
    terms = [float(shade.conditions(*around, position[None], shapes=[shape])[2]) for position, shape in each]
    nearest = int(np.argmax(terms))
    position, shape = lights.positions[nearest], lights.shapes[nearest]
    number = [k for k, light in enumerate(pixel.scene.lights) if light.intensity.any()][nearest]
    size, away = max(pixel.extent, float(np.abs(position).max())), float(length(position - point))
    shaped = shape.attenuates or shape.axis is not None
    also = f"; cone and attenuation amplify that {terms[nearest] * away / max(size, away):.3g} times"
    return (
        f"light {number} is {away:.3g} from the surface, and coordinates relative to the eye reach {size:.3g}: "
        "the direction to it turns by their rounding"
        f"{also if shaped and away > 0.0 else ''}"
    )


def _eye(pixel: Pixel) -> str:
    with np.errstate(divide="ignore"):
        away = np.float64(pixel.extent) / pixel.terms[1]
    return f"the eye is {away:.3g} from the surface, and the triangle's corners reach {pixel.extent:.3g} away from it"


def _needle(pixel: Pixel) -> str:
    return (
        f"the triangle is {SQUARE * pixel.seen.aspect[pixel.face]:.3g} times as long as high, and its corners reach "
        f"{pixel.extent:.3g} away from the eye: a near point is a mean of far ones"
    )


def _normals(pixel: Pixel) -> str:
    return f"the corners' normals cancel: their mean has the length {1.0 / pixel.terms[0]:.3g}"


def _exponent(pixel: Pixel) -> str:
    times = pixel.factors["exponent"]
    return f"n = {pixel.exponent:g}: so small a highlight amplifies errors of directions {times:.3g} times"


def _steepness(pixel: Pixel) -> str:
    return f"n = {pixel.exponent:g}: the power is {pixel.terms[3]:.3g} times as steep as its base, where R.V nears 0"


def _texture(pixel: Pixel) -> str:
    reach, texels = pixel.seen.reach[pixel.face], pixel.seen.texels[pixel.face]
    return f"texture coordinates reach {reach:.3g}, {reach * texels:.3g} of the texture's {texels} texels across"


def _origin(pixel: Pixel) -> str:
    stored = pixel.scene.meshes[pixel.seen.mesh[pixel.face]].verts.dtype
    away = np.abs(pixel.point).max()
    return (
        f"{away:.3g} from the origin, {away / pixel.seen.size:.3g} times the size of what is seen: its {stored} "
        f"coordinates are right to {pixel.seen.rounding[pixel.face]:.2g}, before anything is computed"
    )


def _grazing(pixel: Pixel) -> str:
    return "N.L or R.V is within rounding of 0: the highlight may be there or not"


def _none(pixel: Pixel) -> str:
    return "nothing amplifies rounding four times"


_SENTENCES = {
    "light": _light,
    "eye": _eye,
    "needle": _needle,
    "normals": _normals,
    "exponent": _exponent,
    "steepness": _steepness,
    "texture": _texture,
    "origin": _origin,
    "grazing": _grazing,
    NONE: _none,
}
