"""Figures as PNG, PDF and SVG files; grouping of channels into layers, and thumbnails of layers of any type."""

import re
import zlib
from xml.etree import ElementTree

import numpy as np
import pytest

from clshade.errors import OutputError
from clshade.images import exr, figures, statistics
from clshade.images.decode import srgb_to_linear
from clshade.images.figures import NOTHING, thumbnails
from clshade.images.image_file import color_group, group_channels


def drawn():
    figure = figures.blank(3.0, 2.0)
    axes = figure.subplots()
    axes.imshow(np.random.default_rng(1).integers(0, 255, (900, 1600, 3)).astype(np.uint8))
    axes.set_title("error")
    return figure


@pytest.mark.sampled
@pytest.mark.parametrize("kind", figures.FORMATS)
def test_the_same_figure_gives_the_same_bytes(kind, tmp_path):
    paths = [tmp_path / f"{name}.{kind}" for name in "ab"]
    for path in paths:
        figures.save(drawn(), path, colors=64)
    first, second = (path.read_bytes() for path in paths)
    assert first == second
    assert not re.search(rb"CreationDate|ModDate|dc:date", first)
    with pytest.raises(OutputError, match="there is no folder"):
        figures.save(figures.blank(1.0, 1.0), tmp_path / "none" / f"a.{kind}")


@pytest.mark.long
def test_pdf(tmp_path):
    """Fonts are embedded as TrueType; pictures are compressed, and as large as the page shows them."""
    figures.save(drawn(), tmp_path / "a.PDF")
    data = (tmp_path / "a.PDF").read_bytes()
    assert data.startswith(b"%PDF")
    assert b"/FontFile2" in data
    assert b"/Type3" not in data
    assert 200 < int(re.search(rb"/Subtype /Image.*?/Width (\d+)", data, re.DOTALL)[1]) < 3.0 * figures.VECTOR_DPI
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", data, re.DOTALL)
    text = b"".join(zlib.decompress(stream) for stream in streams if stream[:1] == b"\x78")
    assert re.search(rb"\] TJ|\) Tj", text)  # text, not outlines


def test_svg(tmp_path):
    """One file that loads nothing, text as outlines, pictures within."""
    figures.save(drawn(), tmp_path / "a.svg")
    root = ElementTree.parse(tmp_path / "a.svg").getroot()
    tags = [element.tag.rpartition("}")[2] for element in root.iter()]
    assert ("path" in tags, "text" in tags) == (True, False)
    links = [element.get("{http://www.w3.org/1999/xlink}href", "") for element in root.iter()]
    assert sum(link.startswith("data:image/png;base64,") for link in links) == 1
    assert all(link.startswith(("#", "data:")) for link in links if link)


def named(*names):
    return {name: np.full((2, 3), float(k)) for k, name in enumerate(names)}


def layers(*names):
    return {name: list(group.names) for name, group in group_channels(named(*names)).items()}


def test_channels_become_layers():
    """Of other programs in any order and case, nested, alone; nothing is lost when names collide."""
    for names, groups in (
        ("R G B A Z", {"RGB": "R G B", "A": "A", "Z": "Z"}),
        ("N.X N.Y N.Z uv.U uv.V id", {"N": "N.X N.Y N.Z", "uv": "uv.U uv.V", "id": "id"}),
        ("albedo.R albedo.G albedo.B", {"albedo": "albedo.R albedo.G albedo.B"}),
        ("B G R V.Depth.Z X Y", {"RGB": "R G B", "V.Depth.Z": "V.Depth.Z", "XY": "X Y"}),
        ("V.Normal.z V.Normal.x V.Normal.y", {"V.Normal": "V.Normal.x V.Normal.y V.Normal.z"}),
    ):
        assert layers(*names.split()) == {name: channels.split() for name, channels in groups.items()}
    hostile = ("N.X", "N.Y", "N.R", "N.G", "N", "n.x", "N.x", ".", "..R", "R", "r", "a.b.R", "")
    assert sorted(name for names in layers(*hostile).values() for name in names) == sorted(hostile)


def test_the_color_layer():
    assert color_group(named("View.R", "View.G", "View.B", "G", "B", "R"))[0] == "RGB"
    name, planes = color_group(named("Y", "A"))
    assert (name, [plane[0, 0] for plane in planes]) == ("Y", [0.0, 0.0, 0.0])
    name, planes = color_group(named("Z", "View.B", "View.G", "View.R"))
    assert (name, [plane[0, 0] for plane in planes]) == ("View", [3.0, 2.0, 1.0])
    assert color_group(named("Z", "N.X", "N.Y", "N.Z", "uv.U", "uv.V", "M.R", "M.G")) is None


def test_directions_and_positions():
    normals = np.random.default_rng(3).normal(size=(8, 9, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[0] = 0.0  # the background
    pixels, note = thumbnails(exr.flatten({"N": normals.astype(np.float16)}))["N"]
    assert note == "(n + 1)/2"
    assert (pixels[0] == 0).all()
    # Half's ulp:
    assert np.abs(pixels[1:].astype(float) - 255 * (normals[1:] + 1) / 2).max() <= 0.5 + 255 / 2 * 2.0**-11


def test_a_color_beside_the_image_is_shown_as_it_is():
    codes = np.uint8([[[0, 99, 255], [1, 2, 3]]])
    linear = srgb_to_linear(codes / 255.0)
    for encoded, channels in ((True, codes / 255.0), (False, linear)):
        flat = exr.flatten({"rgb": np.zeros(channels.shape), "albedo": channels})
        assert thumbnails(flat, encoded=encoded)["albedo"].pixels.tolist() == codes.tolist()


def test_luminances_without_stops_have_colors_of_their_own():
    pixels = statistics.false_colors(np.array([[0.0, -1.0, np.inf, np.nan, 0.5, 2.0]]), -1.0, 1.0).pixels[0]
    special = statistics.BLACK, statistics.BLACK, statistics.INFINITE, statistics.NAN
    assert [tuple(pixel) for pixel in pixels[:4].tolist()] == [*special]
    assert pixels[4].argmax() == 2 != pixels[5].argmax()  # blue at the low end


def test_texture_coordinates_repeat():
    pixels, note = thumbnails(exr.flatten({"uv": np.array([[[0.0, 0.25], [1.5, -0.25], [np.nan, 0.5]]])}))["uv"]
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
    pixels = thumbnails({"id": np.arange(1000, dtype=np.uint32).reshape(20, 50)})["id"].pixels.reshape(-1, 3)
    assert pixels[0].tolist() == [0, 0, 0]
    assert len(np.unique(pixels, axis=0)) >= 995  # of 190^3 colors; half a pair coincides by chance
    assert np.median(np.abs(np.diff(pixels[1:].astype(int), axis=0)).sum(axis=1)) > 100  # neighbors look different
