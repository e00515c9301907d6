"""Course scenes: reading (`read_course`) and writing (`save_course`) the .npy files of the seed course, and the checks
that files share with the course's functions, under the names that each uses.

Every error is an `InputError` of the form `owner: name: expected ..., found ...`.
"""

from __future__ import annotations

import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...base.arrays import Floats
from ...base.atomic_files import Path, shown, write_bytes
from ...base.input_files import file_error, read_file
from ...base.validation import arguments, coefficient, floats, indices, integer, number, rows, value_error, vector
from ...base.validation import path as checked_path
from ...errors import InputError
from ..camera import MAX_RESOLUTION, Camera
from ..lights import plain_lights
from ..model import MAX_FACES, Material, Mesh, PointLight, Scene, Texture
from . import safe_pickle
from .reading import Options, name_of

MAX_BYTES = 1 << 31  # of a course file
MAX_LIGHTS = 1 << 15  # a light takes far longer to create than its few bytes take to read
_NAMES = {
    "verts": "verts",
    "colors": "vertex_colors",
    "faces": "face_indices",
    "uvs": "uvs",
    "uv_faces": "face_uv_indices",
}
_WIDTHS = {"verts": 3, "colors": 3, "faces": 3, "uvs": 2, "uv_faces": 3}


@safe_pickle.paused_collection()
def read_course(path: Path, options: Options) -> Scene:
    """Read a course file.

    options.texture replaces the vertex colors. options.focal is required for a file without one.

    A file's fields are checked even where an option replaces them. Unknown keys, including `depth`, are ignored.
    `vertex_colors` may be missing if there are uvs.
    """
    owner = shown(path)
    file = safe_pickle.unpack(read_file(path, MAX_BYTES), owner)

    def color(key: str) -> Floats:
        return coefficient(owner, key, file.value(key))

    textured = "uvs" in file or "face_uv_indices" in file
    names = ["verts", "faces"]
    names += ["colors"] if "vertex_colors" in file or not textured else []
    names += ["uvs", "uv_faces"] if textured else []
    arrays = mesh_fields(owner, _NAMES, {name: file.value(_NAMES[name]) for name in names}, finite_uvs=False)
    material = Material(color("ka"), color("kd"), color("ks"), exponent(owner, file.value("n")))
    mesh = Mesh(**arrays, material=material, name=name_of(path))
    ambient, background = color("Ia"), color("bg_color")
    pose = [file.value(f"cam_{name}") for name in ("eye", "lookat", "up")]
    focal = options.focal
    if "focal" in file or focal is None:
        focal_of_file = number(owner, "focal", file.value("focal"), above=0.0)
        focal = focal_of_file if focal is None else focal
    size, plane = (file.value("M"), file.value("N")), (file.value("H"), file.value("W"))
    view = camera(owner, pose, focal, size, plane, prefix="cam_")
    keys = "light_positions", "light_intensities"
    positions, intensities = lights(owner, keys, *map(file.value, keys))
    if len(positions) > MAX_LIGHTS:
        raise value_error(owner, keys[0], f"at most {MAX_LIGHTS} lights", len(positions))
    points = tuple(map(PointLight, positions, intensities))
    if options.texture is not None:
        if mesh.uvs is None:
            raise file_error(owner, "uvs", "texture coordinates for the texture", "none")
        mesh = replace(mesh, material=replace(material, texture=options.texture))
    return options.applied(Scene((mesh,), view, points, ambient, background, "course", mesh.name))


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
    arrays = {name: np.ascontiguousarray(item) for name, item in content.items() if isinstance(item, np.ndarray)}
    buffer = io.BytesIO()
    np.save(buffer, np.array(content | arrays, dtype=object), allow_pickle=True)
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


def mesh_fields(
    owner: str, names: Mapping[str, str], arrays: Mapping[str, Any], *, finite_uvs: bool = True
) -> dict[str, Any]:
    """Return the arrays of a Mesh by field, contiguous, one row per item, from arrays all 3xN (2xN) or all Nx3.

    arrays: verts and faces, optionally colors, optionally uvs and uv_faces. names: of each in messages.
    verts, colors and uvs are float32 or float64 as arrays, indices int32 in range.
    """
    columns = _is_by_columns(owner, names, arrays)
    tables = {field: array.T if columns else array for field, array in arrays.items()}
    verts = rows(owner, names["verts"], tables["verts"], 3)
    faces = indices(owner, names["faces"], tables["faces"], len(verts))
    if len(faces) > MAX_FACES:
        raise value_error(owner, names["faces"], f"at most {MAX_FACES} triangles", len(faces))
    fields = {"verts": verts, "faces": faces}
    if "colors" in tables:
        fields["colors"] = colors = rows(owner, names["colors"], tables["colors"], 3)
        if len(colors) != len(verts):
            raise value_error(owner, names["colors"], f"one color per vertex ({len(verts)})", len(colors))
    if "uvs" in tables:
        fields["uvs"] = uvs = rows(owner, names["uvs"], tables["uvs"], 2, finite=finite_uvs)
        fields["uv_faces"] = uv_faces = indices(owner, names["uv_faces"], tables["uv_faces"], len(uvs))
        if len(uv_faces) != len(faces):
            raise value_error(owner, names["uv_faces"], f"one triple per face ({len(faces)})", len(uv_faces))
    return fields


def _is_by_columns(owner: str, names: Mapping[str, str], arrays: Mapping[str, Any]) -> bool:
    """Return whether arrays are 3xN (2xN). Those that are not square show the layout; default True."""
    shown_by: dict[bool, str] = {}  # whether 3xN, and the first array that shows it
    for field, array in arrays.items():
        width = _WIDTHS[field]
        if not isinstance(array, np.ndarray) or array.ndim != 2 or width not in array.shape:
            raise value_error(owner, names[field], f"an array of shape ({width}, N) or (N, {width})", array)
        if array.shape != (width, width):
            shown_by.setdefault(array.shape[0] == width, field)
    if len(shown_by) == 2:
        turned, layout = shown_by[False], names[shown_by[True]]
        raise value_error(owner, names[turned], f"shape ({_WIDTHS[turned]}, N), the layout of {layout}", arrays[turned])
    return False not in shown_by


def lights(owner: str, names: tuple[str, str], positions: Any, intensities: Any) -> tuple[Floats, Floats]:
    """Return positions and intensities, (L, 3) float64 each. names: of the two in messages."""
    places, powers = _per_light(owner, names[0], positions), _per_light(owner, names[1], intensities)
    if len(places) != len(powers):
        raise value_error(owner, names[1], f"one row per light of {names[0]} ({len(places)})", f"{len(powers)} rows")
    return places, powers


def _per_light(owner: str, name: str, value: Any) -> Floats:
    """Return (L, 3) float64 from an array of L rows, a list of L 3-vectors, or one 3-vector; L is 0 if it is empty."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.zeros(0)
    if array.shape in ((3,), (3, 1)) and array.dtype.kind in "fiub":  # no list of 3-vectors has that shape
        return np.asarray(vector(owner, name, value)[None].copy())
    if isinstance(value, (list, tuple)):
        return np.array([vector(owner, f"{name}[{k}]", item) for k, item in enumerate(value)]).reshape(-1, 3)
    expected = "an array of shape (L, 3), rows are lights, a list of 3-vectors, or one of them"
    table = floats(owner, name, value, expected)
    if table.size == 0:
        return np.zeros((0, 3))
    if table.ndim == 3 and table.shape[1:] in ((1, 3), (3, 1)):
        table = table.reshape(-1, 3)
    if table.ndim != 2 or table.shape[1] != 3:
        raise value_error(owner, name, expected, table)
    return rows(owner, name, table, 3).astype(np.float64)


def camera(
    owner: str, pose: Sequence[Any], focal: Any, size: tuple[Any, Any], plane: tuple[Any, Any], *, prefix: str = ""
) -> Camera:
    """Return the camera with (eye, lookat, up), (M, N) rows and columns and an image plane (H, W).

    prefix: of the names eye, lookat and up in messages.
    """
    count_rows, columns = (integer(owner, *item, 1, MAX_RESOLUTION) for item in zip("MN", size, strict=True))
    height, width = (number(owner, *item, above=0.0) for item in zip("HW", plane, strict=True))
    distance = number(owner, "focal", focal, above=0.0)
    names = ("eye", "lookat", "up")
    eye, lookat, up = (vector(owner, prefix + name, value) for name, value in zip(names, pose, strict=True))
    try:
        return Camera(eye, lookat, up, distance, (height, width), (columns, count_rows))
    except InputError as error:
        raise InputError(f"{owner}: {prefix}{str(error).removeprefix('Camera: ')}") from None


def exponent(owner: str, value: Any) -> float:
    """Return the specular exponent n, 0 to 1e9."""
    return number(owner, "n", value, least=0.0, most=1e9, expected="a number from 0 to 1e9")
