"""Finding, probing and opening devices. Uses any device there is."""

import errno
import importlib.util
import os
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from unittest.mock import Mock

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
def probed(fresh_cache, monkeypatch):
    """Return a function that simulates devices, PoCL's alone by default, and what their probes do: Python code, which may
    depend on the device. It returns the list to which the index of each probed device is appended."""

    def simulate(code, *devices: DeviceInfo) -> list[str]:
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
SLEEP, ABORT = "import time; time.sleep(60)", "import os; os.abort()"


@pytest.mark.parametrize(
    ("found", "name", "expected"),
    [
        (EVERY, "", [POCL, POCL_GPU, INTEL, RUSTICL, NVIDIA, INTEL_FPGA]),
        (EVERY, "PoCL", [POCL, POCL_GPU]),
        (EVERY, "intel", [INTEL, INTEL_FPGA]),
        (EVERY, "xeon", [POCL, INTEL]),
        (EVERY, "0:1", [POCL_GPU]),
        (EVERY, " 2:0 ", [INTEL]),
        (EVERY, "voodoo", []),
        ([POCL], "intel", []),  # runtimes are not looked for in the names of CPUs
        ([POCL, POCL_GPU], "nvidia", [POCL_GPU]),
    ],
)
def test_candidates(found, name, expected):
    assert device.candidates(found, name) == expected


def test_opened_devices_and_a_name_that_none_has(opened, monkeypatch):
    assert opened.lanes in ((4, 8, 16) if opened.is_cpu else (1,))
    assert opened.compute_units >= 1
    assert opened.memory >= opened.max_allocation > 0
    monkeypatch.setenv("CLSHADE_DEVICE", "voodoo")
    with pytest.raises(DeviceError, match=rf"^no OpenCL device matches 'voodoo'; found: .*{opened.platform}[^\n]*$"):
        device.open_device()


NO_LINKER = "error: unable to execute command: Executable 'ld' doesn't exist!\nFinal linking failed.\n"
DYING = f"import sys; sys.stderr.write({NO_LINKER!r}); sys.stderr.flush(); {ABORT}"
FAULTS = {  # what a probe does, and what is said
    ABORT: "crashes at its first kernel (SIGABRT): PyPI's PoCL needs a linker",
    DYING: "(SIGABRT: unable to execute command: Executable 'ld' doesn't exist!): ",
    "raise SystemExit(7)": "fails at its first kernel (exit code 7)",
    "raise SystemExit(8)": f"files: install them (`apt install gcc`), or {probe.GET_INTEL}, or {probe.GET_CONDA}",
    f"print('{probe.WRONG}')": "computes wrongly: update its driver or choose another device",
    SLEEP: "had not finished a small frame after 0.3 s",
}


@pytest.mark.parametrize(("deed", "words"), FAULTS.items(), ids=range(len(FAULTS)))
def test_faults(deed, words, probed, monkeypatch):
    """A device that was broken is probed again each time; its verdict only determines the order."""
    monkeypatch.setattr(probe, "PROBE_SECONDS", 0.3 if deed is SLEEP else 30.0)
    tried = probed(deed)
    for times in (1, 2):
        with pytest.raises(DeviceError) as caught:
            device.open_device()
        message = str(caught.value)
        assert message.startswith(f"{POCL} ")
        assert words in message
        assert "\n" not in message
        assert tried == [POCL.index] * times
    assert probe.recall(POCL).problem == message


def test_verdict_is_remembered_until_the_system_changes(probed, fresh_cache, monkeypatch):
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
    assert probe.recall(POCL).works
    changes = {"driver": "another", "platform_version": "another", "version": "OpenCL 3.0 PoCL haswell"}
    assert not any(probe.recall(replace(POCL, **{name: value})).works for name, value in changes.items())


def test_a_damaged_verdict_is_replaced(probed, fresh_cache):
    def become_a_folder(file: Path) -> None:
        file.unlink()
        (file / "x").mkdir(parents=True)

    texts = (b"{}", b"[" * 100_000, b"\xff\xfe\0")
    for spoil in (*(partial(Path.write_bytes, data=text) for text in texts), become_a_folder):
        tried = probed(WORKS)
        device.open_device()
        (file,) = (fresh_cache / "verdicts").iterdir()
        spoil(file)
        tried.clear()
        for _ in range(2):
            device.open_device()
            assert tried == [POCL.index], "tried out once, and remembered"


def test_the_next_device_is_taken_when_the_first_is_broken(probed, fresh_cache):
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


def test_the_next_device_is_taken_when_the_first_cannot_be_opened(probed, monkeypatch):
    def connect(info: DeviceInfo) -> DeviceInfo:
        if info.index == POCL.index:
            raise DeviceError(f"{POCL} cannot be opened")
        return info

    probed(WORKS, INTEL, POCL)
    monkeypatch.setattr(device, "_connect", connect)
    assert device.open_device().index == "2:0"
    with pytest.raises(DeviceError, match=r"0:0 .* cannot be opened"):
        device.open_device("pocl")


@pytest.mark.long
def test_a_test_that_began_early_is_not_late_for_a_frame_for_which_it_waits(probed, monkeypatch):
    probed(f"import sys; assert sys.stdin.read() == 'trial'; {WORKS}")
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


@pytest.mark.parametrize(("working", "attempts"), [(8, 2), (0, 4)])
def test_fewer_lanes_are_taken_where_more_fail(working, attempts, probed, capfd):
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
        assert device.open_device().lanes == working
        assert capfd.readouterr().err == ""
        (listed,) = device.list_devices()
        assert (listed.works, listed.lanes) == (True, working)
        assert listed.narrowed.removeprefix(f"{POCL} ") in device.format_devices([listed])
    assert tried[:attempts] == ["0:0"] * attempts


@pytest.mark.long
@pytest.mark.skipif(not PYPI_POCL, reason="this is not PyPI's PoCL")
def test_pocl_without_a_linker(homeless):
    """Neither the verdict nor a compiled kernel in the cache may hide that the linker is gone."""
    nowhere = "/proc/nowhere"
    done = python(OPEN, "", HOME=nowhere, PATH=nowhere, TMPDIR=str(homeless[0]), CLSHADE_DEVICE="pocl")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("refused")
    assert len(done.stdout.splitlines()) == 1
    assert all(word in done.stdout for word in ("SIGABRT", '"ld"', "apt install gcc"))


INTERRUPTED = """
import os, signal, sys, threading
from clshade.base import console
from clshade.pipeline.opencl import device; from clshade.pipeline.opencl import probe as probing
from clshade.pipeline.opencl.probe import DeviceInfo
infos = [DeviceInfo(f"{k}:0", "Portable Computing Language", "CPU") for k in range(3)]
device.found_devices = lambda name: infos
device._connect, console.SLOW = lambda *_: None, 60.0
probing.probe_command = lambda info: [sys.executable, "-S", "-c", "import time; time.sleep(60)"]
start = probing.start
def started(info, *more, **options):
    start(info, *more, **options)
    print(probing._running[info.index].pid, flush=True)
    if info.index == sys.argv[2]:
        signal.raise_signal(signal.SIGINT)
probing.start = started
if not sys.argv[2]:
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
try:
    device.list_devices() if sys.argv[1] == "list" else device.open_device("")
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.sampled
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize(("call", "at"), [("list", ""), ("list", "1:0"), ("open", "0:0")])
def test_an_interrupt_ends_probes(tmp_path, call, at):
    """at: the device whose probe has just been started; "": while waiting for the first."""
    done = python(INTERRUPTED, tmp_path, call, at)
    assert (done.returncode, done.stderr) == (130, "")
    children = [int(pid) for pid in done.stdout.split()]
    assert children
    for pid in children:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    assert not list(tmp_path.rglob("verdicts/*"))


def test_a_probe_that_cannot_be_started(fresh_cache, monkeypatch):
    monkeypatch.setattr(subprocess, "Popen", Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
    with pytest.raises(DeviceError, match=r"0:0 .* cannot be tried out: No space left on device"):
        probe.start(POCL)
    assert not list(fresh_cache.iterdir())
    assert not probe._running


@pytest.mark.parametrize(
    ("before", "vendors", "words"),
    [
        ("", "none.icd", "no OpenCL device found (OCL_ICD_VENDORS is "),
        ("import sys; sys.modules['pyopencl'] = None\n", "", "pyopencl cannot be imported"),
    ],
    ids=["no platform", "no pyopencl"],
)
def test_nothing_to_open(before, vendors, words, tmp_path):
    done = python(before + OPEN, tmp_path, OCL_ICD_VENDORS=vendors and str(tmp_path / vendors))
    assert done.stdout.startswith(f"refused {words}"), done.stderr
    assert "install " in done.stdout
    assert len(done.stdout.splitlines()) == 1


@pytest.mark.parametrize(
    ("machine", "words"),
    [("x86_64", ("pyopencl[pocl]", "intel-opencl-rt", "driver")), ("aarch64", ("conda-forge", "no PoCL for aarch64"))],
)
def test_install_advice(machine, words, monkeypatch):
    """It names no package that is not published: clshade's own extras are installed from a clone, as '.[intel]'."""
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("platform.machine", lambda: machine)
    advice = probe.install_advice()
    assert all(word in advice for word in words)
    assert ("intel-opencl-rt" in advice) == (machine == "x86_64")
    for path in (*Path(device.__file__).parent.rglob("*.py"), ROOT / "README.md"):
        assert "clshade[" not in path.read_text(), path
