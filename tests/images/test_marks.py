"""Text, scale bars, axes triads and color bars beside images; magnified crops, and the image with their places."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.images import marks
from clshade.images.figures import _ticks, with_colorbar
from clshade.images.marks import AXES, COLORS, INK, SIDE, Crop, fade, magnify, mark_crops

X, Y, Z = np.eye(3)
FRONT, BACK = np.array([X, Y, -Z]), np.array([-X, Y, Z])  # right, up, forward


def near(picture, color, tolerance=12):
    """Return rows and columns of pixels of about this color."""
    return np.nonzero(np.abs(picture.astype(int) - color).max(axis=-1) <= tolerance)


@pytest.mark.parametrize(
    ("limit", "length"),
    [
        (1.0, 1.0),
        (0.99, 0.5),
        (0.3, 0.2),
        (3.0, 2.0),
        (7.3, 5.0),
        (19.999, 10.0),
        (1e-7, 1e-7),
        (4.2e12, 2e12),
        (0.6, 0.5),
    ],
)
def test_round_length(limit, length):
    assert marks.round_length(limit) == length


def test_round_lengths_are_the_floats_that_decimal_numbers_are():
    for limit in np.geomspace(1e-12, 1e12, 1000):
        length = marks.round_length(float(limit))
        assert repr(length) == repr(float(f"{length:g}"))
        assert 0.4 * limit - 1e-12 <= length <= limit * (1.0 + 1e-9)
        assert f"{length:e}"[0] in "125"


def test_the_bar_is_as_long_as_it_says():
    picture = np.full((20, 90, 3), 255, np.uint8)
    marks.scale_bar(picture, 10, 10, 61.6)
    columns = near(picture, INK)[1]
    assert (columns.min(), columns.max() + 1) == (10, 72)
    assert (picture[10] == INK).all(axis=-1).sum() == 62 - 4 or (picture[9] == INK).all(axis=-1).sum() == 62


@pytest.mark.parametrize("side", [44, 100])
def test_the_axes_point_where_they_do(side):
    """Seen from the front, x goes to the right, y up, and z is a dot at the origin."""
    picture = marks.triad(FRONT, side)
    assert picture.shape == (side, side, 3)
    (_, x_columns), (y_rows, y_columns), (z_rows, z_columns) = (near(picture, color) for color in AXES.values())
    assert x_columns.max() > y_columns.max() + 0.2 * side
    assert y_rows.min() < z_rows.min() - 0.2 * side
    assert abs(z_columns.mean() - y_columns.mean()) < 0.25 * side
    assert len(z_rows) > 10
    assert len(near(picture, fade(AXES["z"]))[0]) < len(z_rows) / 4  # edges alone
    edge = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert (edge == 255).all()  # nothing is cut


def test_an_axis_that_points_away_is_lighter():
    picture = marks.triad(BACK, 88)
    assert len(near(picture, fade(AXES["z"]))[0]) > 5
    assert not len(near(picture, AXES["z"])[0])
    assert sum(fade(AXES["z"])) > sum(AXES["z"]) + 150


def test_no_label_meets_another_or_the_edge():
    rng = np.random.default_rng(8)
    for _ in range(40):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        picture = marks.triad(axes, 60)
        edge = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
        assert (edge == 255).all()
        assert all(len(near(picture, fade(c) if axes[2, k] > 0 else c, 40)[0]) for k, c in enumerate(AXES.values()))


# Text


def test_text_is_shortened_to_its_width():
    text = "a rather long title of a view"
    for width in range(0, 300, 7):
        fitted = marks.fit_text(text, 9.0, width)
        assert not fitted or marks.text_width(fitted, 9.0) <= width
        assert fitted == text or fitted == "" or (fitted.endswith("...") and text.startswith(fitted[:-3]))
    assert marks.fit_text(text, 9.0, 300) == text
    assert marks.fit_text("", 9.0, 10) == ""


def test_characters_that_cannot_be_drawn(recwarn):
    hostile = "a\nb\x1b[31m\udce9\u4e2d é"
    printable = marks.drawable(hostile)
    assert printable == "a?b?[31m?? é"
    picture = np.full((30, 200, 3), 255, np.uint8)
    marks.draw_text(picture, 2, 20, 9.0, printable)
    assert picture.min() < 100
    assert not recwarn.list


def test_text_is_clipped_at_the_picture():
    for x, y in ((-500, 5), (-9, 5), (35, 5), (500, 5), (3, -40), (3, 1), (3, 60), (3, 500)):
        picture = np.full((12, 40, 3), 255, np.uint8)
        marks.draw_text(picture, x, y, 9.0, "clipped")
        assert picture.shape == (12, 40, 3)


def test_panels_of_a_layout_lie_where_it_says():
    layout = marks.Layout(across=2, panel=50, gap=6, title=20, caption=4, head=30)
    panels = [marks.Panel(np.full((40, 50, 3), 10 * k, np.uint8), "", "") for k in range(3)]
    sheet = marks.compose_sheet(panels, "", layout)
    assert sheet.shape == (30 + 2 * 64, 112, 3)
    for k in range(3):
        x, y = layout.corner(k, 40)
        assert (sheet[y : y + 40, x : x + 50] == 10 * k).all()


@pytest.mark.parametrize(
    ("ends", "labels"),
    [
        ((50.0, 320.0), ["50", "100", "150", "200", "250", "300"]),
        ((-1.0, 1.0), ["-1", "-0.5", "0", "0.5", "1"]),
        ((1e9, 1e9 + 1), ["1000000000", "1000000000.2", "1000000000.4", "1000000000.6", "1000000000.8", "1000000001"]),
        ((2.0, 2.0), ["2"]),
        ((-1.7e308, 1.7e308), ["-1.7e+308", "1.7e+308"]),
        ((0.0, 5e-324), ["0", "4.94066e-324"]),
    ],
)
def test_numbers_are_round_and_all_there(ends, labels):
    places, tick_labels = _ticks(*ends, 6)
    assert tick_labels == labels
    assert len(places) == len(labels)
    assert all(0.0 <= place <= 1.0 for place in places)


def test_any_ends_and_titles():
    image, ground = np.zeros((90, 7, 3), np.uint8), np.array([255, 255, 255], np.uint8)
    for ends in ((0.0, 0.0), (-1e308, 1e308), (0.0, 1e-310), (1e30, 1.00000001e30)):
        assert with_colorbar(image, "jet", ends, "a $\\frac name\n" * 20, ground).shape[0] == 90


# Crops


IMAGE = np.random.default_rng(5).integers(0, 256, (40, 60, 3), dtype=np.uint8)


def test_every_pixel_becomes_a_square():
    large = magnify(IMAGE, Crop(10, 20, 3, 2, 5))
    assert large.shape == (10, 15, 3)
    for row in range(10):
        for column in range(15):
            assert (large[row, column] == IMAGE[20 + row // 5, 10 + column // 5]).all()


@pytest.mark.parametrize(
    ("crop", "scale"), [((0, 0, 60, 40), 8), ((0, 0, 1, 1), 64), ((0, 0, 60, 40, 3), 3), ((0, 0, 600, 10), 1)]
)
def test_scale_of_a_crop(crop, scale):
    factor = Crop(*crop).scale
    assert factor == scale
    assert factor in (1, 3, 64) or factor * 60 <= SIDE < (factor + 1) * 60


def test_marks_lie_outside_the_crops():
    crops = [Crop(24, 20, 12, 9), Crop(40, 0, 20, 8), Crop(0, 30, 5, 10)]
    marked = mark_crops(IMAGE, crops)
    for crop in crops:
        inside = np.s_[crop.y : crop.y + crop.height, crop.x : crop.x + crop.width]
        assert (marked[inside] == IMAGE[inside]).all()
    assert (marked[29, 24:36] == COLORS[0]).all()  # below the first
    assert (marked[30, 26:36] == 0).all()
    assert (marked[20:30, 36] == COLORS[0]).all()
    assert IMAGE.flags.writeable  # a copy was drawn into
    assert (mark_crops(IMAGE, []) == IMAGE).all()


def test_one_crop_has_no_number():
    changed = (mark_crops(IMAGE, [Crop(20, 20, 4, 4)]) != IMAGE).any(axis=-1)
    rows, columns = np.nonzero(changed)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (18, 25, 18, 25)


def test_the_number_of_a_crop_without_room_around_it_is_in_its_corner():
    marked = mark_crops(IMAGE, [Crop(0, 0, 60, 40), Crop(20, 4, 8, 30)])
    for x, y, color in ((0, 0, COLORS[0]), (20, 4, COLORS[1])):
        plate = marked[y : y + 15, x : x + 8]
        assert (plate == color).all(axis=-1).sum() > 40


@pytest.mark.parametrize(
    ("crop", "part"),
    [
        ((0, 0, 61, 10), "within 60 x 40 pixels"),
        ((0, 35, 6, 6), "within 60 x 40 pixels"),
        ((-1, 0, 6, 6), "within 60 x 40 pixels"),
        ((0, 0, 6, 6, 65), "a factor from 1 to 64"),
    ],
)
def test_refused_crops(crop, part):
    with pytest.raises(InputError, match=part):
        Crop(*crop).check("--crop-zoom", 60, 40)
    Crop(54, 34, 6, 6, 64).check("--crop-zoom", 60, 40)
