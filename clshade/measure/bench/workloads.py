"""The generated scenes that `bench` draws, each with the bars that it must meet."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ...base.spelling import hint
from ...errors import InputError
from ...scene.builtin.scenes import Resolution, builtin
from ...scene.model import Mesh, PointLight, Scene

EXPONENT = 20.0  # specular exponent of all workloads
HD, UHD = (1920, 1080), (3840, 2160)
FIVE = {"llvmpipe": 5.0}


class Limit(NamedTuple):
    """A bar other than a ratio: a figure of `Result.figures`, its name, and the most, or the least, allowed."""

    figure: str
    label: str
    value: float
    at_least: bool = False


@dataclass(frozen=True, eq=False)
class Workload:
    """One scene to draw repeatedly.

    make: returns the scene, resolution included. ratios: minimum speedup over a peer, by the peer's name. peers: names
    of all that can draw it. limits: other bars. most_floors: most of its time in units of its floor, if there is a bar.
    apart: draw it in a process of its own, whose peak memory is measured too. options: of Renderer.
    """

    name: str
    about: str
    make: Callable[[], Scene]
    peers: tuple[str, ...] = ("llvmpipe", "opengl", "numpy")
    ratios: dict[str, float] = field(default_factory=dict)
    limits: tuple[Limit, ...] = ()
    most_floors: float | None = None
    apart: bool = False
    options: dict[str, Any] = field(default_factory=dict)


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


def empty(size: int) -> Scene:
    """Return a scene with only a background."""
    return replace(thing(size, level=2), meshes=())


TIME = Limit("ms", "ms a frame", 130.0)
MEMORY = Limit("peak_mib", "MiB at most in memory", 1331.0)
FLOORS = 2.0
FILL_RATE = Limit("mpix_s", "Mpix/s lit", 150.0, at_least=True)

WORKLOADS = (
    Workload(
        "object-512",
        "10,816 triangles over a third of 512x512",
        partial(thing, 512),
        peers=("llvmpipe", "opengl", "numpy", "scanline"),
        ratios={**FIVE, "scanline": 10_000.0},
    ),
    Workload("object-2048", "the same at 2048x2048", partial(thing, 2048), ratios=FIVE),
    Workload("object-4096", "the same at 4096x4096", partial(thing, 4096), ratios=FIVE, most_floors=FLOORS),
    Workload("knot-1080", "torus knot of a million triangles, 1920x1080", partial(knot, 10**6), ratios=FIVE),
    Workload("knot-2160", "the same at 3840x2160", partial(knot, 10**6, UHD), ratios=FIVE),
    Workload(
        "quads",
        "32 full-screen quads in random order, 1920x1080",
        partial(full_screen, 32),
        ratios=FIVE,
        most_floors=FLOORS,
    ),
    Workload(
        "textured",
        "the object with a texture, 1024x1024",
        partial(thing, 1024, textured=True),
        peers=("llvmpipe", "opengl"),
        ratios=FIVE,
    ),
    *(
        Workload(
            f"lights-{count}",
            f"the object under {count} light{'s' * (count > 1)}, 1024x1024",
            partial(thing, 1024, lights=count),
            ratios=FIVE,
            most_floors=FLOORS if count == 64 else None,
        )
        for count in (1, 8, 64)
    ),
    Workload(
        "large",
        "two triangles over all of 2048x2048",
        partial(full_screen, 1, (2048, 2048)),
        ratios=FIVE,
        limits=(FILL_RATE,),
        most_floors=FLOORS,
    ),
    Workload(
        "empty",
        "no triangle at all, 4096x4096",
        partial(empty, 4096),
        peers=("write",),
        ratios={"write": 1.0 / 1.5},
        most_floors=FLOORS,
    ),
    Workload(
        "knot-16M",
        "torus knot of 16,777,216 triangles, 1920x1080",
        partial(knot, 1 << 24),
        peers=(),
        limits=(TIME, MEMORY),
        apart=True,
    ),
)

FEW_TRIANGLES = 1000  # so few that their time is negligible beside that of the pixels
TRIANGLES = (4000, 16_000, 64_000, 256_000, 10**6, 4 * 10**6, 1 << 24, 1 << 25)
SIDES = (256, 512, 1024, 2048, 4096)
FIXED_SIDE = 16  # of an image so small that its pixels take negligible time

# Ways to draw the growing scenes, with the options of Renderer: the first in the preset `standard`, with Phong shading.
WAYS: dict[str, dict[str, Any]] = {"phong": {}, "gouraud": {"shader": "gouraud"}, "course": {"preset": "course"}}


def _growing() -> Iterator[Workload]:
    for way, options in WAYS.items():
        growing = partial(Workload, apart=True, options=options)
        yield growing(f"{way}-triangles-fixed", "few triangles, 1920x1080", partial(knot, FEW_TRIANGLES))
        for n in TRIANGLES:
            yield growing(f"{way}-triangles-{n}", f"{n:,} triangles, 1920x1080", partial(knot, n))
        yield growing(f"{way}-pixels-fixed", "the object at 16x16", partial(thing, FIXED_SIDE))
        for n in SIDES:
            yield growing(f"{way}-pixels-{n}", f"the object at {n}x{n}", partial(thing, n))


# The workloads of --scaling by name; `-fixed` is the same scene with few triangles, or in few pixels.
SCALING = {each.name: each for each in _growing()}


def pick(names: Collection[str], known: Collection[str], what: str) -> list[str]:
    """Return the names without duplicates, or all known ones if there are none.

    Raises InputError, with the nearest known name, for an unknown one.
    """
    for name in names:
        if name not in known:
            near = hint(name, known)
            raise InputError(f"bench: {what}: expected names of {', '.join(known)}, found {name!r}{near}")
    return list(dict.fromkeys(names)) or list(known)
