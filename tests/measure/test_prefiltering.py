"""The error of image-based light against quadrature, which `report` prints."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.measure.report import prefiltering
from clshade.measure.report.tables import PREFILTERED
from clshade.scene.environment import Environment


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(prefiltering, "PLACES", 6)
    monkeypatch.setattr(prefiltering, "POINTS", 48)
    monkeypatch.setattr(prefiltering, "ROUGHNESSES", (0.3, 1.0))


def test_a_constant_environment_has_next_to_no_error(few):
    for each in prefiltering.prefiltering(Environment(np.full((4, 8, 3), 2.0))):
        assert each.metal < 0.02 * each.mean
        assert each.dielectric < 0.02
        assert len(each.stats()) == len(PREFILTERED)


def test_an_environment_with_a_lamp_has_some_that_grows_with_its_strength(few):
    image = np.full((16, 32, 3), 0.1)
    image[4:7, 10:13] = 5.0
    dim, bright = (prefiltering.prefiltering(Environment(image, intensity=factor)) for factor in (1.0, 10.0))
    for one, other in zip(dim, bright, strict=True):
        assert one.metal > 0.01 * one.mean
        np.testing.assert_allclose(other.metal, 10.0 * one.metal, rtol=1e-6)
