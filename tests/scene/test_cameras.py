"""Cameras: fitted to what they show, moved by angles, as named views, as K and pose, in pairs."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_writers import triangle
from scene_files import ends_in_image, same

import clshade
from clshade import Camera, Mesh, Scene
from clshade.errors import InputError
from clshade.farm import orbit, parse_frames
from clshade.scene import geometry
from clshade.scene.adjust_camera import VIEWS, adjusted, camera_of, named_cameras, refitted, towards_eye, up_of
from clshade.scene.builtin.scenes import builtin
from clshade.scene.framing import FILL, UPS, default_camera, fitted
from clshade.scene.geometry import camera_axes, camera_matrices
from clshade.scene.ground import with_ground

# Fitted cameras

VERTS = np.random.default_rng(5).normal(size=(60, 3)) * (3.0, 1.0, 0.5) + (7.0, -2.0, 4.0)
FACES = np.arange(60).reshape(20, 3)
MESH = Mesh(VERTS, FACES)
SKEW = Camera.from_fov((3, 5, 9), (1, 0, 2), (0.2, 1, 0.1), 50.0)


@pytest.mark.parametrize("resolution", [(800, 600), (100, 700), (700, 100), (1, 1)])
@pytest.mark.parametrize("orthographic", [False, True])
def test_the_vertices_fill_the_image_and_are_centered(resolution, orthographic):
    for camera in (SKEW.with_resolution(resolution), default_camera((MESH,), "z", resolution)):
        view = adjusted(camera, fit=(MESH,), orthographic=orthographic)
        low, high = ends_in_image(view, [MESH])
        assert high.max() == pytest.approx(FILL, rel=1e-9)
        assert low == pytest.approx(-high, abs=0.01)
        assert np.allclose(camera_axes(camera), camera_axes(view), atol=1e-12)
        assert view.orthographic is orthographic


def test_every_instance_counts_and_no_vertex_without_a_face():
    placements = np.stack([np.eye(4)] * 3)
    placements[1, :3, 3], placements[2, :3, :3] = (20.0, 5.0, -3.0), np.diag((-1.0, 2.0, 0.1))
    stray = Mesh(np.vstack([VERTS, [[9.0, 9.0, -9.0]]]), FACES, instances=placements)
    meshes = (stray, Mesh(VERTS - 30.0, FACES))
    low, high = ends_in_image(fitted(SKEW, meshes), meshes)
    assert (high.max(), *low) == pytest.approx((FILL, *-high), abs=0.01)


@pytest.mark.sampled
@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("resolution", [(80, 60), (60, 80)])
def test_a_turntable_cuts_nothing_and_wastes_nothing(orthographic, resolution):
    camera = adjusted(SKEW.with_resolution(resolution), fit=(MESH,), turning=True, orthographic=orthographic)
    assert camera.lookat == pytest.approx((VERTS.min(axis=0) + VERTS.max(axis=0)) / 2.0)
    turn = parse_frames("1..360")
    ends = [np.abs(ends_in_image(view, [MESH])).max() for view in orbit(camera, turn.numbers, turn).values()]
    assert FILL * 0.999 < max(ends) <= FILL * (1.0 + 1e-9)


@pytest.mark.parametrize("scale", [1e-300, 1e-30, 1e30, 1e150, 1e300])
def test_any_scale(scale):
    view = fitted(SKEW, (Mesh((VERTS - VERTS.mean(axis=0)) * scale, FACES),))
    one = fitted(SKEW, (Mesh(VERTS - VERTS.mean(axis=0), FACES),))
    assert view.eye / scale == pytest.approx(one.eye, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    "verts",
    [
        [(5, 5, 5)] * 3,
        [(0, 0, 0)] * 3,
        [(1e9, 0, 0)] * 3,
        [(0, 0, 0), (1, 0, 0), (2, 0, 0)],
        SKEW.eye + np.outer((0.0, 1.0, 50.0), SKEW.lookat - SKEW.eye),  # a needle that points at the eye
        [(0, 0, 0), (1, 0, 0), (0, 1, 0)],
    ],
)
def test_points_lines_and_triangles(verts):
    for options in ({}, {"turning": True}, {"orthographic": True}, {"orthographic": True, "turning": True}):
        mesh = Mesh(np.array(verts, float), [(0, 1, 2)])
        view = adjusted(SKEW, fit=(mesh,), **options)
        assert np.abs(ends_in_image(view, [mesh])).max() < FILL * (1.0 + 1e-6)


def test_what_overflows_is_refused_and_a_scene_without_extent_is_not():
    with pytest.raises(InputError, match="Camera: eye"):
        fitted(adjusted(SKEW, view_angle=1.0), (Mesh([(1e308, 0, 0), (-1e308, 0, 0), (0, 1e308, 0)], [(0, 1, 2)]),))
    large = np.diag((10.0, 10.0, 10.0, 1.0))
    with pytest.raises(InputError, match="overflow"):
        fitted(SKEW, (Mesh([(1e308, 0, 0), (0, 0, 0), (0, 1, 0)], [(0, 1, 2)], instances=[large]),))
    assert np.isfinite(fitted(SKEW, ()).eye).all()
    for meshes in ((), Mesh(np.zeros((1, 3)), np.zeros((0, 3), int)), Mesh(np.ones((3, 3)), [[0, 1, 2]])):
        assert np.isfinite(Scene(meshes).camera.eye).all()


def test_a_fitted_camera_is_fitted_again_unless_it_is_placed():
    scene = refitted(Scene((MESH,), SKEW))
    assert scene.fitted
    assert not Scene((MESH,), SKEW).fitted
    turned = camera_of(scene, {"azimuth": 70.0})
    assert ends_in_image(turned, [MESH])[1].max() == pytest.approx(FILL, rel=1e-9)
    assert camera_of(scene, {"azimuth": 0.0, "position": None}).eye.tolist() == scene.camera.eye.tolist()
    zoomed = camera_of(scene, {"view_angle": 10.0})
    assert zoomed.eye.tolist() == scene.camera.eye.tolist()
    zoomed = camera_of(scene, {"view_angle": 10.0}, fit=True)
    assert ends_in_image(zoomed, [MESH])[1].max() == pytest.approx(FILL, rel=1e-9)
    both = {"position": (0.0, 0.0, 50.0), "focal_point": (1.0, 2.0, 3.0)}
    assert camera_of(scene, both, fit=True).eye.tolist() == [0.0, 0.0, 50.0]
    fixed = replace(scene, fitted=False)
    assert camera_of(fixed, {"azimuth": 70.0}).eye == pytest.approx(adjusted(fixed.camera, azimuth=70.0).eye)
    scene = refitted(Scene((MESH,), replace(SKEW, up=(0.1, -0.2, -1.0))), (70, 50))  # what was up stays up
    assert (scene.camera.up.tolist(), scene.camera.resolution) == ([0.0, 0.0, -1.0], (70, 50))
    assert refitted(with_ground(scene)).camera.eye.tolist() == scene.camera.eye.tolist()


def test_fit_ignores_the_camera_of_a_file(tmp_path):
    document = triangle({"mesh": 0})
    document.add("nodes", {"camera": 0, "translation": [50, 2, 9]})
    document.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.1}})
    path = document.glb(tmp_path / "a.glb")
    assert not clshade.load(path).fitted
    scene = clshade.load(path, fit=True)
    assert scene.fitted
    assert ends_in_image(scene.camera, scene.meshes)[1].max() == pytest.approx(FILL, rel=1e-6)


def test_scenes_without_a_camera_get_the_one_of_files():
    teapot = clshade.builtin("teapot").meshes
    scene = Scene(teapot)
    assert scene.fitted
    assert same(scene.camera, default_camera(teapot))
    assert Scene(teapot, scene.camera).fitted is False
    assert same(Scene(teapot, None).camera, scene.camera)
    assert replace(scene, name="a").fitted


# Named views

NAMED = VIEWS[:-1]


def box(size, up=(0.0, 1.0, 0.0), resolution=(80, 60)):
    """Return a scene with two triangles that span a box of this size about (10, 20, 30)."""
    half = np.array(size, np.float64) / 2.0
    verts = np.array([10.0, 20.0, 30.0]) + half * [(-1, -1, -1), (1, -1, -1), (1, 1, 1), (-1, 1, 1)]
    camera = Camera.from_fov((13.0, 25.0, 49.0), (10.0, 20.0, 30.0), up, 35.0, resolution)
    return Scene(Mesh(verts, [(0, 1, 2), (0, 2, 3)]), camera)


@pytest.mark.parametrize(
    ("up", "eyes"),
    [
        ((0.1, 1.0, 0.2), ("+z", "-z", "-x", "+x", "+y", "-y", "+x +y +z")),
        ((0.0, 0.1, 1.0), ("-y", "+y", "-x", "+x", "+z", "-z", "+x -y +z")),
        ((0.0, -1.0, 0.1), ("+z", "-z", "+x", "-x", "-y", "+y", "-x -y +z")),
    ],
)
def test_where_the_eye_is(up, eyes):
    cameras = named_cameras(box((2.0, 3.0, 4.0), up), NAMED)
    assert tuple(map(towards_eye, cameras.values())) == eyes
    assert all(camera.orthographic and (camera.lookat == (10, 20, 30)).all() for camera in cameras.values())
    upward = camera_axes(cameras["front"])[1]
    assert upward.round(12).tolist() == np.sign(np.round(up)).tolist()
    assert up_of(Camera.from_fov((5, 6, 7), [0] * 3, upward, 30)) == "-" * (min(up) < 0) + "xyz"[np.argmax(np.abs(up))]


@pytest.mark.parametrize("size", [(2, 3, 4), (100, 1, 0.01), (0, 5, 0), (0, 0, 0), (1e-30, 1e-30, 0)])
@pytest.mark.parametrize("resolution", [(80, 60), (60, 80), (512, 1)])
def test_the_whole_scene_fits_at_one_scale(size, resolution):
    scene = box(size, resolution=resolution)
    cameras = named_cameras(scene, NAMED)
    assert len({camera.plane for camera in cameras.values()}) == 1
    low, high = geometry.bounding_box(scene)
    fill = 0.0
    for camera in cameras.values():
        half = np.abs(camera_axes(camera)[:2] @ (scene.meshes[0].verts - camera.lookat).T).max(axis=1)
        assert (half <= np.array(camera.plane[::-1]) / 2.0).all()
        fill = max(fill, *(2.0 * half / camera.plane[::-1]))
        assert np.linalg.norm(camera.eye - camera.lookat) > np.linalg.norm(high - low) / 2.0
    assert fill == pytest.approx(FILL if (high > low).any() else 0.0)


# Moved by angles


FRONT = Camera([0.0, 0.0, 5.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0, (1.0, 1.0), (100, 50))


@pytest.mark.parametrize("elevation", [30.0, 90.0, -90.0, 120.0, -135.0, 180.0, 270.0, 400.0, -1e9])
@pytest.mark.parametrize("azimuth", [0.0, 50.0])
def test_elevation_turns_the_camera_over_the_poles(elevation, azimuth):
    """The camera as a whole turns about the axis to its right, then about the scene's vertical, which stays its `up`."""
    camera = adjusted(FRONT, elevation=elevation, azimuth=azimuth)
    up, round_ = np.radians(elevation), np.radians(azimuth)
    turn = np.array([[np.cos(round_), 0, np.sin(round_)], [0, 1, 0], [-np.sin(round_), 0, np.cos(round_)]])
    turn = turn @ [[1, 0, 0], [0, np.cos(up), np.sin(up)], [0, -np.sin(up), np.cos(up)]]
    assert np.allclose(camera.eye, turn @ FRONT.eye, atol=1e-6)
    assert np.allclose(camera_axes(camera), np.array(camera_axes(FRONT)) @ turn.T, atol=1e-6)
    assert np.allclose(np.abs(camera.up), [0.0, 1.0, 0.0], atol=2e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("up", UPS)
def test_a_camera_above_or_below_what_it_looks_at_sees_the_view_of_that_name(capsys, up, sign):
    """Its `up` stays the scene's, so that it goes round the scene's vertical."""
    above = np.array(UPS[up][1], float) * sign
    front = replace(FRONT, eye=np.array(UPS[up][2]) * 5.0, up=UPS[up][1])
    camera = adjusted(front, position=above * 3.0)
    view = named_cameras(replace(builtin("icosphere"), camera=front), ["top" if sign > 0 else "bottom"])
    assert np.allclose(camera_axes(camera), camera_axes(*view.values()), atol=1e-9)
    assert up_of(camera) == up
    upward = ",".join(f"{axis + 0.0:g}" for axis in np.array(camera_axes(camera)[1]).round())
    assert f"its up vector: {upward} is up in the image" in capsys.readouterr().err
    quarter = adjusted(camera, azimuth=90.0)
    assert np.allclose(quarter.eye, camera.eye, atol=1e-5)
    turned = np.cross(above * sign, camera_axes(camera)[0])
    assert np.allclose(camera_axes(quarter)[0], turned, atol=1e-5)
    with pytest.raises(InputError, match="a vector not parallel to lookat - eye"):
        adjusted(front, position=above * 3.0, up=above)


def test_other_changes_of_a_camera():
    """A view angle makes square pixels; an orthographic camera keeps the size at the focal point."""
    assert np.linalg.norm(adjusted(FRONT, azimuth=33, elevation=-20).eye) == pytest.approx(5.0, rel=1e-14)
    wide = adjusted(FRONT, view_angle=90)
    assert (wide.plane[0] / wide.focal, wide.plane[1] / wide.plane[0]) == pytest.approx((2.0, 2.0))
    flat = adjusted(FRONT, orthographic=True)
    assert (flat.orthographic, flat.plane) == (True, (5.0, 5.0))
    placed = adjusted(FRONT, position=[1, 2, 3], focal_point=[1, 2, 0], up=[1, 0, 0])
    assert [vector.tolist() for vector in (placed.eye, placed.lookat, placed.up)] == [[1, 2, 3], [1, 2, 0], [1, 0, 0]]


# Matrices and poses

SIZE = (640, 480)
K = np.array([[612.5, 0.0, 301.25], [0.0, 598.75, 260.5], [0.0, 0.0, 1.0]])
FLIP = {"opencv": np.diag([1.0, 1.0, 1.0]), "opengl": np.diag([1.0, -1.0, -1.0])}
EVERY = [(convention, center) for convention in FLIP for center in (0.5, 0.0)]


def rigid(seed: int, offset: float = 3.0) -> np.ndarray:
    """Return a random rotation and a translation (4, 4)."""
    rng = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = rotation * np.linalg.det(rotation)
    pose[:3, 3] = rng.uniform(-offset, offset, 3)
    return pose


def in_front_of(pose: np.ndarray, convention: str = "opencv") -> np.ndarray:
    """Return 100 points in front of an OpenCV or OpenGL pose, world space."""
    rng = np.random.default_rng(5)
    points = rng.uniform((-3, -2, 2), (3, 2, 20), (100, 3))
    return points @ (pose[:3, :3] @ FLIP[convention]).T + pose[:3, 3]


def projected(matrix: np.ndarray, pose: np.ndarray, points: np.ndarray, convention: str = "opencv") -> np.ndarray:
    """Return columns and rows (P, 2) by the textbook's formula."""
    local = (points - pose[:3, 3]) @ (pose[:3, :3] @ FLIP[convention])
    return (local / local[:, 2:]) @ matrix[:2].T


def drawn_at(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Return columns and rows (P, 2) of points where the camera draws them, the first pixel's center at 0.5."""
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ camera_matrices(camera)[1]
    return homogeneous[:, :2] / homogeneous[:, 3:] * camera.resolution


@pytest.mark.parametrize(("convention", "center"), EVERY)
def test_a_matrix_and_a_pose_come_back(convention, center):
    for seed in range(5):
        pose = rigid(seed)
        camera = Camera.from_matrix(K, pose, SIZE, pixel_center=center, convention=convention)
        matrix, back = camera.to_matrix(pixel_center=center, convention=convention)
        # A few roundings of the largest entries, 1000 and 10.
        np.testing.assert_allclose(matrix, K, rtol=0, atol=1e-12)
        np.testing.assert_allclose(back, pose, rtol=0, atol=1e-14)
        points = in_front_of(pose, convention)
        where = drawn_at(camera, points) - (0.5 - center)
        assert np.abs(projected(matrix, back, points, convention) - where).max() < 1e-9


@pytest.mark.parametrize("center", [0.5, 0.0])
def test_opencv_projects_points_where_they_are_drawn(center):
    """Far from the origin too, as in geographic coordinates: 16 roundings of 1e6 in float64, times fx/z < 500 px, are less
    than 1e-6 px."""
    cv2 = pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    for seed, offset in ((1, 3.0), (2, 1e6)):
        pose = rigid(seed, offset)
        camera = Camera.from_matrix(K, pose, SIZE, pixel_center=center)
        matrix, back = camera.to_matrix(pixel_center=center)
        points = in_front_of(pose)
        to_camera = np.linalg.inv(back)
        # OpenCV adds R p and t, which cancel far away; it is given points relative to the eye.
        turn, _ = cv2.Rodrigues(to_camera[:3, :3])
        pixels, _ = cv2.projectPoints(points - back[:3, 3], turn, np.zeros(3), matrix, None)
        assert np.abs(pixels[:, 0] - projected(K, pose, points)).max() < 1e-6
        assert np.abs(pixels[:, 0] - (drawn_at(camera, points) - (0.5 - center))).max() < 1e-6


def test_cameras_of_many_matrices():
    poses = np.stack([rigid(seed) for seed in range(3)])
    shared = Camera.from_matrices(K, poses[:, :3], SIZE)
    separate = Camera.from_matrices([K, 2 * K / [[1], [1], [2]], K], poses.tolist(), SIZE, convention="opengl")
    assert [len(cameras) for cameras in (shared, separate)] == [3, 3]
    for k, pose in enumerate(poses):
        np.testing.assert_allclose(shared[k].to_matrix()[1], pose, rtol=0, atol=1e-14)
        np.testing.assert_allclose(separate[k].pose("opengl"), pose, rtol=0, atol=1e-14)
    assert separate[1].to_matrix()[0][0, 0] == pytest.approx(2 * K[0, 0], rel=1e-15)
    assert Camera.from_matrices(K, np.empty((0, 4, 4)), SIZE) == ()


@pytest.mark.parametrize("convergence", [None, 6.0])
def test_the_disparity_of_a_pair(convergence):
    """f b (1/Z - 1/convergence) along rows, and nothing along columns."""
    pose, baseline = rigid(3), 0.12
    camera = Camera.from_matrix(K, pose, SIZE)
    left, right = camera.stereo(baseline, convergence)
    points = in_front_of(pose)
    depth = ((points - pose[:3, 3]) @ pose[:3, :3])[:, 2]
    apart = drawn_at(left, points) - drawn_at(right, points)
    expected = K[0, 0] * baseline * (1 / depth - (0 if convergence is None else 1 / convergence))
    assert np.abs(apart[:, 0] - expected).max() < 1e-9
    assert np.abs(apart[:, 1]).max() < 1e-9
    np.testing.assert_allclose((left.eye + right.eye) / 2, camera.eye, rtol=0, atol=1e-14)
    np.testing.assert_allclose(right.eye - left.eye, baseline * pose[:3, 0], rtol=0, atol=1e-14)
    (matrix, _), (right_matrix, _) = left.to_matrix(), right.to_matrix()
    middle = (matrix + right_matrix) / 2
    np.testing.assert_allclose(middle, K, rtol=0, atol=1e-10)
    assert (abs(right_matrix[0, 2] - matrix[0, 2]) > 1) == (convergence is not None)
