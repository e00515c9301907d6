"""EXR files: every channel and attribute is preserved bit for bit."""

from __future__ import annotations

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

LOSSLESS = [name for name in exr.COMPRESSIONS if name not in exr.LOSSY]
# Zeros, denormals, infinities, quiet and signaling NaNs with payloads, 1e6, the largest float; then random bits.
SPECIAL = [0, 1 << 31, 1, 0x80000001, 0x7FFFFF, 0x7F800000, 0xFF800000, 0x7FC00000, 0x7F800001, 0xFFC12345, 0x7FFFFFFF]
SPECIAL += [int(np.float32(1e6).view(np.uint32)), 0x7F7FFFFF]
BITS = np.concatenate([np.array(SPECIAL, np.uint32), np.random.default_rng(3).integers(0, 2**32, 5000, np.uint32)])
CAMERA = Camera((1.0, 2.0, 3.0), (-0.5, 0.25, -4.0), (0.2, 1.0, 0.1), 2.0, (1.5, 1.0), (40, 30))


def noise(shape, dtype=np.float32):
    words = np.resize(BITS, shape)
    return words if dtype == np.uint32 else words.view(np.float32)


def same(actual, expected):
    assert actual.dtype == expected.dtype
    assert actual.shape == expected.shape
    assert actual.tobytes() == np.ascontiguousarray(expected).tobytes()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.exr"


@pytest.mark.parametrize("compression", LOSSLESS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (67, 75), (1, 16384)])
def test_round_trip_bit_for_bit(path, compression, shape):
    names = ["R", "G", "B", "A", "Z", "N.X", "uv.V"] if max(shape) < 100 else ["R", "Z"]
    planes = {name: np.roll(noise(shape), k) for k, name in enumerate(names)}
    planes["id"] = noise(shape, np.uint32)
    assert exr.write(path, planes, compression=compression) == []
    channels, header = exr.read(path)
    assert header["compression"] == compression
    assert header["type"] == "scanlineimage"
    assert [name for name in channels if name in "RGBA"] == [name for name in names if name in "RGBA"]
    assert set(channels) == set(planes)
    for name, plane in planes.items():
        same(channels[name], plane)


def test_round_trip_of_as_many_rows_as_there_can_be(path):
    exr.write(path, {"R": noise((16384, 1))})
    same(exr.read(path)[0]["R"], noise((16384, 1)))


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("compression", exr.LOSSY)
def test_lossy_compressions_change_the_channels_that_they_name(path, compression, half):
    """pxr24 rounds float32 alone, b44 half alone, dwaa colors, of either type; layers keep their bits in any case, though
    OpenEXR's DWA takes each channel for a luminance whose name ends in Y."""
    values = np.random.default_rng(4).uniform(0.1, 1.0, (40, 50)).astype(np.float32)
    layers = dict.fromkeys(("R", "BY", "A", "albedo.B", "N.X", "N.Y", "flow.Y", "a.RY", "Z"), values)
    layers["P"] = np.dstack([values, values + 5.3e6, values])
    layers["id"] = values.view(np.uint32)
    warnings = exr.write(path, layers, compression=compression, half=half)
    named = {name for line in warnings for name in line.split(":")[0].split(", ")}
    expected = (
        {"R", "BY"}
        if compression.startswith("dwa")
        else {"R", "BY", "A"}
        if half != (compression == "pxr24")
        else set()
    )
    assert named == expected
    channels, header = exr.read(path)
    assert header["compression"] == compression
    for name, plane in channels.items():
        exact = exr.flatten(layers)[name].astype(plane.dtype)
        assert (plane == exact).all() == (name not in expected), name
        assert plane.dtype.kind == "u" or np.abs(plane - exact).max() < 0.2, name


def test_lossy_compressions_need_an_image(path):
    with pytest.raises(InputError, match="compression: expected a lossless one for layers without R, G, B or A, found"):
        exr.write(path, {"Z": np.ones((9, 9))}, compression="pxr24")


def test_arrays_that_are_not_contiguous(path):
    image = noise((13, 11, 4)).copy()
    image.flags.writeable = False
    planes = {"R": image[::-1, :, 0], "G": image[:, ::-1, 1], "B": image[..., 2], "Z": noise((11, 13)).T}
    exr.write(path, planes)
    channels, _ = exr.read(path)
    for name, plane in planes.items():
        same(channels[name], plane)
    exr.write(path, {"R": noise((26, 22))[::2, 1::2]})
    same(exr.read(path)[0]["R"], noise((26, 22))[::2, 1::2])


def test_arguments_stay_as_they_are(path):
    channels = {"RGBA": noise((3, 4, 4)), "N": noise((3, 4, 3))}
    metadata = {"scene": "teapot", "worldToCamera": np.eye(4)}
    exr.write(path, channels, metadata=metadata)
    assert list(channels) == ["RGBA", "N"]
    assert list(metadata) == ["scene", "worldToCamera"]


def test_layers_get_their_channel_names(path):
    image, wide = noise((3, 5, 3)), noise((3, 5, 4))
    exr.write(path, {"RGBA": wide, "N": image, "P": image, "albedo": image, "uv": image[..., :2], "Z": image[..., 0]})
    channels, _ = exr.read(path)
    names = {"R", "G", "B", "A", "N.X", "N.Y", "N.Z", "P.X", "P.Y", "P.Z", "uv.U", "uv.V", "Z"}
    assert set(channels) == names | {"albedo.R", "albedo.G", "albedo.B"}
    for k, name in enumerate("RGBA"):
        same(channels[name], wide[..., k])
    for k, name in enumerate(["N.X", "N.Y", "N.Z"]):
        same(channels[name], image[..., k])
    same(channels["uv.V"], image[..., 1])
    exr.write(path, image)
    assert list(exr.read(path)[0]) == ["R", "G", "B"]
    exr.write(path, wide)
    same(exr.read(path)[0]["A"], wide[..., 3])


def test_red_is_red_and_row_0_is_on_top(path):
    """Parsed from the bytes, without OpenEXR: chunks hold y, size, then the channels of a row in alphabetical order."""
    image = np.arange(2 * 3 * 3, dtype=np.float32).reshape(2, 3, 3)
    exr.write(path, image, compression="none")
    data = path.read_bytes()
    rows = [struct.pack("<ii", y, 36) + image[y, :, ::-1].T.astype("<f4").tobytes() for y in (0, 1)]
    assert data.endswith(rows[0] + rows[1])
    assert b"colorInteropID\0string\0" in data


def test_other_types_of_numbers(path):
    mask = np.array([[True, False]])
    exr.write(
        path, {"R": np.float64([[0.1, 3e38]]), "G": np.float16([[0.5, 2]]), "B": np.array([[1, 2]], ">f4"), "m": mask}
    )
    channels, _ = exr.read(path)
    same(channels["R"], np.float32([[0.1, 3e38]]))
    same(channels["G"], np.float32([[0.5, 2]]))
    same(channels["B"], np.float32([[1, 2]]))
    same(channels["m"], np.uint32([[1, 0]]))
    exr.write(path, {"id": np.array([[0, 2**32 - 1]], np.int64)})
    same(exr.read(path)[0]["id"], np.uint32([[0, 2**32 - 1]]))
    assert exr.write(path, {"Z": np.float64([[1e39, np.inf]])}) == [
        "Z: 1 finite values of 3.4e38 or more became infinity in float32"
    ]


def test_half_and_its_warnings(path):
    colors = np.float32([[65519.0, 65520.0, -1e6, np.inf, 0.1]])
    layers = {
        "R": colors,
        "G": np.float32([[np.nan, 1, 2, 3, 4]]),
        "B": np.float32([[0, 1, np.inf, 65504, 1e-30]]),
        "Z": colors,
        "P.X": colors,
    }
    layers |= {"albedo.R": np.float32([[1, 1, 1, 1, 7e4]]), "id": np.uint32([[70000, 1, 2, 3, 4]])}
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


def test_header_values(path):
    matrices = camera_metadata(CAMERA)
    texts = {"software": "clshade 1.2", "settings": "shader=phong\nn=20", "scene": "théière"}
    exr.write(path, noise((3, 4, 3)), metadata={**matrices, **texts, "renderTimeSeconds": 1.25, "count": np.int64(-7)})
    _, header = exr.read(path)
    for name, matrix in zip(("worldToCamera", "worldToNDC"), camera_matrices(CAMERA), strict=True):
        same(header[name], matrix.astype(np.float32))
    assert {name: header[name] for name in texts} == texts
    assert header["renderTimeSeconds"] == 1.25
    assert header["count"] == -7
    assert header["colorInteropID"] == "lin_rec709_scene"
    assert header["pixelAspectRatio"] == np.float32((1.0 / 40) / (1.5 / 30))
    assert header["dataWindow"] == header["displayWindow"] == (0, 0, 3, 2)
    exr.write(path, noise((3, 4, 3)), metadata={"renderTimeSeconds": None})
    _, header = exr.read(path)
    assert header["software"] == "clshade"
    assert header["pixelAspectRatio"] == 1.0
    assert "renderTimeSeconds" not in header


def test_matrices_are_stored_row_after_row(path):
    """Imath's M44f is used with row vectors: the translation is the last row, so the 15th of 16 floats is z."""
    exr.write(path, noise((1, 1, 3)), metadata={"worldToCamera": np.arange(16.0).reshape(4, 4)})
    stored = struct.pack("<16f", *range(16))
    assert b"worldToCamera\0m44f\0" + struct.pack("<i", 64) + stored in path.read_bytes()


VIEWS = {
    "perspective": CAMERA,
    "off center": replace(CAMERA, principal=(0.25, 0.875)),
    "orthographic": replace(CAMERA, orthographic=True),
    "orthographic off center": replace(CAMERA, orthographic=True, principal=(-0.5, 0.6)),
}


@pytest.mark.parametrize("camera", VIEWS.values(), ids=list(VIEWS))
def test_camera_matrices_put_points_where_the_renderer_does(camera):
    to_camera, to_ndc = camera_matrices(camera)
    rng = np.random.default_rng(6)
    inside = np.column_stack([rng.normal(size=(50, 2)), rng.uniform(0.1, 9, 50)])  # camera space
    rows = np.column_stack([inside @ camera_axes(camera) + camera.eye, np.ones(50)])  # world space
    assert np.allclose((rows @ to_camera)[:, :3], inside, atol=1e-13)  # left-handed
    ndc = rows @ to_ndc
    projected = ndc[:, :3] / ndc[:, 3:]
    depth = inside[:, 2]
    assert np.allclose(projected[:, 2], depth if camera.orthographic else 1 - camera.focal / depth, rtol=1e-12)
    u, v = image_positions(inside, camera).T
    assert np.allclose(projected[:, 0], u / camera.resolution[0], rtol=1e-11, atol=1e-11)
    assert np.allclose(projected[:, 1], 1.0 - v / camera.resolution[1], rtol=1e-11, atol=1e-11)


def test_two_writes_are_the_same_bytes(tmp_path):
    layers = {"RGB": noise((300, 200, 3)), "Z": noise((300, 200))}
    for compression in exr.COMPRESSIONS:
        for name in ("a", "b"):
            exr.write(tmp_path / name, layers, compression=compression, metadata=camera_metadata(CAMERA))
        assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_data_window(path):
    image = np.zeros((8, 9, 3), np.float32)
    image[2:5, 3:8] = noise((3, 5, 3))
    exr.write(path, image, window="drawn")
    channels, header = exr.read(path)
    assert header["displayWindow"] == (0, 0, 8, 7)
    window = header["dataWindow"]
    assert window == exr.drawn_window(exr.flatten(image))
    for k, name in enumerate("RGB"):
        same(channels[name], image[..., k])
    exr.write(path, image, window=(4, 2, 6, 3))
    channels, header = exr.read(path)
    assert header["dataWindow"] == (4, 2, 6, 3)
    expected = np.zeros_like(image)
    expected[2:4, 4:7] = image[2:4, 4:7]
    same(channels["G"], expected[..., 1])


def test_the_drawn_window_holds_all_that_is_not_0():
    blank = np.zeros((6, 5), np.float32)
    assert exr.drawn_window({"R": blank}) == (0, 0, 0, 0)
    for value in (1e-45, np.nan, -0.0, np.inf):
        plane = blank.copy()
        plane[4, 1] = value
        assert exr.drawn_window({"R": blank, "G": plane}) == (1, 4, 1, 4)
    ids = np.zeros((6, 5), np.uint32)
    ids[2, 3] = 1
    assert exr.drawn_window({"G": plane, "id": ids}) == (1, 2, 3, 4)
    assert exr.drawn_window({"Z": np.full((6, 5), np.inf)}) == (0, 0, 4, 5)


def test_a_data_window_beyond_the_display_window(path):
    import OpenEXR

    box = lambda *edges: (np.array(edges[:2], np.int32), np.array(edges[2:], np.int32))  # noqa: E731
    pixels = np.arange(20, dtype=np.float32).reshape(4, 5)
    header = {"dataWindow": box(-2, -1, 2, 2), "displayWindow": box(0, 0, 3, 3), "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Y": pixels.copy()}) as file:
        file.write(str(path))
    expected = np.zeros((4, 4), np.float32)
    expected[:3, :3] = pixels[1:, 2:]
    same(exr.read(path)[0]["Y"], expected)


REFUSED = [
    ({"R": np.zeros((2, 2)), "G": np.zeros((2, 3))}, {}, "all of the same shape"),
    ({}, {}, "at least one"),
    ({"R": np.zeros((0, 3))}, {}, "expected an array of shape (M, N)"),
    ({"R": np.zeros(3)}, {}, "expected an array of shape (M, N)"),
    ({"N": np.zeros((2, 2, 4))}, {}, "expected shape (M, N, 3)"),
    (np.zeros((2, 2, 2)), {}, "expected shape (M, N, 3)"),
    ({"RGB": np.zeros((2, 2, 3)), "G": np.zeros((2, 2))}, {}, "found two"),
    ({"": np.zeros((2, 2))}, {}, "names of at least one letter"),
    ({"id": np.array([[-1]])}, {}, "whole numbers from 0 to 2^32-1"),
    ({"id": np.array([[2**32]])}, {}, "whole numbers from 0 to 2^32-1"),
    ({"R": np.array([["x"]])}, {}, "found type"),
    ({"R": np.array([[1j]])}, {}, "found type"),
    (np.zeros((2, 2, 3)), {"compression": "lzma"}, "expected one of none, rle"),
    (np.zeros((2, 2, 3)), {"metadata": {"n": 2**31}}, "a whole number of 32 bits"),
    (np.zeros((2, 2, 3)), {"metadata": {"n": [1, 2]}}, "a whole number of 32 bits"),
    (np.zeros((2, 2, 3)), {"metadata": {"type": "x"}}, "the name of an attribute"),
    (np.zeros((2, 2, 3)), {"metadata": {"pixelAspectRatio": 0.0}}, "from 1e-6 to 1e6"),
    (np.zeros((2, 2, 3)), {"window": (0, 0, 2, 1)}, "inside 2 x 2 pixels"),
    (np.zeros((2, 2, 3)), {"window": "auto"}, "drawn, covered or None"),
]


@pytest.mark.parametrize(("channels", "options", "message"), REFUSED)
def test_refused_arguments(path, channels, options, message):
    with pytest.raises(InputError) as caught:
        exr.write(path, channels, **options)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not path.exists()


def test_a_child_made_by_fork_can_write(path):
    """OpenEXR's threads do not survive a fork; unless stopped before, the child would wait for them forever."""
    code = (
        "import os, sys, numpy as np\nfrom clshade import exr\n"
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


def test_importing_costs_no_library():
    code = (
        "import sys, clshade.images.exr, clshade.images.png, clshade.images.tonemap, clshade.images.statistics\n"
        "print({'OpenEXR', 'PIL', 'matplotlib', 'pyopencl'} & set(sys.modules))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=20, check=True)
    assert result.stdout == "set()\n"
