"""Parts of the live view by themselves: messages, controls, commands, which names are scenes."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from live_views import source_of, unpacked
from processes import ROOT

import clshade
from clshade.cli.options import is_scene
from clshade.errors import InputError
from clshade.scene.look import scaled_lights
from clshade.view import live_input
from clshade.view.live_input import ANSWERED, MESSAGES, checked
from clshade.view.live_session import enlarge, pack_picture
from clshade.view.page import live_page

CAMERA = clshade.Camera.from_fov((3.0, 4.0, 12.0), (0.0, 0.0, 0.0), (0.0, 2.0, 0.0), 40.0)


def test_messages_hold_their_arrays_at_multiples_of_eight_bytes():
    arrays = {
        "A": np.arange(15, dtype=np.float32).reshape(3, 5),
        "id": np.arange(15, dtype=np.uint32).reshape(3, 5) + 2**31,
        "rgba": np.arange(60, dtype=np.uint8).reshape(3, 5, 4),
    }
    message = pack_picture({"width": 5, "height": 3, "name": "ü" * 3}, arrays)
    header, planes = unpacked(message)
    assert header["name"] == "üüü"
    assert len(message) % 8 == 0
    for entry in header["arrays"]:
        assert entry["offset"] % 8 == 0
        np.testing.assert_array_equal(planes[entry["name"]], arrays[entry["name"]])


@pytest.mark.parametrize("shape", [(4, 6), (5, 7), (2, 3), (1, 1)])
def test_a_coarse_channel_covers_the_full_image(shape):
    coarse = np.arange(6.0).reshape(2, 3)[: shape[0], : shape[1]]
    full = enlarge(coarse, shape)
    assert full.shape == shape
    assert (full[0, 0], full[-1, -1]) == (coarse[0, 0], coarse[-1, -1])
    assert set(full.ravel()) == set(coarse.ravel())
    if shape == (4, 6):
        np.testing.assert_array_equal(full, np.kron(coarse, np.ones((2, 2))))


def distance(camera):
    return math.dist(camera.eye, camera.lookat)


def test_orbiting_keeps_distance_target_and_up():
    moved = live_input.orbit(CAMERA, 90.0, 0.0)
    np.testing.assert_allclose(moved.eye, (12.0, 4.0, -3.0), atol=1e-12)
    np.testing.assert_array_equal(moved.lookat, CAMERA.lookat)
    high = live_input.orbit(CAMERA, 0.0, 1000.0)
    assert live_input.elevation(high) == pytest.approx(89.5)
    assert live_input.elevation(live_input.orbit(high, 0.0, -1000.0)) == pytest.approx(-89.5)
    assert distance(high) == pytest.approx(13.0)


def test_panning_by_the_image_s_height_moves_what_is_seen_out_of_it():
    moved = live_input.pan(CAMERA, 0.0, 1.0)
    assert distance(moved) == pytest.approx(13.0)
    shift = moved.lookat - CAMERA.lookat
    assert np.linalg.norm(shift) == pytest.approx(2.0 * 13.0 * math.tan(math.radians(20.0)))
    assert shift @ (CAMERA.lookat - CAMERA.eye) == pytest.approx(0.0, abs=1e-12)


def test_the_distance_has_ends():
    near = live_input.dolly(CAMERA, 1e-30, CAMERA)
    assert distance(near) == pytest.approx(13.0 * live_input.NEAREST)
    assert distance(live_input.dolly(near, 1e30, CAMERA)) == pytest.approx(13.0 * live_input.FARTHEST)


def test_flying_moves_eye_and_target():
    moved = live_input.fly(CAMERA, 0.0, 0.0, 0.5)
    np.testing.assert_allclose(moved.eye, CAMERA.eye / 2.0)
    np.testing.assert_allclose(moved.lookat, -CAMERA.eye / 2.0)


def test_lights_are_multiplied():
    scene = clshade.builtin("teapot")
    for factors in ((0.5,), (0.5, 0.5, 0.5)):
        scaled = scaled_lights(scene, factors)
        for light, before in zip(scaled.lights, scene.lights, strict=True):
            np.testing.assert_array_equal(light.intensity, before.intensity * 0.5)
            np.testing.assert_array_equal(light.position, before.position)
    for factors in ((), (1.0, 2.0), (1.0, -1.0, 1.0), (math.nan,)):
        with pytest.raises(InputError, match="light intensity"):
            scaled_lights(scene, factors)
    assert scaled_lights(replace(scene, lights=()), (2.0,)).lights == ()


def test_the_page_and_the_server_send_what_the_other_knows():
    """By the types in their sources; a picture's message has none in text."""
    view = ROOT / "clshade" / "view"
    scripts = "\n".join(path.read_text() for path in (view / "page").glob("live*.js"))
    assert set(re.findall(r'send\(\{ type: "(\w+)"', scripts)) == MESSAGES.keys()
    sources = "\n".join((view / name).read_text() for name in ("live_server.py", "live_session.py"))
    sent = {*re.findall(r'"type": "(\w+)"[,}]', sources), *ANSWERED} - {"size"}
    (handlers,) = re.findall(r"handlers\(\) {\n    return {\n(.*?)\n    };", scripts, re.DOTALL)
    assert set(re.findall(r"^      (\w+): ", handlers, re.MULTILINE)) == sent


def test_a_misspelt_setting_is_answered_with_the_nearest():
    with pytest.raises(InputError, match=r"view: sample: expected one of .*: did you mean 'samples'\?$"):
        checked({"type": "set", "sample": 4})
    with pytest.raises(InputError, match=r"^dolly: factor: expected a finite number above 0, found None$"):
        checked({"type": "dolly"})
    assert checked({"type": "orbit", "up": 2}) == ("orbit", {"right": 0.0, "up": 2.0})


def test_names_of_scenes(folder):
    (folder / "image").touch()
    scenes = ["teapot", "a.OBJ", "x/y.glb", "a.npy", "teapto"]
    assert [is_scene(name) for name in scenes] == [True] * len(scenes)
    assert [is_scene(name) for name in ("a.exr", "b.png", "image", "c.txt")] == [False] * 4


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("teapot", "a.exr"), "expected one scene, or images, found teapot and a.exr"),
        (("teapot", "quads"), "expected one scene, or images, found teapot and quads"),
        (("a.exr", "--port", "80"), "--port: is for a scene, not for images"),
        (("a.exr", "--half"), "--half: is for a scene, not for images"),
        (("a.exr", "--samples", "4"), "--samples: is for a scene, not for images"),
    ],
)
def test_scenes_and_images_are_not_mixed(capsys, arguments, expected):
    code, out, err = run(capsys, "view", *arguments)
    assert (code, out, len(err)) == (2, "", 1)
    assert expected in err[0]


def test_the_name_of_a_scene_is_no_markup():
    hostile = "</title></script><img src=x onerror=alert(1)>"
    page = live_page(hostile, "127.0.0.1:1")
    assert "<img" not in page


def test_options_that_commands_repeat():
    options = ("--resolution=40,30", "--lights=0,1", "--light-radius=0.5", "--orthographic", "--device=pocl", "--crop")
    source = source_of("teapot", *options, "--light-intensity", "2", "--camera-view-up", "0,0,1", "--port", "8000")
    assert source.options == options
    assert source.settings["samples"] == 64
    assert source.output == "teapot"
    colored = ("--scalars", "q", "--colormap", "jet", "--clim", "-1,2", "--nan-color", "red", "--colorbar")
    expected = ("--scalars=q", "--colormap=jet", "--clim=-1.0,2.0", "--nan-color=red", "--colorbar")
    assert source_of("teapot", *colored).options == expected
    lines = ("--edges", "feature,silhouette", "--edge-width", "2", "--edge-color", "1,0,0", "--edges-only")
    expected = ("--edges=feature,silhouette", "--edge-width=2.0", "--edge-color=1,0,0", "--edges-only")
    assert source_of("teapot", *lines).options == expected
    files = source_of("teapot", "--layers", "id", "--formats", "npz,depth", "--depth-scale", "0.01")
    assert files.options == ("--formats=npz,depth", "--depth-scale=0.01")
    assert files.settings["layers"] == ("id", "Z")
