"""What `grade` prints, and its CSV."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ...base import text_tables
from ...base.atomic_files import shown
from .grade import Row

Facts = dict[str, Any]
HEADER = ("submission", "right", "differ", "mistake", "removes", "same image", "error")


def percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def share(facts: Facts) -> float:
    """Return the share of pixels that differ."""
    return float(facts["pixels_that_differ"] / facts["pixels"])


def verdict(facts: Facts) -> str:
    """Say in a sentence whether the image is right."""
    differ, edges = facts["pixels_that_differ"], facts["of_these_on_edges"]
    if not differ:
        return "right within 1/255"
    if facts["right"]:
        return (
            f"right within 1/255, but for {edges:,} of {facts['pixels']:,} pixels on edges of triangles, which another fill "
            "rule or rounding of corners decides"
        )
    on_edges = f" ({edges:,} of them on edges, where another fill rule may decide)" if edges else ""
    most = round(255.0 * facts["largest_difference"])
    return f"not right: {differ:,} of {facts['pixels']:,} pixels differ{on_edges}, by up to {most}/255"


def named(found: Facts) -> str:
    return " + ".join(found["mistakes"])


def same(found: Facts) -> str:
    """Name what cannot be told from an explanation."""
    return "; ".join(" + ".join(labels) for labels in found["same_image"])


def lines(facts: Facts) -> list[str]:
    """Return what is printed on an image."""
    return [f"{facts['image']}: {verdict(facts)}", *(text_tables.wrapped(each, 2) for each in _reasons(facts))]


def _reasons(facts: Facts) -> Iterator[str]:
    if not facts["right"] and not facts["explained"]:
        nearest = " What comes nearest:" if facts["explanations"] else ""
        yield f"None of the modeled mistakes, nor two of them, explains it.{nearest}"
    for number, found in enumerate(facts["explanations"], 1):
        removed, fixed = percent(found["difference_removed"]), percent(found["pixels_made_right"])
        yield f"{number}. {named(found)}: removes {removed} of the difference, makes {fixed} of the wrong pixels right"
        if number == 1:
            yield from (f"   {advice}" for advice in found["advice"])
            if found["same_image"]:
                yield f"   Cannot be told apart in this scene: {same(found)}"


def summary(names: Sequence[str], found: Sequence[Row | str]) -> list[str]:
    """Return a table of a folder for the terminal."""
    return text_tables.as_lines(HEADER[:5], [row[:4] + (row[4] or row[6][:40],) for row in rows(names, found)], 4)


def csv(names: Sequence[str], found: Sequence[Row | str]) -> str:
    return text_tables.as_csv(HEADER, rows(names, found))


def rows(names: Sequence[str], found: Sequence[Row | str]) -> list[tuple[str, ...]]:
    """Return a row of HEADER for each submission."""
    return [_row(shown(name), each) for name, each in zip(names, found, strict=True)]


def _row(name: str, found: Row | str) -> tuple[str, ...]:
    if isinstance(found, str):
        return name, "", "", "", "", "", found
    facts = found.facts
    start = name, "yes" if facts["right"] else "no", percent(share(facts))
    if facts["right"]:
        return *start, "", "", "", ""
    if not facts["explained"]:
        return *start, "none explains it", "", "", ""
    first = facts["explanations"][0]
    return *start, named(first), percent(first["difference_removed"]), same(first), ""
