"""The scanline renderer, the baseline of speed comparisons, draws the correct image."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from clshade import oracle
from clshade.errors import InputError
from clshade.measure.bench import scanline
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Settings

TEXTURED = builtin("course", level=3, resolution=(64, 48))


def bare(**fields):
    mesh = TEXTURED.meshes[0]
    return replace(TEXTURED, meshes=(replace(mesh, material=replace(mesh.material, texture=None, n=20.0), **fields),))


@pytest.mark.parametrize("shader", ["gouraud", "phong", "nolight"])
def test_scanline_is_the_oracle_but_for_edges(shader):
    scene = bare()
    image = scanline.render(scene, shader)[::-1]
    expected = oracle.render(scene, Settings.from_preset("course", shader=shader))
    apart = np.abs(image - expected.rgb).max(axis=2)
    # Corners are not snapped to 1/256 pixel here: interpolation shifts by as much, and a few pixels change owner.
    assert (apart > 0.05).mean() < 0.01
    assert np.median(apart[expected.id > 0]) < 1e-3
    assert ((image != 1.0).any(axis=2) == (expected.id > 0)).mean() > 0.995


@pytest.mark.parametrize(
    "scene",
    [
        TEXTURED,
        replace(bare(), preset="standard"),
        replace(bare(), background=None),
        replace(bare(), meshes=()),
        bare(verts=TEXTURED.meshes[0].verts + TEXTURED.camera.eye),
    ],
)
def test_scenes_that_it_cannot_draw_are_refused(scene):
    with pytest.raises(InputError, match=r"scanline.render: .*: expected"):
        scanline.render(scene)


def test_the_comparison_prints_every_way_and_how_far_images_are_apart(capsys):
    assert scanline.main(["--level", "2", "--size", "32", "--frames", "2", "--shader", "gouraud"]) == 0
    first, *ways, last = capsys.readouterr().out.splitlines()
    assert first == "256 triangles, 32 x 32, gouraud"
    assert [line.split("  ")[0] for line in ways] == [
        "plain Python loop",
        "render_object, a new object",
        "render_object, the same object",
        "Renderer.render, scene on the device",
    ]
    times = [float(re.search(r"([\d.]+) ms", line)[1]) for line in ways]
    ratios = [float(re.search(r"([\d,]+) times", line)[1].replace(",", "")) for line in ways]
    assert ratios[0] == 1.0
    assert np.allclose(ratios, times[0] / np.array(times), rtol=0.02, atol=0.6)
    assert last == "pixels that differ by more than 0.05: 0.00%"


def test_the_comparison_fails_on_a_wrong_image_and_on_bad_options(monkeypatch, capsys):
    monkeypatch.setattr(scanline, "measure", lambda scene, shader, frames: ({"plain Python loop": 1.0}, 0.02))
    assert scanline.main([]) == 1
    assert scanline.main(["--level", "0"]) == 2
    assert "level" in capsys.readouterr().err
