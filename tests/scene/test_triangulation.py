"""Triangulation of polygons: preserved area, winding and edges, on concave, degenerate and very large polygons."""

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scene_files import write

from clshade.scene import triangulate
from clshade.scene.formats.load import load
from clshade.scene.triangulate import triangulated

SCALES = (1.0, 1e30, 1e-30, 1e300, 1e-300)
DART = [[0, 4, 0], [0, 0, 0], [4, 0, 0], [4, 4, 0], [2, 1, 0]]


def cut_one(verts) -> np.ndarray:
    """Triangulate one polygon; return corner numbers (n - 2, 3)."""
    verts = np.asarray(verts, np.float64)
    faces, cuts = cut(verts, np.arange(len(verts), dtype=np.int32), np.array([len(verts)]))
    assert faces.shape == (len(verts) - 2, 3)
    assert cuts.polygon.tolist() == [0] * (len(verts) - 2)
    return faces


def cut(verts, corners, counts):
    """Triangulate polygons; return indices (F, 3) into verts, and the cuts."""
    cuts = triangulated(verts, corners, counts)
    return cuts.triangles(corners), cuts


def fan(count: int) -> list[list[int]]:
    return [[0, k, k + 1] for k in range(1, count - 1)]


def vector_areas(verts: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (verts[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


def newell(verts: np.ndarray) -> np.ndarray:
    """Return the vector area by Newell's sum over the edges."""
    after = np.roll(verts, -1, axis=0)
    return np.cross(verts - verts[0], after - verts[0]).sum(axis=0) / 2


def assert_edges_are_met(count: int, triangles) -> None:
    """Assert that every edge of a triangle is an edge of the polygon or shared with another triangle: no cracks."""
    edges = Counter((int(a), int(b)) for t in triangles for a, b in zip(t, np.roll(t, -1), strict=True) if a != b)
    edges.subtract(Counter((k, (k + 1) % count) for k in range(count)))
    assert all(edges[b, a] == number for (a, b), number in list(edges.items()))


def assert_cut(verts) -> np.ndarray:
    """Triangulate a simple planar polygon, and assert that the triangles fill it without flips or overlaps."""
    verts = np.asarray(verts, np.float64)
    triangles = cut_one(verts)
    area = newell(verts)
    size = math.sqrt(area @ area)
    along = vector_areas(verts, triangles) @ (area / size)
    assert along.sum() == pytest.approx(size, rel=1e-12)
    assert along.min() >= -1e-12 * size
    assert_edges_are_met(len(verts), triangles)
    return triangles


def in_space(points: np.ndarray, seed: int) -> np.ndarray:
    """Embed points (n, 2) in a random plane, seen from either side, (n, 3)."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return points @ axes[:2] + rng.standard_normal(3)


def star(radii: list[float]) -> np.ndarray:
    angles = 2 * np.pi * np.arange(len(radii)) / len(radii)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.array(radii)[:, None]


def uncrossed(points: np.ndarray) -> np.ndarray:
    """Return a simple polygon through all points: crossing edges are swapped until none are left."""
    order = list(range(len(points)))

    def side(a, b, c):
        (x, y), (s, t), (u, v) = points[a], points[b], points[c]
        return (s - x) * (v - y) - (t - y) * (u - x)

    changed = True
    while changed:
        changed = False
        for i in range(len(order) - 1):
            for j in range(i + 2, len(order) - (i == 0)):
                a, b, c, d = order[i], order[i + 1], order[j], order[(j + 1) % len(order)]
                if side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0:
                    order[i + 1 : j + 1] = order[i + 1 : j + 1][::-1]
                    changed = True
    return points[order]


def test_corners_keep_their_uvs_and_normals(tmp_path):
    text = "".join("v {} {} {}\nvt {} {}\n".format(*corner, *corner[:2]) for corner in DART)
    text += "vn 0 0 1\nvn 0 0 2\nf 3/3/1 4/4/2 5/5/1 1/1/2 2/2/2\nf 1/1/1 2/2/1 3/3/1\n"
    (mesh,) = load(write(tmp_path / "a.obj", text)).meshes
    assert mesh.faces.tolist()[-1] == [0, 1, 2]
    uvs = mesh.uvs[mesh.uv_faces]
    assert np.array_equal(uvs[:, :, 0], mesh.verts[mesh.faces][:, :, 0])
    assert np.array_equal(1 - uvs[:, :, 1], mesh.verts[mesh.faces][:, :, 1])
    expected = np.where(np.isin(mesh.faces[:3], [3, 0, 1]), 2.0, 1.0)
    assert np.array_equal(mesh.normals[mesh.normal_faces[:3]][:, :, 2], expected)


@pytest.mark.parametrize("scale", SCALES)
def test_convex_polygons_stay_fans(scale):
    octagon = in_space(star([1.0] * 8), 4) * scale
    with_middles = np.stack([octagon, (octagon + np.roll(octagon, -1, axis=0)) / 2], axis=1).reshape(-1, 3)
    for verts in (octagon[:4], octagon, octagon[::-1], with_middles):
        assert cut_one(verts).tolist() == fan(len(verts))
        assert cut_one(verts.astype(np.float32) if scale == 1.0 else verts).tolist() == fan(len(verts))


def test_order_of_polygons_and_their_numbers():
    """Triangles, quadrilaterals and others alternate: each polygon's triangles are contiguous and in order."""
    rng = np.random.default_rng(1)
    polygons = [star(list(rng.uniform(0.1, 1, n))) for n in rng.integers(3, 9, 200)]
    verts = np.concatenate([in_space(points, k) for k, points in enumerate(polygons)])
    counts = np.array([len(points) for points in polygons])
    shuffled = rng.permutation(len(verts)).astype(np.int32)  # corners refer to vertices in any order
    faces, cuts = cut(verts[np.argsort(shuffled)], shuffled, counts)
    places = cuts.triangles(np.arange(len(verts)))
    assert np.array_equal(cuts.polygon, np.repeat(np.arange(200), counts - 2))
    assert np.array_equal(faces, shuffled[places])
    for number, start in enumerate(np.cumsum(counts) - counts):
        alone = cut_one(verts[start : start + counts[number]])
        assert np.array_equal(places[cuts.polygon == number] - start, alone)
    assert cuts.left == 0


@pytest.mark.parametrize("scale", SCALES)
def test_any_magnitude(scale):
    verts = in_space(star([1, 0.2, 1, 0.3, 1, 0.2, 1, 0.1]), 5)
    expected = assert_cut(verts)
    assert expected.tolist() != fan(8)
    assert np.array_equal(cut_one(verts * scale), expected)
    both = np.concatenate([verts * scale, verts])  # beside one of size 1
    faces, _ = cut(both, np.arange(16, dtype=np.int32), np.array([8, 8]))
    assert np.array_equal(faces[:6], expected)
    assert np.array_equal(faces[6:] - 8, expected)


@given(st.integers(4, 24), st.integers(0, 1 << 32), st.booleans())
def test_simple_polygons(count, seed, space):
    rng = np.random.default_rng(seed)
    points = uncrossed(rng.random((count, 2)))
    assert_cut(in_space(points, seed) if space else np.concatenate([points, np.ones((count, 1))], axis=1))


@given(st.integers(4, 20), st.integers(0, 1 << 32), st.integers(0, 3))
def test_corners_on_edges_and_repeated_ones_stay_in_use(count, seed, axis):
    """Corners on a small lattice, on edges and coincident: no cracks, and no corner is lost."""
    rng = np.random.default_rng(seed)
    points = uncrossed(rng.random((count, 2)).round(1))
    sides = zip(points, np.roll(points, -1, 0), strict=True)
    points = np.concatenate([[p, *[(p + q) / 2] * int(rng.integers(0, 3))] for p, q in sides])
    verts = np.insert(points, axis, 3.0, axis=1) if axis < 3 else in_space(points, seed)
    area = newell(verts)
    assume(np.abs(area).max() > 1e-3)
    triangles = cut_one(verts)
    assert_edges_are_met(len(verts), triangles)
    assert vector_areas(verts, triangles).sum(axis=0) == pytest.approx(area, abs=1e-12)


@pytest.mark.parametrize(
    ("corners", "area", "is_flat"),
    [
        (DART, 10, False),
        ([[0, 0], [4, -4], [0, 9], [-4, -4]], 36, False),  # the reflex corner at any position of a quadrilateral
        *((np.insert(DART, k, DART[k], axis=0), 10, True) for k in range(5)),  # corners that come twice
        # Corners on straight edges of an L: no triangle is degenerate, and no corner is left out.
        ([[0, 0], [4, 0], [4, 1], [1, 1], [1, 2], [1, 3], [1, 4], [0.5, 4], [0, 4]], 7, False),
        # A square with a square hole, joined by a bridge whose corners come twice.
        ([[0, 0], [9, 0], [9, 9], [0, 9], [0, 0], [3, 3], [3, 6], [6, 6], [6, 3], [3, 3]], 72, True),
    ],
)
def test_concave_polygons(corners, area, is_flat):
    """No triangle is flipped, as in a fan, whose signed areas have the same sum."""
    verts = np.insert(np.array(corners, float)[:, :2], 2, 1.0, axis=1)
    for shift in range(len(verts)):
        turned = np.roll(verts, shift, axis=0)
        triangles = assert_cut(turned)
        areas = vector_areas(turned, triangles)[:, 2]
        assert areas.sum() == area
        assert is_flat or areas.min() > 0 or triangles.tolist() == fan(len(verts))
        assert set(triangles.reshape(-1).tolist()) == set(range(len(verts)))


CROSSED = {
    "bow-tie": ([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]], fan(4)),
    "lopsided bow-tie": ([[0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 1, 0]], fan(4)),
    "no area": ([[0, 0, 0], [1, 1, 1], [2, 2, 2], [3, 3, 3], [1, 1, 1]], fan(5)),
    "one point": ([[1, 2, 3]] * 6, fan(6)),
    "there and back": ([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 0]], fan(4)),
}


@pytest.mark.parametrize(("verts", "expected"), CROSSED.values(), ids=list(CROSSED))
def test_what_has_no_inside_stays_a_fan(verts, expected):
    assert cut_one(verts).tolist() == expected


@given(st.integers(4, 30), st.integers(0, 1 << 32), st.sampled_from([0, 1, 9]))
def test_polygons_that_cross_themselves(count, seed, digits):
    """The result has the polygon's edges, hence its area, and no more flipped area than a fan."""
    verts = np.random.default_rng(seed).random((count, 3)).round(digits)
    triangles = cut_one(verts)
    assert np.array_equal(triangles, cut_one(verts))
    assert_edges_are_met(count, triangles)
    area = newell(verts)
    assert vector_areas(verts, triangles).sum(axis=0) == pytest.approx(area, abs=1e-12)
    over = [np.maximum(-(vector_areas(verts, t) @ area), 0).sum() for t in (triangles, np.array(fan(count)))]
    assert over[0] <= over[1] + 1e-9


def test_polygons_that_would_take_too_long_are_fans_and_told(tmp_path, monkeypatch):
    rng = np.random.default_rng(3)
    many = uncrossed(rng.random((70, 2)))
    text = "".join(f"v {x!r} {y!r} 0\n" for x, y in many.tolist()) + "f " + " ".join(map(str, range(1, 71))) + "\n"
    text += "".join("v {} {} {}\n".format(*corner) for corner in DART) + "f -5 -4 -3 -2 -1\n"
    path = write(tmp_path / "a.obj", text)
    scene = load(path)
    assert scene.ignored == ()
    assert scene.meshes[0].faces[:68].tolist() != fan(70)
    monkeypatch.setattr(triangulate, "_WORK", 100)
    with pytest.warns(UserWarning, match="concave polygons of very many corners"):
        scene = load(path)
    assert scene.meshes[0].faces[:68].tolist() == fan(70)
    assert scene.meshes[0].faces[68:].tolist() != (np.array(fan(5)) + 70).tolist()  # small ones always


def test_large_polygons_are_looked_at_first(monkeypatch):
    monkeypatch.setattr(triangulate, "_UNCHECKED", 64)
    zigzag = np.random.default_rng(4).random((100, 2))
    for points, left in ((star(list(np.random.default_rng(5).uniform(0.2, 1, 100))), 0), (zigzag, 1)):
        verts = in_space(points, 6)
        faces, cuts = cut(verts, np.arange(100, dtype=np.int32), np.array([100]))
        assert cuts.left == left
        assert (faces.tolist() == fan(100)) == bool(left)
    monkeypatch.setattr(triangulate, "_PAIRS", 10)
    assert triangulate._crosses(star([0.2, 1.0] * 50)) == (True, 0)


def test_blocks_and_groups_change_nothing(monkeypatch):
    rng = np.random.default_rng(8)
    counts = rng.integers(3, 8, 300)
    verts = rng.random((int(counts.sum()), 3))
    corners = np.arange(len(verts), dtype=np.int32)
    expected, _ = cut(verts, corners, counts)
    monkeypatch.setattr(triangulate, "_BLOCK", 20)
    assert np.array_equal(cut(verts, corners, counts)[0], expected)
