"""What the command line chooses for a picture that says nothing of it: the camera, and the samples."""

from __future__ import annotations

import pytest
from command_line import needs_device, run, scene_of, settings_of
from mesh_writers import triangle
from scene_files import course_dict, save_npy, write

import clshade
from clshade.errors import InputError
from clshade.images import exr
from clshade.scene.framing import FILL
from clshade.scene.geometry import camera_axes

SQUARE = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n"


@pytest.fixture
def square(tmp_path):
    return write(tmp_path / "square.obj", SQUARE)


@pytest.fixture
def camera_file(tmp_path):
    """A glTF file with a camera."""
    document = triangle()
    document.add("nodes", {"mesh": 0})
    document.add("nodes", {"camera": 0, "translation": [0, 0, 9]})
    document.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0}})
    return document.glb(tmp_path / "own.glb")


def extent(scene):
    """Return the largest image coordinate of the vertices, 1 at the edge."""
    camera, verts = scene.camera, scene.meshes[0].verts
    x, y, z = camera_axes(camera) @ (verts - camera.eye).T
    depth = 1.0 if camera.orthographic else z / camera.focal
    return max(abs(x / depth).max() / camera.plane[1], abs(y / depth).max() / camera.plane[0]) * 2.0


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--camera-azimuth-angle", "200"),
        ("--camera-elevation-angle", "40", "--orthographic"),
        ("--camera-view-up", "0,0,1"),
        ("--fit", "--camera-view-angle", "80"),
        ("--fit", "--camera-position", "9,1,1"),
        ("--resolution", "20,300", "--camera-azimuth-angle", "-50"),
    ],
)
def test_the_camera_of_a_mesh_shows_all_of_it_from_everywhere(square, options):
    assert extent(scene_of(square, *options)) == pytest.approx(FILL, rel=1e-9)


def test_a_placed_camera_stays(square):
    before = scene_of(square).camera
    zoomed = scene_of(square, "--camera-view-angle", "10").camera
    assert zoomed.eye.tolist() == before.eye.tolist()
    placed = scene_of(square, "--fit", "--camera-position", "0,0,9", "--camera-focal-point", "0,0,1").camera
    assert placed.eye.tolist() == [0, 0, 9]


def test_a_files_own_camera_is_used_where_it_is_asked_for(camera_file, square, capsys):
    assert scene_of(camera_file, "--camera", "file").camera.eye.tolist() == [0, 0, 9]
    assert clshade.load(camera_file).camera.eye.tolist() == [0, 0, 9]
    for arguments in (
        (camera_file,),
        (camera_file, "--fit"),
        (camera_file, "--camera-position", "1,2,3"),
        (square,),
        ("course",),
        ("icosphere",),
    ):
        scene_of(*arguments)
        assert capsys.readouterr().err == ""
    for options in ((), ("--fit",), ("--camera", "fit"), ("--camera-azimuth-angle", "100")):
        assert extent(scene_of(camera_file, *options)) == pytest.approx(FILL, rel=1e-6)
    for scene, message in (
        (square, "expected a .*file that has one, found none in "),
        ("icosphere", "file needs a scene file"),
    ):
        with pytest.raises(InputError, match=f"--camera: {message}"):
            scene_of(scene, "--camera", "file")


def test_the_camera_of_a_saved_scene_stays_and_is_named(camera_file, tmp_path, capsys):
    clshade.load(camera_file).to_json(tmp_path / "own.json")
    assert scene_of(tmp_path / "own.json").camera.eye.tolist() == [0, 0, 9]
    line = "own.json: the camera is the file's own: --fit chooses one that shows all of the scene"
    assert capsys.readouterr().err.rstrip().endswith(line)
    scene_of(tmp_path / "own.json", "--camera", "file")
    assert capsys.readouterr().err == ""
    assert not scene_of("icosphere").fitted
    assert extent(scene_of("icosphere", "--fit")) == pytest.approx(FILL, rel=1e-6)


def test_the_ground_lies_below_what_up_says(camera_file):
    for options, normal in (((), [0, 1, 0]), (("--up", "-x"), [-1, 0, 0])):
        assert scene_of(camera_file, "--ground", *options).meshes[-1].normals.tolist() == [normal]


@needs_device
def test_a_mesh_without_lights_is_shown_in_the_studio(square, camera_file, tmp_path):
    for path in (square, camera_file):
        scene = scene_of(path)
        assert (scene.preset, scene.environment.name) == ("pbr", "studio")
        assert scene.meshes[-1].material.texture.name == "contact shadow"
    course = save_npy(tmp_path / "course.npy", course_dict())
    for path, options in (
        (square, ("--look", "plain")),
        (square, ("--shader", "gouraud")),
        (square, ("--preset", "standard")),
        (square, ("--environment", "none")),
        (square, ("--shadows",)),
        (square, ("--lights", "0")),
        (square, ("--light-intensity", "2")),
        (square, ("--layers", "Z")),
        (square, ("--formats", "png,depth")),
        (square, ("--background", "none")),
        (square, ("--sheet",)),
        (course, ()),
        ("icosphere", ()),
    ):
        scene = scene_of(path, *options)
        assert (len(scene.meshes), scene.preset == "pbr") == (1, False), options
    assert scene_of("icosphere", "--look", "studio").meshes[-1].name == "ground"
    assert scene_of(square, "--look", "course").preset == "course"
    for option in (("--lights", "0"), ("--light-radius", "0"), ("--environment", "none")):
        with pytest.raises(InputError, match=f"{option[0]}: .*cannot go with --look studio"):
            scene_of(square, "--look", "studio", *option)
    assert len(scene_of(square, "--look", "studio", "--edges", "all").meshes) == 1
    with pytest.raises(InputError, match="--ground: cannot go with --edges"):
        scene_of(square, "--look", "studio", "--edges", "all", "--ground")
    for options in (("--preset", "pbr"), ("--preset", "course")):
        with pytest.raises(InputError, match="--look: studio cannot go with --preset, which it chooses"):
            scene_of(square, "--look", "studio", *options)


def test_factors_of_lights_that_the_environment_replaces_are_refused(camera_file):
    for options in (("--preset", "standard"), ("--shader", "phong"), ("--environment", "none"), ("--lights", "0,1,2")):
        assert len(scene_of(camera_file, "--light-intensity", "1,2,0", *options).lights) == 3
    with pytest.raises(InputError, match="--light-intensity: expected lights to multiply, found none: the environment"):
        scene_of(camera_file, "--light-intensity", "2")


@pytest.mark.long
@needs_device
def test_samples(tmp_path, square, capsys):
    """Four for pictures but those of the course; as many as are asked for."""
    course = save_npy(tmp_path / "course.npy", course_dict())
    for scene, options, samples in (
        (square, (), 4),
        (square, ("--samples", "1"), 1),
        (square, ("--preset", "course"), 1),
        (square, ("--preset", "standard"), 4),
        (course, (), 1),
        (course, ("--preset", "standard"), 1),
        (course, ("--samples", "3"), 3),
    ):
        assert settings_of(scene, *options)["samples"] == samples, (scene, options)
    assert clshade.Settings().samples == 1
    small = ("--resolution", "12,9", "--shader", "nolight", "--quiet", "-o", tmp_path / "a.1")
    for command in (("render", square), ("turntable", square, "--count", "1")):
        assert run(capsys, *command, *small)[0] == 0
        (path,) = tmp_path.glob("a.*.exr")
        assert "samples=4," in exr.read(path)[1]["settings"]
        path.unlink()


def test_soft_shadows_under_a_rectangle_light():
    """Of the room, and of any scene with such a light; but not in Python, nor for pictures of the course."""
    assert fields_of("box_room") == {"shadows": True, "sample_shading": True}
    assert fields_of("box_room", "--no-shadows") == {"shadows": False}
    for options in (("icosphere",), ("box_room", "--preset", "course"), ("box_room", "--lights", "1")):
        assert fields_of(*options) == {}
    assert any(isinstance(light, clshade.RectangleLight) for light in scene_of("box_room").lights)
    assert not any(isinstance(light, clshade.RectangleLight) for light in clshade.builtin("box_room").lights)


def fields_of(*options):
    """Return the fields of Settings of a picture from the command line, but for its samples."""
    return {name: value for name, value in settings_of(*options).items() if name != "samples"}


def test_pictures_of_textures_and_shadows_light_each_sample():
    """And what an environment lights has shadows by ambient occlusion, where they are asked for."""
    assert fields_of("teapot") == {"sample_shading": True}
    assert fields_of("teapot", "--no-sample-shading") == {"sample_shading": False}
    assert fields_of("teapot", "--preset", "course") == {}
    assert fields_of("icosphere", "--shadows") == {"shadows": True, "sample_shading": True}
    assert fields_of("icosphere", "--preset", "pbr") == {"sample_shading": True}  # which has shadows
    assert fields_of("icosphere", "--look", "studio") == {}
    open_ = {"ambient_occlusion": 16, "sample_shading": True}
    assert fields_of("icosphere", "--look", "studio", "--shadows") == {"shadows": True, **open_}
    assert fields_of("icosphere", "--ambient-occlusion", "16") == open_
    assert fields_of("icosphere", "--ambient-occlusion", "0") == {"ambient_occlusion": 0}
    assert clshade.Settings.from_preset("pbr").sample_shading is False


@pytest.mark.parametrize(
    ("command", "samples"),
    [
        ("render", "4, or 1 for scenes of the course, in Python 1"),
        ("turntable", "4, or 1 for scenes of the course, in Python 1"),
        ("animate", "4, or 1 for scenes of the course, in Python 1"),
        ("view", "64, when the view rests"),
        ("stability", "1, its center"),
    ],
)
def test_the_help_says_how_many_samples(command, samples, capsys):
    code, out, _ = run(capsys, command, "--help")
    assert code == 0
    assert f"samples per pixel (default: {samples})" in " ".join(out.split())
