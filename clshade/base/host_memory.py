"""The memory of this machine, for refusing in one line what cannot fit: systems end processes without a word."""

from __future__ import annotations

import os

from ..errors import InputError

GIB = 1 << 30


def physical() -> int | None:
    """Return the bytes of this machine's memory; None if the system does not say."""
    try:
        found = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None
    return found if found > 0 else None


def require(owner: str, name: str, needed: int, found: str) -> None:
    """Raise InputError if this machine has less memory than needed, bytes. found: what takes so much."""
    most = physical()
    if most is not None and needed > most:
        expected = f"what {most / GIB:.1f} GiB of memory hold"
        raise InputError(f"{owner}: {name}: expected {expected}, found {found}: {needed / GIB:.1f} GiB or more")
