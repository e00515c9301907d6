"""Random meshes: their normals, texture coordinates, colors, placements and scalars."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from random_kinds import Kind, Random
from random_shapes import Shape

from clshade.base.arrays import Array
from clshade.scene.model import Material, Mesh, Scalars

COLOR_MAPS: tuple[Any, ...] = ("viridis", "coolwarm_r", "tab10", ("black", "white"), ("red",))


def random_mesh(rng: Random, kind: Kind, material: Material, shape: Shape, all_of_it: bool = False) -> Mesh:
    """Return a mesh. all_of_it: with every feature of the kind, and not placed."""
    verts, faces = shape
    beyond = len(verts) + 3
    fields: dict[str, Any] = {}

    def wanted(share: float) -> bool:
        return all_of_it or bool(rng.random() < share)

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
