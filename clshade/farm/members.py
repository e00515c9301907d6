"""The workers of a Dask cluster, as its scheduler knows them, and how long each has been silent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from distributed import Client

from .waiting import Clock

HEARTBEAT = 5.0  # seconds within which a healthy worker is heard from several times, however long its frames take


class Members(Mapping[str, int]):
    """Threads by address, as of the latest query of the scheduler."""

    def __init__(self, client: Client, scheduler: str) -> None:
        self._client, self.scheduler = client, scheduler
        self._threads: dict[str, int] = {}
        self._heard: dict[str, float] = {}  # when the scheduler last heard from a worker, by its clock
        self._clocks: dict[str, Clock] = {}  # running since that changed

    def __getitem__(self, worker: str) -> int:
        return self._threads[worker]

    def __iter__(self) -> Iterator[str]:
        return iter(self._threads)

    def __len__(self) -> int:
        return len(self._threads)

    @property
    def threads(self) -> int:
        return sum(self._threads.values())

    def ask(self, timeout: float) -> bool:
        """Query the scheduler for its workers; return False if it does not answer."""
        try:
            scheduler: Any = self._client.scheduler
            found: Any = self._client.sync(scheduler.identity, callback_timeout=timeout)["workers"]
        except Exception:  # such as a connection error or a timeout
            return False
        self._threads = {worker: each["nthreads"] for worker, each in found.items()}
        heard = {worker: each["last_seen"] for worker, each in found.items()}
        self._clocks = {
            worker: self._clocks[worker] if worker in self._clocks and self._heard[worker] == when else Clock()
            for worker, when in heard.items()
        }
        self._heard = heard
        return True

    def processing(self, timeout: float) -> Mapping[str, list[Any]]:
        """Return the keys of the tasks that each worker has, waiting ones included; empty if the scheduler does not
        answer."""
        try:
            scheduler: Any = self._client.scheduler
            found: Mapping[str, list[Any]] = self._client.sync(
                scheduler.processing, workers=None, callback_timeout=timeout
            )
            return found
        except Exception:
            return {}

    def heard(self, limit: float) -> set[str]:
        """Return the workers heard from within `limit` seconds, but at least HEARTBEAT."""
        least = HEARTBEAT + len(self) / 50  # with many workers each is heard from less often
        return {worker for worker, clock in self._clocks.items() if clock.seconds <= max(limit, least)}

    def silence(self, worker: str) -> float:
        """Return the seconds since the worker was last heard from."""
        return self._clocks[worker].seconds

    def due(self, worker: str) -> float | None:
        """Return the seconds of silence if they are to be reported now."""
        return self._clocks[worker].due(0.0) if worker in self._clocks else None

    def skip(self, seconds: float) -> None:
        """Do not count these seconds as silence."""
        for clock in self._clocks.values():
            clock.skip(seconds)
