"""Cases 24l to 24q: shadows of lights and casters that lie in each other's planes, far away, or are as thin as can be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....base.arrays import Array
from ....scene.model import DirectionalLight, Light, Material, Mesh, PointLight, Scene
from . import lit
from .bench import Bench, Case, Outcome, against_oracle, worst

DARK = Material(ka=0.0, kd=0.8, ks=0.0)


def wall(z: float = -2.0, half: float = 3.0) -> Mesh:
    """Return a square across the view, behind what casts shadows on it."""
    corners = np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]) * (1 + 2.0**-40)
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), colors=np.full((4, 3), 0.9), material=lit.MATERIAL)


def casters(count: int = 30) -> Mesh:
    mesh = lit.blob(count)
    return replace(mesh, verts=0.5 * mesh.verts)


def _drawn(bench: Bench, scene: Scene) -> Outcome:
    return against_oracle(bench.draw(scene, shadows=True))


def _under(bench: Bench, lights: list[Light], *meshes: Mesh) -> Outcome:
    """Compare meshes before a wall under each light by itself."""
    scenes = [lit.scene_of(wall(), *meshes, lights=(light,)) for light in lights]
    return worst([_drawn(bench, scene) for scene in scenes], f"{len(lights)} lights")


def grazing(bench: Bench) -> Outcome:
    """Lights 1 to 1e-12 before the wall's plane, in it, and behind it."""
    heights = (1.0, 1e-3, 1e-6, 1e-9, 1e-12, 0.0, -1e-6)
    lights: list[Light] = [PointLight((5.0, 0.7, -2.0 * (1 + 2.0**-40) + height)) for height in heights]
    lights += [DirectionalLight((-1.0, -0.2, -slope)) for slope in (1e-3, 1e-9)]
    return _under(bench, lights, casters())


def on_a_caster(bench: Bench) -> Outcome:
    """Lights on a caster's vertex and side, inside it, and in the planes of triangles."""
    mesh = casters()
    a, b, c = mesh.verts[mesh.faces[7]]
    places = [a, (a + b) / 2.0, (a + b + c) / 3.0, a + 3.0 * (b - a), a - 2.0 * (b - a) + 1.5 * (c - a)]
    walls = replace(wall(), verts=wall().verts[:, [2, 1, 0]] * [1.0, 0.3, 0.3])  # the plane x = -2
    edge_on = [np.array([-2.0 * (1 + 2.0**-40), y, 2.5]) for y in (0.0, 2.0)]
    lights: list[Light] = [PointLight(place) for place in (*places, *edge_on)]
    return _under(bench, lights, mesh, walls)


def far_away(bench: Bench) -> Outcome:
    """Lights 1e9 and 1e30 away; the scene at 1e9; the scene 1e20 times as large and as small."""
    toward = np.array([0.3, 0.4, 1.2])
    outcomes = [_under(bench, [PointLight(toward * 1e9), PointLight(toward * 1e30)], casters())]
    scene = lit.scene_of(lit.on_a_grid(wall(), 12), lit.on_a_grid(casters(), 12), lights=lit.LIGHTS[:1])
    outcomes += [_drawn(bench, lit.shifted(scene, 1.0, 1e9)), _drawn(bench, lit.shifted(scene, 1.0, -1e6))]
    outcomes += [_drawn(bench, lit.shifted(scene, scale, 0.0)) for scale in (1e-20, 1e20)]
    return worst(outcomes, "6 scenes")


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


def slivers(bench: Bench) -> Outcome:
    """Casters that are slivers."""
    mesh = sliver_mesh()
    return _under(bench, [PointLight((0.5, 1.0, 4.0)), DirectionalLight((0.1, -0.3, -1.0))], mesh)


def coplanar(bench: Bench) -> Outcome:
    """A lattice of triangles in one plane, each next to six others, from lights near that plane: none casts a shadow on
    another."""
    sheet = lit.patch(size=2.0, cells=8, bend=0.0)
    steep = replace(sheet, verts=sheet.verts + sheet.verts[:, :1] * [0.0, 0.0, 0.5])  # heights stay multiples of 2^-k
    outcomes = []
    for mesh in (sheet, steep):
        for light in (PointLight((5.0, 0.5, 3.0)), PointLight((40.0, 7.0, 20.5)), DirectionalLight((-1.0, -0.3, -0.9))):
            scene = lit.scene_of(mesh, lights=(light,))
            frames = [bench.draw(scene, shadows=shadows) for shadows in (True, False)]
            dark = (frames[0].rgb != frames[1].rgb).any(axis=-1)
            measured = against_oracle(frames[0])
            outcomes.append(replace(measured, wrong=measured.wrong + int(dark.sum())))
    return worst(outcomes, f"{len(outcomes)} images")


def box(turn: Array, shift: Array, material: Material = DARK) -> Mesh:
    """Return a closed box around the eye of `lit.CAMERA`, seen from inside."""
    line = np.array([-1.0, 1.0])
    verts = np.array([[x, y, z] for x in line for y in line for z in line]) * [2.0, 1.5, 3.0] @ turn.T
    faces = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    return Mesh(verts + shift, triangles, colors=np.full((8, 3), 0.9), material=material)


def closed_boxes(bench: Bench) -> Outcome:
    """Closed boxes, any way round, seen from inside, with lights outside: on every side, far away, in the planes of sides
    and on the lines of edges. All pixels are black."""
    rng = np.random.default_rng(8)
    leaks, seen, outcomes = 0, 0, []
    for k in range(6):
        turn = np.eye(3) if k < 3 else np.linalg.qr(rng.normal(size=(3, 3)))[0]
        center = np.zeros(3) if k % 2 == 0 else np.array([1000.0, -300.0, 50.0])
        places = [center + turn @ p for p in ([4, 0, 0], [2, 1.5, 9], [5, 5, 5], [2, 4, 1], [1e9, 1e9, 3e8])]
        sun = DirectionalLight(turn @ [1.0, 0.0, 0.0])
        around = tuple(PointLight(place, (1e3, 1e3, 1e3)) for place in places)
        camera = replace(lit.CAMERA, eye=center + turn @ [0.3, 0.2, 0.5], lookat=center + turn @ [1.9, 1.3, -2.8])
        scene = lit.scene_of(
            box(turn, center), lights=(*around, sun), ambient=0.0, background=0.0, camera=replace(camera, focal=0.4)
        )
        frame = bench.draw(scene, shadows=True)
        leaks, seen = leaks + int(frame.rgb.any(axis=-1).sum()), seen + frame.alpha.size
        if k == 3:
            outcomes.append(against_oracle(frame))
    outcomes.append(Outcome(leaks, pictures=(frame.rgb, np.zeros_like(frame.rgb))))
    return worst(outcomes, f"{seen} pixels")


CASES = (
    Case("24l", "grazing-shadow", "lights near and in a surface's plane", "within the bound", grazing, True),
    Case("24m", "light-on-caster", "lights on vertices, sides, in planes", "within the bound", on_a_caster, True),
    Case("24n", "far-shadow", "lights 1e9 away, scenes at 1e9", "within the bound", far_away, True),
    Case("24o", "sliver-shadow", "casters 1e-12 wide", "within the bound", slivers, True),
    Case("24p", "coplanar-shadow", "neighbors in one plane", "no shadow", coplanar, True),
    Case("24q", "closed-box", "lights outside of closed boxes", "black", closed_boxes, True),
)
