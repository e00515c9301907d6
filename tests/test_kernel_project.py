"""project.cl: snapped positions and depths are bit-identical to the float64 oracle's; vertices beyond limits are
marked."""

import numpy as np
import pytest
from kernel_stages import project
from view_cameras import CAMERAS, around, cameras

from clshade.oracle import coverage, transform
from clshade.pipeline import struct_layout
from clshade.pipeline.camera_space import CameraSpace, project_on_host
from clshade.scene import geometry
from clshade.scene.camera import Camera, raster_of

LOW, HIGH = struct_layout.GUARD_LOW, struct_layout.GUARD_HIGH


def oracle_of(points: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return the oracle's camera-space depths (V,) and image positions (V, 2)."""
    at = transform.to_camera(points, camera)
    with np.errstate(divide="ignore", invalid="ignore"):
        return at[:, 2], transform.project(at, camera)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("camera", cameras(), ids=CAMERAS)
def test_kernel_host_and_oracle_agree(device, camera, dtype):
    """Depths and snapped positions are the oracle's. 1/depth (in orthographic projection minus the depth) has 48 bits as
    double-single, each rounding at most 2^-24; positions are rounded once. Where a device has no float64 the host projects:
    no bit changes."""
    points = around(camera, dtype=dtype)
    distance = np.linalg.norm(camera.lookat - camera.eye)
    near, scale = 1e-3 * distance, 2.0 ** -np.ceil(np.log2(distance))
    made = project(device, points, camera, near, scale)
    vertices, relative = made.projected.array, made.relative.array
    depth, uv = oracle_of(points, camera)
    assert np.array_equal(vertices["depth"], depth)
    before = depth >= near
    inside = before[:, None] & (uv >= LOW) & (uv <= HIGH)
    assert 0.2 < before.mean() < 0.9
    assert inside.sum() > 1000
    snapped = np.stack([vertices["x"], vertices["y"]], axis=1)
    assert np.array_equal(snapped[inside], transform.snap(uv[inside]))
    beyond = before[:, None] & ~inside
    limit = np.where(uv > 0.0, struct_layout.SNAP_LIMIT, -struct_layout.SNAP_LIMIT)
    assert np.array_equal(snapped[beyond], limit[beyond])
    assert not snapped[~before].any()
    assert not vertices["w"][~before].any()
    w, low = (vertices[name][before].astype(np.float64) for name in ("w", "w_low"))
    exact = -depth[before] * scale if camera.orthographic else 1.0 / (depth[before] * scale)
    assert np.array_equal(w, exact.astype(np.float32))
    assert (np.abs(w + low - exact) <= 2.0**-48 * np.abs(exact)).all()
    assert np.array_equal(relative[:, :3], ((points - camera.eye) * scale).astype(np.float32))
    assert not relative[:, 3].any()
    by_host = np.empty(len(points), struct_layout.SINGLE.Vertex), np.empty((len(points), 4), np.float32)
    space = CameraSpace(camera, geometry.camera_axes(camera), near, scale, raster_of(camera))
    project_on_host(points, space, *by_host)
    assert [array.tobytes() for array in by_host] == [vertices.tobytes(), relative.tobytes()]


# Seen from (0, 0, 4) with focal = plane, a pixel is 1/8 unit wide at z = 0, where the image spans -2 to 2.
CAMERA = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (32, 32))


def test_guard_band_ends_exactly_at_its_limit(device):
    """At z = 0 pixel p is at x = (p - 16)/8: the limit itself is inside, one float64 step beyond it is not."""
    at = np.array([HIGH, LOW, HIGH, LOW, 1e12, -1e300])
    points = np.zeros((len(at), 3))
    points[:, 0] = (at - 16) / 8
    points[2, 0], points[3, 0] = np.nextafter(points[0, 0], np.inf), np.nextafter(points[1, 0], -np.inf)
    positions = project(device, points, CAMERA, 0.1).projected.array["x"]
    limit = struct_layout.SNAP_LIMIT
    # u itself is rounded: the oracle decides whether a step beyond changes it.
    _, uv = oracle_of(points, CAMERA)
    beyond = (uv[:, 0] < LOW) | (uv[:, 0] > HIGH)
    assert beyond[4:].all()
    assert not beyond[:2].any()
    assert positions.tolist() == np.where(beyond, np.sign(at) * limit, at * coverage.SUBPIXELS).astype(int).tolist()


def test_the_near_plane_itself_is_before_the_eye(device):
    near = 0.25
    z = np.array([near, np.nextafter(near, 0.0), 0.0, -0.0, -near, np.nextafter(near, 1.0)])
    camera = Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), 1.0, (1.0, 1.0), (32, 32))
    points = np.zeros((6, 3))
    points[:, 0], points[:, 2] = z / 8, z
    vertices = project(device, points, camera, near).projected.array
    assert (vertices["w"] > 0.0).tolist() == [True, False, False, False, False, True]
    assert (vertices["x"] != 0).tolist() == [True, False, False, False, False, True]


def test_the_hosts_camera_axes_are_the_oracles():
    """The renderer uploads the axes of geometry.camera_axes: the last bit decides between triangles of equal depth."""
    rng = np.random.default_rng(2)
    for _ in range(500):
        eye, lookat, up = rng.normal(size=(3, 3)) * np.exp2(rng.uniform(-20, 20, (3, 1)))
        camera = Camera(eye, lookat, up, 1.0, (1.0, 1.0))
        axes, expected = geometry.camera_axes(camera), transform.camera_frame(camera)
        assert np.array_equal(axes, expected), (eye, lookat, up)
