"""The scene model: frozen dataclasses, checked on construction, independent of the renderer.

Arrays are copied only when their type or layout has to change, and are read-only afterwards. Every refused value raises
`clshade.errors.InputError` naming the class, the field, what was expected and what was found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, wraps
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar, get_args, overload

import numpy as np
from numpy.typing import ArrayLike

from ..base import exchange
from ..base.arrays import Converted, Faces, Floats, Reals, Vector, kept
from ..base.atomic_files import Path
from ..base.validation import (
    choice,
    coefficient,
    flag,
    floats,
    indices,
    integer,
    number,
    rows,
    sequence,
    set_fields,
    text,
    value_error,
)
from ..errors import InputError
from .camera import Camera
from .edges import Edges as Edges
from .environment import Environment as Environment
from .lights import LIGHTS
from .lights import DirectionalLight as DirectionalLight
from .lights import Light as Light
from .lights import PointLight as PointLight
from .lights import RectangleLight as RectangleLight
from .lights import SpotLight as SpotLight
from .material import SIDES as SIDES
from .material import Material as Material
from .material import Sides as Sides
from .metallic_roughness import LEAST_ROUGHNESS as LEAST_ROUGHNESS
from .metallic_roughness import MetallicRoughness as MetallicRoughness
from .scalars import Scalars as Scalars
from .scalars import checked_scalars
from .settings import MAX_SAMPLES as MAX_SAMPLES
from .settings import PRECISIONS as PRECISIONS
from .settings import PRESETS as PRESETS
from .settings import Preset
from .settings import Settings as Settings
from .texture import FILTERS as FILTERS
from .texture import LOOKUPS as LOOKUPS
from .texture import WRAPS as WRAPS
from .texture import Filter as Filter
from .texture import Lookup as Lookup
from .texture import Texture as Texture
from .texture import Wrap as Wrap

MAX_FACES = 1 << 29  # kernels count the three corners of each in an int32

Nonfinite: TypeAlias = Literal["refuse", "drop"]

NONFINITE: tuple[Nonfinite, ...] = get_args(Nonfinite)


def _ones() -> Any:
    return np.ones(3)


def _zeros() -> Any:
    return np.zeros(3)


def _taking_vertices(cls: type[Mesh]) -> type[Mesh]:
    """Let the constructor take `vertices` as another name of `verts`."""
    init = cls.__init__

    @wraps(init)
    def init_by_either_name(self: Mesh, *args: Any, **fields: Any) -> None:
        if "vertices" in fields:
            if args or "verts" in fields:
                raise InputError("Mesh: vertices: cannot go with verts, which is the same")
            fields["verts"] = fields.pop("vertices")
        init(self, *args, **fields)

    cls.__init__ = init_by_either_name  # type: ignore[method-assign]
    return cls


@_taking_vertices
@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with one material, placed any number of times.

    Attributes
    ----------
    verts : array_like, (V, 3)
        Positions, object space, float32 or float64 (kept as given). `vertices` is another name of it.
    faces : array_like, (F, 3)
        Indices into verts.
    colors : array_like, (V, 3) or (V, 4), or None, default None
        Linear RGB per vertex; None: white. Unsigned integers are divided by their type's maximum,
        as those of a Texture; other numbers are used as they are. Kept as (V, 3); a fourth column
        becomes `alphas`.
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
    tangents : array_like, (K, 4) or None, default None
        Directions of any length along which u grows in normal maps, and the sign w of the bitangent
        w * cross(normal, tangent), along which v falls; None: computed as MikkTSpace does.
    tangent_faces : array_like, (F, 3) or None, default None
        Indices into tangents; None: `faces`.
    more_uvs : iterable of array_like, each of the shape of uvs, default ()
        Further texture coordinates, which a Texture names by `coordinates`. Kept as a tuple.
    alphas : array_like, (V,) or None, default None
        Alpha per vertex; None: 1. Unsigned integers are divided by their type's maximum; numbers
        beyond [0, 1] are clamped.
    instance_names : iterable of str, default ()
        Name of each instance, "" for one without; (): none has one. Kept as a tuple.
    part_of : str, default ""
        Meshes of a scene with one text here are parts of one object, each of a material of its own:
        instance k of each is a part of instance k of the object. "": the mesh is an object.
    """

    verts: Reals
    faces: Faces
    colors: Converted[ArrayLike | None, Reals | None] = field(default=kept(None))
    normals: Converted[ArrayLike | None, Reals | None] = field(default=kept(None))
    normal_faces: Converted[ArrayLike | None, Faces | None] = field(default=kept(None))
    uvs: Converted[ArrayLike | None, Reals | None] = field(default=kept(None))
    uv_faces: Converted[ArrayLike | None, Faces | None] = field(default=kept(None))
    material: Material = field(default_factory=cache(Material))
    instances: Converted[ArrayLike | None, Floats] = field(default=kept(None))
    name: str = ""
    nonfinite: Nonfinite = "refuse"
    dropped: int = 0
    scalars: Converted[Mapping[str, ArrayLike] | None, dict[str, Reals]] = field(default=kept(None))
    tangents: Converted[ArrayLike | None, Reals | None] = field(default=kept(None))
    tangent_faces: Converted[ArrayLike | None, Faces | None] = field(default=kept(None))
    more_uvs: Converted[Iterable[ArrayLike], tuple[Reals, ...]] = field(default=kept(()))
    alphas: Converted[ArrayLike | None, Reals | None] = field(default=kept(None))
    instance_names: Converted[Iterable[str], tuple[str, ...]] = field(default=kept(()))
    part_of: str = ""

    if TYPE_CHECKING:

        @overload
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
            tangents: ArrayLike | None = None,
            tangent_faces: ArrayLike | None = None,
            more_uvs: Iterable[ArrayLike] = (),
            alphas: ArrayLike | None = None,
            instance_names: Iterable[str] = (),
            part_of: str = "",
        ) -> None: ...

        @overload
        def __init__(
            self,
            *,
            vertices: ArrayLike,
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
            tangents: ArrayLike | None = None,
            tangent_faces: ArrayLike | None = None,
            more_uvs: Iterable[ArrayLike] = (),
            alphas: ArrayLike | None = None,
            instance_names: Iterable[str] = (),
            part_of: str = "",
        ) -> None: ...

        def __init__(self, *args: Any, **fields: Any) -> None: ...

    def __post_init__(self) -> None:
        who = f"Mesh {self.name!r}" if text("Mesh", "name", self.name) else "Mesh"
        drop = choice(who, "nonfinite", self.nonfinite, NONFINITE) == "drop"
        set_fields(self, dropped=integer(who, "dropped", self.dropped, 0, 1 << 53))
        verts = rows(who, "verts", self.verts, 3, finite=not drop)
        faces = indices(who, "faces", self.faces, len(verts))
        if drop:
            verts, faces, dropped = _without_nonfinite(verts, faces)
            set_fields(self, dropped=self.dropped + dropped)
        colors, alphas = (None, None) if self.colors is None else _vertex_colors(who, self.colors, len(verts))
        alphas = self.alphas if alphas is None else alphas
        set_fields(self, alphas=None if alphas is None else _vertex_alphas(who, alphas, len(verts)))
        normals = None if self.normals is None else rows(who, "normals", self.normals, 3)
        uvs = None if self.uvs is None else rows(who, "uvs", self.uvs, 2, finite=False)
        tangents = None if self.tangents is None else rows(who, "tangents", self.tangents, 4)
        set_fields(self, verts=verts, faces=faces, colors=colors, normals=normals, uvs=uvs, tangents=tangents)
        set_fields(self, more_uvs=_more_uvs(who, self.more_uvs, uvs))
        for name, attribute in (("normal", normals), ("uv", uvs), ("tangent", tangents)):
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
        placements = _IDENTITY if self.instances is None else _placements(who, self.instances)
        names = _texts(who, "instance_names", self.instance_names)
        if names and len(names) != len(placements):
            expected = f"one text per instance ({len(placements)}), or none"
            raise value_error(who, "instance_names", expected, len(names))
        set_fields(self, instances=placements, instance_names=names, part_of=text(who, "part_of", self.part_of))

    @property
    def vertices(self) -> Reals:
        """Another name of `verts`, which the constructor takes too."""
        return self.verts

    @property
    def has_alpha(self) -> bool:
        """Whether something may make it less than opaque: material, texture or vertices."""
        material, texture = self.material, self.material.texture
        of_texture = texture is not None and self.uvs is not None and texture.texels.shape[2] == 4
        return material.opacity < 1.0 or of_texture or self.alphas is not None

    @property
    def blends(self) -> bool:
        """Whether it is composited by its alpha."""
        return self.material.blend and self.has_alpha

    @property
    def tests_alpha(self) -> bool:
        """Whether some of its pixels may be discarded by their alpha."""
        cutoff = self.material.alpha_cutoff
        return cutoff is not None and cutoff > 0.0 and (self.has_alpha or cutoff > 1.0)

    def __repr__(self) -> str:
        counts = _count(len(self.faces), "triangle"), _count(len(self.verts), "vertex", "vertices")
        scalars = f", scalars {', '.join(self.scalars)}" if self.scalars else ""
        placed = _count(len(np.asarray(self.instances)), "instance")
        return f"<Mesh {self.name or 'unnamed'}: {', '.join(counts)}, {placed}{scalars}>"


def _placements(who: str, given: Any) -> Floats:
    form = "an array of shape (K, 4, 4)"
    placements = floats(who, "instances", given, form)
    if placements.ndim != 3 or placements.shape[1:] != (4, 4) or placements.dtype.kind == "b":
        raise value_error(who, "instances", form, given)
    placements = placements.astype(np.float64)
    if not np.isfinite(placements).all() or (placements[:, 3] != [0.0, 0.0, 0.0, 1.0]).any():
        raise value_error(who, "instances", "finite affine matrices with last row 0 0 0 1", given)
    placements.flags.writeable = False
    return placements


_IDENTITY = _placements("Mesh", np.eye(4)[None])


def _vertex_colors(who: str, given: Any, count: int) -> tuple[Reals, Reals | None]:
    """Return colors (V, 3), and the alphas (V,) if they have a fourth column."""
    array = floats(who, "colors", given, "an array of shape (K, 3) of finite numbers")
    if array.dtype.kind == "u":
        array = array / np.iinfo(array.dtype).max
    colors = rows(who, "colors", array, 4 if array.ndim == 2 and array.shape[1] == 4 else 3)
    if len(colors) != count:
        raise value_error(who, "colors", f"one row per vertex ({count})", colors)
    return (colors, None) if colors.shape[1] == 3 else (rows(who, "colors", colors[:, :3], 3), colors[:, 3])


def _vertex_alphas(who: str, given: Any, count: int) -> Reals | None:
    """Return alphas (V,) from 0 to 1; None if all are 1."""
    array = floats(who, "alphas", given, f"an array of shape ({count},) of finite numbers")
    if array.dtype.kind == "u":
        array = array / np.iinfo(array.dtype).max
    if array.shape != (count,):
        raise value_error(who, "alphas", f"one number per vertex ({count})", array)
    alphas: Reals = np.clip(rows(who, "alphas", array[:, None], 1)[:, 0], 0.0, 1.0)
    alphas.flags.writeable = False
    return alphas if (alphas < 1.0).any() else None


def _more_uvs(who: str, given: Any, uvs: Reals | None) -> tuple[Reals, ...]:
    sets = sequence(given)
    if sets is None:
        raise value_error(who, "more_uvs", "a sequence of arrays", given)
    found = tuple(rows(who, "more_uvs", each, 2, finite=False) for each in sets)
    for each in found:
        if uvs is None or each.shape != uvs.shape:
            expected = "no array without uvs" if uvs is None else f"arrays of the shape of uvs {uvs.shape}"
            raise value_error(who, "more_uvs", expected, each)
    return found


def _texts(who: str, name: str, given: Any) -> tuple[str, ...]:
    """Return a sequence of texts as a tuple; one text, whose items would be its letters, is refused."""
    items = None if isinstance(given, str) else sequence(given)
    if items is None or not all(isinstance(item, str) for item in items):
        raise value_error(who, name, "a sequence of texts", given)
    return items


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
        At most 2^29 triangles in all, counting instances. Kept as a tuple.
    camera : Camera or None, default None
        Camera and resolution; None: one of 800 x 600 that shows all meshes, as `clshade.load` gives a
        mesh without one.
    lights : light or iterable of lights, default ()
        Of any kind in `clshade.scene.lights`. Kept as a tuple.
    ambient : float or array_like, default 1
        Intensity Ia of the ambient light, linear RGB.
    background : float, array_like or None, default 0
        Linear RGB; None: RGB is premultiplied, over nothing.
    preset : {"standard", "pbr", "course"}
        Settings that a render of this scene starts from.
    name : str, default ""
        Name of the scene.
    ignored : tuple of str, default ()
        Features of the scene's file that are not rendered, a few words each.
    environment : Environment or None, default None
        Light from all around, which shader `pbr` shows.
    own_lights : bool, default True
        False: lights and ambient light only stand in for those that the scene's file lacks. Shader
        `pbr` replaces them by the environment, or by `clshade.studio()` without one.
    fitted : bool, default False
        Whether the camera was chosen to show all meshes, and is not the author's: a turntable then
        chooses one that shows all of them in every frame. True if `camera` is None.
    light_scale : float, default 1
        What the intensities of a file's lights, in candela and lux, were multiplied by when it was
        loaded. Rendering does not depend on it.
    animations : tuple of str, default ()
        Names of the animations of the scene's file, "" for one without a name; see `clshade.load`.
    """

    meshes: tuple[Mesh, ...]
    camera: Converted[Camera | None, Camera] = field(default=kept(None))
    lights: Converted[Light | Iterable[Light], tuple[Light, ...]] = field(default=kept(()))
    ambient: Vector = field(default_factory=_ones)
    background: Converted[ArrayLike | None, Floats | None] = field(default_factory=_zeros)
    preset: Preset = "standard"
    name: str = ""
    ignored: tuple[str, ...] = ()
    environment: Environment | None = None
    own_lights: bool = True
    fitted: bool = False
    light_scale: float = 1.0
    animations: tuple[str, ...] = ()

    if TYPE_CHECKING:

        def __init__(
            self,
            meshes: Mesh | Iterable[Mesh],
            camera: Camera | None = None,
            lights: Light | Iterable[Light] = (),
            ambient: ArrayLike = ...,
            background: ArrayLike | None = ...,
            preset: Preset = "standard",
            name: str = "",
            ignored: tuple[str, ...] = (),
            environment: Environment | None = None,
            own_lights: bool = True,
            fitted: bool = False,
            light_scale: float = 1.0,
            animations: tuple[str, ...] = (),
        ) -> None: ...

    def __post_init__(self) -> None:
        for name, kinds in (("meshes", (Mesh,)), ("lights", LIGHTS)):
            value = getattr(self, name)
            items = (value,) if isinstance(value, kinds) else sequence(value)
            expected = f"a sequence of {' or '.join(kind.__name__ for kind in kinds)}"
            if items is None:
                raise value_error("Scene", name, expected, value)
            for item in items:
                if not isinstance(item, kinds):
                    raise value_error("Scene", name, expected, item)
            set_fields(self, **{name: items})
        if self.face_count > MAX_FACES:
            raise value_error("Scene", "meshes", f"at most {MAX_FACES} triangles with instances", self.face_count)
        if self.camera is None:
            set_fields(self, camera=exchange.get("default_camera")(self.meshes), fitted=True)
        elif not isinstance(self.camera, Camera):
            raise value_error("Scene", "camera", "a Camera or None", self.camera)
        set_fields(
            self,
            ambient=coefficient("Scene", "ambient", self.ambient),
            background=None if self.background is None else coefficient("Scene", "background", self.background),
        )
        if self.environment is not None and not isinstance(self.environment, Environment):
            raise value_error("Scene", "environment", "an Environment or None", self.environment)
        set_fields(self, own_lights=flag("Scene", "own_lights", self.own_lights))
        set_fields(self, light_scale=number("Scene", "light_scale", self.light_scale, above=0.0))
        choice("Scene", "preset", self.preset, PRESETS)
        text("Scene", "name", self.name)
        set_fields(self, fitted=flag("Scene", "fitted", self.fitted))
        set_fields(self, **{name: _texts("Scene", name, getattr(self, name)) for name in ("ignored", "animations")})

    @property
    def face_count(self) -> int:
        """Number of triangles, counting instances."""
        return sum(len(mesh.faces) * len(np.asarray(mesh.instances)) for mesh in self.meshes)

    @property
    def nonfinite(self) -> int:
        """Number of triangles dropped for a vertex that is NaN or infinite, counting instances."""
        return sum(mesh.dropped * len(np.asarray(mesh.instances)) for mesh in self.meshes)

    @classmethod
    def from_trimesh(
        cls,
        source: Any,
        *,
        resolution: tuple[int, int] | None = None,
        crease: float | None = None,
        up: Literal["y", "z", "x", "-y", "-z", "-x"] = "y",
    ) -> Scene:
        """Create a scene from a mesh or a scene of trimesh, or a mesh of Open3D or PyVista.

        Parameters
        ----------
        source : trimesh.Trimesh, trimesh.Scene, open3d.geometry.TriangleMesh or pyvista.PolyData
            Known by its attributes. Of trimesh: vertices, faces, normals, colors of vertices or
            faces, texture coordinates, simple and PBR materials with their textures, placements
            with the names of their nodes, the camera, and as scalars vertex attributes with one
            number for each vertex. Of Open3D: vertices, triangles, normals, colors. Of PyVista:
            points, triangles, normals, the first array of points with uint8 RGB or RGBA, and as
            scalars arrays with one number for each point or cell.
        resolution : (int, int), optional
            (N, M), columns and rows, 1 to 16384 pixels each. Default: the camera's, else 800 x 600.
        crease : float, optional
            Degrees, 0 to 180: edges with a larger angle between their faces are sharp. Default: the
            normals of the source.
        up : {"x", "y", "z", "-x", "-y", "-z"}, optional
            Axis that points up in the view chosen for a source without a camera.

        Returns
        -------
        Scene
            With a camera that shows all of it and lights around it, as `clshade.load` gives a mesh;
            preset `pbr` if a material is a PBRMaterial, else `standard`. Both sides are lit.

        Raises
        ------
        InputError
            The source is of another kind, has no triangles, other polygons, or several materials on
            one mesh; or an argument is out of range.

        Warns
        -----
        UserWarning
            One line on curves and points of a trimesh.Scene, which are not rendered.

        Notes
        -----
        Colors and images of whole numbers, and colors of Open3D, are decoded from sRGB; factors of
        materials are linear. Colors with alpha below 1 blend.

        Examples
        --------
        >>> import clshade
        >>> import trimesh
        >>> clshade.Scene.from_trimesh(trimesh.creation.box(), crease=30)
        <Scene unnamed: 12 triangles, 1 mesh, 3 lights, 800x600, preset standard>
        """
        scene: Scene = exchange.get("from_trimesh")(source, resolution=resolution, crease=crease, up=up)
        return scene

    def to_glb(self, path: Path) -> None:
        """Write the scene as a binary glTF 2.0 file, which other programs read.

        Meshes keep their triangles, normals, texture coordinates, vertex colors and placements;
        scalars become attributes `_NAME`. Positions that float32 cannot hold are stored relative to
        the middle of the mesh; then its node places them.

        Parameters
        ----------
        path : str or path-like
            File, with a name that ends in .glb; an existing one is replaced.

        Raises
        ------
        InputError
            The name has another ending, the file would have 4 GiB or more, or the scene has numbers
            or an angle of view that glTF cannot hold.
        OutputError
            The file cannot be written.

        Warns
        -----
        UserWarning
            One line on what the file says differently, see Notes.

        Notes
        -----
        The same scene gives the same bytes. What glTF cannot say is converted:

        - Materials without `pbr` become those that shader `pbr` draws them with: roughness and
          specular reflectance after `metallic_roughness.from_phong`, color times kd.
        - Textures become PNG images of 8 bits per channel; numbers beyond 1 are clamped.
        - Colors and textures of course scenes, which are shown without a curve, count as sRGB.
        - Point and spot lights without attenuation get the inverse-square one, and the intensity that
          arrives at the center of the meshes as before. Intensities are in candela and lux, those of
          the scene over `light_scale`. Lights that only stand in for missing ones are left out.
        - Other readers know no ambient light and no background.

        A warning tells of an environment, a principal point off the middle, rectangle lights (which
        become spots), radii of lights, negative light, clamped colors, alpha tests of materials that
        blend, and NaN in scalars. The exact values of materials, camera and lights are in `extras`.

        Examples
        --------
        >>> import clshade
        >>> clshade.builtin("teapot").to_glb("teapot.glb")
        """
        exchange.get("to_glb")(self, path)

    def to_json(self, path: Path) -> None:
        """Write the scene to a file that `clshade.load` reads.

        Parameters
        ----------
        path : str or path-like
            File, with a name that ends in .json; an existing one is replaced. Large arrays, of
            vertices, faces and texels, go to a second file beside it, which it names; that of the
            earlier one is removed.

        Raises
        ------
        InputError
            The name has another ending, or the scene is beyond the limits of the format.
        OutputError
            A file cannot be written; then both are as they were.

        Notes
        -----
        The loaded scene has the same values in every field, bit for bit, and renders the same bits.
        Materials and textures that meshes share are shared again. Settings are no part of a scene.
        The same scene gives the same bytes.

        Examples
        --------
        >>> import clshade
        >>> clshade.builtin("quads", count=2).to_json("quads.json")
        >>> clshade.load("quads.json")
        <Scene quads: 4 triangles, 1 mesh, 2 lights, 1920x1080, preset standard>
        """
        exchange.get("to_json")(self, path)

    def __repr__(self) -> str:
        columns, rows = self.camera.resolution
        counts = _count(len(self.meshes), "mesh", "meshes"), _count(len(self.lights), "light")
        what = ", ".join((_count(self.face_count, "triangle"), *counts, f"{columns}x{rows}", f"preset {self.preset}"))
        return f"<Scene {self.name or 'unnamed'}: {what}>"

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        """Return the text and a small image, for notebooks."""
        bundle: dict[str, Any] = exchange.get("notebook").scene_bundle(self)
        return bundle


def with_materials(scene: Scene, change: Callable[[Material], Material]) -> Scene:
    """Return the scene with changed materials; meshes that share one go on sharing it."""
    made = {key: change(each) for key, each in {id(mesh.material): mesh.material for mesh in scene.meshes}.items()}
    return replace(scene, meshes=tuple(with_fields(mesh, material=made[id(mesh.material)]) for mesh in scene.meshes))


Part = TypeVar("Part", Mesh, Material, Scene)


def with_fields(part: Part, **changes: Any) -> Part:
    """Return a mesh, material or scene with other values that need no check, for thousands of them: `dataclasses.replace`
    checks all fields anew."""
    made = object.__new__(type(part))
    vars(made).update(vars(part), **changes)
    return made


def default_tonemap(scene: Scene) -> Literal["none", "srgb", "neutral"]:
    """Return `none` for course scenes, `neutral` for those of preset pbr, `srgb` otherwise."""
    own: dict[Preset, Literal["none", "srgb", "neutral"]] = {"course": "none", "pbr": "neutral", "standard": "srgb"}
    return own[scene.preset]
