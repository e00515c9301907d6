"""The results of `bench`, and their verdicts against the bars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from ..timing import Spread
from .device_peaks import Peaks
from .frame_timing import FrameTiming
from .peers.agreement import Agreement
from .scaling import EXPONENT, Series
from .starting import EMPTY, NAME, WARM, Started
from .workloads import Workload


class Verdict(NamedTuple):
    """A figure and its bar, the least or the most allowed. value: None if it could not be measured."""

    workload: str
    what: str
    value: float | None
    bar: float
    at_least: bool

    @property
    def kept(self) -> bool | None:
        if self.value is None:
            return None
        return self.value >= self.bar if self.at_least else self.value <= self.bar

    def stats(self) -> dict[str, Any]:
        return {**self._asdict(), "kept": self.kept}


@dataclass(frozen=True)
class Compared:
    """Frame times of a peer and ours, drawn in turns, in milliseconds. rounds: number of turns, each of `turn` frames; of
    ours if the peer draws once. interval: 95 % interval of the ratio; None if the peer draws once."""

    peer: str
    title: str
    ours: Spread
    theirs: Spread
    rounds: int
    agreement: Agreement
    turn: int = 1
    interval: tuple[float, float] | None = None

    @property
    def ratio(self) -> float | None:
        """Speedup over the peer; None if the images differ."""
        return self.theirs.median / self.ours.median if self.agreement.same else None

    def stats(self) -> dict[str, Any]:
        return {
            "peer": self.peer,
            "title": self.title,
            "ours_ms": self.ours._asdict(),
            "theirs_ms": self.theirs._asdict(),
            "rounds": self.rounds,
            "turn": self.turn,
            "ratio": self.ratio,
            "interval": self.interval,
            "picture": self.agreement.stats(),
        }


@dataclass(frozen=True)
class Result:
    """One workload. drawn: None if it cannot be drawn here, for the reason in `failed`. missing: peer -> why."""

    workload: Workload
    drawn: FrameTiming | None
    compared: tuple[Compared, ...] = ()
    missing: tuple[tuple[str, str], ...] = ()
    failed: str = ""

    def verdicts(self, peaks: Peaks) -> list[Verdict]:
        """Return the verdicts on the workload's bars. peaks: of the device, for its floor."""
        name = self.workload.name
        figures = self.drawn.figures if self.drawn else {}
        ratios = [
            Verdict(name, f"times as fast as {each.peer}", each.ratio, self.workload.ratios[each.peer], True)
            for each in self.compared
            if each.peer in self.workload.ratios
        ]
        limits = (
            Verdict(name, each.label, figures.get(each.figure), each.value, each.at_least)
            for each in self.workload.limits
        )
        floors = []
        if self.workload.most_floors is not None:
            times = self.drawn.ms / self.drawn.floor_ms(peaks) if self.drawn else None
            floors.append(Verdict(name, "times its floor", times, self.workload.most_floors, False))
        return [*ratios, *limits, *floors]

    def stats(self) -> dict[str, Any]:
        return {
            "workload": self.workload.name,
            "about": self.workload.about,
            "drawn": self.drawn and {**self.drawn.stats(), **self.drawn.figures},
            "peers": [each.stats() for each in self.compared],
            "missing": dict(self.missing),
            "failed": self.failed,
        }


@dataclass(frozen=True)
class Speed:
    """All results of a run. device, machine: descriptions. failed: what, other than workloads, was not measured, and
    why."""

    device: str
    machine: str
    peaks: Peaks
    results: tuple[Result, ...]
    started: Started | None = None
    series: tuple[Series, ...] = ()
    failed: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether everything could be drawn, and every peer drew the same images."""
        return not self.failed and all(
            not result.failed and all(each.agreement.same for each in result.compared) for result in self.results
        )

    def verdicts(self) -> list[Verdict]:
        found = [verdict for result in self.results for verdict in result.verdicts(self.peaks)]
        if self.started:
            found.append(Verdict(NAME, "s with a warm cache", self.started.warm.median, WARM, False))
            found.append(Verdict(NAME, "s with an empty cache", self.started.empty.median, EMPTY, False))
        for series in self.series:
            for what, exponent in series.exponents().items():
                found.append(Verdict(f"scaling-{series.name}", f"exponent of {what}", exponent, EXPONENT, False))
        return found

    def missing(self) -> list[str]:
        """Peers that are not available, and why; each once."""
        return list(dict.fromkeys(why for result in self.results for _, why in result.missing))

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            "device": self.device,
            "machine": self.machine,
            "copy_bytes_s": self.peaks.copy,
            "fill_bytes_s": self.peaks.fill,
            "float32_flops": self.peaks.flops,
            "workloads": [each.stats() for each in self.results],
            "start_up": self.started and self.started.stats(),
            "scaling": [each.stats() for each in self.series],
            "bars": [each.stats() for each in self.verdicts()],
            "failed": list(self.failed),
        }
