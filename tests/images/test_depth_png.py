"""16-bit depth PNGs: codes, the scale in the file, readers of other programs, refusals."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from clshade.errors import InputError
from clshade.images import depth_png, png
from clshade.images.image_file import resolution_of


def noise(shape: tuple[int, int] = (13, 17)) -> np.ndarray:
    """Return float32 depths from 0.5 to 60 with holes."""
    rng = np.random.default_rng(1)
    depth = rng.uniform(0.5, 60, shape).astype(np.float32)
    depth[rng.random(shape) < 0.2] = np.inf
    return depth


def encoded(depth: np.ndarray, scale: float = depth_png.SCALE) -> bytes:
    file = io.BytesIO()
    depth_png.encode(file, depth, scale)
    return file.getvalue()


@pytest.mark.parametrize("scale", [1e-3, 1 / 5000 * 6, 0.0625])
def test_depths_come_back_within_half_a_step(tmp_path, scale):
    depth = noise()
    (tmp_path / "a.png").write_bytes(encoded(depth, scale))
    read_depth, read_scale = depth_png.read(tmp_path / "a.png")
    assert read_scale == scale
    seen = np.isfinite(depth)
    assert np.array_equal(np.isinf(read_depth), ~seen)
    assert np.abs(read_depth[seen] - depth[seen]).max() <= scale / 2 * (1 + 1e-12)
    assert encoded(depth, scale) == encoded(depth.astype(np.float64), scale) == (tmp_path / "a.png").read_bytes()
    assert resolution_of(tmp_path / "a.png") == (17, 13)


def test_other_programs_read_the_codes_and_the_scale(tmp_path):
    """Pillow, OpenImageIO and OpenCV: 16-bit gray, row 0 at the top, code 0 where there is nothing."""
    depth = noise()
    (tmp_path / "a.png").write_bytes(encoded(depth))
    steps = np.where(np.isfinite(depth), depth.astype(np.float64) / 1e-3, 0)
    with Image.open(tmp_path / "a.png") as image:
        codes = np.asarray(image)
        assert image.text["depthScale"] == "0.001"
    assert codes.dtype in (np.uint16, np.int32)  # the latter before Pillow 10.3
    assert np.abs(codes - steps).max() <= 0.5
    assert np.array_equal(codes == 0, np.isinf(depth))
    oiio = pytest.importorskip("OpenImageIO")
    opened = oiio.ImageInput.open(str(tmp_path / "a.png"))
    assert (str(opened.spec().format), opened.spec().nchannels) == ("uint16", 1)
    assert opened.spec().getattribute("depthScale") == "0.001"
    assert np.array_equal(opened.read_image(format="uint16")[..., 0], codes)
    cv2 = pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    assert np.array_equal(cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED), codes)


def test_the_ends_of_the_codes():
    assert depth_png.codes(np.array([0.001, 65.535, np.inf])).tolist() == [1, 65535, 0]
    assert depth_png.codes(np.full((2, 3), np.inf)).tolist() == [[0] * 3] * 2


@pytest.mark.parametrize(
    ("depth", "scale", "message"),
    [
        (70.0, 1e-3, "expected 0.0011 or more, as 65535 steps have to reach depths of 70, found 0.001"),
        (65.536, 1e-3, "expected 0.0011 or more"),
        (1e300, 5e-324, "expected 1.6e+295 or more"),
        (4e-4, 1e-3, "expected steps of which depths of 0.0004 have one at least, found 0.001"),
        (-1.0, 1e-3, "depths of -1 "),
        (1.0, 0.0, "expected a finite number above 0, found 0"),
        (1.0, np.nan, "expected a finite number above 0, found nan"),
        (1.0, "mm", "expected a finite number above 0, found 'mm'"),
    ],
)
def test_depths_without_a_code(depth, scale, message):
    with pytest.raises(InputError) as caught:
        depth_png.codes(np.array([np.inf, 1.0, depth]), scale)
    assert str(caught.value).startswith("Frame.save: depth_scale: ")
    assert message in str(caught.value)


@pytest.mark.parametrize("value", [1.0, 0.017, 9.94e5, 1e-300, 1.7e308])
def test_the_scale_that_an_error_names_is_enough(value):
    depth = np.array([value])
    with pytest.raises(InputError) as caught:
        depth_png.codes(depth, value / 1e6)
    named = float(str(caught.value).split("expected ")[1].split()[0])
    assert depth_png.codes(depth, named)[0] >= 50_000


def test_refused_files(tmp_path):
    depth = noise()
    Image.fromarray(depth_png.codes(depth)).save(tmp_path / "plain.png")
    png.write(tmp_path / "colors.png", np.zeros((2, 3, 3), np.uint8))
    (tmp_path / "cut.png").write_bytes(encoded(depth)[:-200])
    (tmp_path / "bad.png").write_bytes(encoded(depth, 0.5).replace(b"depthScale\x000.5", b"depthScale\x000,5"))
    for name in ("plain", "colors"):
        with pytest.raises(InputError, match=rf"{name}\.png: file: expected a 16-bit gray PNG with a text depthScale"):
            depth_png.read(tmp_path / f"{name}.png")
    for name in ("cut", "bad", "none"):
        with pytest.raises(InputError, match=rf"{name}\.png: "):
            depth_png.read(tmp_path / f"{name}.png")
