"""Finding, probing and opening devices. Uses any device there is."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import OPEN, ROOT, python

from clshade.errors import DeviceError
from clshade.pipeline.opencl import device, probe
from clshade.pipeline.opencl.probe import DeviceInfo

PYOPENCL = importlib.util.find_spec("pyopencl")
PYPI_POCL = PYOPENCL is not None and list(Path(PYOPENCL.origin or "").parent.glob(".libs/libpocl*"))
POCL = DeviceInfo("0:0", "Portable Computing Language", "pthread-Intel(R) Xeon(R) Processor")
POCL_GPU = DeviceInfo("0:1", "Portable Computing Language", "NVIDIA H100", is_cpu=False)
INTEL_FPGA = DeviceInfo("1:0", "Intel(R) FPGA Emulation Platform for OpenCL(TM)", "Intel(R) FPGA Emulation Device")
INTEL = DeviceInfo("2:0", "Intel(R) OpenCL", "Intel(R) Xeon(R) Processor")
RUSTICL = DeviceInfo("3:0", "rusticl", "Mesa Intel(R) UHD Graphics", is_cpu=False)
NVIDIA = DeviceInfo("4:0", "NVIDIA CUDA", "NVIDIA GeForce RTX 3060", is_cpu=False)
EVERY = [POCL_GPU, POCL, INTEL_FPGA, INTEL, RUSTICL, NVIDIA]


@pytest.fixture
def probed(fresh_cache: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """Return a function that simulates devices, PoCL's alone by default, and what their probes do: Python code, which may
    depend on the device. It returns the list to which the index of each probed device is appended."""

    def simulate(code: str | Callable[[DeviceInfo], str], *devices: DeviceInfo) -> list[str]:
        tried: list[str] = []

        def command(info: DeviceInfo) -> list[str]:
            tried.append(info.index)
            return [sys.executable, "-S", "-c", code if isinstance(code, str) else code(info)]

        monkeypatch.setattr(probe, "probe_command", command)
        monkeypatch.setattr(device, "found_devices", lambda name: device.candidates(devices or [POCL], name))
        monkeypatch.setattr(device, "_connect", lambda info: info)
        return tried

    return simulate


WORKS = f"print('{probe.RIGHT}')"


# Device names


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("", [POCL, POCL_GPU, INTEL, RUSTICL, NVIDIA, INTEL_FPGA]),
        ("PoCL", [POCL, POCL_GPU]),
        ("portable comp", [POCL, POCL_GPU]),
        ("intel", [INTEL, INTEL_FPGA]),
        ("fpga", [INTEL_FPGA]),
        ("nvidia", [NVIDIA]),
        ("rusticl", [RUSTICL]),
        ("xeon", [POCL, INTEL]),
        ("0:1", [POCL_GPU]),
        (" 2:0 ", [INTEL]),
        ("0:9", []),
        ("voodoo", []),
    ],
)
def test_candidates(name: str, expected: list[DeviceInfo]) -> None:
    assert device.candidates(EVERY, name) == expected


def test_a_runtime_is_not_looked_for_in_the_names_of_cpus() -> None:
    assert device.candidates([POCL], "intel") == []
    assert device.candidates([POCL, RUSTICL], "intel") == [RUSTICL]
    assert device.candidates([POCL, POCL_GPU], "nvidia") == [POCL_GPU]


def test_a_name_from_the_environment(opened: device.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """An unknown one lists what was found."""
    monkeypatch.setenv("CLSHADE_DEVICE", "voodoo")
    with pytest.raises(DeviceError, match=r"^no OpenCL device matches 'voodoo'; found: .*$") as caught:
        device.open_device()
    assert opened.platform in str(caught.value)
    assert device.open_device(opened.index).name == opened.name


# Opening


def test_open_device_runs_a_kernel(opened: device.Device) -> None:
    import pyopencl as cl

    assert opened.lanes in ((4, 8, 16) if opened.is_cpu else (1,))
    assert opened.compute_units >= 1
    assert opened.memory >= opened.max_allocation > 0
    assert opened.setup_run > 0
    assert opened.version.startswith("OpenCL")
    source = "__kernel void twice(__global float *x) { x[get_global_id(0)] *= 2.0f; }"
    kernel = cl.Kernel(cl.Program(opened.context, source).build(), "twice")
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    buffer = cl.Buffer(opened.context, flags, hostbuf=np.arange(64, dtype=np.float32))
    event = kernel(opened.queue, (64,), (16,), buffer)
    result = np.empty(64, np.float32)
    cl.enqueue_copy(opened.queue, result, buffer)
    assert (result == 2.0 * np.arange(64)).all()
    assert event.profile.end >= event.profile.start > 0


@pytest.mark.long
def test_pyopencl_keeps_no_caches_of_its_own(opened: device.Device, tmp_path: Path) -> None:
    """They are shared with other programs, and a damaged one would end every run. The user can turn them on."""
    code = f"""
import numpy as np
from clshade.pipeline.opencl import device
import pyopencl as cl
opened = device.open_device({opened.index!r})
kernel = cl.Program(opened.context, "__kernel void one(__global float *x) {{ x[0] = 1; }}").build().all_kernels()[0]
kernel.set_args(cl.Buffer(opened.context, cl.mem_flags.READ_WRITE, 4))
"""
    for variables, kept in (({}, {"clshade"}), ({"PYOPENCL_NO_CACHE": "0"}, {"clshade", "pytools"})):
        done = python(code, tmp_path, **variables)
        assert done.returncode == 0, done.stderr
        assert {path.name for path in tmp_path.iterdir()} - {"pyopencl"} == kept


def test_importing_does_not_import_pyopencl(tmp_path: Path) -> None:
    done = python(
        "import sys, clshade.pipeline.opencl.device; print('pyopencl' in sys.modules, 'numpy' in sys.modules)", tmp_path
    )
    assert done.stdout.split() == ["False", "False"], done.stderr


# Probing


SLEEP, ABORT = "import time; time.sleep(60)", "import os; os.abort()"
NO_LINKER = "error: unable to execute command: Executable 'ld' doesn't exist!\nFinal linking failed.\n"
REMEDY = f"files: install them (`apt install gcc`), or {probe.GET_INTEL}, or {probe.GET_CONDA}"
FAULTS = {  # what a probe does, and what is said
    "dies": (ABORT, "crashes at its first kernel (SIGABRT): PyPI's PoCL needs a linker"),
    "dies with a message": (
        f"import sys; sys.stderr.write({NO_LINKER!r}); sys.stderr.flush(); {ABORT}",
        "(SIGABRT: unable to execute command: Executable 'ld' doesn't exist!): ",
    ),
    "cannot build": (
        "raise SystemExit('LogicError: clBuildProgram failed')",
        "kernel (LogicError: clBuildProgram failed)",
    ),
    "fails": ("raise SystemExit(7)", "fails at its first kernel (exit code 7)"),
    "says what it needs": ("raise SystemExit(7)", REMEDY),
    "is wrong": (f"print('{probe.WRONG}')", "computes wrongly: update its driver or choose another device"),
    "says nothing": ("pass", "computes wrongly"),
    "hangs": (SLEEP, "had not finished a small frame after 0.3 s"),
}


@pytest.mark.parametrize(("deed", "words"), FAULTS.values(), ids=FAULTS)
def test_faults(deed: str, words: str, probed: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    """A device that was broken is probed again each time; its verdict only determines the order."""
    monkeypatch.setattr(probe, "PROBE_SECONDS", 0.3 if deed is SLEEP else 30.0)
    tried = probed(deed)
    for times in (1, 2):
        with pytest.raises(DeviceError) as caught:
            device.open_device()
        assert str(caught.value).startswith(f"{POCL} ")
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)
        assert tried == [POCL.index] * times
    assert probe.recall(POCL).problem == str(caught.value)


@pytest.mark.long
def test_real_probe_finds_that_the_device_works(opened: device.Device, fresh_cache: Path) -> None:
    calls: list[int] = []
    first = device.open_device(opened.index, trial=lambda: calls.append(0) or b"")  # type: ignore[func-returns-value]
    assert calls == [0]
    assert len(list((fresh_cache / "verdicts").iterdir())) == 1
    assert first.lanes == opened.lanes


def test_verdict_is_remembered_until_the_system_changes(
    probed: Callable[..., list[str]], fresh_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = probed(WORKS)
    device.open_device()
    device.open_device(trial=lambda: pytest.fail("nothing is tried out here"))
    assert tried == [POCL.index]
    monkeypatch.setenv("PATH", str(fresh_cache))  # no ld
    device.open_device()
    assert len(tried) == 2
    (fresh_cache / "ld").touch(mode=0o755)
    device.open_device()
    assert len(tried) == 3
    os.utime(fresh_cache / "ld", (1, 1))  # another one
    device.open_device()
    assert len(tried) == 4


def become_a_folder(file: Path) -> None:
    file.unlink()
    (file / "x").mkdir(parents=True)


def lose_its_folder(file: Path) -> None:
    shutil.rmtree(file.parent)
    file.parent.touch()


TEXTS = (b"{", b"{}", b"null", b"[" * 100_000, b"\xff\xfe\0")
SPOILED = [*(partial(Path.write_bytes, data=text) for text in TEXTS), become_a_folder, lose_its_folder]


@pytest.mark.parametrize("spoil", SPOILED, ids=range(len(SPOILED)))
def test_a_damaged_verdict_is_replaced(
    spoil: Callable[[Path], Any], probed: Callable[..., list[str]], fresh_cache: Path
) -> None:
    tried = probed(WORKS)
    device.open_device()
    (file,) = (fresh_cache / "verdicts").iterdir()
    spoil(file)
    for _ in range(2):
        device.open_device()
        assert tried == [POCL.index] * 2, "tried out once, and remembered"


def test_verdict_depends_on_the_driver_and_is_recalled_fast(fresh_cache: Path) -> None:
    probe.remember(replace(POCL, problem=""))
    times = []
    for _ in range(10):
        start = time.perf_counter()
        assert probe.recall(POCL).works
        times.append(time.perf_counter() - start)
    assert min(times) < 0.005
    changes = {"driver": "another", "platform_version": "another", "version": "OpenCL 3.0 PoCL haswell"}
    for name, value in changes.items():
        variant = replace(POCL, **{name: value})
        assert probe.recall(variant) == variant


def test_the_next_device_is_taken_when_the_first_is_broken(probed: Callable[..., list[str]], fresh_cache: Path) -> None:
    tried = probed(lambda info: WORKS if info == INTEL else ABORT, INTEL, POCL)
    assert device.open_device().index == "2:0"
    assert tried == ["0:0", "2:0"]
    assert device.open_device().index == "2:0"
    assert tried == ["0:0", "2:0"], "the broken one comes last, and a working one is not tried out again"
    with pytest.raises(DeviceError, match="crashes"):
        device.open_device("pocl")
    for file in (fresh_cache / "verdicts").iterdir():
        os.utime(file, (1, 1))
    device.open_device()
    assert tried[3:] == ["0:0"], "after a day it comes first again"


def test_a_test_that_began_early_is_the_only_one(probed: Callable[..., list[str]]) -> None:
    tried = probed(WORKS)
    device.try_out_soon("intel")  # there is none: `open_device` says so
    device.try_out_soon()
    assert device.open_device().index == "0:0"
    device.try_out_soon()
    assert tried == ["0:0"]


def test_a_test_that_waits_for_its_frame_is_not_late(
    probed: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """While its scene is loaded, however long that takes."""
    probed(f"import sys; sys.stdin.read(); {WORKS}")
    probe.start(POCL)
    monkeypatch.setattr(probe, "PROBE_SECONDS", 1.0)
    time.sleep(1.1)
    assert probe.tried_out(POCL, b"trial").works


# A device whose compiler fails with some numbers of lanes.
FAILING = """
import os, sys
lanes = int(sys.argv[-1]) or 16
print("{lanes}%d" % lanes, flush=True)
if lanes > {working}: os.abort()
print("{right}")
"""


@pytest.mark.parametrize("working", [8, 1, 0])
def test_fewer_lanes_are_taken_where_more_fail(working: int, probed: Callable[..., list[str]], capfd: Any) -> None:
    """Down to one; a line says which and why. The verdict keeps the number."""
    tried = probed(FAILING.format(lanes=probe.LANES, working=working, right=probe.RIGHT))
    if working == 0:
        with pytest.raises(DeviceError, match=r"crashes at its first kernel \(SIGABRT\)"):
            device.open_device()
    else:
        assert device.open_device().lanes == working
        *progress, said = capfd.readouterr().err.splitlines()
        assert all("trying out" in line for line in progress)
        assert "crashes at its first kernel (SIGABRT)" in said
        assert f"with {working} instead of more lanes" in said
        assert (probe.recall(POCL).works, probe.recall(POCL).lanes) == (True, working)
        assert device.open_device().lanes == working
        assert capfd.readouterr().err == ""
        (listed,) = device.list_devices()
        assert (listed.works, listed.lanes) == (True, working)
        assert listed.narrowed.removeprefix(f"{POCL} ") in device.format_devices([listed])
    attempts = {8: 2, 1: 4, 0: 4}[working]
    assert tried[:attempts] == ["0:0"] * attempts


@pytest.mark.long
def test_what_a_test_compiled_is_not_compiled_again(opened: device.Device, tmp_path: Path) -> None:
    """The trial draws the scene itself: its parent finds every program."""
    code = f"""
import clshade
from clshade.pipeline import programs
clshade.render(clshade.builtin("quads"), device={opened.index!r}, resolution=(32, 24))
print(*(each.loaded for each in programs.built()))
"""
    done = python(code, tmp_path)
    assert done.stdout.split() == ["True", "True"], done.stderr


@pytest.mark.long
@pytest.mark.skipif(not PYPI_POCL, reason="this is not PyPI's PoCL")
def test_pocl_without_a_linker(homeless: tuple[Path, str]) -> None:
    # Neither the verdict nor a compiled kernel in the cache may hide that the linker is gone.
    nowhere = "/proc/nowhere"
    done = python(OPEN, "", HOME=nowhere, PATH=nowhere, TMPDIR=str(homeless[0]), CLSHADE_DEVICE="pocl")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("refused")
    assert len(done.stdout.splitlines()) == 1
    assert all(word in done.stdout for word in ("SIGABRT", '"ld"', "apt install gcc"))


# No device at all


@pytest.mark.parametrize(
    ("before", "vendors", "words"),
    [
        ("", "none.icd", "no OpenCL device found (OCL_ICD_VENDORS is "),
        ("import sys; sys.modules['pyopencl'] = None\n", "", "pyopencl cannot be imported"),
    ],
    ids=["no platform", "no pyopencl"],
)
def test_nothing_to_open(before: str, vendors: str, words: str, tmp_path: Path) -> None:
    done = python(before + OPEN, tmp_path, OCL_ICD_VENDORS=vendors and str(tmp_path / vendors))
    assert done.stdout.startswith(f"refused {words}"), done.stderr
    assert "install " in done.stdout
    assert len(done.stdout.splitlines()) == 1


@pytest.mark.parametrize(
    ("system", "machine", "words"),
    [
        ("linux", "x86_64", ["pyopencl[pocl]", "intel-opencl-rt", "pocl-opencl-icd", "driver"]),
        ("linux", "aarch64", ["pocl-opencl-icd", "conda-forge", "no PoCL for aarch64"]),
        ("darwin", "arm64", ["conda-forge", "driver"]),
    ],
)
def test_install_advice(system: str, machine: str, words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", system)
    monkeypatch.setattr("platform.machine", lambda: machine)
    advice = probe.install_advice()
    assert all(word in advice for word in words)
    assert ("intel-opencl-rt" in advice) == (machine == "x86_64")


def test_no_advice_names_a_package_that_is_not_published() -> None:
    """clshade's own extras are installed from a clone, as '.[intel]'."""
    for path in (*Path(device.__file__).parent.rglob("*.py"), ROOT / "README.md"):
        assert "clshade[" not in path.read_text(), path


@pytest.mark.long
def test_list_and_format_devices(opened: device.Device, fresh_cache: Path) -> None:
    infos = device.list_devices()
    working = [info for info in infos if info.works]
    assert opened.index in [info.index for info in working]
    assert all(bool(info.problem) != info.works for info in infos)
    text = device.format_devices(infos)
    assert text.count("the default") == 1
    assert "--device" in text


def test_format_devices_that_do_not_work() -> None:
    text = device.format_devices([])
    assert "No OpenCL device" in text
    assert "install" in text
    broken = DeviceInfo("0:0", "NVIDIA CUDA", "X", is_cpu=False, problem=probe.device_fault(NVIDIA, "computes wrongly"))
    text = device.format_devices([broken])
    assert "does not work: " in text
    assert "update its driver" in text
    assert "To get one" in text
    assert "the default" not in text
