"""Errors by cause: the parts of an image's error, and the errors of approximate models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies import SMALL, sphere

from clshade.images.metrics import rms
from clshade.measure.report.decomposition import (
    ARITHMETIC,
    NO_FINER,
    NO_FLOAT64,
    OUTPUT,
    SAMPLING,
    TESSELLATION,
    Decomposition,
    Part,
    decompose,
)
from clshade.measure.report.format_errors import png_radiance
from clshade.measure.report.model_errors import APPROXIMATIONS, ModelErrors
from clshade.measure.report.reference_image import reference
from clshade.measure.report.tessellation import FINER, finer_builtin
from clshade.measure.report.variants import base_settings
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Mesh, Settings


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
def test_model_errors_hold_no_aliasing(device):
    """They are differences of images with the same samples: 0 for the same model, whatever its samples, and all of the
    difference between two flat colors."""
    scene = sphere()
    best = Settings.from_preset("standard", precision="float64", samples=4)
    models = ModelErrors(scene, best, device)
    for same in (best, replace(best, samples=1), replace(best, precision="fast")):
        assert models.approximated(same) == []
        assert not models.difference(same).any()
    assert models.approximated(replace(best, resolve="weighted")) == ["resolve"]
    assert models.difference(replace(best, resolve="weighted")).any()
    gouraud = replace(best, samples=1, shader="gouraud")
    assert models.approximated(gouraud) == ["shader"]
    expected = [
        render(scene, device=device, shader=shader, samples=64, sample_shading=True).rgb.astype(np.float64)
        for shader in ("gouraud", "phong")
    ]
    assert np.array_equal(models.difference(gouraud), expected[0] - expected[1])


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
    """From the image of a finer shape to the PNG; each part's share of both totals."""
    scene, converged, models = studied
    found = decomposed(studied, device, Settings.from_preset("course", ambient="tinted"))
    causes = [part.cause for part in found.parts]
    assert causes == [TESSELLATION, *[*APPROXIMATIONS.values()][:4], SAMPLING, ARITHMETIC, OUTPUT]
    assert found.unknown == {}
    for shares in ([part.share for part in found.parts[:-1]], [part.png_share for part in found.parts]):
        assert sum(shares) == pytest.approx(1.0)
    assert found.parts[-1].share is None
    frame = render(scene, device=device, settings=found.settings)
    fine = ModelErrors(finer_builtin(scene), converged.settings, device).best_image
    best = converged.rgb - (models.best_image.astype(np.float64) - fine)
    assert found.total == pytest.approx(rms(frame.rgb - best))
    assert found.png_total == pytest.approx(rms(png_radiance(frame) - best))
    assert found.together == pytest.approx(np.sqrt(sum(part.rmse**2 for part in found.parts[:-1])))
    errors = {part.cause: part.rmse for part in found.parts}
    assert errors[ARITHMETIC] < 1e-6 < errors[SAMPLING]
    assert errors["light at the centroid"] > errors["painter's order"] == 0.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"shader": "gouraud"}, "Gouraud shading"),
        ({"interpolation": "affine"}, "affine interpolation"),
        ({"samples": 16, "sample_shading": True}, SAMPLING),
        ({"precision": "fast"}, ARITHMETIC),
    ],
)
def test_each_cause_is_found_where_it_is_planted(device, studied, plain, changes, cause):
    """What differs from the best settings has the error; all else is as before."""
    before = {part.cause: part.rmse for part in plain.parts}
    assert [*before] == [TESSELLATION, SAMPLING, ARITHMETIC, OUTPUT]
    settings = Settings.from_preset("standard", **changes)
    errors = {part.cause: part.rmse for part in decomposed(studied, device, settings).parts}
    assert errors[TESSELLATION] == before[TESSELLATION]
    if cause == SAMPLING:
        assert errors[SAMPLING] < before[SAMPLING] / 4
    else:
        assert errors[SAMPLING] == pytest.approx(before[SAMPLING], rel=0.05)
    if cause == ARITHMETIC:
        assert errors[ARITHMETIC] > 5 * before[ARITHMETIC]
    assert errors.keys() - before.keys() == {cause} - {SAMPLING, ARITHMETIC}
    assert errors[cause] > 1e-6


@pytest.mark.long
def test_causes_that_are_not_known_are_named(device):
    mesh = sphere().meshes[0]
    scene = replace(sphere(), name="own", meshes=(Mesh(mesh.verts, mesh.faces, normals=mesh.normals),))
    without = replace(device, has_fp64=False)
    converged = reference(scene, base_settings(scene), without)
    models = ModelErrors(scene, converged.settings, without)
    found = decompose(scene, Settings.from_preset("standard"), without, converged, models)
    assert found.unknown == {TESSELLATION: NO_FINER, ARITHMETIC: NO_FLOAT64}
    assert {part.cause: part.rmse for part in found.parts}.keys() == {SAMPLING, OUTPUT}
    assert found.lines()[-2:] == [f"{TESSELLATION}: not known: {NO_FINER}", f"{ARITHMETIC}: not known: {NO_FLOAT64}"]


def test_what_the_parts_do_not_say():
    """Causes that add to each other, make up for others, or are smaller than the reference knows."""

    def line(total: float, sampling: float = 3.0) -> list[str]:
        parts = (Part(TESSELLATION, 4.0, 0.5, 0.5), Part(SAMPLING, sampling, 0.5, 0.5))
        return Decomposition(Settings.from_preset("standard"), parts, total, total, {}, 1.0).lines()

    assert line(5.0) == [
        "total: RMSE 5, as a PNG 5; all causes but the PNG together are as much as if they were independent"
    ]
    assert "1.40 times what independent ones would be: some add to each other" in line(7.0)[0]
    assert "0.20 times what independent ones would be: some make up for others" in line(1.0)[0]
    assert line(5.0, sampling=1.5)[1] == "sampling: about as small as the reference's own error, 1"


# Finer shapes


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("icosphere", {"level": 3}),
        ("teapot", {"level": 4}),
        ("course", {"level": 3}),
        ("torus_knot", {"triangles": 2000}),
    ],
)
def test_built_in_shapes_can_be_finer(name, options):
    scene = builtin(name, **options, resolution=SMALL)
    changed = replace(scene.meshes[0], material=replace(scene.meshes[0].material, n=7.0))
    scene = replace(scene, meshes=(changed, *scene.meshes[1:]))
    finer = finer_builtin(scene)
    assert finer.camera is scene.camera
    assert finer.meshes[0].material == changed.material
    fixed = 4248 if name == "teapot" else 0  # triangles of the floor
    assert finer.face_count - fixed == FINER * (scene.face_count - fixed)


def test_other_shapes_cannot():
    scene = sphere()
    mesh = scene.meshes[0]
    moved = replace(scene, meshes=(replace(mesh, verts=mesh.verts + 1.0),))
    flat = replace(scene, meshes=(replace(mesh, normals=-mesh.normals),))
    there = replace(
        scene,
        meshes=(replace(mesh, instances=np.eye(4)[None] + [[0, 0, 0, 1], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]),),
    )
    for other in (moved, flat, there, replace(scene, name="own"), replace(scene, meshes=()), builtin("quads", count=2)):
        assert finer_builtin(other) is None
    assert finer_builtin(replace(scene, meshes=(mesh, mesh))) is None
