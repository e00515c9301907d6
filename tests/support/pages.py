"""HTML pages as browsers read them, for tests."""

import base64
import io
from dataclasses import dataclass, field
from html.parser import HTMLParser

import numpy as np
from PIL import Image

VOID = {"meta", "img", "input", "br", "hr", "link"}


@dataclass
class Node:
    """An element with its text, that of inner elements included."""

    tag: str
    attributes: dict[str, str]
    inside: list["Node"] = field(default_factory=list)
    text: str = ""

    def all(self, tag: str = "") -> list["Node"]:
        """Return the elements within, of one tag or of all, in the order of the page."""
        elements = [element for node in self.inside for element in (node, *node.all())]
        return [element for element in elements if not tag or element.tag == tag]


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open = [Node("", {})]

    def handle_starttag(self, tag, attributes):
        node = Node(tag, {name: value or "" for name, value in attributes})
        self.open[-1].inside.append(node)
        if tag not in VOID:
            self.open.append(node)

    def handle_endtag(self, tag):
        assert self.open[-1].tag == tag, f"</{tag}> ends <{self.open[-1].tag}>"
        self.open.pop()

    def handle_data(self, data):
        for node in self.open:
            node.text += data


def parsed(page: bytes) -> Node:
    """Return the root of a page; every element but void ones must be closed."""
    reader = _Reader()
    reader.feed(page.decode("utf-8"))
    reader.close()
    assert len(reader.open) == 1
    return reader.open[0]


def picture(image: Node) -> np.ndarray:
    """Return the pixels of an <img> that holds a PNG."""
    head, _, data = image.attributes["src"].partition(",")
    assert head == "data:image/png;base64"
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))
