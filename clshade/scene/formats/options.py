"""What `load` may be asked of any mesh file: texture, resolution, creases, the axis that is up, two-sided light."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from ...base.validation import choice
from ..framing import UPS, Up
from ..model import Material, Scene, Texture
from ..normals import crease_angle


@dataclass(frozen=True)
class Options:
    """The options of `clshade.scene.formats.load.load` for mesh files, checked on construction.

    texture: a Texture in place of the file's. resolution: (N, M) or None. crease: degrees, 0 to 180, or None for what
    the format means. up: one of framing.UPS, or None. two_sided: True, False or None for what the file asks for.
    """

    texture: Texture | None = None
    resolution: tuple[int, int] | None = None
    crease: float | None = None
    up: Up | None = None
    two_sided: bool | None = None

    def __post_init__(self) -> None:
        if self.crease is not None:
            object.__setattr__(self, "crease", crease_angle("load", "crease", self.crease))
        if self.up is not None:
            choice("load", "up", self.up, UPS)

    def lit(self, material: Material, *, by_file: bool) -> Material:
        """The material with the sides that are drawn and lit as asked for.

        by_file: whether the file's format can say which sides are lit. Of others both are: on a closed surface that
        changes no pixel, and on an open one, or one that is inside out, no side stays dark.
        """
        two_sided = self.two_sided
        if two_sided is None:
            return material if by_file else replace(material, two_sided=True)
        return replace(material, two_sided=two_sided, sides="both" if two_sided else material.sides)


def warn_ignored(scene: Scene, owner: str, ignored: Iterable[str]) -> Scene:
    """The scene with what is not rendered in `Scene.ignored`, each once, and in one UserWarning."""
    names: Any = tuple(dict.fromkeys((*scene.ignored, *ignored)))
    if not names:
        return scene
    line = f"{owner}: not rendered: {', '.join(names)}"
    warnings.warn(line if line.isprintable() else ascii(line), stacklevel=2)
    return replace(scene, ignored=names)
