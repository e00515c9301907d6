"""Lights: points, directions and spots, as the glTF extension KHR_lights_punctual has them; spheres and rectangles.

A class says all that is known of its kind: fields, where it shines, what glTF can say of it. A field that kinds share means
the same in all of them, see `FIELDS`. Vectors are kept as read-only (3,) float64 arrays. A value that is not finite, beyond
float32 or not allowed raises InputError, which names the field.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np

from ..base.arrays import Array, Floats, Vector
from ..base.declare import record
from ..base.validation import choice, number, value_error, vector

if TYPE_CHECKING:
    from typing_extensions import Self

Attenuation: TypeAlias = Literal["none", "inverse-square"]
ATTENUATIONS: tuple[Attenuation, ...] = get_args(Attenuation)
MAX_CONE = 90.0  # degrees from the axis
MIN_ANGLE = 1e-6  # radians between the sides of a rectangle
MIN_CONE_EDGE = 1e-3  # of a cone: least difference of the cosines between which it fades (KHR_lights_punctual)
_WHITE: Any = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Field:
    """A field of lights.

    check: of class, field and value; returns the value that is kept. text: of `repr`, unless the value is `missing`.
    turns: a vector that turns with the scene. grows: a length, or several. moves: a position. values: what random scenes
    try: all there are, or the limits of a range and numbers between them; vectors and lengths are drawn freely.
    """

    check: Callable[[str, str, Any], Any]
    text: str
    turns: bool = False
    grows: bool = False
    moves: bool = False
    values: tuple[Any, ...] = ()
    missing: Any = None


def _intensity(who: str, name: str, value: Any) -> Floats:
    intensity = vector(who, name, value)
    if (np.abs(intensity) > float(np.finfo(np.float32).max)).any():
        raise value_error(who, name, "numbers within float32", intensity.tolist())
    return intensity


def _direction(who: str, name: str, value: Any) -> Floats:
    direction = vector(who, name, value)
    if not direction.any():
        raise value_error(who, name, "a vector other than 0", direction.tolist())
    return direction


def _range(who: str, name: str, value: Any) -> float | None:
    return None if value is None else number(who, name, value, above=0.0)


_angle = partial(number, least=0.0, most=MAX_CONE, expected="degrees from 0 to 90")
_ANGLES = (0.0, 1e-3, 1.0, MAX_CONE)
FIELDS = {  # in the order of texts
    "position": Field(vector, ", at {}", turns=True, grows=True, moves=True),
    "right": Field(_direction, ", right {}", turns=True, grows=True),
    "up": Field(_direction, ", up {}", turns=True, grows=True),
    "radius": Field(partial(number, least=0.0), ", radius {}", grows=True, values=(0.0,), missing=0.0),
    "direction": Field(_direction, ", along {}", turns=True),
    "inner_cone": Field(_angle, ", cone {}", values=_ANGLES),
    "outer_cone": Field(_angle, " to {} degrees", values=_ANGLES),
    "intensity": Field(_intensity, ", intensity {}"),
    "attenuation": Field(partial(choice, allowed=ATTENUATIONS), ", {}", values=ATTENUATIONS, missing="none"),
    "range": Field(_range, " up to {}", grows=True, values=(None,)),
}


def described(facts: dict[str, Any]) -> str:
    """Return where a light is, where it shines and how bright, in a few words. facts: its fields, see `AnyLight.facts`."""
    text = ""
    for name, item in FIELDS.items():
        value = facts.get(name, item.missing)
        if value != item.missing:
            values = value if isinstance(value, list) else [value]
            text += item.text.format(" ".join(x if isinstance(x, str) else f"{x + 0.0:.6g}" for x in values))
    return text[2:]


def _unit(direction: Floats) -> Floats:
    scaled = np.ldexp(direction, -np.frexp(np.abs(direction).max())[1])  # squares neither over- nor underflow
    return np.asarray(scaled / math.sqrt(float(scaled @ scaled)))


@record
class AnyLight:
    """What all kinds of light have, besides an intensity."""

    gltf: ClassVar[str]  # the nearest type in KHR_lights_punctual
    size_loss: ClassVar[str] = ""  # what glTF cannot say of its size, and in brackets what it says instead

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            vars(self)[name] = FIELDS[name].check(type(self).__name__, name, value)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {described(self.facts())}>"

    def facts(self) -> dict[str, Any]:
        """Return kind and fields as JSON-compatible values."""
        values = {
            name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(self).items()
        }
        return {"kind": type(self).__name__, **values}

    @property
    def axis(self) -> Floats | None:
        """The direction, (3,) unit, in which it shines; None: in all."""
        return None

    @property
    def cone(self) -> tuple[float, float] | None:
        """Angles from the axis between which it fades, degrees; None without a cone."""
        return None

    @property
    def has_size(self) -> bool:
        """Whether it is larger than a point."""
        return False

    @property
    def attenuates(self) -> bool:
        """Whether it decreases with distance."""
        return bool(vars(self).get("attenuation", "none") != "none")

    @property
    def gltf_loss(self) -> str:
        """What of it glTF cannot say, and in brackets what it says instead."""
        return self.size_loss if self.has_size else ""

    @property
    def is_plain(self) -> bool:
        """Whether it is a point without attenuation."""
        return not (self.attenuates or self.has_size or self.axis is not None)

    def turned(self, center: Floats, turn: Array) -> Self:
        """Return the light turned about `center` by a rotation (3, 3). Raises InputError where a position overflows."""
        changes = {name: value for name, value in vars(self).items() if FIELDS[name].turns}
        with np.errstate(over="ignore"):
            for name, value in changes.items():
                changes[name] = center + turn @ (value - center) if FIELDS[name].moves else turn @ value
        return replace(self, **changes)

    def rescaled(self, scale: float, shift: float | Floats) -> Self:
        """Return the light of a scene whose lengths are `scale` times as large, moved by `shift`: what it lights is as
        bright as before."""
        changes = {
            name: value * scale for name, value in vars(self).items() if FIELDS[name].grows and value is not None
        }
        if "position" in changes:
            changes["position"] += shift
        if self.attenuates:
            changes["intensity"] = vars(self)["intensity"] * scale**2
        return replace(self, **changes)


class PlacedLight(AnyLight):
    """What all lights at a position have."""

    position: Floats
    attenuation: Attenuation
    range: float | None
    radius: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.attenuation == "none" and self.range is not None:
            raise value_error(type(self).__name__, "range", "None without attenuation", self.range)

    @property
    def sides(self) -> Floats | None:
        """Half the sides, (2, 3), of a flat light; None of another."""
        return None

    @property
    def has_size(self) -> bool:
        """Whether it is larger than a point."""
        return self.radius > 0.0 or self.sides is not None

    def profile(self, away: Floats) -> Floats | float:
        """Return what part of the intensity it sends in directions away from it, (..., 3) unit: of a spot its cone's, of a
        flat light the cosine to its normal."""
        if self.axis is None:
            return 1.0
        cosine = away @ self.axis
        if self.cone is None:
            return np.asarray(np.maximum(cosine, 0.0))
        inner, outer = np.cos(np.radians(self.cone))
        return np.asarray(np.clip((cosine - outer) / max(inner - outer, MIN_CONE_EDGE), 0.0, 1.0) ** 2)


@record
class PointLight(PlacedLight):
    """A light that shines from a point, or a sphere, in all directions.

    Attributes
    ----------
    position : array_like, (3,)
        World space.
    intensity : array_like, (3,), default (1, 1, 1)
        Linear RGB, any values that float32 holds. Without attenuation the illuminance of a surface
        that faces the light (lux); with `inverse-square` that at a distance of 1 (candela, if the
        scene's unit is the meter).
    attenuation : {"none", "inverse-square"}
        Whether the light arrives undiminished, or divided by the square of the distance.
    range : float or None, default None
        With `inverse-square`: distance d at which the light ends, by the factor
        max(1 - (d/range)^4, 0). None: it never does.
    radius : float, default 0
        Of the sphere, scene units. A receiver sees it as the disc of that radius around the position
        which faces the receiver: the light is the mean over points of the disc, each of which shines
        as a point light of this intensity (`Settings.light_samples`).

    Notes
    -----
    At a distance of 0 a light contributes nothing.
    """

    position: Vector
    intensity: Vector = _WHITE
    attenuation: Attenuation = "none"
    range: float | None = None
    radius: float = 0.0

    gltf, size_loss = "point", "radii of lights (points)"


@record
class DirectionalLight(AnyLight):
    """A light from infinitely far away, such as the sun: it arrives everywhere from the same direction.

    Attributes
    ----------
    direction : array_like, (3,)
        Direction that the light travels in, world space, any length but 0.
    intensity : array_like, (3,), default (1, 1, 1)
        Linear RGB, any values that float32 holds: the illuminance of a surface that faces the
        light (lux).
    """

    direction: Vector
    intensity: Vector = _WHITE

    gltf = "directional"

    @property
    def axis(self) -> Floats:
        """The direction that the light travels in, (3,) unit."""
        return _unit(self.direction)


@record
class SpotLight(PlacedLight):
    """A light that shines from a point into a cone.

    Attributes
    ----------
    position : array_like, (3,)
        World space.
    direction : array_like, (3,)
        Axis of the cone, away from the light, world space, any length but 0.
    intensity : array_like, (3,), default (1, 1, 1)
        Linear RGB along the axis, as of a PointLight.
    inner_cone, outer_cone : float, default 0 and 45
        Angles from the axis, degrees, 0 to 90, the inner one at most the outer one. Beyond the outer
        one there is no light; between them it fades as in KHR_lights_punctual, by the factor
        clamp((cos(angle) - cos(outer)) * s, 0, 1)^2, s = 1 / max(cos(inner) - cos(outer), 0.001).
    attenuation, range
        See `PointLight`.

    Notes
    -----
    A cone narrower than 2.56 degrees never reaches its full intensity: cos(inner) - cos(outer) is
    then below 0.001.
    """

    position: Vector
    direction: Vector
    intensity: Vector = _WHITE
    inner_cone: float = 0.0
    outer_cone: float = 45.0
    attenuation: Attenuation = "none"
    range: float | None = None

    gltf = "spot"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.inner_cone > self.outer_cone:
            expected = f"an angle of at most outer_cone, {self.outer_cone:g} degrees"
            raise value_error("SpotLight", "inner_cone", expected, self.inner_cone)

    @property
    def axis(self) -> Floats:
        """The axis of its cone, (3,) unit."""
        return _unit(self.direction)

    @property
    def cone(self) -> tuple[float, float]:
        """The angles between which it fades, degrees from the axis."""
        return self.inner_cone, self.outer_cone


@record
class RectangleLight(PlacedLight):
    """A light that shines from the front of a rectangle, as a perfectly diffuse emitter does.

    Attributes
    ----------
    position : array_like, (3,)
        Center, world space.
    right, up : array_like, (3,)
        From the center to the middle of the right and of the upper side, as seen from the front,
        world space: half the width and half the height. The light shines to the side that their
        cross product right x up points to. Where they are not at right angles the light is a
        parallelogram.
    intensity : array_like, (3,), default (1, 1, 1)
        Linear RGB along that normal, as of a PointLight; at an angle to it, times the angle's cosine.
        With `inverse-square`, the intensity over the area is the radiance of the front.
    attenuation, range
        See `PointLight`, from every point of the rectangle: the light is the mean over its points
        (`Settings.light_samples`).
    """

    position: Vector
    right: Vector
    up: Vector
    intensity: Vector = _WHITE
    attenuation: Attenuation = "none"
    range: float | None = None

    gltf, size_loss = "spot", "rectangle lights (spots of 90 degrees)"

    def __post_init__(self) -> None:
        super().__post_init__()
        if np.linalg.norm(np.cross(_unit(self.right), _unit(self.up))) < MIN_ANGLE:
            raise value_error("RectangleLight", "up", "a vector that is not parallel to right", self.up.tolist())

    @property
    def axis(self) -> Floats:
        """The normal of the side that shines, (3,) unit."""
        return _unit(np.cross(_unit(self.right), _unit(self.up)))

    @property
    def sides(self) -> Floats:
        """Half the sides, (2, 3)."""
        return np.stack([self.right, self.up])


Light: TypeAlias = PointLight | DirectionalLight | SpotLight | RectangleLight
LIGHTS: tuple[type[Light], ...] = get_args(Light)


def plain_lights(owner: str, lights: tuple[Light, ...]) -> tuple[PointLight, ...]:
    """Return the lights if all are points without attenuation. Raises InputError for another, naming `owner`."""
    for light in lights:
        if not light.is_plain:
            raise value_error(owner, "lights", "points without attenuation", light)
    return tuple(light for light in lights if isinstance(light, PointLight))
