"""The ground: where it lies, what it looks like at its edge, and that nothing fits a camera to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from command_line import run, scene_of

import clshade
from clshade import Settings, oracle
from clshade.errors import InputError
from clshade.pipeline.effective_settings import effective_settings
from clshade.scene.adjust_camera import camera_of, named_cameras, seen_by
from clshade.scene.framing import UPS, framed
from clshade.scene.ground import GRAY, objects_of, with_ground

SOLID = clshade.builtin("icosphere", level=1)
SCENE = framed(SOLID.meshes, "solid", (60, 40))


@pytest.mark.parametrize("up", UPS)
def test_it_lies_below_the_lowest_point_and_faces_up(up):
    scene = with_ground(SCENE, up)
    ground = scene.meshes[-1]
    upward = np.array(UPS[up][1], float)
    heights, lowest = ground.verts @ upward, (SCENE.meshes[0].verts @ upward).min()
    assert np.ptp(heights) < 1e-6
    assert lowest - 0.01 < heights.max() < lowest
    assert np.abs(ground.verts).max() > 8.0  # of a sphere of radius 1
    a, b, c = ground.verts[ground.faces].astype(float).transpose(1, 0, 2)
    assert (np.cross(b - a, c - a) @ upward > 0.0).all()
    assert (ground.normals == upward).all()
    assert ground.verts.dtype == np.float32  # as the scene's
    assert objects_of(scene).meshes == SCENE.meshes
    assert len(with_ground(scene, up).meshes) == len(scene.meshes)


def test_cameras_and_views_leave_it_out():
    scene = with_ground(SCENE)
    for name, camera in named_cameras(SCENE, ("front", "iso")).items():
        with_it = named_cameras(scene, ("front", "iso"))[name]
        assert with_it.plane == camera.plane
        for one, second in zip(seen_by(scene, with_it).lights, seen_by(SCENE, camera).lights, strict=True):
            assert one.position.tolist() == second.position.tolist()
    turned = {"azimuth": 30.0}
    assert camera_of(scene, turned).eye.tolist() == camera_of(SCENE, turned).eye.tolist()


@pytest.mark.parametrize(
    ("background", "settings", "lights"),
    [
        ((0.3, 0.6, 0.9), Settings(ambient="plain"), SCENE.lights),
        (0.5, Settings(), clshade.DirectionalLight((0.3, -1.0, 0.2))),
        (0.5, Settings(shader="nolight", background="white"), SCENE.lights),
        (0.05, Settings.from_preset("pbr"), SCENE.lights),  # the studio in place of the lights
    ],
)
def test_its_edge_has_the_color_of_the_background(background, settings, lights):
    scene = with_ground(replace(SCENE, background=background, lights=lights), settings=settings)
    above = clshade.Camera((0, 30, 0), (0, 0, 0), (0, 0, 1), 1.0, (32.0, 32.0), (160, 160), orthographic=True)
    place = (np.arange(160) + 0.5) / 5.0 - 16.0
    from_middle = np.hypot(place, place[:, None])
    within = (from_middle > 15.4) & (from_middle < 15.5)  # 9 times the radius of the sphere about the box, sqrt(3)
    edge = oracle.render(*effective_settings(replace(scene, camera=above), settings=settings), *np.nonzero(within))
    assert (edge.alpha == 1.0).all()
    assert len(edge.alpha) > 100
    behind = np.broadcast_to(1.0 if settings.shader == "nolight" else background, edge.rgb.shape)
    assert edge.rgb == pytest.approx(behind, rel=0.02)


def test_unlit_materials_leave_it_the_studio_alone():
    """They show their color by ambient light, which the ground must not count."""
    unlit = replace(SCENE.meshes[0], material=clshade.Material(ka=10.0, kd=0.0, ks=0.0))
    settings = Settings.from_preset("pbr")
    beside, alone = (
        with_ground(replace(SCENE, meshes=meshes), settings=settings).meshes[-1].colors
        for meshes in ((*SCENE.meshes, unlit), SCENE.meshes)
    )
    assert np.array_equal(beside, alone)


def test_the_command_line(capsys):
    alone, grounded = scene_of("icosphere"), scene_of("icosphere", "--ground", "--background", "none")
    assert len(grounded.meshes) == 2
    assert np.array_equal(grounded.meshes[0].verts, alone.meshes[0].verts)  # so that the ids of its faces stay
    assert (grounded.meshes[1].colors == GRAY[0]).all()
    assert grounded.camera.eye.tolist() == alone.camera.eye.tolist()
    code, out, lines = run(capsys, "render", "icosphere", "--ground", "--edges", "all")
    assert (code, out, len(lines)) == (2, "", 1)
    assert "--ground: cannot go with --edges" in lines[0]


def test_scenes_without_lights_or_faces_and_of_any_size():
    for scene in (
        replace(SCENE, lights=(), ambient=0.0),
        replace(SCENE, meshes=()),
        replace(SCENE, background=None),
        replace(SCENE, preset="course", ambient=0.5),
    ):
        colors = with_ground(scene).meshes[-1].colors
        assert np.isfinite(colors).all()
        assert (colors >= 0.0).all()
    huge = [replace(mesh, verts=mesh.verts.astype(float) * 1e308) for mesh in SCENE.meshes]
    with pytest.raises(InputError):
        with_ground(replace(SCENE, meshes=huge))
