"""The sources of the kernels."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from ..errors import DeviceError


@cache
def kernel_folder() -> Path:
    """Return the folder of the kernel sources: inside an installed package, or at the top level of a checkout."""
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "kernels", package.parent / "kernels"):
        if (folder / "features.clh").is_file():
            return folder
    raise DeviceError(f"{package}: the kernel sources are missing; install clshade again")


@cache
def kernel_text(name: str) -> str:
    """Return the source in a file of that name, with the same line ends everywhere."""
    return (kernel_folder() / name).read_text(encoding="utf-8")


@cache
def kernels_digest() -> str:
    """Return the SHA-256 of the names and contents of all sources, in hexadecimal."""
    digest = hashlib.sha256()
    for path in sorted(path for path in kernel_folder().iterdir() if path.suffix in (".cl", ".clh", ".h")):
        content = kernel_text(path.name).encode()
        digest.update(b"%s %d\n" % (path.name.encode(), len(content)) + content)
    return digest.hexdigest()
