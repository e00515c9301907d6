"""`grade`: files that are graded, folders, and the command."""

from __future__ import annotations

import csv
import io
import json
import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused, run
from PIL import Image

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
    elif path.suffix == ".jpg":
        Image.fromarray(np.uint8(image)).save(path, quality=95)
    else:
        png.write(path, np.uint8(image))
    return path


RIGHT = {
    "a.png": lambda: right().codes,
    "a.exr": lambda: right().linear,
    "a.npz": lambda: {"rgb": right().linear, "Z": right().linear[..., 0]},
    "a.npy": lambda: right().linear[::-1],
    **{f"{kind}.npy": lambda kind=kind: upside_down().astype(kind) for kind in ("uint8", "int16", "uint16", "int64")},
}


@pytest.mark.parametrize("name", RIGHT)
def test_files_of_every_kind_are_right(tmp_path, name):
    assert grade.grade(written(tmp_path / name, RIGHT[name]()), right()).differ == 0


@pytest.mark.filterwarnings("error")
def test_alpha_is_left_out_and_remarked(tmp_path):
    see_through = np.dstack([right().codes, np.full((SIZE, SIZE), 128.0)])
    grading = grade.grade(written(tmp_path / "a.png", see_through), right())
    assert grading.right
    assert tables.lines(grading.facts())[1] == "Note: image: its alpha channel is left out"


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
    ("a.jpg", lambda: right().codes, "image: expected a lossless format such as PNG, found JPEG"),
]


@pytest.mark.parametrize(("name", "image", "message"), REFUSED)
def test_what_cannot_be_graded_is_refused_in_one_line(tmp_path, name, image, message):
    with pytest.raises(InputError, match=message) as error:
        grade.grade(written(tmp_path / name, image()), right())
    assert "\n" not in str(error.value)


def test_the_size_of_an_image_with_exchanged_axes_says_so(tmp_path):
    solution = grade.right_of(builtin("course", resolution=(12, 9)), Settings.from_preset("course"))
    with pytest.raises(InputError, match="rows and columns exchanged"):
        grade.grade(written(tmp_path / "turned.png", np.zeros((12, 9, 3))), solution)


def test_the_size_is_checked_before_anything_is_converted(tmp_path, monkeypatch):
    paths = [written(tmp_path / name, np.zeros((4, 5, 3))) for name in ("a.npy", "a.png", "a.exr")]
    monkeypatch.setattr(reading, "as_codes", None)
    monkeypatch.setattr(reading.np, "rint", None)
    for path in paths:
        with pytest.raises(InputError, match=r"size: expected 48 x 48 pixels, .*\(--resolution\), found 5 x 4"):
            grade.grade(path, right())


def test_a_folder_becomes_a_table_and_a_page(tmp_path):
    place = tmp_path / "in"
    (place / "late").mkdir(parents=True)
    written(place / "<b>.png", right().codes)
    written(place / "late" / "z.png", upside_down())
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
    fine, found = grade.graded(right().codes, right(), "a"), grade.graded(upside_down(), right(), "b")
    unclear = replace(found, name="d", explanations=(replace(found.explanations[0], removed=0.2, fixed=0.1),))
    facts = [grading.facts() for grading in (fine, found, replace(found, name="c", explanations=()), unclear)]
    lines = tables.summary([*facts, {"image": "e", "error": "image: expected an image"}])
    differ = f"not right: {found.differ} of 2,304 pixels differ, by up to "
    assert lines[0] == "a: right within 1/255"
    assert all(line.startswith(f"{name}: {differ}") for name, line in zip("bcd", lines[1:4], strict=True))
    assert lines[1].endswith("; upside down (removes 100 %)")
    assert lines[2].endswith("; no mistake explains it")
    assert lines[3].endswith("; no mistake explains it; nearest: upside down (removes 20 %)")
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


def test_the_command(tmp_path, capsys):
    place, out = tmp_path / "in", tmp_path / "marked.png"
    place.mkdir()
    wrong = written(place / "b.png", upside_down())
    code, said, _ = run(capsys, "grade", wrong, *GIVEN, "--json", "-o", out)
    assert (code, json.loads(said)["explanations"][0]["mistake"]) == (1, "upside down")
    assert png.read(out).ndim == 3
    assert "upside down: Row 0 of the course" in run(capsys, "grade", "--list")[1]
    wrong.unlink()
    assert_refused(run(capsys, "grade", place, *GIVEN), "expected images in the folder, found none")
    code, said, _ = run(capsys, "grade", written(place / "a.png", right().codes), *GIVEN)
    assert (code, "right within 1/255" in said) == (0, True)
    table, html = tmp_path / "out.csv", tmp_path / "out.html"
    assert run(capsys, "grade", place, *GIVEN, "-o", table, "--html", html)[0] == 0
    assert table.read_text().splitlines()[1] == f"a.png,True,{SIZE * SIZE},0,0,0.0,False,,,,,,"
    assert html.stat().st_size > 1000
    wrong.write_text("text")
    code, said, _ = run(capsys, "grade", place, *GIVEN, "--json")
    submission = json.loads(said)["submissions"][1]
    assert (code, submission["submission"]) == (1, "b.png")
    assert submission["error"].startswith("image: expected")


def test_a_picture_names_what_it_shows(tmp_path):
    grading = grade.graded(upside_down(), right(), "image")
    figure = pictures.draw(grading, right())
    titles = [axes.get_title() for part in figure.subfigs for axes in part.axes if axes.get_title()]
    assert [title for title in titles if "difference" not in title] == [
        *("your image", "the right image"),
        *("your image", "the right image with this mistake"),
    ]
    assert [part.get_suptitle() for part in figure.subfigs][1] == "upside down"
