"""HTML by elements: nothing that is written as text becomes markup."""

from __future__ import annotations

import pytest
from pages import parsed

from clshade.measure.markup import element, page, table

HOSTILE = "</p><script>alert(1)</script><img src=x onerror='x'>\"&amp;"


def test_texts_and_attributes_are_escaped():
    document = parsed(
        page(HOSTILE, "p { margin: 0 }", element("body", element("p", HOSTILE, title=HOSTILE, class_="a")))
    )
    (paragraph,) = document.all("p")
    assert paragraph.text == HOSTILE
    assert paragraph.attributes == {"title": HOSTILE, "class": "a"}
    assert document.all("title")[0].text == HOSTILE
    assert not document.all("script") + document.all("img")


@pytest.mark.parametrize("text", ["\x00", "\x1b[31m", "\u202e", "\udce9", "\x85"])
def test_characters_that_no_text_should_hold_are_escaped(text):
    document = page(text, "", element("body", element("p", text, title=text))).decode("utf-8")
    assert text not in document
    assert parsed(document.encode()).all("p")[0].text == ascii(text)[1:-1]


def test_content_is_nested_in_its_order():
    made = element("p", "a", element("b", "c"), "d", None, ["e", [element("i"), "f"]], data_x="1")
    document = parsed(page("t", "", element("body", made)))
    assert document.all("p")[0].text == "acdef"
    assert document.all("p")[0].attributes == {"data-x": "1"}
    assert [node.tag for node in document.all("p")[0].inside] == ["b", "i"]


def test_a_table():
    document = parsed(page("t", "", element("body", table(("a", "b"), [("1", "2"), ("3", "4")]))))
    assert [node.text for node in document.all("th") if node.attributes["scope"] == "row"] == ["1", "3"]
    assert [node.text for node in document.all("td")] == ["2", "4"]


def test_a_page_fetches_nothing():
    (policy,) = (
        node.attributes["content"]
        for node in parsed(page("t", "", element("body"))).all("meta")
        if node.attributes.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy.startswith("default-src 'none'; img-src data:")
