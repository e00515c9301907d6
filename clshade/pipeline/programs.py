"""OpenCL programs: sources flattened into one text, built once per device and set of compiled features, and cached."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..base import console
from ..base.atomic_files import write_bytes
from ..errors import ClshadeError, DeviceError
from . import layer_outputs, surface_inputs
from .features import Features, bit_definitions
from .kernel_files import kernel_folder
from .opencl import cache_sharing, environment
from .opencl.device import Device
from .struct_layout import header

# Correctly rounded division and square root if the device offers them; every source turns contraction off by a pragma.
_EXACT = "-cl-fp32-correctly-rounded-divide-sqrt"
# PoCL 3.0, PyPI's, optimizes twice: when it builds a program, and at its first launch. With these options building takes 2/3
# of the time, the first launch 4/5, and frames as long as before. PoCL checks options word by word, and clang splits them at
# any white space: a macro that nobody reads brings them through.
_LESS_OPTIMIZED = "-DLESS_OPTIMIZED\t-O1\t-fno-unroll-loops"
QUICK = "CLSHADE_QUICK_BUILD"  # environment variable: if set, kernels are not optimized; the bits are the same
_COMMENT = re.compile(r"//.*|/\*.*?\*/")
_SCALARS = {"int": np.int32, "float": np.float32, "ulong": np.uint64}
_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"', re.MULTILINE)


def _put_in(text: str, name: str, seen: set[str], parts: list[str]) -> None:
    """Append the lines of a source called `name`; each kernel file is inserted at its first #include only."""
    parts.append(f'#line 1 "{name}"')
    for number, line in enumerate(text.splitlines(), 2):
        match = _INCLUDE.match(line)
        if match is None:
            parts.append(line)
            continue
        if match[1] not in seen:
            seen.add(match[1])
            _put_in((kernel_folder() / match[1]).read_text(), match[1], seen, parts)
        parts.append(f'#line {number} "{name}"')


@cache
def flatten(names: tuple[str, ...]) -> str:
    """Return the named kernel files as one text, each include inserted once; #line keeps compiler messages accurate."""
    return flatten_text("\n".join(f'#include "{name}"' for name in names))


def flatten_text(text: str, name: str = "text") -> str:
    """Flatten a source that is not a file; `name` is its name in compiler messages."""
    parts: list[str] = []
    _put_in(text, name, set(), parts)
    return "\n".join(parts) + "\n"


@dataclass
class Program:
    """A built program. kernels: by name. seconds: the time to build it, or to load it if it was `stored` by us or by the
    runtime. warnings: the lines of the build log in which the compiler warns.

    source: its text. lock: held while a kernel's arguments are set and it is launched. arguments: those of each kernel that
    were set last. launched: identifies the code of each launch that has completed (`Stages.run`).
    """

    features: Features
    lanes: int
    seconds: float
    kernels: dict[str, Any]
    stored: bool = False
    warnings: tuple[str, ...] = ()
    source: str = ""
    lock: threading.Lock = field(default_factory=threading.Lock)
    arguments: dict[str, tuple[Any, ...]] = field(default_factory=dict)
    launched: set[tuple[Any, ...]] = field(default_factory=set)
    _parameters: dict[str, dict[str, Any]] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Any:
        return self.kernels[name]

    def parameters(self, name: str) -> dict[str, Any]:
        """Return the NumPy types of a kernel's parameters by their names, in order; None for pointers."""
        if name not in self._parameters:
            declared = re.split(rf"\bkernel void {name}\(", self.source)[1].split("{")[0]
            real = np.float64 if self.features["DOUBLE"] else np.float32
            self._parameters[name] = dict(self._declared(declared, {**_SCALARS, "real": real}))
        return self._parameters[name]

    def _declared(self, text: str, types: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
        """Yield the names of parameters, and their types, from OpenCL C that declares them."""
        for each in _COMMENT.sub("", text).split(","):
            *kind, name = re.findall(r"\w+|\*", each)
            if kind:
                yield name, None if "*" in kind else types[kind[-1]]
            elif name == "SURFACE_PARAMETERS":  # declared under conditions
                casters, instances = (bool(self.features[each]) for each in ("CASTERS", "INSTANCES"))
                yield from dict.fromkeys(surface_inputs.parameters(casters=casters, instances=instances)).items()
            else:
                macro = re.search(rf"#define {name}\b((?:.*\\\n)*.*)", self.source)
                assert macro is not None, name
                yield from self._declared(macro[1], types)


Rewriting = Callable[[str, Sequence[str]], "str | None"]


@contextlib.contextmanager
def rewriting(rewrite: Rewriting) -> Iterator[None]:
    """Change the sources of the programs that this thread builds in a block.

    rewrite: is given a source and the compiler's options, and returns another source, or None to leave this one.
    """
    _own.rewriting = rewrite
    try:
        yield
    finally:
        del _own.rewriting


SLOW = 0.5  # seconds of compiling before a message
LOADED = 0.02  # seconds within which a runtime finds what it has compiled earlier

_own = threading.local()
_said = False


def waited() -> float:
    """Return the seconds this thread has waited so far for programs to be compiled or loaded."""
    return getattr(_own, "waited", 0.0)


def running_time() -> float:
    """Return this thread's running time in seconds, without what `waited` returns."""
    return time.perf_counter() - waited()


@dataclass
class FirstUse:
    """Timing of a block. ran: seconds of it that were not spent waiting for a compiler."""

    ran: float = 0.0


@contextlib.contextmanager
def first_use(device: Device, *, stored: bool) -> Iterator[FirstUse]:
    """Guard a block in which the runtime compiles a program or a kernel, or loads one that it has kept (`stored`, as
    far as we know), until it has run: time it, print a message if it takes long, and protect the cache."""
    slot = environment.prepare()
    use, start = FirstUse(), time.perf_counter()
    timer = None if stored or _said else threading.Timer(max(SLOW - waited(), 0.0), _say, (device,))
    if timer is not None:
        timer.daemon = True
        timer.start()
    try:
        with slot.using(), contextlib.nullcontext() if stored else console.compiling():
            yield use
    finally:
        if timer is not None:
            timer.cancel()
        taken = time.perf_counter() - start - use.ran
        _own.waited = waited() + taken
    if taken > LOADED and slot.seal() and taken > SLOW:
        _say(device)  # it was thought to be stored


def _say(device: Device) -> None:
    global _said
    if not _said:
        _said = True
        console.progress(f"compiling kernels for {device.title} ...")


_built: dict[tuple[Any, ...], Program] = {}


def built() -> tuple[Program, ...]:
    """Return all programs of this process, in the order in which they were built or loaded."""
    return tuple(_built.values())


def build(device: Device, features: Features, files: tuple[str, ...], *, lanes: int | None = None) -> Program:
    """Return the program of `files` for this device and what of `features` is compiled; built at most once per process.

    lanes: 1, 4, 8 or 16 pixels processed together; None: what suits the device.
    Raises DeviceError with the compiler's first error.
    """
    return _build(device, features, flatten(files), lanes or device.lanes)


def build_text(device: Device, features: Features, text: str, *, lanes: int | None = None) -> Program:
    """Build a program from the caller's OpenCL C, whose `#include`s name kernel files: a few lines reach any device
    function."""
    return _build(device, features, flatten_text(text), lanes or device.lanes)


def declarations(*, double_reals: bool = False, with_double: bool = True) -> str:
    """Return OpenCL C that the host puts before a program's files: structs, constants, features, arguments, layers."""
    structs = header(double_reals=double_reals, with_double=with_double)
    return structs + bit_definitions() + surface_inputs.macros() + layer_outputs.macros()


def _build(device: Device, features: Features, flat: str, lanes: int) -> Program:
    import pyopencl as cl

    double = bool(features["DOUBLE"])
    if double and not device.has_fp64:
        raise DeviceError(f"{device.name}: expected a device with float64 for precision float64, found one without")
    features = features.compiled()
    source = f"#pragma OPENCL FP_CONTRACT OFF\n{declarations(double_reals=double, with_double=device.has_fp64)}{flat}"
    options = [*features.options(), f"-DLANES={lanes}", f"-DSETUP_RUN={device.setup_run}", *compiler_options(device)]
    source = _rewritten(source, options) or source
    key = (device.context.int_ptr, features, source, lanes, len(options))
    if key not in _built:
        start = time.perf_counter()
        path = _stored_at(device, source, options)
        slot = environment.prepare()
        stored = path.exists() or cache_sharing.take_over(slot, f"{path.parent.name}/{path.name}")
        before = set() if stored or not device.keeps_programs else cache_sharing.runtime_folders(slot)
        with first_use(device, stored=stored):
            program = _load(device, path) if stored and not device.keeps_programs else None
            stored = stored and (device.keeps_programs or program is not None)
            if stored:
                with contextlib.suppress(OSError):
                    os.utime(path)  # the cache loses what was not used for longest
            if program is None:
                try:
                    program = _without_log(cl.Program(device.context, source), options)
                except cl.RuntimeError as error:
                    raise _build_error(device, error) from error
            kernels = {kernel.function_name: kernel for kernel in program.all_kernels()}
        if not kernels:
            cache = os.environ.get("POCL_CACHE_DIR", "")
            raise DeviceError(f"{device.name}: a program has no kernels: empty the kernel cache {cache}".rstrip())
        if not stored:
            kept = cache_sharing.runtime_folders(slot) - before if device.keeps_programs else ()
            _store(cache_sharing.note(kept) if device.keeps_programs else program.binaries[0], path)
        warned = _warnings(device, program)
        for line in warned:
            console.detail(f"the compiler warns: {line}")
        taken = time.perf_counter() - start
        _built[key] = Program(features, lanes, taken, kernels, stored, warned, source)
        console.detail(
            f"{'loaded' if stored else 'compiled'} a program of {len(kernels)} kernels, {taken * 1e3:.0f} ms"
        )
    return _built[key]


def _build_error(device: Device, error: Exception) -> DeviceError:
    lines = [line for line in str(error).splitlines() if "error" in line.lower()]
    if not lines:
        cache = os.environ.get("POCL_CACHE_DIR", "")
        reason = environment.fault(Path(cache)) if device.keeps_programs else ""
        lines = [f"POCL_CACHE_DIR, {cache}: {reason}" if reason else "no message from its compiler"]
    return DeviceError(f"{device.name}: the kernels did not build: {lines[0]}")


def compiler_options(device: Device) -> list[str]:
    """Return the options of every build: the language, correctly rounded division and square root where there are, and how
    much is optimized."""
    import pyopencl as cl

    exact = device.device.single_fp_config & cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT
    options = ["-cl-std=CL1.2", *([_EXACT] if exact else [])]
    if os.environ.get(QUICK):
        return [*options, "-cl-opt-disable"]
    return [*options, _LESS_OPTIMIZED] if device.keeps_programs and device.driver.startswith("3.0") else options


def _rewritten(source: str, options: Sequence[str]) -> str | None:
    """Return what `rewriting` makes of a source in this thread; None if it leaves it."""
    rewrite: Rewriting | None = getattr(_own, "rewriting", None)
    return rewrite(source, options) if rewrite else None


def build_alone(device: Device, text: str, options: Sequence[str] = ()) -> dict[str, Any]:
    """Build a text as it stands, with further options, and return its kernels by name: nothing is put before it, and none of
    our caches is used. Raises DeviceError with the compiler's first error."""
    import pyopencl as cl

    options = [*options, *compiler_options(device)]
    try:
        program = _without_log(cl.Program(device.context, _rewritten(text, options) or text), options)
        return {kernel.function_name: kernel for kernel in program.all_kernels()}
    except cl.Error as error:
        raise _build_error(device, error) from error


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


# Built programs are kept in this process's cache folder: loading one skips the compiler's front end. If the runtime has a
# cache of its own, a file notes where in it the program is: PoCL, asked for a binary, would recompile all kernels.


def _stored_at(device: Device, source: str, options: list[str]) -> Path:
    own = os.fspath(environment.prepare().pocl)
    where = os.environ.get("POCL_CACHE_DIR", "").replace(own, "") if device.keeps_programs else ""
    parts = (source, *options, device.platform, device.name, device.version, device.driver, where)
    name = hashlib.sha256("\0".join(parts).encode("utf-8", "surrogatepass")).hexdigest()
    return environment.prepare().folder / "binaries" / name


def _load(device: Device, path: Path) -> Any:
    """Load the stored program; None if there is no intact one that the device accepts."""
    import pyopencl as cl

    try:
        digest, binary = path.read_bytes().split(b"\n", 1)
        if hashlib.sha256(binary).hexdigest().encode() != digest:
            return None
        return _without_log(cl.Program(device.context, [device.device], [binary]))
    except (OSError, ValueError, cl.Error):
        return None


def _store(binary: bytes, path: Path) -> None:
    """Store a built program, or note that the runtime does. A cache that cannot be written only costs time."""
    with contextlib.suppress(OSError, ClshadeError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, hashlib.sha256(binary).hexdigest().encode() + b"\n" + binary)
        environment.prepare().seal()
