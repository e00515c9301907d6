"""Conversion of arbitrary values for JSON and the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

_MOST = 500  # characters of a value in one line


def plain(value: Any, *, words: bool = False) -> Any:
    """Convert a value for JSON, which has no NaN or infinity: null, or with `words` the strings nan, inf and -inf."""
    if isinstance(value, dict):
        return {str(key): plain(each, words=words) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each, words=words) for each in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist(), words=words)
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value) if words else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def in_line(value: Any) -> str:
    """Format a value as part of one line: unprintable characters are escaped, long text is truncated."""
    if isinstance(value, (list, tuple, np.ndarray)):
        items = plain(np.asarray(value, object).reshape(-1)[:_MOST], words=True)
        text = ", ".join(f"{each:.7g}" if isinstance(each, float) else str(each) for each in items)
    else:
        text = str(plain(value, words=True))
    text = text if text.isprintable() else text.encode("unicode_escape").decode("ascii")
    return text if len(text) <= _MOST else text[: _MOST - 3] + "..."


def named_values(values: Mapping[str, Any]) -> str:
    """Format names and values as part of one line."""
    return ", ".join(f"{in_line(name)} {value!s}" for name, value in values.items())
