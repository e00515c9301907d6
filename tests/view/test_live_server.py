"""The live view over real sockets: who is let in, clients of their own, and what is left after they go."""

import asyncio
import contextlib
import functools
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

import numpy as np
import pytest
from command_line import assert_refused, needs_device, run, without_notices
from live_views import SMALL, source_of, unpacked
from processes import ROOT

aiohttp = pytest.importorskip("aiohttp", reason="aiohttp, the extra `view`, is not installed")

from clshade.base import console  # noqa: E402
from clshade.base.extras import how_to_install  # noqa: E402
from clshade.errors import InputError  # noqa: E402
from clshade.view import live_server  # noqa: E402
from clshade.view.live_scene import LiveScene  # noqa: E402
from clshade.view.live_server import HOST, LiveServer, listen  # noqa: E402
from clshade.view.live_session import Session  # noqa: E402
from clshade.view.page import live_page  # noqa: E402

pytestmark = needs_device
SECONDS = 60.0  # for anything that is waited for: the first picture may compile kernels


@contextlib.asynccontextmanager
async def serving(
    *arguments: object, opened: Callable[[], Any] = lambda: None, ends: bool = False
) -> AsyncIterator[LiveServer]:
    """Serve a scene, whose loading begins with `opened`. ends: the server ends by itself."""

    def open_scene() -> LiveScene:
        opened()
        return LiveScene(source_of(*(arguments or SMALL)))

    with listen(None) as listening:
        server = LiveServer(open_scene, listening, lambda host: live_page("x", host))
        ready = asyncio.Event()
        task = asyncio.create_task(server.serve(ready.set))
        await asyncio.wait_for(ready.wait(), SECONDS)
        try:
            yield server
            if ends:
                await asyncio.wait([task], timeout=SECONDS)
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task


class Client:
    """A client without a browser."""

    def __init__(self, ws: Any) -> None:
        self.ws = ws

    async def next(self, kind: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the next message of this type, and the arrays of a picture. Pictures are acknowledged."""
        while True:
            message = await asyncio.wait_for(self.ws.receive(), SECONDS)
            assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY), message
            if message.type == aiohttp.WSMsgType.TEXT:
                header, arrays = json.loads(message.data), {}
            else:
                header, arrays = unpacked(message.data)
                await self.send(type="shown")
            if header["type"] == kind:
                return header, arrays

    async def send(self, **message: Any) -> None:
        await self.ws.send_str(json.dumps(message))


@contextlib.asynccontextmanager
async def client(server: LiveServer) -> AsyncIterator[Client]:
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"{server.url}live", origin=f"http://{HOST}:{server.port}", max_msg_size=0) as ws,
    ):
        yield Client(ws)


def in_loop(test: Callable[..., Awaitable[None]]) -> Callable[..., None]:
    """Run an async test in a loop of its own."""

    @functools.wraps(test)
    def run_it(**fixtures: Any) -> None:
        asyncio.run(asyncio.wait_for(test(**fixtures), 3 * SECONDS))

    return run_it


async def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < end
        await asyncio.sleep(0.01)


@in_loop
async def test_only_the_own_page_with_the_token_is_let_in():
    with listen(None) as listening:
        assert listening.getsockname()[0] == "127.0.0.1"
    async with serving() as server, aiohttp.ClientSession() as session:
        host, token = f"{HOST}:{server.port}", server.token
        address, page, live = f"http://{host}", f"/{token}/", f"/{token}/live"
        assert len(token) >= 32

        async def status(path: str, **headers: str) -> int:
            async with session.get(f"{address}{path}", headers=headers) as answer:
                return answer.status

        for headers in ({}, {"Origin": address}, {"Host": f"localhost:{server.port}"}):
            assert await status(page, **headers) == 200
        for path in ("/", "/live", f"/{token}", f"/{token[:-1]}/", f"/x{token}/", "//", "/%00/", "/é/"):
            code = await status(path)
            assert code == 403 or (code == 404 and token in path), path
        for origin in ("http://evil.example", "null", f"http://localhost:{server.port}", f"https://{host}"):
            assert await status(page, Origin=origin) == 403
        for name in ("evil.example", f"evil.example:{server.port}"):
            assert await status(page, Host=name) == 403
        assert await status(live) == 403  # no Origin
        assert await status(live, Origin=address) == 400  # no WebSocket
        for origin in ("http://evil.example", f"http://{HOST}:{server.port + 1}", None):
            with pytest.raises(aiohttp.WSServerHandshakeError) as caught:
                await session.ws_connect(f"{address}{live}", origin=origin)
            assert caught.value.status == 403
        async with session.post(f"{address}{page}") as answer:
            assert answer.status == 405
        assert not server.clients
        async with session.get(server.url) as answer:
            text = await answer.text()
            assert answer.headers["Referrer-Policy"] == "no-referrer"
            assert answer.headers["Cache-Control"] == "no-store"
            assert f"connect-src ws://{host};" in text
            assert token not in text


@in_loop
async def test_the_page_is_there_before_the_scene_and_says_what_it_waits_for(monkeypatch):
    begun, compiled, draw = threading.Event(), threading.Event(), Session.draw

    def slow(*arguments: Any) -> Any:
        with console.compiling():
            assert compiled.wait(SECONDS)
        return draw(*arguments)

    monkeypatch.setattr(Session, "draw", slow)

    async with serving(opened=lambda: begun.wait(SECONDS)) as server, client(server) as one:
        async with aiohttp.ClientSession() as session, session.get(server.url) as answer:
            assert answer.status == 200
        message, _ = await one.next("state")
        assert message["state"] == "loading"
        await one.send(type="orbit", right=1.0)  # nothing happens yet
        begun.set()
        await one.next("scene")
        while message["state"] != "compiling":
            message, _ = await one.next("state")
        compiled.set()
        await one.next("image")
        while message["state"] != "idle":
            message, _ = await one.next("state")


def test_a_scene_that_cannot_be_loaded_ends_the_view_and_clients_hear_why():
    begun = threading.Event()

    def fail() -> None:
        begun.wait(SECONDS)
        raise InputError("of a\n scene")

    @in_loop
    async def check() -> None:
        async with serving(opened=fail, ends=True) as server, client(server) as one:
            await one.next("state")
            begun.set()
            assert (await one.next("failed"))[0]["text"] == "of a scene"

    with pytest.raises(InputError, match="of a"):
        check()


@pytest.mark.long
@in_loop
async def test_two_clients_have_cameras_of_their_own_and_a_lost_one_leaves_nothing():
    async with serving(*SMALL, "--samples", "4") as server:
        async with client(server) as first, client(server) as second:
            scene, _ = await first.next("scene")
            assert scene["resolution"] == [40, 30]
            await second.next("scene")
            _, before = await first.next("image")
            _, same = await second.next("image")
            np.testing.assert_array_equal(before["R"], same["R"])
            await first.send(type="orbit", right=30.0, up=5.0)
            _, moved = await first.next("image")
            assert not np.array_equal(before["R"], moved["R"])
            await second.send(type="set", lights=[0.5, 1.0])
            _, dimmed = await second.next("image")
            assert not np.array_equal(before["R"], dimmed["R"])
            assert len(server.clients) == 2
            renderers = len(server.scene.renderers)
            second.ws._response.connection.transport.abort()  # as a browser that is killed
            await until(lambda: len(server.clients) == 1)
            await server.in_drawing(lambda: None)
            assert len(server.scene.renderers) < renderers
            await first.send(type="reset")
            _, again = await first.next("image")
            np.testing.assert_array_equal(before["R"], again["R"])
        await until(lambda: not server.clients)
        await server.in_drawing(lambda: None)
        assert not server.scene.renderers


@pytest.mark.long
@in_loop
async def test_pictures_wait_for_a_client_that_does_not_show_them():
    async with serving() as server, client(server) as slow:
        await slow.next("scene")
        drawn = []
        server.stats.add = lambda drawing, interval: drawn.append(drawing)  # type: ignore[method-assign]
        for _ in range(50):
            await slow.send(type="orbit", right=1.0)
            await asyncio.sleep(0.005)
        await slow.send(type="probe", column=1, row=1)  # answered in order, after what was drawn
        kind = ""
        while kind != "probe":
            message = await asyncio.wait_for(slow.ws.receive(), SECONDS)
            kind = json.loads(message.data)["type"] if message.type == aiohttp.WSMsgType.TEXT else "picture"
        assert len(drawn) <= 2
        (session,) = (connection.session for connection in server.clients)
        await slow.send(type="shown")
        await slow.send(type="shown")
        header, _ = await slow.next("image")
        assert header["version"] == session.version  # the latest input


@in_loop
async def test_nonsense_is_answered_with_an_error_and_harms_nobody():
    async with serving() as server, client(server) as neighbor:
        await neighbor.next("image")
        for text in ("", "x", "[1]", '{"type": "orbit", "right": 1e999}', '{"type": 5}', "[" * 50_000):
            await neighbor.ws.send_str(text)
            assert (await neighbor.next("error"))[0]["text"]
        await neighbor.ws.send_bytes(b"\0" * 100)
        await neighbor.send(type="probe", column=20, row=15)
        probe, _ = await neighbor.next("probe")
        assert {"R", "G", "B", "A", "Z", "N.X", "P.Z", "id"} <= probe["values"].keys()
        async with client(server) as rude:
            await rude.ws.send_str("x" * (1 << 17))  # too long: that connection ends
            await until(lambda: len(server.clients) == 1)
        await neighbor.send(type="reset")
        await neighbor.next("image")


@pytest.mark.long
@in_loop
async def test_a_client_that_reads_nothing_holds_up_nobody(monkeypatch):
    async with serving() as server, client(server) as one:
        await until(lambda: len(server.clients) == 1)
        (deaf,) = server.clients
        one.ws._response.connection.transport.pause_reading()
        async with client(server) as neighbor:
            long = {"type": "error", "text": "x" * (24 << 20)}  # bytes: more than the buffers on the way hold
            broadcast = asyncio.create_task(server.tell_all(long))
            assert (await neighbor.next("error"))[0] == long
            assert not broadcast.done()
            monkeypatch.setattr(live_server, "SEND_SECONDS", 0.05)
            await deaf.tell(long)
            await until(lambda: deaf not in server.clients)  # cut off
            await asyncio.wait_for(broadcast, SECONDS)
            await neighbor.send(type="orbit", right=1.0)
            await neighbor.next("image")
            one.ws._response.connection.transport.abort()


@in_loop
async def test_an_unforeseen_error_is_said_and_ends_nothing(monkeypatch, capsys):
    async with serving(*SMALL, "--samples", "1") as server, client(server) as one:
        await one.next("image")

        def fail(*_: object) -> None:
            raise ZeroDivisionError("of a device")

        for method, messages in (
            ("render", [{"type": "orbit", "right": 5.0}, {"type": "probe", "column": 1, "row": 1}]),
            ("load", [{"type": "reload"}]),
        ):
            with monkeypatch.context() as patch:
                patch.setattr(server.scene, method, fail)
                for message in messages:
                    await one.send(**message)
                    assert (await one.next("error"))[0]["text"] == "internal error: ZeroDivisionError: of a device"
        await one.send(type="orbit", right=5.0)
        await one.next("image")
    assert "ZeroDivisionError: of a device" in capsys.readouterr().err


def test_the_view_ends_quietly_while_it_draws_for_clients_that_have_gone(monkeypatch, caplog, capsys):
    begun, ended = threading.Event(), threading.Event()

    def probe(*_: object, **__: object) -> dict[str, Any]:
        begun.set()
        ended.wait(SECONDS)
        return {}

    monkeypatch.setattr(Session, "probe", probe)

    @in_loop
    async def check() -> None:
        async with serving() as server, client(server) as one:
            await one.next("scene")
            await one.send(type="probe", column=1, row=1)
            await until(begun.is_set)
            one.ws._response.connection.transport.abort()
            (gone,) = server.clients
            await until(lambda: gone._transport is None or gone._transport.is_closing())

    check()  # after which what is left is cancelled
    ended.set()
    assert not caplog.records
    assert capsys.readouterr().err == ""


def test_a_port_that_is_taken_and_without_aiohttp(capsys, monkeypatch):
    with socket.create_server((HOST, 0)) as taken:
        port = taken.getsockname()[1]
        message = f"--port: expected a free port from 1 to 65535, found {port}"
        assert_refused(run(capsys, "view", *SMALL, "--port", port), message)
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    monkeypatch.delitem(sys.modules, "clshade.view.live_server")
    monkeypatch.delattr("clshade.view.live_server")
    assert_refused(run(capsys, "view", *SMALL), f"`{how_to_install('view')}`")


@pytest.mark.long
def test_an_interrupt_ends_the_view(tmp_path):
    command = [sys.executable, "-m", "clshade", "view", *SMALL, "--stats"]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, **pipes)
    assert process.stdout is not None
    url = process.stdout.readline().strip()

    async def look() -> None:
        origin = url.removesuffix(f"/{url.split('/')[3]}/")
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{url}live", origin=origin) as ws:
            one = Client(ws)
            await one.next("image")
            process.send_signal(signal.SIGINT)
            sent = time.monotonic()
            closing = (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSING, aiohttp.WSMsgType.CLOSED)
            while (await asyncio.wait_for(ws.receive(), SECONDS)).type not in closing:
                pass
            await asyncio.to_thread(process.wait, SECONDS)
            assert time.monotonic() - sent < 5.0

    asyncio.run(look())
    out, err = process.communicate(timeout=SECONDS)
    assert process.returncode == 130, err
    assert without_notices(err) == ["clshade: Ctrl-C ends the view", "clshade: interrupted"]
    assert out.split()[0] == "samples"
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OSError, match="refused"):
        socket.create_connection((HOST, int(url.split(":")[2].split("/")[0])))
