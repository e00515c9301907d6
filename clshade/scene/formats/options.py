"""Options of `load`, as the readers take them."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from ..adjust_camera import refitted
from ..framing import Up
from ..model import Material, Scene, Texture, with_materials

DEFAULT_MATERIAL = Material(ka=1.0, kd=0.8, ks=0.3, n=32.0)  # for faces without a material in the file


@dataclass(frozen=True)
class Options:
    """Options of `clshade.scene.formats.load.load`, as it checks them.

    texture: a Texture in place of the file's. focal: of a course file, or None. resolution: (N, M) or None. crease:
    degrees, 0 to 180, or None for the format's default. weld: see `load`. up: one of framing.UPS. two_sided: True, False,
    or None for what the file asks for. fit: whether to ignore the file's camera. time: seconds, or None for the file at
    rest. animation: its name or number, or None for the first.
    """

    texture: Texture | None = None
    focal: float | None = None
    resolution: tuple[int, int] | None = None
    crease: float | None = None
    weld: bool = False
    up: Up = "y"
    two_sided: bool | None = None
    fit: bool = False
    time: float | None = None
    animation: str | int | None = None

    def lit(self, material: Material) -> Material:
        """Return the material with the requested sides drawn and lit."""
        if self.two_sided is None:
            return material
        return replace(material, two_sided=self.two_sided, sides="both" if self.two_sided else material.sides)

    def applied(self, scene: Scene) -> Scene:
        """Return a scene of a file that has all of one with the requested resolution, sides and camera."""
        if self.resolution is not None:
            scene = replace(scene, camera=scene.camera.with_resolution(self.resolution))
        scene = with_materials(scene, self.lit)
        return refitted(scene) if self.fit else scene


def warn_ignored(scene: Scene, owner: str, ignored: Iterable[str]) -> Scene:
    """Return the scene with the features that are not rendered in `Scene.ignored`, each once, and warn of them once."""
    names: Any = tuple(dict.fromkeys((*scene.ignored, *ignored)))
    if not names:
        return scene
    line = f"{owner}: not rendered: {', '.join(names)}"
    warnings.warn(line if line.isprintable() else ascii(line), stacklevel=2)
    return replace(scene, ignored=names)
