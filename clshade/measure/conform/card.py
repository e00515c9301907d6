"""The card of a device: JSON and Markdown."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...base.atomic_files import shown, write_bytes
from ...base.json_values import plain
from ...base.text_tables import as_markdown, digits
from .results import Judged, Result
from .tests_of_device import GROUPS

HEADER = ("group", "tests", "passed", "skipped", "failed", "seconds")


def line(group: str, part: str, results: Sequence[Result]) -> str:
    """Return what was found of a part of a group, in a line."""
    failed, skipped = (sum(bool(getattr(each, name)) for each in results) for name in ("problem", "skipped"))
    seconds = sum(each.seconds for each in results)
    words = [f"{len(results)} tests", f"{failed} failed" if failed else "", f"{skipped} skipped" if skipped else ""]
    return f"{group}{' ' * bool(part)}{part}: {', '.join(filter(None, words))}, {seconds:.1f} s"


def _counts(results: Sequence[Result]) -> list[str]:
    failed, skipped = (sum(bool(getattr(each, name)) for each in results) for name in ("problem", "skipped"))
    numbers = len(results), len(results) - failed - skipped, skipped, failed
    return [*map(str, numbers), digits(sum(each.seconds for each in results))]


def markdown(judged: Judged) -> str:
    """Return the card as Markdown."""
    info, results = judged.info, judged.results
    rows = []
    for group, about in GROUPS.items():
        mine = [each for each in results if each.group == group]
        if mine:
            rows.append((f"{group}: {about}", *_counts(mine)))
    lines = [
        f"# {info.platform}: {info.name}",
        "",
        f"Driver {info.driver}, {info.platform_version}; {_facts(judged)}.",
        "",
    ]
    lines += [*as_markdown(HEADER, rows), ""]
    reasons = sorted({each.skipped for each in results if each.skipped})
    lines += [*(f"- Skipped: {reason}." for reason in reasons), ""] if reasons else []
    if judged.failures:
        failures = [(f"{each.group}/{each.name}", each.title, each.problem, _script(each)) for each in judged.failures]
        lines += [*as_markdown(("failure", "what is tested", "found", "script"), failures), ""]
    if judged.failures and not any(each.group in ("operations", "constructs", "structs") for each in judged.failures):
        lines += ["No operation and no construct that was tested explains it.", ""]
    return "\n".join([*lines, f"{digits(judged.seconds)} s. The device {judged.verdict()}."]) + "\n"


def _script(result: Result) -> str:
    return f"`{result.script}`{'' if result.small else ', not made small'}" if result.script else "-"


def _facts(judged: Judged) -> str:
    return ", ".join(f"{name} {value}" for name, value in judged.facts.items()) or "it could not be opened"


def as_json(judged: Judged) -> dict[str, Any]:
    """Return the card for programs."""
    return {
        "device": {**asdict(judged.info), **judged.facts},
        "verdict": judged.verdict(),
        "seconds": judged.seconds,
        "tests": [vars(each) for each in judged.results],
    }


def write(judged: Judged, folder: Path) -> list[str]:
    """Write conform.json and conform.md; return their names. Raises OutputError."""
    text = json.dumps(plain(as_json(judged)), indent=1) + "\n"
    for name, content in (("conform.json", text), ("conform.md", markdown(judged))):
        write_bytes(folder / name, content.encode())
    return [shown(folder / name) for name in ("conform.json", "conform.md")]
