"""Mistakes in the light: wrong directions, and wrong terms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from ...base.arrays import Floats
from ...oracle.corners import Corners
from ...oracle.terms import RIGHT, Directions
from ...oracle.vectors import dot, unit
from ...scene.model import Material, Scene, with_materials
from .drawing import Drawing, Shade, Variant

Value = Callable[[Directions, Floats], Floats]


# Directions. Positions are relative to the eye, which lies at 0.


def _directed(drawing: Drawing, change: Callable[[Directions, Floats, Floats, Floats, Scene], Directions]) -> Drawing:
    """Return the drawing with other directions. change: from those so far, point, light, normal and scene."""
    before = drawing.light.directions

    def directions(point: Floats, normal: Floats, eye: Floats, light: Floats) -> Directions:
        return change(before(point, normal, eye, light), point, light, normal, drawing.scene)

    return replace(drawing, light=drawing.light._replace(directions=directions))


def _shorter(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(normal=normal)


def _with_short_normals(drawing: Drawing) -> Drawing:
    """Return the drawing with N as it is interpolated, in N.L and in R; |R-V|^2 would give R.V of unit vectors only."""
    drawing = _directed(drawing, _shorter)
    right_so_far = drawing.light.terms["ks"] is RIGHT.terms["ks"]
    return _with_term(drawing, "ks", partial(_with_cosine, mirror=_mirror)) if right_so_far else drawing


def unnormalized(drawing: Drawing) -> Iterator[Variant]:
    yield "", _with_short_normals


def _view_back(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_eye=-at.to_eye)


def _view_of_origin(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_eye=unit(-scene.camera.eye - point))


def _view_from_target(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_eye=unit(scene.camera.lookat - scene.camera.eye - point))


def _view_of_camera(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_eye=unit(scene.camera.eye - scene.camera.lookat) + np.zeros_like(at.to_eye))


def _view_by_position(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_eye=unit(scene.camera.eye) + np.zeros_like(at.to_eye))


def wrong_view(drawing: Drawing) -> Iterator[Variant]:
    yield "away from the eye, P - eye", partial(_directed, change=_view_back)
    yield "toward the origin, -P", partial(_directed, change=_view_of_origin)
    yield "toward lookat", partial(_directed, change=_view_from_target)
    yield "the same everywhere, eye - lookat", partial(_directed, change=_view_of_camera)
    yield "the eye's position itself", partial(_directed, change=_view_by_position)


def _light_back(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_light=-at.to_light)


def _light_by_position(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_light=unit(light + scene.camera.eye) + np.zeros_like(at.to_light))


def _light_from_eye(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_light=unit(light) + np.zeros_like(at.to_light))


def wrong_light(drawing: Drawing) -> Iterator[Variant]:
    yield "away from the light, P - position", partial(_directed, change=_light_back)
    yield "the light's position itself", partial(_directed, change=_light_by_position)
    yield "from the eye, position - eye", partial(_directed, change=_light_from_eye)


# Terms


def _with_term(drawing: Drawing, name: str, value: Value) -> Drawing:
    return replace(drawing, light=drawing.light._replace(terms={**drawing.light.terms, name: value}))


def _term(name: str, value: Value) -> Callable[[Drawing], Iterator[Variant]]:
    """Return the variants of a mistake that replaces the term of a coefficient."""

    def variants(drawing: Drawing) -> Iterator[Variant]:
        yield "", partial(_with_term, name=name, value=value)

    return variants


def _cosine(at: Directions, n: Floats) -> Floats:
    return at.n_l


def _magnitude(at: Directions, n: Floats) -> Floats:
    return np.abs(at.n_l)


# All of these take cosines of vectors of any length, as N has another where it is not normalized.


def _mirror(at: Directions) -> Floats:
    return 2.0 * at.normal * at.n_l[..., None] - at.to_light


def _to_power(cosine: Floats, n: Floats) -> Floats:
    return np.where(cosine > 0.0, np.maximum(cosine, 0.0) ** n, 0.0)


def _behind_too(at: Directions, n: Floats) -> Floats:
    return _to_power(dot(_mirror(at), at.to_eye), n)


def _both_ways(at: Directions, n: Floats) -> Floats:
    return np.where(at.n_l > 0.0, _to_power(np.abs(dot(_mirror(at), at.to_eye)), n), 0.0)


def _halfway(at: Directions, n: Floats) -> Floats:
    return np.where(at.n_l > 0.0, _to_power(dot(unit(at.to_light + at.to_eye), at.normal), n), 0.0)


def _with_cosine(at: Directions, n: Floats, mirror: Callable[[Directions], Floats]) -> Floats:
    """Return the highlight of a mirrored direction of any length."""
    return np.where(at.n_l > 0.0, _to_power(dot(mirror(at), at.to_eye), n), 0.0)


def _backward(at: Directions) -> Floats:
    return -_mirror(at)


def _halved(at: Directions) -> Floats:
    return at.normal * at.n_l[..., None] - at.to_light


unclamped = _term("kd", _cosine)
absolute = _term("kd", _magnitude)
ungated = _term("ks", _behind_too)
absolute_mirror = _term("ks", _both_ways)
blinn = _term("ks", _halfway)
reversed_mirror = _term("ks", partial(_with_cosine, mirror=_backward))
halved_mirror = _term("ks", partial(_with_cosine, mirror=_halved))


# Sums


def of_materials(drawing: Drawing, change: Callable[[Material], Material]) -> Drawing:
    """Return the drawing with changed materials."""
    return replace(drawing, scene=with_materials(drawing.scene, change))


def scaled(drawing: Drawing, **factors: float) -> Drawing:
    """Return the drawing with coefficients of all materials multiplied."""

    def change(material: Material) -> Material:
        return replace(material, **{name: getattr(material, name) * factor for name, factor in factors.items()})

    return of_materials(drawing, change)


def without_texture(drawing: Drawing) -> Drawing:
    """Return the drawing without textures."""
    return of_materials(drawing, lambda material: replace(material, texture=None))


def plain_materials(drawing: Drawing) -> Drawing:
    """Return the drawing with materials whose color is that of the vertices."""
    return of_materials(drawing, lambda material: replace(material, texture=None, color=1.0))


def _uncolored(drawing: Drawing) -> Drawing:
    """Return the drawing in white. Colors of vertices are replaced at the corners, which drawings on a canvas share."""
    before = drawing.corners

    def white(corners: Corners) -> Corners:
        found = before(corners)
        return replace(found, colors=np.ones_like(found.colors))

    return replace(plain_materials(drawing), corners=white)


def _white_apart(drawing: Drawing, shade: Shade) -> Floats:
    return shade(scaled(drawing, ks=0.0)) + shade(scaled(_uncolored(drawing), ka=0.0, kd=0.0))


def white_highlight(drawing: Drawing) -> Iterator[Variant]:
    yield "", lambda given: replace(given, compose=_white_apart)


def _at_most_1(light: Floats) -> Floats:
    return np.clip(light, 0.0, 1.0)


def clipped_light(drawing: Drawing) -> Iterator[Variant]:
    yield "", lambda given: replace(given, light=given.light._replace(total=_at_most_1))
