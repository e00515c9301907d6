"""Frames drawn by the workers of a Dask cluster (dask.distributed), which write the files; only figures come back.

The scene is sent once to each worker, as a plugin that latecomers get as well: scattered data would be lost with the
workers that hold it. Dask gives the tasks of a worker that is gone to others; `dispatch` keeps track of who else has
which frame, and for how long.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import re
import threading
import time
import uuid
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

from distributed import Client, Worker, WorkerPlugin, get_worker
from distributed import TimeoutError as NotInTime  # not Python's own before 3.11
from distributed.versions import VersionMismatchWarning

from ..base import console
from ..errors import InputError, WorkerError
from ..pipeline.opencl.environment import THREADS
from ..pipeline.struct_layout import kernel_folder
from .dispatch import ASK, TOPIC, Dispatcher, Members, in_a_line
from .job import DrawnFrame, FrameWriter, Job, Lost, Silent, Task
from .waiting import POLL, SILENT

T = TypeVar("T")
CLOSING = 2.0  # seconds for disconnecting from the scheduler
SENDING = 60.0  # seconds that a worker with a frame waits for the scene
COMPARED = ("python", "dask", "distributed")  # packages whose versions should be equal everywhere


def draw_on_cluster(
    job: Job, tasks: Iterable[Task], address: str, timeout: float, frame_timeout: float | None = None
) -> Iterator[DrawnFrame | Lost | Silent]:
    """Draw the tasks and yield each result as soon as it arrives, in any order; a few tasks per worker thread are taken
    ahead.

    address: of the scheduler, tcp://host:port. timeout: seconds to wait for it, for a first worker, and for another one
    when all are gone. frame_timeout: seconds after which a frame that a worker has begun is given to another one as well;
    None: wait for it.
    Raises InputError for an invalid address or one where nobody answers, WorkerError if the workers cannot draw, and what
    `FrameWriter.draw` raised in a worker.
    """
    with _hushed(), _connected(address, timeout) as client:
        members = Members(client, address)
        name = f"clshade-{uuid.uuid4().hex}"
        _send(client, _Drawing(job, code_digest()), name, members)
        dispatcher = Dispatcher(members, _draw, name, tasks, timeout, frame_timeout)
        try:
            yield from dispatcher.results()
        finally:
            with contextlib.suppress(Exception):  # a stopped scheduler or worker would never answer
                _in_time(dispatcher.close, CLOSING)
                _in_time(partial(client.unregister_worker_plugin, name), CLOSING)


# On the workers


class _Drawing(WorkerPlugin):
    """A plugin that keeps a job on a worker, and its scene on the worker's device from the first frame on."""

    def __init__(self, job: Job, digest: str) -> None:
        self._job, self._digest = job, digest
        self._writer: FrameWriter | None = None

    def setup(self, worker: Worker) -> None:
        for variable in THREADS:
            os.environ.setdefault(variable, str(worker.state.nthreads))
        self._writer = FrameWriter(self._job)

    def teardown(self, worker: Worker) -> None:
        if self._writer is not None:
            self._writer.close()

    def draw(self, task: Task, ready: Callable[[], None]) -> DrawnFrame | None:
        """Draw a frame; return None if the plugin is not set up yet."""
        if code_digest() != self._digest:
            where = get_worker().address
            raise WorkerError(
                f"worker {where}: expected the clshade that runs here, found another one: install it there"
            )
        return None if self._writer is None else self._writer.draw(task, ready)


def _draw(name: str, task: Task) -> None:
    """Draw a frame and log it as an event for `Dispatcher`: a result would have to be fetched, which takes longer, and
    forever from a stopped worker."""
    worker = get_worker()
    about = {"run": name, "key": worker.get_current_task(), "worker": worker.address}

    def say(sign: str, **more: Any) -> None:
        worker.log_event(TOPIC, {**about, "sign": sign, **more})

    say("begun")
    try:
        until = time.monotonic() + SENDING
        while True:
            plugin = worker.plugins.get(name)
            if isinstance(plugin, _Drawing) and (frame := plugin.draw(task, partial(say, "ready"))) is not None:
                break
            if time.monotonic() > until:
                raise WorkerError(f"frame {task.number}: worker {worker.address} did not get the scene")
            time.sleep(POLL)
    except BaseException:
        say("failed")
        raise
    say("drawn", drawn=asdict(frame))


@cache
def code_digest() -> str:
    """Return a digest of all code that affects an image: equal digests mean equal images."""
    digest = hashlib.sha256()
    package = Path(__file__).resolve().parent.parent
    for folder, pattern in ((package, "**/*.py"), (kernel_folder(), "*.cl*")):
        for path in sorted(folder.glob(pattern), key=lambda path: path.relative_to(folder).as_posix()):
            digest.update(path.read_bytes())
    return digest.hexdigest()


# On this machine


@contextlib.contextmanager
def _hushed() -> Iterator[None]:
    """Silence Dask's loggers: the errors raised here say the same, in one line each."""
    ours = ("distributed", "asyncio")
    loggers = [logging.getLogger(name) for name in list(logging.root.manager.loggerDict) if name.startswith(ours)]
    before = [logger.disabled for logger in loggers]
    try:
        for logger in loggers:
            logger.disabled = True
        yield
    finally:
        for logger, disabled in zip(loggers, before, strict=True):
            logger.disabled = disabled


@contextlib.contextmanager
def _connected(address: str, timeout: float) -> Iterator[Client]:
    if not re.fullmatch(r"(tcp|tls)://(\[[0-9a-fA-F:.%]+\]|[^\s:/\[\]]+):[0-9]{1,5}", address):
        raise InputError(f"--scheduler: expected an address such as tcp://host:8786, found {address!r}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VersionMismatchWarning)  # `_compare_versions` says so in one line
            client = _in_time(lambda: Client(address, timeout=timeout, set_as_default=False), timeout + CLOSING)
    except Exception as error:  # what answers there is not a scheduler
        expected = f"a Dask scheduler that answers within {timeout:g} s"
        raise InputError(f"--scheduler: {address}: expected {expected}, found {in_a_line(error)}") from None
    try:
        try:
            client.wait_for_workers(1, timeout=timeout)
        except NotInTime:
            expected = f"workers within {timeout:g} s (start some with `dask worker {address}`)"
            raise InputError(f"--scheduler: {address}: expected {expected}, found none") from None
        yield client
    finally:
        with contextlib.suppress(Exception):
            client.close(timeout=CLOSING)


def _in_time(call: Callable[[], T], seconds: float) -> T:
    """Return what `call` returns. A Client never times out if its connection is accepted but never answered."""
    answer: futures.Future[T] = futures.Future()

    def run() -> None:
        try:
            answer.set_result(call())
        except Exception as error:
            answer.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    until = time.monotonic() + seconds
    while not answer.done():
        if time.monotonic() > until:
            raise NotInTime("no answer")
        futures.wait([answer], POLL)
    return answer.result()


def _send(client: Client, plugin: _Drawing, name: str, members: Members) -> None:
    """Send the scene to all workers, and warn of differing versions, which do not stop the run."""
    members.ask()
    try:
        _in_time(partial(client.register_plugin, plugin, name=name), SILENT)
    except NotInTime:  # those that have it continue; those that come back get it then
        members.ask()
        silent = [worker for worker, clock in members.clocks.items() if clock.seconds > SILENT / 2]
        who = f"worker{'s' * (len(silent) > 1)} {', '.join(silent)}" if silent else "some of the workers"
        console.warning(f"no sign of {who} for {SILENT:g} s, at receiving the scene")
    except Exception as error:  # such as a ModuleNotFoundError of a worker without clshade
        expected = f"workers with the clshade that runs here, found {in_a_line(error)}"
        raise WorkerError(f"--scheduler: {members.scheduler}: expected {expected}") from None
    versions: Any = None
    with contextlib.suppress(Exception):  # stopped workers do not answer
        versions = _in_time(client.get_versions, ASK)
    if versions is not None:
        _compare_versions(versions)


def _compare_versions(versions: Any) -> None:
    here = versions["client"]["packages"]
    workers = {f"worker {address}": worker for address, worker in versions["workers"].items()}
    for who, there in {"the scheduler": versions["scheduler"], **workers}.items():
        theirs = there["packages"]
        differing = [name for name in COMPARED if theirs.get(name) != here.get(name)]
        if differing:
            differences = ", ".join(f"{name} {theirs.get(name)} (here {here.get(name)})" for name in differing)
            console.warning(f"{who} has {differences}")
