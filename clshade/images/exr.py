"""OpenEXR files: linear float images with layers, written atomically and read back bit for bit.

Needs OpenEXR 3.5 or newer, whose `File` takes Python streams. Its module is imported on first use (0.1 s or more).
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, BinaryIO, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..base import atomic_files
from ..base.arrays import Array
from ..base.atomic_files import Path, shown
from ..base.input_files import decoding, file_error, quoted, read_file
from ..base.validation import choice
from ..base.validation import path as checked_path
from ..errors import InputError
from . import exr_limits
from .layers import LAYER_TABLE

Part: TypeAlias = tuple[Mapping[str, ArrayLike], Mapping[str, Any]]  # channels and metadata
Window = tuple[int, int, int, int]  # x0, y0, x1, y1 of pixels, inclusive, y down from the top

IMAGE = frozenset({"R", "G", "B", "A", "Y", "RY", "BY"})  # channels that a lossy compression may change
# Lossy compressions -> (the type whose values they change, the channels of the image, what they do).
LOSSY = {
    "pxr24": (np.float32, IMAGE, "rounds float32 to 24 bits"),
    "b44": (np.float16, IMAGE, "rounds half, 4x4 pixels together"),
    "b44a": (np.float16, IMAGE, "rounds half, 4x4 pixels together"),
    "dwaa": (np.floating, IMAGE - {"A"}, "leaves out what is hardly seen"),
    "dwab": (np.floating, IMAGE - {"A"}, "leaves out what is hardly seen"),
}
Compression: TypeAlias = Literal["none", "rle", "zips", "zip", "piz", "zstd", "pxr24", "b44", "b44a", "dwaa", "dwab"]
COMPRESSIONS: tuple[Compression, ...] = get_args(Compression)  # lossless, then LOSSY
_FLOWS = ("flow", "flow_back")
# Names of a layer's components; R G B A for every other layer.
SUFFIXES: dict[str, str] = {n: row.components for n, row in LAYER_TABLE.items() if row.components not in ("", "RGB")}
SUFFIXES |= dict.fromkeys(_FLOWS, "XY")
# Layers that `half` does not affect: depths, positions and data need their digits.
FULL_PRECISION = (*(name for name, row in LAYER_TABLE.items() if row.keeps_digits), *_FLOWS)
# What some layers hold where there is nothing.
FAR: dict[str, float] = {name: row.background for name, row in LAYER_TABLE.items() if row.background != 0.0}

# Names of the first of several parts, and of the part of the other channels where the compression is lossy.
FIRST, LAYERS = "rgba", "layers"

_MAX_BYTES = 1 << 34  # size of the largest file that is read
WRITTEN = {"software": "clshade", "colorInteropID": "lin_rec709_scene"}  # attributes of every file, by default
PROTECTED = {"channels", "compression", "dataWindow", "displayWindow", "lineOrder", "name", "type", "version"}
PROTECTED |= {"chunkCount", "screenWindowCenter", "screenWindowWidth", "tiles"}
_LOCK = threading.Lock()  # OpenEXR's thread count and the standard streams are global to the process


def flatten(layers: Mapping[str, ArrayLike] | ArrayLike) -> dict[str, Array]:
    """Split layers into one 2-D array per EXR channel, as views.

    Raises InputError for another shape, no layer, sizes that differ, or two channels of one name.

    Parameters
    ----------
    layers : array_like, (M, N, 3) or (M, N, 4), or mapping of str to array_like
        RGB or RGBA; or arrays (M, N), kept under their names, and (M, N, K), split: `RGB` and
        `RGBA` into R, G, B, A, `N` and `P` into .X .Y .Z, `uv` into .U .V, `barycentrics` into
        .U .V .W, any other into .R .G .B .A. Row 0 is the top.
    """
    if not isinstance(layers, Mapping):
        layers = {"RGB": layers}
    flat: dict[str, Array] = {}
    for name, layer in layers.items():
        array = np.asarray(layer)
        if not isinstance(name, str) or not name or "\0" in name:
            raise InputError(f"exr: channels: expected names of at least one letter, found {name!r}")
        components = {name: array}
        if array.ndim == 3:
            suffixes = SUFFIXES.get(name, "RGBA" if array.shape[2] == 4 else "RGB")
            if array.shape[2] != len(suffixes):
                raise InputError(f"exr: {name}: expected shape (M, N, {len(suffixes)}), found {array.shape}")
            prefix = "" if name in ("RGB", "RGBA") else f"{name}."
            components = {prefix + suffix: array[:, :, k] for k, suffix in enumerate(suffixes)}
        for channel, plane in components.items():
            if plane.ndim != 2 or 0 in plane.shape:
                raise InputError(f"exr: {channel}: expected an array of shape (M, N), found {plane.shape}")
            if channel in flat:
                raise InputError(f"exr: {channel}: expected one channel of this name, found two")
            flat[channel] = plane
    if len({plane.shape for plane in flat.values()}) != 1:
        shapes = ", ".join(f"{name} {plane.shape}" for name, plane in flat.items()) or "none"
        raise InputError(f"exr: channels: expected at least one, all of the same shape, found {shapes}")
    return flat


def drawn_window(channels: Mapping[str, Array]) -> Window:
    """Return the smallest window (x0, y0, x1, y1) outside of which every channel is 0.

    Columns and rows are inclusive, y down from the top; the first pixel if everything is 0. -0.0 counts as drawn, because
    readers give +0 outside the data window.

    Parameters
    ----------
    channels : mapping of str to ndarray of shape (M, N)
    """
    rows, columns = np.zeros(1, bool), np.zeros(1, bool)
    for plane in channels.values():
        is_drawn = plane != 0
        if plane.dtype.kind == "f":
            is_drawn |= np.signbit(plane)
        rows, columns = rows | is_drawn.any(axis=1), columns | is_drawn.any(axis=0)
    if not rows.any():
        return 0, 0, 0, 0
    ys, xs = np.flatnonzero(rows).tolist(), np.flatnonzero(columns).tolist()
    return xs[0], ys[0], xs[-1], ys[-1]


def _data_window(planes: dict[str, Array], window: Window | str | None) -> Window:
    rows, columns = next(iter(planes.values())).shape
    if isinstance(window, str):
        if window not in ("drawn", "covered"):
            raise InputError(f"exr: window: expected (x0, y0, x1, y1), drawn, covered or None, found {window!r}")
        cropped = dict(planes)
        for name in FAR.keys() & planes if window == "covered" else ():
            far = np.isnan(planes[name]) if math.isnan(FAR[name]) else planes[name] == FAR[name]
            cropped[name] = np.where(far, 0, planes[name])
        return drawn_window(cropped)
    x0, y0, x1, y1 = (0, 0, columns - 1, rows - 1) if window is None else (int(edge) for edge in window)
    if not (0 <= x0 <= x1 < columns and 0 <= y0 <= y1 < rows):
        raise InputError(f"exr: window: expected one inside {columns} x {rows} pixels, found {window!r}")
    return x0, y0, x1, y1


def _header(metadata: Mapping[str, Any], data: Window, display: Window) -> dict[str, Any]:
    """Return a header whose values OpenEXR stores as they are; it silently stores others wrongly."""
    header: dict[str, Any] = {**WRITTEN, "pixelAspectRatio": 1.0}
    for name, value in metadata.items():
        if value is None:
            continue
        if not isinstance(name, str) or not name.isprintable() or not name or name in PROTECTED:
            raise InputError(f"exr: metadata: expected the name of an attribute of the caller's, found {name!r}")
        value = value.item() if isinstance(value, np.generic) else value
        if isinstance(value, str):
            value = value.encode("utf-8", "replace").decode("utf-8")
        elif isinstance(value, np.ndarray) and value.shape == (4, 4) and value.dtype.kind in "fiu":
            value = np.ascontiguousarray(value, dtype=np.float32)
        elif isinstance(value, int) and -(2**31) <= value < 2**31:
            value = int(value)
        elif not isinstance(value, float):
            expected = "text, a number, a whole number of 32 bits or a (4, 4) array"
            raise file_error("exr: metadata", name, expected, quoted(repr(value)))
        header[name] = value
    aspect = header["pixelAspectRatio"]
    if not isinstance(aspect, float) or not 1e-6 <= aspect <= 1e6:
        raise InputError(f"exr: metadata: pixelAspectRatio: expected a float from 1e-6 to 1e6, found {aspect!r}")
    for name, box in (("dataWindow", data), ("displayWindow", display)):
        header[name] = (np.array(box[:2], np.int32), np.array(box[2:], np.int32))
    return header


def _stored(name: str, plane: Array, half: bool, warnings: list[str]) -> Array:
    """Return a channel, contiguous, in the type it is stored in: uint32 for integers, else float32 or half."""
    kind, size = plane.dtype.kind, plane.dtype.itemsize
    if kind in "iub":
        if plane.dtype != np.uint32 and not 0 <= int(plane.min()) <= int(plane.max()) < 2**32:
            raise InputError(f"exr: {name}: expected whole numbers from 0 to 2^32-1, found others")
        return np.ascontiguousarray(plane, dtype=np.uint32)
    if kind != "f" or size > 8:
        raise InputError(f"exr: {name}: expected floats or whole numbers, found type {plane.dtype}")
    to_half = half and name.split(".")[0] not in FULL_PRECISION
    with np.errstate(over="ignore", invalid="ignore"):
        stored = np.ascontiguousarray(plane, dtype=np.float16 if to_half else np.float32)
    if stored.dtype.itemsize < size:
        label, limit = ("half", "65520") if to_half else ("float32", "3.4e38")
        if lost := np.count_nonzero(np.isinf(stored)) - np.count_nonzero(np.isinf(plane)):
            warnings.append(f"{name}: {lost} finite values of {limit} or more became infinity in {label}")
        if to_half and (unknown := np.count_nonzero(np.isnan(stored))):
            warnings.append(f"{name}: {unknown} NaN values lost their payload in {label}")
    return stored


class _Sink:
    """The stream that OpenEXR writes to; keeps the first error, which a destructor of OpenEXR could swallow."""

    error: BaseException | None = None

    def __init__(self, file: BinaryIO) -> None:
        self.file = file

    def __getattr__(self, name: str) -> Any:
        operation = getattr(self.file, name)

        def guarded(*arguments: Any) -> Any:
            try:
                return operation(*arguments)
            except BaseException as error:
                self.error = self.error or error
                raise

        return guarded


def _compress(
    file: BinaryIO, parts: Sequence[tuple[str, str, dict[str, Any], dict[str, Array]]], tiled: bool = False
) -> None:
    """Write parts: name, compression, header and channels of each; the name of a single one is left out. tiled: as one
    tile each."""
    import OpenEXR

    form: dict[str, Any] = {"type": OpenEXR.scanlineimage}
    if tiled:
        form = {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
        form["tiles"].ySize, form["tiles"].xSize = next(iter(parts[0][3].values())).shape
    sink = _Sink(file)
    with _LOCK:
        # OpenEXR's threads exist only here: a child forked later would wait for them forever.
        before = OpenEXR.global_thread_count()
        OpenEXR.set_global_thread_count(before if parts[0][1] == "none" else min(os.cpu_count() or 1, 8))
        try:
            file_parts = []
            for name, compression, header, channels in parts:
                method = getattr(OpenEXR, f"{compression.upper()}_COMPRESSION".replace("NONE", "NO"))
                attributes = {**header, **form, "compression": method}
                file_parts.append(OpenEXR.Part(attributes, channels, name if len(parts) > 1 else ""))
            with OpenEXR.File(file_parts) as exr:
                exr.write(sink)
        except Exception as error:
            if sink.error is None and not isinstance(error, MemoryError):
                raise OSError(f"OpenEXR: {error}") from None
            raise sink.error or error from None
        finally:
            OpenEXR.set_global_thread_count(before)
    if sink.error is not None:
        raise sink.error


def write(
    path: Path,
    channels: Mapping[str, ArrayLike] | ArrayLike,
    *,
    compression: Compression = "zip",
    half: bool = False,
    metadata: Mapping[str, Any] | None = None,
    window: Window | Literal["drawn", "covered"] | None = None,
) -> list[str]:
    """Write a scanline EXR file of a single part, atomically; the same arguments give the same bytes.

    Returns warnings, one line each: finite values that became infinity, NaNs in half, rounding by a compression. Raises
    InputError for an argument that is not allowed, OutputError if the file cannot be written.

    Parameters
    ----------
    path : str or path-like
        File; an existing one is replaced only when the new one is complete.
    channels : array_like, (M, N, 3) or (M, N, 4), or mapping of str to array_like
        As for `flatten`, such as {"R": .., "Z": .., "N.X": ..} of (M, N) arrays. Row 0 is the top.
        Floats are stored as float32, bit for bit, including NaNs, infinities and denormals; float64
        is rounded; integers are stored as uint32. Arrays need not be contiguous and are not
        changed.
    compression : str, default "zip"
        Lossless: none, rle, zips, zip, piz, zstd; zstd needs a reader with OpenEXR 3.5 or newer.
        Lossy: pxr24 rounds float32 to 24 bits; b44 and b44a round half and leave float32 as it is;
        dwaa and dwab round colors. These are for R, G, B, A (or Y, RY, BY) alone: the other channels
        are stored by zip, without loss, in a part of their own, ``layers``.
    half : bool, default False
        Store floats as half, except the layers Z, P and scalar.
    metadata : mapping, optional
        Further header attributes: text, numbers and (4, 4) matrices; None omits one. Defaults:
        software "clshade", colorInteropID "lin_rec709_scene" and pixelAspectRatio 1. See
        `clshade.scene.geometry.camera_metadata`.
    window : (int, int, int, int), {"drawn", "covered"} or None, default None
        Data window (x0, y0, x1, y1), inclusive: only these pixels are stored, and readers take the
        others as 0. `drawn`: the smallest window that loses nothing. `covered`: also leaves out
        +infinity in Z: the header attribute Zbackground has `read` restore it;
        other readers take Z as 0 there. None: the whole image, which the display window always is.
    """
    with atomic_files.replacing(checked_path("exr.write", "path", path)) as file:
        return encode(file, channels, compression=compression, half=half, metadata=metadata, window=window)


def encode(
    file: BinaryIO,
    channels: Mapping[str, ArrayLike] | ArrayLike,
    *,
    compression: Compression = "zip",
    half: bool = False,
    metadata: Mapping[str, Any] | None = None,
    window: Window | Literal["drawn", "covered"] | None = None,
    parts: Mapping[str, Part] | None = None,
    tiled: bool = False,
) -> list[str]:
    """Encode an EXR into an open file, and return warnings, see `write`.

    Parameters
    ----------
    file : binary file
        Writable and seekable.
    channels, compression, half, metadata, window
        As for `write`.
    parts : mapping of str to (mapping, mapping), optional
        Further parts by name: channels of the same size and metadata of each, without `window`,
        never as half, by zip if the compression is lossy. The first part is named ``rgba``; its
        pixelAspectRatio is that of all.
    tiled : bool, default False
        Store the data window as a single tile, in place of scanlines.
    """
    choice("exr", "compression", compression, COMPRESSIONS)
    planes = flatten(channels)
    x0, y0, x1, y1 = data = _data_window(planes, window)
    rows, columns = next(iter(planes.values())).shape
    display_window = (0, 0, columns - 1, rows - 1)
    header = _header(metadata or {}, data, display_window)
    if window == "covered":
        header |= {exr_limits.OUTSIDE[name]: value for name, value in FAR.items() if name in planes}
    warnings: list[str] = []
    stored = {n: _stored(n, p[y0 : y1 + 1, x0 : x1 + 1], half, warnings) for n, p in planes.items()}
    written = [(FIRST, compression, header, stored)]
    lossless = "zip" if compression in LOSSY else compression
    if compression in LOSSY:
        kind, changed, loss = LOSSY[compression]
        if rounded := [n for n, p in stored.items() if np.issubdtype(p.dtype, kind) and n in changed]:
            warnings.append(f"{', '.join(rounded)}: {compression} {loss}")
        if layers := {name: stored.pop(name) for name in [*stored] if name not in IMAGE}:
            written.append((LAYERS, lossless, header, layers))
        if not stored or (tiled and layers):
            where = "in tiles" if tiled else "without R, G, B or A"
            raise InputError(f"exr: compression: expected a lossless one for layers {where}, found {compression}")
    for name, (part, part_metadata) in (parts or {}).items():
        if not isinstance(name, str) or not name.isprintable() or name in ("", FIRST, LAYERS):
            expected = f"names of at least one letter, other than {FIRST} and {LAYERS}"
            raise InputError(f"exr: parts: expected {expected}, found {name!r}")
        planes = flatten(part)
        if next(iter(planes.values())).shape != (rows, columns):
            raise InputError(f"exr: {name}: expected channels of {columns} x {rows} pixels, found others")
        stored = {channel: _stored(f"{name}.{channel}", plane, False, warnings) for channel, plane in planes.items()}
        shared = {"pixelAspectRatio": header["pixelAspectRatio"]}  # OpenEXR refuses parts that differ in it
        written.append((name, lossless, _header({**part_metadata, **shared}, display_window, display_window), stored))
    _compress(file, written, tiled)
    return warnings


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep OpenEXR's messages about a damaged file off the terminal: the InputError says it in one line."""
    with _LOCK, contextlib.redirect_stdout(io.StringIO()), contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError, ValueError, AttributeError):  # there may be no standard error
            sys.stderr.flush()
            saved = os.dup(2)
            stack.callback(os.close, saved)
            nowhere = os.open(os.devnull, os.O_WRONLY)
            stack.callback(os.close, nowhere)
            stack.callback(os.dup2, saved, 2)
            os.dup2(nowhere, 2)
        yield


def _plain(name: str, value: Any) -> Any:
    """Return a header value as plain Python: windows as (x0, y0, x1, y1), enumerations as lower-case words."""
    if isinstance(value, tuple) and len(value) == 2 and all(isinstance(corner, np.ndarray) for corner in value):
        return tuple(edge.item() for corner in value for edge in corner)
    if name == "compression":
        word = value.name.removesuffix("_COMPRESSION").lower()
        return "none" if word == "no" else word
    return value.name.lower() if name in ("type", "lineOrder") else value


def _decode(data: bytes, owner: str) -> list[tuple[dict[str, Array], dict[str, Any]]]:
    """Return the channels of the data window, and the header, of each part."""
    import OpenEXR

    with OpenEXR.File(io.BytesIO(data), separate_channels=True, header_only=True) as exr:
        all_attributes = [exr.header(part).items() for part in range(len(exr.parts))]
        headers = [{name: _plain(name, value) for name, value in attributes} for attributes in all_attributes]
    exr_limits.check(headers, data, owner)
    parts = []
    with OpenEXR.File(io.BytesIO(data), separate_channels=True) as exr:
        if len(exr.parts) != len(headers) or not headers:  # the only sign of unreadable pixels
            raise file_error(owner, "file", "pixels", "truncated or damaged data")
        for part, header in enumerate(headers):
            channels = {name: channel.pixels for name, channel in exr.channels(part).items()}
            x0, y0, x1, y1 = header["dataWindow"]
            del header["channels"]
            for name, plane in channels.items():
                if not isinstance(plane, np.ndarray) or plane.shape != (y1 - y0 + 1, x1 - x0 + 1):
                    raise file_error(owner, name, "a value for every pixel", "a subsampled channel")
            parts.append((channels, header))
    return parts


def _merged(parts: list[tuple[dict[str, Array], dict[str, Any]]]) -> dict[str, Array]:
    """Return the channels of all parts in the display window.

    A name that an earlier part has is prefixed with the name of its part.
    """
    merged: dict[str, Array] = {}
    for number, (channels, header) in enumerate(parts):
        for name in list(channels):
            plane = channels.pop(name)  # free the pixels as soon as they are copied
            unique = name if name not in merged else f"{header.get('name', '')}.{name}"
            unique = unique if unique not in merged else f"{number}.{unique}"
            outside = header.get(exr_limits.OUTSIDE.get(name, ""))
            fill = outside if isinstance(outside, float) and plane.dtype.kind == "f" else 0.0
            merged[unique] = _displayed(plane, header["dataWindow"], header["displayWindow"], fill)
    return merged


def _displayed(plane: Array, data: Window, display: Window, fill: float) -> Array:
    """Return the pixels of the display window, `fill` where the data window has none."""
    if data == display:
        return plane
    left, top, right, bottom = display
    shape = bottom - top + 1, right - left + 1
    displayed = np.full(shape, fill, plane.dtype) if fill else np.zeros(shape, plane.dtype)  # takes no memory yet
    x0, y0, x1, y1 = max(data[0], left), max(data[1], top), min(data[2], right) + 1, min(data[3], bottom) + 1
    if x0 < x1 and y0 < y1:
        part = plane[y0 - data[1] : y1 - data[1], x0 - data[0] : x1 - data[0]]
        displayed[y0 - top : y1 - top, x0 - left : x1 - left] = part
    return displayed


def read(path: Path) -> tuple[dict[str, Array], dict[str, Any]]:
    """Read a flat EXR file, written by clshade or any other program.

    Raises InputError, one line that names the file, if it is missing, not an EXR, truncated, damaged, deep, subsampled, or
    larger than 2^28 pixels, 2^35 bytes, the free memory or what a file of its size can hold
    (`clshade.images.exr_limits`).

    Parameters
    ----------
    path : str or path-like

    Returns
    -------
    channels : dict of str to ndarray
        One (M, N) array per channel, float32, float16 or uint32 as stored, row 0 at the top, in the
        display window. Outside the data window values are 0, or what the header says of Z and
        scalar (see `write`). R, G, B, A come first. A multi-part file gives the channels of all
        parts; a name that an earlier part has is prefixed with the name of its part and a dot.
    header : dict
        Attributes of the first part; windows as (x0, y0, x1, y1) inclusive, `compression` as in
        `write`.
    """
    owner = shown(checked_path("exr.read", "path", path))
    data = read_file(path, _MAX_BYTES)
    if not data.startswith(exr_limits.MAGIC):
        raise file_error(owner, "file", "an OpenEXR image", "something else")
    with decoding(owner, "file", "an OpenEXR image"):
        with _quiet():
            parts = _decode(data, owner)
        planes = _merged(parts)
    names = [name for name in "RGBA" if name in planes] + [name for name in planes if name not in "RGBA"]
    return {name: planes[name] for name in names}, parts[0][1]
