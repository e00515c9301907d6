"""gouraud.cl: light at the corners against the oracle's reflection model, its interpolation against the oracle's
weights."""

from __future__ import annotations

import numpy as np
import oracle_asserts
import pytest
import stage_oracle
from kernel_stages import OTHER_LANES, Pipeline, bits, four
from stage_oracle import EXPONENTS, options, patches

from clshade.pipeline.buffers import Buffer

FILES = ("setup.cl", "bin.cl", "gouraud.cl")
RESOLUTION = (93, 71)
STANDARD = {"DEPTH_TEST": 1, "PERSPECTIVE": 1, "TINTED": 1}
COURSE = {"CENTROID": 1}
# Weights: edge functions are accurate to 2^-23 (2 units of 2^-24), times w 3, summed 5, with reciprocal and product
# 10 of at most 1; interpolation subtracts (2 units) and adds three times: 10 * 2 + 2 + 3 units of the largest corner.
MIXING = 25 * 2.0**-24


@pytest.fixture(scope="module")
def inputs():
    return patches(RESOLUTION, seed=2)


def pipeline_of(device, inputs, ways, lanes=None, **features) -> Pipeline:
    image = {"lights": len(inputs.lights)}
    pipeline = Pipeline(device, FILES, RESOLUTION, lanes=lanes, image=image, **options(**ways, **features))
    inputs.set_up(pipeline)
    return pipeline


def corners(pipeline: Pipeline, inputs) -> np.ndarray:
    """Return the output of gouraud_corners, (F, 3, 4); NaN for triangles that are not visible."""
    light = Buffer(pipeline.device, np.full((3 * len(inputs.z), 4), np.nan, np.float32))
    surface = pipeline.surface(**inputs.arrays())
    size = pipeline.stages.vectors(pipeline.visible)
    arguments = {"order": pipeline.order, "to_light": light, "count": pipeline.visible}
    pipeline.stages.run("gouraud_corners", size, surface, **arguments)
    return light.to_host().reshape(-1, 3, 4)


def oracle_corners(inputs, ways) -> dict[str, np.ndarray]:
    return stage_oracle.gouraud_corners(inputs, centroid=bool(ways.get("CENTROID")), tinted=bool(ways.get("TINTED")))


@pytest.mark.long
@pytest.mark.parametrize("ways", [STANDARD, COURSE], ids=["standard", "course"])
def test_corners_equal_the_reflection_model(device, inputs, ways):
    """The bound of a color, as for a pixel of phong (clshade/measure/README.md, "Bounds, and where they come from");
    only visible triangles are written."""
    pipeline = pipeline_of(device, inputs, ways)
    light = corners(pipeline, inputs)
    visible = np.sort(pipeline.order.array)
    written = ~np.isnan(light).any(axis=(1, 2))
    assert np.flatnonzero(written).tolist() == visible.tolist()
    assert 200 < len(visible) <= len(inputs.z)
    # An image of one row, with a pixel per corner.
    expected = oracle_corners(inputs, ways)
    face = np.repeat(np.arange(len(inputs.z)), 3)
    at = np.zeros_like(face), np.arange(len(face))
    frame = stage_oracle.as_frame(at[0][None], at, face, expected)
    rgb = np.nan_to_num(light[..., :3].reshape(1, -1, 3))
    for n in EXPONENTS:
        skip = ~stage_oracle.only(frame, inputs, n) | ~written[face][None]
        assert oracle_asserts.assert_colors_within(rgb, frame, skip=skip) < 8.0


@pytest.mark.sampled
@pytest.mark.parametrize("ways", [STANDARD, COURSE], ids=["standard", "course"])
def test_the_corners_light_is_interpolated(device, inputs, ways):
    """Given light, also with colors beyond 1: means by the oracle's weights, plus the constant ambient light."""
    pipeline = pipeline_of(device, inputs, ways)
    light = np.random.default_rng(3).uniform(-1, 5, (3 * len(inputs.z), 3)).astype(np.float32)
    rgba, owners = pipeline.draw(Buffer(device, four(light)), **inputs.arrays())
    interpolation = "perspective" if ways.get("PERSPECTIVE") else "affine"
    at, face, weights = stage_oracle.owned(inputs, owners, interpolation)
    corner = light.reshape(-1, 3, 3)[face]
    expected = stage_oracle.blend(weights, corner)
    largest = np.abs(corner).max(axis=(1, 2))[:, None]
    if not ways.get("TINTED"):
        expected = expected + inputs.materials["ambient"][inputs.face_materials[face]]
        largest = largest + 1.0
    assert len(face) > 4000
    assert (np.abs(rgba[at][:, :3] - expected) / largest).max() <= MIXING
    assert not rgba[owners < 0].any()


@pytest.mark.long
@pytest.mark.parametrize("perspective", [0, 1])
def test_without_light_the_colors_are_interpolated(device, inputs, perspective):
    """nolight: LIT is 0."""
    pipeline = pipeline_of(device, inputs, {}, LIT=0, PERSPECTIVE=perspective)
    rgba, owners = pipeline.draw(**inputs.arrays())
    at, face, weights = stage_oracle.owned(inputs, owners, "perspective" if perspective else "affine")
    expected = stage_oracle.blend(weights, inputs.colors[face])
    assert np.abs(rgba[at][:, :3] - expected).max() <= MIXING
    wrong_weights = stage_oracle.owned(inputs, owners, "affine" if perspective else "perspective")[2]
    assert np.abs(stage_oracle.blend(wrong_weights, inputs.colors[face]) - expected).max() > 0.01


def test_a_constant_stays_exactly_constant(device, inputs):
    """The weight of corner 0 is 1 minus the others, so equal corners give exactly their value."""
    pipeline = pipeline_of(device, inputs, STANDARD)
    light = np.full((3 * len(inputs.z), 3), 0.1, np.float32)
    rgba, owners = pipeline.draw(Buffer(device, four(light)), **inputs.arrays())
    assert (rgba[owners >= 0, :3] == np.float32(0.1)).all()


@pytest.mark.long
@pytest.mark.parametrize("lanes", OTHER_LANES)
def test_lanes_do_not_change_a_bit(device, inputs, lanes):
    drawn = []
    for count in (16, lanes):
        pipeline = pipeline_of(device, inputs, STANDARD, count)
        light = np.nan_to_num(corners(pipeline, inputs)).reshape(-1, 4)
        rgba, _ = pipeline.draw(Buffer(device, light), **inputs.arrays())
        drawn.append((bits(light), bits(rgba)))
    assert np.array_equal(drawn[0][0], drawn[1][0])
    assert np.array_equal(drawn[0][1], drawn[1][1])
