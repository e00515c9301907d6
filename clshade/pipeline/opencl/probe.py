"""Testing a device in a process of its own, and remembering the verdict.

Some devices abort the whole process at their first kernel: PyPI's PoCL does on a machine without a linker. The verdict
is kept on disk until the driver, or what it needs from the system, changes. Nothing here imports pyopencl.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import json
import os
import re
import shutil
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from ...base import atomic_files, interrupts
from ...errors import DeviceError, OutputError
from . import environment

PROBE_SECONDS = 120.0  # a device that has not run a small kernel by then is broken
VERDICT_VERSION = 3  # increment it when the probe changes
BROKEN_SECONDS = 24 * 3600.0  # how long a device that was broken is tried after the others
RIGHT, WRONG = "clshade-probe-right", "clshade-probe-wrong"
LANES = "clshade-probe-lanes="  # before the number with which the frame is drawn, once a small kernel has run

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
    """A device that was found.

    index: "P:D", the platform's and the device's index.
    platform_version: the runtime's own version text.
    version: the device's OpenCL version text; PoCL's ends with the processor that it compiles for.
    memory: bytes.
    works: it drew a frame and the result was right.
    problem: why it does not work, one line with the remedy; "" if it works.
    lanes: pixels that were processed together; 0 if that is not known.
    narrowed: why they are fewer than the device's own number, one line with the remedy; "" if they are not.
    """

    index: str
    platform: str
    name: str
    platform_version: str = ""
    version: str = ""
    driver: str = ""
    is_cpu: bool = True
    has_fp64: bool = True
    compute_units: int = 1
    memory: int = 0
    works: bool = False
    problem: str = "not tried"
    lanes: int = 0
    narrowed: str = ""

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
        remedy = (
            "PyPI's PoCL needs a linker and the C library's development files: install them (`apt install gcc`), "
            f"or {GET_INTEL}, or {GET_CONDA}"
        )
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


_running: set[Probe] = set()


@interrupts.at_end
def _abandon_all() -> None:
    """End, at the end of the process, the probes that an interrupt left running."""
    for probe in list(_running):
        if probe.owner == os.getpid():
            probe.abandon()


class Probe:
    """A probing process, started at once. Its first kernel comes from no cache: a missing linker would go unnoticed. End it
    with `finish` or `abandon`; the end of this process does so too.

    lanes: pixels processed together in its frame, 0 for the device's own number; once finished, the number that was taken,
    0 if it did not come so far. waits: whether `finish` says which frame it draws.

    Raises DeviceError if it cannot be started.
    """

    def __init__(self, info: DeviceInfo, lanes: int = 0, *, waits: bool = True) -> None:
        import subprocess

        variables = {name: value for name, value in os.environ.items() if name != "POCL_CACHE_DIR"}
        self.info, self.lanes, self.owner = info, lanes, os.getpid()
        self.process: subprocess.Popen[bytes] | None = None
        _running.add(self)
        self.started = time.monotonic()
        try:
            self.process = subprocess.Popen(
                [*probe_command(info), str(lanes)],
                env={**variables, "PYOPENCL_NO_CACHE": "1"},
                stdin=subprocess.PIPE if waits else subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
        except OSError as error:
            self.abandon()
            raise DeviceError(f"{info} cannot be tried out: {error.strerror or error}") from None
        except BaseException:
            self.abandon()
            raise

    def abandon(self) -> None:
        """End the process, also while another thread waits for it in `finish`."""
        _running.discard(self)
        if self.process is not None and self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def finish(self, trial: bytes = b"") -> str:
        """Wait for the verdict and remember it: "" if the device works, else what is wrong and the remedy. trial: pickled
        arguments of Renderer for the frame that the process draws, see `trial_frame`; empty: any frame."""
        from subprocess import TimeoutExpired

        assert self.process is not None
        try:
            started = self.started if self.process.stdin is None else time.monotonic()  # it has waited for the frame
            left = started + PROBE_SECONDS - time.monotonic()
            out, err = map(_text, self.process.communicate(trial, timeout=max(left, 0.0)))
            if self not in _running:  # abandoned by an interrupt, which says nothing of the device
                raise KeyboardInterrupt
            fault = _fault(self.process.returncode, out, err)
        except TimeoutExpired:
            self.process.kill()
            out = _text(self.process.communicate()[0])
            fault = f"had not finished a small frame after {PROBE_SECONDS:g} s"
        finally:
            self.abandon()
        told = [word.removeprefix(LANES) for word in out.split() if word.startswith(LANES)]
        self.lanes = int(told[0]) if told else 0
        problem = device_fault(self.info, fault) if fault else ""
        remember(self.info, problem, self.lanes)
        return problem


def _text(output: bytes) -> str:
    return output.decode("utf-8", "replace")


def _fault(code: int, out: str, err: str) -> str:
    """Return what a finished probe showed, as a predicate; "" if the device works."""
    if code == 0:
        return "" if RIGHT in out.split() else "computes wrongly"
    said = ""
    lines = [line.strip() for line in err.splitlines() if line.strip()]
    for telling in (r"doesn't exist|cannot find|no such file", r"error", r""):
        hits = [line for line in lines if re.search(telling, line, re.IGNORECASE)]
        if hits:
            said = one_line(re.sub(r"^(fatal )?error: ", "", hits[0]))
            break
    if code > 0:
        return f"fails at its first kernel ({said or f'exit code {code}'})"
    import signal

    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"crashes at its first kernel ({name}{': ' + said if said else ''})"


_NARROWER = {16: 8, 8: 4, 4: 1}  # number of lanes: the next one to try where a device fails


def tried_out(info: DeviceInfo, trial: bytes = b"", *, started: Probe | None = None) -> DeviceInfo:
    """Test the device, and where its own number of lanes does not work, with fewer; return what was found.

    trial: see `Probe.finish`. started: the first test, if it is under way.
    """
    first, probe = "", started or Probe(info)
    while True:
        problem = probe.finish(trial)
        first, lanes = first or problem, _NARROWER.get(probe.lanes, 0)
        if not problem:
            fewer = f"{first}; it works, but takes longer, with {probe.lanes} instead of more lanes" if first else ""
            return replace(info, works=True, problem="", lanes=probe.lanes, narrowed=fewer)
        if not lanes:
            return replace(info, works=False, problem=first)
        probe = Probe(info, lanes)


# Verdicts: one file per device and state of the system


def _verdict_file(info: DeviceInfo) -> Path:
    spec = importlib.util.find_spec("pyopencl")
    package = os.path.dirname(spec.origin) if spec is not None and spec.origin else ""
    identity = [VERDICT_VERSION, info.platform, info.platform_version, info.name, info.version, info.driver, package]
    text = json.dumps([*identity, environment.fingerprint(package)])
    return environment.cache_root() / "verdicts" / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.json"


def remember(info: DeviceInfo, problem: str, lanes: int = 0) -> None:
    """Store a verdict on disk; if that fails, the device is tested again next time. lanes: with which it was tested, 0 if
    that is not known."""
    file = _verdict_file(info)
    with contextlib.suppress(OSError, OutputError):
        if not file.parent.is_dir():
            file.parent.unlink(missing_ok=True)
            file.parent.mkdir()
        if file.is_dir():
            shutil.rmtree(file)
        atomic_files.write_bytes(file, json.dumps({"device": str(info), "problem": problem, "lanes": lanes}).encode())


class Verdict(NamedTuple):
    """Whether the device works, and the number of lanes with which it was tested, 0 if that is not known."""

    works: bool
    lanes: int


def recall(info: DeviceInfo) -> Verdict | None:
    """Return the remembered verdict; None if there is none. A device that did not work is always tested again before it is
    refused; the verdict only determines the order."""
    try:
        file = _verdict_file(info)
        found = json.loads(file.read_text())
        verdict = Verdict(found["problem"] == "", int(found["lanes"]))
        if not verdict.works and file.stat().st_mtime < time.time() - BROKEN_SECONDS:
            return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return verdict
