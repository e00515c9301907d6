"""The functions of the course's assignments, with its names, argument order and array shapes, run by OpenCL kernels.

Images are (M, N, 3) float64 with row 0 at the BOTTOM, linear and never clamped: values above 1 are kept. To show or
save one as 8 bits as the course does, turn it and clamp it: `np.clip(image[::-1], 0.0, 1.0)`.

Shapes. `verts`, `verts_colors`, `faces`, `uvs`, `uvs_faces` are 3xN (2xN), a column per item; they may all come
transposed, which any of them that is not square shows. `l_pos` and `l_int` are Lx3, rows are lights, or lists of L
3-vectors, or one 3-vector each for one light; L may be 0. `verts_p` is 3x2, rows are corners; `verts_n` and `verts_c`
are 3x3, columns are corners. 3-vectors come as (3,), (1, 3) or (3, 1). k_a, k_d, k_s, light_amb and bg_color are
numbers or 3-vectors; one of the first three that is 0 is left out of the kernel. The exponent n is from 0 to 1e9.

Light, for a point P with unit normal N, V towards the eye, L towards a light, R = 2N(N.L) - L, per channel:
`I = ka*Ia + sum over lights of Ip * color * (kd*max(0, N.L) + ks*(R.V)^n)`, the highlight only where N.L > 0 and
R.V > 0 (B. T. Phong, "Illumination for computer generated pictures", CACM 18(6), 1975). A normal of 0, a light at P or
an eye at P contributes 0.

Objects that hold several arguments, such as a material or lights, are passed by their numbers. Arguments that do not
fit are answered with those that are expected, in their order, and with what was found in the place of each; that error
is a TypeError as well.

Every function raises `clshade.errors.InputError`, a ValueError that names the function, the argument, what was expected
and what was found, for wrong shapes, indices out of range, NaN or infinite values and unknown shaders, before anything
is allocated; and `clshade.errors.DeviceError` where no OpenCL device works. The device is the default one, or the one
that the environment variable CLSHADE_DEVICE names, and stays open; the last scenes stay on it (see `release`).
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Array, Floats, Reals
from ..base.validation import choice, coefficient, value_error, vector
from ..pipeline.opencl.device import Device, shared_device
from ..pipeline.renderer import Renderer
from ..pipeline.single_primitive import NOWHERE, Lookup, PointLighting, draw_triangle, light_point, reach
from ..scene.camera import Camera
from ..scene.formats import course_values
from ..scene.formats.course_npy import only_mesh
from ..scene.formats.course_npy import save_course as save
from ..scene.geometry import vertex_normals
from ..scene.model import Material, Mesh, PointLight, Scene
from ..scene.settings import SHADERS, Shader
from . import arguments as checked
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

_LARGE = 1 << 24  # pixels: the memory of such an image is not kept for the next
_Vectors = tuple[ArrayLike, ArrayLike, ArrayLike]  # eye, lookat, up
_View = tuple[_Vectors, float, tuple[int, int], tuple[float, float]]  # and focal, (M, N), (H, W)
_Surface = tuple[ArrayLike, ArrayLike, ArrayLike, float]  # k_a, k_d, k_s, n
_Lights = tuple[ArrayLike, ArrayLike]  # l_pos, l_int
_lock = threading.RLock()  # kernels take their arguments one after the other: one call at a time


# Single points


@checked.fitting
def light(
    point: ArrayLike, normal: ArrayLike, color: ArrayLike, cam_pos: ArrayLike,
    k_a: ArrayLike, k_d: ArrayLike, k_s: ArrayLike, n: float, l_pos: ArrayLike, l_int: ArrayLike,
) -> Floats:  # fmt: skip
    """The light that a point of a surface sends to the eye.

    point, cam_pos: 3-vectors, world space. normal: 3-vector of any length. color: 3-vector, linear RGB, of the surface.
    k_a: ambient coefficient times ambient intensity. k_d, k_s, n: diffuse and specular coefficient, exponent.
    l_pos, l_int: (L, 3), positions in world space and linear RGB intensities of the lights.

    Returns (3,) float64, linear RGB, not clamped. See the module for the formula and for what is raised.
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
    """The color of a texture at one place, by bilinear interpolation of the four texels around it.

    uv: 2 numbers, (2,), (1, 2) or (2, 1): u to the right and v down the rows, held to [0, 1].
    texture_map: (h, w, 3), row 0 is v = 0; floats as they are, integers divided by their type's maximum.

    With x = u*(w-1) and x0 = floor(x), x1 = min(x0+1, w-1), the same for y: a mean of the texels at x0, x1 and y0, y1.
    Returns (3,) float64. The texture stays on the device for the next call with an equal one.
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
    """Unit normals at the vertices of a mesh: the sum of the cross products of the faces around each, normalized.

    verts: (3, V) positions. faces: (3, F) indices into verts, counter-clockwise seen from outside.
    Returns (3, V) float64; 0 at a vertex without faces or whose faces cancel. Computed on the host in float64.
    """
    given = checked.mesh("calculate_normals", verts=verts, faces=faces)
    return np.ascontiguousarray(vertex_normals(given["verts"], given["faces"]).T)


# One triangle over an image


@checked.fitting
def gouraud_shading(verts_p: ArrayLike, verts_c: ArrayLike, X: ArrayLike) -> Floats:
    """One triangle over an image, its corners' colors interpolated, without light.

    verts_p: (3, 2), rows are corners, continuous image coordinates u to the right and v up in pixels: the center of
        column c, row r is (c+0.5, r+0.5). They may lie outside of the image, as far as they like.
    verts_c: (3, 3), columns are corners, linear RGB. X: (M, N, 3), row 0 at the bottom; it is not changed.

    Returns a new (M, N, 3) float64 image. A pixel is drawn if its center is inside, corners rounded to 1/256 pixel, on
    an edge by the top-left rule: triangles that share an edge draw no pixel twice and leave none out.
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
    """One triangle over an image, lit at its corners, the light interpolated.

    verts_p, verts_c, X: as for `gouraud_shading`. verts_n: (3, 3), columns are the corners' normals, of any length.
    bcoords: 3-vector, the triangle's center of mass in world space, from which the directions to eye and lights are
        taken. cam_pos, k_a, k_d, k_s, n, l_pos, l_int: as for `light`. l_amb: intensity of the ambient light, by which
        k_a is multiplied here.

    Returns a new (M, N, 3) float64 image, not clamped.
    """
    surface, lights = (k_a, k_d, k_s, n), (l_pos, l_int)
    return _shade("gouraud", (verts_p, verts_n, verts_c), bcoords, cam_pos, surface, lights, l_amb, X)


@checked.fitting
def shade_phong(
    verts_p: ArrayLike, verts_n: ArrayLike, verts_c: ArrayLike, bcoords: ArrayLike, cam_pos: ArrayLike,
    k_a: ArrayLike, k_d: ArrayLike, k_s: ArrayLike, n: float, l_pos: ArrayLike, l_int: ArrayLike,
    l_amb: ArrayLike, X: ArrayLike,
) -> Floats:  # fmt: skip
    """One triangle over an image, normals and colors interpolated, lit at each pixel.

    The arguments are those of `shade_gouraud`. Normals are interpolated as they are given, then normalized.
    Returns a new (M, N, 3) float64 image, not clamped.
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
    """The image of an object with vertex colors, painted back to front.

    shader: gouraud, phong, or nolight (the colors themselves).
    focal: distance of the image plane from the eye, scene units. eye, lookat, up: 3-vectors, world space.
    bg_color: linear RGB. M, N: rows and columns of the image, 1 to 16384. H, W: height and width of the image plane,
        scene units.
    verts: (3, V) positions. verts_colors: (3, V) linear RGB. faces: (3, F) indices into verts, up to 2**24 faces.
    k_a, k_d, k_s, n: coefficients and exponent. l_pos, l_int: (L, 3). light_amb: intensity of the ambient light.

    A triangle's depth is the mean depth of its corners; of equal ones the later face is seen. Directions to eye and
    lights are taken at the triangle's center of mass; normals, those of `calculate_normals`, and colors are
    interpolated in the image.
    Returns (M, N, 3) float64, row 0 at the bottom, not clamped: `np.clip(image, 0, 1)` clamps as the course does.
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
    """The image of an object with a texture, whose colors at the corners of the faces are interpolated.

    uvs: (2, T) texture coordinates. uvs_faces: (3, F) indices into uvs, for each corner of each face.
    texture_map: (h, w, 3), row 0 is v = 0, looked up as by `bilerp`. The other arguments and what is returned are those
    of `render_object`.
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
    camera = course_values.camera(owner, *view)
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
    """RGB of a frame, (M, N, 3) float64, row 0 at the bottom. In strips, which stay in the cache."""
    source = rgba[::-1]
    image = np.empty((*rgba.shape[:2], 3))
    for row in range(0, len(image), 16):
        for channel in range(3):
            image[row : row + 16, :, channel] = source[row : row + 16, :, channel]
    return image


def arguments(scene: Scene, textured: bool = False) -> dict[str, Any]:
    """What draws a scene: `render_object("phong", **arguments(scene))`, or render_object_map's if textured.

    scene: a course scene of one mesh, as `clshade.load` and `clshade.builtin("course")` give. Without vertex colors it
    is white. Arrays are 3xN, l_pos and l_int Lx3. Raises InputError for other scenes, and for a missing texture.
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


# What stays for the next call


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
    """Gives back what is kept of the last calls: scenes and textures on the device. Only speed depends on it."""
    with _lock:
        _renderers.clear()
        _lookups.clear()
