"""Suggestions for misspelled names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

_ALIKE = 0.54  # minimum similarity of names, 1 if equal (`difflib.get_close_matches`)


def nearest(name: str, allowed: Iterable[str], words: Mapping[str, str] | None = None) -> str:
    """Return the allowed name closest to a name, or the one that `words` has for it; "" if none is close.

    Case is ignored. words: names used elsewhere, in lower case with _ between words -> an allowed name.
    """
    names = {name.lower(): name for name in allowed}
    key = name.strip().lower()
    if key in names:
        return names[key]
    meant = (words or {}).get(key.replace("-", "_"), "")
    if meant in names.values():
        return meant
    import difflib

    return next((names[near] for near in difflib.get_close_matches(key, names, 1, _ALIKE)), "")


def hint(
    name: Any,
    allowed: Iterable[str],
    words: Mapping[str, str] | None = None,
    *,
    remarks: Mapping[str, str] | None = None,
) -> str:
    """Return the end of a message about a wrong name: `: did you mean 'Z'?`, the remark on that name, or "".

    words: see `nearest`. remarks: names in lower case -> a few words.
    """
    if not isinstance(name, str):
        return ""
    remark = (remarks or {}).get(name.strip().lower())
    if remark:
        return f": {remark}"
    near = nearest(name, allowed, words)
    return f": did you mean {near!r}?" if near else ""
