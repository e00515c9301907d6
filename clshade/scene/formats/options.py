"""Options of `load` for mesh files: texture, resolution, crease angle, up axis, two-sided lighting."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from numbers import Integral
from types import NoneType
from typing import Any

from ...base.validation import choice, flag, integer, number, value_error
from ..camera import MAX_RESOLUTION
from ..framing import UPS, Up
from ..model import Material, Scene, Texture
from ..normals import crease_angle
from .texture import as_texture


@dataclass(frozen=True)
class Options:
    """Options of `clshade.scene.formats.load.load` for mesh files, as `options_for` checks them.

    texture: a Texture in place of the file's. resolution: (N, M) or None. crease: degrees, 0 to 180, or None for the
    format's default. up: one of framing.UPS, or None. two_sided: True, False, or None for what the file asks for. fit:
    whether to ignore the file's camera. time: seconds, or None for the file at rest. animation: its name or number, or
    None for the first.
    """

    texture: Texture | None = None
    resolution: tuple[int, int] | None = None
    crease: float | None = None
    up: Up | None = None
    two_sided: bool | None = None
    fit: bool = False
    time: float | None = None
    animation: str | int | None = None

    def lit(self, material: Material, *, by_file: bool) -> Material:
        """Return the material with the requested sides drawn and lit.

        by_file: whether the file format can say which sides are lit. For other formats both are: on a closed surface
        that changes no pixel, and on a surface that is open or inside out no side stays dark.
        """
        two_sided = self.two_sided
        if two_sided is None:
            return material if by_file else replace(material, two_sided=True)
        return replace(material, two_sided=two_sided, sides="both" if two_sided else material.sides)


def options_for(
    who: str,
    *,
    texture: Any,
    resolution: Any,
    crease: Any,
    flat: Any,
    up: Any,
    two_sided: Any,
    fit: Any,
    time: Any = None,
    animation: Any,
) -> Options:
    """Return the options that users give `who`, see `load`. Raises InputError, naming `who`, for one that is refused."""
    if flag(who, "flat", flat):
        if crease is not None:
            raise value_error(who, "crease", "none beside flat, which is a crease of 0", crease)
        crease = 0.0
    if isinstance(animation, bool) or not isinstance(animation, (str, Integral, NoneType)):
        raise value_error(who, "animation", "a name or a whole number", animation)
    if up is not None:
        choice(who, "up", up, UPS)
    return Options(
        resolution=None if resolution is None else checked_resolution(who, resolution),
        crease=None if crease is None else crease_angle(who, "crease", crease),
        up=up,
        two_sided=None if two_sided is None else flag(who, "two_sided", two_sided),
        fit=flag(who, "fit", fit),
        time=None if time is None else number(who, "time", time, least=0.0),
        animation=int(animation) if isinstance(animation, Integral) else animation,
        texture=None if texture is None else as_texture(texture, srgb=True),
    )


def checked_resolution(who: str, resolution: Any) -> tuple[int, int]:
    """Return a resolution (N, M). Raises InputError, naming `who`, for anything else."""
    try:
        columns, rows = resolution
    except (TypeError, ValueError):
        raise value_error(who, "resolution", "two whole numbers (N, M)", resolution) from None
    return (
        integer(who, "resolution N", columns, 1, MAX_RESOLUTION),
        integer(who, "resolution M", rows, 1, MAX_RESOLUTION),
    )


def warn_ignored(scene: Scene, owner: str, ignored: Iterable[str]) -> Scene:
    """Return the scene with the features that are not rendered in `Scene.ignored`, each once, and warn of them once."""
    names: Any = tuple(dict.fromkeys((*scene.ignored, *ignored)))
    if not names:
        return scene
    line = f"{owner}: not rendered: {', '.join(names)}"
    warnings.warn(line if line.isprintable() else ascii(line), stacklevel=2)
    return replace(scene, ignored=names)
