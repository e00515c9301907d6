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
from clshade.pipeline.frame import same_bits
from clshade.view.live_scene import MAX_PIXELS, LiveScene
from clshade.view.live_session import Session, Task

pytestmark = needs_device


PYRAMID = "v 0 0 0\nv 1 0 0\nv 0 0 -1\nv 0 1 0\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


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
    (ROOM, [{"type": "fly", "right": 0.1, "up": 0.0, "forward": 0.2}]),
    (("a.obj", "--samples", "1"), sized(30, 40)),
    (("a.glb", "--samples", "1"), [*sized(61, 40), {"type": "orbit", "right": 10.0}]),
    (("teapot", *ROOM[1:]), [{"type": "set", "ground": True, "shadows": True, "lights": [0.3, 1.0, 0.0]}]),
    (("teapot", *ROOM[1:]), [{"type": "set", "shader": "pbr", "environment": "studio", "background": "environment"}]),
    (("a.obj", *ROOM[1:]), [{"type": "set", "shader": "pbr", "environment": "none", "ground": True}]),
]


@pytest.mark.parametrize(("arguments", "messages"), INPUTS, ids=str)
def test_an_input_gives_another_picture_and_its_command_draws_it(folder, arguments, messages):
    write(folder / "a.obj", TRIANGLE + "f 1 2 3\n")
    if arguments[0] == "a.glb":
        clshade.builtin("icosphere", level=2).to_glb("a.glb")
    session, clock = session_of(*arguments)
    before = all_drawings(session, clock)[-1].frame
    assert session.due() is None
    for message in messages:
        session.handle(message)
    drawn = all_drawings(session, clock)[-1].frame
    assert not same_bits(before, drawn)
    assert main(shlex.split(session.command("again"))[1:]) == 0
    again = exr.read("again.exr")[0]
    for name, plane in exr.flatten(drawn.channels()).items():
        np.testing.assert_array_equal(again[name], plane, err_msg=name)
    if messages[0]["type"] in ("orbit", "fly") and len(messages) == 1:
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
    session.handle({"type": "size", "columns": 8000, "rows": 4000})
    columns, rows = session.view.camera.resolution
    assert columns * rows <= MAX_PIXELS < 1.01 * columns * rows
    assert columns / rows == pytest.approx(2.0, rel=1e-3)
    session, _ = session_of(*SMALL)
    session.handle({"type": "size", "columns": 61, "rows": 40})
    assert session.view.camera.resolution == (40, 30)


@pytest.mark.sampled
@pytest.mark.parametrize(
    "message",
    [
        {"type": ["orbit"]},
        {"type": "orbit", "right": math.inf},
        {"type": "dolly"},
        {"type": "set", "shader": "toon"},
        {"type": "set", "exposure": 10**400},
        {"type": "set", "lights": [1.0]},
        {"type": "set", "lights": [-1.0, 1.0, 1.0]},
        {"type": "set", "output": "/etc/passwd"},
        {"type": "set", "environment": "/etc/passwd"},
        {"type": "set", "ground": 1},
        {"type": "size", "columns": 0, "rows": 1},
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
    for place in ((40, 0), (-1, 0), ("1", 0), (0.5, 0)):
        with pytest.raises(InputError, match="probe"):
            session.probe(*place)


OPTIONS = [
    "quads --samples 4 --half --light-intensity 0.7",
    "icosphere --fit --orthographic --camera-azimuth-angle 30 --ground --background none",
    "pyramid.obj --no-ground --sample-shading",
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


def test_a_snapshot_that_cannot_be_written(tmp_path):
    session, _ = session_of(*SMALL, "-o", tmp_path / "view")
    (tmp_path / "view-1.exr").mkdir()
    assert session.snapshot()["files"] == [str(tmp_path / f"view-2.{kind}") for kind in ("exr", "png")]
    (tmp_path / "view-3.depth.png").write_text("of another run")
    tmp_path.joinpath("view-4.png").symlink_to(tmp_path / "none" / "x.png")
    with pytest.raises(clshade.errors.OutputError):
        session.snapshot()
    assert not {"view-3.exr", "view-4.exr"} & {path.name for path in tmp_path.iterdir()}


def test_few_renderers_are_kept():
    scene = LiveScene(source_of(*SMALL, "--samples", "1"))
    session = Session(scene)
    for k in range(10):
        session.handle({"type": "set", "lights": [k / 10.0] * len(session.view.lights)})
        next_drawing(session)
    assert 1 < len(scene.renderers) <= 8
    session.close()
    assert len(scene.renderers) == 0


def test_a_file_that_changes_is_read_again_and_the_camera_stays(tmp_path):
    path = write(tmp_path / "a.obj", TRIANGLE + "f 1 2 3\n")
    session, clock = session_of(path, "--resolution", "40,30", "--samples", "1")
    scene = session._scene
    session.handle({"type": "orbit", "right": 10.0})
    camera = session.view.camera
    before = all_drawings(session, clock)[-1]
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
    (tmp_path / "a.obj").unlink()
    assert scene.source.stamps() == (None,)
    session.handle({"type": "orbit", "right": -1.0})
    assert all_drawings(session, clock)


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("none",), ["SCENE", "found 'none'"]),
        (("teapot", "--light-intensity", "1,2"), ["--light-intensity", "3: one for each light"]),
        (("teapot", "-o", "none/x"), ["none"]),
        (("teapot", "a.exr"), ["expected one scene, or images, found teapot and a.exr"]),
        (("a.exr", "--port", "80"), ["--port: is for a scene, not for images"]),
    ],
    ids=str,
)
def test_bad_options_are_refused_in_one_line(folder, monkeypatch, capsys, arguments, parts):
    pytest.importorskip("aiohttp")
    monkeypatch.setattr("clshade.view.live_server.QUIET_SECONDS", 60.0)  # on a machine however busy
    assert_refused(run(capsys, "view", *arguments), *parts)
