"""The memory of this machine, checked before allocating what a file of a few KB or a large scene may claim: systems end
processes without a word."""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path

from ..errors import InputError

GIB = 1 << 30

# Files of a control group (cgroup v2, v1): limit, usage, and the part of it that is cached files, which the kernel
# drops when memory is needed.
_GROUP_FILES = (
    ("memory.max", "memory.current", "inactive_file"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)


def available(root: Path = Path("/")) -> float:
    """Return the bytes that this process may still allocate; infinity if the system does not say.

    The minimum of the free memory of the machine, and what the limits of the process and of its control groups (those
    of a container) leave; swap is not counted. root: of /proc and /sys.
    """
    free = _number(root / "proc/meminfo", r"^MemAvailable:\s*(\d+) kB$")
    pages = _number(root / "proc/self/statm", r"^(\d+) ")
    left = [float(physical() or math.inf) if free is None else free * 1024.0]  # not Linux: the total
    left += [] if pages is None else [limit("RLIMIT_AS") - pages * os.sysconf("SC_PAGE_SIZE")]
    return max(min(*left, *_left_of_groups(root), math.inf), 0.0)


def _number(path: Path, pattern: str = r"^(\d+)$") -> int | None:
    """Return the number that a pattern finds in a file; None without one, or without the file."""
    with contextlib.suppress(OSError):
        match = re.search(pattern, path.read_text(), re.MULTILINE)
        return int(match[1]) if match else None
    return None


def _left_of_groups(root: Path) -> Iterator[float]:
    """Yield the bytes that are left in the control groups of the process that limit them, and in the groups around."""
    with contextlib.suppress(OSError):
        for line in (root / "proc/self/cgroup").read_text().splitlines():
            _, kinds, name = line.split(":", 2)
            if kinds and "memory" not in kinds.split(","):
                continue
            maximum, usage, cached = _GROUP_FILES[bool(kinds)]
            top = root / "sys/fs/cgroup" / ("memory" if kinds else "")
            inner = top / name.strip("/")  # missing in a container that sees its own group as the root
            for group in (inner, *inner.parents):
                maximal, used = _number(group / maximum), _number(group / usage)  # none where the limit is "max"
                if maximal is not None and used is not None:
                    yield maximal - used + (_number(group / "memory.stat", rf"^{cached} (\d+)$") or 0)
                if group == top:
                    break


def limit(name: str) -> float:
    """Return a limit of this process, bytes; infinity if there is none. name: of `resource`, such as RLIMIT_FSIZE."""
    try:
        import resource
    except ImportError:  # on Windows
        return math.inf
    soft = resource.getrlimit(getattr(resource, name))[0]
    return math.inf if soft == resource.RLIM_INFINITY else soft


def physical() -> int | None:
    """Return the bytes of this machine's memory; None if the system does not say."""
    try:
        size = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None
    return size if size > 0 else None


def require(owner: str, name: str, needed: int, found: str) -> None:
    """Raise InputError if this machine has less memory than needed, bytes. found: what takes so much."""
    memory = physical()
    if memory is not None and needed > memory:
        expected = f"what {memory / GIB:.1f} GiB of memory hold"
        raise InputError(f"{owner}: {name}: expected {expected}, found {found}: {needed / GIB:.1f} GiB or more")
