"""`grade`: mistakes that are planted are found, and right images are right; files, folders and the command."""

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
from course_reference import light, scene_arguments
from PIL import Image

from clshade.errors import InputError
from clshade.images import exr, png
from clshade.measure.grade import drawing, folder, grade, search, tables
from clshade.measure.grade.mistakes import coverage
from clshade.oracle import frame, texture
from clshade.oracle.lights import Directions
from clshade.scene.builtin.scenes import builtin
from clshade.scene.geometry import camera_axes, vertex_normals
from clshade.scene.model import Scene, Settings, with_materials

SIZE = 48


def course(size: tuple[int, int] = (SIZE, SIZE), intensity: float = 1.0, textured: bool = True) -> Scene:
    scene = builtin("course", resolution=size)
    if not textured:
        scene = with_materials(scene, lambda material: replace(material, texture=None))
    return replace(scene, lights=tuple(replace(light, intensity=intensity * light.intensity) for light in scene.lights))


def right_of(scene: Scene, shader: str = "phong", **settings: object) -> grade.Right:
    return grade.right_of(scene, Settings.from_preset("course", shader=shader, **settings))


@cache
def right(shader: str = "phong", intensity: float = 1.0, textured: bool = True) -> grade.Right:
    return right_of(course(intensity=intensity, textured=textured), shader)


def with_mistakes(solution: grade.Right, *labels: str) -> drawing.Drawing:
    by_label = {change.label: change for change in search.changes_of(solution.drawing)}
    return search.applied(solution.drawing, [by_label[label] for label in labels])


def linear_of(solution: grade.Right, label: str) -> np.ndarray:
    return drawing.linear_image(with_mistakes(solution, label))


def drawn(solution: grade.Right, *labels: str) -> np.ndarray:
    return np.rint(drawing.code_image(with_mistakes(solution, *labels)))


def found_first(solution: grade.Right, image: np.ndarray) -> list[set[str]]:
    """Return the labels of the best explanation, and of what gives the same image."""
    best = grade.graded(image, solution, "image").best
    assert best.claimed
    return [{change.label for change in changes} for changes in (best.changes, *best.same)]


@pytest.mark.parametrize(("shader", "visibility", "background"), [
    ("phong", "painter", 0.5), ("gouraud", "depth", None),
])  # fmt: skip
def test_the_right_image_is_the_oracle_s(shader, visibility, background):
    scene = replace(course((64, 48)), background=background)
    solution = right_of(scene, shader, visibility=visibility)
    assert np.array_equal(solution.linear, frame.render(scene, solution.drawing.settings).rgb)


Z, TILTED, ASIDE = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.6, 0.0, -0.8]])
# Mistake, term, directions to the light and to the eye from a surface with normal Z, the term's value for n = 3
TERMS = [
    ("N.L not clamped", "kd", -TILTED, Z, -0.8),
    ("N.L by absolute value", "kd", -TILTED, Z, 0.8),
    ("Blinn for Phong", "ks", TILTED, Z, np.cos(0.5 * np.arccos(0.8)) ** 3),
    ("R with the wrong sign", "ks", TILTED, Z, 0.0),
    ("R with the wrong sign", "ks", TILTED, ASIDE, 1.0),
    ("R without its factor 2", "ks", TILTED, -ASIDE, 0.36**3),
    ("R.V by absolute value", "ks", TILTED, ASIDE, 1.0),
    ("highlight without gate", "ks", -TILTED, -Z, 0.8**3),
]


@pytest.mark.parametrize(("label", "term", "to_light", "to_eye", "expected"), TERMS)
def test_terms_of_the_light_in_closed_form(label, term, to_light, to_eye, expected):
    at = Directions(normal=Z, to_light=to_light, to_eye=to_eye)
    assert np.isclose(with_mistakes(right(), label).light.terms[term](at, np.float64(3.0)), expected)


def test_a_normal_that_is_not_renormalized_in_closed_form():
    """All directions along z, with |N| = 0.9: R.V = 2*0.81 - 1."""
    for pair, expected in (((), 0.62), (("Blinn for Phong",), 0.9), (("R.V by absolute value",), 0.62)):
        light = with_mistakes(right(), "normals not renormalized", *pair).light
        at = light.directions(0.0 * Z, 0.9 * Z, Z, 2.0 * Z)
        assert np.isclose(light.terms["ks"](at, np.float64(10.0)), expected**10)
        assert np.isclose(light.terms["kd"](at, np.float64(10.0)), 0.9)


def test_pixels_at_other_places_and_lights_that_keep_their_numbers_beside_a_missing_one():
    codes = right().codes
    for label, image in (
        ("mirrored", codes[:, ::-1]),
        ("turned by 180 degrees", codes[::-1, ::-1]),
        ("axes swapped (about the diagonal from the top left)", codes.swapaxes(0, 1)),
    ):
        assert np.array_equal(drawn(right(), label), image), label
    changed = with_mistakes(right(), "a light missing (light 1)", "one channel of a light (red of light 3)")
    before, after = ([light.intensity for light in version.scene.lights] for version in (right().drawing, changed))
    assert np.array_equal(after, [0.0 * before[0], before[1], before[2] * [1.0, 0.0, 0.0]])


@pytest.mark.parametrize("shader", ["phong", "gouraud"])
def test_a_highlight_without_color_is_that_of_a_white_object(shader):
    solution = right(shader, textured=False)
    scene, settings = solution.drawing.scene, solution.drawing.settings
    mesh = scene.meshes[0]
    matte = replace(mesh, material=replace(mesh.material, ks=0.0))
    white = replace(mesh, colors=None, material=replace(mesh.material, ka=0.0, kd=0.0, color=1.0))
    parts = [frame.render(replace(scene, meshes=(variant,)), settings).rgb for variant in (matte, white)]
    covered = frame.render(scene, settings).id > 0
    image = linear_of(solution, "highlight without color")
    assert np.allclose(image[covered], (parts[0] + parts[1])[covered])
    assert not np.allclose(image, solution.linear)


def test_light_that_is_clipped_before_the_color():
    """Dim light stays; where it is far above 1 at all corners, ambient light and the color itself are left."""
    for shader in ("phong", "gouraud"):
        solution = right(shader, 0.01, textured=False)
        assert np.array_equal(linear_of(solution, "light clipped before color"), solution.linear)
    solution = right("gouraud", 1e6, textured=False)
    scene, settings = solution.drawing.scene, solution.drawing.settings
    unlit = frame.render(scene, replace(settings, shader="nolight"))
    most = unlit.rgb + scene.meshes[0].material.ka * scene.ambient
    lit = (solution.linear > 1e3).all(axis=2) & (unlit.id > 0)
    image = linear_of(solution, "light clipped before color")
    assert lit.any()
    assert np.isclose(image, most).all(axis=2)[lit].mean() > 0.8  # other triangles have corners in the dark
    assert (image <= most + 1e-9)[unlit.id > 0].all()


def test_a_triangle_of_one_color_has_the_mean_of_the_three_texels():
    solution = right("nolight")
    mesh = solution.drawing.scene.meshes[0]
    uvs = mesh.uvs[mesh.faces if mesh.uv_faces is None else mesh.uv_faces]
    face = frame.render(solution.drawing.scene, solution.drawing.settings).id.astype(int)
    expected = (texture.bilerp(uvs, mesh.material.texture.image, "course").mean(axis=1) * mesh.material.color)[face - 1]
    assert np.allclose(linear_of(solution, "one color per triangle")[face > 0], expected[face > 0])


@pytest.mark.long
def test_what_no_mistake_explains_is_not_claimed_and_an_object_that_is_missing_is():
    grading = grade.graded(np.random.default_rng(0).integers(0, 256, (SIZE, SIZE, 3)).astype(float), right(), "noise")
    assert not grading.right
    assert not (grading.best and grading.best.claimed)
    assert "None of the modeled mistakes" in "\n".join(tables.lines(grading.facts()))
    black = np.zeros((SIZE, SIZE, 3))
    background = np.rint(grade.as_codes(black + right().drawing.scene.background))
    assert {"nothing is drawn"} in found_first(right(), background)  # edges are not blamed
    assert "nothing is drawn" in {change.label for change in grade.graded(black, right(), "black").best.changes}


@pytest.mark.long
def test_gamma_beside_a_wrong_background_is_found():
    scene = replace(right().drawing.scene, background=[0.2, 0.5, 0.8])
    image = np.rint(255.0 * np.clip(frame.render(scene, right().drawing.settings).rgb, 0.0, 1.0) ** (1.0 / 2.2))
    assert {"wrong background (as it is)", "gamma (1/2.2)"} in found_first(right(), image)


def painted(scene: Scene, shader: str) -> np.ndarray:
    """Return the image that a student's float code draws: no corner is snapped, weights come from areas, (M, N, 3)."""
    arguments = scene_arguments(scene)
    mesh, camera = scene.meshes[0], scene.camera
    x, y, z = camera_axes(camera) @ (mesh.verts - camera.eye).T
    columns, rows = camera.resolution
    u = (camera.focal * x / (z * camera.plane[1]) + 0.5) * columns
    v = (camera.focal * y / (z * camera.plane[0]) + 0.5) * rows
    places = np.stack([u, v, np.ones_like(u)], axis=1)
    normals, colors = vertex_normals(mesh.verts, mesh.faces), arguments["verts_colors"].T
    materials = (mesh.material.ka * scene.ambient, *(arguments[name] for name in ("k_d", "k_s", "n", "l_pos", "l_int")))
    image = np.tile(scene.background, (rows, columns, 1))
    at = np.stack([*np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), np.ones((rows, columns))], axis=-1)
    for face in mesh.faces[np.argsort(-z[mesh.faces].mean(axis=1), kind="stable")]:
        weights = at @ np.linalg.inv(places[face])
        covered = (weights > 0.0).all(axis=2)
        around, of_corners = mesh.verts[face].mean(axis=0), (normals[face], colors[face])
        if shader == "gouraud":
            image[covered] = weights[covered] @ light(around, *of_corners, camera.eye, *materials)
        else:
            image[covered] = light(around, *(weights[covered] @ v for v in of_corners), camera.eye, *materials)
    return image[::-1]


@pytest.mark.long
@pytest.mark.parametrize(("shader", "rounded"), [("phong", np.floor), ("gouraud", np.rint)])
def test_a_student_s_own_code_is_right(shader, rounded):
    scene = course((80, 60), textured=False)
    grading = grade.graded(rounded(grade.as_codes(painted(scene, shader))), right_of(scene, shader), "image")
    assert grading.right
    assert grading.edges < 0.01 * 80 * 60


def test_pixels_that_another_fill_rule_decides_are_right():
    solution = right_of(course((128, 128)))
    for moved in coverage.SUBPIXEL_SHIFTS.values():
        grading = grade.graded(np.rint(drawing.code_image(moved(solution.drawing))), solution, "image")
        assert grading.right
        if grading.edges:
            break
    assert grading.differ == grading.edges > 0
    assert f"but for {grading.edges:,} of 16,384 pixels on edges" in tables.lines(grading.facts())[0]


def upside_down() -> np.ndarray:
    return right().codes[::-1]


def written(path: Path, image: object) -> Path:
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
    "int16.npy": lambda: upside_down().astype("int16"),
}


@pytest.mark.filterwarnings("error")
def test_files_of_every_kind_are_right(tmp_path):
    for name, image in RIGHT.items():
        assert grade.grade(written(tmp_path / name, image()), right()).differ == 0, name
    see_through = np.dstack([right().codes, np.full((SIZE, SIZE), 128.0)])
    grading = grade.grade(written(tmp_path / "see through.png", see_through), right())
    assert grading.right
    assert tables.lines(grading.facts())[1] == "Note: image: its alpha channel is left out"


def with_value(image: np.ndarray, value: float) -> np.ndarray:
    changed = image.copy()
    changed[5, 7, 1] = value
    return changed


REFUSED = [
    ("a.npy", lambda: np.zeros((4, 4)), "array: expected floats, or integers from 0 to 255, of shape .*found float64"),
    ("a.npy", lambda: right().codes, "array: expected linear floats, 1 for full intensity.*whole numbers up to"),
    ("a.exr", lambda: with_value(right().linear, np.nan), "channels: .*found NaN or infinity in 1 of 2,304 pixels"),
    ("a.npy", lambda: with_value(right().codes.astype(int), 256), r"integers from 0 to 255, found \d+ to 256"),
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


def test_sizes_and_settings_that_cannot_be_right(tmp_path):
    with pytest.raises(InputError, match="expected one sample"):
        right_of(course((8, 8)), samples=4)
    with pytest.raises(InputError, match="rows and columns exchanged"):
        grade.grade(written(tmp_path / "turned.png", np.zeros((12, 9, 3))), right_of(course((12, 9))))
    for name in ("a.npy", "a.png", "a.exr"):
        with pytest.raises(InputError, match=r"size: expected 48 x 48 pixels, .*\(--resolution\), found 5 x 4"):
            grade.grade(written(tmp_path / name, np.zeros((4, 5, 3))), right())


@pytest.mark.long
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
    assert all(line.startswith(f"{name}: {differ}") for name, line in zip("bcd", lines[1:4], strict=True))
    assert [line.partition(";")[2] for line in lines[1:4]] == [
        " upside down (removes 100 %)",
        " no mistake explains it",
        " no mistake explains it; nearest: upside down (removes 20 %)",
    ]
    assert lines[0] == "a: right within 1/255"
    assert lines[4:] == [
        "e: not graded: image: expected an image",
        "5 submissions: 1 right within 1/255, 3 not right (1 explained), 1 not graded",
    ]


def test_cells_that_a_spreadsheet_takes_for_formulas_begin_with_an_apostrophe():
    names = ["=1+1.png", "+a.png", "-a.png", "@a.png", "\ta.png", "a=1.png"]
    rows = list(csv.DictReader(io.StringIO(tables.csv([{"image": name, "error": "-1 found"} for name in names]))))
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


GIVEN = ("course", "--resolution", f"{SIZE},{SIZE}")


@pytest.mark.long
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
