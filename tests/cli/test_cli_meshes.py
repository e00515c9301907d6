"""The command line's options for mesh files, and its messages for slow files and for contents that are not rendered."""

from __future__ import annotations

import json
import time
import warnings

import numpy as np
import pytest
from command_line import needs_device, run, scene_of
from mesh_writers import triangle
from scene_files import DATA, ROOF, TRIANGLE, write

from clshade.base import console
from clshade.cli import DONE, render
from clshade.cli.scene import load_scene
from clshade.images import exr
from clshade.scene import framing
from clshade.scene.formats import load
from clshade.scene.geometry import vertex_normals


def test_creases(tmp_path):
    path = write(tmp_path / "roof.obj", ROOF)
    assert scene_of(path).meshes[0].normals is None
    for options, count in (("--crease 30", 4), ("--crease 10", 6), ("--crease 0", 2), ("--flat", 2)):
        assert len(scene_of(path, *options.split()).meshes[0].normals) == count, options


SEAM = "v 0 0 0\nv 0 1 0\nv -1 0 0\nv 0 0 0\nv 0 1 0\nv 0.9 0 -0.3\nf 1 2 3\nf 5 4 6\n"  # the roof in two pieces


def test_seams_are_joined(tmp_path):
    path, roof = write(tmp_path / "seam.obj", SEAM), write(tmp_path / "whole.obj", ROOF)
    joined, apart = (scene_of(path, *options).meshes[0].normals for options in ((), ("--no-weld",)))
    (together, _) = scene_of(roof).meshes  # the last is the ground
    np.testing.assert_allclose(joined[[0, 1, 2, 5]], vertex_normals(together.verts, together.faces), atol=1e-15)
    assert (joined[3:5] == joined[:2]).all()
    assert apart is None
    assert load.load(path).meshes[0].normals is None


@pytest.mark.parametrize(
    ("low", "high", "up", "likely"),
    [
        ((-120, -173, -252), (120, 180, 233), "y", "z"),  # a bust, about 0
        ((-1, -0.4, 0), (1, 0.4, 3), "y", "z"),  # a person on z = 0
        ((-0.2, -0.17, -0.5), (0.2, 0.17, 0.5), "y", None),  # a car lies
        ((-0.5, -0.7, -0.7), (0.5, 1.0, 1.1), "y", None),
        ((-3, 0, -2), (3, 3, 2), "y", None),
        ((-1, 0, -1), (1, 3, 1), "z", "y"),
        ((-1, -1, 0), (1, 1, 0.05), "y", None),  # a relief
        ((-1, 0, 0), (1, 3, 1), "z", None),
        ((0, 0, 0), (0, 0, 0), "y", None),
        ((-1, -1, 0), (1, 1, 1), "x", None),
    ],
)
def test_the_likely_up(low, high, up, likely):
    assert framing.likely_up(np.array(low, float), np.array(high, float), up) == likely


def test_another_up_is_told_of(tmp_path, capsys):
    path = write(tmp_path / "tall.obj", "v 0 -1 0\nv 1 1 0\nv -1 1 3\nf 1 2 3\n")
    line = "tall.obj: y is up, but its extents suggest z: --up z shows it so"
    for options, warned in (
        ((), True),
        (("--up", "z"), False),
        (("--up", "y"), False),
        (("--camera-view-up", "1,0,0"), False),
    ):
        scene_of(path, *options)
        assert (line in capsys.readouterr().err) is warned


@pytest.mark.parametrize("up", framing.UPS)
@pytest.mark.parametrize("form", ["--up={}", "--up {}"])
def test_up(tmp_path, up, form):
    scene = scene_of(write(tmp_path / "a.obj", ROOF), *form.format(up).split())
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up[0] == "-" else 1.0
    assert scene.camera.up.tolist() == axis.tolist()
    assert (scene.camera.eye - scene.camera.lookat) @ axis > 0  # from above
    assert (scene.lights[0].position - scene.camera.lookat) @ axis > 0


def test_the_views_of_all_axes_are_rotations_of_one():
    for axes in framing.UPS.values():
        assert np.linalg.det(np.array(axes)) == 1.0
        assert np.array_equal(np.cross(axes[0], axes[1]), axes[2])


def test_two_sided(tmp_path):
    path = triangle().glb(tmp_path / "a.glb")
    for options, two_sided, sides in (
        ([], False, "front"),
        (["--two-sided"], True, "both"),
        (["--no-two-sided"], False, "front"),
    ):
        material = scene_of(path, *options).meshes[0].material
        assert (material.two_sided, material.sides) == (two_sided, sides)
    is_open = write(tmp_path / "a.obj", ROOF)
    assert [scene_of(is_open, *o).meshes[0].material.two_sided for o in ([], ["--no-two-sided"])] == [True, False]


@pytest.mark.parametrize("resolution", ["200,800", "800,200"])
def test_a_mesh_fits_into_an_image_of_any_shape(tmp_path, resolution):
    path = write(tmp_path / "a.obj", ROOF)
    wanted = tuple(map(int, resolution.split(",")))
    camera = scene_of(path, "--resolution", resolution).camera
    assert camera.resolution == wanted
    assert camera.eye.tolist() == load.load(path, resolution=wanted).camera.eye.tolist()


def test_values_that_begin_with_a_dash(tmp_path):
    path = write(tmp_path / "a.obj", ROOF)
    camera = scene_of(path, "--camera-position", "-1,-2,3", "--camera-focal-point", "-.5,0,0").camera
    assert (camera.eye.tolist(), camera.lookat.tolist()) == ([-1, -2, 3], [-0.5, 0, 0])


@pytest.mark.long
@needs_device
def test_what_is_not_rendered_is_one_line(tmp_path, capsys):
    document = triangle(material=0)
    document.add("materials", {"extensions": {"KHR_materials_clearcoat": {}, "KHR_materials_sheen": {}}})
    document.json["extensionsUsed"] = ["KHR_materials_clearcoat", "KHR_materials_sheen"]
    path = document.glb(tmp_path / "a.glb")
    small = ("render", path, "--resolution", "32,24", "-o", tmp_path / "out")
    code, out, err = run(capsys, *small)
    assert (code, err) == (0, [f"clshade: warning: {path}: not rendered: KHR_materials_clearcoat, KHR_materials_sheen"])
    assert "\nignored KHR_materials_clearcoat, KHR_materials_sheen\n" in out
    stats = json.loads(run(capsys, *small, "--stats")[1])
    assert stats["ignored"] == ["KHR_materials_clearcoat", "KHR_materials_sheen"]
    plain = run(capsys, "render", triangle().glb(tmp_path / "b.glb"), *small[2:])
    assert plain[2] == []
    assert "ignored" not in plain[1]


def test_warnings_are_lines_without_pythons_own(tmp_path, capsys, monkeypatch):
    path = write(tmp_path / "a.obj", "mtllib none.mtl\n" + TRIANGLE + "usemtl m\nf 1 2 3\n")
    monkeypatch.setattr(render, "run_render", lambda options: load_scene(options, options.scenes[0]) and DONE)
    code, _, err = run(capsys, "render", path)
    assert code == 0
    assert err == [
        f"clshade: warning: {path}: line 1: mtllib: there is no file 'none.mtl': drawn without it",
        f"clshade: warning: {path}: usemtl: no library defines the material 'm'",
    ]
    monkeypatch.setattr(render, "run_render", lambda arguments: warnings.warn("two\nlines", stacklevel=1))
    assert run(capsys, "render", path)[2] == ["clshade: warning: two lines"]


def test_a_slow_file_is_told(tmp_path, capsys, monkeypatch):
    path = write(tmp_path / "a.obj", ROOF)
    load.load(path)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(console, "SLOW", 0.01)
    monkeypatch.setattr("clshade.scene.formats.obj.read_obj", lambda path, options: time.sleep(0.3) or framing)
    assert load.load(path) is framing
    assert capsys.readouterr().err == f"clshade: loading {path} ...\n"


@needs_device
@pytest.mark.parametrize("mirror", [1, -1])
def test_a_mirrored_placement_shows_its_front(tmp_path, capsys, mirror):
    """A single-sided triangle under a mirroring node: its front stays its front, and is lit as before."""
    document = triangle()
    document.add("nodes", {"mesh": 0, "scale": [mirror, 1, 1]})
    path = document.glb(tmp_path / "a.glb")
    view = ("--camera-position", f"{mirror * 0.3},0.3,3", "--camera-focal-point", f"{mirror * 0.3},0.3,0")
    options = ("render", path, "--resolution", "32,32", "-o", tmp_path / "front", "--components", "ambient,diffuse")
    assert run(capsys, *options, *view)[0] == 0
    front, _ = exr.read(tmp_path / "front.exr")
    assert front["A"].sum() > 50
    assert front["R"][front["A"] == 1.0].min() > 0.11  # more than the ambient light
    behind = (*view[:1], f"{mirror * 0.3},0.3,-3", *view[2:])
    assert run(capsys, *options, *behind)[0] == 0
    assert not exr.read(tmp_path / "front.exr")[0]["A"].any()


# Scalars


def test_scalars_are_listed(tmp_path, capsys):
    path = write(tmp_path / "a.ply", DATA)
    code, out, _ = run(capsys, "inspect", path)
    assert code == DONE
    assert out.splitlines()[-1].split() == ["heat", "1", "vertices", "-1.5", "4", "1"]
    code, out, _ = run(capsys, "inspect", path, "--json")
    assert json.loads(out)["meshes"][0]["scalars"] == [
        {"name": "heat", "of": "vertices", "least": -1.5, "most": 4.0, "nan": 1}
    ]
    assert run(capsys, "inspect", write(tmp_path / "b.obj", ROOF))[1].splitlines()[-1] == "no scalars"


@pytest.mark.long
@needs_device
def test_scalars_are_rendered(tmp_path, capsys):
    path = write(tmp_path / "a.ply", DATA)
    options = ("--scalars", "heat", "--colormap", "black,#ff0000", "--clim=-2,2", "--nan-color", "yellow", "--colorbar")
    extra = ("--resolution", "40,30", "--layers", "scalar", "-o", tmp_path / "out")
    assert run(capsys, "render", path, *options, *extra, "--quiet") == (DONE, "", [])
    channels, header = exr.read(tmp_path / "out.exr")
    assert np.isnan(channels["scalar"]).all()  # a corner of the only face is NaN
    assert (header["scalarName"], header["scalarLow"], header["scalarHigh"]) == ("heat", -2, 2)
    lit = channels["A"] == 1.0  # not the edge, over the background
    assert (channels["R"][lit] > 0).all()
    assert (channels["B"][lit] == 0).all()
