"""layers.cl: depths as exact as derived, and held to those of the corners."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_stages import image_of, mask
from stage_oracle import as_kernels_see, owners_of

from clshade.oracle import coverage, shade
from clshade.pipeline import struct_layout
from clshade.pipeline.buffers import Buffer
from clshade.pipeline.launches import Stages, items
from clshade.pipeline.programs import build

NO_INSTANCES = {"triangle_instances": None, "instances": None}


def triangles_of(xy: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return struct_layout.SINGLE.Triangle rows as `setup` writes them; xy: snapped (F, 3, 2). z: depths (F, 3)."""
    rows = np.zeros(len(xy), struct_layout.SINGLE.Triangle)
    area = coverage.signed_area(xy)
    rows["x"], rows["y"], rows["w"] = xy[..., 0], xy[..., 1], 1.0 / z
    rows["inverse_area"], rows["piece_and_turn"] = coverage.SUBPIXELS / np.abs(area), -2 + (area < 0)
    rows["face"] = np.arange(len(xy))
    return rows


def picture(resolution: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return triangles of all sizes: snapped corners, depths, and the owners of an image, row 0 at the TOP."""
    rng = np.random.default_rng(1)
    middle = rng.uniform(0, 1, (150, 1, 2)) * resolution
    size = np.exp2(rng.uniform(-1, 7, (150, 1, 1)))
    xy = np.rint(coverage.SUBPIXELS * (middle + size * rng.normal(size=(150, 3, 2)))).astype(np.int64)
    z = as_kernels_see(np.exp2(rng.uniform(-0.5, 0.5, (150, 3))))
    return xy, z, owners_of(xy, z, resolution, "depth")[::-1].astype(np.int32)


def layers(device, triangles, owners, unscale=1.0) -> tuple[np.ndarray, np.ndarray]:
    """Run the stage; return ids and depths, (M, N)."""
    stages = Stages(device, build(device, mask(OWNERS=1, DEPTH_TEST=1), ("layers.cl",)))
    image = image_of(device, owners.shape[::-1], unscale=unscale)
    ids = Buffer(device, np.full(owners.shape, 77, np.uint32))
    depths = Buffer(device, np.full(owners.shape, np.nan, np.float32))
    values = {"owners": Buffer(device, owners), "triangles": Buffer(device, triangles), "image": image, **NO_INSTANCES}
    numbers = {"shown": ids, "numbers": None, "in_table": False, "of_instances": False, "count": owners.size}
    stages.run("layer_number", items(owners.size), values, **numbers)
    stages.run("layer_z", stages.tiles("layer_z", int(image.array["tiles"][0])), values, depths=depths)
    return ids.to_host(), depths.to_host()


@pytest.mark.parametrize("resolution", [(101, 67), (1, 7)])
def test_ids_and_depths(device, resolution):
    """Depths within 4 ulp of the oracle's: edge functions are accurate to 2 units of 2^-24, each of the three terms is
    rounded once and summed, the area's reciprocal adds 2, the two products and the reciprocal 3: 8 units, at most 8
    half ulp."""
    xy, z, owners = picture(resolution)
    ids, depths = layers(device, triangles_of(xy, z), owners, unscale=8.0)
    assert np.array_equal(ids, owners + 1)
    rows, columns = np.nonzero(owners >= 0)
    owner = owners[rows, columns]
    edges = coverage.edge_functions(xy[owner], columns, resolution[1] - 1 - rows)
    expected = 8.0 * shade.depth(edges, z[owner])
    assert (np.abs(depths[rows, columns] - expected) <= 4 * np.spacing(expected.astype(np.float32))).all()
    assert (depths[owners < 0] == np.inf).all()
    assert len(rows) > 0
    if resolution == (101, 67):
        assert (owners < 0).any()
        assert len(np.unique(ids)) > 40


def test_depths_are_held_to_those_of_the_corners(device):
    """A sliver of nearly constant depth: despite rounding it is nowhere nearer or farther than its corners."""
    xy = np.rint(coverage.SUBPIXELS * np.array([[[0, 0], [64, 0], [64, 0.78]]])).astype(np.int64)
    z = as_kernels_see(np.array([[1.0, 1.0000001, 1.0000002]]))
    owners = owners_of(xy, z, (64, 2), "depth")[::-1].astype(np.int32)
    _, depths = layers(device, triangles_of(xy, z), owners)
    inside = depths[owners >= 0]
    assert len(inside) > 10
    assert (inside >= 1.0).all()
    assert (inside <= z.max().astype(np.float32)).all()
