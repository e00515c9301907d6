"""Images with more than 8 bits per channel, TIFF and PNM: every bit is read, or a one-line error says why not."""

from __future__ import annotations

import contextlib
import io
import struct
import sys
import time
import warnings
import zlib

import numpy as np
import OpenImageIO as oiio
import pytest
import tifffile
from mesh_writers import CORNERS, INDICES, Gltf
from PIL import Image
from scene_files import TRIANGLE, chunk, course_dict, png16, save_npy, write

from clshade.errors import InputError
from clshade.images import decode
from clshade.images.decode import decode_image
from clshade.scene.formats.load import load

RNG = np.random.default_rng(4)


def decoded(data: bytes) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return np.asarray(decode_image(data, "a.img", srgb=False))


def refused(data: bytes, *parts: str) -> None:
    with pytest.raises(InputError) as caught:
        decoded(data)
    text = str(caught.value)
    assert text.isprintable()
    for part in ("a.img: image: expected", ", found", *parts):
        assert part in text, text


def expected(codes: np.ndarray, maxval: int = 65535) -> np.ndarray:
    """Return (h, w, 3 or 4) float32 for codes (h, w, 1 to 4)."""
    values = (codes / maxval).astype(np.float32)
    return (
        np.concatenate([np.repeat(values[:, :, :1], 3, axis=2), values[:, :, 1:]], axis=2)
        if codes.shape[2] < 3
        else values
    )


def codes_of(channels: int, maxval: int = 65535, shape=(11, 9)) -> np.ndarray:
    return RNG.integers(0, maxval + 1, (*shape, channels)).astype(np.uint16 if maxval > 255 else np.uint8)


def tiff_of(codes: np.ndarray, **options) -> bytes:
    """Write a TIFF file with tifffile. codes: (h, w, C)."""
    channels = codes.shape[2]
    if options.get("planarconfig") == "separate":
        codes = np.moveaxis(codes, 2, 0)
    elif channels == 1:
        codes = codes[:, :, 0]
    options.setdefault("photometric", "rgb" if channels > 2 else "minisblack")
    if channels in (2, 4) and options["photometric"] != "separated":
        options.setdefault("extrasamples", ["unassalpha"])
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, codes, **options)
    return buffer.getvalue()


def with_tag(data: bytes, name: str, value: int) -> bytes:
    """Return a TIFF file with one value of its first image replaced."""
    tag = tifffile.TiffFile(io.BytesIO(data)).pages[0].tags[name]
    width = {3: 2, 4: 4}[int(tag.dtype)]
    return data[: tag.valueoffset] + value.to_bytes(width, "little") + data[tag.valueoffset + width :]


def tiff_by_hand(data: bytes, tags: list[tuple[int, int, int, int]]) -> bytes:
    """Return a TIFF file of data and then a directory of tags."""
    directory = struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags) + bytes(4)
    return b"II*\0" + struct.pack("<I", 8 + len(data)) + data + directory


KINDS = [
    {},
    {"byteorder": ">"},
    {"compression": "zlib"},
    {"compression": "zlib", "predictor": True},
    {"tile": (16, 16)},
    {"rowsperstrip": 2},
    {"bigtiff": True},
]


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("options", KINDS, ids=str)
def test_16_bit_tiff(channels, options):
    codes = codes_of(channels)
    for planes in ("contig", "separate") if channels > 1 else (None,):
        assert np.array_equal(decoded(tiff_of(codes, planarconfig=planes, **options)), expected(codes))


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("compression", ["lzw", "packbits"])
def test_compressions_that_tifffile_leaves_to_others(tmp_path, channels, compression):
    codes = codes_of(channels)
    spec = oiio.ImageSpec(9, 11, channels, "uint16")
    spec.attribute("compression", compression)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    for planes in ("contig", "separate"):
        spec.attribute("planarconfig", planes)
        output = oiio.ImageOutput.create(str(tmp_path / "a.tif"))
        assert output.open(str(tmp_path / "a.tif"), spec)
        assert output.write_image(codes)
        output.close()
        data = (tmp_path / "a.tif").read_bytes()
        if planes == "contig":
            assert np.array_equal(decoded(data), expected(codes))
        else:
            refused(data, "no compression or deflate", compression.upper())


def test_associated_alpha_is_divided_out():
    straight = codes_of(4)
    straight[0, 0, 3] = 0
    straight[:, :, 3] |= 0x8000
    straight[0, 0] = 0
    alpha = straight[:, :, 3:].astype(np.int64)
    times = np.round(straight[:, :, :3] * alpha / 65535).astype(np.uint16)
    data = tiff_of(np.dstack([times, straight[:, :, 3]]), extrasamples=["assocalpha"])
    image = decoded(data)
    # The product is rounded by half a code, which an alpha of at least 1/2 doubles; the quotient adds its own half.
    assert np.abs(image - expected(straight)).max() <= 1.5 / 65535
    assert not image[0, 0].any()
    codes = np.array([[[5, 6, 7, 0], [1, 1, 1, 1], [0, 1, 2, 2]]], np.uint16)  # alphas of 0 and almost 0
    image = decoded(tiff_of(codes, extrasamples=["assocalpha"]))
    assert np.array_equal(image[0, :, :3], [[0, 0, 0], [1, 1, 1], [0, np.float32(32768 / 65535), 1]])


def test_white_is_zero():
    codes = codes_of(1)
    assert np.array_equal(decoded(tiff_of(codes, photometric="miniswhite")), expected(65535 - codes))
    codes = codes_of(2)
    inverted = np.dstack([65535 - codes[:, :, 0], codes[:, :, 1]])
    assert np.array_equal(decoded(tiff_of(codes, photometric="miniswhite")), expected(inverted))
    codes = codes_of(1, 255)
    assert np.array_equal(decoded(tiff_of(codes, photometric="miniswhite")), expected(255 - codes, 255))


def test_inks():
    codes = codes_of(4)
    paper = 1 - codes.astype(np.float64) / 65535
    image = decoded(tiff_of(codes, photometric="separated"))
    assert np.abs(image - paper[:, :, :3] * paper[:, :, 3:]).max() <= 0.51 / 65535


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("planes", ["contig", "separate"])
def test_orientation(orientation, planes):
    """As Pillow orients images, with and without tifffile."""
    codes = codes_of(3)
    data = tiff_of(codes, planarconfig=planes, extratags=[(274, "H", 1, orientation, True)])
    turned = Image.open(
        io.BytesIO(tiff_of((codes >> 8).astype(np.uint8), extratags=[(274, "H", 1, orientation, True)]))
    )
    turned.load()
    assert np.array_equal(np.round(decoded(data) * 65535).astype(np.uint16) >> 8, np.asarray(turned))


def test_12_bits(tmp_path):
    """There Pillow's codes end at 4095."""
    codes = codes_of(1, 4095, (4, 6))
    pairs = codes.reshape(-1, 2).astype(np.uint32)
    packed = np.stack([pairs[:, 0] >> 4, (pairs[:, 0] & 15) << 4 | pairs[:, 1] >> 8, pairs[:, 1] & 255], axis=1)
    data = packed.astype(np.uint8).tobytes()
    tags = [(256, 3, 1, 6), (257, 3, 1, 4), (258, 3, 1, 12), (259, 3, 1, 1), (262, 3, 1, 1), (273, 4, 1, 8)]
    tags += [(277, 3, 1, 1), (278, 3, 1, 4), (279, 4, 1, len(data))]
    assert np.array_equal(decoded(tiff_by_hand(data, tags)), expected(codes, 4095))


def test_other_kinds_of_numbers_are_refused():
    for kind in (np.uint32, np.float32, np.int16):
        refused(tiff_of(codes_of(1).astype(kind)), "whole numbers from 0")
        refused(tiff_of(codes_of(3).astype(kind)))


def test_without_tifffile(monkeypatch):
    """Files that Pillow can read are read; others are refused by name, not truncated to 8 bits."""
    monkeypatch.setitem(sys.modules, "tifffile", None)
    codes = codes_of(3)
    assert np.array_equal(decoded(TIFF_RGB(codes)), expected(codes))
    refused(TIFF_PLANES, "tifffile", "`pip install tifffile`")


def TIFF_RGB(codes: np.ndarray) -> bytes:
    spec = [(256, 3, 1, codes.shape[1]), (257, 3, 1, codes.shape[0]), (258, 3, 3, 8), (259, 3, 1, 1), (262, 3, 1, 2)]
    spec += [(273, 4, 1, 14), (277, 3, 1, 3), (278, 3, 1, codes.shape[0]), (279, 4, 1, codes.nbytes)]
    return tiff_by_hand(struct.pack("<3H", 16, 16, 16) + codes.astype("<u2").tobytes(), spec)


TIFF_PLANES = tiff_of(codes_of(3), planarconfig="separate")


def test_broken_tiff_is_refused_and_nothing_is_printed(capfd):
    for good in (TIFF_PLANES, tiff_of(codes_of(2), compression="zlib"), tiff_of(codes_of(3))):
        for end in range(0, len(good), 7):
            with pytest.raises(InputError):
                decoded(good[:end])
        damaged = bytearray(good)
        for place in RNG.integers(8, len(good), 200).tolist():
            before, damaged[place] = damaged[place], int(RNG.integers(0, 256))
            with contextlib.suppress(InputError):
                decoded(bytes(damaged))
            damaged[place] = before
    assert capfd.readouterr() == ("", "")


def test_sizes_are_refused_before_decoding(monkeypatch):
    def never(*_):
        raise AssertionError("decoded")

    monkeypatch.setattr(decode, "_tiff_codes", never)
    data = with_tag(with_tag(TIFF_PLANES, "ImageWidth", 9000), "ImageLength", 9000)
    refused(data, "at most 32768 pixels a side and 67108864 in all", "9000 x 9000")
    for size in (b"9000 9000", b"40000 2", b"60000 60000"):
        for kind in (b"P2", b"P3", b"P5", b"P6"):
            refused(kind + b" " + size + b" 65535\n")  # the file is too short
    enough = b"P5 40000 2 255\n" + bytes(80000)
    refused(enough, "at most 32768 pixels a side", "40000 x 2")


def test_a_strip_that_swells_is_refused():
    bomb = zlib.compress(bytes(1 << 24))
    codes = codes_of(3)
    data = tiff_of(codes, planarconfig="separate", compression="zlib")
    swollen = with_tag(with_tag(data, "StripOffsets", len(data)), "StripByteCounts", len(bomb)) + bomb
    refused(swollen, "at most 198 bytes in a strip or tile", "more")


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_claims_of_more_than_the_image_are_refused(compression):
    codes, unused = codes_of(3), 65001
    data = tiff_of(
        codes, planarconfig="separate", compression=compression, extratags=[(unused, "I", 1, 20_000_000, True)]
    )
    depth = data.replace(unused.to_bytes(2, "little"), (32997).to_bytes(2, "little"), 1)
    refused(depth, f"16-bit pixels of shape {(3, *codes.shape[:2])}", f"{(3, 20_000_000, *codes.shape[:2])}")
    refused(with_tag(data, "ImageLength", 16_000), "strips or tiles, found 3")
    tiled = tiff_of(codes, planarconfig="separate", compression=compression, tile=(16, 16))
    wide = with_tag(with_tag(tiled, "TileWidth", 32768), "TileLength", 32768)
    refused(wide, "strips or tiles of at most")


@pytest.mark.parametrize("body", [b"1" * (1 << 23), b"#" + b"a" * (1 << 23)], ids=["number", "comment"])
def test_long_words_take_no_long_time(body):
    start = time.process_time()
    refused(b"P2 100 100 255\n" + body)
    assert time.process_time() - start < 2.0  # byte by byte would take at least twice as long


@pytest.mark.parametrize("maxval", [1, 100, 255, 256, 1023, 65535])
@pytest.mark.parametrize("kind", ["P2", "P3", "P5", "P6"])
def test_pnm(kind, maxval):
    codes = codes_of(3 if kind in ("P3", "P6") else 1, maxval)
    head = f"{kind} # a comment\n#another\n9\t11#\n\n{maxval}\n".encode()
    if kind in ("P2", "P3"):
        words = [str(value) for value in codes.reshape(-1).tolist()]
        words.insert(5, "# 9 9 9\n")
        body = " ".join(words).encode()
    else:
        body = codes.astype(">u2" if maxval > 255 else np.uint8).tobytes()
    for rest in (b"", b"\n", b"\nP5 1 1 255\n0"):  # a second image is ignored
        assert np.array_equal(decoded(head + body + rest), expected(codes, maxval)[:, :, :3])


def test_text_with_comments_and_any_line_ends():
    codes = codes_of(1, 65535, (40, 30))
    lines = [" ".join(map(str, row)) + " # comment 1 2 3" * (k % 3) for k, row in enumerate(codes[:, :, 0].tolist())]
    for end in ("\n", "\r\n", "\r"):
        data = ("P2 30 40 65535 " + end.join(lines)).encode()
        for rest in (b"", end.encode() + b"7 " * 50, end.encode() + b"P2 1 1 1 0"):  # trailing data is ignored
            assert np.array_equal(decoded(data + rest), expected(codes))


@pytest.mark.parametrize(
    ("data", "part"),
    [
        (b"P6", "width, height and largest value"),
        (b"P6 2 2 255", "width, height and largest value"),
        (b"P6 -2 2 255\n", "width, height"),
        (b"P5 0 2 255\n", "0 x 2"),
        (b"P5 2 2 0\n" + bytes(8), "largest value from 1 to 65535"),
        (b"P5 2 2 65536\n" + bytes(8), "largest value from 1 to 65535"),
        (b"P5 2 2 65535\n" + bytes(7), "at least 8 bytes for 2 x 2 pixels, found 7 bytes"),
        (b"P5 1 2 1000\n\x03\xe8\x03\xe9", "values up to 1000, found 1001"),
        (b"P2 1 2 1000\n1000 1001", "values up to 1000, found 1001"),
        (b"P2 2 2 255\n1 2 3    #", "expected 4 values, found 3"),
        (b"P2 2 2 255\n1 2 3 x", "whole numbers, found 'x'"),
        (b"P2 2 2 255\n1 2 3 -4", "whole numbers, found '-4'"),
        (b"P2 2 2 255\n1 2 3 4444444444", "whole numbers, found '4444444444'"),
        (b"P3 1 1 9999999999\n1 1 1", "width, height"),
    ],
)
def test_broken_pnm(data, part):
    refused(data, part)


def test_the_transparent_color_of_a_16_bit_png():
    """It is compared in all 16 bits."""
    for channels in (1, 3):
        codes = codes_of(channels)
        codes[2, 3], codes[2, 4] = 0x1234, 0x1235
        data = png16(codes)
        key = np.full(channels, 0x1234, ">u2").tobytes()
        place = data.index(b"IDAT") - 4
        image = decoded(data[:place] + chunk(b"tRNS", key) + data[place:])
        alpha = np.where((codes == 0x1234).all(axis=2), 0, 65535)
        assert np.array_equal(image[:, :, 3] * 65535, alpha)
        assert np.array_equal(image[:, :, :3], expected(codes))


def test_textures_of_every_kind_of_scene(tmp_path):
    codes = codes_of(3)
    linear = expected(codes)
    write(tmp_path / "a.tif", tiff_of(codes))
    write(tmp_path / "a.ppm", b"P6 9 11 65535\n" + codes.astype(">u2").tobytes())
    text = "mtllib a.mtl\n" + TRIANGLE + "vt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
    for name in ("a.tif", "a.ppm"):
        write(tmp_path / "a.mtl", f"newmtl m\nmap_Kd {name}\n")
        images = [load(write(tmp_path / "a.obj", text)).meshes[0].material.texture.image]
        document = Gltf()
        document.add("images", {"uri": name})
        document.add("textures", {"source": 0})
        document.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
        uvs = np.array([[0, 0], [1, 0], [0, 1]], np.float32)
        document.mesh({"POSITION": CORNERS, "TEXCOORD_0": uvs}, INDICES, material=0)
        images.append(load(document.gltf(tmp_path / "a.gltf")).meshes[0].material.texture.image)
        for image in images:
            assert len(np.unique(image)) > 256
            levels = np.where(linear <= 0.04045, linear / 12.92, ((linear + 0.055) / 1.055) ** 2.4)
            np.testing.assert_allclose(image, levels, rtol=1e-5)
        course = load(save_npy(tmp_path / "a.npy", course_dict()), texture=tmp_path / name)
        assert np.array_equal(course.meshes[0].material.texture.image, linear)
    write(tmp_path / "a.ppm", b"P6 9 11 65535\n" + bytes(10))
    with pytest.warns(UserWarning, match="a.ppm: image: expected at least 594 bytes"):
        load(tmp_path / "a.obj")


@pytest.mark.parametrize("mode", ["F", "I"])
def test_pixels_of_other_types_are_refused(mode):
    with pytest.raises(InputError, match=f"a.tif: image: expected 8 or 16 bits a channel.* pixels of type {mode}"):
        decode._codes(Image.new(mode, (2, 2)), b"", "a.tif")
