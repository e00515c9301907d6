"""Frames drawn by several processes on this machine, each with its own device, scene and kernel cache.

A process that ends, or is killed because it hangs, is replaced and its frame drawn again. (An executor of
concurrent.futures is broken for good when one of its processes dies, a Pool waits forever for its task, and the workers of
pebble share one pipe, whose lock a stopped one may hold, and leave what they were writing when they are ended.)
"""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from types import FrameType
from typing import Any

from ..base import interrupts
from ..pipeline.opencl.environment import THREADS
from .dispatch import POLL, Dispatcher, Flight, Worker
from .job import DrawnFrame, FrameWriter, Job, Lost, Silent, Task

MOST_WORKERS = 256
PATIENCE = 0.6  # seconds that workers get to end on request; an interrupted process has GRACE and CLEARING itself


def draw_locally(
    job: Job, tasks: Iterable[Task], workers: int, frame_timeout: float | None = None
) -> Iterator[DrawnFrame | Lost | Silent]:
    """Draw the tasks and yield each result as soon as it arrives, in any order; no task is taken before a worker is
    free for it.

    frame_timeout: seconds after which a worker that is ready and has not drawn its frame is killed; None: wait for it.
    Raises what `FrameWriter.draw` raised in a worker, and WorkerError for a frame at which ATTEMPTS of them were lost.
    The workers are ended whenever the iteration ends early.
    """
    tasks = iter(tasks)
    first = list(itertools.islice(tasks, workers))
    pool = _Pool(job, itertools.chain(first, tasks), len(first), frame_timeout)
    _pools.add(pool)
    try:
        for _ in first:  # all of them before the first is told anything
            pool.start()
        yield from pool.results()
        pool.join()
    except KeyboardInterrupt:
        pool.interrupt()  # they end by themselves; `_end_all` waits for that, after all messages
        raise
    except BaseException:
        pool.end()
        raise
    pool.end()


_pools: set[_Pool] = set()
_starting = threading.RLock()  # held while a process starts, and from the end of this one on


@interrupts.at_end
def _end_all() -> None:
    _starting.acquire()  # for good: half a start would print a traceback
    for pool in list(_pools):
        pool.end()


@contextlib.contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Delay an interrupt in the block until after it: half a start would leave a process that nobody ends. A process
    started in it inherits the mask, and gets none until it can handle one (`interrupts.leave_soon`)."""
    late: list[tuple[int, FrameType | None]] = []
    with contextlib.ExitStack() as stack:
        handler = signal.getsignal(signal.SIGINT)
        if callable(handler) and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, lambda number, frame: late.append((number, frame)))
            stack.callback(lambda: [handler(*arguments) for arguments in late[:1]])
            stack.callback(signal.signal, signal.SIGINT, handler)
        if hasattr(signal, "pthread_sigmask"):
            before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
            resource_tracker.ensure_running()  # starting it, as the first process would, lets interrupts through again
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            stack.callback(signal.pthread_sigmask, signal.SIG_SETMASK, before)
        yield


class _Process(Worker):
    """A process, and this end of the pipe to it."""

    def __init__(self, job: bytes, threads: int, timed: bool) -> None:
        # Not forked: a runtime's threads do not survive that.
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, threads, timed), daemon=True)
        self.process.start()
        theirs.close()  # else the pipe would outlive the process
        super().__init__(str(self.process.pid))
        self._job: bytes | None = job  # until it is sent, before the first task
        self._sender: threading.Thread | None = None

    def send(self, task: Task) -> None:
        # A scene may exceed the pipe's capacity, and a stopped process would never read it.
        self._sender = threading.Thread(target=self._send, args=(task,), daemon=True)
        self._sender.start()

    def _send(self, task: Task) -> None:
        with contextlib.suppress(OSError):  # it ended; reading from the pipe will report it
            if self._job is not None:
                self.pipe.send_bytes(self._job)
                self._job = None
            self.pipe.send(task)

    def reason(self) -> str:
        """Return how the process ended, a predicate."""
        self.process.join(PATIENCE)
        code = self.process.exitcode
        if code is None or code >= 0:
            return f"ended with exit code {code}"
        with contextlib.suppress(ValueError):
            return f"was killed by {signal.Signals(-code).name}"
        return f"was killed by signal {-code}"

    def dismiss(self) -> None:
        """Close the pipe, which makes the process end."""
        if self._sender is not None:
            self._sender.join(PATIENCE)  # done, or failed if the process has ended
        self.pipe.close()


class _Pool(Dispatcher[_Process]):
    """The workers of one run, each of which draws a frame at a time."""

    def __init__(self, job: Job, tasks: Iterable[Task], size: int, frame_timeout: float | None) -> None:
        super().__init__(tasks, 1, frame_timeout)
        self._job = pickle.dumps(job, pickle.HIGHEST_PROTOCOL)
        processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self._threads = max(1, processors // max(1, size))
        self._started: list[_Process] = []

    def start(self) -> None:
        with _interrupts_held_back(), _starting:
            worker = _Process(self._job, self._threads, self._frame_timeout is not None)
            self._started.append(worker)
        self._workers[worker.name] = worker

    def _begin(self, flight: Flight, worker: _Process) -> None:
        flight.advance(begun=True)
        worker.send(flight.task)

    def _listen(self) -> Iterator[DrawnFrame | Lost]:
        for worker in [worker for worker in self._workers.values() if not worker.flights]:  # nothing is left for it
            self._dismiss(worker)
        workers: dict[Any, _Process] = {worker.pipe: worker for worker in self._workers.values()}
        for pipe in wait(list(workers), POLL):
            worker = workers[pipe]
            try:
                answer = worker.pipe.recv()
            except (EOFError, OSError):
                lost = self._lose(worker, worker.flights.values(), worker.reason())
                self._replace(worker)
                yield from lost
                continue
            if isinstance(answer, Exception):
                raise answer
            if answer is None:
                for flight in worker.flights.values():
                    flight.advance(begun=True, ready=True)
            elif (frame := self._finish(answer)) is not None:
                yield frame

    def _replace(self, worker: _Process) -> None:
        worker.process.kill()  # nothing else reaches one that hangs or is stopped
        worker.process.join(PATIENCE)
        self._dismiss(worker)
        self.start()

    def _dismiss(self, worker: _Process) -> None:
        worker.dismiss()
        del self._workers[worker.name]

    def join(self) -> None:
        """Wait for the workers that have nothing left to draw."""
        for worker in self._started:
            worker.process.join(PATIENCE)

    def interrupt(self) -> None:
        """Interrupt all processes, so that they remove what they were writing, and end."""
        for worker in self._started:
            if worker.process.is_alive() and worker.process.pid is not None:
                with contextlib.suppress(OSError):
                    os.kill(worker.process.pid, signal.SIGTERM if sys.platform == "win32" else signal.SIGINT)

    def end(self) -> None:
        """Interrupt all processes, and return when they have ended."""
        self.interrupt()
        until = time.monotonic() + PATIENCE
        for worker in self._started:
            worker.process.join(max(0.0, until - time.monotonic()))
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
        _pools.discard(self)


def _serve(pipe: Connection, threads: int, timed: bool) -> None:
    """Run a worker: draw the tasks that come, until the pipe is closed or its other end is gone.

    timed: send None when ready to draw a task, before its result.
    """
    try:
        interrupts.leave_soon(quiet=True)
        for name in THREADS:
            os.environ.setdefault(name, str(threads))
        ready = (lambda: pipe.send(None)) if timed else None
        with FrameWriter(pickle.loads(pipe.recv_bytes())) as writer:
            while True:
                task = pipe.recv()
                try:
                    answer: DrawnFrame | Exception = writer.draw(task, ready)
                except Exception as error:
                    answer = error
                pipe.send(answer)
    except (EOFError, OSError):
        pass
    except KeyboardInterrupt:
        sys.exit(interrupts.INTERRUPTED)
    finally:
        interrupts.ignore()  # only cleanup is left
