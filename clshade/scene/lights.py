"""Lights: points, directions and spots, as the glTF extension KHR_lights_punctual has them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Floats, Vector
from ..base.validation import choice, number, set_fields, value_error, vector

Attenuation: TypeAlias = Literal["none", "inverse-square"]
ATTENUATIONS: tuple[Attenuation, ...] = get_args(Attenuation)
WIDEST_CONE = 90.0  # degrees from the axis
NARROWEST_EDGE = 1e-3  # of a cone: least difference of the cosines between which it fades (KHR_lights_punctual)


def _ones() -> Any:
    return np.ones(3)


def _intensity(who: str, value: Any) -> Floats:
    intensity = vector(who, "intensity", value)
    if (np.abs(intensity) > float(np.finfo(np.float32).max)).any():
        raise value_error(who, "intensity", "numbers within float32", intensity.tolist())
    return intensity


def _direction(who: str, value: Any) -> Floats:
    direction = vector(who, "direction", value)
    if not direction.any():
        raise value_error(who, "direction", "a vector other than 0", direction.tolist())
    return direction


def _check_attenuation(who: str, light: PointLight | SpotLight) -> None:
    choice(who, "attenuation", light.attenuation, ATTENUATIONS)
    if light.range is None:
        return
    if light.attenuation == "none":
        raise value_error(who, "range", "None without attenuation", light.range)
    set_fields(light, range=number(who, "range", light.range, above=0.0))


def unit_direction(light: DirectionalLight | SpotLight) -> Floats:
    """Return the direction that the light travels in, or the axis of its cone: (3,), unit."""
    scaled = np.ldexp(
        light.direction, -np.frexp(np.abs(light.direction).max())[1]
    )  # squares neither over- nor underflow
    unit: Floats = scaled / math.sqrt(float(scaled @ scaled))
    return unit


def _numbers(values: Floats | tuple[float, ...]) -> str:
    return " ".join(f"{value + 0.0:.6g}" for value in np.asarray(values).tolist())


@dataclass(frozen=True, eq=False)
class PointLight:
    """A light that shines from a point in all directions.

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

    Raises
    ------
    InputError
        A value is not finite, beyond float32, or not allowed; the message names the field.

    Notes
    -----
    Position and intensity are kept as read-only (3,) float64 arrays. At a distance of 0 a light
    contributes nothing.
    """

    position: Floats
    intensity: Vector = field(default_factory=_ones)
    attenuation: Attenuation = "none"
    range: float | None = None

    if TYPE_CHECKING:  # here and below: the accepted types; the fields have those that are kept

        def __init__(
            self,
            position: ArrayLike,
            intensity: ArrayLike = ...,
            attenuation: Attenuation = "none",
            range: float | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        position = vector("PointLight", "position", self.position)
        set_fields(self, position=position, intensity=_intensity("PointLight", self.intensity))
        _check_attenuation("PointLight", self)

    def __repr__(self) -> str:
        return f"<PointLight {described(self)}>"


@dataclass(frozen=True, eq=False)
class DirectionalLight:
    """A light from infinitely far away, such as the sun: it arrives everywhere from the same direction.

    Attributes
    ----------
    direction : array_like, (3,)
        Direction that the light travels in, world space, any length but 0.
    intensity : array_like, (3,), default (1, 1, 1)
        Linear RGB, any values that float32 holds: the illuminance of a surface that faces the
        light (lux).

    Raises
    ------
    InputError
        A value is not finite, beyond float32, or not allowed; the message names the field.

    Notes
    -----
    Both are kept as read-only (3,) float64 arrays.
    """

    direction: Floats
    intensity: Vector = field(default_factory=_ones)

    if TYPE_CHECKING:

        def __init__(self, direction: ArrayLike, intensity: ArrayLike = ...) -> None: ...

    def __post_init__(self) -> None:
        direction = _direction("DirectionalLight", self.direction)
        set_fields(self, direction=direction, intensity=_intensity("DirectionalLight", self.intensity))

    def __repr__(self) -> str:
        return f"<DirectionalLight {described(self)}>"


@dataclass(frozen=True, eq=False)
class SpotLight:
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
    attenuation : {"none", "inverse-square"}
        As of a PointLight.
    range : float or None, default None
        As of a PointLight.

    Raises
    ------
    InputError
        A value is not finite, beyond float32, or not allowed; the message names the field.

    Notes
    -----
    Position, direction and intensity are kept as read-only (3,) float64 arrays. A cone narrower
    than 2.56 degrees never reaches its full intensity: cos(inner) - cos(outer) is then below 0.001.
    """

    position: Floats
    direction: Floats
    intensity: Vector = field(default_factory=_ones)
    inner_cone: float = 0.0
    outer_cone: float = 45.0
    attenuation: Attenuation = "none"
    range: float | None = None

    if TYPE_CHECKING:

        def __init__(
            self,
            position: ArrayLike,
            direction: ArrayLike,
            intensity: ArrayLike = ...,
            inner_cone: float = 0.0,
            outer_cone: float = 45.0,
            attenuation: Attenuation = "none",
            range: float | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        position, direction = vector("SpotLight", "position", self.position), _direction("SpotLight", self.direction)
        set_fields(self, position=position, direction=direction, intensity=_intensity("SpotLight", self.intensity))
        for name in ("inner_cone", "outer_cone"):
            angle = number("SpotLight", name, getattr(self, name), least=0.0)
            if angle > WIDEST_CONE:
                raise value_error("SpotLight", name, "degrees from 0 to 90", getattr(self, name))
            set_fields(self, **{name: angle})
        if self.inner_cone > self.outer_cone:
            expected = f"an angle of at most outer_cone, {self.outer_cone:g} degrees"
            raise value_error("SpotLight", "inner_cone", expected, self.inner_cone)
        _check_attenuation("SpotLight", self)

    def __repr__(self) -> str:
        return f"<SpotLight {described(self)}>"


Light: TypeAlias = PointLight | DirectionalLight | SpotLight
LIGHTS = (PointLight, DirectionalLight, SpotLight)


def attenuates(light: Light) -> bool:
    """Return whether the light decreases with distance."""
    return not isinstance(light, DirectionalLight) and light.attenuation != "none"


def is_plain(light: Light) -> bool:
    """Return whether the light is a point without attenuation."""
    return isinstance(light, PointLight) and not attenuates(light)


def plain_lights(owner: str, lights: tuple[Light, ...]) -> tuple[PointLight, ...]:
    """Return the lights if all are points without attenuation. Raises InputError for another, naming `owner`."""
    found = tuple(light for light in lights if isinstance(light, PointLight) and is_plain(light))
    if len(found) < len(lights):
        other = next(light for light in lights if not is_plain(light))
        raise value_error(owner, "lights", "points without attenuation", other)
    return found


def described(light: Light) -> str:
    """Return where the light is, where it shines and how bright, in a few words."""
    words = []
    if not isinstance(light, DirectionalLight):
        words.append(f"at {_numbers(light.position)}")
    if not isinstance(light, PointLight):
        words.append(f"along {_numbers(light.direction)}")
    if isinstance(light, SpotLight):
        words.append(f"cone {light.inner_cone:g} to {light.outer_cone:g} degrees")
    words.append(f"intensity {_numbers(light.intensity)}")
    if not isinstance(light, DirectionalLight) and attenuates(light):
        words.append("inverse-square" + ("" if light.range is None else f" up to {light.range:g}"))
    return ", ".join(words)
