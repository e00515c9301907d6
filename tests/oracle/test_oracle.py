"""The oracle's stages against closed forms, exact arithmetic and mpmath."""

import math
from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from clshade.oracle import clip, coverage, shade, texture, transform
from clshade.oracle.corners import placed_normals, vertex_normals
from clshade.oracle.lights import Interaction, Lights
from clshade.oracle.shade import Surface
from clshade.scene.camera import Camera

CAMERA = Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), 1.0, (1.0, 1.0), (32, 32))

PIXEL = coverage.SUBPIXELS
UP = np.array([0.0, 0, 1])


def close(actual, expected, rtol=1e-12, atol=1e-12) -> bool:
    return np.allclose(actual, expected, rtol=rtol, atol=atol)


def test_camera_frame_is_right_handed_and_unmirrored():
    axes = transform.camera_frame(replace(CAMERA, eye=(0, 0, 4), lookat=(0, 0, 0)))
    assert np.array_equal(axes, [[1, 0, 0], [0, 1, 0], [0, 0, -1]])
    eye, lookat, up = np.array([1.0, -2, 3]), np.array([-4.0, 4, 9]), np.array([0.3, 1, -0.2])
    axes = transform.camera_frame(replace(CAMERA, eye=eye, lookat=lookat, up=up))
    assert close(axes @ axes.T, np.eye(3), atol=1e-15)
    assert close(axes[2], (lookat - eye) / np.linalg.norm(lookat - eye), atol=1e-15)
    assert axes[1] @ up > 0
    assert close(axes[0], np.cross(axes[2], axes[1]), atol=1e-15)
    for scale in (2.0**-300, 2.0**300):
        larger = replace(CAMERA, eye=eye * scale, lookat=lookat * scale, up=up * scale)
        assert np.array_equal(transform.camera_frame(larger), axes)


def test_projection_snapping_and_placing():
    oblong = replace(CAMERA, plane=(1.0, 2.0), resolution=(100, 50))
    uv = transform.project(np.array([[0.0, 0, 5], [1, 1, 2], [-1, 0, 4]]), oblong)
    assert np.array_equal(uv, [[50, 25], [75, 50], [37.5, 25]])
    assert transform.snap(np.array([0.5, 1.5, 2.5, -0.5, -1.5]) / PIXEL).tolist() == [0, 2, 2, 0, -2]
    far = replace(CAMERA, lookat=(0, 0, 2.0))
    assert transform.near_distance(np.array([[0.0, 0, 0], [3, 4, 0]]), far) == 2.5e-4
    assert transform.near_distance(np.ones((1, 3)), far) == 2e-4
    verts = np.array([[1.0, 2, 3], [0, 0, 0]], np.float32)
    turn = np.array([[0.0, -1, 0, 10], [1, 0, 0, 20], [0, 0, 2, 30], [0, 0, 0, 1]])
    assert transform.world_vertices(verts, turn).tolist() == [[8, 21, 36], [10, 20, 30]]


def test_vertex_normals():
    verts = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [9, 9, 9]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]])
    normals = vertex_normals(verts, faces)[0]
    assert close(normals[:2], [np.ones(3) / math.sqrt(3), np.array([0, 1, 1]) / math.sqrt(2)], atol=1e-15)
    assert not normals[4].any()
    assert not vertex_normals(verts, np.array([[0, 1, 2], [0, 2, 1]]))[0].any()
    for scale in (1e-150, 1e150):
        assert close(vertex_normals(verts * scale, faces)[0], normals, atol=1e-15)
    # Faces are weighted by area: twice the area, twice the weight.
    folded = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 1]])
    assert close(vertex_normals(folded, [[0, 1, 2], [0, 3, 1]])[0][0], np.array([0, 1, 2]) / math.sqrt(5), atol=1e-15)


def test_errors_of_vertex_normals_of_slivers():
    """Against extended precision: never above the estimate; for slivers some thousand times the error of a square."""
    rng = np.random.default_rng(3)
    shares = []
    for width in (1.0, 1e-2, 1e-4, 1e-6):
        for _ in range(40):
            angle = rng.uniform(0, 6.28) + width * np.cumsum(rng.uniform(0.5, 1.0, 9))
            rim = np.stack([np.cos(angle), np.sin(angle), 0.3 * np.sin(angle)], axis=1)
            verts = np.concatenate([rng.normal(size=(1, 3)), rim])
            faces = np.array([[0, k, k + 1] for k in range(1, 9)])
            corners = verts.astype(np.longdouble)[faces]
            exact = np.zeros((len(verts), 3), np.longdouble)
            np.add.at(exact, faces, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, None])
            exact /= np.sqrt((exact * exact).sum(axis=1, keepdims=True))
            normals, allowed = vertex_normals(verts, faces)
            off = np.sqrt(((normals - exact) ** 2).sum(axis=1)).astype(np.float64)
            assert (off <= allowed / 2.0 + 4 * 2.0**-53).all()  # of two sides, and the rounding of normalization
            shares.append((off / allowed).max())
        assert 1e-16 / width < allowed.max() < 1e-13 / width
    assert max(shares) > 0.02  # the bound is not far too large
    for faces in ([[0, 1, 2], [0, 2, 1]], np.zeros((0, 3), int)):
        assert vertex_normals(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]]), faces)[1].tolist() == [0.0] * 4


def test_placed_normals_stay_perpendicular():
    rng = np.random.default_rng(1)
    for _ in range(20):
        matrix = np.eye(4)
        matrix[:3, :3] = rng.normal(size=(3, 3))
        normal, tangent = rng.normal(size=(2, 3))
        tangent -= normal * (tangent @ normal) / (normal @ normal)
        placed = placed_normals(normal[None], matrix)[0][0]
        assert abs(placed @ (matrix[:3, :3] @ tangent)) < 1e-13
        assert placed @ np.linalg.inv(matrix[:3, :3]).T @ normal > 0
    mirror = np.diag([-1.0, 1, 1, 1])
    assert close(placed_normals(np.array([[2.0, 0, 0], [0, 3, 0]]), mirror)[0], [[-1, 0, 0], [0, 1, 0]])


def test_near_clip_lands_on_the_plane_and_agrees_between_neighbors():
    rng = np.random.default_rng(2)
    for _ in range(50):
        a, b, c, d = rng.normal(size=(4, 3))
        a[2], b[2] = abs(a[2]) + 1, -abs(b[2])
        cuts = []
        for corners in (np.array([a, b, c]), np.array([b, a, d]), np.array([d, b, a])):
            points, weights = clip.clip_near(corners, np.eye(3), 0.5)
            assert (points[:, 2] >= 0.5).all()
            assert close(weights.sum(axis=1), 1, atol=1e-12)
            assert close(weights @ corners, points, atol=1e-12)
            cuts.append({tuple(p) for p in points.tolist() if p[2] == 0.5})
        assert len(cuts[0] & cuts[1] & cuts[2]) == 1  # the cut of the shared edge a-b, bit-identical


def test_pieces_pass_drop_and_cut():
    simple = [[-1.0, -1, 4], [1, -1, 4], [0, 1, 4]]
    behind = [[0.0, 0, -1], [1, 0, -2], [0, 1, 0.05]]
    straddling = [[-1.0, -1, 4], [1, -1, 4], [0, 1, -4]]
    huge = [[-1e6, -1e6, 4], [1e6, -1e6, 4], [0, 1e6, 4]]
    aside = [[1e6, 0, 4], [2e6, 1, 4], [2e6, 2, 4]]
    cut = clip.pieces(np.array([straddling, behind, simple, huge, aside]), 0.1, CAMERA)
    assert cut.face.tolist()[:4] == [0, 0, 2, 3]  # in face order
    assert set(cut.face.tolist()) == {0, 2, 3}
    assert np.array_equal(cut.weights[2], np.eye(3))
    assert (cut.z >= 0.1).all()
    assert ((cut.xy >= clip.GUARD[0] * PIXEL) & (cut.xy <= clip.GUARD[1] * PIXEL)).all()
    # In an oblong image too the parts of a huge triangle cover each pixel once.
    corners = np.array(huge)
    camera = replace(CAMERA, focal=2.0, plane=(1.0, 4.0), resolution=(64, 20))
    cut = clip.pieces(corners[None], 0.1, camera)
    low, high = (limit * PIXEL for limit in clip.GUARD)
    assert (cut.xy.min(axis=(0, 1)) == low).all()
    assert (cut.xy.max(axis=(0, 1)) == high).all()
    assert sum(coverage.triangle_mask(xy, 64, 20).astype(int) for xy in cut.xy).tolist() == [[1] * 64] * 20
    assert close(transform.project(cut.weights @ corners, camera) * PIXEL, cut.xy, rtol=0, atol=0.51)


def exact_mask(xy, columns: int, rows: int) -> np.ndarray:
    """Apply the top-left rule in rationals: a center moved a little to the right, and far less down, must be inside."""
    mask = np.zeros((rows, columns), bool)
    for row, column in np.ndindex(rows, columns):
        x = PIXEL * column + coverage.HALF + Fraction(1, 10**20)
        y = PIXEL * row + coverage.HALF - Fraction(1, 10**40)
        ends = zip(xy, xy[1:] + xy[:1], strict=True)
        sides = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for (ax, ay), (bx, by) in ends]
        mask[row, column] = all(side > 0 for side in sides) or all(side < 0 for side in sides)
    return mask


def test_coverage_equals_exact_arithmetic():
    rng = np.random.default_rng(3)
    for index in range(300):
        step = (1, PIXEL // 4, PIXEL // 2, PIXEL)[index % 4]  # coarse grids put many centers on edges and corners
        xy = rng.integers(-2 * PIXEL // step, 8 * PIXEL // step, (3, 2)) * step
        if step == PIXEL:  # or beside them
            xy += coverage.HALF + rng.choice([-1, 0, 1, 255, 257], (3, 2))
        if index % 3 == 0:
            xy[0] = rng.integers(*(int(limit) * PIXEL for limit in clip.GUARD), 2)
        mask = coverage.triangle_mask(xy, 6, 5)
        assert np.array_equal(mask, exact_mask(xy.tolist(), 6, 5)), xy.tolist()
        assert np.array_equal(mask, coverage.triangle_mask(xy[[0, 2, 1]], 6, 5))
        assert np.array_equal(mask, coverage.triangle_mask(xy[[1, 2, 0]], 6, 5))
        area, (c0, r0, c1, r1), culled = coverage.setup(xy, 6, 5)
        outside = mask.copy()
        outside[r0 : r1 + 1, c0 : c1 + 1] = False
        assert not outside.any()
        assert not (culled and mask.any())
        assert (coverage.edge_functions(xy, np.arange(6), np.array(2)).sum(axis=-1) == abs(area)).all()


def test_setup_culls():
    side = 4 * PIXEL
    ccw = np.array([[0, 0], [side, 0], [0, side]])
    between, beside = ccw // 9 + coverage.HALF + 1, ccw + 10 * side
    both = coverage.setup(np.array([ccw, ccw[::-1], ccw * 0, between, beside]), 4, 4, cull=True)
    assert both.area.tolist()[:3] == [side**2, -(side**2), 0]
    assert both.box[0].tolist() == [0, 0, 3, 3]
    assert both.culled.tolist() == [False, True, True, True, True]
    assert not coverage.setup(ccw[::-1], 4, 4).culled


def test_samples_are_the_masks():
    xy = np.random.default_rng(4).integers(-4 * PIXEL, 24 * PIXEL, (40, 3, 2))
    setup = coverage.setup(xy, 20, 17)
    alive = np.flatnonzero(~setup.culled)
    for limit in (1, 50, 10**6):
        counts = np.zeros((len(alive), 17, 20), int)
        for k, column, row, _ in coverage.samples(xy[alive], setup.box[alive], limit):
            np.add.at(counts, (k, row, column), 1)
        assert np.array_equal(counts, [coverage.triangle_mask(t, 20, 17) for t in xy[alive]])


def test_painter_order():
    z = np.array([[1.0, 2, 3], [3, 1, 2], [0, 0, 0], [-0.0, 0, 0], [9, 9, 9], [2, 2, 2 + 2**-49]])
    assert coverage.painter_order(z, np.array([1, 1, 1, 1, 0, 1], bool)).tolist() == [3, 2, 1, 0, 5]


@pytest.mark.parametrize("orthographic", [False, True])
def test_depths_much_nearer_than_a_corner_keep_their_digits(orthographic):
    e, z = (2**40 - 3, 2, 1), (2.0**-30, 5.0, 7.0)
    total = sum(Fraction(k) * Fraction(d) ** (1 if orthographic else -1) for k, d in zip(e, z, strict=True))
    exact = total / 2**40 if orthographic else 2**40 / total
    assert abs(Fraction(float(shade.depth(np.array(e), np.array(z), orthographic))) / exact - 1) < 8 * 2.0**-53


def test_barycentrics_and_depth_at_the_middle_of_an_edge():
    edges, z = np.array([5, 5, 0]), np.array([1.0, 3.0, 7.0])
    assert shade.barycentrics(edges, z, "affine").tolist() == [0.5, 0.5, 0]
    assert close(shade.barycentrics(edges, z, "perspective"), [0.75, 0.25, 0], atol=1e-16)
    assert shade.depth(edges, z) == pytest.approx(1.5, rel=1e-15)  # harmonic mean of 1 and 3


def lit(normal=(0, 0, 1), color=1.0, eye=(0, 0, 2), l_pos=(0, 0, 5), kd=0.5, ks=0.0, n=1.0):
    """Return the light of a light of intensity 2, and ambient light of 0.1."""
    args, one = (np.array(v, float) for v in ((0, 0, 0), normal, eye)), np.ones(3)
    surface = Surface(n, k={"kd": kd * one, "ks": ks * one})
    return 0.1 + color * shade.reflected(Interaction(*args, Lights(np.array([l_pos], float), 2 * one[None])), surface)


def test_light_closed_forms():
    assert close(lit(), 0.1 + 2 * 0.5)  # normal incidence
    assert close(lit(l_pos=(math.sqrt(3), 0, 1)), 0.1 + 2 * 0.5 * 0.5)  # 60 degrees
    for eye in ((0, 0, 2), (0, 0, -2)):
        assert close(lit(l_pos=(0, 0, -5), eye=eye, ks=1.0), 0.1)  # from behind: no diffuse, no highlight
    assert close(lit(normal=(0, 0, 7), color=(0.5, 1, 2)), [0.6, 1.1, 2.1])
    # Light at 60 degrees: R.V with the eye on the normal is cos(60); mirrored direction gives 1 for any n.
    assert close(lit(l_pos=(math.sqrt(3), 0, 1), kd=0, ks=0.5, n=3), 0.1 + 2 * 0.5 / 8)
    assert close(lit(l_pos=(1, 0, 1), eye=(-2, 0, 2), kd=0, ks=0.5, n=1e9), 0.1 + 2 * 0.5)
    assert close(lit(l_pos=(1, 0, 1), eye=(2, 0, 1), kd=0, ks=0.5, n=0), 0.1)  # R.V < 0
    assert close(lit(l_pos=(1, 0, 1), eye=(-2, 0, 1), kd=0, ks=0.5, n=0), 0.1 + 2 * 0.5)
    # Degenerate input contributes nothing.
    assert close(lit(normal=(0, 0, 0), ks=1.0), 0.1)
    assert close(lit(l_pos=(0, 0, 0), ks=1.0), 0.1)
    assert close(lit(eye=(0, 0, 0), ks=1.0, n=0), 0.1 + 2 * 0.5)
    for scale in (1e-200, 1e200):
        for axis in np.eye(3):
            assert close(lit(l_pos=scale * axis, eye=scale * axis, normal=scale * axis), 0.1 + 2 * 0.5)


@pytest.mark.parametrize("n", [1, 20, 1e9])
def test_highlight_against_mpmath(n):
    """Inside the lobe the power's condition number is about 2*sqrt(n) in the directions, 1e-16 each."""
    rng = np.random.default_rng(5)
    with mpmath.workdps(60):
        for _ in range(20):
            spread = 1 / math.sqrt(n + 1)
            l_pos, eye = np.array([0.3, 0.2, 1.0]), np.array([-0.3, -0.2, 1.0]) + spread * rng.uniform(-0.5, 0.5, 3)
            l_unit, v_unit = (mpmath.matrix(v.tolist()) / mpmath.norm(mpmath.matrix(v.tolist())) for v in (l_pos, eye))
            cosine = -l_unit[0] * v_unit[0] - l_unit[1] * v_unit[1] + l_unit[2] * v_unit[2]
            value = lit(l_pos=l_pos, eye=eye, kd=0, ks=1.0, n=n)[0] - 0.1
            expected = pytest.approx(2 * float(cosine ** mpmath.mpf(n)), rel=16 * math.sqrt(n + 1) * 2**-53, abs=1e-15)
            assert value == expected


def test_conditioning_budget_and_gate():
    position, point = np.array([[0.0, 0, -4]]), np.array([[0.0, 0, -5], [0, 0, -4.001]])

    def kappa(at, extent, length=1.0, eye=np.zeros(3), away=1.0, **options):  # noqa: B008
        light = Lights(away * position, away * position)
        return shade.condition_number(shade.conditions(Interaction(at, UP, eye, light, extent, length, **options)))

    assert close(kappa(point, 5.0), [5, 5000], rtol=1e-9)
    assert kappa(point[0], 5.0, 0.01) == pytest.approx(100)
    surface = Surface(1.0, np.full(3, 0.1), {"kd": np.full(3, 0.2), "ks": np.full(3, 0.3)})
    assert close(shade.budget(np.array([0.5, 1, 3]), surface, np.array([[2.0, 2, -2]] * 2)), [2.1, 2.1, 6.1])
    # It holds the light also with tinted ambient light, for any color of the surface.
    dark = np.array([9.0, 0.5, 1.0]), Surface(1.0, np.full(3, 0.25)), np.zeros((0, 3))
    assert [shade.budget(*dark, tinted).tolist() for tinted in (False, True)] == [[0.25] * 3, [2.25, 0.25, 0.25]]
    # In orthographic projection directions to the eye are exact, and coordinates are relative to the origin.
    beside = point[:1] + [0, 0, 1]
    assert kappa(point[:1], 1e6, eye=beside, parallel=True) == pytest.approx(1e6)
    assert kappa(point[:1], 1e6, eye=beside, away=1e9, parallel=True) == pytest.approx(1)


def jump(light, n=2.0, normal=(0.0, 0, 1), length=1.0):
    """Return the possible jump of the light at (2, 0, -2), which the eye sees at 45 degrees to its normal."""
    one_light, point = Lights(np.array([light]), np.array([[1.0, 2, -3]])), np.array([[2.0, 0, -2]])
    at = Interaction(point, np.array(normal), np.zeros(3), one_light, 2.0, length)
    return shade.jumps(at, Surface(np.float64(n), k={"ks": np.ones(3)}))[0]


def test_highlights_that_may_be_decided_either_way():
    """A light at distance 1, and 3 from the eye, has kappa 3: 3e-6 of N.L and R.V are uncertain."""
    for side in (1, -1):  # N.L; R.V is sqrt(1/2)
        assert close(jump((3, 0, -2 + side * 2.9e-6)), [0.5, 1, 1.5], rtol=1e-5)
        assert close(jump((3, 0, -2 + side * 2.9e-6), n=20.0), np.array([1, 2, 3]) / 1024, rtol=1e-4)
        assert not jump((3, 0, -2 + side * 3.1e-6)).any()
    # R.V < 0 if the light is on the point's other side: no highlight behind the gate.
    assert not jump((1, 0, -2)).any()
    # With a mean normal of length 1/10, 1e-5 is uncertain.
    assert close(jump((3, 0, -2 + 9.9e-6), length=0.1), [0.5, 1, 1.5], rtol=1e-4)
    # The light is towards the eye: R.V = 0. Unless n is tiny, the highlight behind the gate is negligible.
    assert close(jump((1, 0, -1), n=0.0), [1, 2, 3])
    assert close(jump((1, 0, -1), n=1.0), [0, 0, 0], atol=1e-5)
    assert jump((1, 0, -1), n=0.5).max() > 1e-3
    assert not jump((1, 0, -1.001), n=0.0).any()
    for height, doubtful in ((2e-6, True), (-2e-6, True), (1.5e-5, False), (-1.5e-5, False)):  # R.V is about as large
        assert jump((1, 0, -1 + height), n=0.0).any() == doubtful
    assert not jump((3, 0, -2), normal=(0.0, 0, 0)).any()


IMAGE = np.arange(24, dtype=np.float32).reshape(2, 4, 3)


def test_texel_centers_and_borders():
    j, i = np.indices((2, 4))
    centers = np.stack([(i + 0.5) / 4, (j + 0.5) / 2], axis=-1)
    for wrap in ("repeat", "clamp", "mirror"):
        assert close(texture.bilerp(centers, IMAGE, "standard", wrap), IMAGE, atol=1e-12)
        assert close(texture.bilerp([0.5, 0.25], IMAGE, "standard", wrap), (IMAGE[0, 1] + IMAGE[0, 2]) / 2)
    beyond = 1 + 1.5 / 4
    for wrap, places, colors in (
        ("repeat", (0.0, beyond), [(IMAGE[0, 0] + IMAGE[0, 3]) / 2, IMAGE[0, 1]]),
        ("clamp", (0.0, beyond), [IMAGE[0, 0], IMAGE[0, 3]]),
        ("mirror", (0.0, beyond, -beyond), [IMAGE[0, 0], IMAGE[0, 2], IMAGE[0, 2]]),
    ):
        assert close(texture.bilerp([(u, 0.25) for u in places], IMAGE, "standard", wrap), colors), wrap


def test_course_lookup():
    uv = np.array([[0.0, 0], [1, 1], [1 / 3, 0], [0.5, 0.5], [-7, 9], [1, 0]])
    expected = [IMAGE[0, 0], IMAGE[1, 3], IMAGE[0, 1], IMAGE.mean(axis=(0, 1)), IMAGE[1, 0], IMAGE[0, 3]]
    assert close(texture.bilerp(uv, IMAGE, "course"), expected, atol=1e-12)


@pytest.mark.parametrize("lookup", ["standard", "course"])
@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
def test_lookup_is_defined_everywhere(lookup, wrap):
    wild = np.array([0.0, -0.0, 1, 1e30, -1e30, -1e-30, np.inf, -np.inf, np.nan])
    for image in (IMAGE, IMAGE[:1, :1], IMAGE[:1], IMAGE[:, :1]):
        colors = texture.bilerp(np.stack(np.meshgrid(wild, wild), axis=-1), image, lookup, wrap)
        assert ((colors >= image.min()) & (colors <= image.max())).all()
        assert np.array_equal(colors[6:], np.broadcast_to(colors[0], (3, *colors.shape[1:])))  # not finite: as 0


def test_steepness_is_the_slope_of_the_highlight():
    """n x^(n-1) for 0 < n < 1 at x = R.V, 1 for all other n, and where there is no highlight."""

    def shiny(n: float) -> Surface:
        return Surface(np.array([n]), k={"ks": np.ones((1, 3))})

    def steepness(surface: Surface, light, normal=UP):
        at = Interaction(np.zeros((1, 3)), normal[None], UP, Lights(np.array([light]), np.ones((1, 3))))
        return shade.steepness(at, surface)

    for n, expected in ((0.5, 0.5 * 0.8**-0.5), (0.01, 1.0), (0.0, 1.0), (1.0, 1.0), (200.0, 1.0)):
        assert steepness(shiny(n), (3.0, 0, 4)).tolist() == pytest.approx([max(expected, 1.0)])
    low = (1.0, 0, 1e-8)  # N.L and R.V are 1e-8
    assert steepness(shiny(0.25), low) == pytest.approx(0.25 * 1e-8**-0.75)
    assert steepness(shiny(0.25), low, -UP) == 1.0
    assert steepness(Surface(np.array([0.25]), k={"ks": np.zeros((1, 3))}), low) == 1.0
