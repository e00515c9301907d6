"""Texture coordinates by planes: as accurate as the bound asks, and chosen by triangle and tile alone."""

from __future__ import annotations

import numpy as np
import pytest
from devices import rendered

import clshade
from clshade import Camera, Material, Mesh, PointLight, Renderer, Scene, Texture
from clshade.pipeline.frame import Frame


def flat_camera(size: int, focal: float) -> Camera:
    matrix = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1.0]])
    return Camera.from_matrix(matrix, np.eye(4), (size, size))


def patches(side: float, size: int = 256, focal: float = 300.0) -> Scene:
    """Return triangles of `side` pixels on a wavy sheet, with a noisy texture: from some tiles their corners are farther
    than edge functions of 31 bits allow, from others not."""
    verts, uvs = [], []
    for y in np.arange(0, size - 1, side):
        for x in np.arange(0, size - 1, side):
            for a, b in ((0, 0), (1, 0), (0, 1), (1, 0), (1, 1), (0, 1)):
                px, py = x + a * side, y + b * side
                z = 2.0 + 0.3 * np.sin(px * 0.013) + 0.2 * np.cos(py * 0.017)
                verts.append(((px - size / 2) / focal * z, (py - size / 2) / focal * z, z))
                uvs.append((px / size * 0.97 + 0.013, py / size * 0.93 + 0.021))
    texture = Texture(np.random.default_rng(1).random((2048, 2048, 3)).astype(np.float32))
    faces = np.arange(len(verts)).reshape(-1, 3)
    mesh = Mesh(np.array(verts), faces, uvs=np.array(uvs), material=Material(texture=texture))
    return Scene((mesh,), flat_camera(size, focal), lights=(PointLight((0, 0, 0), (1, 1, 1)),))


def bits(frame: Frame) -> np.ndarray:
    return frame.rgba.view(np.uint32).copy()


@pytest.mark.long
@pytest.mark.parametrize(
    "options",
    [*({"lanes": lanes} for lanes in (8, 4, 1)), *({"forced": {name}} for name in ("MIPMAPS", "MATERIALS", "SORTED"))],
    ids=str,
)
def test_the_choice_depends_on_triangle_and_tile_alone(device, options):
    """Work-items take tiles in another order each time; lanes and features that are not needed change nothing."""
    scene = patches(75.0)
    with Renderer(scene, device=device) as renderer:
        expected = bits(renderer.render())
        for _ in range(12):
            assert np.array_equal(bits(renderer.render()), expected)
    assert np.array_equal(bits(rendered(scene, device=device, **options)), expected)


@pytest.mark.long
@pytest.mark.parametrize("forced", ["VERTEX_COLORS", "MATERIALS"])
def test_unlit_textures_use_them_too(device, forced):
    scene = patches(75.0)
    plain = clshade.render(scene, device=device, shader="nolight")
    assert np.array_equal(bits(rendered(scene, device=device, shader="nolight", forced={forced})), bits(plain))


@pytest.mark.long
def test_coefficients_just_below_a_power_of_two_keep_their_digits(device):
    """A coordinate of -1 at a tile's corner: the plane's first coefficient is next to -2^23 units, and its values beyond."""
    size, rng = 512, np.random.default_rng(3)
    verts, uvs = [], []
    for row in range(size // 16):
        for column in range(size // 16):
            across, up = rng.uniform(1e-4, 5e-4, 2)
            corner_u = -(1.0 - rng.uniform(0, 1.5e-6))
            left, top = 16 * column, size - 16 * row
            for x, y in ((0, 0), (16, 0), (16, -16), (0, 0), (16, -16), (0, -16)):
                verts.append(((left + x - size / 2) / 256, (top + y - size / 2) / 256, 1.0))
                uvs.append((corner_u + across * (15.5 - x) + up * (15.5 + y), 0.5))
    texture = Texture(rng.random((4, 8192, 3)).astype(np.float32))
    faces = np.arange(len(verts)).reshape(-1, 3)
    mesh = Mesh(np.array(verts), faces, uvs=np.array(uvs), material=Material(texture=texture, ks=0.0))
    scene = Scene((mesh,), flat_camera(size, 256.0), lights=(PointLight((0, 0, 0), (1, 1, 1)),))
    assert clshade.check(clshade.render(scene, device=device), pixels=size * size).bounds < 2.0


@pytest.mark.sampled
@pytest.mark.parametrize("side", [1.3, 5.0, 17.0, 40.0])
def test_small_and_large_triangles_are_within_the_bound(device, side):
    frame = clshade.render(patches(side, size=128), device=device)
    assert clshade.check(frame, pixels=128 * 128).bounds < 4.0
