"""Free memory as reported by the system: of the machine, of control groups of both versions, of the process."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest
from processes import ROOT
from scene_files import write

from clshade.base import host_memory

MIB = 1 << 20
MACHINE = "MemTotal:       24576000 kB\nMemFree:         1000000 kB\nMemAvailable:    2048000 kB\n"
FIRST = "5:cpu,cpuacct:/x\n4:memory:/x/y\n1:name=systemd:/\n0::/"


@pytest.mark.parametrize(
    ("member", "groups", "mebibytes"),
    [
        (None, {}, 2000),
        ("0::/a/b", {"a/b": (300, 200, 50)}, 150),
        ("0::/a/b", {"": (300, 200, 50)}, 150),  # inside a container, whose group is the root there
        ("0::/a/b", {"a": (500, 100, 0), "a/b": (900, 100, 0)}, 400),
        ("0::/a/b", {"a/b": ("max", 200, 50)}, 2000),
        (FIRST, {"memory/x/y": (100, 120, 60)}, 40),
        (FIRST, {"memory/x/y": (100, 220, 60)}, 0),
    ],
)
def test_a_machine_with_2000_free_and_control_groups(tmp_path, member, groups, mebibytes):
    """groups: of each its limit, use and inactive files, in MiB."""
    write(tmp_path / "proc/meminfo", MACHINE)
    write(tmp_path / "proc/self/statm", "1000 500 100 1 0 300 0\n")
    if member is not None:
        write(tmp_path / "proc/self/cgroup", f"{member}\n")
    for name, (limit, used, inactive) in groups.items():
        folder, first = tmp_path / "sys/fs/cgroup" / name, member == FIRST
        write(
            folder / ("memory.limit_in_bytes" if first else "memory.max"),
            f"{limit if isinstance(limit, str) else limit * MIB}\n",
        )
        write(folder / ("memory.usage_in_bytes" if first else "memory.current"), f"{used * MIB}\n")
        stat = "inactive_file 5\ntotal_inactive_file" if first else "anon 5\ninactive_file"
        write(folder / "memory.stat", f"{stat} {inactive * MIB}\nactive_file 7\n")
    assert host_memory.available(tmp_path) == mebibytes * MIB


@pytest.mark.parametrize(("pages", "expected"), [(1000, 4096000.0), (-1, math.inf)])
def test_where_there_is_no_such_file(tmp_path, monkeypatch, pages, expected):
    """All of the machine's memory, or unknown."""
    values = {"SC_PHYS_PAGES": pages, "SC_PAGE_SIZE": 4096}
    monkeypatch.setattr(host_memory.os, "sysconf", values.__getitem__)
    assert host_memory.available(tmp_path) == expected


def test_a_limit_of_the_process():
    pytest.importorskip("resource")
    code = f"""
import resource
from clshade.base import host_memory
resource.setrlimit(resource.RLIMIT_AS, ({1 << 30}, resource.getrlimit(resource.RLIMIT_AS)[1]))
print(host_memory.available())
"""
    done = subprocess.run([sys.executable, "-c", code], env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert 0 < float(done.stdout) < 1 << 30
