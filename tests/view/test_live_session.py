"""Sessions of a live view without a network: messages, camera, refinement, the latest input, probe and snapshot."""

import math
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused, needs_device, run, scene_of
from live_views import SMALL, all_drawings, next_drawing, session_of, source_of, unpacked
from processes import ROOT
from scene_files import TRIANGLE, same, write

import clshade
from clshade import exr
from clshade.cli.main import main
from clshade.errors import InputError
from clshade.pipeline.frame import same_bits
from clshade.view import live_input
from clshade.view.live_input import ANSWERED, MESSAGES
from clshade.view.live_scene import MAX_PIXELS, LiveScene
from clshade.view.live_session import Session, Task, pack_picture
from clshade.view.page import live_page

pytestmark = needs_device

PYRAMID = "v 0 0 0\nv 1 0 0\nv 0 0 -1\nv 0 1 0\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


def test_the_pictures_of_a_still_view_and_their_order():
    session, clock = session_of(*SMALL, "--samples", "16", "--layers", "Z,id")
    lights = ["PointLight at 1 1 0, intensity 1 1 1", "PointLight at -2 0.5 0, intensity 0.6 0.3 0.2"]
    assert session.description()["lightNames"] == lights
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
    assert same(arrays, exr.flatten(frame.channels()))
    coarse = unpacked(drawings[0].message)[1]["rgba"]
    np.testing.assert_array_equal(coarse[..., :3], clshade.render(scene_of(*SMALL), resolution=(40, 30)).to_png8())
    assert (coarse[..., 3] == 255).all()
    assert {"frame", "convert", "total"} <= header["times_ms"].keys()


def sized(columns: int, rows: int) -> list[dict]:
    return [{"type": "orbit", "right": 10.0}, {"type": "size", "columns": columns, "rows": rows}]


ROOM = (*SMALL, "--samples", "1")
INPUTS = [
    (ROOM, [{"type": "orbit", "right": 20.0, "up": 5.0}]),
    (ROOM, [{"type": "fly", "right": 0.1, "up": 0.0, "forward": 0.2}]),
    (ROOM, [{"type": "set", "lights": [0.5, 1.0]}]),
    (("teapot",), sized(61, 40)),
    (("a.obj",), sized(30, 40)),
    (("a.glb",), [*sized(61, 40), {"type": "orbit", "right": 10.0}]),
    (("teapot", *ROOM[1:]), [{"type": "set", "ground": True, "shadows": True, "lights": [0.3, 1.0, 0.0]}]),
]
MORE_INPUTS = [
    (ROOM, [{"type": "pan", "right": 0.2, "up": -0.1}]),
    (ROOM, [{"type": "dolly", "factor": 0.5}]),
    (("teapot", *ROOM[1:]), [{"type": "set", "shader": "pbr", "environment": "studio", "background": "environment"}]),
    (("icosphere", *ROOM[1:]), [{"type": "set", "ground": True, "background": "#336699", "ambient_occlusion": 16}]),
    (("a.obj", *ROOM[1:]), [{"type": "set", "shader": "pbr", "environment": "none", "ground": True}]),
]


@pytest.mark.parametrize(
    ("arguments", "messages"), [*INPUTS, *(pytest.param(*row, marks=pytest.mark.long) for row in MORE_INPUTS)], ids=str
)
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
    assert main(shlex.split(session.command("again"))[1:]) == 0
    assert same(exr.read("again.exr")[0], exr.flatten(drawings[-1].frame.channels()))
    kind, values = messages[-1]["type"], session.options()["settings"]
    if kind == "set":
        switches = {name: value for name, value in messages[-1].items() if name in values and name != "background"}
        assert {name: values[name] for name in switches} == switches
    elif len(messages) == 1:
        session.handle({"type": "reset"})
        assert same_bits(all_drawings(session, clock)[-1].frame, before)


def test_the_latest_input_wins():
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
    assert session.due() == pytest.approx(0.02)  # twice as long as with one sample, as a guess
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
    camera, own = session.view.camera, session._scene.scene.camera
    assert camera.plane[1] / camera.focal == pytest.approx(own.plane[1] / own.focal)
    assert camera.plane[0] / camera.focal > own.plane[0] / own.focal
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
@pytest.mark.parametrize("message", [
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
], ids=str)  # fmt: skip
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
    assert session.probe(20, 12)["values"] == {name: np.float32(plane[12, 20]) for name, plane in planes.items()}
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
    written = Path("-a-1.png").read_bytes()
    for name in snapshot["files"]:
        Path(name).unlink()
    assert main(shlex.split(snapshot["command"])[1:]) == 0, capsys.readouterr()
    assert Path("-a-1.png").read_bytes() == written


@pytest.mark.sampled
@pytest.mark.parametrize("options", OPTIONS)
def test_a_snapshot_is_what_its_command_renders(folder, capsys, options):
    write(folder / "pyramid.obj", PYRAMID)
    name, *further = options.split()
    session, clock = session_of(name, "--resolution", "41,30", "--samples", "2", "-o", "a b", *further)
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
    assert (snapshot["files"], snapshot["warnings"]) == (["a b-1.exr", "a b-1.png"], [])
    assert same_bits(drawn, session._scene.render(session.view))
    program, *arguments = shlex.split(snapshot["command"])
    assert program == "clshade"
    assert main([*arguments[:-1], "again"]) == 0, capsys.readouterr()
    assert same(*(exr.read(f"{stem}.exr")[0] for stem in ("a b-1", "again")))
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
    assert not same_bits(before.frame, all_drawings(session, clock)[-1].frame)
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


@pytest.mark.parametrize(("arguments", "parts"), [
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
], ids=str)  # fmt: skip
def test_bad_options_are_refused_in_one_line(folder, monkeypatch, capsys, arguments, parts):
    pytest.importorskip("aiohttp")
    monkeypatch.setattr("clshade.view.live_server.QUIET_SECONDS", 60.0)  # on a machine however busy
    assert_refused(run(capsys, "view", *arguments), *parts)


# Messages, and moves of the camera

CAMERA = clshade.Camera.from_fov((3.0, 4.0, 12.0), (0.0, 0.0, 0.0), (0.0, 2.0, 0.0), 40.0)


def test_messages_hold_their_arrays_at_multiples_of_eight_bytes():
    arrays = {"A": np.arange(15, dtype=np.float32).reshape(3, 5), "id": np.full((3, 5), 2**31, np.uint32)}
    header, planes = unpacked(pack_picture({"width": 5, "height": 3, "name": "ü"}, arrays))
    assert header["name"] == "ü"
    assert [entry["offset"] % 8 for entry in header["arrays"]] == [0, 0]
    assert all(np.array_equal(planes[name], array) for name, array in arrays.items())


def distance(camera):
    return math.dist(camera.eye, camera.lookat)


def test_moves_of_the_camera():
    moved = live_input.orbit(CAMERA, 90.0, 0.0)
    np.testing.assert_allclose(moved.eye, (12.0, 4.0, -3.0), atol=1e-12)
    np.testing.assert_array_equal(moved.lookat, CAMERA.lookat)
    high = live_input.orbit(CAMERA, 0.0, 1000.0)
    assert live_input.elevation(high) == pytest.approx(89.5)
    assert live_input.elevation(live_input.orbit(high, 0.0, -1000.0)) == pytest.approx(-89.5)
    assert distance(high) == pytest.approx(13.0)
    moved = live_input.pan(CAMERA, 0.0, 1.0)  # by the image's height: what is seen leaves it
    assert distance(moved) == pytest.approx(13.0)
    shift = moved.lookat - CAMERA.lookat
    assert np.linalg.norm(shift) == pytest.approx(2.0 * 13.0 * math.tan(math.radians(20.0)))
    assert shift @ (CAMERA.lookat - CAMERA.eye) == pytest.approx(0.0, abs=1e-12)
    near = live_input.dolly(CAMERA, 1e-30, CAMERA)
    assert distance(near) == pytest.approx(13.0 * live_input.NEAREST)
    assert distance(live_input.dolly(near, 1e30, CAMERA)) == pytest.approx(13.0 * live_input.FARTHEST)
    moved = live_input.fly(CAMERA, 0.0, 0.0, 0.5)
    np.testing.assert_allclose(moved.eye, CAMERA.eye / 2.0)
    np.testing.assert_allclose(moved.lookat, -CAMERA.eye / 2.0)


def test_the_page_and_the_server_send_what_the_other_knows():
    """By the types in their sources; a picture's message has none in text."""
    view = ROOT / "clshade" / "view"
    scripts = "\n".join(path.read_text() for path in (view / "page").glob("live*.js"))
    assert set(re.findall(r'send\(\{ type: "(\w+)"', scripts)) == MESSAGES.keys()
    sources = "\n".join((view / name).read_text() for name in ("live_server.py", "live_session.py"))
    sent = {*re.findall(r'"type": "(\w+)"[,}]', sources), *ANSWERED} - {"size"}
    (handlers,) = re.findall(r"handlers\(\) {\n    return {\n(.*?)\n    };", scripts, re.DOTALL)
    assert set(re.findall(r"^      (\w+): ", handlers, re.MULTILINE)) == sent
    assert "<img" not in live_page("</title></script><img src=x onerror=alert(1)>", "127.0.0.1:1")
