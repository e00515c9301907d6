"""Random shapes about the origin: vertices (V, 3) and faces (F, 3), ordinary and degenerate ones."""

from __future__ import annotations

import numpy as np
from random_kinds import Random

from clshade.base.arrays import Array
from clshade.scene.camera import Camera

Shape = tuple[Array, Array]


def triangles(rng: Random, count: int) -> Shape:
    size = 10.0 ** rng.uniform(-1.5, 0.3, (count, 1, 1))
    verts = rng.normal(size=(count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    return verts.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def blob(rng: Random, _: Camera) -> Shape:
    """Return triangles without shared vertices."""
    return triangles(rng, int(rng.integers(1, 60)))


def _sheet(rng: Random, _: Camera) -> Shape:
    """Return a bent mesh with shared vertices; some faces have reversed winding."""
    cells = int(rng.integers(1, 7))
    line = np.linspace(-1.0, 1.0, cells + 1)
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    verts = np.stack([x, y, rng.uniform(-0.5, 0.5) * np.sin(2 * x * y) + 0.05 * rng.normal(size=len(x))], axis=1)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1)
    a, b, c, d = corner, corner + 1, corner + cells + 2, corner + cells + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    turned = rng.random(len(faces)) < 0.1
    faces[turned] = faces[turned][:, [0, 2, 1]]
    return verts, faces


def _needles(rng: Random, _: Camera) -> Shape:
    """Return a fan of triangles with aspect ratios up to 1e6."""
    count, width = int(rng.integers(2, 40)), 10.0 ** rng.uniform(-6, -1)
    angle = rng.uniform(0, 2 * np.pi) + np.cumsum(width * rng.uniform(0.5, 1.0, count + 1))
    rim = rng.uniform(1.0, 3.0) * np.stack([np.cos(angle), np.sin(angle), 0.1 * np.sin(angle)], axis=1)
    verts = np.concatenate([0.3 * rng.normal(size=(1, 3)), rim])
    return verts, np.stack([np.zeros(count, int), np.arange(1, count + 1), np.arange(2, count + 2)], axis=1)


def _specks(rng: Random, _: Camera) -> Shape:
    """Return triangles much smaller than a pixel, and some large ones."""
    verts, faces = triangles(rng, int(rng.integers(5, 80)))
    middle = verts.reshape(-1, 3, 3).mean(axis=1, keepdims=True)
    small = middle + 10.0 ** rng.uniform(-12, -1) * (verts.reshape(-1, 3, 3) - middle)
    return small.reshape(-1, 3), faces


def _huge(rng: Random, _: Camera) -> Shape:
    """Return triangles far larger than the image, or with a distant corner."""
    verts, faces = triangles(rng, int(rng.integers(1, 6)))
    far = 10.0 ** rng.uniform(1, 12)
    return verts * (far if rng.random() < 0.5 else np.where(rng.random((len(verts), 1)) < 0.3, far, 1.0)), faces


def _degenerate(rng: Random, _: Camera) -> Shape:
    """Return degenerate faces: repeated, collinear and coincident vertices; and duplicate faces."""
    verts, faces = triangles(rng, int(rng.integers(2, 20)))
    faces[rng.random(faces.shape) < 0.2] = 0
    on_line = np.flatnonzero(rng.random(len(faces)) < 0.3)
    verts[3 * on_line + 2] = 0.5 * (verts[3 * on_line] + verts[3 * on_line + 1])
    verts[rng.integers(len(verts))] = verts[rng.integers(len(verts))]
    return verts, np.concatenate([faces, faces[rng.integers(len(faces), size=3)]])


def _coplanar(rng: Random, _: Camera) -> Shape:
    """Return squares in a few planes, with equal or almost equal depths."""
    planes = rng.normal(size=3)
    parts = []
    for _k in range(rng.integers(2, 12)):
        low, high = np.sort(rng.uniform(-1.5, 1.5, (2, 2)), axis=0)
        z = rng.choice(planes)
        parts.append([[low[0], low[1], z], [high[0], low[1], z], [high[0], high[1], z], [low[0], high[1], z]])
    verts = np.array(parts).reshape(-1, 3)
    first = 4 * np.arange(len(parts))[:, None]
    return verts, np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])


def _straddling(rng: Random, camera: Camera) -> Shape:
    """Return triangles around the eye, some with a corner exactly there."""
    verts, faces = triangles(rng, int(rng.integers(1, 30)))
    verts = verts * 10.0 ** rng.uniform(-2, 0.5) + camera.eye
    if rng.random() < 0.5:
        verts[rng.integers(len(verts))] = camera.eye
    return verts, faces


def _behind(rng: Random, camera: Camera) -> Shape:
    verts, faces = triangles(rng, int(rng.integers(1, 10)))
    return verts + 4.0 * camera.eye, faces


def _on_centers(rng: Random, camera: Camera) -> Shape:
    """Return corners on a half-pixel grid at one depth, so that edges and corners meet pixel centers."""
    (height, width), (columns, rows) = camera.plane, camera.resolution
    count = int(rng.integers(4, 30))
    grid = rng.integers(-4, 2 * np.array([columns, rows]) + 5, (count, 2)) / 2.0
    z = np.linalg.norm(camera.lookat - camera.eye)
    reach = 1.0 if camera.orthographic else z / camera.focal
    x = (grid[:, 0] / columns - camera.principal[0]) * width * reach
    y = (grid[:, 1] / rows - camera.principal[1]) * height * reach
    forward = (camera.lookat - camera.eye) / z
    up = camera.up - camera.up @ forward * forward
    up /= np.linalg.norm(up)
    verts = camera.lookat + x[:, None] * np.cross(forward, up) + y[:, None] * up
    return verts, rng.integers(0, count, (int(rng.integers(1, 40)), 3))


def _none(_: Random, __: Camera) -> Shape:
    return np.zeros((0, 3)), np.zeros((0, 3), int)


SHAPES = (blob, _sheet, _needles, _specks, _huge, _degenerate, _coplanar, _straddling, _behind, _on_centers, _none)
