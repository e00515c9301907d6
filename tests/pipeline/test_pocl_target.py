"""The processor that PyPI's PoCL compiles for."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from processes import python

from clshade.pipeline.opencl import environment
from clshade.pipeline.opencl.device import Device
from clshade.pipeline.opencl.environment import level_of, target_for

PYOPENCL = importlib.util.find_spec("pyopencl")
PYPI_POCL = PYOPENCL is not None and list(Path(PYOPENCL.origin or "").parent.glob(".libs/libpocl*"))
SECOND = {"cx16", "lahf_lm", "popcnt", "sse4_1", "sse4_2", "ssse3"}
THIRD = SECOND | {"abm", "avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe", "xsave"}
FOURTH = THIRD | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}
VERSION = """
from clshade.pipeline.opencl.device import list_devices, open_device
device = open_device("pocl")
print(device.lanes, device.version)
"""


@pytest.mark.parametrize(
    ("flags", "level"),
    [
        (set(), 1),
        (SECOND, 2),
        (SECOND | {"avx", "f16c"}, 2),
        (THIRD, 3),
        (THIRD - {"fma"}, 2),
        (THIRD | {"avx512f"}, 3),
        (FOURTH, 4),
        (FOURTH - {"ssse3"}, 1),
    ],
)
def test_levels(flags: set[str], level: int) -> None:
    assert level_of(flags) == level


@pytest.mark.parametrize(
    ("name", "flags", "target"),
    [
        ("generic", FOURTH, "x86-64-v4"),  # Zen 5
        ("generic", THIRD, "x86-64-v3"),
        ("generic", SECOND, "x86-64-v2"),
        ("generic", set(), "x86-64"),
        ("znver3", FOURTH, "x86-64-v4"),  # Zen 4
        ("znver3", THIRD, "znver3"),
        ("znver1", THIRD, "znver1"),
        ("alderlake", THIRD, "alderlake"),
        ("sapphirerapids", FOURTH, "sapphirerapids"),
        ("sapphirerapids", THIRD, "x86-64-v3"),  # in a virtual machine without AVX-512
        ("haswell", SECOND, "x86-64-v2"),  # Pentium and Celeron, without AVX
        ("nehalem", SECOND, "nehalem"),
        ("knl", THIRD | {"avx512f", "avx512cd"}, "knl"),
    ],
)
def test_targets(name: str, flags: set[str], target: str) -> None:
    assert target_for(name, flags) == target


@pytest.mark.skipif(not PYPI_POCL, reason="this is not PyPI's PoCL")
@pytest.mark.parametrize(("target", "lanes"), [("nehalem", 4), ("haswell", 8)])
def test_another_target_is_compiled_for(target: str, lanes: int, tmp_path: Path, opened: Device) -> None:
    done = python(VERSION, tmp_path, **{environment.FORCED: target})
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[0] == str(lanes)
    assert done.stdout.strip().endswith(f"-{target}")


@pytest.mark.skipif(not PYPI_POCL, reason="this is not PyPI's PoCL")
def test_this_processor_has_a_name(opened: Device) -> None:
    if not opened.keeps_programs:
        pytest.skip("needs PoCL")
    assert not opened.version.endswith("-generic")


@pytest.mark.skipif(not PYPI_POCL, reason="this is not PyPI's PoCL")
def test_memory_that_cannot_be_changed_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(environment, "_replace_result", refuse)
    monkeypatch.setenv(environment.FORCED, "nehalem")
    assert environment.set_target.__wrapped__() == ""
