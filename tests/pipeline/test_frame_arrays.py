"""Arrays of frames in the hands of others: NumPy's conversions, and DLPack, by which PyTorch and JAX take them uncopied."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np
import pytest
from processes import ROOT

from clshade import Camera, Mesh, Renderer, Scene
from clshade.pipeline.frame import Frame, Views

CAMERA = Camera.from_fov((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 60.0, (60, 40))
TRIANGLE = Mesh(np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
LAYERS = ("Z", "id")
NUMPY_2 = int(np.__version__.split(".")[0]) >= 2


@pytest.fixture
def renderer(device) -> Iterator[Renderer]:
    with Renderer(Scene((TRIANGLE,), CAMERA), device=device, shader="nolight", layers=LAYERS) as renderer:
        yield renderer


@pytest.fixture(params=["frame", "frames"])
def drawn(request, renderer) -> Frame | Views:
    return renderer.render() if request.param == "frame" else renderer.render_many([CAMERA] * 3)


def test_as_an_array_it_is_rgb(drawn):
    array = np.asarray(drawn)
    assert array.shape == drawn.rgba.shape[:-1] + (3,)
    assert np.array_equal(array, drawn.rgba[..., :3])
    assert np.shares_memory(array, drawn.rgba)
    assert np.asarray(drawn, np.float32).base is array.base


def test_copies_are_made_when_asked_for(drawn):
    for copied in (np.array(drawn), np.asarray(drawn, dtype=np.float64), drawn.__array__(copy=True)):
        assert not np.shares_memory(copied, drawn.rgba)
        assert np.array_equal(copied, drawn.rgb)
    assert np.asarray(drawn, dtype=np.float64).dtype == np.float64
    assert np.mean(drawn) == drawn.rgb.mean()


def test_no_copy_where_one_is_needed(drawn):
    assert np.shares_memory(drawn.__array__(copy=False), drawn.rgba)
    with pytest.raises(ValueError, match="expected type float32, which takes no copy, found float16"):
        drawn.__array__(np.dtype(np.float16), copy=False)
    if NUMPY_2:
        assert np.shares_memory(np.asarray(drawn, copy=False), drawn.rgba)
        with pytest.raises(ValueError, match="expected type float32"):
            np.asarray(drawn, dtype=np.float16, copy=False)


def arrays_of(drawn: Frame | Views) -> dict[str, np.ndarray]:
    return {"rgba": drawn.rgba, **{name: drawn[name] for name in drawn.layers}}


def test_arrays_can_be_taken_uncopied(drawn):
    """Contiguous, writeable, and aligned as XLA asks."""
    for array in arrays_of(drawn).values():
        assert array.flags.c_contiguous
        assert array.flags.writeable
        assert array.ctypes.data % 64 == 0
        taken = np.from_dlpack(array)
        assert taken.ctypes.data == array.ctypes.data
        assert np.array_equal(taken, array)


def test_world_positions_are_aligned_too(device):
    """The host makes them, in memory of its own."""
    with Renderer(Scene((TRIANGLE,), CAMERA), device=device, shader="nolight", layers=("P",)) as renderer:
        assert all(renderer.render()["P"].ctypes.data % 64 == 0 for _ in range(3))


@pytest.mark.sampled
@pytest.mark.parametrize("name", ["rgba", *LAYERS])
def test_memory_that_a_capsule_holds_is_not_recycled(renderer, name):
    """Once the frame is gone, a consumer of DLPack is all that refers to it; when that goes too, the next frame takes it."""
    away = Camera.from_fov((0.0, 0.0, 3.0), (0.0, 0.0, 6.0), (0.0, 1.0, 0.0), 60.0, (60, 40))
    frame = renderer.render()
    taken = np.from_dlpack(arrays_of(frame)[name])
    address, before = taken.ctypes.data, taken.copy()
    del frame
    gc.collect()
    newer_frames = [renderer.render(away) for _ in range(6)]
    assert all(arrays_of(newer)[name].ctypes.data != address for newer in newer_frames)
    assert np.array_equal(taken, before)
    assert not np.array_equal(arrays_of(newer_frames[0])[name], before)
    del newer_frames, taken
    gc.collect()
    again = [renderer.render(away) for _ in range(4)]
    assert address in [arrays_of(newer)[name].ctypes.data for newer in again]


def test_a_capsule_outlives_the_renderer(device):
    with Renderer(Scene((TRIANGLE,), CAMERA), device=device, shader="nolight", layers=LAYERS) as renderer:
        frames = renderer.render_many([CAMERA] * 2)
        taken, expected = np.from_dlpack(frames["id"][1]), frames["id"][1].copy()
    del frames, renderer
    gc.collect()
    assert np.array_equal(taken, expected)


CONSUMERS = {  # what gives the address of a tensor made of an array
    "torch": "torch.from_dlpack(array.view(np.int32) if array.dtype == np.uint32 else array).data_ptr()",
    "jax": "jax.numpy.from_dlpack(array, copy=False).unsafe_buffer_pointer()",
}
SCRIPT = """
import {library}
import numpy as np

import clshade

scene = clshade.builtin("icosphere", level=1)
camera = scene.camera.with_resolution((64, 48))
with clshade.Renderer(scene, shader="nolight", layers=("Z", "id")) as renderer:
    for drawn in (renderer.render(camera), renderer.render_many([camera] * 3)):
        for array in (drawn.rgba, drawn["Z"], drawn["id"]):
            assert {address} == array.ctypes.data
"""


@pytest.mark.parametrize("library", CONSUMERS)
def test_other_libraries_take_them_uncopied(device, library):
    """In a process of its own: both start threads, and other tests fork."""
    if not find_spec(library):
        pytest.skip(f"{library} is not installed")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "CLSHADE_DEVICE": device.index}
    script = SCRIPT.format(library=library, address=CONSUMERS[library])
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
