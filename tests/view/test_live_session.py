"""Sessions of a live view without a network: camera, refinement, the latest input, probe and snapshot."""

from __future__ import annotations

import math
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused, needs_device, run, scene_of
from live_views import SMALL, all_drawings, next_drawing, session_of, source_of, unpacked
from scene_files import write

import clshade
from clshade import exr
from clshade.cli.main import main
from clshade.errors import InputError
from clshade.pipeline.frame import Frame, same_bits
from clshade.view.live_scene import MAX_PIXELS, LiveScene
from clshade.view.live_session import Session, Task

pytestmark = needs_device


PYRAMID = "v 0 0 0\nv 1 0 0\nv 0 0 -1\nv 0 1 0\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def assert_drawn_by(command: str, frame: Frame) -> None:
    """The command, which writes `again`, draws the same."""
    assert main(shlex.split(command)[1:]) == 0
    again = exr.read("again.exr")[0]
    for name, plane in exr.flatten(frame.channels()).items():
        np.testing.assert_array_equal(again[name], plane, err_msg=name)


def test_the_pictures_of_a_still_view_and_their_order():
    session, clock = session_of(*SMALL, "--samples", "16", "--layers", "Z,id")
    assert session.description()["lightNames"] == [
        "PointLight at 1 1 0, intensity 1 1 1",
        "PointLight at -2 0.5 0, intensity 0.6 0.3 0.2",
    ]
    drawings = all_drawings(session, clock)
    headers = [unpacked(drawing.message)[0] for drawing in drawings]
    assert [(h["samples"], h["type"], h["moving"], h["last"]) for h in headers] == [
        (1, "picture", True, False),
        (4, "picture", False, False),
        (16, "image", False, True),
    ]
    header, arrays = unpacked(drawings[-1].message)
    frame = clshade.render(scene_of(*SMALL), samples=16, layers=("Z", "id"), resolution=(40, 30))
    assert same_bits(drawings[-1].frame, frame)
    assert list(arrays) == ["R", "G", "B", "A", "Z", "id"]
    for name, plane in exr.flatten(frame.channels()).items():
        np.testing.assert_array_equal(arrays[name], plane)
    assert arrays["id"].dtype == np.uint32
    coarse = unpacked(drawings[0].message)[1]["rgba"]
    one = clshade.render(scene_of(*SMALL), resolution=(40, 30))
    np.testing.assert_array_equal(coarse[..., :3], one.to_png8())
    assert (coarse[..., 3] == 255).all()
    assert {"frame", "convert", "total"} <= header["times_ms"].keys()


def sized(columns: int, rows: int) -> list[dict]:
    return [{"type": "orbit", "right": 10.0}, {"type": "size", "columns": columns, "rows": rows}]


ROOM = (*SMALL, "--samples", "1")
INPUTS = [
    (ROOM, [{"type": "orbit", "right": 20.0, "up": 5.0}]),
    (ROOM, [{"type": "pan", "right": 0.2, "up": -0.1}]),
    (ROOM, [{"type": "dolly", "factor": 0.5}]),
    (ROOM, [{"type": "fly", "right": 0.1, "up": 0.0, "forward": 0.2}]),
    (ROOM, [{"type": "set", "lights": [0.5, 1.0]}]),
    (("teapot",), sized(61, 40)),
    (("a.obj",), sized(30, 40)),
    (("a.glb",), [*sized(61, 40), {"type": "orbit", "right": 10.0}]),
    (("teapot", *ROOM[1:]), [{"type": "set", "ground": True, "shadows": True, "lights": [0.3, 1.0, 0.0]}]),
    (("teapot", *ROOM[1:]), [{"type": "set", "shader": "pbr", "environment": "studio", "background": "environment"}]),
    (("icosphere", *ROOM[1:]), [{"type": "set", "ground": True, "background": "#336699", "ambient_occlusion": 16}]),
    (("a.obj", *ROOM[1:]), [{"type": "set", "shader": "pbr", "environment": "none", "ground": True}]),
]


@pytest.mark.parametrize(("arguments", "messages"), INPUTS, ids=str)
def test_an_input_gives_another_picture_and_its_command_draws_it(folder, arguments, messages):
    write(folder / "a.obj", TRIANGLE + "f 1 2 3\n")
    if arguments[0] == "a.glb":
        clshade.builtin("icosphere", level=2).to_glb("a.glb")
    session, clock = session_of(*arguments, *(() if arguments[1:] else ("--samples", "1")))
    before = all_drawings(session, clock)[-1].frame
    assert session.due() is None
    for message in messages:
        session.handle(message)
    drawings = [next_drawing(session), *all_drawings(session, clock)]
    assert drawings[0].task.is_first
    assert not same_bits(before, drawings[-1].frame)
    assert_drawn_by(session.command("again"), drawings[-1].frame)
    kind, values = messages[-1]["type"], session.options()["settings"]
    if kind == "set":
        switches = {name: value for name, value in messages[-1].items() if name in values and name != "background"}
        assert {name: values[name] for name in switches} == switches
    elif len(messages) == 1:
        session.handle({"type": "reset"})
        assert same_bits(all_drawings(session, clock)[-1].frame, before)


def test_the_latest_input_wins():
    """However many inputs come while a picture is drawn, the next is that of the last."""
    session, _ = session_of()
    task = session.due()
    assert isinstance(task, Task)
    for _ in range(100):
        session.handle({"type": "orbit", "right": 1.0, "up": 0.0})
    session.drawn(task, 1.0)
    drawing = next_drawing(session)
    assert drawing.task.is_first
    assert drawing.task.view.camera is session.view.camera
    assert drawing.task.version == session.version


def test_more_samples_wait_until_the_view_has_been_still_for_as_long_as_they_take():
    session, clock = session_of(*SMALL, "--samples", "4")
    next_drawing(session, ms=10.0)
    wait = session.due()
    assert wait == pytest.approx(0.02)  # twice as long as with one sample, as a guess
    clock.now += 0.02
    assert next_drawing(session, ms=100.0).task.step.last
    session.handle({"type": "orbit", "right": 1.0})
    next_drawing(session, ms=10.0)
    assert session.due() == pytest.approx(0.1)
    session.handle({"type": "orbit", "right": 1.0})
    assert isinstance(session.due(), Task)


def test_slow_pictures_get_coarser_in_motion_and_finer_again():
    session, _ = session_of(*SMALL)

    def moved(ms: float) -> int:
        session.handle({"type": "orbit", "right": 1.0})
        return next_drawing(session, ms).task.step.scale

    assert [moved(400.0), moved(100.0), moved(25.0), moved(25.0)] == [1, 2, 4, 4]
    assert [moved(2.0) for _ in range(12)][-1] == 1
    session, _ = session_of(*SMALL)
    assert [moved(400.0) for _ in range(5)][-1] == 1  # a coarser picture would be no faster


def test_a_picture_has_the_size_of_its_window():
    session, clock = session_of("teapot", "--samples", "1")
    session.handle({"type": "size", "columns": 61, "rows": 40})
    assert all_drawings(session, clock)[-1].frame.rgba.shape == (40, 61, 4)
    assert "--resolution=61,40" in session.command()
    assert "--camera-view-angle" not in session.command()
    version = session.version
    session.handle({"type": "size", "columns": 61, "rows": 40})
    assert session.version == version  # nothing to draw again
    # A narrow window shows as much from left to right as the scene's own picture does.
    session.handle({"type": "size", "columns": 30, "rows": 40})
    height, width = session.view.camera.plane
    own_height, own_width = session._scene.scene.camera.plane
    focal = session._scene.scene.camera.focal
    assert width / session.view.camera.focal == pytest.approx(own_width / focal)
    assert height / session.view.camera.focal > own_height / focal
    session.handle({"type": "size", "columns": 8000, "rows": 4000})
    columns, rows = session.view.camera.resolution
    assert columns * rows <= MAX_PIXELS < 1.01 * columns * rows
    assert columns / rows == pytest.approx(2.0, rel=1e-3)
    for size in ({}, {"columns": 0, "rows": 1}, {"columns": 1, "rows": 1e9}):
        with pytest.raises(InputError, match="size"):
            session.handle({"type": "size", **size})
    session, _ = session_of(*SMALL)
    session.handle({"type": "size", "columns": 61, "rows": 40})
    assert session.view.camera.resolution == (40, 30)


def test_switches_are_those_that_the_scene_allows():
    session, _ = session_of("teapot", "--resolution", "40,30")
    choices = session.options()["choices"]
    assert (choices["environment"], choices["background"]) == ([], ["scene", None, "color"])
    assert choices["shadows"]
    assert choices["ground"]
    session.handle({"type": "set", "shader": "pbr", "environment": "studio", "background": "environment"})
    choices = session.options()["choices"]
    assert choices["environment"] == [(None, "none"), ("studio", "studio")]
    assert "environment" in choices["background"]
    session.handle({"type": "set", "environment": None})  # nothing is left to see behind the surfaces
    assert session.view.settings.background == "scene"
    session.handle({"type": "set", "shader": "nolight"})
    choices = session.options()["choices"]
    assert not choices["shadows"]
    assert not choices["ambient_occlusion"]
    session, _ = session_of("teapot", "--edges", "feature")
    assert not session.options()["choices"]["ground"]
    with pytest.raises(InputError, match="ground"):
        session.handle({"type": "set", "ground": True})


@pytest.mark.sampled
@pytest.mark.parametrize(
    "message",
    [
        {"type": ["orbit"]},
        {"type": "orbit", "right": "x"},
        {"type": "orbit", "right": math.inf},
        {"type": "dolly", "factor": 0},
        {"type": "dolly"},
        {"type": "set", "shader": "toon"},
        {"type": "set", "samples": 65},
        {"type": "set", "exposure": math.nan},
        {"type": "set", "exposure": 10**400},
        {"type": "set", "tonemap": "x"},
        {"type": "set", "lights": [1.0]},
        {"type": "set", "lights": [-1.0, 1.0, 1.0]},
        {"type": "set", "layers": ["Y"]},
        {"type": "set", "output": "/etc/passwd"},
        {"type": "set", "environment": "/etc/passwd"},
        {"type": "set", "environment": ["studio"]},
        {"type": "set", "ground": 1},
        {"type": "set", "background": "environment"},
        {"type": "fly", "forward": 1e308},
    ],
    ids=str,
)
def test_other_inputs_are_refused_and_change_nothing(message):
    session, _ = session_of("teapot", "--resolution", "40,30")
    before = session.view, session.version, session.display
    with pytest.raises(InputError):
        session.handle(message)
    assert (session.view, session.version, session.display) == before


def test_the_probe_has_every_layer_of_the_final_picture():
    session, _ = session_of(*SMALL, "--samples", "4")
    session.handle({"type": "dolly", "factor": 3.0})
    frame = clshade.render(replace(scene_of(*SMALL), camera=session.view.camera), samples=4, layers="all")
    planes = exr.flatten(frame.channels())
    probe = session.probe(20, 12)
    assert probe["values"] == {name: np.float32(plane[12, 20]) for name, plane in planes.items()}
    assert session.probe(0, 0)["values"]["Z"] == "inf"
    for place in ((40, 0), (0, 30), (-1, 0), (None, 0), ("1", 0), (0.5, 0)):
        with pytest.raises(InputError, match="probe"):
            session.probe(*place)


OPTIONS = [
    "quads --samples 4 --half --light-intensity 0.7",
    "icosphere --fit --orthographic --camera-azimuth-angle 30 --ground --background none",
    "icosphere --fit --camera-view-angle 50 --background #336699",
    "box_room --samples 4",
    "pyramid.obj",
    "pyramid.obj --no-ground --sample-shading",
    "pyramid.obj --shadows --ground",
    "pyramid.obj --light-intensity 0.5",
    "pyramid.obj --look course",
    "pyramid.obj --look studio --ambient-occlusion 4",
    "teapot --edges feature,silhouette --edge-width 2 --edge-color 1,0,0",
    "teapot --orthographic --exposure -0.5 --shader gouraud",
    "teapot --preset course --samples 4 --layers Z,N --near 0.3",
    "teapot --camera-view-angle 33.3 --camera-azimuth-angle 30 --precision float64",
    "teapot --lights 0,1 --light-intensity 0.7,1.3 --tonemap aces --components diffuse",
]


def test_names_that_look_like_options(folder, capsys):
    write(folder / "-a.obj", TRIANGLE + "f 1 2 3\n")
    session, _ = session_of("--resolution", "8,6", "--samples", "1", "--", "-a.obj")
    snapshot = session.snapshot()
    assert snapshot["files"] == ["-a-1.exr", "-a-1.png"]
    pictures = [Path(name) for name in snapshot["files"]]
    written = pictures[1].read_bytes()
    for picture in pictures:
        picture.unlink()
    assert main(shlex.split(snapshot["command"])[1:]) == 0, capsys.readouterr()
    assert pictures[1].read_bytes() == written


@pytest.mark.sampled
@pytest.mark.parametrize("options", OPTIONS)
def test_a_snapshot_is_what_its_command_renders(folder, capsys, options):
    write(folder / "pyramid.obj", PYRAMID)
    common_options = ("--resolution", "41,30", "--samples", "2", "-o", "a b")
    name, *further = options.split()
    session, clock = session_of(name, *common_options, *further)
    session.handle({"type": "orbit", "right": 33.3, "up": -12.1})
    session.handle({"type": "pan", "right": 0.01, "up": -0.1})
    session.handle({"type": "dolly", "factor": 0.77})
    session.handle({"type": "set", "lights": [0.3, 0.0, 1.5][: len(session.view.lights)]})
    if session.options()["choices"]["environment_intensity"]:
        session.handle({"type": "set", "environment_intensity": 0.6})
    if name == "quads":
        session.handle({"type": "set", "exposure": 1.5, "tonemap": "reinhard"})
    drawn = all_drawings(session, clock)[-1].frame
    snapshot = session.snapshot()
    assert snapshot["files"] == ["a b-1.exr", "a b-1.png"]
    assert snapshot["warnings"] == []
    assert same_bits(drawn, session._scene.render(session.view))
    program, *arguments = shlex.split(snapshot["command"])
    assert program == "clshade"
    again = [*arguments[:-1], "again"]
    assert main(again) == 0, capsys.readouterr()
    channels, rendered = (exr.read(f"{stem}.exr")[0] for stem in ("a b-1", "again"))
    assert channels.keys() == rendered.keys()
    for name, plane in channels.items():
        assert plane.dtype == rendered[name].dtype
        np.testing.assert_array_equal(plane, rendered[name], err_msg=name)
    assert Path("a b-1.png").read_bytes() == Path("again.png").read_bytes()
    assert session.snapshot()["files"] == ["a b-2.exr", "a b-2.png"]


def test_a_mesh_stands_in_the_studio_until_its_lights_are_asked_for(tmp_path):
    session, _ = session_of(write(tmp_path / "pyramid.obj", PYRAMID), *SMALL[1:])
    options = session.options()
    assert options["settings"]["ground"] is True
    assert options["choices"]["lights"] is False
    assert options["choices"]["environment"] == [(None, "studio"), ("none", "none")]
    assert {"--look=studio", "--ground"} & set(session.command().split()) == {"--look=studio"}
    session.handle({"type": "set", "environment": "none", "ground": False})
    assert session.options()["choices"]["lights"] is True
    assert not any(option.startswith(("--look", "--no-ground")) for option in session.command().split())
    session.handle({"type": "set", "environment": None})
    assert {"--look=studio", "--no-ground"} <= set(session.command().split())


def test_a_snapshot_that_cannot_be_written(tmp_path):
    session, _ = session_of(*SMALL, "-o", tmp_path / "view")
    (tmp_path / "view-1.exr").mkdir()
    assert session.snapshot()["files"] == [str(tmp_path / f"view-2.{kind}") for kind in ("exr", "png")]
    (tmp_path / "view-3.depth.png").write_text("of another run")
    tmp_path.joinpath("view-4.png").symlink_to(tmp_path / "none" / "x.png")
    with pytest.raises(clshade.errors.OutputError):
        session.snapshot()
    assert not {"view-3.exr", "view-4.exr"} & {path.name for path in tmp_path.iterdir()}


def test_two_sessions_share_a_scene_and_keep_their_own_cameras():
    scene = LiveScene(source_of(*SMALL, "--samples", "1"))
    first, second = Session(scene), Session(scene)
    first.handle({"type": "orbit", "right": 40.0})
    assert not same_bits(next_drawing(first).frame, next_drawing(second).frame)
    assert len(scene.renderers) == 1
    second.handle({"type": "set", "lights": [0.5, 1.0]})
    next_drawing(second)
    assert len(scene.renderers) == 2
    second.close()
    assert len(scene.renderers) == 1
    for k in range(10):
        first.handle({"type": "set", "lights": [k / 10.0] * len(first.view.lights)})
        next_drawing(first)
    assert len(scene.renderers) <= 8
    first.close()
    assert len(scene.renderers) == 0


def test_a_file_that_changes_is_read_again_and_the_camera_stays(tmp_path):
    path = write(tmp_path / "a.obj", TRIANGLE + "f 1 2 3\n")
    session, clock = session_of(path, "--resolution", "40,30", "--samples", "1")
    scene = session._scene
    session.handle({"type": "orbit", "right": 10.0})
    camera = session.view.camera
    before = all_drawings(session, clock)[-1]
    assert scene.source.stamps() == scene.stamps
    write(tmp_path / "a.obj", TRIANGLE + "v 1 1 0\nf 1 2 3\nf 2 4 3\n")
    assert scene.source.stamps() != scene.stamps
    scene.load()
    session.reloaded()
    assert scene.source.stamps() == scene.stamps
    after = all_drawings(session, clock)[-1]
    assert not same_bits(before.frame, after.frame)
    for name in ("eye", "lookat", "up"):
        np.testing.assert_array_equal(getattr(session.view.camera, name), getattr(camera, name))
    write(tmp_path / "a.obj", "f 1 2 3\n")
    with pytest.raises(InputError):
        scene.load()
    session.handle({"type": "orbit", "right": -1.0})
    next_drawing(session)
    (tmp_path / "a.obj").unlink()
    assert scene.source.stamps() == (None,)
    with pytest.raises(InputError):
        scene.load()
    assert len(all_drawings(session, clock)) == 1


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("none",), ["SCENE", "found 'none'"]),
        (("none.obj",), ["none.obj"]),
        (("teapot", "--light-intensity", "1,2"), ["--light-intensity", "3: one for each light"]),
        (("teapot", "--samples", "0"), ["samples"]),
        (("teapot", "--exposure", "999"), ["exposure"]),
        (("teapot", "-o", "none/x"), ["none"]),
        (("teapot", "--port", "70000"), ["--port"]),
        (("teapot", "a.exr"), ["expected one scene, or images, found teapot and a.exr"]),
        (("teapot", "quads"), ["expected one scene, or images, found teapot and quads"]),
        (("a.exr", "--port", "80"), ["--port: is for a scene, not for images"]),
        (("a.exr", "--samples", "4"), ["--samples: is for a scene, not for images"]),
    ],
    ids=str,
)
def test_bad_options_are_refused_in_one_line(folder, monkeypatch, capsys, arguments, parts):
    pytest.importorskip("aiohttp")
    monkeypatch.setattr("clshade.view.live_server.QUIET_SECONDS", 60.0)  # on a machine however busy
    assert_refused(run(capsys, "view", *arguments), *parts)
