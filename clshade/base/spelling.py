"""The nearest right name to one that is not known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

_ALIKE = 0.54  # how alike names have to be, 1 for equal ones (`difflib.get_close_matches`)


def nearest(given: str, allowed: Iterable[str], words: Mapping[str, str] | None = None) -> str:
    """The allowed name that is most like the given one, or that `words` has for it; "" where nothing is near.

    Letters' case makes no difference. words: what others call it, in small letters with _ between words -> a name.
    """
    names = {name.lower(): name for name in allowed}
    key = given.strip().lower()
    if key in names:
        return names[key]
    meant = (words or {}).get(key.replace("-", "_"), "")
    if meant in names.values():
        return meant
    import difflib

    return next((names[near] for near in difflib.get_close_matches(key, names, 1, _ALIKE)), "")


def hint(
    given: Any,
    allowed: Iterable[str],
    words: Mapping[str, str] | None = None,
    *,
    remarks: Mapping[str, str] | None = None,
) -> str:
    """What a message adds to a wrong name: `: did you mean 'Z'?`, what `remarks` says of that name, or "".

    words: see `nearest`. remarks: names in small letters -> a few words.
    """
    if not isinstance(given, str):
        return ""
    remark = (remarks or {}).get(given.strip().lower())
    if remark:
        return f": {remark}"
    near = nearest(given, allowed, words)
    return f": did you mean {near!r}?" if near else ""
