"""Ambient occlusion in closed form, and what it has to do with shadows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from caster_meshes import box, sphere
from devices import rendered

from clshade.pipeline.frame import Frame
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scene

MATERIAL = Material(ka=(0.5, 0.6, 0.7), kd=0.4, ks=0.2, n=9.0)
ABOVE = Camera((0.0, 6.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 1.0, (1.0, 1.0), (24, 24))


def quad(corners: Any) -> Mesh:
    return Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=MATERIAL)


def floor(half: float = 4.0) -> Mesh:
    return quad([[-half, 0, -half], [-half, 0, half], [half, 0, half], [half, 0, -half]])


def closed(mesh: tuple[np.ndarray, np.ndarray], up: float = 0.0, scale: float = 1.0) -> Mesh:
    verts, faces = mesh
    return Mesh(scale * verts[:, [1, 2, 0]] + [0.0, up, 0.0], faces, material=MATERIAL)


def scene_of(*meshes: Mesh, camera: Camera) -> Scene:
    return Scene(meshes, camera, (), ambient=(1.0, 0.9, 0.8), background=0.1)


def draw(device, scene: Scene, **options: Any) -> Frame:
    return rendered(scene, device=device, **{"layers": ("Z", "id", "P", "AO"), "ambient_occlusion": 4, **options})


def test_a_closed_box_is_dark_inside(device):
    """Its diagonal is 3.46 long."""
    camera = replace(ABOVE, eye=(0.3, 0.2, 0.5), lookat=(0.9, -0.8, -0.9), focal=0.5)
    frame = draw(device, scene_of(closed(box()), camera=camera), ao_distance=3.5, ambient_occlusion=9)
    assert (frame["id"] > 0).all()
    assert not frame["AO"].any()
    assert not frame.rgb.any()
    assert (draw(device, scene_of(closed(box()), camera=camera), ao_distance=1e-30)["AO"] == 1.0).all()


def beside_a_wall(device, rays: int, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the layer on a floor to the right of an endless wall at x = 0, and distances from it."""
    camera = replace(ABOVE, eye=(1.2, 3.0, 0.0), lookat=(1.2, 0.0, 0.0), plane=(0.7, 0.7))
    wall = quad([[0, 0, -4000], [0, 0, 4000], [0, 0.8, 4000], [0, 0.8, -4000]])
    frame = draw(device, scene_of(floor(5000.0), wall, camera=camera), ambient_occlusion=rays, **options)
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
    ball = closed(sphere(24, 48), 0.5 + 1e-6, 0.5)
    camera = replace(ABOVE, eye=(2.0, 2.0, 0.0), lookat=(1.4, 0.0, 0.0))
    frame = draw(device, scene_of(floor(), ball, camera=camera), ambient_occlusion=64, ao_distance=100.0)
    seen = (frame["id"] > 0) & (frame["id"] <= 2)
    to_center = np.array([0.0, 0.5, 0.0]) - frame["P"][seen]
    distance = np.linalg.norm(to_center, axis=1)
    missing = (frame["AO"][seen] - (1.0 - (0.5 / distance) ** 2 * to_center[:, 1] / distance)).mean()
    assert seen.sum() > 300
    assert abs(missing) < 2e-3  # the mesh lies within the sphere
