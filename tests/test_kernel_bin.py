"""bin.cl: each tile's list holds every triangle with a pixel in it, none whose box misses it, in the given order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kernel_stages import Pipeline, samples_at, vertices_at
from stage_oracle import hull, seen_from

from clshade.oracle import coverage
from clshade.pipeline import struct_layout
from clshade.pipeline.camera_space import sample_positions
from clshade.pipeline.renderer import Renderer, render
from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, Scene

TILE, PIXEL = struct_layout.TILE_SIZE, coverage.SUBPIXELS
FILES = ("setup.cl", "bin.cl", "gouraud.cl")  # more than needed, to share the program of test_kernel_fill.py


def triangles(seed: int, count: int = 1500) -> np.ndarray:
    """Return snapped corners (F, 3, 2): mostly small, some across the image, some needles, some far outside."""
    rng = np.random.default_rng(seed)
    size = PIXEL * np.exp2(rng.uniform(-1.0, 7.0, (count, 1, 1)))
    xy = rng.uniform(-30, 200, (count, 1, 2)) * PIXEL + size * rng.uniform(-1, 1, (count, 3, 2))
    xy[::9, 2] = xy[::9, 1] + rng.uniform(-PIXEL, PIXEL, (len(xy[::9]), 2))
    low, high = struct_layout.GUARD_LOW * PIXEL, struct_layout.GUARD_HIGH * PIXEL
    xy[::50, 0] = rng.uniform(low, high, (len(xy[::50]), 2))
    return np.rint(np.clip(xy, low, high)).astype(np.int64)


def set_up(device, xy: np.ndarray, resolution: tuple[int, int]) -> tuple[Pipeline, np.ndarray, np.ndarray]:
    """Return the pipeline, a random order of the visible triangles, and all boxes."""
    pipeline = Pipeline(device, FILES, resolution, OWNERS=1)
    z = np.random.default_rng(9).uniform(1, 2, (len(xy), 3))
    pipeline.set_up(vertices_at(device, xy.reshape(-1, 2), z.reshape(-1)), np.arange(3 * len(xy)).reshape(-1, 3))
    return pipeline, pipeline.sort(), coverage.setup(xy, *resolution).box


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


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("count", "resolution"), [*((1, size) for size in SIZES), *((n, SIZES[1]) for n in (2, 3, 16, 64))]
)
def test_lists(device, count, resolution):
    """Each triangle is listed, in the given order, in exactly the tiles of its hull that none of its edges excludes, which
    include all tiles with a pixel that it covers at any sample."""
    xy, places = triangles(6, 500), sample_positions(count)
    several = {"image": samples_at(places), "SAMPLES": 1} if count > 1 else {}
    pipeline = Pipeline(device, FILES, resolution, OWNERS=1, **several)
    z = np.random.default_rng(9).uniform(1, 2, (len(xy), 3))
    pipeline.set_up(vertices_at(device, xy.reshape(-1, 2), z.reshape(-1)), np.arange(3 * len(xy)).reshape(-1, 3))
    order, boxes, across = pipeline.sort(), hull(xy, places, resolution), -(-resolution[0] // TILE)
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


def test_triangles_that_miss_a_tile_of_their_box_are_left_out(device):
    """A needle along the diagonal of 10 x 10 tiles meets the 28 on and next to it; its box contains all 100."""
    xy = np.array([[[0, 0], [160, 159.6], [159.6, 160]]])
    xy = np.rint(PIXEL * xy).astype(np.int64)
    pipeline, _, _ = set_up(device, xy, (160, 160))
    tiles = np.array([len(listed) for listed in pipeline.bin()]).reshape(10, 10)
    distance = np.abs(np.subtract.outer(np.arange(10), np.arange(10)))
    assert (tiles[distance == 0] == 1).all()
    assert not tiles[distance > 1].any()


@pytest.mark.parametrize(("chunk", "parts"), [(1, 1), (2, 3), (7, 1), (64, 64), (1000, 7), (10**6, 2)])
def test_chunks_and_parts_change_nothing(device, chunk, parts):
    xy = triangles(2, 400)
    pipeline, _, _ = set_up(device, xy, (90, 70))
    lists = pipeline.bin()
    entries, starts = pipeline.lists.array.copy(), pipeline.starts.array.copy()
    assert sum(map(len, lists)) > 250
    pipeline.bin(min(chunk, pipeline.visible), parts)
    assert np.array_equal(pipeline.starts.array, starts)
    assert np.array_equal(pipeline.lists.array, entries)


def test_an_entrys_box_is_the_triangles_box_within_the_tile(device):
    resolution = (163, 119)
    xy = triangles(3)
    pipeline, _, boxes = set_up(device, xy, resolution)
    lists = pipeline.bin()
    entries = pipeline.lists.to_host()
    tile = np.repeat(np.arange(len(lists)), [len(listed) for listed in lists])
    corner = np.stack([tile % -(-resolution[0] // TILE), tile // -(-resolution[0] // TILE)], axis=1) * TILE
    expected = np.clip(boxes[entries["index"]] - np.tile(corner, 2), 0, TILE - 1)
    assert np.array_equal(entries["box"][:, None] >> np.array([0, 8, 16, 24]) & 0xFF, expected)
    bounds = pipeline.made.bounds.to_host()
    assert np.array_equal(entries["nearest"], bounds["nearest"][entries["index"]])


def test_the_given_order_is_kept_whatever_it_is(device):
    """Binning ignores depths: a reversed order gives reversed lists."""
    xy = triangles(4, 300)
    pipeline, order, _ = set_up(device, xy, (90, 70))
    forth = pipeline.bin()
    pipeline.ordered(order[::-1])
    back = pipeline.bin(13)
    assert all(np.array_equal(a, b[::-1]) for a, b in zip(forth, back, strict=True))


def test_without_room_nothing_is_listed_or_drawn(device):
    """No pixel has an owner then: layers may be enqueued already."""
    pipeline, _, _ = set_up(device, triangles(5, 300), (90, 70))
    pipeline.bin()
    entries = len(pipeline.lists.array)
    assert (pipeline.draw()[1] != -2).all()
    pipeline.bin(room=entries - 1)
    image, owners = pipeline.draw()[:2]
    assert np.isnan(image).all()
    assert (owners == -1).all()


def test_the_renderer_makes_room_as_it_needs_it(device):
    """From one small triangle to many across the image and back: each frame equals a first frame."""
    mesh = Mesh(np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    cameras = [Camera.from_fov((0.0, 0.0, z), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 60.0) for z in (50.0, 0.5, 9.0)]
    scene = Scene((mesh,), cameras[0].with_resolution((200, 150)))
    with Renderer(scene, device=device) as renderer:
        frames = [renderer.render(camera.with_resolution((200, 150))) for camera in cameras]
    for camera, frame in zip(cameras, frames, strict=True):
        alone = render(replace(scene, camera=camera.with_resolution((200, 150))), device=device)
        assert np.array_equal(frame.rgb, alone.rgb)
        assert frame.alpha.any()
