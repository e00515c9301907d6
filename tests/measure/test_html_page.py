"""The report as one page of HTML."""

from __future__ import annotations

from dataclasses import replace

from pages import parsed
from studies import small_study, sphere

from clshade.images import figures
from clshade.measure.report import figure, report

HOSTILE = '<script>alert("x")</script>&$1$\x1b[31m\u202e'


def test_a_page_loads_nothing_escapes_names_and_has_all(device, tmp_path, monkeypatch):
    studied = small_study(device)
    studied = replace(studied, scene=replace(studied.scene, name=HOSTILE))
    monkeypatch.setattr(report, "study", lambda *arguments: studied)
    monkeypatch.setattr(figure, "draw", lambda study: figures.blank(1.0, 1.0))
    report.run(sphere(), device.index, out=tmp_path, html=True, command=lambda settings: f"draw <{settings.samples}>")
    page = parsed((tmp_path / "report.html").read_bytes())
    for node in page.all():
        assert node.tag not in ("script", "link", "iframe", "object", "embed")
        for name in ("src", "href"):
            assert node.attributes.get(name, "#").startswith(
                ("#", "data:image/png;base64,", "data:image/svg+xml;base64,")
            )
        assert not any(name.startswith("on") for name in node.attributes)
    for text in (page.all("title")[0].text, page.all("h1")[0].text):
        assert "<script>alert(" in text
        assert not {"\x1b", "\u202e"} & set(text)
    assert page.all("dt")[0].text in ("no visible error", "closest")
    assert page.all("dd")[0].text.endswith("draw <1>")
    assert [node.text for node in page.all("h2")] == ["Variants", "Where the error comes from"]
    (drawn,) = page.all("img")
    assert drawn.attributes["src"].startswith("data:image/svg+xml")
