"""lines.cl: lists of lines and triangles per cell, and the samples at which lines show, of planted lines and triangles."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from devices import needs_float64
from kernel_stages import image_of, mask, samples_at, split, vertices_at

from clshade.pipeline import struct_layout
from clshade.pipeline.buffers import Buffer
from clshade.pipeline.launches import Stages, items
from clshade.pipeline.programs import build

STRUCTS = struct_layout.SINGLE
COLUMNS, ROWS = 40, 30
CENTER = np.array([[128, 128]])
FAR, NEAR = 8.0, 2.0  # depths of lines, and of triangles that hide them


@pytest.fixture(autouse=True)
def _device_with_float64(device):
    needs_float64(device)


@cache
def stages_of(device, depth_test: int) -> Stages:
    program = build(device, mask(SORTED=0, SAMPLES=1, DEPTH_TEST=depth_test), ("lines.cl",), lanes=1)
    return Stages(device, program)


class Drawing:
    """Lines and the triangles that may hide them, in an image of COLUMNS x ROWS pixels.

    lines: rows of structs.Line. triangles: corners (F, 3, 2), 1/256 px. z: depths (F, 3). edge_faces: what
    `first_face` counts. bits: of the cells' size. ranks: (F,), for painter's order. pieces: so many of the last triangles
    are pieces of clipped faces.
    """

    def __init__(
        self,
        device,
        lines,
        triangles=(),
        z=(),
        *,
        width=384,
        edge_faces=(),
        places=CENTER,
        bits=10,
        ranks=None,
        pieces=0,
    ) -> None:
        self.device, self.lines = device, lines
        self.stages = stages_of(device, int(ranks is None))
        xy = np.asarray(triangles, np.int64).reshape(-1, 3, 2)
        depths = np.asarray(z, np.float64).reshape(-1)
        view = np.zeros(1, STRUCTS.View)
        view["scale"] = 1.0
        snapped = xy << struct_layout.SUBPIXEL_BITS - struct_layout.SAMPLE_BITS
        self.kept = vertices_at(device, snapped.reshape(-1, 2), depths)
        face_count = len(xy) - pieces
        faces = np.arange(3 * face_count, dtype=np.int32).reshape(-1, 3)
        clipped = np.zeros(pieces, STRUCTS.Piece)
        clipped["x"], clipped["y"] = snapped[face_count:, :, 0], snapped[face_count:, :, 1]
        clipped["w"], clipped["w_low"] = split(1.0 / depths[3 * face_count :].reshape(-1, 3))
        clipped["face"] = np.arange(face_count, len(xy))
        rank = None if ranks is None else Buffer(device, np.asarray(ranks, np.int32))
        reach, size = (width + 1) // 2, np.array([COLUMNS, ROWS]) << 8
        self.margin = -(-reach // (1 << bits))
        grid = np.zeros(1, STRUCTS.LineGrid)
        grid["cell_bits"], grid["margin"], grid["width"] = bits, self.margin, width
        self.across, self.up = (-(-size // (1 << bits)) + 2 * self.margin).tolist()
        grid["across"], grid["up"] = self.across, self.up
        self.bits, self.cells, self.triangles = bits, self.across * self.up, len(xy)
        self.values = {
            "face_materials": None,
            "materials": None,
            "faces": Buffer(device, faces),
            "vertices": self.kept.projected,
            "pieces": Buffer(device, clipped),
            "ranks": rank,
            "view": Buffer(device, view),
            "face_count": face_count,
            "grid": Buffer(device, grid),
            "image": image_of(device, (COLUMNS, ROWS), **samples_at(places)),
            "edge_faces": Buffer(device, np.asarray(edge_faces, np.int32)),
            "lines": Buffer(device, lines),
        }

    def lists(self) -> tuple[list[Buffer], list[Buffer]]:
        """Return where each cell's list of lines, and of triangles, begins, and the lists, which must be full."""
        starts, lists = [], []
        for kernel, name, count, dtype in (
            ("list_lines", "listed", len(self.lines), np.uint32),
            ("list_hiders", "hiders", self.triangles, STRUCTS.Hider),
        ):
            cursors = Buffer(self.device, np.zeros(self.cells, np.uint32))
            values = {**self.values, "cursors": cursors, "count": count}
            self.stages.run(kernel, items(count), values, **{name: None}, writes=False)
            begin = np.concatenate([[0], np.cumsum(cursors.to_host())]).astype(np.uint32)
            with cursors.writing() as rows:
                rows[:] = begin[:-1]
            entries = Buffer.empty(self.device, int(begin[-1]), dtype)
            self.stages.run(kernel, items(count), values, **{name: entries}, writes=True)
            assert np.array_equal(cursors.to_host(), begin[1:])
            entries.to_host()
            starts.append(Buffer(self.device, begin))
            lists.append(entries)
        return starts, lists

    def listed(self, which: int) -> list[set[int]]:
        """Return the lines (0), or triangles (1), of each cell."""
        starts, lists = self.lists()
        entries = lists[which].array if which == 0 else lists[which].array["index"]
        begin = starts[which].array
        return [set(entries[a:b].tolist()) for a, b in pairwise(begin)]

    def cell(self, x: int, y: int) -> int:
        return ((y >> self.bits) + self.margin) * self.across + (x >> self.bits) + self.margin

    def shown(self, group: int | None = None) -> np.ndarray:
        """Return the samples that show lines, (ROWS, COLUMNS, 2) uint64, row 0 at the BOTTOM. group: work-items of one."""
        starts, lists = self.lists()
        shown = Buffer(self.device, np.zeros((ROWS, COLUMNS, 2), np.uint64))
        arguments = {
            "line_starts": starts[0],
            "listed": lists[0],
            "starts": starts[1],
            "hiders": lists[1],
            "shown": shown,
        }
        group = group or (1 if self.device.is_cpu else 64)
        self.stages.run("line_samples", (self.cells * group, group), self.values, **arguments)
        return shown.to_host()[::-1].copy()


def lines_at(ends, z=FAR, faces=(0, 0), marked=0) -> np.ndarray:
    """Return rows of structs.Line. ends: (L, 2, 2), 1/256 px. z: depth. faces: the first of its faces, and how many."""
    ends = np.asarray(ends, np.int64).reshape(-1, 2, 2)
    rows = np.zeros(len(ends), STRUCTS.Line)
    rows["x"], rows["y"] = ends[..., 0], ends[..., 1]
    rows["w"], rows["marked"] = 1.0 / z, marked
    rows["first_face"], rows["faces"] = faces
    length = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    with np.errstate(divide="ignore"):
        rows["inset"] = np.minimum(struct_layout.LINE_INSET / length, 0.5)
    return rows


def random_ends(count: int) -> np.ndarray:
    """Return lines of all lengths, some of them points, some beyond the image."""
    rng = np.random.default_rng(5)
    start = rng.integers((-600, -600), (COLUMNS * 256 + 600, ROWS * 256 + 600), (count, 2))
    move = np.rint(rng.normal(size=(count, 2)) * 256 * np.exp2(rng.uniform(-4, 4, (count, 1)))).astype(np.int64)
    move[::7] = 0
    return np.stack([start, np.clip(start + move, -600, (COLUMNS * 256 + 600, ROWS * 256 + 600))], axis=1)


def covered(ends, width: int, place=CENTER[0]) -> np.ndarray:
    """Return (ROWS, COLUMNS): which samples are within half the width of a line, in exact integers."""
    x, y = (np.arange(n).astype(object) * 256 + int(at) for n, at in zip((COLUMNS, ROWS), place, strict=True))
    (ax, ay), (bx, by) = (list(map(int, end)) for end in ends)
    dx, dy, px, py = bx - ax, by - ay, x[None, :] - ax, y[:, None] - ay
    along, length2 = px * dx + py * dy, dx * dx + dy * dy
    near = np.minimum(px * px + py * py, (px - dx) ** 2 + (py - dy) ** 2) * 4 <= width * width
    between = (along > 0) & (along < length2) & (4 * (px * dy - py * dx) ** 2 <= width * width * length2)
    return (near | between).astype(bool)


@pytest.mark.parametrize("width", [1, 384, 2000])
def test_samples_within_half_the_width(device, width):
    long = [[[5000, -600], [5001, 8_000_000]], [[8_000_000, 3000], [-8_000_000, 3001]]]
    ends = np.concatenate([random_ends(24), long])
    samples = Drawing(device, lines_at(ends), width=width).shown()
    expected = np.any([covered(end, width) for end in ends], axis=0)
    assert np.array_equal(samples[..., 0] == 1, expected)
    assert not samples[..., 1].any()
    assert width == 1 or expected.any()


def test_a_bit_for_each_sample_and_marked_lines_apart(device):
    """Bits beyond 32, and both kinds of lines, at 60 samples."""
    places = np.random.default_rng(2).integers(0, 256, (60, 2))
    places[[3, 59]] = (10, 250), (250, 10)
    first, second = random_ends(8), random_ends(20)[8:]
    lines = np.concatenate([lines_at(first), lines_at(second, marked=1)])
    samples = Drawing(device, lines, places=places).shown()
    for s in (3, 31, 32, 59):
        for kind, ends in enumerate((first, second)):
            expected = np.any([covered(end, 384, places[s]) for end in ends], axis=0)
            assert np.array_equal(samples[..., kind] >> np.uint64(s) & np.uint64(1) == 1, expected)


def triangles_around() -> np.ndarray:
    """Return triangles of all sizes and both windings, some without area, partly beyond the image."""
    rng = np.random.default_rng(7)
    middle = rng.uniform(0, 1, (60, 1, 2)) * (COLUMNS, ROWS)
    xy = np.rint(256 * (middle + np.exp2(rng.uniform(-2, 5, (60, 1, 1))) * rng.normal(size=(60, 3, 2))))
    xy[::9, 2] = xy[::9, 1]
    return xy.astype(np.int64)


def test_lists_hold_what_lies_in_a_cell(device):
    """Any point of a line, and of a triangle with area, lies in a cell that lists it; few others list it."""
    ends, xy = random_ends(40), triangles_around()
    drawing = Drawing(device, lines_at(ends), xy, np.full((60, 3), NEAR))
    lines, triangles = drawing.listed(0), drawing.listed(1)
    share = np.linspace(0.0, 1.0, 41)
    for k, (a, b) in enumerate(ends):
        points = np.floor(a + share[:, None] * (b - a)).astype(int)
        cells = {drawing.cell(x, y) for x, y in points if -512 <= x < COLUMNS * 256 and -512 <= y < ROWS * 256}
        assert all(k in lines[cell] for cell in cells)
        assert sum(k in line for line in lines) <= 3 * len(cells) + 9
    weights = np.random.default_rng(1).dirichlet((1, 1, 1), 200)
    for k, corners in enumerate(xy):
        u, v = corners[1] - corners[0], corners[2] - corners[0]
        if u[0] * v[1] == u[1] * v[0]:
            assert not any(k in triangle for triangle in triangles)
            continue
        points = np.floor(weights @ corners).astype(int)
        assert all(
            k in triangles[drawing.cell(x, y)] for x, y in points if 0 <= x < COLUMNS * 256 and 0 <= y < ROWS * 256
        )
    assert max(map(len, triangles)) < 60


ACROSS = np.array([[[512, 15 * 256], [38 * 256, 15 * 256]]])  # a line through the image's middle
WALL = np.array([[[10 * 256, -9000], [10 * 256, 60000], [60000, 15 * 256]]])  # covers it from x = 10 on


def columns_of(shown: np.ndarray) -> np.ndarray:
    return np.flatnonzero((shown[..., 0] > 0).any(axis=0))


HIDDEN, SHOWN = range(1, 10), range(1, 39)  # columns that show the line
ASIDE = WALL - 60000
WITH_FACES = {"faces": (1, 2)}  # of the edge: the second of a list, and the one after it
CASES = {  # members of the line; triangles and their depths; further arguments of Drawing
    "in front": ({}, [WALL], [NEAR], {}, HIDDEN),
    "in front, turned": ({}, [WALL[:, ::-1]], [NEAR], {}, HIDDEN),
    "behind": ({}, [WALL], [2.0 * FAR], {}, SHOWN),
    "at the same depth": ({}, [WALL], [FAR], {}, SHOWN),
    "the second piece of a face": ({}, [ASIDE, ASIDE, ASIDE, WALL], [FAR, FAR, NEAR, NEAR], {"pieces": 2}, HIDDEN),
    "the first piece of a face": ({}, [ASIDE, ASIDE, WALL, ASIDE], [FAR, FAR, NEAR, NEAR], {"pieces": 2}, HIDDEN),
    "the edge's own face": (WITH_FACES, [WALL] * 3, [FAR, NEAR, 2.0 * FAR], {"edge_faces": [7, 0, 1]}, SHOWN),
    "the face of another edge": (WITH_FACES, [WALL] * 3, [FAR, NEAR, 2.0 * FAR], {"edge_faces": [1, 0, 2]}, HIDDEN),
    # In painter's order lines hold minus the first rank of their faces, and depths do not matter.
    "an earlier rank": ({"z": -1 / 5}, [WALL], [2.0 * FAR], {"ranks": [3]}, HIDDEN),
    "the same rank": ({"z": -1 / 5}, [WALL], [2.0 * FAR], {"ranks": [5]}, SHOWN),
    "a later rank": ({"z": -1 / 5}, [WALL], [2.0 * FAR], {"ranks": [6]}, SHOWN),
}


@pytest.mark.parametrize(("line", "triangles", "z", "options", "shown"), CASES.values(), ids=CASES)
def test_a_triangle_hides_where_it_covers(device, line, triangles, z, options, shown):
    depths = np.array(z)[:, None] * np.ones(3)
    drawing = Drawing(device, lines_at(ACROSS, **line), np.concatenate(triangles), depths, **options)
    assert columns_of(drawing.shown()).tolist() == list(shown)


def test_a_triangle_that_leans_through_the_line_hides_where_it_is_nearer(device):
    """Its 1/depth is linear in the image: 1/4 at x = 0, 0 at x = 40; the line's 1/8 at x = 20."""
    corners = np.array([[[0, 0], [39 * 256, 0], [0, 30 * 256]], [[39 * 256, 0], [39 * 256, 30 * 256], [0, 30 * 256]]])
    w = (1.0 - corners[..., 0] / (40 * 256)) / 4.0
    columns = columns_of(Drawing(device, lines_at(ACROSS), corners, 1.0 / w).shown())
    assert columns.max() == 38
    assert columns.min() in (19, 20)


def test_triangles_hide_a_line_along_their_sides(device):
    """Small ones side by side: at both ends of a part their edge functions are 0 but for rounding."""
    step = np.array([224, 96])
    at = 512 + np.arange(32)[:, None] * step
    small = np.stack([at, at + step, at + [0, 300]], axis=1)[4:-4]
    columns = columns_of(Drawing(device, lines_at([[at[0], at[-1]]]), small, np.full((24, 3), NEAR)).shown())
    left, right = at[4, 0] >> 8, at[-4, 0] >> 8
    assert not ((columns > left + 1) & (columns < right - 1)).any()
    assert columns.min() < left < right < columns.max()


def slivers(count: int) -> np.ndarray:
    """Return triangles that together cover the image from x = 10 to 30, each less than a pixel wide."""
    x = np.rint(np.linspace(10 * 256, 30 * 256, count + 1)).astype(np.int64)
    a, b = x[:-1], x[1:]
    low, high = np.full(count, -256), np.full(count, 31 * 256)
    first = np.stack([np.stack([a, low], 1), np.stack([b, low], 1), np.stack([a, high], 1)], axis=1)
    second = np.stack([np.stack([b, low], 1), np.stack([b, high], 1), np.stack([a, high], 1)], axis=1)
    return np.concatenate([first, second])


def test_many_triangles_hide_together(device):
    """More in a cell than are kept, between whose sides nothing shows through."""
    xy = slivers(400)
    samples = Drawing(device, lines_at(ACROSS), xy, np.full((len(xy), 3), NEAR), bits=12).shown()
    columns = columns_of(samples)
    assert not ((columns >= 10) & (columns < 30)).any()
    assert {9, 30} <= set(columns.tolist())


@pytest.mark.sampled
@pytest.mark.parametrize("group", [1, 8])
def test_cells_and_work_groups_do_not_change_a_bit(device, group):
    xy = np.concatenate([triangles_around(), slivers(90)])
    z = np.random.default_rng(4).uniform(NEAR, 2.0 * FAR, (len(xy), 3))
    lines = lines_at(random_ends(60))
    places = np.array([[64, 64], [192, 192]])
    images = [Drawing(device, lines, xy, z, places=places, bits=bits).shown(group) for bits in (8, 10, 12)]
    expected = Drawing(device, lines, xy, z, places=places).shown()
    assert all(np.array_equal(image, expected) for image in images)
    bare = Drawing(device, lines, places=places).shown()
    assert 0 < np.count_nonzero(expected) < np.count_nonzero(bare)
