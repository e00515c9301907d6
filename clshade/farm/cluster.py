"""Frames drawn by the workers of a Dask cluster (dask.distributed), which write the files; only figures come back.

The scene is sent once to each worker, as a plugin that latecomers get as well: scattered data would be lost with the
workers that hold it. Each frame is submitted to one worker, which logs events as it draws: a result would have to be
fetched, which takes longer, and forever from a stopped worker.
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
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent import futures
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

from distributed import CancelledError, Client, Future, WorkerPlugin, get_worker
from distributed import TimeoutError as NotInTime  # not Python's own before 3.11
from distributed import Worker as DaskWorker
from distributed.versions import VersionMismatchWarning

from ..base import console
from ..errors import ClshadeError, InputError, WorkerError
from ..pipeline.opencl.environment import THREADS
from ..pipeline.struct_layout import kernel_folder
from .dispatch import POLL, SILENT, Clock, Dispatcher, Flight, Worker, now
from .job import DrawnFrame, FrameWriter, Job, Lost, Silent, Task

T = TypeVar("T")
TOPIC = "clshade"  # of the workers' events: one for all runs, since a scheduler keeps the latest of each topic forever
AHEAD = 3  # frames per thread: one being drawn, others to continue with
ASK = 1.0  # seconds between queries of the scheduler for its workers, and until one counts as unanswered
HEARTBEAT = 5.0  # seconds within which a healthy worker is heard from several times, however long its frames take
VISIBLE = 10.0  # seconds until a worker's file is visible here: network file systems delay it
CLOSING = 2.0  # seconds for disconnecting from the scheduler
SENDING = 60.0  # seconds that a worker with a frame waits for the scene
COMPARED = ("python", "dask", "distributed")  # packages whose versions should be equal everywhere
RESUME = "run it again to go on"


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
        cluster = Cluster(client, address, tasks, timeout, frame_timeout)
        cluster.send(_Drawing(job, code_digest()))
        try:
            yield from cluster.results()
        finally:
            with contextlib.suppress(Exception):  # a stopped scheduler or worker would never answer
                _in_time(cluster.close, CLOSING)


# On the workers


class _Drawing(WorkerPlugin):
    """A plugin that keeps a job on a worker, and its scene on the worker's device from the first frame on."""

    def __init__(self, job: Job, digest: str) -> None:
        self._job, self._digest = job, digest
        self._writer: FrameWriter | None = None

    def setup(self, worker: DaskWorker) -> None:
        for variable in THREADS:
            os.environ.setdefault(variable, str(worker.state.nthreads))
        self._writer = FrameWriter(self._job)

    def teardown(self, worker: DaskWorker) -> None:
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
    """Draw a frame of a run and log how far it is, as `Cluster` hears it."""
    worker = get_worker()
    about = {"run": name, "number": task.number, "worker": worker.address}

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


class Cluster(Dispatcher[Worker]):
    """The frames of a run, and the workers of a scheduler.

    Workers log events on TOPIC: {"run": name, "number", "worker", "sign": "begun", "ready", "drawn" or "failed"}, for
    "drawn" with the fields of DrawnFrame.
    """

    def __init__(
        self, client: Client, scheduler: str, tasks: Iterable[Task], timeout: float, frame_timeout: float | None
    ) -> None:
        super().__init__(tasks, AHEAD, frame_timeout)
        self._client, self._scheduler, self._timeout = client, scheduler, timeout
        self.name = f"clshade-{uuid.uuid4().hex}"
        self._events: queue.SimpleQueue[Callable[[], DrawnFrame | None]] = queue.SimpleQueue()
        self._heard: dict[str, float] = {}  # when the scheduler last heard from each worker, by its own clock
        self._unseen: dict[int, tuple[list[Path], float]] = {}  # files that are not visible here yet, and since when
        self._asked, self._healthy_at = float("-inf"), now()
        client.subscribe_topic(TOPIC, self._hear)

    def send(self, plugin: _Drawing) -> None:
        """Send the scene to all workers, and warn of differing versions, which do not stop the run."""
        self._ask()
        try:
            _in_time(partial(self._client.register_plugin, plugin, name=self.name), SILENT)
        except NotInTime:  # those that have it continue; those that come back get it then
            self._ask()
            silent = [worker.name for worker in self._workers.values() if worker.clock.seconds > SILENT / 2]
            who = f"worker{'s' * (len(silent) > 1)} {', '.join(silent)}" if silent else "some of the workers"
            console.warning(f"no sign of {who} for {SILENT:g} s, at receiving the scene")
        except Exception as error:  # such as a ModuleNotFoundError of a worker without clshade
            expected = f"workers with the clshade that runs here, found {_in_a_line(error)}"
            raise WorkerError(f"--scheduler: {self._scheduler}: expected {expected}") from None
        with contextlib.suppress(Exception):  # stopped workers do not answer
            _compare_versions(_in_time(self._client.get_versions, ASK))

    def close(self) -> None:
        """Cancel the frames that have not begun, and have the workers forget the scene."""
        self._client.unsubscribe_topic(TOPIC)
        futures = [flight.future for flight in self._flights.values() if flight.future is not None]
        self._client.cancel(futures, asynchronous=False)
        self._client.unregister_worker_plugin(self.name)

    def _is_done(self) -> bool:
        return super()._is_done() and not self._unseen

    def _is_usable(self, worker: Worker) -> bool:
        if self._frame_timeout is None:
            return True
        # Of many workers, each is heard from less often.
        limit = max(self._frame_timeout, HEARTBEAT + len(self._workers) / 50)
        return worker.clock.seconds <= limit and super()._is_usable(worker)

    # Frames to the cluster

    def _begin(self, flight: Flight, worker: Worker) -> None:
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", "Sending large graph", UserWarning)  # a pose goes to one worker, once
                flight.future = self._client.submit(_draw, self.name, flight.task, workers=[worker.name], pure=False)
        except Exception as error:
            raise self._gone() from error
        flight.future.add_done_callback(lambda future: self._events.put(partial(self._look_at, flight, future)))

    def _withdraw(self, flight: Flight) -> None:
        with contextlib.suppress(Exception):
            flight.future.release()
        flight.future = None

    # What is heard of them

    def _listen(self) -> Iterator[DrawnFrame]:
        self._look_for_files()
        with contextlib.suppress(queue.Empty):
            frame = self._events.get(timeout=POLL)()
            if frame is not None:
                yield frame

    def _hear(self, event: tuple[float, Any]) -> None:
        """Queue an event; called in the client's own thread."""
        if event[1].get("run") == self.name:
            self._events.put(partial(self._note, event[1]))

    def _note(self, event: Mapping[str, Any]) -> DrawnFrame | None:
        """Process a worker's event, also for a frame that another one has, or has drawn already."""
        number, worker, sign = event["number"], self._workers.get(event["worker"]), event["sign"]
        flight = self._flights.get(number)
        if worker is not None and sign in ("drawn", "failed"):
            worker.stuck.discard(number)
        if flight is None or sign == "failed":
            return None
        if sign == "drawn":
            self._unseen[number] = flight.task.paths, now()
            return self._finish(DrawnFrame(**event["drawn"]))
        if flight.worker is not None and flight.worker is worker:
            flight.advance(begun=True, ready=sign == "ready")
        return None

    def _look_at(self, flight: Flight, future: Future[Any]) -> None:
        """Raise WorkerError, or what `FrameWriter.draw` raised, for a frame that failed; events report drawn ones."""
        if flight.future is not future or future.status in ("finished", "pending"):
            return
        try:
            future.result(timeout=ASK)
        except ClshadeError:
            raise
        except NotInTime:
            self._events.put(partial(self._look_at, flight, future))
        except CancelledError:
            raise self._gone() from None
        except Exception as error:
            raise WorkerError(f"frame {flight.task.number}: {_in_a_line(error)}") from error

    def _gone(self) -> WorkerError:
        return WorkerError(f"{self._scheduler}: the scheduler is gone: {RESUME}")

    def _look_for_files(self) -> None:
        """Raise WorkerError for a drawn frame whose files do not appear."""
        self._unseen = {n: files for n, files in self._unseen.items() if not all(path.exists() for path in files[0])}
        for number, (paths, since) in self._unseen.items():
            if now() - since > VISIBLE:
                expected = f"workers that write to this machine's {paths[0].parent}"
                raise WorkerError(f"{self._scheduler}: expected {expected}, found frame {number} written elsewhere")

    # Workers

    def _check(self) -> Iterator[Lost | Silent]:
        """Check the workers and their frames now and then. Raises WorkerError if there have been none for some time."""
        if now() < self._asked + ASK:
            return
        self._asked = now()
        answered = self._ask()
        for worker in [worker for worker in self._workers.values() if worker.name not in self._heard]:
            del self._workers[worker.name]
            yield from self._lose(worker, worker.flights.values(), f"{worker.name} is gone")
        yield from super()._check()
        if answered and any(map(self._is_usable, self._workers.values())):
            self._healthy_at = self._asked
        elif self._asked - self._healthy_at > self._timeout:
            reason = "no worker is left" if answered else "the scheduler gives no answer"
            reason = "no worker gives a sign any more" if answered and self._workers else reason
            raise WorkerError(f"{self._scheduler}: {reason}, and there are frames left: {RESUME}")

    def _ask(self) -> bool:
        """Query the scheduler for its workers; return False if it does not answer."""
        try:
            scheduler: Any = self._client.scheduler
            listed: Any = self._client.sync(scheduler.identity, callback_timeout=ASK)["workers"]
        except Exception:  # such as a connection error or a timeout
            return False
        heard = {name: facts["last_seen"] for name, facts in listed.items()}
        for name, facts in listed.items():
            worker = self._workers.setdefault(name, Worker(name))
            worker.threads = facts["nthreads"]
            if self._heard.get(name) != heard[name]:
                worker.clock = Clock()
        self._heard = heard
        return True


@contextlib.contextmanager
def _hushed() -> Iterator[None]:
    """Silence Dask's loggers: the errors raised here say the same, in one line each."""
    with contextlib.ExitStack() as stack:
        for name in list(logging.root.manager.loggerDict):
            if name.startswith(("distributed", "asyncio")):
                logger = logging.getLogger(name)
                stack.callback(setattr, logger, "disabled", logger.disabled)
                logger.disabled = True
        yield


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
        raise InputError(f"--scheduler: {address}: expected {expected}, found {_in_a_line(error)}") from None
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


def _compare_versions(versions: Any) -> None:
    here = versions["client"]["packages"]
    workers = {f"worker {address}": worker for address, worker in versions["workers"].items()}
    for who, there in {"the scheduler": versions["scheduler"], **workers}.items():
        theirs = there["packages"]
        differing = [name for name in COMPARED if theirs.get(name) != here.get(name)]
        if differing:
            differences = ", ".join(f"{name} {theirs.get(name)} (here {here.get(name)})" for name in differing)
            console.warning(f"{who} has {differences}")


def _in_a_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0]
