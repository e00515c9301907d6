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
from clshade.measure.grade import folder, grade, pictures, reading, tables
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


def written(path: Path, image: object) -> Path:
    """Write an image as the ending says, or text."""
    if isinstance(image, str):
        path.write_text(image)
    elif path.suffix == ".npy":
        np.save(path, image)
    elif path.suffix == ".npz":
        np.savez(path, **image)
    elif path.suffix == ".exr":
        exr.write(path, image.astype(np.float32))
    else:
        png.write(path, np.uint8(image))
    return path


def test_files_of_every_kind_are_right(tmp_path):
    linear = right().linear
    images = {
        "a.png": right().codes,
        "b.exr": linear,
        "c.npy": linear[::-1],
        "d.npz": {"rgb": linear, "Z": linear[..., 0]},
    }
    for name, image in images.items():
        assert grade.grade(written(tmp_path / name, image), right()).differ == 0, name


def with_value(image: np.ndarray, value: float) -> np.ndarray:
    changed = image.copy()
    changed[5, 7, 1] = value
    return changed


REFUSED = [
    ("a.npy", lambda: np.zeros((4, 4)), "array: expected floats, or integers from 0 to 255, of shape .*found float64"),
    ("a.npy", lambda: right().codes > 3, "array: expected floats, or integers from 0 to 255"),
    ("a.npy", lambda: right().codes, "array: expected linear floats, 1 for full intensity.*whole numbers up to"),
    ("a.npy", lambda: with_value(right().linear, np.nan), "array: .*found NaN or infinity in 1 of 2,304 pixels"),
    ("a.exr", lambda: with_value(right().linear, np.nan), "channels: .*found NaN or infinity in 1 of 2,304 pixels"),
    ("a.npy", lambda: with_value(right().codes.astype(int), 256), r"integers from 0 to 255, found \d+ to 256"),
    ("a.npy", lambda: with_value(right().codes.astype(int), -1), "integers from 0 to 255, found -1 to"),
    ("a.npy", lambda: np.array([{}], object), "file: expected an array"),
    ("a.npz", lambda: {"a": np.zeros(1), "b": np.zeros(1)}, "arrays: expected one named rgb, found a, b"),
    ("a.png", lambda: "text", "image: expected an image of type"),
]


@pytest.mark.parametrize(("name", "image", "message"), REFUSED)
def test_what_cannot_be_graded_is_refused_in_one_line(tmp_path, name, image, message):
    with pytest.raises(InputError, match=message) as error:
        grade.grade(written(tmp_path / name, image()), right())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.uint16, np.int64])
def test_whole_numbers_of_any_integer_type_are_codes(tmp_path, kind):
    np.save(tmp_path / "a.npy", right().codes[::-1].astype(kind))
    assert grade.grade(tmp_path / "a.npy", right()).right


def test_the_size_is_checked_before_anything_is_converted(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", np.zeros((4, 5, 3)))
    png.write(tmp_path / "a.png", np.zeros((4, 5, 3), np.uint8))
    exr.write(tmp_path / "a.exr", np.zeros((4, 5, 3), np.float32))
    monkeypatch.setattr(reading, "as_codes", None)
    monkeypatch.setattr(reading.np, "rint", None)
    for name in ("a.npy", "a.png", "a.exr"):
        with pytest.raises(InputError, match=r"size: expected 48 x 48 pixels, .*\(--resolution\), found 5 x 4"):
            grade.grade(tmp_path / name, right())


def test_the_size_of_an_image_with_exchanged_axes_says_so(tmp_path):
    png.write(tmp_path / "turned.png", np.zeros((12, 9, 3), np.uint8))
    solution = grade.right_of(builtin("course", resolution=(12, 9)), Settings.from_preset("course"))
    with pytest.raises(InputError, match="rows and columns exchanged"):
        grade.grade(tmp_path / "turned.png", solution)


def test_jpeg_is_refused(tmp_path):
    Image.fromarray(np.uint8(right().codes)).save(tmp_path / "a.png", "JPEG", quality=95)
    with pytest.raises(InputError, match="image: expected a lossless format such as PNG, found JPEG"):
        grade.grade(tmp_path / "a.png", right())


def test_alpha_is_left_out_and_remarked(tmp_path):
    see_through = np.dstack([right().codes, np.full((SIZE, SIZE), 128.0)])
    Image.fromarray(np.uint8(see_through)).save(tmp_path / "a.png")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        grading = grade.grade(tmp_path / "a.png", right())
    assert grading.right
    assert tables.lines(grading.facts())[1] == "Note: image: its alpha channel is left out"


def test_a_folder_becomes_a_table_and_a_page(tmp_path):
    place = tmp_path / "in"
    (place / "late").mkdir(parents=True)
    png.write(place / "<b>.png", np.uint8(right().codes))
    png.write(place / "late" / "z.png", np.uint8(upside_down()))
    for name in (".hidden.png", "notes.txt", "bad.png"):
        (place / name).write_text("text")
    names = folder.submissions(place)
    assert names == ["<b>.png", "bad.png", "late/z.png"]
    rows = list(folder.grade_all(place, names, right(), drawn=True))
    records = list(csv.DictReader(io.StringIO(tables.csv([row.facts for row in rows]))))
    assert [row["right"] for row in records] == ["True", "", "False"]
    assert records[1]["error"].startswith("image: expected an image of type")
    assert (records[2]["explained"], records[2]["mistake"], records[2]["same_image"]) == ("True", "upside down", "")
    assert float(records[2]["difference_removed"]) == float(records[2]["pixels_made_right"]) == 1.0
    text = tables.page(rows, "course").decode()
    assert "&lt;b&gt;.png" in text
    assert "<b>.png" not in text
    assert text.count("data:image/png;base64,") == 2
    assert "http" not in text.replace("http-equiv", "")


def test_a_summary_has_a_line_for_each_submission():
    few, mixed = right().codes.copy(), upside_down().copy()
    few[20, 20] = 255.0 - few[20, 20]
    mixed[: SIZE // 2] = np.random.default_rng(0).integers(0, 256, (SIZE // 2, SIZE, 3))
    images = {"a": right().codes, "b": upside_down(), "c": few, "d": mixed}
    facts = [grade.graded(image, right(), name).facts() for name, image in images.items()]
    lines = tables.summary([*facts, {"image": "e", "error": "image: expected an image"}])
    assert lines[0] == "a: right within 1/255"
    assert lines[1].startswith("b: not right: ")
    assert lines[1].endswith("; upside down (removes 100 %)")
    assert lines[2].startswith("c: not right: 1 of 2,304 pixels differ, by up to")
    assert "; no mistake explains it" in lines[2]
    assert "; no mistake explains it; nearest: " in lines[3]
    assert lines[4] == "e: not graded: image: expected an image"
    assert lines[5] == "5 submissions: 1 right within 1/255, 3 not right (1 explained), 1 not graded"


def test_cells_that_a_spreadsheet_takes_for_formulas_begin_with_an_apostrophe():
    names = ["=1+1.png", "+a.png", "-a.png", "@a.png", "\ta.png", "a=1.png"]
    text = tables.csv([{"image": name, "error": "-1 found"} for name in names])
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [row["submission"] for row in rows] == [*(f"'{name}" for name in names[:5]), "a=1.png"]
    assert {row["error"] for row in rows} == {"'-1 found"}


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

    folder._keep(right(), False)
    monkeypatch.setattr(grade, "read_codes", hungry)
    assert "fits into memory" in folder._row(Path("a.png"), "a.png").facts["error"]


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
    assert facts["explanations"][0]["mistake"] == "upside down"
    assert png.read(out).ndim == 3
    assert main(["grade", str(tmp_path / "none.png"), *GIVEN]) == 2
    assert main(["grade", str(tmp_path / "a.png")]) == 2
    assert main(["grade", str(tmp_path / "a.png"), *GIVEN, "--html", "x.html"]) == 2
    assert main(["grade", "--list"]) == 0
    assert "upside down: Row 0 of the course" in capsys.readouterr().out


def test_the_command_on_a_folder(tmp_path, capsys):
    place = tmp_path / "in"
    place.mkdir()
    png.write(place / "a.png", np.uint8(right().codes))
    table, html = tmp_path / "out.csv", tmp_path / "out.html"
    assert main(["grade", str(place), *GIVEN, "-o", str(table), "--html", str(html)]) == 0
    assert table.read_text().splitlines()[1] == f"a.png,True,{SIZE * SIZE},0,0,0.0,False,,,,,,"
    assert html.stat().st_size > 1000
    (place / "b.png").write_text("text")
    capsys.readouterr()
    assert main(["grade", str(place), *GIVEN, "--json"]) == 1
    facts = json.loads(capsys.readouterr().out)["submissions"][1]
    assert facts["submission"] == "b.png"
    assert facts["error"].startswith("image: expected")
    (place / "a.png").unlink()
    (place / "b.png").unlink()
    assert main(["grade", str(place), *GIVEN]) == 2
    assert "expected images in the folder, found none" in capsys.readouterr().err


def test_a_picture_names_what_it_shows(tmp_path):
    grading = grade.graded(upside_down(), right(), "image")
    figure = pictures.draw(grading, right())
    titles = [axes.get_title() for part in figure.subfigs for axes in part.axes if axes.get_title()]
    assert [title for title in titles if "difference" not in title] == [
        *("your image", "the right image"),
        *("your image", "the right image with this mistake"),
    ]
    assert [part.get_suptitle() for part in figure.subfigs][1] == "upside down"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--list", "x.png"), "IMAGE: expected none with --list, found 'x.png'"),
        (("--list", "--json"), "--json: cannot go with --list"),
        (("x.png", "course", "--look", "studio"), "--look: the right image is drawn as --preset says"),
    ],
)
def test_options_without_effect_are_refused(arguments, message, capsys):
    assert main(["grade", *arguments]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
