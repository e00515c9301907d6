"""OpenCL programs: sources flattened into one text, built once per device and set of compiled features, and cached."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import threading
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..base import console
from ..errors import DeviceError
from . import struct_layout
from .features import Features, bit_definitions
from .opencl import environment, program_store
from .opencl.device import Device
from .opencl.program_store import BINARY, StoredProgram
from .struct_layout import header, kernel_text

# Correctly rounded division and square root if the device offers them; every source turns contraction off by a pragma.
_EXACT = "-cl-fp32-correctly-rounded-divide-sqrt"
# PoCL 3.0, PyPI's, optimizes twice: when it builds a program, and at its first launch. With these options building takes 2/3
# of the time, the first launch 4/5, and frames as long as before. PoCL checks options word by word, and clang splits them at
# any white space: a macro that nobody reads brings them through.
_LESS_OPTIMIZED = "-DLESS_OPTIMIZED\t-O1\t-fno-unroll-loops"
QUICK = "CLSHADE_QUICK_BUILD"  # environment variable: if set, kernels are not optimized; the bits are the same
SLOW = 0.5  # seconds of compiling before a message
_COMMENT = re.compile(r"//.*|/\*.*?\*/")
_SCALARS = {"int": np.int32, "float": np.float32, "ulong": np.uint64}
_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"', re.MULTILINE)


@cache
def flatten(names: tuple[str, ...]) -> str:
    """Return the named kernel files as one text, each include inserted once; #line keeps compiler messages accurate."""
    return flatten_text("\n".join(f'#include "{name}"' for name in names))


def flatten_text(text: str, name: str = "text", seen: set[str] | None = None) -> str:
    """Flatten a source that is not a file; `name` is its name in compiler messages. seen: files that are in."""
    lines, seen = [f'#line 1 "{name}"'], set() if seen is None else seen
    for number, line in enumerate(text.splitlines(), 2):
        included = _INCLUDE.match(line)
        if included is None:
            lines.append(line)
            continue
        if included[1] not in seen:
            seen.add(included[1])
            lines.append(flatten_text(kernel_text(included[1]), included[1], seen).removesuffix("\n"))
        lines.append(f'#line {number} "{name}"')
    return "\n".join(lines) + "\n"


@dataclass
class Program:
    """A built program."""

    features: Features
    lanes: int
    kernels: dict[str, Any]  # by name
    loaded: bool  # from its copy on disk
    stored: StoredProgram  # that copy
    folder: Path | None  # PoCL's cache
    folders: set[Path]  # what of it belongs to the program
    warnings: tuple[str, ...]  # the lines of the build log in which the compiler warns
    source: str
    # held while arguments are set and a kernel is launched
    lock: threading.Lock = field(default_factory=threading.Lock)
    arguments: dict[str, tuple[Any, ...]] = field(default_factory=dict)  # by kernel, as they were set last
    launched: set[tuple[Any, ...]] = field(default_factory=set)  # the code of completed launches, see `Stages.run`
    _parameters: dict[str, dict[str, Any]] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Any:
        return self.kernels[name]

    def keep(self) -> None:
        """Store what PoCL has compiled of it."""
        with contextlib.suppress(OSError):
            if self.folder is not None and self.stored.path is not None:
                self.stored.write(program_store.pack(self.folder, self.folders, self.stored.names))

    def parameters(self, name: str) -> dict[str, Any]:
        """Return the NumPy types of a kernel's parameters by their names, in order; None for pointers."""
        if name not in self._parameters:
            declared = self.source.partition(f"kernel void {name}(")[2].partition("{")[0]
            real = np.float64 if self.features["DOUBLE"] else np.float32
            self._parameters[name] = dict(self._declared(declared, {**_SCALARS, "real": real}))
        return self._parameters[name]

    def _declared(self, text: str, types: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
        """Yield the names of parameters, and their types, from OpenCL C that declares them."""
        for parameter in _COMMENT.sub("", text).split(","):
            *kind, name = re.findall(r"\w+|\*", parameter)
            if kind:
                yield name, None if "*" in kind else types[kind[-1]]
            elif name == "SURFACE_PARAMETERS":  # declared under conditions
                conditions = [feature for feature in ("CASTERS", "INSTANCES") if self.features[feature]]
                yield from dict.fromkeys(struct_layout.surface_parameters(*conditions)).items()
            else:
                macro = re.search(rf"#define {name}\b((?:.*\\\n)*.*)", self.source)
                assert macro is not None, name
                yield from self._declared(macro[1], types)


class _Own(threading.local):
    """What concerns one thread. waited: seconds for programs to be compiled or loaded. is_first: it is in a block of
    `first_picture`. has_first: it has taken programs for a first picture."""

    waited = 0.0
    is_first = has_first = False


this_thread = _Own()
_said = False


@contextlib.contextmanager
def first_picture() -> Iterator[None]:
    """Within a block, let this thread build programs that compile fast where none is at hand: for what the scene and
    most others need, and without optimization. Compiling takes half the time, a frame many times as long; bits are equal."""
    this_thread.is_first = True
    try:
        yield
    finally:
        this_thread.is_first = False


def running_time() -> float:
    """Return this thread's running time in seconds, without the time that it waited for programs."""
    return time.perf_counter() - this_thread.waited


@contextlib.contextmanager
def first_use(device: Device, stored: StoredProgram | None) -> Iterator[None]:
    """Guard a block in which the runtime compiles a program or a kernel, or loads a `stored` one, until it has run: count it
    as waited, and print a message if compiling takes long."""
    start, timer = time.perf_counter(), threading.Timer(max(SLOW - this_thread.waited, 0.0), _say, (device,))
    timer.daemon = True
    if not (stored or _said):
        timer.start()
    try:
        with stored.first_use() if stored else console.compiling():
            yield
    finally:
        timer.cancel()
        this_thread.waited += time.perf_counter() - start


def _say(device: Device) -> None:
    global _said
    if not _said:
        _said = True
        console.progress(f"compiling kernels for {device.title} ...")


_built: dict[tuple[Any, ...], Program] = {}
_building = threading.RLock()  # what appears in PoCL's cache meanwhile belongs to one program


def built() -> tuple[Program, ...]:
    """Return all programs of this process, in the order in which they were built or loaded."""
    return tuple(_built.values())


def declarations(*, double_reals: bool = False, with_double: bool = True) -> str:
    """Return OpenCL C that the host puts before a program's files: structs, constants, features, arguments, layers."""
    structs = header(double_reals=double_reals, with_double=with_double)
    return structs + bit_definitions() + struct_layout.surface_macros() + struct_layout.layer_macros()


def build(
    device: Device,
    features: Features,
    source: tuple[str, ...] | str,
    *,
    lanes: int | None = None,
    stored: bool = True,
    needs: int | None = None,
) -> Program:
    """Return the program of `source` for this device and what of `features` is compiled; built at most once per process.

    source: names of kernel files; or OpenCL C, whose `#include`s name them: a few lines reach any device function. lanes: 1,
    4, 8 or 16 pixels processed together; None: what suits the device. stored: whether it may come from disk. needs: of a
    first picture, see `first_picture`. Raises DeviceError with the compiler's first error.
    """
    double, lanes = bool(features["DOUBLE"]), lanes or device.lanes
    if double and not device.has_fp64:
        raise DeviceError(f"{device.name}: expected a device with float64 for precision float64, found one without")
    features, flat = features.compiled(), flatten_text(source) if isinstance(source, str) else flatten(source)
    text = f"#pragma OPENCL FP_CONTRACT OFF\n{declarations(double_reals=double, with_double=device.has_fp64)}{flat}"
    lanes_of = f"-DLANES={lanes}", f"-DSETUP_RUN={device.setup_run}"
    options = [*features.options(), *lanes_of, *compiler_options(device)]
    with _building:
        key = device.context.int_ptr, text, *options
        hurried = None if os.environ.get(QUICK) else needs
        if hurried is not None and not (key in _built or _stored_program(device, text, options).exists()):
            options = [*features.options(hurried), *lanes_of, *compiler_options(device, quick=True)]
            this_thread.has_first = True
            key = device.context.int_ptr, text, *options
        if key not in _built:
            place = _stored_program(device, text, options) if stored else StoredProgram(None)
            _built[key] = _built_or_loaded(device, features, text, options, lanes, place)
    return _built[key]


def _stored_program(device: Device, text: str, options: list[str]) -> StoredProgram:
    """Return where a program is kept on disk: from there it skips the compiler's front end. PoCL would recompile all kernels
    of a binary, so the files of its own cache are stored."""
    parts = (text, *options, device.platform, device.name, device.version, device.driver)
    name = hashlib.sha256("\0".join(parts).encode("utf-8", "surrogatepass")).hexdigest()
    return StoredProgram(environment.cache_root() / "programs" / name)


def _built_or_loaded(
    device: Device, features: Features, text: str, options: list[str], lanes: int, stored: StoredProgram
) -> Program:
    import pyopencl as cl

    start = time.perf_counter()
    folder = environment.pocl_folder() if device.keeps_programs else None
    files, before = stored.read(), program_store.programs_in(folder)
    with contextlib.suppress(OSError):
        if folder is not None:
            program_store.unpack(files, folder)
    with first_use(device, stored if files else None):
        program = None
        if BINARY in files:
            with contextlib.suppress(ValueError, cl.Error):  # the device does not accept it
                program = _without_log(cl.Program(device.context, [device.device], [files[BINARY]]))
        program = program or compiled(device, text, options)
        kernels = {kernel.function_name: kernel for kernel in program.all_kernels()}
    if not kernels:
        raise DeviceError(f"{device.name}: a program has no kernels: empty the kernel cache {folder or ''}".rstrip())
    if not device.keeps_programs:
        stored.write({BINARY: program.binaries[0]})
    warned = _warnings(device, program)
    for line in warned:
        console.detail(f"the compiler warns: {line}")
    folders = program_store.programs_in(folder) - before
    if folder is not None:
        folders |= {folder.joinpath(*name.split("/")[:2]) for name in files}
    built = Program(features, lanes, kernels, bool(files), stored, folder, folders, warned, text)
    built.keep()
    build_ms = (time.perf_counter() - start) * 1e3
    console.detail(f"{'loaded' if files else 'compiled'} a program of {len(kernels)} kernels, {build_ms:.0f} ms")
    return built


def compiled(device: Device, text: str, options: list[str]) -> Any:
    """Compile a text as it stands, where the options for less optimization are refused without them, and return pyopencl's
    program. Raises DeviceError with the compiler's first error."""
    import pyopencl as cl

    try:
        return _without_log(cl.Program(device.context, text), options)
    except cl.Error as error:
        if _LESS_OPTIMIZED in options:
            return compiled(device, text, [option for option in options if option != _LESS_OPTIMIZED])
        lines = [line for line in str(error).splitlines() if "error" in line.lower()]
        folder = environment.pocl_folder()
        if not lines and device.keeps_programs and (reason := environment.fault(folder)):
            lines = [f"{folder}: {reason}"]
        message = lines[0] if lines else "no message from its compiler"
        raise DeviceError(f"{device.name}: the kernels did not build: {message}") from error


def compiler_options(device: Device, *, quick: bool = False) -> list[str]:
    """Return the options of every build: the language, correctly rounded division and square root where there are, and how
    much is optimized; quick: nothing."""
    import pyopencl as cl

    exact = device.device.single_fp_config & cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT
    options = ["-cl-std=CL1.2", *([_EXACT] if exact else [])]
    if quick or os.environ.get(QUICK):
        return [*options, "-cl-opt-disable"]
    return [*options, _LESS_OPTIMIZED] if device.keeps_programs and device.driver.startswith("3.0") else options


def _without_log(program: Any, options: Sequence[str] = ()) -> Any:
    """Build the program without the warnings that some runtimes emit at every build."""
    import pyopencl as cl

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cl.CompilerWarning)
        return program.build(list(options))


def _warnings(device: Device, program: Any) -> tuple[str, ...]:
    """Return the lines of the build log that warn; PoCL keeps the log with the program.

    NVIDIA's compiler marks every kernel `noinline` and then warns that it ignores this: such lines are left out.
    """
    import pyopencl as cl

    log = program.get_build_info(device.device, cl.program_build_info.LOG) or ""
    warned = (line.strip() for line in log.splitlines() if "warning:" in line.lower())
    return tuple(line for line in warned if "is a kernel, so overriding noinline attribute" not in line)
