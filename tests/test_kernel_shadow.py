"""shadow_predicate.clh and the kernel shadow_rays, against exact integer arithmetic, in scenes that are hard to decide."""

import numpy as np
import pytest
from caster_meshes import Mesh, border_points, box, face_points, joined, lattice, moved, slivers, soup, sphere
from exact_shadows import DARK, EITHER, LIT, ExactShadows

from clshade.pipeline.hierarchy import CasterFrame, Hierarchy
from clshade.pipeline.struct_layout import RECEIVER_UNITS, SHADOW_GRID

Array = np.ndarray


def compare(device, mesh: Mesh, light: list[float], points: tuple[Array, Array]) -> Array:
    """Check shadows at points on faces against the exact ones; return the exact ones."""
    shadowed = Hierarchy(device, *mesh).shadowed(*points, np.array(light))
    expected = ExactShadows(*mesh).of(*points, np.array(light))
    wrong = np.flatnonzero((expected != EITHER) & (shadowed != (expected == DARK)))
    assert not len(wrong), (wrong, shadowed[wrong], expected[wrong])
    return expected


LIGHTS = {
    "near": [2.0, 1.5, 3.0, 1.0],
    "inside": [0.1, -0.05, 0.2, 1.0],
    "far": [1e9, -2e9, 3e9, 1.0],
    "farther": [1e25, -2e25, 3e25, 1.0],
    "directional": [0.3, 0.5, 1.0, 0.0],
    "along an axis": [0.0, 0.0, 1.0, 0.0],
}
BOXES, GROUND = joined(box(), moved(box(), 3.0)), joined(lattice(), moved(box(), 0.2, 0.1))
CASES = {  # from inside of closed meshes nothing outside is seen, also along edges
    f"{name}, {place}": (mesh, light)
    for name, mesh in {"crossing": soup(), "box": box(), "sphere": sphere()}.items()
    for place, light in LIGHTS.items()
} | {
    "in the plane of triangles": (BOXES, [5.0, 0.5, 1.0, 1.0]),
    "on a vertex": (BOXES, [1.0, 1.0, 1.0, 1.0]),
    "on an edge": (BOXES, [1.0, 1.0, 0.25, 1.0]),
    "just above the ground": (GROUND, [0.4, 0.1, 1e-6, 1.0]),
    "on the ground": (GROUND, [0.4, 0.1, 0.0, 1.0]),
    "far from the origin": (moved(joined(sphere(), moved(box(), 2.0)), 1e9), [1e9 + 4.0, 1e9 + 3.0, 1e9 + 5.0, 1.0]),
    "slivers": (slivers(), [3.0, 2.0, 5.0, 1.0]),
    "small beside large": (
        joined(moved(box(), 0.0, 1e6), moved(sphere(), 1e6 + 2.0)), [1e6 + 9.0, 1e6 + 7.0, 1e6 + 20.0, 1.0]
    ),
}  # fmt: skip


@pytest.mark.sampled
@pytest.mark.parametrize("name", CASES)
def test_shadows_are_the_exact_ones(device, name):
    mesh, light = CASES[name]
    exact = [compare(device, mesh, light, points) for points in (face_points(mesh, 80), border_points(mesh, 50))]
    if ", " in name:
        assert EITHER not in exact[0]
        assert np.count_nonzero(exact[1] == EITHER) <= 10  # the rounding of points on borders decides
    if name.endswith(", near"):
        assert {LIT, DARK} == set(exact[0])


@pytest.mark.parametrize("light", [[0.2, 0.1, 2.0, 1.0], [0.2, 0.1, 1e-3, 1.0], [1.0, 0.0, 1e-6, 0.0]])
@pytest.mark.parametrize("turned", [False, True])
def test_a_flat_mesh_casts_no_shadow_on_itself(device, turned, light):
    mesh = lattice(12, turned)
    if turned:
        rotation, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
        light = [*(rotation @ light[:3]), light[3]]
    hierarchy = Hierarchy(device, *mesh)
    for points in (face_points(mesh, 2000), border_points(mesh, 2000)):
        assert not hierarchy.shadowed(*points, np.array(light)).any()


@pytest.mark.long
@pytest.mark.parametrize("units", [RECEIVER_UNITS, 1, RECEIVER_UNITS + 1])
def test_receivers_off_their_plane(device, units):
    """To either side: by as much as rounding may move them, on a flat mesh, they are as if they were on it."""
    mesh = joined(lattice(4), moved(box(), 0.5, 0.1))
    frame = CasterFrame.around(mesh[0])
    at, receivers = face_points(lattice(4), 40)
    for light in ([1.0, 0.8, 1.5, 1.0], [0.2, 0.1, -1.0, 1.0], [0.3, 0.2, 1e-3, 1.0], [1.0, 0.5, 0.7, 0.0]):
        on_plane = compare(device, mesh, light, (at, receivers))
        for off in (units, -units):
            shadows = compare(device, mesh, light, (at + [0.0, 0.0, off * SHADOW_GRID / frame.unit], receivers))
            assert units > RECEIVER_UNITS or np.array_equal(shadows, on_plane)
