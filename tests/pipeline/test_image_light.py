"""Image-based light of shader pbr: closed forms, and what it takes the place of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from devices import rendered
from golden import digest
from oracle_asserts import assert_drawn

import clshade
from clshade.base.arrays import Array, Floats
from clshade.oracle import environment as around
from clshade.oracle import microfacet
from clshade.oracle.microfacet import Facets, alpha_of, passing, schlick
from clshade.oracle.transform import unit
from clshade.pipeline.features import OPTIONAL
from clshade.pipeline.frame import Frame
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
    material = Material(color=color, pbr=MetallicRoughness(metallic, roughness))
    mesh = replace(BALL, colors=None, material=material)
    return Scene(mesh, CAMERA, **{"ambient": 0.0, "environment": environment, "preset": "pbr", **fields})


def draw(device, scene: Scene, **options) -> Frame:
    """Draw with all features on, for which one program is built, unless `options` say otherwise."""
    arguments = {"layers": ("Z", "id"), "forced": OPTIONAL, **options}
    return rendered(scene, device=device, **arguments)


# What is reflected, by quadrature over directions


def lost_energy(alpha: float, n_v: Array, steps: int = 400) -> Floats:
    """Return the share of light that single scattering of a perfect reflector (F = 1) loses, (...), by quadrature: 1 minus
    the integral of its BRDF times N.L over directions to the light.

    Half vectors are taken with equal shares of D (N.H): tan^2 of their angle to N is alpha^2 u/(1 - u), u uniform.
    """
    u = (np.arange(steps) + 0.5) / steps
    phi = (np.arange(steps) + 0.5) / steps * np.pi
    cosine = 1.0 / np.sqrt(1.0 + alpha * alpha * u / (1.0 - u))
    sine = np.sqrt(1.0 - cosine * cosine)
    kept = []
    for c in np.ravel(n_v):
        s = np.sqrt(1.0 - c * c)
        v_h = cosine[:, None] * c + (sine[:, None] * s) * np.cos(phi)
        n_l = 2.0 * v_h * cosine[:, None] - c
        mirrored = (v_h > 0.0) & (n_l > 0.0)
        visible = 4.0 * passing(np.where(mirrored, n_l, 0.0), np.asarray(c), np.asarray(alpha))
        kept.append(np.where(mirrored, visible * v_h / cosine[:, None], 0.0).mean())
    lost: Floats = 1.0 - np.reshape(kept, np.shape(n_v))
    return lost


def true_reflection(
    environment: Environment, normals: Floats, views: Floats, facets: Facets, points: int = 128
) -> Floats:
    """Return what white surfaces reflect of an environment, (K, 3), with unit normals and directions to the eye (K, 3):
    integrals with points^2 directions each, in equal shares of the cosine for the diffuse term and of GGX's normals for the
    lobe. Slow; rough where the environment has small bright spots."""
    share = (np.arange(points) + 0.5) / points
    turn = 2.0 * np.pi * share
    total = np.zeros(normals.shape)
    for k, (n, v) in enumerate(zip(normals, views, strict=True)):
        one = facets[k]
        alpha = float(alpha_of(one.roughness))
        side = unit(np.cross(n, np.eye(3)[np.abs(n).argmin()]))
        frame = np.stack([side, np.cross(n, side), n])
        dielectric = 1.0 - one.metallic
        # Diffuse: cos^2 of the angle to the normal is uniform.
        light = _around(np.sqrt(share), turn) @ frame
        v_h = np.sqrt((1.0 + light @ v) / 2.0)
        below = 1.0 - schlick(np.full(3, one.f0.max()), one.f90, v_h)
        total[k] = dielectric * one.diffuse * (radiance(environment, light) * below).mean(axis=(0, 1))
        # The lobe: normals in equal shares of D N.H.
        half = _around(1.0 / np.sqrt(1.0 + alpha * alpha * share / (1.0 - share)), turn) @ frame
        v_h, n_h = half @ v, half @ n
        light = 2.0 * v_h[..., None] * half - v
        n_l = light @ n
        lit = (v_h > 0.0) & (n_l > 0.0)
        visible = passing(np.where(lit, n_l, 0.0), np.asarray(max(n @ v, 0.0)), np.asarray(alpha))
        weight = np.where(lit, 4.0 * visible * v_h / n_h, 0.0)[..., None] * radiance(environment, light)
        grazing = ((1.0 - np.clip(v_h, 0.0, 1.0)) ** 5)[..., None]
        total[k] += one.metallic * (weight * (1.0 - grazing)).mean(axis=(0, 1))
        edge = dielectric * one.f90 + one.metallic
        total[k] += (weight * (dielectric * one.f0 * (1.0 - grazing) + edge * grazing)).mean(axis=(0, 1))
    return total


def _around(cosine: Floats, turn: Floats) -> Floats:
    """Return the directions (C, T, 3) at angles to z with these cosines, and at angles `turn` about it."""
    sine = np.sqrt(1.0 - cosine * cosine)[:, None]
    upward = np.broadcast_to(cosine[:, None], (len(cosine), len(turn)))
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), upward], axis=-1)


@pytest.mark.long
def test_occlusion_maps_keep_the_environment_away(device):
    scene = ball(0.3, 0.5, Environment(IMAGE))
    (mesh,), frames = scene.meshes, []
    for texel in (0.0, 0.4, 1.0):
        facets = replace(mesh.material.pbr, occlusion_texture=Texture(np.full((2, 2, 3), texel)))
        material = replace(mesh.material, pbr=facets)
        uvs = np.abs(mesh.verts[:, :2])
        frames.append(draw(device, replace(scene, meshes=replace(mesh, uvs=uvs, material=material)), forced=()))
        assert_drawn(frames[-1])
    dark, half, full = (frame.rgb for frame in frames)
    assert not dark.any()
    np.testing.assert_allclose(half, 0.4 * full, rtol=1e-5)
    np.testing.assert_array_equal(full, draw(device, scene).rgb)


@pytest.mark.sampled
@pytest.mark.parametrize("roughness", [0.2, 0.0, 1.0])
def test_a_white_furnace_loses_what_single_scattering_loses(device, roughness):
    frame = draw(device, ball(roughness, 1.0, WHITE, color=1.0), layers=("Z", "id", "N", "P"))
    n, p = frame["N"][frame.alpha > 0], frame["P"][frame.alpha > 0]
    view = CAMERA.eye - p
    n_v = (n * view).sum(axis=1) / np.linalg.norm(view, axis=1)
    # Of 1/31 the table knows no shape: there grazing shares change from 0 to their largest.
    sure = n_v > 0.1
    kept = 1.0 - lost_energy(max(roughness, 1e-3) ** 2, n_v[sure][::7], 200)
    np.testing.assert_allclose(frame.rgb[frame.alpha > 0][sure][::7], np.stack([kept] * 3, axis=1), atol=6e-3)
    # glTF's diffuse base below a dielectric is darkened by F at V.H, not by all that the layer reflects: it sends more than
    # 1 at grazing incidence.
    matt = draw(device, ball(roughness, 0.0, WHITE, color=1.0)).rgb[frame.alpha > 0]
    np.testing.assert_allclose(matt[n_v > 0.6], 1.0, atol=0.05)
    assert matt.min() > 0.95


def test_an_eye_on_the_surface_and_normals_of_zero(device):
    triangle = Mesh([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], [[0, 1, 2]], normals=np.zeros((3, 3)))
    scene = Scene(triangle, CAMERA, ambient=0.0, environment=WHITE, preset="pbr")
    frame = draw(device, scene)
    assert frame.alpha.any()
    assert (frame.rgb == 0.0).all()
    close = replace(CAMERA, eye=(0.0, 0.0, 1.0 + 1e-7))
    assert np.isfinite(draw(device, replace(ball(0.1, 1.0, WHITE), camera=close)).rgb).all()


def test_lights_that_stand_in_give_way_to_the_studio(device):
    lamp = PointLight((2, 3, 4))
    scene = ball(0.5, 0.0, None, lights=lamp, ambient=0.3, own_lights=False)
    frame = draw(device, scene)
    assert frame.scene.environment is clshade.studio()
    assert frame.scene.lights == ()
    assert frame.metadata()["environment"] == "studio, rotation=0, intensity=1"
    white_scene = replace(scene, environment=WHITE)
    assert draw(device, white_scene).scene.environment is WHITE
    assert digest(draw(device, white_scene, preset="standard")) == digest(
        draw(device, replace(scene, own_lights=True), preset="standard")
    )
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
    scene = replace(scene, meshes=(*scene.meshes, aside))
    frame = draw(device, scene)
    assert_drawn(frame)
    unlit_pixels = np.isin(frame["id"], np.arange(len(BALL.faces), 2 * len(BALL.faces)) + 1)
    np.testing.assert_allclose(frame.rgb[unlit_pixels], np.tile([0.2, 0.5, 0.8], (unlit_pixels.sum(), 1)), rtol=1e-6)
    assert unlit_pixels.sum() > 20
    lit = draw(device, replace(scene, meshes=scene.meshes[:1]))
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
    np.testing.assert_allclose(
        MetallicRoughness(specular_color=(1, 100, 0), specular=0.5).dielectric_f0, [0.02, 0.5, 0]
    )
