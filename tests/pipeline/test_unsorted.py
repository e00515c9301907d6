"""Frames without a depth sort: the same bits as with one, whatever was drawn before, and nothing left of other frames."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from view_cameras import cloud, looking

import clshade
from clshade import Mesh, Renderer, Scene
from clshade.pipeline.camera_space import CameraSpace, Extent
from clshade.pipeline.launches import FrameInFlight


@pytest.mark.long
def test_sorted_or_not_clipped_or_not_the_bits_are_the_same(device):
    """One renderer that draws with and without faces to clip, against one that always sorts."""
    scene, backs = cloud(4000, 96), (-4.0, -0.5, -0.5, -4.0, -3.9, -0.4)
    with (
        Renderer(scene, device=device, shader="nolight", layers=("id",)) as free,
        Renderer(scene, device=device, shader="nolight", layers=("id",), forced={"SORTED"}) as bound,
    ):
        clipped = False
        for back in backs:
            frame, expected = free.render(looking(back, 96)), bound.render(looking(back, 96))
            assert np.array_equal(frame.rgba.view(np.uint32), expected.rgba.view(np.uint32))
            assert np.array_equal(frame["id"], expected["id"])
            assert frame.stats["visible"] == expected.stats["visible"]
            assert (frame.stats["clipped"] > 0) == (back > -1.0)
            unsorted = "SORTED" in frame.stats["left_out"]
            # After a frame with faces to clip the next one is sorted at once: most likely it has some too.
            assert unsorted == (back < -1.0 and not clipped and device.lanes > 1)
            assert unsorted == (frame.stats["times_ms"]["sort"] == 0.0)
            assert "SORTED" not in expected.stats["left_out"]
            clipped = back > -1.0


def test_triangles_too_far_for_buckets_are_drawn_in_the_right_order(device):
    """At depths whose reciprocals are about 2^-100 they fall into one bucket, in any order."""
    size, near = 64, 1e-30
    far = 2.0**40 * near * 2.0**100
    scale = CameraSpace.of(looking(0.0, size), Extent((-far,) * 3, (far,) * 3, far), near).scale
    z = 2.0**100 / np.array([1.4, 1.0005, 1.9]) / scale
    corners = np.array([[-0.6, -0.6, 1.0], [1.8, -0.6, 1.0], [-0.6, 1.8, 1.0]])
    mesh = Mesh((corners * z[:, None, None]).reshape(-1, 3), np.arange(9).reshape(-1, 3))
    frame = clshade.render(
        Scene((mesh,), looking(0.0, size)), device=device, shader="nolight", near=near, layers=("id",)
    )
    assert (frame["id"] == 3).all()


@pytest.mark.long
def test_an_interrupt_while_tables_are_written_leaves_none_behind(device, monkeypatch):
    scene = clshade.builtin("quads")
    large = scene.camera.with_resolution((200, 200))
    with Renderer(scene, device=device, resolution=(32, 32)) as renderer:
        expected = renderer.render(large).rgba.copy()
        renderer.render()
        tiles, calls = FrameInFlight.tiles.fget, []

        def interrupted(self):
            calls.append(1)
            if len(calls) == 1:
                raise KeyboardInterrupt
            return tiles(self)

        with monkeypatch.context() as patch:
            patch.setattr(FrameInFlight, "tiles", property(interrupted))
            with pytest.raises(KeyboardInterrupt):
                renderer.render(large)
        assert np.array_equal(renderer.render(large).rgba, expected)


def test_buffers_that_were_replaced_are_freed(device):
    scene = cloud(4000, 96)
    with Renderer(scene, device=device, shader="nolight") as renderer:
        renderer.render()
        before = weakref.ref(renderer._drawing.source.made.triangles)
        renderer.render(looking(-0.5, 96))  # pieces need more room
        gc.collect()
        assert before() is None


@pytest.mark.long
def test_other_lanes_than_the_devices_own_sort(device):
    scene = replace(clshade.builtin("quads"), camera=clshade.builtin("quads").camera.with_resolution((32, 32)))
    expected = clshade.render(scene, device=device).rgba
    with Renderer(scene, device=replace(device, lanes=1), lanes=16) as renderer:
        assert renderer.features["SORTED"]
        assert np.array_equal(renderer.render().rgba, expected)
