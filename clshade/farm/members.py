"""The workers of a Dask cluster, as its scheduler knows them, and how long each has been silent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from distributed import Client

from .waiting import Clock

HEARTBEAT = 5.0  # seconds in which a worker that is well is heard of several times, whatever its frames take


class Members(Mapping[str, int]):
    """Threads by address, as of when the scheduler was asked last."""

    def __init__(self, client: Client, scheduler: str) -> None:
        self._client, self.scheduler = client, scheduler
        self._threads: dict[str, int] = {}
        self._heard: dict[str, float] = {}  # when the scheduler heard of a worker last, by its clock
        self._clocks: dict[str, Clock] = {}  # since that changed

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
        """Asks the scheduler who is there; False where it gives no answer."""
        try:
            scheduler: Any = self._client.scheduler
            found: Any = self._client.sync(scheduler.identity, callback_timeout=timeout)["workers"]
        except Exception:  # such as one of a connection, or that it was not in time
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
        """The keys of the tasks that each has, waiting ones included; nothing where the scheduler gives no answer."""
        try:
            scheduler: Any = self._client.scheduler
            found: Mapping[str, list[Any]] = self._client.sync(
                scheduler.processing, workers=None, callback_timeout=timeout
            )
            return found
        except Exception:
            return {}

    def heard(self, limit: float) -> set[str]:
        """Those that were heard of within `limit` seconds, or HEARTBEAT where that is less."""
        least = HEARTBEAT + len(self) / 50  # of many workers each is heard of less often
        return {worker for worker, clock in self._clocks.items() if clock.seconds <= max(limit, least)}

    def silence(self, worker: str) -> float:
        """For how many seconds it has not been heard of."""
        return self._clocks[worker].seconds

    def due(self, worker: str) -> float | None:
        """The same where it is to be told now."""
        return self._clocks[worker].due(0.0) if worker in self._clocks else None

    def skip(self, seconds: float) -> None:
        """These do not count."""
        for clock in self._clocks.values():
            clock.skip(seconds)
