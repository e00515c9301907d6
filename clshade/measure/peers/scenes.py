"""The scenes that all renderers draw: one mesh with smooth normals, a pinhole camera, and a point light without falloff.

What they lack, all lack: shadows, ambient light, highlights, textures. Vertices and normals are float32 numbers, so that
all get the same ones.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ...base.arrays import Array, Floats
from ...scene.builtin.scenes import builtin
from ...scene.camera import Camera
from ...scene.formats.load import load
from ...scene.geometry import camera_axes, vertex_normals
from ...scene.lights import PointLight
from ...scene.model import Material, Mesh, Scene
from ...scene.seen_points import triangles

Resolution = tuple[int, int]
DATA = "CLSHADE_DATA"  # names the folder of the scenes that are files
KD = (0.9, 0.7, 0.5)
FOV = 35.0
NEEDLES = 4096  # triangles of the fan
FAR = (1_000_000.0, -500_000.0, 250_000.0)  # float32 numbers are 1/16, 1/32 and 1/64 apart there
RADIUS = 32.0  # of the sphere there
SLIVERS = 400


@dataclass(frozen=True, eq=False)
class PeerScene:
    """A scene to draw.

    make: from a resolution to it. file: that it is read from, below the folder of DATA. backs: whether it shows triangles
    from behind.
    """

    name: str
    about: str
    make: Callable[[Resolution], Scene]
    file: str = ""
    backs: bool = False

    @property
    def available(self) -> bool:
        return not self.file or (bool(os.environ.get(DATA)) and (Path(os.environ[DATA]) / self.file).is_file())


def plain(name: str, verts: Floats, faces: Array, camera: Camera, light: Floats, normals: Array | None = None) -> Scene:
    """Return the scene of a mesh, in float32, with smooth normals (V, 3) of its own, or of the faces around a vertex."""
    rounded = verts.astype(np.float32)
    normals = vertex_normals(rounded, faces) if normals is None else normals
    material = Material(ka=0.0, kd=KD, ks=0.0)
    mesh = Mesh(rounded, faces, normals=normals.astype(np.float32), material=material, name=name)
    return Scene((mesh,), camera, (PointLight(light, (1.0, 1.0, 1.0)),), np.zeros(3), None, name=name)


def seen(name: str, scene: Scene) -> Scene:
    """Return the triangles of a scene as one plain mesh, seen by its camera, lit from above the eye."""
    verts, faces = triangles(scene)
    used, inverse = np.unique(faces, return_inverse=True)
    camera = scene.camera
    right, up, _ = camera_axes(camera)
    side = 0.5 * float(np.linalg.norm(camera.lookat - camera.eye))
    return plain(name, verts[used], inverse.reshape(-1, 3), camera, camera.eye + side * (up + 0.5 * right))


def _teapot(resolution: Resolution) -> Scene:
    scene = builtin("teapot", resolution=resolution)
    return seen("teapot", replace(scene, meshes=scene.meshes[:-1]))  # without the floor


def _million(resolution: Resolution) -> Scene:
    return seen("million", builtin("icosphere", level=8, resolution=resolution))


def _fan(resolution: Resolution) -> Scene:
    """A disk of needles about its middle, which is no pixel's center, in a plane that tilts away from the camera."""
    angle = 2.0 * np.pi * np.arange(NEEDLES) / NEEDLES
    rim = np.stack([np.cos(angle), np.sin(angle), 0.3 * np.cos(angle)], axis=1)
    verts = np.concatenate([[[0.013, 0.007, 0.0]], rim])
    index = np.arange(NEEDLES)
    faces = np.stack([np.zeros_like(index), 1 + index, 1 + (index + 1) % NEEDLES], axis=1)
    camera = Camera.from_fov((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), FOV, resolution)
    return plain("fan", verts, faces, camera, np.array([1.0, 1.5, 3.0]))


def _grid(resolution: Resolution) -> Scene:
    """A wavy grid, whose vertices project exactly to centers, corners and the middles of sides of pixels.

    A pixel is 1/64 wide at a depth of 4; vertices lie 3.5 pixels apart, at depths that are powers of two.
    """
    columns, rows = resolution
    camera = Camera((0.0,) * 3, (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 1.0, (rows / 256.0, columns / 256.0), resolution)
    many = 2 * (min(columns, rows) // 9) + 1
    places = 3.5 * (np.arange(many) - many // 2) / 256.0
    x, y = np.meshgrid(places, places)
    depth = np.where((np.add.outer(np.arange(many), np.arange(many)) // 8) % 2, 4.0, 8.0)
    verts = np.stack([x * depth, y * depth, -depth], axis=2).reshape(-1, 3)
    corner = np.arange(many * many).reshape(many, many)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]))
    faces = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    normals = np.tile([0.0, 0.0, 1.0], (len(verts), 1))
    return plain("grid", verts, faces, camera, np.array([1.0, 1.5, 0.0]), normals)


def _offset(resolution: Resolution) -> Scene:
    """A sphere far from the origin, whose vertices are rounded to the float32 numbers there."""
    scene = builtin("icosphere", level=4, resolution=resolution)
    middle, (mesh,) = np.array(FAR), scene.meshes
    eye = middle + RADIUS * np.array([0.0, 0.0, 4.0])
    camera = replace(scene.camera, eye=eye, lookat=middle)
    verts = RADIUS * mesh.verts.astype(np.float64) + middle
    return plain("offset", verts, mesh.faces, camera, eye + RADIUS * np.array([1.0, 2.0, 0.0]), mesh.verts)


def _slivers(resolution: Resolution) -> Scene:
    """Triangles up to two units long and 1e-4 to 1e-2 wide, at random in depth."""
    random = np.random.default_rng(7)
    middle = random.uniform(-1.0, 1.0, (SLIVERS, 3))
    turn, length = random.uniform(0.0, 2.0 * np.pi, SLIVERS), random.uniform(0.3, 1.0, SLIVERS)
    along = np.stack([np.cos(turn), np.sin(turn), 0.3 * np.sin(3.0 * turn)], axis=1) * length[:, None]
    across = np.stack([-np.sin(turn), np.cos(turn), np.zeros(SLIVERS)], axis=1)
    width = 10.0 ** random.uniform(-4.0, -2.0, (SLIVERS, 1))
    verts = np.stack([middle - along, middle + along, middle + along + width * across], axis=1).reshape(-1, 3)
    normals = np.tile([0.0, 0.0, 1.0], (len(verts), 1))
    camera = Camera.from_fov((0.0, 0.0, 4.5), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), FOV, resolution)
    faces = np.arange(len(verts)).reshape(-1, 3)
    return plain("slivers", verts, faces, camera, np.array([1.0, 1.5, 4.0]), normals)


def _file(path: str, resolution: Resolution) -> Scene:
    scene = load(Path(os.environ[DATA]) / path)
    return seen(Path(path).stem, replace(scene, camera=scene.camera.with_resolution(resolution)))


def _of_file(name: str, about: str, path: str, backs: bool = False) -> PeerScene:
    return PeerScene(name, about, partial(_file, path), path, backs)


SCENES = (
    PeerScene("teapot", "the built-in teapot without its floor", _teapot),
    PeerScene("fan", f"{NEEDLES:,} needles about one vertex", _fan),
    PeerScene("grid", "vertices exactly on pixels' centers and corners", _grid),
    PeerScene("offset", "a sphere of 5,120 triangles and radius 32, 1e6 from the origin", _offset),
    PeerScene("slivers", f"{SLIVERS} slivers, some much thinner than a pixel", _slivers),
    PeerScene("million", "a sphere of 1,310,720 triangles", _million),
    _of_file("beetle", "an open car body, 38,656 triangles", "beetle-alt.obj", backs=True),
    _of_file("spot", "a cow, 5,856 triangles", "spot/spot.obj"),
    _of_file("helmet", "the geometry of DamagedHelmet, 15,452 triangles", "gltf/DamagedHelmet.glb"),
)
