"""Many frames in one call: the bits of frames drawn one by one, in arrays of any layout, whatever happens on the way."""

from __future__ import annotations

import gc
import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from view_cameras import cloud, looking

import clshade
from clshade import Camera, Mesh, Renderer, Scene
from clshade.errors import ClshadeError, InputError
from clshade.pipeline import buffers
from clshade.pipeline import renderer as renderer_module
from clshade.pipeline.buffers import aligned
from clshade.pipeline.frame import Frame, Views, same_bits
from clshade.pipeline.launches import Stages

SIZE = 48
LAYERS = ("Z", "id")
FAR = (-4.0, -3.9, -3.8)  # from here no face is clipped
BACKS = (-4.0, -3.0, -0.5, -0.4, -4.0, -3.9, -0.5, -2.0, -4.0)


def open_cloud(device, **options) -> Renderer:
    return Renderer(cloud(), device=device, **{"shader": "nolight", "layers": LAYERS, **options})


def assert_same(views: Views, expected: list[Frame]) -> None:
    """In every bit of every array, and in what is counted."""
    assert len(views) == len(expected)
    for frame, reference in zip(views, expected, strict=True):
        assert frame.rgba.dtype == reference.rgba.dtype
        assert same_bits(frame, reference)
        assert frame.scene.camera is reference.scene.camera
        varying = (
            "times_ms",
            "build_ms",
            "features",
            "left_out",
        )  # whether it is sorted may depend on the frame before
        counts = {name: value for name, value in reference.stats.items() if name not in varying}
        assert {name: frame.stats[name] for name in counts} == counts


def test_frames_that_have_to_be_drawn_again(device):
    """The first of a renderer finds no room in the tile lists, nor does one from nearer; faces to clip need a sort. Views
    of all kinds follow one another."""
    cameras = [looking(back) for back in BACKS]
    with open_cloud(device) as one, open_cloud(device) as reference:
        frames = one.render_many(cameras)
        assert_same(frames, [reference.render(camera) for camera in cameras])
        assert [frame.stats["clipped"] > 0 for frame in frames] == [back > -1.0 for back in BACKS]
        assert_same(one.render_many(cameras[::-1]), list(frames)[::-1])
        assert same_bits(one.render(cameras[0]), frames[0])


def test_the_next_frame_is_enqueued_before_the_last_is_complete(device, monkeypatch):
    if device.lanes == 1:
        pytest.skip("this device always sorts")
    with open_cloud(device) as renderer:
        cameras = [looking(-4.0) for _ in range(4)]
        renderer.render_many(cameras)
        happened = []
        launch = Stages.run

        def noted(self, name, *arguments, **values):
            happened.append(name)
            return launch(self, name, *arguments, **values)

        def waited(*arguments):
            happened.append("wait")
            return wait(*arguments)

        wait = renderer_module.wait
        monkeypatch.setattr(Stages, "run", noted)
        monkeypatch.setattr(renderer_module, "wait", waited)
        renderer.render_many(cameras)
    notable = [name for name in happened if name in ("project", "layer_z", "wait")]
    assert notable == ["project", "layer_z"] + 3 * ["project", "layer_z", "wait"] + ["wait"]


def places(kind: str, shape: tuple[int, ...], dtype: np.dtype, tmp_path) -> np.ndarray:
    """Return an array of a shape in memory of some kind."""
    if kind == "aligned":
        return aligned(shape, dtype)
    if kind == "hardly aligned":
        return aligned((int(np.prod(shape)) + 1,), dtype)[1:].reshape(shape)
    if kind == "every other one":
        return aligned((2 * shape[0], *shape[1:]), dtype)[::-2]
    if kind == "channels first":
        return np.moveaxis(
            np.empty((shape[0], *shape[:0:-1]), dtype), range(1, len(shape)), range(len(shape) - 1, 0, -1)
        )
    return np.lib.format.open_memmap(tmp_path / f"{len(list(tmp_path.iterdir()))}.npy", "w+", dtype, shape)


@pytest.mark.parametrize("size", [48, 33])  # images of 48 begin at multiples of 64 bytes, of 33 at those of 4
@pytest.mark.parametrize("kind", ["aligned", "hardly aligned", "every other one", "channels first", "memory-mapped"])
def test_arrays_of_the_caller(device, tmp_path, kind, size):
    cameras = [looking(back, size) for back in (-4.0, -0.5, -3.0)]
    with open_cloud(device) as renderer:
        expected = renderer.render_many(cameras)
        out = {name: places(kind, array.shape, array.dtype, tmp_path) for name, array in expected.arrays.items()}
        views = renderer.render_many(cameras, out)
        assert all(views.arrays[name] is array for name, array in out.items())
        assert all(np.array_equal(array, expected.arrays[name]) for name, array in out.items())
        assert_same(views, list(expected))


def test_images_that_cannot_be_written_past_the_caches(device, monkeypatch):
    """Whole rows of 64 bytes are, where all images begin at a multiple of that."""
    monkeypatch.setattr(renderer_module, "STREAMED_PIXELS", 1)
    numbers, shape = 4 * SIZE * SIZE, (3, SIZE, SIZE, 4)
    wide = aligned((3, numbers + 4), np.dtype(np.float32))
    cameras = [looking(back) for back in FAR]
    with open_cloud(device) as renderer:
        expected = renderer.render_many(cameras)
        views = renderer.render_many(cameras, {"rgba": wide[:, :numbers].reshape(shape)})
        assert views.rgba[1].ctypes.data % 64 == 16
        assert np.array_equal(views.rgba, expected.rgba)


def test_memory_mapped_arrays_are_written_without_others(device, tmp_path):
    """What is kept in memory does not grow with the number of frames."""
    cameras = [looking(-4.0 + 0.001 * k) for k in range(64)]
    with open_cloud(device, layers=()) as renderer:
        image = np.lib.format.open_memmap(tmp_path / "rgba.npy", "w+", np.float32, (64, SIZE, SIZE, 4))
        renderer.render_many(cameras[:2], {"rgba": image[:2]})
        gc.collect()
        tracemalloc.start()
        try:
            frames = renderer.render_many(cameras, {"rgba": image})
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak < image.nbytes / 2
        image.flush()
        assert np.array_equal(np.load(tmp_path / "rgba.npy")[-1], renderer.render(cameras[-1]).rgba)
        assert len(frames) == 64


def test_some_arrays_are_given_and_others_made(device):
    with open_cloud(device) as renderer:
        ids = np.zeros((2, SIZE, SIZE), np.uint32)
        frames = renderer.render_many([looking(-4.0), looking(-3.0)], {"id": ids})
        assert frames["id"] is ids
        assert frames["Z"].flags.c_contiguous
        assert ids.any()


@pytest.mark.parametrize("layers", [(), LAYERS])
def test_a_device_with_memory_of_its_own(device, monkeypatch, layers):
    """Results are copied by a queue of their own."""
    cameras = [looking(back) for back in BACKS]
    with open_cloud(device, layers=layers) as renderer:
        expected = [renderer.render(camera) for camera in cameras]
    monkeypatch.setattr(buffers, "_coherent", lambda *_: False)
    with open_cloud(device, layers=layers) as renderer:
        assert_same(renderer.render_many(cameras), expected)


def test_no_camera_at_all(device):
    with open_cloud(device) as renderer:
        frames = renderer.render_many([])
        assert (len(frames), list(frames), frames.cameras) == (0, [], ())
        assert {name: array.shape for name, array in frames.arrays.items()} == {
            "rgba": (0, SIZE, SIZE, 4),
            "id": (0, SIZE, SIZE),
            "Z": (0, SIZE, SIZE),
        }
        assert frames.stats["views"] == 0
        assert renderer.render_many(iter([looking(-4.0)])).rgb.shape == (1, SIZE, SIZE, 3)


def test_frames_as_a_sequence(device, tmp_path):
    with open_cloud(device) as renderer:
        cameras = [looking(back) for back in FAR]
        frames = renderer.render_many(cameras)
    assert frames.cameras == tuple(cameras)
    assert frames.layers == LAYERS
    assert "Z" in frames
    assert "rgba" not in frames
    assert [np.shares_memory(frame["Z"], frames["Z"][k]) for k, frame in enumerate(frames)] == [True] * 3
    assert np.shares_memory(frames[-1].rgba, frames.rgba[2])
    assert np.array_equal(frames.alpha, frames.rgba[..., 3])
    assert repr(frames) == "<3 Views, 48x48, layers Z, id>"
    with pytest.raises(IndexError):
        frames[3]
    with pytest.raises(InputError, match=r"Views: layer: expected one that was asked for .*: did you mean 'Z'\?"):
        frames["depth"]
    frames[1].save(tmp_path / "one", deterministic=True)
    assert np.array_equal(clshade.exr.read(tmp_path / "one.exr")[0]["Z"], frames["Z"][1])
    times = frames.stats["times_ms"]
    assert times["views"] == pytest.approx(3 * frames[0].stats["times_ms"]["frame"])
    assert frames.stats["device"] == frames[0].stats["device"]
    np.savez(tmp_path / "all.npz", **frames.arrays)
    assert np.array_equal(np.load(tmp_path / "all.npz")["id"], frames["id"])


REFUSED = {
    "no sequence": (looking(-4.0), None, "cameras: expected a sequence of Cameras, found Camera(eye="),
    "no camera": ([looking(-4.0), 3], None, "cameras[1]: expected a Camera, found 3"),
    "another size": (
        [looking(-4.0), looking(-4.0), looking(-4.0, 47)],
        None,
        "cameras[2]: expected the resolution of all, (48, 48) as that of cameras[0], found (47, 47)",
    ),
    "another kind": (
        [looking(-4.0), replace(looking(-4.0), orthographic=True)],
        None,
        "cameras[1]: expected a perspective camera, as the scene's, found 'the other kind'",
    ),
    "no arrays by name": (1, [np.zeros(3)], "out: expected arrays by name, such as {'rgba': array}, found [array([0."),
    "an unknown name": (1, {"depth": 0}, "out: expected names of rgba, Z, id, found 'depth': did you mean 'Z'?"),
    "another shape": (
        2,
        {"Z": np.zeros((1, SIZE, SIZE), np.float32)},
        "out['Z']: expected an array of shape (2, 48, 48) and type float32, found an array of shape (1, 48, 48) and type "
        "float32",
    ),
    "another type": (
        1,
        {"rgba": np.zeros((1, SIZE, SIZE, 4))},
        "out['rgba']: expected an array of shape (1, 48, 48, 4) and type float32, found an array of shape (1, 48, 48, 4) "
        "and type float64",
    ),
    "no array": (1, {"Z": [1]}, "out['Z']: expected an array of shape (1, 48, 48) and type float32, found [1]"),
    "read-only": (
        1,
        {"Z": np.broadcast_to(np.float32(0), (1, SIZE, SIZE))},
        "out['Z']: expected a writeable array, found a read-only one",
    ),
    "one memory for two": (
        1,
        {"id": np.zeros((1, SIZE, SIZE), np.uint32)},
        "out['id']: expected memory of its own, found that of out['Z']",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_name_the_field_before_anything_is_drawn(device, case, monkeypatch):
    cameras, out, message = REFUSED[case]
    if case == "one memory for two":
        out = {**out, "Z": out["id"].view(np.float32)}
    with open_cloud(device) as renderer:
        monkeypatch.setattr(Stages, "run", None)
        with pytest.raises(InputError, match=rf"^Renderer.render_many: {re.escape(message)}[^\n]*$"):
            renderer.render_many([looking(-4.0)] * cameras if isinstance(cameras, int) else cameras, out)


def test_a_camera_that_float64_cannot_hold_is_refused_before_anything_is_drawn(device, monkeypatch):
    corner = Mesh([[1.7e308, 0, 0], [1.6e308, 0, 0], [1.7e308, 1e307, 0]], [[0, 1, 2]])
    near = Camera((1.7e308, 0, 1e307), (1.7e308, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (SIZE, SIZE))
    far = replace(near, eye=(-1.7e308, 0, 1e307), lookat=(-1.7e308, 0, 0))
    with Renderer(Scene((corner,), near), device=device, shader="nolight", layers=LAYERS) as renderer:
        monkeypatch.setattr(Stages, "run", None)
        with pytest.raises(InputError, match="expected coordinates whose differences float64 can hold"):
            renderer.render_many([near, far])


def test_more_than_fits_in_memory_is_refused(device, monkeypatch):
    with open_cloud(device) as renderer:
        monkeypatch.setattr(buffers.np, "empty", lambda *_: (_ for _ in ()).throw(MemoryError))
        with pytest.raises(
            InputError, match=r"cameras: expected as many as fit in memory, or memory-mapped arrays as out,"
        ):
            renderer.render_many([looking(-4.0)])


@pytest.mark.parametrize("at", [0, 7, 12, 20, 31])  # of the launches
def test_an_interrupt_leaves_the_renderer_usable(device, monkeypatch, at):
    cameras = [looking(back) for back in (*FAR, -0.5, -4.0)]
    with open_cloud(device) as renderer:
        expected = [renderer.render(camera) for camera in cameras]
        launch, calls = Stages.run, []

        def interrupted(self, name, *arguments, **values):
            event = launch(self, name, *arguments, **values)
            calls.append(name)
            if len(calls) > at:
                raise KeyboardInterrupt
            return event

        out = {"rgba": np.zeros((5, SIZE, SIZE, 4), np.float32)}
        with monkeypatch.context() as patch:
            patch.setattr(Stages, "run", interrupted)
            with pytest.raises(KeyboardInterrupt):
                renderer.render_many(cameras, out)
        assert same_bits(renderer.render(cameras[1]), expected[1])
        assert_same(renderer.render_many(cameras, out), expected)


def test_a_closed_renderer_says_so_and_its_frames_stay(device):
    with open_cloud(device) as renderer:
        frames = renderer.render_many([looking(-4.0)] * 2)
        before = frames.rgba.copy()
    with pytest.raises(ClshadeError, match=r"Renderer.render_many: the renderer is closed"):
        renderer.render_many([])
    assert np.array_equal(frames.rgba, before)
    assert frames[0].stats["triangles"] == 1000
