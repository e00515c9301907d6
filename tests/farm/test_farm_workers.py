"""Frames drawn by several processes: the same bits as by one, whichever is killed, and nothing left after an interrupt."""

import contextlib
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from clusters import wait_until
from command_line import needs_device
from farm_jobs import hanging, job, tasks
from processes import ROOT

from clshade.errors import DeviceError, OutputError, WorkerError
from clshade.farm import local
from clshade.farm.dispatch import ATTEMPTS
from clshade.farm.job import DrawnFrame, FrameWriter, Lost, Silent, Task
from clshade.farm.local import draw_locally
from clshade.images import exr
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera

COUNT = 24

pytestmark = [needs_device, pytest.mark.skipif(sys.platform == "win32", reason="signals")]
needs_proc = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="no /proc")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def expected(tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("one")
    with FrameWriter(job()) as writer:
        assert [writer.draw(task).number for task in tasks(folder, COUNT)] == list(range(1, COUNT + 1))
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


@pytest.mark.long
def test_two_workers_one_of_which_is_killed(tmp_path, expected):
    reports, killed = [], 0
    for report in draw_locally(job(), tasks(tmp_path, COUNT), 2):
        reports.append(report)
        if len(reports) == COUNT // 3:
            killed = children()[0]
            os.kill(killed, signal.SIGKILL)
    assert sorted(report.number for report in reports if isinstance(report, DrawnFrame)) == list(range(1, COUNT + 1))
    assert killed
    assert [report.reason for report in reports if isinstance(report, Lost)] == ["was killed by SIGKILL"]
    files = {name: data for name, data in contents(tmp_path).items() if not name.startswith(".clshade-")}
    assert files == expected  # but for what the killed process was writing
    assert not children()


class Deadly:
    """A camera that kills the process that unpickles it."""

    def __reduce__(self) -> tuple:
        return os._exit, (7,)


@pytest.mark.long
@pytest.mark.parametrize("ending", ["exit code 7", r"gave no sign for [0-9.]+ s"])
def test_a_frame_that_ends_its_workers_is_given_up(tmp_path, ending):
    good, task = tasks(tmp_path, 2)
    listed, limit = [hanging(task)], 0.5
    if ending == "exit code 7":
        listed, limit = [good, Task(2, Deadly(), task.path)], None  # type: ignore[arg-type]
    reports: list[DrawnFrame | Lost | Silent] = []
    with pytest.raises(WorkerError, match=rf"^frame 2: {ATTEMPTS} workers were lost .* {ending}$"):
        reports.extend(draw_locally(job(), listed, 2, frame_timeout=limit))
    assert [report.numbers for report in reports if isinstance(report, Lost)] == [(2,)] * (ATTEMPTS - 1)
    assert not children()


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


@pytest.mark.long
def test_errors_of_workers_name_the_frame_and_leaving_early_ends_them(tmp_path):
    first, *_ = tasks(tmp_path, COUNT)
    away = Task(3, first.camera, tmp_path / "none" / "003")
    for render_job, task, error, text in (
        (job(), away, OutputError, r"^frame 3: .*003\.exr: cannot be written: there is no folder"),
        (job(device="no-such"), first, DeviceError, r"^frame 1: no OpenCL device matches 'no-such'"),
        (job(), Task(5, "camera", tmp_path / "005"), WorkerError, r"^frame 5: AttributeError: "),  # type: ignore[arg-type]
    ):
        with pytest.raises(error, match=text) as caught:
            list(draw_locally(render_job, [task], 2))
    assert "Traceback" in caught.value.__notes__[0]
    assert not children()
    results = draw_locally(job(), tasks(tmp_path, COUNT), 2)
    next(results)
    assert len(children()) == 2
    results.close()  # type: ignore[attr-defined]
    assert not children()


def start(folder: Path, *further: str, silent: float = 10.0, before: str = "") -> subprocess.Popen[str]:
    """Start a run. silent: seconds until a worker without a sign of life is reported. before: code that is run first."""
    code = f"from clshade.farm import dispatch; dispatch.SILENT = {silent}; from clshade.__main__ import entry"
    code = f"{before}\n{code}; entry()"
    frames = ("--frames", f"1..{20 * COUNT}", "-o", "###.exr", "--resolution", "32,24", "--workers", "2")
    command = [sys.executable, "-c", code, "turntable", "icosphere", "--preset", "course", *frames, *further]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}, **pipes)


def descendants(pid: int) -> list[int]:
    pids = []
    with contextlib.suppress(OSError):  # a thread or process that has just ended
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in (task / "children").read_text().split():
                pids += [int(child), *descendants(int(child))]
    return pids


@pytest.mark.long
@needs_proc
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_run_that_is_stopped_leaves_no_process_and_can_be_resumed(tmp_path, number):
    process = start(tmp_path)
    wait_until(lambda: len(list(tmp_path.glob("*.png"))) > 5 or process.poll() is not None)
    assert process.poll() is None
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
    whole = [tmp_path / f"{name}.exr" for name in left if (tmp_path / f"{name}.png").exists()]
    times = [path.stat().st_mtime_ns for path in whole]
    process = start(tmp_path, "--frames", f"1..{len(left) + 4}", "--turn", f"1..{20 * COUNT}")
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert len(list(tmp_path.glob("*.exr"))) == len(list(tmp_path.glob("*.png"))) == len(left) + 4
    assert [path.stat().st_mtime_ns for path in whole] == times
    assert f"{len(whole)} there already" in out


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    workers = []
    for pid in descendants(process.pid):
        with contextlib.suppress(OSError):
            workers += [pid] * (b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes())
    return workers


@pytest.mark.long
@needs_proc
def test_interrupts_wait_until_workers_have_started(tmp_path):
    """Otherwise an interrupt of the whole group, as by a terminal, prints a traceback of each worker's imports."""
    process = start(tmp_path)
    wait_until(lambda: workers_of(process) or process.poll() is not None)
    status = Path(f"/proc/{workers_of(process)[0]}/status").read_text()
    assert int(status.split("SigBlk:")[1].split()[0], 16) >> (signal.SIGINT - 1) & 1
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


@pytest.mark.long
def test_an_interrupt_waits_for_a_worker_that_starts(tmp_path):
    process = start(tmp_path, before=SLOW_START)
    _, err = process.communicate(timeout=180)
    assert (process.returncode, err) == (130, "clshade: interrupted\n")


@pytest.mark.long
@needs_proc
def test_a_run_whose_workers_are_stopped_says_so_and_can_be_interrupted(tmp_path):
    process = start(tmp_path, silent=0.5)
    wait_until(lambda: len(list(tmp_path.glob("*.png"))) > 5 or process.poll() is not None)
    workers = workers_of(process)
    for worker in workers:
        os.kill(worker, signal.SIGSTOP)
    lines = iter(process.stderr.readline, "")  # type: ignore[arg-type, union-attr]
    assert any(
        re.match(rf"clshade: warning: no sign of worker {workers[0]} for \d+ s, at frame ", line) for line in lines
    )
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=180)
    assert (process.returncode, err.splitlines()[-1:]) == (130, ["clshade: interrupted"])
    wait_until(lambda: not any(is_alive(pid) for pid in workers))


@pytest.mark.long
@needs_proc
def test_a_run_goes_on_without_the_worker_that_is_stopped(tmp_path):
    process = start(tmp_path, "--frames", f"1..{2 * COUNT}", "--frame-timeout", "3")
    wait_until(lambda: len(list(tmp_path.glob("*.png"))) > 5 or process.poll() is not None)
    stopped = workers_of(process)[0]
    os.kill(stopped, signal.SIGSTOP)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert f"drawn again: the worker {stopped} gave no sign for " in err
    assert "lost, the frames drawn again" in out
    assert not is_alive(stopped)
    assert len(list(tmp_path.glob("*.exr"))) == len(list(tmp_path.glob("*.png"))) == 2 * COUNT
