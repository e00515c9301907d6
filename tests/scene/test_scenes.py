"""The built-in scenes: counts, orientation, closed surfaces, options, determinism."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from surfaces import border, euler, face_normals, mesh_of, volume, welded

from clshade import oracle
from clshade.errors import InputError
from clshade.scene.builtin import scenes
from clshade.scene.model import MAX_FACES, Scene, Settings

SMALL = {"resolution": (64, 48)}
FIELDS = ("verts", "faces", "colors", "normals", "normal_faces", "uvs", "uv_faces", "instances")


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
        assert (np.abs(direction).max(axis=1) > 0.0).all(), mesh.name  # no degenerate face
        if mesh.normals is None:
            continue
        length = np.sqrt((mesh.normals.astype(np.float64) ** 2).sum(axis=1))
        tolerance = 4.0 * np.finfo(mesh.normals.dtype).eps  # rounding of three squares, a sum and a root, or of storage
        assert np.abs(length - 1.0).max() <= tolerance, mesh.name
        corners = mesh.normals[mesh.faces if mesh.normal_faces is None else mesh.normal_faces]
        assert (np.einsum("fc,fkc->fk", direction, corners) > 0.0).all(), mesh.name


@pytest.mark.parametrize(
    ("name", "options", "words"),
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
def test_bad_options_are_refused_by_name(name, options, words):
    with pytest.raises(InputError, match=words) as caught:
        scenes.builtin(name, **options)
    assert "\n" not in str(caught.value)


# The torus knot


@pytest.mark.sampled
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
    """Pappus: cross section times the length of the center curve."""
    scene = scenes.torus_knot(400_000)
    mesh = scene.meshes[0]
    angle = np.linspace(0.0, 2.0 * np.pi, 20_001)
    ring = 2.0 * (1.0 + 0.5 * np.cos(3.0 * angle))
    speed = np.sqrt(ring**2 + (0.5 * 3.0) ** 2)
    length = float(((speed[1:] + speed[:-1]) / 2.0).sum() * angle[1])
    radius = 0.26
    assert math.isclose(volume(mesh.verts, mesh.faces), math.pi * radius**2 * length, rel_tol=1e-3)


def test_a_million_triangles_take_less_than_a_second():
    start = time.process_time()  # of this process, as others may be busy
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
    color = oracle.render(scene, Settings()).rgb[16, 16]
    # The point nearest to the eye is a vertex or an edge midpoint, whose normal points to eye and light.
    assert np.allclose(color, expected, rtol=1e-9)


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


def test_the_lamp_of_the_soft_room_lights_it():
    scene = scenes.box_room(2, resolution=(40, 30), soft=True)
    light, fill = scene.lights
    lamp = mesh_of(scene, "lamp").verts
    assert (np.cross(light.right, light.up) < 0.0).tolist() == [False, True, False]  # it shines down
    assert light.position[1] < lamp[:, 1].min()
    corners = light.position + [[x, 0.0, z] for x in (-0.4, 0.4) for z in (-0.3, 0.3)]
    assert np.allclose(np.sort(corners[:, [0, 2]], axis=0), np.sort(lamp[:, [0, 2]], axis=0))
    assert (fill.position == scene.camera.eye).all()
    for value in (1, None, "yes"):
        with pytest.raises(InputError, match="box_room: soft: expected"):
            scenes.box_room(soft=value)


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
