"""The lifetime of a renderer: threads, errors, closing, forks, memory over many frames."""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
import threading
from dataclasses import replace

import numpy as np
import pyopencl as cl
import pytest
from processes import PEAK

import clshade
from clshade.errors import ClshadeError, DeviceError, InputError
from clshade.pipeline import draw, scene_tables
from clshade.pipeline.buffers import Buffer, Pool, aligned
from clshade.pipeline.launches import Stages
from clshade.pipeline.renderer import Renderer, trial_of
from clshade.scene.camera import Camera
from clshade.scene.environment import Environment
from clshade.scene.material import MetallicRoughness
from clshade.scene.model import Material, Mesh, Scene, Settings, Texture

CAMERA = Camera.from_fov((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 60.0, (60, 40))
TRIANGLE = Mesh(np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
SCENE = Scene((TRIANGLE,), CAMERA)


def test_a_trial_frame_takes_the_programs_of_the_scene():
    """With images of four texels, also where a corner of an image is black; empty where a type cannot be copied."""
    sky, image = np.zeros((8, 16, 3)), np.zeros((8, 8, 4))
    sky[4, 9], image[7, 7] = 3.0, (2.0, 1.0, 1.0, 1.0)
    texture = Texture(image)
    pbr = MetallicRoughness(emission_texture=Texture(image[..., :3] / 2.0))
    mesh = replace(TRIANGLE, uvs=np.zeros((3, 2)), material=Material(texture=texture, pbr=pbr))
    scene = Scene((mesh, mesh), CAMERA, environment=Environment(sky), preset="pbr")
    settings = Settings.from_preset("pbr")
    trial = pickle.loads(trial_of(scene, settings, ()))[0]["scene"]
    features = [scene_tables.pack(variant, settings, forced=(), has_fp64=True).features for variant in (scene, trial)]
    assert features[0] == features[1]
    assert trial.meshes[0].material.texture.image.shape == trial.environment.image.shape[:2] + (4,) == (2, 2, 4)
    own_material = type("OwnMaterial", (Material,), {"__init__": lambda self: Material.__init__(self)})()
    assert trial_of(Scene((replace(TRIANGLE, material=own_material),), CAMERA), settings, ()) == b""


@pytest.mark.parametrize("shape", [(7,), (5, 3), (5, 4), (2, 8)])
def test_float64_in_a_buffer_is_aligned(device, shape):
    """Kernels read four float64 at once, with rows of any length; NumPy aligns to 16 bytes."""
    count = int(np.prod(shape))
    array = aligned((count + 2,), np.dtype(np.float64))[2:].reshape(shape)
    array[:] = np.arange(count).reshape(shape)
    assert array.ctypes.data % 64 == 16
    buffer = Buffer(device, array)
    assert buffer.array.ctypes.data % 64 == 0
    assert np.array_equal(buffer.to_host(), array)


def test_memory_that_is_hardly_aligned_is_shared_as_other_is(device):
    """The device sees the host's writes, and vice versa, in arrays aligned to only 16 bytes."""
    array = aligned((4 + 1000,), np.dtype(np.uint32))[4:]
    array[:] = 5
    buffer = Buffer(device, array)
    with buffer.writing() as rows:
        rows[:] = np.arange(1000)
    cl.enqueue_copy(device.queue, seen := np.zeros(1000, np.uint32), buffer.memory)
    assert np.array_equal(seen, np.arange(1000))
    cl.enqueue_fill_buffer(device.queue, buffer.memory, np.uint32(9), 0, array.nbytes)
    assert (buffer.to_host() == 9).all()


def test_a_closed_renderer_says_so_and_its_frames_stay(device):
    renderer = Renderer(SCENE, device=device)
    frame = renderer.render()
    before = frame.rgba.copy()
    renderer.close()
    renderer.close()
    assert np.array_equal(frame.rgba, before)
    assert frame.stats["triangles"] == 1
    with pytest.raises(ClshadeError, match="the renderer is closed"):
        renderer.render()


def test_threads_share_a_renderer_and_a_device(device):
    """Each frame is that of its camera, with the shortest thread switch interval."""
    cameras = [replace(CAMERA, eye=np.array([0.1 * k, 0.0, 3.0])) for k in range(8)]
    with Renderer(SCENE, device=device) as one, Renderer(SCENE, device=device) as second:
        expected = [one.render(camera).rgba.copy() for camera in cameras]
        wrong: list[object] = []

        def draw(renderer: Renderer) -> None:
            try:
                for turn in range(25):
                    k = turn % len(cameras)
                    if not np.array_equal(renderer.render(cameras[k]).rgba, expected[k]):
                        wrong.append(k)
            except Exception as error:
                wrong.append(error)

        interval = sys.getswitchinterval()
        sys.setswitchinterval(1e-6)
        try:
            threads = [threading.Thread(target=draw, args=(renderer,)) for renderer in (one, one, second)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        finally:
            sys.setswitchinterval(interval)
    assert not wrong


@pytest.mark.sampled
@pytest.mark.parametrize("stage", ["project", "setup", "setup_count", "bin_fill", "phong"])
def test_an_error_on_the_way_leaves_the_renderer_usable(device, monkeypatch, stage):
    visibility = "depth" if stage == "setup_count" else "painter"
    if visibility == "depth" and device.lanes == 1:
        pytest.skip("this device always sorts")
    with Renderer(SCENE, device=device, visibility=visibility) as renderer:
        expected = renderer.render().rgba.copy()
        launch = Stages.run

        def interrupted(self, name, *arguments, **values):
            event = launch(self, name, *arguments, **values)
            if name == stage:
                raise KeyboardInterrupt
            return event

        with monkeypatch.context() as patch:
            patch.setattr(Stages, "run", interrupted)
            with pytest.raises(KeyboardInterrupt):
                renderer.render()
        assert np.array_equal(renderer.render().rgba, expected)


def test_an_image_beyond_the_device_is_refused_with_numbers(device):
    limited = replace(device, max_allocation=100_000)
    with pytest.raises(DeviceError, match=r"one buffer needs 160000 bytes, the device allows 100000"):
        clshade.render(SCENE, device=limited, resolution=(100, 100))


def test_pieces_beyond_the_most_triangles_are_refused(device, monkeypatch):
    mesh = Mesh(np.array([[-9.0, -9, 5], [9, -9, -5], [0, 9, -5]]), np.array([[0, 1, 2], [0, 2, 1]]))
    with Renderer(Scene((mesh,), CAMERA), device=device) as renderer:
        assert renderer.render().stats["clipped"] == 2
        monkeypatch.setattr(draw, "MAX_FACES", 2)
        with pytest.raises(InputError, match="at most 2 triangles, pieces of clipped ones included, found 2 and"):
            renderer.render()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_child_is_told_instead_of_waiting_forever(device):
    with Renderer(SCENE, device=device) as renderer:
        renderer.render()
        child = os.fork()
        if child == 0:
            try:
                renderer.render()
            except DeviceError:
                os._exit(7)
            os._exit(1)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7


GROWTH = f"""{PEAK}
import clshade
scene = clshade.builtin("icosphere")
def draw(count):
    for _ in range(count):
        clshade.render(scene, resolution=(32, 32))
    return peak()
before = draw(20)
print((draw(150) - before) / before)
"""


@pytest.mark.long
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc/self/status")
def test_memory_does_not_grow_with_the_number_of_renderers(device):
    environment = {**os.environ, "CLSHADE_DEVICE": device.index}
    done = subprocess.run([sys.executable, "-c", GROWTH], env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"-?[\d.e-]+", done.stdout.strip())
    assert float(done.stdout) < 0.01


FRAMES = f"""{PEAK}
from dataclasses import replace
import numpy as np
import clshade
from clshade.pipeline.renderer import Renderer, trial_of
scene = clshade.builtin("icosphere")
camera = scene.camera.with_resolution((64, 48))
with Renderer(scene, layers=("Z", "id")) as renderer:
    def draw(count):
        for k in range(count):
            renderer.render(replace(camera, eye=camera.eye + 1e-3 * np.sin([k, 2.0 * k, 3.0 * k])))
        return peak()
    before = draw(200)
    print((draw(10_000) - before) / before)
"""


@pytest.mark.long
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc/self/status")
def test_ten_thousand_frames_in_one_process(device):
    environment = {**os.environ, "CLSHADE_DEVICE": device.index}
    done = subprocess.run([sys.executable, "-c", FRAMES], env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 0.01


def test_memory_that_is_held_is_not_given_away(device):
    """Views of any kind hold it; what nobody holds serves again, with a buffer or without."""
    pool = Pool(device)
    views = (lambda a: a[1:].T, memoryview, lambda a: a.reshape(-1)[::2], np.asarray, lambda a: a)
    for take in (lambda: pool.take((4, 3), np.float32)[1], lambda: pool.take_host((4, 3), np.float64)):
        for view in views:
            array = take()
            place, held = array.ctypes.data, view(array)
            del array
            assert take().ctypes.data != place
            del held
            assert take().ctypes.data == place


@pytest.mark.long
def test_a_frames_arrays_stay_as_they_are(device):
    """Also those that no device sees, such as positions in the world."""
    scene = clshade.builtin("quads", resolution=(40, 30))
    with Renderer(scene, device=device, layers=("P", "N")) as renderer:
        first = renderer.render()
        kept = first.rgb[::2], first["P"].T
        before = [array.copy() for array in kept]
        del first
        for step in range(8):
            renderer.render(camera=replace(scene.camera, eye=scene.camera.eye * (1.0 + 0.1 * step)))
    assert all(np.array_equal(a, b) for a, b in zip(kept, before, strict=True))


def test_the_pool_forgets_shapes_that_are_no_longer_asked_for(device):
    pool = Pool(device, kinds=3)
    for columns in range(1, 9):
        pool.take((2, columns), np.float32)
    assert sorted(shape for shape, *_ in pool._held) == [(2, 6), (2, 7), (2, 8)]


def test_a_scene_too_large_for_its_own_near_plane_is_refused():
    """Its corners can be held, their distance cannot; with a near plane that is given it is drawn."""
    verts = 1.1e308 * np.array([[1.0, 1, 1], [-1, -1, -1], [1, -1, 1]])
    scene = Scene((Mesh(verts, [[0, 1, 2]]),), Camera((0, 0, 1), (0, 0, 0), (0, 1, 0), 1.0, (1, 1), (4, 4)))
    with pytest.raises(InputError, match="coordinates whose differences float64 can hold"):
        clshade.render(scene)


def test_errors_of_copies_name_the_device(device, monkeypatch):
    """Where a device does not work in the host's memory; what is under way is waited for, and its error hides none."""
    buffer = Buffer(device, np.zeros(4, np.float32))
    monkeypatch.setattr(buffer, "is_shared", False)

    def failing(*_: object, **__: object) -> None:
        raise cl.RuntimeError("clEnqueueCopyBuffer failed: OUT_OF_RESOURCES")

    monkeypatch.setattr(cl, "enqueue_copy", failing)
    with pytest.raises(DeviceError, match=f"^{re.escape(device.name)}: .*OUT_OF_RESOURCES"):
        buffer.to_host()
    with pytest.raises(DeviceError, match="OUT_OF_RESOURCES"), buffer.writing() as rows:
        rows[:] = 1.0
    with pytest.raises(DeviceError, match="OUT_OF_RESOURCES"):
        buffer.fetch(device.queue, cl.UserEvent(device.context))
