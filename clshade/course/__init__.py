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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base import validation
from ..base.arrays import Array, Floats, Reals
from ..base.validation import choice, coefficient, value_error, vector
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
from .arguments import SHADERS, Shader
from .content_cache import ContentCache

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
_Vectors = tuple[ArrayLike, ArrayLike, ArrayLike]  # eye, lookat, up
_View = tuple[_Vectors, float, tuple[int, int], tuple[float, float]]  # and focal, (M, N), (H, W)
_Surface = tuple[ArrayLike, ArrayLike, ArrayLike, float]  # k_a, k_d, k_s, n
_Lights = tuple[ArrayLike, ArrayLike]  # l_pos, l_int
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
    point : array_like, 3-vector
        Position of the point, world space.
    normal : array_like, 3-vector
        Normal of the surface, of any length.
    color : array_like, 3-vector
        Color of the surface, linear RGB.
    cam_pos : array_like, 3-vector
        Position of the eye, world space.
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

    Raises
    ------
    InputError
        If an argument is refused, see the module.
    DeviceError
        If no OpenCL device works.
    """
    owner = "light"
    direction, tint = vector(owner, "normal", normal), vector(owner, "color", color)
    around = _surroundings(owner, ("point", point), cam_pos, (k_a, k_d, k_s, n), (l_pos, l_int))
    with _lock:
        return light_point(shared_device(), around, direction, tint)


def _surroundings(
    owner: str, point: tuple[str, ArrayLike], eye: ArrayLike, surface: _Surface, lights: _Lights
) -> PointLighting:
    name, place = point
    around = PointLighting(
        vector(owner, name, place),
        vector(owner, "cam_pos", eye),
        *checked.lights(owner, *lights),
        checked.material(owner, *surface),
    )
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

    Raises
    ------
    InputError
        If an argument is refused, see the module.
    DeviceError
        If no OpenCL device works.

    Notes
    -----
    With x = u*(w-1), x0 = floor(x) and x1 = min(x0+1, w-1), and the same for y, the color is a
    weighted mean of the texels at x0, x1 and y0, y1. The texture stays on the device for the next
    call with an equal one.
    """
    owner = "bilerp"
    place = checked.array(owner, "uv", uv)
    if place.shape not in ((2,), (1, 2), (2, 1)) or not np.isfinite(place).all():
        raise value_error(owner, "uv", "two finite numbers", uv)
    image = checked.texel_array(owner, texture_map)
    with _lock:
        color: Floats = _lookups.get(shared_device(), image)(place.reshape(1, 2).astype(np.float64))[0]
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

    Raises
    ------
    InputError
        If an argument is refused, see the module.
    """
    given = checked.mesh("calculate_normals", verts=verts, faces=faces)
    return np.ascontiguousarray(vertex_normals(given["verts"], given["faces"]).T)


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

    Raises
    ------
    InputError
        If an argument is refused, see the module.
    DeviceError
        If no OpenCL device works.

    Notes
    -----
    A pixel is drawn if its center is inside the triangle, whose corners are rounded to 1/65536 pixel;
    for centers on an edge the top-left rule decides, so triangles that share an edge draw no pixel
    twice and leave none out.
    """
    owner = "gouraud_shading"
    corners = checked.corners(owner, "verts_p", verts_p, (3, 2))
    colors = checked.corners(owner, "verts_c", verts_c, (3, 3)).T
    image = checked.image(owner, X)
    with _lock:
        draw_triangle(shared_device(), "nolight", corners, np.zeros((3, 3)), colors, NOWHERE, image)
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

    Raises
    ------
    InputError
        If an argument is refused, see the module.
    DeviceError
        If no OpenCL device works.
    """
    surface, lights = (k_a, k_d, k_s, n), (l_pos, l_int)
    return _shade("gouraud", (verts_p, verts_n, verts_c), bcoords, cam_pos, surface, lights, l_amb, X)


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
        See `shade_gouraud`. Normals are interpolated as given, then normalized.

    Returns
    -------
    ndarray of float64, (M, N, 3)
        A new image, not clamped.

    Raises
    ------
    InputError
        If an argument is refused, see the module.
    DeviceError
        If no OpenCL device works.
    """
    surface, lights = (k_a, k_d, k_s, n), (l_pos, l_int)
    return _shade("phong", (verts_p, verts_n, verts_c), bcoords, cam_pos, surface, lights, l_amb, X)


def _shade(
    shader: Shader,
    triangle: tuple[ArrayLike, ArrayLike, ArrayLike],
    bcoords: ArrayLike,
    cam_pos: ArrayLike,
    surface: _Surface,
    lights: _Lights,
    l_amb: ArrayLike,
    X: ArrayLike,
) -> Floats:
    owner = f"shade_{shader}"
    verts_p, verts_n, verts_c = triangle
    k_a, k_d, k_s, n = surface
    corners = checked.corners(owner, "verts_p", verts_p, (3, 2))
    normals = checked.corners(owner, "verts_n", verts_n, (3, 3)).T
    colors = checked.corners(owner, "verts_c", verts_c, (3, 3)).T
    ambient = coefficient(owner, "k_a", k_a) * coefficient(owner, "l_amb", l_amb)
    around = _surroundings(owner, ("bcoords", bcoords), cam_pos, (ambient, k_d, k_s, n), lights)
    image = checked.image(owner, X)
    with _lock:
        draw_triangle(shared_device(), shader, corners, normals, colors, around, image)
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
    k_a, k_d, k_s : float or array_like
        Ambient, diffuse and specular coefficients.
    n : float
        Specular exponent.
    l_pos, l_int : array_like, (L, 3)
        Positions in world space and linear RGB intensities of the lights.
    light_amb : float or array_like
        Intensity of the ambient light.

    Returns
    -------
    ndarray of float64, (M, N, 3)
        The image, row 0 at the bottom, not clamped: ``np.clip(image, 0, 1)`` clamps as the course
        does.

    Raises
    ------
    InputError
        If an argument is refused, see the module.
    DeviceError
        If no OpenCL device works.

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
    view = ((eye, lookat, up), focal, (M, N), (H, W))
    mesh = {"verts": verts, "colors": verts_colors, "faces": faces}
    surface, lights = (k_a, k_d, k_s, n), (l_pos, l_int)
    return _render("render_object", shader, view, mesh, None, surface, lights, light_amb, bg_color)


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
        See `render_object`.

    Returns
    -------
    ndarray of float64, (M, N, 3)
        The image, see `render_object`.

    Raises
    ------
    InputError
        If an argument is refused, see the module.
    DeviceError
        If no OpenCL device works.
    """
    owner = "render_object_map"
    view = ((eye, lookat, up), focal, (M, N), (H, W))
    mesh = {"verts": verts, "faces": faces, "uvs": uvs, "uv_faces": uvs_faces}
    surface, lights = (k_a, k_d, k_s, n), (l_pos, l_int)
    texels = checked.texel_array(owner, texture_map)
    return _render(owner, shader, view, mesh, texels, surface, lights, light_amb, bg_color)


def _render(
    owner: str,
    shader: Shader,
    view: _View,
    mesh: dict[str, ArrayLike],
    texels: Array | None,
    surface: _Surface,
    lights: _Lights,
    light_amb: ArrayLike,
    bg_color: ArrayLike,
) -> Floats:
    choice(owner, "shader", shader, SHADERS)
    camera = course_npy.camera(owner, *view)
    given = checked.mesh(owner, **mesh)
    geometry = [given.get(field) for field in ("verts", "faces", "colors", "uvs", "uv_faces")]
    material = checked.material(owner, *surface)
    around = (*checked.lights(owner, *lights), coefficient(owner, "light_amb", light_amb))
    background = coefficient(owner, "bg_color", bg_color)
    coefficients = (material.ka, material.kd, material.ks, material.n)
    with _lock:
        renderer = _renderers.get(shared_device(), owner, shader, *geometry, texels, *coefficients, *around, background)
        image = _turned(renderer.render(camera).rgba)
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
    given = {"focal": camera.focal, "eye": camera.eye, "lookat": camera.lookat, "up": camera.up}
    given |= {"bg_color": scene.background, "verts": mesh.verts.T, "faces": mesh.faces.T}
    (given["N"], given["M"]), (given["H"], given["W"]) = camera.resolution, camera.plane
    if not textured:
        given["verts_colors"] = (np.ones_like(mesh.verts) if mesh.colors is None else mesh.colors).T
    elif texture is None or mesh.uvs is None:
        raise value_error("arguments", "scene", "a mesh with a texture and texture coordinates", scene.name)
    else:
        uvs_faces = mesh.faces if mesh.uv_faces is None else mesh.uv_faces
        given |= {"uvs": mesh.uvs.T, "uvs_faces": uvs_faces.T, "texture_map": texture.image}
    given |= {"k_a": material.ka, "k_d": material.kd, "k_s": material.ks, "n": material.n}
    for name, field in (("l_pos", "position"), ("l_int", "intensity")):
        given[name] = np.array([getattr(light, field) for light in scene.lights]).reshape(-1, 3)
    return {**given, "light_amb": scene.ambient}


# Caches


def _make_renderer(device: Device, owner: str, shader: Shader, *given: Any) -> Renderer:
    verts, faces, colors, uvs, uv_faces, texels, ka, kd, ks, n, positions, intensities, ambient, background = given
    texture = None if texels is None else checked.texture(owner, texels)
    mesh = Mesh(verts, faces, colors, uvs=uvs, uv_faces=uv_faces, material=Material(ka, kd, ks, n, texture))
    lights = tuple(PointLight(*light) for light in zip(positions, intensities, strict=True))
    scene = Scene((mesh,), _ANYWHERE, lights, ambient, background, "course")
    return Renderer(scene, device=device, shader=shader)


def _make_lookup(device: Device, texels: Array) -> Lookup:
    return Lookup(device, checked.texture("bilerp", texels))


_ANYWHERE = Camera(np.zeros(3), np.ones(3), np.array([0.0, 1.0, 0.0]), 1.0, (1.0, 1.0))  # each call brings its own
_renderers: ContentCache[Renderer] = ContentCache(_make_renderer, Renderer.close)
_lookups: ContentCache[Lookup] = ContentCache(_make_lookup, lambda lookup: None, most=2)


def release() -> None:
    """Release what is kept of the latest calls: scenes and textures on the device.

    Only speed depends on it.
    """
    with _lock:
        _renderers.clear()
        _lookups.clear()
