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

    The least of the free memory of the machine, and what the limits of the process and of its control groups (those
    of a container) leave; swap is not counted. root: of /proc and /sys.
    """
    groups = min((_left_of(folder, *names) for folder, names in _groups(root)), default=math.inf)
    return max(min(_of_machine(root), groups, _of_process(root)), 0.0)


def _of_machine(root: Path) -> float:
    with contextlib.suppress(OSError):
        found = re.search(r"^MemAvailable:\s*(\d+) kB$", (root / "proc/meminfo").read_text(), re.MULTILINE)
        if found:
            return int(found[1]) * 1024.0
    return float(physical() or math.inf)  # not Linux: the total


def _groups(root: Path) -> Iterator[tuple[Path, tuple[str, str, str]]]:
    """Yield the control groups that the process is in, each followed by its parents."""
    with contextlib.suppress(OSError):
        for line in (root / "proc/self/cgroup").read_text().splitlines():
            _, kinds, name = line.split(":", 2)
            if kinds and "memory" not in kinds.split(","):
                continue
            top = root / "sys/fs/cgroup" / ("memory" if kinds else "")
            inner = top / name.strip("/")  # missing in a container that sees its own group as the root
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
        return limit("RLIMIT_AS") - int((root / "proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return math.inf


def limit(name: str) -> float:
    """Return a limit of this process, bytes; infinity if there is none. name: of `resource`, such as RLIMIT_FSIZE."""
    try:
        import resource
    except ImportError:  # on Windows, which knows no such limits
        return math.inf
    found = resource.getrlimit(getattr(resource, name))[0]
    return math.inf if found == resource.RLIM_INFINITY else found


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
