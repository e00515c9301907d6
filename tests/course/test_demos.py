"""demos/demo.py and demos/demotmap.py, run as users run them."""

from __future__ import annotations

import os
import re
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
from clshade.images import exr, png
from clshade.images import marks as sheet
from clshade.images.tonemap import tonemap
from clshade.scene.builtin.scenes import builtin

DEMOS = Path(__file__).resolve().parents[2] / "demos"


def run(script: str, folder: Path, *words: str) -> subprocess.CompletedProcess:
    """Run a demo in a folder; it uses its own checkout, whatever is installed."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, str(DEMOS / script), *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def read(folder: Path) -> dict[int, np.ndarray]:
    """Return the figures' EXRs by number, (M, N, 3) float64; check that each PNG is its EXR, clamped."""
    figures = {}
    for path in sorted(folder.glob("figure*.exr")):
        channels, header = exr.read(path)
        image = np.stack([channels[name] for name in "RGB"], axis=2)
        assert np.array_equal(png.read(path.with_suffix(".png")), tonemap(image, "none"))
        assert header["renderTimeSeconds"] > 0.0
        number = int(re.fullmatch(r"figure(\d\d)-.*", path.stem)[1])
        figures[number] = image.astype(np.float64)
    return figures


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
    """Run both demos on the files in the current folder; return the folder."""
    folder = tmp_path_factory.mktemp("out")
    for script in ("demo.py", "demotmap.py"):
        done = run(script, saved_course, "--out", str(folder))
        assert done.returncode == 0, done.stderr
        assert "h3" in done.stderr  # the progress bar
        assert "100%" in done.stderr
    return folder


@pytest.mark.long
def test_all_figures_are_written(drawn):
    names = sorted(path.name for path in drawn.iterdir())
    assert [int(name[6:8]) for name in names if name.endswith(".exr")] == list(range(1, 20))
    assert sum(name.endswith(".png") for name in names) == 19 + 2
    assert "figure06-gouraud-light-2-only.exr" in names
    assert "figure11-phong-specular-only.png" in names
    assert "figure19-nolight-map.exr" in names
    assert all(image.shape == (64, 80, 3) for image in read(drawn).values())


@pytest.mark.long
@pytest.mark.parametrize("first", [1, 9])
def test_the_figures_show_the_lights(drawn, first):
    figure = read(drawn)
    one, two, three, all_terms = (figure[first + k] for k in range(4))
    red = figure[first + 5] - one
    assert (red[..., 1:] == 0.0).all()
    assert red[..., 0].max() > 0.1
    total = figure[first + 4] + figure[first + 5] + figure[first + 6] - 2.0 * one
    ulp = np.spacing(figure[first + 7].astype(np.float32)).astype(np.float64)
    assert (np.abs(total - figure[first + 7]) <= 8.0 * ulp).all()
    assert (figure[first + 7] == all_terms).all()
    covered = (two != 1.0).any(axis=2)
    assert np.allclose((one + two + three)[covered], all_terms[covered], rtol=1e-6)


@pytest.mark.long
def test_the_figures_are_render_object(drawn, saved_course):
    scene = clshade.load(saved_course / "h3.npy")
    figure = read(drawn)
    for number, shader in ((8, "gouraud"), (16, "phong")):
        image = course.render_object(**reference.scene_arguments(scene, shader=shader))
        assert (figure[number][::-1] == image).all()
    texels = np.asarray(Image.open(saved_course / "cat_diff.png"))
    for number, shader in ((17, "gouraud"), (18, "phong"), (19, "nolight")):
        image = course.render_object_map(**reference.map_arguments(scene, texels, shader=shader))
        assert (figure[number][::-1] == image).all()
    assert not (figure[19] == figure[18]).all()


@pytest.mark.long
@pytest.mark.parametrize(("name", "panels"), [("demo.png", 20), ("demotmap.png", 4)])
def test_the_sheets_show_every_figure(drawn, name, panels):
    """Each panel holds its figure, reduced, with dark text below."""
    picture, layout = png.read(drawn / name).astype(float), sheet.Layout()
    height = layout.panel * 64 // 80
    step = height + layout.title + layout.caption
    assert picture.shape == (layout.head + step * (panels // 4), (layout.panel + layout.gap) * 4, 3)
    first = 1 if name == "demo.png" else 17
    files = sorted(drawn.glob("figure*.png"))
    for k in range(panels):
        x, y = (k % 4 * (layout.panel + layout.gap) + layout.gap // 2, layout.head + k // 4 * step + layout.title)
        shown = picture[y : y + height, x : x + layout.panel]
        assert picture[y + height + 2 : y + height + layout.caption, x : x + layout.panel].min() < 128.0
        assert picture[y - layout.title : y - 2, x : x + layout.panel].min() < 128.0
        path = next((f for f in files if f.name.startswith(f"figure{first + k:02d}")), None)
        if path is not None and (name == "demo.png") == (first + k < 17):
            assert np.array_equal(shown, sheet.reduced(png.read(path)))


@pytest.mark.long
def test_without_files_the_built_in_scene_is_drawn(tmp_path):
    done = run("demotmap.py", tmp_path, "--resolution", "48,40")
    assert done.returncode == 0, done.stderr
    figure = read(tmp_path)
    assert sorted(figure) == [17, 18, 19]
    assert figure[17].shape == (40, 48, 3)
    assert (figure[19] != 1.0).any(axis=2).mean() > 0.05


@pytest.mark.long
def test_outside_of_a_checkout(tmp_path, saved_course):
    """Copied elsewhere, a demo uses the installed clshade (here: the one on the path)."""
    (tmp_path / "demo.py").write_text((DEMOS / "demo.py").read_text())
    environment = {**os.environ, "PYTHONPATH": str(DEMOS.parent)}
    command = [sys.executable, str(tmp_path / "demo.py"), "--scene", str(saved_course / "h3.npy"), "--out", "made"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "made").glob("*.png"))) == 17


@pytest.mark.sampled
@pytest.mark.parametrize("script", ["demo.py", "demotmap.py"])
def test_help(script, tmp_path):
    done = run(script, tmp_path, "--help")
    assert done.returncode == 0
    for option in ("--scene", "--texture", "--out", "--resolution", "--device"):
        assert option in done.stdout


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("script", "words", "part"),
    [
        ("demo.py", ("--scene", "missing.npy"), "missing.npy"),
        ("demo.py", ("--resolution", "12"), "--resolution: expected two whole numbers"),
        ("demo.py", ("--resolution", "0,5"), "resolution"),
        ("demo.py", ("--out", "h3.npy"), "--out: expected a folder"),
        ("demo.py", ("--device", "no such device"), "no OpenCL device matches"),
        ("demotmap.py", ("--texture", "missing.png"), "missing.png"),
        ("demotmap.py", ("--texture", "h3.npy"), "h3.npy"),
    ],
)
def test_bad_input_is_one_line(saved_course, script, words, part):
    done = run(script, saved_course, *words)
    assert done.returncode == 2
    lines = [line for line in without_notices(done.stderr) if "figure/s" not in line]
    assert len(lines) == 1, done.stderr
    assert part in lines[0]
    assert lines[0].startswith(f"{script}: ")


@pytest.mark.long
def test_a_sheet_that_cannot_be_written_is_one_line(saved_course, tmp_path):
    (tmp_path / "demotmap.png").mkdir()
    done = run("demotmap.py", saved_course, "--out", str(tmp_path))
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "demotmap.png" in done.stderr.splitlines()[-1]


def test_a_map_needs_a_texture(saved_course, tmp_path):
    done = run("demotmap.py", tmp_path, "--scene", str(saved_course / "h3.npy"))
    assert done.returncode == 2
    assert "--texture: expected an image" in done.stderr


@pytest.mark.long
def test_the_gallery(opened, tmp_path):
    """Eight panels with different colors; the image in the README has the same size."""
    done = run("gallery.py", tmp_path, "--out", "new/folder")
    assert done.returncode == 0, done.stderr
    sheet = png.read(tmp_path / "new" / "folder" / "gallery.png")
    assert sheet.shape == png.read(DEMOS / "gallery.png").shape
    rows, columns = sheet.shape[:2]
    panels = [sheet[i * rows // 2 :, j * columns // 4 :][60:200, 20:250] for i in range(2) for j in range(4)]
    means = np.array([panel.mean(axis=(0, 1)) for panel in panels])
    apart = np.abs(means[:, None] - means[None]).max(axis=2)
    assert (apart + 255 * np.eye(8)).min() > 2.0
    assert min(len(np.unique(panel.reshape(-1, 3), axis=0)) for panel in panels) >= 5


@pytest.mark.long
def test_times_to_a_picture(opened, tmp_path):
    done = run("first_picture.py", tmp_path, "quads", "--rounds", "1")
    assert done.returncode == 0, done.stderr
    name, *columns = done.stdout.split()
    assert (name, columns[::2]) == ("quads", ["cold", "next", "warm", "png"])
    assert all(0.1 < float(value) < 300.0 for value in columns[1::2])


@pytest.mark.long
def test_views_as_tensors(opened, tmp_path):
    """Of the libraries that are installed none copies."""
    done = run("tensors.py", tmp_path, "--views", "5", "--out", "new")
    assert done.returncode == 0, done.stderr
    assert np.load(tmp_path / "new" / "rgba.npy").shape == (5, 120, 160, 4)
    assert np.load(tmp_path / "new" / "id.npy").any()
    wrote, *rest = done.stdout.splitlines()
    assert wrote == "wrote 5 views: rgba.npy, Z.npy, id.npy"
    assert rest[0] == "numpy: shares the memory of rgba, Z, id"
    assert [line.split(": ")[1] in ("not installed", "shares the memory of rgba, Z, id") for line in rest] == 3 * [True]


@pytest.mark.sampled
@pytest.mark.parametrize("script", ["gallery.py", "gltf_gallery.py", "tensors.py"])
def test_a_gallery_where_it_cannot_be_written(tmp_path, script):
    (tmp_path / "file").write_text("")
    done = run(script, tmp_path, "--out", "file")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"{script}: file")
    assert done.stderr.count("\n") == 1


def test_models_that_are_missing(tmp_path):
    done = run("gltf_published.py", tmp_path, "--models", "none")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("gltf_published.py: none")
    assert done.stderr.count("\n") == 1


@pytest.mark.long
def test_models_beside_their_published_pictures(opened, data_folder, tmp_path):
    """The helmet's silhouette is that of the published picture: it agrees to 99.4 %."""
    done = run("gltf_published.py", tmp_path, "--models", str(data_folder / "gltf"))
    assert done.returncode == 0, done.stderr
    picture = png.read(tmp_path / "gltf_published.png").astype(int)
    rows = (picture.shape[0] - 40) // 2
    ours, theirs = (picture[top : top + 600, 10:630] for top in (70, 70 + rows))
    masks = [np.abs(panel - panel[5, 5]).max(axis=2) > 8 for panel in (ours, theirs)]
    left, right = ([np.maximum.accumulate(mask[:, ::step], axis=1)[:, ::step] for mask in masks] for step in (1, -1))
    spans = [a & b for a, b in zip(left, right, strict=True)]  # of the rows: some of its grays are the background's
    assert (spans[0] & spans[1]).sum() > 0.98 * (spans[0] | spans[1]).sum()
