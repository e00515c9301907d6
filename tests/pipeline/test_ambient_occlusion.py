"""Ambient occlusion in closed form, and what it has to do with shadows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from devices import rendered

from clshade.measure.stability.cases.lit import blob
from clshade.pipeline.frame import Frame, same_bits
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, PointLight, Scene

MATERIAL = Material(ka=(0.5, 0.6, 0.7), kd=0.4, ks=0.2, n=9.0)
ABOVE = Camera((0.0, 6.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 1.0, (1.0, 1.0), (24, 24))
ASIDE = Camera((0.3, 3.0, 4.5), (0.0, -0.9, 0.0), (0.0, 1.0, 0.0), 1.5, (1.0, 1.0), (20, 20))


def quad(corners: Any, **fields: Any) -> Mesh:
    """Return a quadrilateral of two triangles. corners: (4, 3)."""
    corners = np.asarray(corners, float)
    options = {"colors": np.full((4, 3), 0.8), "material": MATERIAL, **fields}
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), **options)


def floor(height: float = 0.0, half: float = 4.0, **fields: Any) -> Mesh:
    at = [[-half, height, -half], [-half, height, half], [half, height, half], [half, height, -half]]
    return quad(at, **fields)


def wall(height: float, half: float = 4000.0, **fields: Any) -> Mesh:
    """Return a wall at x = 0, as wide as 2 half."""
    return quad([[0, 0, -half], [0, 0, half], [0, height, half], [0, height, -half]], **fields)


def scene_of(*meshes: Mesh, **fields: Any) -> Scene:
    """Return a scene of these, or of a dozen triangles over a floor beside a low wall."""
    small = replace(blob(12, material=MATERIAL), verts=0.5 * blob(12).verts)
    objects = meshes or (floor(-1.5), small, wall(0.4, 4.0))
    light = (PointLight((3.0, 4.0, 2.0), (0.6, 0.5, 0.4)),)
    return Scene(objects, **{"camera": ASIDE, "lights": light, "ambient": (1.0, 0.9, 0.8), "background": 0.1, **fields})


def draw(device, scene: Scene, **options: Any) -> Frame:
    return rendered(scene, device=device, **{"layers": ("Z", "id", "P", "AO"), "ambient_occlusion": 4, **options})


def box(half: float = 1.0) -> Mesh:
    line = np.array([-half, half])
    verts = np.array([[x, y, z] for x in line for y in line for z in line])
    faces = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    return Mesh(verts, triangles, colors=np.full((8, 3), 0.9), material=MATERIAL)


def test_a_closed_box_is_dark_inside(device):
    """Its diagonal is 3.46 long."""
    camera = replace(ABOVE, eye=(0.3, 0.2, 0.5), lookat=(0.9, -0.8, -0.9), focal=0.5)
    frame = draw(device, scene_of(box(), camera=camera, lights=()), ao_distance=3.5, ambient_occlusion=9)
    assert (frame["id"] > 0).all()
    assert not frame["AO"].any()
    assert not frame.rgb.any()
    nothing_within = draw(device, scene_of(box(), camera=camera, lights=()), ao_distance=1e-30)
    assert (nothing_within["AO"] == 1.0).all()


def beside_a_wall(device, rays: int, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the layer on a floor to the right of a wall, and distances from it."""
    camera = replace(ABOVE, eye=(1.2, 3.0, 0.0), lookat=(1.2, 0.0, 0.0), plane=(0.7, 0.7))
    scene = scene_of(floor(half=5000.0), wall(0.8), camera=camera)
    frame = draw(device, scene, ambient_occlusion=rays, **options)
    on_floor = (frame["id"] <= 2) & (frame["id"] > 0)
    return frame["AO"][on_floor], frame["P"][on_floor][:, 0]


def test_beside_a_wall_the_form_factor_is_missing(device):
    """A strip of height h at right angles, a away, has the form factor (1 - a/sqrt(a^2 + h^2))/2: the projection of its
    arc to the floor, by Nusselt's analog. The mean over the pixels, whose rays are shifted evenly, converges to it."""
    mean_errors, errors = {}, {}
    for rays in (4, 64):
        openness, a = beside_a_wall(device, rays, ao_distance=1e5)
        missing = openness - (1.0 - 0.5 * (1.0 - a / np.hypot(a, 0.8)))
        mean_errors[rays], errors[rays] = abs(missing.mean()), np.sqrt((missing**2).mean())
    assert mean_errors[4] < 0.01
    assert mean_errors[64] < 1e-3
    assert errors[4] < 0.15
    assert errors[64] < 0.02


def test_what_is_farther_away_does_not_count(device):
    openness, a = beside_a_wall(device, 16, ao_distance=0.5)
    assert (openness[a > 0.5] == 1.0).all()
    assert (openness[(a > 0.0) & (a < 0.2)] < 0.9).all()


def test_of_a_sphere_on_a_plane_the_form_factor_is_missing(device):
    """A sphere of radius r whose center is d away from a point, at an angle t to the normal above the horizon, has the form
    factor (r/d)^2 cos t."""
    rows, columns = 24, 48
    turn, rise = np.meshgrid(2 * np.pi * np.arange(columns) / columns, np.pi * np.arange(1, rows) / rows)
    verts = np.stack([np.sin(rise) * np.cos(turn), np.cos(rise), np.sin(rise) * np.sin(turn)], -1).reshape(-1, 3)
    verts = np.concatenate([verts, [[0, 1, 0], [0, -1, 0]]]) * 0.5 + [0.0, 0.5 + 1e-6, 0.0]
    a = np.arange(columns * (rows - 2))
    right = a - a % columns + (a + 1) % columns
    faces = [np.stack([a, right, a + columns], 1), np.stack([right, right + columns, a + columns], 1)]
    ring = np.arange(columns)
    for top, first in ((len(verts) - 2, 0), (len(verts) - 1, columns * (rows - 2))):
        faces.append(np.stack([np.full(columns, top), first + ring, first + (ring + 1) % columns], 1))
    ball = Mesh(verts, np.concatenate(faces), material=MATERIAL)
    camera = replace(ABOVE, eye=(2.0, 2.0, 0.0), lookat=(1.4, 0.0, 0.0))
    frame = draw(device, scene_of(floor(), ball, camera=camera), ambient_occlusion=64, ao_distance=100.0)
    seen = (frame["id"] > 0) & (frame["id"] <= 2)
    to_center = np.array([0.0, 0.5, 0.0]) - frame["P"][seen]
    distance = np.linalg.norm(to_center, axis=1)
    missing = (frame["AO"][seen] - (1.0 - (0.5 / distance) ** 2 * to_center[:, 1] / distance)).mean()
    assert seen.sum() > 300
    assert abs(missing) < 2e-3  # the mesh lies within the sphere


@pytest.mark.long
def test_lights_cast_shadows_only_if_they_are_asked_for(device):
    """Rays need what casts shadows; without them lights arrive everywhere, even if the feature of shadows is forced on."""
    dark = replace(scene_of(), ambient=0.0)
    plain = draw(device, dark, ambient_occlusion=0, layers=("id",))
    assert (draw(device, dark).rgba == plain.rgba).all()
    scene = scene_of()
    frames = [draw(device, scene, forced=forced) for forced in ((), ("SHADOWS", "SHADOW_ALPHA"))]
    assert same_bits(*frames)
    assert (draw(device, scene, shadows=True).rgb < frames[0].rgb - 1e-3).any()
