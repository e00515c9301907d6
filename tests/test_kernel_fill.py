"""fill.clh, through the stages set-up, bin and (unlit) gouraud: coverage and ownership of pixels."""

import numpy as np
import pytest
from devices import needs_float64
from kernel_stages import Pipeline, samples_at
from stage_oracle import owners_of, seen_from

from clshade.oracle import coverage, transform
from clshade.pipeline import struct_layout
from clshade.pipeline.camera_space import sample_positions

PIXEL = coverage.SUBPIXELS
LOW, HIGH = struct_layout.GUARD_LOW * PIXEL, struct_layout.GUARD_HIGH * PIXEL
# A triangle as large as the guard band: it covers the image.
LARGEST = np.array([[LOW, LOW], [HIGH, LOW], [0, HIGH]])


def fill(device, xy, z, resolution, *, places=None, **features) -> np.ndarray:
    """Return owners (M, N), row 0 at the BOTTOM, of triangles without shared vertices: snapped xy (F, 3, 2), depths z
    (F, 3).

    places: sample positions (S, 2), with SAMPLES; the owners are those at the first.
    """
    pipeline = Pipeline(device, resolution, image=None if places is None else samples_at(places), **features)
    pipeline.set_up_apart(xy, z, orthographic=bool(features.get("ORTHOGRAPHIC")))
    face_of_index = np.arange(len(xy))
    pipeline.sort(lambda index: (transform.painter_depth(z[index]), face_of_index[index]))
    pipeline.bin(max(1, -(-pipeline.visible // 3)))
    rgba, owners = pipeline.draw()
    if places is None:
        assert np.array_equal(rgba[..., 3], owners >= 0)
        assert (rgba[owners >= 0, :3] == 1.0).all()
        assert not rgba[owners < 0].any()
    return owners[::-1].copy()


def assert_same_coverage(device, xy, resolution) -> None:
    """Assert that triangles that do not overlap each cover exactly the oracle's pixels."""
    z = np.ones((len(xy), 3))
    assert np.array_equal(fill(device, xy, z, resolution), owners_of(xy, z, resolution, "painter"))


# Coverage


@pytest.mark.sampled
@pytest.mark.parametrize("size", [1, 2, 4, 8, 16, 32, 64, 128, 256])
def test_random_triangles_of_all_sizes(device, size):
    """On the grid of corners, each in its own cell; the cells are not aligned with the tiles."""
    rng = np.random.default_rng(size)
    across = max(2, 256 // size)
    cell = np.stack(np.divmod(np.arange(across**2), across), axis=1)
    xy = rng.integers(0, PIXEL * size + 1, (across**2, 3, 2)) + PIXEL * (size * cell[:, None, :] - [5, 11])
    assert_same_coverage(device, xy, (across * size - 9, across * size - 14))


@pytest.mark.sampled
@pytest.mark.parametrize("resolution", [(61, 47), (17, 33), (1, 1), (1, 7), (333, 1), (16384, 3), (3, 16384)])
def test_triangles_far_larger_than_the_image(device, resolution):
    """Corners up to the guard band; edges cross the image, also one of few pixels, and the longest. `Pipeline.draw` puts
    it between guard rows and checks them."""
    rng = np.random.default_rng(3)
    for _ in range(30):
        xy = rng.integers(LOW, HIGH + 1, (1, 3, 2))
        xy[0, 0] = rng.integers(-PIXEL, PIXEL * np.array(resolution) + PIXEL)
        assert_same_coverage(device, xy, resolution)
    for xy in (LARGEST, np.array([[HIGH, HIGH], [LOW, HIGH], [0, LOW]])):
        assert_same_coverage(device, xy[None], resolution)


# Ownership


def overlapping(seed: int, count: int = 600) -> tuple[np.ndarray, np.ndarray]:
    """Return snapped corners and depths of overlapping triangles, a few of which cover the whole image."""
    rng = np.random.default_rng(seed)
    size = PIXEL * np.exp2(rng.uniform(1.0, 7.0, (count, 1, 1)))
    xy = np.rint(rng.uniform(0, 100 * PIXEL, (count, 1, 2)) + size * rng.uniform(-1, 1, (count, 3, 2))).astype(np.int64)
    xy[::40] *= 30
    return np.clip(xy, LOW, HIGH), rng.uniform(1.0, 2.0, (count, 1)) + rng.uniform(0.0, 0.3, (count, 3))


RESOLUTION = (101, 93)


@pytest.mark.sampled
@pytest.mark.parametrize("depth_test", [1, 0])
def test_owners(device, depth_test):
    for seed in range(3):
        xy, z = overlapping(seed)
        z[1::2] = z[::2, [1, 2, 0]]  # pairs of equal mean depth, with their corners in another order
        expected = [owners_of(xy, z, RESOLUTION, visibility) for visibility in ("painter", "depth")]
        assert np.array_equal(fill(device, xy, z, RESOLUTION, DEPTH_TEST=depth_test), expected[depth_test])
        assert (expected[0] != expected[1]).mean() > 0.01


@pytest.mark.sampled
@pytest.mark.parametrize("apart", [2.0**-18, 2.0**-21, 2.0**-24])
@pytest.mark.parametrize("feature", ["", "ORTHOGRAPHIC", "DOUBLE", "SAMPLES"])
def test_depths_that_float32_hardly_tells_apart(device, feature, apart):
    """Triangles nearly in one slanted plane, with corners off it by up to the fraction `apart` of their depths."""
    if feature == "DOUBLE":
        needs_float64(device)
    xy, _ = overlapping(10)
    orthographic, places = feature == "ORTHOGRAPHIC", sample_positions(3) if feature == "SAMPLES" else None
    slope = 1.0 + (xy @ [1.0, 0.3]) / (PIXEL * 50_000.0)
    plane = slope if orthographic else 1.0 / slope
    z = plane * (1.0 + apart * np.random.default_rng(13).uniform(-1.0, 1.0, plane.shape))  # no two within 2^-40, a tie
    owners = fill(device, xy, z, RESOLUTION, places=places, DEPTH_TEST=1, **({feature: 1} if feature else {}))
    if places is not None:  # the first sample sees what the center sees of triangles moved the other way
        xy = seen_from(xy, places)[0]
    expected = owners_of(xy, z, RESOLUTION, "depth", orthographic)
    assert np.array_equal(owners, expected)
    in_plane = owners_of(xy, plane, RESOLUTION, "depth", orthographic)
    assert (owners != in_plane).mean() > 0.1  # `apart` decides the owners


@pytest.mark.sampled
@pytest.mark.parametrize("feature", ["", "ORTHOGRAPHIC"])
def test_what_float32_puts_behind_the_early_stop(device, feature):
    """One slanted plane covers a tile, drawn eight times, so that all its depths are known when the early-out test
    runs. Then follows a flat triangle that is nearer only at the plane's farthest pixel, by up to 3 roundings: by the
    plane's float32 depth there it may seem hidden. One trial in every third tile, both ways."""
    rng = np.random.default_rng(12)
    orthographic, across, side = feature == "ORTHOGRAPHIC", 18, 16 * PIXEL
    first = 3 * side * np.stack(np.divmod(np.arange(across**2), across), axis=1)[:, None]
    turned = rng.random((across**2, 1, 1)) < 0.5  # which corner of the tile is the farthest
    legs = np.array([[-1, -1], [2 * side + 9, -1], [-1, 2 * side + 9]]) - rng.integers(0, 2 * PIXEL, (across**2, 3, 1))
    xy = first + np.where(turned, legs, side - legs)
    at = first + np.where(turned, coverage.HALF, side - coverage.HALF)
    slope = 2.0**-20 / PIXEL * rng.uniform(1.0, 2.0, (across**2, 1)) * np.where(turned[:, 0], 1.0, -1.0)
    base = rng.uniform(1.0, 2.0, (across**2, 1))
    plane = base * (1.0 + slope * (xy - at).sum(axis=2))
    flat = np.repeat(base * (1.0 + 2.0**-24 * rng.uniform(0.0, 3.0, base.shape)), 3, axis=1)
    w = np.concatenate([plane] * 8 + [flat])
    z = 3.0 - w if orthographic else 1.0 / w
    xy = np.concatenate([xy] * 9)
    resolution = (3 * 16 * across, 3 * 16 * across)
    owners = fill(device, xy, z, resolution, DEPTH_TEST=1, **({feature: 1} if feature else {}))
    expected = owners_of(xy, z, resolution, "depth", orthographic)
    seen = expected[tuple(np.moveaxis(at[:, 0] // PIXEL, 1, 0)[::-1])]
    assert np.array_equal(seen, 8 * across**2 + np.arange(across**2))
    assert np.array_equal(owners, expected)


@pytest.mark.parametrize("depth_test", [0, 1])
def test_of_equal_depths_the_later_face_wins(device, depth_test):
    """Copies of the same triangles with bit-identical depths, at any position in the list."""
    xy, z = overlapping(8, 40)
    again = np.concatenate([xy, xy[::-1], xy])
    owners = fill(device, again, np.concatenate([z, z[::-1], z]), RESOLUTION, DEPTH_TEST=depth_test)
    owned = owners[owners >= 0]
    assert (owned >= 80).all()
    assert len(owned) > 1000
