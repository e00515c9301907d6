"""The environment that OpenCL needs before it starts: a folder of this process for PoCL's cache, all runtimes visible, and
the processor that PyPI's PoCL compiles for.

Nothing here imports pyopencl: its ICD loader and PoCL read the environment once, when OpenCL starts. `prepare` sets it
up, and leaves alone what the user has set but PoCL's cache. Environment variables set here are inherited by child processes;
each but that is noted in `CLSHADE_SET_<name>`, by which a child tells them from the user's own and replaces them.

PoCL 3.0 asks its LLVM, version 14 of 2022, for the processor's name. LLVM calls what it does not know `generic`, for which
clang refuses to compile (AMD Zen 5), and it gives names by family and model whose instructions the processor may lack
(virtual machines without AVX-512) or exceed: Zen 4 is `znver3`, without AVX-512, while PoCL links the kernels with its
AVX-512 library, and LLVM aborts the process. Such a processor is given the name of its level of the x86-64 psABI.
"""

from __future__ import annotations

import contextlib
import ctypes
import glob
import importlib.util
import mmap
import os
import platform
import shutil
import site
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from pathlib import Path

from ...base import console, interrupts
from ...base.atomic_files import lock_file
from ...base.host_memory import limit
from ...errors import DeviceError

# Number of threads that a CPU's OpenCL runtime starts, by default one per processor: PoCL's older and newer variable,
# Intel's.
THREADS = ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT", "DPCPP_CPU_NUM_CUS")
# Bytes of a disk and of a file: PoCL silently ends the process, or builds nothing, if it cannot write what it compiles.
ROOM, FILE = 64 << 20, 4 << 20
SYSTEM_VENDORS = Path("/etc/OpenCL/vendors")
LOCK = "lock"  # a file in a private folder
LEFT_SECONDS = 24 * 3600.0  # an unlocked folder of that age was left by a process that was killed
FORMER = ("slot-*", "probe-*")  # folders that earlier versions kept

guard = threading.RLock()  # held while OpenCL is set up, and while a device is opened
_home: Path | None = None
_home_is_kept = True  # for later processes
_prepared = False
_started_in: int | None = None  # the process that started OpenCL


def is_users(name: str) -> bool:
    """Return whether the environment variable was set by the user rather than by clshade, here or in a parent process."""
    value = os.environ.get(name)
    return bool(value) and value != os.environ.get(f"CLSHADE_SET_{name}")


def _set(name: str, value: str) -> None:
    os.environ[name] = os.environ[f"CLSHADE_SET_{name}"] = value


# Location of the caches


def fault(folder: Path) -> str:
    """Return why compiled kernels cannot be kept in the folder, which is made if need be; "" if they can."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryFile(dir=folder) as trial:
            trial.write(bytes(4096))
        free, size_limit = shutil.disk_usage(folder).free, limit("RLIMIT_FSIZE")
    except FileExistsError:
        return "not a folder"
    except (OSError, ValueError) as error:
        return getattr(error, "strerror", None) or str(error)
    if free < ROOM:
        return f"{free / 1e6:.1f} MB free, {ROOM / 1e6:.0f} MB needed"
    if size_limit < FILE:
        return f"files of at most {size_limit / 1e6:.1f} MB, {FILE / 1e6:.0f} MB needed: raise `ulimit -f`"
    return ""


def _temporary_cache_home(instead: str) -> Path:
    """Return a folder in the system's temporary folder: this user's, kept for later runs; or, if someone else created
    that or could have written to it, one for this process alone, removed when it exits: the cache holds code that gets
    loaded. instead: what was wrong with the other folder, for the message."""
    global _home_is_kept
    remedy = "set XDG_CACHE_HOME to a folder that can"
    try:
        parent = Path(tempfile.gettempdir())
        folder = parent / f"clshade-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
        _home_is_kept = hasattr(os, "getuid") and _is_private(folder)
        if not _home_is_kept:
            instead += f"; {folder}: not private"
            folder = private_folder(parent, f"{folder.name}-")
        reason = fault(folder / "clshade")
        if not reason:
            where = f"kept in {folder}" if _home_is_kept else "not kept"
            console.warning(f"compiled kernels are {where} ({instead}): {remedy} be written")
            return folder
        reason = f"{folder}: {reason}"
    except OSError as error:
        reason = f"the temporary folder: {error.strerror or error}"
    raise DeviceError(f"no folder for caches can be written ({instead}; {reason}): {remedy}")


def _is_private(folder: Path) -> bool:
    """Return whether only this user can have written to the folder, which is created if need be."""
    try:
        folder.mkdir(mode=0o700)
    except FileExistsError:
        status = folder.lstat()
        if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o022:
            return False
        if status.st_mode & 0o777 != 0o700:  # others may read it, or it was created under an unusual umask
            folder.chmod(0o700)
    return True


def cache_home() -> Path:
    """Return a writable cache folder. If the user's own is missing, unwritable or full: one in the temporary folder,
    which is then also set as XDG_CACHE_HOME, for child processes."""
    global _home
    if _home is not None:  # also while a device is opened
        return _home
    import platformdirs

    with guard:
        if _home is None:
            try:
                home = Path(platformdirs.user_cache_dir())
                reason = fault(home / "clshade") if home.is_absolute() else "not an absolute path"
                reason = f"{home}: {reason}" if reason else ""
            except (RuntimeError, OSError):  # no HOME, and a user whom the system does not know, as in a container
                reason = "no HOME"
            if reason:
                home = _temporary_cache_home(reason)
                os.environ["XDG_CACHE_HOME"] = str(home)
            _home = home
        return _home


def keeps_cache() -> bool:
    """Return whether the cache outlives this process."""
    cache_home()
    return _home_is_kept


def cache_root() -> Path:
    """Return clshade's own folder in `cache_home`; it exists."""
    return cache_home() / "clshade"


# Folders for one process


def private_folder(parent: Path, prefix: str) -> Path:
    """Create a folder that is removed when this process exits. Those of processes that were killed are removed first.

    Raises OSError if it cannot be created.
    """
    _remove_left(parent.glob(f"{prefix}*"))
    folder, owner = Path(tempfile.mkdtemp(prefix=prefix, dir=parent)), os.getpid()

    @interrupts.at_end
    def remove() -> None:
        if os.getpid() == owner:
            shutil.rmtree(folder, ignore_errors=True)

    try:
        lock = lock_file(folder / LOCK)  # held until the process exits
    except OSError:  # a file system without locks: if left behind, it is removed once it is old
        return folder
    if lock is not None and (folder / LOCK).is_file():
        return folder
    return private_folder(parent, prefix)  # before it was locked another process took it for a leftover


def _remove_left(folders: Iterable[Path]) -> None:
    """Remove those of this user's folders that no process has locked."""
    for folder in folders:
        with contextlib.suppress(OSError), contextlib.ExitStack() as stack:
            status = folder.lstat()
            if not stat.S_ISDIR(status.st_mode) or (hasattr(os, "getuid") and status.st_uid != os.getuid()):
                continue
            if (folder / LOCK).is_file():
                lock = lock_file(folder / LOCK)
                if lock is None:
                    continue
                stack.callback(os.close, lock)
            elif status.st_mtime >= time.time() - LEFT_SECONDS:  # just created, or its file system has no locks
                continue
            shutil.rmtree(folder, ignore_errors=True)


def _own_folder(prefix: str, files: Mapping[str, str]) -> Path:
    """Create a private folder in the cache, with files of a line each. Raises DeviceError if it cannot be written."""
    try:
        folder = private_folder(cache_root(), prefix)
        for name, line in files.items():
            (folder / name).write_text(f"{line}\n")
        return folder
    except OSError as error:
        raise DeviceError(f"the cache folder {cache_root()} cannot be used: {error.strerror or error}") from None


def pocl_folder() -> Path:
    """Return the folder of PoCL's cache, of this process alone, as two that share one can crash."""
    return Path(os.environ["POCL_CACHE_DIR"])


def _forget() -> None:
    """Let a forked child have a folder of its own; a thread of the parent may have held the lock."""
    global guard, _prepared
    guard, _prepared = threading.RLock(), False


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


# Runtimes visible to the ICD loader


def intel_library() -> Path | None:
    """Return Intel's CPU runtime as pip or conda install it (`intel-opencl-rt`), or None."""
    prefixes = dict.fromkeys((sys.prefix, sys.base_prefix, site.getuserbase(), "/usr/local"))
    paths = (Path(prefix, "lib", "libintelocl.so") for prefix in prefixes if os.path.isabs(prefix or ""))
    return next((path for path in paths if path.is_file()), None)


def expose_runtimes() -> None:
    """Make Intel's runtime visible if it is installed, beside PoCL and the system's runtimes.

    The .icd files that come with it name a folder of its build machine, so OCL_ICD_VENDORS is set to a folder of
    working ones. PyPI's pyopencl adds the PoCL it carries to whatever folder that is.
    """
    if not sys.platform.startswith("linux") or is_users("OCL_ICD_VENDORS") or os.environ.get("OPENCL_VENDOR_PATH"):
        return
    os.environ.pop("OCL_ICD_VENDORS", None)
    intel = intel_library()
    if intel is None:
        return
    files: dict[str, str] = {}  # libraries by the names of their .icd files
    for folder in (SYSTEM_VENDORS, Path(sys.prefix, "etc", "OpenCL", "vendors")):
        for file in sorted(folder.glob("*.icd")):
            with contextlib.suppress(OSError):
                library = file.read_text(errors="replace").strip()
                missing = not library or (os.path.isabs(library) and not os.path.exists(library))
                if not missing and library not in files.values():
                    files[f"{len(files)}-{file.name}" if file.name in files else file.name] = library
    if not any(os.path.basename(library).startswith("libintelocl.so") for library in files.values()):
        files["clshade-intel.icd"] = str(intel)
    elif all((SYSTEM_VENDORS / name).exists() for name in files):
        return
    _set("OCL_ICD_VENDORS", str(_own_folder("vendors-", files)))


def _pin_threads() -> None:
    """Keep each of PoCL's threads on a processor of its own, if it starts one for each: the kernel's scheduler tends to
    wake two on one processor, and moves neither during a short frame.

    Threads that are fewer than the processors are left alone, for PoCL would put those of all processes on the first
    ones; so are those of a process that may not use all processors, for PoCL would take the others too.
    """
    if is_users("POCL_AFFINITY"):
        return
    os.environ.pop("POCL_AFFINITY", None)  # a parent's
    if not hasattr(os, "sched_getaffinity") or any(os.environ.get(name) for name in THREADS):
        return
    if os.sched_getaffinity(0) == set(range(os.cpu_count() or 0)):
        _set("POCL_AFFINITY", "1")


def prepare(name: str = "") -> None:
    """Set up the environment for OpenCL; later calls do nothing. Call it before importing pyopencl. `name`: the device asked
    for, as for `device.open_device`."""
    global _prepared
    with guard:
        if _prepared:
            return
        _remove_left(path for pattern in FORMER for path in cache_root().glob(pattern))
        os.environ["POCL_CACHE_DIR"] = str(_own_folder("pocl-", {}))
        expose_runtimes()
        # pyopencl looks this up unguarded if its cache fails; if empty, it warns and continues without the cache.
        os.environ.setdefault("PYOPENCL_CACHE_FAILURE_FATAL", "")
        if "rusticl" in name.lower():
            os.environ.setdefault("RUSTICL_ENABLE", "swrast")  # Mesa hides its CPU device otherwise
        _prepared = True


def starting() -> None:
    """Note that OpenCL starts in this process.

    Raises DeviceError in a child forked after it had started: a runtime's threads do not survive the fork.
    """
    global _started_in
    if _started_in not in (None, os.getpid()):
        raise DeviceError(
            "this process was forked after OpenCL had started: start workers with multiprocessing's `spawn` method"
        )
    if _started_in is None:
        _pin_threads()
        set_target()
    _started_in = os.getpid()


# The processor that PoCL compiles for

# Names in LLVM 14 of processors with the instructions of level 4 (AVX-512) and of level 3 (AVX2, FMA).
_AVX512 = "skylake-avx512 cascadelake cooperlake cannonlake icelake-client icelake-server tigerlake rocketlake"
_AVX512 += " sapphirerapids"
_AVX2 = "haswell broadwell skylake alderlake znver1 znver2 znver3"

# What Linux calls the instructions of each level (x86-64 psABI, "Microarchitecture levels").
_LEVELS = (
    (2, "cx16 lahf_lm popcnt sse4_1 sse4_2 ssse3"),
    (3, "abm avx avx2 bmi1 bmi2 f16c fma movbe xsave"),
    (4, "avx512f avx512bw avx512cd avx512dq avx512vl"),
)
# Environment variable: LLVM's name of another processor, to try out what is compiled for it.
FORCED = "CLSHADE_POCL_TARGET"


@cache
def pyopencl_folder() -> str:
    """Return pyopencl's folder, which holds PyPI's PoCL; "" if it is not installed."""
    spec = importlib.util.find_spec("pyopencl")
    return os.path.dirname(spec.origin or "") if spec is not None else ""


def level_of(flags: Collection[str]) -> int:
    """Return the highest level of the x86-64 psABI, 1 to 4, whose instructions are all among the processor's flags."""
    lacking = (level for level, words in _LEVELS if not set(words.split()) <= set(flags))
    return next(lacking, 5) - 1


def target_for(name: str, flags: Collection[str]) -> str:
    """Return the name to compile for, where LLVM gives the processor `name` and Linux gives it `flags`: mostly the same."""
    level = level_of(flags)
    named = 4 if name in _AVX512.split() else 3 if name in _AVX2.split() else None
    if name == "generic" or (named is not None and named != level):
        return "x86-64" if level == 1 else f"x86-64-v{level}"
    return name


def processor_flags() -> set[str]:
    """Return what Linux calls this processor's instructions; nothing where there is no /proc/cpuinfo of x86."""
    try:
        with open("/proc/cpuinfo") as file:
            return next((set(line.split(":", 1)[1].split()) for line in file if line.startswith("flags")), set())
    except OSError:
        return set()


def _replace_result(function: ctypes._NamedFuncPointer, name: str) -> None:
    """Overwrite a function of a loaded library so that it returns `name`, as a C string that its caller frees."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.strdup.restype = ctypes.c_void_p
    text, strdup = libc.strdup(name.encode()), ctypes.cast(libc.strdup, ctypes.c_void_p).value or 0
    # mov rdi, text; mov rax, strdup; jmp rax
    code = b"\x48\xbf" + text.to_bytes(8, "little") + b"\x48\xb8" + strdup.to_bytes(8, "little") + b"\xff\xe0"
    address = ctypes.cast(function, ctypes.c_void_p).value or 0
    page = address - address % mmap.PAGESIZE
    length = ctypes.c_size_t(address + len(code) - page)
    if libc.mprotect(ctypes.c_void_p(page), length, mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    ctypes.memmove(address, code, len(code))
    libc.mprotect(ctypes.c_void_p(page), length, mmap.PROT_READ | mmap.PROT_EXEC)


@cache
def set_target() -> str:
    """Make PoCL compile for a name that suits the processor; return it, "" if LLVM's own choice stays. Call it before
    OpenCL starts. Where memory of code cannot be changed nothing happens: the test of the device then finds the fault."""
    if not sys.platform.startswith("linux") or platform.machine() != "x86_64" or not pyopencl_folder():
        return ""
    chosen = ""
    for path in glob.glob(os.path.join(pyopencl_folder(), ".libs", "libpocl*.so*")):
        try:
            function = ctypes.CDLL(path).pocl_get_llvm_cpu_name
            function.restype = ctypes.c_char_p
            name = (function() or b"").decode(errors="replace")
            target = os.environ.get(FORCED) or target_for(name, processor_flags())
            if target != name:
                _replace_result(function, target)
                chosen = target
        except (OSError, AttributeError):
            continue
    return chosen
