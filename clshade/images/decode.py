"""Decoding of image files as textures, with limits: mostly by Pillow, keeping 16 bits, and alpha on request."""

from __future__ import annotations

import io
import math
import re
import sys
import warnings
import zlib
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Array
from ..base.atomic_files import Path, shown
from ..base.input_files import decoding, file_error, quoted, read_file

MAX_BYTES = 1 << 29  # of an image file
MAX_SIDE = 32768  # pixels
MAX_PIXELS = 1 << 26  # 8192 x 8192: 768 MiB as linear float32 RGB
_LIMITS = f"at most {MAX_SIDE} pixels a side and {MAX_PIXELS} in all"
MAX_PNG_PIXELS = 1 << 28  # 16384 x 16384, as for EXR: of a PNG that is read as an image
BAND = 16  # rows of codes at a time
FORMATS = ("PNG", "JPEG", "BMP", "TGA", "TIFF", "WEBP", "GIF", "PPM")

# Pillow's decoders keep the high 8 bits per channel of a 16-bit color image. To get the low bytes: the raw mode -> the
# raw mode of the same size that selects the other byte, and the channels that then hold them.
_NATIVE_SWAPPED = "B" if sys.byteorder == "little" else "L"
_LOW_BYTES = {
    ("PNG", "RGB;16B"): ("RGB;16L", slice(0, 3)),
    ("PNG", "RGBA;16B"): ("RGBA;16L", slice(0, 4)),
    ("PNG", "LA;16B"): ("RGBA", slice(1, 4, 2)),
    **{
        ("TIFF", f"{mode};16{order}"): (f"{mode};16{other}", slice(0, channels))
        for mode, channels in (("RGB", 3), ("RGBX", 3), ("RGBA", 4), ("CMYK", 4))
        for order, other in (("L", "B"), ("B", "L"), ("N", _NATIVE_SWAPPED))
    },
}
_GRAY_16 = ("I;16", "I;16L", "I;16B", "I;16N")
_CONVERTED = {"1": "L", "La": "LA", "RGBa": "RGBA", "PA": "RGBA"}  # Pillow's modes -> gray or color of 8 bits
_CONVERTED |= dict.fromkeys(("P", "RGBX", "CMYK", "YCbCr", "LAB", "HSV"), "RGB")

# TIFF: the first bytes of files, the tags of an image, and their values.
_TIFF_SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_WIDTH, _HEIGHT, _BITS, _PHOTOMETRIC, _ORIENTATION = 256, 257, 258, 262, 274
_SAMPLES, _PLANAR, _EXTRA, _FORMAT = 277, 284, 338, 339
_NONE, _DEFLATE = 1, (8, 32946)  # compressions
_MAX_PART = 1 << 28  # values in a strip or tile: the largest image that is read may be a single one
_ASSOCIATED = 1  # associated (premultiplied) alpha

_MAX_PNM_HEADER = 1 << 16  # bytes, mostly for comments
_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_NUMBER = rb"(\d{1,9})"
# A comment may follow the last number directly; a single white space precedes the pixels.
_PNM_HEADER = re.compile(rb"P([2356])" + (_GAP + _NUMBER) * 3 + rb"(?:#[^\r\n]*)?\s")
_WORD = re.compile(rb"#[^\r\n]*|[^\s#]+")  # a comment, or a number


def srgb_to_linear(values: Array) -> Array:
    """Decode sRGB in [0, 1] to linear light with the exact curve of IEC 61966-2-1; any shape, float64."""
    values = np.asarray(values, np.float64)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


class CodedImage:
    """An image (h, w, C) in the codes of its file, a quarter or half as large as its numbers; array_like of float32.

    codes: uint8 or uint16, RGB or RGBA, row 0 at the top. colors, alphas: (K,) float32, from 0 to 1: the numbers of the
    codes 0 to K-1 in the first three channels, and in the fourth.
    """

    def __init__(self, codes: Array, colors: Array, alphas: Array) -> None:
        self.codes, self.colors, self.alphas = codes, colors, alphas

    @property
    def shape(self) -> tuple[int, ...]:
        return self.codes.shape

    def __len__(self) -> int:
        return len(self.codes)

    def __getitem__(self, part: Any) -> CodedImage:
        """Return a part: some rows, or the first three channels."""
        return CodedImage(self.codes[part], self.colors, self.alphas)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        numbers = np.empty(self.shape, np.float32)
        self.write(numbers)
        return numbers if dtype is None else numbers.astype(dtype, copy=False)

    def brightest(self) -> Array:
        """Return the largest number of each channel, (C,)."""
        largest = CodedImage(self.codes.max(axis=(0, 1))[None, None], self.colors, self.alphas)
        return np.asarray(largest).reshape(-1)

    def write(self, texels: Array) -> None:
        """Fill texels (h, w, 3 or 4) float32 with the numbers, and a channel that the image lacks with 1."""
        band = np.full((BAND, *texels.shape[1:]), len(self.colors) - 1, self.codes.dtype)
        for start in range(0, len(texels), BAND):
            codes, rows = self.codes[start : start + BAND], texels[start : start + BAND]
            band[: len(codes), :, : codes.shape[2]] = codes
            np.take(self.colors, band[: len(codes)], out=rows, mode="clip")
            if codes.shape[2] == 4 and self.alphas is not self.colors:
                rows[:, :, 3] = self.alphas[codes[:, :, 3]]


def read_image(path: Path, *, srgb: bool) -> CodedImage:
    """Read an image file, (h, w, 3), as `decode_image` decodes it; warn if an alpha channel is left out."""
    owner = shown(path)
    image = decode_image(read_file(path, MAX_BYTES), owner, srgb=srgb)
    if image.shape[2] == 4:
        warnings.warn(f"{owner}: image: its alpha channel is left out", stacklevel=2)
    return image[:, :, :3]


def decode_image(
    data: bytes | memoryview, owner: str, *, srgb: bool, count: Callable[[int], None] = lambda pixels: None
) -> CodedImage:
    """Decode an image file of one of FORMATS, (h, w, 3), or (h, w, 4) if it has alpha that is not 1 everywhere.

    Row 0 is the top. Values are code/255, code/65535 for 16 bits, and code/maximum for PPM and PGM. Gray images get three
    equal channels, palettes are resolved, of animations the first frame is used.
    srgb: whether to decode colors from sRGB to linear; alpha is never decoded. owner: the name for messages. count: called
    with the number of pixels before they are decoded; may raise an InputError.
    Raises InputError if it cannot be decoded, or is larger than MAX_SIDE or MAX_PIXELS.
    """
    with decoding(owner, "image", "an image of type " + ", ".join(FORMATS)):
        pixels, white = _decoded(data, owner, count)
    levels = np.arange(white + 1) / white
    alphas = levels.astype(np.float32)
    colors = srgb_to_linear(levels).astype(np.float32) if srgb else alphas
    channels = pixels.shape[2]
    if channels in (2, 4) and pixels[:, :, -1].min() == white:
        pixels = pixels[:, :, : channels - 1]
    if channels < 3:
        pixels = np.concatenate([np.repeat(pixels[:, :, :1], 3, axis=2), pixels[:, :, 1:]], axis=2)
    return CodedImage(pixels, colors, alphas)


def read_png(path: Path) -> tuple[Array, dict[str, Any]]:
    """Read a PNG as (h, w, C) uint8 or uint16 codes, gray, gray and alpha, RGB or RGBA; and its header.

    Raises InputError, one line naming the file, if it is missing, not a PNG, truncated, damaged or too large.
    """
    from PIL.PngImagePlugin import PngImageFile  # Image.open refuses more than 1.8e8 pixels in any format

    owner, data = shown(path), read_file(path, 1 << 31)
    with decoding(owner, "file", "a PNG image"):
        image = PngImageFile(io.BytesIO(data))
        if image.width * image.height > MAX_PNG_PIXELS:
            raise file_error(owner, "file", f"at most {MAX_PNG_PIXELS} pixels", f"{image.width} x {image.height}")
        codes, _ = _codes(image, data, owner)
    simple = (str, int, float, tuple)
    return codes, {str(name): value for name, value in image.info.items() if isinstance(value, simple)}


def _decoded(data: bytes | memoryview, owner: str, count: Callable[[int], None]) -> tuple[Array, int]:
    """Return (h, w, C) uint8 or uint16 pixels, gray, gray and alpha, RGB or RGBA, and the code of white."""
    from PIL import Image

    def admit(width: int, height: int) -> None:
        if max(width, height) > MAX_SIDE or width * height > MAX_PIXELS:
            raise file_error(owner, "image", _LIMITS, f"{width} x {height}")
        count(width * height)

    if bytes(data[:2]) in (b"P2", b"P3", b"P5", b"P6"):
        return _decoded_pnm(bytes(data), owner, admit)
    if (layout := _foreign_tiff(data)) is not None:
        admit(layout.width, layout.height)
        return _tiff_codes(data, layout, owner), 65535
    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        try:
            image = Image.open(io.BytesIO(data), formats=FORMATS)
        except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:  # of more than MAX_PIXELS
            size = re.search(r"\d+ pixels", str(error))
            raise file_error(owner, "image", _LIMITS, size.group() if size else str(error)) from None
    admit(image.width, image.height)
    return _codes(image, data, owner)


def _codes(image: Any, data: bytes | memoryview, owner: str) -> tuple[Array, int]:
    """Return (h, w, C) uint8 or uint16 pixels, gray, gray and alpha, RGB or RGBA, and the code of white."""
    raw = image.tile[0][3] if image.format in ("PNG", "TIFF") and image.tile else ""
    raw = raw if isinstance(raw, str) else raw[0]
    image.load()
    tags = image.tag_v2 if image.format == "TIFF" else {}
    if (image.format, raw) in _LOW_BYTES:
        return _keyed(_sixteen_bits(image, data, raw), image), 65535
    if image.mode in _GRAY_16 or (image.mode == "I" and raw.startswith("I;16") and not raw.endswith("S")):
        codes = np.asarray(image).astype(np.uint16)[:, :, None]
        white = 4095 if raw == "I;12" else 65535
        return _keyed(white - codes if tags.get(_PHOTOMETRIC) == 0 else codes, image), white
    keyed = "transparency" in image.info and image.mode in ("P", "L", "RGB")
    mode, bits = "RGBA" if keyed else _CONVERTED.get(image.mode, image.mode), max(tags.get(_BITS, (1,)))
    if bits > 8 or mode not in ("L", "LA", "RGB", "RGBA"):
        kind = (f"a TIFF image with channels of {bits} bits and " if bits > 8 else "") + f"pixels of type {image.mode}"
        raise file_error(owner, "image", "8 or 16 bits a channel, whole numbers from 0", kind)
    codes = np.asarray(image if mode == image.mode else image.convert(mode))
    return (codes[:, :, None] if codes.ndim == 2 else codes), 255


def _sixteen_bits(image: Any, data: bytes | memoryview, raw: str) -> Array:
    """Return the 16-bit codes, (h, w, C), of an image for which Pillow gives the high bytes."""
    low_mode, channels = _LOW_BYTES[image.format, raw]
    low = type(image)(io.BytesIO(data))
    for number, tile in enumerate(low.tile):
        arguments = low_mode if isinstance(tile[3], str) else (low_mode, *tile[3][1:])
        low.tile[number] = tile._replace(args=arguments) if hasattr(tile, "_replace") else (*tile[:3], arguments)
    low.load()
    low_bytes = np.asarray(low)[:, :, channels]
    codes: Array = np.asarray(image)[:, :, : low_bytes.shape[2]].astype(np.uint16) << 8 | low_bytes
    if image.mode != "CMYK":
        return codes
    ink = 65535 - codes.astype(np.uint32)
    paint: Array = ((ink[:, :, :3] * ink[:, :, 3:] + 32767) // 65535).astype(np.uint16)
    return paint


def _keyed(codes: Array, image: Any) -> Array:
    """Return 16-bit codes with an alpha channel that is 0 at the one transparent color of a PNG, if it has one."""
    key = image.info.get("transparency")
    if image.format != "PNG" or key is None or codes.shape[2] not in (1, 3):
        return codes
    alpha = np.where((codes == np.asarray(key, np.uint16)).all(axis=2), 0, 65535).astype(np.uint16)
    return np.concatenate([codes, alpha[:, :, None]], axis=2)


# TIFF with 16 bits per channel in layouts that Pillow lacks, or truncates to 8 bits, through tifffile.


class _Tiff(NamedTuple):
    """The layout of the first image of a file."""

    width: int
    height: int
    samples: int
    planar: bool
    orientation: int
    white_is_zero: bool
    associated: bool  # whether colors are premultiplied by alpha


def _foreign_tiff(data: bytes | memoryview) -> _Tiff | None:
    """Return the layout of a TIFF file with 16 bits per channel that Pillow gives truncated, wrong or not at all.

    None for other files and for ones too damaged to tell.
    """
    head = bytes(data[:16])
    if head[:4] not in _TIFF_SIGNATURES:
        return None
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    try:
        tags: Any = ImageFileDirectory_v2(head if head[2] == 43 or head[3] == 43 else head[:8])
        file = io.BytesIO(data)
        file.seek(tags.next)
        tags.load(file)
        samples, photometric = int(tags.get(_SAMPLES, 1)), int(tags.get(_PHOTOMETRIC, 1))
        planar, associated = tags.get(_PLANAR, 1) == 2, _ASSOCIATED in tags.get(_EXTRA, ())
        gray = photometric in (0, 1) and (samples == 2 or (planar and samples == 1))
        color = photometric == 2 and samples in (3, 4) and (planar or associated)
        if not (gray or color) or set(tags.get(_BITS, (1,))) != {16} or set(tags.get(_FORMAT, (1,))) != {1}:
            return None
        width, height, orientation = int(tags[_WIDTH]), int(tags[_HEIGHT]), int(tags.get(_ORIENTATION, 1))
        orientation = orientation if 1 <= orientation <= 8 else 1
        return _Tiff(width, height, samples, planar, orientation, photometric == 0, associated)
    except Exception:  # a damaged file raises exceptions of many types; Pillow then reports the fault
        return None


def _tiff_codes(data: bytes | memoryview, layout: _Tiff, owner: str) -> Array:
    """Return (h, w, C) uint16 gray, gray and alpha, RGB or RGBA of a file with a foreign layout and a checked size.

    Raises InputError if tifffile is not installed, and for a compression other than deflate.
    """
    import logging

    try:
        import tifffile
    except ImportError:
        expected = "tifffile, for 16 bits a channel in planes, with gray and alpha, or with associated alpha"
        raise file_error(owner, "image", expected, "none: `pip install tifffile`") from None
    rows, columns, samples = layout.height, layout.width, layout.samples
    shape = (samples, rows, columns) if layout.planar else (rows, columns, samples)
    logger = logging.getLogger("tifffile")  # it reports damaged files on standard error
    before, logger.disabled = logger.disabled, True
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            page: Any = file.pages[0]
            _check_tiff(page, shape, data, owner)
            pixels = np.asarray(page.asarray(maxworkers=1)).reshape(shape)
    finally:
        logger.disabled = before
    pixels = np.moveaxis(pixels, 0, -1) if layout.planar else pixels
    if layout.white_is_zero:
        pixels = np.concatenate([65535 - pixels[:, :, :1], pixels[:, :, 1:]], axis=2)
    if layout.associated:  # colors are divided by alpha; 0 where that is
        alpha = pixels[:, :, -1:].astype(np.uint32)
        straight = (pixels[:, :, :-1].astype(np.uint32) * 65535 + alpha // 2) // np.maximum(alpha, 1)
        straight = np.where(alpha == 0, 0, np.minimum(straight, 65535)).astype(np.uint16)
        pixels = np.concatenate([straight, pixels[:, :, -1:]], axis=2)
    # Row 0 becomes the top and column 0 the left, by the orientation of the TIFF standard.
    pixels = pixels.transpose(1, 0, 2) if layout.orientation > 4 else pixels
    down, across = (-1 if layout.orientation in turned else 1 for turned in ((3, 4, 7, 8), (2, 3, 6, 7)))
    return pixels[::down, ::across]


def _check_tiff(page: Any, shape: tuple[int, ...], data: bytes | memoryview, owner: str) -> None:
    """Raise InputError for an unsupported compression, and if the file claims or holds more data than its pixels take.

    A file of a few bytes may claim more pixels, in depth, or more or larger strips or tiles: tifffile would allocate
    all.
    """

    def require(condition: bool, expected: str, found: object) -> None:
        if not condition:
            raise file_error(owner, "image", expected, str(found))

    fits = page.size == math.prod(shape) and page.dtype == np.uint16
    require(fits, f"16-bit pixels of shape {shape}", f"{page.dtype} of shape {page.shape}")
    parts, listed, values = math.prod(page.chunked), len(page.dataoffsets), math.prod(page.chunks)
    require(parts == listed, f"{parts} strips or tiles", listed)
    require(values <= _MAX_PART, f"strips or tiles of at most {_MAX_PART} values", values)
    supported = "no compression or deflate, for 16 bits in planes, with associated alpha, or gray with alpha"
    require(page.compression in (_NONE, *_DEFLATE), supported, page.compression.name)
    for start, count in zip(page.dataoffsets, page.databytecounts, strict=True) if page.compression != _NONE else ():
        part = zlib.decompressobj().decompress(data[start : start + count], 2 * values + 1)
        require(len(part) <= 2 * values, f"at most {2 * values} bytes in a strip or tile", "more")


# Gray and RGB images of the PNM family, text and binary: Pillow keeps only 8 bits of color.


def _decoded_pnm(data: bytes, owner: str, admit: Callable[[int, int], None]) -> tuple[Array, int]:
    """Return (h, w, 1 or 3) codes of a PGM or PPM file (P2, P3, P5, P6) and its largest, white; data behind is ignored.

    admit: called with width and height before pixels are read. Raises InputError if the header is malformed, the file has
    fewer bytes than its pixels take, text stands in place of a number, or a value is above the largest.
    """
    match = _PNM_HEADER.match(data, 0, _MAX_PNM_HEADER)
    if match is None:
        raise file_error(owner, "image", "width, height and largest value of a PNM image", quoted(data[:32]))
    form, width, height, white = map(int, match.groups())
    if not (width and height and 0 < white < 1 << 16):
        expected = "a PNM image with pixels and a largest value from 1 to 65535"
        raise file_error(owner, "image", expected, f"{width} x {height} with {white}")
    shape, left = (height, width, 3 if form in (3, 6) else 1), len(data) - match.end()
    count, kind = math.prod(shape), np.dtype(np.uint8 if white < 256 else ">u2")
    size = 2 * count - 1 if form < 4 else count * kind.itemsize
    if size > left:
        raise file_error(owner, "image", f"at least {size} bytes for {width} x {height} pixels", f"{left} bytes")
    admit(width, height)
    if form < 4:
        values = np.fromiter(islice(_numbers(data, match.end(), owner), count), np.uint32)
        if len(values) < count:
            raise file_error(owner, "image", f"{count} values", str(len(values)))
    else:
        values = np.frombuffer(data, kind, count, match.end())
    if values.max() > white:
        raise file_error(owner, "image", f"values up to {white}", str(values.max()))
    return values.astype(kind.newbyteorder("="), copy=False).reshape(shape), white


def _numbers(data: bytes, start: int, owner: str) -> Iterator[int]:
    """Yield the whole numbers of a text, without its comments."""
    for match in _WORD.finditer(data, start):
        word = match[0]
        if word.isdigit() and len(word) < 10:
            yield int(word)
        elif not word.startswith(b"#"):
            raise file_error(owner, "image", "whole numbers", quoted(word))
