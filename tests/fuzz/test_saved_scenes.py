"""Scenes in which the fuzzer found a fault, cut down to what it needs; each failed with the fault planted again."""

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
NOLIGHT: dict[str, Any] = {"shader": "nolight"}
PBR: dict[str, Any] = {"shader": "pbr", "precision": "float64"}
DATA = Scalars("data", ("black", "white"), (0.6746296516765734, 1.6458878312718688))
EDGES = Edges("all", 154.0, 0.5286888182258525, (0.6, 5.4, 1.6))
# File, features forced on, settings; with the usual number of lanes, which changes no bit and shares programs
SAVED: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    # The visible piece of a face was 4.2 * 2^-24 of its depth behind another's: closer than float32 tells.
    "close_depths": ((), {}),
    # With all features forced on, a pixel at an edge with an alpha of -1e-19 failed a test that its material has not.
    "negative_alpha": (OPTIONAL, {"shadows": True}),
    # Alphas that jump at texels' edges: of faces that blend; of texels with exactly the alpha of the cutoff; with an opacity
    # of 1e-7, so that they differ by less than their margin at a cutoff; at samples that are not the pixel's nearest, where
    # neither its id nor its alpha tells.
    "blended_texels": (OPTIONAL, {}),
    "texels_at_cutoff": (OPTIONAL, {}),
    "faint_texels": (OPTIONAL, {**NOLIGHT, "scalars": DATA}),
    "texels_of_samples": (OPTIONAL, {**NOLIGHT, "samples": 10, "visibility": "painter", "edges": EDGES, **VERTICES}),
    # With one pixel per work-item Intel's runtime dereferenced pointers of work-items that had left a loop early, and the
    # process crashed. No fault is seen any more with the vectorizer let loose on today's kernels.
    "items_that_leave": (OPTIONAL, {**PBR, "samples": 15, "sample_shading": True, **VERTICES}),
}

pytestmark = pytest.mark.long


@pytest.mark.parametrize("name", SAVED)
def test_a_saved_scene(device, name):
    if name == "items_that_leave" and "intel" not in device.platform.lower():
        pytest.skip("only Intel's compiler was wrong")
    forced, settings = SAVED[name]
    options: dict[str, Any] = {"forced": forced, "lanes": 1 if name == "items_that_leave" and device.is_cpu else None}
    chosen = Settings.from_preset("standard", **{"layers": "all", **settings})
    assert problem(rendered(clshade.load(SCENES / f"{name}.json"), device=device, settings=chosen, **options)) == ""


def test_corners_saturate_where_float32_cannot_hold_a_scalar(device):
    """The oracle interpolated between 1e-77 and 1e239, the layer between what float32 can hold."""
    corners, values = [[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]], np.array([[1e-77, 1e-77, 1e239]])
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (0.4, 0.4), (24, 24))
    scene = Scene((Mesh(corners, [[0, 1, 2]], scalars={"data": values}),), camera)
    frame = clshade.render(scene, device=device, shader="nolight", layers="all", scalars=Scalars("data"))
    assert problem(frame) == ""


def test_sums_of_alphas_over_samples(device):
    """Where few of 44 samples are transparent, the sum of their alphas rounds to its own size."""
    corners = 0.9 * np.array([[-1.0, -1, -1], [1.1, -0.93, -1], [0.9, 1.02, -1], [-0.95, 1, -1]])
    veils = np.random.default_rng(0).uniform(-1, 1, (90, 3))
    veil = Mesh(veils, np.arange(90).reshape(-1, 3), material=Material(blend=True, opacity=0.123))
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (0.6, 0.6), (48, 48))
    scene = Scene((Mesh(corners, [[0, 1, 2], [0, 2, 3]]), veil), camera)
    assert problem(clshade.render(scene, device=device, shader="nolight", samples=44, layers="all")) == ""
