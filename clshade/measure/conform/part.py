"""A part of a group of tests in processes that a device may take along."""

from __future__ import annotations

import json
import time
from dataclasses import replace

from ..child_process import Child, ending
from .child import Task
from .results import Judged, Result

SHRINKING = 60.0  # seconds that making a failure smaller may take
WHOLE = 600.0  # seconds that all processes of a part may take
MOST_ENDED = 3  # processes of a part that end early; then the rest is not tried
_REST = "is given up: its processes end early, or take too long"
EVENTS = {"planned", "device", "begin", "script", "end", "shrink", "shrunk"}


class Part:
    """A part of a group, in as many processes as the device takes along."""

    def __init__(self, task: Task, judged: Judged, limit: float) -> None:
        self.task, self.judged, self.limit = task, judged, limit
        self.results: dict[str, Result] = {}
        self.current, self.ended = "", 0
        self.planned: list[str] | None = None
        self._end = time.monotonic() + WHOLE

    @property
    def where(self) -> str:
        return f"{self.task.group} {self.task.part}".rstrip()

    @property
    def missing(self) -> list[str]:
        """The tests that were to be run and have not begun."""
        return [name for name in self.planned or () if name not in self.results]

    def run(self) -> list[Result]:
        while True:
            problem = self._process()
            if not problem:
                return list(self.results.values())
            name = self.current
            if not name:  # before a test, or while a failure was made smaller
                if self.missing or self.planned is None:
                    title = f"tests not run: {', '.join(self.missing)}" if self.missing else "the device opens"
                    self.results["open"] = Result(self.task.group, "open", title, problem)
                return list(self.results.values())
            self.results[name].problem = problem
            self.task = replace(self.task, done=(*self.results,))
            self.ended += 1
            if self.ended == MOST_ENDED or time.monotonic() > self._end:
                self.results["rest"] = Result(
                    self.task.group, "rest", "the other tests", skipped=f"{self.where} {_REST}"
                )
                return list(self.results.values())

    def _process(self) -> str:
        """Run a process to its end; return what ended it early."""
        child, self.current, limit = Child(self.task.command()), "", self.limit
        end = min(time.monotonic() + limit, self._end)
        try:
            while True:
                line = child.line(end)
                if not line:
                    code, said = child.code(end), child.said()
                    if not (code or self.current or self.missing or self.planned is None):
                        return ""
                    return f"ends the process: {ending(code)}" + (f": {said}" if said else "")
                more = self._heard(line)
                if more:
                    limit, end = more, min(time.monotonic() + more, self._end)
        except TimeoutError:
            return f"does not end within {WHOLE if time.monotonic() > self._end else limit:g} s"
        finally:
            child.close()

    def _heard(self, line: bytes) -> float:
        """Take an event; return the seconds until the next one, 0 for a runtime's own output."""
        try:
            event = json.loads(line)
        except ValueError:
            return 0.0
        if not (isinstance(event, dict) and EVENTS & event.keys()):
            return 0.0
        if "planned" in event:
            self.planned = event["planned"]
        elif "device" in event:
            self.judged.facts = event["device"]
        elif "begin" in event:
            self.current = event["begin"]
            self.results[self.current] = Result(self.task.group, self.current, event["title"])
        elif "script" in event:
            self.results[self.current].script = event["script"]
        elif "end" in event:
            ended = self.results[event.pop("end")]
            vars(ended).update(event, script=ended.script if event.get("problem") else "")
            self.current = ""
        elif "shrunk" in event:
            vars(self.results[event["shrunk"]]).update(problem=event["problem"], small=True)
        return SHRINKING if "shrink" in event else self.limit
