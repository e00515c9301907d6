"""Access to the converters of scenes, and to the choice of a camera, for the scene's model, which may not import them: the
package root installs them here."""

from __future__ import annotations

TYPE_CHECKING = False  # `typing` is slow to import, and an interrupt of the command line meanwhile prints a traceback
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

_converters: dict[str, Callable[[], Any]] = {}


def install(**converters: Callable[[], Any]) -> None:
    """Set functions, by name, that import and return a converter when it is first needed."""
    _converters.update(converters)


def converter(name: str) -> Any:
    """Return the converter of this name."""
    return _converters[name]()
