"""What people look at: frames and scenes in a notebook, a page for images, a live view, sheets, films and posters.

Public names are imported on first use, as those of `clshade` are.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

_HOMES = {
    "Film": "clshade.view.film",
    "draw_film": "clshade.view.film",
    "Poster": "clshade.view.poster",
    "draw_poster": "clshade.view.poster",
    "Sheet": "clshade.view.sheet",
    "draw_sheet": "clshade.view.sheet",
}

__all__ = ["Film", "Poster", "Sheet", "draw_film", "draw_poster", "draw_sheet"]

if TYPE_CHECKING:
    from .film import Film, draw_film
    from .poster import Poster, draw_poster
    from .sheet import Sheet, draw_sheet


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=sys.modules[__name__])
    import importlib

    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return list(__all__)
