"""Decoding of image files as textures, with limits: mostly by Pillow, keeping 16 bits, and alpha on request."""

from __future__ import annotations

import io
import re
import sys
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.atomic_files import Path, shown
from ..base.input_files import file_error, read_file, reason_of
from ..errors import InputError
from . import pnm, tiff

MAX_BYTES = 1 << 29  # of an image file
MAX_SIDE = 32768  # pixels
MAX_PIXELS = 1 << 26  # 8192 x 8192: 768 MiB as linear float32 RGB
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
_TO_RGB = ("P", "PA", "RGBX", "RGBa", "CMYK", "YCbCr", "LAB", "HSV")


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
            codes, some = self.codes[start : start + BAND], texels[start : start + BAND]
            band[: len(codes), :, : codes.shape[2]] = codes
            np.take(self.colors, band[: len(codes)], out=some, mode="clip")
            if codes.shape[2] == 4 and self.alphas is not self.colors:
                some[:, :, 3] = self.alphas[codes[:, :, 3]]


def read_image(path: Path, *, srgb: bool) -> CodedImage:
    """Read an image file, (h, w, 3), row 0 at the top.

    srgb: whether to decode the values from sRGB to linear; otherwise they are value/255, value/65535 for 16 bits, and
    for PPM and PGM images value/most, where most is the file's largest value.
    Gray images get three equal channels, palettes are resolved, of animations the first frame is used. Alpha is
    dropped, with a warning unless it is opaque everywhere. Formats: see FORMATS.

    Raises InputError naming the file if it cannot be read or decoded, or is larger than MAX_SIDE or MAX_PIXELS.
    """
    owner = shown(path)
    image = decode_image(read_file(path, MAX_BYTES), owner, srgb=srgb)
    if image.shape[2] == 4:
        warnings.warn(f"{owner}: image: its alpha channel is left out", stacklevel=2)
    return image[:, :, :3]


def decode_image(
    data: bytes | memoryview, owner: str, *, srgb: bool, count: Callable[[int], None] = lambda pixels: None
) -> CodedImage:
    """Decode an image file, (h, w, 3), or (h, w, 4) if it has alpha that is not 1 everywhere.

    Row 0 is the top. srgb: see read_image; alpha is never decoded. owner: the name for messages. count: is told the number
    of pixels before they are decoded, and may raise an InputError.
    Raises InputError if it cannot be decoded, or is larger than MAX_SIDE or MAX_PIXELS.
    """
    try:
        pixels, most = _decoded(data, owner, count)
    except (InputError, ImportError):
        raise
    except Exception as error:  # decoders raise exceptions of many types on damaged files
        reason = reason_of(error) or type(error).__name__
        raise file_error(owner, "image", "an image of type " + ", ".join(FORMATS), reason) from None
    levels = np.arange(most + 1) / most
    alphas = levels.astype(np.float32)
    colors = srgb_to_linear(levels).astype(np.float32) if srgb else alphas
    channels = pixels.shape[2]
    if channels in (2, 4) and pixels[:, :, -1].min() == most:
        pixels = pixels[:, :, : channels - 1]
    if channels < 3:
        pixels = np.concatenate([np.repeat(pixels[:, :, :1], 3, axis=2), pixels[:, :, 1:]], axis=2)
    return CodedImage(pixels, colors, alphas)


def decode_png(data: bytes | memoryview, owner: str, *, most_pixels: int) -> tuple[Array, dict[str, Any]]:
    """Decode a PNG to (h, w, C) uint8 or uint16 codes, gray, gray and alpha, RGB or RGBA; and its header.

    Raises InputError if it cannot be decoded, or is larger than MAX_SIDE or `most_pixels`.
    """
    try:
        image = _opened(data, owner, most_pixels, formats=("PNG",))
        codes, _ = _codes(image, data, owner)
    except (InputError, ImportError):
        raise
    except Exception as error:  # decoders raise exceptions of many types on damaged files
        raise file_error(owner, "file", "a PNG image", reason_of(error) or "damaged data") from None
    return codes, {name: value for name, value in image.info.items() if isinstance(value, (str, int, float, tuple))}


def _decoded(data: bytes | memoryview, owner: str, count: Callable[[int], None]) -> tuple[Array, int]:
    """Return (h, w, C) uint8 or uint16 pixels, gray, gray and alpha, RGB or RGBA, and the code of white."""
    if bytes(data[:1]) == b"P":
        data = bytes(data)
        head = pnm.header(data, owner)
        if head is not None:
            _check_size(head.width, head.height, owner, MAX_PIXELS)
            count(head.width * head.height)
            return pnm.codes(data, head, owner), head.most
    layout = tiff.layout(data)
    if layout is not None and layout.is_foreign:
        _check_size(layout.width, layout.height, owner, MAX_PIXELS)
        count(layout.width * layout.height)
        return tiff.codes(data, layout, owner), 65535
    image = _opened(data, owner, MAX_PIXELS)
    count(image.width * image.height)
    codes, most = _codes(image, data, owner)
    if layout is not None and layout.photometric == 0 and layout.bits > 8:  # 0 is white
        codes = most - codes
    return codes, most


def _check_size(width: int, height: int, owner: str, most_pixels: int, found: str = "") -> None:
    if max(width, height) > MAX_SIDE or width * height > most_pixels:
        expected = f"at most {MAX_SIDE} pixels a side and {most_pixels} in all"
        raise file_error(owner, "image", expected, found or f"{width} x {height}")


def _opened(data: bytes | memoryview, owner: str, most_pixels: int, formats: tuple[str, ...] = FORMATS) -> Any:
    """Return Pillow's image, not yet decoded."""
    from PIL import Image, PngImagePlugin

    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        try:
            if formats == ("PNG",):  # Image.open refuses more than 1.8e8 pixels in any format
                image: Any = PngImagePlugin.PngImageFile(io.BytesIO(data))
            else:
                image = Image.open(io.BytesIO(data), formats=formats)
            (width, height), found = image.size, ""
        except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
            width = height = MAX_SIDE + 1
            size = re.search(r"\d+ pixels", str(error))
            found = size.group() if size else str(error)
    _check_size(width, height, owner, most_pixels, found)
    return image


def _codes(image: Any, data: bytes | memoryview, owner: str) -> tuple[Array, int]:
    """Return (h, w, C) uint8 or uint16 pixels, gray, gray and alpha, RGB or RGBA, and the code of full intensity."""
    raw = image.tile[0][3] if image.format in ("PNG", "TIFF") and image.tile else ""
    raw = raw if isinstance(raw, str) else raw[0]
    image.load()
    if (image.format, raw) in _LOW_BYTES:
        return _keyed(_sixteen_bits(image, data, raw), image), 65535
    if image.mode in _GRAY_16 or (image.mode == "I" and raw.startswith("I;16") and not raw.endswith("S")):
        codes = np.asarray(image).astype(np.uint16)[:, :, None]
        return _keyed(codes, image), 4095 if raw == "I;12" else 65535
    if image.format == "TIFF" and max(image.tag_v2.get(258, (1,))) > 8:
        found = f"a TIFF image with channels of {max(image.tag_v2[258])} bits and pixels of type {image.mode}"
        raise file_error(owner, "image", "8 or 16 bits a channel, whole numbers from 0", found)
    return _eight_bits(image, owner), 255


def _sixteen_bits(image: Any, data: bytes | memoryview, raw: str) -> Array:
    """Return the 16-bit codes, (h, w, C), of an image for which Pillow gives the high bytes."""
    from PIL import Image

    low_mode, channels = _LOW_BYTES[image.format, raw]
    low: Any = Image.open(io.BytesIO(data), formats=(image.format,)) if image.format != "PNG" else _png(data)
    low.tile = [_decoded_as(tile, low_mode) for tile in low.tile]
    low.load()
    low_bytes = np.asarray(low)[:, :, channels]
    codes: Array = np.asarray(image)[:, :, : low_bytes.shape[2]].astype(np.uint16) << 8 | low_bytes
    if image.mode != "CMYK":
        return codes
    ink = 65535 - codes.astype(np.uint32)
    paint: Array = ((ink[:, :, :3] * ink[:, :, 3:] + 32767) // 65535).astype(np.uint16)
    return paint


def _decoded_as(tile: Any, raw: str) -> Any:
    """Return a tile of one of Pillow's images with another raw mode and otherwise the same arguments of its decoder."""
    arguments = raw if isinstance(tile[3], str) else (raw, *tile[3][1:])
    return tile._replace(args=arguments) if hasattr(tile, "_replace") else (*tile[:3], arguments)


def _png(data: bytes | memoryview) -> Any:
    from PIL import PngImagePlugin

    return PngImagePlugin.PngImageFile(io.BytesIO(data))


def _keyed(codes: Array, image: Any) -> Array:
    """Return 16-bit codes with an alpha channel that is 0 at the one transparent color of a PNG, if it has one."""
    key = image.info.get("transparency")
    if image.format != "PNG" or key is None or codes.shape[2] not in (1, 3):
        return codes
    alpha = np.where((codes == np.asarray(key, np.uint16)).all(axis=2), 0, 65535).astype(np.uint16)
    return np.concatenate([codes, alpha[:, :, None]], axis=2)


def _eight_bits(image: Any, owner: str) -> Array:
    mode = image.mode
    if mode in ("1", "La"):
        image = image.convert("L" if mode == "1" else "LA")
    elif "transparency" in image.info and mode in ("P", "L", "RGB"):
        image = image.convert("RGBA")
    elif mode in _TO_RGB:
        image = image.convert("RGBA" if mode in ("RGBa", "PA") else "RGB")
    elif mode not in ("L", "LA", "RGB", "RGBA"):
        raise file_error(owner, "image", "8 or 16 bits a channel, whole numbers from 0", f"pixels of type {mode}")
    pixels = np.asarray(image)
    return pixels[:, :, None] if pixels.ndim == 2 else pixels
