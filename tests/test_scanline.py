"""The scanline renderer that speed is compared with draws the right image, or the comparison would be of nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clshade import oracle
from clshade.checks import scanline
from clshade.errors import InputError
from clshade.scene import Settings
from clshade.scenes import builtin

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
    # Corners are not rounded to 1/256 pixel here: interpolation moves by as much, and a few pixels change owner.
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
