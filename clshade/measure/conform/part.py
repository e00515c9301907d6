"""A part of a group of tests in processes that a device may take along."""

from __future__ import annotations

import json
import time
from dataclasses import replace

from ..child_process import Child, ending
from .child import Task
from .results import Judged, Result

SHRINKING = 60.0  # seconds that making a failure smaller may take
MOST_ENDED = 3  # processes of a part that end early; then the rest is not tried
_REST = f"is given up after {MOST_ENDED} tests that ended their process"


class Part:
    """A part of a group, in as many processes as the device takes along."""

    def __init__(self, task: Task, judged: Judged, limit: float) -> None:
        self.task, self.judged, self.limit = task, judged, limit
        self.results: dict[str, Result] = {}
        self.current, self.ended = "", 0

    @property
    def where(self) -> str:
        return f"{self.task.group} {self.task.part}".rstrip()

    def run(self) -> list[Result]:
        while True:
            problem = self._process()
            if not problem:
                return list(self.results.values())
            name = self.current
            if not name:  # before its first test, or while a failure was made smaller
                if not self.results:
                    self.results["open"] = Result(self.task.group, "open", "the device opens", problem)
                return list(self.results.values())
            self.results[name].problem = problem
            self.task = replace(self.task, done=(*self.results,))
            self.ended += 1
            if self.ended == MOST_ENDED:
                self.results["rest"] = Result(
                    self.task.group, "rest", "the other tests", skipped=f"{self.where} {_REST}"
                )
                return list(self.results.values())

    def _process(self) -> str:
        """Run a process to its end; return what ended it early."""
        child, self.current, limit = Child(self.task.command()), "", self.limit
        try:
            while True:
                end = time.monotonic() + limit
                line = child.line(end)
                if not line:
                    code = child.code(end)
                    said = child.said()
                    return f"ends the process: {ending(code)}" + (f": {said}" if said else "") if code else ""
                limit = self._heard(line)
        except TimeoutError:
            return f"does not end within {limit:g} s"
        finally:
            child.close()

    def _heard(self, line: bytes) -> float:
        """Take an event; return the seconds until the next one."""
        try:
            event = json.loads(line)
            assert isinstance(event, dict)
        except (ValueError, AssertionError):  # a runtime's own output
            return self.limit
        if "device" in event:
            self.judged.facts = event["device"]
        elif "begin" in event:
            self.current = event["begin"]
            self.results[self.current] = Result(self.task.group, self.current, event["title"])
        elif "end" in event:
            vars(self.results[event.pop("end")]).update(event)
            self.current = ""
        elif "shrunk" in event:
            self.results[event["shrunk"]].problem = event["problem"]
        return SHRINKING if "shrink" in event else self.limit
