"""Frames on their way through a Dask cluster: a few per thread at a time, monitored, and reassigned."""

from __future__ import annotations

import contextlib
import itertools
import queue
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from distributed import CancelledError, Client, Future, KilledWorker
from distributed import TimeoutError as NotInTime  # not Python's own before 3.11

from ..errors import ClshadeError, WorkerError
from .job import DrawnFrame, Lost, Silent, Task
from .waiting import ATTEMPTS, POLL, Clock, now

TOPIC = "clshade"  # of the workers' events: one for all runs, since a scheduler keeps the latest of each topic forever
AHEAD = 3  # frames per thread: one being drawn, others to continue with
ASK = 1.0  # seconds between queries of the scheduler for its workers, and until one counts as unanswered
HEARTBEAT = 5.0  # seconds within which a healthy worker is heard from several times, however long its frames take
VISIBLE = 10.0  # seconds until a worker's file is visible here: network file systems delay it
RESUME = "run it again to go on"


class Members(dict[str, int]):
    """The workers of a cluster, threads by address, as its scheduler last listed them.

    clocks: the time since the scheduler last heard from each.
    """

    def __init__(self, client: Client, scheduler: str) -> None:
        super().__init__()
        self.client, self.scheduler = client, scheduler
        self.clocks: dict[str, Clock] = {}
        self._heard: dict[str, float] = {}  # when that was, by the scheduler's clock

    def ask(self) -> bool:
        """Query the scheduler for its workers; return False if it does not answer."""
        try:
            scheduler: Any = self.client.scheduler
            workers: Any = self.client.sync(scheduler.identity, callback_timeout=ASK)["workers"]
        except Exception:  # such as a connection error or a timeout
            return False
        self.clear()
        self.update((address, worker["nthreads"]) for address, worker in workers.items())
        heard = {address: worker["last_seen"] for address, worker in workers.items()}
        self.clocks = {
            address: self.clocks[address] if self._heard.get(address) == when else Clock()
            for address, when in heard.items()
        }
        self._heard = heard
        return True


@dataclass(eq=False)
class _Flight:
    """A frame that the cluster has. future: of the latest attempt. worker: which has it, "" if unknown.

    allowed: the only workers that may draw it; None: any. begun, ready: whether the worker has begun, and has compiled the
    kernels. late: workers that did not draw it in time. keys: of all attempts.
    """

    task: Task
    future: Future[Any] | None = None
    allowed: frozenset[str] | None = None
    worker: str = ""
    begun: bool = False
    ready: bool = False
    late: list[str] = field(default_factory=list)
    keys: list[str] = field(default_factory=list)
    clock: Clock = field(default_factory=Clock)

    def place(self, worker: str, begun: bool = False, ready: bool = False) -> None:
        self.worker, self.begun, self.ready = worker, begun, ready
        self.clock.restart()

    def has_key(self, key: str) -> bool:
        """Return whether the key is that of the latest attempt."""
        return self.future is not None and self.future.key == key

    def release(self) -> None:
        """Give up the latest attempt."""
        if self.future is not None:
            with contextlib.suppress(Exception):
                self.future.release()
        self.future = None


def _numbers(flights: Iterable[_Flight]) -> tuple[int, ...]:
    return tuple(sorted(flight.task.number for flight in flights))


class Dispatcher:
    """The frames of a run, seen from this machine. Workers log their progress on TOPIC: {"run": name, "key", "worker",
    "sign": "begun", "ready", "drawn" or "failed"}, for "drawn" with the fields of DrawnFrame."""

    def __init__(
        self,
        members: Members,
        draw: Callable[[str, Task], None],
        name: str,
        tasks: Iterable[Task],
        timeout: float,
        frame_timeout: float | None,
    ) -> None:
        self._members, self._draw, self._name, self._tasks = members, draw, name, iter(tasks)
        self._client, self._timeout, self._frame_timeout = members.client, timeout, frame_timeout
        self._events: queue.SimpleQueue[Future[Any] | Mapping[str, Any]] = queue.SimpleQueue()
        self._flights: dict[int, _Flight] = {}
        self._by_key: dict[str, _Flight] = {}  # of all attempts at frames not drawn yet
        self._stuck: dict[str, str] = {}  # keys of frames that a worker has had for too long, and the worker
        # Files of drawn frames that are not visible here yet, and since when.
        self._unseen: dict[int, tuple[list[Path], float]] = {}
        self._keys = (f"{name}-{number}" for number in itertools.count())
        self._all_taken = False
        self._latest = 0.0  # duration of the latest frame, seconds
        self._asked, self._healthy_at = float("-inf"), now()
        for topic in ("all", TOPIC):
            self._client.subscribe_topic(topic, self._hear)

    def results(self) -> Iterator[DrawnFrame | Lost | Silent]:
        """Yield results, losses and silences until all frames are drawn."""
        while True:
            if now() >= self._asked + ASK:
                self._asked = now()
                yield from self._look()
            self._refill()
            self._await_files()
            if self._all_taken and not self._flights and not self._unseen:
                return
            try:
                event = self._events.get(timeout=POLL)
            except queue.Empty:
                continue
            if isinstance(event, Future):
                self._check_future(event)
            elif event.get("action") == "remove-worker":
                yield from self._forget(event)
            elif event.get("run") == self._name and (frame := self._note(event)) is not None:
                yield frame

    def close(self) -> None:
        """Cancel the frames that have not begun."""
        for topic in ("all", TOPIC):
            self._client.unsubscribe_topic(topic)
        futures = [flight.future for flight in self._flights.values() if flight.future is not None]
        self._client.cancel(futures, asynchronous=False)

    # Frames to the cluster

    def _refill(self) -> None:
        """Submit enough that no thread waits for the next frame, and no more: a run may have a million."""
        threads = sum(self._members.values())
        room = AHEAD * threads - len(self._flights)
        if room < threads:  # one frame per thread at a time: each call of a scheduler takes long
            return
        flights = [_Flight(task) for task in itertools.islice(self._tasks, max(room, 0))]
        self._all_taken |= len(flights) < room
        self._flights.update((flight.task.number, flight) for flight in flights)
        healthy = self._healthy()
        some = self._frame_timeout is not None and healthy and len(healthy) < len(self._members)
        self._submit(flights, frozenset(healthy) if some else None)

    def _submit(self, flights: list[_Flight], allowed: frozenset[str] | None) -> None:
        if not flights:
            return
        keys = list(itertools.islice(self._keys, len(flights)))
        tasks = [flight.task for flight in flights]
        workers = None if allowed is None else sorted(allowed)
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", "Sending large graph", UserWarning)  # a pose goes to one worker, once
                futures: list[Future[Any]] = self._client.map(
                    self._draw, [self._name] * len(tasks), tasks, key=keys, pure=False, workers=workers
                )
        except Exception as error:
            raise self._gone() from error
        for key, flight, future in zip(keys, flights, futures, strict=True):
            self._by_key[key] = flight
            flight.keys.append(key)
            flight.future, flight.allowed = future, allowed
            flight.place("")
            future.add_done_callback(self._events.put)

    def _move(self, flight: _Flight) -> None:
        """Give the frame to a healthy worker; if there is none, later."""
        flight.release()
        flight.place("")
        healthy = self._healthy()
        chosen = healthy - set(flight.late) or healthy
        if chosen:
            self._submit([flight], frozenset(chosen))

    # Events

    def _hear(self, event: tuple[float, Any]) -> None:
        """Queue an event; called in the client's own thread."""
        if isinstance(event[1], dict):
            self._events.put(event[1])

    def _note(self, event: Mapping[str, Any]) -> DrawnFrame | None:
        """Process a worker's event, also for a frame that another one has drawn already."""
        key, sign = event["key"], event["sign"]
        flight = self._by_key.get(key)
        if sign in ("drawn", "failed"):
            self._stuck.pop(key, None)
        if flight is None:
            return None
        if sign == "drawn":
            return self._finish(flight, DrawnFrame(**event["drawn"]))
        if flight.has_key(key) and sign != "failed":
            flight.place(event["worker"], begun=True, ready=sign == "ready")
        return None

    def _finish(self, flight: _Flight, frame: DrawnFrame) -> DrawnFrame:
        del self._flights[frame.number]
        for key in flight.keys:
            del self._by_key[key]
        flight.release()
        self._latest = (frame.render_ms + frame.save_ms) / 1e3
        self._unseen[frame.number] = flight.task.paths, now()
        return frame

    def _check_future(self, future: Future[Any]) -> None:
        """Raise WorkerError, or what `FrameWriter.draw` raised, for a frame that failed; events report drawn ones."""
        flight = self._by_key.get(str(future.key))
        if flight is None or flight.future is not future or future.status in ("finished", "pending"):
            return
        number = flight.task.number
        try:
            future.result(timeout=ASK)
        except ClshadeError:
            raise
        except NotInTime:
            self._events.put(future)
        except KilledWorker as error:
            reason = f"{error.allowed_failures + 1} workers ended while they drew it"
            raise WorkerError(f"frame {number}: {reason}, the last {error.last_worker.address}") from None
        except CancelledError:
            raise self._gone() from None
        except Exception as error:
            raise WorkerError(f"frame {number}: {in_a_line(error)}") from error

    def _gone(self) -> WorkerError:
        return WorkerError(f"{self._members.scheduler}: the scheduler is gone: {RESUME}")

    def _forget(self, event: Mapping[str, Any]) -> Iterator[Lost]:
        """Forget a worker that is gone: Dask gives its frames to others."""
        worker = event.get("worker")
        flights = [self._by_key[key] for key in event.get("processing-tasks", ()) if key in self._by_key]
        for flight in flights:
            flight.place("")
        self._stuck = {key: stuck for key, stuck in self._stuck.items() if stuck != worker}
        if flights:
            yield Lost(_numbers(flights), f"{worker} is gone")

    def _await_files(self) -> None:
        """Raise WorkerError for a drawn frame whose files do not appear."""
        self._unseen = {n: files for n, files in self._unseen.items() if not all(path.exists() for path in files[0])}
        for number, (paths, since) in self._unseen.items():
            if now() - since > VISIBLE:
                expected = f"workers that write to this machine's {paths[0].parent}"
                reason = f"frame {number} written elsewhere"
                raise WorkerError(f"{self._members.scheduler}: expected {expected}, found {reason}")

    # Workers

    def _look(self) -> Iterator[Lost | Silent]:
        """Check the workers and their frames. Raises WorkerError if there have been no workers for some time."""
        answered = self._members.ask()
        if answered and any(not flight.begun for flight in self._flights.values()):
            self._find()
        if self._frame_timeout is not None:
            yield from self._reassign(self._frame_timeout)
        yield from self._silent()
        if answered and self._healthy():
            self._healthy_at = self._asked
        elif self._asked - self._healthy_at > self._timeout:
            reason = "no worker is left" if answered else "the scheduler gives no answer"
            reason = "no worker gives a sign any more" if answered and self._members else reason
            raise WorkerError(f"{self._members.scheduler}: {reason}, and there are frames left: {RESUME}")

    def _find(self) -> None:
        """Find which worker has each frame that has not begun."""
        try:
            scheduler: Any = self._client.scheduler
            processing: Any = self._client.sync(scheduler.processing, workers=None, callback_timeout=ASK)
        except Exception:  # no answer
            return
        for worker, keys in processing.items():
            for key in keys:
                flight = self._by_key.get(key)
                if flight is not None and flight.has_key(key) and not flight.begun and flight.worker != worker:
                    flight.place(worker)

    def _healthy(self) -> set[str]:
        """Return the workers that can begin a frame now or later; all of them without a frame timeout."""
        if self._frame_timeout is None:
            return set(self._members)
        stuck, clocks = Counter(self._stuck.values()), self._members.clocks
        # Of many workers, each is heard from less often.
        limit = max(self._frame_timeout, HEARTBEAT + len(clocks) / 50)
        heard = [worker for worker, clock in clocks.items() if clock.seconds <= limit]
        return {worker for worker in heard if stuck[worker] < self._members[worker]}

    def _reassign(self, limit: float) -> Iterator[Lost]:
        """Give frames of hanging workers to others. Raises WorkerError after ATTEMPTS at one."""
        moved: dict[str, list[_Flight]] = defaultdict(list)
        seconds: dict[str, float] = {}
        for flight in self._flights.values():
            if flight.begun and flight.clock.is_over(limit, flight.ready):
                self._stuck[flight.keys[-1]] = flight.worker
                flight.late.append(flight.worker)
                seconds[flight.worker] = flight.clock.seconds
                moved[flight.worker].append(flight)
        healthy = self._healthy()
        for flight in self._flights.values():
            if not flight.begun and flight.worker in self._members and flight.worker not in healthy:
                seconds.setdefault(flight.worker, self._members.clocks[flight.worker].seconds)
                moved[flight.worker].append(flight)
        for worker, flights in moved.items():
            reason = f"{worker} gave no sign for {seconds[worker]:.3g} s"
            for flight in flights:
                if len(flight.late) == ATTEMPTS:
                    tried = f"{ATTEMPTS} workers did not draw it in time; the last one, {reason}"
                    raise WorkerError(f"frame {flight.task.number}: {tried}")
                self._move(flight)
            yield Lost(_numbers(flights), reason)
        for flight in self._flights.values():
            is_stranded = flight.allowed is not None and not flight.begun and not flight.allowed & healthy
            if flight.future is None or is_stranded:
                self._move(flight)

    def _silent(self) -> Iterator[Silent]:
        """Yield what is to be reported of frames that take long, and of workers that have some and do not begin."""
        placed: dict[str, list[_Flight]] = defaultdict(list)
        for flight in self._flights.values():
            if flight.worker:
                placed[flight.worker].append(flight)
        for worker, flights in placed.items():
            begun = [flight for flight in flights if flight.begun]
            silences = {flight: flight.clock.due(self._latest) for flight in begun}
            if not begun and worker in self._members:
                silences = dict.fromkeys(flights, self._members.clocks[worker].due(0.0))
            reported = {flight: seconds for flight, seconds in silences.items() if seconds is not None}
            if reported:
                yield Silent(_numbers(reported), worker, max(reported.values()))


def in_a_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0]
