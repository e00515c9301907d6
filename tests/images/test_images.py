"""Image files of any type become linear float32 RGB; those that cannot be decoded are refused in one line."""

from __future__ import annotations

import io
import struct
import warnings
import zlib

import numpy as np
import pytest
from PIL import Image
from scene_files import png16

from clshade.errors import InputError
from clshade.images.decode import read_image, srgb_to_linear
from clshade.scene.formats.texture import as_texture

RNG = np.random.default_rng(3)
PIXELS = RNG.integers(0, 256, (5, 7, 4), dtype=np.uint8)
RGB = np.ascontiguousarray(PIXELS[:, :, :3])


def saved(tmp_path, image, **options):
    path = tmp_path / "image.png"
    image.save(path, **options)
    return path


def refusal(path, part: str) -> None:
    with pytest.raises(InputError) as caught:
        read_image(path, srgb=True)
    text = str(caught.value)
    assert text.isprintable()
    assert part in text
    assert str(path) in text


def test_the_curve():
    assert srgb_to_linear(np.array([0.0, 0.04045, 1.0])).tolist() == [0.0, 0.04045 / 12.92, 1.0]
    # 128/255 by the standard's formula, computed with mpmath to 20 digits.
    assert srgb_to_linear(np.array(128 / 255)) == pytest.approx(0.21586050011389926, abs=1e-15)


def test_rgb_row_0_is_the_top(tmp_path):
    path = saved(tmp_path, Image.fromarray(RGB))
    image = np.asarray(read_image(path, srgb=False))
    assert image.dtype == np.float32
    assert np.array_equal(image, (RGB / 255).astype(np.float32))
    assert np.array_equal(read_image(path, srgb=True), srgb_to_linear(RGB / 255).astype(np.float32))


@pytest.mark.parametrize("kind", ["L", "1", "LA", "RGBA", "P", "CMYK"])
def test_other_types_of_8_bits(tmp_path, kind):
    original = Image.fromarray(RGB)
    if kind == "CMYK":
        image, expected = original.convert("CMYK"), RGB
        path = tmp_path / "image.tif"
        image.save(path)
    elif kind == "P":
        image = original.quantize(16)
        expected = np.asarray(image.convert("RGB"))
        path = saved(tmp_path, image)
    else:
        image = Image.fromarray(PIXELS) if kind == "RGBA" else original.convert(kind)
        expected = RGB if kind == "RGBA" else np.asarray(image.convert("RGB"))
        path = saved(tmp_path, image)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        result = read_image(path, srgb=False)
    assert np.array_equal(result, (expected / 255).astype(np.float32))
    assert [str(w.message) for w in told] == ([f"{path}: image: its alpha channel is left out"] * (kind == "RGBA"))


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_16_bits_keep_every_bit(tmp_path, channels):
    pixels = RNG.integers(0, 65536, (11, 9, channels), dtype=np.uint16)
    path = tmp_path / "deep.png"
    path.write_bytes(png16(pixels))
    expected = np.repeat(pixels[:, :, :1], 3, axis=2) if channels < 3 else pixels[:, :, :3]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert np.array_equal(read_image(path, srgb=False), (expected / 65535).astype(np.float32))
    assert len(told) == (channels in (2, 4))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert np.array_equal(read_image(path, srgb=True), srgb_to_linear(expected / 65535).astype(np.float32))


def test_a_bomb_is_refused_before_it_is_decoded(tmp_path):
    def part(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    for width, height in ((9000, 9000), (40000, 2), (60000, 60000)):
        head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
        path = tmp_path / "bomb.png"
        path.write_bytes(b"\x89PNG\r\n\x1a\n" + part(b"IHDR", head) + part(b"IDAT", zlib.compress(b"")))
        refusal(path, "expected at most 32768 pixels a side")


def test_broken_and_foreign_files(tmp_path):
    buffer = io.BytesIO()
    Image.fromarray(RNG.integers(0, 256, (64, 64, 3), dtype=np.uint8)).save(buffer, "PNG")
    for name, data in {
        "cut.png": buffer.getvalue()[:2000],
        "text.png": b"no image at all",
        "page.eps": b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n",
    }.items():
        (tmp_path / name).write_bytes(data)
        refusal(tmp_path / name, "image: expected an image of type PNG")
    (tmp_path / "empty.png").write_bytes(b"")
    refusal(tmp_path / "empty.png", "empty file")
    refusal(tmp_path / "none.png", "no such file")
    refusal(tmp_path, "a folder")
    Image.fromarray(np.ones((2, 2), np.float32)).save(tmp_path / "float.tif")
    refusal(tmp_path / "float.tif", "pixels of type F")


def test_as_texture(tmp_path):
    path = saved(tmp_path, Image.fromarray(RGB))
    texture = as_texture(path, srgb=False, lookup="course")
    assert (texture.lookup, texture.name) == ("course", "image.png")
    assert as_texture(texture, srgb=True) is texture
    assert np.array_equal(as_texture(RGB, srgb=True).image, texture.image)
    with pytest.raises(InputError):
        as_texture(np.zeros((0, 3, 3)), srgb=False)
