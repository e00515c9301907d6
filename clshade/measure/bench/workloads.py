"""The generated scenes that `bench` draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ...scene.builtin.scenes import Resolution, builtin
from ...scene.model import Mesh, PointLight, Scene

EXPONENT = 20.0  # specular exponent of all workloads
HD, UHD = (1920, 1080), (3840, 2160)


@dataclass(frozen=True, eq=False)
class Workload:
    """A scene to draw repeatedly. make: returns it, resolution included. options: of Renderer."""

    name: str
    about: str
    make: Callable[[], Scene]
    options: Mapping[str, Any] = field(default_factory=dict)


def _lights(count: int = 3) -> tuple[PointLight, ...]:
    """Return lights on a circle in front of the scene, of different hues, with a constant total intensity."""
    turn = 2.0 * np.pi * np.arange(count) / count
    hue = turn[:, None] + 2.0 * np.pi * np.arange(3) / 3.0
    places = np.stack([6.0 * np.cos(turn), 3.0 + 3.0 * np.sin(turn), np.full(count, 7.0)], axis=1)
    return tuple(PointLight(place, (0.6 + 0.4 * np.cos(h)) * 3.0 / count) for place, h in zip(places, hue, strict=True))


def phong_mesh(mesh: Mesh, **changes: Any) -> Mesh:
    """Return the mesh without texture, with the highlight of all workloads. changes: fields of its material."""
    return replace(mesh, material=replace(mesh.material, **{"texture": None, "n": EXPONENT, **changes}))


def thing(size: int, level: int = 13, lights: int = 3, textured: bool = False) -> Scene:
    """Return the course's object, 64 level^2 triangles, filling a third of a square image."""
    scene = builtin("course", level=level, resolution=(size, size))
    (mesh,) = scene.meshes
    if textured:
        texture = replace(mesh.material.texture, lookup="standard")  # type: ignore[type-var]
        mesh = phong_mesh(replace(mesh, colors=None), texture=texture)
    else:
        mesh = phong_mesh(replace(mesh, uvs=None, uv_faces=None))
    camera = replace(scene.camera, focal=1.2 * scene.camera.focal)
    return replace(scene, meshes=(mesh,), camera=camera, lights=_lights(lights), preset="standard")


def knot(triangles: int, resolution: Resolution = HD) -> Scene:
    """Return the built-in torus knot, which fills a quarter of the image."""
    scene = builtin("torus_knot", triangles=triangles, resolution=resolution)
    return replace(scene, meshes=tuple(map(phong_mesh, scene.meshes)))


def full_screen(count: int, resolution: Resolution = HD) -> Scene:
    """Return full-screen quads in random order of depth."""
    scene = builtin("quads", count=count, resolution=resolution)
    return replace(scene, meshes=tuple(map(phong_mesh, scene.meshes)), lights=_lights())


WORKLOADS = (
    Workload("object-512", "10,816 triangles over a third of 512x512", partial(thing, 512)),
    Workload("object-2048", "the same at 2048x2048", partial(thing, 2048)),
    Workload("object-4096", "the same at 4096x4096", partial(thing, 4096)),
    Workload("knot-1080", "torus knot of a million triangles, 1920x1080", partial(knot, 10**6)),
    Workload("knot-2160", "the same at 3840x2160", partial(knot, 10**6, UHD)),
    Workload("quads", "32 full-screen quads in random order, 1920x1080", partial(full_screen, 32)),
    Workload("textured", "the object with a texture, 1024x1024", partial(thing, 1024, textured=True)),
    Workload("lights-1", "the object under 1 light, 1024x1024", partial(thing, 1024, lights=1)),
    Workload("lights-8", "the object under 8 lights, 1024x1024", partial(thing, 1024, lights=8)),
    Workload("lights-64", "the object under 64 lights, 1024x1024", partial(thing, 1024, lights=64)),
    Workload("large", "two triangles over all of 2048x2048", partial(full_screen, 1, (2048, 2048))),
)
