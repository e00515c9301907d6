"""PNG files: every code is preserved, and a file is written completely or not at all."""

from __future__ import annotations

import os
import struct
import zlib

import numpy as np
import pytest
from scene_files import chunk

from clshade.errors import InputError
from clshade.images import png
from clshade.images.image_file import resolution_of


def noise(shape):
    return np.random.default_rng(4).integers(0, 256, shape, np.uint8)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.png"


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (67, 75), (16384, 1), (1, 16384)])
def test_round_trip(path, shape):
    codes = noise((*shape, 3))
    png.write(path, codes)
    pixels = png.read(path)
    assert pixels.dtype == np.uint8
    assert np.array_equal(pixels, codes)


def test_every_layout(path):
    codes, wide = noise((13, 11, 3)), noise((13, 11, 4))
    for view in (
        codes[::-1],
        codes[:, ::-1],
        codes[..., ::-1],
        codes.transpose(1, 0, 2),
        wide[..., :3],
        codes[::2, 1::3],
    ):
        png.write(path, view)
        assert np.array_equal(png.read(path), view)


def test_red_is_red_and_row_0_is_on_top(path):
    """Parsed from the bytes, without Pillow: a row is its filter's number and then R, G, B of each pixel."""
    codes = np.zeros((2, 1, 3), np.uint8)
    codes[0, 0], codes[1, 0] = (255, 1, 2), (3, 4, 255)
    png.write(path, codes)
    data = path.read_bytes()
    assert struct.unpack(">II", data[16:24]) == (1, 2)
    start = data.index(b"IDAT")
    (size,) = struct.unpack(">I", data[start - 4 : start])
    rows = zlib.decompress(data[start + 4 : start + 4 + size])
    assert rows[:4] in (bytes([0, 255, 1, 2]), bytes([1, 255, 1, 2]), bytes([2, 255, 1, 2]), bytes([4, 255, 1, 2]))


def test_two_writes_are_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        png.write(tmp_path / name, noise((50, 60, 3)))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_other_kinds_of_png(path):
    from PIL import Image

    codes, gray = noise((5, 6, 3)), noise((5, 6))
    Image.fromarray(np.dstack([codes, gray])).save(path)
    assert np.array_equal(png.read(path), codes)
    Image.fromarray(gray).save(path)
    assert np.array_equal(png.read(path), np.dstack([gray] * 3))
    few = codes // 64 * 64
    Image.fromarray(few).quantize(64, dither=Image.Dither.NONE).save(path)
    assert png.read(path).shape == (5, 6, 3)
    deep = np.array([[0, 128, 129, 65535, 257 * 7 + 128, 257 * 7 + 129]], np.uint16)
    Image.fromarray(deep).save(path)
    assert png.read(path)[0, :, 1].tolist() == [0, 0, 1, 255, 7, 8]


@pytest.mark.parametrize(
    "codes",
    [np.zeros((2, 2), np.uint8), np.zeros((2, 2, 5), np.uint8), np.zeros((2, 2, 3)), np.zeros((0, 2, 3), np.uint8)],
)
def test_refused_arrays(path, codes):
    with pytest.raises(InputError, match=r"^png: rgb8: expected uint8 of shape"):
        png.write(path, codes)
    assert not path.exists()


def test_ctrl_c_leaves_the_earlier_file(path, monkeypatch):
    from PIL import Image

    png.write(path, noise((4, 4, 3)))
    before = path.read_bytes()

    def interrupted(self, file, *arguments, **options):
        file.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(Image.Image, "save", interrupted)
    with pytest.raises(KeyboardInterrupt):
        png.write(path, noise((9, 9, 3)))
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == ["a.png"]


def bad(path) -> str:
    with pytest.raises(InputError) as caught:
        png.read(path)
    assert str(caught.value).startswith(f"{path}: file: expected ")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_bad_files(path):
    assert "no such file" in bad(path)
    png.write(path, noise((40, 40, 3)))
    data = path.read_bytes()
    for size in range(0, len(data) - 20, 97):
        path.write_bytes(data[:size])
        bad(path)
    path.write_bytes(data[:1000] + bytes(40) + data[1040:])
    bad(path)
    path.write_bytes(b"GIF89a" + bytes(100))
    assert "a PNG image" in bad(path)


def test_a_header_that_claims_too_many_pixels(path):
    png.write(path, noise((1, 1, 3)))
    data = path.read_bytes()
    header = chunk(b"IHDR", struct.pack(">II", 30000, 30000) + data[24:29])
    path.write_bytes(data[:8] + header + data[33:])
    assert "at most 268435456 pixels, found 30000 x 30000" in bad(path)


def test_the_resolution_of_a_file(tmp_path):
    path = tmp_path / "a.png"
    png.write(path, np.zeros((3, 500, 3), np.uint8))
    assert resolution_of(path) == (500, 3)
    path.write_bytes(path.read_bytes()[:23])
    assert resolution_of(path) is None
    path.write_bytes(b"something else, and long enough")
    assert resolution_of(path) is None
    assert resolution_of(tmp_path) is None
