"""Grouping of channels into layers, and thumbnails of layers of any shape and type."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.images import exr
from clshade.images.figures import NOTHING, SIDE, thin, thumbnails
from clshade.images.image_file import color_group, group_channels

RNG = np.random.default_rng(3)


def named(*names):
    """Return a plane for each name, filled with its index."""
    return {name: np.full((2, 3), float(k)) for k, name in enumerate(names)}


def layers(*names):
    return {name: list(group.names) for name, group in group_channels(named(*names)).items()}


def test_channels_of_this_program():
    groups = layers(
        "R", "G", "B", "A", "Z", "N.X", "N.Y", "N.Z", "uv.U", "uv.V", "id", "albedo.R", "albedo.G", "albedo.B"
    )
    assert groups == {
        "RGB": ["R", "G", "B"],
        "A": ["A"],
        "Z": ["Z"],
        "N": ["N.X", "N.Y", "N.Z"],
        "uv": ["uv.U", "uv.V"],
        "id": ["id"],
        "albedo": ["albedo.R", "albedo.G", "albedo.B"],
    }


def test_channels_of_other_programs():
    """In any order and case, nested, alone, without a prefix; nothing is lost when names collide."""
    groups = layers(
        "B", "G", "R", "View.Depth.Z", "View.Normal.z", "View.Normal.x", "View.Normal.y", "X", "Y", "N.R", "N.G"
    )
    assert groups["RGB"] == ["R", "G", "B"]
    assert groups["View.Depth.Z"] == ["View.Depth.Z"]
    assert groups["View.Normal"] == ["View.Normal.x", "View.Normal.y", "View.Normal.z"]
    assert groups["XY"] == ["X", "Y"]
    hostile = ("N.X", "N.Y", "N.R", "N.G", "N", "n.x", "N.x", ".", "..R", "R", "r", "a.b.R", "")
    together = layers(*hostile)
    assert sorted(name for names in together.values() for name in names) == sorted(hostile)


def test_the_color_layer():
    assert color_group(named("View.R", "View.G", "View.B", "G", "B", "R"))[0] == "RGB"
    name, planes = color_group(named("Y", "A"))
    assert (name, [plane[0, 0] for plane in planes]) == ("Y", [0.0, 0.0, 0.0])
    name, planes = color_group(named("Z", "View.B", "View.G", "View.R"))
    assert (name, [plane[0, 0] for plane in planes]) == ("View", [3.0, 2.0, 1.0])
    assert color_group(named("Z", "N.X", "N.Y", "N.Z", "uv.U", "uv.V", "M.R", "M.G")) is None


def test_directions_and_positions():
    normals = RNG.normal(size=(8, 9, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[0] = 0.0  # the background
    pixels, note = thumbnails(exr.flatten({"N": normals.astype(np.float16)}))["N"]
    assert note == "(n + 1)/2"
    assert (pixels[0] == 0).all()
    # Half's ulp:
    assert np.abs(pixels[1:].astype(float) - 255 * (normals[1:] + 1) / 2).max() <= 0.5 + 255 / 2 * 2.0**-11
    points = 2.0 * normals
    points[1, 1] = np.nan
    pixels, note = thumbnails(exr.flatten({"P": points}))["P"]
    assert note == "each component's range"
    assert pixels[1, 1].tolist() == list(NOTHING)
    assert pixels.min() == 0
    assert pixels.max() == 255


def test_texture_coordinates_repeat():
    uv = np.array([[[0.0, 0.25], [1.5, -0.25], [np.nan, 0.5]]])
    pixels, note = thumbnails(exr.flatten({"uv": uv}))["uv"]
    assert note == "red u, green v, from 0 to 1, repeated"
    assert pixels.tolist() == [[[0, 64, 0], [128, 191, 0], list(NOTHING)]]


def test_depth_leaves_infinity_gray_and_is_not_flat_for_one_far_pixel():
    depth = np.linspace(2.0, 3.0, 400).reshape(20, 20)
    depth[0, 0], depth[0, 1], depth[0, 2] = np.inf, np.nan, 1e10
    pixels, note = thumbnails({"Z": depth})["Z"]
    assert "gray infinite or NaN" in note
    assert pixels[0, 0].tolist() == pixels[0, 1].tolist() == list(NOTHING)
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 100
    assert (thumbnails({"Z": np.full((2, 2), np.inf)})["Z"].pixels == NOTHING).all()
    assert thumbnails({"Z": np.full((2, 2), 7.0)})["Z"].pixels.shape == (2, 2, 3)


def test_names_of_things_have_colors_of_their_own():
    ids = np.arange(1000, dtype=np.uint32).reshape(20, 50)
    pixels = thumbnails({"id": ids})["id"].pixels.reshape(-1, 3)
    assert pixels[0].tolist() == [0, 0, 0]
    assert len(np.unique(pixels, axis=0)) >= 995  # of 190^3 colors; half a pair coincides by chance
    steps = np.abs(np.diff(pixels[1:].astype(int), axis=0)).sum(axis=1)
    assert np.median(steps) > 100  # neighbors look different
    again = thumbnails({"other": ids[::-1]})["other"].pixels
    assert (again[::-1].reshape(-1, 3) == pixels).all()


@pytest.mark.parametrize("encoded", [False, True])
def test_colors(encoded):
    linear = np.full((1, 1, 3), 0.5)
    pixels = thumbnails(exr.flatten({"albedo": linear}), encoded=encoded)["albedo"].pixels
    assert (pixels == (128 if encoded else 188)).all()  # sRGB of 0.5 is 0.7354


def test_many_pixels_are_thinned_not_averaged():
    for shape, expected in (((1000, 2000), (143, 286)), ((20000, 3), (318, 3)), ((3, 3), (3, 3)), ((1, 640), (1, 320))):
        plane = RNG.integers(0, 9, shape, dtype=np.uint32)
        small = thin(plane)
        assert small.shape == expected
        assert max(small.shape) <= SIDE
        assert small[0, 0] == plane[0, 0]
        assert set(np.unique(small)) <= set(range(9))
