"""Many frames in one call: the bits of frames drawn one by one, in arrays of any layout, whatever happens on the way.

And what arrays of frames are to others.
"""

import gc
import re
import tracemalloc
from dataclasses import replace
from unittest.mock import Mock

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
    """In every bit of every array, and in what is counted; whether it is sorted may depend on the frame before."""
    assert len(views) == len(expected)
    for frame, reference in zip(views, expected, strict=True):
        assert same_bits(frame, reference)
        assert frame.scene.camera is reference.scene.camera
        counts = set(reference.stats) - {"times_ms", "build_ms", "features", "left_out"}
        assert {name: frame.stats[name] for name in counts} == {name: reference.stats[name] for name in counts}


def test_frames_that_have_to_be_drawn_again(device):
    """The first of a renderer finds no room in the tile lists, nor does one from nearer; faces to clip need a sort."""
    cameras = [looking(back) for back in BACKS]
    with open_cloud(device) as one, open_cloud(device) as reference:
        frames = one.render_many(cameras)
        assert_same(frames, [reference.render(camera) for camera in cameras])
        assert [frame.stats["clipped"] > 0 for frame in frames] == [back > -1.0 for back in BACKS]
        assert_same(one.render_many(cameras[::-1]), list(frames)[::-1])
        assert same_bits(one.render(cameras[0]), frames[0])


def places(kind: str, shape: tuple[int, ...], dtype: np.dtype, tmp_path) -> np.ndarray:
    if kind == "memory-mapped":
        return np.lib.format.open_memmap(tmp_path / f"{len(list(tmp_path.iterdir()))}.npy", "w+", dtype, shape)
    if kind == "every other one":
        return aligned((2 * shape[0], *shape[1:]), dtype)[::-2]
    first = int(kind == "hardly aligned")
    return aligned((int(np.prod(shape)) + first,), dtype)[first:].reshape(shape)


@pytest.mark.parametrize("size", [48, 33])  # images of 48 begin at multiples of 64 bytes, of 33 at those of 4
@pytest.mark.parametrize("kind", ["aligned", "hardly aligned", "every other one", "memory-mapped"])
def test_arrays_of_the_caller(device, tmp_path, kind, size):
    cameras = [looking(back, size) for back in (-4.0, -0.5, -3.0)]
    with open_cloud(device) as renderer:
        expected = renderer.render_many(cameras)
        out = {name: places(kind, array.shape, array.dtype, tmp_path) for name, array in expected.arrays.items()}
        if kind == "aligned":
            del out["Z"]  # the others are made
        views = renderer.render_many(cameras, out)
        assert all(views.arrays[name] is array for name, array in out.items())
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
            renderer.render_many(cameras, {"rgba": image})
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak < image.nbytes / 2
        image.flush()
        assert np.array_equal(np.load(tmp_path / "rgba.npy")[-1], renderer.render(cameras[-1]).rgba)


@pytest.mark.parametrize("layers", [(), LAYERS])
def test_a_device_with_memory_of_its_own(device, monkeypatch, layers):
    cameras = [looking(back) for back in BACKS]
    with open_cloud(device, layers=layers) as renderer:
        expected = [renderer.render(camera) for camera in cameras]
    monkeypatch.setattr(buffers, "_coherent", lambda *_: False)
    with open_cloud(device, layers=layers) as renderer:
        assert_same(renderer.render_many(cameras), expected)


def test_frames_as_a_sequence(device, tmp_path):
    with open_cloud(device) as renderer:
        cameras = [looking(back) for back in FAR]
        frames = renderer.render_many(cameras)
        before = frames.rgba.copy()
        none = renderer.render_many([])
        assert renderer.render_many(iter(cameras[:1])).rgb.shape == (1, SIZE, SIZE, 3)
    with pytest.raises(ClshadeError, match=r"Renderer.render_many: the renderer is closed"):
        renderer.render_many([])
    assert (len(none), list(none), none.cameras, none.stats["views"]) == (0, [], (), 0)
    shapes = {name: array.shape for name, array in none.arrays.items()}
    assert shapes == {"rgba": (0, SIZE, SIZE, 4), "id": (0, SIZE, SIZE), "Z": (0, SIZE, SIZE)}
    assert np.array_equal(frames.rgba, before)
    assert frames.cameras == tuple(cameras)
    assert frames.layers == LAYERS
    assert np.shares_memory(frames[-1].rgba, frames.rgba[2])
    assert np.array_equal(frames.alpha, frames.rgba[..., 3])
    with pytest.raises(IndexError):
        frames[3]
    with pytest.raises(InputError, match=r"Views: layer: expected one that was asked for .*: did you mean 'Z'\?"):
        frames["depth"]
    frames[1].save(tmp_path / "one", deterministic=True)
    assert np.array_equal(clshade.exr.read(tmp_path / "one.exr")[0]["Z"], frames["Z"][1])
    assert frames.stats["times_ms"]["views"] == pytest.approx(3 * frames[0].stats["times_ms"]["frame"])
    assert frames[0].stats["triangles"] == 1000


def shaped(*shape: int, dtype: str = "f4") -> np.ndarray:
    return np.zeros((*shape, SIZE, SIZE), dtype)


IDS, READ_ONLY = shaped(1, dtype="u4"), np.broadcast_to(np.float32(0), (1, SIZE, SIZE))
NEAR, SMALLER = looking(-4.0), looking(-4.0, 47)
PARALLEL = replace(NEAR, orthographic=True)
EXPECTED_Z = "out['Z']: expected an array of shape (1, 48, 48) and type float32, found "
REFUSED = [
    (NEAR, None, "cameras: expected a sequence of Cameras, found Camera(eye="),
    ([NEAR, 3], None, "cameras[1]: expected a Camera, found 3"),
    ([NEAR, SMALLER], None, "cameras[1]: expected the resolution of all, (48, 48) as that of cameras[0], found"),
    ([NEAR, PARALLEL], None, "cameras[1]: expected a perspective camera, as the scene's, found"),
    ([NEAR], [np.zeros(3)], "out: expected arrays by name, such as {'rgba': array}, found [array([0."),
    ([NEAR], {"depth": 0}, "out: expected names of rgba, Z, id, found 'depth': did you mean 'Z'?"),
    ([NEAR], {"Z": shaped(1, dtype="f8")}, EXPECTED_Z + "an array of shape (1, 48, 48) and type float64"),
    ([NEAR], {"Z": READ_ONLY}, "out['Z']: expected a writeable array, found a read"),
    ([NEAR], {"id": IDS, "Z": IDS.view(np.float32)}, "out['id']: expected memory of its own, found that of out['Z']"),
]


@pytest.mark.parametrize(("cameras", "out", "message"), REFUSED, ids=range(len(REFUSED)))
def test_refusals_name_the_field_before_anything_is_drawn(device, cameras, out, message, monkeypatch):
    with open_cloud(device) as renderer:
        monkeypatch.setattr(Stages, "run", None)
        with pytest.raises(InputError, match=rf"^Renderer.render_many: {re.escape(message)}[^\n]*$"):
            renderer.render_many(cameras, out)


def test_what_float64_or_memory_cannot_hold_is_refused_before_anything_is_drawn(device, monkeypatch):
    corner = Mesh([[1.7e308, 0, 0], [1.6e308, 0, 0], [1.7e308, 1e307, 0]], [[0, 1, 2]])
    near = Camera((1.7e308, 0, 1e307), (1.7e308, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (SIZE, SIZE))
    far = replace(near, eye=(-1.7e308, 0, 1e307), lookat=(-1.7e308, 0, 0))
    with Renderer(Scene((corner,), near), device=device, shader="nolight", layers=LAYERS) as renderer:
        monkeypatch.setattr(Stages, "run", None)
        with pytest.raises(InputError, match="expected coordinates whose differences float64 can hold"):
            renderer.render_many([near, far])
        monkeypatch.setattr(buffers.np, "empty", Mock(side_effect=MemoryError))
        with pytest.raises(
            InputError, match="cameras: expected as many as fit in memory, or memory-mapped arrays as out,"
        ):
            renderer.render_many([near])


@pytest.mark.parametrize("at", [0, 31])  # of the launches
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


def arrays_of(drawn: Frame | Views) -> dict[str, np.ndarray]:
    return {"rgba": drawn.rgba, **{name: drawn[name] for name in drawn.layers}}


@pytest.mark.parametrize("many", [False, True])
def test_frames_are_arrays_of_rgb_and_copied_only_when_asked_for(device, many):
    """Contiguous, writeable, and aligned as XLA asks; also world positions, which the host makes."""
    with open_cloud(device, layers=("Z", "id", "P")) as renderer:
        drawn = renderer.render_many([NEAR] * 3) if many else renderer.render()
    array = np.asarray(drawn)
    assert np.array_equal(array, drawn.rgba[..., :3])
    for shared in (array, np.asarray(drawn, np.float32), drawn.__array__(copy=False)):
        assert np.shares_memory(shared, drawn.rgba)
    for copied in (np.array(drawn), np.asarray(drawn, dtype=np.float64), drawn.__array__(copy=True)):
        assert not np.shares_memory(copied, drawn.rgba)
        assert np.array_equal(copied, drawn.rgb)
    assert np.asarray(drawn, dtype=np.float64).dtype == np.float64
    for array in arrays_of(drawn).values():
        assert array.flags.c_contiguous
        assert array.flags.writeable
        assert array.ctypes.data % 64 == 0
        assert np.from_dlpack(array).ctypes.data == array.ctypes.data


@pytest.mark.long
@pytest.mark.parametrize("name", ["rgba", "Z"])
def test_memory_that_a_capsule_holds_is_not_recycled(device, name):
    """Once the frame is gone, a consumer of DLPack is all that refers to it; when that goes too, the next frame takes it."""
    with open_cloud(device, layers=("Z", "id", "P")) as renderer:
        taken = np.from_dlpack(arrays_of(renderer.render())[name])
        address, before = taken.ctypes.data, taken.copy()
        gc.collect()
        newer_frames = [renderer.render(looking(-9.0)) for _ in range(6)]
        assert all(arrays_of(newer)[name].ctypes.data != address for newer in newer_frames)
        assert not np.array_equal(arrays_of(newer_frames[0])[name], before)
        assert np.array_equal(taken, before)
        del newer_frames, taken
        gc.collect()
        again = [renderer.render(looking(-9.0)) for _ in range(4)]
        assert address in [arrays_of(newer)[name].ctypes.data for newer in again]
        taken = np.from_dlpack(again[0][LAYERS[0]])
        before = taken.copy()
        del again
    del renderer
    gc.collect()
    assert np.array_equal(taken, before), "it outlives the renderer"
