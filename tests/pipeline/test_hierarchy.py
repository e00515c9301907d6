"""The hierarchy of casters: its tree, its order, and the frame of its coordinates."""

from __future__ import annotations

import numpy as np
import pytest
from caster_meshes import box, crumpled, random_points, soup

from clshade.pipeline import hierarchy as hierarchy_module
from clshade.pipeline.hierarchy import CasterFrame, Hierarchy
from clshade.pipeline.launches import Stages
from clshade.pipeline.struct_layout import HIERARCHY_RUN, SHADOW_REACH

Array = np.ndarray


def leaves_of(hierarchy: Hierarchy) -> tuple[Array, Array]:
    """Return corners (L, 16, 3, 3) and faces (L, 16) of the leaves."""
    rows = hierarchy.leaves.to_host().reshape(-1, 10, 16)
    return rows[:, :9].transpose(0, 2, 1).reshape(-1, 16, 3, 3), np.ascontiguousarray(rows[:, 9]).view(np.int32)


@pytest.mark.parametrize("count", [1, 15, 16, 17, 256, 257, 4096, 4097])
def test_tree(device, count):
    """Every triangle is in one leaf, every box is that of what lies below."""
    mesh = soup(count)
    hierarchy = Hierarchy(device, *mesh)
    corners, faces = leaves_of(hierarchy)
    assert np.array_equal(np.unique(faces), np.arange(count))
    assert len(faces) == -(-count // 16)
    assert np.array_equal(corners, hierarchy.vertices.array[:, 0, :3][mesh[1]][faces])
    table = hierarchy.casters.array[0]
    boxes = np.stack([corners.min(axis=(1, 2)), corners.max(axis=(1, 2))], axis=1)
    for level in range(table["levels"]):
        first, size = table["first_node"][level], -(-len(boxes) // 16)
        nodes = hierarchy.nodes.array[first : first + size].reshape(-1, 2, 3, 16).transpose(0, 3, 1, 2)
        children = nodes.reshape(-1, 2, 3)
        assert np.array_equal(children[: len(boxes)], boxes)
        assert (children[len(boxes) :, 0] > children[len(boxes) :, 1]).all()
        boxes = np.stack([nodes[:, :, 0].min(axis=1), nodes[:, :, 1].max(axis=1)], axis=1)
    assert len(boxes) == 1


def overlap(lower: Array, upper: Array) -> float:
    """Return by how much two sets of points (K, 3) overlap along the axis where they do least, as a share of both."""
    return float(((lower.max(axis=0) - upper.min(axis=0)) / np.ptp(np.concatenate([lower, upper]), axis=0)).min())


@pytest.mark.parametrize("count", [17, 300, 4096, 9000])
def test_runs_are_halved_down_to_the_leaves(device, monkeypatch, count):
    """What each part puts first lies before the rest along some axis, but for what is within one of 64 steps. Parts begin
    with whole leaves, and above 256 triangles with whole nodes."""
    monkeypatch.setattr(hierarchy_module, "_TOGETHER", 4096)  # several launches
    mesh = soup(count)
    centroids = mesh[0][mesh[1]].mean(axis=1)[leaves_of(Hierarchy(device, *mesh))[1].reshape(-1)[:count]]

    def check(points: Array) -> None:
        if len(points) > 16:
            unit = 256 if len(points) > 256 else 16
            first = -(-len(points) // (2 * unit)) * unit
            assert overlap(points[:first], points[first:]) <= 1 / 64
            check(points[:first])
            check(points[first:])

    for start in range(0, count, HIERARCHY_RUN):
        check(centroids[start : start + HIERARCHY_RUN])


def test_neighbors_along_the_curve(device, monkeypatch):
    """Of triangles one per cell, in the order before that of runs, each lies in a cell next to that of the one before."""
    run = Stages.run
    monkeypatch.setattr(
        Stages, "run", lambda self, name, *rest, **extra: name == "hierarchy_runs" or run(self, name, *rest, **extra)
    )
    cells = np.stack(np.meshgrid(*[np.arange(16)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    small = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.1]]) + 0.45
    vertices = (cells[:, None] + small).reshape(-1, 3)
    end = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0]]) + 0.001  # the frame is as large as all cells
    ends = np.concatenate([end, 16.0 - end])
    mesh = np.concatenate([vertices, ends]), np.arange(len(vertices) + len(ends)).reshape(-1, 3)
    faces = leaves_of(Hierarchy(device, *mesh))[1].reshape(-1)
    along = cells[faces[(faces < len(cells)) & (np.arange(len(faces)) < len(mesh[1]))]]
    assert len(along) == 4096
    assert (np.abs(np.diff(along, axis=0)).sum(axis=1) == 1).all()


def test_indices_of_many_bits(device, monkeypatch):
    """As many as so many faces need: the curve is then coarser, and the same triangles cast the same shadows."""
    mesh = crumpled(16)
    expected = Hierarchy(device, *mesh)
    assert [hierarchy_module._index_bits(count) for count in (0, 2**26, 2**26 + 1, 2**29)] == [26, 26, 27, 29]
    monkeypatch.setattr(hierarchy_module, "_index_bits", lambda count: 40)
    hierarchy = Hierarchy(device, *mesh)
    corners, faces = leaves_of(hierarchy)
    assert np.array_equal(np.unique(faces), np.arange(len(mesh[1])))
    assert np.array_equal(corners, hierarchy.vertices.array[:, 0, :3][mesh[1]][faces])
    assert not np.array_equal(faces, leaves_of(expected)[1])
    rays = *random_points(mesh, 1600), np.array([0.3, -0.2, 0.4, 1.0])
    assert np.array_equal(hierarchy.shadowed(*rays), expected.shadowed(*rays))


def test_triangles_that_cast_nothing(device):
    """Those with two equal corners or one that is not finite are left out, the others stay; none may be left."""
    vertices, faces = box()
    vertices = np.concatenate([vertices, [[np.nan, 0, 0], [0, np.inf, 0]]])
    faces = np.concatenate([faces, [[0, 1, 8], [9, 2, 3], [0, 0, 1], [1, 2, 1]]])
    hierarchy = Hierarchy(device, vertices, faces)
    assert np.array_equal(np.unique(leaves_of(hierarchy)[1]), np.arange(12))
    point, light = np.array([[0.0, 0.0, -1.0]]), np.array([0.0, 0.0, 3.0, 1.0])
    assert hierarchy.shadowed(point, [0], light).all()
    assert not Hierarchy(device, vertices[:8], faces[-1:]).shadowed(point, [0], light).any()


@pytest.mark.parametrize("offset", [0.0, 1e9])
@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_frame(offset, scale):
    """Coordinates fill the range, and are within half a unit of the grid of what they stand for."""
    vertices = (np.random.default_rng(5).normal(size=(100, 3)) * [1.0, 0.1, 0.01] + offset) * scale
    frame = CasterFrame.around(vertices)
    pairs = frame.pairs(vertices).astype(np.float64)
    coordinates = pairs[:, :3] + pairs[:, 3:]
    assert SHADOW_REACH / 2 <= np.abs(coordinates).max() <= SHADOW_REACH
    assert np.array_equal(coordinates * 2.0**31, np.rint(coordinates * 2.0**31))
    assert np.abs(coordinates - (vertices - frame.origin) * frame.unit).max() <= 2.0**-32
