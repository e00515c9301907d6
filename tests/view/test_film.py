"""Films drawn by `turntable` and `animate`: pixels, resuming, what is left after a failure, refusals."""

from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_refused, listing, needs_device, run
from PIL import Image

from clshade.errors import InputError, OutputError
from clshade.farm.job import FrameWriter
from clshade.images import png
from clshade.view import video
from clshade.view.frame_folder import FrameFolder

PLANE = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
PLANE += "property float heat\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
PLANE += "0 0 0 1\n2 0 0 2\n2 1 0 4\n3 0 1 2\n"
SMALL = ("--resolution", "32,24", "--preset", "course", "--deterministic")
TURN = ("turntable", "icosphere", *SMALL, "--count", "3")

needs_av = pytest.mark.skipif(importlib.util.find_spec("av") is None, reason="PyAV is not installed")


def shown(path: Path) -> list[np.ndarray]:
    """Return the frames of an animated image."""
    with Image.open(path) as film:
        frames = []
        for number in range(film.n_frames):
            film.seek(number)
            frames.append(np.asarray(film.convert("RGB")))
        return frames


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
    assert all((a == b).all() for a, b in zip(shown(folder / "film.webp"), frames, strict=True))
    assert (frames[0] != frames[2]).any()
    assert sorted(path.suffix for path in folder.iterdir()) == [".exr"] * 3 + [".png"] * 3 + [".webp"]


@needs_av
@needs_device
def test_a_video_of_ten_bits_and_its_frames(folder, capsys):
    import av

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
    (folder / "used.gif.frames").mkdir()
    (folder / "used.gif.frames" / "0001.png").write_text("of somebody else")
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
    assert [frame.shape for frame in shown(folder / "a.gif")] == [(12, 16, 3)] * 2


@pytest.mark.parametrize("record", ["", "[]", "{", '{"digest": 3}', "\xff"])
def test_a_damaged_record_counts_as_that_of_another_film(tmp_path, record):
    folder = FrameFolder(str(tmp_path / "a.gif"))
    path = tmp_path / "a.gif.frames"
    path.mkdir()
    (path / "film.json").write_text(record, encoding="latin-1")
    (path / "0001.png").write_text("a frame")
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
    (folder / "plane.ply").write_text(PLANE)
    shown_by = ("--scalars", "heat", "--colorbar", *SMALL)
    command = ("turntable", "plane.ply", *shown_by, "--frames", "1..2", "-o", "film.gif")
    code, out, err = run(capsys, *command, "--keep-frames", "--json")
    width, height = shown(folder / "film.gif")[0].shape[1::-1]
    assert (code, json.loads(out)["film"]["resolution"]) == (0, [width, height]), err
    assert width > 32
    code, _, err = run(capsys, *command)
    assert (code, [line for line in err if "warning" in line]) == (0, [])
