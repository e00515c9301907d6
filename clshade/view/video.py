"""The formats of films, their rates and names of files; their encoders: videos by PyAV, FFmpeg's libraries, in BT.709 and
tagged so; animated images by Pillow."""

from __future__ import annotations

import contextlib
import importlib.util
import math
import os
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from numbers import Real
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ..base.arrays import Array, Bytes
from ..base.atomic_files import Path, shown
from ..base.extras import how_to_install
from ..base.input_files import quoted
from ..base.spelling import hint
from ..errors import InputError

if TYPE_CHECKING:
    from av import VideoFrame
    from PIL import Image

MIN_RATE = Fraction(1, 10)  # frames per second
# ISO/IEC 23091-2 (ITU-T H.273): 1 is BT.709 as primaries, transfer and matrix. FFmpeg's color range 1 is the limited one.
TAGS = {"color_primaries": 1, "color_trc": 1, "colorspace": 1, "color_range": 1}
_HEADER, _FRAME_HEADER = 8192, 32  # bytes kept for MP4's index: more than x265's headers and five tables take
_SAMPLED_FRAMES, _SAMPLED_PIXELS = 16, 1 << 16  # that the colors of a GIF are chosen from
_MAX_DURATION = (1 << 16) - 1  # ticks
_COLORS = 255  # Pillow needs one to say that a pixel stays

# Y'CbCr by ITU-R BT.709-6. Written out, because the conversions of video libraries take BT.601's matrix unless told
# otherwise, round to 8 bits before they subsample, and differ between versions.
KR, KB = 0.2126, 0.0722  # weights of red and blue in luma: BT.709-6, item 3.2
KG = 1.0 - KR - KB
# Rows: Y', Cb and Cr of (R', G', B') in 0 to 1, items 3.2 and 3.3. Cb and Cr lie within -0.5 to 0.5.
MATRIX = np.array(
    [
        [KR, KG, KB],
        [-0.5 * KR / (1.0 - KB), -0.5 * KG / (1.0 - KB), 0.5],
        [0.5, -0.5 * KG / (1.0 - KR), -0.5 * KB / (1.0 - KR)],
    ]
)
_SCALES, _OFFSETS = (219.0, 224.0, 224.0), (16.0, 128.0, 128.0)  # of 8-bit codes, item 3.4


@dataclass(frozen=True)
class FilmFormat:
    """A format of film files with a depth of color."""

    ending: str  # of file names
    bits: int  # per channel
    codec: str  # its name, for people
    pixels: str  # FFmpeg's pixel format, or for people what an animated image holds
    options: dict[str, Any]  # of the encoder
    encoder: str = ""  # FFmpeg's; "" for Pillow's
    min_side: int = 1  # pixels
    max_side: int = 16384
    # Frames per second: GIF's delays are centiseconds, those of APNG and WebP milliseconds, and browsers show a frame of
    # 10 ms or less for 100 ms.
    max_rate: int = 240
    ticks: int = 0  # units of a frame's duration in a second; 0: any duration
    alpha: bool = False  # whether it keeps that of frames over nothing


# Constant quality: FFmpeg's guide to H.264 calls 17 or 18 visually lossless.
_H264 = {"crf": "16"}
_HEVC = {"crf": "16", "preset": "fast", "x265-params": "log-level=none"}
_VP9 = {"crf": "20", "b": "0", "deadline": "good", "cpu-used": "4", "row-mt": "1"}
_GIF: dict[str, Any] = {"format": "GIF", "optimize": False}
_APNG: dict[str, Any] = {"format": "PNG", "compress_level": 6}
_WEBP: dict[str, Any] = {"format": "WEBP", "lossless": True, "quality": 20, "method": 1}  # more effort gains little
FORMATS = {  # (ending, bits) -> format
    (row.ending, row.bits): row
    for row in (
        FilmFormat(".mp4", 8, "H.264", "yuv420p", _H264, "libx264", min_side=2),
        # Apple's players take HEVC that is called hvc1, and hardly any plays H.264 of 10 bits. Between 33 and 63 pixels a
        # side x265 4.2 writes past its buffers.
        FilmFormat(".mp4", 10, "HEVC", "yuv420p10le", _HEVC, "libx265", min_side=64),
        FilmFormat(".webm", 8, "VP9", "yuv420p", _VP9, "libvpx-vp9", min_side=2),
        FilmFormat(".gif", 8, "GIF", "255 colors, dithered", _GIF, max_side=65535, max_rate=50, ticks=100),
        FilmFormat(".apng", 8, "APNG", "lossless", _APNG, max_rate=90, ticks=1000, alpha=True),
        FilmFormat(".webp", 8, "WebP", "lossless", _WEBP, max_side=16383, max_rate=90, ticks=1000, alpha=True),
    )
}
ENDINGS = tuple(dict.fromkeys(ending for ending, _ in FORMATS))
_SUBSTITUTES = {  # endings of formats that are not written -> one that is
    **dict.fromkeys((".mov", ".m4v", ".avi", ".mpg", ".mpeg", ".mpeg4", ".h264", ".hevc", ".wmv", ".flv"), ".mp4"),
    **dict.fromkeys((".mkv", ".ogv", ".vp9"), ".webm"),
    ".mng": ".apng",
}


def is_film(name: str) -> bool:
    """Return whether an output is a film; False for frames. Raises InputError for a film in a format that is not
    written, or whose name has a number."""
    stem, ending = os.path.splitext(os.path.basename(name.lower()))
    if ending in ENDINGS:
        if "#" in stem:
            raise InputError(f"--output: expected a film's name without #, found {quoted(name)}")
        return True
    of_frames = ending in ("", ".exr", ".png") or "#" in stem + ending
    if not of_frames and (near := hint(ending, ENDINGS, _SUBSTITUTES)):
        expected = f"a film, {', '.join(ENDINGS)}, or frames such as out.####.exr"
        raise InputError(f"--output: expected {expected}, found {quoted(name)}{near}")
    return False


def format_of(path: Path, bits: int) -> FilmFormat:
    """Return the format of a film's name with so many bits per channel. Raises InputError for another name, if the format
    has no such depth, or if its encoder is not installed."""
    ending = os.path.splitext(os.fspath(path))[1].lower()
    if ending not in ENDINGS:
        near = hint(ending, ENDINGS, _SUBSTITUTES) if ending else ""
        raise InputError(f"film: path: expected a name that ends in {', '.join(ENDINGS)}, found {shown(path)}{near}")
    kind = FORMATS.get((ending, bits))
    if kind is None:
        expected = " or ".join(str(depth) for end, depth in FORMATS if end == ending)
        endings = [end for end, depth in FORMATS if depth == bits]
        near = f": {' and '.join(endings)} can have {bits}" if endings else ""
        raise InputError(f"--bit-depth: expected {expected} for {ending}, found {bits}{near}")
    if kind.encoder and importlib.util.find_spec("av") is None:
        needs = f"needs PyAV: `{how_to_install('film')}`; .gif, .apng and .webp need nothing more"
        raise InputError(f"{shown(path)}: {needs}")
    return kind


def checked_rate(kind: FilmFormat, fps: Any) -> Fraction:
    """Return frames per second, a number or text such as 24, 29.97 or 30000/1001, as a fraction. Raises InputError."""
    rate = math.nan
    if isinstance(fps, str | Real) and not isinstance(fps, bool):
        # As a float, from which `limit_denominator` recovers the fraction: that of the text 1e999999999 would take all
        # memory.
        with contextlib.suppress(ValueError, ZeroDivisionError, OverflowError):
            rate = float(Fraction(fps) if isinstance(fps, str) and "/" in fps else fps)
    if not float(MIN_RATE) <= rate <= kind.max_rate:
        limits = f"{float(MIN_RATE):g} to {kind.max_rate} for {kind.ending}"
        expected = f"frames per second, {limits}, such as 24 or 30000/1001"
        raise InputError(f"--fps: expected {expected}, found {quoted(str(fps))}")
    return Fraction(rate).limit_denominator(1001)


def durations(count: int, rate: Fraction, ticks: int) -> list[int]:
    """Return how long each frame is shown, in units of 1/ticks s: whole numbers whose sums are right to half a unit.

    Thirty frames per second of a GIF are shown for 3, 4, 3, 3, 4, 3, ... centiseconds.
    """
    ends = [math.floor(ticks * k / rate + Fraction(1, 2)) for k in range(count + 1)]
    return [end - start for start, end in pairwise(ends)]


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
    for image in (load() for load in chosen):
        step = max(1, round((image.shape[0] * image.shape[1] / (_SAMPLED_PIXELS // len(chosen))) ** 0.5))
        pixels.append(image[::step, ::step].reshape(-1, 3))
    colors = Image.fromarray(np.concatenate(pixels)[None])
    return colors.quantize(_COLORS, method=Image.Quantize.MEDIANCUT, kmeans=1, dither=Image.Dither.NONE)


def even(image: Array) -> Array:
    """Return the image (M, N, K) with its last row or column repeated where their number is odd."""
    return np.pad(image, ((0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)), "edge")


def planes_420(rgb: Array, bits: int = 8) -> tuple[Array, Array, Array]:
    """Convert a display image to Y'CbCr planes with 4:2:0 subsampling.

    rgb: (M, N, 3), M and N even, row 0 at the top: uint8 codes, or floats in 0 to 1.
    bits: 8 to 16, of the codes.

    Returns Y' (M, N), Cb and Cr (M/2, N/2), uint8 for 8 bits, else uint16, rounded to nearest once. A chroma sample lies
    on the left column of its 2 x 2 pixels, halfway between their rows, where decoders of H.264, HEVC and VP9 assume it
    (ITU-T H.264, figure 6-1); its weights are 1/4, 1/2, 1/4 across and 1/2, 1/2 down.
    """
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.shape[0] % 2 or rgb.shape[1] % 2 or 0 in rgb.shape:
        raise InputError(f"ycbcr: rgb: expected shape (M, N, 3), M and N even, found {rgb.shape}")
    values = rgb.astype(np.float32) / np.float32(255.0) if rgb.dtype == np.uint8 else rgb.astype(np.float32)
    rows = (values[0::2] + values[1::2]) * np.float32(0.5)
    left = np.concatenate([rows[:, :1], rows[:, 1:-1:2]], axis=1)
    small = (left + rows[:, 1::2]) * np.float32(0.25) + rows[:, 0::2] * np.float32(0.5)
    planes = []
    for weights, scale, offset, image in zip(MATRIX, _SCALES, _OFFSETS, (values, small, small), strict=True):
        unit = 2.0 ** (bits - 8)
        plane = image @ (weights * scale * unit).astype(np.float32) + np.float32(offset * unit + 0.5)
        planes.append(plane.astype(np.uint8 if bits == 8 else np.uint16))
    y, cb, cr = planes
    return y, cb, cr
