"""Images with more than 8 bits per channel, TIFF and PNM: every bit is read, or a one-line error says why not."""

import contextlib
import io
import sys
import time
import warnings
import zlib

import numpy as np
import OpenImageIO as oiio
import pytest
import tifffile
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
    if codes.shape[2] > 2:
        return values
    return np.concatenate([np.repeat(values[:, :, :1], 3, axis=2), values[:, :, 1:]], axis=2)


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


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"byteorder": ">"},
        {"compression": "zlib", "predictor": True},
        {"compression": "zlib", "rowsperstrip": 2},
        {"tile": (16, 16)},
        {"bigtiff": True},
    ],
    ids=str,
)
def test_16_bit_tiff(channels, options):
    codes = codes_of(channels)
    for planes in ("contig", "separate") if channels > 1 else (None,):
        assert np.array_equal(decoded(tiff_of(codes, planarconfig=planes, **options)), expected(codes))


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("compression", ["lzw", "packbits"])
def test_compressions_that_tifffile_leaves_to_others(tmp_path, channels, compression):
    codes = codes_of(channels)
    image = oiio.ImageBuf(codes)
    image.specmod().attribute("compression", compression)
    image.specmod().attribute("oiio:UnassociatedAlpha", 1)
    for planes in ("contig", "separate"):
        image.specmod().attribute("planarconfig", planes)
        assert image.write(str(tmp_path / "a.tif"))
        data = (tmp_path / "a.tif").read_bytes()
        if planes == "contig":
            assert np.array_equal(decoded(data), expected(codes))
        else:
            refused(data, "no compression or deflate", compression.upper())


def test_associated_alpha_is_divided_out():
    straight = codes_of(4)
    straight[:, :, 3] |= 0x8000
    straight[0, 0] = 0
    times = np.round(straight[:, :, :3] * straight[:, :, 3:].astype(np.int64) / 65535).astype(np.uint16)
    image = decoded(tiff_of(np.dstack([times, straight[:, :, 3]]), extrasamples=["assocalpha"]))
    # The product is rounded by half a code, which an alpha of at least 1/2 doubles; the quotient adds its own half.
    assert np.abs(image - expected(straight)).max() <= 1.5 / 65535
    assert not image[0, 0].any()
    codes = np.array([[[5, 6, 7, 0], [1, 1, 1, 1], [0, 1, 2, 2]]], np.uint16)  # alphas of 0 and almost 0
    image = decoded(tiff_of(codes, extrasamples=["assocalpha"]))
    assert np.array_equal(image[0, :, :3], [[0, 0, 0], [1, 1, 1], [0, np.float32(32768 / 65535), 1]])


def test_white_is_zero_and_inks():
    for channels, maxval in ((1, 65535), (2, 65535), (1, 255)):
        codes = codes_of(channels, maxval)
        inverted = np.dstack([maxval - codes[:, :, 0], codes[:, :, 1:]])
        assert np.array_equal(decoded(tiff_of(codes, photometric="miniswhite")), expected(inverted, maxval))
    codes = codes_of(4)
    paper = 1 - codes.astype(np.float64) / 65535
    image = decoded(tiff_of(codes, photometric="separated"))
    assert np.abs(image - paper[:, :, :3] * paper[:, :, 3:]).max() <= 0.51 / 65535


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("planes", ["contig", "separate"])
def test_orientation(orientation, planes):
    """As Pillow orients images, with and without tifffile."""
    codes, tag = codes_of(3), {"extratags": [(274, "H", 1, orientation, True)]}
    turned = Image.open(io.BytesIO(tiff_of((codes >> 8).astype(np.uint8), **tag)))
    turned.load()
    image = decoded(tiff_of(codes, planarconfig=planes, **tag))
    assert np.array_equal(np.round(image * 65535).astype(np.uint16) >> 8, np.asarray(turned))


def test_12_bits(tmp_path):
    """There Pillow's codes end at 4095."""
    codes = codes_of(1, 4095, (4, 6))
    image = oiio.ImageBuf(codes << 4 | codes >> 8)  # whose upper bits are written
    image.specmod().attribute("oiio:BitsPerSample", 12)
    image.specmod().attribute("compression", "none")
    assert image.write(str(tmp_path / "a.tif"))
    assert np.array_equal(decoded((tmp_path / "a.tif").read_bytes()), expected(codes, 4095))


PLANES = tiff_of(codes_of(3), planarconfig="separate")


def test_without_tifffile(monkeypatch):
    """Files that Pillow can read are read; others are refused by name, not truncated to 8 bits."""
    codes = codes_of(3)
    interleaved = tiff_of(codes)
    monkeypatch.setitem(sys.modules, "tifffile", None)
    assert np.array_equal(decoded(interleaved), expected(codes))
    refused(PLANES, "tifffile", "`pip install tifffile`")


def test_broken_tiff_is_refused_and_nothing_is_printed(capfd):
    for good in (PLANES, tiff_of(codes_of(2), compression="zlib"), tiff_of(codes_of(3))):
        for end in range(0, len(good), 7):
            with pytest.raises(InputError):
                decoded(good[:end])
        for place in RNG.integers(8, len(good), 200).tolist():
            damaged = bytearray(good)
            damaged[place] = int(RNG.integers(0, 256))
            with contextlib.suppress(InputError):
                decoded(bytes(damaged))
    assert capfd.readouterr() == ("", "")


def test_sizes_are_refused_before_decoding(monkeypatch):
    data = with_tag(with_tag(PLANES, "ImageWidth", 9000), "ImageLength", 9000)
    monkeypatch.setattr(decode, "_tiff_codes", None)
    refused(data, "at most 32768 pixels a side and 67108864 in all", "9000 x 9000")
    refused(b"P5 40000 2 255\n" + bytes(80000), "at most 32768 pixels a side", "40000 x 2")


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_claims_of_more_than_the_image_are_refused(compression):
    """Of more planes, more rows, larger tiles, and of strips that swell when they are unpacked."""
    codes, unused = codes_of(3), 65001
    options = {"planarconfig": "separate", "compression": compression}
    data = tiff_of(codes, **options, extratags=[(unused, "I", 1, 20_000_000, True)])
    depth = data.replace(unused.to_bytes(2, "little"), (32997).to_bytes(2, "little"), 1)
    refused(depth, f"16-bit pixels of shape {(3, *codes.shape[:2])}", f"{(3, 20_000_000, *codes.shape[:2])}")
    refused(with_tag(data, "ImageLength", 16_000), "strips or tiles, found 3")
    tiled = tiff_of(codes, **options, tile=(16, 16))
    refused(with_tag(with_tag(tiled, "TileWidth", 32768), "TileLength", 32768), "strips or tiles of at most")
    if compression:
        bomb = zlib.compress(bytes(1 << 24))
        swollen = with_tag(with_tag(data, "StripOffsets", len(data)), "StripByteCounts", len(bomb)) + bomb
        refused(swollen, "at most 198 bytes in a strip or tile", "more")


@pytest.mark.parametrize("maxval", [1, 100, 255, 256, 65535])
@pytest.mark.parametrize("kind", ["P2", "P3", "P5", "P6"])
def test_pnm(kind, maxval):
    codes = codes_of(3 if kind in ("P3", "P6") else 1, maxval)
    head = f"{kind} # a comment\n#another\n9\t11#\n\n{maxval}\n".encode()
    if kind in ("P2", "P3"):
        lines = [" ".join(map(str, row)) + " # 1 2 3" * (k % 3) for k, row in enumerate(codes.reshape(11, -1).tolist())]
        bodies = [end.join(lines).encode() for end in ("\n", "\r\n", "\r")]
    else:
        bodies = [codes.astype(">u2" if maxval > 255 else np.uint8).tobytes()]
    for body in bodies:
        for rest in (b"", b"\n", b"\nP5 1 1 255\n0"):  # a second image is ignored
            assert np.array_equal(decoded(head + body + rest), expected(codes, maxval)[:, :, :3])


@pytest.mark.parametrize(
    ("data", "part"),
    [
        *((data, "width, height and largest value") for data in (b"P6", b"P6 2 2 255")),
        *((data, "width, height") for data in (b"P6 -2 2 255\n", b"P3 1 1 9999999999\n1 1 1")),
        (b"P5 0 2 255\n", "0 x 2"),
        *((b"P5 2 2 %d\n" % maxval + bytes(8), "largest value from 1 to 65535") for maxval in (0, 65536)),
        (b"P5 2 2 65535\n" + bytes(7), "at least 8 bytes for 2 x 2 pixels, found 7 bytes"),
        (b"P2 60000 60000 255\n", "at least 7199999999 bytes"),
        (b"P5 1 2 1000\n\x03\xe8\x03\xe9", "values up to 1000, found 1001"),
        (b"P2 1 2 1000\n1000 1001", "values up to 1000, found 1001"),
        (b"P2 2 2 255\n1 2 3    #", "expected 4 values, found 3"),
        *((f"P2 2 2 255\n1 2 3 {word}".encode(), f"whole numbers, found '{word}'") for word in ("x", "-4", "4" * 10)),
        (b"P2 100 100 255\n" + b"1" * (1 << 23), "whole numbers, found"),
        (b"P2 100 100 255\n#" + b"a" * (1 << 23), "expected 10000 values, found 0"),
    ],
)
def test_broken_pnm(data, part):
    start = time.process_time()
    refused(data, part)
    assert time.process_time() - start < 2.0  # byte by byte the long words would take at least twice as long


def test_the_transparent_color_of_a_16_bit_png():
    """It is compared in all 16 bits."""
    for channels in (1, 3):
        codes = codes_of(channels)
        codes[2, 3], codes[2, 4] = 0x1234, 0x1235
        data = png16(codes)
        key = np.full(channels, 0x1234, ">u2").tobytes()
        place = data.index(b"IDAT") - 4
        image = decoded(data[:place] + chunk(b"tRNS", key) + data[place:])
        assert np.array_equal(image[:, :, 3] * 65535, np.where((codes == 0x1234).all(axis=2), 0, 65535))
        assert np.array_equal(image[:, :, :3], expected(codes))


def test_textures_of_every_kind_of_scene(tmp_path):
    codes = codes_of(3)
    linear = expected(codes)
    levels = np.where(linear <= 0.04045, linear / 12.92, ((linear + 0.055) / 1.055) ** 2.4)
    write(tmp_path / "a.tif", tiff_of(codes))
    write(tmp_path / "a.ppm", b"P6 9 11 65535\n" + codes.astype(">u2").tobytes())
    text = "mtllib a.mtl\n" + TRIANGLE + "vt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
    for name in ("a.tif", "a.ppm"):
        write(tmp_path / "a.mtl", f"newmtl m\nmap_Kd {name}\n")
        mesh = load(write(tmp_path / "a.obj", text)).meshes[0]
        np.testing.assert_allclose(mesh.material.texture.image, levels, rtol=1e-5)
        course = load(save_npy(tmp_path / "a.npy", course_dict()), texture=tmp_path / name)
        assert np.array_equal(course.meshes[0].material.texture.image, linear)
    write(tmp_path / "a.ppm", b"P6 9 11 65535\n" + bytes(10))
    with pytest.warns(UserWarning, match="a.ppm: image: expected at least 594 bytes"):
        load(tmp_path / "a.obj")


def test_other_kinds_of_numbers_are_refused():
    for kind in (np.uint32, np.float32, np.int16):
        refused(tiff_of(codes_of(1).astype(kind)), "whole numbers from 0")
        refused(tiff_of(codes_of(3).astype(kind)))
