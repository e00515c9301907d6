"""The report as one page of HTML."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image
from studies import small_study

from clshade.images import figures
from clshade.measure.report import figure, html_page, tables

HOSTILE = '<script>alert("x")</script>&$1$'


class Page(HTMLParser):
    """The tags of a page, the open ones at its end, and its text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="module")
def page(device, tmp_path_factory):
    found = small_study(device)
    found = replace(found, scene=replace(found.scene, name=HOSTILE))
    path = tmp_path_factory.mktemp("page") / "report.html"
    html_page.write(found, found.measured[0], figures.blank(1.0, 1.0), path)
    return found, path.read_text()


def test_it_loads_nothing(page):
    _, text = page
    parsed = Page(text)
    for tag, attributes in parsed.tags:
        assert tag not in ("script", "link", "iframe", "object", "embed")
        for name in ("src", "href", "xlink:href"):
            assert (attributes.get(name) or "#").startswith(("#", "data:image/png;base64,"))
        assert not any(name.startswith("on") for name in attributes)
    assert "url(http" not in text
    assert "default-src 'none'" in text


def test_names_are_escaped(page):
    _, text = page
    assert HOSTILE in Page(text).text
    assert "<script" not in text


def test_tables_and_pictures(page):
    found, text = page
    parsed = Page(text)
    for section in tables.sections(found):
        for part in (section.title, *section.header, *section.notes, *(cell for row in section.rows for cell in row)):
            assert part in parsed.text
    data = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    shown = [np.asarray(Image.open(io.BytesIO(base64.b64decode(each)))) for each in data]
    assert len(shown) == 1 + len(found.pictures)
    for each, expected in zip(shown, figure.colored(found).values(), strict=True):
        assert np.array_equal(each, expected)
    assert sum(tag == "details" for tag, _ in parsed.tags) == len(shown)
    assert tables.used_line(found.measured[0], found.scene) in parsed.text
