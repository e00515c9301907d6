"""Arrays that take long to compute, kept on disk by a digest of what they are computed from."""

from __future__ import annotations

import contextlib
import hashlib
import io
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from ..base.arrays import Array
from ..base.atomic_files import write_bytes
from ..errors import ClshadeError
from .opencl.environment import cache_root

_MOST = 8  # files: those that were not used for longest go


def kept(code: Iterable[Path], inputs: Iterable[bytes], compute: Callable[[], tuple[Array, ...]]) -> tuple[Array, ...]:
    """Return what `compute` returns, from disk if an earlier call with equal `inputs` wrote it. code: the files that say how
    it is computed. A file that is damaged or cannot be written only costs time."""
    path: Path | None = None
    with contextlib.suppress(OSError, ValueError, EOFError, KeyError, MemoryError, zipfile.BadZipFile, ClshadeError):
        parts = [np.__version__.encode(), *(file.read_bytes() for file in code), *inputs]
        digest = hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts))
        path = cache_root() / "tables" / f"{digest.hexdigest()}.npz"
        with np.load(path, allow_pickle=False) as file:
            arrays = tuple(file.values())
        path.touch()
        return arrays
    arrays, content = compute(), io.BytesIO()
    if path is None:
        return arrays
    np.savez(content, *arrays)
    with contextlib.suppress(OSError, ClshadeError):
        path.parent.mkdir(exist_ok=True)
        write_bytes(path, content.getbuffer())
        for old in sorted(path.parent.glob("*.npz"), key=lambda each: each.stat().st_mtime)[:-_MOST]:
            old.unlink(missing_ok=True)
    return arrays
