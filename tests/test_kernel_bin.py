"""bin.cl: each tile's list holds every triangle with a pixel in it, none whose box misses it, in the given order."""

import numpy as np
import pytest
from kernel_stages import Pipeline, samples_at
from stage_oracle import hull, seen_from

from clshade.oracle import coverage
from clshade.pipeline import struct_layout
from clshade.pipeline.camera_space import sample_positions

TILE, PIXEL = struct_layout.TILE_SIZE, coverage.SUBPIXELS


def triangles(seed: int, count: int = 1500) -> np.ndarray:
    """Return snapped corners (F, 3, 2): mostly small, some across the image, some needles, some far outside."""
    rng = np.random.default_rng(seed)
    size = PIXEL * np.exp2(rng.uniform(-1.0, 7.0, (count, 1, 1)))
    xy = rng.uniform(-30, 200, (count, 1, 2)) * PIXEL + size * rng.uniform(-1, 1, (count, 3, 2))
    xy[::9, 2] = xy[::9, 1] + rng.uniform(-PIXEL, PIXEL, (len(xy[::9]), 2))
    low, high = struct_layout.GUARD_LOW * PIXEL, struct_layout.GUARD_HIGH * PIXEL
    xy[::50, 0] = rng.uniform(low, high, (len(xy[::50]), 2))
    return np.rint(np.clip(xy, low, high)).astype(np.int64)


def set_up(device, xy: np.ndarray, resolution: tuple[int, int], places: np.ndarray | None = None) -> Pipeline:
    """Return the pipeline with the visible triangles in a random order. places: sample positions (S, 2)."""
    several = {} if places is None else {"image": samples_at(places), "SAMPLES": 1}
    pipeline = Pipeline(device, resolution, **several)
    pipeline.set_up_apart(xy, np.random.default_rng(9).uniform(1, 2, (len(xy), 3)))
    pipeline.ordered(np.random.default_rng(8).permutation(pipeline.sort()))
    return pipeline


def tiles_drawn(xy: np.ndarray, boxes: np.ndarray, order: np.ndarray, resolution: tuple[int, int]) -> list[set[int]]:
    """Return for each tile exactly the triangles that cover a pixel of it."""
    across = -(-resolution[0] // TILE)
    tiles: list[set[int]] = [set() for _ in range(across * -(-resolution[1] // TILE))]
    for k, column, row, _ in coverage.samples(xy[order], boxes[order]):
        for pair in np.unique(np.stack([row // TILE * across + column // TILE, order[k]]), axis=1).T.tolist():
            tiles[pair[0]].add(pair[1])
    return tiles


def tiles_met(xy: np.ndarray, box: np.ndarray, places: np.ndarray) -> set[tuple[int, int]]:
    """Return the tiles (column, row) of a box in which a triangle (3, 2) is listed.

    These are all, if at most 2 x 2; otherwise those that no edge excludes as a whole, over the range of the sample
    positions.
    """
    (left, low, right, high), ends = box // TILE, (places.min(axis=0), places.max(axis=0))
    tiles = {(x, y) for x in range(left, right + 1) for y in range(low, high + 1)}
    if right - left < 2 and high - low < 2:
        return tiles
    met = set()
    for x, y in tiles:
        corners = []
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
            moved = seen_from(xy, np.array([[ends[i][0], ends[j][1]]]))[0]
            corners.append(coverage.edge_functions(moved, x * TILE + i * (TILE - 1), y * TILE + j * (TILE - 1)))
        largest = np.max(corners, axis=0)
        if ((largest > 0) | ((largest == 0) & coverage.top_left(xy))).all():
            met.add((x, y))
    return met


SIZES = [(160, 128), (163, 119), (1, 1), (16, 16), (17, 1), (5, 200)]
CASES = [*((1, size) for size in SIZES), *((count, SIZES[1]) for count in (2, 3, 16, 64))]


@pytest.mark.sampled
@pytest.mark.parametrize(("count", "resolution"), CASES)
def test_lists(device, count, resolution):
    """Each triangle is listed, in the given order, in exactly the tiles of its hull that none of its edges excludes, which
    include all tiles with a pixel that it covers at any sample."""
    xy, places = triangles(6, 500), sample_positions(count)
    pipeline = set_up(device, xy, resolution, places if count > 1 else None)
    order, boxes, across = pipeline.order.array, hull(xy, places, resolution), -(-resolution[0] // TILE)
    lists = [listed.tolist() for listed in pipeline.bin()]
    expected: list[list[int]] = [[] for _ in lists]
    for k in order.tolist():
        for x, y in tiles_met(xy[k], boxes[k], places):
            expected[y * across + x].append(k)
    assert lists == expected
    for moved in seen_from(xy, places):
        alive = order[~coverage.setup(moved, *resolution).culled[order]]
        needed = tiles_drawn(moved, coverage.setup(moved, *resolution).box, alive, resolution)
        assert all(some <= set(listed) for some, listed in zip(needed, lists, strict=True))


@pytest.mark.parametrize(("chunk", "parts"), [(1, 1), (2, 3), (7, 1), (64, 64), (1000, 7), (10**6, 2)])
def test_chunks_and_parts_change_nothing(device, chunk, parts):
    pipeline = set_up(device, triangles(2, 400), (90, 70))
    lists = pipeline.bin()
    entries, starts = pipeline.lists.array.copy(), pipeline.starts.array.copy()
    assert sum(map(len, lists)) > 250
    pipeline.bin(min(chunk, pipeline.visible), parts)
    assert np.array_equal(pipeline.starts.array, starts)
    assert np.array_equal(pipeline.lists.array, entries)


def test_without_room_nothing_is_listed_or_drawn(device):
    """No pixel has an owner then: layers may be enqueued already."""
    pipeline = set_up(device, triangles(5, 300), (90, 70))
    pipeline.bin()
    entries = len(pipeline.lists.array)
    assert (pipeline.draw()[1] != -2).all()
    pipeline.bin(room=entries - 1)
    image, owners = pipeline.draw()[:2]
    assert np.isnan(image).all()
    assert (owners == -1).all()
