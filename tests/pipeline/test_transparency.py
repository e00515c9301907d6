"""Transparent surfaces: closed forms, order, and layers."""

from dataclasses import replace

import layer_scenes
import numpy as np
import pytest
from devices import rendered

from clshade.errors import InputError
from clshade.pipeline.draw import TileLists
from clshade.pipeline.features import OPTIONAL
from clshade.pipeline.frame import Frame, same_bits
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, Scene, Settings, Texture

CAMERA = Camera((0, 0, -4), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (20, 20))
MIDDLE = (10, 10)
RED, GREEN, BLUE = np.eye(3)


def square(z: float, turned: bool = False, **fields) -> Mesh:
    """Return an unlit square that faces the camera; turned: cut along its other diagonal."""
    colors = {name: fields.pop(name) for name in ("colors", "alphas", "uvs") if name in fields}
    material = Material(**{"ka": 1, "kd": 0, "ks": 0, "blend": True, **fields})
    mesh = layer_scenes.square(1.0, z, material=material, **colors)
    return replace(mesh, faces=[[0, 1, 3], [1, 2, 3]]) if turned else mesh


def scene(*meshes: Mesh, background=None, **fields) -> Scene:
    return Scene(meshes, CAMERA, background=background, **fields)


def draw(device, drawn_scene: Scene, **options) -> Frame:
    """Draw with all features on, for which few programs are built, unless `options` say otherwise."""
    return rendered(drawn_scene, device=device, **{"forced": OPTIONAL, **options})


def test_alpha_comes_from_material_vertices_and_texture(device):
    texture = Texture(np.full((1, 1, 4), 0.5))
    uvs, alphas = np.zeros((4, 2)), np.full(4, 0.5)
    for mesh, alpha in (
        (square(0, opacity=0.5), 0.5),
        (square(0, alphas=alphas), 0.5),
        (square(0, colors=np.column_stack([np.ones((4, 3)), alphas])), 0.5),
        (square(0, texture=texture, uvs=uvs), 0.5),
        (square(0, texture=texture, uvs=uvs, alphas=alphas, opacity=0.5), 0.125),
        (square(0, texture=Texture(np.full((1, 1, 4), 7.0)), uvs=uvs), 1.0),
        (square(0, opacity=0.5, blend=False), 1.0),
        (square(0, opacity=0.5, alpha_cutoff=0.6), 0.0),
        (square(0, opacity=0.5, alpha_cutoff=0.4), 0.5),
    ):
        assert draw(device, scene(mesh)).alpha[MIDDLE] == alpha


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("visibility", ["depth", pytest.param("painter", marks=pytest.mark.long)])
def test_layers_are_composited_in_order_of_depth(device, order, visibility):
    blue, green = square(0, color=BLUE, opacity=0.5), square(1, color=GREEN, opacity=0.5)
    behind, before = (square(z, color=RED, blend=False) for z in (2, -1))
    for drawn, expected in (
        (scene(*(blue, green, behind)[::order]), [0.25, 0.25, 0.5, 1.0]),
        (scene(*(blue, green)[::order]), [0, 0.25, 0.5, 0.75]),
        (scene(blue, green, background=1.0), [0.25, 0.5, 0.75, 0.75]),
        (scene(blue, before), [1, 0, 0, 1]),
    ):
        assert draw(device, drawn, visibility=visibility).rgba[MIDDLE].tolist() == expected


@pytest.mark.long
@pytest.mark.parametrize("first", [2**24 - 3, 2**29 - 40])
def test_ranks_that_float32_does_not_count(device, monkeypatch, first):
    """In painter's order of many triangles, some of them transparent."""
    meshes = [square(z, color=(RED, GREEN, BLUE)[z % 3], opacity=0.3) for z in range(12)]
    drawn_scene = scene(*meshes, square(12, color=RED, blend=False))
    expected = draw(device, drawn_scene, visibility="painter")
    sort = TileLists.sort

    def further(self, frame):
        sort(self, frame)
        with frame.values["ranks"].writing() as ranks:
            ranks += first

    monkeypatch.setattr(TileLists, "sort", further)
    assert same_bits(draw(device, drawn_scene, visibility="painter"), expected)


@pytest.mark.parametrize("turned", [False, True])
def test_of_layers_in_one_plane_the_later_is_nearer(device, turned):
    """Cut along other diagonals their depths differ by rounding."""
    meshes = (square(0.3, color=RED, opacity=0.5), square(0.3, turned=turned, color=GREEN, opacity=0.5))
    wall = square(0.3, turned=turned, color=BLUE, blend=False)
    assert (draw(device, scene(*meshes)).rgba[6:14, 8:12] == [0.25, 0.5, 0, 0.75]).all()
    assert (draw(device, scene(*meshes[::-1])).rgba[6:14, 8:12] == [0.5, 0.25, 0, 0.75]).all()
    assert (draw(device, scene(meshes[0], wall)).rgba[6:14, 8:12] == [0, 0, 1, 1]).all()
    assert (draw(device, scene(wall, meshes[0])).rgba[6:14, 8:12] == [0.5, 0, 0.5, 1]).all()


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("orthographic", "tilt", "planes"), [(False, 0.0, 1), (True, 1 / 64, 1), (True, 1 / 64, 2), (True, 0.0, 300)]
)
def test_many_layers_in_one_plane(device, orthographic, tilt, planes):
    """Up to some eighty at a pixel, all equally near: the later face is nearer, whatever rounding makes of them. Of several
    planes one is in front of another by less than float32 tells apart, with every second face in it, or with one face."""
    columns, rows, count, alpha = 40, 36, 300, 0.3
    generator = np.random.default_rng(5)
    x, y = generator.integers(-5000, 15000, (2, count, 3))  # in 1/256 px, y down
    behind = np.arange(count) % planes != 0
    z = 40.0 + tilt * x / 256 + behind[:, None] * 2.0**-18
    verts = np.stack([columns / 2 - x / 256, rows / 2 - y / 256, z], axis=-1)
    colors = generator.random((count, 3))
    material, faces = Material(color=1.0, blend=True, opacity=alpha), np.arange(3 * count).reshape(-1, 3)
    mesh = Mesh(verts.reshape(-1, 3), faces, colors=np.repeat(colors, 3, axis=0), material=material)
    focal = 1.0 if orthographic else 40.0  # a unit is a pixel
    camera = Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), focal, (rows, columns), (columns, rows), orthographic=orthographic)
    drawn_scene = Scene((mesh,), camera, (), ambient=0.0, background=0.0)
    frame = draw(device, drawn_scene, shader="nolight", near=0.5, samples=1)
    expected, through = np.zeros((rows, columns, 3)), np.ones((rows, columns))
    at_x, at_y = np.meshgrid(256 * np.arange(columns) + 128, 256 * np.arange(rows) + 128)
    for k in sorted(range(count), key=lambda k: (behind[k], -k)):
        turn = np.sign((x[k, 1] - x[k, 0]) * (y[k, 2] - y[k, 0]) - (x[k, 2] - x[k, 0]) * (y[k, 1] - y[k, 0]))
        sides = [
            turn * ((x[k, b] - x[k, a]) * (at_y - y[k, a]) - (y[k, b] - y[k, a]) * (at_x - x[k, a]))
            for a, b in ((0, 1), (1, 2), (2, 0))
        ]
        share = through * alpha * (np.min(sides, axis=0) > 0)
        expected += share[..., None] * colors[k]
        through -= share
    assert abs(frame.rgb - expected).max() < 2e-6
    assert abs(frame.alpha - (1 - through)).max() < 2e-6


def test_each_sample_has_its_own_owner(device):
    """A pane in the plane of two walls, before one and behind the other, which share a column of pixels."""
    left, right = (
        replace(square(0, color=color, blend=False), verts=[[a, -1, 0], [b, -1, 0], [b, 1, 0], [a, 1, 0]])
        for a, b, color in ((-1.0, 0.1, BLUE), (0.1, 1.0, RED))
    )
    pane = square(0, color=GREEN, opacity=0.5)
    walls, both = (draw(device, scene(*meshes), samples=4).rgb[7:13] for meshes in ((left, right), (left, pane, right)))
    red, blue = walls[..., :1], walls[..., 2:]
    assert ((red > 0) & (blue > 0)).any()
    assert np.allclose(both, red * RED + blue * (GREEN + BLUE) / 2)


@pytest.mark.parametrize("depth", [1e-3, 0.0])
@pytest.mark.parametrize("samples", [1, 4])
def test_a_hundred_layers(device, depth, samples):
    """In rounds of eight, which the samples take in turns; at one depth the last face is nearest."""
    count, alpha = 100, 0.03125
    values = np.linspace(0.1, 1, count)
    meshes = [square(depth * k, color=value, opacity=alpha) for k, value in enumerate(values)]
    shares = alpha * (1 - alpha) ** np.arange(count)
    expected = (shares * (values if depth else values[::-1])).sum()
    frame = draw(device, scene(*meshes), samples=samples)
    np.testing.assert_allclose(frame.rgba[MIDDLE], [expected] * 3 + [shares.sum()], rtol=count * 2.0**-24)
    np.testing.assert_array_equal(frame.rgba[7:13, 7:13], np.broadcast_to(frame.rgba[MIDDLE], (6, 6, 4)))


def test_nothing_shines_through_alpha_one(device):
    front = square(0, color=GREEN, opacity=0.5, alphas=np.ones(4))
    full = replace(front, alphas=[1, 1, 1, 0.999], material=replace(front.material, opacity=1.0))
    assert draw(device, scene(full, square(1, color=1e30, blend=False))).alpha.max() == 1.0
    one = draw(device, scene(square(0, texture=Texture(np.ones((1, 1, 4))), uvs=np.zeros((4, 2)), color=GREEN)))
    assert one.rgba[MIDDLE].tolist() == [0, 1, 0, 1]
    faint = draw(device, scene(*(square(0.01 * k, opacity=1e-7) for k in range(20))))
    np.testing.assert_allclose(faint.alpha[MIDDLE], 1 - (1 - 1e-7) ** 20, rtol=1e-5)


@pytest.mark.parametrize(("layer_alpha", "face"), [(0.0, 1), (0.25, 1), (0.26, 3), (0.5, 3), (0.6, 5), (1.0, 5)])
def test_layers_show_what_is_opaque_enough(device, layer_alpha, face):
    meshes = square(0, opacity=0.25), square(1, opacity=0.5), square(2, blend=False)
    frame = draw(device, scene(*meshes), layers=("id", "Z", "object_id"), layer_alpha=layer_alpha)
    assert frame["id"][MIDDLE] in (face, face + 1)
    assert (frame["object_id"][MIDDLE], frame["Z"][MIDDLE]) == ((face + 1) // 2, pytest.approx(4 + face // 2))
    alone = draw(device, scene(meshes[0]), layers=("id", "Z"), layer_alpha=0.3)
    assert (alone["id"][MIDDLE], alone["Z"][MIDDLE], alone.alpha[MIDDLE]) == (0, np.inf, 0.25)


@pytest.mark.parametrize("value", [-0.1, np.nan, "half"])
def test_values_beyond_zero_to_one_are_refused(value):
    with pytest.raises(InputError, match=r"^Material: opacity: expected a number from 0 to 1"):
        Material(opacity=value)
    with pytest.raises(InputError, match=r"^Settings: layer_alpha: expected a number from 0 to 1"):
        Settings(layer_alpha=value)


def test_alphas_of_vertices_are_checked():
    mesh = square(0, colors=np.array([[255, 0, 0, 51]] * 4, np.uint8))
    np.testing.assert_allclose(mesh.alphas, 0.2)
    assert mesh.colors.shape == (4, 3)
    assert square(0, alphas=[2, 3, 4, 1]).alphas is None
    assert square(0, alphas=[-1, 3, 4, 1]).alphas.tolist() == [0, 1, 1, 1]
    with pytest.raises(InputError, match=r"^Mesh: alphas: expected one number per vertex \(4\)"):
        square(0, alphas=[1, 1])
    with pytest.raises(InputError, match=r"^Mesh: alphas: expected finite numbers"):
        square(0, alphas=[1, 1, 1, np.nan])
