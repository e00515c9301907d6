"""Image files as textures: decoded by Pillow under limits, 16 bits kept, alpha kept where it is asked for."""

from __future__ import annotations

import io
import os
import warnings
from typing import Any

import numpy as np

from .atomic import Path, shown
from .errors import InputError
from .reading import complaint, read_file
from .scene import Texture
from .validation import Array

MAX_BYTES = 1 << 29  # of an image file
MAX_SIDE = 32768  # pixels; scene.Texture takes no more
MAX_PIXELS = 1 << 26  # 8192 x 8192: 768 MiB as linear float32 RGB
FORMATS = ("PNG", "JPEG", "BMP", "TGA", "TIFF", "WEBP", "GIF", "PPM")

# How Pillow's PNG decoder, which keeps 8 bits a channel of a 16-bit color image, is told to give the low bytes: its raw
# mode, the raw mode of the same size that shows the other byte, and the channels that then hold them.
_LOW_BYTES = {
    "RGB;16B": ("RGB;16L", slice(0, 3)),
    "RGBA;16B": ("RGBA;16L", slice(0, 4)),
    "LA;16B": ("RGBA", slice(1, 4, 2)),
}
_GREY_16 = ("I;16", "I;16L", "I;16B", "I;16N")
_TO_RGB = ("P", "PA", "RGBX", "RGBa", "CMYK", "YCbCr", "LAB", "HSV")


def srgb_to_linear(values: Array) -> Array:
    """Decode sRGB in [0, 1] to linear light with the exact curve of IEC 61966-2-1; any shape, float64."""
    values = np.asarray(values, np.float64)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def read_image(path: Path, *, srgb: bool) -> Array:
    """An image file as (h, w, 3) float32, row 0 at the top.

    srgb: whether the values are decoded from sRGB to linear; otherwise they are value/255, or value/65535 for 16 bits.
    Grey images get three equal channels, palettes are resolved, of animations the first picture is taken. Alpha is
    dropped, with a warning when it is not opaque everywhere. Formats: see FORMATS.

    Raises InputError naming the file when it cannot be read or decoded, or is larger than MAX_SIDE or MAX_PIXELS.
    """
    owner = shown(path)
    image = decode_image(read_file(path, MAX_BYTES), owner, srgb=srgb)
    if image.shape[2] == 4:
        warnings.warn(f"{owner}: image: its alpha channel is left out", stacklevel=2)
    return image[:, :, :3]


def decode_image(data: bytes | memoryview, owner: str, *, srgb: bool) -> Array:
    """The bytes of an image file as (h, w, 3) float32, or (h, w, 4) where it has alpha that is not 1 everywhere.

    Row 0 is the top. srgb: see read_image; alpha is never decoded. owner: the name for messages.
    Raises InputError when it cannot be decoded, or is larger than MAX_SIDE or MAX_PIXELS.
    """
    try:
        pixels = _codes(_opened(data, owner, MAX_PIXELS), data, owner)
    except (InputError, ImportError):
        raise
    except Exception as error:  # a decoder fed with a broken file raises anything at all
        reason = " ".join(str(error).split()) or type(error).__name__
        raise complaint(owner, "image", "an image of type " + ", ".join(FORMATS), reason[:160]) from None
    most = np.iinfo(pixels.dtype).max
    levels = np.arange(most + 1) / most
    plain = levels.astype(np.float32)
    table = srgb_to_linear(levels).astype(np.float32) if srgb else plain
    channels = pixels.shape[2]
    if channels in (2, 4) and pixels[:, :, -1].min() < most:
        image = np.empty((*pixels.shape[:2], 4), np.float32)
        image[:, :, :3] = table[pixels[:, :, :-1]]
        image[:, :, 3] = plain[pixels[:, :, -1]]
        return image
    return np.broadcast_to(table[pixels[:, :, : 3 if channels > 2 else 1]], (*pixels.shape[:2], 3))


def decode_png(data: bytes | memoryview, owner: str, *, most_pixels: int) -> tuple[Array, dict[str, Any]]:
    """The bytes of a PNG as (h, w, C) uint8 or uint16 codes, grey, grey and alpha, RGB or RGBA; and its header.

    Raises InputError when it cannot be decoded, or is larger than MAX_SIDE or `most_pixels`.
    """
    try:
        image = _opened(data, owner, most_pixels, formats=("PNG",))
        codes = _codes(image, data, owner)
    except (InputError, ImportError):
        raise
    except Exception as error:  # a decoder fed with a broken file raises anything at all
        raise complaint(owner, "file", "a PNG image", " ".join(str(error).split())[:160] or "damaged data") from None
    return codes, {name: value for name, value in image.info.items() if isinstance(value, (str, int, float, tuple))}


def _opened(data: bytes | memoryview, owner: str, most_pixels: int, formats: tuple[str, ...] = FORMATS) -> Any:
    """Pillow's image, not yet decoded."""
    from PIL import Image, PngImagePlugin

    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        try:
            if formats == ("PNG",):  # Image.open refuses more than 1.8e8 pixels of whatever format
                image: Any = PngImagePlugin.PngImageFile(io.BytesIO(data))
            else:
                image = Image.open(io.BytesIO(data), formats=formats)
            width, height = image.size
            found = f"{width} x {height}"
        except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
            width = height = MAX_SIDE + 1
            found = str(error)
    if max(width, height) > MAX_SIDE or width * height > most_pixels:
        raise complaint(owner, "image", f"at most {MAX_SIDE} pixels a side and {most_pixels} in all", found)
    return image


def _codes(image: Any, data: bytes | memoryview, owner: str) -> Array:
    """(h, w, C) uint8 or uint16 pixels: grey, grey and alpha, RGB or RGBA."""
    raw = image.tile[0][3] if image.format == "PNG" and image.tile else ""
    raw = raw if isinstance(raw, str) else raw[0]
    image.load()
    if raw in _LOW_BYTES:
        return _sixteen_bits(np.asarray(image), data, raw)
    return _eight_or_grey(image, raw, owner)


def _sixteen_bits(high: Array, data: bytes | memoryview, raw: str) -> Array:
    """The 16-bit colors of a PNG from its high bytes (h, w, C), as Pillow gives them, and its low bytes."""
    from PIL import PngImagePlugin

    low_mode, channels = _LOW_BYTES[raw]
    image: Any = PngImagePlugin.PngImageFile(io.BytesIO(data))
    image.tile = [(*image.tile[0][:3], low_mode)]
    low = np.asarray(image)[:, :, channels]
    return high[:, :, : low.shape[2]].astype(np.uint16) << 8 | low


def _eight_or_grey(image: Any, raw: str, owner: str) -> Array:
    mode = image.mode
    if mode in _GREY_16 or (mode == "I" and raw.startswith("I;16")):
        return np.asarray(image).astype(np.uint16)[:, :, None]
    if mode in ("1", "La"):
        image = image.convert("L" if mode == "1" else "LA")
    elif "transparency" in image.info and mode in ("P", "L", "RGB"):
        image = image.convert("RGBA")
    elif mode in _TO_RGB:
        image = image.convert("RGBA" if mode in ("RGBa", "PA") else "RGB")
    elif mode not in ("L", "LA", "RGB", "RGBA"):
        raise complaint(owner, "image", "8 bits a channel, or 16 bits and grey or PNG", f"pixels of type {mode}")
    pixels = np.asarray(image)
    return pixels[:, :, None] if pixels.ndim == 2 else pixels


def as_texture(source: Any, *, srgb: bool, lookup: str = "standard") -> Texture:
    """A Texture from an image file's path, an array (see scene.Texture: taken as linear) or a Texture (as it is)."""
    if isinstance(source, Texture):
        return source
    if isinstance(source, (str, os.PathLike)):
        return Texture(read_image(source, srgb=srgb), lookup=lookup, name=os.path.basename(os.fspath(source)))
    return Texture(source, lookup=lookup)
