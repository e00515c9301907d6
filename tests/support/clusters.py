"""A Dask scheduler and workers in child processes, on loopback."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from processes import ROOT


def wait_until(condition: Callable[[], object], seconds: float = 180.0) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


class Cluster:
    """A cluster started with the commands of the README; `close` stops it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._processes: list[subprocess.Popen[bytes]] = []
        file = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", file)
        wait_until(lambda: file.exists() and file.stat().st_size)
        self.address: str = json.loads(file.read_text())["address"]

    def _start(self, kind: str, *arguments: object) -> subprocess.Popen[bytes]:
        code = "import sys; sys.argv[0] = 'dask'; from dask.__main__ import main; main()"
        command = [sys.executable, "-c", code, kind, *map(str, arguments), "--no-dashboard"]
        with open(self._folder / f"{len(self._processes)}-{kind}.log", "wb") as log:
            process = subprocess.Popen(
                command,
                cwd=self._folder,
                env={**os.environ, "PYTHONPATH": str(ROOT)},
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        self._processes.append(process)
        return process

    def worker(self) -> subprocess.Popen[bytes]:
        """Start a worker process without a nanny, which would restart it when it is killed."""
        options: Sequence[object] = ("--nworkers", 1, "--nthreads", 1, "--no-nanny", "--memory-limit", 0)
        return self._start("worker", self.address, *options, "--local-directory", self._folder / "scratch")

    def wait_for_workers(self, count: int) -> None:
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=180)

    def close(self) -> None:
        for process in reversed(self._processes):
            process.send_signal(signal.SIGKILL)
            process.wait()
