"""Mistakes in the light at a point: wrong terms, wrong directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ....base.arrays import Floats
from ....oracle.lights import Directions
from ....oracle.shade import RIGHT
from ....oracle.transform import dot, unit
from ....scene.camera import Camera
from ..drawing import Drawing, Edit, Shade, instead, then
from .mistake import Mistake, of_materials, plain_materials, scaled, wrong_setting

Value = Callable[[Directions, Floats], Floats]


def _with_light(drawing: Drawing, **steps: Any) -> Drawing:
    return replace(drawing, light=drawing.light._replace(**steps))


# Directions. Positions are relative to the eye, which lies at 0.


class _Lit(NamedTuple):
    """Where light arrives: the directions so far; point, normal as it is interpolated, and light (..., 3); the camera."""

    at: Directions
    point: Floats
    normal: Floats
    light: Floats
    camera: Camera


def _direction(name: str, value: Callable[[_Lit], Floats]) -> Edit:
    """Return an edit that exchanges one of the directions."""

    def change(drawing: Drawing) -> Drawing:
        def directions(point: Floats, normal: Floats, eye: Floats, light: Floats) -> Directions:
            at = drawing.light.directions(point, normal, eye, light)
            direction = value(_Lit(at, point, normal, light, drawing.scene.camera))
            return at._replace(**{name: np.broadcast_to(direction, getattr(at, name).shape)})

        return _with_light(drawing, directions=directions)

    return change


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


def short_normals(drawing: Drawing) -> Drawing:
    """Return the drawing with N as it is interpolated, in N.L and in R; |R-V|^2 would give R.V of unit vectors only."""
    drawing = _direction("normal", lambda here: here.normal)(drawing)
    right_so_far = drawing.light.terms["ks"] is RIGHT.terms["ks"]
    return _term("ks", _gated(lambda at: dot(_mirror(at), at.to_eye)))(drawing) if right_so_far else drawing


def _uncolored(drawing: Drawing) -> Drawing:
    """Return the drawing in white. Colors of vertices are replaced at the corners, which drawings on a canvas share."""
    white = then(corners=lambda corners: replace(corners, colors=np.ones_like(corners.colors)))
    return white(plain_materials(drawing))


def _white_apart(drawing: Drawing, shade: Shade) -> Floats:
    return shade(scaled(drawing, ks=0.0)) + shade(scaled(_uncolored(drawing), ka=0.0, kd=0.0))


MISTAKES = (
    Mistake(
        "highlight without color",
        "The course multiplies the highlight by the color, too.",
        {"": instead(compose=_white_apart)},
    ),
    Mistake(
        "light clipped before color",
        "Clip the sum to 1 at the end, after the color.",
        {"": lambda drawing: _with_light(drawing, total=lambda light: np.clip(light, 0.0, 1.0))},
    ),
    Mistake("N.L not clamped", "Take max(N.L, 0), or lights behind darken.", {"": _term("kd", lambda at, n: at.n_l)}),
    Mistake(
        "N.L by absolute value",
        "|N.L| lights the far side too: max(N.L, 0).",
        {"": _term("kd", lambda at, n: np.abs(at.n_l))},
    ),
    Mistake(
        "highlight without gate",
        "There is no highlight where the light is behind, N.L <= 0.",
        {"": _term("ks", lambda at, n: _to_power(dot(_mirror(at), at.to_eye), n))},
    ),
    Mistake(
        "R.V by absolute value",
        "|R.V| or an even power makes a second highlight: max(R.V, 0).",
        {"": _term("ks", _gated(lambda at: np.abs(dot(_mirror(at), at.to_eye))))},
    ),
    Mistake(
        "Blinn for Phong",
        "Phong's highlight is (R.V)^n, Blinn's (N.H)^n.",
        {"": _term("ks", _gated(lambda at: dot(unit(at.to_light + at.to_eye), at.normal)))},
    ),
    Mistake(
        "R with the wrong sign",
        "R points the wrong way: R = 2N(N.L) - L.",
        {"": _term("ks", _gated(lambda at: dot(-_mirror(at), at.to_eye)))},
    ),
    Mistake(
        "R without its factor 2",
        "R = 2N(N.L) - L.",
        {"": _term("ks", _gated(lambda at: dot(at.normal * at.n_l[..., None] - at.to_light, at.to_eye)))},
    ),
    Mistake(
        "no exponent",
        "Raise the highlight to the power n.",
        {"": lambda drawing: of_materials(drawing, lambda material: replace(material, n=1.0))},
    ),
    Mistake(
        "V from the wrong point",
        "V points from the surface to the eye: V = eye - P.",
        {
            "away from the eye, P - eye": _direction("to_eye", lambda here: -here.at.to_eye),
            "toward the origin, -P": _direction("to_eye", lambda here: unit(-here.camera.eye - here.point)),
            "toward lookat": _direction("to_eye", lambda here: unit(here.camera.lookat - here.camera.eye - here.point)),
            "the same everywhere, eye - lookat": _direction(
                "to_eye", lambda here: unit(here.camera.eye - here.camera.lookat)
            ),
            "the eye's position itself": _direction("to_eye", lambda here: unit(here.camera.eye)),
        },
    ),
    Mistake(
        "L from the wrong point",
        "L points from the surface to the light: L = position - P.",
        {
            "away from the light, P - position": _direction("to_light", lambda here: -here.at.to_light),
            "the light's position itself": _direction("to_light", lambda here: unit(here.light + here.camera.eye)),
            "from the eye, position - eye": _direction("to_light", lambda here: unit(here.light)),
        },
    ),
    Mistake(
        "light at each point",
        "The course takes V and L at the triangle's center of mass.",
        wrong_setting("lighting_at", {"centroid": "position"}),
    ),
)
