"""JSON from users, parsed with limits and without Python's extensions; arbitrary values for JSON and the terminal."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from .input_files import file_error, quoted

MAX_DIGITS = 1000  # of an integer: float64 holds none of more than 309, and parsing time is quadratic in the digits
MAX_VALUES = 1 << 22  # commas and brackets in the text: bounds the memory of the parsed value
_MOST = 500  # characters of a value in one line


def parse_text(text: bytes, owner: str, form: str, *, unique: bool = False) -> Any:
    """Parse a JSON text.

    owner, form: the file, and its expected content, for messages. unique: refuse objects with a duplicate key.
    Raises InputError for text that is not JSON in UTF-8, holds NaN or infinity, is nested too deeply, or has too many
    values.
    """
    if sum(map(text.count, (b",", b"[", b"{"))) > MAX_VALUES:
        raise file_error(owner, "JSON", f"at most {MAX_VALUES} values", "more")
    hook = _unique if unique else None
    try:
        return json.loads(
            text.decode("utf-8-sig"), parse_int=_whole, parse_constant=_refuse_constant, object_pairs_hook=hook
        )
    except UnicodeDecodeError as error:
        raise file_error(owner, "JSON", "UTF-8 text", f"byte {text[error.start]} at {error.start}") from None
    except json.JSONDecodeError as error:
        problem = f"{error.msg} in line {error.lineno}, column {error.colno}"
        raise file_error(owner, "JSON", form, problem) from None
    except (ValueError, RecursionError) as error:
        problem = "too deep a nesting" if isinstance(error, RecursionError) else quoted(str(error))
        raise file_error(owner, "JSON", form, problem) from None


def found_text(value: Any) -> str:
    if value is None:
        return "none"
    return f"{len(value)} values" if isinstance(value, (list, dict)) else quoted(repr(value)).strip("\"'")


def _whole(digits: str) -> int:
    if len(digits) > MAX_DIGITS:
        raise ValueError(f"a whole number of {len(digits)} digits")
    return int(digits)


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"a number that is {name}")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    unique = dict(pairs)
    if len(unique) < len(pairs):
        twice, _ = Counter(key for key, _ in pairs).most_common(1)[0]
        raise ValueError(f"the key {twice} twice")
    return unique


def plain(value: Any, *, words: bool = False) -> Any:
    """Convert a value for JSON, which has no NaN or infinity: null, or with `words` the strings nan, inf and -inf."""
    if isinstance(value, dict):
        return {str(key): plain(item, words=words) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, words=words) for item in value]
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
        text = ", ".join(f"{item:.7g}" if isinstance(item, float) else str(item) for item in items)
    else:
        text = str(plain(value, words=True))
    text = text if text.isprintable() else text.encode("unicode_escape").decode("ascii")
    return text if len(text) <= _MOST else text[: _MOST - 3] + "..."


def named_values(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{in_line(name)} {value!s}" for name, value in values.items())
