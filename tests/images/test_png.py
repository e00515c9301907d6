"""PNG files: every code is preserved; 16-bit depth PNGs: codes, the scale in the file, readers of other programs."""

import io

import numpy as np
import pytest
from PIL import Image
from scene_files import png_header

from clshade.errors import InputError
from clshade.images import depth_png, png
from clshade.images.image_file import resolution_of


def noise(shape):
    return np.random.default_rng(4).integers(0, 256, shape, np.uint8)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.png"


@pytest.mark.parametrize("shape", [(1, 1), (67, 75), (16384, 1), (1, 16384)])
def test_round_trip_of_every_layout(path, shape):
    codes, wide = noise((*shape, 3)), noise((*shape, 4))
    mirrored = codes[::-1], codes[:, ::-1], codes[..., ::-1]
    for view in (codes, *mirrored, codes.transpose(1, 0, 2), wide[..., :3], codes[::2, ::3]):
        png.write(path, view)
        before = path.read_bytes()
        png.write(path, view)
        assert path.read_bytes() == before
        np.testing.assert_array_equal(png.read(path), view, strict=True)


def test_other_kinds_of_png(path):
    codes, gray = noise((5, 6, 3)), noise((5, 6))
    Image.fromarray(np.dstack([codes, gray])).save(path)
    assert np.array_equal(png.read(path), codes)
    Image.fromarray(gray).save(path)
    assert np.array_equal(png.read(path), np.dstack([gray] * 3))
    Image.fromarray(np.array([[0, 128, 129, 65535, 257 * 7 + 128, 257 * 7 + 129]], np.uint16)).save(path)
    assert png.read(path)[0, :, 1].tolist() == [0, 0, 1, 255, 7, 8]


@pytest.mark.parametrize(
    "codes",
    [np.zeros((2, 2), np.uint8), np.zeros((2, 2, 5), np.uint8), np.zeros((2, 2, 3)), np.zeros((0, 2, 3), np.uint8)],
)
def test_refused_arrays(path, codes):
    with pytest.raises(InputError, match=r"^png: rgb8: expected uint8 of shape"):
        png.write(path, codes)
    assert not path.exists()


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
    path.write_bytes(png_header(30000, 30000))
    assert "at most 268435456 pixels, found 30000 x 30000" in bad(path)


RNG = np.random.default_rng(1)
DEPTHS = RNG.uniform(0.5, 60, (13, 17)).astype(np.float32)
DEPTHS[RNG.random(DEPTHS.shape) < 0.2] = np.inf


def encoded(depth: np.ndarray, scale: float = depth_png.SCALE) -> bytes:
    file = io.BytesIO()
    depth_png.encode(file, depth, scale)
    return file.getvalue()


@pytest.mark.parametrize("scale", [1e-3, 0.0625])
def test_depths_come_back_within_half_a_step(tmp_path, scale):
    data, path = encoded(DEPTHS, scale), tmp_path / "a.png"
    path.write_bytes(data)
    depth, read_scale = depth_png.read(path)
    assert read_scale == scale
    seen = np.isfinite(DEPTHS)
    assert np.array_equal(np.isinf(depth), ~seen)
    assert np.abs(depth[seen] - DEPTHS[seen]).max() <= scale / 2 * (1 + 1e-12)
    assert encoded(DEPTHS, scale) == encoded(DEPTHS.astype(np.float64), scale) == data
    assert resolution_of(path) == (17, 13)


def test_other_programs_read_the_codes_and_the_scale(tmp_path):
    """Pillow, OpenImageIO and OpenCV: 16-bit gray, row 0 at the top, code 0 where there is nothing."""
    (tmp_path / "a.png").write_bytes(encoded(DEPTHS))
    steps = np.where(np.isfinite(DEPTHS), DEPTHS.astype(np.float64) / 1e-3, 0)
    with Image.open(tmp_path / "a.png") as image:
        codes = np.asarray(image)
        assert image.text["depthScale"] == "0.001"
    assert codes.dtype in (np.uint16, np.int32)  # the latter before Pillow 10.3
    assert np.abs(codes - steps).max() <= 0.5
    assert np.array_equal(codes == 0, np.isinf(DEPTHS))
    opened = pytest.importorskip("OpenImageIO").ImageInput.open(str(tmp_path / "a.png"))
    assert (str(opened.spec().format), opened.spec().nchannels) == ("uint16", 1)
    assert opened.spec().getattribute("depthScale") == "0.001"
    assert np.array_equal(opened.read_image(format="uint16")[..., 0], codes)
    cv2 = pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    assert np.array_equal(cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED), codes)


@pytest.mark.parametrize(
    ("depth", "scale", "message"),
    [
        (70.0, 1e-3, "expected 0.0011 or more, as 65535 steps have to reach depths of 70, found 0.001"),
        (1e300, 5e-324, "expected 1.6e+295 or more"),
        (4e-4, 1e-3, "expected steps of which depths of 0.0004 have one at least, found 0.001"),
        (-1.0, 1e-3, "depths of -1 "),
        (1.0, 0.0, "expected a finite number above 0, found 0"),
    ],
)
def test_depths_without_a_code(depth, scale, message):
    assert depth_png.codes(np.array([0.001, 65.535, np.inf])).tolist() == [1, 65535, 0]
    with pytest.raises(InputError) as caught:
        depth_png.codes(np.array([np.inf, 1.0, depth]), scale)
    assert str(caught.value).startswith("Frame.save: depth_scale: ")
    assert message in str(caught.value)


def test_refused_files(tmp_path):
    Image.fromarray(depth_png.codes(DEPTHS)).save(tmp_path / "plain.png")
    png.write(tmp_path / "colors.png", np.zeros((2, 3, 3), np.uint8))
    (tmp_path / "bad.png").write_bytes(encoded(DEPTHS, 0.5).replace(b"depthScale\x000.5", b"depthScale\x000,5"))
    expected = "file: expected a 16-bit gray PNG with a text depthScale.*"
    reasons = {"plain": f"{expected} none", "colors": f"{expected} channels: 3 of 8 bits", "bad": "", "none": ""}
    for name, reason in reasons.items():
        with pytest.raises(InputError, match=rf"{name}\.png: {reason}"):
            depth_png.read(tmp_path / f"{name}.png")
