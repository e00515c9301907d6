"""Encoders of films: videos by PyAV, FFmpeg's libraries, in BT.709 and tagged so; animated images by Pillow."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ..base.arrays import Array, Bytes
from ..errors import InputError
from ..images.ycbcr import even, planes_420
from .film_format import FilmFormat, durations

if TYPE_CHECKING:
    from av import VideoFrame
    from PIL import Image

# ISO/IEC 23091-2 (ITU-T H.273): 1 is BT.709 as primaries, transfer and matrix. FFmpeg's color range 1 is the limited one.
TAGS = {"color_primaries": 1, "color_trc": 1, "colorspace": 1, "color_range": 1}
_HEADER, _FRAME_HEADER = 8192, 32  # bytes kept for MP4's index: more than x265's headers and five tables take
_SAMPLED_FRAMES, _SAMPLED_PIXELS = 16, 1 << 16  # that the colors of a GIF are chosen from
_MAX_DURATION = (1 << 16) - 1  # ticks
_COLORS = 255  # Pillow needs one to say that a pixel stays


def encode_video(file: BinaryIO, images: Iterable[Array], count: int, rate: Fraction, kind: FilmFormat) -> None:
    """Encode `count` images (M, N, 3), uint8 or floats in 0 to 1, as a video into an open file.

    Odd sides are made even by repeating the last row or column, as 4:2:0 asks for. An MP4's index stands before its
    frames, so that it plays while it is loaded. Raises OSError for any failure.
    """
    import av

    container = kind.ending[1:]
    # Reserved, for FFmpeg would move it there afterwards by reading a file of its own.
    reserved = {"moov_size": str(_HEADER + _FRAME_HEADER * count)} if container == "mp4" else {}
    options = kind.options
    if kind.encoder == "libx265" and count <= 2:
        # In films of one or two frames x265 4.2 leaves decoding times unset if it reorders.
        options = {**options, "x265-params": options["x265-params"] + ":bframes=0"}
    try:
        with av.open(file, "w", format=container, options=reserved) as opened:
            stream: Any = None
            for number, image in enumerate(images):
                planes = planes_420(even(image), kind.bits)
                if stream is None:
                    stream = opened.add_stream(kind.encoder, rate=rate)
                    stream.height, stream.width = planes[0].shape
                    stream.pix_fmt, stream.options = kind.pixels, options
                    stream.codec_context.time_base = 1 / rate
                    if kind.encoder == "libx265":
                        stream.codec_context.codec_tag = "hvc1"
                    for name, value in TAGS.items():
                        setattr(stream.codec_context, name, value)
                opened.mux(stream.encode(_video_frame(planes, kind.pixels, number)))
            opened.mux(stream.encode())
    except av.FFmpegError as error:
        if isinstance(error, OSError):  # some are
            raise
        raise OSError(str(error)) from error


def _video_frame(planes: tuple[Array, ...], pixel_format: str, number: int) -> VideoFrame:
    from av import VideoFrame

    rows, columns = planes[0].shape
    frame: Any = VideoFrame(columns, rows, pixel_format)
    for plane, values in zip(frame.planes, planes, strict=True):
        padded = np.zeros((len(values), plane.line_size // values.itemsize), values.dtype)
        padded[:, : values.shape[1]] = values
        plane.update(padded)
    frame.pts = number
    frame.colorspace, frame.color_range = TAGS["colorspace"], TAGS["color_range"]
    return frame  # type: ignore[no-any-return]


class _LazyImage:
    """An image of a sequence, loaded when Pillow uses it: all of them at once may not fit in memory."""

    def __init__(self, load: Callable[[int], Image.Image], index: int) -> None:
        self._load, self._index = load, index

    def __getattr__(self, name: str) -> Any:
        return getattr(self._load(self._index), name)


def encode_animation(file: BinaryIO, images: Sequence[Callable[[], Bytes]], rate: Fraction, kind: FilmFormat) -> None:
    """Encode an animated image, which loops forever, into an open file. images: load each image, uint8 (M, N, 3).

    Equal neighbors may become one frame that is shown for longer. A GIF has one palette for all frames, so that areas
    that stay do not flicker, and error diffusion (Floyd and Steinberg), without which gradients have bands. Raises
    InputError for equal frames that are shown for too long as one.
    """
    from PIL import Image

    palette = _palette(images) if kind.ending == ".gif" else None

    @lru_cache(maxsize=1)
    def load(index: int) -> Image.Image:
        image = Image.fromarray(images[index]())
        return image if palette is None else image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)

    milliseconds: Any = [ticks * 1000 // kind.ticks for ticks in durations(len(images), rate, kind.ticks)]
    others: Any = [_LazyImage(load, index) for index in range(1, len(images))]
    try:
        load(0).save(file, save_all=True, append_images=others, duration=milliseconds, loop=0, **kind.options)
    except (OverflowError, struct.error):  # of the 16 bits that hold a duration
        expected = f"an image that stays for at most {_MAX_DURATION / kind.ticks:g} s for {kind.ending}"
        raise InputError(f"film: frames: expected {expected}, found equal frames for longer") from None


def _palette(images: Sequence[Callable[[], Bytes]]) -> Image.Image:
    """Return an image that has the colors of a GIF: by median cut and k-means, from pixels on a grid in some frames."""
    from PIL import Image

    chosen = images[:: -(-len(images) // _SAMPLED_FRAMES)]
    pixels = []
    for load in chosen:
        image = load()
        step = max(1, round((image.shape[0] * image.shape[1] / (_SAMPLED_PIXELS // len(chosen))) ** 0.5))
        pixels.append(image[::step, ::step].reshape(-1, 3))
    colors = Image.fromarray(np.concatenate(pixels)[None])
    return colors.quantize(_COLORS, method=Image.Quantize.MEDIANCUT, kmeans=1, dither=Image.Dither.NONE)
