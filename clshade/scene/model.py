"""The scene model: records that are checked when they are made, independent of the renderer.

Arrays are copied only when their type or layout has to change, and are read-only afterwards. Every refused value raises
`clshade.errors.InputError` naming the class, the field, what was expected and what was found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import field, replace
from functools import cache, partial, wraps
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar, get_args, overload

import numpy as np
from numpy.typing import ArrayLike

from ..base import exchange
from ..base.arrays import Array, Converted, Faces, Floats, Reals, Vector
from ..base.atomic_files import Path
from ..base.declare import check_fields, checked, record, required
from ..base.validation import (
    choice,
    coefficient,
    flag,
    floats,
    indices,
    instance,
    integer,
    items,
    number,
    read_only,
    rows,
    text,
    value_error,
)
from ..errors import InputError
from .camera import Camera
from .environment import Environment
from .lights import LIGHTS, DirectionalLight, Light, PointLight, RectangleLight, SpotLight
from .material import MIN_ROUGHNESS, Material, MetallicRoughness
from .settings import PRESETS, Edges, Preset, Scalars, Settings
from .texture import Texture

if TYPE_CHECKING:
    from typing_extensions import TypedDict, Unpack

__all__ = ["DirectionalLight", "Light", "PointLight", "RectangleLight", "SpotLight", "Texture"]
__all__ += ["MIN_ROUGHNESS", "Edges", "Environment", "Material", "MetallicRoughness", "Scalars", "Settings"]

MAX_FACES = 1 << 29  # kernels count the three corners of each in an int32

Nonfinite: TypeAlias = Literal["refuse", "drop"]
Rows: TypeAlias = Converted[ArrayLike | None, Reals | None]
Indices: TypeAlias = Converted[ArrayLike | None, Faces | None]

_LATER: Any = None  # the default of fields that are checked together with others

if TYPE_CHECKING:

    class MeshFields(TypedDict, total=False):
        """Fields of `Mesh` besides vertices and faces, as keyword arguments."""

        colors: ArrayLike | None
        normals: ArrayLike | None
        normal_faces: ArrayLike | None
        uvs: ArrayLike | None
        uv_faces: ArrayLike | None
        material: Material
        instances: ArrayLike | None
        name: str
        nonfinite: Nonfinite
        dropped: int
        scalars: Mapping[str, ArrayLike] | None
        tangents: ArrayLike | None
        tangent_faces: ArrayLike | None
        more_uvs: Iterable[ArrayLike]
        alphas: ArrayLike | None
        instance_names: Iterable[str]
        part_of: str


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


def _placements(owner: str, name: str, value: Any) -> Floats:
    form = "an array of shape (K, 4, 4)"
    placements = floats(owner, name, value, form)
    if placements.ndim != 3 or placements.shape[1:] != (4, 4) or placements.dtype.kind == "b":
        raise value_error(owner, name, form, value)
    placements = placements.astype(np.float64)
    if not np.isfinite(placements).all() or (placements[:, 3] != [0.0, 0.0, 0.0, 1.0]).any():
        raise value_error(owner, name, "finite affine matrices with last row 0 0 0 1", value)
    return read_only(placements)


_IDENTITY = _placements("Mesh", "instances", np.eye(4)[None])


def _arrays(owner: str, name: str, value: Any) -> tuple[Reals, ...]:
    """Return arrays of texture coordinates."""
    arrays = items(owner, name, value, "a sequence of arrays")
    return tuple(rows(owner, name, array, 2, finite=False) for array in arrays)


_texts = partial(items, expected="a sequence of texts", kinds=str)


def _vertex_colors(who: str, colors: Any, alphas: Any, count: int) -> tuple[Reals | None, Reals | None]:
    """Return colors (V, 3), and alphas (V,) from 0 to 1, which a fourth column of colors may hold; None if all are 1."""
    if colors is not None:
        array = _scaled(who, "colors", colors, "an array of shape (K, 3) of finite numbers")
        colors = rows(who, "colors", array, 4 if array.ndim == 2 and array.shape[1] == 4 else 3)
        if len(colors) != count:
            raise value_error(who, "colors", f"one row per vertex ({count})", colors)
        if colors.shape[1] == 4:
            colors, alphas = rows(who, "colors", colors[:, :3], 3), colors[:, 3]
    if alphas is None:
        return colors, None
    array = _scaled(who, "alphas", alphas, f"an array of shape ({count},) of finite numbers")
    if array.shape != (count,):
        raise value_error(who, "alphas", f"one number per vertex ({count})", array)
    alphas = read_only(np.clip(rows(who, "alphas", array[:, None], 1)[:, 0], 0.0, 1.0))
    return colors, alphas if (alphas < 1.0).any() else None


def _scaled(who: str, name: str, value: Any, expected: str) -> Array:
    """Return numbers, unsigned integers divided by their type's maximum."""
    array = floats(who, name, value, expected)
    return array / np.iinfo(array.dtype).max if array.dtype.kind == "u" else array


def _scalars(who: str, value: Any, vertices: int, faces: int) -> dict[str, Reals]:
    """Return a mesh's scalars, read-only, infinity as NaN."""
    try:
        pairs = dict(() if value is None else value).items()
    except (TypeError, ValueError):
        raise value_error(who, "scalars", "a mapping from names to arrays", value) from None
    shapes = f"({vertices},) per vertex, ({faces},) per face or ({faces}, 3) per corner"
    scalars: dict[str, Reals] = {}
    for name, numbers in pairs:
        if not isinstance(name, str) or not name:
            raise value_error(who, "scalars", "names that are texts", name)
        array = floats(who, f"scalars {name!r}", numbers, f"an array of numbers: {shapes}")
        if array.shape not in ((vertices,), (faces,), (faces, 3)):
            raise value_error(who, f"scalars {name!r}", shapes, array)
        array = np.ascontiguousarray(array, None if array.dtype in (np.float32, np.float64) else np.float64)
        infinite = np.isinf(array)
        array = np.where(infinite, array.dtype.type(np.nan), array) if infinite.any() else array.view()
        scalars[name] = read_only(array)
    return scalars


def _without_nonfinite(verts: Reals, faces: Faces) -> tuple[Reals, Faces, int]:
    """Return finite vertices, faces, and how many faces used another vertex: these shrink to a point at a vertex that others
    use, so that they affect neither normals nor the bounding box."""
    bad: Array = np.asarray(~np.isfinite(verts).all(axis=1))
    if not bad.any():
        return verts, faces, 0
    lost = bad[faces].any(axis=1)
    finite = faces[~lost]
    anchor = finite[0, 0] if len(finite) else np.flatnonzero(~bad)[0] if not bad.all() else 0
    verts, faces = verts.copy(), faces.copy()
    verts[bad] = 0.0 if bad.all() else verts[anchor]
    faces[lost] = anchor
    return read_only(verts), read_only(faces), int(lost.sum())


@_taking_vertices
@record
class Mesh:
    """Triangles with one material, placed any number of times.

    Attributes
    ----------
    verts : array_like, (V, 3)
        Positions, object space; float32 and float64 are kept. `vertices` is another name of it.
    faces : array_like, (F, 3)
        Indices into verts.
    colors : array_like, (V, 3) or (V, 4), or None, default None
        Linear RGB per vertex; None: white. Unsigned integers are divided by their type's maximum.
        Kept as (V, 3); a fourth column becomes `alphas`.
    normals : array_like, (K, 3) or None, default None
        Directions of any length; None: computed from the faces (`geometry.vertex_normals`).
    normal_faces, uv_faces, tangent_faces : array_like, (F, 3) or None, default None
        Indices into normals, uvs and tangents; None: `faces`.
    uvs : array_like, (T, 2) or None, default None
        Texture coordinates; v = 0 is row 0 of the texture's image. NaN and infinity count as 0,
        magnitudes beyond 2^40 as 2^40.
    material : Material, default Material()
        Material of all triangles.
    instances : array_like, (K, 4, 4) or None, default None
        Affine placements, object to world, for column vectors; None: one identity.
    name : str, default ""
        Name of the mesh.
    nonfinite : {"refuse", "drop"}
        With vertices that are NaN or infinite, refuse the mesh, or drop the triangles that use
        them: they keep their numbers and draw nothing, and normals are as they would be without.
    dropped : int, default 0
        Number of faces dropped; counted here, and kept in copies of the mesh.
    scalars : mapping of str to array_like or None, default None
        Data by name, any numbers: (V,) per vertex, (F,) per face, or (F, 3) per corner of each
        face; with as many vertices as faces (V,) is per vertex. NaN and infinity: no data. Kept as a
        dict of float32 or float64. `Settings.scalars` shows them by a color map.
    tangents : array_like, (K, 4) or None, default None
        Directions of any length along which u grows in normal maps, and the sign w of the bitangent
        w * cross(normal, tangent), along which v falls; None: computed as MikkTSpace does.
    more_uvs : iterable of array_like, each of the shape of uvs, default ()
        Further texture coordinates, which a Texture names by `coordinates`. Kept as a tuple.
    alphas : array_like, (V,) or None, default None
        Alpha per vertex, clamped to [0, 1]; None: 1. Unsigned integers as for `colors`.
    instance_names : iterable of str, default ()
        Name of each instance, "" for one without; (): none has one. Kept as a tuple.
    part_of : str, default ""
        Meshes of a scene with one text here are parts of one object, each of a material of its own:
        instance k of each is a part of instance k of the object. "": the mesh is an object.
    """

    verts: Reals
    faces: Faces
    colors: Rows = _LATER
    normals: Rows = checked(None, partial(rows, width=3))
    normal_faces: Indices = _LATER
    uvs: Rows = checked(None, partial(rows, width=2, finite=False))
    uv_faces: Indices = _LATER
    material: Material = field(default_factory=cache(Material))
    instances: Converted[ArrayLike | None, Floats] = checked(None, _placements)
    name: str = ""
    nonfinite: Nonfinite = checked("refuse", partial(choice, allowed=get_args(Nonfinite)))
    dropped: int = checked(0, partial(integer, least=0, most=1 << 53))
    scalars: Converted[Mapping[str, ArrayLike] | None, dict[str, Reals]] = _LATER
    tangents: Rows = checked(None, partial(rows, width=4))
    tangent_faces: Indices = _LATER
    more_uvs: Converted[Iterable[ArrayLike], tuple[Reals, ...]] = checked((), _arrays)
    alphas: Rows = _LATER
    instance_names: Converted[Iterable[str], tuple[str, ...]] = checked((), _texts)
    part_of: str = checked("", text)

    if TYPE_CHECKING:

        @overload
        def __init__(self, verts: ArrayLike, faces: ArrayLike, *others: Any, **fields: Unpack[MeshFields]) -> None: ...

        @overload
        def __init__(self, *, vertices: ArrayLike, faces: ArrayLike, **fields: Unpack[MeshFields]) -> None: ...

        def __init__(self, *args: Any, **fields: Any) -> None: ...

    def __post_init__(self) -> None:
        who = f"Mesh {self.name!r}" if text("Mesh", "name", self.name) else "Mesh"
        check_fields(self, who)
        values, drop = vars(self), self.nonfinite == "drop"
        verts = rows(who, "verts", self.verts, 3, finite=not drop)
        faces = indices(who, "faces", self.faces, len(verts))
        if drop:
            verts, faces, dropped = _without_nonfinite(verts, faces)
            values["dropped"] += dropped
        colors, alphas = _vertex_colors(who, self.colors, self.alphas, len(verts))
        values.update(verts=verts, faces=faces, colors=colors, alphas=alphas)
        for further in self.more_uvs:
            if self.uvs is None or further.shape != self.uvs.shape:
                expected = (
                    "no array without uvs" if self.uvs is None else f"arrays of the shape of uvs {self.uvs.shape}"
                )
                raise value_error(who, "more_uvs", expected, further)
        for name in ("normal", "uv", "tangent"):
            attribute, corners = values[f"{name}s"], values[f"{name}_faces"]
            if corners is None:
                if attribute is not None and len(attribute) < len(verts):
                    raise value_error(who, f"{name}s", f"one row per vertex ({len(verts)}), or {name}_faces", attribute)
                continue
            if attribute is None:
                raise value_error(who, f"{name}_faces", f"None without {name}s", corners)
            values[f"{name}_faces"] = corners = indices(who, f"{name}_faces", corners, len(attribute))
            if corners.shape != faces.shape:
                raise value_error(who, f"{name}_faces", f"the shape of faces {faces.shape}", corners)
        values["scalars"] = _scalars(who, self.scalars, len(verts), len(faces))
        if not isinstance(self.material, Material):
            raise value_error(who, "material", "a Material", self.material)
        placements = values["instances"] = _IDENTITY if values["instances"] is None else self.instances
        if self.instance_names and len(self.instance_names) != len(placements):
            expected = f"one text per instance ({len(placements)}), or none"
            raise value_error(who, "instance_names", expected, len(self.instance_names))

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
        placed = _count(len(self.instances), "instance")
        return f"<Mesh {self.name or 'unnamed'}: {', '.join(counts)}, {placed}{scalars}>"


def _count(number: int, singular: str, plural: str = "") -> str:
    return f"{number:,} {singular if number == 1 else plural or singular + 's'}"


def _parts(owner: str, name: str, value: Any, kinds: tuple[type, ...]) -> tuple[Any, ...]:
    """Return one part of a scene, or a sequence of them, as a tuple."""
    value = (value,) if isinstance(value, kinds) else value
    return items(owner, name, value, f"a sequence of {' or '.join(kind.__name__ for kind in kinds)}", kinds=kinds)


def _background(owner: str, name: str, value: Any) -> Floats | None:
    return None if value is None else coefficient(owner, name, value)


@record
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

    meshes: Converted[Mesh | Iterable[Mesh], tuple[Mesh, ...]] = required(check=partial(_parts, kinds=(Mesh,)))
    camera: Converted[Camera | None, Camera] = checked(None, partial(instance, kind=Camera))
    lights: Converted[Light | Iterable[Light], tuple[Light, ...]] = checked((), partial(_parts, kinds=LIGHTS))
    ambient: Vector = checked(1.0, coefficient)
    background: Converted[ArrayLike | None, Floats | None] = checked(0.0, _background)
    preset: Preset = checked("standard", partial(choice, allowed=PRESETS))
    name: str = checked("", text)
    ignored: tuple[str, ...] = checked((), _texts)
    environment: Environment | None = checked(None, partial(instance, kind=Environment))
    own_lights: bool = checked(True, flag)
    fitted: bool = checked(False, flag)
    light_scale: float = checked(1.0, partial(number, above=0.0))
    animations: tuple[str, ...] = checked((), _texts)

    def __post_init__(self) -> None:
        check_fields(self)
        if self.face_count > MAX_FACES:
            raise value_error("Scene", "meshes", f"at most {MAX_FACES} triangles with instances", self.face_count)
        if vars(self)["camera"] is None:
            vars(self).update(camera=exchange.get("default_camera")(self.meshes), fitted=True)

    @property
    def face_count(self) -> int:
        """Number of triangles, counting instances."""
        return sum(len(mesh.faces) * len(mesh.instances) for mesh in self.meshes)

    @property
    def nonfinite(self) -> int:
        """Number of triangles dropped for a vertex that is NaN or infinite, counting instances."""
        return sum(mesh.dropped * len(mesh.instances) for mesh in self.meshes)

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

        It has a camera that shows all of it and lights around it, as `clshade.load` gives a mesh; its
        preset is `pbr` if a material is a PBRMaterial, else `standard`. Both sides are lit. Refused
        are sources without triangles, with other polygons, or with several materials on one mesh; a
        warning tells of curves and points of a trimesh.Scene, which are not rendered.

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

        Parameters
        ----------
        path : str or path-like
            File, with a name that ends in .glb; an existing one is replaced.

        Notes
        -----
        The same scene gives the same bytes. A file of 4 GiB or more, and numbers or an angle of view
        that glTF cannot hold, are refused. The table in clshade/scene/README.md says what becomes of
        each part of a scene; the exact values of materials, camera and lights are in `extras`. Lights
        that only stand in for missing ones are left out. A warning tells of an environment, a
        principal point off the middle, rectangle lights, radii of lights, negative light, clamped
        colors, alpha tests of materials that blend, and NaN in scalars.
        """
        exchange.get("to_glb")(self, path)

    def to_json(self, path: Path) -> None:
        """Write the scene to a file that `clshade.load` reads.

        Parameters
        ----------
        path : str or path-like
            File, with a name that ends in .json; an existing one is replaced. Large arrays go to a
            second file beside it, which it names; that of the earlier one is removed.

        Notes
        -----
        The loaded scene has the same values in every field, bit for bit. Materials and textures that
        meshes share are shared again. The same scene gives the same bytes. A scene beyond the limits
        of the format is refused; where a file cannot be written, both are as they were.

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
    change = cache(change)
    return replace(scene, meshes=tuple(with_fields(mesh, material=change(mesh.material)) for mesh in scene.meshes))


Part = TypeVar("Part", Mesh, Material, Scene)


def with_fields(part: Part, **changes: Any) -> Part:
    """Return a mesh, material or scene with other values that need no check, for thousands of them: `dataclasses.replace`
    checks all fields anew."""
    copied = object.__new__(type(part))
    vars(copied).update(vars(part), **changes)
    return copied


def default_tonemap(scene: Scene) -> Literal["none", "srgb", "neutral"]:
    """Return `none` for course scenes, `neutral` for those of preset pbr, `srgb` otherwise."""
    return "none" if scene.preset == "course" else "neutral" if scene.preset == "pbr" else "srgb"
