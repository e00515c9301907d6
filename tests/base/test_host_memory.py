"""Free memory as reported by the system: of the machine, of control groups of both versions, of the process."""

import math

import pytest
from processes import python
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
    limit_name, use_name, stat = "memory.max", "memory.current", "anon 5\ninactive_file"
    if member == FIRST:
        limit_name, use_name = "memory.limit_in_bytes", "memory.usage_in_bytes"
        stat = "inactive_file 5\ntotal_inactive_file"
    for name, (limit, used, inactive) in groups.items():
        folder = tmp_path / "sys/fs/cgroup" / name
        write(folder / limit_name, f"{limit if limit == 'max' else limit * MIB}\n")
        write(folder / use_name, f"{used * MIB}\n")
        write(folder / "memory.stat", f"{stat} {inactive * MIB}\nactive_file 7\n")
    assert host_memory.available(tmp_path) == mebibytes * MIB


@pytest.mark.parametrize(("pages", "expected"), [(1000, 4096000.0), (-1, math.inf)])
def test_where_there_is_no_such_file(tmp_path, monkeypatch, pages, expected):
    """All of the machine's memory, or unknown."""
    monkeypatch.setattr(host_memory.os, "sysconf", {"SC_PHYS_PAGES": pages, "SC_PAGE_SIZE": 4096}.__getitem__)
    assert host_memory.available(tmp_path) == expected


def test_a_limit_of_the_process():
    pytest.importorskip("resource")
    code = f"""
import resource
from clshade.base import host_memory
resource.setrlimit(resource.RLIMIT_AS, ({1 << 30}, resource.getrlimit(resource.RLIMIT_AS)[1]))
print(host_memory.available())
"""
    done = python(code, "")
    assert done.returncode == 0, done.stderr
    assert 0 < float(done.stdout) < 1 << 30
