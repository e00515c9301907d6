"""Free memory as reported by the system: of the machine, of control groups of both versions, of the process."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest
from processes import ROOT
from scene_files import write

from clshade.base import host_memory

MIB = 1 << 20
MACHINE = "MemTotal:       24576000 kB\nMemFree:         1000000 kB\nMemAvailable:    2048000 kB\n"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Simulate a machine with 2000 MiB of free memory, without control groups."""
    write(tmp_path / "proc/meminfo", MACHINE)
    write(tmp_path / "proc/self/statm", "1000 500 100 1 0 300 0\n")
    return tmp_path


def test_the_machine(root):
    assert host_memory.available(root) == 2000 * MIB


def test_this_machine():
    assert 64 * MIB < host_memory.available() < 1 << 50


@pytest.mark.parametrize(("pages", "expected"), [(1000, 4096000.0), (-1, math.inf)])
def test_where_there_is_no_such_file(tmp_path, monkeypatch, pages, expected):
    """All of the machine's memory, or unknown."""
    values = {"SC_PHYS_PAGES": pages, "SC_PAGE_SIZE": 4096}
    monkeypatch.setattr(host_memory.os, "sysconf", values.__getitem__)
    assert host_memory.available(tmp_path) == expected


@pytest.mark.parametrize("inside", [False, True])
def test_a_control_group(root, inside):
    """Version 2; inside a container its own group is the root."""
    write(root / "proc/self/cgroup", "0::/a.slice/b.scope\n")
    group = root / "sys/fs/cgroup" if inside else root / "sys/fs/cgroup/a.slice/b.scope"
    write(group / "memory.max", f"{300 * MIB}\n")
    write(group / "memory.current", f"{200 * MIB}\n")
    write(group / "memory.stat", f"anon 5\ninactive_file {50 * MIB}\nactive_file 7\n")
    assert host_memory.available(root) == 150 * MIB
    write(group / "memory.max", "max\n")
    assert host_memory.available(root) == 2000 * MIB


def test_a_group_around_the_own_one(root):
    write(root / "proc/self/cgroup", "0::/a.slice/b.scope\n")
    for name, limit in (("a.slice", 500), ("a.slice/b.scope", 900)):
        write(root / "sys/fs/cgroup" / name / "memory.max", f"{limit * MIB}\n")
        write(root / "sys/fs/cgroup" / name / "memory.current", f"{100 * MIB}\n")
        write(root / "sys/fs/cgroup" / name / "memory.stat", "inactive_file 0\n")
    assert host_memory.available(root) == 400 * MIB


def test_a_control_group_of_the_first_version(root):
    write(root / "proc/self/cgroup", "5:cpu,cpuacct:/x\n4:memory:/x/y\n1:name=systemd:/\n0::/\n")
    group = root / "sys/fs/cgroup/memory/x/y"
    write(group / "memory.limit_in_bytes", f"{100 * MIB}\n")
    write(group / "memory.usage_in_bytes", f"{120 * MIB}\n")
    write(group / "memory.stat", f"inactive_file 5\ntotal_inactive_file {60 * MIB}\n")
    assert host_memory.available(root) == 40 * MIB
    write(group / "memory.usage_in_bytes", f"{220 * MIB}\n")
    assert host_memory.available(root) == 0


def test_files_that_say_nothing(root):
    write(root / "proc/self/cgroup", "0::/a\n")
    write(root / "sys/fs/cgroup/a/memory.max", "nonsense\n")
    assert host_memory.available(root) == 2000 * MIB


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
