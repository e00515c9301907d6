"""Image-based light of shader pbr: closed forms, and what it takes the place of."""

from dataclasses import replace

import numpy as np
import pytest
from devices import rendered
from oracle_asserts import assert_drawn

import clshade
from clshade.base.arrays import Floats
from clshade.oracle import environment as around
from clshade.oracle import microfacet
from clshade.oracle.microfacet import Facets, alpha_of, passing, schlick
from clshade.oracle.transform import unit
from clshade.pipeline.features import OPTIONAL
from clshade.pipeline.frame import Frame, same_bits
from clshade.scene.camera import Camera
from clshade.scene.environment import Environment
from clshade.scene.formats.gltf_materials import phong
from clshade.scene.image_light import bilinear, radiance, texel_directions
from clshade.scene.material import MetallicRoughness, from_phong
from clshade.scene.model import Material, Mesh, PointLight, Scene, Texture

BALL = clshade.builtin("icosphere", level=3).meshes[0]
CAMERA = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (0.6, 0.6), (48, 48))
IMAGE = np.random.default_rng(3).random((12, 24, 3)) ** 3
WHITE = Environment(np.ones((2, 4, 3)))


def ball(roughness: float, metallic: float, environment: Environment | None, color=(0.9, 0.6, 0.3), **fields) -> Scene:
    mesh = replace(BALL, colors=None, material=Material(color=color, pbr=MetallicRoughness(metallic, roughness)))
    return Scene(mesh, CAMERA, **{"ambient": 0.0, "environment": environment, "preset": "pbr", **fields})


def draw(device, scene: Scene, **options) -> Frame:
    """Draw with all features on, for which one program is built, unless `options` say otherwise."""
    return rendered(scene, device=device, **{"layers": ("Z", "id"), "forced": OPTIONAL, **options})


def true_reflection(environment: Environment, normals: Floats, views: Floats, facets: Facets, points: int) -> Floats:
    """Return what white surfaces reflect of an environment, (K, 3), with unit normals and directions to the eye (K, 3):
    integrals with points^2 directions each, in equal shares of the cosine for the diffuse term and of GGX's normals for the
    lobe."""
    share = (np.arange(points) + 0.5) / points
    total = np.zeros(normals.shape)

    def around(n: Floats, cosine: Floats) -> Floats:
        """Return directions all around n, at angles to it with these cosines."""
        side, turn = unit(np.cross(n, np.eye(3)[np.abs(n).argmin()])), 2.0 * np.pi * share
        ring = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * np.cross(n, side)
        return np.sqrt(1.0 - cosine * cosine)[:, None, None] * ring + cosine[:, None, None] * n

    for k, (n, v) in enumerate(zip(normals, views, strict=True)):
        one, alpha = facets[k], alpha_of(facets[k].roughness)
        dielectric = 1.0 - one.metallic
        # Diffuse: cos^2 of the angle to the normal is uniform.
        light = around(n, np.sqrt(share))
        below = 1.0 - schlick(np.full(3, one.f0.max()), one.f90, np.sqrt((1.0 + light @ v) / 2.0))
        total[k] = dielectric * one.diffuse * (radiance(environment, light) * below).mean(axis=(0, 1))
        # The lobe: normals in equal shares of D N.H.
        half = around(n, 1.0 / np.sqrt(1.0 + alpha * alpha * share / (1.0 - share)))
        v_h = half @ v
        light = 2.0 * v_h[..., None] * half - v
        n_l = light @ n
        lit = (v_h > 0.0) & (n_l > 0.0)
        visible = passing(np.where(lit, n_l, 0.0), np.asarray(max(n @ v, 0.0)), alpha)
        weight = np.where(lit, 4.0 * visible * v_h / (half @ n), 0.0)[..., None] * radiance(environment, light)
        grazing = ((1.0 - np.clip(v_h, 0.0, 1.0)) ** 5)[..., None]
        straight, edge = one.metallic + dielectric * one.f0, one.metallic + dielectric * one.f90
        total[k] += (weight * (straight * (1.0 - grazing) + edge * grazing)).mean(axis=(0, 1))
    return total


@pytest.mark.long
def test_occlusion_maps_keep_the_environment_away(device):
    scene = ball(0.3, 0.5, Environment(IMAGE))
    (mesh,), frames = scene.meshes, []
    for texel in (0.0, 0.4, 1.0):
        facets = replace(mesh.material.pbr, occlusion_texture=Texture(np.full((2, 2, 3), texel)))
        occluded = replace(mesh, uvs=np.abs(mesh.verts[:, :2]), material=replace(mesh.material, pbr=facets))
        frames.append(draw(device, replace(scene, meshes=occluded), forced=()))
        assert_drawn(frames[-1])
    dark, half, full = (frame.rgb for frame in frames)
    assert not dark.any()
    np.testing.assert_allclose(half, 0.4 * full, rtol=1e-5)
    np.testing.assert_array_equal(full, draw(device, scene).rgb)


@pytest.mark.long
@pytest.mark.parametrize("roughness", [0.2, 0.0, 1.0])
def test_a_white_furnace_loses_what_single_scattering_loses(device, roughness):
    frame = draw(device, ball(roughness, 1.0, WHITE, color=1.0), layers=("Z", "id", "N", "P"))
    shown = frame.alpha > 0
    n, view = frame["N"][shown], unit(CAMERA.eye - frame["P"][shown])
    n_v = (n * view).sum(axis=1)
    # Of 1/31 the table knows no shape: there grazing shares change from 0 to their largest.
    some = np.flatnonzero(n_v > 0.1)[::7]
    facets = microfacet.facets_of([Material(pbr=MetallicRoughness(1.0, roughness))] * len(some))
    expected = true_reflection(WHITE, n[some], view[some], facets, 128)
    np.testing.assert_allclose(frame.rgb[shown][some], expected, atol=6e-3)
    # glTF's diffuse base below a dielectric is darkened by F at V.H, not by all that the layer reflects: it sends more than
    # 1 at grazing incidence.
    matt = draw(device, ball(roughness, 0.0, WHITE, color=1.0)).rgb[shown]
    np.testing.assert_allclose(matt[n_v > 0.6], 1.0, atol=0.05)
    assert matt.min() > 0.95


def test_an_eye_on_the_surface_and_normals_of_zero(device):
    triangle = Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]], normals=np.zeros((3, 3)))
    frame = draw(device, Scene(triangle, CAMERA, ambient=0.0, environment=WHITE, preset="pbr"))
    assert frame.alpha.any()
    assert not frame.rgb.any()
    close = replace(CAMERA, eye=(0.0, 0.0, 1.0 + 1e-7))
    assert np.isfinite(draw(device, replace(ball(0.1, 1.0, WHITE), camera=close)).rgb).all()


@pytest.mark.long
def test_lights_that_stand_in_give_way_to_the_studio(device):
    scene = ball(0.5, 0.0, None, lights=PointLight((2, 3, 4)), ambient=0.3, own_lights=False)
    frame = draw(device, scene)
    assert frame.scene.environment is clshade.studio()
    assert frame.scene.lights == ()
    assert frame.metadata()["environment"] == "studio, rotation=0, intensity=1"
    white = replace(scene, environment=WHITE)
    assert draw(device, white).scene.environment is WHITE
    plain, kept = (draw(device, lit, preset="standard") for lit in (white, replace(scene, own_lights=True)))
    assert same_bits(plain, kept)
    upright = replace(scene, camera=replace(CAMERA, eye=(0, -4, 0), up=(0, 0, 1)))
    np.testing.assert_array_equal(draw(device, upright).scene.environment.up, [0, 0, 1])


# The oracle


def test_the_oracles_lookup_is_continuous_and_means_texels():
    level = np.random.default_rng(4).random((16, 16, 3))
    reach = np.zeros(1)
    for d in texel_directions(16).reshape(-1, 3)[::5]:
        np.testing.assert_allclose(around.lookup(level, d[None], reach)[0], bilinear(level, d[None]), atol=1e-12)
    for d in ([0, 0, -1.0], [1, 0, -1e-15], [0.5, -0.5, -0.2], [-1, 0, 0]):
        moved = np.array(d) + 1e-7 * np.random.default_rng(0).standard_normal((40, 3))
        colors, off = around.lookup(level, moved, np.full(40, 1e-6))
        assert np.ptp(colors, axis=0).max() < 1e-4
        assert (np.abs(colors - colors[0]) <= off + 1e-12).all()


def test_the_split_sum_is_near_the_true_integral():
    smooth = Environment(np.linspace(1.0, 0.2, 32)[:, None, None] * np.ones((32, 64, 3)))
    normal, view = unit(np.array([[[0.2, 0.9, 0.3], [0.5, -0.2, 0.8]], [[0.1, 0.6, 0.79], [0.6, 0.0, 0.8]]]))
    facets = microfacet.facets_of([Material(pbr=MetallicRoughness(m, r)) for m, r in ((0.0, 0.5), (1.0, 0.3))])
    near = around.reflected(smooth, normal, view, facets, np.ones((2, 3)), np.full(2, 1e-6))
    true = true_reflection(smooth, normal, view, facets, 64)
    np.testing.assert_allclose(near.tinted + near.plain, true, rtol=0.03)


def test_unlit_materials_keep_their_color(device):
    """glTF's unlit materials show their color by the ambient light, which the environment replaces for all others."""
    unlit = Material(color=(0.2, 0.5, 0.8), ka=10.0, kd=0.0, ks=0.0)
    aside = Mesh(BALL.verts * 0.2 + np.array([1.2, 0.0, 0.0], np.float32), BALL.faces, material=unlit)
    scene = ball(0.5, 0.0, None, ambient=0.1, own_lights=False)
    frame, lit = draw(device, replace(scene, meshes=(*scene.meshes, aside))), draw(device, scene)
    assert_drawn(frame)
    unlit_pixels = frame["id"] > len(BALL.faces)
    assert unlit_pixels.sum() > 20
    np.testing.assert_allclose(frame.rgb[unlit_pixels], np.tile([0.2, 0.5, 0.8], (unlit_pixels.sum(), 1)), rtol=1e-6)
    np.testing.assert_array_equal(frame.rgb[~unlit_pixels], lit.rgb[~unlit_pixels])


# Parameters


def test_the_distribution_projects_to_one():
    """The integral of D N.H over half vectors is 1; `distribution` is pi times D."""
    x = (np.arange(400_000) + 0.5) / 400_000  # |N x H|; N.H times the solid angle is x dx dphi
    for alpha in (0.05, 0.25, 1.0):
        assert (2.0 * x * microfacet.distribution(x, np.float64(alpha))).mean() == pytest.approx(1.0, rel=1e-4)


def test_parameters_from_phong():
    """The inverse of what Phong's model makes of glTF's parameters; without a highlight nothing is reflected."""
    kd, ks, n = phong(0.0, 0.4, 1.0)
    parameters = from_phong(np.full(3, ks), n)
    assert (kd, parameters.metallic) == (1.0, 0.0)
    assert parameters.roughness == pytest.approx(0.4)
    np.testing.assert_allclose(parameters.dielectric_f0, 0.04)
    assert not from_phong(np.zeros(3), 20.0).dielectric_f0.any()
    assert from_phong(np.zeros(3), 20.0).specular == 0.0
    assert (from_phong(np.full(3, 1e9), 0.0).dielectric_f0 == 1.0).all()


def test_dielectric_reflectance():
    np.testing.assert_allclose(MetallicRoughness(ior=1.5).dielectric_f0, 0.04)
    assert not MetallicRoughness(ior=1.0).dielectric_f0.any()
    assert (MetallicRoughness(ior=0.0, specular=0.5).dielectric_f0 == 0.5).all()
    colored = MetallicRoughness(specular_color=(1, 100, 0), specular=0.5)
    np.testing.assert_allclose(colored.dielectric_f0, [0.02, 0.5, 0])
