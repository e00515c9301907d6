"""A folder of submissions as one page of HTML that fetches nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ...base import atomic_files
from ...base.arrays import Bytes
from ...base.atomic_files import shown
from ...base.markup import Content, element, page, table
from ...images import png
from ..report.html_page import STYLE
from . import pictures, tables
from .grade import Right, Row

_SIDE = 240  # most pixels of a picture along its longer side
_STYLE = (
    STYLE
    + """
.right { border-left: .4rem solid #4b9b4b } .wrong { border-left: .4rem solid #c0504d } section { padding-left: .8rem }
section img { width: 12rem; image-rendering: pixelated } figure { display: inline-block; margin: .3rem }
figcaption { font-size: .8rem; color: #444 } td, tbody th { white-space: normal }
"""
)


def write(names: Sequence[str], found: Sequence[Row | str], right: Right, path: str | Path) -> None:
    """Write the page. Raises OutputError."""
    expected = np.uint8(right.codes)
    count = sum(not isinstance(each, str) and each.facts["right"] for each in found)
    body = element(
        "body",
        element("h1", f"Submissions: {right.drawing.scene.name}"),
        element("p", f"{count} of {len(found)} are right within 1/255."),
        element("div", table(tables.HEADER, tables.rows(names, found)), class_="wide"),
        [_section(shown(name), each, expected) for name, each in zip(names, found, strict=True)],
    )
    atomic_files.write_bytes(path, page("Submissions", _STYLE, body))


def _section(name: str, found: Row | str, expected: Bytes) -> Element:
    title = element("h2", name)
    if isinstance(found, str):
        return element("section", title, element("p", found), class_="wrong")
    facts = found.facts
    shots = [_picture("submission", found.image), _picture("right", expected)]
    if facts["pixels_that_differ"]:
        shots.append(_picture("difference", pictures.difference(found.image, expected)))
    if found.explained is not None:
        shots.append(_picture("right one with the mistake", found.explained))
        shots.append(_picture("difference that is left", pictures.difference(found.image, found.explained)))
    text: Content = [element("p", line) for line in tables.lines(facts)]
    return element("section", title, text, shots, class_="right" if facts["right"] else "wrong")


def _picture(caption: str, image: Bytes) -> Element:
    step = -(-max(image.shape[:2]) // _SIDE)
    small = np.ascontiguousarray(image[::step, ::step])
    return element("figure", element("img", src=png.as_uri(small), alt=caption), element("figcaption", caption))
