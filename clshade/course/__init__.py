"""The functions of the course's assignments, run by OpenCL kernels.

Names, argument order and array shapes are those of the assignments.

Notes
-----
Images are (M, N, 3) float64 with row 0 at the BOTTOM, linear and never clamped: values above 1 are
kept. To show or save one in 8 bits as the course does, flip it and clamp it:
``np.clip(image[::-1], 0.0, 1.0)``.

Shapes. `verts`, `verts_colors`, `faces`, `uvs` and `uvs_faces` are 3xN (2xN), one item per column;
all of them may come transposed together, which is recognized by any that is not square. `l_pos` and
`l_int` are Lx3, one light per row, or lists of L 3-vectors, or one 3-vector each for one light; L
may be 0. `verts_p` is 3x2, one corner per row; `verts_n` and `verts_c` are 3x3, one corner per
column. 3-vectors are (3,), (1, 3) or (3, 1). k_a, k_d, k_s, light_amb and bg_color are numbers or
3-vectors; those of the first three that are 0 are left out of the kernel. The exponent n is from 0
to 1e9.

Light, for a point P with unit normal N, V toward the eye, L toward a light, R = 2N(N.L) - L, per
channel: ``I = ka*Ia + sum over lights of Ip * color * (kd*max(0, N.L) + ks*(R.V)^n)``, the
highlight only where N.L > 0 and R.V > 0 (B. T. Phong, "Illumination for computer generated
pictures", CACM 18(6), 1975). A normal of 0, a light at P and an eye at P contribute 0.

Objects that hold several arguments, such as a material or lights, are passed by their numbers. If
the arguments of a call do not fit, the error lists the expected ones in their order, with what was
found in place of each; it is a TypeError as well.

Every function raises `clshade.errors.InputError`, a ValueError that names the function, the
argument, what was expected and what was found, for wrong shapes, indices out of range, NaN or
infinite values and unknown shaders, before anything is allocated; and `clshade.errors.DeviceError`
if no OpenCL device works. The device is the default one, or the one that the environment variable
CLSHADE_DEVICE names. It stays open, and the latest scenes stay on it (see `release`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..base import validation
from ..base.arrays import Floats, Reals
from ..base.validation import value_error
from ..pipeline.opencl.device import Device, shared_device
from ..pipeline.renderer import Renderer
from ..pipeline.single_primitive import NOWHERE, Lookup, PointLighting, draw_triangle, light_point, reach
from ..scene.camera import Camera
from ..scene.formats import course_npy
from ..scene.formats.course_npy import only_mesh
from ..scene.formats.course_npy import save_course as save
from ..scene.geometry import vertex_normals
from ..scene.model import Material, Mesh, PointLight, Scene
from . import arguments as checked
from .arguments import Shader

__all__ = [
    "arguments",
    "bilerp",
    "calculate_normals",
    "gouraud_shading",
    "light",
    "release",
    "render_object",
    "render_object_map",
    "save",
    "shade_gouraud",
    "shade_phong",
]

_LARGE = 1 << 24  # pixels; after larger images the caches are released
_SURFACE = ("k_a", "k_d", "k_s", "n")
_lock = threading.RLock()  # setting a kernel's arguments is not atomic: one call at a time


# Single points


@checked.fitting
def light(
    point: ArrayLike, normal: ArrayLike, color: ArrayLike, cam_pos: ArrayLike,
    k_a: ArrayLike, k_d: ArrayLike, k_s: ArrayLike, n: float, l_pos: ArrayLike, l_int: ArrayLike,
) -> Floats:  # fmt: skip
    """Return the light that a surface point sends toward the eye, by Phong's model.

    Parameters
    ----------
    point, cam_pos : array_like, 3-vectors
        Positions of the point and of the eye, world space.
    normal, color : array_like, 3-vectors
        Normal of the surface, of any length, and its color, linear RGB.
    k_a : float or array_like
        Ambient coefficient times ambient intensity.
    k_d, k_s : float or array_like
        Diffuse and specular coefficients.
    n : float
        Specular exponent.
    l_pos, l_int : array_like, (L, 3)
        Positions in world space and linear RGB intensities of the lights.

    Returns
    -------
    ndarray of float64, (3,)
        Linear RGB, not clamped. See the module for the formula.
    """
    values = checked.values("light", locals())
    around = _surroundings("light", "point", values)
    with _lock:
        return light_point(shared_device(), around, values["normal"], values["color"])


def _surroundings(owner: str, name: str, values: dict[str, Any]) -> PointLighting:
    """Return the lights and the material at the point that has this name among the arguments."""
    surface = Material(*(values[field] for field in _SURFACE))
    around = PointLighting(values[name], values["cam_pos"], values["l_pos"], values["l_int"], surface)
    if not np.isfinite(reach(around)):
        raise value_error(owner, "cam_pos", f"a distance from {name} that float64 can hold", around.eye.tolist())
    return around


@checked.fitting
def bilerp(uv: ArrayLike, texture_map: ArrayLike) -> Floats:
    """Return the color of a texture at one point, interpolated bilinearly from four texels.

    Parameters
    ----------
    uv : array_like, (2,), (1, 2) or (2, 1)
        Texture coordinates: u to the right and v down the rows, clamped to [0, 1].
    texture_map : array_like, (h, w, 3)
        Texture; row 0 is v = 0. Floats are used as they are, integers divided by the maximum of
        their type.

    Returns
    -------
    ndarray of float64, (3,)
        The color.

    Notes
    -----
    With x = u*(w-1), x0 = floor(x) and x1 = min(x0+1, w-1), and the same for y, the color is a
    weighted mean of the texels at x0, x1 and y0, y1. The texture stays on the device for the next
    call with an equal one.
    """
    values = checked.values("bilerp", locals())
    with _lock:
        color: Floats = _lookups.get(shared_device(), values["texture_map"])(values["uv"])[0]
    return color


@checked.fitting
def calculate_normals(verts: ArrayLike, faces: ArrayLike) -> Floats:
    """Return unit vertex normals: normalized sums of the adjacent faces' cross products.

    Parameters
    ----------
    verts : array_like, (3, V)
        Positions.
    faces : array_like, (3, F)
        Indices into `verts`, counterclockwise as seen from outside.

    Returns
    -------
    ndarray of float64, (3, V)
        Normals; 0 at a vertex without faces or whose faces cancel. Computed on the host in float64.
    """
    mesh = checked.mesh("calculate_normals", locals())
    return np.ascontiguousarray(vertex_normals(mesh["verts"], mesh["faces"]).T)


# One triangle over an image


@checked.fitting
def gouraud_shading(verts_p: ArrayLike, verts_c: ArrayLike, X: ArrayLike) -> Floats:
    """Draw one triangle over an image, with interpolated corner colors and no light.

    Parameters
    ----------
    verts_p : array_like, (3, 2)
        Corners, one per row, in continuous image coordinates: u to the right and v up, in pixels;
        the center of column c, row r is (c+0.5, r+0.5). They may lie outside of the image, at any
        distance.
    verts_c : array_like, (3, 3)
        Colors of the corners, one per column, linear RGB.
    X : array_like, (M, N, 3)
        Image, row 0 at the bottom; not modified.

    Returns
    -------
    ndarray of float64, (M, N, 3)
        A new image.

    Notes
    -----
    A pixel is drawn if its center is inside the triangle, whose corners are rounded to 1/65536 pixel;
    for centers on an edge the top-left rule decides, so triangles that share an edge draw no pixel
    twice and leave none out.
    """
    values = checked.values("gouraud_shading", locals())
    image: Floats = values["X"]
    with _lock:
        colors = values["verts_c"].T
        draw_triangle(shared_device(), "nolight", values["verts_p"], np.zeros((3, 3)), colors, NOWHERE, image)
    return image


@checked.fitting
def shade_gouraud(
    verts_p: ArrayLike, verts_n: ArrayLike, verts_c: ArrayLike, bcoords: ArrayLike, cam_pos: ArrayLike,
    k_a: ArrayLike, k_d: ArrayLike, k_s: ArrayLike, n: float, l_pos: ArrayLike, l_int: ArrayLike,
    l_amb: ArrayLike, X: ArrayLike,
) -> Floats:  # fmt: skip
    """Draw one triangle over an image, lit at its corners, the light interpolated.

    Parameters
    ----------
    verts_p, verts_c, X : array_like
        See `gouraud_shading`.
    verts_n : array_like, (3, 3)
        Normals of the corners, one per column, of any length.
    bcoords : array_like, 3-vector
        The triangle's centroid in world space, from which the directions to eye and lights are
        taken.
    cam_pos, k_a, k_d, k_s, n, l_pos, l_int
        See `light`.
    l_amb : float or array_like
        Intensity of the ambient light; here it is multiplied by `k_a`.

    Returns
    -------
    ndarray of float64, (M, N, 3)
        A new image, not clamped.
    """
    return _shade("gouraud", locals())


@checked.fitting
def shade_phong(
    verts_p: ArrayLike, verts_n: ArrayLike, verts_c: ArrayLike, bcoords: ArrayLike, cam_pos: ArrayLike,
    k_a: ArrayLike, k_d: ArrayLike, k_s: ArrayLike, n: float, l_pos: ArrayLike, l_int: ArrayLike,
    l_amb: ArrayLike, X: ArrayLike,
) -> Floats:  # fmt: skip
    """Draw one triangle over an image, lit at each pixel, normals and colors interpolated.

    Parameters
    ----------
    verts_p, verts_n, verts_c, bcoords, cam_pos, k_a, k_d, k_s, n, l_pos, l_int, l_amb, X
        See `shade_gouraud`, also for the result. Normals are interpolated as given, then normalized.
    """
    return _shade("phong", locals())


def _shade(shader: Shader, arguments: dict[str, Any]) -> Floats:
    owner = f"shade_{shader}"
    values = checked.values(owner, arguments)
    values["k_a"] = values["k_a"] * values["l_amb"]
    around = _surroundings(owner, "bcoords", values)
    normals, colors = values["verts_n"].T, values["verts_c"].T
    image: Floats = values["X"]
    with _lock:
        draw_triangle(shared_device(), shader, values["verts_p"], normals, colors, around, image)
    return image


# Whole objects


@checked.fitting
def render_object(
    shader: Shader, focal: float, eye: ArrayLike, lookat: ArrayLike, up: ArrayLike,
    bg_color: ArrayLike, M: int, N: int, H: float, W: float,
    verts: ArrayLike, verts_colors: ArrayLike, faces: ArrayLike,
    k_a: ArrayLike, k_d: ArrayLike, k_s: ArrayLike, n: float, l_pos: ArrayLike, l_int: ArrayLike,
    light_amb: ArrayLike,
) -> Floats:  # fmt: skip
    """Draw an object with vertex colors, back to front.

    Parameters
    ----------
    shader : {"gouraud", "phong", "nolight"}
        Shader; ``"nolight"`` draws the colors themselves.
    focal : float
        Distance of the image plane from the eye, scene units.
    eye, lookat, up : array_like, 3-vectors
        Camera, world space.
    bg_color : float or array_like
        Background, linear RGB.
    M, N : int
        Rows and columns of the image, 1 to 16384.
    H, W : float
        Height and width of the image plane, scene units.
    verts : array_like, (3, V)
        Positions, world space.
    verts_colors : array_like, (3, V)
        Vertex colors, linear RGB.
    faces : array_like, (3, F)
        Indices into `verts`; at most 2**29 faces.
    k_a, k_d, k_s, n, l_pos, l_int
        See `light`; here `k_a` is the ambient coefficient alone.
    light_amb : float or array_like
        Intensity of the ambient light.

    Returns
    -------
    ndarray of float64, (M, N, 3)
        The image, row 0 at the bottom, not clamped: ``np.clip(image, 0, 1)`` clamps as the course
        does.

    Notes
    -----
    A triangle's depth is the mean depth of its corners; of equal depths the later face wins.
    Directions to eye and lights are taken at the triangle's centroid; normals, those of
    `calculate_normals`, and colors are interpolated in the image.

    Examples
    --------
    >>> import clshade
    >>> from clshade import course
    >>> image = course.render_object("phong", **course.arguments(clshade.builtin("course")))
    >>> image.shape
    (512, 512, 3)
    """
    return _render("render_object", locals())


@checked.fitting
def render_object_map(
    shader: Shader, focal: float, eye: ArrayLike, lookat: ArrayLike, up: ArrayLike,
    bg_color: ArrayLike, M: int, N: int, H: float, W: float,
    verts: ArrayLike, faces: ArrayLike, uvs: ArrayLike, uvs_faces: ArrayLike, texture_map: ArrayLike,
    k_a: ArrayLike, k_d: ArrayLike, k_s: ArrayLike, n: float, l_pos: ArrayLike, l_int: ArrayLike,
    light_amb: ArrayLike,
) -> Floats:  # fmt: skip
    """Draw an object with a texture, whose colors at the corners of the faces are interpolated.

    Parameters
    ----------
    shader, focal, eye, lookat, up, bg_color, M, N, H, W, verts, faces
        See `render_object`.
    uvs : array_like, (2, T)
        Texture coordinates.
    uvs_faces : array_like, (3, F)
        Indices into `uvs`, one per corner of each face.
    texture_map : array_like, (h, w, 3)
        Texture; row 0 is v = 0. Looked up as by `bilerp`.
    k_a, k_d, k_s, n, l_pos, l_int, light_amb
        See `render_object`, also for the result.
    """
    return _render("render_object_map", locals())


def _render(owner: str, arguments: dict[str, Any]) -> Floats:
    values = checked.values(owner, arguments)
    focal, *pose = (values[name] for name in ("focal", "eye", "lookat", "up"))
    rows, columns, height, width = (values[name] for name in "MNHW")
    camera = course_npy.camera(owner, pose, focal, (rows, columns), (height, width))
    mesh = checked.mesh(owner, values)
    geometry = [mesh.get(field) for field in ("verts", "faces", "colors", "uvs", "uv_faces")]
    look = [values[name] for name in (*_SURFACE, "l_pos", "l_int", "light_amb", "bg_color")]
    contents = (values["shader"], *geometry, values.get("texture_map"), *look)
    with _lock:
        image = _turned(_renderers.get(shared_device(), owner, *contents).render(camera).rgba)
        if image.size > 3 * _LARGE:
            release()
    return image


def _turned(rgba: Reals) -> Floats:
    """Return a frame's RGB, (M, N, 3) float64, row 0 at the bottom. Copied in strips, which stay in the cache."""
    source = rgba[::-1]
    image = np.empty((*rgba.shape[:2], 3))
    for row in range(0, len(image), 16):
        for channel in range(3):
            image[row : row + 16, :, channel] = source[row : row + 16, :, channel]
    return image


@validation.arguments(scene=Scene, textured=validation.flag)
def arguments(scene: Scene, textured: bool = False) -> dict[str, Any]:
    """Return the arguments of `render_object`, or of `render_object_map`, that draw a scene.

    Parameters
    ----------
    scene : Scene
        A course scene of one mesh, as returned by ``clshade.load`` and
        ``clshade.builtin("course")``.
    textured : bool, default False
        Return the arguments of `render_object_map`.

    Returns
    -------
    dict
        All arguments except `shader`, by name: ``render_object("phong", **arguments(scene))``.
        Arrays are 3xN, l_pos and l_int Lx3. A mesh without vertex colors is white.

    Raises
    ------
    InputError
        For other scenes, and for a missing texture.
    """
    mesh, camera = only_mesh(scene, "arguments"), scene.camera
    material, texture = mesh.material, mesh.material.texture
    values = {"focal": camera.focal, "eye": camera.eye, "lookat": camera.lookat, "up": camera.up}
    values |= {"bg_color": scene.background, "verts": mesh.verts.T, "faces": mesh.faces.T}
    (values["N"], values["M"]), (values["H"], values["W"]) = camera.resolution, camera.plane
    if not textured:
        values["verts_colors"] = (np.ones_like(mesh.verts) if mesh.colors is None else mesh.colors).T
    elif texture is None or mesh.uvs is None:
        raise value_error("arguments", "scene", "a mesh with a texture and texture coordinates", scene.name)
    else:
        uvs_faces = mesh.faces if mesh.uv_faces is None else mesh.uv_faces
        values |= {"uvs": mesh.uvs.T, "uvs_faces": uvs_faces.T, "texture_map": texture.image}
    values |= {"k_a": material.ka, "k_d": material.kd, "k_s": material.ks, "n": material.n}
    for name, field in (("l_pos", "position"), ("l_int", "intensity")):
        values[name] = np.array([getattr(light, field) for light in scene.lights]).reshape(-1, 3)
    return {**values, "light_amb": scene.ambient}


# Caches

T = TypeVar("T")


class ContentCache(Generic[T]):
    """The latest results of `make`; the oldest are dropped beyond `max_count`, and while their arrays hold more than
    `max_bytes`.

    make: called with the arguments, arrays copied so that the caller may modify its own afterwards.
    drop: called with each result that is dropped.
    """

    def __init__(
        self, make: Callable[..., T], drop: Callable[[T], Any], max_count: int = 4, max_bytes: int = 1 << 25
    ) -> None:
        self._make, self._drop, self._max_count, self._max_bytes = make, drop, max_count, max_bytes
        self._kept: list[tuple[tuple[Any, ...], T]] = []  # latest first

    def get(self, *arguments: Any) -> T:
        """Return the result for these arguments; arrays must be contiguous."""
        for place, (key, result) in enumerate(self._kept):
            if len(key) == len(arguments) and all(map(are_equal, key, arguments)):
                self._kept.insert(0, self._kept.pop(place))
                return result
        copies = tuple(item.copy() if isinstance(item, np.ndarray) else item for item in arguments)
        result = self._make(*copies)
        self._kept.insert(0, (copies, result))
        while len(self._kept) > 1 and (len(self._kept) > self._max_count or self._bytes() > self._max_bytes):
            self._drop(self._kept.pop()[1])
        return result

    def _bytes(self) -> int:
        return sum(item.nbytes for key, _ in self._kept for item in key if isinstance(item, np.ndarray))

    def clear(self) -> None:
        """Drop all results."""
        while self._kept:
            self._drop(self._kept.pop()[1])


def are_equal(a: Any, b: Any) -> bool:
    """Return whether two arguments are equal: arrays in type, shape and every bit, other values by type and ==."""
    if not (isinstance(a, np.ndarray) and isinstance(b, np.ndarray)):
        return type(a) is type(b) and bool(a == b)
    words = np.uint64 if a.nbytes % 8 == 0 else np.uint8
    is_alike = (a.dtype, a.shape) == (b.dtype, b.shape)
    return is_alike and np.array_equal(a.reshape(-1).view(words), b.reshape(-1).view(words))


def _make_renderer(device: Device, owner: str, shader: Shader, *contents: Any) -> Renderer:
    verts, faces, colors, uvs, uv_faces, texels, ka, kd, ks, n, positions, intensities, ambient, background = contents
    texture = None if texels is None else checked.texture(owner, texels)
    mesh = Mesh(verts, faces, colors, uvs=uvs, uv_faces=uv_faces, material=Material(ka, kd, ks, n, texture))
    lights = tuple(PointLight(*light) for light in zip(positions, intensities, strict=True))
    scene = Scene((mesh,), _ANYWHERE, lights, ambient, background, "course")
    return Renderer(scene, device=device, shader=shader)


_ANYWHERE = Camera(np.zeros(3), np.ones(3), np.array([0.0, 1.0, 0.0]), 1.0, (1.0, 1.0))  # each call brings its own
_renderers: ContentCache[Renderer] = ContentCache(_make_renderer, Renderer.close)
_lookups: ContentCache[Lookup] = ContentCache(
    lambda device, texels: Lookup(device, checked.texture("bilerp", texels)), lambda lookup: None, max_count=2
)


def release() -> None:
    """Release what is kept of the latest calls, for speed alone: scenes and textures on the device."""
    with _lock:
        _renderers.clear()
        _lookups.clear()
