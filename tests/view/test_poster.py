"""Posters: tiles joined to one EXR and one PNG, the same pixels as in an image drawn at once, read by others too."""

import io
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from command_line import listing, needs_device, run
from PIL import Image
from scene_files import same, write

import clshade
from clshade import Camera, exr
from clshade.cli import frames as command
from clshade.errors import InputError
from clshade.images import png
from clshade.view import draw_poster, poster
from clshade.view.frame_folder import FrameFolder

SIZE = (150, 100)
SCENE = clshade.builtin("icosphere", level=2)


def test_the_command_has_the_default_of_the_function():
    assert command.TILE == poster.TILE


def draw(name: str = "p", **options):
    chosen = {"tile": 64, "layers": ("Z", "id"), "resolution": SIZE, **options}
    return draw_poster(SCENE, name, progress=False, **chosen)


def assert_same_images(folder: Path, name: str, **options) -> None:
    """As `clshade.render` draws them at once."""
    clshade.render(SCENE, resolution=SIZE, layers=("Z", "id")).save(folder / "whole", **options)
    one, header = exr.read(folder / f"{name}.exr")
    direct, expected = exr.read(folder / "whole.exr")
    assert same(one, direct)
    assert header["worldToNDC"].tolist() == expected["worldToNDC"].tolist()
    assert header["settings"] == expected["settings"]
    if (folder / f"{name}.png").exists():
        assert np.array_equal(png.read(folder / f"{name}.png", alpha=True), png.read(folder / "whole.png", alpha=True))


@pytest.mark.sampled
@needs_device
@pytest.mark.parametrize("options", [{}, {"half": True, "compression": "piz"}, {"compression": "none"}])
def test_a_poster_has_the_pixels_of_an_image_drawn_at_once(folder, options):
    poster = draw("p.exr", saving=options)
    assert (poster.run.drawn, poster.resolution, poster.paths) == (6, SIZE, ("p.exr", "p.png"))
    assert_same_images(folder, "p", **options)
    assert listing(folder) == ["p.exr", "p.png", "whole.exr", "whole.png"]
    assert poster.size == sum((folder / name).stat().st_size for name in poster.paths)


@needs_device
def test_others_read_it_and_its_background_may_be_transparent(folder):
    oiio = pytest.importorskip("OpenImageIO")
    draw()
    image = oiio.ImageInput.open("p.exr")
    spec = image.spec()
    assert (spec.tile_width, spec.tile_height, spec.width, spec.height) == (64, 64, *SIZE)
    channels, _ = exr.read("p.exr")
    for number, name in enumerate(spec.channelnames):
        kind = oiio.TypeDesc("uint" if name == "id" else "float")
        assert np.array_equal(image.read_image(number, number + 1, kind)[..., 0], channels[name]), name
    assert np.array_equal(np.asarray(Image.open("p.png")), png.read("p.png", alpha=True))
    draw("q", background=None, saving={"files": ("png",)})
    assert listing(folder) == ["p.exr", "p.png", "q.png"]
    frame = clshade.render(SCENE, resolution=SIZE, background=None)
    assert np.array_equal(png.read("q.png", alpha=True), frame.to_png8())


@needs_device
def test_a_run_that_was_stopped_goes_on(folder, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("clshade.view.poster.join_tiles", stop)
    with pytest.raises(KeyboardInterrupt):
        draw()
    assert listing(folder)[0] == "p.tiles"
    (folder / "p.tiles" / "0003.exr").unlink()
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    poster = draw()
    assert (poster.run.drawn, poster.run.skipped) == (1, 5)
    assert_same_images(folder, "p")


@needs_device
def test_tiles_that_are_kept_are_images(folder):
    assert draw(keep_tiles=True).tiles == "p.tiles"
    channels, header = exr.read("p.tiles/0005.exr")
    assert channels["R"].shape == (36, 22)
    joined, _ = exr.read("p.exr")
    assert np.array_equal(channels["id"], joined["id"][64:, 128:])
    assert header["worldToNDC"].tolist() != exr.read("p.exr")[1]["worldToNDC"].tolist()  # of the tile
    assert draw(tile=128).run.drawn == 2  # other tiles are drawn again


@needs_device
@pytest.mark.long
def test_workers_draw_the_same(folder):
    draw(workers=2)
    assert_same_images(folder, "p")


@needs_device
@pytest.mark.long
def test_one_larger_than_can_be_drawn_at_once(folder):
    """A tile of it has the ids that a camera of its own sees; the header says how large it is."""
    oiio = pytest.importorskip("OpenImageIO")
    options = {"resolution": (40_000, 300), "tile": 512, "layers": "id", "saving": {"files": ("exr",)}}
    assert draw_poster(SCENE, "p", progress=False, **options).run.drawn == 79
    image = oiio.ImageInput.open("p.exr")
    assert (image.spec().width, image.spec().height) == (40_000, 300)
    tiles = image.read_tiles(19_456, 20_480, 0, 300, 0, 1, 4, 5, oiio.TypeDesc("uint"))
    ids = tiles[:, 19_900 - 19_456 :, 0][:, :300]
    view, height = SCENE.camera, SCENE.camera.plane[0]
    lens = ((20_000 - 19_900) / 300, 0.5)
    camera = Camera(view.eye, view.lookat, view.up, view.focal, (height, height), (300, 300), lens)
    assert len(np.unique(ids)) > 50
    assert np.array_equal(ids, clshade.render(clshade.Scene(SCENE.meshes, camera, SCENE.lights), layers="id")["id"])


REFUSED = [
    ({"tile": 100}, "tile: expected a power of two"),
    ({"tile": 8}, "tile: expected a whole number from 16 to 8192"),
    ({"saving": {"files": ("exr", "npz")}}, "files: expected exr, png or both"),
    ({"saving": {"colorbar": True}}, "colorbar: cannot go with tiles"),
    ({"workers": 0}, "workers"),
    ({"saving": {"exposre": 1.0}}, "exposre"),
    ({"saving": {"compression": "dwaa"}, "layers": ("N",)}, "compression: expected a lossless one with layers"),
    ({"tile": 8192, "layers": "all"}, r"less than 2\^31 bytes"),
    ({"resolution": ()}, "resolution"),
    ({"resolution": (0, 5)}, "resolution"),
    ({"resolution": (200_000, 5)}, "resolution"),
]


@pytest.mark.parametrize(("options", "expected"), REFUSED)
def test_refused_arguments(folder, options, expected):
    write(folder / "p.tiles" / "poster.json", '{"digest": "of another poster", "kept": true}')
    write(folder / "p.tiles" / "0000.exr", "a tile")
    with pytest.raises(InputError, match=expected):
        draw(**options)
    assert listing(folder / "p.tiles") == ["0000.exr", "poster.json"]


@needs_device
def test_the_command(folder, capsys):
    command = ("poster", "icosphere", "--resolution", "90x70", "--tile", "64", "-o", "p")
    code, out, _ = run(capsys, *command, "--json")
    figures = json.loads(out)
    assert (code, figures["poster"]["resolution"], figures["drawn"]) == (0, [90, 70], 4)
    assert run(capsys, *command, "--quiet")[:2] == (0, "")
    assert listing(folder) == ["p.exr", "p.png"]


def test_a_folder_of_something_else_is_refused(folder):
    write(folder / "p.tiles" / "0001.exr", "of somebody else")
    with pytest.raises(InputError, match=r"p\.tiles: expected a folder with tiles of this poster, or none"):
        draw()
    with FrameFolder("q", "poster", "tiles").of("digest", kept=False):
        assert listing(folder / "q.tiles") == ["lock", "poster.json"]


def one_tile(value: float = 1.0, **options) -> bytes:
    file = io.BytesIO()
    exr.encode(file, {"R": np.full((3, 5), value, np.float32)}, tiled=True, **options)
    return file.getvalue()


@pytest.mark.parametrize(("damaged", "problem"), [
    (None, ""),
    (b"", "something else"),
    (b"\x76\x2f\x31\x01\x02", "damaged"),
    (one_tile()[:-1], "does not end with its pixels"),
    (one_tile() + b"x", "does not end with its pixels"),
    (one_tile()[:-200], "damaged|does not end"),
    (one_tile(compression="piz"), "other compression"),
    (one_tile(half=True), "other channels"),
])  # fmt: skip
def test_files_that_are_no_tiles_of_it_are_refused(folder, damaged, problem):
    if damaged is not None:
        (folder / "0.exr").write_bytes(damaged)
    (folder / "whole.exr").write_bytes(one_tile())
    with pytest.raises(InputError, match=rf"0\.exr: file: expected a tile of this image.*{problem}"):
        poster.join_tiles(io.BytesIO(), poster.tiled_header("whole.exr", (5, 3), 8, {}), ["0.exr"], 1, 1)


def test_headers_may_be_long(folder):
    (folder / "0.exr").write_bytes(one_tile(metadata={"objectNames": 300_000 * "x"}))
    file = io.BytesIO()
    poster.join_tiles(file, poster.tiled_header("0.exr", (5, 3), 8, {"objectNames": "y" * 70_000}), ["0.exr"], 1, 1)
    (folder / "joined.exr").write_bytes(file.getvalue())
    channels, header = exr.read("joined.exr")
    assert (channels["R"] == 1.0).all()
    assert header["objectNames"] == 70_000 * "y"


@pytest.mark.parametrize("alpha", [False, True])
def test_png_in_bands(alpha):
    rng = np.random.default_rng(0)
    image = np.cumsum(rng.integers(0, 3, (37, 29, 3 + alpha)), axis=0).astype(np.uint8)
    image[20:] = rng.integers(0, 256, (17, 29, 3 + alpha))
    file = io.BytesIO()
    png.encode_bands(file, 29, 37, (image[first : first + 10] for first in range(0, 37, 10)))
    assert np.array_equal(np.asarray(Image.open(file)), image)
    assert struct.unpack(">2I", file.getvalue()[16:24]) == (29, 37)
