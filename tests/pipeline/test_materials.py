"""Materials, placements and cameras: whole frames against the oracle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from devices import rendered
from oracle_asserts import assert_drawn

from clshade.pipeline.effective_settings import effective_settings
from clshade.scene.builtin import scenes
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, PointLight, Scene, Texture

KNOT = scenes.builtin("torus_knot", triangles=3000, resolution=(160, 120))
BODY = KNOT.meshes[0]
GLOSSY = Material(0.1, 0.7, 0.6, 20.0)
MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])
MIRROR[:3, 3] = 0.1, 0.2, 0.3


def cut_out() -> Scene:
    """Return a knot with alpha-tested holes, whose inside is lit too."""
    texture = Texture(np.random.default_rng(5).random((16, 16, 4)), wrap=("mirror", "repeat"))
    material = replace(GLOSSY, texture=texture, color=(0.5, 1.0, 2.0), alpha_cutoff=0.45, two_sided=True)
    return replace(KNOT, meshes=(replace(BODY, uvs=BODY.verts[:, :2] * 2.0, material=material),))


def mirrored() -> Scene:
    mesh = replace(BODY, normals=None, instances=np.stack([np.eye(4), MIRROR]), material=replace(GLOSSY, sides="front"))
    return replace(KNOT, meshes=(mesh,))


def mixed_sides() -> Scene:
    back_too = replace(BODY, normals=None, instances=MIRROR[None], material=replace(GLOSSY, color=(1.0, 0.0, 0.0)))
    return replace(KNOT, meshes=(back_too, replace(BODY, material=replace(GLOSSY, sides="front"))))


def orthographic(scene: Scene, plane: tuple[float, float]) -> Scene:
    return replace(scene, camera=replace(scene.camera, orthographic=True, plane=plane))


def close_up(scene: Scene) -> Scene:
    """Return the scene so close to the nearest vertex that its faces extend beyond the guard band."""
    camera = orthographic(scene, (1e-4, 1e-4)).camera
    verts = scene.meshes[0].verts.astype(np.float64)
    shift = verts[((verts - camera.eye) ** 2).sum(axis=1).argmin()] - camera.lookat
    return replace(scene, camera=replace(camera, eye=camera.eye + shift, lookat=camera.lookat + shift))


CASES = {
    "cut out": cut_out(),
    "mirrored": mirrored(),
    "mixed sides": mixed_sides(),
    "orthographic": orthographic(mirrored(), (8.0, 10.0)),
    "orthographic, cut out": orthographic(cut_out(), (8.0, 10.0)),
    "orthographic, beyond the guard band": close_up(cut_out()),
    "principal point": replace(cut_out(), camera=replace(KNOT.camera, principal=(0.2, 0.9))),
}


# What Gouraud shading and preset course do otherwise does not depend on the projection.
OTHERS = {
    ("standard", "gouraud"): ("cut out", "mixed sides", "orthographic", "principal point"),
    ("course", "phong"): ("mirrored", "mixed sides", "orthographic, cut out", "orthographic, beyond the guard band"),
}


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("preset", "shader", "name"),
    [
        *(("standard", "phong", name) for name in CASES),
        *((*how, name) for how, names in OTHERS.items() for name in names),
    ],
)
def test_frames_match_the_oracle(device, name, preset, shader):
    scene, settings = effective_settings(CASES[name], preset=preset, shader=shader, layers=("id", "Z"))
    frame = rendered(scene, settings=settings, device=device)
    assert frame.alpha.any(), "nothing was drawn"
    assert_drawn(frame)


@pytest.mark.long
def test_front_only_leaves_out_what_is_seen_from_behind(device):
    quad = Mesh(
        [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]], material=Material(sides="front")
    )
    for eye, covered in (([0, 0, 3], 1.0), ([0, 0, -3], 0.0)):
        camera = Camera(eye, [0, 0, 0], [0, 1, 0], 1.0, (0.2, 0.2), (8, 8))
        assert (rendered(Scene((quad,), camera), device=device).alpha == covered).all()


@pytest.mark.sampled
@pytest.mark.parametrize("alpha", [0.5, 0.3, 1.0])
def test_alpha_at_the_cutoff_is_seen(device, alpha):
    """Only alphas below the cutoff are discarded: a cutoff one float32 above the texture's alpha leaves nothing."""
    at = float(np.float32(alpha))
    image = np.concatenate([np.ones((3, 3, 3)), np.full((3, 3, 1), at)], axis=2)
    card = Mesh([[-1, -1, 0], [3, -1, 0], [-1, 3, 0]], [[0, 1, 2]], uvs=[[0, 0], [2, 0], [0, 2]])
    camera = Camera([0, 0, 3], [0, 0, 0], [0, 1, 0], 1.0, (0.2, 0.2), (8, 8))
    for cutoff, covered in ((at, 1.0), (float(np.nextafter(np.float32(at), np.float32(2.0))), 0.0)):
        mesh = replace(card, material=Material(texture=Texture(image), alpha_cutoff=cutoff))
        assert (rendered(Scene((mesh,), camera), device=device, shader="nolight").alpha == covered).all()


@pytest.mark.long
def test_two_sided_light_is_the_same_from_both_sides(device):
    quad = Mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])

    def seen(side: float, two_sided: bool) -> np.ndarray:
        camera = Camera([0, 0, 3 * side], [0, 0, 0], [0, 1, 0], 1.0, (0.2, 0.2), (9, 9))
        material = Material(0.0, 1.0, 0.0, two_sided=two_sided)
        scene = Scene((replace(quad, material=material),), camera, (PointLight([0, 0, 2 * side]),))
        return rendered(scene, device=device).rgb.copy()

    assert np.array_equal(seen(1.0, True), seen(-1.0, True)[:, ::-1])
    assert not seen(-1.0, False).any()


def test_vertex_colors_of_whole_numbers():
    """Unsigned integers are fractions of their type's maximum, as in textures; ones and zeros of a list are kept."""
    shares = np.array([[0, 51, 255], [255, 102, 0], [204, 255, 0]])
    for kind, factor in ((np.uint8, 1), (np.uint16, 257), (np.uint32, 16843009)):
        codes = (shares * factor).astype(kind)
        colors = Mesh(np.eye(3), [[0, 1, 2]], colors=codes).colors
        assert np.allclose(colors, shares / 255, rtol=1e-15)
        assert np.array_equal(Texture(codes[None]).image[0], np.float32(colors))
    for plain in ([[0, 1, 0], [1, 0, 2], [-1, 0, 0]], np.eye(3, dtype=bool), np.eye(3, dtype=np.int8)):
        assert np.array_equal(Mesh(np.eye(3), [[0, 1, 2]], colors=plain).colors, np.float64(plain))
