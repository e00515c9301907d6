"""Scalars shown by a color map: closed forms, files, bits that stay as they are."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from devices import rendered
from layer_scenes import square
from matplotlib import colormaps

from clshade import Camera, Material, Mesh, PointLight, Scalars, Scene, Settings, Texture, exr
from clshade.errors import InputError
from clshade.images import png
from clshade.pipeline.frame import Frame
from clshade.pipeline.gather import map_positions
from clshade.pipeline.struct_layout import MOST_POSITION
from clshade.scene.scalar_colors import ColorMap

FRONT = Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 2.0, (1.0, 1.0), (64, 64), orthographic=False)
ASIDE = Camera((2, 1, 3), (0, 0, 0), (0, 1, 0), 1.4, (0.75, 1.0), (48, 36))
LIGHT = PointLight((2, 3, 4))


def wave() -> Mesh:
    """A curved sheet of 8 x 8 cells; its scalars are its heights."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)))
    verts = np.stack([x, y, 0.3 * np.sin(4 * x + y)], axis=1).astype(np.float32)
    corner = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    faces = np.concatenate([corner[:, None] + [0, 1, 10], corner[:, None] + [0, 10, 9]])
    return Mesh(verts, faces, scalars={"data": verts[:, 2]})


def floor() -> Mesh:
    """A textured mesh without scalars."""
    texture = Texture(np.random.default_rng(1).random((4, 4, 3)))
    return square(1.5, -0.6, uvs=square().verts[:, :2], material=Material(texture=texture))


def drawn(device, scene: Scene, **options) -> Frame:
    return rendered(scene, device=device, **{"scalars": "data", "layers": "all", **options})


def test_a_step_is_sharp_within_a_triangle(device):
    """Two colors of a map meet where the scalar crosses its middle: the number is interpolated, never the color."""
    scene = Scene(square(scalars={"data": [-1.0, 1.0, 1.0, -1.0]}), FRONT)
    frame = drawn(device, scene, scalars=Scalars("data", ("black", "white")), shader="nolight")
    covered = frame.alpha > 0
    x = np.broadcast_to((np.arange(64) + 0.5) / 64 * 2 - 1, (64, 64))
    assert np.array_equal(frame.rgb[..., 0][covered], (x > 0)[covered].astype(np.float32))
    assert np.abs(frame["scalar"] - x)[covered].max() < 1e-6
    assert np.array_equal(np.isnan(frame["scalar"]), ~covered)


def test_an_unlit_png_shows_the_maps_colors(device):
    values = np.array([0.25, 3.0])
    scene, scalars = Scene(square(scalars={"data": values}), FRONT), Scalars("data", "viridis", (0, 4))
    frame = drawn(device, scene, shader="nolight", scalars=scalars)
    table = colormaps["viridis"](np.floor(values / 4 * 256).astype(int))[:, :3]
    codes = frame.to_png8()[frame["id"] == 1][0], frame.to_png8()[frame["id"] == 2][0]
    assert np.array_equal(codes, np.rint(255 * table))


def test_a_color_of_the_map_is_lit_as_any_other(device):
    """A map of one color, and the same mesh in that color: the same bits."""
    white, red = wave(), replace(wave(), scalars=None, colors=np.tile([1.0, 0.0, 0.0], (81, 1)))
    scalars = Scalars("data", ["red"])
    changed = replace(white, material=Material(color=(0, 1, 0)), colors=np.full((81, 3), 0.3))
    mapped, again = (drawn(device, Scene(mesh, ASIDE, LIGHT), scalars=scalars) for mesh in (white, changed))
    for other in (drawn(device, Scene(red, ASIDE, LIGHT), scalars=None), again):
        assert np.array_equal(mapped.rgba.view("u4"), other.rgba.view("u4"))


EXTREMES = [(1.0, 1e30), (1e9, 1e9 + 1e-3), (5e-324, 1e-310), (-1.7e308, 1.7e308), (0.5, 0.5), (0.0, 1e-300)]


@pytest.mark.parametrize("ends", EXTREMES)
def test_positions_of_any_numbers(ends):
    """Positions of a face's corners against fractions: their own, or in proportion where the map is too narrow."""
    color_map = ColorMap(np.zeros((259, 3), np.float32), *ends)
    rng = np.random.default_rng(3)
    values = rng.normal(size=(50, 3)) * 10.0 ** rng.uniform(-300, 300, (50, 1))
    values[:10] = ends[0] + rng.random((10, 3)) * (ends[1] / 2 - ends[0] / 2)
    for row, positions in zip(values, map_positions(values, color_map), strict=True):
        low, high = map(Fraction, ends)
        apart = [Fraction(float(value)) - low for value in row]
        largest = max(map(abs, apart))
        if not largest:
            assert not positions.any()
            continue
        factor = Fraction(256) / (high - low) if high > low else None
        assert np.isfinite(positions).all()
        if factor is None or factor * largest > 10**300:
            factor = Fraction(float(np.abs(positions).max())) / largest
            assert np.abs(positions).max() > MOST_POSITION
        for exact, position in zip(apart, positions.tolist(), strict=True):
            assert abs(Fraction(position) - exact * factor) <= largest * factor * Fraction(1, 2**49)


def test_whole_numbers_of_colors_are_exact():
    """29 of 100 colors: 29/100*100 would be below 29 in float64."""
    color_map = ColorMap(np.zeros((103, 3), np.float32), 0.0, 100.0)
    assert np.array_equal(map_positions(np.arange(101.0)[:, None], color_map)[:, 0], np.arange(101.0))


def test_a_map_without_width_separates_what_is_below_and_above(device):
    for values, scalars, color in (
        ([0.5, 0.5 + 1e-9, 0.5 + 1e-9, 0.5], Scalars("data", ("black", "red"), (0.5, 0.5)), [1, 0, 0]),
        (np.full(4, 0.5), Scalars("data", ("lime", "red")), [0, 1, 0]),
    ):
        frame = drawn(device, Scene(square(scalars={"data": values}), FRONT), scalars=scalars, shader="nolight")
        assert (frame.rgb[8:-8, 8:-8] == np.float32(color)).all()


@pytest.mark.sampled
@pytest.mark.parametrize("size", [(48, 36), (3, 2), (40, 300)])
def test_a_color_bar_leaves_the_image_as_it_is_and_files_name_the_scalars(opened, tmp_path, size):
    frame = drawn(opened, Scene((wave(), floor()), ASIDE.with_resolution(size), LIGHT), layers=("Z", "scalar"))
    frame.save(tmp_path / "plain")
    frame.save(tmp_path / "bar", colorbar=True)
    plain, bar = (png.read(tmp_path / f"{name}.png") for name in ("plain", "bar"))
    assert bar.shape[0] == size[1]
    assert bar.shape[1] >= size[0] + 16
    assert np.array_equal(bar[:, : size[0]], plain)
    assert len(np.unique(bar[:, size[0] :].reshape(-1, 3), axis=0)) > (20 if size[1] > 30 else 1)
    channels, header = exr.read(tmp_path / "bar.exr")
    assert np.array_equal(channels["R"], frame.rgb[..., 0])
    assert np.array_equal(channels["scalar"], frame["scalar"], equal_nan=True)
    data = frame.scene.meshes[0].scalars["data"]
    names = ("scalarName", "scalarLow", "scalarHigh")
    assert [header[name] for name in names] == ["data", np.float32(data.min()), np.float32(data.max())]


@pytest.mark.parametrize(
    ("meshes", "scalars", "message"),
    [
        ((wave(), floor()), "date", r"expected one of the scene's \(data\), found 'date': did you mean 'data'"),
        (floor(), "data", "expected a scene with scalars, found 'data'"),
    ],
)
def test_refusals(opened, meshes, scalars, message):
    with pytest.raises(InputError, match=f"render: scalars: {message}"):
        rendered(Scene(meshes, ASIDE), device=opened, scalars=scalars)
    with pytest.raises(InputError, match="Settings: layers: expected scalars with the layer scalar"):
        Settings(layers="scalar")
