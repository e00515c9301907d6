"""Text, scale bars, axes triads and color bars beside images; magnified crops, and the image with their places."""

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.images import marks
from clshade.images.figures import _ticks, with_colorbar
from clshade.images.marks import AXES, COLORS, Crop, fade, magnify, mark_crops


def near(picture, color):
    return np.nonzero(np.abs(picture.astype(int) - color).max(axis=-1) <= 12)


@pytest.mark.parametrize(("limit", "length"), [(1.0, 1.0), (0.99, 0.5), (0.3, 0.2), (19.999, 10.0), (4.2e12, 2e12)])
def test_round_length(limit, length):
    assert marks.round_length(limit) == length


@pytest.mark.parametrize("side", [44, 100])
def test_the_axes_point_where_they_do(side):
    """Seen from the front, x goes to the right, y up, and z is a dot at the origin."""
    picture = marks.triad(np.diag([1.0, 1.0, -1.0]), side)  # right, up, forward
    assert picture.shape == (side, side, 3)
    (_, x_columns), (y_rows, y_columns), (z_rows, z_columns) = (near(picture, color) for color in AXES.values())
    assert x_columns.max() > y_columns.max() + 0.2 * side
    assert y_rows.min() < z_rows.min() - 0.2 * side
    assert abs(z_columns.mean() - y_columns.mean()) < 0.25 * side
    assert len(z_rows) > 10
    assert len(near(picture, fade(AXES["z"]))[0]) < len(z_rows) / 4  # edges alone
    edge = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert (edge == 255).all()  # nothing is cut


def test_text_is_shortened_to_its_width():
    text = "a rather long title of a view"
    for width in range(0, 300, 7):
        fitted = marks.fit_text(text, 9.0, width)
        assert not fitted or marks.text_width(fitted, 9.0) <= width
        assert fitted == text or fitted == "" or (fitted.endswith("...") and text.startswith(fitted[:-3]))
    assert marks.fit_text(text, 9.0, 300) == text
    assert marks.fit_text("", 9.0, 10) == ""


def test_characters_that_cannot_be_drawn(recwarn):
    printable = marks.drawable("a\nb\x1b[31m\udce9\u4e2d é")
    assert printable == "a?b?[31m?? é"
    picture = np.full((30, 200, 3), 255, np.uint8)
    marks.draw_text(picture, 2, 20, 9.0, printable)
    assert picture.min() < 100
    for x, y in ((-9, 5), (35, 5), (500, 5), (3, -40), (3, 1), (3, 500)):  # clipped at the picture
        picture = np.full((12, 40, 3), 255, np.uint8)
        marks.draw_text(picture, x, y, 9.0, "clipped")
    assert not recwarn.list


@pytest.mark.parametrize(
    ("ends", "labels"),
    [
        ((50.0, 320.0), ["50", "100", "150", "200", "250", "300"]),
        ((1e9, 1e9 + 1), ["1000000000", "1000000000.2", "1000000000.4", "1000000000.6", "1000000000.8", "1000000001"]),
        ((-1.7e308, 1.7e308), ["-1.7e+308", "1.7e+308"]),
        ((0.0, 0.0), ["0"]),
    ],
)
def test_numbers_are_round_and_all_there(ends, labels):
    places, tick_labels = _ticks(*ends, 6)
    assert tick_labels == labels
    assert len(places) == len(labels)
    assert all(0.0 <= place <= 1.0 for place in places)
    image, ground = np.zeros((90, 7, 3), np.uint8), np.array([255, 255, 255], np.uint8)
    assert with_colorbar(image, "jet", ends, "a $\\frac name\n" * 20, ground).shape[0] == 90


IMAGE = np.random.default_rng(5).integers(0, 256, (40, 60, 3), dtype=np.uint8)


def test_every_pixel_becomes_a_square():
    large = magnify(IMAGE, Crop(10, 20, 3, 2, 5))
    assert np.array_equal(large, IMAGE[20:22, 10:13].repeat(5, axis=0).repeat(5, axis=1))


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
    rows, columns = np.nonzero((mark_crops(IMAGE, [Crop(20, 20, 4, 4)]) != IMAGE).any(axis=-1))  # without a number
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (18, 25, 18, 25)


@pytest.mark.parametrize(
    ("crop", "part"), [((0, 0, 61, 10), "within 60 x 40 pixels"), ((0, 0, 6, 6, 65), "a factor from 1 to 64")]
)
def test_refused_crops(crop, part):
    with pytest.raises(InputError, match=part):
        Crop(*crop).check("--crop-zoom", 60, 40)
    Crop(54, 34, 6, 6, 64).check("--crop-zoom", 60, 40)


def test_texts_of_a_sheet_stand_in_the_middle():
    """Of the sheet its heading, of each panel title and caption; pictures lie at the places of `Layout.corner`."""
    layout = marks.Layout(across=2, panel=90)
    sheet = marks.compose_sheet([marks.Panel(np.zeros((40, 90, 3), np.uint8), "HOH", "HOH")] * 3, "HOH", layout)
    for k in range(3):
        x, y = layout.corner(k, 40)
        assert not sheet[y : y + 40, x : x + 90].any()
        for text in (sheet[y - layout.title : y - 2, x : x + 90], sheet[y + 42 : y + layout.caption, x : x + 90]):
            assert np.nonzero((text < 128).any(axis=(0, 2)))[0].mean() == pytest.approx(45, abs=3)
    heading = np.nonzero((sheet[: layout.head - 2] < 128).any(axis=(0, 2)))[0]
    assert heading.mean() == pytest.approx(sheet.shape[1] / 2, abs=3)
