"""Image files of any type become linear float32 RGB; those that cannot be decoded are refused in one line."""

import io
import warnings

import numpy as np
import pytest
from PIL import Image
from scene_files import png16, png_header

from clshade.errors import InputError
from clshade.images import radiance
from clshade.images.decode import read_image, srgb_to_linear
from clshade.scene.formats.reading import as_texture

RNG = np.random.default_rng(3)
PIXELS = RNG.integers(0, 256, (5, 7, 4), dtype=np.uint8)
RGB = np.ascontiguousarray(PIXELS[:, :, :3])


def test_the_curve():
    assert srgb_to_linear(np.array([0.0, 0.04045, 1.0])).tolist() == [0.0, 0.04045 / 12.92, 1.0]
    # 128/255 by the standard's formula, computed with mpmath to 20 digits.
    assert srgb_to_linear(np.array(128 / 255)) == pytest.approx(0.21586050011389926, abs=1e-15)


PICTURE = Image.fromarray(RGB)
KINDS = {
    "RGB": PICTURE,
    "L": PICTURE.convert("L"),
    "1": PICTURE.convert("1"),
    "LA": PICTURE.convert("LA"),
    "RGBA": Image.fromarray(PIXELS),
    "P": PICTURE.quantize(16),
    "CMYK": PICTURE.convert("CMYK"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_types_of_8_bits_are_as_pillow_reads_them(tmp_path, kind):
    path = tmp_path / ("image.tif" if kind == "CMYK" else "image.png")
    KINDS[kind].save(path)
    codes = RGB if kind in ("RGB", "RGBA", "CMYK") else np.asarray(KINDS[kind].convert("RGB"))
    assert_read(path, codes / 255, warned=kind == "RGBA")


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_16_bits_keep_every_bit(tmp_path, channels):
    pixels = RNG.integers(0, 65536, (11, 9, channels), dtype=np.uint16)
    (tmp_path / "deep.png").write_bytes(png16(pixels))
    codes = np.repeat(pixels[:, :, :1], 3, axis=2) if channels < 3 else pixels[:, :, :3]
    assert_read(tmp_path / "deep.png", codes / 65535, warned=channels in (2, 4))


def assert_read(path, levels, warned: bool) -> None:
    for srgb in (False, True):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            image = np.asarray(read_image(path, srgb=srgb))
        messages = [str(warning.message) for warning in caught]
        assert messages == [f"{path}: image: its alpha channel is left out"] * warned
        expected = (srgb_to_linear(levels) if srgb else levels).astype(np.float32)
        np.testing.assert_array_equal(image, expected, strict=True)


def test_files_that_are_refused(tmp_path):
    buffer = io.BytesIO()
    Image.fromarray(RNG.integers(0, 256, (64, 64, 3), dtype=np.uint8)).save(buffer, "PNG")
    Image.fromarray(np.ones((2, 2), np.float32)).save(tmp_path / "float.tif")
    content = {
        "cut.png": buffer.getvalue()[:2000],
        "text.png": b"no image at all",
        "page.eps": b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n",
        "empty.png": b"",
    }
    bombs = {f"bomb{size[0]}.png": png_header(*size) for size in ((9000, 9000), (40000, 2), (60000, 60000))}
    for name, data in {**content, **bombs}.items():
        (tmp_path / name).write_bytes(data)
    messages = dict.fromkeys(content, "image: expected an image of type PNG")
    messages |= dict.fromkeys(bombs, "expected at most 32768 pixels a side")
    messages |= {"empty.png": "empty file", "none.png": "no such file", "": "a folder", "float.tif": "pixels of type F"}
    for name, message in messages.items():
        with pytest.raises(InputError) as caught:
            read_image(tmp_path / name, srgb=True)
        assert all(part in str(caught.value) for part in (message, str(tmp_path / name)))
        assert str(caught.value).isprintable()


def test_as_texture(tmp_path):
    PICTURE.save(tmp_path / "image.png")
    texture = as_texture(tmp_path / "image.png", srgb=False, lookup="course")
    assert (texture.lookup, texture.name) == ("course", "image.png")
    assert as_texture(texture, srgb=True) is texture
    assert np.array_equal(as_texture(RGB, srgb=True).image, texture.image)
    with pytest.raises(InputError):
        as_texture(np.zeros((0, 3, 3)), srgb=False)


HEAD = b"#?RADIANCE\n# a comment\nFORMAT=32-bit_rle_rgbe\n\n"


def decoded(data: bytes) -> np.ndarray:
    return radiance.decode(data, "x.hdr", max_side=32768, max_pixels=1 << 20)


def encoded_row(codes: np.ndarray, run: int) -> bytes:
    """Encode a row (w, 4): the first `run` values of each channel, equal ones, as a run, the others one by one."""
    data = b"\x02\x02" + len(codes).to_bytes(2, "big")
    for plane in codes.T:
        data += bytes([128 + run, plane[0]]) + bytes([len(codes) - run]) + plane[run:].tobytes()
    return data


def test_runs_of_each_channel():
    codes = np.random.default_rng(0).integers(0, 256, (3, 12, 4), np.uint8)
    codes[:, :, 3] = [[130], [0], [136]]
    codes[:, :5] = codes[:, :1]
    image = decoded(HEAD + b"-Y 3 +X 12\n" + b"".join(encoded_row(row, 5) for row in codes))
    expected = codes[..., :3] * np.array([2.0**-6, 0.0, 1.0])[:, None, None]
    np.testing.assert_array_equal(image, expected.astype(np.float32))


def test_pixels_one_by_one_and_repeats_with_two_digits():
    pixels = [bytes([10, 20, 30, 136]), bytes([1, 1, 1, 2]), bytes([1, 1, 1, 1]), bytes([7, 8, 9, 137])]
    image = decoded(HEAD + b"-Y 2 +X 130\n" + b"".join(pixels))  # 1 + 2 + 256 + 1 pixels
    assert image.shape == (2, 130, 3)
    np.testing.assert_array_equal(image.reshape(-1, 3)[[0, 258, 259]], [[10, 20, 30], [10, 20, 30], [14, 16, 18]])
    no_run = np.full((1, 8, 4), [2, 2, 200, 136], np.uint8)
    np.testing.assert_array_equal(decoded(HEAD + b"-Y 1 +X 8\n" + no_run.tobytes()), no_run[..., :3])


def test_exposures_and_color_corrections_are_divided_out():
    data = b"#?RGBE\nEXPOSURE=2\nEXPOSURE= 2\nCOLORCORR= 1 2 4\n\n-Y 1 +X 1\n" + bytes([16, 16, 16, 136])
    np.testing.assert_array_equal(decoded(data), [[[4.0, 2.0, 1.0]]])


@pytest.mark.parametrize("value", ["0", "-1", "nan", "1e-40", "1e300", "", "auto", "1 1"])
@pytest.mark.parametrize("name", ["EXPOSURE", "COLORCORR"])
def test_what_is_no_exposure_is_ignored_with_a_warning(name, value):
    value = f"{value} 1 1" if name == "COLORCORR" else value
    data = f"#?RADIANCE\n{name}=2{' 2 2' * (name == 'COLORCORR')}\n{name}={value}\n\n-Y 1 +X 1\n".encode()
    with pytest.warns(UserWarning, match=f"^x.hdr: {name}: '{value.strip()}' is ignored") as caught:
        image = decoded(data + bytes([16, 16, 16, 136]))
    assert (len(caught), image.tolist()) == (1, [[[8.0, 8.0, 8.0]]])


@pytest.mark.parametrize("order", ["-Y +X", "-Y -X", "+Y +X", "+Y -X", "+X -Y", "+X +Y", "-X -Y", "-X +Y"])
def test_pixels_come_in_any_of_eight_orders(order):
    """The image [[1, 2, 3], [4, 5, 6]], written as Radiance's manual describes: the first axis is that of scanlines."""
    stored = np.array([[1, 2, 3], [4, 5, 6]])
    stored = stored[:: 1 if "-Y" in order else -1, :: 1 if "+X" in order else -1]
    stored = stored if order[1] == "Y" else stored.T
    codes = np.stack([stored, 0 * stored, 0 * stored, 0 * stored + 136], axis=2).astype(np.uint8)
    for end in ("\n", "\r\n"):
        lines = ("#?any program", "# a comment", "", f"{order[:2]} {len(stored)}\t{order[3:]} {stored.shape[1]}", "")
        assert decoded(end.join(lines).encode() + codes.tobytes())[..., 0].tolist() == [[1, 2, 3], [4, 5, 6]]


def test_another_programs_files(tmp_path):
    OpenImageIO = pytest.importorskip("OpenImageIO", reason="OpenImageIO writes the files")
    image = (np.random.default_rng(1).random((9, 40, 3)) ** 8 * 1e4).astype(np.float32)
    image[:, 5:30] = image[:, 5:6]
    path = tmp_path / "peer.hdr"
    assert OpenImageIO.ImageBuf(image).write(str(path))
    peer = OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.FLOAT)
    np.testing.assert_array_equal(decoded(path.read_bytes()), peer)


@pytest.mark.parametrize(
    ("data", "field"),
    [
        (b"P6 1 1", "file"),
        (b"#?RADIANCE\n" + b"a" * 100, "header"),
        (HEAD.replace(b"rgbe", b"xyze") + b"-Y 1 +X 1\nabcd", "FORMAT"),
        (HEAD + b"-X 1 +X 1\nabcd", "header"),
        (HEAD + b"512 x 512\nabcd", "header"),
        (HEAD + b"-Y 0 +X 1\nabcd", "image"),
        (HEAD + b"-Y 40000 +X 1\n" + b"abcd" * 40000, "image"),
        (HEAD + b"-Y 9999 +X 9999\nabcd", "image"),
        (HEAD + b"-Y 1 +X 2\nabcd", "image"),
        (HEAD + b"-Y 1 +X 1\n\x01\x01\x01\x01", "image"),
        (HEAD + b"-Y 1 +X 8\n\x02\x02\x00\x09" + b"\x88a" * 4, "image"),
        (HEAD + b"-Y 1 +X 8\n\x02\x02\x00\x08" + b"\x89a" * 4, "image"),
        (HEAD + b"-Y 1 +X 8\n\x02\x02\x00\x08" + b"\x00a" * 4, "image"),
        (HEAD + b"-Y 1 +X 8\n\x02\x02\x00\x08" + b"\x88a" * 3, "image"),
        (HEAD + b"-Y 2 +X 8\n\x02\x02\x00\x08" + b"\x88a" * 4 + b"abcd", "image"),
    ],
)
def test_damaged_files_are_refused_in_one_line(data, field):
    with pytest.raises(InputError, match=f"^x.hdr: {field}: expected .*found ") as caught:
        decoded(data)
    assert "\n" not in str(caught.value)
