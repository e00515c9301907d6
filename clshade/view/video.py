"""Videos by PyAV, FFmpeg's libraries: H.264 or HEVC in MP4, VP9 in WebM. BT.709 throughout, and tagged so."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ..base.arrays import Array
from ..images.ycbcr import even, planes_420
from .film_format import FilmFormat

if TYPE_CHECKING:
    from av import VideoFrame

# ISO/IEC 23091-2 (ITU-T H.273): 1 is BT.709 as primaries, transfer and matrix. FFmpeg's color range 1 is the limited one.
TAGS = {"color_primaries": 1, "color_trc": 1, "colorspace": 1, "color_range": 1}


@dataclass(frozen=True)
class Codec:
    """name: as people know it. container, encoder, options: FFmpeg's. least: fewest pixels a side."""

    name: str
    container: str
    encoder: str
    pixel_format: str
    options: dict[str, str]
    least: int = 2


# Constant quality: FFmpeg's guide to H.264 calls 17 or 18 visually lossless.
CODECS = {
    (".mp4", 8): Codec("H.264", "mp4", "libx264", "yuv420p", {"crf": "16"}),
    # Apple's players take HEVC that is called hvc1, and hardly any plays H.264 of 10 bits. Between 33 and 63 pixels a side
    # x265 4.2 writes past its buffers.
    (".mp4", 10): Codec(
        "HEVC", "mp4", "libx265", "yuv420p10le", {"crf": "16", "preset": "fast", "x265-params": "log-level=none"}, 64
    ),
    (".webm", 8): Codec(
        "VP9",
        "webm",
        "libvpx-vp9",
        "yuv420p",
        {"crf": "20", "b": "0", "deadline": "good", "cpu-used": "4", "row-mt": "1"},
    ),
}
_HEADER, _HEADER_OF_A_FRAME = 8192, 32  # bytes kept for MP4's index: more than x265's headers and five tables take


def codec_of(kind: FilmFormat, bits: int) -> Codec:
    return CODECS[kind.ending, bits]


def encode(file: BinaryIO, images: Iterable[Array], count: int, rate: Fraction, codec: Codec) -> None:
    """Encode `count` images (M, N, 3), uint8 or floats in 0 to 1, as a video into an open file.

    Odd sides are made even by repeating the last row or column, as 4:2:0 asks for. An MP4's index stands before its
    frames, so that it plays while it is loaded. Raises OSError for any failure.
    """
    import av

    # Reserved, for FFmpeg would move it there afterwards by reading a file of its own.
    options = {"moov_size": str(_HEADER + _HEADER_OF_A_FRAME * count)} if codec.container == "mp4" else {}
    with _as_oserror(), av.open(file, "w", format=codec.container, options=options) as opened:
        stream: Any = None
        for number, image in enumerate(images):
            planes = planes_420(even(image), 10 if codec.pixel_format.endswith("10le") else 8)
            if stream is None:
                stream = opened.add_stream(codec.encoder, rate=rate)
                stream.height, stream.width = planes[0].shape
                stream.pix_fmt, stream.options = codec.pixel_format, _options(codec, count)
                stream.codec_context.time_base = 1 / rate
                if codec.encoder == "libx265":
                    stream.codec_context.codec_tag = "hvc1"
                for name, value in TAGS.items():
                    setattr(stream.codec_context, name, value)
            opened.mux(stream.encode(_frame(planes, codec.pixel_format, number)))
        opened.mux(stream.encode())


def _options(codec: Codec, count: int) -> dict[str, str]:
    """Return the encoder's options. In films of one or two frames x265 4.2 leaves decoding times unset if it reorders."""
    if codec.encoder == "libx265" and count <= 2:
        return {**codec.options, "x265-params": codec.options["x265-params"] + ":bframes=0"}
    return codec.options


def _frame(planes: tuple[Array, ...], pixel_format: str, number: int) -> VideoFrame:
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


@contextmanager
def _as_oserror() -> Iterator[None]:
    """Turn FFmpeg's errors, some of which are OSErrors already, into OSErrors."""
    from av import FFmpegError

    try:
        yield
    except FFmpegError as error:
        if isinstance(error, OSError):
            raise
        raise OSError(str(error)) from error
