"""Random scenes, each determined by its number: odd sizes, all settings, degenerate geometry, extreme values."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from random_extremes import aligned, coincident, stiffened
from random_kinds import BLOCK, TERMS, Kind, Random, kind_of
from random_materials import random_environment, random_lights, random_material
from random_meshes import SHAPES, blob, moved_mesh, random_mesh, triangles, with_scalars

from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, Scene, Settings
from clshade.scene.settings import EDGE_KINDS, MAX_SAMPLES, MAX_WIDTH, Edges

VARIED = (*TERMS, "colored")  # among scenes with a program that has all features


@dataclass(frozen=True)
class RandomScene:
    """One random scene and how to draw it. again: also draw it with `kind.other_lanes` and compare all bits."""

    number: int
    kind: Kind
    scene: Scene
    settings: Settings
    again: bool


def scene_of(number: int, seed: int = 0) -> RandomScene:
    """Return scene `number`, determined by number and seed. Even ones are stiffer; a quarter has exact coincidences."""
    kind, rng = kind_of(seed, number // BLOCK), np.random.default_rng([seed, number, 1])
    if not kind.specialize:
        kind = replace(kind, flags=kind.flags - {*VARIED} | {name for name in VARIED if rng.random() < 0.8})
    camera, coincides = _camera(rng, kind), number % 4 == 3
    camera = aligned(camera) if coincides else camera
    meshes = _meshes(rng, kind, camera)
    scale = 10.0 ** rng.uniform(-20, 20) if rng.random() < 0.2 and not coincides else 1.0
    shift = np.zeros(3)
    if rng.random() < 0.2 and not coincides:
        shift = scale * 10.0 ** rng.uniform(0, 9 if kind.double else 3) * rng.normal(size=3)
    lights = random_lights(rng, kind, meshes, camera.lookat, scale, shift)
    meshes = [moved_mesh(mesh, scale, shift, kind.double) for mesh in meshes]
    settings = _settings(rng, kind, scale)
    if kind.scalars:
        mesh = moved_mesh(random_mesh(rng, kind, meshes[-1].material, blob(rng, camera)), scale, shift, kind.double)
        mesh, colors = with_scalars(rng, kind, mesh)
        meshes, settings = [*meshes, mesh], replace(settings, scalars=colors)
    plane: Any = tuple((scale if kind.orthographic else 1.0) * np.array(camera.plane))
    nothing = None if rng.random() < 0.5 else np.zeros(3)
    scene = Scene(
        tuple(meshes),
        replace(camera, eye=camera.eye * scale + shift, lookat=camera.lookat * scale + shift, plane=plane),
        lights,
        rng.uniform(0.05, 1.0, 3) if kind.ambient else np.zeros(3),
        rng.choice((0.1, 1.0, 1e4)) * rng.uniform(0.1, 1.0, 3) if kind.background else nothing,
        kind.preset,
        f"fuzz {seed}/{number}",
        environment=random_environment(rng) if kind.around or kind.backdrop else None,
    )
    scene = stiffened(rng, scene, kind.double, kind.dim) if number % 2 == 0 else scene
    scene = coincident(rng, scene) if coincides else scene
    return RandomScene(number, kind, scene, settings, again=number % 8 in (0, 1, 6, 7))  # half of each sort


def _meshes(rng: Random, kind: Kind, camera: Camera) -> list[Mesh]:
    """Return up to five meshes of any shape; the first has every feature of the kind."""
    materials = [random_material(rng, kind, all_of_it=True)]
    if kind.several:
        materials += [random_material(rng, kind) for _ in range(rng.integers(1, 4))]
        if kind.front:
            materials[1] = replace(materials[1], sides="both")
    meshes = [random_mesh(rng, kind, materials[0], triangles(rng, 1), all_of_it=True)]
    for k in range(rng.integers(kind.several, 5)):
        # The second material's mesh needs faces: with a single material in use the program would differ.
        material = materials[1] if k == 0 and kind.several else materials[rng.integers(len(materials))]
        shape = blob if k == 0 else SHAPES[rng.integers(len(SHAPES))]
        meshes.append(random_mesh(rng, kind, material, shape(rng, camera)))
    return meshes


def _settings(rng: Random, kind: Kind, scale: float) -> Settings:
    changed: dict[str, Any] = {"near": None if rng.random() < 0.75 else scale * 10.0 ** rng.uniform(-6, 0.5)}
    if kind.settings.samples > 1:
        few = rng.random() < 0.95
        changed["samples"] = int(rng.integers(2, 17) if few else rng.integers(17, MAX_SAMPLES + 1))
    if kind.settings.ambient_occlusion and rng.random() < 0.5:
        changed["ao_distance"] = scale * 10.0 ** rng.uniform(-3, 3)
    if kind.settings.edges is not None:
        changed["edges"] = _edges(rng, kind, kind.settings.edges.only)
    return replace(kind.settings, **changed)


def _edges(rng: Random, kind: Kind, only: bool) -> Edges:
    count = rng.integers(1, 4) if rng.random() < 0.7 else 0
    kinds = tuple(EDGE_KINDS[k] for k in rng.integers(0, len(EDGE_KINDS), count)) or ("all",)
    width = 10.0 ** rng.uniform(-1.5, 0.8) if rng.random() < 0.8 else rng.uniform(5.0, MAX_WIDTH)
    color = tuple((1.0 if kind.dim else 10.0) * rng.uniform(0.0, 1.0, 3))
    return Edges(kinds, float(rng.uniform(0.0, 180.0)), float(width), color, only=only)


def _size(rng: Random, maximum: int) -> int:
    """Return a number of columns or rows: any, or one near a multiple of the tile size."""
    if rng.random() < 0.3:
        return int(min(maximum, rng.choice((1, 2, 15, 16, 17, 31, 32, 33, 48, 49))))
    return int(rng.integers(1, maximum + 1))


def _camera(rng: Random, kind: Kind) -> Camera:
    columns, rows = _size(rng, 80), _size(rng, 60)
    eye, up = rng.normal(size=3), rng.normal(size=3)
    eye *= rng.uniform(2.0, 6.0) / np.linalg.norm(eye)
    if rng.random() < 0.3:  # axis-aligned: many exact values
        eye, up = np.array([0.0, 0.0, 4.0]), np.array([0.0, 1.0, 0.0])
    lookat = np.zeros(3) if rng.random() < 0.5 else 0.3 * rng.normal(size=3)
    height = rng.uniform(2.0, 5.0) if kind.orthographic else 1.0
    if rng.random() < 0.1:
        height *= 10.0 ** rng.uniform(-2, 2)
    width = height * columns / rows if rng.random() < 0.6 else height * rng.uniform(0.5, 2.0)
    center = (0.5, 0.5) if rng.random() < 0.7 else tuple(rng.uniform(-0.3, 1.3, 2))
    return Camera(eye, lookat, up, rng.uniform(0.6, 2.5), (height, width), (columns, rows), center, kind.orthographic)
