"""The scene model: frozen dataclasses, checked on construction, that know nothing of the renderer.

Arrays are copied only when their type or layout has to change, and are then read-only. Every refused value raises
`clshade.errors.InputError` naming the class, the field, what was expected and what was found.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .errors import InputError

MAX_RESOLUTION = 16384  # pixels a side; kernels/edge.clh derives the integer ranges from it
MAX_FACES = 1 << 24  # a face's index has 24 bits in the host's sort key

Array = np.ndarray

SHADERS = ("gouraud", "phong", "nolight")
VISIBILITIES = ("painter", "depth")
LIGHTING_AT = ("centroid", "position")
INTERPOLATIONS = ("affine", "perspective")
TEXTURE_AT = ("vertex", "pixel")
AMBIENTS = ("plain", "tinted")
LAYERS = ("Z", "id")
WRAPS = ("repeat", "clamp", "mirror")
LOOKUPS = ("standard", "course")
SIDES = ("both", "front")
PRESETS = ("course", "standard")


def _describe(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape} and type {value.dtype}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def refuse(owner: str, name: str, expected: str, found: Any) -> InputError:
    """The one form of every complaint about a value: owner, field, expected, found."""
    return InputError(f"{owner}: {name}: expected {expected}, found {_describe(found)}")


def choice(owner: str, name: str, value: Any, allowed: Iterable[str]) -> str:
    allowed = tuple(allowed)
    if not isinstance(value, str) or value not in allowed:
        raise refuse(owner, name, "one of " + ", ".join(allowed), value)
    return value


def _floats(owner: str, name: str, value: Any, expected: str) -> Array:
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            raise TypeError
    except (TypeError, ValueError):
        raise refuse(owner, name, expected, value) from None
    return array


def vector(owner: str, name: str, value: Any, *, finite: bool = True) -> Array:
    """A 3-vector given as (3,), (1,3) or (3,1), as a read-only (3,) float64 array."""
    expected = "three finite numbers" if finite else "three numbers"
    array = _floats(owner, name, value, expected)
    if array.shape not in ((3,), (1, 3), (3, 1)):
        raise refuse(owner, name, expected, value)
    array = array.astype(np.float64).reshape(3)
    if finite and not np.isfinite(array).all():
        raise refuse(owner, name, expected, array.tolist())
    array.flags.writeable = False
    return array


def coefficient(owner: str, name: str, value: Any) -> Array:
    """A scalar or 3-vector coefficient, as a read-only (3,) float64 array (one value per channel)."""
    array = _floats(owner, name, value, "a number or three numbers")
    return vector(owner, name, np.full(3, array.item()) if array.size == 1 else array)


def number(
    owner: str, name: str, value: Any, *, above: float = -math.inf, least: float = -math.inf, expected: str = ""
) -> float:
    """A finite real number above `above` and not below `least`, as a Python float."""
    if not expected:
        expected = "a finite number"
        expected += f" above {above:g}" if above > -math.inf else ""
        expected += f" of at least {least:g}" if least > -math.inf else ""
    array = _floats(owner, name, value, expected)
    if array.size != 1:
        raise refuse(owner, name, expected, value)
    result = float(array.item())
    if not math.isfinite(result) or result <= above or result < least:
        raise refuse(owner, name, expected, value)
    return result


def integer(owner: str, name: str, value: Any, least: int, most: int) -> int:
    expected = f"a whole number from {least} to {most}"
    array = _floats(owner, name, value, expected)
    if array.size != 1 or isinstance(value, bool) or array.item() != array.item() or math.isinf(array.item()):
        raise refuse(owner, name, expected, value)
    result = int(array.item())
    if result != array.item() or not least <= result <= most:
        raise refuse(owner, name, expected, value)
    return result


def rows(owner: str, name: str, value: Any, width: int, *, finite: bool = True, least: int = 0) -> Array:
    """A (K, width) array of reals in its own precision (float32 or float64), contiguous and read-only."""
    expected = f"an array of shape (K, {width}) of {'finite ' if finite else ''}numbers"
    array = _floats(owner, name, value, expected)
    if array.ndim != 2 or array.shape[1] != width or array.shape[0] < least:
        raise refuse(owner, name, expected + (f" with K of at least {least}" if least else ""), array)
    if array.dtype not in (np.float32, np.float64):
        array = array.astype(np.float64)
    array = np.ascontiguousarray(array)
    if finite and not np.isfinite(array).all():
        bad = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
        raise refuse(owner, name, "finite numbers", f"{array[bad].tolist()} in row {bad}")
    array = array.view()
    array.flags.writeable = False
    return array


def indices(owner: str, name: str, value: Any, count: int) -> Array:
    """An (F, 3) array of indices below `count`, range-checked before it is narrowed to int32; read-only."""
    array = np.asarray(value)
    if array.size == 0:
        array = np.zeros((0, 3), np.int32)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
        raise refuse(owner, name, "an array of shape (F, 3) of whole numbers", value)
    if array.size and (array.min() < 0 or array.max() >= count):
        face, corner = np.argwhere((array < 0) | (array >= count))[0]
        raise refuse(owner, name, f"indices from 0 to {count - 1}", f"{array[face, corner]} in face {face}")
    array = np.ascontiguousarray(array, dtype=np.int32).view()
    array.flags.writeable = False
    return array


def _set(instance: Any, **values: Any) -> None:
    for name, value in values.items():
        object.__setattr__(instance, name, value)


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera.

    eye, lookat, up: 3-vectors, world space. `up` must not be parallel to the viewing direction.
    focal: distance of the image plane from the eye, scene units (only focal/plane matters).
    plane: (H, W), height and width of the image plane, scene units.
    resolution: (N, M), columns and rows of the image, pixels.
    principal: where the viewing direction meets the image, as fractions of its width and height from the bottom left.
    orthographic: parallel projection; plane is then the size of what is seen, scene units, and focal has no meaning.
    """

    eye: Array
    lookat: Array
    up: Array
    focal: float
    plane: tuple[float, float]
    resolution: tuple[int, int] = (800, 600)
    principal: tuple[float, float] = (0.5, 0.5)
    orthographic: bool = False

    def __post_init__(self) -> None:
        who = "Camera"
        eye, lookat, up = (vector(who, name, getattr(self, name)) for name in ("eye", "lookat", "up"))
        with np.errstate(over="ignore"):
            forward = lookat - eye
        if not np.isfinite(forward).all() or not forward.any():
            raise refuse(who, "lookat", "a point other than eye", self.lookat)
        if not up.any():
            raise refuse(who, "up", "a vector other than zero", self.up)
        unit_forward, unit_up = (v / np.abs(v).max() for v in (forward, up))
        if np.linalg.norm(np.cross(unit_forward, unit_up)) <= 1e-12:
            raise refuse(who, "up", "a vector not parallel to lookat - eye", up.tolist())
        try:
            height, width = self.plane
            columns, count_rows = self.resolution
        except (TypeError, ValueError):
            raise refuse(who, "plane, resolution", "two numbers each", (self.plane, self.resolution)) from None
        try:
            right, up_part = self.principal
        except (TypeError, ValueError):
            raise refuse(who, "principal", "two numbers", self.principal) from None
        _set(
            self,
            eye=eye,
            lookat=lookat,
            up=up,
            focal=number(who, "focal", self.focal, above=0.0),
            plane=(number(who, "plane H", height, above=0.0), number(who, "plane W", width, above=0.0)),
            resolution=(
                integer(who, "resolution N", columns, 1, MAX_RESOLUTION),
                integer(who, "resolution M", count_rows, 1, MAX_RESOLUTION),
            ),
            principal=(number(who, "principal u", right), number(who, "principal v", up_part)),
            orthographic=bool(self.orthographic),
        )

    @classmethod
    def from_fov(cls, eye: Any, lookat: Any, up: Any, fov: float, resolution: tuple[int, int] = (800, 600)) -> Camera:
        """A camera with square pixels from its vertical field of view, in degrees, between 0 and 180."""
        fov = number("Camera.from_fov", "fov", fov, above=0.0)
        if fov >= 180.0:
            raise refuse("Camera.from_fov", "fov", "degrees between 0 and 180", fov)
        height = 2.0 * math.tan(math.radians(fov) / 2.0)
        columns, count_rows = resolution
        return cls(eye, lookat, up, 1.0, (height, height * columns / max(count_rows, 1)), resolution)

    @classmethod
    def from_matrix(
        cls,
        matrix: Any,
        pose: Any,
        resolution: tuple[int, int],
        *,
        pixel_center: float = 0.5,
        convention: str = "opencv",
    ) -> Camera:
        """A camera from its 3x3 matrix K and its pose.

        matrix: K, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, x to the right and y down from the image's top left.
        pose: (4, 4) camera to world, a rotation and a translation. convention: axes of the camera in `pose`, `opencv`
        (x right, y down, z forward) or `opengl` (x right, y up, z backward).
        pixel_center: 0.5 where K counts the first pixel's center as 0.5, 0 where it counts it as 0.
        """
        who = "Camera.from_matrix"
        k, placement = (np.asarray(m, dtype=np.float64) for m in (matrix, pose))
        if (
            k.shape != (3, 3)
            or not np.isfinite(k).all()
            or (k[[0, 1, 2, 2], [1, 0, 0, 1]] != 0.0).any()
            or k[2, 2] != 1.0
        ):
            raise refuse(who, "matrix", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]", k.tolist())
        if min(k[0, 0], k[1, 1]) <= 0.0:
            raise refuse(who, "matrix", "fx and fy above 0", k.tolist())
        if placement.shape != (4, 4) or not np.isfinite(placement).all():
            raise refuse(who, "pose", "a finite (4, 4) matrix, camera to world", pose)
        rotation, eye = placement[:3, :3], placement[:3, 3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0.0:
            raise refuse(who, "pose", "a rotation without scale or reflection", rotation.tolist())
        if pixel_center not in (0, 0.5):
            raise refuse(who, "pixel_center", "0.5 or 0", pixel_center)
        choice(who, "convention", convention, ("opencv", "opengl"))
        forward, up = (rotation[:, 2], -rotation[:, 1]) if convention == "opencv" else (-rotation[:, 2], rotation[:, 1])
        columns = integer(who, "resolution N", resolution[0], 1, MAX_RESOLUTION)
        count_rows = integer(who, "resolution M", resolution[1], 1, MAX_RESOLUTION)
        shift = 0.5 - pixel_center
        principal = ((k[0, 2] + shift) / columns, 1.0 - (k[1, 2] + shift) / count_rows)
        plane = (count_rows / k[1, 1], columns / k[0, 0])
        return cls(eye, eye + forward, up, 1.0, plane, (columns, count_rows), principal)

    def with_resolution(self, resolution: tuple[int, int]) -> Camera:
        """The same view at another resolution (N, M): H of the plane is kept, W makes the pixels square."""
        try:
            columns, count_rows = resolution
            columns = integer("Camera", "resolution N", columns, 1, MAX_RESOLUTION)
            count_rows = integer("Camera", "resolution M", count_rows, 1, MAX_RESOLUTION)
        except (TypeError, ValueError) as error:
            if isinstance(error, InputError):
                raise
            raise refuse("Camera", "resolution", "two whole numbers (N, M)", resolution) from None
        height = self.plane[0]
        return replace(self, plane=(height, height * columns / count_rows), resolution=(columns, count_rows))


@dataclass(frozen=True, eq=False)
class PointLight:
    """A point light without attenuation. position: world space. intensity: linear RGB, any finite values."""

    position: Array
    intensity: Array = field(default_factory=lambda: np.ones(3))

    def __post_init__(self) -> None:
        _set(
            self,
            position=vector("PointLight", "position", self.position),
            intensity=vector("PointLight", "intensity", self.intensity),
        )


@dataclass(frozen=True, eq=False)
class Texture:
    """An image to look colours up in.

    image: (h, w, 3) or, with alpha, (h, w, 4), linear RGB, row 0 is v = 0, column 0 is u = 0. Floats are used as they
        are, integers are divided by their type's maximum. Kept as float32.
    wrap: repeat, clamp or mirror, or a pair of them for u and v; used by the standard lookup. Kept as a pair.
    lookup: `standard` has the centre of texel (i, j) at ((i+0.5)/w, (j+0.5)/h), and the texel multiplies the vertex
        colour; `course` maps u to u*(w-1), holds u and v to [0, 1], and the texel replaces the vertex colour.
    """

    image: Array
    wrap: str | tuple[str, str] = "repeat"
    lookup: str = "standard"
    name: str = ""

    def __post_init__(self) -> None:
        image = _floats("Texture", "image", self.image, "an array of shape (h, w, 3) or (h, w, 4)")
        if image.ndim != 3 or image.shape[2] not in (3, 4) or 0 in image.shape or max(image.shape) > 32768:
            raise refuse("Texture", "image", "an array of shape (h, w, 3|4) with h and w from 1 to 32768", image)
        if image.dtype.kind in "iu":
            image = image.astype(np.float64) / np.iinfo(image.dtype).max
        image = np.ascontiguousarray(image, dtype=np.float32).view()
        if not np.isfinite(image).all():
            raise refuse("Texture", "image", "finite numbers", "NaN, infinity or a value beyond float32")
        image.flags.writeable = False
        wraps = (self.wrap, self.wrap) if isinstance(self.wrap, str) else tuple(self.wrap)
        if len(wraps) != 2:
            raise refuse("Texture", "wrap", "one name or two, for u and v", self.wrap)
        _set(self, image=image, wrap=tuple(choice("Texture", "wrap", wrap, WRAPS) for wrap in wraps))
        choice("Texture", "lookup", self.lookup, LOOKUPS)


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

    ka: Any = 0.1
    kd: Any = 0.8
    ks: Any = 0.5
    n: float = 20.0
    texture: Texture | None = None
    name: str = ""
    color: Any = 1.0
    sides: str = "both"
    two_sided: bool = False
    alpha_cutoff: float | None = None

    def __post_init__(self) -> None:
        exponent = number("Material", "n", self.n, least=0.0, expected="a number from 0 to 1e9")
        if exponent > 1e9:
            raise refuse("Material", "n", "a number from 0 to 1e9", self.n)
        if self.texture is not None and not isinstance(self.texture, Texture):
            raise refuse("Material", "texture", "a Texture or None", self.texture)
        _set(self, n=exponent, **{k: coefficient("Material", k, getattr(self, k)) for k in ("ka", "kd", "ks", "color")})
        choice("Material", "sides", self.sides, SIDES)
        if self.alpha_cutoff is not None:
            _set(self, alpha_cutoff=number("Material", "alpha_cutoff", self.alpha_cutoff))


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with one material, placed any number of times.

    verts: (V, 3) positions, object space, float32 or float64 (kept as given).
    faces: (F, 3) indices into verts.
    colors: (V, 3) linear RGB per vertex, or None for white.
    normals: (K, 3) directions of any length, or None to compute them from the faces (`geometry.vertex_normals`).
    normal_faces: (F, 3) indices into normals, or None for `faces`.
    uvs: (T, 2) texture coordinates, v = 0 at row 0 of the texture's image, or None.
    uv_faces: (F, 3) indices into uvs, or None for `faces`.
    instances: (K, 4, 4) affine placements, object to world, column vectors; default one identity.
    """

    verts: Array
    faces: Array
    colors: Array | None = None
    normals: Array | None = None
    normal_faces: Array | None = None
    uvs: Array | None = None
    uv_faces: Array | None = None
    material: Material = field(default_factory=Material)
    instances: Array | None = None
    name: str = ""

    def __post_init__(self) -> None:
        who = f"Mesh {self.name!r}" if self.name else "Mesh"
        verts = rows(who, "verts", self.verts, 3)
        faces = indices(who, "faces", self.faces, len(verts))
        colors = None if self.colors is None else rows(who, "colors", self.colors, 3)
        if colors is not None and len(colors) != len(verts):
            raise refuse(who, "colors", f"one row per vertex ({len(verts)})", colors)
        normals = None if self.normals is None else rows(who, "normals", self.normals, 3)
        # A texture coordinate that is NaN or infinite gives a defined texel (texel 0): accepted.
        uvs = None if self.uvs is None else rows(who, "uvs", self.uvs, 2, finite=False)
        _set(self, verts=verts, faces=faces, colors=colors, normals=normals, uvs=uvs)
        for name, attribute in (("normal", normals), ("uv", uvs)):
            given = getattr(self, f"{name}_faces")
            if given is None:
                if attribute is not None and len(attribute) < len(verts):
                    raise refuse(who, f"{name}s", f"one row per vertex ({len(verts)}), or {name}_faces", attribute)
                continue
            if attribute is None:
                raise refuse(who, f"{name}_faces", f"None without {name}s", given)
            given = indices(who, f"{name}_faces", given, len(attribute))
            if given.shape != faces.shape:
                raise refuse(who, f"{name}_faces", f"the shape of faces {faces.shape}", given)
            _set(self, **{f"{name}_faces": given})
        if not isinstance(self.material, Material):
            raise refuse(who, "material", "a Material", self.material)
        placements = np.eye(4)[None] if self.instances is None else np.asarray(self.instances)
        if placements.ndim != 3 or placements.shape[1:] != (4, 4) or placements.dtype.kind not in "fiu":
            raise refuse(who, "instances", "an array of shape (K, 4, 4)", self.instances)
        placements = placements.astype(np.float64)
        if not np.isfinite(placements).all() or (placements[:, 3] != [0.0, 0.0, 0.0, 1.0]).any():
            raise refuse(who, "instances", "finite affine matrices with last row 0 0 0 1", self.instances)
        placements.flags.writeable = False
        _set(self, instances=placements)


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
    lights: tuple[PointLight, ...] = ()
    ambient: Array = field(default_factory=lambda: np.ones(3))
    background: Array | None = field(default_factory=lambda: np.zeros(3))
    preset: str = "standard"
    name: str = ""
    ignored: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, kind in (("meshes", Mesh), ("lights", PointLight)):
            value = getattr(self, name)
            items = (value,) if isinstance(value, kind) else value
            try:
                items = tuple(items)
            except TypeError:
                raise refuse("Scene", name, f"a sequence of {kind.__name__}", value) from None
            for item in items:
                if not isinstance(item, kind):
                    raise refuse("Scene", name, f"a sequence of {kind.__name__}", item)
            _set(self, **{name: items})
        if not isinstance(self.camera, Camera):
            raise refuse("Scene", "camera", "a Camera", self.camera)
        if self.face_count > MAX_FACES:
            raise refuse("Scene", "meshes", f"at most {MAX_FACES} triangles with instances", self.face_count)
        _set(
            self,
            ambient=coefficient("Scene", "ambient", self.ambient),
            background=None if self.background is None else coefficient("Scene", "background", self.background),
        )
        choice("Scene", "preset", self.preset, PRESETS)

    @property
    def face_count(self) -> int:
        """Number of triangles, instances counted."""
        return sum(len(mesh.faces) * len(np.asarray(mesh.instances)) for mesh in self.meshes)


@dataclass(frozen=True)
class Settings:
    """How a scene is drawn. The defaults are the preset `standard`; `Settings.from_preset("course")` gives the other.

    shader: gouraud, phong or nolight (the colour itself).
    visibility: `painter`: the triangle with the smallest mean vertex depth wins, ties: the later face; `depth`: per
        pixel, ties: the later face.
    lighting_at: `centroid`: directions to eye and lights once per triangle; `position`: at each pixel (or vertex).
    interpolation: of attributes over a triangle, `affine` in the image or `perspective`. Depth is always perspective.
    texture_at: `vertex` looks the texture up at the corners, `pixel` at every pixel.
    ambient: `plain` ka*Ia, or `tinted` ka*Ia*color.
    layers: further layers besides the image, any of `Z`, `id`.
    cull: leave out triangles that are seen from behind (clockwise in the image).
    near: distance of the near plane from the eye, scene units; None: 1e-4 of the scene's bounding radius.
    precision: arithmetic of the kernels: float32.
    """

    shader: str = "phong"
    visibility: str = "depth"
    lighting_at: str = "position"
    interpolation: str = "perspective"
    texture_at: str = "pixel"
    ambient: str = "tinted"
    layers: tuple[str, ...] = ()
    cull: bool = False
    near: float | None = None
    precision: str = "float32"

    def __post_init__(self) -> None:
        who = "Settings"
        choice(who, "shader", self.shader, SHADERS)
        choice(who, "visibility", self.visibility, VISIBILITIES)
        choice(who, "lighting_at", self.lighting_at, LIGHTING_AT)
        choice(who, "interpolation", self.interpolation, INTERPOLATIONS)
        choice(who, "texture_at", self.texture_at, TEXTURE_AT)
        choice(who, "ambient", self.ambient, AMBIENTS)
        choice(who, "precision", self.precision, ("float32",))
        layers = (self.layers,) if isinstance(self.layers, str) else tuple(self.layers)
        for layer in layers:
            choice(who, "layers", layer, LAYERS)
        _set(self, layers=tuple(name for name in LAYERS if name in layers), cull=bool(self.cull))
        if self.near is not None:
            _set(self, near=number(who, "near", self.near, above=0.0))

    @classmethod
    def from_preset(cls, preset: str, **fields: Any) -> Settings:
        """The named preset with `fields` changed. Raises InputError for an unknown preset, field or value."""
        choice("Settings", "preset", preset, PRESETS)
        values: dict[str, Any] = {}
        if preset == "course":
            values = {
                "visibility": "painter",
                "lighting_at": "centroid",
                "interpolation": "affine",
                "texture_at": "vertex",
                "ambient": "plain",
            }
        unknown = set(fields) - set(cls.__dataclass_fields__)
        if unknown:
            raise refuse(
                "Settings", sorted(unknown)[0], "one of " + ", ".join(cls.__dataclass_fields__), "no such field"
            )
        return cls(**{**values, **fields})
