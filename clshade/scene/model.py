"""The scene model: frozen dataclasses, checked on construction, that know nothing of the renderer.

Arrays are copied only when their type or layout has to change, and are then read-only. Every refused value raises
`clshade.errors.InputError` naming the class, the field, what was expected and what was found.
"""

from __future__ import annotations

from collections.abc import Iterable
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
from .settings import LAYERS as LAYERS
from .settings import MAX_SAMPLES as MAX_SAMPLES
from .settings import PRECISIONS as PRECISIONS
from .settings import PRESETS as PRESETS
from .settings import Preset
from .settings import Settings as Settings

MAX_FACES = 1 << 24  # a face's index has 24 bits in the host's sort key

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
    """A point light without attenuation. position: world space. intensity: linear RGB, any values that float32 holds."""

    position: Floats
    intensity: Vector = field(default_factory=_ones)

    if TYPE_CHECKING:  # here and below: what it may be given; the fields say what is kept of it

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
    """An image to look colors up in.

    image: (h, w, 3) or, with alpha, (h, w, 4), linear RGB, row 0 is v = 0, column 0 is u = 0. Floats are used as they
        are, integers are divided by their type's maximum. Kept as float32.
    wrap: repeat, clamp or mirror, or a pair of them for u and v; used by the standard lookup. Kept as a pair.
    lookup: `standard` has the center of texel (i, j) at ((i+0.5)/w, (j+0.5)/h), and the texel multiplies the vertex
        color; `course` maps u to u*(w-1), holds u and v to [0, 1], and the texel replaces the vertex color.
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
    """Phong's coefficients of a surface.

    ka, kd, ks: ambient, diffuse and specular coefficient; a scalar or a 3-vector, kept as (3,) float64.
    n: specular exponent, 0 to 1e9.
    texture: a Texture, or None.
    color: 3-vector that multiplies vertex color and texel; linear RGB.
    sides: `both` draws triangles seen from either side, `front` only those seen from the front (counter-clockwise).
    two_sided: light a surface seen from behind with its normal turned round.
    alpha_cutoff: pixels whose texture alpha is below it are left out (alpha test); None: alpha is not looked at.
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

    verts: (V, 3) positions, object space, float32 or float64 (kept as given).
    faces: (F, 3) indices into verts.
    colors: (V, 3) linear RGB per vertex, or None for white. Unsigned integers are divided by their type's maximum, as
        a Texture's are; other numbers are used as they are.
    normals: (K, 3) directions of any length, or None to compute them from the faces (`geometry.vertex_normals`).
    normal_faces: (F, 3) indices into normals, or None for `faces`.
    uvs: (T, 2) texture coordinates, v = 0 at row 0 of the texture's image, or None. What is NaN or infinite counts as 0,
        what is beyond 2^40 as that.
    uv_faces: (F, 3) indices into uvs, or None for `faces`.
    instances: (K, 4, 4) affine placements, object to world, column vectors; default one identity.
    nonfinite: what a vertex that is NaN or infinite means: `refuse` the mesh, or `drop` the triangles that use it. A
        dropped face keeps its number and draws nothing; its neighbors are as they would be without it.
    dropped: how many faces were dropped; counted here, and kept when a mesh is made from this one.
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
        return f"<Mesh {self.name or 'unnamed'}: {', '.join(counts)}, {_count(len(np.asarray(self.instances)), 'instance')}>"


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
    """Finite vertices, faces, and the number of faces that used another vertex. Those shrink to a point at a vertex that
    other faces use, so that neither normals nor the bounding box show them."""
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
    """What is drawn: meshes, seen by a camera, lit by lights.

    ambient: 3-vector, intensity Ia of the ambient light.
    background: 3-vector, linear RGB, or None (RGB premultiplied over nothing).
    preset: `course` or `standard`, the settings a render of this scene starts from.
    ignored: what the scene's file asked for and no render will show, a few words each.
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
        """Number of triangles, instances counted."""
        return sum(len(mesh.faces) * len(np.asarray(mesh.instances)) for mesh in self.meshes)

    @property
    def nonfinite(self) -> int:
        """Number of triangles dropped for a vertex that is NaN or infinite, instances counted."""
        return sum(mesh.dropped * len(np.asarray(mesh.instances)) for mesh in self.meshes)

    def __repr__(self) -> str:
        columns, rows = self.camera.resolution
        counts = _count(len(self.meshes), "mesh", "meshes"), _count(len(self.lights), "light")
        what = ", ".join((_count(self.face_count, "triangle"), *counts, f"{columns}x{rows}", f"preset {self.preset}"))
        return f"<Scene {self.name or 'unnamed'}: {what}>"

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        """For notebooks: a line of text, and the scene drawn small."""
        bundle: dict[str, Any] = display.notebook().scene_bundle(self)
        return bundle


def default_tonemap(scene: Scene) -> Literal["none", "srgb"]:
    """`none` for course scenes, `srgb` otherwise."""
    return "none" if scene.preset == "course" else "srgb"
