"""A contact sheet: images with titles and captions in a grid. Independent of rendering."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import lettering

PANEL = 272  # pixels, the width of a panel
FRAME = 160  # gray


@dataclass(frozen=True)
class Layout:
    """Sizes of a sheet. across: panels per row. panel: width of a panel. gap, title, caption, head: the space around it.

    All in pixels but title_size and text_size, the text sizes of titles and captions in points.
    """

    across: int = 4
    panel: int = PANEL
    gap: int = 12
    title: int = 22
    caption: int = 54
    head: int = 26
    title_size: float = 8
    text_size: float = 6.5

    def corner(self, number: int, height: int) -> tuple[int, int]:
        """Return column and row of the top left pixel of the panel of this number, from 0; `height`: of all panels."""
        row, column = divmod(number, self.across)
        step = height + self.title + self.caption
        return column * (self.panel + self.gap) + self.gap // 2, self.head + row * step + self.title


@dataclass
class Panel:
    """One image, (height, width, 3) uint8 or, shown in false colors, (height, width); row 0 at the top.

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


def _center(sheet: np.ndarray, x: float, y: float, size: float, text: str) -> None:
    """Draw centered lines of text on a sheet (height, width, 3), the first baseline y pixels from the top."""
    for k, line in enumerate(text.split("\n")):
        width = lettering.width_of(line, size)
        lettering.put(sheet, x - width / 2, y + k * lettering.LINE * size, size, line)


def compose(panels: Sequence[Panel], heading: str, layout: Layout | None = None) -> np.ndarray:
    """Return the sheet, (height, width, 3) uint8: the panels, all of one size, in rows of `layout.across`."""
    layout = layout or Layout()
    height, width = len(panels[0].picture), layout.panel
    rows = -(-len(panels) // layout.across)
    size = layout.corner(rows * layout.across, height)[1] - layout.title, (width + layout.gap) * layout.across
    sheet = np.full((*size, 3), 255, np.uint8)
    _center(sheet, sheet.shape[1] / 2, 2 * layout.title_size, layout.title_size, heading)
    for k, panel in enumerate(panels):
        x, y = layout.corner(k, height)
        picture = panel.picture
        if picture.ndim == 2:
            from matplotlib import colormaps

            picture = (colormaps["magma"](picture)[:, :, :3] * 255.0).astype(np.uint8)
        sheet[y - 1 : y + height + 1, x - 1 : x + width + 1] = FRAME
        sheet[y : y + height, x : x + width] = picture
        _center(sheet, x + width / 2, y - 0.75 * layout.title_size, layout.title_size, panel.title)
        _center(sheet, x + width / 2, y + height + 12, layout.text_size, panel.text)
    return sheet
