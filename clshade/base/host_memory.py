"""How much memory this process may still take: asked before something is made that a file of a few KB may claim."""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path

# The files of a control group in the kernel's two versions: what it may take, what it has taken, and of that the cached
# files, which go when memory is needed.
_GROUP_FILES = (
    ("memory.max", "memory.current", "inactive_file"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)


def available(root: Path = Path("/")) -> float:
    """Bytes: what is free on this machine, and what the process's control groups (a container's) and its own limit
    leave of it; swap is not counted. Infinity where the system does not say. root: of /proc and /sys."""
    return max(min(_of_machine(root), _of_groups(root), _of_process(root)), 0.0)


def _of_machine(root: Path) -> float:
    with contextlib.suppress(OSError):
        found = re.search(r"^MemAvailable:\s*(\d+) kB$", (root / "proc/meminfo").read_text(), re.MULTILINE)
        if found:
            return int(found[1]) * 1024.0
    with contextlib.suppress(AttributeError, ValueError, OSError):  # no Linux: what there is in all
        pages = os.sysconf("SC_PHYS_PAGES")
        return float(pages) * os.sysconf("SC_PAGE_SIZE") if pages > 0 else math.inf
    return math.inf


def _of_groups(root: Path) -> float:
    return min((_left_of(folder, *names) for folder, names in _groups(root)), default=math.inf)


def _groups(root: Path) -> Iterator[tuple[Path, tuple[str, str, str]]]:
    """The control groups that the process is in, each with those around it."""
    with contextlib.suppress(OSError):
        for line in (root / "proc/self/cgroup").read_text().splitlines():
            _, kinds, name = line.split(":", 2)
            if kinds and "memory" not in kinds.split(","):
                continue
            top = root / "sys/fs/cgroup" / ("memory" if kinds else "")
            inner = top / name.strip("/")  # not there where a container sees its own group as the top
            for folder in (inner, *inner.parents):
                yield folder, _GROUP_FILES[bool(kinds)]
                if folder == top:
                    break


def _left_of(group: Path, most: str, taken: str, cached: str) -> float:
    try:
        limit = (group / most).read_text().strip()
        if limit == "max":
            return math.inf
        found = re.search(rf"^{cached} (\d+)$", (group / "memory.stat").read_text(), re.MULTILINE)
        return int(limit) - int((group / taken).read_text()) + (int(found[1]) if found else 0)
    except (OSError, ValueError):
        return math.inf


def _of_process(root: Path) -> float:
    try:
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit == resource.RLIM_INFINITY:
            return math.inf
        pages = int((root / "proc/self/statm").read_text().split()[0])
        return limit - pages * resource.getpagesize()
    except (ImportError, OSError):
        return math.inf
