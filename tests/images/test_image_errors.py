"""Error metrics on images with known errors, and the radiance that a PNG's codes stand for."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.images import metrics
from clshade.images.metrics import image_error, relmse, rmse
from clshade.images.tonemap import OPERATORS, radiance, tonemap

RNG = np.random.default_rng(5)


def flat(value: float) -> np.ndarray:
    return np.full((12, 16, 3), value)


def test_a_constant_offset():
    reference = RNG.uniform(0.0, 2.0, (12, 16, 3))
    assert rmse(reference + 0.25, reference) == pytest.approx(0.25, rel=1e-12)
    assert rmse(reference.astype(np.float32), reference) == pytest.approx(2.0**-25, rel=0.9)  # compared in float64


def test_one_channel_of_one_pixel():
    image = flat(1.0)
    image[3, 4, 1] += 2.0
    assert rmse(image, flat(1.0)) == pytest.approx(2.0 / math.sqrt(12 * 16 * 3), rel=1e-12)


def test_relative_error_does_not_depend_on_brightness():
    assert relmse(flat(110.0), flat(100.0)) == pytest.approx(0.01, rel=1e-6)
    assert relmse(flat(1.1), flat(1.0)) == pytest.approx(0.01, rel=1e-3)
    assert relmse(flat(0.01), flat(0.0)) == pytest.approx(1.0)  # the floor


def test_decibels_are_of_what_is_seen():
    assert image_error(flat(0.3), flat(0.3)).psnr == math.inf
    assert image_error(flat(1.0), flat(0.0)).psnr == pytest.approx(0.0)
    assert image_error(flat(7.0), flat(2.0)).psnr == math.inf  # both are white
    # The sRGB curve is a straight line of slope 12.92 near black.
    assert image_error(flat(0.002), flat(0.001)).psnr == pytest.approx(-20.0 * math.log10(0.001 * 12.92))


def test_without_flip_evaluator(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert not metrics.has_flip()
    assert image_error(flat(0.2), flat(0.4)).flip is None


@pytest.mark.skipif(not metrics.has_flip(), reason="flip-evaluator is not installed")
def test_flip():
    assert image_error(flat(0.5), flat(0.5)).flip == 0.0
    assert image_error(flat(0.5), flat(0.5) + 1e-9).flip == pytest.approx(0.0, abs=1e-6)
    assert image_error(flat(1.0), flat(0.0)).flip > 0.9
    near, far = (image_error(flat(0.5 + d), flat(0.5)).flip for d in (0.01, 0.2))
    assert 0.0 < near < far < 1.0


def test_all_measures_as_json():
    found = image_error(flat(0.3), flat(0.3)).stats()
    assert (found["rmse"], found["relmse"], found["psnr"]) == (0.0, 0.0, None)


def test_images_of_different_sizes():
    with pytest.raises(InputError, match=r"image_error: image: expected the reference's shape \(12, 16, 3\)"):
        image_error(flat(1.0)[:4], flat(1.0))


@pytest.mark.parametrize("exposure", [0.0, -2.0, 3.5])
@pytest.mark.parametrize("operator", OPERATORS)
def test_radiance_has_the_code_that_it_is_read_from(operator, exposure):
    codes = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    values = radiance(codes, operator, exposure)
    assert (np.diff(values, axis=0) > 0.0).all()
    assert (tonemap(values[None], operator, exposure)[0] == codes).all()


def test_radiance_is_off_by_half_a_step():
    """`none` has steps of 1/255; values beyond white are lost."""
    image = RNG.uniform(0.0, 254.4 / 255.0, (20, 30, 3))
    assert np.abs(radiance(tonemap(image, "none"), "none") - image).max() <= 0.5 / 255.0 + 1e-12
    assert radiance(np.uint8(255), "none") == pytest.approx(254.5 / 255.0)
