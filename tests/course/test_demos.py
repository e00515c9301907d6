"""The figures of the course, which of them a scene can show; the demos that draw them, run as users run them."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import course_reference as reference
import numpy as np
import pytest
from command_line import without_notices
from PIL import Image

import clshade
from clshade import course
from clshade.course import figures
from clshade.images import exr, marks, png
from clshade.images.tonemap import tonemap
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Material, PointLight

DEMOS = Path(__file__).resolve().parents[2] / "demos"


def lit_scene(lights=3, **changes):
    course = builtin("course", level=2, resolution=(8, 6))
    light = PointLight(np.zeros(3), np.ones(3))
    return replace(course, lights=(*course.lights, light, light)[:lights], **changes)


def test_what_each_figure_shows():
    every, stems = (0, 1, 2), [figure.stem for figure in figures.lit() + figures.mapped()]
    assert stems[5::13] == ["figure06-gouraud-light-2-only", "figure19-nolight-map"]
    for first, shader in ((0, "gouraud"), (8, "phong")):
        for k, figure in enumerate(figures.lit()[first : first + 8]):
            assert figure.shader == shader
            assert figure.terms == ((figures.TERMS[k],) if k < 3 else figures.TERMS)
            assert figure.lights == ((k - 4,) if 4 <= k < 7 else every)
            assert not figure.mapped
    assert all(figure.mapped and figure.lights == every for figure in figures.mapped())
    assert [(a.number, b.number) for a, b in figures.pairs(figures.lit())] == [(1, 9), (2, 10), (3, 11), (4, 12)]
    assert [(a.number, b.number) for a, b in figures.pairs(figures.mapped())] == [(17, 18)]


FULL = lit_scene()
MESH = FULL.meshes[0]
BARE = replace(FULL, meshes=(replace(MESH, material=Material()),))
UNMAPPED = replace(FULL, meshes=(replace(MESH, uvs=None, uv_faces=None),))


@pytest.mark.parametrize(
    ("one", "missing"),
    [
        (FULL, {}),
        (lit_scene(1), {"the scene has 1 light": (6, 7, 14, 15)}),
        (BARE, {"the scene has no texture": (17, 18, 19)}),
        (UNMAPPED, {"the scene has no texture coordinates": (17, 18, 19)}),
    ],
)
def test_figures_that_a_scene_cannot_show_are_named(one, missing):
    drawn, left_out = figures.possible(one)
    assert left_out == missing
    rest = [number for group in missing.values() for number in group]
    assert sorted([*(figure.number for figure in drawn), *rest]) == list(range(1, 20))


# Demos


def run(script: str, folder: Path, *words: str, code: int = 0, **variables: str) -> subprocess.CompletedProcess:
    """Run a demo in a folder; it uses its own checkout, whatever is installed. code: with which it ends."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | variables
    command = [sys.executable, str(DEMOS / script), *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == code, done.stderr
    return done


def read(folder: Path) -> dict[int, np.ndarray]:
    """Return the figures' EXRs by number, (M, N, 3) float64; check that each PNG is its EXR, clamped."""
    images = {}
    for path in sorted(folder.glob("figure*.exr")):
        channels, header = exr.read(path)
        image = np.stack([channels[name] for name in "RGB"], axis=2)
        assert np.array_equal(png.read(path.with_suffix(".png")), tonemap(image, "none"))
        assert header["renderTimeSeconds"] > 0.0
        images[int(re.fullmatch(r"figure(\d\d)-.*", path.stem)[1])] = image.astype(np.float64)
    return images


@pytest.fixture(scope="module")
def saved_course(tmp_path_factory) -> Path:
    """Return a folder with a smaller built-in scene as h3.npy, and a texture as cat_diff.png."""
    folder = tmp_path_factory.mktemp("course")
    scene = builtin("course", level=3, resolution=(80, 64))
    texture = scene.meshes[0].material.texture
    mesh = scene.meshes[0]
    plain = clshade.Mesh(mesh.verts, mesh.faces, mesh.colors, uvs=mesh.uvs, uv_faces=mesh.uv_faces)
    bare = replace(plain, material=replace(mesh.material, texture=None))
    course.save(replace(scene, meshes=(bare,)), folder / "h3.npy")
    png.write(folder / "cat_diff.png", tonemap(texture.image, "none"))
    return folder


@pytest.fixture(scope="module")
def drawn(saved_course, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    for script in ("demo.py", "demotmap.py"):
        done = run(script, saved_course, "--out", str(folder))
        assert "h3" in done.stderr  # the progress bar
        assert "100%" in done.stderr
    return folder


@pytest.mark.long
def test_all_figures_are_written_and_are_render_object(drawn, saved_course):
    names = sorted(path.name for path in drawn.iterdir())
    assert sum(name.endswith(".png") for name in names) == 19 + 2
    assert "figure06-gouraud-light-2-only.exr" in names
    assert "figure19-nolight-map.png" in names
    scene, figure = clshade.load(saved_course / "h3.npy"), read(drawn)
    assert sorted(figure) == list(range(1, 20))
    assert all(image.shape == (64, 80, 3) for image in figure.values())
    texels = np.asarray(Image.open(saved_course / "cat_diff.png"))
    for number, shader in ((8, "gouraud"), (16, "phong"), (17, "gouraud"), (18, "phong"), (19, "nolight")):
        if number < 17:
            image = course.render_object(**reference.scene_arguments(scene, shader=shader))
        else:
            image = course.render_object_map(**reference.map_arguments(scene, texels, shader=shader))
        assert (figure[number][::-1] == image).all()


@pytest.mark.long
@pytest.mark.parametrize(("name", "shown", "rows"), [("demo.png", range(1, 17), 5), ("demotmap.png", range(17, 20), 1)])
def test_the_sheets_show_every_figure(drawn, name, shown, rows):
    """Each panel holds its figure, reduced, with dark text above and below."""
    picture, layout = png.read(drawn / name), marks.Layout()
    height = layout.panel * 64 // 80
    step = height + layout.title + layout.caption
    assert picture.shape == (layout.head + step * rows, (layout.panel + layout.gap) * 4, 3)
    for k, number in enumerate(shown):
        x, y = (k % 4 * (layout.panel + layout.gap) + layout.gap // 2, layout.head + k // 4 * step + layout.title)
        columns = slice(x, x + layout.panel)
        assert picture[y + height + 2 : y + height + layout.caption, columns].min() < 128
        assert picture[y - layout.title : y - 2, columns].min() < 128
        (path,) = drawn.glob(f"figure{number:02d}*.png")
        assert np.array_equal(picture[y : y + height, columns], marks.reduced(png.read(path)))


@pytest.mark.long
def test_without_files_and_outside_of_a_checkout(tmp_path):
    """The built-in scene is drawn; copied elsewhere, a demo uses the installed clshade (here: the one on the path)."""
    copy = shutil.copy(DEMOS / "demotmap.py", tmp_path)
    run(copy, tmp_path, "--resolution", "48,40", PYTHONPATH=str(DEMOS.parent))
    figure = read(tmp_path)
    assert sorted(figure) == [17, 18, 19]
    assert figure[17].shape == (40, 48, 3)
    assert (figure[19] != 1.0).any(axis=2).mean() > 0.05


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("script", "words", "part"),
    [
        ("demo.py", ("--scene", "missing.npy"), "missing.npy"),
        ("demo.py", ("--device", "no such device"), "no OpenCL device matches"),
        ("demotmap.py", ("--texture", "h3.npy"), "h3.npy"),
        ("gallery.py", ("--out", "h3.npy"), "h3.npy"),
        ("gltf_published.py", ("--models", "none"), "none"),
    ],
)
def test_bad_input_is_one_line(saved_course, script, words, part):
    done = run(script, saved_course, *words, code=2)
    assert done.stdout == ""
    lines = [line for line in without_notices(done.stderr) if "figure/s" not in line]
    assert len(lines) == 1, done.stderr
    assert part in lines[0]
    assert lines[0].startswith(f"{script}: ")


@pytest.mark.long
def test_the_gallery(opened, tmp_path):
    run("gallery.py", tmp_path, "--out", "new/folder")
    sheet = png.read(tmp_path / "new" / "folder" / "gallery.png")
    assert sheet.shape == png.read(DEMOS / "gallery.png").shape
    panels = [sheet[i * sheet.shape[0] // 2 :][60:200, 20:250] for i in range(2)]
    assert np.abs(panels[0].mean(axis=(0, 1)) - panels[1].mean(axis=(0, 1))).max() > 2.0


@pytest.mark.long
def test_the_page_of_figures(opened, tmp_path):
    run("figures.py", tmp_path, "quads", "--rounds", "1", "--only", "pictures")
    header, _, row = (tmp_path / "FIGURES.md").read_text().splitlines()[-3:]
    assert header == "| seconds | cold | next | warm | png |"
    name, *seconds = row.strip("| ").split(" | ")
    assert name == "quads"
    assert all(0.1 < float(value) < 300.0 for value in seconds)


@pytest.mark.long
def test_views_as_tensors(opened, tmp_path):
    """Of the libraries that are installed none copies."""
    done = run("tensors.py", tmp_path, "--views", "5", "--out", "new")
    assert np.load(tmp_path / "new" / "rgba.npy").shape == (5, 120, 160, 4)
    assert np.load(tmp_path / "new" / "id.npy").any()
    wrote, *rest = done.stdout.splitlines()
    assert wrote == "wrote 5 views: rgba.npy, Z.npy, id.npy"
    assert rest[0] == "numpy: shares the memory of rgba, Z, id"
    assert [line.split(": ")[1] in ("not installed", "shares the memory of rgba, Z, id") for line in rest] == 3 * [True]


@pytest.mark.long
def test_models_beside_their_published_pictures(opened, data_folder, tmp_path):
    """The helmet's silhouette is that of the published picture: it agrees to 99.4 %."""
    run("gltf_published.py", tmp_path, "--models", str(data_folder / "gltf"))
    picture = png.read(tmp_path / "gltf_published.png").astype(int)
    ours, theirs = (picture[top : top + 600, 10:630] for top in (70, picture.shape[0] // 2 + 50))
    masks = [np.abs(panel - panel[5, 5]).max(axis=2) > 8 for panel in (ours, theirs)]
    left, right = ([np.maximum.accumulate(mask[:, ::step], axis=1)[:, ::step] for mask in masks] for step in (1, -1))
    spans = [a & b for a, b in zip(left, right, strict=True)]  # of the rows: some of its grays are the background's
    assert (spans[0] & spans[1]).sum() > 0.98 * (spans[0] | spans[1]).sum()
