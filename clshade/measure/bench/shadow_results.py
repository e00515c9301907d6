"""The results of `bench --shadows`, and their verdicts against the bars."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..timing import ratio_interval
from .results import Verdict
from .shadow_rays import ShadowWorkload

BUILD_MS, BYTES = 300.0, 64.0  # bars: ms for a million triangles, bytes a triangle
OCCLUSION = 0.5  # bar: times as fast as Embree, rays of ambient occlusion


@dataclass(frozen=True)
class Answers:
    """Rays of a light on which both disagree, and others, decided by `exact_shadows`.

    differ: rays on which both disagree. checked: those of them that were decided. ties: where a rounding decides.
    ours_wrong, theirs_wrong: proven. agreed: decided rays on which both agree, both_wrong: those that are wrong.
    """

    differ: int = 0
    checked: int = 0
    ties: int = 0
    ours_wrong: int = 0
    theirs_wrong: int = 0
    agreed: int = 0
    both_wrong: int = 0

    @property
    def wrong(self) -> int:
        """Rays that we answer wrongly, proven."""
        return self.ours_wrong + self.both_wrong


@dataclass(frozen=True)
class LightTimes:
    """Times of all rays to one light, traced in turns. light: its position; empty: rays of ambient occlusion. theirs_ms:
    empty where Embree is missing. many: rays of each receiver, to points of a light of finite size or around, or 1."""

    light: tuple[float, ...]
    rays: int
    dark: int
    ours_ms: tuple[float, ...]
    theirs_ms: tuple[float, ...]
    answers: Answers
    many: int = 1

    @property
    def ours_rate(self) -> float:
        """Million rays a second, of the fastest turn."""
        return self.rays / min(self.ours_ms) / 1e3

    @property
    def theirs_rate(self) -> float | None:
        return self.rays / min(self.theirs_ms) / 1e3 if self.theirs_ms else None

    @property
    def least_ratio(self) -> float | None:
        """Speedup over Embree, fastest turn against fastest turn."""
        return min(self.theirs_ms) / min(self.ours_ms) if self.theirs_ms else None

    @property
    def ratio(self) -> float | None:
        """Speedup over Embree, median against median."""
        return float(np.median(self.theirs_ms) / np.median(self.ours_ms)) if self.theirs_ms else None

    @property
    def interval(self) -> tuple[float, float] | None:
        """95 % interval of `ratio`."""
        return ratio_interval(self.theirs_ms, self.ours_ms) if self.theirs_ms else None


@dataclass(frozen=True)
class Built:
    """A hierarchy: what builds it, the ms of each build, and its bytes a triangle, None where these are not known."""

    title: str
    ms: tuple[float, ...]
    bytes: float | None


@dataclass(frozen=True)
class ShadowTimes:
    """One workload. theirs: None where Embree is missing, for the reason in `missing`. processors: of the process."""

    name: str
    triangles: int
    ours: Built
    theirs: Built | None
    lights: tuple[LightTimes, ...]
    processors: int | None
    missing: str = ""

    @property
    def passed(self) -> bool:
        """Whether none of our answers is proven wrong."""
        return not any(each.answers.wrong for each in self.lights)

    @property
    def numbered(self) -> list[tuple[str, LightTimes]]:
        """The lights and what to call them: a number, which those of finite size share with their centers, or AO."""
        numbers = np.cumsum([each.many == 1 for each in self.lights])
        names = [str(k) if each.light else "AO" for k, each in zip(numbers, self.lights, strict=True)]
        many = [f" x{each.many}" if each.many > 1 else "" for each in self.lights]
        return [(name + more, each) for name, more, each in zip(names, many, self.lights, strict=True)]

    def verdicts(self, workload: ShadowWorkload) -> list[Verdict]:
        found = [
            Verdict(
                self.name,
                f"times as fast as Embree, {f'light {name}' if each.light else name}",
                each.least_ratio,
                workload.at_least if each.light else OCCLUSION,
                True,
            )
            for name, each in self.numbered
        ]
        if self.triangles >= 10**6:
            found.append(Verdict(self.name, "ms to build", min(self.ours.ms), BUILD_MS, False))
        return [*found, Verdict(self.name, "bytes a triangle", self.ours.bytes, BYTES, False)]

    def stats(self) -> dict[str, Any]:
        """Return all measurements for JSON; `from_stats` reverses it."""
        return asdict(self)

    @classmethod
    def from_stats(cls, stats: dict[str, Any]) -> ShadowTimes:
        lights = tuple(
            LightTimes(**{**_tuples(each), "answers": Answers(**each["answers"])}) for each in stats["lights"]
        )
        ours, theirs = (stats[name] and Built(**_tuples(stats[name])) for name in ("ours", "theirs"))
        return cls(**{**stats, "ours": ours, "theirs": theirs, "lights": lights})


def _tuples(values: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
