"""Random meshes: shapes about the origin, ordinary and degenerate ones; their normals, texture coordinates, colors,
placements and scalars."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from random_kinds import Kind, Random, is_wanted

from clshade.base.arrays import Array
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scalars

Shape = tuple[Array, Array]  # vertices (V, 3) and faces (F, 3)
COLOR_MAPS: tuple[Any, ...] = ("viridis", "coolwarm_r", "tab10", ("black", "white"), ("red",))


def random_mesh(rng: Random, kind: Kind, material: Material, shape: Shape, all_of_it: bool = False) -> Mesh:
    """Return a mesh. all_of_it: with every feature of the kind, and not placed."""
    verts, faces = shape
    beyond = len(verts) + 3
    fields: dict[str, Any] = {}
    wanted = partial(is_wanted, rng, always=all_of_it)
    if kind.colored and rng.random() < 0.7:
        maximum = 1.0 if kind.dim else rng.choice((1.0, 1.0, 1.0, 10.0))
        fields["colors"] = maximum * rng.uniform(0, 1, (len(verts), 3))
    if kind.bright and all_of_it:
        fields["colors"] = 3.0 * rng.uniform(0.5, 1, (len(verts), 3))
    indexed = kind.normal_faces and wanted(0.5)
    if indexed or rng.random() < 0.4:
        fields["normals"] = _directions(rng, beyond, 3)
        if indexed:
            fields["normal_faces"] = rng.integers(0, beyond, faces.shape)
    # With a single material every mesh has coordinates: without them, it would count as another material.
    if kind.textured and (not kind.several or wanted(0.8)):
        fields["uvs"] = _coordinates(rng, beyond)
        if kind.uv_faces and wanted(0.5):
            fields["uv_faces"] = rng.integers(0, beyond, faces.shape)
        if kind.maps:
            fields["more_uvs"] = (rng.uniform(-1.5, 2.5, (beyond, 2)),)
            if rng.random() < 0.5:
                fields["tangents"] = _directions(rng, beyond, 4)
                fields["tangent_faces"] = rng.integers(0, beyond, faces.shape)
    if kind.transparent and wanted(0.5):
        fields["alphas"] = rng.uniform(0, 1, len(verts)) * (rng.random(len(verts)) < 0.8)
    if not all_of_it:
        fields["instances"] = _placements(rng, kind.double)
    return Mesh(verts, faces, material=material, **fields)


def _directions(rng: Random, count: int, width: int) -> Array:
    directions = rng.normal(size=(count, width))
    if rng.random() < 0.3:
        directions *= 10.0 ** rng.uniform(-20, 20, (count, 1))
    if rng.random() < 0.3:
        directions[rng.random(count) < 0.2] = 0.0
    return directions


def _coordinates(rng: Random, count: int) -> Array:
    """Return texture coordinates in [0, 1] and beyond; or all equal, with any value."""
    uvs = rng.uniform(-1.5, 2.5, (count, 2)) if rng.random() < 0.6 else rng.uniform(0, 1, (count, 2))
    if rng.random() < 0.1:
        uvs *= 10.0 ** rng.uniform(0, 4)
    elif rng.random() < 0.1:
        uvs[:] = rng.choice((0.0, -0.0, 1.0, 1e30, np.nan, np.inf, -np.inf), 2)
    return uvs


def _placements(rng: Random, double: bool) -> Array | None:
    """Return one to three placements; without `double`, only those that map float32 values to float32 values."""
    if rng.random() < 0.6:
        return None
    placements = np.tile(np.eye(4), (int(rng.integers(1, 4)), 1, 1))
    for matrix in placements:
        if double:
            matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.3, 1.5, 3)
            matrix[:3, 3] = rng.normal(size=3)
        else:
            matrix[:3, :3] = np.diag(rng.choice((-1.0, 1.0), 3))[rng.permutation(3)]
        if rng.random() < 0.1:
            matrix[:3, rng.integers(3)] = 0.0  # flattened
    return placements


def moved_mesh(mesh: Mesh, scale: float, shift: Array, double: bool) -> Mesh:
    """Return the mesh times `scale` plus `shift`, in float32 without `double`; placements are about the shifted origin."""
    verts = mesh.verts * scale
    if not double:
        return replace(mesh, verts=(verts + shift).astype(np.float32))
    placed = np.array(mesh.instances)
    if np.array_equal(placed, np.eye(4)[None]):
        return replace(mesh, verts=verts + shift, instances=None)
    placed[:, :3, 3] = placed[:, :3, 3] * scale + shift
    return replace(mesh, verts=verts, instances=placed)


def with_scalars(rng: Random, kind: Kind, mesh: Mesh) -> tuple[Mesh, Scalars]:
    """Return the mesh with scalars, of its "vertices", finite and not all equal, or such that its faces' "corners"
    differ; and a color map, whose ends are the values' own, two of them, or with "corners" also far from them or
    equal."""
    values = _of_vertices(rng, len(mesh.verts)) if kind.scalars == "vertices" else _of_corners(rng, mesh)
    finite = np.unique(values[np.isfinite(values)])
    clim: Any = None
    if len(finite) > 1 and rng.random() < 0.5:
        clim = tuple(np.sort(rng.choice(finite, 2, replace=False)).tolist())
    elif kind.scalars == "corners" and rng.random() < 0.5:
        low = float(rng.choice((0.0, -1.0, 1e300, 1e-300)))
        clim = (low, low if rng.random() < 0.5 else abs(low) * 2.0 + 1e-310)
    colors = COLOR_MAPS[rng.integers(len(COLOR_MAPS))]
    return replace(mesh, scalars={"data": values}), Scalars("data", colors, clim)


def _of_vertices(rng: Random, count: int) -> Array:
    values = rng.normal(size=count) if rng.random() < 0.5 else rng.integers(0, 5, count).astype(np.float64)
    values[:2] = 0.0, 1.0
    return np.asarray(values * 10.0 ** rng.uniform(-12, 12) + (1e3 if rng.random() < 0.2 else 0.0))


def _of_corners(rng: Random, mesh: Mesh) -> Array:
    faces, shape = len(mesh.faces), (len(mesh.faces), 3)
    if rng.random() < 0.5 and faces != len(mesh.verts):
        shape = shape[:1]  # type: ignore[assignment]
    values = rng.normal(size=shape) if rng.random() < 0.5 else rng.integers(0, 4, shape).astype(np.float64)
    if rng.random() < 0.5:
        values *= 10.0 ** rng.uniform(-300, 300, shape if rng.random() < 0.5 else ())
    if rng.random() < 0.5:
        values[rng.random(shape) < 0.2] = rng.choice((np.nan, np.inf, 0.0, 1e308, 5e-324))
    return values


# Shapes


def triangles(rng: Random, count: int) -> Shape:
    size = 10.0 ** rng.uniform(-1.5, 0.3, (count, 1, 1))
    verts = rng.normal(size=(count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    return verts.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def blob(rng: Random, _: Camera) -> Shape:
    return triangles(rng, int(rng.integers(1, 60)))


def _sheet(rng: Random, _: Camera) -> Shape:
    """Return a bent mesh with shared vertices; some faces have reversed winding."""
    cells = int(rng.integers(1, 7))
    line = np.linspace(-1.0, 1.0, cells + 1)
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    verts = np.stack([x, y, rng.uniform(-0.5, 0.5) * np.sin(2 * x * y) + 0.05 * rng.normal(size=len(x))], axis=1)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1, 1)
    faces = np.concatenate([corner + [0, 1, cells + 2], corner + [0, cells + 2, cells + 1]])
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
