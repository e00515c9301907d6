"""The live view on loopback: a page, and a WebSocket for pictures and input. Needs aiohttp, the extra `view`."""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
import signal
import socket
import time
import traceback
from collections import defaultdict, deque
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np

from ..base import console, text_tables
from ..base.extras import how_to_install
from ..errors import ClshadeError, InputError
from .live_input import ANSWERED
from .live_scene import LiveScene
from .live_session import Drawing, Session, Task

try:
    from aiohttp import WSCloseCode, WSMsgType, web
except ImportError:
    raise InputError(f"view: needs aiohttp to serve the scene: `{how_to_install('view')}`") from None

HOST = "127.0.0.1"
MAX_IN_FLIGHT = 2  # pictures on their way to a client: one is drawn while the one before is shown
WATCH_SECONDS = 0.5  # between looks at the scene's files
QUIET_SECONDS = 0.3  # of loading before the address is printed: a mistyped name opens no page
STATE_SECONDS = 0.1  # between looks at what the view waits for
MAX_MESSAGE = 1 << 16  # bytes, from a client
CLOSE_SECONDS = 0.2  # for clients to say goodbye
SEND_SECONDS = 30.0  # for a client to take a message; one that reads nothing is cut off
KEPT_TIMES = 10_000  # of pictures, of each kind

_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",  # the token is part of the address
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


def listen(port: int | None) -> socket.socket:
    """Return a socket that listens on the loopback address, on a free port without `port`. Raises InputError."""
    try:
        return socket.create_server((HOST, port or 0))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"--port: expected a free port from 1 to 65535, found {port}: {reason}") from None


class LiveStats:
    """Times of the pictures of all clients, by samples and scale, and how fast they followed each other in motion."""

    def __init__(self) -> None:
        self._times: dict[tuple[int, int], deque[dict[str, float]]] = defaultdict(lambda: deque(maxlen=KEPT_TIMES))
        self._intervals: deque[float] = deque(maxlen=KEPT_TIMES)

    def add(self, drawing: Drawing, interval: float | None) -> None:
        """Note a picture. interval: since the one before, s, if both were in motion: the pace at which a client shows
        pictures."""
        step = drawing.task.step
        self._times[step.samples, step.scale].append(drawing.times_ms)
        if interval is not None:
            self._intervals.append(interval)

    def lines(self) -> list[str]:
        """Return a table of medians in ms, and the frames per second in motion; empty if nothing was drawn."""
        if not self._times:
            return []
        names = list(dict.fromkeys(name for kind in self._times.values() for times in kind for name in times))
        rows = []
        for (samples, scale), kind in sorted(self._times.items()):
            values = ([times[name] for times in kind if name in times] for name in names)
            medians = [f"{np.median(ms):.2f}" if ms else "-" for ms in values]
            rows.append([f"{samples}", f"1/{scale**2}" if scale > 1 else "all", f"{len(kind):,}", *medians])
        lines = text_tables.as_lines(["samples", "pixels", "pictures", *(f"{name} ms" for name in names)], rows)
        if self._intervals:
            rate = 1.0 / float(np.median(self._intervals))
            lines.append(f"in motion {rate:.1f} frames/s, median of {len(self._intervals):,} intervals")
        return lines


class LiveServer:
    """Serves a scene to any number of clients, each with its camera; one thread draws for all.

    open_scene: loads it; clients can connect before. page: makes the page for the host and port that it may connect to.
    """

    scene: LiveScene  # once `loaded` is set

    def __init__(
        self, open_scene: Callable[[], LiveScene], listening: socket.socket, page: Callable[[str], str]
    ) -> None:
        self.stats, self.loaded = LiveStats(), asyncio.Event()
        self._open_scene, self._socket, self._page = open_scene, listening, page
        self._pending = 0  # functions that wait for the thread that draws, or run in it
        # What clients wait for: loading, compiling, drawing or idle; and when that began.
        self._state, self._since = "loading", time.monotonic()
        self.clients: set[_Client] = set()
        self.token = secrets.token_urlsafe(24)
        self.port: int = listening.getsockname()[1]
        self.drawing = ThreadPoolExecutor(1, "clshade-view")
        self.is_outdated = False  # whether a file of the scene has changed since it was read

    @property
    def url(self) -> str:
        return f"http://{HOST}:{self.port}/{self.token}/"

    async def serve(self, ready: Callable[[], None] | None = None) -> None:
        """Serve until Ctrl-C, or until cancelled. ready: called once clients can connect. Raises what loading raises."""
        app = web.Application(middlewares=[self._guard], client_max_size=1)
        app.add_routes([web.get("/{token}/", self._serve_page), web.get("/{token}/live", self._serve_client)])
        runner = web.AppRunner(app, access_log=None, handle_signals=False, shutdown_timeout=CLOSE_SECONDS)
        await runner.setup()
        loop, stopped = asyncio.get_running_loop(), asyncio.Event()
        tasks: list[asyncio.Task[Any]] = []
        try:
            await web.SockSite(runner, self._socket).start()
            # Where the system and the thread allow it: the loop would sleep through the signal.
            with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):
                loop.add_signal_handler(signal.SIGINT, stopped.set)
            works = (self.loaded.wait(), self._show(), self._tell_state(), stopped.wait())
            tasks += map(asyncio.create_task, works)
            await asyncio.wait(tasks, timeout=QUIET_SECONDS, return_when=asyncio.FIRST_COMPLETED)
            if ready is not None and not any(task.done() for task in tasks[1:]):
                ready()
            done, _ = await asyncio.wait(tasks[1:], return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            with contextlib.suppress(NotImplementedError):
                loop.remove_signal_handler(signal.SIGINT)
            for task in tasks:
                task.cancel()
            goodbyes = [client.socket.close(code=WSCloseCode.GOING_AWAY) for client in self.clients]
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(asyncio.gather(*goodbyes, return_exceptions=True), CLOSE_SECONDS)
            await runner.cleanup()
            # Not shut down, it ends with the server: handlers of clients that have gone outlive the cleanup, and use it.
            if self.loaded.is_set():
                self.drawing.submit(self.scene.close)

    # Requests

    @web.middleware
    async def _guard(self, request: web.Request, handler: Callable[[web.Request], Awaitable[Any]]) -> Any:
        """Refuse other hosts (DNS rebinding), other origins (pages of other sites) and other tokens."""
        host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        port = "" if self.port == 80 else f":{self.port}"  # as browsers write it
        is_own = host in (f"{HOST}{port}", f"localhost{port}") and origin in (None, f"http://{host}")
        token = request.path.split("/")[1] if request.path.startswith("/") else ""
        if not secrets.compare_digest(token.encode("utf-8", "replace"), self.token.encode()) or not is_own:
            return web.Response(status=403, text="403: the address printed by `clshade view` is needed\n")
        response = await handler(request)
        if not response.prepared:
            response.headers.update(_HEADERS)
        return response

    async def _serve_page(self, request: web.Request) -> web.Response:
        return web.Response(text=self._page(request.host), content_type="text/html")

    async def _serve_client(self, request: web.Request) -> web.StreamResponse:
        if "Origin" not in request.headers:  # browsers always send it
            return web.Response(status=403, text="403: a WebSocket needs an Origin\n")
        # Compression would take longer than the loopback interface.
        ws = web.WebSocketResponse(compress=False, max_msg_size=MAX_MESSAGE, heartbeat=30.0)
        await ws.prepare(request)
        client = _Client(self, ws, request)
        self.clients.add(client)
        try:
            await client.run()
        finally:
            self.clients.discard(client)
            if client.session is not None:
                # Without waiting for pictures before it: the view may be ending.
                self.drawing.submit(client.session.close)
        return ws

    async def in_drawing(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run a function in the thread that draws."""
        self._pending += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self.drawing, function, *arguments)
        finally:
            self._pending -= 1

    # What clients wait for

    async def _show(self) -> None:
        """Load the scene, compile while nobody is there whose pictures do, then tell clients when its files change."""
        try:
            self.scene = await self.in_drawing(self._open_scene)
            self.loaded.set()
            for last in (False, True):
                if not self.clients:
                    await self.in_drawing(partial(self.scene.prepare, last=last))
        except Exception as error:
            await self.tell_all({"type": "failed", "text": " ".join(str(error).split())})
            raise
        while True:
            await asyncio.sleep(WATCH_SECONDS)
            was_outdated, self.is_outdated = self.is_outdated, self.scene.source.stamps() != self.scene.stamps
            if self.is_outdated != was_outdated:
                await self.tell_all({"type": "changed", "changed": self.is_outdated})

    async def _tell_state(self) -> None:
        """Tell clients when they wait for something else."""
        while True:
            await asyncio.sleep(STATE_SECONDS)
            # Between two kernels the compiler is not at work.
            compiling = console.is_compiling() or self._state == "compiling"
            state = ("compiling" if compiling else "drawing") if self._pending else "idle"
            state = state if self.loaded.is_set() else "loading"
            if state != self._state:
                self._state, self._since = state, time.monotonic()
                await self.tell_all(self.state())

    def state(self) -> dict[str, Any]:
        """Return the message on what clients wait for, and for how many seconds they have."""
        return {"type": "state", "state": self._state, "seconds": round(time.monotonic() - self._since, 1)}

    async def reload(self) -> None:
        """Read the scene again, for all clients."""
        try:
            await self.in_drawing(self.scene.load)
        except Exception as error:
            await self.tell_all({"type": "error", "text": _line(error)})
            return
        self.is_outdated = False
        for client in self.clients:
            if client.session is not None:
                client.session.reloaded()
                client.changed.set()
        await asyncio.gather(*(client.describe() for client in self.clients), return_exceptions=True)

    async def tell_all(self, message: dict[str, Any]) -> None:
        await asyncio.gather(*(client.tell(message) for client in self.clients), return_exceptions=True)


class _Client:
    """A connected page. request: its query may have the size of the window, columns and rows."""

    def __init__(self, server: LiveServer, socket: web.WebSocketResponse, request: web.Request) -> None:
        self.server, self.socket, self._transport = server, socket, request.transport
        size = {name: int(value) for name, value in request.query.items() if value.isdecimal() and len(value) < 6}
        self._size: dict[str, Any] = {**size, "type": "size"}  # the latest message of this type
        self.session: Session | None = None  # until the scene is loaded
        self.changed = asyncio.Event()  # something may be due
        self._in_flight = 0  # pictures on their way
        self._moved_at: float | None = None  # when the latest picture was drawn, if it was in motion

    async def tell(self, message: dict[str, Any]) -> None:
        with contextlib.suppress(ConnectionError, RuntimeError):  # it is closing
            await self._sent(self.socket.send_str(json.dumps(message)))

    async def describe(self) -> None:
        if self.session is not None:
            await self.tell({"type": "scene", **self.session.description()})

    async def _sent(self, sending: Awaitable[None]) -> None:
        """Send, or cut the client off if it does not take the message: it must hold up nobody else."""

        def cut_off() -> None:
            if isinstance(self._transport, asyncio.WriteTransport):
                self._transport.abort()

        # Not `wait_for`: aiohttp lets all who send to a client wait for one future, which any cancelled one cancels.
        timer = asyncio.get_running_loop().call_later(SEND_SECONDS, cut_off)
        try:
            await sending
        finally:
            timer.cancel()

    async def run(self) -> None:
        """Handle input and send pictures until the connection ends."""
        await self.tell(self.server.state())
        tasks = [asyncio.create_task(self._receive()), asyncio.create_task(self._send_pictures())]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        for task in done:
            with contextlib.suppress(ConnectionError):
                task.result()

    async def _receive(self) -> None:
        async for message in self.socket:
            if message.type == WSMsgType.TEXT:
                try:
                    await self._handle(json.loads(message.data))
                except Exception as error:
                    await self.tell({"type": "error", "text": _line(error)})
                self.changed.set()

    async def _handle(self, message: Any) -> None:
        if not isinstance(message, dict):
            raise InputError("view: message: expected an object")
        session, kind = self.session, message.get("type")
        if session is None:
            self._size = message if kind == "size" else self._size  # nothing else to change yet
        elif kind == "shown":
            self._in_flight = max(0, self._in_flight - 1)
        elif kind == "reload":
            await self.server.reload()
        else:
            if kind == "set" and "environment" in message:
                await self.server.in_drawing(session.checked_environment, message["environment"])
            takes_time = kind in ANSWERED
            reply = await self.server.in_drawing(session.handle, message) if takes_time else session.handle(message)
            if reply is not None:
                await self.tell(reply)

    async def _send_pictures(self) -> None:
        await self.server.loaded.wait()
        session = self.session = Session(self.server.scene)
        with contextlib.suppress(InputError):
            session.handle(self._size)
        await self.describe()
        if self.server.is_outdated:
            await self.tell({"type": "changed", "changed": True})
        while True:
            self.changed.clear()
            due = session.due() if self._in_flight < MAX_IN_FLIGHT else None
            if not isinstance(due, Task):
                with contextlib.suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(self.changed.wait(), due)
                continue
            drawing = await self._drawn(session, due)
            if drawing is not None:
                self._in_flight += 1
                await self._sent(self.socket.send_bytes(drawing.message))

    async def _drawn(self, session: Session, task: Task) -> Drawing | None:
        """Draw a picture; if that fails, tell the client and go on."""
        start = time.monotonic()
        try:
            drawing: Drawing = await self.server.in_drawing(session.draw, task)
        except Exception as error:
            await self.tell({"type": "error", "text": _line(error)})
            session.drawn(task, (time.monotonic() - start) * 1e3)
            return None
        session.drawn(task, drawing.ms)
        now, before = time.monotonic(), self._moved_at
        self.server.stats.add(drawing, now - before if task.is_first and before is not None else None)
        self._moved_at = now if task.is_first else None
        return drawing


def _line(error: Exception) -> str:
    """Return a line on an error for clients. An unforeseen one is printed, too: the view goes on."""
    text = " ".join(str(error).split())
    if isinstance(error, (ClshadeError, ValueError, RecursionError)):
        return text
    if isinstance(error, MemoryError):
        return f"out of memory: {text}"
    traceback.print_exception(error)
    return f"internal error: {type(error).__name__}: {text}"
