"""Access to what the scene's model and the frame may not import, such as converters: the package root installs it here."""

from __future__ import annotations

TYPE_CHECKING = False  # `typing` is slow to import, and an interrupt of the command line meanwhile prints a traceback
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

installed: dict[str, Callable[[], Any]] = {}  # functions that import and return something when it is first needed


def get(name: str) -> Any:
    return installed[name]()
