"""Access to the notebook renderer for scenes and frames, which may not import it: the package root installs it here."""

from __future__ import annotations

TYPE_CHECKING = False  # `typing` is slow to import, and an interrupt of the command line meanwhile prints a traceback
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

_notebook: Callable[[], Any] | None = None


def install(notebook: Callable[[], Any]) -> None:
    """Set the function that imports and returns the notebook module when it is first needed."""
    global _notebook
    _notebook = notebook


def notebook() -> Any:
    """Return the module `clshade.view.notebook`."""
    assert _notebook is not None, "clshade/__init__.py installs it"
    return _notebook()
