"""Frames drawn by several processes: the same bits as by one, whichever is killed, and nothing left of an interrupted
run."""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import farm_jobs
import pytest
from devices import working_devices
from farm_jobs import hanging, job
from processes import ROOT

from clshade.errors import DeviceError, OutputError, WorkerError
from clshade.farm import dispatch, local
from clshade.farm.dispatch import ATTEMPTS
from clshade.farm.job import DrawnFrame, FrameWriter, Job, Lost, Silent, Task
from clshade.farm.local import draw_locally
from clshade.images import exr
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera

COUNT = 24

pytestmark = [
    pytest.mark.skipif(not working_devices(), reason="no OpenCL device works here"),
    pytest.mark.skipif(sys.platform == "win32", reason="signals"),
]


def tasks(folder: Path, count: int = COUNT) -> list[Task]:
    return farm_jobs.tasks(folder, count, (32, 24))


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def expected(tmp_path_factory) -> dict[str, bytes]:
    """Return the files that one process writes."""
    folder = tmp_path_factory.mktemp("one")
    with FrameWriter(job()) as writer:
        assert [writer.draw(task).number for task in tasks(folder)] == list(range(1, COUNT + 1))
    files = contents(folder)
    assert len(files) == 2 * COUNT
    assert len(set(files.values())) > COUNT  # frames differ
    return files


def children() -> list[int]:
    return [child.pid for child in multiprocessing.active_children() if child.pid]


def is_alive(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


def wait_until(condition: Callable[[], object], seconds: float = 180.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.01)


@pytest.mark.long
def test_two_workers_one_of_which_is_killed(tmp_path, expected):
    reports, killed = [], 0
    for report in draw_locally(job(), tasks(tmp_path), 2):
        reports.append(report)
        if len(reports) == COUNT // 3:
            killed = children()[0]
            os.kill(killed, signal.SIGKILL)
    drawn = [report.number for report in reports if isinstance(report, DrawnFrame)]
    assert sorted(drawn) == list(range(1, COUNT + 1))
    assert killed
    lost = [report for report in reports if isinstance(report, Lost)]
    assert [report.reason for report in lost] == ["was killed by SIGKILL"]
    assert written(tmp_path) == expected
    assert not children()


class Deadly:
    """A camera that kills the process that unpickles it."""

    def __reduce__(self) -> tuple:
        return os._exit, (7,)


@pytest.mark.long
def test_a_frame_that_kills_its_workers_is_given_up(tmp_path):
    good, *_ = tasks(tmp_path)
    bad = Task(2, Deadly(), tmp_path / "002")  # type: ignore[arg-type]
    reports: list[DrawnFrame | Lost] = []
    with pytest.raises(WorkerError, match=rf"^frame 2: {ATTEMPTS} workers were lost .* exit code 7$"):
        reports.extend(draw_locally(job(), [good, bad], 2))
    assert sum(isinstance(report, Lost) for report in reports) == ATTEMPTS - 1
    assert not children()


def written(folder: Path) -> dict[str, bytes]:
    """Return the files, except those that a killed process was writing."""
    return {name: data for name, data in contents(folder).items() if not name.startswith(".clshade-")}


@pytest.mark.long
def test_a_worker_that_is_stopped_is_told_of_and_waited_for(tmp_path, expected, monkeypatch):
    monkeypatch.setattr(dispatch, "SILENT", 0.5)
    reports: list[DrawnFrame | Lost | Silent] = []
    silent: list[Silent] = []  # from the stopped worker
    stopped, meanwhile = 0, 0  # the worker, and frames that the other one draws while it is
    for report in draw_locally(job(), tasks(tmp_path), 2):
        reports.append(report)
        if not stopped and sum(isinstance(one, DrawnFrame) for one in reports) == COUNT // 3:
            stopped = children()[0]
            os.kill(stopped, signal.SIGSTOP)
        elif stopped:
            meanwhile += isinstance(report, DrawnFrame)
            if isinstance(report, Silent) and report.worker == str(stopped):
                silent.append(report)
            if len(silent) >= 2 and meanwhile:
                os.kill(stopped, signal.SIGCONT)
    drawn = [report.number for report in reports if isinstance(report, DrawnFrame)]
    assert sorted(drawn) == list(range(1, COUNT + 1))
    first, second, *_ = silent
    assert first.numbers == second.numbers
    assert second.seconds >= 2.0 * first.seconds >= 1.0
    assert drawn.index(first.numbers[0]) > COUNT // 3
    assert not any(isinstance(report, Lost) for report in reports)
    assert written(tmp_path) == expected


@pytest.mark.long
def test_a_worker_that_is_stopped_is_replaced(tmp_path, expected):
    reports: list[DrawnFrame | Lost | Silent] = []
    for report in draw_locally(job(), tasks(tmp_path), 2, frame_timeout=3.0):
        reports.append(report)
        if len(reports) == COUNT // 3:
            # Not one that may still be compiling, for which it has longer.
            stopped = int(report.worker.rpartition(":")[2])
            os.kill(stopped, signal.SIGSTOP)
    assert sorted(report.number for report in reports if isinstance(report, DrawnFrame)) == list(range(1, COUNT + 1))
    lost = [report for report in reports if isinstance(report, Lost)]
    assert [report.reason.partition(" for ")[0] for report in lost].count(f"{stopped} gave no sign") == 1
    assert written(tmp_path) == expected
    assert not is_alive(stopped)
    assert not children()


@pytest.mark.long
def test_a_frame_in_which_workers_hang_is_given_up(tmp_path):
    bad = hanging(tasks(tmp_path, 2)[1])
    reports: list[DrawnFrame | Lost | Silent] = []
    with pytest.raises(WorkerError, match=rf"^frame 2: {ATTEMPTS} workers were lost .* gave no sign for [0-9.]+ s$"):
        reports.extend(draw_locally(job(), [bad], 2, frame_timeout=0.5))
    assert [report.numbers for report in reports if isinstance(report, Lost)] == [(2,)] * (ATTEMPTS - 1)
    assert not children()


def test_starting_does_not_count(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(dispatch, "now", lambda: now[0])
    (task,) = tasks(tmp_path, 1)
    pool = local._Pool(job(), [task], 1, 5.0)
    workers = [MagicMock(load=0.0, threads=1, flights={}, stuck=set()) for _ in range(2)]
    workers[0].name, workers[1].name = "a", "b"
    pool._workers["a"] = workers[0]
    monkeypatch.setattr(pool, "start", lambda: pool._workers.update(b=workers[1]))
    pool._hand_out()
    (flight,) = workers[0].flights.values()
    now[0] += dispatch.PREPARING + 4.0
    assert [type(report) for report in pool._check()] == [Silent]
    flight.advance(begun=True, ready=True)
    now[0] += 4.0
    assert list(pool._check()) == []
    now[0] += 2.0
    assert [report.numbers for report in pool._check()] == [(1,)]
    workers[0].process.kill.assert_called_once()
    pool._hand_out()
    workers[1].send.assert_called_once_with(task)


@pytest.mark.sampled
@pytest.mark.parametrize("away", [0.0, 60.0])
def test_time_in_which_this_process_was_stopped_does_not_count(tmp_path, monkeypatch, away):
    monkeypatch.setattr(dispatch, "SILENT", 0.05)  # less than a worker takes to start
    passed = itertools.count(time.monotonic(), 1.0 + away)  # seconds from one reading to the next
    monkeypatch.setattr(dispatch, "time", SimpleNamespace(monotonic=lambda: next(passed)))
    reports = list(draw_locally(job(), tasks(tmp_path, 1), 2))
    assert any(isinstance(report, Silent) for report in reports) == (away == 0.0)


def test_kernels_are_compiled_before_a_frame_counts(tmp_path, monkeypatch):
    order: list[str] = []
    render = Renderer.render

    def watched(self: Renderer, camera: Camera) -> object:
        order.append("{}x{}".format(*camera.resolution))
        return render(self, camera)

    monkeypatch.setattr(Renderer, "render", watched)
    with FrameWriter(job()) as writer:
        for task in tasks(tmp_path, 2):
            writer.draw(task, lambda: order.append("ready"))
    assert order == ["16x16", "ready", "32x24", "ready", "32x24"]


def test_a_large_scene_does_not_wait_for_a_worker_that_is_stopped(tmp_path):
    worker = local._Process(bytes(1 << 24), 1, timed=False)
    try:
        os.kill(worker.process.pid, signal.SIGSTOP)  # type: ignore[arg-type]
        start = time.monotonic()
        worker.send(tasks(tmp_path, 1)[0])
        assert time.monotonic() - start < 5.0
    finally:
        worker.process.kill()
        worker.dismiss()
    assert worker._sender is not None
    assert not worker._sender.is_alive()


def draw_all(render_job: Job, listed: Iterable[Task]) -> None:
    for _ in draw_locally(render_job, list(listed), 2):
        pass


@pytest.mark.long
def test_errors_of_workers_name_the_frame(tmp_path):
    first, *_ = tasks(tmp_path)
    away = Task(3, first.camera, tmp_path / "none" / "003")
    with pytest.raises(OutputError, match=r"^frame 3: .*003\.exr: cannot be written: there is no folder"):
        draw_all(job(), [away])
    with pytest.raises(DeviceError, match=r"^frame 1: no OpenCL device matches 'no-such'"):
        draw_all(job(device="no-such"), [first])
    with pytest.raises(WorkerError, match=r"^frame 5: AttributeError: ") as caught:
        draw_all(job(), [Task(5, "camera", tmp_path / "005")])  # type: ignore[arg-type]
    assert "Traceback" in caught.value.__notes__[0]
    assert not children()


@pytest.mark.long
def test_leaving_early_ends_the_workers(tmp_path):
    results = draw_locally(job(), tasks(tmp_path), 2)
    next(results)
    assert len(children()) == 2
    results.close()  # type: ignore[attr-defined]
    assert not children()


# Runs of the command


def start(folder: Path, *further: str, silent: float = 10.0, before: str = "") -> subprocess.Popen[str]:
    """Start a run. silent: seconds until a worker without a sign of life is reported. before: code that is run first."""
    code = f"from clshade.farm import dispatch; dispatch.SILENT = {silent}; from clshade.__main__ import entry"
    code = f"{before}\n{code}; entry()"
    frames = ("--frames", f"1..{20 * COUNT}", "-o", "###.exr", "--resolution", "32,24", "--workers", "2")
    command = [sys.executable, "-c", code, "turntable", "icosphere", "--preset", "course", *frames, *further]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def descendants(pid: int) -> list[int]:
    pids = []
    with contextlib.suppress(OSError):  # a thread or process that has just ended
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in (task / "children").read_text().split():
                pids += [int(child), *descendants(int(child))]
    return pids


def under_way(folder: Path) -> subprocess.Popen[str]:
    """Start a run, and wait until it has drawn some of its frames."""
    process = start(folder)
    wait_until(lambda: len(list(folder.glob("*.png"))) > 5 or process.poll() is not None)
    assert process.poll() is None
    return process


@pytest.mark.sampled
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="no /proc")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_run_that_is_stopped_leaves_no_process_and_can_be_resumed(tmp_path, number):
    process = under_way(tmp_path)
    pids = descendants(process.pid)
    assert len(pids) >= 2
    process.send_signal(number)
    _, err = process.communicate(timeout=180)
    if number == signal.SIGINT:
        assert process.returncode == 130
        assert err.splitlines()[-1] == "clshade: interrupted"
        assert "Traceback" not in err
    wait_until(lambda: not any(is_alive(pid) for pid in pids))
    left = sorted(path.stem for path in tmp_path.glob("*.exr"))
    assert 5 < len(left) < 20 * COUNT
    assert all(exr.read(path)[0]["R"].shape == (24, 32) for path in tmp_path.glob("*.exr"))
    if number == signal.SIGINT:
        assert not list(tmp_path.glob(".clshade-*"))
    before = {
        name: (tmp_path / f"{name}.exr").stat().st_mtime_ns for name in left if (tmp_path / f"{name}.png").exists()
    }
    process = start(tmp_path, "--frames", f"1..{len(left) + 4}", "--turn", f"1..{20 * COUNT}")
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert len(list(tmp_path.glob("*.exr"))) == len(list(tmp_path.glob("*.png"))) == len(left) + 4
    assert all((tmp_path / f"{name}.exr").stat().st_mtime_ns == when for name, when in before.items())
    assert f"{len(before)} there already" in out


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    return [pid for pid in descendants(process.pid) if b"spawn_main" in command_line(pid)]


def command_line(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def blocked(pid: int) -> int:
    """Return the mask of signals that a process blocks."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.split("SigBlk:")[1].split()[0], 16)


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="no /proc")
def test_interrupts_wait_until_workers_have_started(tmp_path):
    """Otherwise an interrupt of the whole group, as by a terminal, prints a traceback of each worker's imports."""
    process = start(tmp_path)
    wait_until(lambda: workers_of(process) or process.poll() is not None)
    assert [blocked(pid) >> (signal.SIGINT - 1) & 1 for pid in workers_of(process)[:1]] == [1]
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=180)
    assert (process.returncode, err) == (130, "clshade: interrupted\n")


# Interrupts itself when a worker has been started, before that is told anything, and takes its time to tell it.
SLOW_START = """
import os, signal, time
from clshade.base import interrupts
interrupts.leave_soon()  # before NumPy starts threads
from multiprocessing import util
spawn = util.spawnv_passfds
def slow(*arguments):
    pid = spawn(*arguments)
    if b"spawn_main" in arguments[1][-2].encode():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.6)  # longer than the main thread gets
    return pid
util.spawnv_passfds = slow
"""


def test_an_interrupt_waits_for_a_worker_that_starts(tmp_path):
    """Otherwise the worker prints a traceback: it is told nothing."""
    process = start(tmp_path, before=SLOW_START)
    _, err = process.communicate(timeout=180)
    assert (process.returncode, err) == (130, "clshade: interrupted\n")


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="no /proc")
def test_a_run_names_the_worker_that_is_stopped_and_can_be_interrupted(tmp_path):
    process = start(tmp_path, silent=0.5)
    first = [tmp_path / f"{number:03d}.png" for number in (1, 2)]
    wait_until(lambda: all(path.exists() for path in first) or process.poll() is not None)
    time.sleep(0.2)  # until that is answered, too
    assert process.poll() is None
    workers = workers_of(process)
    for worker in workers:
        os.kill(worker, signal.SIGSTOP)
    form = r"clshade: warning: no sign of worker (\d+) for \d+ s, at frame (\d+) \(--frame-timeout SECONDS gives .*\)\n"
    silent: set[int] = set()
    while silent != set(workers):
        line = process.stderr.readline()  # type: ignore[union-attr]
        if re.match(r"clshade: \d+/\d+ frames, ", line):  # printed at a slow start
            continue
        match = re.fullmatch(form, line)
        assert match, line
        if int(match[2]) > 2:  # the first two may have waited for their workers to start
            silent.add(int(match[1]))
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=180)
    assert (process.returncode, err.splitlines()[-1:]) == (130, ["clshade: interrupted"])
    wait_until(lambda: not any(is_alive(pid) for pid in workers))
    assert "\r" not in err


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="no /proc")
def test_a_run_goes_on_without_the_worker_that_is_stopped(tmp_path):
    process = start(tmp_path, "--frames", f"1..{2 * COUNT}", "--frame-timeout", "3")
    wait_until(lambda: len(list(tmp_path.glob("*.png"))) > 5 or process.poll() is not None)
    stopped = workers_of(process)[0]
    os.kill(stopped, signal.SIGSTOP)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert f"drawn again: the worker {stopped} gave no sign for " in err
    assert "lost, the frames drawn again" in out
    assert len(list(tmp_path.glob("*.exr"))) == len(list(tmp_path.glob("*.png"))) == 2 * COUNT
