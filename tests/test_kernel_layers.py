"""layers.cl: face numbers and depths from the triangles that own the pixels."""

from __future__ import annotations

import compare
import numpy as np
import pytest
from kernels import LANES, Pipeline, bits, image_of, mask, vertices_at

from clshade import layout
from clshade.oracle import coverage, shade
from clshade.programs import build
from clshade.stages import Buffer, Stages

FILES = ("setup.cl", "bin.cl", "gouraud.cl", "layers.cl")


def drawn(device, resolution, lanes=None) -> tuple[Pipeline, np.ndarray, np.ndarray, np.ndarray]:
    """A picture of triangles of all sizes: the pipeline, owners with row 0 at the top, snapped corners and depths."""
    rng = np.random.default_rng(1)
    count = 150
    middle = rng.uniform(0, 1, (count, 1, 2)) * resolution
    size = np.exp2(rng.uniform(-1, 7, (count, 1, 1)))
    xy = np.rint(256 * (middle + size * rng.normal(size=(count, 3, 2)))).astype(np.int64)
    z = np.exp2(rng.uniform(-0.5, 0.5, (count, 3)))
    z = 1.0 / (1.0 / z).astype(np.float32).astype(np.float64)  # as the kernels see it
    pipeline = Pipeline(device, FILES, resolution, lanes=lanes, OWNERS=1, DEPTH_TEST=1, image={"unscale": 8.0})
    vertices = vertices_at(device, xy.reshape(-1, 2), z.reshape(-1))
    _, owners = pipeline.whole(vertices, np.arange(3 * count).reshape(-1, 3))
    return pipeline, owners, xy, z


def layers(pipeline: Pipeline, owners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, N) ids and depths."""
    own = Buffer(pipeline.device, owners)
    ids = Buffer(pipeline.device, np.full(owners.shape, 77, np.uint32))
    depths = Buffer(pipeline.device, np.full(owners.shape, np.nan, np.float32))
    pipeline.stages.layer_id(own, pipeline.made.triangles, ids, owners.size)
    pipeline.stages.layer_z(own, pipeline.made.triangles, pipeline.image, depths, owners.size)
    return ids.to_host(), depths.to_host()


@pytest.mark.parametrize("resolution", [(101, 67), (1, 1), (1, 7), (333, 1), (64, 48)])
def test_ids_and_depths(device, resolution):
    """Depths within 4 ulp of the oracle's: sums of three products rounded by 2 units of 2^-24 each, the area's 2, the
    products' and the reciprocal's: below 8 units, of which an ulp has one to two."""
    pipeline, owners, xy, z = drawn(device, resolution)
    ids, depths = layers(pipeline, owners)
    assert np.array_equal(ids, owners + 1)
    rows, columns = np.nonzero(owners >= 0)
    owner = owners[rows, columns]
    edges = coverage.edge_functions(xy[owner], columns, resolution[1] - 1 - rows)
    expected = 8.0 * shade.depth(edges, z[owner])
    assert compare.tied(depths[rows, columns].astype(np.float64), expected).all()
    assert (depths[owners < 0] == np.inf).all()
    assert len(rows) > 0
    if resolution == (101, 67):
        assert (owners < 0).any()
        assert len(np.unique(ids)) > 40


def test_faces_of_pieces(device):
    """An id is the triangle's face, not its index: clipped pieces share their face's."""
    triangles = np.zeros(3, layout.TRIANGLE)
    triangles["face"] = [5, 2, 16_777_215]
    owners = np.array([[-1, 2], [1, 0]], np.int32)
    stages = Stages(device, build(device, mask(OWNERS=1), ("layers.cl",)))
    inputs = Buffer(device, owners), Buffer(device, triangles)
    ids = Buffer(device, np.zeros((2, 2), np.uint32))
    stages.layer_id(*inputs, ids, 4)
    assert ids.to_host().tolist() == [[0, 16_777_216], [3, 6]]


def test_depths_are_held_to_those_of_the_corners(device):
    """A sliver seen edge-on: nowhere is it nearer or farther than its corners, whatever rounding says."""
    xy = np.array([[[0, 0], [64 * 256, 0], [64 * 256, 200]]])
    z = np.array([[1.0, 1.0000001, 1.0000002]])
    pipeline = Pipeline(device, FILES, (64, 2), OWNERS=1, DEPTH_TEST=1)
    _, owners = pipeline.whole(vertices_at(device, xy.reshape(-1, 2), z.reshape(-1)), np.array([[0, 1, 2]]))
    _, depths = layers(pipeline, owners)
    inside = depths[owners >= 0]
    assert len(inside) > 10
    assert (inside >= 1.0).all()
    assert (inside <= np.float32(1.0000003)).all()


def test_lanes_do_not_change_a_bit(device):
    found = []
    for lanes in LANES:
        pipeline, owners, _, _ = drawn(device, (45, 31), lanes)
        ids, depths = layers(pipeline, owners)
        found.append((ids, bits(depths)))
    for ids, depths in found[1:]:
        assert np.array_equal(ids, found[0][0])
        assert np.array_equal(depths, found[0][1])


def test_resolution_and_unscale_come_from_the_image(device):
    pipeline, owners, _, _ = drawn(device, (20, 10))
    _, depths = layers(pipeline, owners)
    pipeline.image = image_of(device, (20, 10), unscale=16.0)
    _, doubled = layers(pipeline, owners)
    assert np.array_equal(doubled, 2.0 * depths)
