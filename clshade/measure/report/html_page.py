"""The report as one page of HTML: tables, the figure, and error images that open large; it loads nothing else."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from ...base import atomic_files
from ...base.text_tables import Row
from ...images import figures, png
from . import figure, tables
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
th:first-child, td:first-child { text-align: left } tbody tr:hover { background: #eef3fa }
ul { color: #444; font-size: .9rem } .use { background: #eef3fa; padding: .5rem .8rem }
.figure svg { width: 100%; height: auto }
.pictures { display: flex; flex-wrap: wrap; gap: .6rem }
details { width: 18rem } details[open] { width: 100% }
summary { list-style: none; cursor: zoom-in } details[open] summary { cursor: zoom-out }
summary::-webkit-details-marker { display: none }
details img { width: 100%; display: block; image-rendering: pixelated } details span { font-size: .9rem }
"""
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def write(study: Study, used: Measured | None, drawn: Figure, path: Path) -> None:
    """Write the page. used: the variant chosen for the budget or tolerance. drawn: the figure. Raises OutputError."""
    atomic_files.write_bytes(path, "\n".join(_page(study, used, drawn)).encode("utf-8", "replace"))


def _page(study: Study, used: Measured | None, drawn: Figure) -> Iterator[str]:
    title = escape(f"Error against run time: {study.title}")
    yield "<!DOCTYPE html>"
    yield f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
    yield f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield f"<style>{STYLE}</style></head><body><h1>{title}</h1>"
    facts = (f"<dt>{escape(line[:11].strip())}</dt><dd>{escape(line[11:])}</dd>" for line in tables.facts(study))
    yield f"<dl>{''.join(facts)}</dl>"
    if used is not None:
        yield f'<p class="use">{escape(tables.used_line(used, study.scene))}</p>'
    vectors = figures.as_vectors(drawn, "svg").decode()
    yield f'<div class="figure">{vectors[vectors.index("<svg") :]}</div>'
    yield "<h2>Images</h2><p>Click to enlarge. Differences are drawn on a logarithmic scale: black is "
    yield f"{figure.LEAST:g} or less, the brightest color {figure.MOST:g} or more, where display white is 1.</p>"
    yield '<div class="pictures">'
    for name, picture in figure.colored(study).items():
        file = io.BytesIO()
        png.encode(file, picture)
        data = base64.b64encode(file.getvalue()).decode()
        yield f'<details><summary><img alt="" src="data:image/png;base64,{data}"><span>{escape(name)}</span></summary>'
        yield "</details>"
    yield "</div>"
    for section in tables.sections(study):
        yield from _section(section)
    yield "</body></html>\n"


def _section(section: tables.Section) -> Iterator[str]:
    yield f"<h2>{escape(section.title)}</h2>"
    if section.about:
        yield f"<p>{escape(section.about)}.</p>"
    yield f'<div class="wide"><table><thead>{_row(section.header, "th")}</thead><tbody>'
    yield from (_row(row, "td") for row in section.rows)
    yield "</tbody></table></div>"
    if section.notes:
        yield f"<ul>{''.join(f'<li>{escape(note)}</li>' for note in section.notes)}</ul>"


def _row(cells: Row, tag: str) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"
