"""How long workers may be silent, by a simulated clock; and the dispatch of frames in a fake cluster."""

import contextlib
import queue
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from farm_jobs import tasks

from clshade.errors import WorkerError
from clshade.farm import dispatch
from clshade.farm.job import DrawnFrame, Lost, Silent, Task

cluster_module = pytest.importorskip("clshade.farm.cluster", reason="needs dask.distributed", exc_type=ImportError)


class Time:
    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now

    def run(self, seconds: float) -> None:
        """Let time pass in which this process runs."""
        end = self.now + seconds
        while self.now < end:
            self.now = min(self.now + 1.0, end)
            dispatch.now()


@pytest.fixture
def turned(monkeypatch) -> Time:
    turned = Time()
    monkeypatch.setattr(dispatch, "time", turned)
    return turned


def test_silence_is_told_each_time_that_it_has_doubled(turned):
    """Frames that take long are no silence, nor is time in which this process was stopped."""
    clock, durations = dispatch.Clock(), []
    for _ in range(1000):
        turned.now += 0.1
        if (seconds := clock.due(latest=0.1)) is not None:
            durations.append(round(seconds))
    assert durations == [10, 20, 40, 80]
    clock = dispatch.Clock()
    turned.run(9.9)
    assert clock.due(0.1) is None
    turned.run(15.1)
    assert clock.due(latest=13.0) is None
    assert clock.due(latest=12.0) == 25.0
    clock = dispatch.Clock()
    for passed, counted in ((0.1, 0.1), (2.9, 3.0), (60.0, 3.0), (0.1, 3.1)):
        turned.now += passed
        assert clock.seconds == pytest.approx(counted)


class FakeFuture:
    def __init__(self, task: Task, worker: str) -> None:
        self.task, self.worker, self.status = task, worker, "pending"

    def add_done_callback(self, call: Any) -> None:
        pass

    def release(self) -> None:
        self.status = "cancelled"


class FakeCluster:
    """Fake client, which gives each frame to the worker for which it is submitted."""

    scheduler = SimpleNamespace(identity="identity")

    def __init__(self, turned: Time, **threads: int) -> None:
        self.turned, self.threads, self.stopped = turned, dict(threads), set[str]()
        self.futures: list[FakeFuture] = []
        self.answers, self.run = True, ""
        self.handlers: dict[str, Any] = {}

    def subscribe_topic(self, topic: str, handler: Any) -> None:
        self.handlers[topic] = handler

    def sync(self, what: str, callback_timeout: float, **_: Any) -> Any:
        if not self.answers:
            raise TimeoutError
        heard = self.turned.now
        seen = {worker: 0.0 if worker in self.stopped else heard for worker in self.threads}
        return {"workers": {name: {"nthreads": n, "last_seen": seen[name]} for name, n in self.threads.items()}}

    def submit(self, draw: Any, name: str, task: Task, *, workers: list[str], **_: Any) -> FakeFuture:
        future = FakeFuture(task, *workers)
        self.futures.append(future)
        return future

    def waiting(self, worker: str) -> list[FakeFuture]:
        return [future for future in self.futures if future.worker == worker and future.status == "pending"]

    def say(self, future: FakeFuture, sign: str, **more: Any) -> None:
        said = {"number": future.task.number, "worker": future.worker, "sign": sign, **more}
        self.handlers[cluster_module.TOPIC]((0.0, {"run": self.run, **said}))

    def begin(self, worker: str) -> FakeFuture:
        future = self.waiting(worker)[0]
        self.say(future, "begun")
        self.say(future, "ready")
        return future

    def draw(self, future: FakeFuture) -> None:
        task = future.task
        for kind in ("exr", "png"):
            task.path.with_name(f"{task.path.name}.{kind}").touch()
        future.status = "finished"
        drawn = {"number": task.number, "render_ms": 1.0, "save_ms": 1.0, "size": 2, "warnings": []}
        self.say(future, "drawn", drawn={**drawn, "worker": future.worker})


class Run(queue.Queue):
    """A run on such a cluster, and its events, which are polled once per step of one second."""

    def __init__(self, turned: Time, cluster: FakeCluster, source: Iterator[Task], limit: float | None) -> None:
        super().__init__()
        self.turned, self.cluster = turned, cluster
        self.dispatcher = cluster_module.Cluster(cluster, "tcp://scheduler", source, 10.0, limit)
        cluster.run = self.dispatcher.name
        self.dispatcher._events = self
        self.steps_left, self.away = 0, 0.0

    def get(self, timeout: float) -> Any:
        if not self.empty():
            return super().get()
        self.turned.now += 1.0 + self.away
        self.away = 0.0
        self.steps_left -= 1
        if self.steps_left < 0:
            raise Paused
        raise queue.Empty

    def step(self, seconds: int = 1) -> list[DrawnFrame | Lost | Silent]:
        """Return the events of that many seconds."""
        self.steps_left = seconds
        reports: list[DrawnFrame | Lost | Silent] = []
        with contextlib.suppress(Paused):
            for result in self.dispatcher.results():
                reports.append(result)
        return reports


class Paused(Exception):
    pass


def start(turned: Time, folder: Path, count: int, limit: float | None = 5.0) -> tuple[Run, FakeCluster]:
    """Start a run with the workers a and b."""
    cluster = FakeCluster(turned, a=1, b=1)
    run = Run(turned, cluster, iter(tasks(folder, count, (8, 8))), limit)
    run.step()
    return run, cluster


def numbers(reports: list[Any], kind: type) -> list[int]:
    return sorted(number for report in reports if isinstance(report, kind) for number in getattr(report, "numbers", ()))


@pytest.mark.long
def test_no_more_frames_are_taken_than_there_are_threads_for(turned, tmp_path):
    taken: list[int] = []

    def counted_tasks() -> Iterator[Task]:
        for task in tasks(tmp_path, 1000, (8, 8)):
            taken.append(task.number)
            yield task

    cluster = FakeCluster(turned, a=1, b=2)
    run = Run(turned, cluster, counted_tasks(), None)
    run.step()
    assert len(taken) == 3 * cluster_module.AHEAD
    for done in range(1, 20):
        cluster.draw(cluster.waiting("a")[0] if cluster.waiting("a") else cluster.waiting("b")[0])
        run.step()
        assert 3 * (cluster_module.AHEAD - 1) < len(taken) - done <= 3 * cluster_module.AHEAD
        assert len(run.dispatcher._flights) == len(taken) - done
    cluster.threads["c"] = 4  # joins later and gets work
    run.step(2)
    assert len(taken) == 7 * cluster_module.AHEAD + 19
    assert cluster.waiting("c")


def test_a_frame_that_takes_too_long_goes_to_another_worker_and_the_first_to_draw_it_wins(turned, tmp_path):
    run, cluster = start(turned, tmp_path, 2)
    slow, quick = cluster.begin("a"), cluster.begin("b")
    cluster.draw(quick)
    assert [type(report) for report in run.step(4)] == [DrawnFrame]
    (lost,) = run.step(4)
    assert isinstance(lost, Lost)
    assert (lost.numbers, lost.reason.split(" ")[0]) == ((1,), "a")
    assert "gave no sign for" in lost.reason
    (again,) = cluster.waiting("b")
    assert again.task.number == 1
    cluster.draw(slow)  # it returns before the other has drawn it
    (drawn,) = run.step()
    assert (drawn.number, drawn.worker, again.status) == (1, "a", "cancelled")
    cluster.say(again, "drawn", drawn={})  # late: ignored
    assert run.step() == []
    assert not run.dispatcher._flights


def test_a_worker_that_is_free_draws_frames_that_wait_behind_others(turned, tmp_path):
    run, cluster = start(turned, tmp_path, 2 * cluster_module.AHEAD)
    first = cluster.begin("a")
    others = {future.task.number for future in cluster.waiting("a")} - {first.task.number}
    while waiting := cluster.waiting("b"):
        if others & {future.task.number for future in waiting}:
            break
        cluster.draw(waiting[0])
        run.step()
    assert waiting
    assert first in cluster.waiting("a")


def test_compiling_has_time_and_so_has_this_process_when_it_was_stopped(turned, tmp_path):
    run, cluster = start(turned, tmp_path, 1)
    (future,) = cluster.waiting("a")
    cluster.say(future, "begun")
    assert numbers(run.step(int(dispatch.PREPARING)), Lost) == []
    cluster.say(future, "ready")
    assert numbers(run.step(3), Lost) == []
    run.away = 60.0
    assert run.step(1) == []
    assert numbers(run.step(4), Lost) == [1]


def test_a_worker_that_hangs_gets_nothing_new_until_it_is_back(turned, tmp_path):
    run, cluster = start(turned, tmp_path, 100)
    hanging = cluster.begin("a")  # it reports all the time
    run.step(8)
    assert cluster.waiting("a") == []
    for _ in range(4):
        cluster.draw(cluster.waiting("b")[0])
        assert numbers(run.step(), Lost) == []
        assert cluster.waiting("a") == []
        assert cluster_module.AHEAD <= len(cluster.waiting("b")) < 2 * cluster_module.AHEAD
    cluster.draw(hanging)
    for _ in range(2):
        cluster.draw(cluster.waiting("b")[0])
        run.step()
    assert cluster.waiting("a")


def test_a_worker_that_is_stopped_before_it_begins_loses_what_it_was_given(turned, tmp_path):
    run, cluster = start(turned, tmp_path, 100)
    cluster.stopped.add("a")
    (first, *_) = futures = cluster.waiting("a")
    assert numbers(run.step(4), Lost) == []
    assert numbers(run.step(4), Lost) == sorted(future.task.number for future in futures)
    assert cluster.waiting("a") == []
    moved = run.dispatcher._flights[first.task.number]
    run.step()
    assert moved.worker.name == "b"
    cluster.say(first, "begun")  # it is back, and does not know yet
    run.step()
    assert (moved.worker.name, moved.begun) == ("b", False)
    drawn: set[int] = set()
    while cluster.waiting("b"):
        cluster.draw(cluster.waiting("b")[0])
        drawn |= {report.number for report in run.step() if isinstance(report, DrawnFrame)}
        assert not cluster.waiting("a")
    assert drawn == set(range(1, 101))


def test_frames_follow_when_the_workers_that_they_were_given_to_are_gone(turned, tmp_path):
    run, cluster = start(turned, tmp_path, 2)
    cluster.begin("a")
    cluster.draw(cluster.begin("b"))
    run.step(8)
    (moved,) = cluster.waiting("b")
    del cluster.threads["b"]
    cluster.threads["c"] = 1
    run.step(2)
    assert moved.status == "cancelled"
    (again,) = cluster.waiting("c")
    assert again.task.number == 1


def test_without_a_limit_silence_is_told_and_waited_for(turned, tmp_path):
    run, cluster = start(turned, tmp_path, 2, limit=None)
    first = cluster.begin("a")
    cluster.stopped |= {"a", "b"}  # b has not begun its frames
    reports = run.step(85)
    assert all(isinstance(report, Silent) for report in reports)
    for worker, number in (("a", 1), ("b", 2)):
        worker_reports = [report for report in reports if report.worker == worker]
        assert {report.numbers for report in worker_reports} == {(number,)}
        seconds = [report.seconds for report in worker_reports]
        assert len(seconds) == 4
        assert seconds[0] == pytest.approx(10.5, abs=1.0)
        assert all(later >= 2.0 * sooner for sooner, later in pairwise(seconds))
    cluster.stopped.clear()
    cluster.draw(first)
    cluster.draw(cluster.begin("b"))
    assert sorted(report.number for report in run.step()) == [1, 2]


@pytest.mark.parametrize(("ends", "text"), [
    ("hang", "no worker gives a sign any more"), ("go", "no worker is left"), ("scheduler", "gives no answer"),
])  # fmt: skip
def test_without_workers_the_run_ends(turned, tmp_path, ends, text):
    """Also of a scheduler that does not answer at first, which is waited for."""
    cluster = FakeCluster(turned, a=1, b=1)
    cluster.answers = False
    run = Run(turned, cluster, iter(tasks(tmp_path, 20, (8, 8))), 5.0)
    assert run.step(3) == []
    cluster.answers = True
    run.step(2)
    for worker in ("a", "b"):
        cluster.begin(worker)
    if ends == "hang":
        cluster.stopped |= {"a", "b"}
    elif ends == "go":
        cluster.threads.clear()
    else:
        cluster.answers = False
    with pytest.raises(WorkerError, match=text):
        run.step(60)
    assert turned.now < 1040.0
