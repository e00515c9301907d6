"""HTML pages as trees of elements: texts and attributes are escaped where they are written, so no name becomes markup."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from typing import TypeAlias
from xml.etree.ElementTree import Element, tostring

from ..base.console import printable

Content: TypeAlias = "Element | str | Iterable[Content] | None"

# Nothing is fetched and no script runs, whatever the page holds.
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


def element(tag: str, *content: Content, **attributes: str) -> Element:
    """Return an element. content: elements, texts, nested lists of them; None is left out.

    attributes: by name; `class_` is `class`, and `_` within a name is `-`. Characters that no text should hold, such as
    control characters, are written as escapes, see `printable`.
    """
    made = Element(tag, {name.rstrip("_").replace("_", "-"): printable(text) for name, text in attributes.items()})
    _append(made, content)
    return made


def _append(parent: Element, content: Iterable[Content]) -> None:
    for each in content:
        if each is None:
            continue
        if isinstance(each, Element):
            parent.append(each)
        elif not isinstance(each, str):
            _append(parent, each)
        elif len(parent):
            parent[-1].tail = (parent[-1].tail or "") + printable(each)
        else:
            parent.text = (parent.text or "") + printable(each)


def data_uri(kind: str, data: bytes) -> str:
    """Return a file as a URI that holds it. kind: its media type."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def table(header: Iterable[Content], rows: Iterable[Iterable[Content]], **attributes: str) -> Element:
    """Return a table; the first cell of each row is its header."""

    def row(cells: Iterable[Content]) -> Element:
        first, *others = cells
        return element("tr", element("th", first, scope="row"), [element("td", each) for each in others])

    head = element("tr", [element("th", each, scope="col") for each in header])
    return element("table", element("thead", head), element("tbody", [row(cells) for cells in rows]), **attributes)


def page(title: str, style: str, body: Element) -> bytes:
    """Return a whole page that refers to nothing outside itself, UTF-8. style: CSS."""
    root = element(
        "html",
        element(
            "head",
            element("meta", charset="utf-8"),
            element("meta", http_equiv="Content-Security-Policy", content=POLICY),
            element("meta", name="viewport", content="width=device-width, initial-scale=1"),
            element("title", title),
            element("style", style),
        ),
        body,
        lang="en",
    )
    text: bytes = tostring(root, encoding="utf-8", method="html")
    return b"<!DOCTYPE html>\n" + text + b"\n"
