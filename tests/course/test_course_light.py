"""`light`, `bilerp` and `calculate_normals` of `clshade.course` against the formulas."""

from __future__ import annotations

import course_reference as reference
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from clshade import course
from clshade.oracle import texture

pytestmark = pytest.mark.usefixtures("on_each_device")
few = settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])

POSITIONS = np.array([[0.0, 0, 5], [-7, 0, 0], [0, 5, 0], [3, -2, 4]])
INTENSITIES = np.array([[1.0, 1, 1], [1, 0, 0], [0.937, 0.753, 0.492], [0.1, 0.2, 3]])
COLOR = np.array([0.9, 0.5, 0.2])
numbers = st.floats(-4, 4, allow_subnormal=False, width=32)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)


def assert_light(arguments, n=None) -> None:
    color, expected = course.light(*arguments), reference.light(*arguments)
    assert color.shape == (3,)
    assert color.dtype == np.float64
    assert (np.abs(color - expected) <= reference.bound(*arguments)).all(), (color, expected)


@pytest.mark.sampled
@pytest.mark.parametrize("count", range(5))
@pytest.mark.parametrize("n", [0, 1, 20, 200, 1e4])
def test_light_is_the_formula(count, n):
    rng = np.random.default_rng(count)
    for point, normal in zip(rng.normal(size=(8, 3)), rng.normal(size=(8, 3)), strict=True):
        lights = (POSITIONS[:count], INTENSITIES[:count])
        assert_light((point, normal, COLOR, [1.0, 2.0, 8.0], 0.05, 0.8, np.array([1.0, 0.5, 0.3]), n, *lights))


@few
@given(point=vectors, normal=vectors, color=vectors, eye=vectors, position=vectors)
def test_light_anywhere(point, normal, color, eye, position):
    lights = (np.array([position, [0.0, 0, 50]]), INTENSITIES[[1, 3]])
    assert_light((point, normal, np.abs(color), eye, 0.1, 0.8, 0.5, 20.0, *lights))


def test_light_facing_everything():
    """Eye, light and normal in one direction: N.L = R.V = 1, so ka + Ip*color*(kd + ks) for any n."""
    for n in (0, 1, 50, 1e9):
        color = course.light([1, 1, 1], [0, 0, 3], COLOR, [1, 1, 9], 0.25, 0.5, 0.125, n, [[1, 1, 4]], [[2, 1, 0.5]])
        assert np.allclose(color, 0.25 + np.array([2, 1, 0.5]) * COLOR * 0.625, rtol=1e-6, atol=0.0)


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"normal": [0, 0, 0]}, 0.1),
        ({"normal": [0, 0, -1]}, 0.1),
        ({"l_pos": [[0, 0, 0]]}, 0.1),
        ({"cam_pos": [0, 0, 0]}, 0.1 + 0.8),
        ({"l_pos": np.zeros((0, 3)), "l_int": np.zeros((0, 3))}, 0.1),
        ({"l_pos": [], "l_int": []}, 0.1),
        ({"l_int": [[0, 0, 0]]}, 0.1),
        ({"k_a": 0}, 0.8 + 0.5),
        ({"k_d": 0}, 0.1 + 0.5),
        ({"k_s": 0}, 0.1 + 0.8),
        ({"l_pos": [[0, 0, 1e300]]}, 0.1 + 0.8 + 0.5),
        ({"normal": [0, 0, 1e-300]}, 0.1 + 0.8 + 0.5),
        ({"normal": [0, 0, 1e300]}, 0.1 + 0.8 + 0.5),
    ],
)
def test_light_degenerate(changes, expected):
    facing = {"point": [0, 0, 0], "normal": [0, 0, 1], "color": [1, 1, 1], "cam_pos": [0, 0, 5], "k_a": 0.1}
    facing |= {"k_d": 0.8, "k_s": 0.5, "n": 20, "l_pos": [[0, 0, 3]], "l_int": [[1, 1, 1]]}
    assert np.allclose(course.light(**{**facing, **changes}), expected, rtol=1e-6)


def test_three_lights_are_rows_not_columns():
    arguments = ([0.3, 0.2, 0.1], [0.2, 0.5, 1.0], COLOR, [1, 2, 8], 0.1, 0.8, 0.5, 3)
    square = course.light(*arguments, POSITIONS[:3], INTENSITIES[:3])
    apart = sum(course.light(*arguments, [p], [i]) for p, i in zip(POSITIONS[:3], INTENSITIES[:3], strict=True))
    assert np.allclose(square, apart - 2 * 0.1, rtol=1e-6)
    assert not np.allclose(square, course.light(*arguments, POSITIONS[:3].T, INTENSITIES[:3]), rtol=1e-2)
    as_lists = [p[:, None] for p in POSITIONS[:3]], [list(i) for i in INTENSITIES[:3]]
    assert (course.light(*arguments, *as_lists) == square).all()


def test_shapes_of_vectors_do_not_matter():
    arguments = [[0.3, 0.2, 0.1], [0.2, 0.5, 1.0], COLOR, [1, 2, 8]]
    rest = (0.1, [0.8, 0.4, 0.2], 0.5, 3, POSITIONS, INTENSITIES)
    colors = [course.light(*(np.reshape(v, shape) for v in arguments), *rest) for shape in ((3,), (1, 3), (3, 1))]
    assert (colors[0] == colors[1]).all()
    assert (colors[0] == colors[2]).all()


@few
@given(scale=st.integers(-60, 60))
def test_a_power_of_two_changes_no_bit(scale):
    factor = 2.0**scale
    point, eye = np.array([0.3, 0.2, 0.1]), np.array([1.0, 2, 8])
    plain = course.light(point, [0.2, 0.5, 1], COLOR, eye, 0.1, 0.8, 0.5, 20, POSITIONS, INTENSITIES)
    scaled = course.light(
        point * factor, [0.2, 0.5, 1], COLOR, eye * factor, 0.1, 0.8, 0.5, 20, POSITIONS * factor, INTENSITIES
    )
    assert (plain == scaled).all()


def test_values_are_not_clamped():
    bright = course.light([0, 0, 0], [0, 0, 1], [1, 1, 1], [0, 0, 5], 0, 1, 0, 1, [[0, 0, 3]], [[1e6, -2, 1e30]])
    assert np.allclose(bright, [1e6, -2, 1e30], rtol=1e-6)


# Texture lookup


@few
@given(
    u=st.floats(-0.5, 1.5),
    v=st.floats(-0.5, 1.5),
    size=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    kind=st.sampled_from([np.uint8, np.uint16, np.float32, np.float64]),
)
def test_bilerp_is_the_formula(u, v, size, kind):
    rng = np.random.default_rng(5)
    image = rng.random((*size, 3))
    if np.issubdtype(kind, np.integer):
        image = rng.integers(0, np.iinfo(kind).max, (*size, 3), endpoint=True)
    color = course.bilerp((u, v), image.astype(kind))
    linear = image / np.iinfo(kind).max if np.issubdtype(kind, np.integer) else image.astype(np.float32)
    expected = texture.bilerp(np.array([u, v]), linear, "course")
    assert color.shape == (3,)
    assert color.dtype == np.float64
    # Texels of at most 1: one rounding each, one of the fraction, and three means of two roundings.
    assert np.abs(color - expected).max() <= 8 * reference.HALF_ULP


def test_bilerp_at_texels_and_between():
    image = np.zeros((3, 4, 3))
    image[2, 3] = [1, 0, 0]
    image[0, 0] = [0, 1, 0]
    image[0, 3] = [0, 0, 1]
    assert (course.bilerp([1, 1], image) == [1, 0, 0]).all()
    assert (course.bilerp([[0.0], [0.0]], image) == [0, 1, 0]).all()
    assert (course.bilerp([[1, 0]], image) == [0, 0, 1]).all()
    assert (course.bilerp([9.0, -0.0], image) == [0, 0, 1]).all()
    assert (course.bilerp([-1e300, -7], image) == [0, 1, 0]).all()
    assert np.allclose(course.bilerp([1, 0.75], image), [0.5, 0, 0])
    assert np.allclose(course.bilerp([0.5 / 3, 0], image), [0, 0.5, 0])


def test_bilerp_on_a_wide_texture_is_exact_between_texels():
    """u on 30,000 texels: float32 alone would be off by a thousandth of a texel."""
    image = np.zeros((1, 30000, 3), np.float32)
    image[0, 20000] = 1.0
    u = 20000.25 / 29999
    assert np.allclose(course.bilerp([u, 0], image), 0.75, atol=1e-6)


def test_bilerp_sees_a_change_of_the_texture():
    image = np.zeros((2, 2, 3))
    assert (course.bilerp([0, 0], image) == 0).all()
    image[0, 0] = 0.5
    assert (course.bilerp([0, 0], image) == 0.5).all()
    assert (course.bilerp([0, 0], np.asfortranarray(image)[::-1][::-1]) == 0.5).all()


# Normals


def test_normals_of_a_cube_corner():
    """Three perpendicular faces: at their common corner the normal is along the diagonal."""
    verts = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]).T
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3]]).T
    normals = course.calculate_normals(verts, faces)
    assert normals.shape == (3, 4)
    assert normals.dtype == np.float64
    assert np.allclose(normals[:, 0], -np.ones(3) / np.sqrt(3), rtol=1e-14)
    assert np.allclose(course.calculate_normals(verts.T, faces.T), normals)  # 4x3 verts decide the layout of faces


def test_normals_follow_the_faces():
    verts = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5.0]]).T
    assert (course.calculate_normals(verts, [[0], [1], [2]]) == [[0, 0, 0, 0], [0, 0, 0, 0], [1, 1, 1, 0]]).all()
    assert (course.calculate_normals(verts, [[0], [2], [1]])[2] == [-1, -1, -1, 0]).all()
    both = course.calculate_normals(verts, [[0, 0], [1, 2], [2, 1]])  # the two cancel
    assert (both == 0).all()
    assert (course.calculate_normals(verts, np.zeros((3, 0), int)) == 0).all()


@few
@given(seed=st.integers(0, 2**32 - 1))
def test_normals_are_sums_of_cross_products(seed):
    rng = np.random.default_rng(seed)
    verts, faces = rng.normal(size=(3, 12)), rng.integers(0, 12, (3, 20))
    total = np.zeros((12, 3))
    for a, b, c in faces.T:
        cross = np.cross(verts.T[b] - verts.T[a], verts.T[c] - verts.T[a])
        for corner in (a, b, c):
            total[corner] += cross
    normals = course.calculate_normals(verts, faces).T
    long = np.linalg.norm(total, axis=1) > 1e-6
    assert np.allclose(normals[long], reference.unit(total[long]), atol=1e-9)
