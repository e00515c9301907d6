"""What casters let pass of a light, in closed form: one by one, in any order, opaque or not; and ambient occlusion."""

from dataclasses import replace
from typing import Any

import layer_scenes
import numpy as np
import pytest
from caster_meshes import box, sphere
from devices import rendered, skip_unsupported

from clshade.pipeline.frame import Frame
from clshade.scene.camera import Camera
from clshade.scene.model import Light, Material, Mesh, PointLight, RectangleLight, Scene, Texture

CAMERA = Camera((0.2, -9.0, 7.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1.0, (1.2, 1.2), (48, 48))
LIGHT = PointLight((0.0, 0.0, 10.0), (1.0, 1.0, 1.0))
UVS = (layer_scenes.square().verts[:, :2] + 1.0) / 2.0


def square(z: float, half: float = 1.0, **fields: Any) -> Mesh:
    """Return a square of two triangles, parallel to the floor. fields: of its material."""
    more = {name: fields.pop(name) for name in ("alphas", "uvs") if name in fields}
    return layer_scenes.square(half, z, material=Material(ka=0.1, kd=0.8, ks=0.0, two_sided=True, **fields), **more)


def card(z: float = 3.0, **fields: Any) -> Mesh:
    """Return a square whose shadow is that of the square at z = 3."""
    return square(z, (10.0 - z) / 7.0, **fields)


def half(z: float = 3.0) -> Mesh:
    return card(z, blend=True, opacity=0.5)


def holed() -> Texture:
    """Return a texture of alpha 1 with a square hole."""
    image = np.ones((8, 8, 4), np.float32)
    image[2:6, 2:6, 3] = 0.0
    return Texture(image, name="holed")


def draw(device, *cards: Mesh, light: Light = LIGHT, **options: Any):
    scene = Scene((square(0.0, 4.0), *cards), CAMERA, (light,), np.zeros(3), (0.0, 0.0, 0.0))
    return rendered(scene, device=device, **{"layers": ("Z", "P", "id"), "shadows": True, "samples": 1, **options})


def shares(device, *cards: Mesh, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the share of the light that arrives at the floor, (K,), and where the light meets the square at z = 3."""
    frame, bare = draw(device, *cards, **options), draw(device, **options)
    floor = (frame["id"] > 0) & (frame["id"] <= 2)
    return frame.rgb[floor][:, 0] / bare.rgb[floor][:, 0], 0.7 * frame["P"][floor][:, :2]


def inside(place: np.ndarray, edge: float = 1.0) -> np.ndarray:
    return (np.abs(place) < edge - 0.01).all(axis=1)


def outside(place: np.ndarray, edge: float = 1.0) -> np.ndarray:
    return (np.abs(place) > edge + 0.01).any(axis=1)


CARDS: dict[str, tuple[tuple[Mesh, ...], float]] = {
    "one card": ((half(),), 0.5),
    "two cards": ((half(), half(2.0)), 0.25),
    "three cards": ((half(), half(2.0), half(4.0)), 0.125),
    "an opaque card behind": ((half(), card(2.0)), 0.0),
}


@pytest.mark.sampled
@pytest.mark.parametrize(("cards", "expected"), CARDS.values(), ids=CARDS)
def test_cards_multiply_what_they_let_pass(opened, cards, expected):
    share, place = shares(opened, *cards)
    assert inside(place).sum() > 50
    assert (share[inside(place)] == np.float32(expected)).all()
    assert (share[outside(place)] == 1.0).all()


@pytest.mark.sampled
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_nothing_comes_through_alpha_1(opened, precision):
    """Also of a card that may blend: not 2^-128, the least share that is counted."""
    skip_unsupported(opened, {"precision": precision})
    share, place = shares(opened, card(blend=True, alphas=np.array([1.0, 1.0, 1.0, 0.5])), precision=precision)
    within = inside(place) & (place[:, 0] > place[:, 1] + 0.1)  # the first of two triangles
    assert within.sum() > 20
    assert (share[within] == 0.0).all()


@pytest.mark.parametrize(("fields", "expected"), [({}, 0.0), ({"blend": True, "opacity": 0.75}, 0.25)], ids=str)
def test_a_card_casts_its_hole_and_its_alpha(opened, fields, expected):
    share, place = shares(opened, card(alpha_cutoff=0.5, texture=holed(), uvs=UVS, **fields))
    hole, rim = inside(place, 0.4), inside(place, 0.9) & outside(place, 0.6)
    assert hole.sum() > 5 < rim.sum()
    assert (share[hole] == 1.0).all()
    np.testing.assert_allclose(share[rim], expected, rtol=1e-5)


def test_alpha_of_vertices_is_that_where_the_light_crosses(opened):
    share, place = shares(opened, card(blend=True, alphas=np.array([0.0, 1.0, 1.0, 0.0])))
    within = inside(place)
    # P is up to 12 from the eye: 8 roundings of that.
    np.testing.assert_allclose(share[within], 1.0 - (place[within, 0] + 1.0) / 2.0, atol=8 * 12 * 2.0**-24)


def test_each_of_many_triangles_counts_once(opened):
    """Of a ball with more triangles than one node of the hierarchy has, and a leaf that is not full."""
    verts, faces = sphere(12, 14)
    assert len(faces) > 256
    assert len(faces) % 16
    share, place = shares(opened, Mesh(verts + [0.0, 0.0, 3.0], faces, material=half().material))
    within = (place**2).sum(axis=1) < 0.9**2
    assert within.sum() > 30
    assert (share[within] == 0.25).all()  # in and out


def test_any_order_gives_the_same_bits(opened):
    cards = [card(z, blend=True, opacity=o) for z, o in ((1.0, 0.3), (2.0, 0.7), (3.0, 0.13), (4.0, 0.41))]
    first = draw(opened, *cards)
    for order in ((3, 1, 0, 2), (2, 3, 1, 0)):
        frame = draw(opened, *(cards[k] for k in order))
        both = (first["id"] <= 2) & (frame["id"] <= 2)
        assert both.sum() > 500
        assert (frame.rgb[both] == first.rgb[both]).all()


SIZED: dict[str, Light] = {
    "sphere": replace(LIGHT, radius=0.5),
    "rectangle": RectangleLight((0.0, 0.0, 10.0), (0.5, 0.0, 0.0), (0.0, -0.4, 0.0), (1.0, 1.0, 1.0)),
}
# How far from the line to its center the lines to a light's points meet the square at z = 3.
PENUMBRA = 0.5 * 3.0 / 10.0


@pytest.mark.parametrize("light", SIZED.values(), ids=SIZED)
def test_a_card_halves_each_point_of_a_light_of_finite_size(opened, light):
    share, place = shares(opened, half(), light=light, light_samples=4)
    assert inside(place, 1.0 - PENUMBRA).sum() > 30
    assert (share[inside(place, 1.0 - PENUMBRA)] == 0.5).all()
    assert (share[outside(place, 1.0 + PENUMBRA)] == 1.0).all()
    assert ((share > 0.51) & (share < 0.99)).sum() > 10  # some points of the light shine past the card


# Ambient occlusion


GRAY = Material(ka=(0.5, 0.6, 0.7), kd=0.4, ks=0.2, n=9.0)
ABOVE = Camera((0.0, 6.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 1.0, (1.0, 1.0), (24, 24))


def quad(corners: Any) -> Mesh:
    return Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=GRAY)


def floor(half: float = 4.0) -> Mesh:
    return quad([[-half, 0, -half], [-half, 0, half], [half, 0, half], [half, 0, -half]])


def closed(mesh: tuple[np.ndarray, np.ndarray], up: float = 0.0, scale: float = 1.0) -> Mesh:
    verts, faces = mesh
    return Mesh(scale * verts[:, [1, 2, 0]] + [0.0, up, 0.0], faces, material=GRAY)


def draw_occlusion(device, *meshes: Mesh, camera: Camera, **options: Any) -> Frame:
    scene = Scene(meshes, camera, (), ambient=(1.0, 0.9, 0.8), background=0.1)
    return rendered(scene, device=device, **{"layers": ("Z", "id", "P", "AO"), "ambient_occlusion": 4, **options})


def test_a_closed_box_is_dark_inside(device):
    """Its diagonal is 3.46 long."""
    camera = replace(ABOVE, eye=(0.3, 0.2, 0.5), lookat=(0.9, -0.8, -0.9), focal=0.5)
    frame = draw_occlusion(device, closed(box()), camera=camera, ao_distance=3.5, ambient_occlusion=9)
    assert (frame["id"] > 0).all()
    assert not frame["AO"].any()
    assert not frame.rgb.any()
    assert (draw_occlusion(device, closed(box()), camera=camera, ao_distance=1e-30)["AO"] == 1.0).all()


def beside_a_wall(device, rays: int, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the layer on a floor to the right of an endless wall at x = 0, and distances from it."""
    camera = replace(ABOVE, eye=(1.2, 3.0, 0.0), lookat=(1.2, 0.0, 0.0), plane=(0.7, 0.7))
    wall = quad([[0, 0, -4000], [0, 0, 4000], [0, 0.8, 4000], [0, 0.8, -4000]])
    frame = draw_occlusion(device, floor(5000.0), wall, camera=camera, ambient_occlusion=rays, **options)
    on_floor = (frame["id"] <= 2) & (frame["id"] > 0)
    return frame["AO"][on_floor], frame["P"][on_floor][:, 0]


def test_beside_a_wall_the_form_factor_is_missing(device):
    """A strip of height h at right angles, a away, has the form factor (1 - a/sqrt(a^2 + h^2))/2: the projection of its
    arc to the floor, by Nusselt's analog. The mean over the pixels, whose rays are shifted evenly, converges to it."""
    mean_errors, errors = {}, {}
    for rays in (4, 64):
        openness, a = beside_a_wall(device, rays, ao_distance=1e5)
        missing = openness - (1.0 - 0.5 * (1.0 - a / np.hypot(a, 0.8)))
        mean_errors[rays], errors[rays] = abs(missing.mean()), np.sqrt((missing**2).mean())
    assert mean_errors[4] < 0.01
    assert mean_errors[64] < 1e-3
    assert errors[4] < 0.15
    assert errors[64] < 0.02


def test_what_is_farther_away_does_not_count(device):
    openness, a = beside_a_wall(device, 16, ao_distance=0.5)
    assert (openness[a > 0.5] == 1.0).all()
    assert (openness[(a > 0.0) & (a < 0.2)] < 0.9).all()


def test_of_a_sphere_on_a_plane_the_form_factor_is_missing(device):
    """A sphere of radius r whose center is d away from a point, at an angle t to the normal above the horizon, has the form
    factor (r/d)^2 cos t."""
    ball = closed(sphere(24, 48), 0.5 + 1e-6, 0.5)
    camera = replace(ABOVE, eye=(2.0, 2.0, 0.0), lookat=(1.4, 0.0, 0.0))
    frame = draw_occlusion(device, floor(), ball, camera=camera, ambient_occlusion=64, ao_distance=100.0)
    seen = (frame["id"] > 0) & (frame["id"] <= 2)
    to_center = np.array([0.0, 0.5, 0.0]) - frame["P"][seen]
    distance = np.linalg.norm(to_center, axis=1)
    missing = (frame["AO"][seen] - (1.0 - (0.5 / distance) ** 2 * to_center[:, 1] / distance)).mean()
    assert seen.sum() > 300
    assert abs(missing) < 2e-3  # the mesh lies within the sphere
