"""Families of ways: work-precision curves, their powers, and what theory expects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies import SMALL, small_study

from clshade.errors import InputError
from clshade.images.metrics import rmse
from clshade.measure.defaults import FAMILIES
from clshade.measure.report import families, tables
from clshade.measure.report.families import (
    COUNTED,
    LAWS,
    PRECISION,
    ROUNDOFF,
    SAMPLED,
    SHADINGS,
    of_families,
)
from clshade.measure.report.power_law import Law, Power, expected, exponent
from clshade.measure.report.ray_count_errors import MOST, RayCountErrors, known
from clshade.measure.report.variants import BASE, base_settings, variants_for
from clshade.measure.timing import Spread
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera
from clshade.scene.lights import PointLight, RectangleLight
from clshade.scene.model import Mesh, Scene, Settings


@pytest.fixture
def found(device):
    return small_study(device)


def way(found, name, changes, ms, rmse=0.1, rms=1e-8, rays=None):
    """Return a measured variant with these changes, time and errors."""
    one = found.measured[0]
    return replace(
        one,
        variant=replace(one.variant, name=name, changes=changes),
        settings=Settings(**changes),
        frame_ms=Spread(0.9 * ms, ms, 1.1 * ms),
        approximation=replace(one.approximation, rmse=rmse),
        arithmetic=replace(one.arithmetic, rms=rms),
        rays=rays or {},
    )


def of(found, measured):
    return {each.name: each for each in replace(found, measured=tuple(measured)).families}


@pytest.mark.long
def test_the_slope_of_sampling_is_of_errors_that_the_reference_is_good_enough_for(found):
    known = found.reference.error
    errors = {1: 64.0 * known, 4: 16.0 * known, 16: 4.0 * known, 64: 0.9 * known}
    for family, (prefix, first) in SAMPLED.items():
        if family in COUNTED:
            continue
        named = {n: first if n == 1 else f"{prefix}{n}" for n in errors}
        measured = [way(found, named[n], {"samples": n}, float(n), error) for n, error in errors.items()]
        fall = of(found, measured)[family]
        assert fall.by_size().exponent == pytest.approx(-1.0)
        assert fall.by_time() == pytest.approx(fall.by_size())  # a millisecond a sample
        assert fall.gain() == pytest.approx(16.0)
        assert [each.known for each in fall.members] == [True, True, True, False]
        assert family not in of(found, measured[2:])
        assert family not in of(found, measured[1:])  # without one sample


@pytest.mark.parametrize("family", COUNTED)
def test_the_slope_of_rays_is_of_their_own_errors(found, family):
    """Not of those against the reference, most of which edges make."""
    errors = {1: 0.64, 4: 0.16, 16: 0.04, 64: 0.01, 256: None}
    field, (prefix, base) = COUNTED[family], SAMPLED[family]
    measured = [
        way(found, base if n == 16 else f"{prefix}{n}", {field: n}, float(n), rmse=0.3, rays={field: error})
        for n, error in errors.items()
    ]
    fall = of(found, measured)[family]
    assert fall.by_size().exponent == pytest.approx(-1.0)
    assert [each.size for each in fall.fit] == [1, 4, 16, 64]
    assert [each.size for each in fall.members] == [*errors]
    assert family not in of(found, measured[2:])
    assert family not in of(found, measured[1:])  # without one ray


def under_a_panel() -> Scene:
    """Return a floor below a square that a panel shines past: half of the image is penumbra."""
    corners = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], float)
    faces = [[0, 1, 2], [0, 2, 3]]
    meshes = (Mesh(4.0 * corners, faces), Mesh(0.5 * corners + [0, 1, 0], faces))
    camera = Camera((0, 0.9, 0), (0, 0, 0), (0, 0, -1), 1.0, (2.0, 2.0), (24, 24))  # below the square
    panel = RectangleLight((0.0, 3.0, 0.0), (0.6, 0.0, 0.0), (0.0, 0.0, 0.6))
    return Scene(meshes, camera, (panel,))


@pytest.mark.long
def test_errors_of_light_points_fall_as_theory_says(device):
    """Edges of the square, which the camera does not see, cut the light; measured: the power -0.93."""
    scene = under_a_panel()
    settings = base_settings(scene, shadows=True)
    errors = errors_by_count(device, scene, settings, "light_samples")
    assert -1.3 < exponent([*errors], [*errors.values()]) < -0.6
    assert errors[1] > 0.01
    dark = replace(scene, lights=(PointLight((0, 3, 0)),))
    frame = render(dark, settings=settings, device=device)
    assert RayCountErrors(dark, device).error(frame, "light_samples") is None


@pytest.mark.long
def test_errors_of_occlusion_rays_fall_as_theory_says(device):
    """Of a floor below a square, both seen from the side: measured: the power -0.72."""
    camera = Camera((0.0, 0.6, 3.0), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (24, 24))
    scene = replace(under_a_panel(), camera=camera, ambient=1.0)
    settings = base_settings(scene, ambient_occlusion=1, ao_distance=3.0)
    errors = errors_by_count(device, scene, settings, "ambient_occlusion")
    assert -1.0 < exponent([*errors], [*errors.values()]) < -0.5
    assert errors[1] > 0.01
    frame = render(scene, settings=base_settings(scene), device=device)
    assert RayCountErrors(scene, device).error(frame, "ambient_occlusion") is None


def errors_by_count(device, scene, settings, field):
    """Return the errors of 1, 4, 16 and 64 rays."""
    counts = RayCountErrors(scene, device)
    errors = {}
    for count in (1, 4, 16, 64):
        frame = render(scene, settings=replace(settings, **{field: count}), device=device)
        errors[count] = counts.error(frame, field)
    most = render(scene, settings=replace(settings, **{field: MOST[field]}), device=device)
    assert errors[64] == rmse(frame.rgb, most.rgb)
    assert known(field) >= 64
    assert counts.error(most, field) is None
    return errors


def test_the_slope_of_precision_is_of_the_roundoff(found):
    measured = [way(found, name, {"precision": name}, 1.0, rms=3.0 * size) for name, size in ROUNDOFF.items()]
    one = of(found, measured)[PRECISION]
    assert one.by_size() == pytest.approx((1.0, 1.0, 1.0))
    assert expected(one.by_size(), one.law) == "expected 1, that of a constant number of roundings"
    assert PRECISION not in of(found, measured[:2])
    more = way(found, "fast-4", {"precision": "fast", "samples": 4}, 1.0)
    assert [each.name for each in of(found, [*measured, more])[PRECISION].members] == list(ROUNDOFF)


def test_the_sphere_is_a_family_too(found):
    sphere = found.details.tessellation
    for shader, name in SHADINGS.items():
        one = of(found, found.measured)[name]
        assert one.by_size() == sphere.slope(shader)
        assert [each.ms for each in one.members] == list(sphere.ms[shader])
        assert min(each.ms.low for each in one.members) > 0.0


def test_where_a_power_differs_from_that_of_theory():
    falling, none, growing = Law(-0.75, "edges", "a", "b"), Law(0.0, "blur", "a", "b"), Law(1.0, "roundings", "a", "b")
    for law, above, below in (
        (falling, "falls slower", "falls faster"),
        (none, "grows", "falls"),
        (growing, "grows faster", "grows slower"),
    ):
        at = law.exponent
        assert expected(Power(at, at - 0.1, at + 0.1), law) == f"expected {at:g}, that of {law.of}"
        assert expected(Power(at + 0.5, at + 0.4, at + 0.6), law).endswith(f"; it {above}: a")
        assert expected(Power(at - 0.5, at - 0.6, at - 0.4), law).endswith(f"; it {below}: b")
    assert expected(Power(-0.4, -0.5, -0.3), falling._replace(above="")).endswith("; it falls slower")
    assert str(Power(-0.001, -0.002, 0.001)) == "0.00 (0.00 to 0.00)"


def test_the_table_names_every_family(found):
    errors = {1: 0.64, 4: 0.16, 16: 0.04, 64: 0.02}
    measured = [way(found, f"samples-{n}" if n > 1 else BASE, {"samples": n}, float(n), e) for n, e in errors.items()]
    text = "\n".join(tables.lines(replace(found, measured=tuple(measured))))
    assert max(map(len, text.splitlines())) <= 100
    for name in ("samples", *SHADINGS.values()):
        assert f"\n{name} (" in text
    assert "shaded (" not in text


def test_ways_of_families(device):
    scene = builtin("course", resolution=SMALL)
    known = variants_for(scene, base_settings(scene), device)
    assert set(LAWS) == {*FAMILIES, *SHADINGS.values()} == set(families.ABOUT)
    assert of_families(known, ()) == known
    chosen = [each.name for each in of_families(known, ("samples", "filter"))]
    assert chosen == [BASE, "samples-4", "samples-16", "samples-64", "trilinear", "trilinear-4", "trilinear-16"]
    if device.has_fp64:
        assert [each.name for each in of_families(known, (PRECISION,))] == [BASE, "fast", "float64"]
    with pytest.raises(InputError, match=r"--family: .* this scene are needed, precision has standard, fast$"):
        of_families([each for each in known if each.name != "float64"], (PRECISION,))
