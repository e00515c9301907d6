"""Mistakes in shading, normals, lights and coefficients."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ....base.arrays import Floats
from ....oracle.corners import Corners
from ....oracle.transform import cross, unit
from ....scene.lights import PointLight
from ..drawing import Drawing, Edit, then
from .mistake import Edits, Mistake, scaled, setting, wrong_setting
from .terms import short_normals


def _per_face(corners: Corners) -> Corners:
    a, b, c = np.moveaxis(corners.world, 1, 0)
    return replace(corners, normals=np.repeat(unit(cross(b - a, c - a))[:, None], 3, axis=1))


def _lit_by(change: Callable[[Floats], Floats]) -> Edit:
    """Return an edit that changes the intensities of the lights, (L, 3)."""

    def edit(drawing: Drawing) -> Drawing:
        lights = drawing.scene.lights
        rgb = change(np.array([light.intensity for light in lights]).reshape(-1, 3))
        changed = tuple(replace(light, intensity=intensity) for light, intensity in zip(lights, rgb, strict=True))
        return replace(drawing, scene=replace(drawing.scene, lights=changed))

    return edit


def _times(factors: Floats) -> Edit:
    """Return an edit that multiplies the intensities by (L, 1) or (L, 3)."""
    return _lit_by(lambda rgb: rgb * factors)


def _of_channel(channel: int) -> Edit:
    """Return an edit that takes one channel of all lights for all."""
    return _lit_by(lambda rgb: rgb[:, [channel] * 3])


def _missing(drawing: Drawing) -> Edits:
    one = np.eye(len(drawing.scene.lights))[..., None]
    edits = {f"light {k + 1}": _times(1.0 - one[k]) for k in range(len(one))}
    if len(one) > 2:
        edits |= {f"all but light {k + 1}": _times(one[k]) for k in (0, len(one) - 1)}
    return edits


def _one_channel(drawing: Drawing) -> Edits:
    one = np.eye(len(drawing.scene.lights))[..., None]
    edits: dict[str, Edit] = {}
    for channel, name in enumerate(("red", "green", "blue")):
        others = 1.0 - np.eye(3)[channel]
        edits |= {f"{name} of light {k + 1}": _times(1.0 - one[k] * others) for k in range(len(one))}
        edits[f"{name} of all lights, for all channels"] = _of_channel(channel)
    return edits


def _several(drawing: Drawing) -> bool:
    return len(drawing.scene.lights) > 1


def _steady(drawing: Drawing) -> bool:
    return any(isinstance(light, PointLight) and light.attenuation == "none" for light in drawing.scene.lights)


def _fading(light: Any) -> Any:
    return replace(light, attenuation="inverse-square") if isinstance(light, PointLight) else light


def _all_fading(drawing: Drawing) -> Drawing:
    return replace(drawing, scene=replace(drawing.scene, lights=tuple(map(_fading, drawing.scene.lights))))


MISTAKES = (
    Mistake(
        "shader exchanged",
        "Gouraud lights corners and interpolates colors, Phong lights each pixel.",
        wrong_setting("shader", {"phong": "gouraud", "gouraud": "phong"}),
    ),
    Mistake(
        "no light at all",
        "Call light() for each corner (Gouraud) or pixel (Phong).",
        {"": setting("shader", "nolight")},
    ),
    Mistake("normals per face", "Average the normals of the faces around a vertex.", {"": then(corners=_per_face)}),
    Mistake(
        "normals flipped",
        "Normals point inward: take the cross product of the edges in the other order.",
        {"": then(corners=lambda corners: replace(corners, normals=-corners.normals))},
    ),
    Mistake(
        "normals not renormalized",
        "Interpolated normals are shorter than 1: divide by the length in each pixel.",
        {"": short_normals},
    ),
    Mistake("a light missing", "Sum over all lights.", _missing),
    Mistake("one channel of a light", "Multiply by a light's intensity channel by channel.", _one_channel),
    Mistake(
        "lights without color",
        "Multiply by the intensity of the lights, channel by channel.",
        {"": _lit_by(lambda rgb: np.repeat(rgb.any(axis=1, keepdims=True), 3, axis=1).astype(float))},
    ),
    Mistake(
        "lights averaged",
        "Sum over the lights: do not divide by their number.",
        {"": _lit_by(lambda rgb: rgb / len(rgb))},
        _several,
    ),
    Mistake(
        "light falls off", "The course's light is not divided by the squared distance.", {"": _all_fading}, _steady
    ),
    Mistake("no ambient light", "The term ka*Ia is missing.", {"": lambda drawing: scaled(drawing, ka=0.0)}),
    Mistake("no diffuse light", "The term kd*(N.L) is missing.", {"": lambda drawing: scaled(drawing, kd=0.0)}),
    Mistake("no highlight", "The term ks*(R.V)^n is missing.", {"": lambda drawing: scaled(drawing, ks=0.0)}),
    Mistake(
        "ambient light per lamp",
        "Add ka*Ia once, not for each light.",
        {"": lambda drawing: scaled(drawing, ka=float(len(drawing.scene.lights)))},
        _several,
    ),
    Mistake(
        "ka without Ia",
        "The ambient intensity Ia is left out: the term is ka*Ia.",
        {"": lambda drawing: replace(drawing, scene=replace(drawing.scene, ambient=np.ones(3)))},
    ),
    Mistake(
        "ambient light times color", "The course adds ka*Ia as it is.", wrong_setting("ambient", {"plain": "tinted"})
    ),
)
