"""`gouraud_shading`, `shade_gouraud` and `shade_phong`: one triangle over an image, against float64."""

from __future__ import annotations

from fractions import Fraction

import course_reference as reference
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from clshade import course

pytestmark = pytest.mark.usefixtures("on_each_device")
few = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])

ROWS, COLUMNS = 37, 50
X = np.random.default_rng(1).random((ROWS, COLUMNS, 3)) / 3.0  # not float32 values
COLORS = np.array([[0.9, 0.1, 0.2], [0.1, 0.8, 0.3], [0.2, 0.1, 0.7]])
NORMALS = np.array([[0.1, -0.3, 0.5], [0.2, 0.4, -0.1], [1.0, 0.9, 0.8]])
POINT, EYE = np.array([0.3, -0.2, 0.1]), np.array([1.0, 2.0, 8.0])
POSITIONS = np.array([[0.0, 0, 5], [-7, 0, 0], [0, 5, 0], [3, -2, 4]])
INTENSITIES = np.array([[1.0, 1, 1], [1, 0, 0], [0.937, 0.753, 0.492], [0.1, 0.2, 3]])
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
    assert picture.shape == X.shape
    assert picture.dtype == np.float64
    assert (picture[~drawn] == X[~drawn]).all()
    error = np.abs(picture - image)
    assert (error <= off).all(), (error / np.where(off > 0.0, off, 1.0)).max()


@pytest.mark.sampled
@pytest.mark.parametrize("shader", SHADERS)
@pytest.mark.parametrize("count", range(5))
def test_one_triangle(shader, count):
    before = X.copy()
    expected = expect(shader, count=count)
    assert expected[2].sum() > 400
    assert_drawn(draw(shader, count=count), expected)
    assert (before == X).all()


@pytest.mark.long
def test_a_glaring_corner_costs_the_others_no_digits():
    """Opposite a corner of 1e6, the bound is relative to the pixel's own color."""
    glaring = np.array([[1e6, 0.1, 0.5], [0.2, 1e6, 0.4], [0.3, 0.3, 1e6]])
    assert_drawn(draw("phong", verts_c=glaring), expect("phong", verts_c=glaring))


@pytest.mark.sampled
@pytest.mark.parametrize("shader", SHADERS)
@pytest.mark.parametrize("n", [1, 200, 1e4])
def test_exponents(shader, n):
    assert_drawn(draw(shader, n=n), expect(shader, n=n))


@pytest.mark.parametrize("shader", SHADERS)
@pytest.mark.parametrize(
    "verts_p",
    [
        [[-20.0, -9], [70, 12], [15, 60]],  # across every border
        [[30.0, 20], [90, 20], [30, 90]],
        [[-500.0, 10], [500, 9], [3, 30]],
        [[60.0, 3], [70, 3], [60, 20]],  # beside the image
        [[-9.0, -9], [-1, -9], [-5, -0.6]],
        [[1.0, 50], [30, 60], [20, 400]],
        [[3.0, 3], [20, 20], [9, 9]],  # no area
        [[7.0, 7], [7, 7], [7, 7]],
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


def weights_of(verts_p: np.ndarray) -> np.ndarray:
    """Return the corners' weights at all pixel centers, (M, N, 3), in rational arithmetic: corners are not rounded."""
    (ax, ay), (bx, by), (cx, cy) = ((Fraction(u), Fraction(v)) for u, v in verts_p.tolist())
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    weights = np.zeros((ROWS, COLUMNS, 3))
    for row in range(ROWS):
        for column in range(COLUMNS):
            x, y = Fraction(2 * column + 1, 2), Fraction(2 * row + 1, 2)
            b = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
            c = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
            weights[row, column] = [float(1 - b - c), float(b), float(c)]
    return weights


@pytest.mark.sampled
@pytest.mark.parametrize("far", [1e5, 1e9, 1e38, 1e300])
@pytest.mark.parametrize("shader", SHADERS)
def test_corners_far_away(shader, far):
    """A triangle through the image with one corner at (20, 10) and two far away, clipped at the guard band."""
    verts_p = np.array([[20.25, 10.25], [far, 0.3 * far], [-0.7 * far, far]])
    weights = weights_of(verts_p)
    # Corners of the clipped piece are rounded to 1/65536 pixel: edges, and weights with them, may move as much.
    with np.errstate(over="ignore"):
        step = np.abs(np.diff(weights, axis=1)).max(axis=(0, 1)) + np.abs(np.diff(weights, axis=0)).max(axis=(0, 1))
    margin = step / 16384.0 + 1e-12 / far
    inside, outside = (weights > margin).all(axis=2), (weights < -margin).any(axis=2)
    assert inside.sum() > 100
    assert outside.sum() > 100
    image = draw(shader, verts_p)
    assert (image[outside] == X[outside]).all()
    around = (POINT, EYE, K_A * L_AMB, K_D, K_S, N, POSITIONS, INTENSITIES)
    if shader == "phong":
        expected = reference.light(POINT, weights @ NORMALS.T, weights @ COLORS.T, *around[1:])
    elif shader == "gouraud":
        expected = weights @ reference.light(POINT, NORMALS.T, COLORS.T, *around[1:])
    else:
        expected = weights @ COLORS.T
    assert np.allclose(image[inside], expected[inside], rtol=1e-4, atol=1e-4 + 30.0 / far)


@pytest.mark.parametrize("shader", SHADERS)
@pytest.mark.parametrize("far", [1e5, 1e20, 1e308])
def test_a_huge_triangle_covers_the_image(shader, far):
    image = draw(shader, np.array([[-far, -far], [far, -far], [0.0, far]]))
    assert (image != X).any(axis=2).all()
    assert np.isfinite(image).all()
    far_off = np.array([[-far, -far], [far, -far], [0.0, -far / 2]])
    assert (draw(shader, far_off) == X).all()


@pytest.mark.parametrize("shader", SHADERS)
def test_two_triangles_share_their_edge(shader):
    """Every pixel of a quad is drawn by exactly one of its two triangles, at any rotation."""
    for turn in np.linspace(0.0, 2.0 * np.pi, 9)[:-1]:
        corners = np.array([[np.cos(turn + k * np.pi / 2), np.sin(turn + k * np.pi / 2)] for k in range(4)])
        corners = corners * 14.0 + [25.5, 18.5]
        drawn = [(draw(shader, corners[index]) != X).any(axis=2) for index in ([0, 1, 2], [0, 2, 3])]
        both = drawn[0] | drawn[1]
        assert not (drawn[0] & drawn[1]).any()
        column, row = np.meshgrid(np.arange(COLUMNS) + 0.5 - 25.5, np.arange(ROWS) + 0.5 - 18.5)
        rotated = np.stack([np.cos(turn) * column + np.sin(turn) * row, np.cos(turn) * row - np.sin(turn) * column])
        reach = np.abs(rotated).sum(axis=0)  # 14 on the quad's border
        assert both[reach < 13.99].all()
        assert not both[reach > 14.01].any()


def test_corners_and_columns_are_not_mixed_up():
    """Each corner's color is near it: verts_p has corners in rows, verts_c in columns; v points up."""
    corners = np.array([[1.0, 1.0], [49.0, 1.0], [1.0, 36.0]])
    image = course.gouraud_shading(corners, np.eye(3), np.zeros((ROWS, COLUMNS, 3)))
    assert (image[1, 1].argmax(), image[1, 46].argmax(), image[34, 1].argmax()) == (0, 1, 2)
    assert image[[1, 1, 34], [1, 46, 1]].max(axis=1).min() > 0.9


def test_lengths_of_normals():
    """Gouraud lights each corner by the normal's direction; phong interpolates normals without normalizing them
    first."""
    longer = NORMALS * [1.0, 2.0, 0.5]
    assert np.allclose(draw("gouraud", verts_n=longer), draw("gouraud"), rtol=1e-6)
    assert_drawn(draw("phong", verts_n=longer), expect("phong", verts_n=longer))
    for factor in (2.0**-900, 2.0**900):
        assert (draw("phong", verts_n=NORMALS * factor) == draw("phong")).all()
        assert (draw("gouraud", verts_n=NORMALS * factor) == draw("gouraud")).all()


@pytest.mark.long
@pytest.mark.parametrize("shader", ["gouraud", "phong"])
def test_zero_normals_and_left_out_components(shader):
    drawn = expect(shader)[2]
    ambient = K_A * L_AMB
    for changes in ({"verts_n": np.zeros((3, 3))}, {"k_d": 0, "k_s": 0}, {"l_int": np.zeros((4, 3))}):
        assert np.allclose(draw(shader, **changes)[drawn], ambient, rtol=1e-6)
    total = draw(shader)[drawn]
    parts = [draw(shader, **left_out)[drawn] for left_out in ({"k_s": 0}, {"k_d": 0}, {"k_s": 0, "k_d": 0})]
    assert np.allclose(total, parts[0] + parts[1] - parts[2], rtol=1e-5, atol=1e-6)
    assert np.allclose(total - draw(shader, k_a=0)[drawn], ambient, rtol=1e-5, atol=1e-6)


def test_images_of_any_type_and_size():
    for image in (np.zeros((1, 1, 3), np.uint8), np.ones((40, 3, 3), np.float32), np.zeros((3, 200, 3))[:, ::2]):
        picture = course.gouraud_shading([[-9, -9], [400, -9], [-9, 400]], np.full((3, 3), 7.0), image)
        assert picture.dtype == np.float64
        assert picture.shape == image.shape
        assert (picture == 7.0).all()
    image = np.arange(60.0).reshape(4, 5, 3)
    picture = course.gouraud_shading([[0, 0], [1, 0], [0, 1.0]], np.full((3, 3), 7.0), image[::-1])
    assert picture.flags.c_contiguous
    assert (picture[1:] == image[::-1][1:]).all()
    assert (picture[0, 0] == 7.0).all() or (picture[0, 0] == image[-1, 0]).all()
