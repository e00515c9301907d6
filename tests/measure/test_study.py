"""What `report` measures: the variants of a scene, its reference, and the causes of an image's error."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from studies import SMALL, sphere

from clshade.errors import InputError
from clshade.images.metrics import rms
from clshade.measure.report import reference_image as reference_module
from clshade.measure.report import variants
from clshade.measure.report.decomposition import ARITHMETIC, OUTPUT, SAMPLING, Decomposition, decompose, png_radiance
from clshade.measure.report.measure import measure
from clshade.measure.report.model_errors import APPROXIMATIONS, ModelErrors
from clshade.measure.report.power_law import fitted
from clshade.measure.report.reference_image import averaged, reference, tiles
from clshade.measure.report.variants import BASE, base_settings, named, variants_for
from clshade.pipeline import programs
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scene, Settings

FLATTEN = programs.flatten
STANDARD = Settings.from_preset("standard")


def test_every_variant_is_another_way_and_those_of_a_scene_change_something(device):
    names = [variant.name for variant in variants.VARIANTS]
    changes = {tuple(sorted(variant.changes.items())) for variant in variants.VARIANTS}
    assert len(set(names)) == len(changes) == len(names)
    assert {*variants.COMMON, *variants.LIMITED} <= set(names)
    plain, textured = (
        {variant.name for variant in variants_for(builtin(name, resolution=SMALL), Settings(), device)}
        for name in ("quads", "course")
    )
    assert {BASE, "gouraud", "painter", "affine", "course"} <= plain
    assert textured - plain == {"vertex-texture", "trilinear", "trilinear-4", "trilinear-16"}


def test_variants_by_name(device):
    candidates = variants_for(sphere(), Settings(), device)
    assert named(candidates, []) == candidates
    assert [variant.name for variant in named(candidates, ["gouraud", BASE, "gouraud"])] == ["gouraud", BASE]
    of_pbr = variants_for(sphere(), Settings(shader="pbr"), device)
    without = variants_for(sphere(), Settings(), replace(device, has_fp64=False))
    for variants_of, name, message in (
        (candidates, "guro", r"expected names of standard, .*gouraud.* found .guro.: did you mean .gouraud.\?$"),
        (candidates, "vertex-texture", ".*found 'vertex-texture', which changes nothing of this scene"),
        (of_pbr, "gouraud", ".*found 'gouraud', which is another picture than shader pbr's"),
        (without, "float64", ".*found 'float64', which needs a device with float64"),
    ):
        with pytest.raises(InputError, match=f"--only: {message}"):
            named(variants_of, [name])


def triangle() -> Scene:
    """Return a white, unlit triangle over black that covers 0.4 * 0.7 / 2 of the image, without axis-aligned edges."""
    verts = np.array([[-0.2, -0.35, -1.0], [0.2, -0.31, -1.0], [-0.17, 0.35, -1.0]])
    camera = Camera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 1.0, (1.0, 1.0), (40, 40))
    mesh = Mesh(verts, np.array([[0, 1, 2]]), material=Material(ka=1.0, kd=0.0, ks=0.0, n=1.0))
    return Scene((mesh,), camera, (), np.ones(3), np.zeros(3), name="triangle")


def area(scene: Scene) -> float:
    """Return the triangle's fraction of the image, whose plane is one unit away and one unit wide."""
    (ax, ay, _), (bx, by, _), (cx, cy, _) = scene.meshes[0].verts
    return abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay)) / 2.0


@pytest.mark.long
def test_the_reference_approaches_the_covered_area_and_more_samples_the_reference(device):
    """Low-discrepancy points give an edge pixel's coverage to about samples^-0.75: 1/23 from 1 to 64."""
    scene = triangle()
    base = base_settings(scene)
    converged = reference(scene, base, device)
    assert (converged.rgb.shape, converged.samples) == ((40, 40, 3), 256)
    # About 60 pixels contain an edge, and a pixel's coverage is a multiple of 1/256.
    assert converged.rgb.mean() == pytest.approx(area(scene), abs=60 / 40**2 / 256)
    assert 0.0 < converged.error < 0.02
    chosen = named(variants_for(scene, base, device), [BASE, *(f"samples-{n}" for n in (4, 16, 64))])
    measured = measure(scene, chosen, base, device, converged, ModelErrors(scene, converged.settings, device), frames=1)
    errors = [measurement.error for measurement in measured]
    assert all(later < earlier for earlier, later in itertools.pairwise(errors))
    assert fitted((1, 4, 16, 64), errors).exponent == pytest.approx(-0.75, abs=0.2)
    assert errors[0] > 12 * errors[-1]
    assert all(measurement.arithmetic.passed for measurement in measured)


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


@pytest.fixture(scope="module")
def studied(device):
    scene = sphere()
    converged = reference(scene, base_settings(scene), device)
    return scene, converged, ModelErrors(scene, converged.settings, device)


def errors_of(studied, device, settings) -> tuple[Decomposition, dict[str, float]]:
    scene, converged, models = studied
    decomposition = decompose(scene, settings, device, converged, models)
    return decomposition, {part.cause: part.rmse for part in decomposition.parts}


@pytest.mark.long
def test_the_parts_add_up(device, studied):
    """From the converged image to the PNG; a model takes the named fields only."""
    scene, converged, models = studied
    decomposition, errors = errors_of(studied, device, Settings.from_preset("course", ambient="tinted"))
    assert list(errors) == [*[*APPROXIMATIONS.values()][:4], SAMPLING, ARITHMETIC, OUTPUT]
    assert sum(part.share for part in decomposition.parts[:-1]) == pytest.approx(1.0)
    assert decomposition.parts[-1].share is None
    frame = render(scene, device=device, settings=decomposition.settings)
    assert decomposition.total == pytest.approx(rms(frame.rgb - converged.rgb))
    assert decomposition.png_total == pytest.approx(rms(png_radiance(frame) - converged.rgb))
    assert errors[ARITHMETIC] < 1e-6 < errors[SAMPLING]
    assert errors["light at the centroid"] > errors["painter's order"] == 0.0
    course = Settings.from_preset("course")
    assert models.approximated(course) == [*APPROXIMATIONS][:4]
    alone, all_of_them = models.difference(course, ["lighting_at"]), models.difference(course)
    assert np.array_equal(alone, models.difference(Settings.from_preset("standard", lighting_at="centroid")))
    assert not np.array_equal(alone, all_of_them)
    assert not models.difference(course, []).any()


CAUSES = {
    "Gouraud shading": {"shader": "gouraud"},
    "affine interpolation": {"interpolation": "affine"},
    SAMPLING: {"samples": 16, "sample_shading": True},
    ARITHMETIC: {},
}


@pytest.mark.long
@pytest.mark.parametrize("cause", CAUSES)
def test_each_cause_is_found_where_it_is_planted(device, studied, monkeypatch, cause):
    _, before = errors_of(studied, device, STANDARD)
    assert [*before] == [SAMPLING, ARITHMETIC, OUTPUT]
    if cause == ARITHMETIC:
        monkeypatch.setattr(programs, "flatten", lambda names: FLATTEN(names).replace("0.6931471824645996f", "0.6933f"))
    _, errors = errors_of(studied, device, replace(STANDARD, **CAUSES[cause]))
    if cause == SAMPLING:
        assert errors[SAMPLING] < before[SAMPLING] / 4
    else:
        assert errors[SAMPLING] == pytest.approx(before[SAMPLING], rel=0.05)
    assert errors.keys() - before.keys() == {cause} - {SAMPLING, ARITHMETIC}
    assert errors[cause] > 1e-6
    assert cause != ARITHMETIC or errors[ARITHMETIC] > 5 * before[ARITHMETIC]


def test_a_png_holds_no_radiance_above_one(device):
    """Below, its error is half a step: of the sRGB curve at most 2.4/1.055 / 255 wide, at white."""
    frame = render(sphere(), device=device)
    assert frame.rgb.max() > 1.01
    assert 0.001 < np.abs(png_radiance(frame) - np.minimum(frame.rgb, 1.0)).max() < 0.005
