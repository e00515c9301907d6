"""Encoded films, read back: videos by PyAV, animated images by Pillow; names, rates and depths."""

from __future__ import annotations

import importlib.util
import io
from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from PIL import Image

from clshade.errors import InputError
from clshade.view import video
from clshade.view.video import FORMATS, checked_rate, durations, format_of, is_film

needs_av = pytest.mark.skipif(importlib.util.find_spec("av") is None, reason="PyAV is not installed")

SIDE = 32  # pixels of a patch
COLORS = np.array(
    [
        *((255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (0, 255, 255), (255, 0, 255)),
        *((255, 255, 255), (0, 0, 0), (200, 120, 40), (40, 120, 200), (128, 128, 128)),
    ],
    np.float64,
)
COUNT = 7


def card(number: int) -> np.ndarray:
    """Return a test card: 3 rows of 4 patches, float64 codes of 8 bits; the gray of the last one is the frame's number."""
    colors = np.vstack([COLORS, np.full((1, 3), 30.0 * number)]).reshape(3, 4, 3)
    return np.repeat(np.repeat(colors, SIDE, axis=0), SIDE, axis=1)


def images(bits: int = 8) -> list[np.ndarray]:
    return [card(k).astype(np.uint8) if bits == 8 else card(k) / 255.0 for k in range(COUNT)]


def encoded(ending: str, frames: list[np.ndarray], bits: int = 8, rate: Fraction | int = 25) -> bytes:
    file, kind = io.BytesIO(), FORMATS[ending, bits]
    if kind.encoder:
        video.encode_video(file, frames, len(frames), Fraction(rate), kind)
    else:
        video.encode_animation(file, [partial(lambda frame: frame, image) for image in frames], Fraction(rate), kind)
    return file.getvalue()


# Videos


def planes_of(frame) -> list[np.ndarray]:
    """Return the codes of a decoded frame's planes."""
    dtype = np.uint16 if frame.format.name.endswith("10le") else np.uint8
    planes = []
    for plane in frame.planes:
        rows = np.frombuffer(plane, dtype).reshape(plane.height, -1)
        planes.append(rows[:, : plane.width].astype(np.float64))
    return planes


def rgb_of(y: np.ndarray, cb: np.ndarray, cr: np.ndarray, bits: int, kr: float = 0.2126, kb: float = 0.0722):
    """Invert limited-range Y'CbCr: 8-bit codes, float64. Default: BT.709; kr=0.299, kb=0.114 are BT.601's."""
    scale = 2.0 ** (bits - 8)
    y, cb, cr = (y / scale - 16) / 219, (cb / scale - 128) / 224, (cr / scale - 128) / 224
    r, b = y + 2 * (1 - kr) * cr, y + 2 * (1 - kb) * cb
    return 255 * np.stack([r, (y - kr * r - kb * b) / (1 - kr - kb), b], axis=-1)


def centers(frame, bits: int, **weights: float) -> np.ndarray:
    """Return the colors in the middle of a card's patches, (12, 3)."""
    y, cb, cr = planes_of(frame)
    middle = np.arange(3)[:, None] * SIDE + SIDE // 2, np.arange(4)[None] * SIDE + SIDE // 2
    small = tuple(index // 2 for index in middle)
    return rgb_of(y[middle], cb[small], cr[small], bits, **weights).reshape(12, 3)


@needs_av
@pytest.mark.parametrize(
    ("ending", "bits", "codec", "pixel_format"),
    [(".mp4", 8, "h264", "yuv420p"), (".mp4", 10, "hevc", "yuv420p10le"), (".webm", 8, "vp9", "yuv420p")],
)
def test_a_video_read_back(ending, bits, codec, pixel_format):
    import av

    data = encoded(ending, images(bits), bits)
    with av.open(io.BytesIO(data)) as container:
        stream = container.streams.video[0]
        context = stream.codec_context
        assert (context.name, stream.average_rate) == (codec, 25)
        tags = (context.color_primaries, context.color_trc, context.colorspace, context.color_range)
        assert tags == (1, 1, 1, 1)  # BT.709, BT.709, BT.709, limited
        assert container.duration == pytest.approx(1e6 * COUNT / 25, abs=1000)  # WebM counts milliseconds
        frames = list(container.decode(video=0))
    assert [frame.format.name for frame in frames] == [pixel_format] * COUNT
    assert {(frame.width, frame.height) for frame in frames} == {(4 * SIDE, 3 * SIDE)}
    # A code of a plane is off by 1/2 for rounding. A flat block of a quantizer's step 4 (QP 16; a 4 x 4 transform scales
    # it by 4) may be off by 1/2, too. Blue adds both of Y' (255/219) and Cb (1.8556 * 255/224): 3.3 codes of 8 bits.
    bound = 3.3
    for number, frame in enumerate(frames):
        error = np.abs(centers(frame, bits) - card(number)[SIDE // 2 :: SIDE, SIDE // 2 :: SIDE].reshape(12, 3))
        assert error.max() <= bound, number
    wrong = np.abs(centers(frames[0], bits, kr=0.299, kb=0.114) - np.vstack([COLORS, [[0, 0, 0]]]))
    assert wrong.max() > 10 * bound  # with the matrix of BT.601


@needs_av
def test_ten_bits_come_from_floats():
    """Grays a quarter of an 8-bit code apart, in 10 bits 3.4 codes of 8 bits: each has a code of its own."""
    import av

    grays = 0.5 + np.arange(4) / 3.0 / 255.0
    image = np.repeat(np.repeat(grays[None, :, None], 64, axis=0), 64, axis=1) * np.ones(3)
    with av.open(io.BytesIO(encoded(".mp4", [image], 10))) as container:
        (frame,) = container.decode(video=0)
    codes = planes_of(frame)[0][32, 32::64]
    assert np.abs(codes - (219 * grays + 16) * 4).max() <= 1.0
    assert (np.diff(codes) >= 1).all()


@pytest.mark.sampled
@needs_av
@pytest.mark.parametrize("count", [1, 2, 3])
def test_frames_of_short_films_have_times(count):
    """Unset times, as x265 gave one or two frames, held whatever the memory held: some of 40 films failed."""
    import av

    for _ in range(40):
        with av.open(io.BytesIO(encoded(".mp4", [np.full((64, 256, 3), 0.5)] * count, 10))) as container:
            packets = [packet for packet in container.demux(video=0) if packet.size]
        assert sorted(packet.pts * packet.time_base * 25 for packet in packets) == list(range(count))
        assert all(-4 <= packet.dts * packet.time_base * 25 <= packet.pts * packet.time_base * 25 for packet in packets)


@needs_av
@pytest.mark.parametrize(("ending", "size"), [(".mp4", (5, 3)), (".mp4", (1, 1)), (".webm", (33, 24))])
def test_odd_sizes_are_made_even(ending, size):
    import av

    columns, rows = size
    image = np.random.default_rng(1).integers(0, 256, (rows, columns, 3)).astype(np.uint8)
    with av.open(io.BytesIO(encoded(ending, [image] * 2))) as container:
        frames = list(container.decode(video=0))
    assert [(frame.width, frame.height) for frame in frames] == [(columns + columns % 2, rows + rows % 2)] * 2


@needs_av
def test_a_fraction_as_rate_and_an_index_before_the_frames():
    import av

    data = encoded(".mp4", images() * 40, rate=Fraction(30000, 1001))
    with av.open(io.BytesIO(data)) as container:
        stream = container.streams.video[0]
        assert (stream.average_rate, stream.frames) == (Fraction(30000, 1001), 40 * COUNT)
        assert stream.duration * stream.time_base == Fraction(40 * COUNT * 1001, 30000)
    assert 0 < data.find(b"moov") < data.find(b"mdat")


@needs_av
def test_what_ffmpeg_reports_is_an_oserror():
    """It becomes an OutputError that names the film."""

    class Full(io.BytesIO):
        def write(self, data):
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        video.encode_video(Full(), images(), COUNT, Fraction(25), FORMATS[".mp4", 8])
    with pytest.raises(OSError, match="Invalid argument"):
        encoded(".mp4", [np.zeros((8, 8, 3))], 10)  # smaller than x265 takes; `draw_film` refuses it before


# Animated images


def shown(data: bytes) -> tuple[list[np.ndarray], list[float], dict]:
    """Return pixels and durations of the frames of an animated image, and facts about it."""
    with Image.open(io.BytesIO(data)) as film:
        pixels, durations_ms = [], []
        for number in range(film.n_frames):
            film.seek(number)
            pixels.append(np.asarray(film.convert("RGB")).astype(int))
            film.load()
            durations_ms.append(film.info.get("duration", 0.0))
        return pixels, durations_ms, film.info


@pytest.mark.parametrize("ending", [".gif", ".apng", ".webp"])
def test_an_animation_read_back(ending):
    """The card has few colors, which a GIF keeps as well. One frame is a film, too; equal frames are shown for as long."""
    pixels, durations_ms, info = shown(encoded(ending, images(), rate=24))
    np.testing.assert_array_equal(pixels, [card(number) for number in range(COUNT)])
    assert info["loop"] == 0
    assert sum(durations_ms) == pytest.approx(1000 * COUNT / 24, abs=5 if ending == ".gif" else 0.5)
    np.testing.assert_array_equal(shown(encoded(ending, images()[:1]))[0], [card(0)])
    equal = [images()[0]] * 3 + [images()[1]] * 2
    assert sum(shown(encoded(ending, equal, rate=25))[1]) == 200


def test_a_gif_has_one_palette_and_dithers():
    """Without error diffusion the means of a gradient's blocks would be off by up to half the distance of two colors."""
    ramp = np.linspace(0, 255, 96)
    image = np.stack([*np.meshgrid(ramp, ramp), np.full((96, 96), 60.0)], axis=-1).astype(np.uint8)
    frames = [np.roll(image, 5 * k, axis=1) for k in range(3)]
    with Image.open(io.BytesIO(encoded(".gif", frames))) as film:
        palettes = []
        for number in range(3):
            film.seek(number)
            palettes.append(film.tile[0][3] and film.global_palette.getdata()[1])
            pixels = np.asarray(film.convert("RGB")).astype(float)
    assert palettes[0] == palettes[1] == palettes[2]
    blocks = (pixels - frames[2]).reshape(6, 16, 6, 16, 3).mean(axis=(1, 3))
    assert np.abs(blocks).max() < 4
    assert np.abs(pixels - frames[2]).max() > 8


def test_a_gif_of_one_image_for_too_long_is_refused():
    images = [lambda: np.zeros((2, 3, 3), np.uint8)] * 66
    message = r"^film: frames: expected .* 655\.35 s for \.gif, found equal frames for longer"
    with pytest.raises(InputError, match=message):
        video.encode_animation(io.BytesIO(), images, Fraction(1, 10), FORMATS[".gif", 8])


# Rates and names


@pytest.mark.parametrize(
    ("rate", "ticks", "expected"),
    [(30, 100, [3, 4, 3, 3, 4, 3]), (50, 100, [2, 2, 2]), (60, 1000, [17, 16, 17, 17, 16, 17])],
)
def test_durations_add_up(rate, ticks, expected):
    assert durations(len(expected), Fraction(rate), ticks) == expected
    many = np.cumsum(durations(1000, Fraction(rate), ticks))
    exact = np.arange(1, 1001) * ticks / float(rate)
    assert np.abs(many - exact).max() <= 0.5 + 1e-9


def test_rates():
    for text, rate in (
        ("24", 24),
        (30, 30),
        ("23.976", Fraction(2997, 125)),
        ("30000/1001", Fraction(30000, 1001)),
        (np.float32(12.5), Fraction(25, 2)),
        ("0.1", Fraction(1, 10)),
    ):
        assert checked_rate(FORMATS[".mp4", 8], text) == rate
    assert checked_rate(FORMATS[".gif", 8], 50) == 50


@pytest.mark.parametrize(
    "fps", ["0", "-3", "nan", "inf", "x", "", "1/0", "1e99999", "1e-999999999", "9" * 50, "241", 0.05, None, True, [3]]
)
def test_refused_rates(fps):
    with pytest.raises(InputError, match=r"^--fps: expected frames per second, 0\.1 to 240 for \.mp4, such as 24"):
        checked_rate(FORMATS[".mp4", 8], fps)


def test_names_of_films_and_of_frames():
    assert [is_film(f"a/b.{ending}") for ending in ("mp4", "webm", "GIF", "apng", "webp")] == [True] * 5
    assert not any(map(is_film, ("out.####.exr", "out.png", "a", "v1.2", "out.##", "a.##.tif", ".mp4")))
    for name, near in (("a.mov", ".mp4"), ("b.MKV", ".webm"), ("a.wepb", ".webp"), ("a.agif", ".gif")):
        message = rf"^--output: expected a film, .* found '{name}': did you mean '{near}'\?$"
        with pytest.raises(InputError, match=message):
            is_film(name)


def test_depths_and_a_missing_encoder(monkeypatch):
    with pytest.raises(InputError, match=r"^--bit-depth: expected 8 for \.webm, found 10: \.mp4 can have 10$"):
        format_of("a.webm", 10)
    with pytest.raises(InputError, match=r"^--bit-depth: expected 8 or 10 for \.mp4, found 12$"):
        format_of("a.mp4", 12)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for name in ("a.mp4", "a.webm"):
        with pytest.raises(InputError, match=rf"^{name}: needs PyAV: `pip install .*\[film\]'`"):
            format_of(name, 8)
    assert format_of("a.gif", 8).ending == ".gif"
