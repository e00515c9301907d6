"""What `grade` prints and writes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any
from xml.etree.ElementTree import Element

from ...base import text_tables
from ..markup import data_uri, element
from ..results import Column, Results, Table
from .folder import Row

Facts = dict[str, Any]  # of a submission, see `Grade.facts`; of one that cannot be graded: `image` and `error`
_FORMULAS = ("=", "+", "-", "@", "\t", "\r")  # what begins a formula in spreadsheets
_STYLE = """
.right { border-left: .4rem solid #4b9b4b } .wrong { border-left: .4rem solid #c0504d } section { padding-left: .8rem }
section img { max-width: 100% } td, tbody th { white-space: normal } td, thead th { text-align: left }
"""


def _verdict(facts: Facts) -> str:
    """Say in a sentence whether the image is right."""
    differ, edges = facts["pixels_that_differ"], facts["on_edges"]
    if not differ:
        return "right within 1/255"
    if facts["right"]:
        return (
            f"right within 1/255, but for {edges:,} of {facts['pixels']:,} pixels on edges of triangles, which another fill "
            "rule or rounding of corners decides"
        )
    on_edges = f" ({edges:,} of them on edges, where another fill rule may decide)" if edges else ""
    largest = round(255.0 * facts["largest_difference"])
    return f"not right: {differ:,} of {facts['pixels']:,} pixels differ{on_edges}, by up to {largest}/255"


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def lines(facts: Facts) -> list[str]:
    """Return what is printed on an image."""
    return [f"{facts['image']}: {_verdict(facts)}", *(text_tables.wrapped(text, 2) for text in _reasons(facts))]


def _reasons(facts: Facts) -> Iterator[str]:
    explanations = facts["explanations"]
    if not facts["right"] and not facts["explained"]:
        nearest = " What comes nearest:" if explanations else ""
        yield f"None of the modeled mistakes, nor two of them, explains it.{nearest}"
    for number, explanation in enumerate(explanations, 1):
        removed, fixed = _percent(explanation["difference_removed"]), _percent(explanation["pixels_made_right"])
        mistake = f"{number}. {explanation['mistake']}"
        yield f"{mistake}: removes {removed} of the difference, makes {fixed} of the wrong pixels right"
        if number == 1:
            yield f"   {explanation['advice']}"
            if explanation["same_image"]:
                yield f"   Cannot be told apart in this scene: {explanation['same_image']}"
    if facts["remark"]:
        yield f"Note: {facts['remark']}"


def short(facts: Facts) -> str:
    """Return the result in one line."""
    if "error" in facts:
        return f"not graded: {facts['error']}"
    texts = [_verdict(facts)]
    if not facts["right"] and not facts["explained"]:
        texts.append("no mistake explains it")
    if facts["mistake"]:
        nearest = "" if facts["explained"] else "nearest: "
        texts.append(f"{nearest}{facts['mistake']} (removes {_percent(facts['difference_removed'])})")
    return "; ".join([*texts, facts["remark"]] if facts["remark"] else texts)


def summary(submissions: Sequence[Facts]) -> list[str]:
    """Return a line for each submission of a folder, for the terminal, and a last one on all."""
    return [*(f"{facts['image']}: {short(facts)}" for facts in submissions), _counted(submissions)]


def _counted(submissions: Sequence[Facts]) -> str:
    graded = [facts for facts in submissions if "error" not in facts]
    right, explained = (sum(facts[name] for facts in graded) for name in ("right", "explained"))
    missed = f", {len(submissions) - len(graded)} not graded" if len(graded) < len(submissions) else ""
    count = f"{len(submissions)} submission{'s' * (len(submissions) != 1)}"
    return f"{count}: {right} right within 1/255, {len(graded) - right} not right ({explained} explained){missed}"


def _column(name: str) -> Column:
    """Return a column of a fact for programs."""
    return Column("", name, lambda facts: facts.get(name))


_FOUND = ("mistake", "difference_removed", "pixels_made_right", "same_image")
_COUNTS = ("right", "pixels", "pixels_that_differ", "on_edges", "largest_difference", "explained")
SUBMISSIONS = (
    Column("submission", "submission", lambda facts: facts["image"], str),
    Column("result", "", short, str),
    *map(_column, (*_COUNTS, *_FOUND, "remark", "error")),
)
EXPLANATIONS = tuple(map(_column, ("submission", *_FOUND, "advice")))


def results(submissions: Sequence[Facts], scene: str) -> Results:
    """Return the results for programs. scene: its name."""
    explanations = [
        {"submission": facts["image"], **found} for facts in submissions for found in facts.get("explanations", ())
    ]
    tables = (Table("Submissions", SUBMISSIONS, submissions), Table("Explanations", EXPLANATIONS, explanations))
    return Results(f"Submissions: {scene}", {"scene": scene, "result": _counted(submissions)}, tables)


def csv(submissions: Sequence[Facts]) -> str:
    """Return the submissions as CSV. Texts that a spreadsheet would take for formulas begin with an apostrophe."""

    def harmless(value: Any) -> Any:
        return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULAS) else value

    safe = [{name: harmless(value) for name, value in facts.items()} for facts in submissions]
    return Table("", SUBMISSIONS, safe).csv()


def page(rows: Sequence[Row], scene: str) -> bytes:
    """Return a page of HTML that fetches nothing: the results, and each submission with its picture. scene: its name."""
    submissions = [row.facts for row in rows]
    overview = Table("Results", SUBMISSIONS, submissions).html()
    above = replace(results(submissions, scene), tables=())
    return above.html(overview, [_section(row) for row in rows], style=_STYLE)


def _section(row: Row) -> Element:
    facts = row.facts
    text = [short(facts)] if "error" in facts else lines(facts)
    picture = element("img", src=data_uri("image/png", row.picture), alt=short(facts)) if row.picture else None
    paragraphs = [element("p", line) for line in text]
    return element(
        "section", element("h2", facts["image"]), paragraphs, picture, class_="right" if facts.get("right") else "wrong"
    )
