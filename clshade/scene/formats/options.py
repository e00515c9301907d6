"""Options of `load` for mesh files: texture, resolution, crease angle, up axis, two-sided lighting."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from numbers import Integral
from types import NoneType
from typing import Any

from ...base.validation import choice, number, value_error
from ..framing import UPS, Up
from ..model import Material, Scene, Texture
from ..normals import crease_angle


@dataclass(frozen=True)
class Options:
    """Options of `clshade.scene.formats.load.load` for mesh files, checked on construction.

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

    def __post_init__(self) -> None:
        if self.crease is not None:
            object.__setattr__(self, "crease", crease_angle("load", "crease", self.crease))
        if self.up is not None:
            choice("load", "up", self.up, UPS)
        if self.time is not None:
            object.__setattr__(self, "time", number("load", "time", self.time, least=0.0))
        if isinstance(self.animation, bool) or not isinstance(self.animation, (str, Integral, NoneType)):
            raise value_error("load", "animation", "a name or a whole number", self.animation)

    def lit(self, material: Material, *, by_file: bool) -> Material:
        """Return the material with the requested sides drawn and lit.

        by_file: whether the file format can say which sides are lit. For other formats both are: on a closed surface
        that changes no pixel, and on a surface that is open or inside out no side stays dark.
        """
        two_sided = self.two_sided
        if two_sided is None:
            return material if by_file else replace(material, two_sided=True)
        return replace(material, two_sided=two_sided, sides="both" if two_sided else material.sides)


def warn_ignored(scene: Scene, owner: str, ignored: Iterable[str]) -> Scene:
    """Return the scene with the features that are not rendered in `Scene.ignored`, each once, and warn of them once."""
    names: Any = tuple(dict.fromkeys((*scene.ignored, *ignored)))
    if not names:
        return scene
    line = f"{owner}: not rendered: {', '.join(names)}"
    warnings.warn(line if line.isprintable() else ascii(line), stacklevel=2)
    return replace(scene, ignored=names)
