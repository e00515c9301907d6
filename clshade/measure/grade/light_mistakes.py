"""Mistakes in the light: wrong directions, and wrong terms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Floats
from ...oracle.terms import RIGHT, Directions
from ...oracle.vectors import dot, unit
from ...scene.camera import Camera
from ...scene.model import Material, with_materials
from .drawing import Drawing, Edit, Shade, instead, only, then, variants

Value = Callable[[Directions, Floats], Floats]


# Directions. Positions are relative to the eye, which lies at 0.


class _Lit(NamedTuple):
    """Where light arrives: the directions so far; point, normal as it is interpolated, and light (..., 3); the camera."""

    at: Directions
    point: Floats
    normal: Floats
    light: Floats
    camera: Camera


def _with_light(drawing: Drawing, **steps: Any) -> Drawing:
    return replace(drawing, light=drawing.light._replace(**steps))


def _direction(name: str, value: Callable[[_Lit], Floats]) -> Edit:
    """Return an edit that exchanges one of the directions."""

    def change(drawing: Drawing) -> Drawing:
        def directions(point: Floats, normal: Floats, eye: Floats, light: Floats) -> Directions:
            at = drawing.light.directions(point, normal, eye, light)
            found = value(_Lit(at, point, normal, light, drawing.scene.camera))
            return at._replace(**{name: np.broadcast_to(found, getattr(at, name).shape)})

        return _with_light(drawing, directions=directions)

    return change


wrong_view = variants(
    {
        "away from the eye, P - eye": _direction("to_eye", lambda here: -here.at.to_eye),
        "toward the origin, -P": _direction("to_eye", lambda here: unit(-here.camera.eye - here.point)),
        "toward lookat": _direction("to_eye", lambda here: unit(here.camera.lookat - here.camera.eye - here.point)),
        "the same everywhere, eye - lookat": _direction(
            "to_eye", lambda here: unit(here.camera.eye - here.camera.lookat)
        ),
        "the eye's position itself": _direction("to_eye", lambda here: unit(here.camera.eye)),
    }
)
wrong_light = variants(
    {
        "away from the light, P - position": _direction("to_light", lambda here: -here.at.to_light),
        "the light's position itself": _direction("to_light", lambda here: unit(here.light + here.camera.eye)),
        "from the eye, position - eye": _direction("to_light", lambda here: unit(here.light)),
    }
)


# Terms. All of these take cosines of vectors of any length, as N has another where it is not normalized.


def _term(name: str, value: Value) -> Edit:
    """Return an edit that replaces the term of a coefficient."""
    return lambda drawing: _with_light(drawing, terms={**drawing.light.terms, name: value})


def _mirror(at: Directions) -> Floats:
    return 2.0 * at.normal * at.n_l[..., None] - at.to_light


def _to_power(cosine: Floats, n: Floats) -> Floats:
    return np.where(cosine > 0.0, np.maximum(cosine, 0.0) ** n, 0.0)


def _gated(cosine: Callable[[Directions], Floats]) -> Value:
    """Return the highlight of another cosine."""
    return lambda at, n: np.where(at.n_l > 0.0, _to_power(cosine(at), n), 0.0)


def _short_normals(drawing: Drawing) -> Drawing:
    """Return the drawing with N as it is interpolated, in N.L and in R; |R-V|^2 would give R.V of unit vectors only."""
    drawing = _direction("normal", lambda here: here.normal)(drawing)
    right_so_far = drawing.light.terms["ks"] is RIGHT.terms["ks"]
    return _term("ks", _gated(lambda at: dot(_mirror(at), at.to_eye)))(drawing) if right_so_far else drawing


unnormalized = only(_short_normals)
unclamped = only(_term("kd", lambda at, n: at.n_l))
absolute = only(_term("kd", lambda at, n: np.abs(at.n_l)))
ungated = only(_term("ks", lambda at, n: _to_power(dot(_mirror(at), at.to_eye), n)))
absolute_mirror = only(_term("ks", _gated(lambda at: np.abs(dot(_mirror(at), at.to_eye)))))
blinn = only(_term("ks", _gated(lambda at: dot(unit(at.to_light + at.to_eye), at.normal))))
reversed_mirror = only(_term("ks", _gated(lambda at: dot(-_mirror(at), at.to_eye))))
halved_mirror = only(_term("ks", _gated(lambda at: dot(at.normal * at.n_l[..., None] - at.to_light, at.to_eye))))


# Sums


def of_materials(drawing: Drawing, change: Callable[[Material], Material]) -> Drawing:
    """Return the drawing with changed materials."""
    return replace(drawing, scene=with_materials(drawing.scene, change))


def scaled(drawing: Drawing, **factors: float) -> Drawing:
    """Return the drawing with coefficients of all materials multiplied."""

    def change(material: Material) -> Material:
        return replace(material, **{name: getattr(material, name) * factor for name, factor in factors.items()})

    return of_materials(drawing, change)


def plain_materials(drawing: Drawing) -> Drawing:
    """Return the drawing with materials whose color is that of the vertices."""
    return of_materials(drawing, lambda material: replace(material, texture=None, color=1.0))


def _uncolored(drawing: Drawing) -> Drawing:
    """Return the drawing in white. Colors of vertices are replaced at the corners, which drawings on a canvas share."""
    white = then(corners=lambda corners: replace(corners, colors=np.ones_like(corners.colors)))
    return white(plain_materials(drawing))


def _white_apart(drawing: Drawing, shade: Shade) -> Floats:
    return shade(scaled(drawing, ks=0.0)) + shade(scaled(_uncolored(drawing), ka=0.0, kd=0.0))


white_highlight = only(instead(compose=_white_apart))
clipped_light = only(lambda drawing: _with_light(drawing, total=lambda light: np.clip(light, 0.0, 1.0)))
