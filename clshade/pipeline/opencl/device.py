"""Finding, testing and opening an OpenCL device."""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...base import console
from ...errors import DeviceError, InputError
from . import environment, probe
from .probe import NOT_TRIED, RUNTIMES, DeviceInfo, device_fault, install_advice, is_runtime, one_line, recall


@dataclass(frozen=True, eq=False, kw_only=True)
class Device(DeviceInfo):
    """An open device. lanes: pixels that a work-item processes together: as many as a CPU's vectors have float32 numbers, 1
    on a GPU and where the runtime vectorizes work-items."""

    device: Any  # pyopencl's
    context: Any
    queue: Any  # in-order, with events that carry times
    max_allocation: int  # bytes per buffer
    setup_run: int  # faces that a work-item of the setup kernel processes in sequence
    keeps_programs: bool  # whether the runtime finds programs that it has built before by their source

    __eq__, __hash__ = object.__eq__, object.__hash__


# Finding


def found_devices(name: str) -> list[DeviceInfo]:
    """Return every device found, in the order of the ICD loader."""
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
    infos: list[DeviceInfo] = []
    try:
        platforms = cl.get_platforms()
    except cl.Error:  # the ICD loader has none
        return infos
    for p, runtime in enumerate(platforms):
        try:
            devices = runtime.get_devices()
        except cl.Error:
            continue
        infos += [
            DeviceInfo(
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
            for d, device in enumerate(devices)
        ]
    return infos


def candidates(infos: Sequence[DeviceInfo], name: str) -> list[DeviceInfo]:
    """Return the devices that `name` can mean, best first.

    name: "P:D"; or, in any case, part of a platform's name or a word of RUNTIMES; or else part of a device's name.
        Every runtime's device on an Intel CPU is called Intel: words of RUNTIMES are not looked for in CPUs' names.
        "" means any.
    """
    word = name.strip().lower()
    if re.fullmatch(r"\d+\s*:\s*\d+", word):
        p, d = (int(part) for part in word.split(":"))
        return [info for info in infos if info.index == f"{p}:{d}"]
    if word in RUNTIMES:
        chosen = [info for info in infos if is_runtime(info, word)]
        chosen = chosen or [info for info in infos if not info.is_cpu and word in info.name.lower()]
    else:
        chosen = [info for info in infos if word in info.platform.lower()]
        chosen = chosen or [info for info in infos if word in info.name.lower()]

    def rank(info: DeviceInfo) -> int:  # PoCL's CPU, the rest of PoCL, Intel's CPU runtime, any other; emulators last
        if any(word in info.platform.lower() for word in ("fpga", "oclgrind")):
            return 4
        if is_runtime(info, "pocl"):
            return 0 if info.is_cpu else 1
        return 2 if is_runtime(info, "intel") and info.is_cpu else 3

    return sorted(chosen, key=rank)


def open_untested(index: str, name: str, lanes: int = 0) -> Device:
    """Open a device that another process found under this index, as one that tests it does. lanes: 0 for its own number."""
    for info in found_devices(name):
        if info.index == index and info.name == name:
            return _connect(replace(info, lanes=lanes))
    raise RuntimeError(f"{name!r} is not found at {index}")


# Opening


def chosen_devices(name: str | None) -> list[DeviceInfo]:
    """Return the devices that `name` can mean, best first. Raises DeviceError if there is none."""
    name = named(name)
    infos = found_devices(name)
    if not infos:
        is_set = environment.is_users("OCL_ICD_VENDORS")
        hint = f" (OCL_ICD_VENDORS is {os.environ['OCL_ICD_VENDORS']})" if is_set else ""
        raise DeviceError(f"no OpenCL device found{hint}: install {install_advice()}")
    chosen = candidates(infos, name)
    if not chosen:
        hint = f"; for Intel's CPU runtime {probe.GET_INTEL}" if name.lower() == "intel" else ""
        raise DeviceError(f"no OpenCL device matches {name!r}; found: {', '.join(map(str, infos))}{hint}")
    return chosen


def named(name: str | None) -> str:
    """Return the name that `open_device` is given, or the environment's."""
    return (os.environ.get("CLSHADE_DEVICE", "") if name is None else name).strip()


def open_device(name: str | None = None, *, trial: Callable[[], bytes] | None = None) -> Device:
    """Open a device that works; of several that the name can mean, the first that does.

    name: `pocl`, `intel`, `nvidia`, `amd`, `rusticl`, any part of a platform's name or else of a device's, or "P:D"
        (indices of platform and device). None: the environment's CLSHADE_DEVICE, or else PoCL, Intel, any.
    trial: returns what the device is tested with, the first time on a machine: see `probe.tried_out`.

    Raises DeviceError, with one line that says what to install or change, if there is none.
    """
    chosen = chosen_devices(name)
    problems = {}
    for info in sorted(map(recall, chosen), key=lambda info: info.problem not in ("", NOT_TRIED)):
        if not info.works and probe.can_probe():
            with environment.guard, console.told_when_slow(f"trying out {info.title} ..."), console.compiling():
                info = probe.tried_out(info, trial() if trial is not None else b"")
            if not info.works:
                problems[info.index] = info.problem
                continue
            if info.narrowed:
                console.warning(info.narrowed)
        try:
            return _connect(info)
        except DeviceError as error:
            problems[info.index] = str(error)
    others = f" ({len(problems) - 1} more broken: see `python -m clshade devices`)" if len(problems) > 1 else ""
    raise DeviceError(problems[chosen[0].index] + others)


_shared: dict[tuple[int, str], Device] = {}


def shared_device(name: str | None = None, *, trial: Callable[[], bytes] | None = None) -> Device:
    """Open a device as `open_device` does, but once per process, so that programs built for it are found again."""
    if not isinstance(name, str | None):
        expected = "a Device, a name such as pocl or 0:0, or None"
        raise InputError(f"render: device: expected {expected}, found {one_line(repr(name))}")
    key = (os.getpid(), named(name))
    with environment.guard:
        if key not in _shared:
            start = time.perf_counter()
            _shared[key] = device = open_device(name, trial=trial)
            probe.end_all()  # of devices that another process has tested meanwhile, or that come later
            console.detail(f"opened {device.title}, {(time.perf_counter() - start) * 1e3:.0f} ms")
        return _shared[key]


def try_out_soon(name: str | None = None) -> None:
    """Begin the test of the device that `open_device` will try first, if it has not been tested: its process imports and
    compiles while this one loads a scene. Errors are left to `open_device`."""
    with environment.guard, contextlib.suppress(DeviceError):
        info, *_ = chosen_devices(name)
        if recall(info).problem == NOT_TRIED and probe.can_probe():
            probe.start(info)


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


def _connect(info: DeviceInfo) -> Device:
    import pyopencl as cl

    platform, number = map(int, info.index.split(":"))
    try:
        handle = cl.get_platforms()[platform].get_devices()[number]
        context = cl.Context([handle])
        queue = cl.CommandQueue(context, handle, properties=cl.command_queue_properties.PROFILING_ENABLE)
    except cl.Error as error:
        raise DeviceError(device_fault(info, f"cannot be opened ({one_line(str(error))})")) from None
    return Device(
        **vars(replace(info, lanes=info.lanes or _own_lanes(info, context, handle))),
        device=handle,
        context=context,
        queue=queue,
        max_allocation=handle.max_mem_alloc_size,
        setup_run=256 if info.is_cpu else 1,
        keeps_programs=is_runtime(info, "pocl"),
    )


def list_devices() -> list[DeviceInfo]:
    """Return every device found, all tested afresh in parallel. Raises DeviceError if pyopencl cannot be imported."""
    infos = found_devices("")
    if not probe.can_probe():
        return infos
    with environment.guard:
        for info in infos:
            probe.start(info, waits=False)
        return [probe.tried_out(info) for info in infos]


def format_devices(infos: Sequence[DeviceInfo]) -> str:
    """Format for the terminal what was found, what works, and what to install if nothing does."""
    lines = [] if infos else ["No OpenCL device was found."]
    usable = [info for info in infos if info.works]
    default = next(iter(candidates(usable, os.environ.get("CLSHADE_DEVICE", ""))), None)
    for info in infos:
        kind = "CPU" if info.is_cpu else "GPU"
        units = f"{info.compute_units} compute unit{'s' if info.compute_units != 1 else ''}"
        fp64 = "float64" if info.has_fp64 else "no float64"
        lines.append(f"{info.index}  {info.title}")
        lines.append(f"     {kind}, {units}, {info.memory / 2**30:.1f} GiB, {fp64}, driver {info.driver}")
        lanes = f" with {info.lanes} lanes" if info.lanes > 1 else ""
        state = f"works{lanes}{', the default' if info is default else ''}"
        lines.append(f"     {state if info.works else 'does not work: ' + info.problem.removeprefix(f'{info} ')}")
        if info.narrowed:
            lines.append(f"     {info.narrowed.removeprefix(f'{info} ')}")
    choose = "Choose one with --device or CLSHADE_DEVICE: its indices, or any part of its platform's name."
    return "\n".join([*lines, choose if usable else f"To get one: {install_advice()}."])
