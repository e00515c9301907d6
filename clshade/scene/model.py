"""The scene model: frozen dataclasses, checked on construction, independent of the renderer.

Arrays are copied only when their type or layout has to change, and are read-only afterwards. Every refused value raises
`clshade.errors.InputError` naming the class, the field, what was expected and what was found.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..base import display
from ..base.arrays import Converted, Faces, Floats, Floats32, Reals, Vector, kept
from ..base.validation import (
    choice,
    coefficient,
    flag,
    floats,
    indices,
    number,
    rows,
    sequence,
    set_fields,
    text,
    value_error,
    vector,
)
from .camera import Camera
from .edges import Edges as Edges
from .scalars import Scalars as Scalars
from .scalars import checked_scalars
from .settings import LAYERS as LAYERS
from .settings import MAX_SAMPLES as MAX_SAMPLES
from .settings import PRECISIONS as PRECISIONS
from .settings import PRESETS as PRESETS
from .settings import Preset
from .settings import Settings as Settings

MAX_FACES = 1 << 24  # the host's sort key has 24 bits for the index of a face

Wrap: TypeAlias = Literal["repeat", "clamp", "mirror"]
Lookup: TypeAlias = Literal["standard", "course"]
Sides: TypeAlias = Literal["both", "front"]
Nonfinite: TypeAlias = Literal["refuse", "drop"]

WRAPS: tuple[Wrap, ...] = get_args(Wrap)
LOOKUPS: tuple[Lookup, ...] = get_args(Lookup)
SIDES: tuple[Sides, ...] = get_args(Sides)
NONFINITE: tuple[Nonfinite, ...] = get_args(Nonfinite)


def _ones() -> Any:
    return np.ones(3)


def _zeros() -> Any:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class PointLight:
    """A point light without attenuation.

    Attributes
    ----------
    position : array_like, (3,)
        World space.
    intensity : array_like, (3,), default (1, 1, 1)
        Linear RGB, any values that float32 holds.

    Raises
    ------
    InputError
        A value is not finite, or beyond float32.

    Notes
    -----
    Both are kept as read-only (3,) float64 arrays.
    """

    position: Floats
    intensity: Vector = field(default_factory=_ones)

    if TYPE_CHECKING:  # here and below: the accepted types; the fields have those that are kept

        def __init__(self, position: ArrayLike, intensity: ArrayLike = ...) -> None: ...

    def __post_init__(self) -> None:
        set_fields(
            self,
            position=vector("PointLight", "position", self.position),
            intensity=vector("PointLight", "intensity", self.intensity),
        )
        if (np.abs(self.intensity) > float(np.finfo(np.float32).max)).any():
            raise value_error("PointLight", "intensity", "numbers within float32", self.intensity.tolist())


@dataclass(frozen=True, eq=False)
class Texture:
    """An image for texture mapping.

    Attributes
    ----------
    image : array_like, (h, w, 3) or (h, w, 4)
        Linear RGB, or RGBA; row 0 is v = 0, column 0 is u = 0; h and w from 1 to 32768. Floats are
        used as they are, integers are divided by their type's maximum. Kept as float32.
    wrap : {"repeat", "clamp", "mirror"} or a pair of these
        Wrap mode, or one each for u and v; used by the standard lookup. Kept as a pair.
    lookup : {"standard", "course"}
        `standard`: the center of texel (i, j) is at ((i+0.5)/w, (j+0.5)/h), and the texel
        multiplies the vertex color. `course`: u maps to u*(w-1), and v likewise, both clamped to
        [0, 1], and the texel replaces the vertex color.
    name : str, default ""
        Name of the texture.

    Raises
    ------
    InputError
        A value is not allowed; the message names the field.
    """

    image: Floats32
    wrap: Converted[Wrap | Iterable[Wrap], tuple[Wrap, Wrap]] = field(default=kept("repeat"))
    lookup: Lookup = "standard"
    name: str = ""

    if TYPE_CHECKING:

        def __init__(
            self, image: ArrayLike, wrap: Wrap | Iterable[Wrap] = "repeat", lookup: Lookup = "standard", name: str = ""
        ) -> None: ...

    def __post_init__(self) -> None:
        image = floats("Texture", "image", self.image, "an array of shape (h, w, 3) or (h, w, 4)")
        if image.ndim != 3 or image.shape[2] not in (3, 4) or 0 in image.shape or max(image.shape) > 32768:
            raise value_error("Texture", "image", "an array of shape (h, w, 3|4) with h and w from 1 to 32768", image)
        if image.dtype.kind in "iu":
            image = image.astype(np.float64) / np.iinfo(image.dtype).max
        image = np.ascontiguousarray(image, dtype=np.float32).view()
        if not np.isfinite(image).all():
            raise value_error("Texture", "image", "finite numbers", "NaN, infinity or a value beyond float32")
        image.flags.writeable = False
        wraps = (self.wrap, self.wrap) if isinstance(self.wrap, str) else sequence(self.wrap)
        if wraps is None or len(wraps) != 2:
            raise value_error("Texture", "wrap", "one name or two, for u and v", self.wrap)
        set_fields(self, image=image, wrap=tuple(choice("Texture", "wrap", wrap, WRAPS) for wrap in wraps))
        choice("Texture", "lookup", self.lookup, LOOKUPS)
        text("Texture", "name", self.name)

    def __repr__(self) -> str:
        rows, columns, channels = self.image.shape
        return f"<Texture {self.name or 'unnamed'}: {columns}x{rows}, {channels} channels>"


@dataclass(frozen=True, eq=False)
class Material:
    """Coefficients of the Phong reflection model, and how a surface is drawn.

    Attributes
    ----------
    ka, kd, ks : float or array_like, default 0.1, 0.8 and 0.5
        Ambient, diffuse and specular coefficient. Kept as (3,) float64.
    n : float, default 20
        Specular exponent, 0 to 1e9.
    texture : Texture or None, default None
        Texture of the surface.
    name : str, default ""
        Name of the material.
    color : float or array_like, default 1
        Factor of vertex color and texel, linear RGB. Kept as (3,) float64.
    sides : {"both", "front"}
        Draw triangles seen from either side, or only those seen from the front (counter-clockwise).
    two_sided : bool, default False
        Light back faces with their normals reversed.
    alpha_cutoff : float or None, default None
        Discard pixels whose texture alpha is below this value (alpha test); None: ignore alpha.

    Raises
    ------
    InputError
        A value is not allowed; the message names the field.
    """

    ka: Vector = field(default=kept(0.1))
    kd: Vector = field(default=kept(0.8))
    ks: Vector = field(default=kept(0.5))
    n: float = 20.0
    texture: Texture | None = None
    name: str = ""
    color: Vector = field(default=kept(1.0))
    sides: Sides = "both"
    two_sided: bool = False
    alpha_cutoff: float | None = None

    def __post_init__(self) -> None:
        exponent = number("Material", "n", self.n, least=0.0, expected="a number from 0 to 1e9")
        if exponent > 1e9:
            raise value_error("Material", "n", "a number from 0 to 1e9", self.n)
        if self.texture is not None and not isinstance(self.texture, Texture):
            raise value_error("Material", "texture", "a Texture or None", self.texture)
        set_fields(
            self, n=exponent, **{k: coefficient("Material", k, getattr(self, k)) for k in ("ka", "kd", "ks", "color")}
        )
        choice("Material", "sides", self.sides, SIDES)
        text("Material", "name", self.name)
        set_fields(self, two_sided=flag("Material", "two_sided", self.two_sided))
        if self.alpha_cutoff is not None:
            set_fields(self, alpha_cutoff=number("Material", "alpha_cutoff", self.alpha_cutoff))


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with one material, placed any number of times.

    Attributes
    ----------
    verts : array_like, (V, 3)
        Positions, object space, float32 or float64 (kept as given).
    faces : array_like, (F, 3)
        Indices into verts.
    colors : array_like, (V, 3) or None, default None
        Linear RGB per vertex; None: white. Unsigned integers are divided by their type's maximum,
        as those of a Texture; other numbers are used as they are.
    normals : array_like, (K, 3) or None, default None
        Directions of any length; None: computed from the faces (`geometry.vertex_normals`).
    normal_faces : array_like, (F, 3) or None, default None
        Indices into normals; None: `faces`.
    uvs : array_like, (T, 2) or None, default None
        Texture coordinates; v = 0 is row 0 of the texture's image. NaN and infinity count as 0,
        magnitudes beyond 2^40 as 2^40.
    uv_faces : array_like, (F, 3) or None, default None
        Indices into uvs; None: `faces`.
    material : Material, default Material()
        Material of all triangles.
    instances : array_like, (K, 4, 4) or None, default None
        Affine placements, object to world, for column vectors; None: one identity.
    name : str, default ""
        Name of the mesh.
    nonfinite : {"refuse", "drop"}
        With vertices that are NaN or infinite, refuse the mesh, or drop the triangles that use
        them. A dropped face keeps its number and draws nothing; its neighbors are as they would be
        without it.
    dropped : int, default 0
        Number of faces dropped; counted here, and kept in copies of the mesh.
    scalars : mapping of str to array_like or None, default None
        Data by name, any numbers: (V,) per vertex, (F,) per face, or (F, 3) per corner of each
        face; with as many vertices as faces (V,) is per vertex. NaN: no data; infinity counts as
        NaN. Kept as a dict of float32 or float64. `Settings.scalars` shows them by a color map.

    Raises
    ------
    InputError
        An array has another shape, an index is out of range, or a value is not allowed; the message
        names the mesh and the field.
    """

    verts: Reals
    faces: Faces
    colors: Converted[ArrayLike | None, Reals | None] = field(default=kept(None))
    normals: Converted[ArrayLike | None, Reals | None] = field(default=kept(None))
    normal_faces: Converted[ArrayLike | None, Faces | None] = field(default=kept(None))
    uvs: Converted[ArrayLike | None, Reals | None] = field(default=kept(None))
    uv_faces: Converted[ArrayLike | None, Faces | None] = field(default=kept(None))
    material: Material = field(default_factory=Material)
    instances: Converted[ArrayLike | None, Floats] = field(default=kept(None))
    name: str = ""
    nonfinite: Nonfinite = "refuse"
    dropped: int = 0
    scalars: Converted[Mapping[str, ArrayLike] | None, dict[str, Reals]] = field(default=kept(None))

    if TYPE_CHECKING:

        def __init__(
            self,
            verts: ArrayLike,
            faces: ArrayLike,
            colors: ArrayLike | None = None,
            normals: ArrayLike | None = None,
            normal_faces: ArrayLike | None = None,
            uvs: ArrayLike | None = None,
            uv_faces: ArrayLike | None = None,
            material: Material = ...,
            instances: ArrayLike | None = None,
            name: str = "",
            nonfinite: Nonfinite = "refuse",
            dropped: int = 0,
            scalars: Mapping[str, ArrayLike] | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        who = f"Mesh {self.name!r}" if text("Mesh", "name", self.name) else "Mesh"
        drop = choice(who, "nonfinite", self.nonfinite, NONFINITE) == "drop"
        verts = rows(who, "verts", self.verts, 3, finite=not drop)
        faces = indices(who, "faces", self.faces, len(verts))
        if drop:
            verts, faces, dropped = _without_nonfinite(verts, faces)
            set_fields(self, dropped=self.dropped + dropped)
        colors = None if self.colors is None else _vertex_colors(who, self.colors, len(verts))
        normals = None if self.normals is None else rows(who, "normals", self.normals, 3)
        uvs = None if self.uvs is None else rows(who, "uvs", self.uvs, 2, finite=False)
        set_fields(self, verts=verts, faces=faces, colors=colors, normals=normals, uvs=uvs)
        for name, attribute in (("normal", normals), ("uv", uvs)):
            given = getattr(self, f"{name}_faces")
            if given is None:
                if attribute is not None and len(attribute) < len(verts):
                    raise value_error(who, f"{name}s", f"one row per vertex ({len(verts)}), or {name}_faces", attribute)
                continue
            if attribute is None:
                raise value_error(who, f"{name}_faces", f"None without {name}s", given)
            given = indices(who, f"{name}_faces", given, len(attribute))
            if given.shape != faces.shape:
                raise value_error(who, f"{name}_faces", f"the shape of faces {faces.shape}", given)
            set_fields(self, **{f"{name}_faces": given})
        set_fields(self, scalars=checked_scalars(who, self.scalars, len(verts), len(faces)))
        if not isinstance(self.material, Material):
            raise value_error(who, "material", "a Material", self.material)
        form = "an array of shape (K, 4, 4)"
        placements = np.eye(4)[None] if self.instances is None else floats(who, "instances", self.instances, form)
        if placements.ndim != 3 or placements.shape[1:] != (4, 4) or placements.dtype.kind == "b":
            raise value_error(who, "instances", form, self.instances)
        placements = placements.astype(np.float64)
        if not np.isfinite(placements).all() or (placements[:, 3] != [0.0, 0.0, 0.0, 1.0]).any():
            raise value_error(who, "instances", "finite affine matrices with last row 0 0 0 1", self.instances)
        placements.flags.writeable = False
        set_fields(self, instances=placements)

    def __repr__(self) -> str:
        counts = _count(len(self.faces), "triangle"), _count(len(self.verts), "vertex", "vertices")
        scalars = f", scalars {', '.join(self.scalars)}" if self.scalars else ""
        placed = _count(len(np.asarray(self.instances)), "instance")
        return f"<Mesh {self.name or 'unnamed'}: {', '.join(counts)}, {placed}{scalars}>"


def _vertex_colors(who: str, given: Any, count: int) -> Reals:
    array = floats(who, "colors", given, "an array of shape (K, 3) of finite numbers")
    if array.dtype.kind == "u":
        array = array / np.iinfo(array.dtype).max
    colors = rows(who, "colors", array, 3)
    if len(colors) != count:
        raise value_error(who, "colors", f"one row per vertex ({count})", colors)
    return colors


def _count(number: int, singular: str, plural: str = "") -> str:
    return f"{number:,} {singular if number == 1 else plural or singular + 's'}"


def _without_nonfinite(verts: Reals, faces: Faces) -> tuple[Reals, Faces, int]:
    """Return finite vertices, faces, and the number of faces that used another vertex.

    Those faces shrink to a point at a vertex that other faces use, so that they affect neither normals nor the bounding
    box.
    """
    bad = np.asarray(~np.isfinite(verts).all(axis=1))
    if not bad.any():
        return verts, faces, 0
    lost = bad[faces].any(axis=1)
    kept = faces[~lost]
    anchor = kept[0, 0] if len(kept) else np.flatnonzero(~bad)[0] if not bad.all() else 0
    verts, faces = verts.copy(), faces.copy()
    verts[bad] = 0.0 if bad.all() else verts[anchor]
    faces[lost] = anchor
    verts.flags.writeable = faces.flags.writeable = False
    return verts, faces, int(lost.sum())


@dataclass(frozen=True, eq=False)
class Scene:
    """Meshes, lit by lights and seen by a camera.

    Attributes
    ----------
    meshes : Mesh or iterable of Mesh
        At most 2^24 triangles in all, counting instances. Kept as a tuple.
    camera : Camera
        Camera and resolution.
    lights : PointLight or iterable of PointLight, default ()
        Point lights. Kept as a tuple.
    ambient : float or array_like, default 1
        Intensity Ia of the ambient light, linear RGB.
    background : float, array_like or None, default 0
        Linear RGB; None: RGB is premultiplied, over nothing.
    preset : {"standard", "course"}
        Settings that a render of this scene starts from.
    name : str, default ""
        Name of the scene.
    ignored : tuple of str, default ()
        Features of the scene's file that are not rendered, a few words each.

    Raises
    ------
    InputError
        A value is not allowed; the message names the field.
    """

    meshes: tuple[Mesh, ...]
    camera: Camera
    lights: Converted[PointLight | Iterable[PointLight], tuple[PointLight, ...]] = field(default=kept(()))
    ambient: Vector = field(default_factory=_ones)
    background: Converted[ArrayLike | None, Floats | None] = field(default_factory=_zeros)
    preset: Preset = "standard"
    name: str = ""
    ignored: tuple[str, ...] = ()

    if TYPE_CHECKING:

        def __init__(
            self,
            meshes: Mesh | Iterable[Mesh],
            camera: Camera,
            lights: PointLight | Iterable[PointLight] = (),
            ambient: ArrayLike = ...,
            background: ArrayLike | None = ...,
            preset: Preset = "standard",
            name: str = "",
            ignored: tuple[str, ...] = (),
        ) -> None: ...

    def __post_init__(self) -> None:
        for name, kind in (("meshes", Mesh), ("lights", PointLight)):
            value = getattr(self, name)
            items = (value,) if isinstance(value, kind) else sequence(value)
            if items is None:
                raise value_error("Scene", name, f"a sequence of {kind.__name__}", value)
            for item in items:
                if not isinstance(item, kind):
                    raise value_error("Scene", name, f"a sequence of {kind.__name__}", item)
            set_fields(self, **{name: items})
        if not isinstance(self.camera, Camera):
            raise value_error("Scene", "camera", "a Camera", self.camera)
        if self.face_count > MAX_FACES:
            raise value_error("Scene", "meshes", f"at most {MAX_FACES} triangles with instances", self.face_count)
        set_fields(
            self,
            ambient=coefficient("Scene", "ambient", self.ambient),
            background=None if self.background is None else coefficient("Scene", "background", self.background),
        )
        choice("Scene", "preset", self.preset, PRESETS)
        text("Scene", "name", self.name)

    @property
    def face_count(self) -> int:
        """Number of triangles, counting instances."""
        return sum(len(mesh.faces) * len(np.asarray(mesh.instances)) for mesh in self.meshes)

    @property
    def nonfinite(self) -> int:
        """Number of triangles dropped for a vertex that is NaN or infinite, counting instances."""
        return sum(mesh.dropped * len(np.asarray(mesh.instances)) for mesh in self.meshes)

    def __repr__(self) -> str:
        columns, rows = self.camera.resolution
        counts = _count(len(self.meshes), "mesh", "meshes"), _count(len(self.lights), "light")
        what = ", ".join((_count(self.face_count, "triangle"), *counts, f"{columns}x{rows}", f"preset {self.preset}"))
        return f"<Scene {self.name or 'unnamed'}: {what}>"

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        """Return the text and a small image, for notebooks."""
        bundle: dict[str, Any] = display.notebook().scene_bundle(self)
        return bundle


def default_tonemap(scene: Scene) -> Literal["none", "srgb"]:
    """Return `none` for course scenes, `srgb` otherwise."""
    return "none" if scene.preset == "course" else "srgb"
