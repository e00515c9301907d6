"""What the readers of scene files share: options of `load`, colors, normals, textures, and what is not rendered."""

from __future__ import annotations

import contextlib
import os
import re
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from numbers import Integral
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.declare import checked
from ...base.input_files import beside, file_error, quoted, read_file
from ...base.validation import choice, flag, number, value_error
from ...errors import InputError
from ...images.decode import MAX_BYTES, CodedImage, decode_image, read_image, srgb_to_linear
from .. import framing
from ..adjust_camera import refitted
from ..camera import checked_resolution
from ..framing import UPS, Up
from ..geometry import crease_angle, vertex_normals
from ..model import Material, Mesh, Scene, Texture, with_fields, with_materials
from ..texture import Lookup, Wrap

FPS = 30  # of animations that are played
VertexColors: TypeAlias = Literal["srgb", "linear"]
VERTEX_COLORS: tuple[VertexColors, ...] = get_args(VertexColors)
DEFAULT_MATERIAL = Material(ka=1.0, kd=0.8, ks=0.3, n=32.0)  # for faces without a material in the file
MAX_PIXELS = 1 << 28  # of all images of a scene: 3 GiB as linear float32 RGB
MAX_MISSING = 256  # files for which the names of others are tried, as that takes time
_BYTES = 8  # of an image that is none, for which it counts as a pixel


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
    """Convert colors of a file (K, 4) to linear float64 with alpha (K, 4), as options.vertex_colors says.

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
    largest = np.finfo(np.float32).max
    if options.vertex_colors == "srgb":
        with np.errstate(over="ignore"):
            values[:, :3] = srgb_to_linear(np.maximum(values[:, :3], 0.0))
    return np.clip(values, -largest, largest, out=values)


def repair_normals(verts: Array, faces: Array, normals: Array, normal_faces: Array, owner: str) -> tuple[Array, Array]:
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


def name_of(path: Path) -> str:
    """Return the name of a scene: that of its file without folders and extension."""
    return os.path.splitext(os.path.basename(os.fspath(path)))[0]


def framed(meshes: tuple[Mesh, ...], path: Path, options: Options, ignored: Iterable[str], **fields: Any) -> Scene:
    """Return the scene of a file's meshes by `framing.framed`, of which `fields` are further arguments; warn of features
    that are not rendered, which `Scene.ignored` lists, and of texture coordinates that are not finite."""
    owner, scene = shown(path), framing.framed(meshes, name_of(path), options.resolution, up=options.up, **fields)
    textured = (mesh.uvs for mesh in meshes if mesh.uvs is not None and mesh.material.texture is not None)
    if not all(np.isfinite(uvs).all() for uvs in textured):
        warnings.warn(f"{owner}: texture coordinates that are not finite count as 0", stacklevel=2)
    names = tuple(dict.fromkeys(ignored))
    if not names:
        return scene
    line = f"{owner}: not rendered: {', '.join(names)}"
    warnings.warn(line if line.isprintable() else ascii(line), stacklevel=2)
    return replace(scene, ignored=names)


class Images:
    """The images of a scene file, each decoded once. One that cannot be had is left out, with a warning: a texture never
    costs the picture.

    scene: path of the scene file. At most MAX_PIXELS pixels are decoded in all, those of damaged images too.
    """

    def __init__(self, scene: Path) -> None:
        self.scene, self._left, self._missing = scene, MAX_PIXELS, 0
        self._images: dict[tuple[str, bool], CodedImage | None] = {}
        self._paths: dict[tuple[str, str | None], str | None] = {}
        self._names: dict[str, dict[str, str]] = {}

    def has(self, reference: str, owner: str, field: str) -> bool:
        """Return whether `beside` finds a file."""
        with contextlib.suppress(InputError):
            return beside(self.scene, reference, owner, field) is not None
        return False

    def find(
        self, reference: str, owner: str, field: str, folder: str | None = None, *, optional: bool = False
    ) -> str | None:
        """Return the path of a file as `beside` does, or else, with a warning, of the file of that name beside the scene:
        exporters write the paths of the machine they ran on, and Windows takes either case. None, with a warning unless
        it is optional, if there is neither. A reference is sought, and warned of, once."""
        key = reference, folder
        if key not in self._paths:
            path = self._search(reference, owner, field, folder, optional)
            if path is None and optional:
                return None
            self._paths[key] = path
        return self._paths[key]

    def _search(self, reference: str, owner: str, field: str, folder: str | None, optional: bool) -> str | None:
        root = os.path.dirname(os.fspath(self.scene)) or "."
        name = re.split(r"[\\/:]", reference)[-1].strip("\"'")
        tried = [(reference, folder or root), (name, folder or root), (name, root)]
        problem = f"{owner}: {field}: there is no file {quoted(reference)}"
        try:
            path = beside(self.scene, reference, owner, field, folder)
            if path is not None:
                return path
        except InputError as error:
            problem, tried = str(error), tried[1:]
        self._missing += 1
        if self._missing == MAX_MISSING:
            warnings.warn(f"{problem}: drawn without it, and without more of such files", stacklevel=2)
        if self._missing >= MAX_MISSING:
            return None
        for other, place in tried:
            with contextlib.suppress(InputError):
                spelled = self._spelled(other, place)
                path = beside(self.scene, spelled, owner, field, place)
                if path is not None:
                    warnings.warn(f"{problem}: {quoted(spelled)} is read", stacklevel=2)
                    return path
        if not optional:
            warnings.warn(f"{problem}: drawn without it", stacklevel=2)
        return None

    def _spelled(self, reference: str, folder: str) -> str:
        """Return a relative path in the upper and lower case of the files that are there."""
        parts: list[str] = []
        top = os.path.realpath(os.path.dirname(os.fspath(self.scene)) or ".")
        for part in reference.replace("\\", "/").split("/"):
            if part in ("", "."):
                continue
            place = os.path.join(folder, *parts)
            if place not in self._names and os.path.commonpath([os.path.realpath(place), top]) == top:
                with contextlib.suppress(OSError):
                    names = sorted(os.listdir(place))
                    self._names[place] = {name.casefold(): name for name in names} | {name: name for name in names}
            there = self._names.get(place, {})
            spelled = there.get(part) or there.get(part.casefold())
            if spelled is None:
                return reference
            parts.append(spelled)
        return "/".join(parts)

    def texture(self, path: str, wrap: Wrap = "repeat") -> Texture | None:
        """Return the texture of the image in a file, without its alpha, see `decoded`."""
        image = self.at(path, srgb=True)
        if image is not None and image.shape[2] == 4:
            warnings.warn(f"{shown(path)}: image: its alpha channel is left out", stacklevel=2)
        return None if image is None else Texture(image[:, :, :3], wrap=wrap, name=os.path.basename(path))

    def at(self, path: str, *, srgb: bool) -> CodedImage | None:
        """Return the image in a file, see `decoded`."""
        return self.decoded(shown(path), lambda: read_file(path, MAX_BYTES), srgb=srgb)

    def decoded(self, owner: str, read: Callable[[], bytes | memoryview | None], *, srgb: bool) -> CodedImage | None:
        """Return an image as `decode_image` does; None, with a warning, if it cannot be read or decoded.

        owner: its name. read: returns its content, or None if it has already warned of it.
        """
        if (owner, srgb) not in self._images:
            data: bytes | memoryview = b""
            image = None
            try:
                self._count(0)
                data = read() or b""
                image = decode_image(data, owner, srgb=srgb, count=self._count) if data else None
            except InputError as error:
                self._left -= len(data) // _BYTES
                warnings.warn(f"{error}: drawn without it", stacklevel=2)
            self._images[owner, srgb] = image
        return self._images[owner, srgb]

    def _count(self, pixels: int) -> None:
        self._left -= pixels
        if self._left < 0:
            raise file_error(shown(self.scene), "images", f"at most {MAX_PIXELS} pixels in all", "more")


def as_texture(source: Path | ArrayLike | Texture, *, srgb: bool, lookup: Lookup = "standard") -> Texture:
    """Return a Texture from an image file's path, an array (see `Texture`: taken as linear) or a Texture (as it is)."""
    if isinstance(source, Texture):
        return source
    if isinstance(source, (str, os.PathLike)):
        return Texture(read_image(source, srgb=srgb), lookup=lookup, name=os.path.basename(os.fspath(source)))
    return Texture(source, lookup=lookup)
