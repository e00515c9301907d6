"""Precision float32 and float64: the same coverage, each within its bounds."""

from __future__ import annotations

from dataclasses import replace

import mpmath
import numpy as np
import oracle_asserts
import pytest
from devices import needs_float64, rendered, skip_unsupported
from kernel_stages import NUMERICS_OF_ONE_BLOCK, Probe

import clshade
from clshade import oracle
from clshade.errors import DeviceError, InputError
from clshade.measure.check import oracle_bounds
from clshade.measure.stability.cases.lit import CAMERA, LIGHTS, MATERIAL, blob, scene_of
from clshade.pipeline.frame import same_bits
from clshade.scene.camera import Camera
from clshade.scene.geometry import camera_axes
from clshade.scene.model import Material, Mesh, Scene, Texture

PRECISIONS = ["float32", "float64"]
RESOLUTION = (97, 71)
LAYERS = ("Z", "id")
SURFACE = ("N", "P", "albedo", "barycentrics")

TEXT = (
    NUMERICS_OF_ONE_BLOCK
    + """
#define IN(name) LOAD_LANES(name + get_global_id(0) * LANES)
#define OUT(value) STORE_LANES(value, out + get_global_id(0) * LANES)
kernel void inverse_root(global const REAL *x, global REAL *out) { OUT(reciprocal_sqrt(IN(x))); }
kernel void log2_less(global const REAL *x, global REAL *out) { OUT(log2_one_minus(IN(x))); }
kernel void exp2_below(global const REAL *x, global REAL *out) { OUT(exp2_negative(IN(x))); }
kernel void power(global const REAL *t, global const REAL *n, global REAL *out) { OUT(power_one_minus(IN(t), IN(n))); }
"""
)


def relative(values: np.ndarray, expected: list) -> float:
    """Return the largest relative error against exact values."""
    return float(max(abs(mpmath.mpf(float(f)) / e - 1) for f, e in zip(values, expected, strict=True)))


@pytest.fixture(scope="module")
def double(device):
    return Probe(device, TEXT, DOUBLE=1, POWER=1)


def test_float64_functions(double):
    """A few roundings of 2^-53 each. Root: two. Logarithm: the quotient s and its products, six. Exponential: its
    argument (half a rounding of 0.35) and the sum, two. Each plus a little for the truncated series."""
    mpmath.mp.dps = 40
    rng = np.random.default_rng(4)
    t = np.concatenate([rng.uniform(0, 1, 1000), 10.0 ** rng.uniform(-17, -1, 1000)])
    logs = [mpmath.log1p(-mpmath.mpf(x)) / mpmath.log(2) for x in t]
    assert relative(double("log2_less", t, dtype=np.float64), logs) <= 6 * 2.0**-53
    y = -rng.uniform(0, 800, 1000)
    assert (
        relative(double("exp2_below", y, dtype=np.float64), [mpmath.mpf(2) ** mpmath.mpf(x) for x in y])
        <= 2.5 * 2.0**-53
    )
    x = 10.0 ** rng.uniform(-200, 200, 1000)
    assert (
        relative(double("inverse_root", x, dtype=np.float64), [1 / mpmath.sqrt(mpmath.mpf(v)) for v in x])
        <= 2 * 2.0**-53
    )


@pytest.mark.parametrize("n", [1.0, 20.0, 1e4, 1e9])
def test_float64_powers(double, n):
    """(1-t)^n with n*t up to 40: the logarithm's error times n*|log2(1-t)|, up to 60, and the exponential's."""
    t = np.random.default_rng(5).uniform(0.0, min(40.0 / n, 0.999), 500)
    exact = [mpmath.power(1 - mpmath.mpf(x), n) for x in t]
    assert relative(double("power", t, np.full_like(t, n), dtype=np.float64), exact) <= (60 * 7 + 3) * 2.0**-53


def draw(device, scene, **options):
    skip_unsupported(device, options)
    return rendered(scene, device=device, layers=LAYERS, **options)


@pytest.mark.sampled
@pytest.mark.parametrize("precision", PRECISIONS)
def test_of_two_quads_in_one_plane_the_later_is_seen(device, precision):
    """Cut along different diagonals, so that the depths of a pixel differ only by rounding: corners lie on the grid, to
    which they would be moved each by itself."""
    corners = np.array([[-1.0, -1.0, 0.3], [1.0, -1.0, -0.2], [1.0, 1.0, -0.3], [-1.0, 1.0, 0.2]])
    meshes = [Mesh(corners, faces) for faces in ([[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]])]
    camera = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (3.75, 5.0), (160, 120), orthographic=True)
    scene = Scene(tuple(meshes), camera, LIGHTS)
    for samples in (1, 4):
        frame = draw(device, scene, precision=precision, samples=samples, shader="nolight")
        assert frame.alpha.any()
        assert set(np.unique(frame["id"])) <= {0, 3, 4}


def lit(n: float) -> Scene:
    mesh = replace(blob(), material=replace(MATERIAL, n=n))
    return Scene((mesh,), CAMERA.with_resolution(RESOLUTION), LIGHTS)


def test_float64_does_not_pass_for_float32(device):
    """float32 exceeds the bound of float64."""
    scene = lit(20.0)
    frame = draw(device, scene)
    expected = oracle.render(scene, frame.settings)
    with pytest.raises(AssertionError, match="colors off by more than 1 bounds"):
        oracle_asserts.assert_colors_within(frame.rgb, expected, 1.0, precision="float64")


@pytest.mark.long
def test_large_texture_coordinates_in_float64(device):
    """Found by the fuzzer: coordinates of some thousands hold fewer digits of a texel, which float64's bound includes;
    double-single, with 48 bits, still exceeds it."""
    needs_float64(device)
    image = np.random.default_rng(6).uniform(0, 1, (33, 33, 3)).astype(np.float32)
    uvs = np.random.default_rng(7).uniform(-2e4, 2e4, (120, 2))
    scene = scene_of(blob(40, 2, uvs=uvs, material=Material(texture=Texture(image))))
    frame = draw(device, scene, shader="nolight", precision="float64")
    expected = oracle.render(scene, frame.settings)
    allowed = oracle_bounds.allowed(scene, frame.settings)
    assert 1e-10 < allowed * 1e-12 < 1e-8
    assert 1.0 < oracle_asserts.assert_frame(frame, expected, scene, frame.settings).bounds < allowed / 3.0
    single = draw(device, scene, shader="nolight")
    off = np.abs(single.rgb - expected.rgb).max(axis=-1)[single["id"] == frame["id"]]
    assert off.max() > 10.0 * allowed * 1e-12


@pytest.mark.long
@pytest.mark.parametrize("orthographic", [False, True])
def test_far_texture_coordinates_that_are_equal_in_float64(device, orthographic):
    """Found by the fuzzer: the corners of clipped pieces get means of the coordinates, which are rounded even if all
    coordinates are equal."""
    needs_float64(device)
    image = np.random.default_rng(6).uniform(0, 1, (33, 33, 3)).astype(np.float32)
    scene = scene_of(blob(40, 2, uvs=np.full((120, 2), 12558.56161890673), material=Material(texture=Texture(image))))
    scene = replace(scene, camera=replace(scene.camera, orthographic=orthographic))
    near = float(np.linalg.norm(scene.camera.eye - scene.camera.lookat))
    frame = draw(device, scene, shader="nolight", precision="float64", near=near)
    assert frame.stats["clipped"] > 5
    error = oracle_asserts.assert_drawn(frame).bounds
    assert 1.0 < error < oracle_bounds.allowed(scene, frame.settings)


@pytest.mark.long
def test_layers_of_faces_that_the_near_plane_cuts_in_float64(device):
    """Found by the fuzzer: if depths are small, or differ little, along a clipped edge, barycentric coordinates amplify
    the rounding of positions."""
    needs_float64(device)
    rng, worst, best = np.random.default_rng(9), 0.0, np.inf
    for _ in range(12):
        depths = rng.uniform(0.5e-3, 2e-3, (40, 3, 1))
        verts = np.concatenate([rng.normal(size=(40, 3, 2)), depths], axis=2).reshape(-1, 3)
        eye, lookat, up = rng.normal(size=(3, 3))
        camera = replace(CAMERA, eye=eye, lookat=lookat, up=up, resolution=RESOLUTION)
        mesh = Mesh(eye + verts @ camera_axes(camera), np.arange(120).reshape(40, 3))
        scene = replace(scene_of(mesh), camera=camera)
        options = {"precision": "float64", "shader": "nolight", "near": 1e-3}
        frame = rendered(scene, device=device, layers=LAYERS + SURFACE, **options)
        assert frame.stats["clipped"]
        expected, layers = (reference(scene, frame.settings) for reference in (oracle.render, oracle.render_layers))
        ties = oracle_asserts.assert_same_ids(frame, expected, scene, frame.settings)
        oracle_asserts.assert_layers(frame, layers, scene, frame.settings, skip=ties)
        worst = max(worst, layers.weight_condition.max())
        best = min(best, layers.weight_condition.min())
    assert best >= 1.0
    assert 1e3 < worst < 1e6


def test_a_float64_frame_is_saved_as_float32(device, tmp_path):
    frame = draw(device, lit(20.0), precision="float64")
    frame.save(tmp_path / "ball")
    channels, _ = clshade.images.exr.read(tmp_path / "ball.exr")
    assert channels["R"].dtype == np.float32
    assert np.array_equal(channels["R"], frame.rgb[..., 0].astype(np.float32))


def test_a_device_without_float64_refuses_it(device):
    scene = Scene((Mesh(np.eye(3), [[0, 1, 2]]),), CAMERA)
    with pytest.raises(DeviceError, match="precision float64"):
        clshade.render(scene, device=replace(device, has_fp64=False), precision="float64")


def test_an_unknown_precision_is_refused():
    with pytest.raises(InputError, match="precision: expected one of fast, float32, float64, found 'half'"):
        clshade.Settings(precision="half")


def test_fast_is_another_name_of_float32(device):
    scene = lit(20.0)
    frame, default_frame = draw(device, scene, precision="fast"), draw(device, scene)
    assert same_bits(frame, default_frame)
    assert frame.settings == default_frame.settings
    assert frame.settings.precision == "float32"
