"""A contact sheet: pictures with titles and captions side by side. Knows nothing of rendering."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

DPI = 100
LINE = 1.8  # pixels between lines, per point of the text's size
ACROSS = 4  # panels in a row
PANEL, GAP, TITLE, CAPTION, HEAD = 272, 12, 22, 54, 26  # pixels: a panel's width, and the room around it


@dataclass
class Panel:
    """One picture, (height, PANEL, 3) uint8 or, shown in false colors, (height, PANEL); row 0 at the top.

    title: above it. text: the lines below.
    """

    picture: np.ndarray
    title: str
    text: str


def reduced(picture: np.ndarray) -> np.ndarray:
    """A picture (M, N, 3) or (M, N), uint8, in a panel's size."""
    from PIL import Image

    rows, columns = picture.shape[:2]
    height = min(max(PANEL * rows // columns, 16), 4 * PANEL)
    return np.array(Image.fromarray(picture).resize((PANEL, height), Image.Resampling.BOX))


def prepare() -> None:
    """Imports what is slow to import."""
    import matplotlib.backends.backend_agg
    import matplotlib.font_manager  # noqa: F401


class _Writer:
    """Text on a white sheet of (height, width) pixels, drawn by matplotlib."""

    def __init__(self, height: int, width: int) -> None:
        from matplotlib.backends.backend_agg import RendererAgg

        self._renderer = RendererAgg(width, height, DPI)
        self._renderer.clear()
        self.size = height, width

    def centered(self, x: float, y: float, size: float, text: str) -> None:
        """Lines of text of a size in points, the first one's baseline y pixels from the top."""
        from matplotlib.font_manager import FontProperties

        font, pen = FontProperties(size=size), self._renderer.new_gc()
        for k, line in enumerate(text.split("\n")):
            width = self._renderer.get_text_width_height_descent(line, font, False)[0]
            self._renderer.draw_text(pen, x - width / 2, y + k * LINE * size, line, font, 0.0)

    def pixels(self) -> np.ndarray:
        """(height, width, 3) uint8, black on white."""
        alpha = np.asarray(self._renderer.buffer_rgba())[:, :, 3:]
        return np.broadcast_to(255 - alpha, (*self.size, 3))


def compose(panels: Sequence[Panel], heading: str) -> np.ndarray:
    """The sheet, (height, width, 3) uint8: the panels, all of one size, in rows of ACROSS."""
    from matplotlib import colormaps, rc_context

    height = len(panels[0].picture)
    step = height + TITLE + CAPTION
    whole = np.full((HEAD + step * -(-len(panels) // ACROSS), (PANEL + GAP) * ACROSS, 3), 255, np.uint8)
    text = _Writer(*whole.shape[:2])
    with rc_context({"text.hinting": "none"}):
        text.centered(whole.shape[1] / 2, 16, 8, heading)
        for k, panel in enumerate(panels):
            x, y = k % ACROSS * (PANEL + GAP) + GAP // 2, HEAD + k // ACROSS * step + TITLE
            picture = panel.picture
            if picture.ndim == 2:
                picture = (colormaps["magma"](picture)[:, :, :3] * 255.0).astype(np.uint8)
            whole[y - 1 : y + height + 1, x - 1 : x + PANEL + 1] = 160
            whole[y : y + height, x : x + PANEL] = picture
            text.centered(x + PANEL / 2, y - 6, 8, panel.title)
            text.centered(x + PANEL / 2, y + height + 12, 6.5, panel.text)
    return np.minimum(whole, text.pixels())
