"""The curves of `stability`: scenes that grow stiff, errors, powers and the oracle's own limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clshade import oracle
from clshade.measure.stability import curves
from clshade.measure.stability.cases.light import exact_highlights, in_the_lobe
from clshade.measure.stability.curves import AXES, PLAIN, Row
from clshade.oracle import shade
from clshade.scene.model import Settings

EXPONENT, DISTANCE, ASPECT, NEARNESS = AXES
STANDARD = Settings.from_preset("standard", near=curves.NEAR)


@pytest.mark.long
def test_errors_are_as_in_theory(device, monkeypatch):
    monkeypatch.setattr(curves, "SIDE", 48)
    monkeypatch.setattr(curves, "FRAMES", 2)
    some = [replace(axis, values=(1.0, 1e3, 1e6)) for axis in AXES]
    rows = [curves.measure(axis, value, device) for axis in some for value in axis.values]
    for row in rows:
        assert set(row.ms) == set(row.rms) - {PLAIN}
        assert all(row.wrong[way] == 0 and row.ms[way] > 0.0 for way in row.ms)
        assert row.rms.get("float64", 0.0) < row.axis.own_error(row.value)
    errors = {axis.name: [row.rms for row in rows if row.axis is axis] for axis in some}
    first, _, last = (rms["standard"] for rms in errors["exponent"])
    assert 100.0 < last / first < 1e4  # sqrt(n) is 1000
    assert last < 1e-4
    distances = [rms["standard"] for rms in errors["distance"]]
    assert distances == pytest.approx(distances[:1] * 3, rel=0.05)
    assert errors["exponent"][2][PLAIN] > 0.02  # no digit is left
    assert errors["distance"][2][PLAIN] > 1e3 * errors["distance"][0][PLAIN]
    assert errors["aspect"][2][PLAIN] > 2.0 * errors["aspect"][2]["standard"] > 1e-5
    assert errors["nearness"][2]["standard"] > 1e4 * errors["nearness"][0]["standard"]
    tables = curves.results(rows, "$device$")
    assert max(map(len, "\n".join(tables.lines()).splitlines())) <= 100
    assert len(tables.tables[0].csv().splitlines()) == 13
    low, high = curves.figure(rows, "$device$").axes[0].get_ylim()
    assert low < high


@pytest.mark.parametrize("n", [1.0, 1e4, 1e9])
def test_the_oracle_s_own_error_of_a_highlight(n):
    """Against 50 digits."""
    pytest.importorskip("mpmath")
    points, normals, light = in_the_lobe(n, 60)
    values = shade.specular(shade.Directions.at(points, normals, np.zeros(3), light), np.float64(n))
    assert np.abs(values - exact_highlights(points, normals, light, n)).max() < EXPONENT.own_error(n)


def test_scenes_are_as_named(monkeypatch):
    monkeypatch.setattr(curves, "SIDE", 24)
    near, far = (oracle.render(curves.moved(distance), STANDARD) for distance in (1.0, 1e9))
    assert near.alpha.any()
    assert (near.id == far.id).all()
    assert np.abs(near.rgb - far.rgb).max() <= near.budget.max() * DISTANCE.own_error(1e9)
    for n in (1.0, 1e9):
        rgb = oracle.render(curves.highlight(n), STANDARD).rgb
        assert rgb.min() > 0.0
        assert rgb.max() == pytest.approx(1.0, abs=0.1)  # ka, kd and ks add up to 1.1
        assert rgb.max() > 1.1 * rgb.min()
    for aspect in (1.0, 1e6):
        corners = curves.needle(aspect).meshes[0].verts
        edges = np.roll(corners, -1, axis=0) - corners
        longest = np.linalg.norm(edges, axis=1).max()
        assert longest**2 / np.linalg.norm(np.cross(edges[0], edges[1])) == pytest.approx(aspect, rel=0.4)
    light = curves.near_light(1e6).lights[0].position
    assert np.linalg.norm(light - curves.near_light(1e6).camera.lookat) == pytest.approx(1e-6, rel=0.1)


def power(*errors: float):
    rows = [Row(ASPECT, 10.0**k, {PLAIN: rms}, {PLAIN: 0}, {PLAIN: 1.0}) for k, rms in enumerate(errors)]
    return curves.power(rows, PLAIN, ASPECT)


def test_powers_leave_out_useless_images_and_none():
    assert power(1e-6, 1e-5, 1e-4, 0.5, 3.0).exponent == pytest.approx(1.0)
    assert power(0.0, 1e-6, 1e-5, 1e-4).exponent == pytest.approx(1.0)
    assert power(1e-6, 1e-5, 0.5) is power(np.nan, np.nan, np.nan) is None


def test_pixels_that_are_not_finite_are_all_wrong(monkeypatch):
    monkeypatch.setattr(curves, "SIDE", 24)
    expected = oracle.render(curves.needle(1.0), STANDARD)
    for bad in (np.nan, np.inf):
        assert curves.errors(np.full((24, 24, 4), bad), expected)[0] == 1.0
    covered = np.concatenate([expected.rgb, 1.0 - expected.alpha[..., None]], axis=-1)
    assert curves.errors(covered, expected)[1] == expected.alpha.size
