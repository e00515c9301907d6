"""Finding, testing and opening an OpenCL device."""

from __future__ import annotations

import contextlib
import os
import re
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ...base import console
from ...errors import DeviceError, InputError
from . import environment
from .probe import (
    GET_INTEL,
    RUNTIMES,
    DeviceInfo,
    Probe,
    can_probe,
    device_fault,
    install_advice,
    is_runtime,
    one_line,
    recall,
    tried_out,
)


@dataclass(frozen=True, eq=False)
class Device:
    """An open device.

    device, context, queue: pyopencl's objects; the queue is in-order.
    version: the device's OpenCL version text. driver: its driver's version.
    lanes: pixels that a work-item processes together: as many as a CPU's vectors have float32 numbers, 1 on a GPU and
        where the runtime vectorizes work-items.
    memory, max_allocation: bytes, in total and per buffer.
    setup_run: faces that a work-item of the setup kernel processes in sequence.
    keeps_programs: whether the runtime finds programs that it has built before by their source.
    """

    device: Any
    context: Any
    queue: Any
    index: str
    platform: str
    name: str
    version: str
    driver: str
    is_cpu: bool
    has_fp64: bool
    lanes: int
    compute_units: int
    memory: int
    max_allocation: int
    setup_run: int
    keeps_programs: bool
    profiling: bool

    @property
    def title(self) -> str:
        """Platform and name."""
        return f"{self.platform}: {self.name}"


# Finding


def found_devices(name: str) -> list[tuple[DeviceInfo, Any]]:
    """Return every device found, with pyopencl's object, in the order of the ICD loader."""
    environment.prepare(name)
    try:
        import pyopencl as cl
    except ImportError as error:
        advice = f"install {install_advice()}"
        raise DeviceError(f"pyopencl cannot be imported ({one_line(str(error))}): {advice}") from None
    # pyopencl's caches lie outside of `programs`, are not checked for damage and not needed: `programs` has its own.
    if "PYOPENCL_NO_CACHE" not in os.environ:
        cl._PYOPENCL_NO_CACHE = True
    environment.starting()
    found: list[tuple[DeviceInfo, Any]] = []
    try:
        platforms = cl.get_platforms()
    except cl.Error:  # the ICD loader has none
        return found
    for p, runtime in enumerate(platforms):
        try:
            devices = runtime.get_devices()
        except cl.Error:
            continue
        for d, device in enumerate(devices):
            info = DeviceInfo(
                index=f"{p}:{d}",
                platform=runtime.name.strip(),
                name=device.name.strip(),
                platform_version=runtime.version.strip(),
                version=device.version.strip(),
                driver=device.driver_version.strip(),
                is_cpu=bool(device.type & cl.device_type.CPU),
                has_fp64="cl_khr_fp64" in device.extensions.split(),
                compute_units=device.max_compute_units,
                memory=device.global_mem_size,
            )
            found.append((info, device))
    return found


def _rank(info: DeviceInfo) -> int:
    """Return the rank of preference: PoCL's CPU, the rest of PoCL, Intel's CPU runtime, any other; emulators last."""
    if any(word in info.platform.lower() for word in ("fpga", "oclgrind")):
        return 4
    if is_runtime(info, "pocl"):
        return 0 if info.is_cpu else 1
    return 2 if is_runtime(info, "intel") and info.is_cpu else 3


def candidates(found: Sequence[DeviceInfo], name: str) -> list[DeviceInfo]:
    """Return the devices that `name` can mean, best first.

    name: "P:D"; or, in any case, part of a platform's name or a word of RUNTIMES; or else part of a device's name.
        Every runtime's device on an Intel CPU is called Intel: words of RUNTIMES are not looked for in CPUs' names.
        "" means any.
    """
    word = name.strip().lower()
    if re.fullmatch(r"\d+\s*:\s*\d+", word):
        p, d = (int(part) for part in word.split(":"))
        return [info for info in found if info.index == f"{p}:{d}"]
    if word in RUNTIMES:
        chosen = [info for info in found if is_runtime(info, word)]
        chosen = chosen or [info for info in found if not info.is_cpu and word in info.name.lower()]
    else:
        chosen = [info for info in found if word in info.platform.lower()]
        chosen = chosen or [info for info in found if word in info.name.lower()]
    return sorted(chosen, key=_rank)


def open_untested(index: str, name: str, lanes: int = 0) -> Device:
    """Open a device that another process found under this index, as one that tests it does. lanes: 0 for its own number."""
    for info, handle in found_devices(name):
        if info.index == index and info.name == name:
            return _connect(info, handle, False, lanes)
    raise RuntimeError(f"{name!r} is not found at {index}")


# Opening


def chosen_devices(name: str | None = None) -> tuple[dict[DeviceInfo, Any], list[DeviceInfo]]:
    """Return pyopencl's objects of all devices found, and the devices that `name` can mean, best first: see `open_device`.

    Raises DeviceError if there is none.
    """
    name = (os.environ.get("CLSHADE_DEVICE", "") if name is None else name).strip()
    handles = dict(found_devices(name))
    if not handles:
        is_set = environment.is_users("OCL_ICD_VENDORS")
        hint = f" (OCL_ICD_VENDORS is {os.environ['OCL_ICD_VENDORS']})" if is_set else ""
        raise DeviceError(f"no OpenCL device found{hint}: install {install_advice()}")
    chosen = candidates(list(handles), name)
    if not chosen:
        hint = f"; for Intel's CPU runtime {GET_INTEL}" if name.lower() == "intel" else ""
        raise DeviceError(f"no OpenCL device matches {name!r}; found: {', '.join(map(str, handles))}{hint}")
    return handles, chosen


def open_device(
    name: str | None = None, *, profiling: bool = False, trial: Callable[[], bytes] | None = None
) -> Device:
    """Open a device that works; of several that the name can mean, the first that does.

    name: `pocl`, `intel`, `nvidia`, `amd`, `rusticl`, any part of a platform's name or else of a device's, or "P:D"
        (indices of platform and device). None: the environment's CLSHADE_DEVICE, or else PoCL, Intel, any.
    profiling: whether the queue's events carry times.
    trial: returns what the device is tested with, the first time on a machine: see `probe.tried_out`.

    Raises DeviceError, with one line that says what to install or change, if there is none.
    """
    handles, chosen = chosen_devices(name)
    problems = {}
    verdicts = {info: recall(info) for info in chosen}
    for info in sorted(chosen, key=lambda info: (verdict := verdicts[info]) is not None and not verdict.works):
        verdict = verdicts[info]
        try:
            if (verdict is not None and verdict.works) or not can_probe():
                return _connect(info, handles[info], profiling, verdict.lanes if verdict is not None else 0)
            return _try_out(info, handles[info], profiling, trial)
        except _Broken as error:
            problems[info] = str(error)
    others = f" ({len(problems) - 1} more broken: see `python -m clshade devices`)" if len(problems) > 1 else ""
    raise DeviceError(problems[chosen[0]] + others)


_shared: dict[tuple[int, str, bool], Device] = {}
_started: dict[str, Probe] = {}  # tests that `try_out_soon` began, by the indices of their devices
_opening = threading.Lock()


def _forget() -> None:
    """In a forked child: a thread of the parent may have held the lock."""
    global _opening
    _opening = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def shared_device(
    name: str | None = None, *, profiling: bool = False, trial: Callable[[], bytes] | None = None
) -> Device:
    """Open a device as `open_device` does, but once per process, so that programs built for it are found again."""
    if not isinstance(name, str | None):
        expected = "a Device, a name such as pocl or 0:0, or None"
        raise InputError(f"render: device: expected {expected}, found {one_line(repr(name))}")
    asked = (os.environ.get("CLSHADE_DEVICE", "") if name is None else name).strip()
    key = (os.getpid(), asked, profiling)
    with _opening:
        if key not in _shared:
            start = time.perf_counter()
            _shared[key] = device = open_device(asked, profiling=profiling, trial=trial)
            while _started:  # of a device that another process has tested meanwhile
                _started.popitem()[1].abandon()
            console.detail(f"opened {device.platform}: {device.name}, {(time.perf_counter() - start) * 1e3:.0f} ms")
        return _shared[key]


def try_out_soon(name: str | None = None) -> None:
    """Begin the test of the device that `open_device` will try first, if it has not been tested: its process imports and
    compiles while this one loads a scene. Errors are left to `open_device`."""
    with _opening, contextlib.suppress(DeviceError):
        _, (info, *_) = chosen_devices(name)
        if recall(info) is None and can_probe():
            _started[info.index] = Probe(info)


class _Broken(DeviceError):
    """A device that does not work; another one may."""


def _try_out(info: DeviceInfo, handle: Any, profiling: bool, trial: Callable[[], bytes] | None) -> Device:
    """Open the device after a test; where its own number of lanes does not work, with fewer."""
    with console.told_when_slow(f"trying out {info.platform}: {info.name} ..."), console.compiling():
        found = tried_out(info, trial() if trial is not None else b"", started=_started.pop(info.index, None))
    if not found.works:
        raise _Broken(found.problem)
    if found.narrowed:
        console.warning(found.narrowed)
    return _connect(info, handle, profiling, found.lanes)


# Its kernel's name says how many float32 numbers the vectors of the processor have that the runtime compiles for.
_WIDTH = """
#if defined(__AVX512F__)
kernel void lanes_16(void) {}
#elif defined(__AVX__)
kernel void lanes_8(void) {}
#elif defined(__SSE2__) || defined(__ARM_NEON)
kernel void lanes_4(void) {}
#else
kernel void lanes_of_device(void) {}
#endif
"""


def _own_lanes(info: DeviceInfo, context: Any, handle: Any) -> int:
    """Return the device's own number of lanes: for a CPU what its compiler's macros say, or else the device itself."""
    import pyopencl as cl

    if not info.is_cpu or is_runtime(info, "rusticl"):  # Mesa vectorizes work-items itself
        return 1
    name = cl.Program(context, _WIDTH).build().all_kernels()[0].function_name
    if name != "lanes_of_device":
        return int(name.removeprefix("lanes_"))
    return handle.native_vector_width_float if handle.native_vector_width_float in (4, 8, 16) else 16


def _connect(info: DeviceInfo, handle: Any, profiling: bool, lanes: int = 0) -> Device:
    import pyopencl as cl

    try:
        context = cl.Context([handle])
        options = {"properties": cl.command_queue_properties.PROFILING_ENABLE} if profiling else {}
        queue = cl.CommandQueue(context, handle, **options)
    except cl.Error as error:
        raise _Broken(device_fault(info, f"cannot be opened ({one_line(str(error))})")) from None
    return Device(
        device=handle,
        context=context,
        queue=queue,
        index=info.index,
        platform=info.platform,
        name=info.name,
        version=handle.version.strip(),
        driver=info.driver,
        is_cpu=info.is_cpu,
        has_fp64=info.has_fp64,
        lanes=lanes or _own_lanes(info, context, handle),
        compute_units=info.compute_units,
        memory=info.memory,
        max_allocation=handle.max_mem_alloc_size,
        setup_run=256 if info.is_cpu else 1,
        keeps_programs=is_runtime(info, "pocl"),
        profiling=profiling,
    )


def list_devices() -> list[DeviceInfo]:
    """Return every device found, all tested afresh in parallel: `works` and `problem` are filled in. Empty if there is none.

    Raises DeviceError if pyopencl cannot be imported.
    """
    found = [info for info, _ in found_devices("")]
    if not can_probe():
        return found
    probes = [Probe(info, waits=False) for info in found]
    return [tried_out(info, started=probe) for info, probe in zip(found, probes, strict=True)]


def format_devices(infos: Sequence[DeviceInfo]) -> str:
    """Format for the terminal what was found, what works, and what to install if nothing does."""
    lines = [] if infos else ["No OpenCL device was found."]
    usable = [info for info in infos if info.works]
    default = next(iter(candidates(usable, os.environ.get("CLSHADE_DEVICE", ""))), None)
    for info in infos:
        kind = "CPU" if info.is_cpu else "GPU"
        units = f"{info.compute_units} compute unit{'s' if info.compute_units != 1 else ''}"
        fp64 = "float64" if info.has_fp64 else "no float64"
        lines.append(f"{info.index}  {info.platform}: {info.name}")
        lines.append(f"     {kind}, {units}, {info.memory / 2**30:.1f} GiB, {fp64}, driver {info.driver}")
        lanes = f" with {info.lanes} lanes" if info.lanes > 1 else ""
        state = f"works{lanes}{', the default' if info is default else ''}"
        lines.append(f"     {state if info.works else 'does not work: ' + info.problem.removeprefix(f'{info} ')}")
        if info.narrowed:
            lines.append(f"     {info.narrowed.removeprefix(f'{info} ')}")
    if not usable:
        lines.append(f"To get one: {install_advice()}.")
    else:
        lines.append("Choose one with --device or CLSHADE_DEVICE: its indices, or any part of its platform's name.")
    return "\n".join(lines)
