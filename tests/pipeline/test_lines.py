"""Lines along edges in whole frames: their width, what hides them, and every sample against the oracle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from devices import needs_float64
from line_scenes import cube, floor, scene_of

import clshade
from clshade.pipeline.frame import same_bits
from clshade.pipeline.renderer import Renderer, render
from clshade.scene.camera import Camera
from clshade.scene.model import Mesh
from clshade.scene.settings import Edges

ONLY = Edges("all", only=True)


@pytest.fixture(autouse=True)
def _device_with_float64(request):
    if "device" in request.fixturenames:
        needs_float64(request.getfixturevalue("device"))


def passes(frame) -> bool:
    report = clshade.check(frame, "all")
    return report.passed and report.complete


def flat_scene(verts, faces, resolution=(32, 32)):
    """Return a scene in pixels: (x, y) of a vertex is its place in the image, z its depth."""
    columns, rows = resolution
    camera = Camera(
        np.zeros(3), np.array([0.0, 0, 1]), np.array([0.0, 1, 0]), 1.0, (rows, columns), resolution, (0, 0), True
    )
    return replace(scene_of(Mesh(np.array(verts, float) * [-1, 1, 1], np.array(faces))), camera=camera)


@pytest.mark.long
def test_lines_have_their_width(device):
    """Lines 3 px wide along pixel borders cover three rows or columns; the rule is closed, so centers at 1.5 count."""
    scene = flat_scene([[8.5, 8.5, 5], [24.5, 8.5, 5], [24.5, 24.5, 5], [8.5, 24.5, 5]], [[0, 1, 2], [0, 2, 3]])
    coverage = render(scene, device=device, edges=Edges("boundary", width=3, only=True)).alpha[::-1] > 0
    rows, columns = np.mgrid[0:32, 0:32]
    inner = np.maximum(abs(rows - 16), abs(columns - 16))
    expected = (inner >= 7) & (inner <= 9)
    corner = (abs(rows - 16) > 8) & (abs(columns - 16) > 8)  # the joins are round: 1 px off both ways is within 1.5
    assert np.array_equal(coverage, expected | (corner & (inner <= 9)))


def test_frames_are_the_oracles(device):
    scene = scene_of(cube(), floor())
    assert passes(render(scene, device=device, edges="all", layers=("Z", "id")))
    assert passes(
        render(scene, device=device, edges=Edges(("feature", "silhouette"), width=2.6, color=(1, 0.5, 0)), samples=5)
    )
    assert passes(render(scene, device=device, edges=ONLY, preset="course"))


def test_a_fin_is_drawn_in_its_own_color(device):
    fin = Mesh(np.array([[0.0, 1, 1], [1, 1, 1], [0.5, 1.6, 1.2]]), np.array([[0, 1, 2]]))
    frame = render(scene_of(cube(), fin), device=device, edges="nonmanifold", samples=4)
    assert passes(frame)
    assert (frame.rgb == [1, 0, 0]).all(axis=-1).sum() > 5


@pytest.mark.long
def test_edges_in_a_surface_are_not_stippled(device):
    """A cube stands on a floor: its bottom edges lie in the plane of the floor's triangles, at the same depth but for the
    snapping of all corners."""
    scene = scene_of(cube(), floor(), resolution=(240, 180))
    lines = render(scene, device=device, edges=Edges("feature", only=True)).alpha > 0
    alone = render(scene_of(cube(), resolution=(240, 180)), device=device, edges=Edges("feature", only=True)).alpha > 0
    assert np.array_equal(lines, alone)
    assert lines.sum() > 400


def test_nothing_shows_through(device):
    """Behind a wall no line shows, although the mesh behind is finer than pixels and the wall is of slivers."""
    steps = np.linspace(-3, 4, 200)
    verts = np.array([[x, y, 2.0] for x in steps for y in (-3.0, 4.0)])
    faces = np.array([[2 * i + a, 2 * i + b, 2 * i + c] for i in range(199) for a, b, c in ((0, 2, 1), (1, 2, 3))])
    scene = scene_of(cube(), Mesh(verts, faces), eye=(0.5, 0.5, 6.0))
    assert not render(scene, device=device, edges=Edges("feature", only=True)).alpha.any()


@pytest.mark.long
def test_layers_and_other_pixels_stay_as_they_are(device):
    scene = scene_of(cube(), floor())
    plain = render(scene, device=device, layers=("Z", "id"))
    lined = render(scene, device=device, layers=("Z", "id"), edges=Edges("all", color=(9, 0, 0)))
    for name in ("Z", "id"):
        assert np.array_equal(plain[name], lined[name])
    line = (lined.rgb == [9, 0, 0]).all(axis=-1)
    assert 100 < line.sum() < line.size / 2
    assert np.array_equal(plain.rgba[~line], lined.rgba[~line])


@pytest.mark.long
def test_near_plane_and_edges_behind(device):
    """The eye stands within the floor's extent, above it: its edges cross the near plane."""
    scene = scene_of(cube(), floor(-0.2), eye=(1.8, 0.9, 2.2))
    assert passes(render(scene, device=device, edges=Edges("all", width=3.3)))
    behind = scene_of(cube(), eye=(3.0, 3.0, 3.0), lookat=(9.0, 9.0, 9.0))
    assert not render(behind, device=device, edges=ONLY).alpha.any()


@pytest.mark.parametrize("resolution", [(1, 1), (17, 33)])
@pytest.mark.parametrize("width", [0.1, 40])
def test_sizes_and_widths(device, resolution, width):
    scene = scene_of(cube(), resolution=resolution)
    assert passes(render(scene, device=device, edges=Edges("all", width=width), layers=("Z", "id")))


def test_a_scene_without_faces(device):
    scene = scene_of(Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)))
    assert not render(scene, device=device, edges=ONLY).alpha.any()


@pytest.mark.long
@pytest.mark.parametrize("samples", [1, 5])
def test_the_bits_do_not_depend_on_lanes(device, samples):
    scene = scene_of(cube(), floor())
    frames = []
    for lanes in (None, 4):
        with Renderer(scene, device=device, lanes=lanes, edges="all", samples=samples, layers=("id",)) as renderer:
            frames += [renderer.render(), renderer.render()]
    assert all(same_bits(frames[0], frame) for frame in frames[1:])


def test_far_away_and_end_on(device):
    """Edges seen end-on, exactly and nearly, in coordinates of 1e7."""
    shift = np.array([1e7, -2e7, 3e7])
    mesh = replace(cube(), verts=cube().verts + shift)
    for eye in ([0.5, 0.5, 6.0], [1.0, 1.0, 6.0], [1.0, 1.00001, 4.0]):
        scene = scene_of(mesh, eye=np.array(eye) + shift, lookat=np.array([*eye[:2], 0.0]) + shift)
        assert passes(render(scene, device=device, edges="all", layers=("Z", "id")))


@pytest.mark.long
def test_culled_faces_neither_hide_nor_have_lines(device):
    scene = scene_of(floor(), eye=(0.5, -3.0, 4.0))
    assert not render(scene, device=device, edges=ONLY, cull=True).alpha.any()
    assert render(scene, device=device, edges=ONLY).alpha.any()


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "options"),
    [
        *((name, {}) for name in ("box_room", "quads", "icosphere", "teapot")),
        *((name, {"samples": 4, "visibility": "painter"}) for name in ("box_room", "teapot")),
        *((name, {"precision": "float64"}) for name in ("quads", "icosphere")),
    ],
    ids=str,
)
def test_built_in_scenes(device, name, options):
    frame = render(clshade.builtin(name), device=device, resolution=(50, 37), edges="all", **options)
    assert passes(frame)
