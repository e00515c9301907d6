"""`bench --views`: its table, its files, and failure if the bits differ."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from devices import working_devices

from clshade.cli.main import main
from clshade.errors import InputError
from clshade.measure.bench import views
from clshade.pipeline.renderer import Renderer

needs_device = pytest.mark.skipif(not working_devices(), reason="no OpenCL device works here")


@pytest.fixture
def small(monkeypatch) -> None:
    monkeypatch.setattr(views, "RESOLUTION", (32, 24))
    monkeypatch.setattr(views, "LAYERS", ())


@needs_device
def test_every_way_is_timed(tmp_path, small):
    out = io.StringIO()
    prefix = str(tmp_path / "views")
    assert views.run(3, rounds=2, out=prefix, stream=out)
    written = [f"views.{kind}" for kind in ("csv", "json", "md", "png")]
    assert sorted(path.name for path in tmp_path.iterdir()) == written
    found = json.loads(Path(f"{prefix}.json").read_text())
    assert (found["views"], found["rounds"], found["same"]) == (3, 2, True)
    ways = {way["name"]: way for way in found["ways"]}
    assert list(ways) == list(views.WAYS)
    for name, other in views.WAYS.items():
        assert ways[name]["ms"]["median"] > 0.0
        assert ways[name]["ratio"] == pytest.approx(ways[other]["ms"]["median"] / ways[name]["ms"]["median"])
    assert "phong" in found["stages"]
    text = out.getvalue()
    assert "3 views of 10,816 triangles, 32x24" in text
    assert all(name in text for name in views.WAYS)
    assert "the bits of render_many are those of render" in text
    assert max(map(len, text.splitlines())) <= 160


@needs_device
def test_other_bits_fail(monkeypatch, small):
    draw = Renderer.render_many

    def wrong(self, cameras, out=None):
        frames = draw(self, cameras, out)
        frames.rgba[-1, 0, 0, 0] += 1.0
        return frames

    monkeypatch.setattr(Renderer, "render_many", wrong)
    out = io.StringIO()
    assert not views.run(2, rounds=1, stream=out)
    assert "the bits of render_many DIFFER" in out.getvalue()


def test_refusals(tmp_path, capsys):
    with pytest.raises(InputError, match="above 0"):
        views.run(0)
    for further in (["quads"], ["--targets"], ["--scaling"], ["--peers", "none"], ["--turn", "2"], ["--workers", "2"]):
        assert main(["bench", *further, "--views", "2"]) == 2
        assert "bench: expected either --views" in capsys.readouterr().err
    assert main(["bench", "--shadows", "--views", "2"]) == 2
    assert "expected either --shadows" in capsys.readouterr().err
    assert main(["bench", "--views", "2", "-o", str(tmp_path / "none" / "x")]) == 2
    assert "there is no folder" in capsys.readouterr().err
