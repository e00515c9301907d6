"""setup.cl against the oracle: areas, boxes, culling and its counters, faces left to the clipper, the order of keys."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kernel_stages import Pipeline, boxes_of, samples_at
from stage_oracle import hull, seen_from

from clshade.oracle import coverage, transform
from clshade.pipeline import struct_layout
from clshade.pipeline.buffers import Buffer, TriangleBuffers, index_bits
from clshade.pipeline.camera_space import sample_positions
from clshade.pipeline.draw import front_to_back
from clshade.pipeline.launches import FrameInFlight
from clshade.pipeline.triangle_source import set_up_pieces

COLUMNS, ROWS = 61, 43
PIXEL = coverage.SUBPIXELS
COUNTED = ("visible", "between_samples", "off_screen", "zero_area", "back_facing")


def triangles(count: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    """Return snapped corners (F, 3, 2) of all sizes in and around the image, many without area or between samples, and
    depths (F, 3)."""
    rng = np.random.default_rng(1)
    size = PIXEL * np.exp2(rng.uniform(-8.0, 8.0, (count, 1, 1)))
    middle = rng.uniform(-20, 80, (count, 1, 2)) * PIXEL
    xy = np.rint(middle + size * rng.uniform(-1, 1, (count, 3, 2))).astype(np.int64)
    xy[::10, 2] = 2 * xy[::10, 1] - xy[::10, 0]  # collinear
    xy[5::100, 1] = xy[5::100, 0]  # repeated
    xy[1::7] = xy[1::7] // coverage.HALF * coverage.HALF  # corners on pixel centers and edges
    xy[2::7] = xy[2::7] // PIXEL * PIXEL + coverage.HALF + rng.choice([-1, 0, 1, 255, 257], xy[2::7].shape)
    xy = np.clip(xy, struct_layout.GUARD_LOW * PIXEL, struct_layout.GUARD_HIGH * PIXEL)
    return xy, np.exp2(rng.uniform(-3, 3, (count, 3)))


def drawn(xy: np.ndarray, box: np.ndarray, culled: np.ndarray) -> np.ndarray:
    """Return exactly which triangles cover a pixel, (F,) bool."""
    covered = np.zeros(len(xy), bool)
    alive = np.flatnonzero(~culled)
    for k, _, _, _ in coverage.samples(xy[alive], box[alive]):
        covered[alive[k]] = True
    return covered


@pytest.mark.sampled
@pytest.mark.parametrize(("count", "cull"), [(1, 0), (1, 1), *((count, 0) for count in (2, 3, 16, 64))])
def test_areas_boxes_and_culls(device, count, cull):
    """The box is the union of all samples' boxes, and a pixel is covered at any sample. Triangles that cover a pixel are
    visible, culled ones are not, and one whose box is a single pixel only if it covers that."""
    (xy, z), places = triangles(), sample_positions(count)
    several = {"image": samples_at(places), "SAMPLES": 1} if count > 1 else {}
    pipeline = Pipeline(device, (COLUMNS, ROWS), CULL=cull, **several)
    counters = pipeline.set_up_apart(xy, z)
    area, box, covers = coverage.signed_area(xy), hull(xy, places, (COLUMNS, ROWS)), np.zeros(len(xy), bool)
    for moved in seen_from(xy, places):
        covers |= drawn(moved, *coverage.setup(moved, COLUMNS, ROWS, cull=bool(cull))[1:])
    culled = (area == 0) | ((area < 0) & bool(cull)) | (box[:, 2:] < box[:, :2]).any(axis=1)
    visible = np.sort(pipeline.sort())
    assert counters["visible"] == len(visible) == len(np.unique(visible))
    assert sum(counters[name] for name in COUNTED) == len(xy)
    assert 200 < len(visible) < 1500
    is_visible = np.isin(np.arange(len(xy)), visible)
    assert not (covers & ~is_visible).any()
    assert not (is_visible & culled).any()
    one_pixel = (box[:, :2] == box[:, 2:]).all(axis=1) & ~culled & (np.ptp(xy, axis=1) < PIXEL).all(axis=1)
    assert np.array_equal(is_visible[one_pixel], covers[one_pixel])
    assert 0 < covers[one_pixel].sum() < one_pixel.sum()
    bounds = pipeline.made.bounds.to_host()[visible]
    assert np.array_equal(boxes_of(bounds), box[visible])
    made = pipeline.made.triangles.to_host()[visible]
    assert np.array_equal(np.stack([made["x"], made["y"]], axis=2), xy[visible])
    assert np.array_equal(made["piece_and_turn"], -2 + (area[visible] < 0))
    assert np.array_equal(made["inverse_area"], np.float32(PIXEL) / np.abs(area[visible]).astype(np.float32))
    assert np.array_equal(made["w"], (1.0 / z[visible]).astype(np.float32))
    assert np.array_equal(bounds["nearest"], made["w"].max(axis=1))
    assert np.array_equal(made["face"], visible)


DEPTHS = (0.0, -0.0, 5e-324, 1e-30, np.nextafter(1.0, 0), 1.0, np.nextafter(1.0, 2), 1e6, 1e6 + 2**-33, 1e30, 1e300)


def deep(device, z: np.ndarray, **features: int) -> Pipeline:
    """Set up visible triangles of these depths (F, 3), with the near plane far behind the eye."""
    xy = np.tile(np.array([[[0, 0], [35 * PIXEL, 0], [0, 35 * PIXEL]]]), (len(z), 1, 1))
    pipeline = Pipeline(device, (COLUMNS, ROWS), **features)
    assert pipeline.set_up_apart(xy, z, near=-np.inf)["visible"] == len(z)
    return pipeline


def test_painters_keys_order_mean_depths(device):
    """Mean depths an ulp apart, equal ones and -0.0: with exact depths for equal keys, exactly the oracle's order."""
    rng = np.random.default_rng(2)
    z = rng.choice(np.array(DEPTHS), (1500, 1)) + np.zeros(3)
    z[::3] = rng.uniform(1, 2, (500, 3))
    order = deep(device, z).sort(lambda index: (transform.painter_depth(z[index]), index.astype(np.int64)))
    assert np.array_equal(order, coverage.painter_order(z, np.ones(len(z), bool)))


def test_depth_keys_order_nearest_corners(device):
    z = np.exp2(np.random.default_rng(4).uniform(-10, 10, (4000, 3)))
    order = deep(device, z, DEPTH_TEST=1).sort()
    ordered = z.min(axis=1)[order]
    assert (np.diff(ordered) > -(2.0**-28) * ordered[1:]).all()
    assert not np.array_equal(order, np.argsort(z.mean(axis=1)))  # the two kinds of keys differ here


def test_setup_pieces(device):
    """Pieces follow the faces, with their own depth as key and the index of their face."""
    first_face = 1 << 24
    xy, z = triangles(400)
    pipeline = Pipeline(device, (COLUMNS, ROWS))
    face_count = first_face + 7
    made = TriangleBuffers(device, face_count, len(xy))
    counted = Buffer(device, np.zeros(1, struct_layout.SINGLE.Counters))
    table = np.zeros(len(xy), struct_layout.SINGLE.Piece)
    table["x"], table["y"], table["w"] = xy[..., 0], xy[..., 1], 1.0 / z
    table["key_depth"], table["face"] = z[:, 1], first_face + np.arange(len(xy)) % 7
    pieces = Buffer(device, table)
    values = {**made.values, "keys": made.keys, "face_materials": None, "materials": None}
    frame = FrameInFlight({**values, "image": pipeline.image, "counters": counted})
    set_up_pieces(pipeline.stages, pieces, frame, face_count)
    counters = counted.to_host()[0]
    expected = coverage.setup(xy, COLUMNS, ROWS)
    order = front_to_back(made.keys.to_host(int(counters["visible"])).copy(), bits=made.index_bits).astype(np.int64)
    visible = np.sort(order - face_count)
    assert set(np.flatnonzero(drawn(xy, expected.box, expected.culled))) <= set(visible)
    assert not expected.culled[visible].any()
    rows = made.triangles.to_host()[face_count + visible]
    assert np.array_equal(rows["face"], first_face + visible % 7)
    assert np.array_equal(rows["piece_and_turn"] >> 1, visible)
    assert np.array_equal(boxes_of(made.bounds.to_host()[face_count + visible]), expected.box[visible])
    assert np.array_equal(order, face_count + visible[np.argsort(z[visible, 1])])


# The host's depth sort against NumPy's lexsort in full precision


# Values that 40 bits of a float64 distinguish, and others: 1, an ulp on both sides, and 2^-28 above.
NEAR_ONE = (1.0, np.nextafter(1.0, 0.0), np.nextafter(1.0, 2.0), 1.0 + 2.0**-40, 1.0 + 2.0**-28)
DEPTHS = (*NEAR_ONE, -1.0, -1.0 - 2.0**-40, 0.0, -0.0, 5e-324, -5e-324, 1e-300, 1e300, 2.0, 1e6, 1e6 + 2.0**-30)


def keys_of(depth: np.ndarray, bits: int = 24, first: int = 0) -> np.ndarray:
    """Compute keys one by one as documented in draw.py: the highest bits of the float in sortable order, and the index."""
    keys = []
    for index, value in enumerate(depth, first):
        (raw,) = np.array([value + 0.0]).view(np.uint64).tolist()
        ordered = raw + (1 << 63) if raw < 1 << 63 else (1 << 64) - 1 - raw
        low = 1 << bits
        keys.append(ordered // low * low + (low - 1 - index))
    return np.array(keys, np.uint64).reshape(-1)


@given(
    st.lists(st.sampled_from(DEPTHS), max_size=40),
    st.sampled_from([0, 2**24 - 20, 2**24, 2**25 - 1, 2**28, 2**29 - 40]),
    st.integers(0, 99),
)
def test_nearest_first_then_the_later_face(values, first, seed):
    """`setup` appends keys in any order. Beyond 24 bits of indices fewer are left for depths, of which more are compared."""
    depth, bits = np.array(values, np.float64), index_bits(first + len(values))
    keys = np.random.default_rng(seed).permutation(keys_of(depth, bits, first))
    order = front_to_back(keys, lambda index: (depth[index - first], index.astype(np.int64)), bits)
    assert order.dtype == np.uint32
    assert (order - first).tolist() == np.lexsort((-np.arange(len(depth)), depth)).tolist()


@given(st.lists(st.tuples(st.sampled_from(NEAR_ONE), st.integers(0, 5)), max_size=30))
def test_pieces_are_ordered_by_their_face(rows):
    """A clipped face's pieces have their own indices; for equal depths the face decides, not the index."""
    depth, face = np.array([row[0] for row in rows]), np.array([row[1] for row in rows], np.int64)
    order = front_to_back(keys_of(depth)[::-1].copy(), lambda index: (depth[index], face[index]))
    expected = np.lexsort((-face, depth))
    assert depth[order].tolist() == depth[expected].tolist()
    assert face[order].tolist() == face[expected].tolist()
