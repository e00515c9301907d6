"""Errors by cause: the parts of an image's error, and the errors of approximate models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies import sphere

from clshade.images.metrics import rms
from clshade.measure.report.decomposition import (
    ARITHMETIC,
    OUTPUT,
    SAMPLING,
    Decomposition,
    Part,
    decompose,
    png_radiance,
)
from clshade.measure.report.model_errors import APPROXIMATIONS, ModelErrors
from clshade.measure.report.reference_image import reference
from clshade.measure.report.variants import base_settings
from clshade.pipeline import programs
from clshade.pipeline.renderer import render
from clshade.scene.model import Settings


@pytest.fixture(scope="module")
def studied(device):
    """Return a sphere, its converged image and the models of it, which keep their images."""
    scene = sphere()
    converged = reference(scene, base_settings(scene), device)
    return scene, converged, ModelErrors(scene, converged.settings, device)


@pytest.fixture(scope="module")
def plain(studied, device):
    return decomposed(studied, device, Settings.from_preset("standard"))


def decomposed(studied, device, settings):
    scene, converged, models = studied
    return decompose(scene, settings, device, converged, models)


# Models


@pytest.mark.long
def test_a_model_takes_the_named_fields_only(studied):
    course = Settings.from_preset("course")
    *_, models = studied
    assert models.approximated(course) == [*APPROXIMATIONS][:4]
    alone, all_of_them = models.difference(course, ["lighting_at"]), models.difference(course)
    assert np.array_equal(alone, models.difference(Settings.from_preset("standard", lighting_at="centroid")))
    assert not np.array_equal(alone, all_of_them)
    assert not models.difference(course, []).any()


# The parts


@pytest.mark.long
def test_the_parts_add_up(device, studied):
    """From the converged image to the PNG."""
    scene, converged, _ = studied
    decomposition = decomposed(studied, device, Settings.from_preset("course", ambient="tinted"))
    causes = [part.cause for part in decomposition.parts]
    assert causes == [*[*APPROXIMATIONS.values()][:4], SAMPLING, ARITHMETIC, OUTPUT]
    assert sum(part.share for part in decomposition.parts[:-1]) == pytest.approx(1.0)
    assert decomposition.parts[-1].share is None
    frame = render(scene, device=device, settings=decomposition.settings)
    assert decomposition.total == pytest.approx(rms(frame.rgb - converged.rgb))
    assert decomposition.png_total == pytest.approx(rms(png_radiance(frame) - converged.rgb))
    errors = {part.cause: part.rmse for part in decomposition.parts}
    assert errors[ARITHMETIC] < 1e-6 < errors[SAMPLING]
    assert errors["light at the centroid"] > errors["painter's order"] == 0.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"shader": "gouraud"}, "Gouraud shading"),
        ({"interpolation": "affine"}, "affine interpolation"),
        ({"samples": 16, "sample_shading": True}, SAMPLING),
    ],
)
def test_each_cause_is_found_where_it_is_planted(device, studied, plain, changes, cause):
    """What differs from the best settings has the error; all else is as before."""
    before = {part.cause: part.rmse for part in plain.parts}
    assert [*before] == [SAMPLING, ARITHMETIC, OUTPUT]
    settings = Settings.from_preset("standard", **changes)
    errors = {part.cause: part.rmse for part in decomposed(studied, device, settings).parts}
    if cause == SAMPLING:
        assert errors[SAMPLING] < before[SAMPLING] / 4
    else:
        assert errors[SAMPLING] == pytest.approx(before[SAMPLING], rel=0.05)
    assert errors.keys() - before.keys() == {cause} - {SAMPLING}
    assert errors[cause] > 1e-6


@pytest.mark.long
def test_an_error_of_arithmetic_is_found_where_it_is_planted(device, studied, plain, monkeypatch):
    """A coefficient of the power function in float32."""
    before, flatten = {part.cause: part.rmse for part in plain.parts}, programs.flatten
    monkeypatch.setattr(programs, "flatten", lambda names: flatten(names).replace("0.6931471824645996f", "0.6933f"))
    errors = {part.cause: part.rmse for part in decomposed(studied, device, plain.settings).parts}
    assert errors[ARITHMETIC] > max(5 * before[ARITHMETIC], 1e-6)
    assert errors[SAMPLING] == pytest.approx(before[SAMPLING], rel=0.05)
    assert errors.keys() == before.keys()


@pytest.mark.long
def test_the_arithmetic_is_not_known_without_float64(device):
    without = replace(device, has_fp64=False)
    converged = reference(sphere(), base_settings(sphere()), without)
    models = ModelErrors(sphere(), converged.settings, without)
    decomposition = decompose(sphere(), Settings.from_preset("standard"), without, converged, models)
    assert [part.cause for part in decomposition.parts] == [SAMPLING, OUTPUT]
    assert decomposition.remarks()[-1] == "arithmetic: not known: the device has no float64 to compare with"


def test_a_png_holds_no_radiance_above_one(device):
    """Below, its error is half a step: of the sRGB curve at most 2.4/1.055 / 255 wide, at white."""
    frame = render(sphere(), device=device)
    assert frame.rgb.max() > 1.01
    off = np.abs(png_radiance(frame) - np.minimum(frame.rgb, 1.0))
    assert 0.001 < off.max() < 0.005


def test_what_the_parts_do_not_say():
    """Whether sampling errs by more than the reference knows."""

    def remarks(sampling: float) -> list[str]:
        parts = (Part(SAMPLING, sampling, 0.5), Part(ARITHMETIC, 4.0, 0.5))
        return Decomposition(Settings.from_preset("standard"), parts, 5.0, 6.0, 1.0).remarks()

    assert remarks(3.0) == []
    assert remarks(1.5) == ["sampling: about as small as the reference's own error, 1"]
