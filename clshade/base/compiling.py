"""Whether a compiler is at work for this process: what a thread may show while another waits."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

_lock = threading.Lock()
_blocks = 0


@contextlib.contextmanager
def at_work() -> Iterator[None]:
    """Count a compiler as at work within the block."""
    global _blocks
    with _lock:
        _blocks += 1
    try:
        yield
    finally:
        with _lock:
            _blocks -= 1


def is_at_work() -> bool:
    return _blocks > 0
