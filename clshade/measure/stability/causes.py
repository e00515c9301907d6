"""What amplifies rounding at a pixel: the factors of its bound, and a sentence about the largest.

The derivations are in `clshade/measure/README.md`. kappa counts only the worst of normals, eye and light, so one of these
is a factor at a pixel, and the others are 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ...base.arrays import Array, Floats, Integers
from ...oracle import shade
from ...oracle.corners import Corners, gather
from ...oracle.lights import Interaction, Lights, scene_lights
from ...oracle.shade import CONDITIONS
from ...oracle.transform import cross, length
from ...scene.model import Scene, Settings
from ..check import oracle_bounds
from ..check.check import Comparison
from ..check.layer_bounds import half_ulp

CAUSES = {  # by name: a title, and a sentence with the names of numbers, see `explain`
    "light": (
        "light near the surface",
        "light {light} is {distance:.3g} from the surface, and coordinates relative to the eye reach {size:.3g}: the "
        "direction to it turns by their rounding{shape}",
    ),
    "eye": (
        "eye near the surface",
        "the eye is {eye:.3g} from the surface, and the triangle's corners reach {face.extent:.3g} away from it",
    ),
    "needle": (
        "needle triangle",
        "the triangle is {face.aspect:.3g} times as long as high, and its corners reach {face.extent:.3g} away from the "
        "eye: a near point is a mean of far ones",
    ),
    "normals": ("cancelling normals", "the corners' normals cancel: their mean has the length {normal:.3g}"),
    "exponent": ("large exponent", "n = {n:g}: so small a highlight amplifies errors of directions {factor:.3g} times"),
    "steepness": (
        "exponent below 1",
        "n = {n:g}: the power is {factor:.3g} times as steep as its base, where R.V nears 0",
    ),
    "texture": (
        "texture coordinates",
        "texture coordinates reach {face.reach:.3g}, {reached:.3g} of the texture's {face.texels} texels across",
    ),
    "origin": (
        "far from the origin",
        "{origin:.3g} from the origin, {sizes:.3g} times the size of what is seen: its {dtype} coordinates are right to "
        "{face.rounding:.2g}, before anything is computed",
    ),
    "grazing": ("grazing light", "N.L or R.V is within rounding of 0: the highlight may be there or not"),
}
NONE = "none"
LEAST = 4.0  # a factor below it costs less than two bits, and is no cause
SQUARE = 2.0  # longest edge over smallest height of half a square: no needle


class Faces(NamedTuple):
    """Properties of U faces, (U,) each, or of one.

    face: in the scene's face order. extent: the largest coordinate of the corners relative to the eye. aspect: the longest
    edge over the smallest height. size: the largest side of the box around all U faces. rounding: of the coordinates as they
    are stored, absolute. reach: largest texture coordinate. texels: along the texture's larger side, 0 without one. mesh:
    index into scene.meshes.
    """

    face: Array
    extent: Array
    aspect: Array
    size: Array
    rounding: Array
    reach: Array
    texels: Array
    mesh: Array


def visible_faces(compared: Comparison) -> Faces:
    """Measure the faces that own a compared pixel."""
    scene = compared.frame.scene
    ids = np.unique(compared.oracle.id)
    index = ids[ids > 0].astype(np.int64) - 1
    corners = gather(scene)
    world = corners.world[index]
    edges = np.roll(world, -1, axis=1) - world
    longest = length(edges).max(axis=1, initial=0.0)
    with np.errstate(divide="ignore", invalid="ignore"):  # snapping gives collinear corners an area
        height = length(cross(edges[:, 0], edges[:, 1])) / longest
        aspect = longest / height
    size = np.ptp(world.reshape(-1, 3), axis=0).max() if len(index) else 0.0
    mesh = corners.mesh[index]
    texels = np.array([oracle_bounds.texture_side(each) for each in scene.meshes], np.int64)
    return Faces(
        face=index,
        extent=np.abs(world - scene.camera.eye).max(axis=(1, 2), initial=0.0),
        aspect=aspect,
        size=np.full(len(index), size),
        rounding=_stored_rounding(scene, corners, index),
        reach=np.abs(corners.uvs[index]).max(axis=(1, 2), initial=0.0),
        texels=texels[mesh],
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
    rounding: Floats = np.maximum(np.concatenate([np.zeros(0), *stored])[index], 2.0**-53 * world)
    return rounding


def factors(compared: Comparison, faces: Faces) -> dict[str, Floats]:
    """Return how much each cause amplifies rounding at the compared pixels, (K,) of at least 1, by the names of CAUSES.

    Their product without `origin` and `grazing` is the bound relative to ALLOWED * 2^-24 of the light budget; 1 for the
    background.
    """
    expected, settings = compared.oracle, compared.frame.settings
    covered = expected.id > 0
    at = np.searchsorted(faces.face, expected.id[covered].astype(np.int64) - 1)
    count, precision = len(covered), settings.precision
    result = {name: np.ones(count) for name in CAUSES}

    terms = expected.conditions[covered]
    kappa = np.fmax.reduce(terms[:, :3], axis=1, initial=1.0)
    worst = np.where(kappa > 1.0, np.nan_to_num(terms[:, :3]).argmax(axis=1), -1)
    aspect = np.maximum(faces.aspect[at] / SQUARE, 1.0)
    # If the corners were no farther away than the point, s would be so much smaller; no term knows that in parallel
    # projection. kappa is at least the eye's term.
    needle = np.where(worst >= 1, np.clip(terms[:, CONDITIONS.index("eye")], 1.0, aspect), 1.0)
    for k, name in enumerate(CONDITIONS[:3]):
        result[name][covered] = np.where(worst == k, kappa / needle, 1.0)
    result["needle"][covered] = needle
    result["steepness"][covered] = terms[:, 3]
    result["exponent"][covered] = oracle_bounds.exponent_condition(expected.exponent[covered], precision)
    more = oracle_bounds.texture_bounds(faces.texels, faces.reach, precision)
    result["texture"][covered] = (1.0 + more / oracle_bounds.ALLOWED[precision])[at]
    result["origin"][covered] = np.maximum(faces.rounding / (half_ulp(settings) * faces.size), 1.0)[at]
    without = compared.allowed * oracle_bounds.rounding(expected, precision)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Where kappa is infinite, so is all that is expected.
        result["grazing"] = np.where(expected.gate & np.isfinite(without), compared.expected / without, 1.0)
    return result


def amplification(of: Mapping[str, Floats]) -> Floats:
    """Return the product of the factors, (K,)."""
    with np.errstate(over="ignore"):
        product: Floats = np.multiply.reduce(list(of.values()))
        return product


def explain(compared: Comparison, faces: Faces, pixel: int, of: Mapping[str, float]) -> tuple[str, str]:
    """Return the cause of a compared pixel of a face, NONE if all its factors are below LEAST, and a sentence about it."""
    name = max(of, key=lambda key: of[key])
    if of[name] < LEAST:
        return NONE, f"nothing amplifies rounding {LEAST:g} times"
    expected, scene = compared.oracle, compared.frame.scene
    k = int(np.searchsorted(faces.face, int(expected.id[pixel]) - 1))
    face = Faces(*(values[k] for values in faces))
    point = compared.frame["P"][compared.rows[pixel], compared.columns[pixel]]
    normal, eye = (np.float64(1.0 if term == 0.0 else term) for term in expected.conditions[pixel][:2])
    away = np.abs(point).max()
    numbers = {
        "face": face,
        "factor": of[name],
        "n": expected.exponent[pixel],
        "eye": face.extent / eye,
        "normal": 1.0 / normal,
        "reached": face.reach * face.texels,
        "origin": away,
        "sizes": away / face.size,
        "dtype": scene.meshes[int(face.mesh)].verts.dtype,
    }
    if name == "light":
        numbers |= _worst_light(scene, np.asarray(point - scene.camera.eye, np.float64), float(face.extent))
    return name, CAUSES[name][1].format_map(numbers)


def _worst_light(scene: Scene, point: Floats, extent: float) -> dict[str, object]:
    """Return the numbers of the sentence about the light that amplifies rounding most at a point, relative to the eye."""
    lights, one = scene_lights(scene, Settings().light_samples), np.ones(())
    terms = []
    for position, shape in zip(lights.positions, lights.shapes, strict=True):
        light = Lights(position[None], position[None], [shape])
        at = Interaction(point, np.zeros(3), np.zeros(3), light, extent * one, one)
        terms.append(float(shade.conditions(at)[2]))
    worst = int(np.argmax(terms))
    position = lights.positions[worst]
    size, distance = max(extent, float(np.abs(position).max())), float(length(position - point))
    steeper = terms[worst] * distance / max(size, distance)  # NaN for a light at the point
    return {
        "light": [k for k, light in enumerate(scene.lights) if light.intensity.any()][worst],
        "distance": distance,
        "size": size,
        "shape": f"; cone and attenuation amplify that {steeper:.3g} times" if steeper > 1.01 else "",
    }
