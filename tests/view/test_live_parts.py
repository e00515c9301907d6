"""Parts of the live view by themselves: messages, controls, commands, which names are scenes."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from live_views import unpacked
from processes import ROOT

import clshade
from clshade.view import live_input
from clshade.view.live_input import ANSWERED, MESSAGES
from clshade.view.live_session import pack_picture
from clshade.view.page import live_page

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
