"""Radiance HDR files: every encoding, a reader of another program, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.images import radiance

HEAD = b"#?RADIANCE\n# a comment\nFORMAT=32-bit_rle_rgbe\n\n"
LIMITS = {"most_side": 32768, "most_pixels": 1 << 20}


def decoded(data: bytes, **limits) -> np.ndarray:
    return radiance.decode(data, "x.hdr", **{**LIMITS, **limits})


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


def test_a_first_pixel_of_two_twos_is_not_taken_for_a_run():
    pixels = np.full((1, 8, 4), [2, 2, 200, 136], np.uint8)
    np.testing.assert_array_equal(decoded(HEAD + b"-Y 1 +X 8\n" + pixels.tobytes()), pixels[..., :3])


def test_exposure_is_divided_out_and_rows_and_columns_may_run_the_other_way():
    data = b"#?RGBE\nEXPOSURE=2\nEXPOSURE=2\n\n+Y 2 -X 2\n" + bytes(range(1, 17))[:12] + bytes([0, 0, 8, 136])
    image = decoded(data)
    assert image[0, 0, 2] == 2.0  # the last pixel of the file, at a quarter of its value


def test_another_programs_files(tmp_path):
    OpenImageIO = pytest.importorskip("OpenImageIO", reason="OpenImageIO writes the files")
    image = (np.random.default_rng(1).random((9, 40, 3)) ** 8 * 1e4).astype(np.float32)
    image[:, 5:30] = image[:, 5:6]
    path = tmp_path / "peer.hdr"
    output = OpenImageIO.ImageOutput.create(str(path))
    output.open(str(path), OpenImageIO.ImageSpec(40, 9, 3, "float"))
    output.write_image(image)
    output.close()
    peer = OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.FLOAT)
    np.testing.assert_array_equal(decoded(path.read_bytes()), peer)


@pytest.mark.parametrize(
    ("data", "field"),
    [
        (b"#?NOT", "file"),
        (b"#?RADIANCE\n" + b"a" * 100, "header"),
        (HEAD.replace(b"rgbe", b"xyze") + b"-Y 1 +X 1\nabcd", "FORMAT"),
        (b"#?RGBE\nEXPOSURE=0\n\n-Y 1 +X 1\nabcd", "EXPOSURE"),
        (b"#?RGBE\nEXPOSURE=nan\n\n-Y 1 +X 1\nabcd", "EXPOSURE"),
        (HEAD + b"+X 1 -Y 1\nabcd", "size"),
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
