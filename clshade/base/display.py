"""Where scenes and frames find what shows them in a notebook, though neither may import it: the root says it here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_notebook: Callable[[], Any] | None = None


def install(notebook: Callable[[], Any]) -> None:
    """Set what `notebook` returns: the module that draws for notebooks, imported when it is first needed."""
    global _notebook
    _notebook = notebook


def notebook() -> Any:
    """The module `clshade.view.notebook`."""
    assert _notebook is not None, "clshade/__init__.py installs it"
    return _notebook()
