"""Whole frames: against the oracle, bit by bit against each other, and at the limits of scenes."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import oracle_asserts
import pytest
from checked_scenes import CHECKED
from devices import rendered

from clshade import oracle
from clshade.measure.stability.cases.lit import CAMERA, LIGHTS, MATERIAL, blob
from clshade.pipeline import programs, struct_layout
from clshade.pipeline.features import OPTIONAL
from clshade.pipeline.frame import Frame, same_bits
from clshade.pipeline.opencl.device import Device
from clshade.pipeline.renderer import Renderer
from clshade.scene.builtin import scenes
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, PointLight, Scene, Settings, Texture
from clshade.scene.settings import PRESETS, SHADERS

LAYERS = ("Z", "id")
SCENES = {
    "course": lambda: scenes.course(4, (96, 80)),
    "teapot": lambda: scenes.teapot(4, (120, 90)),
    "box_room": lambda: scenes.box_room(3, (101, 67)),  # the eye is inside: the near plane clips the walls
    "quads": lambda: scenes.quads(20, 3, (83, 47)),
}


@cache
def scene_of(name: str) -> Scene:
    return SCENES[name]()


def draw(device: Device, scene: Scene, **options: Any) -> Frame:
    """Render one frame with all layers."""
    return rendered(scene, device=device, layers=LAYERS, **options)


# Against the oracle


# Every built-in scene with every preset and shader, except those of tests/measure/test_checking.py, which compares them with
# the oracle too; preset pbr is standard with its own shader and shadows.
COMBINATIONS = [case for case in itertools.product(SCENES, PRESETS, SHADERS) if case not in CHECKED]


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("name", "preset", "shader"), [case for case in COMBINATIONS if (case[1] == "pbr") == (case[2] == "pbr")]
)
def test_built_in_scenes_equal_the_oracle(device, name, preset, shader):
    """Measured: at most 3 of the 32 bounds allowed (clshade/measure/README.md, "Bounds, and where they come from")."""
    frame = draw(device, scene_of(name), preset=preset, shader=shader)
    assert (frame["id"] > 0).mean() > 0.15
    assert oracle_asserts.assert_drawn(frame).bounds < 16.0
    if name == "box_room":
        assert frame.stats["clipped"] > 0


def test_the_comparison_notices_another_scene(device):
    """Planted: a light moved slightly, a vertex color changed, a triangle's winding reversed."""
    scene = scene_of("course")
    frame = draw(device, scene, shader="phong")
    mesh, light = scene.meshes[0], scene.lights[0]
    moved = replace(scene, lights=(replace(light, position=light.position + 1e-3), *scene.lights[1:]))
    nudged = mesh.verts.copy()
    nudged[:, 1] += 0.01
    lifted = replace(scene, meshes=(replace(mesh, verts=nudged),))
    for wrong, message in ((moved, "colors off"), (lifted, "ids differ")):
        expected = oracle.render(wrong, frame.settings)
        with pytest.raises(AssertionError, match=message):
            oracle_asserts.assert_frame(frame, expected, wrong, frame.settings)


# Another scene: the following tests share few feature masks


COURSE_LONG = ("standard", pytest.param("course", marks=pytest.mark.long))


def blob_scene(**fields: Any) -> Scene:
    return Scene(**{"meshes": (blob(),), "camera": CAMERA, "lights": LIGHTS, "background": (0.25, 0.5, 2.0), **fields})


def flat(*corners: tuple[float, float, float]) -> Mesh:
    """Return one triangle with the feature mask of `blob`."""
    colors = np.array([[1.0, 0.5, 0.2], [0.1, 0.9, 0.3], [0.2, 0.3, 0.7]])
    return Mesh(np.array(corners) * (1 + 2.0**-40), np.array([[0, 1, 2]]), colors=colors, material=MATERIAL)


def assert_background(frame: Frame) -> None:
    assert (frame.rgb == np.float32([0.25, 0.5, 2.0])).all()
    assert not frame.alpha.any()
    assert not frame["id"].any()
    assert (frame["Z"] == np.inf).all()


@pytest.mark.long
@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("resolution", [(61, 61), (1, 1), (1, 7), (17, 33), (333, 1), (16384, 2)])
def test_odd_sizes(device, preset, resolution):
    height, width = 1.0, 1.0
    camera = replace(CAMERA, resolution=resolution, plane=(height, width))
    frame = draw(device, blob_scene(camera=camera), preset=preset)
    assert frame.rgba.shape == (*resolution[::-1], 4)
    oracle_asserts.assert_drawn(frame)


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
        assert np.array_equal(frame["id"], full_frame["id"][cut])
        assert np.array_equal(frame.rgba, full_frame.rgba[cut])
        assert np.array_equal(frame["Z"], full_frame["Z"][cut])


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


@pytest.mark.parametrize("preset", COURSE_LONG)
def test_an_empty_scene_is_background(device, preset):
    nothing = Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    unused = Mesh(np.ones((3, 3)), np.zeros((0, 3), int))
    for meshes in ((), (nothing,), (nothing, unused)):
        frame = draw(device, blob_scene(meshes=meshes), preset=preset)
        assert_background(frame)
        assert frame.stats["triangles"] == frame.stats["visible"] == 0


@pytest.mark.parametrize("preset", PRESETS)
def test_everything_behind_the_eye_is_background(device, preset):
    mesh = blob()
    frame = draw(device, blob_scene(meshes=(replace(mesh, verts=mesh.verts + [0.0, 0, 15]),)), preset=preset)
    assert_background(frame)
    assert frame.stats["behind"] == len(mesh.faces)


def test_triangles_without_area_draw_nothing(device):
    verts = np.array([[0.0, 0, 0], [1, 1, 0], [2, 2, 0], [1e-9, 0, 0]]) * (1 + 2.0**-40)
    faces = np.array([[0, 1, 2], [0, 0, 1], [1, 1, 1], [0, 3, 0]])
    mesh = Mesh(verts, faces, colors=np.full((4, 3), 0.5), material=MATERIAL)
    assert_background(draw(device, blob_scene(meshes=(mesh,))))


# Clipping


@pytest.mark.parametrize("preset", PRESETS)
def test_a_floor_to_the_horizon(device, preset):
    floor = flat((-900.0, -1.0, 90.0), (900.0, -1.0, 90.0), (0.0, -1.0, -900.0))
    frame = draw(device, blob_scene(meshes=(floor,)), preset=preset, near=0.5)
    assert frame.stats["clipped"] == 1
    assert 0.3 < frame.alpha.mean() < 0.7
    oracle_asserts.assert_drawn(frame)


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


# Light and background


@pytest.mark.long
@pytest.mark.parametrize("preset", COURSE_LONG)
def test_without_lights_and_background(device, preset):
    """Only ambient light is left; in the background rgb and alpha are 0. A black light counts as none."""
    for lights in ((), (PointLight((1.0, 2, 3), (0.0, 0, 0)),)):
        frame = draw(device, blob_scene(lights=lights, ambient=0.5, background=None), preset=preset)
        oracle_asserts.assert_drawn(frame)
        assert {"DIFFUSE", "SPECULAR"} <= set(frame.stats["left_out"])
        assert not frame.rgba[frame["id"] == 0].any()
        assert (frame["id"] == 0).any()


CAMERAS = {
    "perspective": CAMERA,
    "orthographic": replace(CAMERA, orthographic=True, plane=(4.0, 5.0), principal=(0.4, 0.55)),
}


@pytest.mark.long
@pytest.mark.parametrize(
    ("camera", "shader"), [("orthographic", "phong"), ("perspective", "phong"), ("perspective", "gouraud")]
)
def test_sides_alpha_and_light_on_both_sides(device, camera, shader):
    """Cards around the origin seen from both sides: culled, lit from behind, cut out by their texture's alpha,
    mirrored; in orthographic projection, off center."""
    image = np.random.default_rng(8).uniform(0, 1, (5, 4, 4)).astype(np.float32)
    uvs = np.tile([[0.0, 0.0], [1.5, 0.1], [0.2, 1.3]], (250, 1))
    materials = (
        Material(sides="front", color=(0.5, 1.0, 0.7)),
        Material(two_sided=True, texture=Texture(image, ("mirror", "clamp")), alpha_cutoff=0.5),
        Material(n=200.0),
    )
    mirrored = np.diag([-1.0, 1.0, 1.0, 1.0])[None]
    meshes = [blob(250, seed, uvs=uvs, material=material) for seed, material in enumerate(materials)]
    meshes[2] = replace(meshes[2], instances=mirrored)
    scene = blob_scene(meshes=meshes, camera=CAMERAS[camera])
    frame = draw(device, scene, shader=shader)
    assert {"SIDES", "TWO_SIDED", "ALPHA_TEST"} <= set(frame.stats["features"])
    oracle_asserts.assert_drawn(frame)
    opaque = [replace(mesh, material=replace(mesh.material, alpha_cutoff=None)) for mesh in meshes]
    seen = oracle.render(replace(scene, meshes=opaque), frame.settings)
    assert (seen.id != frame["id"]).mean() > 0.01


# Bit by bit


@pytest.mark.parametrize(
    ("name", "options"),
    [
        pytest.param("course", {"shader": "gouraud"}, marks=pytest.mark.long),
        pytest.param("box_room", {"shader": "gouraud"}, marks=pytest.mark.long),
        pytest.param("quads", {"preset": "course", "shader": "phong"}, marks=pytest.mark.long),
        pytest.param("course", {"preset": "standard", "samples": 4}, marks=pytest.mark.long),
        ("teapot", {"preset": "standard", "shader": "gouraud", "cull": True}),
        ("teapot", {"preset": "standard", "cull": True, "edges": "all"}),
    ],
)
def test_leaving_out_changes_no_bit(device, name, options):
    lean = draw(device, scene_of(name), **options)
    full = draw(device, scene_of(name), forced=OPTIONAL, **options)
    assert set(full.stats["left_out"]) < set(lean.stats["left_out"])
    assert same_bits(lean, full)


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


def cameras() -> list[Camera]:
    """Return views from elsewhere, closer (with clipping), and with another resolution."""
    eyes = ((-2.0, 1.0, 4.0), (0.3, 0.1, 0.8), (0.0, 9.0, 0.1))
    views = [replace(CAMERA, eye=np.array(eye)) for eye in eyes]
    return [*views, views[0].with_resolution((40, 23)), CAMERA]


@pytest.mark.parametrize("preset", PRESETS)
def test_a_moved_camera_equals_a_fresh_render(device, preset):
    with Renderer(blob_scene(), device=device, preset=preset, layers=LAYERS) as renderer:
        for camera in cameras():
            frame = renderer.render(camera=camera)
            assert frame.scene.camera is camera
            assert same_bits(frame, draw(device, blob_scene(camera=camera), preset=preset))


# Memory


def address(frame: Frame) -> int:
    return frame.rgba.__array_interface__["data"][0]


def test_frames_own_their_memory(device):
    with Renderer(blob_scene(), device=device, layers=LAYERS) as renderer:
        first = renderer.render()
        kept = {name: array.copy() for name, array in first.channels().items()}
        later_frames = [renderer.render(camera=camera) for camera in cameras() * 2]
        assert all(np.array_equal(first.channels()[name], kept[name]) for name in kept)
        assert len({address(frame) for frame in (first, *later_frames)}) == 1 + len(later_frames)
    # Frames outlive the renderer.
    assert all(np.array_equal(first.channels()[name], kept[name]) for name in kept)
    assert same_bits(later_frames[4], first)


def test_memory_is_recycled_once_no_view_is_held(device):
    with Renderer(blob_scene(), device=device, layers=LAYERS) as renderer:
        frame = renderer.render()
        place, depth_place = address(frame), frame["Z"].__array_interface__["data"][0]
        del frame
        frame = renderer.render()
        assert address(frame) == place
        assert frame["Z"].__array_interface__["data"][0] == depth_place
        view, content = frame.rgb[::2, 1:], frame.rgb[::2, 1:].copy()
        del frame
        second = renderer.render(camera=cameras()[0])
        assert address(second) != place
        assert np.array_equal(view, content)
        del view, second
        places = {address(renderer.render()) for _ in range(10)}
        assert len(places) <= 2


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
