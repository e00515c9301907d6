"""Cameras that show all of a scene: what they see, measured by projecting every vertex."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mesh_writers import triangle
from scene_files import ends_in_image

import clshade
from clshade import Camera, Mesh, Scene
from clshade.errors import InputError
from clshade.farm import orbit, parse_frames
from clshade.scene.adjust_camera import adjusted, camera_of, refitted
from clshade.scene.framing import FILL, default_camera, fitted
from clshade.scene.geometry import camera_axes
from clshade.scene.ground import with_ground

VERTS = np.random.default_rng(5).normal(size=(60, 3)) * (3.0, 1.0, 0.5) + (7.0, -2.0, 4.0)
FACES = np.arange(60).reshape(20, 3)
MESH = Mesh(VERTS, FACES)
SKEW = Camera.from_fov((3, 5, 9), (1, 0, 2), (0.2, 1, 0.1), 50.0)


def seen(camera, meshes=(MESH,)):
    return ends_in_image(camera, meshes)


@pytest.mark.parametrize("resolution", [(800, 600), (100, 700), (700, 100), (1, 1)])
@pytest.mark.parametrize("orthographic", [False, True])
def test_the_vertices_fill_the_image_and_are_centered(resolution, orthographic):
    for camera in (SKEW.with_resolution(resolution), default_camera((MESH,), "z", resolution)):
        view = adjusted(camera, fit=(MESH,), orthographic=orthographic)
        low, high = seen(view)
        assert high.max() == pytest.approx(FILL, rel=1e-9)
        assert low == pytest.approx(-high, abs=0.01)
        assert np.allclose(camera_axes(camera), camera_axes(view), atol=1e-12)
        assert view.orthographic is orthographic


def test_every_instance_counts_and_no_vertex_without_a_face():
    placements = np.stack([np.eye(4)] * 3)
    placements[1, :3, 3], placements[2, :3, :3] = (20.0, 5.0, -3.0), np.diag((-1.0, 2.0, 0.1))
    stray = Mesh(np.vstack([VERTS, [[9.0, 9.0, -9.0]]]), FACES, instances=placements)
    meshes = (stray, Mesh(VERTS - 30.0, FACES))
    low, high = seen(fitted(SKEW, meshes), meshes)
    assert (high.max(), *low) == pytest.approx((FILL, *-high), abs=0.01)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("resolution", [(80, 60), (60, 80)])
def test_a_turntable_cuts_nothing_and_wastes_nothing(orthographic, resolution):
    camera = adjusted(SKEW.with_resolution(resolution), fit=(MESH,), turning=True, orthographic=orthographic)
    assert camera.lookat == pytest.approx((VERTS.min(axis=0) + VERTS.max(axis=0)) / 2.0)
    turn = parse_frames("1..360")
    ends = [np.abs(seen(view)).max() for view in orbit(camera, turn.numbers, turn).values()]
    assert FILL * 0.999 < max(ends) <= FILL * (1.0 + 1e-9)


@pytest.mark.parametrize("scale", [1e-300, 1e-30, 1e30, 1e150, 1e300])
def test_any_scale(scale):
    view = fitted(SKEW, (Mesh((VERTS - VERTS.mean(axis=0)) * scale, FACES),))
    one = fitted(SKEW, (Mesh(VERTS - VERTS.mean(axis=0), FACES),))
    assert view.eye / scale == pytest.approx(one.eye, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    "verts",
    [
        [(5, 5, 5)] * 3,
        [(0, 0, 0)] * 3,
        [(1e9, 0, 0)] * 3,
        [(0, 0, 0), (1, 0, 0), (2, 0, 0)],
        SKEW.eye + np.outer((0.0, 1.0, 50.0), SKEW.lookat - SKEW.eye),  # a needle that points at the eye
        [(0, 0, 0), (1, 0, 0), (0, 1, 0)],
    ],
)
def test_points_lines_and_triangles(verts):
    for options in ({}, {"turning": True}, {"orthographic": True}, {"orthographic": True, "turning": True}):
        mesh = Mesh(np.array(verts, float), [(0, 1, 2)])
        view = adjusted(SKEW, fit=(mesh,), **options)
        assert np.abs(seen(view, (mesh,))).max() < FILL * (1.0 + 1e-6)


def test_what_overflows_is_refused_and_a_scene_without_extent_is_not():
    with pytest.raises(InputError, match="Camera: eye"):
        fitted(adjusted(SKEW, view_angle=1.0), (Mesh([(1e308, 0, 0), (-1e308, 0, 0), (0, 1e308, 0)], [(0, 1, 2)]),))
    large = np.diag((10.0, 10.0, 10.0, 1.0))
    with pytest.raises(InputError, match="overflow"):
        fitted(SKEW, (Mesh([(1e308, 0, 0), (0, 0, 0), (0, 1, 0)], [(0, 1, 2)], instances=[large]),))
    assert np.isfinite(fitted(SKEW, ()).eye).all()
    for meshes in ((), Mesh(np.zeros((1, 3)), np.zeros((0, 3), int)), Mesh(np.ones((3, 3)), [[0, 1, 2]])):
        assert np.isfinite(Scene(meshes).camera.eye).all()


def test_a_fitted_camera_is_fitted_again_unless_it_is_placed():
    scene = refitted(Scene((MESH,), SKEW))
    assert scene.fitted
    assert not Scene((MESH,), SKEW).fitted
    turned = camera_of(scene, {"azimuth": 70.0})
    assert seen(turned)[1].max() == pytest.approx(FILL, rel=1e-9)
    assert camera_of(scene, {"azimuth": 0.0, "position": None}).eye.tolist() == scene.camera.eye.tolist()
    zoomed = camera_of(scene, {"view_angle": 10.0})
    assert zoomed.eye.tolist() == scene.camera.eye.tolist()
    assert seen(camera_of(scene, {"view_angle": 10.0}, fit=True))[1].max() == pytest.approx(FILL, rel=1e-9)
    both = {"position": (0.0, 0.0, 50.0), "focal_point": (1.0, 2.0, 3.0)}
    assert camera_of(scene, both, fit=True).eye.tolist() == [0.0, 0.0, 50.0]
    fixed = replace(scene, fitted=False)
    assert camera_of(fixed, {"azimuth": 70.0}).eye == pytest.approx(adjusted(fixed.camera, azimuth=70.0).eye)
    scene = refitted(Scene((MESH,), replace(SKEW, up=(0.1, -0.2, -1.0))), (70, 50))  # what was up stays up
    assert (scene.camera.up.tolist(), scene.camera.resolution) == ([0.0, 0.0, -1.0], (70, 50))
    assert refitted(with_ground(scene)).camera.eye.tolist() == scene.camera.eye.tolist()


def test_fit_ignores_the_camera_of_a_file(tmp_path):
    document = triangle()
    document.add("nodes", {"mesh": 0})
    document.add("nodes", {"camera": 0, "translation": [50, 2, 9]})
    document.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.1}})
    path = document.glb(tmp_path / "a.glb")
    assert not clshade.load(path).fitted
    scene = clshade.load(path, fit=True)
    assert scene.fitted
    assert seen(scene.camera, scene.meshes)[1].max() == pytest.approx(FILL, rel=1e-6)


def same_camera(one, second):
    fields = [[getattr(camera, name) for name in vars(camera)] for camera in (one, second)]
    return all(map(np.array_equal, *fields))


def test_scenes_without_a_camera_get_the_one_of_files():
    teapot = clshade.builtin("teapot").meshes
    scene = Scene(teapot)
    assert scene.fitted
    assert same_camera(scene.camera, default_camera(teapot))
    assert Scene(teapot, scene.camera).fitted is False
    assert same_camera(Scene(teapot, None).camera, scene.camera)
    assert replace(scene, name="a").fitted
