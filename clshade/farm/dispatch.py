"""Frames on their way: handed to workers of any kind, watched, and handed to others when a worker is lost."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from ..errors import WorkerError
from .job import DrawnFrame, Lost, Silent, Task

POLL = 0.1  # seconds between checks for an interrupt
SILENT = 10.0  # seconds without a sign until it is reported
PREPARING = 120.0  # seconds that a worker may take beyond --frame-timeout to start and to compile the kernels
AWAY = 3.0  # seconds between two readings of `now` that pass only if this process was stopped itself
ATTEMPTS = 3  # workers that may be lost at a frame before the run ends: the frame may be what ends them

_read = _away = 0.0  # when `now` was last read, and for how long in total it was not


def now() -> float:
    """Return the time, in seconds, without that in which this process was stopped (Ctrl-Z): workers gave no sign then
    because nobody could receive one. To be read at least every AWAY seconds."""
    global _read, _away
    before, _read = _read, time.monotonic()
    if _read - before > AWAY:
        _away += _read - before
    return _read - _away


class Clock:
    """The time since the last sign of a worker, or of a frame that it has."""

    def __init__(self) -> None:
        self._since, self._reported = now(), 0.0

    @property
    def seconds(self) -> float:
        return now() - self._since

    def due(self, latest: float) -> float | None:
        """Return the seconds of silence if they are to be reported now: after SILENT, or twice the duration of the
        `latest` frame if that is longer, and each time that they have doubled."""
        seconds = self.seconds
        if seconds < max(SILENT, 2.0 * latest, 2.0 * self._reported):
            return None
        self._reported = seconds
        return seconds


@dataclass(eq=False)
class Flight:
    """A frame that was handed out. begun, ready: whether its worker has begun it, and has compiled the kernels.

    lost: workers that were lost at it. clock: since the latest sign of it. future: of its latest attempt, by Dask.
    """

    task: Task
    worker: Worker | None = None
    begun: bool = False
    ready: bool = False
    lost: list[str] = field(default_factory=list)
    clock: Clock = field(default_factory=Clock)
    future: Any = None

    def advance(self, *, begun: bool = False, ready: bool = False) -> None:
        self.begun, self.ready, self.clock = begun, ready, Clock()

    def leave(self) -> None:
        """Leave the worker, if there is one."""
        if self.worker is not None:
            del self.worker.flights[self.task.number]
        self.worker = None


@dataclass(eq=False)
class Worker:
    """What draws frames. name: its process id, or its address. threads: frames that it draws at a time.

    flights: its frames by number, those that it has not begun too. stuck: frames that it has had for too long.
    clock: since it was last heard from.
    """

    name: str
    threads: int = 1
    flights: dict[int, Flight] = field(default_factory=dict)
    stuck: set[int] = field(default_factory=set)
    clock: Clock = field(default_factory=Clock)

    @property
    def load(self) -> float:
        return len(self.flights) / self.threads


AnyWorker = TypeVar("AnyWorker", bound=Worker)


class Dispatcher(ABC, Generic[AnyWorker]):
    """The frames of a run. Subclasses add workers, begin frames with them, and listen to them.

    ahead: frames per thread of a worker: one that is drawn, others to continue with. frame_timeout: seconds after which a
    worker that is ready counts as hanging if it has not drawn its frame; None: it is waited for.
    """

    def __init__(self, tasks: Iterable[Task], ahead: int, frame_timeout: float | None) -> None:
        self._tasks, self._ahead, self._frame_timeout = iter(tasks), ahead, frame_timeout
        self._workers: dict[str, AnyWorker] = {}
        self._flights: dict[int, Flight] = {}  # by number, until they are drawn
        self._all_taken = False
        self._latest = 0.0  # duration of the latest frame, seconds

    @abstractmethod
    def _begin(self, flight: Flight, worker: AnyWorker) -> None:
        """Send a worker a frame."""

    @abstractmethod
    def _listen(self) -> Iterator[DrawnFrame | Lost]:
        """Process what workers have said, and return within about POLL seconds."""

    def _withdraw(self, flight: Flight) -> None:
        """Tell the worker of a frame not to draw it, if it can still be told."""

    def _replace(self, worker: AnyWorker) -> None:
        """End a worker that hangs, and start another one in its place, if workers are ours."""

    def _is_usable(self, worker: AnyWorker) -> bool:
        """Return whether a worker can begin a frame now or later."""
        return len(worker.stuck) < worker.threads

    def _is_done(self) -> bool:
        return self._all_taken and not self._flights

    def results(self) -> Iterator[DrawnFrame | Lost | Silent]:
        """Yield results, losses and silences until all frames are drawn."""
        self._hand_out()
        while not self._is_done():
            for result in self._listen():
                self._hand_out()  # before the result is used: no worker waits for that
                yield result
            yield from self._check()
            self._hand_out()

    # Frames to workers

    def _hand_out(self) -> None:
        """Give frames to the workers with the fewest: those that others have lost, then as many as there is room for."""
        usable = [worker for worker in self._workers.values() if self._is_usable(worker)]
        if not usable:
            return
        for flight in self._flights.values():
            if flight.worker is None:
                self._give(flight, [worker for worker in usable if worker.name not in flight.lost] or usable)
        while min(worker.load for worker in usable) < self._ahead:
            task = next(self._tasks, None)
            if task is None:
                self._all_taken = True
                self._level(usable)
                return
            self._flights[task.number] = Flight(task)
            self._give(self._flights[task.number], usable)

    def _give(self, flight: Flight, workers: Sequence[AnyWorker]) -> None:
        worker = min(workers, key=lambda worker: worker.load)
        flight.worker = worker
        flight.advance()
        worker.flights[flight.task.number] = flight
        self._begin(flight, worker)

    def _level(self, workers: Sequence[AnyWorker]) -> None:
        """Let workers that are free draw frames that wait behind others."""
        for idle in workers:
            while len(idle.flights) < idle.threads:
                busiest = max(workers, key=lambda worker: worker.load)
                waiting = [flight for flight in busiest.flights.values() if not flight.begun]
                if busiest.load <= 1.0 or not waiting:
                    return
                self._withdraw(waiting[-1])
                waiting[-1].leave()
                self._give(waiting[-1], [idle])

    def _finish(self, frame: DrawnFrame) -> DrawnFrame | None:
        """Return a frame, None if another worker has drawn it before."""
        flight = self._flights.pop(frame.number, None)
        if flight is None:
            return None
        self._withdraw(flight)
        flight.leave()
        self._latest = (frame.render_ms + frame.save_ms) / 1e3
        return frame

    # Workers

    def _lose(self, worker: AnyWorker, flights: Iterable[Flight], reason: str) -> list[Lost]:
        """Take frames from a worker. Raises WorkerError for one at which ATTEMPTS workers were lost."""
        flights = list(flights)
        for flight in flights:
            self._withdraw(flight)
            flight.leave()
            if flight.begun:
                flight.lost.append(worker.name)
            if len(flight.lost) == ATTEMPTS:
                cause = f"{ATTEMPTS} workers were lost while they drew it: the last one {reason}"
                raise WorkerError(f"frame {flight.task.number}: {cause}")
        return [Lost(_numbers(flights), reason)] if flights else []

    def _check(self) -> Iterator[Lost | Silent]:
        """Take frames from workers that hang, and report those that are silent."""
        for worker in list(self._workers.values()):
            if self._frame_timeout is not None:
                yield from self._take_late(worker, self._frame_timeout)
            begun = [flight for flight in worker.flights.values() if flight.begun]
            silences = {flight: flight.clock.due(self._latest) for flight in begun}
            if worker.flights and not begun:
                silences = dict.fromkeys(worker.flights.values(), worker.clock.due(0.0))
            reported = {flight: seconds for flight, seconds in silences.items() if seconds is not None}
            if reported:
                yield Silent(_numbers(reported), worker.name, max(reported.values()))

    def _take_late(self, worker: AnyWorker, limit: float) -> Iterator[Lost]:
        """Take the frames that a worker has had for too long, and all others if it can begin none."""
        flights = list(worker.flights.values())
        late = [
            flight
            for flight in flights
            if flight.begun and flight.clock.seconds > limit + (0.0 if flight.ready else PREPARING)
        ]
        worker.stuck.update(_numbers(late))
        clocks = [flight.clock for flight in late] or [worker.clock]
        if not self._is_usable(worker):
            late += [flight for flight in flights if not flight.begun]
        if late:
            seconds = max(clock.seconds for clock in clocks)
            lost = self._lose(worker, late, f"{worker.name} gave no sign for {seconds:.3g} s")
            self._replace(worker)
            yield from lost


def _numbers(flights: Iterable[Flight]) -> tuple[int, ...]:
    return tuple(sorted(flight.task.number for flight in flights))
