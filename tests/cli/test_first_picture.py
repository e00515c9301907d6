"""What the command line chooses for a picture that says nothing of it: the camera, and the samples."""

from __future__ import annotations

import pytest
from command_line import needs_device, run, scene_of
from mesh_writers import triangle
from scene_files import course_dict, save_npy, write

import clshade
from clshade.cli.commands.scene_options import load_scene, picture_settings
from clshade.cli.main import _parser
from clshade.errors import InputError
from clshade.images import exr
from clshade.scene.fitting import FILL
from clshade.scene.geometry import camera_axes

SQUARE = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n"


@pytest.fixture
def square(tmp_path):
    return write(tmp_path / "square.obj", SQUARE)


@pytest.fixture
def own(tmp_path):
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


def test_a_files_own_camera_is_named_and_fit_ignores_it(own, square, capsys):
    line = "own.glb: the camera is the file's own: --fit chooses one that shows all of the scene"
    assert scene_of(own).camera.eye.tolist() == [0, 0, 9]
    assert capsys.readouterr().err.rstrip().endswith(line)
    for arguments in ((own, "--fit"), (own, "--camera-position", "1,2,3"), (square,), ("course",), ("icosphere",)):
        scene_of(*arguments)
        assert capsys.readouterr().err == ""
    assert extent(scene_of(own, "--fit")) == pytest.approx(FILL, rel=1e-6)
    assert not scene_of("icosphere").fitted
    assert extent(scene_of("icosphere", "--fit")) == pytest.approx(FILL, rel=1e-6)


def test_the_ground_lies_below_what_up_says(own):
    for options, normal in (((), [0, 1, 0]), (("--up", "-x"), [-1, 0, 0])):
        assert scene_of(own, "--ground", *options).meshes[-1].normals.tolist() == [normal]


def test_factors_of_lights_that_the_environment_replaces_are_refused(own):
    for options in (("--preset", "standard"), ("--shader", "phong"), ("--environment", "none"), ("--lights", "0,1,2")):
        assert len(scene_of(own, "--light-intensity", "1,2,0", *options).lights) == 3
    with pytest.raises(InputError, match="--light-intensity: expected lights to multiply, found none: the environment"):
        scene_of(own, "--light-intensity", "2")


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
        parsed = _parser(["render"]).parse_args(["render", str(scene), *options])
        found = picture_settings(parsed, load_scene(parsed, str(scene)))
        assert found["samples"] == samples, (scene, options)
    assert clshade.Settings().samples == 1
    small = ("--resolution", "12,9", "--shader", "nolight", "--quiet", "-o", tmp_path / "a.1")
    for command in (("render", square), ("turntable", square, "--count", "1")):
        assert run(capsys, *command, *small)[0] == 0
        (path,) = tmp_path.glob("a.*.exr")
        assert "samples=4," in exr.read(path)[1]["settings"]
        path.unlink()


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
    assert f"that are looked at (default: {samples})" in " ".join(out.split())
