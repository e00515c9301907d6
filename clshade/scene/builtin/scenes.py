"""Built-in scenes, generated in code: `builtin("teapot")`. The same call gives the same arrays, bit for bit."""

from __future__ import annotations

import inspect
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...base import host_memory
from ...base.arrays import Array
from ...base.validation import choice, flag, integer, known, value_error
from ..camera import Camera
from ..model import MAX_FACES, Material, Mesh, PointLight, RectangleLight, Scene, Texture
from . import teapot as newell

Resolution = tuple[int, int]

DARK = np.array([0.004, 0.0045, 0.006])  # background


def builtin(name: str = "teapot", **options: Any) -> Scene:
    """Create a built-in scene. The same call gives the same arrays, bit for bit.

    Parameters
    ----------
    name : {"teapot", "torus_knot", "icosphere", "quads", "box_room", "course"}
        Name of the scene.
    **options
        Options of that scene, see Notes.

    Notes
    -----
    Every scene takes `resolution`, (N, M), columns and rows: by default (1920, 1080) for `quads`,
    (512, 512) for `course` and (800, 600) for the others. Further options:

    - teapot: `level`, 2 to 500, default 10: cells along each side of a Bezier patch; the pot has
      64*level**2 triangles, the floor 4248.
    - torus_knot: `triangles`, 18 to 536870912, default 100000: their number, as close as cells that
      are not too elongated allow; `p` and `q`, 1 to 50, default 2 and 3: turns around the axis of
      the torus and around its tube, without a common divisor.
    - icosphere: `level`, 0 to 9, default 5: subdivisions of an icosahedron, 20*4**level triangles.
    - quads: `count`, 1 to 4096, default 32, quads one behind the other, of two triangles each;
      `seed` of their order, 0 to 2**32-1, default 1.
    - box_room: `divisions`, 1 to 256, default 16: cells along each side of a wall; `soft`, default
      False: lit by its lamp, a RectangleLight, and a dim light at the eye, as on the command line.
    - course: `level`, 2 to 500, default 8, as for teapot; 64*level**2 triangles.

    Examples
    --------
    >>> import clshade
    >>> clshade.builtin("icosphere", level=3)
    <Scene icosphere: 1,280 triangles, 1 mesh, 1 light, 800x600, preset standard>
    """
    build = BUILTINS[choice("builtin", "name", name, BUILTINS)]
    known(f"builtin {name!r}", options, inspect.signature(build).parameters)
    scene = build(**options)
    return replace(scene, meshes=tuple(map(_in_float32, scene.meshes)))


def _in_float32(mesh: Mesh) -> Mesh:
    """Return the mesh in float32: the last bit of a float64 sine depends on the machine, and golden images must not."""
    names = ("verts", "normals", "uvs", "colors")
    wide = {name: getattr(mesh, name) for name in names if getattr(getattr(mesh, name), "dtype", None) == np.float64}
    return replace(mesh, **{name: array.astype(np.float32) for name, array in wide.items()}) if wide else mesh


def teapot(level: int = 10, resolution: Resolution = (800, 600)) -> Scene:
    """Newell's teapot, blue and white porcelain on a marble floor, under a white, an orange and a blue light."""
    parts = newell.parts(integer("teapot", "level", level, 2, 500))
    lights = _lights(
        ((1.6, 4.6, 8.8), (0.90, 0.87, 0.80)),
        ((-7.5, 4.0, -0.5), (2.1, 0.62, 0.07)),
        ((7.5, 4.2, 0.5), (0.12, 0.45, 1.8)),
    )
    porcelain: dict[str, Any] = {"ka": 0.10, "kd": 0.58, "ks": 1.2, "n": 90.0}
    images = {"body": newell.body_image(), "lid": newell.lid_image(), "tube": newell.tube_image()}
    glazed = {k: Material(**porcelain, texture=Texture(image, name=k), name=k) for k, image in images.items()}
    clay = Material(ka=0.05, kd=0.15, ks=0.0, n=1.0, name="clay")
    materials = {**glazed, "seat": clay, "handle": glazed["tube"], "spout": glazed["tube"]}
    meshes = [
        _pot_part(name, grids[0], grids[1], _grid_uvs(grids[0], 4.0 if name in glazed else 1.0), materials[name])
        for name, grids in parts.items()
    ]
    camera = Camera.from_fov((-2.4, 4.9, 9.2), (0.18, 1.32, 0.0), (0.0, 1.0, 0.0), 35.0)
    return Scene((*meshes, _floor(lights)), camera.with_resolution(resolution), lights, np.ones(3), DARK, name="teapot")


def _lights(*positions_and_intensities: tuple[Any, Any]) -> tuple[PointLight, ...]:
    return tuple(PointLight(position, intensity) for position, intensity in positions_and_intensities)


# Grids


def _grid_faces(rows: int, columns: int) -> Array:
    """Return (2*rows*columns, 3) int32: two triangles per cell of a grid of (rows+1)*(columns+1) points, row by row.

    They are counter-clockwise seen from the side to which (down the rows) x (along the columns) points.
    """
    corner = np.arange(rows * (columns + 1), dtype=np.int32).reshape(rows, columns + 1)[:, :-1].ravel()
    below, right = corner + np.int32(columns + 1), corner + np.int32(1)
    return np.stack([corner, below, below + np.int32(1), corner, below + np.int32(1), right], axis=1).reshape(-1, 3)


def _grid_uvs(positions: Array, turns: float = 1.0) -> Array:
    """Return u from 0 to `turns` along the columns, and v from 0 to 1 by arc length along the first column."""
    steps = np.sqrt((np.diff(positions[:, 0], axis=0) ** 2).sum(axis=1))
    down = np.concatenate([[0.0], np.cumsum(steps)])
    right = np.linspace(0.0, turns, positions.shape[1])
    return np.stack(np.broadcast_arrays(right, down[:, None] / down[-1]), axis=-1)


def _welded(positions: Array) -> tuple[Array, Array, Array]:
    """Return the vertices and faces of a grid of points with equal points merged, and the matching `_grid_faces`.

    Triangles that become degenerate are removed from both kinds of faces.
    """
    grid = _grid_faces(positions.shape[0] - 1, positions.shape[1] - 1)
    verts, index = np.unique(positions.reshape(-1, 3), axis=0, return_inverse=True)
    faces = index.reshape(-1).astype(np.int32)[grid]
    a, b, c = faces.T
    is_proper = (a != b) & (b != c) & (c != a)
    return verts, faces[is_proper], grid[is_proper]


def _pot_part(name: str, positions: Array, normals: Array, uvs: Array, material: Material) -> Mesh:
    """A part of the teapot, darker towards the floor, which blocks light."""
    verts, faces, grid = _welded(positions)
    return Mesh(
        verts,
        faces,
        colors=np.repeat(0.45 + 0.55 * newell.smoothstep(-0.1, 0.9, verts[:, 1:2]), 3, axis=1),
        normals=normals.reshape(-1, 3),
        normal_faces=grid,
        uvs=uvs.reshape(-1, 2),
        uv_faces=grid,
        material=material,
        name=name,
    )


def _floor(lights: Sequence[PointLight]) -> Mesh:
    """A disk of marble, dark towards its edge, with the shadows of the pot painted on it (preset `standard` casts none).

    A vertex color is the fraction of the light, per channel, that reaches the vertex past the pot.
    """
    rings, spokes, ambient, reach = 30, 72, 0.15, 8.0
    radius = reach * np.linspace(0.0, 1.0, rings + 1)[:, None]
    angle = 2.0 * np.pi * np.arange(spokes + 1) / spokes
    positions = np.stack([radius * np.sin(angle), np.zeros((rings + 1, spokes + 1)), radius * np.cos(angle)], axis=-1)
    positions[:, -1] = positions[:, 0]
    verts, faces, _ = _welded(positions)
    ambients = np.full((len(verts), 3), ambient)
    passed = ambients.copy()
    for light, hidden in zip(lights, newell.shadows([light.position for light in lights], verts), strict=True):
        to = light.position - verts
        reaching = light.intensity * (to[:, 1] / np.sqrt((to * to).sum(axis=1)))[:, None]
        ambients += reaching
        passed += reaching * (1.0 - hidden)[:, None]
    distance = np.sqrt((verts * verts).sum(axis=1))
    contact = 1.0 - 0.8 * np.exp(-2.2 * np.maximum(distance - 1.4, 0.0))
    fade = contact * (0.03 + 0.97 * newell.smoothstep(reach, 2.5, distance))
    texture = Texture(newell.marble_image(), name="marble")
    return Mesh(
        verts,
        faces,
        colors=passed / ambients * fade[:, None],
        normals=np.array([[0.0, 1.0, 0.0]]),
        normal_faces=np.zeros_like(faces),
        uvs=verts[:, [0, 2]] / 4.0,
        material=Material(ka=ambient, kd=0.7, ks=0.4, n=60.0, texture=texture, name="marble"),
        name="floor",
    )


# The others


def torus_knot(triangles: int = 100_000, p: int = 2, q: int = 3, resolution: Resolution = (800, 600)) -> Scene:
    """A tube along the (p, q) torus knot: one smooth closed surface without texture, in float32, under three lights."""
    triangles = integer("torus_knot", "triangles", triangles, 18, MAX_FACES)
    host_memory.require("torus_knot", "triangles", 24 * triangles, f"{triangles:,}")
    p, q = integer("torus_knot", "p", p, 1, 50), integer("torus_knot", "q", q, 1, 50)
    if math.gcd(p, q) != 1:
        raise value_error("torus_knot", "p, q", "numbers without a common divisor", (p, q))
    tube = 0.26 * min(math.sin(math.pi / max(p, 2)), 2.0 * math.sin(math.pi / max(q, 2)) / 1.7)
    angle = np.linspace(0.0, 2.0 * np.pi, 4097)
    length = np.sqrt((np.diff(_knot_frame(angle, p, q)[0], axis=0) ** 2).sum(axis=1)).sum()
    segments, sides = _knot_cells(triangles, length / (2.0 * np.pi * tube))
    verts, normals = (np.empty((segments, sides, 3), np.float32) for _ in range(2))
    turn = 2.0 * np.pi * np.arange(sides)[:, None] / sides
    step = max(1, 100_000 // sides)
    for start in range(0, segments, step):  # in blocks, to bound the float64 temporaries
        stop = min(start + step, segments)
        centers, outward, sideways = _knot_frame(2.0 * np.pi * np.arange(start, stop) / segments, p, q)
        normals[start:stop] = block = np.cos(turn) * outward[:, None] + np.sin(turn) * sideways[:, None]
        verts[start:stop] = centers[:, None] + tube * block
    mesh = Mesh(
        verts.reshape(-1, 3),
        _torus_faces(segments, sides),
        normals=normals.reshape(-1, 3),
        material=Material(ka=0.1, kd=(0.75, 0.62, 0.45), ks=0.7, n=40.0, name="brass"),
        name="knot",
    )
    lights = _lights(
        ((3.0, 4.0, 5.0), (1.1, 1.05, 1.0)),
        ((-5.0, 1.0, 2.0), (1.2, 0.3, 0.2)),
        ((1.0, -5.0, 2.0), (0.15, 0.4, 1.2)),
    )
    camera = Camera.from_fov((0.0, -1.6, 4.6), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 45.0).with_resolution(resolution)
    return Scene((mesh,), camera, lights, np.full(3, 0.5), DARK, name="torus_knot")


def _knot_frame(angle: Array, p: int, q: int) -> tuple[Array, Array, Array]:
    """Return points (K, 3) of the knot on a torus of radii 1 and 1/2, the normals of the torus there, and its tangents
    across the knot: normal x direction of travel."""
    radial = np.stack([np.cos(p * angle), np.sin(p * angle), np.zeros_like(angle)], axis=1)
    axis = np.array([0.0, 0.0, 1.0])
    c, s = np.cos(q * angle)[:, None], np.sin(q * angle)[:, None]
    outward = c * radial + s * axis
    travel = p * (1.0 + 0.5 * c) * np.cross(axis, radial) + 0.5 * q * (c * axis - s * radial)
    travel /= np.sqrt((travel * travel).sum(axis=1, keepdims=True))
    return radial + 0.5 * outward, outward, np.cross(outward, travel)


def _knot_cells(triangles: int, ratio: float) -> tuple[int, int]:
    """Return segments and sides, at least 3: 2*segments*sides nearest `triangles`, then their ratio nearest `ratio`."""
    ideal = math.sqrt(triangles / (2.0 * ratio))
    sides = np.arange(max(3, int(0.5 * ideal)), max(3, int(2.0 * ideal)) + 2)
    segments = np.clip(np.rint(triangles / (2.0 * sides)).astype(np.int64), 3, MAX_FACES // (2 * sides))
    best = np.lexsort((np.abs(np.log(sides / ideal)), np.abs(2 * segments * sides - triangles)))[0]
    return int(segments[best]), int(sides[best])


def _torus_faces(segments: int, sides: int) -> Array:
    """Return (2*segments*sides, 3) int32: the triangles of a grid of vertices that closes in both directions."""
    faces = np.empty((segments, sides, 2, 3), np.int32)
    index = np.arange(segments * sides, dtype=np.int32).reshape(segments, sides)
    faces[:, :, :, 0] = index[:, :, None]
    faces[:-1, :, 0, 1], faces[-1, :, 0, 1] = index[1:], index[0]
    faces[:, :-1, 1, 2], faces[:, -1, 1, 2] = index[:, 1:], index[:, 0]
    faces[:, :-1, 0, 2], faces[:, -1, 0, 2] = faces[:, 1:, 0, 1], faces[:, 0, 0, 1]
    faces[:, :, 1, 1] = faces[:, :, 0, 2]
    return faces.reshape(-1, 3)


def icosphere(level: int = 5, resolution: Resolution = (800, 600)) -> Scene:
    """A unit sphere about the origin: an icosahedron subdivided `level` times, under one light."""
    verts, faces = _icosahedron()
    for _ in range(integer("icosphere", "level", level, 0, 9)):
        verts, faces = _cut_in_four(verts, faces)
    mesh = Mesh(verts, faces, normals=verts, material=Material(ka=0.05, kd=0.8, ks=0.4, n=30.0), name="sphere")
    camera = Camera.from_fov((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 35.0).with_resolution(resolution)
    return Scene((mesh,), camera, _lights(((0.0, 0.0, 8.0), (1.0, 1.0, 1.0))), name="icosphere")


def _icosahedron() -> tuple[Array, Array]:
    """Return 12 unit vectors and the 20 triples of neighbors among them, counter-clockwise from outside."""
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    corners = [np.roll((0.0, a, b * golden), k) for k in range(3) for a in (-1, 1) for b in (-1, 1)]
    verts = np.array(corners) / math.sqrt(1.0 + golden**2)
    triples = np.array(list(itertools.combinations(range(12), 3)), np.int32)
    a, b, c = (verts[triples[:, k]] for k in range(3))
    near = np.all([((x - y) ** 2).sum(axis=1) < 1.2 for x, y in ((a, b), (b, c), (c, a))], axis=0)
    outward = (np.cross(a, b) * c).sum(axis=1, keepdims=True) > 0.0
    return verts, np.where(outward, triples, triples[:, ::-1])[near]


def _cut_in_four(verts: Array, faces: Array) -> tuple[Array, Array]:
    """Split each triangle of a mesh of unit vectors at its edges' midpoints, which are moved out to the sphere."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1).astype(np.int64)
    edges, index = np.unique(ends[:, 0] * len(verts) + ends[:, 1], return_inverse=True)
    middles = verts[edges // len(verts)] + verts[edges % len(verts)]
    middles /= np.sqrt((middles * middles).sum(axis=1, keepdims=True))
    (a, b, c), (ab, bc, ca) = faces.T, (index.reshape(-1, 3) + len(verts)).astype(np.int32).T
    cut = np.stack([a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca], axis=1)
    return np.concatenate([verts, middles]), cut.reshape(-1, 3)


def quads(count: int = 32, seed: int = 1, resolution: Resolution = (1920, 1080)) -> Scene:
    """Quads that face the camera, one behind the other in random order, each covering every pixel in its own color. Quad k
    consists of faces 2k and 2k+1."""
    count, seed = integer("quads", "count", count, 1, 4096), integer("quads", "seed", seed, 0, 2**32 - 1)
    camera = Camera.from_fov((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 60.0).with_resolution(resolution)
    depth = np.random.default_rng(seed).permutation(np.linspace(2.0, 10.0, count))[:, None, None]
    height, width = camera.plane
    corner = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * [0.55 * width, 0.55 * height]
    verts = np.concatenate([corner * depth, np.broadcast_to(-depth, (count, 4, 1))], axis=2).reshape(-1, 3)
    faces = (4 * np.arange(count)[:, None, None] + [[0, 1, 2], [0, 2, 3]]).reshape(-1, 3)
    hue = np.arange(count)[:, None] * ((math.sqrt(5.0) - 1.0) / 2.0) + np.array([0.0, 1.0, 2.0]) / 3.0
    mesh = Mesh(
        verts,
        faces,
        colors=np.repeat(0.55 + 0.4 * np.cos(2.0 * np.pi * hue), 4, axis=0),
        normals=np.array([[0.0, 0.0, 1.0]]),
        normal_faces=np.zeros_like(faces),
        material=Material(ka=0.1, kd=0.8, ks=0.3, n=20.0),
        name="quads",
    )
    lights = _lights(((1.0, 1.0, 0.0), (1.0, 1.0, 1.0)), ((-2.0, 0.5, 0.0), (0.6, 0.3, 0.2)))
    return Scene((mesh,), camera, lights, name="quads")


def box_room(divisions: int = 16, resolution: Resolution = (800, 600), soft: bool = False) -> Scene:
    """The inside of a room with a red and a green wall, two boxes and a lamp, under four lights. The walls extend past the
    eye, so that the near plane clips triangles. soft: shadows without hard edges, and a brighter ambient light."""
    divisions = integer("box_room", "divisions", divisions, 1, 256)
    gray, red, green = (0.72, 0.70, 0.66), (0.62, 0.06, 0.05), (0.10, 0.42, 0.09)
    # Center, half extent along the rows, half extent along the columns: rows x columns points inwards.
    walls = {
        "floor": ((0.0, 0.0, 0.0), (0.0, 0.0, 2.0), (1.3, 0.0, 0.0), gray),
        "ceiling": ((0.0, 2.0, 0.0), (1.3, 0.0, 0.0), (0.0, 0.0, 2.0), gray),
        "back": ((0.0, 1.0, -2.0), (1.3, 0.0, 0.0), (0.0, 1.0, 0.0), gray),
        "left": ((-1.3, 1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2.0), red),
        "right": ((1.3, 1.0, 0.0), (0.0, 0.0, 2.0), (0.0, 1.0, 0.0), green),
    }
    meshes = [_wall(name, *wall, divisions) for name, wall in walls.items()]
    lamp = _wall("lamp", (0.0, 1.995, -0.7), (0.4, 0.0, 0.0), (0.0, 0.0, 0.3), gray, 1)
    glow = Material(ka=(6.0, 5.4, 4.2), kd=0.0, ks=0.0, n=1.0, name="lamp")
    boxes = _boxes(((-0.45, 0.62, -1.05), (0.36, 0.62, 0.36), 20.0), ((0.5, 0.32, -0.6), (0.32, 0.32, 0.32), -20.0))
    lights = _lights(
        ((0.0, 1.9, -0.7), (0.75, 0.66, 0.50)),
        ((0.9, 1.6, 1.2), (0.16, 0.20, 0.30)),
        ((-1.0, 0.3, -1.7), (0.35, 0.14, 0.05)),
        ((0.0, 0.9, 1.3), (0.12, 0.12, 0.12)),
    )
    camera = Camera.from_fov((0.0, 1.0, 1.6), (0.0, 0.92, 0.0), (0.0, 1.0, 0.0), 60.0).with_resolution(resolution)
    scene = Scene((*meshes, replace(lamp, colors=None, material=glow), boxes), camera, lights, name="box_room")
    if not flag("box_room", "soft", soft):
        return scene
    below = RectangleLight((0.0, 1.99, -0.7), (0.4, 0.0, 0.0), (0.0, 0.0, 0.3), (1.2, 1.08, 0.86))
    fill = PointLight(camera.eye, (0.16, 0.17, 0.2))  # its shadows are out of sight
    return replace(scene, lights=(below, fill), ambient=(2.0, 1.8, 1.5))


def _wall(name: str, middle: Any, along_rows: Any, along_columns: Any, color: Any, divisions: int) -> Mesh:
    """A rectangle of divisions x divisions cells along two axes, darker at its borders, facing rows x columns."""
    step = np.linspace(-1.0, 1.0, divisions + 1)
    a, b = np.array(along_rows), np.array(along_columns)
    verts = (np.array(middle) + step[:, None, None] * a + step[:, None] * b).reshape(-1, 3)
    dark_a, dark_b = (1.0 - 0.45 * np.exp((np.abs(step) - 1.0) * np.abs(v).sum() / 0.2) for v in (a, b))
    faces = _grid_faces(divisions, divisions)
    return Mesh(
        verts,
        faces,
        colors=(dark_a[:, None] * dark_b).reshape(-1, 1) * np.array(color),
        normals=np.sign(np.cross(a, b))[None],
        normal_faces=np.zeros_like(faces),
        material=Material(ka=0.12, kd=0.85, ks=0.05, n=8.0, name=name),
        name=name,
    )


def _boxes(*boxes: tuple[Any, Any, float]) -> Mesh:
    """Instances of the cube from -1 to 1 with flat normals, each placed at (center, half extents, degrees about y)."""
    placements = np.tile(np.eye(4), (len(boxes), 1, 1))
    for matrix, (middle, half, degrees) in zip(placements, boxes, strict=True):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        matrix[:3, :3] = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]) * half
        matrix[:3, 3] = middle
    sides = []
    for axis, sign in itertools.product(range(3), (-1, 1)):
        corner = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])[::sign]
        sides.append(np.roll(np.insert(corner, 2, sign, axis=1), axis + 1, axis=1))
    return Mesh(
        np.concatenate(sides),
        (4 * np.arange(6)[:, None, None] + [[0, 1, 2], [0, 2, 3]]).reshape(-1, 3),
        normals=np.array([side.mean(axis=0) for side in sides]),
        normal_faces=np.repeat(np.arange(6), 6).reshape(-1, 3),
        material=Material(ka=0.12, kd=(0.70, 0.64, 0.52), ks=0.6, n=60.0, name="box"),
        instances=placements,
        name="boxes",
    )


def course(level: int = 8, resolution: Resolution = (512, 512)) -> Scene:
    """A scene as the course sets it: one mesh, seen through the course's camera, under its three lights. It is the teapot,
    2 units long, with vertex colors and a texture that replaces them."""
    verts, faces, uvs, uv_faces = (np.empty((0, k), t) for k, t in ((3, float), (3, int), (2, float), (3, int)))
    for positions, _ in newell.parts(integer("course", "level", level, 2, 500)).values():
        more, among_verts, among_uvs = _welded(positions)
        faces, uv_faces = np.append(faces, among_verts + len(verts), 0), np.append(uv_faces, among_uvs + len(uvs), 0)
        verts, uvs = np.append(verts, more, 0), np.append(uvs, _grid_uvs(positions).reshape(-1, 2), 0)
    verts = (verts - (verts.min(axis=0) + verts.max(axis=0)) / 2.0) * (2.0 / np.ptp(verts[:, 0]))
    height = (verts[:, 1:2] - verts[:, 1].min()) / np.ptp(verts[:, 1])
    colors = (1.0 - height) * np.array([0.10, 0.28, 0.32]) + height * np.array([0.55, 0.45, 0.30])
    texture = Texture(newell.swirl_image(), lookup="course", name="swirl")
    material = Material(ka=0.1, kd=0.8, ks=1.0, n=1.0, texture=texture)
    mesh = Mesh(verts, faces, colors, uvs=uvs, uv_faces=uv_faces, material=material, name="teapot")
    lights = _lights(
        ((0.0, 0.0, 5.0), (1.0, 1.0, 1.0)),
        ((-7.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
        ((0.0, 5.0, 0.0), (0.937, 0.753, 0.492)),
    )
    camera = Camera(np.array([-4.0, 4.0, 9.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 70.0, (15.0, 15.0))
    return Scene(
        (mesh,),
        camera.with_resolution(resolution),
        lights,
        ambient=np.full(3, 0.2),
        background=np.ones(3),
        preset="course",
        name="course",
    )


BUILTINS: dict[str, Callable[..., Scene]] = {
    build.__name__: build for build in (teapot, torus_knot, icosphere, quads, box_room, course)
}
