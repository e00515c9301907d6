"""Lines over surfaces that a color map colors: both in one frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from devices import needs_float64
from line_scenes import cube, floor, scene_of

import clshade
from clshade.pipeline.frame import same_bits
from clshade.pipeline.renderer import Renderer, render
from clshade.scene.model import Scalars
from clshade.scene.settings import Edges

COMMON = {"edges": Edges("all", color=(0, 0, 0.5)), "scalars": "height", "layers": ("Z", "id", "scalar")}
CASES = {
    "one sample": {},
    "samples": {"samples": 4, "resolve": "weighted"},
    "painter": {"visibility": "painter"},
    "float64": {"precision": "float64"},
    "lines alone": {"edges": Edges(("feature", "silhouette"), only=True)},
    "unlit": {"shader": "nolight", "scalars": Scalars("height", ("red", "blue"))},
}


def colored():
    """Return a cube with scalars on a floor without."""
    return scene_of(replace(cube(), scalars={"height": cube().verts[:, 1]}), floor())


@pytest.mark.parametrize("case", [pytest.param(c, marks=pytest.mark.long) if c != "one sample" else c for c in CASES])
def test_frames_are_the_oracles(device, case):
    needs_float64(device)
    frame = render(colored(), device=device, **{**COMMON, **CASES[case]})
    report = clshade.check(frame, "all")
    assert report.passed
    assert report.complete
    assert np.isfinite(frame["scalar"]).any()


@pytest.mark.long
def test_neither_changes_the_other(device):
    """The layer is that of the frame without lines, and off the lines so is the image; from every camera."""
    needs_float64(device)
    scene = colored()
    with (
        Renderer(scene, device=device, **COMMON) as both,
        Renderer(scene, device=device, **COMMON | {"edges": None}) as bare,
    ):
        for eye in ((3.1, 2.3, 4.2), (-2.0, 3.0, 1.5)):
            camera = replace(scene.camera, eye=np.array(eye))
            lined, plain = both.render(camera), bare.render(camera)
            assert np.array_equal(lined["scalar"], plain["scalar"], equal_nan=True)
            line = (lined.rgb == np.float32([0, 0, 0.5])).all(axis=-1)
            assert 50 < line.sum() < line.size / 2
            assert np.array_equal(lined.rgba[~line], plain.rgba[~line])
            assert same_bits(lined, both.render(camera))
