"""The report as one page of HTML: tables, the figure, and error images that open large; it loads nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element

from ...base import atomic_files
from ...base.arrays import Bytes
from ...base.markup import Content, data_uri, element, page, table
from ...images import figures, png
from . import figure, tables
from .answer import Command, criterion
from .measure import Measured
from .study import Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
ul { color: #444; font-size: .9rem } .use { background: #eef3fa; padding: .5rem .8rem }
.figure { width: 100%; height: auto }
.pictures { display: flex; flex-wrap: wrap; gap: .6rem }
details { width: 18rem } details[open] { width: 100% }
summary { list-style: none; cursor: zoom-in } details[open] summary { cursor: zoom-out }
summary::-webkit-details-marker { display: none }
details img { width: 100%; display: block; image-rendering: pixelated } details span { font-size: .9rem }
"""
ABOUT = "Error against time, and error images"
SCALE = (
    f"Click to enlarge. Differences are drawn on a logarithmic scale: black is {figure.LEAST:g} or less, the brightest "
    f"color {figure.MOST:g} or more, where display white is 1."
)


def write(study: Study, used: Measured | None, command: Command, drawn: Figure, path: Path) -> None:
    """Write the page. used: the variant chosen for the budget or tolerance. command: returns the command that draws
    settings. drawn: the figure. Raises OutputError."""
    title = f"Error against run time: {study.title}"
    body = element(
        "body",
        element("h1", title),
        element("div", table(tables.ANSWER, tables.answer_rows(study, command)), class_="wide"),
        element("p", criterion(study)),
        element("dl", [(element("dt", name), element("dd", value)) for name, value in tables.facts(study).items()]),
        element("p", tables.used_line(used, command), class_="use") if used is not None else None,
        element("img", class_="figure", src=data_uri("image/svg+xml", figures.as_vectors(drawn, "svg")), alt=ABOUT),
        element("h2", "Images"),
        element("p", SCALE),
        element("div", [_picture(*each) for each in figure.colored(study).items()], class_="pictures"),
        [_section(each) for each in tables.sections(study)],
    )
    atomic_files.write_bytes(path, page(title, STYLE, body))


def _picture(name: str, picture: Bytes) -> Element:
    image = element("img", src=png.as_uri(picture), alt=name)
    return element("details", element("summary", image, element("span", name)))


def _section(section: tables.Section) -> Content:
    return (
        element("h2", section.title),
        element("p", f"{section.about}.") if section.about else None,
        element("div", table(section.header, section.rows), class_="wide"),
        element("ul", [element("li", note) for note in section.notes]) if section.notes else None,
    )
