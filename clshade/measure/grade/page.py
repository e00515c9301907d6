"""A folder of submissions as one page of HTML that fetches nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

from ...base import atomic_files
from ...base.atomic_files import shown
from ...base.markup import element, page, table
from ...images import png
from ..results import STYLE
from . import tables
from .folder import Row
from .pictures import Shot

_STYLE = (
    STYLE
    + """
.right { border-left: .4rem solid #4b9b4b } .wrong { border-left: .4rem solid #c0504d } section { padding-left: .8rem }
section img { width: 12rem; image-rendering: pixelated } figure { display: inline-block; margin: .3rem }
figcaption { font-size: .8rem; color: #444 } td, tbody th { white-space: normal }
td, thead th { text-align: left }
"""
)


def write(names: Sequence[str], found: Sequence[Row | str], scene: str, path: str | Path) -> None:
    """Write the page. scene: its name. Raises OutputError."""
    rows = [(shown(name), tables.short(each)) for name, each in zip(names, found, strict=True)]
    body = element(
        "body",
        element("h1", f"Submissions: {scene}"),
        element("p", tables.counted(found)),
        element("div", table(("submission", "result"), rows), class_="wide"),
        [_section(shown(name), each) for name, each in zip(names, found, strict=True)],
    )
    atomic_files.write_bytes(path, page("Submissions", _STYLE, body))


def _section(name: str, found: Row | str) -> Element:
    title = element("h2", name)
    if isinstance(found, str):
        return element("section", title, element("p", f"not graded: {found}"), class_="wrong")
    text = [element("p", line) for line in tables.lines(found.facts)]
    shots = [_picture(each) for each in found.pictures]
    return element("section", title, text, shots, class_="right" if found.facts["right"] else "wrong")


def _picture(shot: Shot) -> Element:
    image = element("img", src=png.as_uri(shot.pixels), alt=shot.caption)
    return element("figure", image, element("figcaption", shot.caption))
