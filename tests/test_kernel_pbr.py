"""microfacet.clh, through the stage `light`, at single points: closed forms, lobes, energy, reciprocity."""

from __future__ import annotations

import math

import numpy as np
import pytest
from devices import needs_float64
from kernel_stages import Probe, float32, light_rows, mask, material_rows, reflected
from reflection_quadrature import lost_energy

from clshade.measure.stability.cases.light import unit
from clshade.oracle import microfacet
from clshade.oracle.lights import Directions
from clshade.scene.formats.gltf_materials import phong
from clshade.scene.material import MIN_ROUGHNESS, from_phong
from clshade.scene.model import MetallicRoughness

WHITE = (1, 1, 1)


def reflect(device, points, normals, lights, pbr, *, colors=None) -> np.ndarray:
    """Return the light (K, 3) of points relative to the eye with normals (K, 3) and colors (K, 3), by default white, under
    lights (positions (L, 3), intensities (L, 3))."""
    chosen = mask(LIT=1, PBR=1, DIFFUSE=1, SPECULAR=1, EMISSION=1)
    facets = {"diffuse": 1.0, "f0": pbr.dielectric_f0, "f90": pbr.specular, "emission": pbr.emission}
    rows = material_rows(metallic=pbr.metallic, roughness=pbr.roughness, **facets)
    points, normals = (np.atleast_2d(float32(vectors)) for vectors in (points, normals))
    lights = light_rows(*(np.atleast_2d(float32(part)) for part in lights))
    return reflected(device, chosen, points, normals, colors, rows, lights, None)


def one(device, pbr, point=(0, 0, -2), normal=(0, 0, 1), light=(0, 0, 0), **options) -> list[float]:
    return reflect(device, point, normal, (light, WHITE), pbr, **options)[0].tolist()


ROUGH, BLACK = MetallicRoughness(0.0, 1.0), [0, 0, 0]
# Light and eye along the normal: the lobe is F0 / (4 alpha^2), the diffuse base what F0 leaves.
CLOSED_FORMS = {
    "dielectric": (ROUGH, {}, [0.04 / 4.0 + 0.96] * 3),
    "without a lobe": (MetallicRoughness(0.0, 1.0, specular=0.0), {}, [1.0] * 3),
    "metal": (MetallicRoughness(1.0, 0.5), {"colors": float32([[1.0, 0.5, 0.0]])}, [4.0, 2.0, 0.0]),
    "from behind": (ROUGH, {"normal": (0, 0, -1)}, BLACK),
    "no normal": (ROUGH, {"normal": BLACK}, BLACK),
    "light at the point": (ROUGH, {"light": (0, 0, -2)}, BLACK),
    "eye at the point": (ROUGH, {"point": BLACK, "light": (0, 0, 1)}, [0.96] * 3),  # no lobe
    "emission": (MetallicRoughness(0.0, 1.0, emission=(1e30, 2, 0)), {"normal": (0, 0, -1)}, [1e30, 2.0, 0.0]),
    # Less counts as 2^-5, whose lobe is 2^18 high.
    **{f"roughness {r:g}": (MetallicRoughness(1.0, r), {}, [2.0**18] * 3) for r in (0.0, 1e-4, MIN_ROUGHNESS)},
}


@pytest.mark.parametrize(("pbr", "point", "expected"), CLOSED_FORMS.values(), ids=CLOSED_FORMS)
def test_closed_forms(device, pbr, point, expected):
    assert one(device, pbr, **point) == pytest.approx(expected, rel=1e-6)


def test_half_vectors_below_the_surface_see_its_horizon(device):
    """An interpolated normal that turns away from the eye, light behind the surface: N.V < 0 < N.L < -N.V. The lobe is D at
    N.H = 0 times 1/2 / alpha, at any angle, not its mirrored peak."""
    alpha = 0.3**2
    for n_v, n_l in ((-0.02, 0.01), (-0.1, 0.05), (-0.5, 0.4)):
        point = np.array([math.sqrt(1.0 - n_v * n_v), 0.0, -n_v])  # the eye is at 0
        light = point + [math.sqrt(1.0 - n_l * n_l), 0.0, n_l]
        assert one(device, MetallicRoughness(1.0, 0.3), point, light=light) == pytest.approx([alpha / 2] * 3, rel=1e-4)


@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.3, 1.0])
def test_lobes_own_relative_error(device, roughness):
    """Inside the lobe, |N x H| <= alpha, at most 32 / alpha * 2^-24 (clshade/measure/README.md)."""
    rng = np.random.default_rng(7)
    alpha = max(roughness, MIN_ROUGHNESS) ** 2
    light = float32([0.7, -0.4, 0.9])
    points = float32(unit(rng.normal(size=(4000, 3))) * rng.uniform(1.0, 2.0, (4000, 1)))
    to_eye, to_light = unit(-points.astype(np.float64)), unit(light.astype(np.float64) - points)
    kept = ((to_eye * to_light).sum(axis=1) > -0.5) & (np.linalg.norm(points - light, axis=1) > 0.7)
    points, half = points[kept], unit(to_eye + to_light)[kept]
    normals = float32(
        unit(half + min(alpha, 0.3) * rng.uniform(0, 0.7, (len(half), 1)) * unit(rng.normal(size=half.shape)))
    )
    radiance = reflect(device, points, normals, (light, WHITE), MetallicRoughness(1.0, roughness))[:, 0]
    exact = (a.astype(np.float64) for a in (points, normals, np.zeros(3), light))
    at = microfacet.angles(Directions.at(*exact))
    lobe = microfacet.distribution(at.beside, np.float64(alpha)) * microfacet.passing(at.n_l, at.n_v, np.float64(alpha))
    inside = (at.beside <= alpha) & (at.n_l > 0.3) & (at.n_v > 0.3)
    assert inside.sum() > 1000
    assert np.abs(radiance[inside] / lobe[inside] - 1.0).max() <= 32.0 / alpha * 2.0**-24


ROOTS = """
#include "light.clh"
kernel void square_roots(global const REAL *x, global REAL *out)
{
    int i = get_global_id(0) * LANES;
    reals root, square = LOAD_LANES(x + i);
    roots(&root, &square, 1);
    STORE_LANES(root, out + i);
}
"""


@pytest.mark.sampled
@pytest.mark.parametrize("double", [0, 1])
def test_square_roots(device, double):
    """0 too: what L + V is where the light lies behind the point."""
    if double:
        needs_float64(device)
    real = np.float64 if double else np.float32
    squares = np.concatenate([[0.0], 2.0 ** np.arange(-100, 126)]).astype(real)
    roots = Probe(device, ROOTS, PBR=1, DOUBLE=double)("square_roots", squares, dtype=real)
    np.testing.assert_allclose(roots, np.sqrt(squares), rtol=1e-15 if double else 2.0**-22)


# The model


def test_reciprocity(device):
    """Exchanging eye and light changes the lobe of a metal over N.L by roundings only."""
    rng = np.random.default_rng(2)
    directions = unit(rng.normal(size=(2, 50, 3)) + [0, 0, 1.5])
    directions = directions[:, (directions[..., 2] > 0.1).all(axis=0)]
    brdf = []
    for eye, light in (directions, directions[::-1]):
        # The light is at the same place for all points: each is lit alone.
        lit = [one(device, MetallicRoughness(1.0, 0.4), -e, light=to - e)[0] for e, to in zip(eye, light, strict=True)]
        brdf.append(np.array(lit) / light[:, 2])
    np.testing.assert_allclose(*brdf, rtol=1e-5)


def test_a_white_furnace_loses_what_single_scattering_loses(device):
    """A perfect reflector in light from everywhere, 1 / (2 pi) of it from each unit of solid angle: what is reflected is 1
    less `lost_energy`, by another quadrature, over directions to the light."""
    steps = 160
    cosine, phi = (
        a.ravel() for a in np.meshgrid((np.arange(steps) + 0.5) / steps, (np.arange(steps) + 0.5) / steps * 2 * np.pi)
    )
    sine = np.sqrt(1.0 - cosine * cosine)
    to_light = np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=1)
    weights = np.full((len(to_light), 3), 2.0 / len(to_light), np.float32)  # 2 pi / K of solid angle, over pi
    for roughness in (0.5, 0.8, 1.0):
        for n_v in (0.3, 0.7, 1.0):
            point = -np.array([math.sqrt(1.0 - n_v * n_v), 0.0, n_v])
            lit = reflect(device, point, (0, 0, 1), (point + to_light, weights), MetallicRoughness(1.0, roughness))
            lost = lost_energy(roughness**2, np.array(n_v))
            assert lit[0, 0] == pytest.approx(1.0 - lost, abs=3e-3)
            assert -1e-3 < lost < 0.7
    assert lost_energy(1.0, np.array(1.0)) == pytest.approx(math.log(2.0), abs=1e-5)  # 1 - int u/(1 + u) du
    base = MetallicRoughness(0.0, 0.6)  # a white dielectric sends no more than it receives
    lights = [0, 0, -1] + to_light, weights
    assert reflect(device, (0, 0, -1), (0, 0, 1), lights, base).max() < 1.0


@pytest.mark.parametrize("alpha", [0.05, 0.25, 1.0])
def test_the_distribution_projects_to_one(alpha):
    """The integral of D N.H over half vectors is 1; `distribution` is pi times D."""
    x = (np.arange(400_000) + 0.5) / 400_000  # |N x H|; N.H times the solid angle is x dx dphi
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
