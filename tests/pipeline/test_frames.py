"""Whole frames: other units, nothing to see, clipped surfaces, precision, many triangles, and who owns their memory."""

from dataclasses import replace
from typing import Any

import numpy as np
import oracle_asserts
import pytest
from devices import needs_float64, rendered, skip_unsupported

import clshade
from clshade import oracle
from clshade.errors import DeviceError
from clshade.measure.check import oracle_bounds
from clshade.measure.stability.cases.lit import CAMERA, LIGHTS, MATERIAL, blob, scene_of
from clshade.pipeline import programs, struct_layout
from clshade.pipeline.frame import Frame, same_bits
from clshade.pipeline.opencl.device import Device
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scene, Settings, Texture

LAYERS = ("Z", "id")


def draw(device: Device, scene: Scene, **options: Any) -> Frame:
    skip_unsupported(device, options)
    return rendered(scene, device=device, layers=LAYERS, **options)


def blob_scene(**fields: Any) -> Scene:
    return Scene(**{"meshes": (blob(),), "camera": CAMERA, "lights": LIGHTS, "background": (0.25, 0.5, 2.0), **fields})


@pytest.mark.sampled
@pytest.mark.parametrize("preset", ["standard", "course"])
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
        frame["Z"][:] = np.ldexp(frame["Z"], -exponent)
        assert same_bits(frame, plain)


NO_FACES = np.zeros((0, 3), int)
ALONG_A_LINE = np.array([[0.0, 0, 0], [1, 1, 0], [2, 2, 0], [1e-9, 0, 0]]) * (1 + 2.0**-40)
NOTHING = {
    "no mesh": (),
    "no faces": (Mesh(np.zeros((0, 3)), NO_FACES), Mesh(np.ones((3, 3)), NO_FACES)),
    "behind the eye": (replace(blob(), verts=blob().verts + [0.0, 0, 15]),),
    "no area": (Mesh(ALONG_A_LINE, np.array([[0, 1, 2], [0, 0, 1], [1, 1, 1], [0, 3, 0]])),),
}


@pytest.mark.parametrize("meshes", NOTHING.values(), ids=NOTHING)
def test_where_nothing_is_seen_is_background(device, meshes):
    frame = draw(device, blob_scene(meshes=meshes))
    assert (frame.rgb == np.float32([0.25, 0.5, 2.0])).all()
    assert not frame.alpha.any()
    assert not frame["id"].any()
    assert (frame["Z"] == np.inf).all()


# Clipping


@pytest.mark.long
@pytest.mark.parametrize("orthographic", [False, True])
def test_clipped_surfaces_that_float32_hardly_tells_apart(device, orthographic):
    """Two floors through the near plane, or two walls beyond the guard band, that intersect at an angle of 2^-25: the
    nearer one differs below the last bit of float32."""
    camera = replace(CAMERA, eye=(0.0, 0.0, 5.0), lookat=(0.0, 0.0, 0.0), orthographic=True) if orthographic else CAMERA
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


# More than 2^24 triangles

BEFORE = 1 << 24  # faces without area before the others


def soup(before: int) -> Scene:
    """Return 600 triangles, a third of them twice in one plane, some across the near plane, after others without area."""
    rng = np.random.default_rng(1)
    corners = rng.uniform(-1.0, 1.0, (400, 1, 3)) + rng.uniform(-0.5, 0.5, (400, 3, 3))
    corners[::20, 0, 2] += 4.0
    verts, triangles = corners.reshape(-1, 3).astype(np.float32), np.arange(1200, dtype=np.int32).reshape(-1, 3)
    faces = np.concatenate([np.zeros((before, 3), np.int32), triangles, triangles[:200, [1, 2, 0]]])
    mesh = Mesh(verts, faces, normals=rng.normal(size=verts.shape), colors=rng.random(verts.shape), material=MATERIAL)
    camera = Camera.from_fov((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 60.0, (96, 64))
    return Scene((mesh,), camera, LIGHTS)


@pytest.mark.long
@pytest.mark.parametrize(
    "options",
    [{}, {"visibility": "painter", "interpolation": "affine"}, {"shader": "gouraud", "shadows": True}],
    ids=str,
)
def test_the_image_of_many_triangles_is_that_of_the_faces_that_show(device, options):
    if device.memory < 4 << 30:
        pytest.skip("needs a device with 4 GiB")
    few, many = (draw(device, soup(before), near=0.1, **options) for before in (0, BEFORE))
    assert few.stats["clipped"] > 10
    assert many.stats["triangles"] == BEFORE + few.stats["triangles"]
    assert many.stats["visible"] == few.stats["visible"]
    assert len(np.unique(few["id"])) > 100
    few["id"][few["id"] > 0] += np.uint32(BEFORE)
    assert same_bits(few, many)


# Precision


@pytest.mark.sampled
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_of_two_quads_in_one_plane_the_later_is_seen(device, precision):
    """Cut along different diagonals, so that the depths of a pixel differ only by rounding: corners lie on the grid, to
    which they would be moved each by itself."""
    corners = np.array([[-1.0, -1.0, 0.3], [1.0, -1.0, -0.2], [1.0, 1.0, -0.3], [-1.0, 1.0, 0.2]])
    meshes = [Mesh(corners, faces) for faces in ([[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]])]
    camera = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (3.75, 5.0), (160, 120), orthographic=True)
    scene = Scene(tuple(meshes), camera, LIGHTS)
    for samples in (1, 4):
        frame = draw(device, scene, precision=precision, samples=samples)
        assert frame.alpha.any()
        assert set(np.unique(frame["id"])) <= {0, 3, 4}


SHINY = replace(blob(), material=replace(MATERIAL, n=20.0))
LIT = Scene((SHINY,), CAMERA.with_resolution((97, 71)), LIGHTS)


def test_float64_does_not_pass_for_float32(device):
    """float32 exceeds the bound of float64."""
    frame = draw(device, LIT)
    expected = oracle.render(LIT, frame.settings)
    with pytest.raises(AssertionError, match="colors off by more than 1 bounds"):
        oracle_asserts.assert_colors_within(frame.rgb, expected, 1.0, precision="float64")


@pytest.mark.long
def test_large_texture_coordinates_in_float64(device):
    """Found by the fuzzer: coordinates of some thousands hold fewer digits of a texel, which float64's bound includes;
    double-single, with 48 bits, still exceeds it."""
    needs_float64(device)
    image = np.random.default_rng(6).uniform(0, 1, (33, 33, 3)).astype(np.float32)
    uvs = np.random.default_rng(7).uniform(-2e4, 2e4, (120, 2))
    scene = scene_of(blob(40, 2, uvs=uvs, material=Material(texture=Texture(image))))
    frame, single = (draw(device, scene, shader="nolight", precision=name) for name in ("float64", "float32"))
    expected, allowed = oracle.render(scene, frame.settings), oracle_bounds.allowed(scene, frame.settings)
    assert 1e-10 < allowed * 1e-12 < 1e-8
    assert 1.0 < oracle_asserts.assert_frame(frame, expected, scene, frame.settings).bounds < allowed / 3.0
    off = np.abs(single.rgb - expected.rgb).max(axis=-1)[single["id"] == frame["id"]]
    assert off.max() > 10.0 * allowed * 1e-12


def test_a_device_without_float64_refuses_it(device):
    scene = Scene((Mesh(np.eye(3), [[0, 1, 2]]),), CAMERA)
    with pytest.raises(DeviceError, match="precision float64"):
        clshade.render(scene, device=replace(device, has_fp64=False), precision="float64")


def test_fast_is_another_name_of_float32(device):
    frame, expected = draw(device, LIT, precision="fast"), draw(device, LIT)
    assert same_bits(frame, expected)
    assert frame.settings == expected.settings
    assert frame.settings.precision == "float32"
