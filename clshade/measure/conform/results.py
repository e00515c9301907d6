"""What was found of a device."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ...pipeline.opencl.probe import DeviceInfo


@dataclass
class Result:
    """Result of a test. problem: what is wrong, "" if nothing. skipped: why it was not taken. script: file that shows it.
    small: whether that was made small."""

    group: str
    name: str
    title: str = ""
    problem: str = ""
    skipped: str = ""
    seconds: float = 0.0
    script: str = ""
    small: bool = False


@dataclass
class Judged:
    """What was found of a device. facts: its version and lanes, as a process that opened it said. seconds: in all."""

    info: DeviceInfo
    results: list[Result] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def failures(self) -> list[Result]:
        return [result for result in self.results if result.problem]

    def verdict(self) -> str:
        """Return the last line."""
        if not self.failures:
            return "conforms"
        names = [f"{result.group}/{result.name}" for result in self.failures]
        more = f" and {len(names) - 5} more" if len(names) > 5 else ""
        return f"does not conform: {', '.join(names[:5])}{more}"
