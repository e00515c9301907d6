"""Inlining of PoCL's built-in functions, and the search for calls that are left in its compiled kernels.

PoCL compiles its built-in functions once for each family of CPUs. LLVM inlines a function only into callers that have
all CPU features of the function, and many CPUs lack some that the family's model has: every `fma` is a call there,
and arithmetic is up to nine times as slow.
"""

from __future__ import annotations

import re
from pathlib import Path

# Features in which x86 CPUs of a family differ and which no compiler uses by itself, so that code with them runs on
# every CPU: instructions for system software, random numbers, cache control, long additions with carry.
_FEATURES = "adx,clflushopt,clwb,fsgsbase,invpcid,pku,prfchw,rdrnd,rdseed,xsave,xsavec,xsaveopt,xsaves"
_GUARD = "#if defined(__clang__) && defined(__x86_64__)"  # neither in SPIR-V nor on GPUs
_BUILTIN = re.compile(rb"_Z\d+(_cl_\w+)")  # the mangled name of a function of PoCL's library


def inlined(source: str) -> str:
    """Return OpenCL C whose functions have those features too, so that built-in functions are inlined into them."""
    target = f'__attribute__((target("{_FEATURES}")))'
    push = f"{_GUARD}\n#pragma clang attribute push({target}, apply_to = function)\n#endif\n"
    return f"{push}{source}\n{_GUARD}\n#pragma clang attribute pop\n#endif\n"


def called_builtins(folder: Path) -> dict[str, list[str]]:
    """Return the built-in functions that PoCL's compiled kernels below `folder` call, by kernel: the mangled names
    in their symbol tables. A function that is inlined everywhere is not listed there."""
    return {
        library.stem: sorted({name.decode() for name in _BUILTIN.findall(library.read_bytes())})
        for library in sorted(folder.rglob("*.so"))
    }
