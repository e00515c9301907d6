"""`bench --features`: what compiling features out would save, and that it changes no bit."""

from __future__ import annotations

import json

import pytest

from clshade.cli.main import main
from clshade.errors import InputError
from clshade.measure.bench import features
from clshade.pipeline.features import FEATURES, Features
from clshade.scene.builtin.scenes import builtin

ROWS = [("textures", ("TEXTURED", "MIPMAPS")), ("CASTERS *", ("CASTERS",)), ("BLEND", ("BLEND",))]


def test_rows_are_what_a_scene_does_not_need():
    rows = dict(features.rows_of(Features.of(["PHONG", "DEPTH_TEST", "LIT", "TEXTURED"])))
    assert rows["textures"] == features.GROUPS["textures"][1:]
    assert not {"TEXTURED", "LIT", "PHONG", "DEPTH_TEST"} & set(rows)
    assert rows["CASTERS *"] == ("CASTERS",)
    assert {"BLEND", "SORTED", "alpha"} <= set(rows)
    everything = Features.of([feature.name for feature in FEATURES])
    assert not list(features.rows_of(everything))


def test_an_unknown_scene_is_refused():
    with pytest.raises(InputError, match="workload: expected names of phong, knot"):
        features.run(names=["teapott"])


def test_no_frames_are_refused():
    with pytest.raises(InputError, match="--frames: expected a whole number above 0, found 0"):
        features.run(rounds=0)


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(features, "SCENES", {"phong": (lambda: builtin("icosphere", resolution=(48, 32)), {})})
    monkeypatch.setattr(features, "rows_of", lambda _: iter(ROWS))


@pytest.mark.long
def test_the_table_is_printed_and_written(device, small, tmp_path, capsys):
    code = main(["bench", "--features", "--frames", "1", "-o", str(tmp_path / "found")])
    out = capsys.readouterr().out
    assert code == 0, out
    assert all(name in out for name, _ in ROWS)
    stats = json.loads((tmp_path / "found.json").read_text())
    assert [each["names"] for each in stats["savings"]] == [name for name, _ in ROWS]
    assert all(each["same"] for each in stats["savings"])
    assert (tmp_path / "found.csv").read_text().count("\n") == 4


@pytest.mark.long
def test_a_changed_bit_is_said(device, small, monkeypatch, capsys):
    monkeypatch.setattr(features, "same_bits", lambda *_: False)
    assert not features.run(rounds=1)
    assert "phong: other bits without BLEND" in capsys.readouterr().out
