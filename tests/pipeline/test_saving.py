"""Frames as files and as bytes: all files or none, refusals before anything is written, what each file holds, pickling."""

import errno
import json
import os
import pickle
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from devices import rendered

from clshade import builtin
from clshade.base import atomic_files
from clshade.errors import InputError, OutputError
from clshade.images import depth_png, exr, png
from clshade.images.image_file import resolution_of
from clshade.pipeline import frame_files
from clshade.pipeline.frame import Frame, same_bits
from clshade.scene.camera import Camera
from clshade.scene.model import Scene, Settings

CAMERA = Camera((1, 2, 9), (0.5, 0, 0), (0.1, 1, 0), 1.5, (1.0, 1.6), (48, 32), (0.4, 0.55))
ENOSPC = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def noise(camera: Camera = CAMERA, farthest: float = 9.0, milliseconds: float = 2.0) -> Frame:
    """Return a frame of noise with layers, with stats computed on demand by a closure, as by a renderer."""
    rng = np.random.default_rng(1)
    pixels = rng.uniform(0, 1, (32, 48, 4)).astype(np.float32)
    depth = rng.uniform(4, farthest, (32, 48)).astype(np.float32)
    depth[:5] = np.inf
    layers = {"Z": depth, "id": np.arange(32 * 48, dtype=np.uint32).reshape(32, 48), "P": rng.normal(size=(32, 48, 3))}
    calls: list[int] = []

    def stats() -> dict:
        calls.append(1)
        return {"times_ms": {"frame": milliseconds}, "calls": len(calls)}

    return Frame(pixels, layers, Scene((), camera, name="noise"), Settings(layers=tuple(layers)), stats)


@pytest.fixture
def earlier(tmp_path):
    """Write two earlier files, which must stay unchanged and alone in their folder."""
    texts = {"a.exr": "an earlier image", "a.png": "and its picture"}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    yield tmp_path / "a"
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == texts


def test_names_of_files():
    for name, stem in (("b/a.PNG", "b/a"), ("out.exr.png", "out.exr"), ("a.b", "a.b")):
        assert frame_files.output_paths(name) == (Path(f"{stem}.exr"), Path(f"{stem}.png"))
    for name in ("sub/a.JPEG", "a.exr.hdr", "a.mp4", "-"):
        with pytest.raises(
            InputError, match=r"Frame.save: path: expected .* for (a|image).*\.png: other formats are not wr"
        ):
            frame_files.output_paths(name)
    for name in ("", "/", "sub/.."):
        with pytest.raises(InputError, match=r"Frame\.save: path: expected a file name"):
            frame_files.output_paths(name)


@pytest.mark.parametrize(("call", "name"), [(1, "a.exr"), (2, "a.png")])
@pytest.mark.parametrize("operation", ["fsync", "replace", "open"])
def test_a_step_that_fails_for_either_file(earlier, monkeypatch, operation, call, name):
    """fsync: data buffered until then does not fit. replace: the EXR's rename is undone."""
    monkeypatch.setattr(atomic_files, "_swept", {str(earlier.parent)})
    real, calls = getattr(os, operation), []

    def fail(*arguments, **options):
        calls.append(1)
        if len(calls) == call:
            raise ENOSPC
        return real(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(os, operation, fail)
        with pytest.raises(OutputError, match=rf"{name}: cannot be written: No space left on device"):
            noise().save(earlier)
        if operation == "replace":  # where there was no file there is none
            calls.clear()
            with pytest.raises(OutputError, match=rf"{name.replace('a', 'b', 1)}"):
                noise().save(earlier.with_name("b"))


def test_a_png_that_does_not_fit(earlier):
    resource = pytest.importorskip("resource")
    frame = noise()
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    large = np.random.default_rng(2).integers(0, 256, (512, 512, 3)).astype(np.uint8)
    frame.to_png8 = lambda *_: large  # a megabyte
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, limit[1]))
    try:
        with pytest.raises(OutputError, match=r"a\.png: cannot be written: File too large"):
            frame.save(earlier)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)


@pytest.mark.parametrize(
    ("farthest", "options", "line"),
    [
        (9.0, {"compression": "foo"}, "exr: compression: .*zip.*found 'foo'"),
        (9.0, {"tonemap": "film"}, "operator.*film"),
        (90.0, {}, "depth_scale: expected 0.0014 or more.*depths of 8.*found 0.001"),
        (9.0, {"depth_scale": 0}, "Frame.save: depth_scale: expected a finite number above 0, found 0"),
        (9.0, {"depth_scale": 20.0}, "depth_scale: expected steps.*found 20.0"),
        (9.0, {"files": ("exr", "depht")}, r"Frame.save: files: .*did you mean 'depth'\?"),
        *((9.0, {"files": files}, "Frame.save: files: expected (one|some) of exr, png") for files in ((), "npz", 3)),
    ],
)
def test_refused_options(earlier, farthest, options, line):
    with pytest.raises(InputError, match=line) as caught:
        noise(farthest=farthest).save(earlier, **{"files": frame_files.KINDS, **options})
    assert str(caught.value).isprintable()


def test_depth_needs_its_layer_and_a_folder(tmp_path):
    frame = Frame(noise().rgba, {}, Scene((), CAMERA), Settings(), dict)
    with pytest.raises(InputError, match=r"^Frame\.save: files: depth needs a frame with the layer Z"):
        frame.save(tmp_path / "a", files=["depth"])
    with pytest.raises(OutputError, match=r"a\.npz: cannot be written: there is no folder"):
        noise().save(tmp_path / "none" / "a", files=["npz"])
    assert os.listdir(tmp_path) == []


def test_pickling_keeps_pixels_layers_and_stats(device):
    drawn = rendered(builtin("quads"), resolution=(32, 24), preset="course", layers=("Z", "id"), device=device)
    for first in (noise(), drawn):
        second = pickle.loads(pickle.dumps(first))
        assert same_bits(first, second)
        assert second.stats == first.stats
        assert second.settings == first.settings
        assert second.scene.name == first.scene.name
    assert pickle.loads(pickle.dumps(noise())).stats == {"times_ms": {"frame": 2.0}, "calls": 1, "nonfinite": 0}


def test_an_npz_has_all_arrays_and_the_camera(tmp_path):
    frame = noise()
    assert frame.save(tmp_path / "a.npz") == []
    assert os.listdir(tmp_path) == ["a.npz"]
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        contents = dict(arrays)
    for name, array in {"rgba": frame.rgba, **{name: frame[name] for name in frame}}.items():
        assert contents[name].dtype == array.dtype
        assert np.array_equal(contents[name], array), name
    names = {"rgba", "Z", "id", "P", "K", "pose", "pixel_center", "convention", "resolution", "metadata"}
    assert set(contents) == names
    k, pose, resolution = contents["K"], contents["pose"], contents["resolution"].tolist()
    center, convention = contents["pixel_center"].item(), str(contents["convention"])
    again = Camera.from_matrix(k, pose, resolution, pixel_center=center, convention=convention)
    for one, expected in zip(again.to_matrix(), CAMERA.to_matrix(), strict=True):
        np.testing.assert_allclose(one, expected, rtol=0, atol=1e-12)
    metadata = json.loads(str(contents["metadata"]))
    assert metadata["renderTimeSeconds"] == 0.002
    assert metadata["settings"].startswith("shader=")


def test_an_npz_of_an_orthographic_camera_and_of_a_check():
    frame = noise(replace(CAMERA, orthographic=True))
    frame.check = SimpleNamespace(image=np.ones((32, 48), np.float32), metadata=lambda: {"checkedPixels": 1536})
    arrays = frame.arrays()
    assert "K" not in arrays
    assert arrays["plane"].tolist() == [1.0, 1.6]
    assert np.array_equal(arrays["pose"], CAMERA.pose())
    assert np.array_equal(arrays["error"], np.ones((32, 48)))


def test_the_same_frame_gives_the_same_bytes(tmp_path):
    """Without times, whenever and with whatever other file it is written; members have a fixed date."""
    noise().save(tmp_path / "a", files=frame_files.KINDS, deterministic=True)
    for kind in frame_files.KINDS:
        assert noise(milliseconds=3.0).save(tmp_path / f"{kind}.exr", files=[kind], deterministic=True) == []
        (alone,) = tmp_path.glob(f"{kind}.*")
        assert alone.read_bytes() == (tmp_path / f"a{alone.name.removeprefix(kind)}").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert {member.date_time for member in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert archive.testzip() is None


def test_all_files_and_their_sizes(tmp_path):
    frame = noise()
    frame.save(tmp_path / "a.exr", files=frame_files.KINDS)
    assert sorted(os.listdir(tmp_path)) == ["a.depth.png", "a.exr", "a.npz", "a.png"]
    depth, scale = depth_png.read(tmp_path / "a.depth.png")
    seen = np.isfinite(frame["Z"])
    assert np.array_equal(np.isfinite(depth), seen)
    assert np.abs(depth[seen] - frame["Z"][seen]).max() <= scale / 2 * (1 + 1e-12)
    channels, _ = exr.read(tmp_path / "a.exr")
    assert np.array_equal(channels["Z"], frame["Z"])
    assert np.array_equal(channels["G"], frame.rgb[..., 1])
    assert png.read(tmp_path / "a.png").shape == (32, 48, 3)
    for path in tmp_path.iterdir():
        assert resolution_of(path) == (48, 32)
        for damaged in (b"", path.read_bytes()[:7], b"\x76\x2f\x31\x01" + bytes(40)):
            path.write_bytes(damaged)
            assert resolution_of(path) is None
    assert resolution_of(tmp_path / "none") is None
