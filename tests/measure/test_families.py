"""Families of ways: work-precision curves, their powers, and what theory expects."""

from __future__ import annotations

from dataclasses import replace

import pytest
from studies import SMALL, small_study

from clshade.errors import InputError
from clshade.measure.defaults import FAMILIES
from clshade.measure.report import families, tables
from clshade.measure.report.families import LAWS, PRECISION, ROUNDOFF, SAMPLED, SHADINGS, of_families
from clshade.measure.report.power_law import Law, Power, expected
from clshade.measure.report.variants import BASE, base_settings, variants_for
from clshade.measure.timing import Spread
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Settings


@pytest.fixture
def found(device):
    return small_study(device)


def way(found, name, changes, ms, rmse=0.1, rms=1e-8):
    """Return a measured variant with these changes, time and errors."""
    one = found.measured[0]
    return replace(
        one,
        variant=replace(one.variant, name=name, changes=changes),
        settings=Settings(**changes),
        frame_ms=Spread(0.9 * ms, ms, 1.1 * ms),
        approximation=replace(one.approximation, rmse=rmse),
        arithmetic=replace(one.arithmetic, rms=rms),
    )


def of(found, measured):
    return {each.name: each for each in replace(found, measured=tuple(measured)).families}


def test_the_slope_of_sampling_is_of_errors_that_the_reference_is_good_enough_for(found):
    known = found.reference.error
    errors = {1: 64.0 * known, 4: 16.0 * known, 16: 4.0 * known, 64: 0.9 * known}
    for family, (prefix, first) in SAMPLED.items():
        named = {n: first if n == 1 else f"{prefix}{n}" for n in errors}
        measured = [way(found, named[n], {"samples": n}, float(n), error) for n, error in errors.items()]
        fall = of(found, measured)[family]
        assert fall.by_size().exponent == pytest.approx(-1.0)
        assert fall.by_time() == pytest.approx(fall.by_size())  # a millisecond a sample
        assert fall.gain() == pytest.approx(16.0)
        assert [each.known for each in fall.members] == [True, True, True, False]
        assert family not in of(found, measured[2:])
        assert family not in of(found, measured[1:])  # without one sample


def test_the_slope_of_precision_is_of_the_roundoff(found):
    measured = [way(found, name, {"precision": name}, 1.0, rms=3.0 * size) for name, size in ROUNDOFF.items()]
    one = of(found, measured)[PRECISION]
    assert one.by_size() == pytest.approx((1.0, 1.0, 1.0))
    assert expected(one.by_size(), one.law) == "expected 1, that of a constant number of roundings"
    assert PRECISION not in of(found, measured[:2])
    more = way(found, "fast-4", {"precision": "fast", "samples": 4}, 1.0)
    assert [each.name for each in of(found, [*measured, more])[PRECISION].members] == list(ROUNDOFF)


def test_the_sphere_is_a_family_too(found):
    sphere = found.tessellation
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
    with pytest.raises(InputError, match=r"--family: .* this scene; precision has standard, fast$"):
        of_families([each for each in known if each.name != "float64"], (PRECISION,))
