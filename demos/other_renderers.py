"""clshade beside other renderers: scenes that all of them can draw, against an exact answer in float64.

    python demos/other_renderers.py                              # all that are installed: five minutes
    python demos/other_renderers.py --only fan grid --renderers clshade embree

Every scene is one mesh with smooth normals, a pinhole camera, and Lambert's light kd I max(N.L, 0) of one point light.
Vertices and normals are float32 numbers, so that all renderers get the same ones. Every renderer has a process of its own;
they take turns. One that is missing, crashes or hangs is named in a line. Three scenes are files below CLSHADE_DATA.

Needs: moderngl (llvmpipe; Debian: libegl1 libgl1-mesa-dri), embreex, mitsuba (Debian: libllvm15), riley-raster.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import sys
import time
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
if (CHECKOUT / "clshade").is_dir():  # run from a checkout, installed or not
    sys.path.insert(0, str(CHECKOUT))

from clshade.base import interrupts  # noqa: E402

if __name__ == "__main__":
    interrupts.leave_soon()  # the rest takes long to import

from collections.abc import Callable, Iterator, Sequence  # noqa: E402
from concurrent.futures import ProcessPoolExecutor, TimeoutError  # noqa: E402  # on Python 3.10 it is not the built-in one
from concurrent.futures.process import BrokenProcessPool  # noqa: E402
from contextlib import ExitStack  # noqa: E402
from dataclasses import replace  # noqa: E402
from functools import partial  # noqa: E402
from importlib import metadata  # noqa: E402
from typing import Any, NamedTuple  # noqa: E402

import numpy as np  # noqa: E402

import clshade  # noqa: E402
from clshade.course import calculate_normals  # noqa: E402
from clshade.scene.geometry import camera_axes, triangles  # noqa: E402

KD = (0.9, 0.7, 0.5)
RESOLUTION = (320, 240)
FRAMES, SECONDS = 7, 20.0  # timed frames of each renderer, and of a scene together, at most
LIMIT = 180.0  # seconds for each answer; the first may compile
TIE = 1e-6  # pixels whose center is no farther than this from an edge are on it
SAME = 1e-7  # relative: depths of triangles that share an edge, where the center is on it
OTHER = 0.01  # of the scene's range of depths: a pixel that is farther off shows another surface
DATA = os.environ.get("CLSHADE_DATA", "")


# Cameras and scenes


def pixel_rays(camera: clshade.Camera) -> np.ndarray:
    """Return the rays (M, N, 3) from the eye through the centers of pixels, of depth 1, row 0 at the top."""
    (height, width), (columns, rows) = camera.plane, camera.resolution
    x = ((np.arange(columns) + 0.5) / columns - camera.principal[0]) * width
    y = ((rows - np.arange(rows) - 0.5) / rows - camera.principal[1]) * height
    across, up = np.broadcast_arrays(x, y[:, None])
    return np.stack([across, up, np.full_like(across, camera.focal)], axis=-1) @ camera_axes(camera) / camera.focal


def in_image(camera: clshade.Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where points (K, 3) are in the image, in pixels to the right and down (K, 2), and their depths (K,)."""
    (height, width), (columns, rows) = camera.plane, camera.resolution
    x, y, z = ((points - camera.eye) @ camera_axes(camera).T).T
    across = (x * camera.focal / z / width + camera.principal[0]) * columns
    up = (y * camera.focal / z / height + camera.principal[1]) * rows
    return np.stack([across, rows - up], axis=1), z


def plain(name: str, verts, faces, camera, light, normals=None) -> clshade.Scene:
    """Return the scene of a mesh, in float32, with smooth normals (V, 3) of its own, or of the faces around a vertex."""
    verts = np.asarray(verts).astype(np.float32)
    normals = calculate_normals(verts.T, faces.T).T if normals is None else np.asarray(normals)
    material = clshade.Material(ka=0.0, kd=KD, ks=0.0)
    mesh = clshade.Mesh(verts, faces, normals=normals.astype(np.float32), material=material, name=name)
    lights = (clshade.PointLight(light, (1.0, 1.0, 1.0)),)
    return clshade.Scene((mesh,), camera, lights, np.zeros(3), None, name=name)


def seen(name: str, scene: clshade.Scene) -> clshade.Scene:
    """Return the triangles of a scene as one plain mesh, seen by its camera, lit from above the eye."""
    verts, faces = triangles(scene)
    used, inverse = np.unique(faces, return_inverse=True)
    camera = scene.camera
    right, up, _ = camera_axes(camera)
    side = 0.5 * float(np.linalg.norm(camera.lookat - camera.eye))
    light = camera.eye + side * (up + 0.5 * right)
    return plain(name, verts[used], inverse.reshape(-1, 3), camera, light)


def fan(resolution):
    """4,096 needles about one vertex, which is no pixel's center, in a plane that tilts away from the camera."""
    count = 4096
    angle = 2.0 * np.pi * np.arange(count) / count
    rim = np.stack([np.cos(angle), np.sin(angle), 0.3 * np.cos(angle)], axis=1)
    index = np.arange(count)
    faces = np.stack([np.zeros_like(index), 1 + index, 1 + (index + 1) % count], axis=1)
    camera = clshade.Camera.from_fov((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 35.0, resolution)
    verts = np.concatenate([[[0.013, 0.007, 0.0]], rim])
    return plain("fan", verts, faces, camera, np.array([1.0, 1.5, 3.0]))


def grid(resolution):
    """A wavy grid, whose vertices project exactly to centers, corners and the middles of sides of pixels.

    A pixel is 1/64 wide at a depth of 4; vertices lie 3.5 pixels apart, at depths that are powers of two.
    """
    columns, rows = resolution
    plane = (rows / 256.0, columns / 256.0)
    camera = clshade.Camera((0.0,) * 3, (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 1.0, plane, resolution)
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


def offset(resolution):
    """A sphere of 5,120 triangles and radius 32, 1e6 from the origin, where float32 numbers are 1/16 apart."""
    radius, middle = 32.0, np.array([1_000_000.0, -500_000.0, 250_000.0])
    scene = clshade.builtin("icosphere", level=4, resolution=resolution)
    (mesh,) = scene.meshes
    eye = middle + radius * np.array([0.0, 0.0, 4.0])
    verts = radius * mesh.verts.astype(np.float64) + middle
    light = eye + radius * np.array([1.0, 2.0, 0.0])
    return plain("offset", verts, mesh.faces, replace(scene.camera, eye=eye, lookat=middle), light, mesh.verts)


def slivers(resolution):
    """400 triangles up to two units long and 1e-4 to 1e-2 wide, at random in depth."""
    count, random = 400, np.random.default_rng(7)
    middle = random.uniform(-1.0, 1.0, (count, 3))
    turn, length = random.uniform(0.0, 2.0 * np.pi, count), random.uniform(0.3, 1.0, count)
    along = np.stack([np.cos(turn), np.sin(turn), 0.3 * np.sin(3.0 * turn)], axis=1) * length[:, None]
    across = np.stack([-np.sin(turn), np.cos(turn), np.zeros(count)], axis=1)
    width = 10.0 ** random.uniform(-4.0, -2.0, (count, 1))
    verts = np.stack([middle - along, middle + along, middle + along + width * across], axis=1).reshape(-1, 3)
    normals = np.tile([0.0, 0.0, 1.0], (len(verts), 1))
    camera = clshade.Camera.from_fov((0.0, 0.0, 4.5), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 35.0, resolution)
    faces = np.arange(len(verts)).reshape(-1, 3)
    return plain("slivers", verts, faces, camera, np.array([1.0, 1.5, 4.0]), normals)


def teapot(resolution):
    """The built-in teapot without its floor."""
    scene = clshade.builtin("teapot", resolution=resolution)
    return seen("teapot", replace(scene, meshes=scene.meshes[:-1]))


def from_file(name: str, path: str, resolution):
    scene = clshade.load(Path(DATA) / path)
    return seen(name, replace(scene, camera=scene.camera.with_resolution(resolution)))


FILES = {"beetle": "beetle-alt.obj", "spot": "spot/spot.obj", "helmet": "gltf/DamagedHelmet.glb"}
CANNOT = {("riley", "beetle")}  # it leaves out triangles seen from behind, which the beetle shows
SCENES: dict[str, Callable[..., clshade.Scene]] = {
    **{make.__name__: make for make in (teapot, fan, grid, offset, slivers)},
    "million": lambda resolution: seen("million", clshade.builtin("icosphere", level=8, resolution=resolution)),
    **{name: partial(from_file, name, path) for name, path in FILES.items() if DATA and (Path(DATA) / path).is_file()},
}


# The exact answer: what is at the center of each pixel, from the vertices as they are, on no grid


class Exact(NamedTuple):
    """covered: (M, N). tied: (M, N), where the center is on an edge, and either answer is right. depth: (M, N), +inf where
    nothing is. rgb: (M, N, 3). Row 0 is at the top."""

    covered: np.ndarray
    tied: np.ndarray
    depth: np.ndarray
    rgb: np.ndarray


class Hits(NamedTuple):
    """Pixels, counted row by row from the top, with a triangle that covers the center or has it on an edge, (K,) each.
    inside: whether it covers it. weights: (K, 3) of its corners."""

    pixel: np.ndarray
    face: np.ndarray
    inside: np.ndarray
    depth: np.ndarray
    weights: np.ndarray


def exact(scene: clshade.Scene) -> Exact:
    """Return the exact image of a scene of one mesh, all of it before the eye, under one light."""
    camera, (verts, normals, faces) = scene.camera, arrays_of(scene)
    columns, rows = camera.resolution
    places, z = in_image(camera, verts.astype(np.float64))
    parts = [hits_of(places, z, faces, *part, columns) for part in candidates(places, faces, columns, rows)]
    hits = Hits._make(np.concatenate(values) for values in zip(*parts, strict=True))
    sure, nearest, owner = nearest_hits(hits, hits.inside, rows * columns)
    covered, nearest_any, owner_any = nearest_hits(hits, np.ones(len(hits.pixel), bool), rows * columns)
    tied = np.where(sure, nearest_any < nearest * (1.0 - SAME), covered)
    doubtful = np.flatnonzero(tied)
    in_front = hits.depth <= nearest_any[hits.pixel] * (1.0 + SAME)
    tied[doubtful[surrounded(hits, in_front, places, faces, doubtful, columns)]] = False
    owner = np.where(sure & (nearest <= nearest_any), owner, owner_any)
    depth, rgb = np.full(rows * columns, np.inf), np.zeros((rows * columns, 3))
    shown = np.flatnonzero(covered)
    mine = owner[shown]
    depth[shown] = hits.depth[mine]
    mixed = (normals[faces[hits.face[mine]]].astype(np.float64) * hits.weights[mine, :, None]).sum(axis=1)
    points = camera.eye + depth[shown, None] * pixel_rays(camera).reshape(-1, 3)[shown]
    rgb[shown] = lambert(mixed, points, scene)
    shape = rows, columns
    return Exact(covered.reshape(shape), tied.reshape(shape), depth.reshape(shape), rgb.reshape(*shape, 3))


def candidates(places, faces, columns, rows, pairs=1 << 20) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield triangles and pixels, (K,) each, whose center is in the triangle's box, with TIE about it."""
    corners = places[faces]
    low = np.maximum(np.ceil(corners.min(axis=1) - 0.5 - TIE), 0).astype(np.int64)
    high = np.minimum(np.floor(corners.max(axis=1) - 0.5 + TIE), [columns - 1, rows - 1]).astype(np.int64)
    size = np.maximum(high - low + 1, 0)
    count = size[:, 0] * size[:, 1]
    kept = np.flatnonzero(count)
    number = np.cumsum(count[kept]) // pairs
    for part in np.split(kept, np.flatnonzero(np.diff(number)) + 1):
        face = np.repeat(part, count[part])
        step = np.arange(len(face)) - np.repeat(np.cumsum(count[part]) - count[part], count[part])
        column, row = low[face, 0] + step % size[face, 0], low[face, 1] + step // size[face, 0]
        yield face, row * columns + column


def distances(corners, points):
    """Return the signed distances in pixels of points (K, 2) from the edges of triangles (K, 3, 2), (K, 3), positive inside,
    and twice the areas of the triangles that they make with these, (K, 3). Edge k is opposite corner k."""

    def cross(a, b):
        return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]

    edges, apart = ((1, 2), (2, 0), (0, 1)), corners - points[:, None]
    areas = np.stack([cross(apart[:, i], apart[:, j]) for i, j in edges], axis=1)
    areas *= np.sign(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))[:, None]
    lengths = np.stack([np.linalg.norm(corners[:, j] - corners[:, i], axis=1) for i, j in edges], axis=1)
    return areas / np.where(lengths > 0.0, lengths, 1.0), areas


def centers(pixel, columns):
    return np.stack([pixel % columns, pixel // columns], axis=1).astype(np.float64) + 0.5


def hits_of(places, z, faces, face, pixel, columns) -> Hits:
    apart, areas = distances(places[faces[face]], centers(pixel, columns))
    kept = (apart >= -TIE).all(axis=1) & (areas.sum(axis=1) > 0.0)
    face, pixel, apart, areas = face[kept], pixel[kept], apart[kept], np.maximum(areas[kept], 0.0)
    weights = areas / z[faces[face]]  # perspective: affine weights over depths
    depth = areas.sum(axis=1) / weights.sum(axis=1)
    return Hits(pixel, face, (apart > TIE).all(axis=1), depth, weights / weights.sum(axis=1, keepdims=True))


def nearest_hits(hits, among, count):
    """Return for each of `count` pixels whether any of these hits is there, the least depth, and the hit that has it."""
    index = np.flatnonzero(among)
    depth, owner = np.full(count, np.inf), np.full(count, -1)
    np.minimum.at(depth, hits.pixel[index], hits.depth[index])
    first = index[hits.depth[index] == depth[hits.pixel[index]]]
    owner[hits.pixel[first]] = first
    return owner >= 0, depth, owner


def surrounded(hits, among, places, faces, pixels, columns):
    """Return which pixels (Q,), whose center is on an edge, have triangles of these hits all around the center: none may
    leave it out."""
    index = np.flatnonzero(among & np.isin(hits.pixel, pixels))
    order = np.searchsorted(pixels, hits.pixel[index])
    corners, middle = places[faces[hits.face[index]]], centers(hits.pixel[index], columns)
    closed = np.ones(len(pixels), bool)
    for angle in np.arange(8) * (np.pi / 4.0) + 0.1:
        probe = middle + 4.0 * TIE * np.array([np.cos(angle), np.sin(angle)])
        held = (distances(corners, probe)[0] >= 0.0).all(axis=1)
        closed &= np.bincount(order[held], minlength=len(pixels)) > 0
    return closed


# What renderers take and return


class Picture(NamedTuple):
    """rgb: (M, N, 3) linear, row 0 at the top, over black. depth: (M, N) along the viewing direction, +inf where nothing
    is. alpha: (M, N), the part of the pixel that is covered."""

    rgb: np.ndarray
    depth: np.ndarray
    alpha: np.ndarray


def arrays_of(scene: clshade.Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices (V, 3) and normals (V, 3), float32, and faces (F, 3), int32, of the scene's one mesh."""
    (mesh,) = scene.meshes
    return mesh.verts.astype(np.float32), mesh.normals.astype(np.float32), mesh.faces.astype(np.int32)


def lambert(normals, points, scene):
    """Return the light (K, 3) that points with normals of any length (K, 3) send, in their own precision."""
    kind, (mesh,), (light,) = normals.dtype, scene.meshes, scene.lights
    toward = np.asarray(light.position, kind) - points
    lengths = np.einsum("kx,kx->k", normals, normals) * np.einsum("kx,kx->k", toward, toward)
    cosine = np.einsum("kx,kx->k", normals, toward) / np.sqrt(np.where(lengths > 0.0, lengths, kind.type(1.0)))
    return np.maximum(cosine, kind.type(0.0))[:, None] * np.asarray(mesh.material.kd * light.intensity, kind)


def picture_of(shown, rgb, depth) -> Picture:
    """Return the picture of pixels that show something: shown (M, N) bool, rgb (K, 3) and depth (K,) of these."""
    image, z = np.zeros((*shown.shape, 3), rgb.dtype), np.full(shown.shape, np.inf, depth.dtype)
    image[shown], z[shown] = rgb, depth
    return Picture(image, z, shown.astype(np.float32))


class Ours:
    def __init__(self, scene, **options):
        self._renderer = clshade.Renderer(scene, layers=("Z",), **options)
        self.title = f"clshade {clshade.__version__}, {self._renderer.device.title}"

    def draw(self) -> Picture:
        frame = self._renderer.render()
        return Picture(frame.rgb, frame["Z"], frame.alpha)


class OpenGL:
    """Mesa's software rasterizer by OpenGL through EGL: world coordinates, a float32 matrix and a float target."""

    VERTEX = """#version 330
    uniform mat4 to_clip; in vec3 in_position, in_normal; out vec3 position, normal;
    void main() { position = in_position; normal = in_normal; gl_Position = to_clip * vec4(in_position, 1.0); }"""
    FRAGMENT = """#version 330
    uniform vec3 light, color; in vec3 position, normal; out vec4 result;
    void main() { result = vec4(color * max(dot(normalize(normal), normalize(light - position)), 0.0), 1.0); }"""

    def __init__(self, scene):
        import moderngl

        os.environ["LIBGL_ALWAYS_SOFTWARE"] = "1"
        self._context = context = moderngl.create_context(standalone=True, backend="egl")
        self.title = f"{context.info['GL_RENDERER']}, OpenGL {context.info['GL_VERSION']}"
        (verts, normals, faces), camera, (light,) = arrays_of(scene), scene.camera, scene.lights
        self._size = size = camera.resolution
        self._target = context.framebuffer(
            [context.renderbuffer(size, 4, dtype="f4")], context.depth_renderbuffer(size)
        )
        z = in_image(camera, verts.astype(np.float64))[1]
        self._range = near, far = float(z.min() / 2.0), float(z.max() * 2.0)
        (height, width), axes, lens, pose = camera.plane, camera_axes(camera), np.zeros((4, 4)), np.eye(4)
        lens[0, 0], lens[1, 1] = 2.0 * camera.focal / width, 2.0 * camera.focal / height
        lens[2, 2:] = (far + near) / (far - near), -2.0 * far * near / (far - near)
        lens[3, 2] = 1.0
        pose[:3, :3], pose[:3, 3] = axes, -axes @ camera.eye
        program = context.program(vertex_shader=self.VERTEX, fragment_shader=self.FRAGMENT)
        program["to_clip"].write(np.ascontiguousarray((lens @ pose).T, np.float32).tobytes())
        program["light"].value = tuple(map(float, light.position))
        program["color"].value = tuple(map(float, scene.meshes[0].material.kd * light.intensity))
        attributes = {"in_position": verts, "in_normal": normals}
        buffers = [(context.buffer(values.tobytes()), "3f", name) for name, values in attributes.items()]
        self._vertices = context.vertex_array(program, buffers, context.buffer(faces.tobytes()))

    def draw(self) -> Picture:
        (columns, rows), (near, far) = self._size, self._range
        self._target.use()
        self._context.enable_only(self._context.DEPTH_TEST)
        self._target.clear(depth=1.0)
        self._vertices.render()
        image = np.frombuffer(self._target.read(components=4, dtype="f4"), np.float32).reshape(rows, columns, 4)[::-1]
        buffer = np.frombuffer(self._target.read(attachment=-1, components=1, dtype="f4"), np.float32)
        buffer = buffer.reshape(rows, columns)[::-1].astype(np.float64)
        depth = np.where(buffer < 1.0, near * far / (far - buffer * (far - near)), np.inf)
        return Picture(image[..., :3], depth, image[..., 3])


class Embree:
    """Intel Embree by embreex: a ray through each pixel's center, in one thread; NumPy interpolates and lights."""

    def __init__(self, scene):
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene, (verts, self._normals, self._faces) = scene, arrays_of(scene)
        self._hierarchy = EmbreeScene()
        self._mesh = TriangleMesh(self._hierarchy, verts, self._faces)
        self.title = f"embreex {metadata.version('embreex')}"
        rays = pixel_rays(scene.camera)
        self._shape, self._rays = rays.shape[:2], np.ascontiguousarray(rays.reshape(-1, 3), np.float32)
        self._origins = np.tile(scene.camera.eye.astype(np.float32), (len(self._rays), 1))

    def draw(self) -> Picture:
        hit = self._hierarchy.run(self._origins, self._rays, query="INTERSECT", output=True)
        shown = hit["primID"] >= 0
        second, third, depth = (hit[name][shown] for name in ("u", "v", "tfar"))
        points = self._origins[shown] + depth[:, None] * self._rays[shown]
        a, b, c = (self._normals[self._faces[hit["primID"][shown], k]] for k in range(3))
        normals = a + second[:, None] * (b - a) + third[:, None] * (c - a)
        return picture_of(shown.reshape(self._shape), lambert(normals, points, self._scene), depth)


class Mitsuba:
    """Mitsuba 3: a ray through each pixel's center and the shading normal there; Lambert's light by Dr.Jit. Its integrators'
    light falls off with distance and casts shadows, and their samples lie at random in the pixel."""

    def __init__(self, scene):
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")  # float32, vectorized; scalar variants take one ray at a time
        self._mi, self.title, (verts, normals, faces) = mi, f"Mitsuba {mi.__version__}", arrays_of(scene)
        mesh = mi.Mesh("mesh", len(verts), len(faces), has_vertex_normals=True)
        fields = mi.traverse(mesh)
        fields["vertex_positions"], fields["vertex_normals"] = verts.ravel(), normals.ravel()
        fields["faces"] = faces.astype(np.uint32).ravel()
        fields.update()
        self._scene = mi.load_dict({"type": "scene", "mesh": mesh})
        rays, (light,) = pixel_rays(scene.camera), scene.lights
        self._shape = rays.shape[:2]
        eye = mi.Point3f(*map(float, scene.camera.eye))
        self._ray = mi.Ray3f(eye, np.ascontiguousarray(rays.reshape(-1, 3).T, np.float32))
        self._light = mi.Point3f(*map(float, light.position))
        self._color = mi.Color3f(*map(float, scene.meshes[0].material.kd * light.intensity))

    def draw(self) -> Picture:
        import drjit as dr

        hit = self._scene.ray_intersect(self._ray)
        shown = hit.is_valid()
        cosine = dr.dot(hit.sh_frame.n, dr.normalize(self._light - hit.p))
        cosine = dr.select(shown & (cosine > 0.0), cosine, 0.0)  # LLVM 15 cannot compile Dr.Jit's maximum
        rgb, depth = cosine * self._color, dr.select(shown, hit.t, dr.inf)
        dr.eval(rgb, depth)
        image, depth = rgb.numpy().T.reshape(*self._shape, 3), depth.numpy().reshape(self._shape)
        return Picture(image, depth, np.isfinite(depth).astype(np.float32))


class Riley:
    """riley-raster, a rasterizer in float64 that interpolates fields of three channels: it draws normals and positions, and
    NumPy lights what they show."""

    NOWHERE = 1e300  # what the image has where no triangle is

    def __init__(self, scene):
        import riley

        self._riley, self._scene, (verts, normals, faces) = riley, scene, arrays_of(scene)
        self.title = f"riley-raster {metadata.version('riley-raster')}"
        verts, faces = verts.astype(np.float64), faces.astype(np.int64)
        form = riley.ConnectConvention(riley.EElemType.TRI3, riley.EConnectAxis.ROW, 0, riley.ENodeOrder.RILEY)
        shaders = [
            riley.NodalShader(
                field=np.ascontiguousarray(field, np.float64)[:, None, :], scaling_type=riley.ScaleStrategy.none
            )
            for field in (normals, verts)
        ]
        self._meshes = [riley.create_mesh(form, riley.MeshType.tri3opt, verts, faces, shader) for shader in shaders]
        camera = scene.camera
        (height, width), (columns, rows) = camera.plane, camera.resolution
        right, up, forward = camera_axes(camera)
        turn = np.stack([right, up, -forward], axis=1)  # about x, then y, then z
        angles = (
            np.arctan2(turn[1, 0], turn[0, 0]),
            np.arctan2(-turn[2, 0], np.hypot(turn[2, 1], turn[2, 2])),
            np.arctan2(turn[2, 1], turn[2, 2]),
        )
        self._camera = riley.Camera(
            pixels_num=(columns, rows),
            pixels_size=(width / columns, height / rows),
            pos_world=tuple(map(float, camera.eye)),
            rot_world=tuple(map(float, angles)),
            roi_cent_world=tuple(map(float, verts.mean(axis=0))),
            focal_length=camera.focal,
            sub_sample=1,
        )
        self._config = riley.RasterConfig(
            save_strategy=riley.SaveStrategy.memory,
            report=riley.ReportMode.off,
            background_value=self.NOWHERE,
        )

    def draw(self) -> Picture:
        drawn = (self._riley.raster(mesh, self._camera, self._config)[0, 0] for mesh in self._meshes)
        normals, points = (np.moveaxis(image, 0, -1) for image in drawn)
        shown = (points != self.NOWHERE).all(axis=2)
        normals, points = normals[shown], points[shown]
        depth = (points - self._scene.camera.eye) @ camera_axes(self._scene.camera)[2]
        return picture_of(shown, lambert(normals, points, self._scene), depth)


RENDERERS: dict[str, Callable[[clshade.Scene], Any]] = {
    "clshade": Ours,
    "float64": partial(Ours, precision="float64"),
    "llvmpipe": OpenGL,
    "embree": Embree,
    "mitsuba": Mitsuba,
    "riley": Riley,
}


# A renderer in a process of its own

_drawer: Any = None  # of the child process


def open_drawer(name: str, scene: clshade.Scene) -> str:
    """Open a scene in the child process; return the renderer's name and version."""
    global _drawer
    _drawer = RENDERERS[name](scene)
    return _drawer.title


def draw() -> tuple[float, Picture]:
    """Draw a frame in the child process; return its milliseconds, and the frame."""
    start = time.perf_counter()
    picture = _drawer.draw()
    return (time.perf_counter() - start) * 1e3, Picture(*map(np.ascontiguousarray, picture))


class Process:
    """A renderer that has opened its scene. Raises RuntimeError if it is missing, crashes or hangs, as `call` does."""

    def __init__(self, name: str, scene: clshade.Scene) -> None:
        ignored = (signal.SIGINT, signal.SIG_IGN)  # an interrupt ends the parent
        self._pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), signal.signal, ignored)
        self.title = self.call(open_drawer, name, scene)

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return self._pool.submit(function, *arguments).result(LIMIT)
        except TimeoutError:
            for child in list(self._pool._processes.values()):
                child.kill()
            raise RuntimeError(f"no answer within {LIMIT:g} s") from None
        except BrokenProcessPool:
            raise RuntimeError("the process crashed") from None
        except Exception as error:
            raise RuntimeError(f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]) from None

    def close(self) -> None:
        self._pool.shutdown(cancel_futures=True)


# Measurement


class Result(NamedTuple):
    """A renderer on a scene. wrong: pixels of wrong coverage, or that show another surface; depth, color: RMS errors, None
    where no pixel is right. same: whether two frames have equal bits."""

    scene: str
    name: str
    title: str
    ms: float
    same: bool
    wrong: int
    depth: float | None
    color: float | None


def rms(values) -> float | None:
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64)))) if values.size else None


def exact_errors(picture: Picture, right: Exact) -> dict[str, Any]:
    """Return how wrong an image of one sample at the pixels' centers is; tied pixels are left out."""
    covered = picture.alpha > 0.0
    wrong = (covered != right.covered) & ~right.tied
    both = covered & right.covered & ~right.tied
    depth = np.abs(picture.depth[both].astype(np.float64) - right.depth[both])
    span = float(np.ptp(right.depth[right.covered])) if right.covered.any() else 0.0
    off_surface = ~(depth <= OTHER * span)
    color = picture.rgb[both][~off_surface] - right.rgb[both][~off_surface]
    return {"wrong": int(wrong.sum() + off_surface.sum()), "depth": rms(depth[~off_surface]), "color": rms(color)}


def measure(scene: clshade.Scene, names: Sequence[str], rounds: int, failed: dict[str, list[str]]) -> list[Result]:
    """Draw a scene with all renderers, in turns."""
    right, results = exact(scene), []
    with ExitStack() as stack:
        opened, times = {}, {}
        for name in names:
            try:
                process = Process(name, scene)
                stack.callback(process.close)
                opened[name], times[name] = (process, process.call(draw)[1], process.call(draw)[1]), []
            except RuntimeError as error:
                failed.setdefault(f"{name}: {error}", []).append(scene.name)
        start = time.perf_counter()
        for _ in range(rounds):
            for name, (process, _, _) in list(opened.items()):
                try:
                    process.call(draw)  # after another program's frames, the first finds cold caches
                    times[name].append(process.call(draw)[0])
                except RuntimeError as error:
                    failed.setdefault(f"{name}: {error}", []).append(scene.name)
                    del opened[name]
            if time.perf_counter() - start > SECONDS:
                break
    for name, (process, picture, again) in opened.items():
        same = all(a.tobytes() == b.tobytes() for a, b in zip(picture, again, strict=True))
        ms = float(np.median(times[name]))
        results.append(Result(scene.name, name, process.title, ms, same, **exact_errors(picture, right)))
    return results


# Tables


TABLES = {"wrong pixels": "wrong", "depth, RMS": "depth", "color, RMSE": "color", "ms": "ms"}


def table(results: Sequence[Result], title: str, field: str) -> list[str]:
    """Return a Markdown table of a figure, a row for each scene and a column for each renderer."""
    figures = {(entry.scene, entry.name): getattr(entry, field) for entry in results}
    names = [name for name in RENDERERS if any(name == column for _, column in figures)]
    lines = [f"| {title} | {' | '.join(names)} |", f"| --- {'| --- ' * len(names)}|"]
    for scene in dict.fromkeys(scene for scene, _ in figures):
        values = [figures.get((scene, name)) for name in names]
        digits = "" if field == "wrong" else ".3g" if field == "ms" else ".2g"
        lines.append(f"| {scene} | {' | '.join('-' if entry is None else format(entry, digits) for entry in values)} |")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=list(SCENES), default=list(SCENES), metavar="SCENE")
    parser.add_argument("--renderers", nargs="+", choices=list(RENDERERS), default=list(RENDERERS), metavar="NAME")
    parser.add_argument("--frames", type=int, default=FRAMES, metavar="N", help=f"timed frames (default: {FRAMES})")
    options = parser.parse_args(arguments)
    if options.frames < 1:
        parser.error("--frames: expected a whole number above 0")
    results: list[Result] = []
    failed: dict[str, list[str]] = {}
    for name in options.only:
        able = [entry for entry in options.renderers if (entry, name) not in CANNOT]
        results += measure(SCENES[name](RESOLUTION), able, options.frames, failed)
        print(f"{name} is done", file=sys.stderr, flush=True)
    for title, field in TABLES.items():
        print("\n".join(["", *table(results, title, field)]))
    titles = dict.fromkeys(f"{entry.name}: {entry.title}" for entry in results)
    changed = dict.fromkeys(f"{entry.name}: two frames have different bits" for entry in results if not entry.same)
    missing = (f"not drawn: {', '.join(scenes)}: {why}" for why, scenes in failed.items())
    print("\n".join(["", *titles, *changed, *missing]))
    return 0 if results else 1


if __name__ == "__main__":
    interrupts.run(main)
