"""Small scene files for the tests of loading, and the form of a refusal."""

import io
import pickle
import struct
import warnings
import zlib
from collections.abc import Callable, Iterable
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.scene.camera import Camera
from clshade.scene.formats.load import load
from clshade.scene.geometry import camera_axes
from clshade.scene.model import Mesh, Scene

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
ROOF = "v 0 0 0\nv 0 1 0\nv -1 0 0\nv 0.9 0 -0.3\nf 1 2 3\nf 2 1 4\n"  # two faces, 18 degrees apart
TEXTURED = "mtllib a.mtl\n" + TRIANGLE + "vt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
DATA = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float heat\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 -1.5\n1 0 0 nan\n0 1 0 4\n3 0 1 2\n"
)


def course_dict(**changes: Any) -> dict[str, Any]:
    """Return a course file's dict: four vertices, two faces, three uvs, 3xN; a change to None removes the key."""
    content = {
        "verts": np.array([[0, 1, 0, 1], [0, 0, 1, 1], [0, 0.5, 0, 0.25]], np.float32),
        "vertex_colors": np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4),
        "face_indices": np.array([[0, 1], [1, 3], [2, 2]]),
        "uvs": np.array([[0, 1, 0.25], [0, 0.5, 1]], np.float32),
        "face_uv_indices": np.array([[0, 1], [1, 2], [2, 0]]),
        "depth": np.ones(4, np.float32),
        "cam_eye": np.array([0, 0, 5], np.float32),
        "cam_up": np.array([0, 1, 0], np.float32),
        "cam_lookat": np.zeros(3, np.float32),
        "ka": 0.1,
        "kd": 0.8,
        "ks": 0.5,
        "n": 7,
        "light_positions": [np.array([0.0, 0, 5]), np.array([1.0, 2, 3])],
        "light_intensities": [np.ones(3), np.array([1.0, 0.5, 0.25])],
        "Ia": np.array([0.2, 0.3, 0.4]),
        "M": 48,
        "N": 64,
        "W": 4,
        "H": 3,
        "bg_color": np.array([1.0, 0.9, 0.8]),
        "focal": 2,
    }
    content.update(changes)
    return {key: value for key, value in content.items() if value is not None}


def transposed(content: dict[str, Any]) -> dict[str, Any]:
    keys = ("verts", "vertex_colors", "face_indices", "uvs", "face_uv_indices")
    return {key: value.T if key in keys else value for key, value in content.items()}


def save_npy(path, content: Any) -> str:
    np.save(path, np.array(content, dtype=object), allow_pickle=True)
    return str(path)


def npy_of_pickle(path, pickled: bytes) -> str:
    """Write a .npy file with the header of a course file and the given pickle."""
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "|O", "fortran_order": False, "shape": ()})
    path.write_bytes(buffer.getvalue() + pickled)
    return str(path)


def pickled_array(content: Any) -> bytes:
    return pickle.dumps(np.array(content, dtype=object), protocol=4)


def write(path, text: str | bytes) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return str(path)


def scene_and_warnings(path, **options: Any) -> tuple[Scene, list[str]]:
    """Load a file; return the scene and the warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = load(path, **options)
    messages = [str(warning.message) for warning in caught]
    assert all(message.isprintable() for message in messages)
    return scene, messages


def corners_in_world(meshes: Iterable[Mesh]) -> np.ndarray:
    """Return the corners of all triangles, (F, 3, 3), in the order of meshes, placements and faces."""
    placed = ((mesh, matrix) for mesh in meshes for matrix in np.asarray(mesh.instances))
    return np.concatenate([(mesh.verts @ m[:3, :3].T + m[:3, 3])[mesh.faces] for mesh, m in placed])


def ends_in_image(camera: Camera, meshes: Iterable[Mesh]) -> np.ndarray:
    """Return the least and the greatest image coordinates of the corners, (2, 2): from -1 to 1 inside the image."""
    x, y, z = camera_axes(camera) @ (corners_in_world(meshes).reshape(-1, 3) - camera.eye).T
    assert (z > 0.0).all()
    depth = 1.0 if camera.orthographic else z / camera.focal
    points = np.stack([x, y], axis=1) / np.reshape(depth, (-1, 1)) / camera.plane[::-1] * 2.0
    return np.array([points.min(axis=0), points.max(axis=0)])


def refusal(path, *parts: str, read: Callable[..., Any] = load, **options: Any) -> str:
    """Return the message that refuses a file: one line that contains the file's name and the given parts."""
    with pytest.raises(InputError) as caught:
        read(path, **options)
    text = str(caught.value)
    assert text.isprintable()
    for part in (*parts, "expected", "found"):
        assert part in text, text
    return text


def chunk(kind: bytes, data: bytes) -> bytes:
    """Return a chunk of a PNG file."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png_header(columns: int, rows: int) -> bytes:
    """Return a gray PNG file without its pixels."""
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


def png16(pixels: np.ndarray) -> bytes:
    """Encode (h, w, 1..4) uint16 as a PNG with 16 bits per channel, using all five filters."""
    height, width, channels = pixels.shape
    rows = pixels.astype(">u2").reshape(height, -1).view(np.uint8).astype(np.int32)
    step = 2 * channels
    before = np.zeros_like(rows[0])
    lines = []
    for y, row in enumerate(rows):
        left = np.concatenate([np.zeros(step, np.int32), row[:-step]])
        corner = np.concatenate([np.zeros(step, np.int32), before[:-step]])
        estimate = left + before - corner
        far = np.abs(np.stack([estimate - left, estimate - before, estimate - corner]))
        paeth = np.choose(far.argmin(axis=0), [left, before, corner])
        guess = (np.zeros_like(row), left, before, (left + before) // 2, paeth)[y % 5]
        lines.append(bytes([y % 5]) + ((row - guess) % 256).astype(np.uint8).tobytes())
        before = row

    color = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    head = struct.pack(">IIBBBBB", width, height, 16, color, 0, 0, 0)
    data = zlib.compress(b"".join(lines))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def same(a: Any, b: Any) -> bool:
    """Return whether two values are of the same type and have the same bits."""
    if type(a) is not type(b):
        return False
    if is_dataclass(a):
        return all(same(getattr(a, field.name), getattr(b, field.name)) for field in fields(a))
    if isinstance(a, np.ndarray):
        return (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return struct.pack("d", a) == struct.pack("d", b) if isinstance(a, float) else a == b
