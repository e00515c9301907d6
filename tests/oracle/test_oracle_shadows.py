"""Shadows of the oracle: exact signs, closed forms, and lights and casters in each other's planes."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from clshade import builtin
from clshade.oracle import shadows, visibility
from clshade.oracle.corners import gather
from clshade.oracle.transform import orientation
from clshade.scene.camera import Camera
from clshade.scene.model import DirectionalLight, Light, Mesh, PointLight, Scene

CAMERA = Camera((0.0, 5.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 1.0, (1.0, 1.0), (8, 8))


def quad(center: tuple[float, float, float], across: tuple[float, ...], along: tuple[float, ...]) -> Mesh:
    """Return a parallelogram around a center, from half its sides."""
    c, u, v = (np.array(vector, np.float64) for vector in (center, across, along))
    return Mesh(np.array([c - u - v, c + u - v, c + u + v, c - u + v]), np.array([[0, 1, 2], [0, 2, 3]]))


GROUND = quad((0.0, 0.0, 0.0), (8.0, 0.0, 0.0), (0.0, 0.0, -8.0))


def casters_of(*meshes: Mesh) -> shadows.Casters:
    return shadows.Casters.of(gather(Scene(meshes, CAMERA, ())))


def grid(count: int, reach: float) -> np.ndarray:
    """Return the centers of count^2 squares of the plane y = 0, |x| and |z| at most reach."""
    line = (np.arange(count) + 0.5) / count * 2.0 * reach - reach
    x, z = (coordinate.ravel() for coordinate in np.meshgrid(line, line))
    return np.stack([x, np.zeros_like(x), z], axis=1)


def faces_of_ground(points: np.ndarray) -> np.ndarray:
    """Return which of the ground's two triangles holds each point: corners run from (-8, 8), over (8, 8) to (8, -8)."""
    return np.where(points[:, 0] + points[:, 2] > 0.0, 0, 1)


def dark_at(casters: shadows.Casters, light: Light, points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return which points (K, 3) of these faces a light does not reach, and for which either answer is right."""
    local, off = (points - casters.origin) / casters.scale, np.full(len(points), shadows.OFF)
    return shadows.met(shadows.Rays.to(light, shadows.Receivers(casters, local, faces, off)))


def dark_on_ground(light: Light, points: np.ndarray, *meshes: Mesh) -> tuple[np.ndarray, np.ndarray]:
    return dark_at(casters_of(GROUND, *meshes), light, points, faces_of_ground(points))


def test_orientation_is_exact_where_float64_is_not():
    """Points of a plane, moved by one step of float64 out of it: of all, the sign of rational arithmetic."""
    generator = np.random.default_rng(5)
    a, b, c = (generator.normal(size=(400, 3)) for _ in range(3))
    share = generator.integers(-8, 9, size=(400, 2)) / 4.0
    d = a + share[:, :1] * (b - a) + share[:, 1:] * (c - a)
    d[::2, 0] = np.nextafter(d[::2, 0], 9.0)
    a[:100], b[:100], c[:100], d[:100] = (np.round(4.0 * v[:100]) / 4.0 for v in (a, b, c, d))
    d[:50] = a[:50] + 2.0 * (b[:50] - a[:50]) - (c[:50] - a[:50])
    signs = orientation(a, b, c, d)
    for k in range(len(a)):
        origin, *others = ([Fraction(x) for x in points[k].tolist()] for points in (a, b, c, d))
        (p, q, r), (s, t, u), (v, w, x) = ([x - y for x, y in zip(point, origin, strict=True)] for point in others)
        volume = p * (t * x - u * w) - q * (s * x - u * v) + r * (s * w - t * v)
        assert signs[k] == (volume > 0) - (volume < 0)
    assert (signs[:50] == 0).all()
    assert {-1, 0, 1} <= set(signs.tolist())


SQUARE = quad((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))


@pytest.mark.parametrize(
    ("light", "middle", "half"),
    [
        (PointLight((0.5, 3.0, 0.25)), (-0.25, -0.125), 1.5),
        (DirectionalLight((1.0, -2.0, 0.5)), (0.5, 0.25), 1.0),
        (PointLight((0.0, 0.5, 0.0)), (0.0, 0.0), 0.0),  # what lies behind the light hides nothing
    ],
)
def test_the_umbra_of_a_square(light, middle, half):
    """At height 1, of side 2: below a light at height 3 of side 3, moved away from the light; in the sun of side 2."""
    points = grid(64, 4.0)
    dark, unsure = dark_on_ground(light, points, SQUARE)
    assert np.array_equal(dark, (np.abs(points[:, [0, 2]] - middle) < half).all(axis=1))
    assert not unsure.any()


def test_a_light_in_the_plane_of_a_triangle_or_above_it_is_not_hidden_by_it():
    """A wall seen edge-on hides nothing but along its line."""
    wall = quad((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    below = quad((0.0, -1.0, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, -2.0))
    points = grid(40, 4.0)
    assert not np.any(dark_on_ground(PointLight((0.0, 3.0, 5.0)), points, wall))
    assert not np.any(dark_on_ground(PointLight((0.0, 3.0, 0.0)), points, below))
    dark, _ = dark_on_ground(PointLight((1.0, 3.0, 0.0)), points, wall)
    assert dark.any()
    assert not dark[points[:, 0] > 0.0].any()


def test_coplanar_faces_cast_no_shadow_on_each_other():
    """The ground's other half, also of one that rounding bends, and a second ground in the same plane or just below."""
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    points = grid(30, 7.9)
    for heights in (0.0, 1e-14):
        second_ground = quad((1.0, heights * -1.0, 1.0), (3.0, 0.0, 0.0), (0.0, 0.0, -3.0))
        for light in (PointLight((20.0, 1e-3, 3.0)), DirectionalLight((1.0, -1e-6, 0.3))):
            assert not np.any(dark_on_ground(light, points, second_ground))
    casters = casters_of(replace(GROUND, verts=GROUND.verts @ turned.T))
    light = PointLight(np.array([20.0, 1e-3, 3.0]) @ turned.T)
    dark, unsure = dark_at(casters, light, points @ turned.T, faces_of_ground(points))
    assert not dark.any()
    assert unsure.mean() < 0.01


@pytest.mark.parametrize("shift", [0.0, 1e9])
@pytest.mark.parametrize("distance", [3.0, 1e9])
def test_far_scenes_and_lights(shift, distance):
    """The umbra of the square is the same wherever the scene lies, and for a light so far away that of the sun."""
    toward, points = np.array([1.0, 2.0, 0.5]), grid(32, 4.0)
    expected = dark_on_ground(PointLight(toward * distance), points, SQUARE)[0]
    if distance > 1e6:
        assert np.array_equal(expected, dark_on_ground(DirectionalLight(-toward), points, SQUARE)[0])
    casters = casters_of(*(replace(mesh, verts=mesh.verts + shift) for mesh in (GROUND, SQUARE)))
    dark, unsure = dark_at(casters, PointLight(toward * distance + shift), points + shift, faces_of_ground(points))
    assert (dark == expected)[~unsure].all()
    assert unsure.mean() < 0.02


@pytest.mark.parametrize("uncertain", [0.0, 1e-6, 1e-2])
def test_no_pair_that_is_hit_or_may_be_is_left_untried(uncertain):
    """Corners on a coarse grid: lines meet sides, corners and planes; places known as exactly as on the device or less."""
    generator = np.random.default_rng(11)
    corners = generator.integers(-4, 5, size=(120, 3, 3)) / 4.0
    corners[:20, 2] = corners[:20, 1] + generator.normal(size=(20, 3)) * 1e-9  # slivers
    casters = casters_of(Mesh(corners.reshape(-1, 3), np.arange(360).reshape(-1, 3)))
    face = generator.choice(casters.opaque, 60)
    share = generator.choice([0.0, 0.25, 0.5, 1.0], size=(60, 3)) + 1e-3
    points = (share[:, :, None] * casters.corners[face]).sum(axis=1) / share.sum(axis=1)[:, None]
    at = shadows.Receivers(casters, points, face, np.full(60, shadows.OFF + uncertain))
    lights: list[Light] = [PointLight(place) for place in ((0, 0, 0), (0.25, 0.5, -0.5), (2, 3, 1), (1e9, 2e9, 0))]
    lights += [DirectionalLight((0, -1, 0)), DirectionalLight((1, 2, -3))]
    k, column = np.nonzero(at.face[:, None] != casters.opaque)
    triangle = casters.opaque[column]
    for light in lights:
        rays = shadows.Rays.to(light, at, off=uncertain * casters.scale)
        tried = set(zip(*map(np.ndarray.tolist, shadows.candidates(rays, casters.opaque)), strict=True))
        hits = np.logical_or(*shadows.Tests(rays[k], triangle).hits())
        hit = set(zip(k[hits].tolist(), triangle[hits].tolist(), strict=True))
        assert len(hit) > 60
        assert hit <= tried
        assert len(tried) < len(at.face) * len(casters.opaque)


def test_slivers_and_triangles_without_area_hide_at_most_what_they_cover():
    """A triangle 1e-9 wide hides a line; one without area, or with a corner that is not finite, nothing."""
    line = np.array([[0.0, 1.0, -2.0], [1e-9, 1.0, -2.0], [0.0, 1.0, 2.0]])
    points = grid(41, 4.0)
    flat = np.array([[0.0, 1.0, -2.0], [0.0, 1.0, 0.0], [0.0, 1.0, 2.0]])
    light, face = PointLight((0.0, 3.0, 0.0)), np.array([[0, 1, 2]])
    assert not np.any(dark_on_ground(light, points[np.abs(points[:, 0]) > 1e-6], Mesh(line, face)))
    assert not np.any(dark_on_ground(light, points, Mesh(flat, face)))


@pytest.mark.parametrize("orthographic", [False, True])
def test_points_lie_where_the_rays_meet_the_plane(orthographic):
    camera = replace(CAMERA, orthographic=orthographic, plane=(4.0, 4.0), principal=(0.4, 0.7), resolution=(16, 8))
    casters = casters_of(GROUND)
    x, y = (coordinate.ravel() for coordinate in np.meshgrid(np.arange(16) * 256 + 128, np.arange(8) * 256 + 40))
    right, up = (x / 4096.0 - 0.4) * 4.0, (y / 2048.0 - 0.7) * 4.0
    expected = np.stack([right, np.zeros(len(x)), -up], axis=1) * (1.0 if orthographic else 5.0)
    seen = shadows.at_pixels(casters, camera, faces_of_ground(expected), x, y)
    inside = (np.abs(expected) < 7.9).all(axis=1)
    assert inside.sum() > 20
    points = seen.point * casters.scale + casters.origin
    assert np.abs(points - expected)[inside].max() < 1e-12
    assert not points[:, 1].any()
    assert np.abs(points).max() <= 8.0
    assert seen.off.max() < 1e-9


def share(normal, face, to_light, bend: float = 0.0, turned=None):
    """Return the share of a light, its least and its largest."""
    normals = (np.broadcast_to(v, to_light.shape) for v in (normal if turned is None else turned, normal, face))
    count = to_light.shape[:-1]
    return visibility.softened(visibility.Normals(*normals, np.full(count, bend)), to_light, np.full(count, 1e-6))


def test_the_terminator_is_soft_where_normals_differ_and_absent_where_they_agree():
    up = np.array([0.0, 1.0, 0.0])
    angle = np.linspace(-0.5, np.pi / 2, 60)
    to_light = np.stack([np.cos(angle), np.sin(angle), np.zeros(60)], axis=1)
    assert (share(up, up, to_light)[0][angle > 0.01] == 1.0).all()
    bent = np.array([np.sin(0.3), np.cos(0.3), 0.0])
    for shares in (share(bent, up, to_light), share(bent, bent, to_light, turned=bent, bend=0.2)):
        assert (shares[0][to_light @ bent > 0.999] > 0.99).all()
        assert (np.diff(shares[0]) >= 0.0)[angle[1:] < np.pi / 2 - 0.3].all()
        assert ((shares[1] <= shares[0]) & (shares[0] <= shares[2])).all()
    assert (share(bent, up, to_light)[0][angle <= 0.0] == 0.0).all()
    assert (share(up, up, to_light, turned=bent)[0][angle < 0.0] == 0.0).all()
    assert [share(up, face, np.array([[0.6, 0.8, 0.0]]))[0] for face in (-up, np.zeros(3))] == [0.0, 1.0]


def test_the_terminator_of_a_smooth_mesh_has_no_steps():
    """Where a face turns away from the light nothing arrives, by normals and bends alone: both sides of an edge agree."""
    corners = gather(builtin("icosphere", level=2), bent=True)
    to_light = np.array([0.6, 0.64, 0.48])
    faces = shadows.Casters.of(corners).normals
    weights = np.random.default_rng(1).dirichlet(np.ones(3), len(faces))
    mean = (weights[:, :, None] * corners.normals).sum(axis=1)
    size = np.sqrt((mean * mean).sum(axis=1))
    bend = (weights * corners.bends).sum(axis=1) / size
    normals = visibility.Normals(mean / size[:, None], mean / size[:, None], np.zeros_like(mean), bend)
    arriving = visibility.softened(normals, np.broadcast_to(to_light, mean.shape), np.zeros(len(mean)))[0]
    assert (arriving[faces @ to_light <= 0.0] == 0.0).all()
    assert 0.4 < (arriving > 0.0).mean() < 0.5
    assert (arriving[mean @ to_light > 0.9] > 0.99).all()
