"""Options as classes declare them; the scene and the settings that they make, or that are chosen without them; notices."""

import argparse
import json
import warnings
from dataclasses import fields

import numpy as np
import pytest
from command_line import needs_device, run, scene_of, settings_of
from mesh_writers import triangle
from scene_files import DATA, ROOF, course_dict, save_npy, write

import clshade
from clshade.cli import DONE, render
from clshade.cli.main import _parser
from clshade.cli.options import Arguments, Option, add_options
from clshade.images import exr
from clshade.scene import framing
from clshade.scene.builtin.scenes import builtin
from clshade.scene.formats import load
from clshade.scene.geometry import bounding_box, camera_axes, half_diagonal, vertex_normals
from clshade.scene.model import Scene, Settings
from clshade.scene.settings import LIGHT_FIELDS, PRESET_FIELDS, Edges

SQUARE = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n"
SEAM = "v 0 0 0\nv 0 1 0\nv -1 0 0\nv 0 0 0\nv 0 1 0\nv 0.9 0 -0.3\nf 1 2 3\nf 5 4 6\n"  # the roof in two pieces


@pytest.fixture(autouse=True)
def files(folder):
    """Write files of each kind; own.glb and own.json have a camera."""
    write(folder / "roof.obj", ROOF)
    write(folder / "square.obj", SQUARE)
    save_npy(folder / "course.npy", course_dict())
    exr.write(folder / "sky.exr", np.ones((2, 4, 3), np.float32))
    document = triangle()
    document.glb(folder / "plain.glb")
    document.add("nodes", {"mesh": 0})
    document.add("nodes", {"camera": 0, "translation": [0, 0, 9]})
    document.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0}})
    clshade.load(document.glb(folder / "own.glb")).to_json(folder / "own.json")


def normals(scene: Scene):
    return None if scene.meshes[0].normals is None else len(scene.meshes[0].normals)


def sides(scene: Scene):
    return scene.meshes[0].material.two_sided, scene.meshes[0].material.sides


def eye(scene: Scene):
    return scene.camera.eye.tolist()


def extent(scene: Scene):
    """Return the largest image coordinate of the vertices, 1 at the edge, to six digits."""
    chosen, verts = scene.camera, scene.meshes[0].verts
    x, y, z = camera_axes(chosen) @ (verts - chosen.eye).T
    depth = 1.0 if chosen.orthographic else z / chosen.focal
    return round(max(abs(x / depth).max() / chosen.plane[1], abs(y / depth).max() / chosen.plane[0]) * 2.0, 6)


def lights(scene: Scene):
    return len(scene.lights), scene.own_lights


def terms(scene: Scene):
    return [bool(getattr(scene.meshes[0].material, name).any()) for name in ("ka", "kd", "ks")]


def around(scene: Scene):
    environment = scene.environment
    return environment and (environment.rotation, environment.intensity, environment.up.tolist())


def look(scene: Scene):
    """Return the names of what was added to the mesh, and the preset."""
    return [mesh.name for mesh in scene.meshes[1:]], scene.preset


UP = [0, 1, 0]
FITTED = (
    *("--camera-elevation-angle 40 --orthographic", "--camera-view-up 0,0,1", "--fit --camera-view-angle 80"),
    *("--fit --camera-position 9,1,1", "--resolution 800,200", "--resolution 20,300 --camera-azimuth-angle -50"),
)
UNLIKE_STUDIO = (
    *("--look plain", "--shader gouraud", "--preset standard", "--environment none", "--shadows", "--lights 0"),
    *("--light-intensity 2", "--layers Z", "--formats png,depth", "--background none", "--sheet"),
)
SCENES = [
    (normals, "roof.obj", None),
    (normals, "roof.obj --crease 30", 4),
    (normals, "roof.obj --flat", 2),
    (sides, "plain.glb", (False, "front")),
    (sides, "plain.glb --two-sided", (True, "both")),
    (sides, "roof.obj --no-two-sided", (False, "both")),
    # Cameras: without one of the file's that is asked for, all of the scene is shown.
    (eye, "square.obj --fit --camera-position -1,0,9 --camera-focal-point 0,0,1", [-1, 0, 9]),
    (eye, "own.glb --camera file", [0, 0, 9]),
    (eye, "own.json", [0, 0, 9]),
    *((extent, f"square.obj {options}", framing.FILL) for options in FITTED),
    *((extent, f"own.glb {options}", framing.FILL) for options in ("", "--camera fit", "--camera-azimuth-angle 99")),
    (extent, "icosphere --fit", framing.FILL),
    (lights, "quads", (2, True)),
    (lambda scene: scene.lights[0].position.tolist(), "quads --lights 1", builtin("quads").lights[1].position.tolist()),
    (terms, "quads --components ambient,specular", [True, False, True]),
    (lights, "roof.obj", (3, False)),
    (lights, "roof.obj --lights 0", (1, True)),
    (lights, "roof.obj --environment none", (3, True)),
    *(
        (lambda scene: len(scene.lights), f"own.glb --light-intensity 1,2,0 {options}", 3)
        for options in ("--preset standard", "--shader phong", "--environment none", "--lights 0,1,2")
    ),
    (around, "teapot --environment studio --environment-rotation 30 --environment-intensity 2", (30.0, 2.0, UP)),
    (around, "roof.obj --environment-intensity 2", (0.0, 2.0, UP)),
    (around, "roof.obj --environment sky.exr --up z", (0.0, 1.0, [0, 0, 1])),
    (around, "roof.obj --environment none", None),
    (lambda scene: scene.preset, "teapot --environment studio --preset standard", "standard"),
    (lambda scene: scene.preset, "teapot --environment studio --shader phong", "standard"),
    # A mesh without lights is shown in the studio, unless options say otherwise.
    (look, "square.obj", (["ground"], "pbr")),
    (lambda scene: scene.meshes[-1].material.texture.name, "square.obj", "contact shadow"),
    (look, "icosphere --look studio", (["ground"], "pbr")),
    (look, "course.npy", ([], "course")),
    (look, "square.obj --look course", ([], "course")),
    (look, "square.obj --look studio --edges all", ([], "pbr")),
    *((look, f"square.obj {options}", ([], "standard")) for options in UNLIKE_STUDIO),
    (lambda scene: scene.meshes[-1].normals.tolist(), "own.glb --ground --up -x", [[-1, 0, 0]]),
]


@pytest.mark.parametrize(("part", "command", "expected"), SCENES, ids=[f"{row[0].__name__} {row[1]}" for row in SCENES])
def test_options_reach_the_scene(part, command, expected):
    assert part(scene_of(*command.split())) == expected


def test_seams_are_joined(folder):
    path = write(folder / "seam.obj", SEAM)
    joined, apart = (scene_of(path, *options).meshes[0].normals for options in ((), ("--no-weld",)))
    (together, _) = scene_of("roof.obj").meshes  # the last is the ground
    np.testing.assert_allclose(joined[[0, 1, 2, 5]], vertex_normals(together.verts, together.faces), atol=1e-15)
    assert (joined[3:5] == joined[:2]).all()
    assert apart is None
    assert load.load(path).meshes[0].normals is None


@pytest.mark.parametrize("up", framing.UPS)
def test_up(up):
    scene = scene_of("roof.obj", "--up", up)
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up[0] == "-" else 1.0
    assert scene.camera.up.tolist() == axis.tolist()
    assert (scene.camera.eye - scene.camera.lookat) @ axis > 0  # from above
    assert (scene.lights[0].position - scene.camera.lookat) @ axis > 0
    axes = framing.UPS[up]  # the views are rotations of one
    assert np.linalg.det(np.array(axes)) == 1.0
    assert np.array_equal(np.cross(axes[0], axes[1]), axes[2])


@pytest.mark.parametrize(("low", "high", "up", "likely"), [
    ((-120, -173, -252), (120, 180, 233), "y", "z"),  # a bust, about 0
    ((-1, -0.4, 0), (1, 0.4, 3), "y", "z"),  # a person on z = 0
    ((-0.2, -0.17, -0.5), (0.2, 0.17, 0.5), "y", None),  # a car lies
    ((-1, 0, -1), (1, 3, 1), "z", "y"),
    ((-1, -1, 0), (1, 1, 0.05), "y", None),  # a relief
    ((0, 0, 0), (0, 0, 0), "y", None),
    ((-1, -1, 0), (1, 1, 1), "x", None),
])  # fmt: skip
def test_the_likely_up(low, high, up, likely):
    assert framing.likely_up(np.array(low, float), np.array(high, float), up) == likely


OPEN = {"ambient_occlusion": 16, "sample_shading": True}
EDGES = "quads --edges all --edge-angle 45 --edge-width 2 --edge-color 1,0.5,0 --edges-only"
SETTINGS = [
    # Four samples for pictures but those of the course
    ("square.obj", {"samples": 4}),
    *((command, {"samples": 1}) for command in ("square.obj --samples 1", "square.obj --preset course", "course.npy")),
    ("course.npy --samples 3", {"samples": 3}),
    # Under a rectangle light shadows are soft; pictures of textures and shadows light each sample, and what an environment
    # lights has shadows by ambient occlusion.
    ("box_room", {"shadows": True, "sample_shading": True}),
    ("box_room --no-shadows", {"shadows": False}),
    *((command, {}) for command in ("box_room --preset course", "box_room --lights 1")),
    ("teapot", {"sample_shading": True}),
    ("teapot --no-sample-shading", {"sample_shading": False}),
    ("icosphere --preset pbr", {"sample_shading": True}),  # which has shadows
    ("icosphere --look studio", {}),
    ("icosphere --look studio --shadows", {"shadows": True, **OPEN}),
    ("icosphere --ambient-occlusion 16", OPEN),
    ("icosphere --ambient-occlusion 0", {"ambient_occlusion": 0}),
    ("quads --edges silhouette,feature", {"edges": Edges(("feature", "silhouette"))}),
    (EDGES, {"edges": Edges("all", angle=45, width=2, color=(1, 0.5, 0), only=True)}),
]


@pytest.mark.parametrize(("command", "expected"), SETTINGS)
def test_settings_of_pictures(command, expected):
    settings = settings_of(*command.split())
    samples = settings.pop("samples")
    assert ({"samples": samples} if "samples" in expected else settings) == expected


TOLD = "own.json: the camera is the file's own: --fit chooses one that shows all of the scene"
SUGGESTED = "tall.obj: y is up, but its extents suggest z: --up z shows it so"


@pytest.mark.parametrize(("command", "line"), [
    ("own.json", TOLD),
    ("tall.obj", SUGGESTED),
    *((quiet, "") for quiet in ("own.json --camera file", "tall.obj --up y", "course", "own.glb", "square.obj")),
])  # fmt: skip
def test_what_is_chosen_is_told(folder, capsys, command, line):
    write(folder / "tall.obj", "v 0 -1 0\nv 1 1 0\nv -1 1 3\nf 1 2 3\n")
    scene_of(*command.split())
    told = capsys.readouterr().err.rstrip()
    assert told.endswith(line) if line else told == ""


def test_warnings_are_lines_without_pythons_own(capsys, monkeypatch):
    monkeypatch.setattr(render, "run_render", lambda arguments: warnings.warn("two\nlines", stacklevel=1))
    assert run(capsys, "render", "roof.obj")[2] == ["clshade: warning: two lines"]


@needs_device
def test_a_mirrored_placement_shows_its_front(folder, capsys):
    document = triangle()
    document.add("nodes", {"mesh": 0, "scale": [-1, 1, 1]})
    document.glb(folder / "a.glb")
    for z, shown in ((3, True), (-3, False)):
        view = ("--camera-position", f"-0.3,0.3,{z}", "--camera-focal-point", "-0.3,0.3,0")
        code, _, err = run(capsys, "render", "a.glb", "--resolution", "32,32", "--preset", "course", *view)
        assert code == 0
        assert bool(exr.read("out.exr")[0]["A"].any()) is shown
        assert ["every triangle is seen from behind" in line for line in err] == [True] * (not shown)


def test_scalars_are_listed(folder, capsys):
    write(folder / "a.ply", DATA)
    code, out, _ = run(capsys, "inspect", "a.ply")
    assert (code, out.splitlines()[-1].split()) == (DONE, ["heat", "1", "vertices", "-1.5", "4", "1"])
    (mesh,) = json.loads(run(capsys, "inspect", "a.ply", "--json")[1])["meshes"]
    assert mesh["scalars"] == [{"name": "heat", "of": "vertices", "least": -1.5, "most": 4.0, "nan": 1}]
    assert run(capsys, "inspect", "roof.obj")[1].splitlines()[-1] == "no scalars"


@pytest.mark.long
@needs_device
def test_options_stand_in_the_header_where_they_are_set(folder, capsys):
    def drawn(scene: str, *options: str):
        code, out, err = run(capsys, "render", scene, *options, "--resolution", "48,36")
        assert code == 0, err
        return *exr.read("out.exr"), out

    assert "edges=Edges(kinds=('all',)" in drawn("quads", "--edges", "all")[1]["settings"]
    _, header, out = drawn("teapot", "--samples", "1", "--shadows", "--explain")
    assert "shadows=True" in header["settings"]
    assert "edges" not in header["settings"]
    assert "images: the same bits" in out
    header = drawn("icosphere", "--samples", "1", "--ambient-occlusion", "4", "--layers", "AO")[1]
    assert "ambient_occlusion=4" in header["settings"]
    assert f"ao_distance={0.4 * half_diagonal(*bounding_box(builtin('icosphere')))!r}" in header["settings"]
    write(folder / "a.ply", DATA)
    options = ("--scalars", "heat", "--colormap", "black,#ff0000", "--clim=-2,2", "--nan-color", "yellow", "--colorbar")
    channels, header, _ = drawn("a.ply", *options, "--layers", "scalar")
    assert np.isnan(channels["scalar"]).all()  # a corner of the only face is NaN
    assert (header["scalarName"], header["scalarLow"], header["scalarHigh"]) == ("heat", -2, 2)
    lit = channels["A"] == 1.0  # not the edge, over the background
    assert (channels["R"][lit] > 0).all()
    assert (channels["B"][lit] == 0).all()


class Fields:
    title = "some: of a test"
    path = Option("-o, --output FILE: where to: a file", default="out")
    size = Option("--size N: pixels", int, 3, either="size")
    full = Option("--full-size: all of them", either="size")
    lit = Option("--[no-]lit: with light (default: by day)")
    kind = Option("--kind fast|exact: of the arithmetic")
    names = Option("names NAME: of scenes", nargs="*")


def parsed(*arguments: str) -> Arguments:
    parser = argparse.ArgumentParser()
    add_options(parser, Fields)
    parser.set_defaults(parser=parser)
    return parser.parse_args(arguments, Arguments())


def test_options_that_are_set_are_keyword_arguments(capsys):
    assert parsed().keywords(Fields) == {"names": []}
    assert parsed("-o", "out", "--size", "3", "a").keywords(Fields) == {"names": ["a"]}
    keywords = parsed("--full-size", "--no-lit", "--kind", "exact", "-o", "x").keywords(Fields)
    assert keywords == {"path": "x", "full": True, "lit": False, "kind": "exact", "names": []}
    with pytest.raises(SystemExit):
        parsed("--size", "4", "--full-size")
    assert "not allowed with" in capsys.readouterr().err


def options_of(command: str) -> dict[str, argparse.Action]:
    return {action.dest: action for action in _parser([command]).parse_args([command, "teapot"]).parser._actions}


@pytest.mark.parametrize("command", ["render", "turntable", "stability", "poster"])
def test_each_setting_has_an_option(command):
    options = options_of(command)
    for field in fields(Settings):
        declared, option = field.metadata["declared"], options[field.name]
        if field.name == "edges":  # whose option is that of Edges.kinds
            declared = Edges.__dataclass_fields__["kinds"].metadata["declared"]
        assert option.help.startswith(declared.help)
        assert option.default is None
        assert option.metavar == declared.form
        assert tuple(option.choices or ()) == declared.choices


def test_flags_that_a_preset_or_pictures_set_can_be_taken_back():
    options = options_of("render")
    flags = {field.name for field in fields(Settings) if isinstance(field.default, bool)}
    assert {name for name in flags if len(options[name].option_strings) == 2} == {"shadows", "sample_shading"}
    assert flags & {name for changed in PRESET_FIELDS.values() for name in changed} == {"shadows"}


def test_a_report_takes_the_settings_of_light_alone():
    assert options_of("report").keys() & Settings.__dataclass_fields__.keys() == set(LIGHT_FIELDS)
