"""Frames as .npz and depth PNG: what they hold, the same bytes again, and files as they were after a refusal."""

from __future__ import annotations

import json
import os
import zipfile
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from clshade.errors import InputError, OutputError
from clshade.images import depth_png, exr
from clshade.images.image_file import resolution_of
from clshade.pipeline.frame import Frame
from clshade.pipeline.frame_files import KINDS
from clshade.scene.camera import Camera
from clshade.scene.model import Scene, Settings

CAMERA = Camera((1, 2, 9), (0.5, 0, 0), (0.1, 1, 0), 1.5, (1.0, 1.6), (48, 32), (0.4, 0.55))


def made(camera: Camera = CAMERA, farthest: float = 9.0, milliseconds: float = 2.0) -> Frame:
    """Return a frame of noise with layers."""
    rng = np.random.default_rng(1)
    pixels = rng.uniform(0, 1, (32, 48, 4)).astype(np.float32)
    depth = rng.uniform(4, farthest, (32, 48)).astype(np.float32)
    depth[:5] = np.inf
    layers = {"Z": depth, "id": np.arange(32 * 48, dtype=np.uint32).reshape(32, 48), "P": rng.normal(size=(32, 48, 3))}
    settings = Settings(layers=tuple(layers))
    return Frame(pixels, layers, Scene((), camera), settings, lambda: {"times_ms": {"frame": milliseconds}})


def test_an_npz_has_all_arrays_and_the_camera(tmp_path):
    frame = made()
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
    frame = made(replace(CAMERA, orthographic=True))
    frame.check = SimpleNamespace(image=np.ones((32, 48), np.float32), metadata=lambda: {"checkedPixels": 1536})
    arrays = frame.arrays()
    assert "K" not in arrays
    assert arrays["plane"].tolist() == [1.0, 1.6]
    assert np.array_equal(arrays["pose"], CAMERA.pose())
    assert np.array_equal(arrays["error"], np.ones((32, 48)))


def test_the_same_frame_gives_the_same_bytes(tmp_path):
    """Without times, whenever it is written; members have a fixed date."""
    for name, milliseconds in (("a", 2.0), ("b", 3.0)):
        made(milliseconds=milliseconds).save(tmp_path / name, files=("npz", "depth"), deterministic=True)
    for ending in (".npz", ".depth.png"):
        assert (tmp_path / f"a{ending}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert {member.date_time for member in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert archive.testzip() is None


def test_all_files_and_their_sizes(tmp_path):
    frame = made()
    frame.save(tmp_path / "a.exr", files=KINDS)
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


@pytest.mark.parametrize(
    ("frame", "options", "parts"),
    [
        (made(farthest=90.0), {}, ("depth_scale: expected 0.0014 or more", "depths of 8", "found 0.001")),
        (made(), {"depth_scale": 0}, ("depth_scale: expected a finite number above 0, found 0",)),
        (made(), {"depth_scale": 20.0}, ("depth_scale: expected steps", "found 20.0")),
        (made(), {"files": ("exr", "depht")}, ("files: ", "did you mean 'depth'?")),
        (made(), {"files": "npz"}, ("files: expected some of exr, png, npz, depth",)),
    ],
)
def test_a_refusal_leaves_the_files_as_they_were(tmp_path, frame, options, parts):
    names = ["a.depth.png", "a.exr", "a.npz", "a.png"]
    for name in names:
        (tmp_path / name).write_text(f"earlier {name}")
    with pytest.raises(InputError) as caught:
        frame.save(tmp_path / "a", **{"files": KINDS, **options})
    message = str(caught.value)
    assert message.startswith("Frame.save: ")
    assert "\n" not in message
    assert all(part in message for part in parts), message
    assert sorted(os.listdir(tmp_path)) == names
    assert all((tmp_path / name).read_text() == f"earlier {name}" for name in names)


def test_depth_needs_its_layer_and_a_folder(tmp_path):
    frame = Frame(made().rgba, {}, Scene((), CAMERA), Settings(), dict)
    with pytest.raises(InputError, match=r"^Frame\.save: files: depth needs a frame with the layer Z"):
        frame.save(tmp_path / "a", files=["depth"])
    with pytest.raises(OutputError, match=r"a\.npz: cannot be written: there is no folder"):
        made().save(tmp_path / "none" / "a", files=["npz"])
    assert os.listdir(tmp_path) == []
