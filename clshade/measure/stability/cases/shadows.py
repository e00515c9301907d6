"""Cases 24l to 24u: shadows and ambient occlusion where lights, casters and receivers lie in each other's planes, far away,
or are as thin as can be."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ....base.arrays import Array
from ....scene.model import DirectionalLight, Light, Material, Mesh, PointLight, Scene
from . import lit
from .bench import Bench, Case, Outcomes, against_oracle, all_against_oracle, different_bits, wrong_pixels

DARK = Material(ka=0.0, kd=0.8, ks=0.0)
AMBIENT = (1.0, 0.9, 0.8)


def wall() -> Mesh:
    """Return a square across the view, behind what casts shadows on it."""
    corners = np.array([[-3.0, -3.0, -2.0], [3.0, -3.0, -2.0], [3.0, 3.0, -2.0], [-3.0, 3.0, -2.0]]) * (1 + 2.0**-40)
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), colors=np.full((4, 3), 0.9), material=lit.MATERIAL)


def casters() -> Mesh:
    mesh = lit.blob(30)
    return replace(mesh, verts=0.5 * mesh.verts)


def before_a_wall(**fields: Any) -> Scene:
    """Return casters before a wall, on a grid that stays exact in float64 when they move, with one light."""
    return lit.scene_of(lit.on_a_grid(wall(), 12), lit.on_a_grid(casters(), 12), lights=lit.LIGHTS[:1], **fields)


def moved(scene: Scene) -> list[Scene]:
    """Return the scene far away, and as large and small as may be."""
    return [lit.shifted(scene, *move) for move in ((1.0, 1e9), (1.0, -1e6), (1e-20, 0.0), (1e20, 0.0))]


def _under(bench: Bench, lights: list[Light], *meshes: Mesh) -> Outcomes:
    """Compare meshes before a wall under each light by itself."""
    scenes = [lit.scene_of(wall(), *meshes, lights=(light,)) for light in lights]
    return all_against_oracle(bench, scenes, shadows=True)


def grazing(bench: Bench) -> Outcomes:
    """Lights 1 to 1e-12 before the wall's plane, in it, and behind it."""
    heights = (1.0, 1e-3, 1e-6, 1e-9, 1e-12, 0.0, -1e-6)
    lights: list[Light] = [PointLight((5.0, 0.7, -2.0 * (1 + 2.0**-40) + height)) for height in heights]
    lights += [DirectionalLight((-1.0, -0.2, -slope)) for slope in (1e-3, 1e-9)]
    return _under(bench, lights, casters())


def on_a_caster(bench: Bench) -> Outcomes:
    """Lights on a caster's vertex and side, inside it, and in the planes of triangles."""
    mesh = casters()
    a, b, c = mesh.verts[mesh.faces[7]]
    places = [a, (a + b) / 2.0, (a + b + c) / 3.0, a + 3.0 * (b - a), a - 2.0 * (b - a) + 1.5 * (c - a)]
    walls = replace(wall(), verts=wall().verts[:, [2, 1, 0]] * [1.0, 0.3, 0.3])  # the plane x = -2
    edge_on = [np.array([-2.0 * (1 + 2.0**-40), y, 2.5]) for y in (0.0, 2.0)]
    lights: list[Light] = [PointLight(place) for place in (*places, *edge_on)]
    return _under(bench, lights, mesh, walls)


def far_away(bench: Bench) -> Outcomes:
    """Lights 1e9 and 1e30 away; the scene at 1e9; the scene 1e20 times as large and as small."""
    toward = np.array([0.3, 0.4, 1.2])
    yield from _under(bench, [PointLight(toward * 1e9), PointLight(toward * 1e30)], casters())
    yield from all_against_oracle(bench, moved(before_a_wall()), shadows=True)


def sliver_mesh() -> Mesh:
    """Return triangles 1e-2 to 1e-12 wide and 3 long, a fan of them around a point, and triangles without area."""
    rng = np.random.default_rng(2)
    corners = []
    for k in range(60):
        start, along = rng.uniform(-1.5, 1.5, 3) * [1, 1, 0.3], rng.normal(size=3)
        across = np.cross(along, rng.normal(size=3)) * 10.0 ** -(2 + k % 11)
        corners += [start, start + along, start + along * 0.5 + across]
    for k in range(20):
        turn = 2.0 * np.pi * np.array([k, k + 1e-3]) / 20
        corners += [np.zeros(3), *(np.stack([np.cos(turn), np.sin(turn), 0.1 * turn], axis=1))]
    corners += [np.zeros(3), np.ones(3), 2.0 * np.ones(3)]
    verts = np.array(corners) * (1 + 2.0**-40)
    return Mesh(verts, np.arange(len(verts)).reshape(-1, 3), colors=np.full_like(verts, 0.5), material=lit.MATERIAL)


def slivers(bench: Bench) -> Outcomes:
    """Casters that are slivers."""
    return _under(bench, [PointLight((0.5, 1.0, 4.0)), DirectionalLight((0.1, -0.3, -1.0))], sliver_mesh())


def planes() -> list[Mesh]:
    """Return sheets of triangles in one plane, across the view and steep."""
    sheet = lit.patch(size=2.0, cells=8, bend=0.0)
    # Heights stay multiples of 2^-k.
    return [sheet, replace(sheet, verts=sheet.verts + sheet.verts[:, :1] * [0.0, 0.0, 0.5])]


def coplanar(bench: Bench) -> Outcomes:
    """A lattice of triangles in one plane, each next to six others, from lights near that plane: none casts a shadow on
    another."""
    for mesh in planes():
        for light in (PointLight((5.0, 0.5, 3.0)), PointLight((40.0, 7.0, 20.5)), DirectionalLight((-1.0, -0.3, -0.9))):
            scene = lit.scene_of(mesh, lights=(light,))
            frames = [bench.draw(scene, shadows=shadows) for shadows in (True, False)]
            yield from [against_oracle(frames[0]), different_bits(*frames)]


def rooms(seed: int) -> list[tuple[Array, Array]]:
    """Return ways to turn a box, (3, 3), and its centers (3,)."""
    rng = np.random.default_rng(seed)
    turns = [np.eye(3), np.eye(3), *(np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(4))]
    return list(zip(turns, [np.zeros(3), np.array([1000.0, -300.0, 50.0])] * 3, strict=True))


def in_box(turn: Array, center: Array, material: Material, **fields: Any) -> Scene:
    """Return a closed box seen from inside, over a black background."""
    corners = np.stack(np.meshgrid([-2.0, 2.0], [-1.5, 1.5], [-3.0, 3.0], indexing="ij"), axis=-1).reshape(-1, 3)
    faces = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    box = Mesh(corners @ turn.T + center, triangles, colors=np.full((8, 3), 0.9), material=material)
    eye, lookat = center + turn @ [0.3, 0.2, 0.5], center + turn @ [1.9, 1.3, -2.8]
    return lit.scene_of(box, background=0.0, camera=replace(lit.CAMERA, eye=eye, lookat=lookat, focal=0.4), **fields)


def closed_boxes(bench: Bench) -> Outcomes:
    """Closed boxes, any way round, with lights outside: on every side, far away, in the planes of sides and on the lines
    of edges. All pixels are black."""
    for turn, center in rooms(8):
        places = [center + turn @ p for p in ([4, 0, 0], [2, 1.5, 9], [5, 5, 5], [2, 4, 1], [1e9, 1e9, 3e8])]
        around = *(PointLight(place, (1e3, 1e3, 1e3)) for place in places), DirectionalLight(turn @ [1.0, 0.0, 0.0])
        frame = bench.draw(in_box(turn, center, DARK, lights=around, ambient=0.0), shadows=True)
        yield from (wrong_pixels(frame.rgb, 0.0 * frame.rgb), against_oracle(frame))


# Ambient occlusion


def closed_occlusion(bench: Bench) -> Outcomes:
    """Closed boxes with rays as long as their diagonals: all pixels are black, also on edges."""
    for turn, center in rooms(9):
        scene = in_box(turn, center, lit.MATERIAL, lights=(), ambient=1.0)
        frame = bench.draw(scene, ambient_occlusion=16, ao_distance=8.0)
        yield wrong_pixels(frame.rgb, 0.0 * frame.rgb)


def open_planes(bench: Bench) -> Outcomes:
    """Sheets of triangles in one plane, across the view and steep, where they are and elsewhere: all of their ambient light
    arrives."""
    for mesh in planes():
        scene = lit.scene_of(lit.on_a_grid(mesh, 12), lights=(), ambient=1.0)
        for variant in (scene, *moved(scene)):
            yield different_bits(*(bench.draw(variant, ambient_occlusion=rays) for rays in (5, 0)))


def sliver_occlusion(bench: Bench) -> Outcomes:
    """Triangles 1e-2 to 1e-12 wide and 3 long, as casters and as receivers, and some without area."""
    scene = lit.scene_of(sliver_mesh(), wall(), ambient=AMBIENT)
    return all_against_oracle(bench, [scene], ambient_occlusion=4)


def lengths(bench: Bench) -> Outcomes:
    """Rays of 1e-300 to 1e300 and of the scene's own size; the scene at 1e9 and 1e20 times as large and as small."""
    scene = before_a_wall(ambient=AMBIENT)
    yield from all_against_oracle(bench, [scene, *moved(scene)], ambient_occlusion=4)
    for distance in (1e-300, 1e-9, 1e-3, 1e5, 1e300):
        yield from all_against_oracle(bench, [scene], ambient_occlusion=4, ao_distance=distance)


CASES = (
    Case("24l", "grazing-shadow", "lights near and in a surface's plane", "within the bound", grazing, True),
    Case("24m", "light-on-caster", "lights on vertices, sides, in planes", "within the bound", on_a_caster, True),
    Case("24n", "far-shadow", "lights 1e9 away, scenes at 1e9", "within the bound", far_away, True),
    Case("24o", "sliver-shadow", "casters 1e-12 wide", "within the bound", slivers, True),
    Case("24p", "coplanar-shadow", "neighbors in one plane", "no shadow", coplanar, True),
    Case("24q", "closed-box", "lights outside of closed boxes", "black", closed_boxes, True),
    Case("24r", "closed-occlusion", "ambient light in closed boxes", "black", closed_occlusion, True),
    Case("24s", "open-planes", "ambient light on planes, far away", "all of it arrives", open_planes, True),
    Case("24t", "sliver-occlusion", "casters and receivers 1e-12 wide", "within the bound", sliver_occlusion, True),
    Case("24u", "occlusion-length", "rays of 1e-300 to 1e300", "within the bound", lengths, True),
)
