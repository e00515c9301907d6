"""The lifetime of a renderer: threads, errors, closing, forks, memory over many frames.

And what does not fit into memory, or the kernels' numbers: it is refused in one line before it is allocated.
"""

import os
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pyopencl as cl
import pytest
from devices import rendered
from processes import PEAK, python
from view_cameras import looking

import clshade
from clshade import Renderer
from clshade.base import host_memory
from clshade.base.validation import indices
from clshade.errors import ClshadeError, DeviceError, InputError
from clshade.pipeline import buffers, draw, hierarchy, scene_tables, struct_layout
from clshade.pipeline.buffers import Buffer, aligned
from clshade.pipeline.camera_space import CameraSpace, Extent
from clshade.pipeline.draw import TileLists
from clshade.pipeline.launches import FrameInFlight, Stages
from clshade.pipeline.opencl import environment
from clshade.scene import model, settings
from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, Scene

CAMERA = Camera.from_fov((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 60.0, (60, 40))
TRIANGLE = Mesh(np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
SCENE = Scene((TRIANGLE,), CAMERA)


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
    cameras = [replace(CAMERA, eye=np.array([0.1 * (k % 8), 0.0, 3.0])) for k in range(24)]
    with Renderer(SCENE, device=device) as one, Renderer(SCENE, device=device) as second:
        expected = [one.render(camera).rgba.copy() for camera in cameras]
        interval = sys.getswitchinterval()
        sys.setswitchinterval(1e-6)
        try:
            with ThreadPoolExecutor(3) as pool:
                runs = [pool.submit(lambda r: list(map(r.render, cameras)), each) for each in (one, one, second)]
        finally:
            sys.setswitchinterval(interval)
    for run in runs:
        assert all(np.array_equal(a.rgba, b) for a, b in zip(run.result(), expected, strict=True))


@pytest.mark.parametrize("stage", ["project", "setup_count", "phong", "tiles"])
def test_an_interrupt_on_the_way_leaves_the_renderer_usable(device, monkeypatch, stage):
    """While kernels are launched, and while tables are written for a larger image, of which none is left behind."""
    if stage == "setup_count" and device.lanes == 1:
        pytest.skip("this device always sorts")
    large, launch = CAMERA.with_resolution((200, 200)), Stages.run

    def interrupted(self, name="", *arguments, **values):
        event = launch(self, name, *arguments, **values) if name else None
        if name in (stage, ""):
            raise KeyboardInterrupt
        return event

    visibility = "depth" if stage in ("setup_count", "tiles") else "painter"
    with Renderer(SCENE, device=device, visibility=visibility) as renderer:
        expected = renderer.render(large).rgba.copy()
        renderer.render()
        with monkeypatch.context() as patch:
            if stage == "tiles":
                patch.setattr(FrameInFlight, "tiles", property(interrupted))
            else:
                patch.setattr(Stages, "run", interrupted)
            with pytest.raises(KeyboardInterrupt):
                renderer.render(large)
        assert np.array_equal(renderer.render(large).rgba, expected)


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


def test_triangles_too_far_for_buckets_are_drawn_in_the_right_order(device):
    """At depths whose reciprocals are about 2^-100 they fall into one bucket, in any order."""
    size, near = 64, 1e-30
    far = 2.0**40 * near * 2.0**100
    scale = CameraSpace.of(looking(0.0, size), Extent((-far,) * 3, (far,) * 3, far), near).scale
    z = 2.0**100 / np.array([1.4, 1.0005, 1.9]) / scale
    corners = np.array([[-0.6, -0.6, 1.0], [1.8, -0.6, 1.0], [-0.6, 1.8, 1.0]])
    mesh = Mesh((corners * z[:, None, None]).reshape(-1, 3), np.arange(9).reshape(-1, 3))
    scene = Scene((mesh,), looking(0.0, size))
    frame = clshade.render(scene, device=device, shader="nolight", near=near, layers=("id",))
    assert (frame["id"] == 3).all()


def test_memory_that_is_hardly_aligned_is_shared_where_kernels_can_read_it(device):
    """The device sees the host's writes, and vice versa, in arrays aligned to only 16 bytes, as NumPy's. Kernels read four
    float64 at once, with rows of any length: of those there is a copy."""
    array = aligned((4 + 1000,), np.dtype(np.uint32))[4:]
    array[:] = 5
    buffer = Buffer(device, array)
    with buffer.writing() as rows:
        rows[:] = np.arange(1000)
    cl.enqueue_copy(device.queue, seen := np.zeros(1000, np.uint32), buffer.memory)
    assert np.array_equal(seen, np.arange(1000))
    cl.enqueue_fill_buffer(device.queue, buffer.memory, np.uint32(9), 0, array.nbytes)
    assert (buffer.to_host() == 9).all()
    for shape in ((7,), (5, 3), (5, 4)):
        array = aligned((22,), np.dtype(np.float64))[2 : 2 + np.prod(shape)].reshape(shape)
        array[:] = np.random.default_rng(0).random(shape)
        assert array.ctypes.data % 64 == 16
        buffer = Buffer(device, array)
        assert buffer.array.ctypes.data % 64 == 0
        assert np.array_equal(buffer.to_host(), array)


GROWTH = f"""{PEAK}
from dataclasses import replace
import numpy as np
import clshade
scene = clshade.builtin("icosphere", resolution=(64, 48))
def draw(count):
    for k in range(count):
        {{}}
    return peak()
with clshade.Renderer(scene, layers=("Z", "id")) as renderer:
    before = draw({{}})
    print((draw({{}}) - before) / before)
"""
MOVED = "renderer.render(replace(scene.camera, eye=scene.camera.eye + 1e-3 * np.sin([k, 2.0 * k, 3.0 * k])))"


@pytest.mark.long
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc/self/status")
@pytest.mark.parametrize(("deed", "before", "after"), [("clshade.render(scene)", 20, 150), (MOVED, 200, 10_000)])
def test_memory_does_not_grow_with_the_number_of_renderers_or_frames(device, deed, before, after):
    code = GROWTH.format(deed, before, after)
    done = python(code, environment.cache_home(), timeout=600.0, CLSHADE_DEVICE=device.index)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 0.01


def test_errors_of_copies_name_the_device(device, monkeypatch):
    buffer = Buffer(device, np.zeros(4, np.float32))
    monkeypatch.setattr(buffer, "is_shared", False)
    failure = cl.RuntimeError("clEnqueueCopyBuffer failed: OUT_OF_RESOURCES")
    monkeypatch.setattr(cl, "enqueue_copy", Mock(side_effect=failure))
    with pytest.raises(DeviceError, match=f"^{re.escape(device.name)}: .*OUT_OF_RESOURCES"):
        buffer.to_host()


SPHERE = clshade.builtin("icosphere", level=3)


def placed(count: int) -> Scene:
    return replace(SPHERE, meshes=tuple(replace(m, instances=np.tile(np.eye(4), (count, 1, 1))) for m in SPHERE.meshes))


def test_memory_of_a_device(device, monkeypatch):
    """The least that both kinds of devices need is told, in figures; a device with all of it draws."""
    for is_cpu, memory in ((True, 40_000), (False, 120_000)):
        small = replace(device, is_cpu=is_cpu, memory=memory)
        line = r"^[^\n]+: 1,280 triangles and 642 vertices take 0\.0 GiB or more, the device has 0\.0 GiB$"
        with pytest.raises(DeviceError, match=line):
            clshade.render(SPHERE, device=small, resolution=(8, 8))
    assert rendered(SPHERE, device=replace(device, memory=400_000), resolution=(8, 8)).alpha.any()
    limited = replace(device, max_allocation=100_000)
    with pytest.raises(DeviceError, match=r"one buffer needs 160000 bytes, the device allows 100000"):
        clshade.render(SPHERE, device=limited, resolution=(100, 100))
    monkeypatch.setattr(buffers, "aligned", Mock(side_effect=MemoryError))
    with pytest.raises(DeviceError, match=r"^[^\n]+: no memory for 48 bytes$"):
        Buffer.empty(device, (3, 4), np.float32)


def test_memory_of_the_machine(device, monkeypatch):
    assert host_memory.physical() > 1 << 28
    with monkeypatch.context() as patch:
        patch.setattr(host_memory, "physical", lambda: 1 << 20)
        hold = r"expected what 0\.0 GiB of memory hold, found"
        with pytest.raises(InputError, match=f"^render: scene: {hold} 128,000 tri"):
            Renderer(placed(100), device=device, shadows=True)
        with pytest.raises(InputError, match=f"^torus_knot: triangles: {hold} 50,000"):
            clshade.builtin("torus_knot", triangles=50_000)
        scene_tables.check_host(placed(2))


def test_more_than_the_kernels_number(device, monkeypatch):
    with pytest.raises(InputError, match=r"expected indices from 0 to 2147483647, found '2147483648 in face 0'"):
        indices("Mesh", "faces", np.array([[0, 1, 1 << 31]]), 1 << 32)
    monkeypatch.setattr(scene_tables, "MOST_VERTICES", 1500)
    scene_tables.check_host(placed(2))
    with pytest.raises(InputError, match=r"^render: scene: expected at most 1500 vertices with instances, found 1926$"):
        scene_tables.check_host(placed(3))
    monkeypatch.setattr("clshade.scene.model.MAX_FACES", 2000)
    line = r"^Scene: meshes: expected at most 2000 triangles with instances, found 2560$"
    with pytest.raises(InputError, match=line):
        placed(2)
    mesh = Mesh(np.array([[-9.0, -9, 5], [9, -9, -5], [0, 9, -5]]), np.array([[0, 1, 2], [0, 2, 1]]))
    with Renderer(Scene((mesh,), CAMERA), device=device) as renderer:
        assert renderer.render().stats["clipped"] == 2
        monkeypatch.setattr(draw, "MAX_FACES", 2)
        with pytest.raises(InputError, match="at most 2 triangles, pieces of clipped ones included, found 2 and"):
            renderer.render()
    verts = 1.1e308 * np.array([[1.0, 1, 1], [-1, -1, -1], [1, -1, 1]])
    scene = Scene((Mesh(verts, [[0, 1, 2]]),), Camera((0, 0, 1), (0, 0, 0), (0, 1, 0), 1.0, (1, 1), (4, 4)))
    with pytest.raises(InputError, match="coordinates whose differences float64 can hold"):
        clshade.render(scene, device=device)


def test_entries_of_tile_lists_that_the_kernels_do_not_count(device, monkeypatch):
    with Renderer(SPHERE, device=device, resolution=(64, 64)) as renderer:
        expected = renderer.render()
        entries = renderer._drawing._lists.room
        monkeypatch.setattr(draw, "_MOST_ENTRIES", entries)
        lists, frame = TileLists(renderer.stages), FrameInFlight(renderer._drawing.tables)
        lists.make_room(entries, frame)
        assert lists.room == entries
        with pytest.raises(DeviceError, match=rf"all tiles need {entries + 1} entries, {entries} are allowed"):
            lists.make_room(entries + 1, frame)
        assert np.array_equal(renderer.render().rgba, expected.rgba)


def test_the_most_of_all_is_within_the_kernels_numbers():
    limit = model.MAX_FACES
    assert 3 * limit <= 1 << 31
    assert struct_layout.SINGLE.Triangle.itemsize == 3 * 16
    assert 2 * limit + 1 < 1 << 31
    assert limit + 0x00800000 < 0x7F800000
    assert limit <= 16 ** (struct_layout.MOST_HIERARCHY_LEVELS + 1)
    mantissa = 64 - buffers.index_bits(limit) - 12
    assert mantissa > 22  # sorted to 2^-22 of a depth, as the kernels have it
    per_axis = (64 - struct_layout.SIZE_BITS - hierarchy._index_bits(limit)) / 3
    assert per_axis >= 10  # cells of Hilbert's curve, 2^10 along each axis
    farthest = max(struct_layout.GUARD_HIGH, 16384 - struct_layout.GUARD_LOW) << struct_layout.SUBPIXEL_BITS
    assert farthest < struct_layout.SNAP_LIMIT <= 2**31 - (1 << struct_layout.SUBPIXEL_BITS)
    assert struct_layout.GUARD_HIGH - struct_layout.GUARD_LOW << struct_layout.SUBPIXEL_BITS < 2**31
    assert settings.MAX_SAMPLES == struct_layout.MOST_SAMPLES
