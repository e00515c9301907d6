"""Scenes in which the fuzzer found a fault, cut down to what it needs; each failed with the fault planted again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from devices import rendered
from scene_fuzzer import problem

import clshade
from clshade.pipeline.features import OPTIONAL
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scalars, Scene, Settings
from clshade.scene.settings import Edges

SCENES = Path(__file__).with_name("scenes")
VERTICES: dict[str, Any] = {"interpolation": "affine", "texture_at": "vertex"}
LEAVING: dict[str, Any] = {"shader": "pbr", "precision": "float64", "samples": 15, "sample_shading": True, **VERTICES}
EDGES = Edges("all", 154.0, 0.5286888182258525, (0.6, 5.4, 1.6))


def drawn(device, name: str, forced: tuple[str, ...] = (), lanes: int | None = None, **settings: Any) -> str:
    """Draw a saved scene with all layers, and return what is wrong with it."""
    scene = clshade.load(SCENES / f"{name}.json")
    options: dict[str, Any] = {"forced": forced, "lanes": lanes if device.is_cpu else None}
    chosen = Settings.from_preset("standard", **{"layers": "all", **settings})
    return problem(rendered(scene, device=device, settings=chosen, **options))


@pytest.mark.long
def test_depths_closer_than_float32_tells(device):
    """The visible piece of a face was 4.2 * 2^-24 of its depth behind another's."""
    assert drawn(device, "close_depths") == ""


@pytest.mark.long
def test_alphas_of_0_at_edges(device):
    """With all features forced on, a pixel with an alpha of -1e-19 failed a test that its material has not."""
    assert drawn(device, "negative_alpha", OPTIONAL, 1, shadows=True) == ""


@pytest.mark.long
@pytest.mark.parametrize("name", ["blended_texels", "texels_at_cutoff"])
def test_alphas_that_jump_at_texels_edges(device, name):
    """Of faces that blend, and where texels have exactly the alpha of the cutoff."""
    assert drawn(device, name, OPTIONAL, 4) == ""


@pytest.mark.long
def test_faint_alphas_that_jump_at_texels_edges(device):
    """Of an opacity of 1e-7: the alphas differ by less than their margin at a cutoff."""
    colors = Scalars("data", ("black", "white"), (0.6746296516765734, 1.6458878312718688))
    assert drawn(device, "faint_texels", OPTIONAL, 4, shader="nolight", scalars=colors) == ""


@pytest.mark.long
def test_alphas_that_jump_at_samples(device):
    """At samples that are not the pixel's nearest: neither its id nor its alpha tells."""
    settings = {"shader": "nolight", "samples": 10, "visibility": "painter", "edges": EDGES, **VERTICES}
    assert drawn(device, "texels_of_samples", OPTIONAL, **settings) == ""


@pytest.mark.long
def test_corners_saturate_where_float32_cannot_hold_a_scalar(device):
    """The oracle interpolated between 1e-77 and 1e239, the layer between what float32 can hold."""
    corners, values = [[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]], np.array([[1e-77, 1e-77, 1e239]])
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (0.4, 0.4), (24, 24))
    scene = Scene((Mesh(corners, [[0, 1, 2]], scalars={"data": values}),), camera)
    frame = clshade.render(scene, device=device, shader="nolight", layers="all", scalars=Scalars("data"))
    assert problem(frame) == ""


@pytest.mark.long
def test_sums_of_alphas_over_samples(device):
    """Where few of 44 samples are transparent, the sum of their alphas rounds to its own size."""
    corners = 0.9 * np.array([[-1.0, -1, -1], [1.1, -0.93, -1], [0.9, 1.02, -1], [-0.95, 1, -1]])
    veils = np.random.default_rng(0).uniform(-1, 1, (90, 3))
    veil = Mesh(veils, np.arange(90).reshape(-1, 3), material=Material(blend=True, opacity=0.123))
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (0.6, 0.6), (48, 48))
    scene = Scene((Mesh(corners, [[0, 1, 2], [0, 2, 3]]), veil), camera)
    assert problem(clshade.render(scene, device=device, shader="nolight", samples=44, layers="all")) == ""


def test_items_that_leave_a_loop_early(device):
    """With one pixel per work-item Intel's runtime dereferenced pointers of work-items that had left the loop, and the
    process crashed. No fault is seen any more with the vectorizer let loose on today's kernels."""
    if "intel" not in device.platform.lower():
        pytest.skip("only Intel's compiler was wrong")
    assert drawn(device, "items_that_leave", OPTIONAL, 1, **LEAVING) == ""
