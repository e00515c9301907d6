"""The built-in scenes: counts, orientation, closed surfaces, options, determinism."""

from __future__ import annotations

import itertools
import math
import os
import time
from pathlib import Path

import numpy as np
import pytest

import clshade.teapot as newell
from clshade import oracle, scenes
from clshade.errors import InputError
from clshade.scene import MAX_FACES, Mesh, Scene, Settings

SMALL = {"resolution": (64, 48)}
FIELDS = ("verts", "faces", "colors", "normals", "normal_faces", "uvs", "uv_faces", "instances")


def mesh_of(scene: Scene, name: str) -> Mesh:
    return next(mesh for mesh in scene.meshes if mesh.name == name)


def face_normals(mesh: Mesh) -> np.ndarray:
    """Cross products, (F, 3), as long as twice the area."""
    a, b, c = (mesh.verts[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    return np.cross(b - a, c - a)


def volume(verts: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (verts[faces[:, k]].astype(np.float64) for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def welded(*meshes: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """One surface of several meshes; only positions equal bit for bit become one vertex."""
    starts = np.cumsum([0] + [len(mesh.verts) for mesh in meshes])
    verts = np.concatenate([mesh.verts for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)])
    verts, index = np.unique(verts, axis=0, return_inverse=True)
    return verts, index.reshape(-1)[faces]


def edge_keys(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A number for each directed edge, and for the same edge in the opposite direction."""
    a = faces.astype(np.int64)
    b = np.roll(a, -1, axis=1)
    size = int(a.max()) + 1
    return (a * size + b).ravel(), (b * size + a).ravel()


def border(faces: np.ndarray) -> int:
    """Number of edges without a partner in the opposite direction; asserts that none is there twice in one."""
    there, back = edge_keys(faces)
    assert len(np.unique(there)) == len(there)
    return len(there) - int(np.isin(back, there).sum())


def euler(faces: np.ndarray) -> int:
    return len(np.unique(faces)) - len(np.unique(np.minimum(*edge_keys(faces)))) + len(faces)


# Every scene


@pytest.mark.parametrize("name", scenes.BUILTINS)
def test_builds_a_scene_of_that_name_and_resolution(name):
    scene = scenes.builtin(name, **SMALL)
    assert isinstance(scene, Scene)
    assert scene.name == name
    assert scene.camera.resolution == (64, 48)
    assert scene.lights
    assert scenes.BUILTINS[name] is getattr(scenes, name)
    assert scenes.BUILTINS[name].__doc__


def test_the_teapot_is_the_default():
    scene = scenes.builtin()
    assert scene.name == "teapot"
    assert scene.camera.resolution == (800, 600)


@pytest.mark.parametrize("name", scenes.BUILTINS)
def test_the_same_call_gives_the_same_bits(name):
    first, second = scenes.builtin(name), scenes.builtin(name)
    assert len(first.meshes) == len(second.meshes)
    for one, two in zip(first.meshes, second.meshes, strict=True):
        for field in FIELDS:
            a, b = getattr(one, field), getattr(two, field)
            assert (a is None) == (b is None)
            assert a is None or (a.dtype == b.dtype and a.tobytes() == b.tobytes())
        if one.material.texture is not None:
            assert one.material.texture.image.tobytes() == two.material.texture.image.tobytes()


@pytest.mark.parametrize("name", scenes.BUILTINS)
def test_normals_are_unit_and_agree_with_the_winding(name):
    for mesh in scenes.builtin(name).meshes:
        direction = face_normals(mesh)
        assert (np.abs(direction).max(axis=1) > 0.0).all(), mesh.name  # no face without area
        if mesh.normals is None:
            continue
        length = np.sqrt((mesh.normals.astype(np.float64) ** 2).sum(axis=1))
        tolerance = 4.0 * np.finfo(mesh.normals.dtype).eps  # rounding of three squares, a sum and a root, or of storing
        assert np.abs(length - 1.0).max() <= tolerance, mesh.name
        corners = mesh.normals[mesh.faces if mesh.normal_faces is None else mesh.normal_faces]
        assert (np.einsum("fc,fkc->fk", direction, corners) > 0.0).all(), mesh.name


@pytest.mark.parametrize(
    ("name", "options", "told"),
    [
        ("tea", {}, "teapot, torus_knot, icosphere, quads, box_room, course"),
        (None, {}, "name"),
        (["teapot"], {}, "name"),
        ("teapot", {"triangles": 3}, "level, resolution"),
        ("teapot", {"level": 1}, "level"),
        ("teapot", {"level": 2.5}, "level"),
        ("teapot", {"level": "10"}, "level"),
        ("teapot", {"level": 501}, "level"),
        ("teapot", {"resolution": 5}, "resolution"),
        ("teapot", {"resolution": (0, 5)}, "resolution"),
        ("torus_knot", {"triangles": 17}, "triangles"),
        ("torus_knot", {"triangles": MAX_FACES + 1}, "triangles"),
        ("torus_knot", {"triangles": math.nan}, "triangles"),
        ("torus_knot", {"p": 2, "q": 4}, "common divisor"),
        ("torus_knot", {"p": 0}, "p"),
        ("icosphere", {"level": 10}, "level"),
        ("icosphere", {"level": -1}, "level"),
        ("quads", {"count": 0}, "count"),
        ("quads", {"seed": -1}, "seed"),
        ("quads", {"resolution": (1, 2, 3)}, "resolution"),
        ("box_room", {"divisions": True}, "divisions"),
        ("course", {"level": None}, "level"),
    ],
)
def test_bad_options_are_refused_by_name(name, options, told):
    with pytest.raises(InputError, match=told) as caught:
        scenes.builtin(name, **options)
    assert "\n" not in str(caught.value)


# The teapot

PATCHES = {
    "body": (newell.RIM, newell.BODY_UPPER, newell.BODY_LOWER, newell.BOTTOM),
    "lid": (newell.KNOB, newell.LID),
    "handle": (newell.HANDLE_UPPER, newell.HANDLE_LOWER),
    "spout": (newell.SPOUT_LOWER, newell.SPOUT_UPPER),
}


def casteljau(points: np.ndarray, t: float) -> np.ndarray:
    while len(points) > 1:
        points = points[:-1] + t * (points[1:] - points[:-1])
    return points[0]


def surface(patch, round_patch: bool, s: float, t: float) -> np.ndarray:
    """A point of a patch as the table means it, by repeated linear interpolation; y up."""
    points = np.array(patch)
    if round_patch:
        points = np.array([[(r, 0, z), (r, k, z), (k, r, z), (0, r, z)] for r, k, z in patch], float)
    x, y, z = casteljau(np.array([casteljau(row, t) for row in points]), s)
    return np.array([x, z, -y])


@pytest.mark.parametrize("level", [2, 7, 10])
def test_teapot_has_64_triangles_for_each_square_of_its_level(level):
    scene = scenes.teapot(level)
    pot = sum(len(mesh.faces) for mesh in scene.meshes if mesh.name != "floor")
    assert pot == 64 * level**2
    assert len(mesh_of(scene, "floor").faces) == 4248
    assert [mesh.name for mesh in scene.meshes] == ["body", "seat", "lid", "handle", "spout", "floor"]


def test_teapot_points_are_those_of_the_table():
    level = 4
    parts = newell.parts(level)
    for name, patches in PATCHES.items():
        positions = parts[name][0]
        for k, patch in enumerate(patches):
            for i, j in itertools.product(range(level + 1), repeat=2):
                is_round = name in ("body", "lid")
                # A tube's given half, y <= 0, comes first and runs against the order of the table.
                expected = surface(patch, is_round, i / level, j / level if is_round else 1.0 - j / level)
                assert np.allclose(positions[k * level + i, j], expected, rtol=0.0, atol=1e-14), (name, k, i, j)


def test_teapot_normals_are_those_of_the_surface():
    level, h = 5, 1e-5
    parts = newell.parts(level)
    for name, patches in PATCHES.items():
        is_round = name in ("body", "lid")
        for k, patch in enumerate(patches):
            for i, j in itertools.product(range(1, level), repeat=2):
                s, t = i / level, (j / level if is_round else 1.0 - j / level)
                by_s, by_t = (
                    surface(patch, is_round, s + ds, t + dt) - surface(patch, is_round, s - ds, t - dt)
                    for ds, dt in ((h, 0.0), (0.0, h if is_round else -h))
                )
                normal = np.cross(by_s, by_t)
                normal /= np.sqrt(normal @ normal)
                # Central differences: h^2 times third over first derivatives (up to 20), and rounding 1e-16 / h.
                assert np.allclose(parts[name][1][k * level + i, j], normal, rtol=0.0, atol=1e-8), (name, k, i, j)


def test_teapot_poles_have_their_limit_normals():
    parts = newell.parts(6)
    body, lid = parts["body"][1], parts["lid"][1]
    assert np.allclose(lid[0], [0.0, 1.0, 0.0], rtol=0.0, atol=1e-15)
    assert np.allclose(body[-1], [0.0, -1.0, 0.0], rtol=0.0, atol=1e-15)
    positions = parts["lid"][0]
    assert (positions[0] == [0.0, 3.15, 0.0]).all()


@pytest.mark.parametrize("level", [2, 3, 10])
def test_teapot_is_free_of_cracks(level):
    scene = scenes.teapot(level)
    _, faces = welded(*(mesh_of(scene, name) for name in ("body", "seat", "lid")))
    assert border(faces) == 0
    assert euler(faces) == 2
    for name in ("handle", "spout"):
        verts, faces = welded(mesh_of(scene, name))
        assert border(faces) == 4 * level  # the two open ends, inside the body or at the spout's mouth
        assert euler(faces) == 0
        mirrored = verts * [1.0, 1.0, -1.0] + 0.0  # + 0.0: no -0.0
        assert set(map(tuple, verts)) == set(map(tuple, mirrored))


def test_teapot_faces_outwards():
    scene = scenes.teapot()
    assert volume(*welded(*(mesh_of(scene, name) for name in ("body", "seat", "lid")))) > 0.0
    for name in ("handle", "spout"):
        tube = newell.parts(10)[name][0]
        first, last = (np.broadcast_to(tube[k].mean(axis=0), tube[:1].shape) for k in (0, -1))  # closed by cones
        assert volume(*scenes._welded(np.concatenate([first, tube, last]))[:2]) > 0.0


def polynomial(four) -> np.poly1d:
    t = np.poly1d([1.0, 0.0])
    a, b, c, d = map(float, four)
    return a * (1 - t) ** 3 + 3 * b * t * (1 - t) ** 2 + 3 * c * t**2 * (1 - t) + d * t**3


def integral(function: np.poly1d) -> float:
    return float(np.polyint(function)(1.0))


def test_teapot_body_volume_converges_to_that_of_its_profile():
    x, y = polynomial((1.0, 1.0, 0.56, 0.0)), polynomial((0.0, 0.56, 1.0, 1.0))
    section = 4.0 * 0.5 * integral(x * y.deriv() - y * x.deriv())  # of radius 1
    assert abs(section - math.pi) < 0.03
    expected = 0.0
    for patch in (newell.BODY_UPPER, newell.BODY_LOWER, newell.BOTTOM):
        radius, inner, height = np.array(patch).T
        assert np.allclose(inner, 0.56 * radius)
        expected -= section * integral(polynomial(radius) ** 2 * polynomial(height).deriv())

    def meshed(level: int) -> float:
        below_rim = newell.parts(level)["body"][0][level:]
        lid = np.broadcast_to([0.0, 2.4, 0.0], below_rim[:1].shape)
        return volume(*scenes._welded(np.concatenate([lid, below_rim]))[:2])

    errors = [abs(meshed(level) - expected) for level in (8, 16, 32)]
    assert errors[0] < 0.01 * expected
    assert errors[1] < errors[0] / 3.8  # second order: a quarter each time
    assert errors[2] < errors[1] / 3.8


def test_teapot_has_newells_dimensions():
    """Of the surface, not of the control points: the spout's tip at 3.434, its widest circle beyond 2 by the arc."""
    scene = scenes.teapot(40)
    verts = np.concatenate([mesh.verts for mesh in scene.meshes if mesh.name != "floor"])
    assert np.allclose(verts.min(axis=0), [-3.0, 0.0, -2.0], rtol=0.0, atol=1e-4)
    assert np.allclose(verts.max(axis=0), [3.434, 3.15, 2.0], rtol=0.0, atol=1e-3)


def test_teapot_patches_join_smoothly():
    """Along a profile or a tube the direction goes on where patches meet: a mistyped number would show."""
    for patches in PATCHES.values():
        for first, second in itertools.pairwise(patches):
            first, second = np.array(first), np.array(second)
            assert (first[3] == second[0]).all()
            before, after = first[3] - first[2], second[1] - second[0]
            cosine = (before * after).sum(-1) / np.sqrt((before**2).sum(-1) * (after**2).sum(-1))
            assert (cosine > 1.0 - 1e-9).all()


def test_teapot_agrees_with_a_teapot_of_other_make():
    """All of its vertices are among ours: it was cut into 10 x 10 cells a patch too."""
    path = Path(os.environ.get("CLSHADE_DATA", Path(__file__).parents[2] / "shared" / "data")) / "teapot.obj"
    if not path.exists():
        pytest.skip(f"needs {path}; CLSHADE_DATA names its folder")
    theirs = np.array([line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")], float)
    ours = np.concatenate([positions.reshape(-1, 3) for positions, _ in newell.parts(10).values()])
    furthest = max(np.abs(ours - point).max(axis=1).min() for point in theirs)
    assert furthest < 2e-6  # written with six digits after the point


def test_teapot_stands_on_its_floor_in_the_light():
    scene = scenes.teapot()
    floor = mesh_of(scene, "floor")
    assert (floor.verts[:, 1] == 0.0).all()
    assert floor.colors.min() >= 0.0
    assert floor.colors.max() <= 1.0
    key, orange, blue = (light.intensity for light in scene.lights)
    assert np.ptp(key) < 0.2
    assert orange[0] > 3.0 * orange[2]
    assert blue[2] > 3.0 * blue[0]
    assert len({mesh.material.name for mesh in scene.meshes}) == 5
    camera = scene.camera  # nothing needs clipping
    forward = (camera.lookat - camera.eye) / np.linalg.norm(camera.lookat - camera.eye)
    assert min(((mesh.verts - camera.eye) @ forward).min() for mesh in scene.meshes) > 1.0


def test_teapot_shadows_lie_away_from_the_light():
    points = np.array([[0.0, 0.0, 0.0], [-3.2, 0.0, 0.0], [4.2, 0.0, 0.0], [0.0, 0.0, 4.0]])
    above, right = newell.shadows([np.array([0.0, 1000.0, 0.0]), np.array([20.0, 14.0, 0.0])], points)
    assert above[0] > 0.95
    assert above[1] < 0.2  # 0.2 beside the handle: the softened edge of its shadow
    assert above[2:].tolist() == [0.0, 0.0]
    assert right[:2].min() > 0.9
    assert right[2:].tolist() == [0.0, 0.0]


def test_teapot_has_highlights_beyond_one():
    scene = scenes.teapot(4, resolution=(80, 60))
    rgb = oracle.render(scene, Settings()).rgb
    assert rgb.max() > 1.5
    assert 0.003 < (rgb.max(axis=2) > 1.0).mean() < 0.1  # highlights, not a burnt-out picture
    assert np.median(rgb) < 0.5


@pytest.mark.parametrize(
    ("make", "shape"),
    [
        (newell.body_image, (512, 512, 3)),
        (newell.lid_image, (256, 256, 3)),
        (newell.tube_image, (256, 128, 3)),
        (newell.marble_image, (384, 384, 3)),
        (newell.swirl_image, (256, 256, 3)),
    ],
)
def test_images_are_colors_that_repeat_without_a_seam(make, shape):
    image = make()
    assert image.shape == shape
    assert image.dtype == np.float32
    assert image.min() >= 0.0
    assert image.max() <= 1.0
    assert image.std() > 0.02
    assert (image * 4096.0 == np.rint(image * 4096.0)).all()
    seam = np.abs(image[:, 0] - image[:, -1]).mean()
    inside = np.abs(np.diff(image, axis=1)).mean(axis=(0, 2))
    assert seam <= 1.5 * inside.max()


# The torus knot


@pytest.mark.parametrize("triangles", [18, 96, 1000, 12345, 100_000])
@pytest.mark.parametrize(("p", "q"), [(2, 3), (3, 2), (1, 1), (5, 8)])
def test_knot_is_a_closed_torus(triangles, p, q):
    mesh = scenes.torus_knot(triangles, p, q).meshes[0]
    assert mesh.verts.dtype == np.float32
    assert mesh.normals.dtype == np.float32
    assert mesh.faces.dtype == np.int32
    assert len(mesh.verts) == len(mesh.faces) // 2
    assert border(mesh.faces) == 0
    assert euler(mesh.faces) == 0
    if triangles >= 1000:
        assert abs(len(mesh.faces) - triangles) <= 0.01 * triangles
    if triangles >= 12345:
        assert volume(mesh.verts, mesh.faces) > 0.0


@pytest.mark.parametrize("triangles", [1000, 20_000, 100_000, 250_000, 1_000_000])
def test_knot_has_the_number_of_triangles_asked_for(triangles):
    assert scenes.builtin("torus_knot", triangles=triangles, **SMALL).face_count == triangles


@pytest.mark.parametrize("triangles", [16_000_000, MAX_FACES])
def test_knot_cells_are_exact_and_about_square_up_to_the_limit(triangles):
    segments, sides = scenes._knot_cells(triangles, 10.0)
    assert 2 * segments * sides == triangles
    assert 0.25 <= segments / sides / 10.0 <= 4.0


def test_knot_is_a_tube_of_constant_radius_with_its_own_normals():
    mesh = scenes.torus_knot(40_000).meshes[0]
    sides = int(mesh.faces[0, 1])  # the vertex next to the first one along the tube comes a ring later
    rings = mesh.verts.reshape(-1, sides, 3).astype(np.float64)
    spokes = rings - rings.mean(axis=1, keepdims=True)
    radius = np.sqrt((spokes**2).sum(axis=2))
    assert np.ptp(radius) < 1e-6  # float32 of coordinates up to 2
    assert np.allclose(spokes / radius[:, :, None], mesh.normals.reshape(-1, sides, 3), rtol=0.0, atol=1e-5)


def test_knot_volume_is_that_of_its_tube():
    """Pappus: cross section times the length of the center's way (its centers lie on the way itself)."""
    scene = scenes.torus_knot(400_000)
    mesh = scene.meshes[0]
    angle = np.linspace(0.0, 2.0 * np.pi, 20_001)
    ring = 2.0 * (1.0 + 0.5 * np.cos(3.0 * angle))
    speed = np.sqrt(ring**2 + (0.5 * 3.0) ** 2)
    length = float(((speed[1:] + speed[:-1]) / 2.0).sum() * angle[1])
    radius = 0.26
    assert math.isclose(volume(mesh.verts, mesh.faces), math.pi * radius**2 * length, rel_tol=1e-3)


def test_a_million_triangles_take_less_than_a_second():
    start = time.process_time()  # of this process: others may be busy
    scenes.torus_knot(1_000_000)
    assert time.process_time() - start < 1.0


# The icosphere


@pytest.mark.parametrize("level", range(5))
def test_icosphere_counts_and_topology(level):
    mesh = scenes.icosphere(level).meshes[0]
    assert len(mesh.faces) == 20 * 4**level
    assert len(mesh.verts) == 10 * 4**level + 2
    assert border(mesh.faces) == 0
    assert euler(mesh.faces) == 2
    assert (mesh.normals == mesh.verts).all()


def test_icosphere_volume_converges_to_that_of_the_ball():
    errors = []
    for level in range(6):
        mesh = scenes.icosphere(level).meshes[0]
        errors.append(4.0 / 3.0 * math.pi - volume(mesh.verts, mesh.faces))
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    edge = 1.0 / math.sqrt(golden * math.sqrt(5.0)) * 2.0  # of the icosahedron in the unit sphere
    exact = 4.0 / 3.0 * math.pi - 5.0 / 12.0 * (3.0 + math.sqrt(5.0)) * edge**3
    assert math.isclose(errors[0], exact, rel_tol=1e-12)
    ratios = np.array(errors[:-1]) / errors[1:]
    assert errors[-1] > 0.0
    assert (np.abs(ratios[2:] - 4.0) < 0.1).all()  # second order


def test_icosphere_center_is_lit_head_on():
    scene = scenes.icosphere(3, resolution=(33, 33))
    material, light = scene.meshes[0].material, scene.lights[0]
    expected = material.ka * scene.ambient + light.intensity * (material.kd + material.ks)
    found = oracle.render(scene, Settings()).rgb[16, 16]
    # The point nearest to the eye is a vertex or an edge's middle, whose normal points to eye and light.
    assert np.allclose(found, expected, rtol=1e-9)


# The quads


def test_quads_cover_every_pixel_each_in_its_own_color_in_random_order():
    scene = scenes.quads()
    mesh, camera = scene.meshes[0], scene.camera
    assert camera.resolution == (1920, 1080)
    assert len(mesh.faces) == 64
    corners = mesh.verts.reshape(32, 4, 3) - camera.eye
    depth = -corners[:, :, 2]
    assert (depth == depth[:, :1]).all()  # they face the camera
    assert len(np.unique(depth)) == 32
    assert (np.diff(depth[:, 0]) > 0.0).any()
    assert (np.diff(depth[:, 0]) < 0.0).any()
    height, width = camera.plane
    reach = np.abs(corners[:, :, :2]) * camera.focal / depth[:, :, None]
    assert (reach > [width / 2.0, height / 2.0]).all()
    colors = mesh.colors.reshape(32, 4, 3)
    assert (colors == colors[:, :1]).all()
    assert len(np.unique(np.round(colors[:, 0], 3), axis=0)) == 32
    assert colors.min() >= 0.0


def test_quads_nearest_wins_everywhere():
    scene = scenes.quads(5, seed=3, resolution=(24, 16))
    nearest = int(np.argmax(scene.meshes[0].verts[::4, 2]))
    ids = oracle.render(scene, Settings()).id
    assert set(np.unique(ids)) == {2 * nearest + 1, 2 * nearest + 2}


def test_quads_seed_changes_the_order_only():
    one, two = (scenes.quads(16, seed=seed).meshes[0].verts[::4, 2] for seed in (1, 2))
    assert (one != two).any()
    assert (np.sort(one) == np.sort(two)).all()


# The room


def test_room_is_seen_from_inside_and_needs_the_near_plane():
    scene = scenes.box_room(4)
    assert scene.face_count == 10 * 4**2 + 2 + 24
    eye = scene.camera.eye
    for name in ("floor", "ceiling", "back", "left", "right"):
        wall = mesh_of(scene, name)
        to_eye = eye - wall.verts[wall.faces].mean(axis=1)
        assert ((face_normals(wall) * to_eye).sum(axis=1) > 0.0).all()
    floor = mesh_of(scene, "floor").verts
    assert floor[:, 2].max() > eye[2] > floor[:, 2].min()
    assert len(scene.lights) >= 3
    assert len({mesh.material.name for mesh in scene.meshes}) == len(scene.meshes)
    assert mesh_of(scene, "left").colors[:, 0].max() > 3.0 * mesh_of(scene, "left").colors[:, 1].max()
    assert mesh_of(scene, "right").colors[:, 1].max() > 3.0 * mesh_of(scene, "right").colors[:, 0].max()


def test_room_fills_the_image_and_its_lamp_is_brighter_than_white():
    frame = oracle.render(scenes.box_room(2, resolution=(40, 30)), Settings())
    assert (frame.alpha == 1.0).all()
    assert math.isclose(frame.rgb.max(), 6.0)


def test_room_boxes_stand_in_it():
    scene = scenes.box_room()
    boxes = mesh_of(scene, "boxes")
    assert border(welded(boxes)[1]) == 0
    assert math.isclose(volume(boxes.verts, boxes.faces), 8.0)
    for placement in boxes.instances:
        assert np.linalg.det(placement[:3, :3]) > 0.0
        corners = boxes.verts @ placement[:3, :3].T + placement[:3, 3]
        assert math.isclose(corners[:, 1].min(), 0.0, abs_tol=1e-12)
        assert (np.abs(corners[:, 0]) < 1.3).all()
        assert (corners[:, 2] > -2.0).all()


# The course's scene


def test_course_scene_is_set_as_the_course_does():
    scene = scenes.course()
    assert scene.preset == "course"
    assert scene.face_count == 4096
    camera, mesh = scene.camera, scene.meshes[0]
    assert camera.eye.tolist() == [-4.0, 4.0, 9.0]
    assert (camera.focal, camera.plane, camera.resolution) == (70.0, (15.0, 15.0), (512, 512))
    assert [light.position.tolist() for light in scene.lights] == [[0, 0, 5], [-7, 0, 0], [0, 5, 0]]
    assert scene.lights[2].intensity.tolist() == [0.937, 0.753, 0.492]
    assert scene.ambient.tolist() == [0.2, 0.2, 0.2]
    assert scene.background.tolist() == [1.0, 1.0, 1.0]
    material = mesh.material
    assert [material.ka[0], material.kd[0], material.ks[0], material.n] == [0.1, 0.8, 1.0, 1.0]
    assert material.texture.lookup == "course"
    assert mesh.normals is None
    assert len(mesh.colors) == len(mesh.verts)
    assert mesh.uvs.min() >= 0.0
    assert mesh.uvs.max() <= 1.0
    assert (mesh.uv_faces != mesh.faces).any()


def test_course_object_fills_the_frame_well():
    alpha = oracle.render(scenes.course(4, resolution=(64, 64)), Settings.from_preset("course")).alpha
    columns = np.flatnonzero(alpha.any(axis=0))
    assert columns[0] > 0
    assert columns[-1] < 63
    assert np.ptp(columns) > 0.75 * 64
