"""The live view in a browser: mouse and keys, values as rendered, and controls."""

import asyncio
import contextlib
import json
import shlex
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsers import until
from clusters import wait_until
from command_line import needs_device
from live_views import source_of
from scene_files import write

pytest.importorskip("aiohttp", reason="aiohttp, the extra `view`, is not installed")

import clshade
from clshade import exr
from clshade.cli.main import main
from clshade.view.live_scene import LiveScene
from clshade.view.live_server import LiveServer, listen
from clshade.view.page import live_page

pytestmark = [needs_device, pytest.mark.long]

SMALL = ("quads", "--resolution", "160,120", "--samples", "4")
STILL = "live.header?.last && !live.viewer.frame && !live.controls.turning"


@contextlib.contextmanager
def served(*arguments: object) -> Iterator[LiveServer]:
    """Serve a scene in a thread with a loop of its own."""
    with listen(None) as listening:
        open_scene = partial(LiveScene, source_of(*arguments))
        server = LiveServer(open_scene, listening, lambda host: live_page("a scene", host))
        loop, ready = asyncio.new_event_loop(), threading.Event()
        task = loop.create_task(server.serve(ready.set))
        with ThreadPoolExecutor(1) as pool:
            ended = pool.submit(loop.run_until_complete, task)
            assert ready.wait(60.0)
            try:
                yield server
            finally:
                loop.call_soon_threadsafe(task.cancel)
                with contextlib.suppress(asyncio.CancelledError):
                    ended.result(60.0)
                loop.close()


@contextlib.contextmanager
def shown(browser: Any, *arguments: object) -> Iterator[Any]:
    """Yield the page of a live view; afterwards nothing may have gone wrong in it."""
    with served(*arguments) as server:
        page = browser.new_page(viewport={"width": 1000, "height": 700})
        faults: list[str] = []
        page.on("console", lambda message: faults.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.goto(server.url)
        page.server = server
        try:
            until(page, "live.counts.all > 0")
            yield page
            assert [fault for fault in faults if "GPU stall due to ReadPixels" not in fault] == []
        finally:
            page.close()


def at_rest(page: Any) -> int:
    """Wait until the final picture of the server's latest view is shown; return its version."""
    # Input is sent in an animation frame; what the server has answered to came after it.
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    page.wait_for_timeout(100)  # input on its way
    ends = time.monotonic() + 60.0
    while time.monotonic() < ends:
        version: int = page.evaluate(f"{STILL} ? live.header.version : -1")
        if any(version == client.session.version for client in page.server.clients):
            return version
        page.wait_for_timeout(20)
    raise AssertionError("the view does not come to rest")


def channel(page: Any, name: str) -> np.ndarray:
    image = "live.viewer.image"
    rows, columns, values = page.evaluate(f"[{image}.height, {image}.width, [...{image}.channels.get('{name}').data]]")
    return np.array(values, np.float32).reshape(rows, columns)


def test_mouse_keys_and_values(browser, folder, capsys):
    with shown(browser, *SMALL) as page:
        at_rest(page)
        frame = clshade.render(clshade.builtin("quads"), resolution=(160, 120), samples=4)
        for k, name in enumerate("RGB"):
            np.testing.assert_array_equal(channel(page, name), frame.rgb[..., k])
        assert page.evaluate("live.motion.canvas.hidden")

        def drag(button: str, x: int, y: int) -> None:
            page.mouse.down(button=button)
            page.mouse.move(x, y, steps=4)
            page.mouse.up(button=button)

        moves = {
            "drag": lambda: (page.mouse.move(300, 300), drag("left", 360, 320)),
            "right drag": lambda: drag("right", 330, 300),
            "wheel": lambda: page.mouse.wheel(0, -120),
            "w": lambda: (page.keyboard.down("w"), page.wait_for_timeout(150), page.keyboard.up("w")),
            "t": lambda: (page.keyboard.press("t"), page.wait_for_timeout(800), page.keyboard.press("t")),
        }
        eyes = [page.evaluate("live.header.camera.eye")]
        for name, move in moves.items():
            move()
            at_rest(page)
            eyes.append(page.evaluate("live.header.camera.eye"))
            assert eyes[-1] != eyes[-2], name
        # What is shown is what the snapshot's command renders.
        page.click("#snapshot")
        command = until(page, "document.querySelector('#written code')?.textContent")
        assert main([*shlex.split(command)[1:-1], "again"]) == 0, capsys.readouterr()
        written, again = exr.read("quads-1.exr")[0], exr.read("again.exr")[0]
        for name in "RGB":
            np.testing.assert_array_equal(channel(page, name), again[name])
            np.testing.assert_array_equal(written[name], again[name])
        # A click pins a pixel, whose values come from the server: also those of layers that are not shown.
        page.mouse.click(350, 330)
        rows = until(page, "live.probedValues && [...live.others.children].map((row) => row.firstChild.textContent)")
        assert {"Z", "N", "P", "id", "uv"} <= set(rows)
        place = page.evaluate("[live.viewer.pinned.y, live.viewer.pinned.x]")
        values = page.evaluate("live.probedValues")
        for name in "RGB":
            assert np.float32(values[name]) == again[name][tuple(place)]


def test_controls(browser):
    with shown(browser, *SMALL, "--tonemap", "aces", "--exposure", "1") as page:
        at_rest(page)
        before = channel(page, "R")
        tonemap = page.evaluate("viewer.settings.operator")
        page.evaluate("viewer.set({ operator: 'hable', exposure: 2 })")
        page.keyboard.press("r")  # back to the scene's own
        assert page.evaluate("[viewer.settings.operator, viewer.settings.exposure]") == [tonemap, 1.0]
        page.evaluate("viewer.set({ exposure: 0 })")
        page.click("#layers .toggles button:text-is('Z')")
        at_rest(page)
        depth = clshade.render(clshade.builtin("quads"), resolution=(160, 120), samples=4, layers="Z")["Z"]
        np.testing.assert_array_equal(channel(page, "Z"), depth)
        page.click("#layers table button:text-is('Z')")  # pictures in motion are then those of the layer
        until(page, "JSON.parse(live.display).as_floats")
        at_rest(page)
        page.keyboard.press("t")
        until(page, "live.header.moving && live.header.type === 'image'")
        page.keyboard.press("t")
        page.click("#live .buttons button:text-is('Reset')")
        at_rest(page)
        page.click("#layers table button:text-is('RGB')")
        at_rest(page)
        np.testing.assert_array_equal(channel(page, "R"), before)
        page.click(".light input[type=checkbox] >> nth=0")
        at_rest(page)
        assert not np.array_equal(channel(page, "R"), before)
        page.click(".light input[type=checkbox] >> nth=0")
        at_rest(page)
        np.testing.assert_array_equal(channel(page, "R"), before)
        page.click("#live .choice button:text-is('No light')")
        at_rest(page)
        assert not np.array_equal(channel(page, "R"), before)
        page.fill("#adjust input[type=number] >> nth=0", "1.5")
        page.keyboard.press("Enter")
        (client,) = page.server.clients
        until(page, "JSON.parse(live.display).exposure === 1.5")
        wait_until(lambda: client.session.display.exposure == 1.5, 60.0)


def test_the_picture_has_the_window_s_pixels(browser):
    with served("teapot", "--samples", "1") as server:
        page = browser.new_page(viewport={"width": 700, "height": 300}, device_scale_factor=2)
        page.server = server
        page.goto(server.url)
        until(page, STILL)
        sizes = "[live.header.full, [live.viewer.canvas.width, live.viewer.canvas.height], live.viewer.view]"
        full, canvas, view = page.evaluate(sizes)
        assert full == canvas
        assert canvas[1] == 600
        assert view == {"x": 0, "y": 0, "zoom": 1}
        page.set_viewport_size({"width": 660, "height": 250})
        until(page, "live.header.full[1] === 500 && live.header.last")
        at_rest(page)
        full, canvas, view = page.evaluate(sizes)
        assert full == canvas
        assert channel(page, "R").shape == (500, canvas[0])
        page.close()


def test_switches_and_the_command_that_draws_this(browser, tmp_path, capsys):
    path = write(tmp_path / "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    environment = "#live .choose:has-text('Environment') button:text-is('None')"
    intensity = "#live input[type=number][aria-label='Intensity of the environment']"
    command_text = "live.panel.commandText.firstChild?.textContent"
    with shown(browser, path, "--resolution", "80,60", "--samples", "1") as page:
        at_rest(page)
        for action in (  # in the studio, then in the default lights
            lambda: (page.fill(intensity, "0.5"), page.keyboard.press("Enter")),
            lambda: page.click(environment),
            lambda: page.click("#live .switch:has-text('Shadows')"),
            lambda: page.click("#live .choice button:text-is('Phong')"),
            lambda: page.click("#live .choose:has-text('Occlusion') button:text-is('16')"),
            lambda: page.click("#live .switch:has-text('Ground')"),
            lambda: page.click("#live .choose:has-text('Background') button:text-is('Color')"),
        ):
            before, former = channel(page, "R"), until(page, command_text)
            action()
            until(page, f"{command_text} !== {json.dumps(former)}")
            at_rest(page)
            command = page.evaluate(command_text)
            assert main([*shlex.split(command)[1:], "-o", str(tmp_path / "again")]) == 0, capsys.readouterr()
            np.testing.assert_array_equal(channel(page, "R"), exr.read(tmp_path / "again.exr")[0]["R"])
            assert not np.array_equal(channel(page, "R"), before), command
        assert page.is_hidden(environment)
        assert {"--environment=none", "--ambient-occlusion=16"} <= set(shlex.split(command))
        page.click("#live .choice button:text-is('No light')")
        until(page, "!document.querySelector('#live .switch').checkVisibility()")
        headings = "[...document.querySelectorAll('h2')].filter((each) => each.innerText.startsWith('Layers')).length"
        assert page.evaluate(headings) == 1


def test_a_file_that_changes_and_the_end_of_the_server(browser, tmp_path):
    path = Path(write(tmp_path / "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"))
    with shown(browser, path, "--resolution", "80,60", "--samples", "1") as page:
        at_rest(page)
        before = channel(page, "R")
        assert page.is_hidden("#changed")
        path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n")
        page.click("#changed button")
        at_rest(page)
        assert not np.array_equal(channel(page, "R"), before)
        until(page, "document.getElementById('changed').hidden")
        path.write_text("nonsense")
        page.click("#changed button")
        until(page, "document.getElementById('notice').textContent.includes('a.obj')")
        (client,) = page.server.clients
        asyncio.run_coroutine_threadsafe(client.socket.close(), client.socket._loop).result(10.0)
        until(page, "document.body.classList.contains('ended')")
