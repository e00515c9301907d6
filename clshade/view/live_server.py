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
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Literal, TypeAlias

from ..base import console
from ..base.extras import how_to_install
from ..errors import ClshadeError, InputError
from .live_scene import LiveScene
from .live_session import Drawing, Session, Task
from .live_stats import LiveStats

try:
    from aiohttp import WSCloseCode, WSMsgType, web
except ImportError:
    raise InputError(f"view: needs aiohttp to serve the scene: `{how_to_install('view')}`") from None

HOST = "127.0.0.1"
AHEAD = 2  # pictures on their way to a client: one is drawn while the one before is shown
WATCH_SECONDS = 0.5
QUIET_SECONDS = 0.3  # of loading before the address is printed: a mistyped name opens no page
STATE_SECONDS = 0.1  # between looks at what the view waits for
MAX_MESSAGE = 1 << 16  # bytes, from a client
CLOSE_SECONDS = 0.2  # for clients to say goodbye
SEND_SECONDS = 30.0  # for a client to take a message; one that reads nothing is cut off

State: TypeAlias = Literal["loading", "compiling", "drawing", "idle"]  # what a client waits for

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


class LiveServer:
    """Serves a scene to any number of clients, each with a camera of its own; one thread draws for all.

    open_scene: loads it; clients can connect before. page: makes the page, given the host and port that it may connect to.
    """

    scene: LiveScene  # once `loaded` is set

    def __init__(
        self, open_scene: Callable[[], LiveScene], listening: socket.socket, page: Callable[[str], str]
    ) -> None:
        self.stats, self.loaded = LiveStats(), asyncio.Event()
        self._open_scene = open_scene
        self._works = 0  # functions that wait for the thread that draws, or run in it
        self._state: State = "loading"
        self._since = time.monotonic()  # the state's begin
        self.clients: set[_Client] = set()
        self.token = secrets.token_urlsafe(24)
        self._socket, self._page = listening, page
        self.port: int = listening.getsockname()[1]
        self.drawing = ThreadPoolExecutor(1, "clshade-view")
        self.is_outdated = False  # whether a file of the scene is another than was read

    @property
    def url(self) -> str:
        return f"http://{HOST}:{self.port}/{self.token}/"

    def application(self) -> web.Application:
        app = web.Application(middlewares=[self._guard], client_max_size=1)
        app.router.add_get("/{token}/", self._serve_page)
        app.router.add_get("/{token}/live", self._serve_client)
        return app

    async def serve(self, ready: Callable[[], None] | None = None) -> None:
        """Serve until Ctrl-C, or until cancelled. ready: called once clients can connect. Raises what loading raises."""
        runner = web.AppRunner(
            self.application(), access_log=None, handle_signals=False, shutdown_timeout=CLOSE_SECONDS
        )
        await runner.setup()
        tasks: list[asyncio.Task[Any]] = []
        try:
            await web.SockSite(runner, self._socket).start()
            with _interrupted() as stopped:
                works = (self._show(), self._tell_state(), stopped.wait())
                tasks += map(asyncio.create_task, (self.loaded.wait(), *works))
                await asyncio.wait(tasks, timeout=QUIET_SECONDS, return_when=asyncio.FIRST_COMPLETED)
                if ready is not None and not any(task.done() for task in tasks[1:]):
                    ready()
                done, _ = await asyncio.wait(tasks[1:], return_when=asyncio.FIRST_COMPLETED)
                for task in done:
                    task.result()
        finally:
            for task in tasks:
                task.cancel()
            goodbyes = [each.socket.close(code=WSCloseCode.GOING_AWAY) for each in self.clients]
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
        own = host in (f"{HOST}{port}", f"localhost{port}") and origin in (None, f"http://{host}")
        token = request.path.split("/")[1] if request.path.startswith("/") else ""
        right = secrets.compare_digest(token.encode("utf-8", "replace"), self.token.encode())
        if not own or not right:
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
        size = {name: int(value) for name, value in request.query.items() if value.isdecimal() and len(value) < 6}
        client = _Client(self, ws, request.transport, size)
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
        self._works += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self.drawing, function, *arguments)
        finally:
            self._works -= 1

    # What clients wait for

    async def _show(self) -> None:
        """Load the scene, compile while nobody is there whose pictures do, then watch the scene's files."""
        try:
            self.scene = await self.in_drawing(self._open_scene)
            self.loaded.set()
            for last in (False, True):
                if not self.clients:
                    await self.in_drawing(partial(self.scene.prepare, last=last))
        except Exception as error:
            await self.tell_all({"type": "failed", "text": " ".join(str(error).split())})
            raise
        await self._watch()

    async def _tell_state(self) -> None:
        """Tell clients when they wait for something else."""
        while True:
            await asyncio.sleep(STATE_SECONDS)
            state: State = "idle"
            if not self.loaded.is_set():
                state = "loading"
            elif self._works:
                # Between two kernels the compiler is not at work.
                state = "compiling" if console.is_compiling() or self._state == "compiling" else "drawing"
            if state != self._state:
                self._state, self._since = state, time.monotonic()
                await self.tell_all(self.state())

    def state(self) -> dict[str, Any]:
        """Return the message on what clients wait for, and for how many seconds they have."""
        return {"type": "state", "state": self._state, "seconds": round(time.monotonic() - self._since, 1)}

    # The scene's files

    async def _watch(self) -> None:
        """Tell clients when a file of the scene is no longer the one that was read."""
        while True:
            await asyncio.sleep(WATCH_SECONDS)
            outdated = self.scene.source.stamps() != self.scene.stamps
            if outdated != self.is_outdated:
                self.is_outdated = outdated
                await self.tell_all({"type": "changed", "changed": outdated})

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
    """A connected page: its session, None until the scene is loaded, and the pictures on their way to it.

    size: of its window, columns and rows, pixels; empty: the pictures' own.
    """

    def __init__(
        self,
        server: LiveServer,
        ws: web.WebSocketResponse,
        transport: asyncio.BaseTransport | None,
        size: dict[str, Any],
    ) -> None:
        self.server, self.socket, self._transport = server, ws, transport
        self.session: Session | None = None
        self._size = size
        self.changed = asyncio.Event()  # something may be due
        self._on_the_way = 0

    async def tell(self, message: dict[str, Any]) -> None:
        with contextlib.suppress(ConnectionError, RuntimeError):  # it is closing
            await self._sent(self.socket.send_str(json.dumps(message)))

    async def describe(self) -> None:
        if self.session is not None:
            await self.tell({"type": "scene", **self.session.description()})

    async def _sent(self, sending: Awaitable[None]) -> None:
        """Send, or cut the client off if it does not take the message: it must hold up nobody else."""
        # Not `wait_for`: aiohttp lets all who send to a client wait for one future, and each who is cancelled cancels it.
        cutting = asyncio.get_running_loop().call_later(SEND_SECONDS, self._cut_off)
        try:
            await sending
        finally:
            cutting.cancel()

    def _cut_off(self) -> None:
        if isinstance(self._transport, asyncio.WriteTransport):
            self._transport.abort()

    async def run(self) -> None:
        """Handle input and send pictures until the connection ends."""
        await self.tell(self.server.state())
        tasks = [asyncio.create_task(each) for each in (self._receive(), self._send_pictures())]
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
                await self._handle(message.data)

    async def _handle(self, text: str) -> None:
        try:
            message = json.loads(text)
            if not isinstance(message, dict):
                raise InputError("view: message: expected an object")
            session, kind = self.session, message.get("type")
            if session is None:
                self._size = message if kind == "size" else self._size
                return  # nothing else to change yet
            if kind == "shown":
                self._on_the_way = max(0, self._on_the_way - 1)
            elif kind == "probe":
                place = message.get("column"), message.get("row")
                await self.tell({"type": "probe", **await self.server.in_drawing(session.probe, *place)})
            elif kind == "snapshot":
                await self.tell({"type": "snapshot", **await self.server.in_drawing(session.snapshot)})
            elif kind == "reload":
                await self.server.reload()
            elif kind == "command":
                await self.tell({"type": "command", "command": await self.server.in_drawing(session.command)})
            elif kind == "set":
                await self._set(session, message)
            else:
                session.handle(message)
        except Exception as error:
            await self.tell({"type": "error", "text": _line(error)})
        self.changed.set()

    async def _set(self, session: Session, message: dict[str, Any]) -> None:
        """Change settings; tell the client if they are not those that it knows, or allow others."""
        before = session.options()
        if "environment" in message:
            await self.server.in_drawing(session.checked_environment, message["environment"])
        session.handle(message)
        if session.options() != before:
            await self.tell({"type": "options", **session.options()})

    async def _send_pictures(self) -> None:
        await self.server.loaded.wait()
        session = self.session = Session(self.server.scene)
        if self._size:
            with contextlib.suppress(InputError):
                session.handle({**self._size, "type": "size"})
        await self.describe()
        if self.server.is_outdated:
            await self.tell({"type": "changed", "changed": True})
        while True:
            self.changed.clear()
            due = session.due() if self._on_the_way < AHEAD else None
            if not isinstance(due, Task):
                with contextlib.suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(self.changed.wait(), due)
                continue
            drawing = await self._drawn(session, due)
            if drawing is not None:
                self._on_the_way += 1
                await self._sent(self.socket.send_bytes(drawing.message))

    async def _drawn(self, session: Session, task: Task) -> Drawing | None:
        """Draw a picture; if that fails, tell the client and go on."""
        loop = asyncio.get_running_loop()
        start = loop.time()
        drawing: Drawing | None = None
        try:
            drawing = await self.server.in_drawing(session.draw, task)
        except Exception as error:
            await self.tell({"type": "error", "text": _line(error)})
        session.drawn(task, drawing.ms if drawing else (loop.time() - start) * 1e3)
        if drawing is not None:
            self.server.stats.add(session, drawing, loop.time())
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


@contextlib.contextmanager
def _interrupted() -> Iterator[asyncio.Event]:
    """Yield an event that SIGINT sets, where the system and the thread allow it: the loop would sleep through it."""
    loop, stopped = asyncio.get_running_loop(), asyncio.Event()
    caught = False
    with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):
        loop.add_signal_handler(signal.SIGINT, stopped.set)
        caught = True
    try:
        yield stopped
    finally:
        if caught:
            loop.remove_signal_handler(signal.SIGINT)
