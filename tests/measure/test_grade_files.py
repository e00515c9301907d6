"""`grade`: files that are graded, folders, and the command."""

from __future__ import annotations

import csv
import io
import json
import os
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from clshade.cli.main import main
from clshade.errors import InputError
from clshade.images import exr, png
from clshade.measure.grade import folder, grade, page, pictures, reading, tables
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Settings

SIZE = 48


@cache
def right() -> grade.Right:
    """Return the right image of the built-in course scene."""
    return grade.right_of(builtin("course", resolution=(SIZE, SIZE)), Settings.from_preset("course"))


def upside_down() -> np.ndarray:
    return right().codes[::-1]


# Files


def test_files_of_every_kind_are_right(tmp_path):
    linear = right().linear
    png.write(tmp_path / "a.png", np.uint8(right().codes))
    exr.write(tmp_path / "b.exr", linear.astype(np.float32))
    np.save(tmp_path / "c.npy", linear[::-1])
    np.savez(tmp_path / "d.npz", rgb=linear, Z=linear[..., 0])
    for name in ("a.png", "b.exr", "c.npy", "d.npz"):
        assert grade.grade(tmp_path / name, right()).differ == 0, name


def test_a_file_that_cannot_be_graded_is_refused_in_one_line(tmp_path):
    np.save(tmp_path / "flat.npy", np.zeros((4, 4)))
    np.save(tmp_path / "objects.npy", np.array([{}], object))
    np.savez(tmp_path / "two.npz", a=np.zeros(1), b=np.zeros(1))
    (tmp_path / "text.png").write_text("text")
    png.write(tmp_path / "small.png", np.zeros((4, 5, 3), np.uint8))
    expected = {
        "flat.npy": r"array: expected floats, or integers from 0 to 255, of shape .*, found float64 of shape \(4, 4\)",
        "objects.npy": "file: expected an array",
        "two.npz": "arrays: expected one named rgb, found a, b",
        "text.png": "image: expected an image of type",
        "small.png": r"size: expected 48 x 48 pixels, as the scene has \(--resolution\), found 5 x 4",
    }
    for name, message in expected.items():
        with pytest.raises(InputError, match=message) as error:
            grade.grade(tmp_path / name, right())
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.uint16, np.int64])
def test_whole_numbers_of_any_integer_type_are_codes(tmp_path, kind):
    np.save(tmp_path / "a.npy", right().codes[::-1].astype(kind))
    assert grade.grade(tmp_path / "a.npy", right()).right


def test_arrays_whose_values_are_no_linear_colors_are_refused(tmp_path):
    hole = right().linear.copy()
    hole[5, 7] = np.nan
    over = right().codes.astype(int)
    over[0, :2] = [[256], [-1]]
    images = {
        "array: expected linear floats, 1 for full intensity.*whole numbers up to": right().codes,
        "array: expected finite values, found NaN or infinity in 1 of 2,304 pixels": hole,
        "array: expected integers from 0 to 255, found -1 to 256": over,
        "array: expected floats, or integers from 0 to 255": right().codes > 3,
    }
    for message, image in images.items():
        np.save(tmp_path / "a.npy", image)
        with pytest.raises(InputError, match=message):
            grade.grade(tmp_path / "a.npy", right())


def test_nan_in_an_exr_is_refused(tmp_path):
    linear = right().linear.astype(np.float32)
    linear[3, 4, 1] = np.nan
    exr.write(tmp_path / "a.exr", linear)
    with pytest.raises(
        InputError, match="channels: expected finite values, found NaN or infinity in 1 of 2,304 pixels"
    ):
        grade.grade(tmp_path / "a.exr", right())


def test_the_size_is_checked_before_anything_is_converted(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", np.zeros((4, 5, 3)))
    png.write(tmp_path / "a.png", np.zeros((4, 5, 3), np.uint8))
    exr.write(tmp_path / "a.exr", np.zeros((4, 5, 3), np.float32))
    monkeypatch.setattr(reading, "as_codes", None)
    monkeypatch.setattr(reading.np, "rint", None)
    for name in ("a.npy", "a.png", "a.exr"):
        with pytest.raises(InputError, match="size: expected 48 x 48 pixels"):
            grade.grade(tmp_path / name, right())


def test_the_size_of_an_image_with_exchanged_axes_says_so(tmp_path):
    png.write(tmp_path / "turned.png", np.zeros((12, 9, 3), np.uint8))
    given = grade.right_of(builtin("course", resolution=(12, 9)), Settings.from_preset("course"))
    with pytest.raises(InputError, match="rows and columns exchanged"):
        grade.grade(tmp_path / "turned.png", given)


def test_jpeg_is_refused(tmp_path):
    Image.fromarray(np.uint8(right().codes)).save(tmp_path / "a.png", "JPEG", quality=95)
    with pytest.raises(InputError, match="image: expected a lossless format such as PNG, found JPEG"):
        grade.grade(tmp_path / "a.png", right())


def test_alpha_is_left_out_and_remarked(tmp_path):
    see_through = np.dstack([right().codes, np.full((SIZE, SIZE), 128.0)])
    Image.fromarray(np.uint8(see_through)).save(tmp_path / "a.png")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = grade.grade(tmp_path / "a.png", right())
    assert found.right
    assert tables.lines(found.facts())[1] == "Note: image: its alpha channel is left out"


def test_a_folder_becomes_a_table_and_a_page(tmp_path):
    place = tmp_path / "in"
    (place / "late").mkdir(parents=True)
    png.write(place / "<b>.png", np.uint8(right().codes))
    png.write(place / "late" / "z.png", np.uint8(upside_down()))
    (place / ".hidden.png").write_text("not read")
    (place / "notes.txt").write_text("not read")
    (place / "bad.png").write_text("text")
    paths = folder.submissions(place)
    names = [str(path.relative_to(place)) for path in paths]
    assert names == ["<b>.png", "bad.png", "late/z.png"]
    found = list(folder.grade_all(paths, right()))
    rows = tables.rows(names, found)
    assert [row[1] for row in rows] == ["yes", "", "no"]
    assert rows[2][5] == "upside down"
    assert rows[1][-1].startswith("image: expected an image of type")
    page.write(names, found, "course", tmp_path / "out.html")
    text = (tmp_path / "out.html").read_text()
    assert "&lt;b&gt;.png" in text
    assert "<b>.png" not in text
    assert "http" not in text.replace("http-equiv", "")


def rows_of(**pictures: np.ndarray) -> list[folder.Row]:
    """Return what is found in images, as in a folder."""
    found = [grade.graded(image, right(), name) for name, image in pictures.items()]
    return [folder.Row(each.facts(), pictures_of(each)) for each in found]


def pictures_of(found: grade.Grade) -> tuple[pictures.Shot, ...]:
    return pictures.shots(found, right())


@pytest.mark.long
def test_a_summary_has_a_line_for_each_submission():
    name = "a-very-long-folder-name-of-a-student/and-a-file-name-that-is-as-long-as-that-one-is-or-longer.png"
    few = right().codes.copy()
    few[20, 20] = 255.0 - few[20, 20]
    found = [*rows_of(a=right().codes, b=upside_down(), c=few), "image: expected an image"]
    lines = tables.summary([name, "b.png", "c.png", "d.png"], found)
    assert lines[0] == f"{name}: right"
    assert lines[1].startswith("b.png: not right, ")
    assert "; upside down (removes 100 %)" in lines[1]
    assert lines[2].startswith("c.png: not right, 1 pixel differs; no mistake explains it")
    assert lines[3] == "d.png: not graded: image: expected an image"
    assert lines[4] == "4 submissions: 1 right within 1/255, 2 not right (1 explained), 1 not graded"


def test_cells_that_a_spreadsheet_takes_for_formulas_begin_with_an_apostrophe():
    names = ["=1+1.png", "+a.png", "-a.png", "@a.png", "\ta.png", "a=1.png"]
    text = tables.csv(names, ["-1 found"] * len(names))
    cells = [(row[0], row[-1]) for row in csv.reader(io.StringIO(text))][1:]
    assert [name[:2] for name, _ in cells[:4]] == ["'=", "'+", "'-", "'@"]
    assert cells[5][0] == "a=1.png"
    assert not any(name.startswith(("=", "+", "-", "@", "\t")) for name, _ in cells)
    assert {remark for _, remark in cells} == {"'-1 found"}


@pytest.mark.long
def test_a_table_has_plain_numbers_and_what_comes_nearest():
    codes = upside_down()
    codes[: SIZE // 2] = np.random.default_rng(0).integers(0, 256, (SIZE // 2, SIZE, 3))
    (row,) = tables.rows(["a.png"], rows_of(a=codes))
    facts = dict(zip(tables.HEADER, row, strict=True))
    assert facts["right"] == "no"
    assert int(facts["pixels"]) == SIZE * SIZE
    assert int(facts["pixels differ"]) > SIZE * SIZE // 4
    assert facts["mistake"] == ""
    assert facts["nearest"]
    assert 0.0 < float(facts["removes"]) < 0.8


def test_small_pictures_keep_the_difference_of_pixels_that_are_skipped():
    apart = np.zeros((1000, 1000, 3))
    apart[501, 502] = 255.0
    shot = pictures._difference("difference", apart, np.zeros_like(apart))
    assert max(shot.pixels.shape) <= 240
    assert (shot.pixels == 255).all(axis=2).sum() == 1


def test_a_folder_that_cannot_be_read_is_an_error(tmp_path, monkeypatch):
    (tmp_path / "late").mkdir()
    scan = os.scandir

    def refused(path):
        if str(path).endswith("late"):
            raise PermissionError(13, "Permission denied", str(path))
        return scan(path)

    monkeypatch.setattr(os, "scandir", refused)
    with pytest.raises(InputError, match="late: folder: expected a readable folder, found Permission denied"):
        folder.submissions(tmp_path)


def test_want_of_memory_costs_one_submission(monkeypatch):
    def hungry(path, shape):
        raise MemoryError

    folder._keep(right())
    monkeypatch.setattr(grade, "read_codes", hungry)
    assert "fits into memory" in folder._kept_one(Path("a.png"))


# The command

GIVEN = ("course", "--resolution", f"{SIZE},{SIZE}")


def test_the_command_s_exit_codes(tmp_path, capsys):
    png.write(tmp_path / "a.png", np.uint8(right().codes))
    png.write(tmp_path / "b.png", np.uint8(upside_down()))
    assert main(["grade", str(tmp_path / "a.png"), *GIVEN]) == 0
    assert "right within 1/255" in capsys.readouterr().out
    out = tmp_path / "found.png"
    assert main(["grade", str(tmp_path / "b.png"), *GIVEN, "--json", "-o", str(out)]) == 1
    facts = json.loads(capsys.readouterr().out)
    assert facts["explanations"][0]["mistakes"] == ["upside down"]
    assert png.read(out).ndim == 3
    assert main(["grade", str(tmp_path / "none.png"), *GIVEN]) == 2
    assert main(["grade", str(tmp_path / "a.png")]) == 2
    assert main(["grade", str(tmp_path / "a.png"), *GIVEN, "--html", "x.html"]) == 2
    assert main(["grade", "--list"]) == 0
    assert "upside down: The course" in capsys.readouterr().out


def test_the_command_on_a_folder(tmp_path, capsys):
    place = tmp_path / "in"
    place.mkdir()
    png.write(place / "a.png", np.uint8(right().codes))
    table, html = tmp_path / "out.csv", tmp_path / "out.html"
    assert main(["grade", str(place), *GIVEN, "-o", str(table), "--html", str(html)]) == 0
    assert table.read_text().splitlines()[1] == f"a.png,yes,{SIZE * SIZE},0,0,,,,,,"
    assert html.stat().st_size > 1000
    (place / "b.png").write_text("text")
    assert main(["grade", str(place), *GIVEN]) == 1
    (place / "a.png").unlink()
    (place / "b.png").unlink()
    assert main(["grade", str(place), *GIVEN]) == 2
    assert "expected images in the folder, found none" in capsys.readouterr().err


def test_a_picture_names_what_it_shows(tmp_path):
    found = grade.graded(upside_down(), right(), "image")
    figure = pictures.draw(found, right())
    titles = [axes.get_title() for part in figure.subfigs for axes in part.axes if axes.get_title()]
    assert [title for title in titles if "difference" not in title] == [
        *("your image", "the right image"),
        *("your image", "the right image with this mistake"),
    ]
    assert [part.get_suptitle() for part in figure.subfigs][1] == "upside down"


def test_json_of_a_folder_names_the_files_that_cannot_be_graded(tmp_path, capsys):
    (tmp_path / "b.png").write_text("text")
    assert main(["grade", str(tmp_path), *GIVEN, "--json"]) == 1
    (facts,) = json.loads(capsys.readouterr().out)
    assert facts["image"].endswith("b.png")
    assert facts["error"].startswith("image: expected")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("--planted", "-3"), "expected a whole number from 1 on, found '-3'"),
        (("--planted", "0"), "expected a whole number from 1 on, found '0'"),
        (("--planted", "1", "--pairs", "-1"), "expected a whole number from 0 on, found '-1'"),
        (("--planted", "1", "x.png"), "IMAGE: expected none with --planted, found 'x.png'"),
        (("--planted", "1", "--json"), "--json: cannot go with --planted"),
        (("--list", "x.png"), "IMAGE: expected none with --list, found 'x.png'"),
        (("--list", "--planted", "1"), "--planted: cannot go with --list"),
        (("x.png", "course", "--pairs", "3"), "--pairs: needs --planted N"),
        (("x.png", "course", "--seed", "3"), "--seed: needs --planted N"),
        (("x.png", "course", "--look", "studio"), "--look: the right image is drawn as --preset says"),
    ],
)
def test_options_without_effect_are_refused(given, message, capsys):
    try:
        assert main(["grade", *given]) == 2
    except SystemExit as ended:  # argparse's own
        assert ended.code == 2
    assert message in " ".join(capsys.readouterr().err.split())
