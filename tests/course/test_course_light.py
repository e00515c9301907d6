"""`light`, `bilerp`, `calculate_normals`, and one triangle over an image, against the formulas in float64."""

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


@few
@given(point=vectors, normal=vectors, color=vectors, eye=vectors, position=vectors, n=st.sampled_from([0, 1, 20, 1e4]))
def test_light_anywhere(point, normal, color, eye, position, n):
    lights = (np.array([position, [0.0, 0, 50]]), INTENSITIES[[1, 3]])
    arguments = point, normal, np.abs(color), eye, 0.1, [0.8, 0.4, 0.6], 0.5, n, *lights
    lit, expected = course.light(*arguments), reference.light(*arguments)
    assert (lit.shape, lit.dtype) == ((3,), np.float64)
    assert (np.abs(lit - expected) <= reference.bound(*arguments)).all(), (lit, expected)


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, 0.1 + 0.8 + 0.5),  # N.L = R.V = 1
        ({"n": 1e9}, 0.1 + 0.8 + 0.5),
        ({"normal": [0, 0, 0]}, 0.1),
        ({"normal": [0, 0, -1]}, 0.1),
        ({"l_pos": [[0, 0, 0]]}, 0.1),
        ({"cam_pos": [0, 0, 0]}, 0.1 + 0.8),
        ({"l_pos": np.zeros((0, 3)), "l_int": np.zeros((0, 3))}, 0.1),
        ({"k_d": 0}, 0.1 + 0.5),
        ({"l_pos": [[0, 0, 1e300]]}, 0.1 + 0.8 + 0.5),
        ({"normal": [0, 0, 1e-300]}, 0.1 + 0.8 + 0.5),
        ({"k_a": 0, "k_d": 1, "k_s": 0, "l_int": [[1e6, -2, 1e30]]}, [1e6, -2, 1e30]),  # not clamped
    ],
)
def test_light_in_one_direction(changes, expected):
    """Eye, light and normal face each other, or one of them is missing or extreme."""
    facing = {"point": [0, 0, 0], "normal": [0, 0, 1], "color": [1, 1, 1], "cam_pos": [0, 0, 5], "k_a": 0.1}
    facing |= {"k_d": 0.8, "k_s": 0.5, "n": 20, "l_pos": [[0, 0, 3]], "l_int": [[1, 1, 1]]}
    assert np.allclose(course.light(**{**facing, **changes}), expected, rtol=1e-6)


def test_shapes_of_lights_and_vectors():
    vectors, rest = [[0.3, 0.2, 0.1], [0.2, 0.5, 1.0], COLOR, [1, 2, 8]], (0.1, [0.8, 0.4, 0.2], 0.5, 3)
    positions, intensities = POSITIONS[:3], INTENSITIES[:3]
    square = course.light(*vectors, *rest, positions, intensities)
    apart = sum(course.light(*vectors, *rest, [p], [i]) for p, i in zip(positions, intensities, strict=True))
    assert np.allclose(square, apart - 2 * 0.1, rtol=1e-6)
    as_lists = [p[:, None] for p in positions], [list(i) for i in intensities]
    assert (course.light(*vectors, *rest, *as_lists) == square).all()
    one = course.light(*vectors, *rest, positions[:1], intensities[:1])
    assert (course.light(*vectors, *rest, positions[0], list(intensities[0])) == one).all()
    for shape in ((1, 3), (3, 1)):
        shaped = (np.reshape(vector, shape) for vector in vectors)
        assert (course.light(*shaped, *rest, positions, intensities) == square).all()


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
    assert (color.shape, color.dtype) == ((3,), np.float64)
    # Texels of at most 1: one rounding each, one of the fraction, and three means of two roundings.
    assert np.abs(color - expected).max() <= 8 * reference.HALF_ULP


def test_bilerp_on_a_wide_texture_is_exact_between_texels_and_sees_a_change():
    """u on 30,000 texels: float32 alone would be off by a thousandth of a texel."""
    image = np.zeros((1, 30000, 3), np.float32)
    u = 20000.25 / 29999
    assert (course.bilerp([u, 0], image) == 0).all()
    image[0, 20000] = 1.0
    assert np.allclose(course.bilerp([u, 0], image), 0.75, atol=1e-6)
    assert np.allclose(course.bilerp([u, 0], image[:, ::-1][:, ::-1]), 0.75, atol=1e-6)


# Normals


def test_normals_of_a_cube_corner():
    verts = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]).T
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3]]).T
    assert np.allclose(course.calculate_normals(verts, faces)[:, 0], -np.ones(3) / np.sqrt(3), rtol=1e-14)


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
    normals = course.calculate_normals(verts, faces)
    assert (normals.shape, normals.dtype) == ((3, 12), np.float64)
    long = np.linalg.norm(total, axis=1) > 1e-6
    assert np.allclose(normals.T[long], reference.unit(total[long]), atol=1e-9)
    square = course.calculate_normals(verts.T, faces[:, :3].T)  # 12x3 verts decide the layout of faces
    assert np.allclose(square, course.calculate_normals(verts, faces[:, :3]))


# One triangle over an image: `gouraud_shading`, `shade_gouraud` and `shade_phong`


ROWS, COLUMNS = 37, 50
X = np.random.default_rng(1).random((ROWS, COLUMNS, 3)) / 3.0  # not float32 values
COLORS = np.array([[0.9, 0.1, 0.2], [0.1, 0.8, 0.3], [0.2, 0.1, 0.7]])
NORMALS = np.array([[0.1, -0.3, 0.5], [0.2, 0.4, -0.1], [1.0, 0.9, 0.8]])
POINT, EYE = np.array([0.3, -0.2, 0.1]), np.array([1.0, 2.0, 8.0])
INSIDE = np.array([[5.2, 4.1], [44.9, 10.3], [20.5, 33.7]])
K_A, K_D, K_S, N, L_AMB = 0.2, np.array([0.8, 0.7, 0.6]), 0.5, 20.0, np.array([0.5, 0.25, 1.0])
SHADERS = {"nolight": course.gouraud_shading, "gouraud": course.shade_gouraud, "phong": course.shade_phong}


def draw(shader, verts_p=INSIDE, verts_c=COLORS, verts_n=NORMALS, count=4, image=X, **changes):
    if shader == "nolight":
        return course.gouraud_shading(verts_p, verts_c, image)
    arguments = {"bcoords": POINT, "cam_pos": EYE, "k_a": K_A, "k_d": K_D, "k_s": K_S, "n": N}
    arguments |= {"l_pos": POSITIONS[:count], "l_int": INTENSITIES[:count], "l_amb": L_AMB, **changes}
    return SHADERS[shader](verts_p, verts_n, verts_c, X=image, **arguments)


def expect(shader, verts_p=INSIDE, verts_c=COLORS, verts_n=NORMALS, count=4, n=N, k_s=K_S):
    around = (POINT, EYE, K_A * L_AMB, K_D, k_s, n, POSITIONS[:count], INTENSITIES[:count])
    return reference.triangle(shader, verts_p, verts_n, verts_c, around, X)


def assert_drawn(picture, expected) -> None:
    image, off, drawn = expected
    assert (picture.shape, picture.dtype) == (X.shape, np.float64)
    assert (picture[~drawn] == X[~drawn]).all()
    error = np.abs(picture - image)
    assert (error <= off).all(), (error / np.where(off > 0.0, off, 1.0)).max()


@pytest.mark.parametrize(
    ("shader", "changes"),
    [
        *((shader, {"count": count}) for shader in SHADERS for count in (0, 4)),
        ("phong", {"n": 1e4}),
        *((shader, {"k_s": 0.0}) for shader in ("gouraud", "phong")),
        # Opposite a corner of 1e6, the bound is relative to the pixel's own color.
        ("phong", {"verts_c": np.array([[1e6, 0.1, 0.5], [0.2, 1e6, 0.4], [0.3, 0.3, 1e6]])}),
        ("phong", {"verts_n": NORMALS * [1.0, 2.0, 0.5]}),  # which are interpolated before they are normalized
        ("gouraud", {"verts_n": NORMALS * [1.0, 2.0, 0.5]}),
    ],
)
def test_one_triangle(shader, changes):
    expected = expect(shader, **changes)
    assert expected[2].sum() > 400
    assert_drawn(draw(shader, **changes), expected)


@pytest.mark.parametrize("shader", ["nolight", "phong"])
@pytest.mark.parametrize(
    "verts_p",
    [
        [[-20.0, -9], [70, 12], [15, 60]],  # across every border
        [[30.0, 20], [90, 20], [30, 90]],
        [[60.0, 3], [70, 3], [60, 20]],  # beside the image
        [[3.0, 3], [20, 20], [9, 9]],  # no area
        [[3.1, 3.1], [3.2, 3.1], [3.1, 3.2]],  # between pixel centers
        [[5.2, 4.1], [20.5, 33.7], [44.9, 10.3]],  # clockwise
    ],
)
def test_triangles_over_the_border_and_beside(shader, verts_p):
    assert_drawn(draw(shader, np.array(verts_p)), expect(shader, np.array(verts_p)))


@few
@given(
    verts_p=st.lists(st.tuples(st.floats(-30, 80), st.floats(-30, 70)), min_size=3, max_size=3).map(np.array),
    shader=st.sampled_from(sorted(SHADERS)),
)
def test_any_triangle(verts_p, shader):
    assert_drawn(draw(shader, verts_p), expect(shader, verts_p))


@pytest.mark.parametrize("far", [1e5, 1e300])
def test_corners_far_away(far):
    """A triangle through the image with one corner at (20, 10) and two far away, clipped at the guard band."""
    verts_p = np.array([[20.25, 10.25], [far, 0.3 * far], [-0.7 * far, far]])
    a, b, c = verts_p
    to_pixels = np.stack(np.meshgrid(np.arange(COLUMNS) + 0.5, np.arange(ROWS) + 0.5), axis=-1) - a
    both = np.linalg.solve(np.column_stack([b - a, c - a]), to_pixels.reshape(-1, 2).T).T.reshape(ROWS, COLUMNS, 2)
    weights = np.dstack([1.0 - both.sum(axis=2), both])
    # Corners of the clipped piece are rounded to 1/65536 pixel: edges, and weights with them, may move as much.
    inside, outside = (both > 1e-4 / far).all(axis=2), (both < -1e-4 / far).any(axis=2)
    assert min(inside.sum(), outside.sum()) > 100
    image = draw("phong", verts_p)
    assert (image[outside] == X[outside]).all()
    lit_by = EYE, K_A * L_AMB, K_D, K_S, N, POSITIONS, INTENSITIES
    expected = reference.light(POINT, weights @ NORMALS.T, weights @ COLORS.T, *lit_by)
    assert np.allclose(image[inside], expected[inside], rtol=1e-4, atol=1e-4 + 30.0 / far)


@pytest.mark.parametrize("shader", ["gouraud", "phong"])
def test_normals_of_any_length(shader):
    for factor in (2.0**-900, 2.0**900):
        assert (draw(shader, verts_n=NORMALS * factor) == draw(shader)).all()


def test_images_of_any_type_and_size():
    corners, color = [[-9, -9], [400, -9], [-9, 400]], np.full((3, 3), 7.0)
    for image in (np.zeros((1, 1, 3), np.uint8), np.ones((40, 3, 3), np.float32), np.zeros((3, 200, 3))[:, ::2]):
        picture = course.gouraud_shading(corners, color, image)
        assert (picture.dtype, picture.shape, picture.flags.c_contiguous) == (np.float64, image.shape, True)
        assert (picture == 7.0).all()
    image = np.arange(60.0).reshape(4, 5, 3)[::-1]
    assert (course.gouraud_shading([[0, 0], [1, 0], [0, 1.0]], color, image)[1:] == image[1:]).all()
