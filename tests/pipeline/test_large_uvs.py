"""Texture coordinates far outside the image: the oracle's texels, on both sides of the seam."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle_asserts
import pytest
from devices import rendered, skip_unsupported

import clshade
from clshade import oracle
from clshade.pipeline.frame import Frame
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scene, Texture

CAMERA = Camera.from_fov((0, 0, 3), (0, 0, 0), (0, 1, 0), 45, (61, 47))


def texture(shape: tuple[int, int], wrap: Any, channels: int = 3) -> Texture:
    return Texture(np.random.default_rng(5).random((*shape, channels)), wrap)


def cards(uvs: np.ndarray, *textures: Texture, seed: int = 1, **fields: Any) -> Scene:
    """Return a mesh of large white triangles for each texture, with coordinates uvs (F, 3, 2)."""
    rng, meshes, count = np.random.default_rng(seed), [], len(uvs)
    for base_texture in textures:
        material = Material(texture=base_texture, **({} if base_texture.image.shape[2] == 3 else fields))
        faces = np.arange(3 * count).reshape(-1, 3)
        meshes.append(Mesh(rng.uniform(-1, 1, (3 * count, 3)), faces, uvs=uvs.reshape(-1, 2), material=material))
    return Scene(tuple(meshes), CAMERA)


def draw(device: Any, scene: Scene, **options: Any) -> Frame:
    arguments = {"shader": "nolight", "layers": ("Z", "id", "uv", "albedo"), **options}
    return rendered(scene, device=device, **arguments)


def assert_equals_oracle(frame: Frame) -> None:
    """Assert that the image and, with one sample, the layers equal the oracle's."""
    scene, settings = frame.scene, frame.settings
    expected = oracle.render(scene, settings)
    oracle_asserts.assert_frame(frame, expected, scene, settings)
    ties = oracle_asserts.assert_same_ids(frame, expected, scene, settings)
    oracle_asserts.assert_layers(frame, oracle.render_layers(scene, settings), scene, settings, skip=ties)
    assert frame.alpha.mean() > 0.15


def far(reach: float, count: int = 12) -> np.ndarray:
    """Return random coordinates (count, 3, 2) from -reach to reach."""
    return np.random.default_rng(2).uniform(-reach, reach, (count, 3, 2))


# Coordinates span 2^25 texels, where an error of one texel is 2^20 bounds; with small and large textures.
SIZES = [((8, 4), 2.0**22), ((4, 1024), 2.0**15)]


@pytest.mark.sampled
@pytest.mark.parametrize("wrap", ["repeat", "mirror", ("clamp", "repeat")], ids=str)
@pytest.mark.parametrize(("shape", "reach"), SIZES, ids=["few-texels", "many"])
def test_far_coordinates(device, shape, reach, wrap):
    assert_equals_oracle(draw(device, cards(far(reach), texture(shape, wrap))))


@pytest.mark.long
@pytest.mark.parametrize(
    "options",
    [
        {"lanes": 1},
        {"precision": "float64"},
        {"interpolation": "affine"},
        {"samples": 3, "sample_shading": True},
        {"texture_at": "vertex"},
    ],
    ids=str,
)
def test_far_coordinates_however_they_are_drawn(device, options):
    skip_unsupported(device, options)
    (shape, reach), *_ = SIZES
    assert_equals_oracle(draw(device, cards(far(reach), texture(shape, "repeat"), texture(shape, "mirror")), **options))


@pytest.mark.long
@pytest.mark.parametrize("wrap", ["repeat", "mirror"])
def test_far_but_close_to_each_other(device, wrap):
    """1/16 to 128 textures across a triangle, plus integer offsets up to 1e6: every mipmap level."""
    near = np.random.default_rng(3).uniform(0, 1, (12, 3, 2)) * np.exp2(np.arange(-4, 8)).reshape(-1, 1, 1)
    uvs = np.round(far(1e6)[:, :1]) + near
    assert_equals_oracle(draw(device, cards(uvs, texture((16, 8), wrap)), texture_filter="trilinear"))


@pytest.mark.long
@pytest.mark.parametrize("wrap", ["repeat", "mirror"])
def test_alpha_tests_far_away(device, wrap):
    """Holes are where the oracle has them."""
    scene = cards(far(2.0**20), texture((8, 4), wrap, 4), alpha_cutoff=0.5)
    opaque_frame = draw(device, cards(far(2.0**20), texture((8, 4), wrap)))
    frame = draw(device, scene)
    assert_equals_oracle(frame)
    assert (frame.alpha != opaque_frame.alpha).mean() > 0.1


@pytest.mark.parametrize("wrap", ["repeat", "mirror"])
def test_as_far_as_coordinates_go(device, wrap):
    """From 2^24 on float32 has no fractions: only the low parts hold them. At 2^39 they are accurate to 2^-9."""
    for exponent in (24, 26, 32, 39):
        frame = draw(device, cards(far(2.0**exponent), texture((8, 4), wrap)))
        report = clshade.check(frame, "all")
        assert report.passed
        assert report.error < 2.0 ** (exponent - 44)


def test_the_bound_knows_how_far_coordinates_reach(device):
    """It is 32 up to 2^21 texels; larger errors come from coordinates, which have only 48 bits."""
    for shape, reach, allowed in (((8, 8), 2.0**18, 32.0), ((8, 8), 2.0**22, 47.0), ((4, 1024), 2.0**20, 543.0)):
        uvs = far(reach)
        uvs[0, 0] = reach
        frame = draw(device, cards(uvs, texture(shape, "repeat")))
        report = clshade.check(frame, "all")
        assert report.passed
        assert report.allowed == allowed
        assert (report.bounds > 32.0) == (allowed > 500.0)
