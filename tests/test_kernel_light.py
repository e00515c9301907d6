"""light.clh, through the stage `light`, at single points: highlights up to n = 1e9, degenerate input, overflow."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import oracle_asserts
import pytest
from kernel_stages import OTHER_LANES, bits, float32, light_rows, mask, material_rows, reflected

from clshade.measure.stability.cases.light import in_the_lobe, unit
from clshade.oracle import OracleFrame, shade
from clshade.oracle.lights import POINT, Interaction, Lights, Shape
from clshade.scene.material import TERMS

HALF_ULP = 2.0**-24
EYE = np.zeros(3)  # points and lights are relative to it


def reflect(
    device, points, normals, lights, *, colors=None, lanes=None, material=None, shape=None, **features
) -> np.ndarray:
    """Return the light (K, 3) at points with normals (K, 3) and colors (K, 3), by default white; members of
    material as of `material_rows`.

    lights: (positions (L, 3), intensities (L, 3)). shape: further members of all their struct_layout.SINGLE.Light rows.
    """
    needed = {"LIT": 1, "POWER": 1, **{term.feature: 1 for term in TERMS.values()}}
    chosen = mask(**{**needed, "LIGHT_SHAPES": int(shape is not None), **features})
    rows = light_rows(*map(np.atleast_2d, lights))
    for name, value in (shape or {}).items():
        rows[name] = value
    return reflected(device, chosen, points, normals, colors, material_rows(**(material or {})), rows, lanes)


# Highlights


def directions(points, normals, light) -> shade.Directions:
    return shade.Directions.at(*(a.astype(np.float64) for a in (points, normals, EYE, light)))


def exact_highlight(points, normals, light, n) -> tuple[np.ndarray, np.ndarray]:
    """Return (R.V)^n in float64 and where it is inside the lobe, both (K,)."""
    value = shade.specular(directions(points, normals, light), np.float64(n))
    return value, value >= math.exp(-1.0)


@pytest.mark.sampled
@pytest.mark.parametrize("n", [4.0, 20.0, 200.0, 1e4, 1e6, 1e9])
def test_highlights_own_relative_error(device, n):
    """Inside the lobe at most 16 * sqrt(n) * 2^-24 (clshade/measure/README.md, "Bounds, and where they come from").

    |R-V| = d <= sqrt(2/n) there. A direction errs by up to 6 units of 2^-24 (normalization); with the normal's own
    rounding, and its error entering twice, about 16 units in R-V, hence n*d*16 <= 16*sqrt(2n) of the power, if all
    errors had the same direction. Measured: below 3.6 * sqrt(n) * 2^-24.
    """
    points, normals, light = in_the_lobe(n)
    expected, inside = exact_highlight(points, normals, light, n)
    highlight = reflect(device, points, normals, (light, np.ones(3)), material={"n": n, "kd": 0.0})[:, 0]
    assert inside.sum() > 1000
    assert expected[inside].min() < 0.4
    assert expected[inside].max() > 0.99
    error = np.abs(highlight[inside] / expected[inside] - 1.0)
    assert error.max() <= 16.0 * math.sqrt(n) * HALF_ULP


def test_the_reference_is_right_at_the_stiffest(device):
    """The oracle's form in float64 against 50 digits at n = 1e9: an error of at most 1e-11."""
    n = 1e9
    points, normals, light = in_the_lobe(n, 60)
    expected, inside = exact_highlight(points, normals, light, n)
    with mpmath.workdps(50):
        for k in np.flatnonzero(inside)[:10]:
            p, m, q = (mpmath.matrix(v.astype(float).tolist()) for v in (points[k], normals[k], light))
            m, v, to = m / mpmath.norm(m), -p / mpmath.norm(p), (q - p) / mpmath.norm(q - p)
            mirrored = 2 * m * (m.T * to)[0] - to
            assert expected[k] == pytest.approx(float((mirrored.T * v)[0] ** n), rel=1e-10)


def test_a_naive_power_would_not_pass(device):
    """(R.V)^n from R.V in float32: beyond n = 1e5 the bound above rejects it."""
    points, normals, light = in_the_lobe(1e6)
    expected, inside = exact_highlight(points, normals, light, 1e6)
    r_v, _ = shade.mirrored(directions(points, normals, light))
    naive = float32(r_v).astype(np.float64) ** 1e6
    assert np.abs(naive / expected - 1.0)[inside].max() > 16.0 * math.sqrt(1e6) * HALF_ULP


# The model


@pytest.mark.parametrize("n", [0.0, 0.5, 1.0, 20.0, 200.0, 1e4])
def test_light_at_random_points(device, n):
    """Three lights, diffuse and specular, also with colors above 1: within the bound of the light budget
    (clshade/measure/README.md, "Bounds, and where they come from").

    For an exponent between 0 and 1 the slope at R.V = 0 is infinite: there the bound holds from R.V = 0.02 on, where
    the slope n * x^(n-1) is 3.5.
    """
    rng = np.random.default_rng(1)
    count = 5000
    points = float32(rng.uniform(-2, 2, (count, 3)))
    normals = float32(unit(rng.normal(size=(count, 3))))
    colors = float32(rng.uniform(0, 2, (count, 3)))
    positions = float32([[3.0, 0, 0], [-1, 4, 2], [0, 0, -3.5]])
    intensities = float32([[1, 0.5, 0.25], [0.3, 0.3, 2], [1, 1, -0.5]])
    k = dict(zip(TERMS, float32(rng.uniform(0.2, 0.9, (len(TERMS), 3))), strict=True))
    material = {"n": n, **k}
    lit = reflect(device, points, normals, (positions, intensities), colors=colors, material=material)
    p, m, c, l_pos, l_int = (a.astype(np.float64) for a in (points, normals, colors, positions, intensities))
    surface = shade.Surface(np.float64(n), k={name: factor.astype(np.float64) for name, factor in k.items()})
    at = Interaction(p, m, EYE, Lights(l_pos, l_int), np.abs(p).max(axis=1), np.ones(count))
    steepness = shade.steepness(at, surface)
    expected = OracleFrame(
        rgb=(c * shade.reflected(at, surface))[None],
        alpha=np.ones((1, count)),
        id=np.ones((1, count), np.uint32),
        Z=np.ones((1, count)),
        budget=shade.budget(c, surface, l_int)[None],
        conditions=shade.conditions(at, steepness)[None],
        jump=(np.abs(c) * shade.jumps(at, surface))[None],
        exponent=np.full((1, count), n),
        alpha_error=np.zeros((1, count)),
        unsure=np.zeros((1, count), bool),
    )
    steep = np.zeros((1, count), bool)
    if 0.0 < n < 1.0:
        r_v = np.array([shade.mirrored(directions(p, m, light))[0] for light in l_pos])
        steep[0] = ((r_v > -0.001) & (r_v < 0.02)).any(axis=0)
    assert steep.mean() < 0.05
    assert oracle_asserts.assert_colors_within(lit[None], expected, skip=steep) < 8.0


def one(device, point=(0, 0, -2), normal=(0, 0, 1), light=(0, 0, 0), intensity=(1, 1, 1), **options) -> list[float]:
    """Return the light at a single point."""
    vectors = [float32([v]) for v in (point, normal)]
    return reflect(device, *vectors, (float32(light), float32(intensity)), **options)[0].tolist()


def test_closed_forms(device):
    """Exact in float32: incidence along the normal and at 90 degrees; R.V = 1; 0^n contributes nothing."""
    assert one(device) == [2, 2, 2]  # kd + ks
    assert one(device, material={"ks": 0.0}) == [1, 1, 1]
    assert one(device, material={"kd": 0.0}) == [1, 1, 1]
    assert one(device, normal=(0, 0, -1)) == [0, 0, 0]  # from behind
    assert one(device, normal=(1, 0, 0)) == [0, 0, 0]  # along the surface
    assert one(device, intensity=(1, 0, -2)) == [2, 0, -4]
    for n in (0.0, 1.0, 1e9):
        assert one(device, material={"n": n, "kd": 0.0}) == [1, 1, 1]
    # The light above the point, the eye to the side: N.L = 1, R.V = 0: no highlight for any n.
    aside = {"point": (-2.0, 0, 0), "normal": (0, 0, 1), "light": (-2.0, 0, 1)}
    for n in (0.0, 1.0, 20.0):
        assert one(device, **aside, material={"n": n}) == [1, 1, 1]
    # R.V < 0: the light mirrored away from the eye.
    away = {"point": (-2.0, 0, -0.5), "normal": (0, 0, 1), "light": (-1.0, 0, 0.5)}
    for n in (0.0, 1.0, 2.0, 1e9):
        assert one(device, **away, material={"n": n, "kd": 0.0}) == [0, 0, 0]


@pytest.mark.parametrize("n", [0.0, 1.0, 20.0, 1e9])
def test_lights_behind_the_surface_give_exactly_nothing(device, n):
    rng = np.random.default_rng(22)
    points, normals = float32(rng.uniform(-2, 2, (4000, 3))), unit(rng.normal(size=(4000, 3)))
    light = float32([0.5, 0.25, 1.5])
    above = ((light - points) * normals).sum(axis=1)
    facing = float32(normals * -np.sign(above)[:, None])[np.abs(above) > 1e-3]
    lit = reflect(device, points[np.abs(above) > 1e-3], facing, (light, np.ones(3)), material={"n": n})
    assert not lit.any()


def test_degenerate_input_contributes_zero(device):
    assert one(device, normal=(0, 0, 0)) == [0, 0, 0]
    assert one(device, point=(1, 1, -2), light=(1, 1, -2)) == [0, 0, 0]  # the light at the point
    assert one(device, point=(0, 0, 0), light=(0, 0, 2)) == [1, 1, 1]  # the eye at the point: diffuse only
    assert one(device, point=(0, 0, 0), light=(0, 0, 0)) == [0, 0, 0]
    assert one(device, point=(1e-30, 0, 0), light=(0, 0, 2), material={"n": 0.0}) == [1, 1, 1]
    assert one(device, point=(0, 0, -2), light=(0, 0, 2.0**61)) == [2, 2, 2]  # the largest distance admitted
    nothing = reflect(device, np.zeros((3, 3)), np.zeros((3, 3)), (np.zeros((2, 3)), np.ones((2, 3))))
    assert not nothing.any()


def test_overflow_saturates_and_meets_no_zero(device):
    largest = float(np.finfo(np.float32).max)
    two = (float32([[0, 0, 0], [0, 0, 0]]), float32([[3e38, 3e38, -3e38], [3e38, 1, -3e38]]))
    point, normal = float32([[0, 0, -2]]), float32([[0, 0, 1]])
    assert reflect(device, point, normal, two)[0].tolist() == [largest, pytest.approx(largest), -largest]
    black = reflect(device, point, normal, two, colors=np.zeros((1, 3)))
    assert black[0].tolist() == [0, 0, 0]  # not NaN
    no_kd = reflect(device, point, normal, two, material={"kd": 0.0, "ks": 0.0})
    assert no_kd[0].tolist() == [0, 0, 0]
    assert one(device, intensity=(1e-30, 1e-38, 0), material={"n": 1e4}) == pytest.approx([2e-30, 2e-38, 0], rel=1e-6)


# Lights that are no plain points

AXIS = (0.6, 0.0, -0.8)
ATTENUATED = {"attenuated": 1}
CONE = {"cone": 1, "axis": AXIS, "cone_cosine": 0.5, "cone_scale": 4.0}
SHAPES = [
    ({}, POINT),
    ({"directional": 1.0}, Shape(parallel=True)),
    (ATTENUATED, Shape(attenuates=True)),
    ({**ATTENUATED, "inverse_range": 0.25}, Shape(attenuates=True, range=4.0)),
    (CONE, Shape(axis=float32(AXIS).astype(float), inner=0.75, outer=0.5)),
    ({**CONE, **ATTENUATED}, Shape(False, float32(AXIS).astype(float), 0.75, 0.5, True)),
]


@pytest.mark.sampled
@pytest.mark.parametrize(("fields", "shape"), SHAPES, ids=[" ".join(fields) or "plain" for fields, _ in SHAPES])
def test_shapes_at_random_points(device, fields, shape):
    """Within the bound of what arrives, which counts distance and cone (clshade/measure/README.md)."""
    rng = np.random.default_rng(3)
    count = 3000
    points = float32(rng.uniform(-2, 2, (count, 3)))
    normals = float32(unit(rng.normal(size=(count, 3))))
    light, intensity = float32([-0.9, 0.1, 1.0]), float32([2.0, 1.0, 0.5])
    if shape.parallel:
        light = float32(unit(light))
    lit = reflect(device, points, normals, (light, intensity), material={"n": 20.0}, shape=fields)
    p, m = points.astype(np.float64), normals.astype(np.float64)
    arrays = [np.atleast_2d(a.astype(np.float64)) for a in (light, intensity)]
    extent, one, n, white = np.abs(p).max(axis=1), np.ones(count), np.float64(20.0), np.ones(3)
    surface = shade.Surface(n, k={"kd": white, "ks": white})
    at = Interaction(p, m, EYE, Lights(*arrays, [shape]), extent, one)
    expected = OracleFrame(
        rgb=shade.reflected(at, surface)[None],
        alpha=np.ones((1, count)),
        id=np.ones((1, count), np.uint32),
        Z=np.ones((1, count)),
        budget=np.broadcast_to(
            shade.budget(white, surface, [sample.max_arriving for sample in at.samples]), (1, count, 3)
        ),
        conditions=shade.conditions(at)[None],
        jump=shade.jumps(at, surface)[None],
        exponent=np.full((1, count), n),
        alpha_error=np.zeros((1, count)),
        unsure=np.zeros((1, count), bool),
    )
    assert (lit > 0.0).any(axis=1).mean() > 0.1
    assert oracle_asserts.assert_colors_within(lit[None], expected) < 4.0


def test_what_arrives_at_the_limits_of_distance(device):
    """Powers of two, exact in float32, at the normal; the shortest distance with a direction is 2^-50."""
    matte = {"point": (0, 0, 0), "material": {"ks": 0.0}}
    for power in (0, -20, -50, 50):
        lit = one(device, **matte, light=(0, 0, 2.0**power), shape=ATTENUATED)
        assert lit == [pytest.approx(2.0 ** (-2 * power), rel=1e-6)] * 3
    for near in (0.0, 2.0**-51):
        assert one(device, **matte, light=(0, 0, near), shape=ATTENUATED) == [0, 0, 0]
    at_once = {**ATTENUATED, "inverse_range": 2.0**60}
    assert one(device, **matte, light=(0, 0, 1), shape=at_once) == [0, 0, 0]
    dim = {**ATTENUATED, **CONE, "axis": (0, 0, -1), "cone_cosine": 1.0 - 2.0**-22, "cone_scale": 1.0}
    # A share of 2^-160 counts as 0, so that devices that flush denormal numbers and others agree.
    assert one(device, **matte, light=(0, 0, 2.0**58), intensity=(1e38, 1, 1), shape=dim) == [0, 0, 0]


def test_what_arrives_saturates(device):
    largest = float(np.finfo(np.float32).max)
    near = {"point": (0, 0, 0), "light": (0, 0, 2.0**-40), "material": {"ks": 0.0}, "shape": ATTENUATED}
    assert one(device, **near, intensity=(3e38, -3e38, 0)) == [largest, -largest, 0]
    both = (float32([[0, 0, 2.0**-40], [0, 0, 2.0**-40]]), float32([[3e38] * 3, [-3e38] * 3]))
    lit = reflect(device, float32([[0, 0, 0]]), float32([[0, 0, 1]]), both, material={"ks": 0.0}, shape=ATTENUATED)
    assert np.isfinite(lit).all()


@pytest.mark.parametrize("lanes", OTHER_LANES)
def test_lanes_do_not_change_a_bit(device, lanes):
    points, normals, light = in_the_lobe(1e4, 1001)
    lights = light, float32([1.0, 0.7, 0.1])
    first, second = (reflect(device, points, normals, lights, lanes=n, material={"n": 1e4}) for n in (16, lanes))
    assert np.array_equal(bits(first), bits(second))
