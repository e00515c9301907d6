"""Frames drawn by the workers of a Dask cluster (dask.distributed), which write the files; only figures come back.

The scene travels once to each worker, as a plugin that late comers get as well: data that is scattered would be lost
with the workers that have it. Dask gives the tasks of a worker that is gone to others.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import queue
import re
import threading
import time
import uuid
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from distributed import CancelledError, Client, Future, KilledWorker, Worker, WorkerPlugin, get_worker
from distributed import TimeoutError as NotInTime  # not Python's own before 3.11
from distributed.versions import VersionMismatchWarning

from .. import telling
from ..errors import ClshadeError, InputError, WorkerError
from ..frame import output_paths
from ..programs import kernel_folder
from .job import THREADS, Drawn, FrameWriter, Job, Lost, Task

T = TypeVar("T")
POLL = 0.1  # seconds after which Python looks whether there was an interrupt
ASK = 1.0  # seconds after which the scheduler is asked whether there are workers
CLOSING = 2.0  # seconds for saying goodbye to the scheduler
VISIBLE = 10.0  # seconds until a file that a worker wrote is here: network file systems take some
COMPARED = ("python", "dask", "distributed")  # packages whose versions had better be equal everywhere


def draw_on_cluster(job: Job, tasks: Sequence[Task], address: str, timeout: float) -> Iterator[Drawn | Lost]:
    """Draws the tasks and gives what came of each as soon as it is there, in any order.

    address: of the scheduler, tcp://host:port. timeout: seconds to wait for it, for a first worker, and for another one
    when all are gone.
    Raises InputError for an address that is none or that nobody answers at, WorkerError where the workers cannot do it,
    and what `FrameWriter.draw` did in a worker.
    """
    with _hushed(), _connected(address, timeout) as client:
        _compare_versions(client)
        name = f"clshade-{uuid.uuid4().hex}"
        _send(client, _Drawing(job, code_digest()), name, address)
        run = _Run(client, name, tasks, address, timeout)
        try:
            yield from run.results()
        finally:
            with contextlib.suppress(Exception):  # the scheduler may be gone, and what came before matters more
                client.unsubscribe_topic("all")
                client.cancel(list(run.futures), asynchronous=False)
                client.unregister_worker_plugin(name)


# On the workers


class _Drawing(WorkerPlugin):
    """Keeps a job on a worker, and its scene on the worker's device from the first frame on."""

    def __init__(self, job: Job, digest: str) -> None:
        self._job, self._digest = job, digest

    def setup(self, worker: Worker) -> None:
        for variable in THREADS:
            os.environ.setdefault(variable, str(worker.state.nthreads))
        self._writer = FrameWriter(self._job)

    def teardown(self, worker: Worker) -> None:
        self._writer.close()

    def draw(self, task: Task) -> Drawn:
        if code_digest() != self._digest:
            where = get_worker().address
            raise WorkerError(
                f"worker {where}: expected the clshade that runs here, found another one: install it there"
            )
        return self._writer.draw(task)


def _draw(name: str, task: Task) -> Drawn:
    plugin = get_worker().plugins[name]
    assert isinstance(plugin, _Drawing)
    return plugin.draw(task)


@cache
def code_digest() -> str:
    """Of all code that makes an image: where it is equal, images are."""
    digest = hashlib.sha256()
    package = Path(__file__).resolve().parent.parent
    for folder, pattern in ((package, "**/*.py"), (kernel_folder(), "*.cl*")):
        for path in sorted(folder.glob(pattern), key=lambda path: path.relative_to(folder).as_posix()):
            digest.update(path.read_bytes())
    return digest.hexdigest()


# Here


@contextlib.contextmanager
def _hushed() -> Iterator[None]:
    """What Dask would log meanwhile is said by the errors raised here, in one line each."""
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
            warnings.simplefilter("ignore", VersionMismatchWarning)  # `_compare_versions` says it in a line
            client = _in_time(lambda: Client(address, timeout=timeout, set_as_default=False), timeout + CLOSING)
    except Exception as error:  # whatever answers there, it is no scheduler
        expected = f"a Dask scheduler that answers within {timeout:g} s"
        raise InputError(f"--scheduler: {address}: expected {expected}, found {_in_a_line(error)}") from None
    try:
        _wait_for_workers(client, address, timeout)
        yield client
    finally:
        with contextlib.suppress(Exception):
            client.close(timeout=CLOSING)


def _in_time(call: Callable[[], T], seconds: float) -> T:
    """What `call` gives. A Client has no limit of its own where somebody accepts its connection and never answers."""
    answers: queue.SimpleQueue[tuple[T | None, Exception | None]] = queue.SimpleQueue()

    def run() -> None:
        try:
            answers.put((call(), None))
        except Exception as error:
            answers.put((None, error))

    threading.Thread(target=run, daemon=True).start()
    try:
        value, error = answers.get(timeout=seconds)
    except queue.Empty:
        raise NotInTime("no answer") from None
    if error is not None:
        raise error
    return value  # type: ignore[return-value]


def _wait_for_workers(client: Client, address: str, timeout: float) -> None:
    try:
        client.wait_for_workers(1, timeout=timeout)
    except NotInTime:
        expected = f"workers within {timeout:g} s (start some with `dask worker {address}`)"
        raise InputError(f"--scheduler: {address}: expected {expected}, found none") from None


def _in_a_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0]


def _compare_versions(client: Client) -> None:
    """Warns of versions that differ: frames may be drawn all the same."""
    found: Any = client.get_versions()
    here = found["client"]["packages"]
    others = {
        "the scheduler": found["scheduler"],
        **{f"worker {name}": each for name, each in found["workers"].items()},
    }
    for who, each in others.items():
        theirs = each["packages"]
        differing = [name for name in COMPARED if theirs.get(name) != here.get(name)]
        if differing:
            shown = ", ".join(f"{name} {theirs.get(name)} (here {here.get(name)})" for name in differing)
            telling.warning(f"{who} has {shown}")


def _send(client: Client, plugin: _Drawing, name: str, address: str) -> None:
    try:
        client.register_plugin(plugin, name=name)
    except Exception as error:  # such as a ModuleNotFoundError of a worker without clshade
        expected = f"workers with the clshade that runs here, found {_in_a_line(error)}"
        raise WorkerError(f"--scheduler: {address}: expected {expected}") from None


class _Run:
    """The tasks of a run, from here."""

    def __init__(self, client: Client, name: str, tasks: Sequence[Task], address: str, timeout: float) -> None:
        self._client, self._address, self._timeout = client, address, timeout
        self._events: queue.SimpleQueue[Future | Lost] = queue.SimpleQueue()
        self._by_key: dict[Any, Task] = {f"{name}-{task.number}": task for task in tasks}
        self._by_number = {task.number: task for task in tasks}
        self._asked = self._seen = time.monotonic()
        client.subscribe_topic("all", self._hear)
        keys = list(self._by_key)
        self.futures: list[Future] = client.map(_draw, [name] * len(tasks), tasks, key=keys, pure=False)
        for future in self.futures:
            future.add_done_callback(self._events.put)

    def _hear(self, event: tuple[float, Any]) -> None:
        """Of workers that are gone, while they drew or had just drawn."""
        _, message = event
        if isinstance(message, dict) and message.get("action") == "remove-worker":
            keys = message.get("processing-tasks", ())
            numbers = tuple(sorted(self._by_key[key].number for key in keys if key in self._by_key))
            if numbers:
                self._events.put(Lost(numbers, f"{message.get('worker')} is gone"))

    def results(self) -> Iterator[Drawn | Lost]:
        left = len(self.futures)
        unseen: dict[int, float] = {}  # frames drawn whose files are not here yet, since when
        while left or unseen:
            unseen = {number: since for number, since in unseen.items() if not self._is_here(number)}
            if unseen and time.monotonic() - min(unseen.values()) > VISIBLE:
                folder = self._by_number[min(unseen)].path.parent
                expected = f"workers that write to this machine's {folder}"
                raise WorkerError(f"{self._address}: expected {expected}, found frame {min(unseen)} written elsewhere")
            self._look_for_workers(left)
            try:
                event = self._events.get(timeout=POLL)
            except queue.Empty:
                continue
            if isinstance(event, Lost):
                yield event
            elif (drawn := self._result(event)) is not None:
                left -= 1
                unseen[drawn.number] = time.monotonic()
                yield drawn

    def _is_here(self, number: int) -> bool:
        return all(path.exists() for path in output_paths(self._by_number[number].path))

    def _look_for_workers(self, left: int) -> None:
        """Raises WorkerError when there have been none for some time."""
        now = time.monotonic()
        if now < self._asked + ASK:
            return
        self._asked = now
        with contextlib.suppress(Exception):  # the scheduler may be gone, too
            if self._client.scheduler_info()["workers"]:
                self._seen = now
        if now - self._seen > self._timeout:
            raise WorkerError(f"{self._address}: no worker is left, and {left} frames are: run it again to go on")

    def _result(self, future: Future) -> Drawn | None:
        """None where the worker that has it is gone: the frame is drawn again, and the event comes again."""
        number = self._by_key[future.key].number
        try:
            return future.result(timeout=ASK)
        except ClshadeError:
            raise
        except NotInTime:
            self._events.put(future)
            return None
        except KilledWorker as error:
            found = f"{error.allowed_failures + 1} workers ended while they drew it"
            raise WorkerError(f"frame {number}: {found}, the last {error.last_worker.address}") from None
        except CancelledError:
            raise WorkerError(f"{self._address}: the scheduler is gone: run it again to go on") from None
        except Exception as error:
            raise WorkerError(f"frame {number}: {_in_a_line(error)}") from error
