"""Whole frames of the oracle against closed forms, and the comparisons against planted errors."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import oracle_asserts
import pytest

from clshade import oracle
from clshade.oracle import frame as oracle_frame
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, PointLight, Scene, Settings, Texture
from clshade.scene.settings import PRESETS

# Seen from (0, 0, 4) with focal = plane the image spans x, y in [-2, 2] at z = 0: a pixel is 1/8 unit wide.
CAMERA = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (32, 32))
LIGHT = PointLight((1.0, 2.0, 3.0), (1.0, 0.5, 0.25))
QUAD = [[0, 1, 2], [0, 2, 3]]
QUAD_UVS = np.array([[0.0, 0.0], [1, 0], [1, 1], [0, 1]])


def close(actual, expected, rtol=1e-12, atol=1e-12) -> bool:
    return np.allclose(actual, expected, rtol=rtol, atol=atol)


def quad(half: float = 1.0, z: float = 0.0, **fields) -> Mesh:
    """Return a square facing the camera, counter-clockwise, lower-left corner first."""
    return Mesh(np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]), QUAD, **fields)


def draw(*meshes: Mesh, preset: str = "standard", camera: Camera = CAMERA, lights=(LIGHT,), sky=0.3, **fields):
    return oracle.render(Scene(meshes, camera, lights, sky, preset=preset), Settings.from_preset(preset, **fields))


@pytest.mark.parametrize("far", [1e4, 1e10, 1e38, 1e200])
def test_triangle_far_beyond_the_screen_covers_all_of_it(far):
    """Beyond float32 its depth has few digits, but the square in front of it is intact."""
    frame = draw(Mesh(np.array([[-far, -far, 0], [far, -far, 0], [0, far, 0]]), [[0, 1, 2]]), quad(z=1.0), near=0.1)
    assert (frame.id[10:22, 10:22] >= 2).all()
    assert np.isfinite(frame.rgb).all()
    if far < 1e38:
        assert (frame.id[[0, -1]] == 1).all()
        assert close(frame.Z[frame.id == 1], 4, rtol=1e-12)


def test_floor_through_the_eye_plane():
    """A floor at y = -1 that reaches far behind the eye: depth 1/tan(angle below the horizon), nothing above it."""
    camera = Camera((0, 0, 0), (0, 0, -1), (0, 1, 0), 1.0, (1.0, 1.0), (32, 32))
    frame = draw(Mesh(np.array([[-900.0, -1, 90], [900, -1, 90], [0, -1, -900]]), [[0, 1, 2]]), camera=camera, near=0.5)
    below = (np.arange(16, 32) - 15.5) / 32  # of rows 16 to 31 from the top, at distance 1
    assert not frame.id[:16].any()
    assert (frame.id[16:, 14:18] == 1).all()
    # Snapping moves the ends of edges, and the depth with them, by up to 1/131072 px of the 1/2 px to the horizon.
    assert close(frame.Z[16:, 16], 1 / below, rtol=1 / 65536)
    assert np.isfinite(frame.rgb).all()


def pixel_position(row: int, column: int) -> np.ndarray:
    """Return the intersection of a pixel's ray of CAMERA with the plane z = 0."""
    return np.array([(column - 15.5) / 8, (15.5 - row) / 8, 0.0])


def phong(point, normal, ka=0.1, kd=0.8, ks=0.5, n=20.0, ambient=0.3):
    """Evaluate the reflection model independently, for one white point, in plain vectors."""
    to_light, to_eye = (v / math.hypot(*v) for v in (LIGHT.position - point, CAMERA.eye - point))
    n_l = normal @ to_light
    r_v = (2 * normal * n_l - to_light) @ to_eye
    return ka * ambient + LIGHT.intensity * (kd * max(0, n_l) + (ks * r_v**n if n_l > 0 and r_v > 0 else 0))


UP = np.array([0.0, 0, 1])


def test_standard_phong_pixels():
    frame = draw(quad())
    assert frame.id[7, 16] == 0
    assert sorted(np.unique(frame.id)) == [0, 1, 2]
    assert frame.alpha.sum() == 16 * 16
    assert np.array_equal(frame.Z, np.where(frame.id > 0, 4, np.inf))
    for at in ((8, 8), (8, 23), (23, 8), (13, 20)):
        assert close(frame.rgb[at], phong(pixel_position(*at), UP), rtol=1e-12)


def test_course_lights_once_per_triangle():
    corners = quad().verts[quad().faces]
    frame = draw(quad(), preset="course")
    for at in ((8, 9), (22, 20)):
        assert close(frame.rgb[at], phong(corners[frame.id[at] - 1].mean(axis=0), UP), rtol=1e-12)
    assert len(np.unique(frame.rgb[frame.id == 1], axis=0)) <= 3  # one color, to rounding
    assert close(draw(quad(), preset="course", shader="gouraud").rgb, frame.rgb, rtol=1e-12)  # flat: the same


def test_gouraud_interpolates_the_corners():
    triangle = Mesh(np.array([[-1.0, -1, 0], [1, -1, 0], [-1, 1, 0]]), [[0, 1, 2]])
    frame = draw(triangle, shader="gouraud", interpolation="affine")
    point = pixel_position(20, 12)
    a, b, c = (phong(p, UP) for p in triangle.verts)
    s, t = (point[0] + 1) / 2, (point[1] + 1) / 2
    assert close(frame.rgb[20, 12], a + s * (b - a) + t * (c - a), rtol=1e-12)


def test_interpolation_on_a_slanted_quad():
    """Color 0 at depth 2 and 1 at depth 6: halfway in the image, perspective gives 1/4, affine 1/2."""
    verts = np.array([[-1.0, -1, 2], [3, -3, -2], [3, 3, -2], [-1, 1, 2]])  # its sides are at u = 0 and u = 32
    mesh = Mesh(verts, QUAD, colors=np.array([[0.0] * 3, [1] * 3, [1] * 3, [0] * 3]))
    middle = {how: draw(mesh, shader="nolight", interpolation=how).rgb[16] for how in ("affine", "perspective")}
    u = (np.arange(32) + 0.5) / 32
    assert close(middle["affine"][:, 0], u, atol=1e-12)
    assert close(middle["perspective"][:, 0], u / 6 / (u / 6 + (1 - u) / 2), atol=1e-12)
    assert close(draw(mesh, shader="nolight").Z[16], 1 / (u / 6 + (1 - u) / 2), rtol=1e-12)


def test_visibility():
    near, far = quad(0.5, z=1.0), quad(1.0, z=-1.0)
    for preset in PRESETS:
        for meshes in ((near, far), (far, near)):
            frame = draw(*meshes, preset=preset)
            assert (frame.Z[14:18, 14:18] == 3).all()
            assert (frame.Z[9, 16], frame.id.max()) == (np.inf, 4)
        assert set(np.unique(draw(quad(), quad(), preset=preset).id)) == {0, 3, 4}  # equal: the later face
    # Painter's order uses the mean: the slanted triangle's (12/3) is behind the flat one's, although it protrudes.
    slanted = Mesh(np.array([[-1.0, -1, 2], [1, -1, -2], [0, 1, -1]]), [[0, 1, 2]])
    flat = Mesh(np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]), [[0, 1, 2]])
    seen = {v: draw(slanted, flat, visibility=v).id for v in ("painter", "depth")}
    both = draw(slanted).alpha * draw(flat).alpha > 0
    assert set(seen["painter"][both]) == {2}
    assert set(seen["depth"][both]) == {1, 2}


def test_clipped_pieces_keep_the_painters_depth():
    """Depths 6, 6 and -9: the mean 1 is in front of the square at 2, that of the clipped piece is not."""
    straddling = Mesh(np.array([[-3.0, -1, -2], [3, -1, -2], [0, -1, 13]]), [[0, 1, 2]])
    frame = draw(straddling, quad(2.0, z=2.0), visibility="painter")
    alone = draw(straddling)
    assert (frame.id[alone.id > 0] == 1).all()
    assert (alone.id > 0).sum() > 100


def test_culling_and_winding():
    back = replace(quad(), faces=np.array(QUAD)[:, ::-1])
    pictures = draw(quad(), cull=True), draw(back, cull=True), draw(back)
    assert [frame.alpha.sum() for frame in pictures] == [256, 0, 256]


def test_orientation_and_faces_of_instances():
    move = np.tile(np.eye(4), (2, 1, 1))
    move[0, :2, 3], move[1, :2, 3] = (-1, 1), (1, -1)
    mesh = quad(0.5, colors=np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]), instances=move)
    frame = draw(quad(0.25), mesh, shader="nolight")
    assert np.isin(frame.id[4:12, 4:12], (3, 4)).all()  # up and left: the first instance
    assert (frame.id[20:28, 20:28] >= 5).all()
    # Red is bottom left, green bottom right, blue top right.
    assert [frame.rgb[at].argmax() for at in ((11, 4), (11, 11), (4, 11))] == [0, 1, 2]
    assert frame.rgb[4, 4].min() > 0.8


def test_given_normals_are_used_except_by_course_scenes():
    tilted = np.array([[0.6, 0, 0.8]])
    mesh = quad(normals=3 * tilted, normal_faces=np.zeros((2, 3), int))
    assert close(draw(mesh).rgb[10, 10], phong(pixel_position(10, 10), tilted[0]), rtol=1e-12)
    assert np.array_equal(draw(mesh, preset="course").rgb, draw(quad(), preset="course").rgb)


def test_background_and_empty_scenes():
    scene = Scene((), CAMERA, background=(0.25, 0.5, 2.0))
    for preset in PRESETS:
        frame = oracle.render(scene, Settings.from_preset(preset))
        assert (frame.rgb == [0.25, 0.5, 2.0]).all()
        assert not frame.id.any()
    assert not oracle.render(replace(scene, background=None), Settings()).rgb.any()


def test_textured_light():
    """Ambient `plain` is not multiplied by the texel, everything else is; course lookups replace the vertex color."""
    image = np.array([[[0.0, 0.25, 0.5], [1, 0.75, 0.5]]], np.float32)
    u = (np.arange(16) + 0.5) / 16
    for lookup in ("standard", "course"):
        material = Material(texture=Texture(image, "clamp", lookup))
        mesh = quad(uvs=QUAD_UVS, material=material, colors=np.full((4, 3), 0.5))
        share = np.clip(2 * u - 0.5, 0, 1) if lookup == "standard" else u
        color = (image[0, 0] + share[:, None] * (image[0, 1] - image[0, 0])) * (0.5 if lookup == "standard" else 1.0)
        fields = {"interpolation": "affine", "lighting_at": "position"}
        assert close(draw(mesh, shader="nolight").rgb[16, 8:24], color, atol=1e-7)
        for ambient, shader in product(("plain", "tinted"), ("phong", "gouraud")):
            base = 0.1 * 0.3 if ambient == "plain" else 0.0
            white, drawn = (draw(one, shader=shader, ambient=ambient, **fields).rgb[16, 8:24] for one in (quad(), mesh))
            assert close(drawn, base + (white - base) * color, atol=1e-7), (lookup, ambient, shader)
        at_corners = draw(mesh, shader="nolight", texture_at="vertex", preset="course").rgb[16, 8:24]
        ends = image[0, 0], image[0, 1]
        expected = (ends[0] + u[:, None] * (ends[1] - ends[0])) * (0.5 if lookup == "standard" else 1.0)
        assert close(at_corners, expected, atol=1e-7)


def test_texture_rows_go_up_with_v():
    image = np.zeros((2, 2, 3), np.float32)
    image[0, 1] = 1.0  # v = 0, u = 1: the lower right corner of the quad
    frame = draw(quad(uvs=QUAD_UVS, material=Material(texture=Texture(image))), shader="nolight")
    assert frame.rgb[19, 19, 0] == pytest.approx(frame.rgb[19:21, 19:21].max())
    assert max(frame.rgb[11, 19, 0], frame.rgb[19, 11, 0]) < 0.2
    broken = quad(uvs=np.full((4, 2), np.nan), material=Material(texture=Texture(image, "clamp", "course")))
    assert (draw(broken, shader="nolight").rgb[12:20, 12:20] == image[0, 0]).all()


@pytest.fixture(scope="module", params=PRESETS)
def case(request):
    """Return a frame, its scene and settings: triangles of all sizes around the origin, some of them behind the eye."""
    rng = np.random.default_rng(6)
    middles, corners = rng.normal(size=(400, 1, 3)) * [1, 1, 2], rng.normal(size=(400, 3, 3))
    verts = np.round((middles + corners * rng.uniform(0.05, 1, (400, 1, 1))) * 64) / 64
    mesh = Mesh(verts.reshape(-1, 3), np.arange(1200).reshape(-1, 3), colors=rng.uniform(0, 1, (1200, 3)))
    scene, settings = Scene((mesh,), CAMERA, (LIGHT,), preset=request.param), Settings.from_preset(request.param)
    return oracle.render(scene, settings), scene, settings


def test_scale_and_offset_change_nothing(case):
    plain, scene, settings = case
    assert plain.alpha.mean() > 0.5
    (mesh,), camera = scene.meshes, scene.camera
    for scale, shift in ((1e-20, 0), (1e20, 0), (1, 1e6), (2.0**70, 0)):
        meshes = (replace(mesh, verts=mesh.verts * scale + shift),)
        moved = replace(camera, eye=camera.eye * scale + shift, lookat=camera.lookat * scale + shift)
        lights = (replace(LIGHT, position=LIGHT.position * scale + shift),)
        frame = oracle.render(replace(scene, meshes=meshes, camera=moved, lights=lights), settings)
        assert np.array_equal(frame.id, plain.id)
        assert close(frame.rgb, plain.rgb, rtol=0, atol=1e-9)
    assert np.array_equal(frame.rgb, plain.rgb)  # a power of two: the same bits


def test_pixels_parts_and_depth_at_agree_with_render(case, monkeypatch):
    frame, scene, settings = case
    rows, columns = np.indices(frame.id.shape)
    depths = oracle.depth_at(scene, settings, frame.id.ravel().astype(int) - 1, rows.ravel(), columns.ravel())
    assert np.array_equal(depths.reshape(frame.Z.shape), frame.Z)
    assert np.array_equal(oracle.render(scene, settings, rows[5:9, 3], columns[5:9, 3]).rgb, frame.rgb[5:9, 3])
    monkeypatch.setattr(oracle_frame, "MAX_SAMPLES", 300)
    for name, values in vars(oracle.render(scene, settings)).items():
        assert np.array_equal(values, getattr(frame, name)), name
    if settings.visibility == "depth":  # no face is nearer anywhere
        for face in range(0, 400, 40):
            assert (oracle.depth_at(scene, settings, face, rows.ravel(), columns.ravel()) >= frame.Z.ravel()).all()


class Rounded:
    """An oracle frame with the types of a rendered one."""

    def __init__(self, frame: oracle.OracleFrame) -> None:
        self.rgb, self.alpha = frame.rgb.astype(np.float32), frame.alpha.astype(np.float32)
        self.layers = {"id": frame.id.copy(), "Z": frame.Z.astype(np.float32)}

    def __getitem__(self, name: str) -> np.ndarray:
        return self.layers[name]


@pytest.mark.parametrize(
    ("message", "plant"),
    [
        ("rgb: expected", lambda f: setattr(f, "rgb", f.rgb.astype(np.float64))),
        ("id: expected", lambda f: f.layers.update(id=f.layers["id"].astype(np.int64))),
        ("rgb: not finite", lambda f: f.rgb.__setitem__((3, 4, 1), np.nan)),
        ("Z: NaN", lambda f: f.layers["Z"].__setitem__((3, 4), np.nan)),
        ("ids differ: 1 of", lambda f: f.layers["id"].__setitem__((16, 16), 401)),
        ("alpha differs: 1 of", lambda f: f.alpha.__setitem__((16, 16), 0.5)),
        ("depths off", lambda f: f.layers["Z"].__setitem__((16, 16), f.layers["Z"][16, 16] * (1 + 11.5 * 2**-24))),
        ("colors off", lambda f: f.rgb.__setitem__((16, 16, 2), f.rgb[16, 16, 2] + 0.01)),
    ],
)
def test_comparators_accept_rounding_and_find_planted_errors(case, message, plant):
    frame = Rounded(case[0])
    assert 0 < oracle_asserts.assert_frame(frame, *case).bounds <= 1  # one rounding of at most the budget
    plant(frame)
    with pytest.raises(AssertionError, match=message):
        oracle_asserts.assert_frame(frame, *case)


def test_gates_are_excepted_up_to_the_highlight_and_counted(case):
    expected, frame = case[0], Rounded(case[0])
    at = tuple(np.argwhere(expected.id > 0)[:3].T)
    frame.rgb[at] += 0.5 * expected.budget[at].astype(np.float32)
    jump = np.zeros_like(expected.jump)
    jump[at] = 0.5 * expected.budget[at]
    marked = replace(expected, jump=jump)
    oracle_asserts.assert_colors_within(frame.rgb, marked)
    with pytest.raises(AssertionError, match="too many"):
        oracle_asserts.assert_colors_within(frame.rgb, marked, gate_fraction=1e-6)
    with pytest.raises(AssertionError, match="colors off"):
        oracle_asserts.assert_colors_within(frame.rgb, expected)
    # Pixels covered beside their center are covered: three excepted ones of none would be too many.
    beside = replace(marked, id=np.zeros_like(expected.id))
    oracle_asserts.assert_colors_within(frame.rgb, beside, gate_fraction=1.0)
    with pytest.raises(AssertionError, match="too many"):
        oracle_asserts.assert_colors_within(frame.rgb, replace(beside, alpha=0 * beside.alpha), gate_fraction=1.0)


def test_measured_error_is_in_bounds():
    """An error of exactly eight bounds measures as eight, and kappa and the exponent widen the bound."""
    expected = draw(quad(material=Material(n=100.0)))
    bound = 10 * expected.kappa[..., None] * expected.budget * 2**-24
    rgb = (expected.rgb + np.where(expected.id[..., None] > 0, 8 * bound, 0)).astype(np.float32)
    assert oracle_asserts.assert_colors_within(rgb, expected) == pytest.approx(8, abs=0.1)
    with pytest.raises(AssertionError, match="colors off"):
        oracle_asserts.assert_colors_within(rgb, expected, factor=7)
