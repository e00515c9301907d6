"""NumPy's .npz: named arrays in a ZIP archive."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from typing import BinaryIO

import numpy as np

from ..base.arrays import Array
from ..base.atomic_files import Path

_LEVEL = 1  # of zlib, whose default gains little on renders


def encode(file: BinaryIO, arrays: Mapping[str, Array]) -> None:
    """Write arrays to an open file, as `numpy.savez_compressed` does; `numpy.load` reads them without pickle.

    Equal arrays give equal bytes: members have the date 1980-01-01, which `ZipFile.open` gives them.
    Raises ValueError for arrays of objects.
    """
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=_LEVEL) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)


def resolution(path: Path) -> tuple[int, int] | None:
    """Return the two whole numbers of the array `resolution` of a file, or None if there is no such file or array."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            columns, rows = arrays["resolution"].tolist()
            return int(columns), int(rows)
    except Exception:  # damaged archives raise exceptions of many types
        return None
