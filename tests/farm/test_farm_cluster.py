"""Frames drawn by a Dask cluster: a real scheduler and workers on loopback, one of which is killed midway."""

import contextlib
import signal
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import farm_jobs
import pytest
from clusters import Cluster
from command_line import assert_refused, needs_device, run
from farm_jobs import job

from clshade.errors import DeviceError, InputError, WorkerError
from clshade.farm import dispatch
from clshade.farm.job import DrawnFrame, FrameWriter, Job, Lost, Silent, Task

cluster_module = pytest.importorskip("clshade.farm.cluster", reason="needs dask.distributed", exc_type=ImportError)

COUNT = 40
PATIENT = 120.0  # seconds, for busy machines

pytestmark = [needs_device, pytest.mark.skipif(sys.platform == "win32", reason="signals")]


def tasks(folder: Path, count: int = COUNT) -> list[Task]:
    return farm_jobs.tasks(folder, count, (64, 48))


@pytest.fixture
def cluster(tmp_path_factory) -> Iterator[Cluster]:
    with contextlib.closing(Cluster(tmp_path_factory.mktemp("cluster"))) as cluster:
        yield cluster


@pytest.mark.long
def test_two_workers_one_of_which_is_killed(tmp_path, cluster):
    workers = {process.pid: process for process in (cluster.worker(), cluster.worker())}
    here, there = tmp_path / "here", tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
    with FrameWriter(job()) as writer:
        for task in tasks(here):
            writer.draw(task)

    cluster.wait_for_workers(2)
    reports: list[DrawnFrame | Lost] = []
    for report in cluster_module.draw_on_cluster(job(), tasks(there), cluster.address, PATIENT):
        reports.append(report)
        if len(reports) == COUNT // 4:
            assert isinstance(report, DrawnFrame)
            busy = workers[int(report.worker.rpartition(":")[2])]
            busy.send_signal(signal.SIGKILL)
            busy.wait()
    lost = [report for report in reports if isinstance(report, Lost)]
    drawn = [report for report in reports if isinstance(report, DrawnFrame)]
    assert [report.reason.partition(" ")[2] for report in lost] == ["is gone"]
    assert sorted(report.number for report in drawn) == list(range(1, COUNT + 1))
    assert len({report.worker for report in drawn}) == 2
    written = {path.name: path.read_bytes() for path in there.iterdir() if not path.name.startswith(".clshade-")}
    assert written == {path.name: path.read_bytes() for path in here.iterdir()}
    assert len(written) == 2 * COUNT


@pytest.mark.long
def test_a_worker_that_is_stopped(tmp_path, cluster, monkeypatch, capsys):
    """The other worker draws its frames, and in the next run, of which the stopped one never hears, all of them."""
    monkeypatch.setattr(dispatch, "SILENT", 2.0)
    monkeypatch.setattr(cluster_module, "SILENT", 2.0)
    workers = {process.pid: process for process in (cluster.worker(), cluster.worker())}
    cluster.wait_for_workers(2)
    reports: list[DrawnFrame | Lost | Silent] = []
    for report in cluster_module.draw_on_cluster(job(), tasks(tmp_path), cluster.address, PATIENT, 3.0):
        reports.append(report)
        if len(reports) == COUNT // 4:
            assert isinstance(report, DrawnFrame)
            workers[int(report.worker.rpartition(":")[2])].send_signal(signal.SIGSTOP)
    assert sorted(report.number for report in reports if isinstance(report, DrawnFrame)) == list(range(1, COUNT + 1))
    assert any(isinstance(report, Lost) and "gave no sign for " in report.reason for report in reports)
    assert len(list(tmp_path.glob("*.exr"))) == len(list(tmp_path.glob("*.png"))) == COUNT
    reports = list(cluster_module.draw_on_cluster(job(), tasks(tmp_path), cluster.address, PATIENT, 3.0))
    assert len({report.number for report in reports if isinstance(report, DrawnFrame)}) == COUNT
    assert "no sign of worker tcp://127.0.0.1:" in capsys.readouterr().err


@pytest.mark.long
def test_errors_come_back_and_the_cluster_can_be_used_again(tmp_path, cluster, capsys, monkeypatch):
    def draw(render_job: Job, count: int = 1, timeout: float = PATIENT) -> None:
        list(cluster_module.draw_on_cluster(render_job, tasks(tmp_path, count), cluster.address, timeout))

    with pytest.raises(InputError, match=r"expected workers within 5 s .*`dask worker tcp://.*found none$"):
        draw(job(), 10, 5.0)
    worker = cluster.worker()
    with pytest.raises(DeviceError, match=r"^frame 1: no OpenCL device matches 'no-such'"):
        draw(job(device="no-such"))
    monkeypatch.setattr(cluster_module, "code_digest", lambda: "another")
    with pytest.raises(WorkerError, match=r"^worker tcp://.*expected the clshade that runs here"):
        draw(job())
    monkeypatch.undo()
    monkeypatch.setattr(cluster_module, "VISIBLE", 0.5)
    monkeypatch.setattr(Task, "paths", [tmp_path / "on-a-disk-of-its-own"])
    with pytest.raises(WorkerError, match=rf"workers that write to this machine's {tmp_path}, found frame 1 written"):
        draw(job())
    monkeypatch.undo()
    for path in tmp_path.iterdir():
        path.unlink()

    monkeypatch.chdir(tmp_path)  # the workers' current folder is another
    command = ("turntable", "icosphere", "--frames", "1..4", "--resolution", "64,48", "--preset", "course")
    code, out, err = run(capsys, *command, "--scheduler", cluster.address, "-o", "#.exr", "--timeout", "60")
    assert code == 0
    assert "1 worker" in out
    assert "4/4" in "".join(err)
    assert len(list(tmp_path.iterdir())) == 8

    worker.send_signal(signal.SIGKILL)
    worker.wait()
    with pytest.raises((InputError, WorkerError), match="worker"):
        draw(job(), 2, 5.0)


@pytest.mark.long
def test_the_scheduler_is_lost(tmp_path, cluster):
    cluster.worker()
    cluster.wait_for_workers(1)
    results = cluster_module.draw_on_cluster(job(), tasks(tmp_path, 800), cluster.address, 5.0)
    next(results)
    cluster.scheduler.send_signal(signal.SIGKILL)
    cluster.scheduler.wait()
    with pytest.raises(WorkerError, match=r"gone|no worker is left"):
        list(results)


def refused(capsys: pytest.CaptureFixture[str], address: str) -> str:
    start = time.perf_counter()
    outcome = run(capsys, "turntable", "quads", "--scheduler", address, "--timeout", "2", "--frames", "1..2")
    assert_refused(outcome)
    assert time.perf_counter() - start < PATIENT
    return outcome[2][0]


@pytest.mark.parametrize("address", ["host", "tcp://host", "http://127.0.0.1:8786", "tcp://a b:1", "tcp://:1", ""])
def test_addresses_that_are_none(folder, capsys, address):
    assert "expected an address such as tcp://host:8786" in refused(capsys, address)


@pytest.mark.long
def test_a_scheduler_that_cannot_be_reached(folder, capsys):
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))  # nobody listens
        address = f"tcp://127.0.0.1:{nobody.getsockname()[1]}"
        line = refused(capsys, address)
        assert address in line
        assert "2 s" in line
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        refused(capsys, f"tcp://127.0.0.1:{silent.getsockname()[1]}")
    assert "tcp://no-such-host.invalid:8786" in refused(capsys, "tcp://no-such-host.invalid:8786")
    assert not list(folder.iterdir())


def test_without_dask(folder, capsys, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert 'pip install "dask[distributed]"' in refused(capsys, "tcp://127.0.0.1:8786")


def test_the_code_s_digest_changes_with_the_code(tmp_path, monkeypatch):
    before = cluster_module.code_digest()
    (tmp_path / "one.cl").write_text("kernel")
    monkeypatch.setattr(cluster_module, "kernel_folder", lambda: tmp_path)
    assert cluster_module.code_digest.__wrapped__() != before
