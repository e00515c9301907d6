"""Testing a device in a process of its own, and remembering the verdict.

Some devices abort the whole process at their first kernel: PyPI's PoCL does on a machine without a linker. The verdict
is kept on disk until the driver, or what it needs from the system, changes. Nothing here imports pyopencl.
"""

from __future__ import annotations

import contextlib
import glob
import hashlib
import json
import math
import os
import re
import shutil
import signal
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ...base import atomic_files, interrupts
from ...errors import DeviceError, OutputError
from . import environment

if TYPE_CHECKING:
    from subprocess import Popen

PROBE_SECONDS = 120.0  # a device that has not run a small kernel by then is broken
VERDICT_VERSION = 3  # increment it when the probe changes
BROKEN_SECONDS = 24 * 3600.0  # how long a device that was broken is tried after the others
RIGHT, WRONG = "clshade-probe-right", "clshade-probe-wrong"
LANES = "clshade-probe-lanes="  # before the number with which the frame is drawn, once a small kernel has run
NOT_TRIED = "not tried"

# Words for runtimes, and substrings of their platforms' names.
RUNTIMES = {
    "pocl": ("portable computing language", "pocl"),
    "intel": ("intel",),
    "nvidia": ("nvidia",),
    "amd": ("amd", "advanced micro devices"),
    "rusticl": ("rusticl",),
}
GET_INTEL = "`pip install intel-opencl-rt intel-cmplr-lib-rt`"
GET_CONDA = "PoCL from conda-forge (`conda install -c conda-forge pyopencl pocl`)"


@dataclass(frozen=True)
class DeviceInfo:
    """A device that was found."""

    index: str  # "P:D", the platform's and the device's index
    platform: str
    name: str
    platform_version: str = ""  # the runtime's own version text
    version: str = ""  # the device's OpenCL version text; PoCL's ends with the processor that it compiles for
    driver: str = ""
    is_cpu: bool = True
    has_fp64: bool = True
    compute_units: int = 1
    memory: int = 0  # bytes
    works: bool = False  # it drew a frame and the result was right
    problem: str = NOT_TRIED  # why it does not work, one line with the remedy; "" if it works
    lanes: int = 0  # pixels that were processed together; 0 if that is not known
    narrowed: str = ""  # why these are fewer than the device's own number, one line with the remedy; "" if they are not

    @property
    def title(self) -> str:
        """Platform and name."""
        return f"{self.platform}: {self.name}"

    def __str__(self) -> str:
        return f"{self.index} {self.platform} ({self.name})"


def is_runtime(info: DeviceInfo, word: str) -> bool:
    """Return whether the device's platform is the one that a word of RUNTIMES means."""
    return any(part in info.platform.lower() for part in RUNTIMES[word])


def one_line(text: str, length: int = 160) -> str:
    text = " ".join(text.split())
    return text if len(text) <= length else text[: length - 3] + "..."


# Remedies


def install_advice() -> str:
    """Return what to install on this system to get an OpenCL device; one line."""
    import platform

    gpu = "for a GPU, its vendor's driver"
    machine = platform.machine()
    if sys.platform.startswith("linux"):
        if machine.lower() in ("x86_64", "amd64"):
            return f'`pip install "pyopencl[pocl]"` (needs gcc), {GET_INTEL}, or Debian\'s pocl-opencl-icd; {gpu}'
        return f"Debian's pocl-opencl-icd, or {GET_CONDA}: PyPI has no PoCL for {machine}; {gpu}"
    return f"{GET_CONDA}: PyPI has none for {platform.system() or sys.platform}; {gpu}"


def device_fault(info: DeviceInfo, fault: str) -> str:
    """Return one line: the device, what is wrong with it (a predicate), and the remedy."""
    remedy = "update its driver or choose another device"
    if is_runtime(info, "pocl") and info.is_cpu and "first kernel" in fault:
        needed = "PyPI's PoCL needs a linker and the C library's development files"
        remedy = f"{needed}: install them (`apt install gcc`), or {GET_INTEL}, or {GET_CONDA}"
    elif is_runtime(info, "intel") and info.is_cpu:
        remedy = "reinstall it (`pip install -U intel-opencl-rt intel-cmplr-lib-rt`) or choose another device"
    return f"{info} {fault}: {remedy}"


# The probing process


def own_command(module: str) -> list[str]:
    """Return the command line that runs the `main` of one of clshade's modules, with the module search path of this process;
    to be followed by its arguments."""
    path = [*sys.path, str(Path(__file__).resolve().parents[3])]
    code = (
        f"import sys; sys.path[:] = {path!r}\n"
        f"from {module} import main\n"
        "try: main(*sys.argv[1:])\n"
        "except Exception as error: sys.exit(f'{type(error).__name__}: {error}')"
    )
    return [sys.executable, "-c", code]


def probe_command(info: DeviceInfo) -> list[str]:
    """Return the command line that runs `trial_frame.main`; to be followed by the number of lanes."""
    return [*own_command("clshade.pipeline.trial_frame"), info.index, info.name]


def can_probe() -> bool:
    """Return whether a Python can be started: in an application that embeds Python, sys.executable is something else."""
    return bool(sys.executable) and not getattr(sys, "frozen", False)


_running: dict[str, Popen[bytes]] = {}  # processes by the indices of the devices that they test
_deadlines: dict[str, float] = {}  # of processes that do not wait for a trial, by `time.monotonic`


def end(index: str) -> None:
    """End the test of a device, if there is one, even while another thread waits for it; a forked child ends none."""
    process = _running.pop(index, None)
    if process is not None:
        process.kill()
        process.wait()


@interrupts.at_end
def end_all() -> None:
    """End the tests of all devices."""
    for index in list(_running):
        end(index)


def start(info: DeviceInfo, lanes: int = 0, *, waits: bool = True) -> None:
    """Start a process that tests the device, and ends with this one. Its first kernel comes from no cache: a missing linker
    would go unnoticed.

    lanes: pixels processed together, 0 for the device's own number. waits: whether `tried_out` says what it draws.
    Raises DeviceError if it cannot be started.
    """
    from subprocess import DEVNULL, PIPE, Popen

    end(info.index)
    stdin, command = PIPE if waits else DEVNULL, [*probe_command(info), str(lanes)]
    variables = {**os.environ, "PYOPENCL_NO_CACHE": "1"}
    try:
        _running[info.index] = Popen(command, env=variables, stdin=stdin, stdout=PIPE, stderr=PIPE)
        _deadlines[info.index] = math.inf if waits else time.monotonic() + PROBE_SECONDS
    except OSError as error:
        raise DeviceError(f"{info} cannot be tried out: {error.strerror or error}") from None


_NARROWER = {16: 8, 8: 4, 4: 1}  # number of lanes: the next one to try where a device fails


def tried_out(info: DeviceInfo, trial: bytes = b"") -> DeviceInfo:
    """Test the device, where its own number of lanes does not work with fewer, and return it with the verdict, which is
    remembered. The first test may be under way.

    trial: pickled arguments of Renderer for the frame that the process draws, see `trial_frame`; empty: any frame.
    """
    if info.index not in _running:
        start(info)
    first = ""
    while True:
        out, fault = _finish(info.index, trial)
        match = re.search(rf"{LANES}(\d+)", out)
        problem = device_fault(info, fault) if fault else ""
        outcome = replace(info, works=not problem, problem=problem, lanes=int(match[1]) if match else 0)
        remember(outcome)
        first = first or problem
        if outcome.works:
            fewer = f"{first}; it works, but takes longer, with {outcome.lanes} instead of more lanes" if first else ""
            return replace(outcome, narrowed=fewer)
        if outcome.lanes not in _NARROWER:
            return replace(outcome, problem=first)
        start(info, _NARROWER[outcome.lanes])


def _finish(index: str, trial: bytes) -> tuple[str, str]:
    """Wait for a test: return its output, and what it showed, as a predicate; "" if the device works."""
    from subprocess import TimeoutExpired

    process, left = _running[index], max(_deadlines[index] - time.monotonic(), 1.0)
    try:
        out, err = (stream.decode(errors="replace") for stream in process.communicate(trial, min(left, PROBE_SECONDS)))
        if index not in _running:  # ended by an interrupt, which says nothing of the device
            raise KeyboardInterrupt
        return out, _fault(process.returncode, out, err)
    except TimeoutExpired:
        process.kill()
        out = process.communicate()[0].decode(errors="replace")
        return out, f"had not finished a small frame after {PROBE_SECONDS:g} s"
    finally:
        end(index)


def _fault(code: int, out: str, err: str) -> str:
    if code == 0:
        return "" if RIGHT in out.split() else "computes wrongly"
    lines = [line.strip() for line in err.splitlines() if line.strip()]
    telling = r"doesn't exist|cannot find|no such file", r"error", r""
    hits = [line for pattern in telling for line in lines if re.search(pattern, line, re.IGNORECASE)]
    said = one_line(re.sub(r"^(fatal )?error: ", "", hits[0])) if hits else ""
    if code > 0:
        return f"fails at its first kernel ({said or f'exit code {code}'})"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    return f"crashes at its first kernel ({name}{': ' + said if said else ''})"


# Verdicts: one file per device and state of the system


def _verdict_file(info: DeviceInfo) -> Path:
    """Return the file of a device's verdict. Its name is a digest of what the device's working depends on, at little cost:
    driver, time of the runtimes' libraries in pip's folders, of `ld`, and of the C library's linker script and compiler
    support files, which PyPI's PoCL links its kernels with."""
    package = environment.pyopencl_folder()
    paths = [*glob.glob(os.path.join(package, ".libs", "libpocl*")), str(environment.intel_library() or "")]
    paths += [shutil.which("ld") or "", shutil.which("x86_64-unknown-linux-gnu-ld") or ""]
    for pattern in ("/libc.so", "64/libc.so", "/*-linux-gnu*/libc.so", "/gcc*/*/*/libgcc.a"):
        paths += sorted(glob.glob(f"/usr/lib{pattern}"))
    times = [[path, os.stat(path).st_mtime_ns if os.path.exists(path) else None] for path in filter(None, paths)]
    identity = [VERDICT_VERSION, info.platform, info.platform_version, info.name, info.version, info.driver, package]
    digest = hashlib.sha256(json.dumps([*identity, times]).encode()).hexdigest()
    return environment.cache_root() / "verdicts" / f"{digest[:32]}.json"


def remember(info: DeviceInfo) -> None:
    """Store a device's verdict on disk; if that fails, it is tested again next time."""
    file, verdict = _verdict_file(info), {"device": str(info), "problem": info.problem, "lanes": info.lanes}
    with contextlib.suppress(OSError, OutputError):
        if not file.parent.is_dir():
            file.parent.unlink(missing_ok=True)
            file.parent.mkdir()
        if file.is_dir():
            shutil.rmtree(file)
        atomic_files.write_bytes(file, json.dumps(verdict).encode())


def recall(info: DeviceInfo) -> DeviceInfo:
    """Return the device with the remembered verdict, if there is one. A device that did not work is always tested again
    before it is refused; the verdict only determines the order."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
        file = _verdict_file(info)
        verdict = json.loads(file.read_text())
        problem, lanes = str(verdict["problem"]), int(verdict["lanes"])
        if not problem or file.stat().st_mtime >= time.time() - BROKEN_SECONDS:
            return replace(info, works=not problem, problem=problem, lanes=lanes)
    return info
