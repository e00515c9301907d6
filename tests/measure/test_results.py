"""Results of commands: one list of columns gives terminal, CSV, JSON, Markdown and HTML, in which no text is markup."""

import csv
import io
import json

import pytest
from pages import parsed

from clshade.measure.markup import element, page, table
from clshade.measure.results import Column, Results, Table

COLUMNS = (
    Column("variant", "name", lambda row: row[0], str),
    Column("ms", "frame_ms", lambda row: row[1]),
    Column("", "psnr", lambda row: row[2]),
    Column("share", "", lambda row: row[1] / 10, lambda value: f"{value:.0%}"),
)
RECORDS = [("plain | bar", 1.23456789, None), ("<fast>", 2.0, float("inf"))]
RESULTS = Results(
    "Speed",
    {"device": "a CPU"},
    [Table("All frames", COLUMNS, RECORDS, about="Median.", notes=("ms: of 5 frames",)), Table("None", COLUMNS, [])],
    {"seed": 7},
)


def test_people_see_titled_columns_and_programs_named_ones():
    assert RESULTS.lines() == [
        "device  a CPU",
        *("", "All frames", "Median."),
        "variant        ms  share",
        "plain | bar  1.23    12%",
        "<fast>          2    20%",
        "ms: of 5 frames",
    ]
    rows = list(csv.DictReader(io.StringIO(RESULTS.tables[0].csv())))
    assert rows[0] == {"name": "plain | bar", "frame_ms": "1.23456789", "psnr": ""}
    document = json.loads(RESULTS.json())
    assert (document["device"], document["seed"], document["none"]) == ("a CPU", 7, [])
    assert document["all_frames"][1] == {"name": "<fast>", "frame_ms": 2.0, "psnr": None}  # JSON has no infinity


def test_markdown_and_html_escape_names():
    assert r"| plain \| bar | 1.23 | 12% |" in RESULTS.markdown()
    assert "- ms: of 5 frames" in RESULTS.markdown()
    text = RESULTS.html("above", style="p { color: red }").decode()
    assert "<fast>" not in text
    assert text.index("above") < text.index("All frames") < text.index("&lt;fast&gt;")
    assert "color: red" in text


HOSTILE = "</p><script>alert(1)</script><img src=x onerror='x'>\"&amp;"


def test_texts_and_attributes_are_escaped():
    made = page(HOSTILE, "p { margin: 0 }", element("body", element("p", HOSTILE, title=HOSTILE, class_="a")))
    document = parsed(made)
    (paragraph,) = document.all("p")
    assert paragraph.text == document.all("title")[0].text == HOSTILE
    assert paragraph.attributes == {"title": HOSTILE, "class": "a"}
    assert not document.all("script") + document.all("img")


@pytest.mark.parametrize("text", ["\x00", "\x1b[31m", "\u202e", "\udce9", "\x85"])
def test_characters_that_no_text_should_hold_are_escaped(text):
    document = page(text, "", element("body", element("p", text, title=text))).decode("utf-8")
    assert text not in document
    assert parsed(document.encode()).all("p")[0].text == ascii(text)[1:-1]


def test_content_is_nested_in_its_order_and_a_page_fetches_nothing():
    made = element("p", "a", element("b", "c"), "d", None, ["e", [element("i"), "f"]], data_x="1")
    document = parsed(page("t", "", element("body", made, table(("a", "b"), [("1", "2"), ("3", "4")]))))
    (paragraph,) = document.all("p")
    assert (paragraph.text, paragraph.attributes) == ("acdef", {"data-x": "1"})
    assert [node.tag for node in paragraph.inside] == ["b", "i"]
    assert [node.text for node in document.all("th") if node.attributes["scope"] == "row"] == ["1", "3"]
    assert [node.text for node in document.all("td")] == ["2", "4"]
    policy = {node.attributes.get("http-equiv"): node.attributes.get("content") for node in document.all("meta")}
    assert policy["Content-Security-Policy"].startswith("default-src 'none'; img-src data:")
