"""What `grade` prints, and its CSV."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ...base import text_tables
from ...base.atomic_files import shown
from ...base.text_tables import digits
from .folder import Row

Facts = dict[str, Any]
HEADER = (
    *("submission", "right", "pixels", "pixels differ", "on edges"),
    *("mistake", "nearest", "removes", "makes right", "same image", "remark"),
)
_FORMULAS = ("=", "+", "-", "@", "\t", "\r")  # what begins a formula in spreadsheets


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


def percent(share: float) -> str:
    """Return a share in percent, with two significant digits or more."""
    return f"{100.0 * share:.0f} %" if abs(share) >= 0.1 else f"{digits(100.0 * share, 2)} %"


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
    yield from (f"Note: {each}" for each in facts["remarks"])


def counted(found: Sequence[Row | str]) -> str:
    """Say in a sentence how many submissions are right."""
    graded = [each.facts for each in found if not isinstance(each, str)]
    right, explained = sum(each["right"] for each in graded), sum(each["explained"] for each in graded)
    missed = f", {len(found) - len(graded)} not graded" if len(graded) < len(found) else ""
    wrong = f"{len(graded) - right} not right ({explained} explained)"
    return f"{len(found)} submission{'s' * (len(found) != 1)}: {right} right within 1/255, {wrong}{missed}"


def summary(names: Sequence[str], found: Sequence[Row | str]) -> list[str]:
    """Return a line for each submission of a folder, for the terminal, and a last one on all."""
    each_line = [f"{shown(name)}: {short(each)}" for name, each in zip(names, found, strict=True)]
    return [*each_line, counted(found)]


def short(found: Row | str) -> str:
    """Return the result in one line."""
    if isinstance(found, str):
        return f"not graded: {found}"
    facts = found.facts
    remarks = "".join(f"; {each}" for each in facts["remarks"])
    if facts["right"]:
        on_edges = f", but for {facts['of_these_on_edges']:,} pixels on edges" if facts["of_these_on_edges"] else ""
        return f"right{on_edges}{remarks}"
    count = facts["pixels_that_differ"]
    start = "not right, 1 pixel differs" if count == 1 else f"not right, {count:,} pixels differ"
    if not facts["explanations"]:
        return f"{start}; no mistake explains it{remarks}"
    first = facts["explanations"][0]
    removes = f"(removes {percent(first['difference_removed'])})"
    claim = "" if facts["explained"] else "no mistake explains it, nearest: "
    return f"{start}; {claim}{named(first)} {removes}{remarks}"


def csv(names: Sequence[str], found: Sequence[Row | str]) -> str:
    """Return the table as CSV. Texts that a spreadsheet would take for formulas begin with an apostrophe."""
    return text_tables.as_csv(HEADER, [[_harmless(cell) for cell in row] for row in rows(names, found)])


def _harmless(cell: str) -> str:
    return f"'{cell}" if cell.startswith(_FORMULAS) else cell


def rows(names: Sequence[str], found: Sequence[Row | str]) -> list[tuple[str, ...]]:
    """Return a row of HEADER for each submission: removes and makes right are shares."""
    return [_row(shown(name), each) for name, each in zip(names, found, strict=True)]


def _row(name: str, found: Row | str) -> tuple[str, ...]:
    if isinstance(found, str):
        return name, *[""] * (len(HEADER) - 2), found
    facts = found.facts
    counts = (str(facts[key]) for key in ("pixels", "pixels_that_differ", "of_these_on_edges"))
    start = name, "yes" if facts["right"] else "no", *counts
    remarks = "; ".join(facts["remarks"])
    if not facts["explanations"]:
        return *start, "", "", "", "", "", remarks
    first = facts["explanations"][0]
    either = (named(first), "") if facts["explained"] else ("", named(first))
    shares = (f"{first[key]:.4f}" for key in ("difference_removed", "pixels_made_right"))
    return *start, *either, *shares, same(first), remarks
