"""Images as they are handed in, read as codes."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from ...base.arrays import Array, Floats
from ...base.atomic_files import shown
from ...base.input_files import file_error, first_bytes, reason_of
from ...images import decode
from ...images.image_file import EXR, read_picture
from .drawing import as_codes

_JPEG = b"\xff\xd8\xff"
_CODES_FROM = 16.0  # linear floats that are all whole numbers are no image from here on
_ARRAYS = (".npy", ".npz")
ENDINGS = (".png", ".exr", *_ARRAYS, ".jpg", ".jpeg", ".bmp", ".tga", ".tif", ".tiff", ".webp", ".gif", ".ppm")


def read_codes(path: str | Path, shape: tuple[int, int]) -> tuple[Floats, tuple[str, ...]]:
    """Read an image of (M, N) pixels: codes of 8-bit files as they are; linear floats of EXR, .npy and .npz (its array
    `rgb`, or its only one) times 255, clipped to [0, 255]; integers from 0 to 255 of these as codes. Row 0 of an .npy is
    the bottom, as the course's functions return images; of all others it is the top.

    Returns codes (M, N, 3), row 0 at the top, and remarks on the file. Raises InputError naming the file.
    """
    owner = shown(path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        codes = _codes(path, shape, owner)
    return codes, tuple(str(warning.message).removeprefix(f"{owner}: ") for warning in caught)


def _codes(path: str | Path, shape: tuple[int, int], owner: str) -> Floats:
    begin = first_bytes(path, len(EXR))
    if begin == EXR:
        picture = read_picture(path)
        _check_size(picture.shape, shape, owner)
        color = picture.color()
        if color is None:
            raise file_error(owner, "channels", "R, G and B", "none")
        return as_codes(_finite(np.asarray(color[1], np.float64), owner, "channels"))
    if begin.startswith(_JPEG):
        raise file_error(owner, "image", "a lossless format such as PNG", "JPEG, which is off by more than 1/255")
    if Path(path).suffix.lower() in _ARRAYS:
        codes = _codes_of(_array(path, owner), shape, owner)
        return codes[::-1] if Path(path).suffix.lower() == ".npy" else codes
    image = decode.read_image(path, srgb=False)
    _check_size(image.shape, shape, owner)
    codes = np.asarray(image, np.float64) * 255.0
    return np.where(np.abs(codes - np.rint(codes)) < 1e-4, np.rint(codes), codes)


def _check_size(size: tuple[int, ...], shape: tuple[int, int], owner: str) -> None:
    if size[:2] != shape:
        expected = f"{shape[1]} x {shape[0]} pixels, as the scene has (--resolution)"
        exchanged = "; rows and columns exchanged? index image[row, column]" if size[1::-1] == shape else ""
        raise file_error(owner, "size", expected, f"{size[1]} x {size[0]}{exchanged}")


def _array(path: str | Path, owner: str) -> Array:
    """Return the array of a file; that of an .npy is not read into memory yet."""
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        if isinstance(array, np.ndarray):
            return array
        with array:
            names = array.files
            if "rgb" in names or len(names) == 1:
                return np.asarray(array["rgb" if "rgb" in names else names[0]])
    except Exception as error:  # damaged archives raise exceptions of many types
        raise file_error(owner, "file", "an array", reason_of(error) or "damaged data") from None
    raise file_error(owner, "arrays", "one named rgb", ", ".join(names[:8]) or "none")


def _codes_of(array: Array, shape: tuple[int, int], owner: str) -> Floats:
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype.kind not in "fiu":
        expected = "floats, or integers from 0 to 255, of shape (M, N, 3)"
        raise file_error(owner, "array", expected, f"{array.dtype} of shape {array.shape}")
    _check_size(array.shape, shape, owner)
    low, high = array.min(), array.max()
    if array.dtype.kind != "f":
        if low < 0 or high > 255:
            raise file_error(owner, "array", "integers from 0 to 255", f"{low} to {high}")
        return array.astype(np.float64)
    values = _finite(array.astype(np.float64), owner, "array")
    if high >= _CODES_FROM and (values == np.rint(values)).all():
        expected = "linear floats, 1 for full intensity, or codes as integers"
        raise file_error(owner, "array", expected, f"floats that are whole numbers up to {high:g}")
    return as_codes(values)


def _finite(values: Floats, owner: str, field: str) -> Floats:
    bad = ~np.isfinite(values).all(axis=2)
    if bad.any():
        raise file_error(owner, field, "finite values", f"NaN or infinity in {bad.sum():,} of {bad.size:,} pixels")
    return values
