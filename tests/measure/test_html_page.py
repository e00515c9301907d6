"""The report as one page of HTML."""

from __future__ import annotations

import base64
from dataclasses import replace

import numpy as np
import pytest
from pages import parsed, picture
from studies import small_study

from clshade.images import figures
from clshade.measure.report import figure, html_page, tables

HOSTILE = '<script>alert("x")</script>&$1$\x1b[31m\u202e'


def draw_command(settings) -> str:
    return f"draw <{settings.samples}>"


@pytest.fixture(scope="module")
def page(device, tmp_path_factory):
    found = small_study(device)
    found = replace(found, scene=replace(found.scene, name=HOSTILE))
    path = tmp_path_factory.mktemp("page") / "report.html"
    html_page.write(found, found.measured[0], draw_command, figures.blank(1.0, 1.0), path)
    return found, parsed(path.read_bytes())


def test_it_loads_nothing(page):
    _, tree = page
    for node in tree.all():
        assert node.tag not in ("script", "link", "iframe", "object", "embed")
        for name in ("src", "href"):
            assert node.attributes.get(name, "#").startswith(
                ("#", "data:image/png;base64,", "data:image/svg+xml;base64,")
            )
        assert not any(name.startswith("on") for name in node.attributes)
    (style,) = tree.all("style")
    assert "url(" not in style.text
    policies = [node.attributes.get("content", "") for node in tree.all("meta")]
    assert any("default-src 'none'" in policy for policy in policies)


def test_names_are_escaped(page):
    _, tree = page
    for text in (tree.all("title")[0].text, tree.all("h1")[0].text, tree.all("dd")[0].text):
        assert "<script>alert(" in text
        assert not {"\x1b", "\u202e"} & set(text)


def test_tables_and_pictures(page):
    found, tree = page
    texts = {node.text for node in tree.all()}
    for section in tables.sections(found):
        for part in (section.title, *section.header, *section.notes, *(cell for row in section.rows for cell in row)):
            assert part in texts
    answered, *others = tree.all("table")
    for name, _, command in tables.answer_rows(found, draw_command):
        assert {name, command} <= {cell.text for row in answered.all("tr") for cell in row.inside}
    for table, section in zip(others, tables.sections(found), strict=True):
        rows = [[cell.text for cell in row.inside] for row in table.all("tr")]
        assert rows == [[*section.header], *(list(row) for row in section.rows)]
    drawn, *shown = tree.all("img")
    for image, (name, expected) in zip(shown, figure.colored(found).items(), strict=True):
        assert np.array_equal(picture(image), expected)
        assert image.attributes["alt"] == name
    assert len(tree.all("details")) == len(shown)
    vectors = base64.b64decode(drawn.attributes["src"].partition(",")[2])
    assert vectors == figures.as_vectors(figures.blank(1.0, 1.0), "svg")
    assert tables.used_line(found.measured[0], draw_command) in texts
