"""Films: encoded and read back by PyAV and Pillow; drawn by `turntable` and `animate`, resumed, interrupted, refused."""

import importlib.util
import io
import json
import shutil
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused, listing, needs_device, run
from PIL import Image, ImageSequence
from scene_files import DATA, write

from clshade.errors import InputError, OutputError
from clshade.farm.job import FrameWriter
from clshade.images import png
from clshade.view import video
from clshade.view.frame_folder import FrameFolder
from clshade.view.video import FORMATS, checked_rate, durations, format_of, is_film

SMALL = ("--resolution", "32,24", "--preset", "course", "--deterministic")
TURN = ("turntable", "icosphere", *SMALL, "--count", "3")

try:
    import av
except ImportError:
    av = None
needs_av = pytest.mark.skipif(av is None, reason="PyAV is not installed")

SIDE = 32  # pixels of a patch
COLORS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (0, 255, 255), (255, 0, 255), (255, 255, 255)]
COLORS += [(0, 0, 0), (200, 120, 40), (40, 120, 200), (128, 128, 128)]
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


def planes_of(frame) -> list[np.ndarray]:
    dtype = np.uint16 if frame.format.name.endswith("10le") else np.uint8
    rows = [(np.frombuffer(plane, dtype).reshape(plane.height, -1), plane.width) for plane in frame.planes]
    return [codes[:, :width].astype(np.float64) for codes, width in rows]


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
@pytest.mark.parametrize(("ending", "bits", "codec", "pixel_format"), [
    (".mp4", 8, "h264", "yuv420p"), (".mp4", 10, "hevc", "yuv420p10le"), (".webm", 8, "vp9", "yuv420p"),
])  # fmt: skip
def test_a_video_read_back(ending, bits, codec, pixel_format):
    with av.open(io.BytesIO(encoded(ending, images(bits), bits))) as container:
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
    for _ in range(40):
        with av.open(io.BytesIO(encoded(".mp4", [np.full((64, 256, 3), 0.5)] * count, 10))) as container:
            packets = [packet for packet in container.demux(video=0) if packet.size]
        assert sorted(packet.pts * packet.time_base * 25 for packet in packets) == list(range(count))
        assert all(-4 <= packet.dts * packet.time_base * 25 <= packet.pts * packet.time_base * 25 for packet in packets)


@needs_av
@pytest.mark.parametrize(("ending", "size"), [(".mp4", (5, 3)), (".mp4", (1, 1)), (".webm", (33, 24))])
def test_odd_sizes_are_made_even(ending, size):
    columns, rows = size
    image = np.random.default_rng(1).integers(0, 256, (rows, columns, 3)).astype(np.uint8)
    with av.open(io.BytesIO(encoded(ending, [image] * 2))) as container:
        frames = list(container.decode(video=0))
    assert [(frame.width, frame.height) for frame in frames] == [(columns + columns % 2, rows + rows % 2)] * 2


@needs_av
def test_a_fraction_as_rate_and_an_index_before_the_frames():
    data = encoded(".mp4", images() * 40, rate=Fraction(30000, 1001))
    with av.open(io.BytesIO(data)) as container:
        stream = container.streams.video[0]
        assert (stream.average_rate, stream.frames) == (Fraction(30000, 1001), 40 * COUNT)
        assert stream.duration * stream.time_base == Fraction(40 * COUNT * 1001, 30000)
    assert 0 < data.find(b"moov") < data.find(b"mdat")


@needs_av
def test_what_ffmpeg_reports_is_an_oserror():
    class Full(io.BytesIO):
        def write(self, data):
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        video.encode_video(Full(), images(), COUNT, Fraction(25), FORMATS[".mp4", 8])
    with pytest.raises(OSError, match="Invalid argument"):
        encoded(".mp4", [np.zeros((8, 8, 3))], 10)  # smaller than x265 takes; `draw_film` refuses it before


def shown(data: bytes) -> tuple[list[np.ndarray], list[float], dict]:
    """Return pixels and durations of the frames of an animated image, and facts about it."""
    with Image.open(io.BytesIO(data)) as film:
        pixels, durations_ms = [], []
        for frame in ImageSequence.Iterator(film):
            pixels.append(np.asarray(frame.convert("RGB")).astype(int))
            durations_ms.append(frame.info.get("duration", 0.0))
        return pixels, durations_ms, film.info


@pytest.mark.parametrize("ending", [".gif", ".apng", ".webp"])
def test_an_animation_read_back(ending):
    """The card has few colors, which a GIF keeps as well. One frame is a film, too; equal frames are shown for as long."""
    pixels, durations_ms, info = shown(encoded(ending, images(), rate=24))
    np.testing.assert_array_equal(pixels, [card(number) for number in range(COUNT)])
    assert info["loop"] == 0
    assert sum(durations_ms) == pytest.approx(1000 * COUNT / 24, abs=5 if ending == ".gif" else 0.5)
    np.testing.assert_array_equal(shown(encoded(ending, images()[:1]))[0], [card(0)])
    assert sum(shown(encoded(ending, [images()[0]] * 3 + [images()[1]] * 2, rate=25))[1]) == 200


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
    assert np.abs((pixels - frames[2]).reshape(6, 16, 6, 16, 3).mean(axis=(1, 3))).max() < 4
    assert np.abs(pixels - frames[2]).max() > 8


def test_a_gif_of_one_image_for_too_long_is_refused():
    images = [lambda: np.zeros((2, 3, 3), np.uint8)] * 66
    message = r"^film: frames: expected .* 655\.35 s for \.gif, found equal frames for longer"
    with pytest.raises(InputError, match=message):
        video.encode_animation(io.BytesIO(), images, Fraction(1, 10), FORMATS[".gif", 8])


@pytest.mark.parametrize(("rate", "ticks", "expected"), [
    (30, 100, [3, 4, 3, 3, 4, 3]), (50, 100, [2, 2, 2]), (60, 1000, [17, 16, 17, 17, 16, 17]),
])  # fmt: skip
def test_durations_add_up(rate, ticks, expected):
    assert durations(len(expected), Fraction(rate), ticks) == expected
    many = np.cumsum(durations(1000, Fraction(rate), ticks))
    assert np.abs(many - np.arange(1, 1001) * ticks / float(rate)).max() <= 0.5 + 1e-9


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


def interrupt_after(monkeypatch, frames: int) -> None:
    """Let Ctrl-C arrive when so many frames are drawn."""
    draw, drawn = FrameWriter.draw, []

    def drawing(self, task, ready=None):
        if len(drawn) == frames:
            raise KeyboardInterrupt
        drawn.append(task.number)
        return draw(self, task, ready)

    monkeypatch.setattr(FrameWriter, "draw", drawing)


@needs_device
def test_a_film_holds_the_pixels_of_the_frames(folder, capsys):
    assert run(capsys, *TURN, "--exposure", "1", "--quiet", "-o", "f.####.exr")[0] == 0
    code, out, err = run(capsys, *TURN, "--exposure", "1", "--fps", "12.5", "-o", "film.webp")
    assert code == 0, err
    assert "film    film.webp, 32x24, 3 frames, 12.5 a second, 0.24 s" in out
    assert "WebP (lossless)" in out
    assert "files " not in out
    frames = [png.read(f"f.{number:04d}.png") for number in (1, 2, 3)]
    assert all((a == b).all() for a, b in zip(shown(Path("film.webp").read_bytes())[0], frames, strict=True))
    assert (frames[0] != frames[2]).any()
    assert sorted(path.suffix for path in folder.iterdir()) == [".exr"] * 3 + [".png"] * 3 + [".webp"]


@needs_av
@needs_device
def test_a_video_of_ten_bits_and_its_frames(folder, capsys):
    big = ("--resolution", "65,64", "--bit-depth", "10", "--json", "-o", "new/a.mp4")
    code, out, _ = run(capsys, *TURN, *big, "--keep-frames")
    summary = json.loads(out)
    assert (code, summary["drawn"], summary["film"]["resolution"]) == (0, 3, [66, 64])
    assert (summary["film"]["codec"], summary["film"]["pixels"]) == ("HEVC", "yuv420p10le, BT.709")
    facts = {"seconds": 0.1, "fps": 30.0, "frames": "new/a.mp4.frames"}
    assert {name: summary["film"][name] for name in facts} == facts
    names = [f"{number:04d}.{kind}" for number in (1, 2, 3) for kind in ("exr", "png")]
    assert sorted(listing(folder / "new" / "a.mp4.frames")) == [*names, "film.json"]
    with av.open("new/a.mp4") as film:
        frames = list(film.decode(video=0))
    assert len(frames) == 3
    # Luma of what the PNG shows, off by half an 8-bit code, and by the quantizer in this small picture: a few codes.
    picture = png.read("new/a.mp4.frames/0002.png") @ [0.2126, 0.7152, 0.0722]
    luma = np.frombuffer(frames[1].planes[0], np.uint16).reshape(64, -1)[:, :65]
    assert np.abs((luma / 4 - 16) * 255 / 219 - picture).mean() < 2
    # Frames that were kept stay, and serve a film of another rate.
    code, out, _ = run(capsys, *TURN, *big, "--fps", "10")
    summary = json.loads(out)
    assert (code, summary["drawn"], summary["skipped"], summary["film"]["seconds"]) == (0, 0, 3, 0.3)
    assert len(listing(folder / "new" / "a.mp4.frames")) == 7


@needs_device
def test_an_interrupted_film_goes_on(folder, capsys, monkeypatch):
    film = folder / "film.apng"
    with monkeypatch.context() as patched:
        interrupt_after(patched, 2)
        assert run(capsys, *TURN, "-o", "film.apng")[0] == 130
    frames = ["film.apng.frames", *(f"film.apng.frames/{name}" for name in ("0001.png", "0002.png", "film.json"))]
    assert listing(folder) == frames
    code, out, err = run(capsys, *TURN, "-o", "film.apng", "--json")
    summary = json.loads(out)
    assert (code, summary["drawn"], summary["skipped"]) == (0, 1, 2), err
    assert "first" not in summary
    assert listing(folder) == ["film.apng"]
    resumed = film.read_bytes()
    assert run(capsys, *TURN, "-o", "film.apng", "--quiet")[0] == 0
    assert film.read_bytes() == resumed


@needs_device
@pytest.mark.parametrize("change", [("--exposure", "1"), ("--degrees", "90")])
def test_frames_of_other_settings_are_drawn_again(folder, capsys, monkeypatch, change):
    with monkeypatch.context() as patched:
        interrupt_after(patched, 2)
        assert run(capsys, *TURN, "-o", "film.gif")[0] == 130
    code, out, err = run(capsys, *TURN, *change, "-o", "film.gif", "--json")
    assert (code, json.loads(out)["skipped"]) == (0, 0)
    assert err[0] == "clshade: film.gif.frames: frames of another scene or other settings: drawn again"
    assert listing(folder) == ["film.gif"]


@pytest.mark.parametrize("ending", [pytest.param("mp4", marks=needs_av), "webp"])
@needs_device
def test_a_full_disk_and_ctrl_c_leave_the_earlier_film(folder, capsys, monkeypatch, ending):
    """The frames stay. The limit is shorter than the index of an MP4, and than this WebP."""
    resource = pytest.importorskip("resource")
    name, encoder = f"film.{ending}", {"mp4": "encode_video", "webp": "encode_animation"}[ending]
    (folder / name).write_bytes(b"earlier")
    left = [name, f"{name}.frames", *(f"{name}.frames/{frame}" for frame in ("0001.png", "0002.png", "0003.png"))]
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    encode = getattr(video, encoder)

    def limited(*arguments):
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
        encode(*arguments)

    monkeypatch.setattr(video, encoder, limited)
    try:
        code, _, err = run(capsys, *TURN, "-o", name)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (code, err[-1]) == (2, f"clshade: {name}: cannot be written: File too large")
    assert listing(folder) == [*left, f"{name}.frames/film.json"]

    def interrupted(file, *_):
        file.write(b"half a film")
        raise KeyboardInterrupt

    monkeypatch.setattr(video, encoder, interrupted)
    assert run(capsys, *TURN, "-o", name, "--quiet")[0] == 130
    assert listing(folder) == [*left, f"{name}.frames/film.json"]
    assert (folder / name).read_bytes() == b"earlier"

    monkeypatch.setattr(video, encoder, encode)
    code, out, _ = run(capsys, *TURN, "-o", name, "--json")
    assert (code, json.loads(out)["skipped"]) == (0, 3)
    assert listing(folder) == [name]
    assert (folder / name).read_bytes() != b"earlier"


BAR = ("--scalars", "heat", "--colorbar", "--resolution", "64,64")
REFUSED = [
    (("-o", "a.mov"), ("--output", "'a.mov'", "did you mean '.mp4'?")),
    (("-o", "a.##.gif"), ("--output", "without #")),
    (("-o", "a.####.exr", "--fps", "24"), ("--fps", "needs a film as --output", "a.####.exr")),
    (("-o", "a.####.exr", "--keep-frames"), ("--keep-frames", "needs a film")),
    (("-o", "a.gif", "--fps", "fast"), ("--fps", "0.1 to 50 for .gif", "'fast'")),
    (("-o", "a.gif", "--bit-depth", "10"), ("--bit-depth", "expected 8 for .gif", ".mp4 can have 10")),
    (("-o", "a.webp", "--resolution", "16384,2"), ("1 to 16383 pixels", "16384x2")),
    (("-o", "used.gif"), ("used.gif.frames", "expected a folder with frames of this film", "other files")),
    (("-o", "file.gif"), ("file.gif.frames", "it is not a folder")),
    (("-o", "folder.gif"), ("folder.gif", "it is a folder")),
    (("-o", "new/deep/a.gif", "--device", "no-such"), ("frame 1", "no OpenCL device")),
    (("-o", "new/a.gif", "--compression", "rar"), ("compression", "'rar'")),
    (("-o", "new/a.gif", "--workers", "0"), ("workers", "0")),
    pytest.param(("-o", "a.mp4", "--bit-depth", "10"), ("64 to 16384 pixels a side", "32x24"), marks=needs_av),
    pytest.param((*BAR, "-o", "a.mp4", "--bit-depth", "10"), ("--colorbar", "--bit-depth 10"), marks=needs_av),
]


@pytest.mark.parametrize(("arguments", "parts"), REFUSED)
def test_refused_command_lines(folder, capsys, arguments, parts):
    write(folder / "used.gif.frames" / "0001.png", "of somebody else")
    (folder / "file.gif.frames").write_text("no folder")
    (folder / "folder.gif").mkdir()
    before = listing(folder)
    assert_refused(run(capsys, *TURN, *arguments), *parts)
    assert listing(folder) == before


@needs_device
def test_frames_of_a_film_have_one_size(folder, capsys):
    (folder / "c.json").write_text('[{"eye": [3, 2, 9], "resolution": [20, 10]}, {"resolution": [10, 20]}]')
    command = ("animate", "icosphere", "c.json", "--preset", "course", "-o", "a.gif")
    assert_refused(run(capsys, *command), "frame 2", "20x10, found 10x20", "--resolution gives them one")
    assert run(capsys, *command, "--resolution", "16,12", "--quiet")[0] == 0
    assert [frame.shape for frame in shown(Path("a.gif").read_bytes())[0]] == [(12, 16, 3)] * 2


@pytest.mark.parametrize("record", ["", "[]", "{", '{"digest": 3}', "\xff"])
def test_a_damaged_record_counts_as_that_of_another_film(tmp_path, record):
    folder = FrameFolder(str(tmp_path / "a.gif"))
    path = tmp_path / "a.gif.frames"
    write(path / "film.json", record.encode("latin-1"))
    write(path / "0001.png", "a frame")
    assert not folder.kept
    with folder.of("digest", kept=True):
        assert listing(path) == ["film.json", "lock"]
        assert folder.kept
    assert listing(tmp_path) == []  # no frame was drawn


def test_one_process_at_a_time_draws_a_film(tmp_path):
    """Descriptors of one process exclude each other as those of two do. What a killed process left is removed."""
    one, two = (FrameFolder(str(tmp_path / "a.gif")) for _ in range(2))
    path = tmp_path / "a.gif.frames"
    with one.of("digest", kept=True):
        (path / "0001.png").write_text("a frame")
        for digest in ("digest", "another"):
            with (
                pytest.raises(OutputError, match=r"a\.gif\.frames: cannot be written: another process draws this film"),
                two.of(digest, kept=False),
            ):
                pass
            assert listing(path) == ["0001.png", "film.json", "lock"]
    assert listing(path) == ["0001.png", "film.json"]
    (path / ".clshade-0123456789abcdef.tmp").write_text("half a frame")
    (path / "lock").write_text("")
    with two.of("digest", kept=False):
        assert (path / "0001.png").exists()
    assert listing(tmp_path) == []

    def fail():
        with one.of("digest", kept=True):
            shutil.rmtree(path)
            raise InputError("of the block")  # not hidden by an error of the folder that is gone

    with pytest.raises(InputError, match="of the block"):
        fail()


@pytest.mark.long
@needs_device
def test_a_color_bar_widens_the_film(folder, capsys):
    (folder / "plane.ply").write_text(DATA)
    shown_by = ("--scalars", "heat", "--colorbar", *SMALL)
    command = ("turntable", "plane.ply", *shown_by, "--frames", "1..2", "-o", "film.gif")
    code, out, err = run(capsys, *command, "--keep-frames", "--json")
    width, height = shown(Path("film.gif").read_bytes())[0][0].shape[1::-1]
    assert (code, json.loads(out)["film"]["resolution"]) == (0, [width, height]), err
    assert width > 32
    code, _, err = run(capsys, *command)
    assert (code, [line for line in err if "warning" in line]) == (0, [])
