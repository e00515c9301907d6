"""What does not fit into memory, or into the kernels' numbers, is refused in one line before it is allocated."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from devices import rendered

import clshade
from clshade.base import host_memory
from clshade.base.validation import indices
from clshade.errors import DeviceError, InputError
from clshade.pipeline import buffers, draw, hierarchy, scene_tables, struct_layout
from clshade.pipeline.draw import TileLists
from clshade.pipeline.launches import FrameInFlight
from clshade.pipeline.renderer import Renderer
from clshade.scene import model
from clshade.scene.model import Scene

SCENE = clshade.builtin("icosphere", level=3)


def placed(count: int) -> Scene:
    return replace(SCENE, meshes=tuple(replace(m, instances=np.tile(np.eye(4), (count, 1, 1))) for m in SCENE.meshes))


def test_memory_of_a_device(device):
    """The least that both kinds of devices need is told, in figures; a device with all of it draws."""
    for is_cpu, memory in ((True, 40_000), (False, 120_000)):
        small = replace(device, is_cpu=is_cpu, memory=memory)
        line = r"^[^\n]+: 1,280 triangles and 642 vertices take 0\.0 GiB or more, the device has 0\.0 GiB$"
        with pytest.raises(DeviceError, match=line):
            clshade.render(SCENE, device=small, resolution=(8, 8))
    assert rendered(SCENE, device=replace(device, memory=400_000), resolution=(8, 8)).alpha.any()


def test_memory_that_the_system_does_not_give(device, monkeypatch):
    def refuse(shape, dtype):
        raise MemoryError

    monkeypatch.setattr(buffers, "aligned", refuse)
    with pytest.raises(DeviceError, match=r"^[^\n]+: no memory for 48 bytes$"):
        buffers.Buffer.empty(device, (3, 4), np.float32)


def test_memory_of_the_machine(device, monkeypatch):
    """Of what instances multiply, and of generated scenes."""
    monkeypatch.setattr(host_memory, "physical", lambda: 1 << 20)
    with pytest.raises(InputError, match=r"^render: scene: expected what 0\.0 GiB of memory hold, found 128,000 tri"):
        Renderer(placed(100), device=device, shadows=True)
    with pytest.raises(
        InputError, match=r"^torus_knot: triangles: expected what 0\.0 GiB of memory hold, found 50,000"
    ):
        clshade.builtin("torus_knot", triangles=50_000)
    scene_tables.check_host(placed(2))
    monkeypatch.setattr(host_memory, "physical", lambda: None)
    scene_tables.check_host(placed(100))


def test_a_machine_that_does_not_say_refuses_nothing(monkeypatch):
    if hasattr(os, "sysconf"):
        assert host_memory.physical() > 1 << 28

    def unknown(name):
        raise ValueError("unrecognized configuration name")

    monkeypatch.setattr(os, "sysconf", unknown, raising=False)
    assert host_memory.physical() is None
    host_memory.require("x", "y", 1 << 60, "z")


def test_vertices_that_int32_does_not_number(monkeypatch):
    with pytest.raises(
        InputError, match=r"^Mesh: faces: expected indices from 0 to 2147483647, found '2147483648 in face 0'"
    ):
        indices("Mesh", "faces", np.array([[0, 1, 1 << 31]]), 1 << 32)
    monkeypatch.setattr(scene_tables, "MOST_VERTICES", 1500)
    scene_tables.check_host(placed(2))
    with pytest.raises(InputError, match=r"^render: scene: expected at most 1500 vertices with instances, found 1926$"):
        scene_tables.check_host(placed(3))


def test_faces_that_the_kernels_do_not_count(monkeypatch):
    monkeypatch.setattr("clshade.scene.model.MAX_FACES", 2000)
    with pytest.raises(
        InputError, match=r"^Scene: meshes: expected at most 2000 triangles with instances, found 2560$"
    ):
        placed(2)


def test_the_most_faces_are_within_the_kernels_numbers():
    """In int32: corners, rows of four reals of the structs of triangles, twice a piece and its turn. In the bits of a float,
    neither infinite nor NaN: ranks, and faces of leaves. In 64 bits: keys. And the hierarchy has enough levels."""
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


def test_entries_of_tile_lists_that_the_kernels_do_not_count(device, monkeypatch):
    with Renderer(SCENE, device=device, resolution=(64, 64)) as renderer:
        expected = renderer.render()
        entries = renderer._drawing._lists.room
        monkeypatch.setattr(draw, "_MOST_ENTRIES", entries)
        lists, frame = TileLists(renderer.stages), FrameInFlight(renderer._drawing.tables)
        lists.make_room(entries, frame)
        assert lists.room == entries
        line = rf"the lists of all tiles need {entries + 1} entries, {entries} are allowed"
        with pytest.raises(DeviceError, match=line):
            lists.make_room(entries + 1, frame)
        assert np.array_equal(renderer.render().rgba, expected.rgba)
