"""Frames as files and as bytes: all files or none, refusals before anything is written, what each file holds, pickling."""

from __future__ import annotations

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


def made(**layers: np.ndarray) -> Frame:
    """Return a frame of noise, with stats computed on demand by a closure, as by a renderer."""
    pixels = np.random.default_rng(1).uniform(0, 1, (32, 48, 4)).astype(np.float32)
    calls: list[int] = []

    def stats() -> dict:
        calls.append(1)
        return {"times_ms": {"frame": 2.0}, "calls": len(calls)}

    return Frame(pixels, layers, Scene((), CAMERA, name="noise"), Settings(layers=tuple(layers)), stats)


def noise(camera: Camera = CAMERA, farthest: float = 9.0, milliseconds: float = 2.0) -> Frame:
    """Return a frame of noise with layers."""
    rng = np.random.default_rng(1)
    pixels = rng.uniform(0, 1, (32, 48, 4)).astype(np.float32)
    depth = rng.uniform(4, farthest, (32, 48)).astype(np.float32)
    depth[:5] = np.inf
    layers = {"Z": depth, "id": np.arange(32 * 48, dtype=np.uint32).reshape(32, 48), "P": rng.normal(size=(32, 48, 3))}
    settings = Settings(layers=tuple(layers))
    return Frame(pixels, layers, Scene((), camera), settings, lambda: {"times_ms": {"frame": milliseconds}})


@pytest.fixture
def earlier(tmp_path):
    """Write two earlier files, which must stay unchanged and alone in their folder."""
    for name in ("a.exr", "a.png"):
        (tmp_path / name).write_text(f"earlier {name}")
    yield tmp_path / "a"
    assert sorted(os.listdir(tmp_path)) == ["a.exr", "a.png"]
    for name in ("a.exr", "a.png"):
        assert (tmp_path / name).read_text() == f"earlier {name}"


def failing(real, call: int):
    """Wrap `real` so that call number `call` fails with a full disk."""
    calls: list[int] = []

    def fail(*arguments, **options):
        calls.append(1)
        if len(calls) == call:
            raise ENOSPC
        return real(*arguments, **options)

    return fail


def test_both_files_are_written(tmp_path):
    assert made().save(tmp_path / "a.png") == []
    assert sorted(os.listdir(tmp_path)) == ["a.exr", "a.png"]
    assert np.array_equal(exr.read(tmp_path / "a.exr")[0]["G"], made().rgb[..., 1])
    assert png.read(tmp_path / "a.png").shape == (32, 48, 3)
    assert frame_files.output_paths(tmp_path / "a.PNG") == (tmp_path / "a.exr", tmp_path / "a.png")
    assert frame_files.output_paths("a.jpg.exr") == (Path("a.jpg.exr"), Path("a.jpg.png"))
    assert frame_files.output_paths("out.exr.png") == (Path("out.exr.exr"), Path("out.exr.png"))
    assert frame_files.output_paths("v1.2-") == (Path("v1.2-.exr"), Path("v1.2-.png"))
    for name in ("a.jpg", "sub/a.JPEG", "a.tiff", "a.exr.hdr", "a.mp4", "a.apng", "a.npy", "-"):
        with pytest.raises(
            InputError, match=r"Frame.save: path: expected .* for (a|image).*\.png: other formats are not wr"
        ):
            frame_files.output_paths(name)
    assert frame_files.output_paths("a.b") == (Path("a.b.exr"), Path("a.b.png"))


def test_one_file_of_the_two(tmp_path):
    for kind in ("exr", "png"):
        folder = tmp_path / kind
        folder.mkdir()
        assert made().save(folder / "a.exr", files=[kind], deterministic=True) == []
        assert os.listdir(folder) == [f"a.{kind}"]
        made().save(tmp_path / "both", deterministic=True)
        assert (folder / f"a.{kind}").read_bytes() == (tmp_path / f"both.{kind}").read_bytes()
    for files in ((), ("jpg",), "png", ("png", "PNG"), 3):
        with pytest.raises(InputError, match=r"^Frame.save: files: expected (one|some) of exr, png, npz, depth"):
            made().save(tmp_path / "c", files=files)
    assert sorted(os.listdir(tmp_path)) == ["both.exr", "both.png", "exr", "png"]


def test_a_png_that_cannot_be_encoded(earlier, monkeypatch):
    def encode(file, rgb8):
        file.write(b"half")
        raise ENOSPC

    monkeypatch.setattr(png, "encode", encode)
    with pytest.raises(OutputError, match=r"a\.png: cannot be written: No space left on device"):
        made().save(earlier)


@pytest.mark.parametrize(("call", "name"), [(1, "a.exr"), (2, "a.png")])
@pytest.mark.parametrize("operation", ["fsync", "replace", "open"])
def test_a_step_that_fails_for_either_file(earlier, monkeypatch, operation, call, name):
    """fsync: data buffered until then does not fit. replace: the EXR's rename is undone."""
    monkeypatch.setattr(atomic_files, "_swept", {str(earlier.parent)})
    monkeypatch.setattr(os, operation, failing(getattr(os, operation), call))
    with pytest.raises(OutputError, match=rf"{name}: cannot be written: No space left on device"):
        made().save(earlier)
    monkeypatch.undo()


def test_a_rename_that_fails_leaves_no_new_file(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "replace", failing(os.replace, 2))
    with pytest.raises(OutputError, match=r"a\.png"):
        made().save(tmp_path / "a")
    assert os.listdir(tmp_path) == []


def test_a_disk_that_has_room_for_the_exr_alone(earlier):
    resource = pytest.importorskip("resource")
    flat = made()
    flat.rgba[..., :3] = 1.0  # its EXR is a kilobyte
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    noise = np.random.default_rng(2).integers(0, 256, (512, 512, 3)).astype(np.uint8)
    flat.to_png8 = lambda *_: noise  # a megabyte
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, limit[1]))
    try:
        with pytest.raises(OutputError, match=r"a\.png: cannot be written: File too large"):
            flat.save(earlier)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)


@pytest.mark.parametrize(
    ("farthest", "options", "parts"),
    [
        (9.0, {"compression": "foo"}, ("exr: compression: ", "zip", "found 'foo'")),
        (9.0, {"exposure": float("nan")}, ("exposure", "nan")),
        (9.0, {"tonemap": "film"}, ("operator", "film")),
        (90.0, {}, ("depth_scale: expected 0.0014 or more", "depths of 8", "found 0.001")),
        (9.0, {"depth_scale": 0}, ("Frame.save: depth_scale: expected a finite number above 0, found 0",)),
        (9.0, {"depth_scale": 20.0}, ("depth_scale: expected steps", "found 20.0")),
        (9.0, {"files": ("exr", "depht")}, ("Frame.save: files: ", "did you mean 'depth'?")),
        (9.0, {"files": "npz"}, ("Frame.save: files: expected some of exr, png, npz, depth",)),
    ],
)
def test_refused_options(earlier, farthest, options, parts):
    with pytest.raises(InputError) as caught:
        noise(farthest=farthest).save(earlier, **{"files": frame_files.KINDS, **options})
    assert str(caught.value).isprintable()
    assert all(part in str(caught.value) for part in parts)


@pytest.mark.parametrize("path", ["", ".", "..", "/", "sub/.."])
def test_refused_names(path, folder):
    with pytest.raises(InputError, match=r"Frame\.save: path: expected a file name"):
        made().save(path)
    assert os.listdir(folder) == []


def test_pickling_keeps_pixels_layers_and_stats():
    first = made(Z=np.full((32, 48), np.inf, np.float32), id=np.arange(32 * 48, dtype=np.uint32).reshape(32, 48))
    second = pickle.loads(pickle.dumps(first))
    assert same_bits(first, second)
    assert second.stats == first.stats == {"times_ms": {"frame": 2.0}, "calls": 1, "nonfinite": 0}
    assert second.settings == first.settings
    assert (second.scene.name, second.scene.camera.resolution) == ("noise", (48, 32))


def test_a_rendered_frame_can_be_pickled(device):
    from clshade import builtin, render

    first = render(builtin("quads"), resolution=(32, 24), preset="course", layers=("Z", "id"), device=device)
    second = pickle.loads(pickle.dumps(first))
    assert same_bits(first, second)
    assert second.stats == first.stats


# Each file


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
    again = Camera.from_matrix(
        contents["K"],
        contents["pose"],
        contents["resolution"].tolist(),
        pixel_center=contents["pixel_center"].item(),
        convention=str(contents["convention"]),
    )
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
    """Without times, whenever it is written; members have a fixed date."""
    for name, milliseconds in (("a", 2.0), ("b", 3.0)):
        noise(milliseconds=milliseconds).save(tmp_path / name, files=("npz", "depth"), deterministic=True)
    for ending in (".npz", ".depth.png"):
        assert (tmp_path / f"a{ending}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()
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
    assert np.array_equal(exr.read(tmp_path / "a.exr")[0]["Z"], frame["Z"])
    for path in tmp_path.iterdir():
        assert resolution_of(path) == (48, 32)
        for damaged in (b"", path.read_bytes()[:7], b"\x76\x2f\x31\x01" + bytes(40)):
            path.write_bytes(damaged)
            assert resolution_of(path) is None
    assert resolution_of(tmp_path / "none") is None
    np.savez(tmp_path / "a.npz", resolution=np.array([None, 1], object), allow_pickle=True)
    assert resolution_of(tmp_path / "a.npz") is None


def test_depth_needs_its_layer_and_a_folder(tmp_path):
    frame = Frame(noise().rgba, {}, Scene((), CAMERA), Settings(), dict)
    with pytest.raises(InputError, match=r"^Frame\.save: files: depth needs a frame with the layer Z"):
        frame.save(tmp_path / "a", files=["depth"])
    with pytest.raises(OutputError, match=r"a\.npz: cannot be written: there is no folder"):
        noise().save(tmp_path / "none" / "a", files=["npz"])
    assert os.listdir(tmp_path) == []
