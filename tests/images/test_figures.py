"""Figures as PNG, PDF and SVG files."""

from __future__ import annotations

import re
import zlib
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from clshade.errors import OutputError
from clshade.images import figures


def drawn():
    """Return a figure with text and a large picture."""
    figure = figures.blank(3.0, 2.0)
    axes = figure.subplots()
    axes.imshow(np.random.default_rng(1).integers(0, 255, (900, 1600, 3)).astype(np.uint8))
    axes.set_title("error")
    return figure


@pytest.mark.sampled
@pytest.mark.parametrize("kind", figures.FORMATS)
def test_the_same_figure_gives_the_same_bytes(kind, tmp_path):
    for name in "ab":
        figures.save(drawn(), tmp_path / f"{name}.{kind}", colors=64)
    first, second = ((tmp_path / f"{name}.{kind}").read_bytes() for name in "ab")
    assert first == second
    assert not re.search(rb"CreationDate|ModDate|dc:date", first)


def test_pdf(tmp_path):
    """Fonts are embedded as TrueType; pictures are compressed, and as large as the page shows them."""
    figures.save(drawn(), tmp_path / "a.PDF")
    data = (tmp_path / "a.PDF").read_bytes()
    assert data.startswith(b"%PDF")
    assert b"/FontFile2" in data
    assert b"/Type3" not in data
    width = int(re.search(rb"/Subtype /Image.*?/Width (\d+)", data, re.DOTALL)[1])
    assert 200 < width < 3.0 * figures.VECTOR_DPI
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", data, re.DOTALL)
    text = b"".join(zlib.decompress(stream) for stream in streams if stream[:1] == b"\x78")
    assert re.search(rb"\] TJ|\) Tj", text)  # text, not outlines


def test_svg(tmp_path):
    """One file that loads nothing, text as outlines, pictures within."""
    figures.save(drawn(), tmp_path / "a.svg")
    root = ElementTree.parse(tmp_path / "a.svg").getroot()
    tags = [element.tag.rpartition("}")[2] for element in root.iter()]
    assert "path" in tags
    assert "text" not in tags
    links = [element.get("{http://www.w3.org/1999/xlink}href", "") for element in root.iter()]
    assert sum(link.startswith("data:image/png;base64,") for link in links) == 1
    assert all(link.startswith(("#", "data:")) for link in links if link)


def test_png(tmp_path):
    figures.save(drawn(), tmp_path / "a.png", colors=16)
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (330, 220)
        assert len(image.getcolors()) <= 16


@pytest.mark.parametrize("kind", figures.FORMATS)
def test_a_figure_that_cannot_be_written(kind, tmp_path):
    with pytest.raises(OutputError, match="there is no folder"):
        figures.save(figures.blank(1.0, 1.0), tmp_path / "none" / f"a.{kind}")
    assert not list(tmp_path.iterdir())
