"""phong.cl against the oracle's reflection model at the stage's own inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import oracle_asserts
import pytest
import stage_oracle
from kernel_stages import OTHER_LANES, Pipeline, bits
from stage_oracle import EXPONENTS, options, patches

from clshade.measure.check import oracle_bounds

FILES = ("setup.cl", "bin.cl", "phong.cl")
RESOLUTION = (93, 71)
# The options of the two presets: position, perspective, tinted; centroid, affine, plain.
STANDARD = {"DEPTH_TEST": 1, "PERSPECTIVE": 1, "TINTED": 1}
COURSE = {"CENTROID": 1}


def draw(device, inputs, ways, lanes=None, **features):
    """Run the stage; return rgba (M, N, 4) and owners (M, N)."""
    image = {"lights": len(inputs.lights)}
    pipeline = Pipeline(device, FILES, RESOLUTION, lanes=lanes, image=image, **options(PHONG=1, **ways, **features))
    inputs.set_up(pipeline)
    return pipeline.draw(**inputs.arrays())


def oracle_of(inputs, owners, ways):
    interpolation = "perspective" if ways.get("PERSPECTIVE") else "affine"
    centroid, tinted = "CENTROID" in ways, "TINTED" in ways
    return stage_oracle.phong(inputs, owners, centroid=centroid, interpolation=interpolation, tinted=tinted)


@pytest.fixture(scope="module")
def inputs():
    return patches(RESOLUTION)


@pytest.mark.long
@pytest.mark.parametrize("ways", [STANDARD, COURSE], ids=["standard", "course"])
def test_pixels_equal_the_reflection_model(device, inputs, ways):
    """Within the bound for every exponent: 32 * sqrt(max(n, 1)) * 2^-24 * kappa of the light budget
    (clshade/measure/README.md, "Bounds, and where they come from")."""
    rgba, owners = draw(device, inputs, ways)
    expected = oracle_of(inputs, owners, ways)
    assert (owners >= 0).mean() > 0.7
    for n in EXPONENTS:
        chosen = stage_oracle.only(expected, inputs, n)
        assert chosen.sum() > 500
        # Measured: 1.8 at n = 1.
        assert oracle_asserts.assert_colors_within(rgba[..., :3], expected, skip=~chosen) < 8.0
    # Highlights of the sharpest material are visible, so that the loop above tested some.
    sharp = stage_oracle.only(expected, inputs, EXPONENTS[-1]) & (expected.rgb > expected.budget / 4).all(axis=-1)
    assert sharp.any()
    assert np.array_equal(rgba[..., 3], owners >= 0)


def test_the_comparison_notices_another_exponent_and_a_moved_light(device, inputs):
    rgba, owners = draw(device, inputs, STANDARD)
    lights = inputs.lights.copy()
    lights["position"][0, 0] += 1e-3
    for wrong in (stage_oracle.with_exponent(inputs, 20.01), replace(inputs, lights=lights)):
        with pytest.raises(AssertionError, match="colors off"):
            oracle_asserts.assert_colors_within(rgba[..., :3], oracle_of(wrong, owners, STANDARD))


@pytest.mark.long
@pytest.mark.parametrize("lanes", OTHER_LANES)
def test_lanes_do_not_change_a_bit(device, inputs, lanes):
    first, owners = draw(device, inputs, STANDARD)
    rgba, owned = draw(device, inputs, STANDARD, lanes)
    assert np.array_equal(owners, owned)
    assert np.array_equal(bits(first), bits(rgba))


@pytest.mark.long
def test_exponent_one_needs_no_power(device, inputs):
    plain = stage_oracle.with_exponent(inputs, 1.0)
    with_power, _ = draw(device, plain, STANDARD)
    without, _ = draw(device, plain, STANDARD, POWER=0)
    assert np.array_equal(bits(with_power), bits(without))


def test_zero_normals_give_the_ambient_light_alone(device, inputs):
    """Also where the corners' normals cancel only at a pixel: the direction is undefined there, the color finite."""
    none = replace(inputs, normals=np.zeros_like(inputs.normals))
    rgba, owners = draw(device, none, COURSE)
    expected = none.materials["ambient"][none.face_materials[owners]]
    assert np.array_equal(rgba[..., :3], np.where(owners[..., None] >= 0, expected, 0))
    canceling = inputs.normals.copy()
    canceling[:, 1], canceling[:, 2] = -canceling[:, 0], 0.0
    rgba, _ = draw(device, replace(inputs, normals=canceling), STANDARD)
    assert np.isfinite(rgba).all()


@pytest.mark.parametrize("unit", [1.0, 2.0**20])
def test_an_overflow_saturates_and_is_counted(device, inputs, unit):
    """When light is summed, or when it is scaled back from its unit."""
    bright = replace(inputs, lights=inputs.lights.copy(), colors=np.float32(1e3) * inputs.colors)
    bright.lights["intensity"] *= np.float32(1e36)
    scaled = replace(bright, lights=bright.lights.copy())
    scaled.lights["intensity"] /= np.float32(unit)
    image = {"lights": len(inputs.lights), "light_unit": unit}
    pipeline = Pipeline(device, FILES, RESOLUTION, image=image, **options(PHONG=1, **STANDARD))
    scaled.set_up(pipeline)
    rgba, owners = pipeline.draw(**scaled.arrays())
    full = rgba[..., :3] == oracle_bounds.FLOAT32_MAX
    assert np.isfinite(rgba).all()
    expected = oracle_of(bright, owners, STANDARD).rgb
    assert full[expected > 1.01 * oracle_bounds.FLOAT32_MAX].all()
    assert not full[expected < 0.99 * oracle_bounds.FLOAT32_MAX].any()
    assert 100 < pipeline.counters["saturated"] == full.any(axis=-1).sum() < (owners >= 0).sum()
