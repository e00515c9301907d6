"""EXR files: every channel and attribute is preserved bit for bit."""

import contextlib
import os
import signal
import struct
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.images import exr
from clshade.pipeline.camera_space import image_positions
from clshade.scene.camera import Camera
from clshade.scene.geometry import camera_axes, camera_matrices, camera_metadata

# Zeros, denormals, infinities, quiet and signaling NaNs with payloads, 1e6, the largest float; then random bits.
SPECIAL = [0, 1 << 31, 1, 0x80000001, 0x7FFFFF, 0x7F800000, 0xFF800000, 0x7FC00000, 0x7F800001, 0xFFC12345, 0x7FFFFFFF]
SPECIAL += [int(np.float32(1e6).view(np.uint32)), 0x7F7FFFFF]
BITS = np.concatenate([np.array(SPECIAL, np.uint32), np.random.default_rng(3).integers(0, 2**32, 5000, np.uint32)])
CAMERA = Camera((1.0, 2.0, 3.0), (-0.5, 0.25, -4.0), (0.2, 1.0, 0.1), 2.0, (1.5, 1.0), (40, 30))
LONG_SHAPES = (1, 16384), (16384, 1)


def noise(shape, dtype=np.float32):
    words = np.resize(BITS, shape)
    return words if dtype == np.uint32 else words.view(np.float32)


def same(actual, expected):
    assert (actual.dtype, actual.shape) == (expected.dtype, expected.shape)
    assert actual.tobytes() == np.ascontiguousarray(expected).tobytes()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.exr"


@pytest.mark.parametrize("compression", [name for name in exr.COMPRESSIONS if name not in exr.LOSSY])
@pytest.mark.parametrize("shape", [(1, 1), (67, 75), *(pytest.param(s, marks=pytest.mark.long) for s in LONG_SHAPES)])
def test_round_trip_bit_for_bit(path, compression, shape):
    names = ["R", "G", "B", "A", "Z", "N.X", "uv.V"] if max(shape) < 100 else ["R", "Z"]
    planes = {name: np.roll(noise(shape), k) for k, name in enumerate(names)}
    planes["id"] = noise(shape, np.uint32)
    for name in ("a.exr", "again.exr"):
        assert exr.write(path.parent / name, planes, compression=compression, metadata=camera_metadata(CAMERA)) == []
    assert path.read_bytes() == (path.parent / "again.exr").read_bytes()
    channels, header = exr.read(path)
    assert (header["compression"], header["type"]) == (compression, "scanlineimage")
    assert [name for name in channels if name in "RGBA"] == [name for name in names if name in "RGBA"]
    assert set(channels) == set(planes)
    for name, plane in planes.items():
        same(channels[name], plane)


COLORS, ALL = {"R", "BY"}, {"R", "BY", "A"}


@pytest.mark.parametrize(
    ("compression", "of_floats", "of_halves"),
    [
        ("pxr24", ALL, set()),
        *((name, set(), ALL) for name in ("b44", "b44a")),
        *((name, COLORS, COLORS) for name in ("dwaa", "dwab")),
    ],
)
@pytest.mark.parametrize("half", [False, True])
def test_lossy_compressions_change_the_channels_that_they_name(path, compression, of_floats, of_halves, half):
    """Layers keep their bits, though OpenEXR's DWA takes each channel for a luminance whose name ends in Y."""
    values = np.random.default_rng(4).uniform(0.1, 1.0, (40, 50)).astype(np.float32)
    layers = dict.fromkeys(("R", "BY", "A", "albedo.B", "N.X", "N.Y", "flow.Y", "a.RY", "Z"), values)
    layers["P"] = np.dstack([values, values + 5.3e6, values])
    layers["id"] = values.view(np.uint32)
    changed = of_halves if half else of_floats
    warnings = exr.write(path, layers, compression=compression, half=half)
    assert {name for line in warnings for name in line.split(":")[0].split(", ")} == changed
    before = path.read_bytes()
    exr.write(path, layers, compression=compression, half=half)
    assert path.read_bytes() == before
    channels, header = exr.read(path)
    assert header["compression"] == compression
    for name, plane in channels.items():
        exact = exr.flatten(layers)[name].astype(plane.dtype)
        assert (plane == exact).all() == (name not in changed), name
        assert plane.dtype.kind == "u" or np.abs(plane - exact).max() < 0.2, name


def test_layers_get_their_channel_names(path):
    image, wide = noise((3, 5, 3)), noise((3, 5, 4))
    layers = {"RGBA": wide, "N": image, "P": image, "albedo": image, "uv": image[..., :2], "Z": image[..., 0]}
    exr.write(path, layers)
    assert list(layers) == ["RGBA", "N", "P", "albedo", "uv", "Z"]
    channels, _ = exr.read(path)
    names = ["R", "G", "B", "A", "N.X", "N.Y", "N.Z", "P.X", "P.Y", "P.Z", "albedo.R", "albedo.G", "albedo.B"]
    names += ["uv.U", "uv.V", "Z"]
    assert set(channels) == set(names)
    for name, plane in zip(names, np.dstack(list(layers.values())).transpose(2, 0, 1), strict=True):
        same(channels[name], plane)
    for colors, letters in ((image, "RGB"), (wide, "RGBA")):
        exr.write(path, colors)
        channels, _ = exr.read(path)
        assert "".join(channels) == letters
        same(channels[letters[-1]], colors[..., -1])


def test_bytes_of_pixels_and_matrices(path):
    """Parsed without OpenEXR: chunks hold y, size, then the channels of a row in alphabetical order; row 0 is on top.
    Imath's M44f is used with row vectors: the translation is the last row, so the 15th of 16 floats is z."""
    image = np.arange(2 * 3 * 3, dtype=np.float32).reshape(2, 3, 3)
    exr.write(path, image, compression="none", metadata={"worldToCamera": np.arange(16.0).reshape(4, 4)})
    data = path.read_bytes()
    rows = [struct.pack("<ii", y, 36) + image[y, :, ::-1].T.astype("<f4").tobytes() for y in (0, 1)]
    assert data.endswith(rows[0] + rows[1])
    assert b"colorInteropID\0string\0" in data
    assert b"worldToCamera\0m44f\0" + struct.pack("<i16f", 64, *range(16)) in data


@pytest.mark.parametrize(
    ("plane", "stored"),
    [
        (np.float64([[0.1, 3e38]]), np.float32([[0.1, 3e38]])),
        (np.float16([[0.5, 2]]), np.float32([[0.5, 2]])),
        (np.array([[1, 2]], ">f4"), np.float32([[1, 2]])),
        (np.array([[True, False]]), np.uint32([[1, 0]])),
        (np.array([[0, 2**32 - 1]], np.int64), np.uint32([[0, 2**32 - 1]])),
    ],
)
def test_other_types_of_numbers(path, plane, stored):
    assert exr.write(path, {"G": plane}) == []
    same(exr.read(path)[0]["G"], stored)


def test_half_and_its_warnings(path):
    colors = np.float32([[65519.0, 65520.0, -1e6, np.inf, 0.1]])
    layers = {"R": colors, "G": np.float32([[np.nan, 1, 2, 3, 4]]), "B": np.float32([[0, 1, np.inf, 65504, 1e-30]])}
    layers |= {"Z": colors, "P.X": colors, "albedo.R": np.float32([[1, 1, 1, 1, 7e4]])}
    layers["id"] = np.uint32([[70000, 1, 2, 3, 4]])
    assert exr.write(path, layers, half=True) == [
        "R: 2 finite values of 65520 or more became infinity in half",
        "G: 1 NaN values lost their payload in half",
        "albedo.R: 1 finite values of 65520 or more became infinity in half",
    ]
    channels, _ = exr.read(path)
    same(channels["R"], np.float16([[65504, np.inf, -np.inf, np.inf, 0.1]]))
    assert np.isnan(channels["G"][0, 0])
    assert channels["albedo.R"].dtype == np.float16
    for name in ("Z", "P.X", "id"):
        same(channels[name], layers[name])
    assert exr.write(path, layers) == []
    warnings = exr.write(path, {"Z": np.float64([[1e39, np.inf]])})
    assert warnings == ["Z: 1 finite values of 3.4e38 or more became infinity in float32"]


def test_header_values(path):
    texts = {"software": "clshade 1.2", "settings": "shader=phong\nn=20", "scene": "théière"}
    metadata = {**camera_metadata(CAMERA), **texts, "renderTimeSeconds": 1.25, "count": np.int64(-7)}
    exr.write(path, noise((3, 4, 3)), metadata=metadata)
    header = exr.read(path)[1]
    for name, matrix in zip(("worldToCamera", "worldToNDC"), camera_matrices(CAMERA), strict=True):
        same(header[name], matrix.astype(np.float32))
    expected = {**texts, "renderTimeSeconds": 1.25, "count": -7, "colorInteropID": "lin_rec709_scene"}
    assert {name: header[name] for name in expected} == expected
    assert header["pixelAspectRatio"] == np.float32((1.0 / 40) / (1.5 / 30))
    assert header["dataWindow"] == header["displayWindow"] == (0, 0, 3, 2)
    exr.write(path, noise((3, 4, 3)), metadata={"renderTimeSeconds": None})
    _, header = exr.read(path)
    assert (header["software"], header["pixelAspectRatio"]) == ("clshade", 1.0)
    assert "renderTimeSeconds" not in header


@pytest.mark.parametrize(
    "changes",
    [{}, {"principal": (0.25, 0.875)}, {"orthographic": True}, {"orthographic": True, "principal": (-0.5, 0.6)}],
)
def test_camera_matrices_put_points_where_the_renderer_does(changes):
    camera = replace(CAMERA, **changes)
    to_camera, to_ndc = camera_matrices(camera)
    rng = np.random.default_rng(6)
    inside = np.column_stack([rng.normal(size=(50, 2)), rng.uniform(0.1, 9, 50)])  # camera space
    rows = np.column_stack([inside @ camera_axes(camera) + camera.eye, np.ones(50)])  # world space
    assert np.allclose((rows @ to_camera)[:, :3], inside, atol=1e-13)  # left-handed
    ndc = rows @ to_ndc
    projected, depth = ndc[:, :3] / ndc[:, 3:], inside[:, 2]
    assert np.allclose(projected[:, 2], depth if camera.orthographic else 1 - camera.focal / depth, rtol=1e-12)
    u, v = image_positions(inside, camera).T
    assert np.allclose(projected[:, 0], u / camera.resolution[0], rtol=1e-11, atol=1e-11)
    assert np.allclose(projected[:, 1], 1.0 - v / camera.resolution[1], rtol=1e-11, atol=1e-11)


def test_data_window(path):
    image = np.zeros((8, 9, 3), np.float32)
    image[2:5, 3:8] = noise((3, 5, 3))
    for window, (x0, y0, x1, y1) in (("drawn", (3, 2, 7, 4)), ((4, 2, 6, 3), (4, 2, 6, 3))):
        exr.write(path, image, window=window)
        channels, header = exr.read(path)
        assert (header["displayWindow"], header["dataWindow"]) == ((0, 0, 8, 7), (x0, y0, x1, y1))
        expected = np.zeros_like(image)
        expected[y0 : y1 + 1, x0 : x1 + 1] = image[y0 : y1 + 1, x0 : x1 + 1]
        for k, name in enumerate("RGB"):
            same(channels[name], expected[..., k])


def test_the_drawn_window_holds_all_that_is_not_0():
    blank, plane = np.zeros((2, 6, 5), np.float32)
    assert exr.drawn_window({"R": blank}) == (0, 0, 0, 0)
    for value in (1e-45, np.nan, -0.0, np.inf):
        plane[4, 1] = value
        assert exr.drawn_window({"R": blank, "G": plane}) == (1, 4, 1, 4)
    ids = np.zeros((6, 5), np.uint32)
    ids[2, 3] = 1
    assert exr.drawn_window({"G": plane, "id": ids}) == (1, 2, 3, 4)
    assert exr.drawn_window({"Z": np.full((6, 5), np.inf)}) == (0, 0, 4, 5)


IMAGE = np.zeros((2, 2, 3))


@pytest.mark.parametrize(
    ("channels", "options", "message"),
    [
        ({"R": np.zeros((2, 2)), "G": np.zeros((2, 3))}, {}, "all of the same shape"),
        ({}, {}, "at least one"),
        *(({"R": np.zeros(shape)}, {}, "expected an array of shape (M, N)") for shape in ((0, 3), 3)),
        ({"N": np.zeros((2, 2, 4))}, {}, "expected shape (M, N, 3)"),
        (np.zeros((2, 2, 2)), {}, "expected shape (M, N, 3)"),
        ({"RGB": IMAGE, "G": np.zeros((2, 2))}, {}, "found two"),
        ({"": np.zeros((2, 2))}, {}, "names of at least one letter"),
        *(({"id": np.array([[wrong]])}, {}, "whole numbers from 0 to 2^32-1") for wrong in (-1, 2**32)),
        *(({"R": np.array([[wrong]])}, {}, "found type") for wrong in ("x", 1j)),
        ({"Z": np.ones((9, 9))}, {"compression": "pxr24"}, "a lossless one for layers without R, G, B or A, found"),
        (IMAGE, {"compression": "lzma"}, "expected one of none, rle"),
        *((IMAGE, {"metadata": {"n": wrong}}, "a whole number of 32 bits") for wrong in (2**31, [1, 2])),
        (IMAGE, {"metadata": {"type": "x"}}, "the name of an attribute"),
        (IMAGE, {"metadata": {"pixelAspectRatio": 0.0}}, "from 1e-6 to 1e6"),
        (IMAGE, {"window": (0, 0, 2, 1)}, "inside 2 x 2 pixels"),
        (IMAGE, {"window": "auto"}, "drawn, covered or None"),
    ],
)
def test_refused_arguments(path, channels, options, message):
    with pytest.raises(InputError) as caught:
        exr.write(path, channels, **options)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not path.exists()


def test_a_child_made_by_fork_can_write(path):
    """OpenEXR's threads do not survive a fork; unless stopped before, the child would wait for them forever. Importing
    costs no library before."""
    code = (
        "import os, sys, numpy as np\n"
        "import clshade.images.exr, clshade.images.png, clshade.images.tonemap, clshade.images.statistics\n"
        "assert not {'OpenEXR', 'PIL', 'matplotlib', 'pyopencl'} & set(sys.modules)\n"
        "from clshade import exr\n"
        "exr.write(sys.argv[1], np.ones((99, 99, 3)))\n"
        "child = os.fork()\n"
        "exr.write(sys.argv[1] + str(child > 0), np.ones((99, 99, 3)))\n"
        "if child: sys.exit(os.waitpid(child, 0)[1])\n"
        "os._exit(0)"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(path)], start_new_session=True)
    try:
        assert process.wait(timeout=20) == 0
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)  # also ends a child that hangs
    assert (path.parent / "a.exrTrue").read_bytes() == (path.parent / "a.exrFalse").read_bytes()
