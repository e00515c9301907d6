"""A contact sheet: images with titles and captions in a grid. Independent of rendering."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

DPI = 100
LINE = 1.8  # line spacing in pixels per point of text size
ACROSS = 4  # panels per row
PANEL, GAP, TITLE, CAPTION, HEAD = 272, 12, 22, 54, 26  # pixels: width of a panel, and the space around it


@dataclass
class Panel:
    """One image, (height, PANEL, 3) uint8 or, shown in false colors, (height, PANEL); row 0 at the top.

    title: above it. text: the lines below.
    """

    picture: np.ndarray
    title: str
    text: str


def reduced(picture: np.ndarray) -> np.ndarray:
    """Resize an image (M, N, 3) or (M, N), uint8, to a panel."""
    from PIL import Image

    rows, columns = picture.shape[:2]
    height = min(max(PANEL * rows // columns, 16), 4 * PANEL)
    return np.array(Image.fromarray(picture).resize((PANEL, height), Image.Resampling.BOX))


def prepare() -> None:
    """Import modules that are slow to import."""
    import matplotlib.ft2font  # noqa: F401


@cache
def _font() -> Any:
    """Return matplotlib's default font without importing the rest of it, which takes as long as the figures."""
    from matplotlib import get_data_path
    from matplotlib.ft2font import FT2Font

    return FT2Font(str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"))


@cache
def _unhinted() -> Any:
    """Return the flag for unhinted glyph spacing, whose name depends on the version of matplotlib."""
    from matplotlib import ft2font

    names: Any = ft2font
    return names.LoadFlags.NO_HINTING if hasattr(names, "LoadFlags") else names.LOAD_NO_HINTING


@cache
def _line(text: str, size: float) -> tuple[np.ndarray, int]:
    """Render a line of text as (height, width) uint8, 255 for black; and return its rows below the baseline.

    size: points.
    """
    font = _font()
    font.set_size(size, DPI)
    font.set_text(text, 0.0, flags=_unhinted())
    font.draw_glyphs_to_bitmap(antialiased=True)
    return np.array(font.get_image()), font.get_descent() // 64  # from 1/64 pixel


def _center(sheet: np.ndarray, x: float, y: float, size: float, text: str) -> None:
    """Draw centered lines of text on a sheet (height, width, 3), the first baseline y pixels from the top."""
    for k, line in enumerate(text.split("\n")):
        ink, descent = _line(line, size)
        left, bottom = round(x - ink.shape[1] / 2), round(y + k * LINE * size) + descent
        # Text is clipped at the sheet.
        ink = ink[:, max(-left, 0) : sheet.shape[1] - left]
        place = sheet[bottom - len(ink) : bottom, max(left, 0) :][:, : ink.shape[1]]
        np.minimum(place, 255 - ink[:, :, None], out=place)


def compose(panels: Sequence[Panel], heading: str) -> np.ndarray:
    """Return the sheet, (height, width, 3) uint8: the panels, all of one size, in rows of ACROSS."""
    from matplotlib import colormaps

    height = len(panels[0].picture)
    step = height + TITLE + CAPTION
    sheet = np.full((HEAD + step * -(-len(panels) // ACROSS), (PANEL + GAP) * ACROSS, 3), 255, np.uint8)
    _center(sheet, sheet.shape[1] / 2, 16, 8, heading)
    for k, panel in enumerate(panels):
        x, y = k % ACROSS * (PANEL + GAP) + GAP // 2, HEAD + k // ACROSS * step + TITLE
        picture = panel.picture
        if picture.ndim == 2:
            picture = (colormaps["magma"](picture)[:, :, :3] * 255.0).astype(np.uint8)
        sheet[y - 1 : y + height + 1, x - 1 : x + PANEL + 1] = 160
        sheet[y : y + height, x : x + PANEL] = picture
        _center(sheet, x + PANEL / 2, y - 6, 8, panel.title)
        _center(sheet, x + PANEL / 2, y + height + 12, 6.5, panel.text)
    return sheet
