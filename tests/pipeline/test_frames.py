"""Whole frames: parts of them, other units, nothing to see, clipped surfaces, and who owns their memory."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import oracle_asserts
import pytest
from devices import rendered

from clshade.measure.stability.cases.lit import CAMERA, LIGHTS, MATERIAL, blob
from clshade.pipeline import programs, struct_layout
from clshade.pipeline.frame import Frame, same_bits
from clshade.pipeline.opencl.device import Device
from clshade.pipeline.renderer import Renderer
from clshade.scene.model import Mesh, Scene, Settings
from clshade.scene.settings import PRESETS

LAYERS = ("Z", "id")


def draw(device: Device, scene: Scene, **options: Any) -> Frame:
    """Render one frame with all layers."""
    return rendered(scene, device=device, layers=LAYERS, **options)


def blob_scene(**fields: Any) -> Scene:
    return Scene(**{"meshes": (blob(),), "camera": CAMERA, "lights": LIGHTS, "background": (0.25, 0.5, 2.0), **fields})


def assert_background(frame: Frame) -> None:
    assert (frame.rgb == np.float32([0.25, 0.5, 2.0])).all()
    assert not frame.alpha.any()
    assert not frame["id"].any()
    assert (frame["Z"] == np.inf).all()


@pytest.mark.sampled
@pytest.mark.parametrize("preset", PRESETS)
def test_a_crop_is_that_part_of_the_whole(device, preset):
    """An image with a moved principal point is bit-identical to a part of the larger one."""
    camera = replace(CAMERA, resolution=(64, 64))
    full_frame = draw(device, blob_scene(camera=camera), preset=preset)
    for left, bottom, columns, rows in ((0, 0, 1, 1), (31, 17, 1, 7), (5, 9, 17, 33), (1, 30, 63, 1), (17, 3, 32, 48)):
        part = replace(
            camera,
            resolution=(columns, rows),
            plane=(rows / 64, columns / 64),
            principal=((32 - left) / columns, (32 - bottom) / rows),
        )
        frame = draw(device, blob_scene(camera=part), preset=preset)
        cut = np.s_[64 - bottom - rows : 64 - bottom, left : left + columns]
        for name, channel in frame.channels().items():
            assert np.array_equal(channel, full_frame.channels()[name][cut]), name


@pytest.mark.sampled
@pytest.mark.parametrize("preset", PRESETS)
def test_offset_and_scale(device, preset):
    """The whole scene at +1e6 (its vertices on a grid exact in float64 there) and at scales from 1e-20 to 1e20: the
    oracle's image of that scene; a power of two gives the same bits."""
    mesh = blob()
    grid = replace(mesh, verts=np.round(mesh.verts * 2**20) / 2**20 + 2.0**-26)
    scene = blob_scene(meshes=(grid,))
    plain = draw(device, scene, preset=preset)

    def moved(scale: float, shift: float) -> Frame:
        camera = replace(CAMERA, eye=CAMERA.eye * scale + shift, lookat=CAMERA.lookat * scale + shift)
        lights = tuple(replace(light, position=light.position * scale + shift) for light in LIGHTS)
        changed = replace(grid, verts=grid.verts * scale + shift)
        return draw(device, replace(scene, meshes=(changed,), camera=camera, lights=lights), preset=preset)

    for scale, shift in ((1e-20, 0.0), (1e20, 0.0), (1.0, 1e6)):
        frame = moved(scale, shift)
        oracle_asserts.assert_drawn(frame)
        assert (frame["id"] != plain["id"]).mean() < 0.01
    for exponent in (-70, 90):
        frame = moved(2.0**exponent, 0.0)
        assert np.array_equal(frame.rgba, plain.rgba)
        assert np.array_equal(frame["id"], plain["id"])
        assert np.array_equal(frame["Z"], np.ldexp(plain["Z"], exponent))


# Nothing to see


@pytest.mark.sampled
@pytest.mark.parametrize("preset", ["standard", "course"])
def test_an_empty_scene_is_background(device, preset):
    nothing = Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    unused = Mesh(np.ones((3, 3)), np.zeros((0, 3), int))
    for meshes in ((), (nothing,), (nothing, unused)):
        frame = draw(device, blob_scene(meshes=meshes), preset=preset)
        assert_background(frame)
        assert frame.stats["triangles"] == frame.stats["visible"] == 0


def test_everything_behind_the_eye_is_background(device):
    mesh = blob()
    frame = draw(device, blob_scene(meshes=(replace(mesh, verts=mesh.verts + [0.0, 0, 15]),)))
    assert_background(frame)
    assert frame.stats["behind"] == len(mesh.faces)


def test_triangles_without_area_draw_nothing(device):
    verts = np.array([[0.0, 0, 0], [1, 1, 0], [2, 2, 0], [1e-9, 0, 0]]) * (1 + 2.0**-40)
    faces = np.array([[0, 1, 2], [0, 0, 1], [1, 1, 1], [0, 3, 0]])
    mesh = Mesh(verts, faces, colors=np.full((4, 3), 0.5), material=MATERIAL)
    assert_background(draw(device, blob_scene(meshes=(mesh,))))


# Clipping


@pytest.mark.long
@pytest.mark.parametrize("orthographic", [False, True])
def test_clipped_surfaces_that_float32_hardly_tells_apart(device, orthographic):
    """Two floors through the near plane, or two walls beyond the guard band, that intersect at an angle of 2^-25: the
    nearer one differs below the last bit of float32."""
    camera = replace(CAMERA, eye=(0.0, 0.0, 5.0), lookat=(0.0, 0.0, 0.0)) if orthographic else CAMERA
    camera = replace(camera, orthographic=orthographic)
    far, tilt = 900.0, 2.0**-25
    floor = np.array([[-far, -1.0, 90.0], [far, -1.0, 90.0], [0.0, -1.0, -far]])
    wall = 1e5 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    first = wall if orthographic else floor
    second = first.copy()
    second[:, 2 if orthographic else 1] += tilt * first[:, 0]
    meshes = tuple(Mesh(verts, [[0, 1, 2]], material=MATERIAL) for verts in (first, second))
    frame = draw(device, blob_scene(meshes=meshes, camera=camera), preset="standard", near=0.5)
    assert frame.stats["clipped"] == 2
    assert {1, 2} <= set(np.unique(frame["id"]))
    oracle_asserts.assert_drawn(frame)


@pytest.mark.long
@pytest.mark.parametrize("size", [8, 32])
def test_the_tile_size_changes_no_bit(device, monkeypatch, size):
    """This also shows that no kernel hard-codes the host's number."""
    plain = draw(device, blob_scene())
    monkeypatch.setattr(struct_layout, "TILE_SIZE", size)
    monkeypatch.setitem(struct_layout.CONSTANTS, "TILE_SIZE", size)
    monkeypatch.setattr(programs, "_built", {})
    frame = draw(device, blob_scene())
    assert len(programs._built) == 2  # the geometry program and the pixel program
    assert same_bits(frame, plain)


def test_frames_own_their_memory(device):
    with Renderer(blob_scene(), device=device, layers=LAYERS) as renderer:
        first = renderer.render()
        kept = {name: array.copy() for name, array in first.channels().items()}
        later_frames = [renderer.render(replace(CAMERA, eye=CAMERA.eye + [0.1 * k, 0, 0])) for k in range(8)]
        assert len({frame.rgba.ctypes.data for frame in (first, *later_frames)}) == 9
    # Frames outlive the renderer.
    assert all(np.array_equal(first.channels()[name], kept[name]) for name in kept)
    assert same_bits(later_frames[0], first)


def test_stats_say_what_was_done(device):
    frame = draw(device, blob_scene())
    stats = frame.stats
    assert stats["triangles"] == 250
    assert 0 < stats["visible"] <= 250
    assert stats["resolution"] == (61, 61)
    assert set(stats["features"]).isdisjoint(stats["left_out"])
    assert all(time >= 0.0 for time in stats["times_ms"].values())
    assert {"project", "setup", "sort", "bin_scan", "bin_fill", "phong", "frame"} <= set(stats["times_ms"])
    assert frame.settings == Settings(layers=LAYERS)
