"""Finding, probing and opening devices. Uses any device there is."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import replace
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


def probe_that(code: str, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Replace the probing process; return the list to which each probed device's index is appended."""
    tried: list[str] = []

    def command(info: DeviceInfo) -> list[str]:
        tried.append(info.index)
        return [sys.executable, "-S", "-c", code]

    monkeypatch.setattr(probe, "probe_command", command)
    return tried


# Device names


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("", [POCL, POCL_GPU, INTEL, RUSTICL, NVIDIA, INTEL_FPGA]),
        ("pocl", [POCL, POCL_GPU]),
        ("PoCL", [POCL, POCL_GPU]),
        ("portable comp", [POCL, POCL_GPU]),
        ("intel", [INTEL, INTEL_FPGA]),
        ("fpga", [INTEL_FPGA]),
        ("nvidia", [NVIDIA]),
        ("cuda", [NVIDIA]),
        ("rusticl", [RUSTICL]),
        ("h100", [POCL_GPU]),
        ("xeon", [POCL, INTEL]),
        ("0:1", [POCL_GPU]),
        (" 2:0 ", [INTEL]),
        ("9:0", []),
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


def test_unknown_name_lists_what_was_found(opened: device.Device) -> None:
    with pytest.raises(DeviceError, match="no OpenCL device matches 'voodoo'; found: ") as caught:
        device.open_device("voodoo")
    assert opened.platform in str(caught.value)
    assert "\n" not in str(caught.value)


def test_name_from_the_environment(opened: device.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLSHADE_DEVICE", "voodoo")
    with pytest.raises(DeviceError, match="voodoo"):
        device.open_device()
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


def test_a_device_that_aborts_gives_one_line(
    opened: device.Device, fresh_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = 'error: unable to execute command: Executable "ld" doesn\'t exist!\\nFinal linking failed.\\n'
    tried = probe_that(f"import os, sys; sys.stderr.write({text!r}); sys.stderr.flush(); os.abort()", monkeypatch)
    for times in (1, 2):  # it is probed again each time
        with pytest.raises(DeviceError, match="crashes at its first kernel") as caught:
            device.open_device(opened.index)
        assert tried == [opened.index] * times
    message = str(caught.value)
    assert "\n" not in message
    assert "SIGABRT" in message
    assert '"ld" doesn\'t exist' in message
    if opened.platform == POCL.platform:
        assert all(word in message for word in ("apt install gcc", probe.GET_INTEL, "conda-forge"))
    assert not list(fresh_cache.glob("probe-*"))


@pytest.mark.parametrize(
    ("code", "fault"),
    [
        (f"print('{probe.WRONG}')", "computes wrongly"),
        ("pass", "computes wrongly"),
        ("raise SystemExit('LogicError: clBuildProgram failed')", "fails at its first kernel (LogicError: clBuild"),
        ("raise SystemExit(7)", "(exit code 7)"),
        ("import time; time.sleep(60)", "had not finished a small frame after 0.3 s"),
    ],
)
def test_faults(code: str, fault: str, fresh_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probe, "PROBE_SECONDS", 0.3 if "sleep" in code else 30.0)
    probe_that(code, monkeypatch)
    problem = probe.tried_out(POCL).problem
    assert problem.startswith(f"{POCL} ")
    assert fault in problem
    assert probe.recall(POCL).problem == problem


@pytest.mark.long
def test_real_probe_finds_that_the_device_works(opened: device.Device, fresh_cache: Path) -> None:
    calls: list[int] = []
    first = device.open_device(opened.index, trial=lambda: calls.append(0) or b"")  # type: ignore[func-returns-value]
    assert calls == [0]
    assert len(list((fresh_cache / "verdicts").iterdir())) == 1
    assert first.lanes == opened.lanes


def test_verdict_is_remembered_until_the_system_changes(
    opened: device.Device, fresh_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = probe_that(f"print('{probe.RIGHT}')", monkeypatch)
    device.open_device(opened.index)
    device.open_device(opened.index, trial=lambda: pytest.fail("nothing is tried out here"))
    assert tried == [opened.index]
    monkeypatch.setenv("PATH", str(fresh_cache))  # no ld
    device.open_device(opened.index)
    assert len(tried) == 2
    (fresh_cache / "ld").touch(mode=0o755)
    device.open_device(opened.index)
    assert len(tried) == 3
    os.utime(fresh_cache / "ld", (1, 1))  # another one
    device.open_device(opened.index)
    assert len(tried) == 4
    folder = fresh_cache / "verdicts"
    damages: list[Callable[[Path], Any]] = [
        lambda file: file.write_text("{"),
        lambda file: file.write_text("[" * 100_000),
        lambda file: file.write_bytes(b"\xff\xfe\0"),
        lambda file: (file.unlink(), file.mkdir(), (file / "x").touch()),
    ]
    for damage in [*damages, None]:
        if damage is None:
            shutil.rmtree(folder)
            folder.touch()
        else:
            for file in list(folder.iterdir()):
                damage(file)
        before = len(tried)
        for _ in range(2):
            device.open_device(opened.index)
            assert len(tried) == before + 1, "tried out once, and remembered"


def test_verdict_depends_on_the_driver(fresh_cache: Path) -> None:
    probe.remember(replace(POCL, problem=""))
    assert probe.recall(POCL).works
    changes = {"driver": "another", "platform_version": "another", "version": "OpenCL 3.0 PoCL haswell"}
    for name, value in changes.items():
        variant = replace(POCL, **{name: value})
        assert probe.recall(variant) == variant


def test_recalling_is_fast(fresh_cache: Path) -> None:
    probe.remember(replace(POCL, problem=""))
    times = []
    for _ in range(10):
        start = time.perf_counter()
        assert probe.recall(POCL).works
        times.append(time.perf_counter() - start)
    assert min(times) < 0.005


def test_the_next_device_is_taken_when_the_first_is_broken(fresh_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = f"import sys; print('{probe.RIGHT}')"
    tried: list[str] = []

    def command(info: DeviceInfo) -> list[str]:
        tried.append(info.index)
        return [sys.executable, "-S", "-c", code if info == INTEL else "import os; os.abort()"]

    monkeypatch.setattr(probe, "probe_command", command)
    monkeypatch.setattr(device, "found_devices", lambda name: [INTEL, POCL])
    monkeypatch.setattr(device, "_connect", lambda info: info.index)
    assert device.open_device("") == "2:0"
    assert tried == ["0:0", "2:0"]
    assert device.open_device("") == "2:0"
    assert tried == ["0:0", "2:0"], "the broken one comes last, and a working one is not tried out again"
    with pytest.raises(DeviceError, match="crashes"):
        device.open_device("pocl")
    for file in (fresh_cache / "verdicts").iterdir():
        os.utime(file, (1, 1))
    device.open_device("")
    assert tried[3:] == ["0:0"], "after a day it comes first again"


def test_a_test_that_began_early_is_the_only_one(fresh_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried = probe_that(f"print('{probe.RIGHT}')", monkeypatch)
    monkeypatch.setattr(device, "found_devices", lambda name: [POCL])
    monkeypatch.setattr(device, "_connect", lambda info: info.index)
    device.try_out_soon("intel")  # there is none: `open_device` says so
    device.try_out_soon()
    assert device.open_device() == "0:0"
    device.try_out_soon()
    assert tried == ["0:0"]


def test_a_test_that_waits_for_its_frame_is_not_late(fresh_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While its scene is loaded, however long that takes."""
    probe_that(f"import sys; sys.stdin.read(); print('{probe.RIGHT}')", monkeypatch)
    probe.start(POCL)
    monkeypatch.setattr(probe, "PROBE_SECONDS", 1.0)
    time.sleep(1.1)
    assert probe.tried_out(POCL, b"trial").works


# A device whose compiler fails with some numbers of lanes: at the first build, at the first launch, or it hangs.
FAILING = """
import os, sys, time
lanes = int(sys.argv[-1]) or 16
print("{lanes}%d" % lanes, flush=True)
if lanes > {working}: {fault}
print("{right}")
"""


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (
            "sys.stderr.write('LLVM ERROR: Cannot select\\n'); sys.stderr.flush(); os.abort()",
            "SIGABRT: LLVM ERROR: Can",
        ),
        ("sys.exit('RuntimeError: clBuildProgram failed')", "fails at its first kernel (RuntimeError: clBuild"),
        ("time.sleep(60)", "had not finished a small frame after 0.5 s"),
        ("print('clshade-probe-wrong'); sys.exit()", "computes wrongly"),
    ],
)
@pytest.mark.parametrize("working", [8, 1, 0])
def test_fewer_lanes_are_taken_where_more_fail(
    fault: str, reason: str, working: int, fresh_cache: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    """Down to one; a line says which and why. The verdict keeps the number."""
    monkeypatch.setattr(probe, "PROBE_SECONDS", 0.5 if "sleep" in fault else 30.0)
    tried = probe_that(FAILING.format(lanes=probe.LANES, working=working, fault=fault, right=probe.RIGHT), monkeypatch)
    monkeypatch.setattr(device, "found_devices", lambda name: [POCL])
    monkeypatch.setattr(device, "_connect", lambda info: info.lanes)
    attempts = {8: 2, 1: 4, 0: 4}[working]
    if working == 0:
        with pytest.raises(DeviceError) as caught:
            device.open_device("")
        said = str(caught.value)
    else:
        assert device.open_device("") == working
        *progress, said = capfd.readouterr().err.splitlines()
        assert all("trying out" in line for line in progress)
        assert f"with {working} instead of more lanes" in said
        assert (probe.recall(POCL).works, probe.recall(POCL).lanes) == (True, working)
        assert device.open_device("") == working
        assert capfd.readouterr().err == ""
        (listed,) = device.list_devices()
        assert (listed.works, listed.lanes) == (True, working)
        assert listed.narrowed.removeprefix(f"{POCL} ") in device.format_devices([listed])
    assert reason in said
    assert "\n" not in said
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


def test_no_platform(tmp_path: Path) -> None:
    done = python(OPEN, tmp_path, OCL_ICD_VENDORS=str(tmp_path / "none.icd"))
    assert done.stdout.startswith("refused no OpenCL device found (OCL_ICD_VENDORS is "), done.stderr
    assert "install " in done.stdout
    assert len(done.stdout.splitlines()) == 1


def test_no_pyopencl(tmp_path: Path) -> None:
    done = python("import sys; sys.modules['pyopencl'] = None\n" + OPEN, tmp_path)
    assert done.stdout.startswith("refused pyopencl cannot be imported"), done.stderr
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
