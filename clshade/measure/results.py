"""Results of a command: one list of columns gives a table for the terminal, CSV, JSON, Markdown and HTML."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from ..base import atomic_files, text_tables
from ..base.atomic_files import shown
from ..base.json_values import plain
from ..base.text_tables import digits
from . import markup
from .markup import element

EXTENSIONS = ("csv", "json", "md")
STYLE = """
:root { color-scheme: light }
body { font: 15px/1.45 system-ui, sans-serif; color: #222; background: #fff; max-width: 76rem; margin: 2rem auto;
  padding: 0 1rem }
h1 { font-size: 1.5rem } h2 { font-size: 1.15rem; margin-top: 2.2rem }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1rem } dt { color: #666 } dd { margin: 0 }
.wide { overflow-x: auto }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .85rem }
th, td { padding: .15rem .6rem; text-align: right; white-space: nowrap; border-bottom: 1px solid #ddd }
th:first-child { text-align: left } tbody th { font-weight: normal } tbody tr:hover { background: #eef3fa }
ul { color: #444; font-size: .9rem }
"""  # of the pages that show results


class Column(NamedTuple):
    """A column of a table.

    title: for people, "" to show it to programs alone. name: for programs, "" to show it to people alone. value: of a
    record. show: a value as people read it.
    """

    title: str
    name: str
    value: Callable[[Any], Any]
    show: Callable[[Any], str] = digits


def as_markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table; vertical bars in texts are escaped."""
    body = (f"| {' | '.join(text.replace('|', chr(92) + '|') for text in row)} |" for row in (header, *rows))
    first, *others = body
    return [first, "| --- " * len(header) + "|", *others]


@dataclass(frozen=True, eq=False)
class Table:
    """Records under columns. about: a sentence above; notes: sentences below; left: columns aligned to the left."""

    title: str
    columns: Sequence[Column]
    records: Sequence[Any]
    about: str = ""
    notes: Sequence[str] = ()
    left: int = 1

    @property
    def header(self) -> list[str]:
        return [column.title for column in self.columns if column.title]

    def rows(self) -> list[list[str]]:
        """Return the cells as people read them."""
        visible = [column for column in self.columns if column.title]
        return [[column.show(column.value(record)) for column in visible] for record in self.records]

    def plain(self) -> list[dict[str, Any]]:
        """Return the records for JSON, in full precision."""
        columns = [column for column in self.columns if column.name]
        return [{column.name: plain(column.value(record)) for column in columns} for record in self.records]

    def csv(self) -> str:
        names = [column.name for column in self.columns if column.name]
        cells = (["" if value is None else str(value) for value in record.values()] for record in self.plain())
        return text_tables.as_csv(names, cells)

    def lines(self) -> list[str]:
        """Return the table for the terminal, its title and sentences around it."""
        above = [text_tables.wrapped(self.about)] if self.about else []
        body = text_tables.as_lines(self.header, self.rows(), self.left)
        return ["", self.title, *above, *body, *(text_tables.wrapped(note, 2) for note in self.notes)]

    def markdown(self) -> list[str]:
        above = ["", self.about] if self.about else []
        below = ["", *(f"- {note}" for note in self.notes)] if self.notes else []
        return ["", f"## {self.title}", *above, "", *as_markdown(self.header, self.rows()), *below]

    def html(self) -> markup.Content:
        return (
            element("h2", self.title),
            element("p", self.about) if self.about else None,
            element("div", markup.table(self.header, self.rows()), class_="wide"),
            element("ul", [element("li", note) for note in self.notes]) if self.notes else None,
        )


@dataclass(frozen=True, eq=False)
class Results:
    """What a command measured: facts by name, and tables, of which people see those with records; the first of these goes
    into the CSV. data: further values for JSON."""

    title: str
    facts: dict[str, Any]
    tables: Sequence[Table]
    data: dict[str, Any] = field(default_factory=dict)

    @property
    def shown_tables(self) -> list[Table]:
        return [table for table in self.tables if table.records]

    def lines(self) -> list[str]:
        """Return facts and tables for the terminal."""
        width = max(map(len, self.facts), default=0) + 2
        facts = (text_tables.wrapped(f"{name:<{width}}{value}", width) for name, value in self.facts.items())
        return [*facts, *(line for table in self.shown_tables for line in table.lines())]

    def markdown(self) -> str:
        facts = (f"- {name}: {value}" for name, value in self.facts.items())
        tables = (line for table in self.shown_tables for line in table.markdown())
        return "\n".join([f"# {self.title}", "", *facts, *tables, ""])

    def json(self) -> str:
        tables = {table.title.lower().replace(" ", "_"): table.plain() for table in self.tables}
        return json.dumps({**plain({**self.facts, **self.data}), **tables}, indent=2) + "\n"

    def html(self, *content: markup.Content, style: str = "") -> bytes:
        """Return a page of facts, `content` and tables. style: CSS besides STYLE."""
        facts = element("dl", [(element("dt", name), element("dd", str(value))) for name, value in self.facts.items()])
        tables = [table.html() for table in self.shown_tables]
        body = element("body", element("h1", self.title), facts, content, tables)
        return markup.page(self.title, STYLE + style, body)

    def write(self, prefix: str | Path) -> list[Path]:
        """Write PREFIX.csv, .json and .md; return their paths. Raises OutputError."""
        first = next(iter(self.shown_tables), self.tables[0])
        texts = first.csv(), self.json(), self.markdown()
        paths = files(prefix)
        for path, text in zip(paths, texts, strict=True):
            atomic_files.write_bytes(path, text.encode())
        return paths


def files(prefix: str | Path, *others: str) -> list[Path]:
    """Return the files of a prefix: those of `Results.write`, and with the other extensions."""
    return [Path(f"{prefix}.{extension}") for extension in (*EXTENSIONS, *others)]


def check_files(paths: Iterable[Path]) -> None:
    """Raise the OutputError that writing would, before minutes of measuring."""
    for path in paths:
        atomic_files.check(path)


def wrote(paths: Iterable[Path]) -> list[str]:
    """Return a line for each file that was written."""
    return [f"wrote {shown(path)}" for path in paths]
