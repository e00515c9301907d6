"""gouraud.cl and phong.cl, what whole frames do not show: exact interpolation, light beyond float32, normals of 0."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from kernel_stages import Pipeline, float32, four, light_rows, material_rows
from stage_oracle import as_kernels_see

from clshade.measure.check.oracle_bounds import FLOAT32_MAX
from clshade.oracle import coverage, shade
from clshade.pipeline.buffers import Buffer
from clshade.scene.material import TERMS

Array = np.ndarray
RESOLUTION = (93, 71)
EXPONENTS = (1.0, 20.0, 200.0, 1e4)
# The options of the two presets.
STANDARD = {"DEPTH_TEST": 1, "PERSPECTIVE": 1, "TINTED": 1}
COURSE = {"CENTROID": 1}
LIGHT = ("LIT", "AMBIENT", "POWER", "VERTEX_COLORS", "MATERIALS", *(term.feature for term in TERMS.values()))


@dataclass(frozen=True)
class Inputs:
    """F triangles without shared vertices: snapped xy (F, 3, 2), depths z (F, 3), positions relative to the eye, in the
    image's axes, (F, 3, 3), and what `Pipeline.draw` takes."""

    xy: Array
    z: Array
    points: Array
    arrays: dict[str, Array]

    def pipeline(self, device, file: str, ways: dict[str, int], **image: float) -> Pipeline:
        """Run the stages up to the tile lists. image: members of the struct Image."""
        files, features = ("setup.cl", "bin.cl", file), dict.fromkeys((*LIGHT, "OWNERS"), 1)
        image["lights"] = len(self.arrays["lights"])
        pipeline = Pipeline(device, files, RESOLUTION, image=image, PHONG=int(file == "phong.cl"), **features, **ways)
        pipeline.set_up_apart(self.xy, self.z, relative=self.points.reshape(-1, 3))
        pipeline.sort()
        pipeline.bin()
        return pipeline

    def with_arrays(self, **arrays: Array) -> Inputs:
        return replace(self, arrays={**self.arrays, **arrays})


@pytest.fixture(scope="module")
def inputs() -> Inputs:
    """Return triangles of all sizes in front of the eye, with normals roughly towards it, under three lights."""
    rng, count = np.random.default_rng(1), 300
    z = rng.uniform(2.0, 4.0, (count, 1)) + rng.uniform(-0.5, 0.5, (count, 3))
    size = 0.25 * np.exp2(rng.uniform(-4, 1, (count, 1, 1)))
    xy = rng.uniform(0, 1, (count, 1, 2)) + size * rng.normal(size=(count, 3, 2))
    points = float32(np.concatenate([z[..., None] * (xy - 0.5), z[..., None]], axis=2))
    normals = 0.4 * rng.normal(size=(count, 3, 3)) - points / np.linalg.norm(points, axis=2, keepdims=True)
    materials = material_rows(len(EXPONENTS), n=EXPONENTS)
    for name in ("ambient", "k"):
        materials[name] = rng.uniform(0, 0.6, materials[name].shape)
    positions, intensities = float32([[0.3, 0.2, 0.1], [-2, 3, 1], [1.5, -2, 2]]), rng.uniform(0, 1, (3, 3))
    arrays = {
        "normals": four(normals.reshape(-1, 3)),
        "colors": four(rng.uniform(0, 1, (3 * count, 3))),
        "face_materials": np.resize(np.arange(len(EXPONENTS), dtype=np.int32), count),
        "materials": materials,
        "lights": light_rows(positions, float32(intensities)),
    }
    snapped = np.rint(xy * RESOLUTION * coverage.SUBPIXELS).astype(np.int64)
    return Inputs(snapped, as_kernels_see(z), points, arrays)


@pytest.mark.sampled
@pytest.mark.parametrize("ways", [STANDARD, COURSE], ids=["standard", "course"])
def test_gouraud_interpolates_the_corners_light(device, inputs, ways):
    """Means by the oracle's weights, plus the ambient light that no color multiplies. Edge functions are accurate to 2 units
    of 2^-24, times w 3, summed 5, with reciprocal and product 10 of at most 1; interpolation subtracts (2 units) and adds
    three times: 10 * 2 + 2 + 3 units of the largest corner. The weight of corner 0 is 1 minus the others, so that equal
    corners give exactly their value."""
    pipeline = inputs.pipeline(device, "gouraud.cl", ways)
    light = np.random.default_rng(3).uniform(-1, 5, (3 * len(inputs.z), 3)).astype(np.float32)
    rgba, owners = pipeline.draw(Buffer(device, four(light)), **inputs.arrays)
    covered = np.nonzero(owners >= 0)
    face = owners[covered]
    edges = coverage.edge_functions(inputs.xy[face], covered[1], RESOLUTION[1] - 1 - covered[0])
    weights = shade.barycentrics(edges, inputs.z[face], "perspective" if "PERSPECTIVE" in ways else "affine")
    corners = light.reshape(-1, 3, 3)[face]
    expected = (weights[:, :, None] * corners.astype(np.float64)).sum(axis=1)
    largest = np.abs(corners).max(axis=(1, 2))[:, None] + float("TINTED" not in ways)
    ambient = inputs.arrays["materials"]["ambient"][inputs.arrays["face_materials"][face]] * ("TINTED" not in ways)
    assert len(face) > 4000
    assert (np.abs(rgba[covered][:, :3] - expected - ambient) / largest).max() <= 25 * 2.0**-24
    assert not rgba[owners < 0].any()
    rgba, _ = pipeline.draw(Buffer(device, four(np.full_like(light, 0.1))), **inputs.arrays)
    assert np.array_equal(rgba[covered][:, :3], np.float32(0.1) + ambient)


@pytest.mark.parametrize("unit", [1.0, 2.0**20])
def test_phong_saturates_and_counts_what_overflows(device, inputs, unit):
    """When light is summed, or scaled back from its unit. Powers of two in lights and colors are exact in the image."""
    dark = inputs.arrays["materials"].copy()
    dark["ambient"] = 0.0
    plain = inputs.with_arrays(materials=dark)
    rgba, owners = plain.pipeline(device, "phong.cl", STANDARD).draw(**plain.arrays)
    lights = plain.arrays["lights"].copy()
    lights["intensity"] *= np.float32(2.0**119 / unit)
    bright = plain.with_arrays(lights=lights, colors=np.float32(2.0**10) * plain.arrays["colors"])
    pipeline = bright.pipeline(device, "phong.cl", STANDARD, light_unit=unit)
    saturated, _ = pipeline.draw(**bright.arrays)
    assert np.array_equal(saturated[..., :3], np.minimum(2.0**129 * rgba[..., :3].astype(float), FLOAT32_MAX))
    full = (saturated[..., :3] == FLOAT32_MAX).any(axis=-1)
    assert 100 < pipeline.counters["saturated"] == full.sum() < (owners >= 0).sum()


def test_phong_gives_the_ambient_light_alone_without_a_normal(device, inputs):
    """Also where the corners' normals cancel only at a pixel: the direction is undefined there, the color finite."""
    normals, materials = inputs.arrays["normals"], inputs.arrays["materials"]
    none = inputs.with_arrays(normals=np.zeros_like(normals))
    rgba, owners = none.pipeline(device, "phong.cl", COURSE).draw(**none.arrays)
    expected = materials["ambient"][inputs.arrays["face_materials"][owners]]
    assert np.array_equal(rgba[..., :3], np.where(owners[..., None] >= 0, expected, 0))
    canceling = normals.copy()
    canceling[1::3], canceling[2::3] = -canceling[0::3], 0.0
    turned = inputs.with_arrays(normals=canceling)
    assert np.isfinite(turned.pipeline(device, "phong.cl", STANDARD).draw(**turned.arrays)[0]).all()
