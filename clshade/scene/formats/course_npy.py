"""Course scenes: reading (`read_course`) and writing (`save_course`) the .npy files of the seed course."""

from __future__ import annotations

import io
import os
from dataclasses import replace
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown, write_bytes
from ...base.input_files import file_error, read_file
from ...base.validation import arguments, coefficient, number, value_error
from ...base.validation import path as checked_path
from ..camera import Camera
from ..lights import plain_lights
from ..model import Material, Mesh, PointLight, Scene, Texture
from . import course_values as values
from . import safe_pickle
from .options import Options

MAX_BYTES = 1 << 31  # of a course file
MAX_LIGHTS = 1 << 15  # a light takes far longer to create than its few bytes take to read
_NAMES = {
    "verts": "verts",
    "colors": "vertex_colors",
    "faces": "face_indices",
    "uvs": "uvs",
    "uv_faces": "face_uv_indices",
}


class _Fields:
    """Checked values of one file; each method raises InputError `file: key: expected ..., found ...`."""

    def __init__(self, content: safe_pickle.Content, owner: str) -> None:
        self.content, self.owner = content, owner

    def get(self, key: str) -> Any:
        if key not in self.content:
            raise file_error(self.owner, key, "this key", "none")
        return self.content.value(key)

    def coefficient(self, key: str) -> Array:
        return coefficient(self.owner, key, self.get(key))


@safe_pickle.paused_collection()
def read_course(path: Path, options: Options) -> Scene:
    """Read a course file.

    options.texture replaces the vertex colors. options.focal is required for a file without one.

    A file's fields are checked even where an option replaces them. Unknown keys, including `depth`, are ignored.
    `vertex_colors` may be missing if there are uvs.
    """
    owner = shown(path)
    content = safe_pickle.unpack(read_file(path, MAX_BYTES), owner)
    fields = _Fields(content, owner)
    mesh = _mesh(fields, os.path.splitext(os.path.basename(os.fspath(path)))[0])
    ambient, background = fields.coefficient("Ia"), fields.coefficient("bg_color")
    camera = _camera(fields, options.focal)
    scene = Scene((mesh,), camera, _lights(fields), ambient, background, "course", mesh.name)
    if options.texture is not None:
        if mesh.uvs is None:
            raise file_error(owner, "uvs", "texture coordinates for the texture", "none")
        material = replace(mesh.material, texture=options.texture)
        scene = replace(scene, meshes=(replace(mesh, material=material),))
    return options.applied(scene)


def _mesh(fields: _Fields, name: str) -> Mesh:
    textured = "uvs" in fields.content or "face_uv_indices" in fields.content
    wanted = ["verts", "faces"]
    wanted += ["colors"] if "vertex_colors" in fields.content or not textured else []
    wanted += ["uvs", "uv_faces"] if textured else []
    given = {field: fields.get(_NAMES[field]) for field in wanted}
    arrays = values.mesh_fields(fields.owner, _NAMES, given, finite_uvs=False)
    ka, kd, ks = (fields.coefficient(key) for key in ("ka", "kd", "ks"))
    return Mesh(**arrays, material=Material(ka, kd, ks, values.exponent(fields.owner, fields.get("n"))), name=name)


def _camera(fields: _Fields, focal: float | None) -> Camera:
    pose = [fields.get(f"cam_{name}") for name in ("eye", "lookat", "up")]
    size, plane = (fields.get("M"), fields.get("N")), (fields.get("H"), fields.get("W"))
    # The file's value is checked even if it is replaced.
    if "focal" in fields.content or focal is None:
        own = number(fields.owner, "focal", fields.get("focal"), above=0.0)
        focal = own if focal is None else focal
    return values.camera(fields.owner, pose, focal, size, plane, prefix="cam_")


def _lights(fields: _Fields) -> tuple[PointLight, ...]:
    names = ("light_positions", "light_intensities")
    given = values.lights(fields.owner, names, *(fields.get(name) for name in names))
    if len(given[0]) > MAX_LIGHTS:
        raise value_error(fields.owner, names[0], f"at most {MAX_LIGHTS} lights", len(given[0]))
    return tuple(PointLight(*light) for light in zip(*given, strict=True))


@arguments(scene=Scene, path=checked_path)
def save_course(scene: Scene, path: Path) -> None:
    """Write a course scene to a course .npy file, atomically.

    Parameters
    ----------
    scene : Scene
        A scene of the preset `course` with one mesh.
    path : str or path-like
        File, with a name that ends in .npy; an existing one is replaced.

    Raises
    ------
    InputError
        The format cannot hold the scene: another preset, several meshes or instances, a placement,
        given normals, a texture (its image is a separate file), no background, lights other than
        points without attenuation.
    OutputError
        The file cannot be written.

    Notes
    -----
    The layout is 3xN, with int64 face indices. `load(path)` then gives the same arrays, bit for
    bit: those of one mesh, camera, lights and material. Names are not kept; vertex colors of None
    are written as ones, and uv_faces of None as the faces.
    """
    owner = "save_course"
    if not os.fspath(path).lower().endswith(".npy"):
        raise file_error(owner, "path", "a name ending in .npy", shown(path))
    mesh = only_mesh(scene, owner)
    if isinstance(mesh.material.texture, Texture):
        raise file_error(owner, "mesh.material.texture", "None: the image is a file apart", "a texture")
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
    lights = plain_lights(owner, scene.lights)
    content["light_positions"] = [light.position for light in lights]
    content["light_intensities"] = [light.intensity for light in lights]
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


def only_mesh(scene: Scene, owner: str) -> Mesh:
    """Return the mesh of a scene that the course's functions can draw. Raises InputError for any other scene."""
    if scene.preset != "course":
        raise value_error(owner, "scene.preset", "course", scene.preset)
    if len(scene.meshes) != 1:
        raise file_error(owner, "scene.meshes", "one mesh", str(len(scene.meshes)))
    if scene.background is None:
        raise value_error(owner, "scene.background", "a color", None)
    mesh = scene.meshes[0]
    if not np.array_equal(np.asarray(mesh.instances), np.eye(4)[None]):
        raise file_error(owner, "mesh.instances", "one identity", "a placement or several")
    if mesh.normals is not None:
        raise file_error(owner, "mesh.normals", "None: course scenes compute them", "normals")
    return mesh
