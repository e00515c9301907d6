"""Times and errors at growing image sizes, and the powers fitted to them."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from command_line import assert_refused, run
from studies import small_study, sphere

from clshade.base import text_tables
from clshade.errors import InputError
from clshade.images.metrics import rmse
from clshade.measure.report import csv_table, tables, variants
from clshade.measure.report.reference_image import reference
from clshade.measure.report.sizes import Growth, Point, growths, resolutions, statements
from clshade.measure.report.thinned_image import Estimate
from clshade.measure.report.variants import BASE, base_settings, named, variants_for
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin

SIDES = (100, 200, 400)


def growth(power: float, error_power: float, name: str = BASE, scale: float = 1.0, spread: float = 0.1) -> Growth:
    """Return times that scatter about a power of the number of pixels, and errors known to 10 %."""
    rng = np.random.default_rng(1)
    variant = next(each for each in variants.VARIANTS if each.name == name)
    points = []
    for side in SIDES:
        times = scale * side ** (2.0 * power) * np.exp(rng.normal(0.0, spread, 40))
        error = side ** (2.0 * error_power)
        points.append(Point((side, side), tuple(times), Estimate(error, 0.9 * error, 1.1 * error)))
    return Growth(variant, tuple(points))


def test_powers():
    found = growth(0.75, -0.25)
    assert found.time_power().exponent == pytest.approx(0.75, abs=0.05)
    assert found.error_power().exponent == pytest.approx(-0.25)
    for fitted in (found.time_power(), found.error_power()):
        assert fitted.low < fitted.exponent < fitted.high < fitted.low + 0.2
    exact = growth(0.75, -0.25, spread=0.0).time_power()
    assert exact == pytest.approx((0.75, 0.75, 0.75))
    wide = growth(0.75, -0.25, spread=0.5).time_power()
    assert wide.high - wide.low > 2 * (found.time_power().high - found.time_power().low)


def test_an_image_without_error_has_no_power_of_errors():
    found = growth(1.0, -0.5)
    exact = replace(found.points[0], error=Estimate(0.0, 0.0, 0.0))
    assert replace(found, points=(exact, *found.points[1:])).error_power() is None


def test_statements_compare_with_the_base():
    said = statements([growth(1.0, -0.5, spread=0.0), growth(1.0, -0.5, "gouraud", scale=2.0, spread=0.0)])
    assert said == ["Gouraud: 2.00, 2.00, 2.00 times the time of 1 sample, 1.00, 1.00, 1.00 times its error"]


def test_resolutions():
    wide, tall = builtin("icosphere", resolution=(160, 90)), builtin("icosphere", resolution=(300, 400))
    assert resolutions(wide) == [(480, 270), (960, 540), (1920, 1080)]
    assert resolutions(tall) == [(202, 269), (405, 540), (810, 1080)]
    assert resolutions(wide, (320, 64)) == [(64, 36), (320, 180)]


@pytest.mark.parametrize("widths", [(320,), (320, 320), (63, 320), (320, 1 << 15)])
def test_sizes_that_cannot_be_measured(widths, capsys):
    with pytest.raises(
        InputError, match=r"report: --sizes: expected two or more widths from 64 to 16384 columns, found"
    ):
        resolutions(sphere(), widths)
    found = run(capsys, "report", "icosphere", "--sizes", ",".join(map(str, widths)))
    assert_refused(found, "report: --sizes: expected two or more widths")


def test_growths_are_measured(device):
    """Errors of small images are those of the whole image."""
    scene = sphere()
    base = base_settings(scene)
    ways = named(variants_for(scene, base, device), [BASE, "gouraud"])
    found = growths(scene, ways, base, device, [(64, 48), (96, 72)])
    assert [each.variant.name for each in found] == [BASE, "gouraud"]
    for k, size in enumerate(((64, 48), (96, 72))):
        sized = replace(scene, camera=scene.camera.with_resolution(size))
        converged = reference(sized, base, device)
        for each in found:
            point = each.points[k]
            drawn = render(sized, settings=each.variant.settings(base), device=device)
            assert point.resolution == size
            assert point.error.rmse == pytest.approx(rmse(drawn.rgb, converged.rgb), rel=1e-6)
            assert point.error.low <= point.error.rmse <= point.error.high
            assert min(point.times) > 0.0


def test_the_tables_hold_them(device):
    found = replace(small_study(device), growths=(growth(1.0, -0.5), growth(0.5, -0.25, "gouraud")))
    lines = "\n".join(tables.lines(found)).splitlines()
    assert max(map(len, lines)) <= 100
    assert any(line.startswith("variant") and "ms, 400x400" in line for line in lines)
    assert any(line.startswith("Gouraud: ") and "times the time of 1 sample" in line for line in lines)
    assert "## Sizes" in tables.markdown(found, str, "")
    rows = list(csv.DictReader(io.StringIO(text_tables.as_csv(csv_table.HEADER, csv_table.rows(found)))))
    sizes = [row for row in rows if row["study"] == "size"]
    assert [(row["name"], row["columns"]) for row in sizes] == [
        (name, str(side)) for name in (BASE, "gouraud") for side in SIDES
    ]
    for row in sizes:
        assert float(row["rmse_low"]) == pytest.approx(0.9 * float(row["rmse"]))
        assert float(row["rmse_high"]) == pytest.approx(1.1 * float(row["rmse"]))
        assert float(row["ms_low"]) < float(row["ms_95_low"]) < float(row["ms"]) < float(row["ms_95_high"])
    powers = [row for row in rows if row["study"] == "size power"]
    assert [(row["name"], row["of"]) for row in powers] == [
        (name, f"{what} by the number of pixels") for name in (BASE, "gouraud") for what in ("time", "error")
    ]
    for row, power in zip(powers, (1.0, -0.5, 0.5, -0.25), strict=True):
        assert float(row["power"]) == pytest.approx(power, abs=0.1)
        assert float(row["power_low"]) < float(row["power"]) < float(row["power_high"])
    assert [each["variant"] for each in found.stats()["sizes"]] == [BASE, "gouraud"]
    assert "## Sizes" not in tables.markdown(small_study(device), str, "")
