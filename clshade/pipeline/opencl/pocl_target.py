"""The processor that PyPI's PoCL compiles for.

PoCL 3.0 asks its LLVM, version 14 of 2022, for the processor's name. LLVM calls what it does not know `generic`, for which
clang refuses to compile (AMD Zen 5), and it gives names by family and model whose instructions the processor may lack
(virtual machines without AVX-512) or exceed: Zen 4 is `znver3`, without AVX-512, while PoCL links the kernels with its
AVX-512 library, and LLVM aborts the process. Such a processor is given the name of its level of the x86-64 psABI.
"""

from __future__ import annotations

import ctypes
import glob
import importlib.util
import mmap
import os
import platform
import sys
from collections.abc import Collection
from functools import cache

# Names in LLVM 14 of processors with the instructions of level 4 (AVX-512) and of level 3 (AVX2, FMA).
_AVX512 = (
    "skylake-avx512 cascadelake cooperlake cannonlake icelake-client icelake-server tigerlake rocketlake sapphirerapids"
)
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
