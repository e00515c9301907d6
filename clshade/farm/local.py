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
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from types import FrameType

from ..base import interrupts
from ..errors import WorkerError
from ..pipeline.opencl.environment import THREADS
from .job import DrawnFrame, FrameWriter, Job, Lost, Silent, Task
from .waiting import ATTEMPTS, POLL, Clock

MOST_WORKERS = 256
PATIENCE = 0.6  # seconds that workers get to end on request; an interrupted process has GRACE and CLEARING itself


def draw_locally(
    job: Job, tasks: Iterable[Task], workers: int, frame_timeout: float | None = None
) -> Iterator[DrawnFrame | Lost | Silent]:
    """Draw the tasks and yield each result as soon as it arrives, in any order; no task is taken before a worker is
    free for it.

    frame_timeout: seconds after which a worker that is ready and has not drawn its frame is killed; None: wait for it.
    Raises what `FrameWriter.draw` raised in a worker, and WorkerError for a frame whose workers ended ATTEMPTS times.
    The workers are ended whenever the iteration ends early.
    """
    waiting = iter(tasks)
    first = list(itertools.islice(waiting, workers))
    pool = _Pool(job, len(first), frame_timeout)
    _pools.add(pool)
    try:
        yield from pool.draw(first, waiting)
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


class _Worker:
    """A process, this end of the pipe to it, and its current task."""

    def __init__(self, threads: int, timed: bool) -> None:
        # Not forked: a runtime's threads do not survive that.
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, threads, timed), daemon=True)
        self.process.start()
        theirs.close()  # else the pipe would outlive the process
        self.task: Task | None = None
        self.ready = False  # it has started and compiled the kernels
        self.clock = Clock()
        self._sender: threading.Thread | None = None

    def begin(self, task: Task, job: bytes | None = None) -> None:
        """Give it a task; a new worker gets the job first."""
        self.task = task
        self.clock.restart()
        if job is None:
            self._send(task)
        else:
            # A scene may exceed the pipe's capacity, and a stopped process would never read it.
            self._sender = threading.Thread(target=self._send, args=(task, job), daemon=True)
            self._sender.start()

    def _send(self, task: Task, job: bytes | None = None) -> None:
        with contextlib.suppress(OSError):  # it ended; reading from the pipe will report it
            if job is not None:
                self.pipe.send_bytes(job)
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
        self.task = None


class _Pool:
    """The workers of one run."""

    def __init__(self, job: Job, size: int, frame_timeout: float | None) -> None:
        self._job = pickle.dumps(job, pickle.HIGHEST_PROTOCOL)
        processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self._threads = max(1, processors // max(1, size))
        self._frame_timeout = frame_timeout
        self._workers: list[_Worker] = []
        self._attempts: Counter[int] = Counter()
        self._latest = 0.0  # duration of the latest frame, seconds

    def draw(self, first: Sequence[Task], waiting: Iterator[Task]) -> Iterator[DrawnFrame | Lost | Silent]:
        """Draw the tasks. first: what the workers begin with, one task each."""
        started = [self._start() for _ in first]  # all of them before the first is told anything
        for worker, task in zip(started, first, strict=True):
            worker.begin(task, self._job)
        while busy := {worker.pipe: worker for worker in self._workers if worker.task is not None}:
            for pipe in wait(list(busy), POLL):
                worker = busy[pipe]  # type: ignore[index]
                try:
                    answer = worker.pipe.recv()
                except (EOFError, OSError):
                    yield self._replace(worker, worker.reason())
                    continue
                if isinstance(answer, Exception):
                    raise answer
                if answer is None:
                    worker.ready = True
                    worker.clock.restart()
                    continue
                self._latest = (answer.render_ms + answer.save_ms) / 1e3
                following = next(waiting, None)
                if following is None:
                    worker.dismiss()
                else:
                    worker.begin(following)
                yield answer
            for worker in busy.values():
                yield from self._look_at(worker)
        for worker in self._workers:
            worker.process.join(PATIENCE)

    def _look_at(self, worker: _Worker) -> Iterator[Lost | Silent]:
        """Check whether a worker has been silent for too long."""
        if worker.task is None:
            return
        if self._frame_timeout is not None and worker.clock.is_over(self._frame_timeout, worker.ready):
            seconds = worker.clock.seconds
            worker.process.kill()  # nothing else reaches one that hangs or is stopped
            worker.process.join(PATIENCE)
            yield self._replace(worker, f"{worker.process.pid} gave no sign for {seconds:.3g} s")
        elif (silence := worker.clock.due(self._latest)) is not None:
            yield Silent((worker.task.number,), str(worker.process.pid), silence)

    def _replace(self, worker: _Worker, reason: str) -> Lost:
        """Have a new worker draw what this one did not. Raises WorkerError after ATTEMPTS of them."""
        task = worker.task
        assert task is not None
        worker.dismiss()
        self._attempts[task.number] += 1
        if self._attempts[task.number] == ATTEMPTS:
            cause = f"{ATTEMPTS} workers ended while they drew it; the last one {reason}"
            raise WorkerError(f"frame {task.number}: {cause}")
        self._start().begin(task, self._job)
        return Lost((task.number,), reason)

    def _start(self) -> _Worker:
        with _interrupts_held_back(), _starting:
            worker = _Worker(self._threads, self._frame_timeout is not None)
            self._workers.append(worker)
        return worker

    def interrupt(self) -> None:
        """Interrupt all processes, so that they remove what they were writing, and end."""
        for worker in self._workers:
            if worker.process.is_alive() and worker.process.pid is not None:
                with contextlib.suppress(OSError):
                    os.kill(worker.process.pid, signal.SIGTERM if sys.platform == "win32" else signal.SIGINT)

    def end(self) -> None:
        """Interrupt all processes, and return when they have ended."""
        self.interrupt()
        until = time.monotonic() + PATIENCE
        for worker in self._workers:
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
