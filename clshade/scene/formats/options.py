"""Options of `load`, as the readers take them, and what all readers do."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from numbers import Integral
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from ...base.arrays import Array
from ...base.declare import checked
from ...base.validation import choice, flag, number, value_error
from ...images.decode import srgb_to_linear
from ..adjust_camera import refitted
from ..camera import checked_resolution
from ..framing import UPS, Up
from ..geometry import crease_angle, vertex_normals
from ..model import Material, Scene, Texture, with_fields, with_materials

FPS = 30  # of animations that are played
VertexColors: TypeAlias = Literal["srgb", "linear"]
VERTEX_COLORS: tuple[VertexColors, ...] = get_args(VertexColors)
DEFAULT_MATERIAL = Material(ka=1.0, kd=0.8, ks=0.3, n=32.0)  # for faces without a material in the file


def _animation(who: str, name: str, value: Any) -> str | int:
    """Return the name of an animation, or its number as an int."""
    if isinstance(value, bool) or not isinstance(value, (str, Integral)):
        raise value_error(who, name, "a name or a whole number", value)
    return int(value) if isinstance(value, Integral) else value


@dataclass(frozen=True)
class Options:
    """Options of `clshade.scene.formats.load.load`, with its checks; None leaves two_sided to the file."""

    texture: Texture | None = None
    focal: float | None = checked(None, partial(number, above=0.0))
    resolution: tuple[int, int] | None = checked(None, lambda who, name, value: checked_resolution(who, value))
    crease: float | None = checked(None, crease_angle)
    weld: bool = checked(False, flag)
    up: Up = checked("y", partial(choice, allowed=UPS))
    two_sided: bool | None = checked(None, flag)
    fit: bool = checked(False, flag)
    time: float | None = checked(None, partial(number, least=0.0))
    animation: str | int | None = checked(None, _animation)
    vertex_colors: VertexColors = checked("srgb", partial(choice, allowed=VERTEX_COLORS))

    def lit(self, material: Material) -> Material:
        """Return the material with the requested sides drawn and lit."""
        if self.two_sided is None:
            return material
        return with_fields(material, two_sided=self.two_sided, sides="both" if self.two_sided else material.sides)

    def applied(self, scene: Scene) -> Scene:
        """Return a scene of a file that has all of one with the requested resolution, sides and camera."""
        if self.resolution is not None:
            scene = replace(scene, camera=scene.camera.with_resolution(self.resolution))
        scene = with_materials(scene, self.lit)
        return refitted(scene) if self.fit else scene


def linear_colors(values: Array, options: Options, owner: str) -> Array:
    """Return linear colors (K, 4) float64 with alpha for those of a file, (K, 4), as options.vertex_colors says.

    An alpha of NaN is not in the file and becomes 1. With a warning that begins with `owner`, a color that is not finite
    becomes white, whole numbers up to 255 are divided by 255, and alphas that are all 0, which would hide everything,
    become 1.
    """
    values, remarks = values.astype(np.float64), []
    finite = np.isfinite(values[:, :3]).all(axis=1)
    with_alpha = finite & np.isfinite(values[:, 3])
    if not finite.all():
        remarks.append(f"colors that are not finite became white: {(~finite).sum()}")
    for words, rows, columns in (("colors", finite, slice(3)), ("alphas", with_alpha, slice(3, 4))):
        part = values[rows, columns]
        if 1.0 < part.max(initial=0.0) <= 255.0 and (part == np.floor(part)).all():
            remarks.append(f"{words} up to {part.max():g} were divided by 255")
            values[rows, columns] = part / 255.0
    if with_alpha.any() and not values[with_alpha, 3].any():
        remarks.append("alphas, which are all 0, became 1")
        with_alpha[:] = False
    values[~finite, :3] = 1.0
    values[~with_alpha, 3] = 1.0
    np.clip(values[:, 3], 0.0, 1.0, out=values[:, 3])
    for remark in remarks:
        warnings.warn(f"{owner}: {remark}", stacklevel=2)
    most = np.finfo(np.float32).max
    if options.vertex_colors == "srgb":
        with np.errstate(over="ignore"):
            values[:, :3] = srgb_to_linear(np.maximum(values[:, :3], 0.0))
    return np.clip(values, -most, most, out=values)


def mended_normals(verts: Array, faces: Array, normals: Array, normal_faces: Array, owner: str) -> tuple[Array, Array]:
    """Return normals (K, 3) and normal_faces (F, 3) of a file, with normals computed from the faces in place of those in
    use that are 0 or not finite; a warning that begins with `owner` counts them."""
    lost: Array = np.asarray(~(np.isfinite(normals).all(axis=1) & normals.any(axis=1)))
    if not lost.any():
        return normals, normal_faces
    normals = np.where(lost[:, None], normals.dtype.type(0.0), normals)
    corners = lost[normal_faces]
    if not corners.any():
        return normals, normal_faces
    count = len(np.unique(normal_faces[corners]))
    warnings.warn(f"{owner}: normals that are 0 or not finite were computed from the faces: {count}", stacklevel=2)
    vertices, which = np.unique(faces[corners], return_inverse=True)
    computed = vertex_normals(verts, faces)[vertices].astype(normals.dtype)
    normal_faces = normal_faces.copy()
    normal_faces[corners] = len(normals) + which.reshape(-1)
    return np.concatenate([normals, computed]), normal_faces


def warn_ignored(scene: Scene, owner: str, ignored: Iterable[str]) -> Scene:
    """Return the scene with the features that are not rendered in `Scene.ignored`, each once, and warn of them once, and of
    texture coordinates that are not finite."""
    textured = (mesh.uvs for mesh in scene.meshes if mesh.uvs is not None and mesh.material.texture is not None)
    if not all(np.isfinite(uvs).all() for uvs in textured):
        warnings.warn(f"{owner}: texture coordinates that are not finite count as 0", stacklevel=2)
    names: Any = tuple(dict.fromkeys((*scene.ignored, *ignored)))
    if not names:
        return scene
    line = f"{owner}: not rendered: {', '.join(names)}"
    warnings.warn(line if line.isprintable() else ascii(line), stacklevel=2)
    return replace(scene, ignored=names)
