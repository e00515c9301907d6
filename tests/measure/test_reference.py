"""The reference of `report`: its accuracy, its tiles, and its samples, which differ from every variant's."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from clshade.images.metrics import rmse
from clshade.measure.report import reference_image as reference_module
from clshade.measure.report import variants
from clshade.measure.report.measure import measure
from clshade.measure.report.model_errors import ModelErrors
from clshade.measure.report.power_law import fitted
from clshade.measure.report.reference_image import STEPS, averaged, first_step, reference, tiles
from clshade.measure.report.variants import BASE, base_settings, named, variants_for
from clshade.pipeline.camera_space import sample_positions
from clshade.pipeline.renderer import render
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scene, Settings


def triangle() -> Scene:
    """Return a white, unlit triangle over black that covers 0.4 * 0.7 / 2 of the image, without axis-aligned edges."""
    verts = np.array([[-0.2, -0.35, -1.0], [0.2, -0.31, -1.0], [-0.17, 0.35, -1.0]])
    camera = Camera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 1.0, (1.0, 1.0), (40, 40))
    material = Material(ka=1.0, kd=0.0, ks=0.0, n=1.0)
    mesh = Mesh(verts, np.array([[0, 1, 2]]), material=material)
    return Scene((mesh,), camera, (), np.ones(3), np.zeros(3), name="triangle")


def area(scene: Scene) -> float:
    """Return the triangle's fraction of the image, whose plane is one unit away and one unit wide."""
    (ax, ay, _), (bx, by, _), (cx, cy, _) = scene.meshes[0].verts
    return abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay)) / 2.0


@pytest.mark.long
def test_the_reference_approaches_the_covered_area(device):
    scene = triangle()
    converged = reference(scene, base_settings(scene), device)
    assert converged.rgb.shape == (40, 40, 3)
    assert converged.samples == 256
    # About 60 pixels contain an edge, and a pixel's coverage is a multiple of 1/256.
    assert converged.rgb.mean() == pytest.approx(area(scene), abs=60 / 40**2 / 256)
    assert 0.0 < converged.error < 0.02


@pytest.mark.long
def test_more_samples_are_nearer_to_the_reference(device):
    """Low-discrepancy points give an edge pixel's coverage to about samples^-0.75: 1/23 from 1 to 64."""
    scene = triangle()
    base = base_settings(scene)
    chosen = named(variants_for(scene, base_settings(scene), device), [BASE, *(f"samples-{n}" for n in (4, 16, 64))])
    converged = reference(scene, base, device)
    models = ModelErrors(scene, converged.settings, device)
    measured = measure(scene, chosen, base, device, converged, models, frames=1)
    errors = [measurement.error for measurement in measured]
    assert all(later < earlier for earlier, later in itertools.pairwise(errors))
    assert fitted((1, 4, 16, 64), errors).exponent == pytest.approx(-0.75, abs=0.2)
    assert errors[0] > 12 * errors[-1]
    assert all(measurement.arithmetic.passed for measurement in measured)


def test_the_mean_of_a_larger_image_is_the_mean_of_samples_on_a_grid(device):
    scene = triangle()
    base = base_settings(scene)
    image = averaged(scene, device, base, 4, 1)
    large = render(scene, settings=base, device=device, resolution=(160, 160)).rgb
    assert image[17, 12] == pytest.approx(large[68:72, 48:52].mean(axis=(0, 1)), rel=1e-6)
    assert rmse(image, reference(scene, base, device).rgb) < 0.05


def test_tiles_make_the_same_image(device, monkeypatch):
    """A moved principal point and a smaller plane: only the rounding of vertices to 1/65536 px may differ, which moves
    edges so little that none crosses a sample here."""
    scene = triangle()
    scene = replace(scene, camera=replace(scene.camera, principal=(0.45, 0.6), plane=(1.1, 0.9)))
    untiled = averaged(scene, device, base_settings(scene), 2, 4)
    monkeypatch.setattr(reference_module, "TILE", 32)
    assert len(list(tiles(scene.camera, 2))) == 9
    assert untiled.std() > 0.1
    assert averaged(scene, device, base_settings(scene), 2, 4) == pytest.approx(untiled, abs=1e-12)


def places(scale: int, samples: int) -> set[tuple[float, float]]:
    """Return the sample positions within a pixel that is divided into scale x scale pixels."""
    cells = itertools.product(range(scale), repeat=2)
    positions = sample_positions(samples) / 256.0
    return {((i + x) / scale, (j + y) / scale) for i, j in cells for x, y in positions.tolist()}


def test_the_reference_samples_where_no_variant_does():
    of_variants = set().union(*(places(1, variant.changes.get("samples", 1)) for variant in variants.VARIANTS))
    assert len(of_variants) == 1 + 4 + 16 + 64
    for step in STEPS[:-1]:
        assert len(places(*step)) == step[0] ** 2 * step[1]
        assert not places(*step) & of_variants
    assert places(*STEPS[-1]) <= of_variants  # it only estimates the last step's error


def test_images_too_large_for_many_samples_have_few():
    """The largest image has 4 samples, one of a screen's size 64 and more."""

    places = [first_step(math.prod(size)) for size in ((640, 480), (1920, 1080), (4096, 4096), (16384, 16384))]
    assert places == [0, 1, 3, 3]


def test_the_reference_keeps_what_belongs_to_the_scene(device):
    base = Settings.from_preset("course", shader="nolight", cull=True, near=0.5, shadows=True)
    settings = reference_module.best_settings(base, device)
    assert (settings.ambient, settings.shader, settings.cull, settings.near) == ("plain", "nolight", True, 0.5)
    assert settings.shadows
    assert (settings.visibility, settings.interpolation, settings.texture_at) == ("depth", "perspective", "pixel")
