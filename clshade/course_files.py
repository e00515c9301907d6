"""Course scenes: the .npy files of the seed course, read (`read_course`) and written (`save_course`)."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from . import course_pickle
from .atomic import Path, shown, write_bytes
from .camera import MAX_RESOLUTION, Camera
from .errors import InputError
from .images import as_texture
from .reading import complaint, read_file
from .scene import Material, Mesh, PointLight, Scene, Texture
from .validation import Array, coefficient, indices, integer, number, refuse, rows, vector

MAX_BYTES = 1 << 31  # of a course file
_WIDTHS = {"verts": 3, "vertex_colors": 3, "face_indices": 3, "uvs": 2, "face_uv_indices": 3}


class _Fields:
    """The checked values of one file; each method raises InputError `file: key: expected ..., found ...`."""

    def __init__(self, content: dict[str, Any], owner: str) -> None:
        self.content, self.owner = content, owner

    def get(self, key: str) -> Any:
        if key not in self.content:
            raise complaint(self.owner, key, "this key", "none")
        return course_pickle.value(self.owner, key, self.content[key])

    def number(self, key: str) -> float:
        return number(self.owner, key, self.get(key), above=0.0)

    def vector(self, key: str) -> Array:
        return vector(self.owner, key, self.get(key))

    def coefficient(self, key: str) -> Array:
        return coefficient(self.owner, key, self.get(key))

    def per_light(self, key: str) -> Array:
        """(L, 3) float64 from L x 3 numbers or a list of L 3-vectors; an empty one of any shape is L = 0."""
        array = np.asarray(self.get(key))
        if array.size == 0:
            return np.zeros((0, 3))
        if array.ndim == 3 and array.shape[1:] in ((1, 3), (3, 1)):
            array = array.reshape(-1, 3)
        return rows(self.owner, key, array, 3)


def read_course(
    path: Path, *, texture: Any = None, focal: Any = None, resolution: tuple[int, int] | None = None
) -> Scene:
    """The scene in a course file.

    texture: path of an image (value/255, not decoded from sRGB), array or Texture; it replaces the vertex colors.
    focal: distance of the image plane in place of the file's; needed for a file without one.
    resolution: (N, M) in place of the file's; the image plane keeps its height.

    A file's fields are checked even where an option replaces them. Unknown keys, `depth` among them, are ignored.
    `vertex_colors` may be missing where there are uvs. Raises InputError, one line, see clshade.loading.load.
    """
    owner = shown(path)
    content = course_pickle.unpack(read_file(path, MAX_BYTES), owner)
    fields = _Fields(content, owner)
    mesh = _mesh(fields, os.path.splitext(os.path.basename(os.fspath(path)))[0])
    ambient, background = fields.coefficient("Ia"), fields.coefficient("bg_color")
    camera = _camera(fields, focal)
    scene = Scene((mesh,), camera, _lights(fields), ambient, background, "course", mesh.name)
    if resolution is not None:
        scene = replace(scene, camera=camera.with_resolution(resolution))
    if texture is not None:
        if mesh.uvs is None:
            raise complaint(owner, "uvs", "texture coordinates for the texture", "none")
        material = replace(mesh.material, texture=as_texture(texture, srgb=False, lookup="course"))
        scene = replace(scene, meshes=(replace(mesh, material=material),))
    return scene


def _mesh(fields: _Fields, name: str) -> Mesh:
    owner, content = fields.owner, fields.content
    textured = "uvs" in content or "face_uv_indices" in content
    wanted = ["verts", "face_indices"]
    wanted += ["vertex_colors"] if "vertex_colors" in content or not textured else []
    wanted += ["uvs", "face_uv_indices"] if textured else []
    arrays = upright(owner, {key: fields.get(key) for key in wanted}, _WIDTHS)
    verts = rows(owner, "verts", arrays["verts"], 3)
    faces = indices(owner, "face_indices", arrays["face_indices"], len(verts))
    colors = uvs = uv_faces = None
    if "vertex_colors" in arrays:
        colors = rows(owner, "vertex_colors", arrays["vertex_colors"], 3)
        if len(colors) != len(verts):
            raise complaint(owner, "vertex_colors", f"one color per vertex ({len(verts)})", str(len(colors)))
    if "uvs" in arrays:
        uvs = rows(owner, "uvs", arrays["uvs"], 2, finite=False)
        uv_faces = indices(owner, "face_uv_indices", arrays["face_uv_indices"], len(uvs))
        if len(uv_faces) != len(faces):
            raise complaint(owner, "face_uv_indices", f"one triple per face ({len(faces)})", str(len(uv_faces)))
    ka, kd, ks = (fields.coefficient(key) for key in ("ka", "kd", "ks"))
    exponent = number(owner, "n", fields.get("n"), least=0.0, expected="a number from 0 to 1e9")
    if exponent > 1e9:
        raise refuse(owner, "n", "a number from 0 to 1e9", exponent)
    return Mesh(verts, faces, colors, uvs=uvs, uv_faces=uv_faces, material=Material(ka, kd, ks, exponent), name=name)


def upright(owner: str, arrays: dict[str, Any], widths: Mapping[str, int]) -> dict[str, Array]:
    """All arrays with a row per item, as views: each may come as w x N or N x w, the same for all that show which.

    widths: w of each array. Where all are square, they are w x N. Raises InputError, with `owner` and the array's name.
    """
    shown_by: dict[bool, str] = {}  # whether w x N, and the first array that shows it
    for key, array in arrays.items():
        width = widths[key]
        if not isinstance(array, np.ndarray) or array.ndim != 2 or width not in array.shape:
            raise refuse(owner, key, f"an array of shape ({width}, N) or (N, {width})", array)
        if array.shape != (width, width):
            shown_by.setdefault(array.shape[0] == width, key)
    if len(shown_by) == 2:
        rows_key, columns_key = shown_by[False], shown_by[True]
        width = widths[rows_key]
        raise refuse(owner, rows_key, f"shape ({width}, N), the layout of {columns_key}", arrays[rows_key])
    return {key: array if False in shown_by else array.T for key, array in arrays.items()}


def _camera(fields: _Fields, focal: Any) -> Camera:
    owner = fields.owner
    eye, up, lookat = (fields.vector(f"cam_{name}") for name in ("eye", "up", "lookat"))
    count_rows, columns = (integer(owner, key, fields.get(key), 1, MAX_RESOLUTION) for key in ("M", "N"))
    plane = fields.number("H"), fields.number("W")
    if "focal" in fields.content or focal is None:
        found = fields.number("focal")
    distance = found if focal is None else number("load", "focal", focal, above=0.0)
    try:
        return Camera(eye, lookat, up, distance, plane, (columns, count_rows))
    except InputError as error:
        raise InputError(f"{owner}: cam_{str(error).removeprefix('Camera: ')}") from None


def _lights(fields: _Fields) -> tuple[PointLight, ...]:
    positions, intensities = fields.per_light("light_positions"), fields.per_light("light_intensities")
    if len(positions) != len(intensities):
        expected = f"one row per light of light_positions ({len(positions)})"
        raise complaint(fields.owner, "light_intensities", expected, str(len(intensities)))
    return tuple(PointLight(position, intensity) for position, intensity in zip(positions, intensities, strict=True))


def save_course(scene: Scene, path: Path) -> None:
    """Write a course scene as a course .npy file (3xN layout, face indices int64), whole or not at all.

    `load(path)` then gives the same arrays, bit for bit: those of one mesh, camera, lights and material. Names are not
    kept; vertex colors of None are written as ones, and uv_faces of None as the faces.

    Raises InputError for what the format cannot hold: another preset, several meshes or instances, a placement, given
    normals, a texture (its image is a file apart), no background. Raises OutputError when the file cannot be written.
    """
    owner = "save_course"
    if not os.fspath(path).lower().endswith(".npy"):
        raise complaint(owner, "path", "a name ending in .npy", shown(path))
    mesh = _only_mesh(scene, owner)
    camera, material = scene.camera, mesh.material
    content: dict[str, Any] = {
        "verts": mesh.verts.T,
        "vertex_colors": (np.ones_like(mesh.verts) if mesh.colors is None else mesh.colors).T,
        "face_indices": mesh.faces.astype(np.int64).T,
    }
    if mesh.uvs is not None:
        uv_faces = mesh.faces if mesh.uv_faces is None else mesh.uv_faces
        content.update(uvs=mesh.uvs.T, face_uv_indices=uv_faces.astype(np.int64).T)
    content.update(cam_eye=camera.eye, cam_up=camera.up, cam_lookat=camera.lookat)
    for name in ("ka", "kd", "ks"):
        channels = getattr(material, name)
        content[name] = float(channels[0]) if len({value.tobytes() for value in channels}) == 1 else channels
    content["n"] = int(material.n) if material.n.is_integer() and material.n > 0 else material.n
    content["light_positions"] = [light.position for light in scene.lights]
    content["light_intensities"] = [light.intensity for light in scene.lights]
    columns, count_rows = camera.resolution
    height, width = camera.plane
    content.update(Ia=scene.ambient, M=count_rows, N=columns, W=width, H=height)
    content.update(bg_color=scene.background, focal=camera.focal)
    for name, item in content.items():
        if isinstance(item, np.ndarray):
            content[name] = np.ascontiguousarray(item)
    buffer = io.BytesIO()
    np.save(buffer, np.array(content, dtype=object), allow_pickle=True)
    write_bytes(path, buffer.getbuffer())


def _only_mesh(scene: Scene, owner: str) -> Mesh:
    """The mesh of a scene that a course file can hold. Raises InputError for any other scene."""
    if scene.preset != "course":
        raise refuse(owner, "scene.preset", "course", scene.preset)
    if len(scene.meshes) != 1:
        raise complaint(owner, "scene.meshes", "one mesh", str(len(scene.meshes)))
    if scene.background is None:
        raise refuse(owner, "scene.background", "a color", None)
    mesh = scene.meshes[0]
    if not np.array_equal(np.asarray(mesh.instances), np.eye(4)[None]):
        raise complaint(owner, "mesh.instances", "one identity", "a placement or several")
    if mesh.normals is not None:
        raise complaint(owner, "mesh.normals", "None: course scenes compute them", "normals")
    if isinstance(mesh.material.texture, Texture):
        raise complaint(owner, "mesh.material.texture", "None: the image is a file apart", "a texture")
    return mesh
