"""EXR errors: a full disk leaves the earlier file intact, bad files raise an InputError of one line."""

import io
import os
import re
import struct
from functools import partial
from unittest import mock

import numpy as np
import OpenEXR
import pytest

from clshade.errors import InputError, OutputError
from clshade.images import exr, exr_limits, png


def noise(shape):
    return np.random.default_rng(8).random(shape, np.float32)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.exr"


class Failing(io.BytesIO):
    limit, error = 0, None

    def write(self, data):
        if self.tell() + len(data) > self.limit:
            raise self.error
        return super().write(data)


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_disk_that_is_full_after_any_number_of_bytes(error):
    """The last bytes matter most: OpenEXR seeks back and writes its table of offsets at the very end."""

    def encode(compression, names, limit, error=None):
        box = (np.zeros(2, np.int32), np.array([8, 39], np.int32))
        sink = Failing()
        sink.limit, sink.error = limit, error
        header, channels = {"dataWindow": box, "displayWindow": box}, {"R": noise((40, 9)).copy()}
        exr._compress(sink, [(name, compression, header, channels) for name in names])
        return len(sink.getvalue())

    for compression, names in (("none", "a"), ("zip", "a"), ("zstd", "a"), ("zip", "ab")):
        size = encode(compression, names, 1 << 30)
        for limit in [*range(0, size, 97), *range(size - 30, size)]:
            with pytest.raises(type(error)):
                encode(compression, names, limit, error)
        assert OpenEXR.global_thread_count() == 0


@pytest.mark.parametrize(
    ("name", "write", "limit"),
    [
        ("a.exr", partial(exr.write, compression="none"), 100_000),
        ("a.png", lambda path, values: png.write(path, np.uint8(values * 255)), 50_000),
    ],
)
def test_a_full_disk_leaves_the_earlier_file(tmp_path, name, write, limit):
    resource = pytest.importorskip("resource")
    path = tmp_path / name
    write(path, noise((4, 4, 3)))
    before = path.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        with pytest.raises(OutputError, match=re.escape(name) + ": cannot be written: File too large$"):
            write(path, noise((200, 200, 3)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == [name]
    with pytest.raises(OutputError, match="there is no folder"):
        write(tmp_path / "none" / name, noise((2, 2, 3)))


def bad(path, capfd) -> str:
    with pytest.raises(InputError) as caught:
        exr.read(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    assert capfd.readouterr() == ("", "")
    return text


def test_files_that_are_no_exr(tmp_path, capfd):
    for content, message in ((b"", "empty"), (b"text", "something else"), (b"\x76\x2f\x31\x01", "expected an OpenEXR")):
        (tmp_path / "a.exr").write_bytes(content)
        assert message in bad(tmp_path / "a.exr", capfd)
    os.mkfifo(tmp_path / "pipe.exr")
    for name, message in (("missing.exr", "no such file"), ("", "folder"), ("pipe.exr", "regular file")):
        assert message in bad(tmp_path / name, capfd)


@pytest.mark.sampled
@pytest.mark.parametrize("compression", ["zip", *sorted(set(exr.COMPRESSIONS) - {"zip"})])
def test_truncated_and_damaged_files(path, capfd, compression):
    exr.write(path, np.repeat(noise((40, 3, 3)), 4, axis=1), compression=compression)
    data, descriptors = bytearray(path.read_bytes()), len(os.listdir("/proc/self/fd"))
    for size in [*range(0, len(data), 61), len(data) - 1]:
        path.write_bytes(data[:size])
        bad(path, capfd)
    assert len(os.listdir("/proc/self/fd")) == descriptors
    if compression in ("zip", "zstd", "pxr24"):
        for k in range(20):
            data[len(data) // 2 + k] ^= 0x5A
        path.write_bytes(data)
        assert "truncated or damaged" in bad(path, capfd)


@pytest.fixture
def opened(monkeypatch) -> list[bool]:
    """Whether the header alone was read, of each file that OpenEXR opened."""
    calls, genuine = [], OpenEXR.File

    def noted(*arguments, **options):
        calls.append(options.get("header_only", False))
        return genuine(*arguments, **options)

    monkeypatch.setattr(OpenEXR, "File", noted)
    return calls


def box(*edges):
    return np.array(edges[:2], np.int32), np.array(edges[2:], np.int32)


def test_images_of_other_kinds(path, capfd):
    """Deep ones, tiles, and one whose data window is beyond the display window."""
    samples = np.empty((2, 2), object)
    samples.flat[:] = [np.zeros(k + 1, np.float32) for k in range(4)]
    deep = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    OpenEXR.File(deep, {"Z": samples}).write(str(path))
    assert "a flat image" in bad(path, capfd)
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 3
    OpenEXR.File({"type": OpenEXR.tiledimage, "tiles": tiles}, {"Y": noise((7, 5)).copy()}).write(str(path))
    assert np.array_equal(exr.read(path)[0]["Y"], noise((7, 5)))
    header = {"dataWindow": box(-2, -1, 2, 2), "displayWindow": box(0, 0, 3, 3), "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Y": noise((4, 5)).copy()}).write(str(path))
    expected = np.zeros((4, 4), np.float32)
    expected[:3, :3] = noise((4, 5))[1:, 2:]
    assert np.array_equal(exr.read(path)[0]["Y"], expected)


def test_several_parts(path, capfd):
    """Each in its own window; a name already taken is prefixed with the part's. The header has types and names."""
    first, second, long = noise((5, 7)).copy(), np.arange(4, dtype=np.float16).reshape(2, 2), "x" * 200
    common = {"type": OpenEXR.scanlineimage, "displayWindow": box(0, 0, 6, 4)}
    header = {**common, "dataWindow": box(3, 1, 4, 2)}
    parts = [
        OpenEXR.Part({**common, "dataWindow": box(0, 0, 6, 4)}, {"R": first.copy(), "Z": first.copy()}, "beauty"),
        OpenEXR.Part(header, {"Z": second, "id": second.astype(np.uint32), long: second.copy()}, "other"),
    ]
    OpenEXR.File(parts).write(str(path))
    assert exr_limits.channel_bytes(path.read_bytes(), 2) == [{"R": 4, "Z": 4}, {"Z": 2, "id": 4, long: 2}]
    channels, header = exr.read(path)
    assert sorted(channels) == ["R", "Z", "id", "other.Z", long]
    assert (header["name"], "channels" in header) == ("beauty", False)
    assert np.array_equal(channels["Z"], first)
    inside = np.zeros((5, 7))
    inside[1:3, 3:5] = second
    assert np.array_equal(channels["other.Z"], inside)
    assert (channels["other.Z"].dtype, channels["id"].dtype) == (np.float16, np.uint32)
    path.write_bytes(path.read_bytes()[:-30])
    bad(path, capfd)


def wide(data: bytes, *edges: int, name: bytes = b"dataWindow") -> bytes:
    before, *parts = data.split(name + b"\0box2i\0" + struct.pack("<i", 16))
    assert parts
    return before + b"".join(name + b"\0box2i\0" + struct.pack("<5i", 16, *edges) + part[16:] for part in parts)


def subsampled(data: bytes) -> bytes:
    """OpenEXR's module cannot write this: two halves per row become a float for every second pixel."""
    before, after = (b"RY\0" + struct.pack("<4i", *fields) for fields in ((1, 0, 1, 1), (2, 0, 2, 1)))
    assert data.count(before) == 1
    return data.replace(before, after)


SIXTY = tuple(f"layer{k:02d}.R" for k in range(60))
LARGEST, TOO_LARGE = (0, 0, 16383, 16383), (0, 0, 65535, 65535)


@pytest.mark.parametrize(
    ("compression", "names", "change", "message"),
    [
        ("dwaa", "RGBAZ", lambda data: wide(data, 0, 0, 6881326, 32), "dataWindow: expected pixels that "),
        ("zip", SIXTY, lambda data: wide(data, *LARGEST), "dataWindow: expected pixels that "),
        ("zstd", ("Z", "N.X"), lambda data: wide(data, -(10**8), 5, 10**8, 5), "dataWindow: expected pixels that "),
        ("none", "R", lambda data: wide(data, *TOO_LARGE, name=b"displayWindow"), "displayWindow: expected 1 to"),
        ("none", ("RY", "Y"), subsampled, "RY: expected a value for every pixel"),
    ],
)
def test_changed_headers_are_refused_before_pixels_are_decoded(
    path, capfd, opened, compression, names, change, message
):
    exr.write(path, dict.fromkeys(names, noise((33, 2))), compression=compression, half="RY" in names)
    path.write_bytes(change(path.read_bytes()))
    opened.clear()
    assert f"a.exr: {message}" in bad(path, capfd)
    assert opened == [True]


@pytest.mark.sampled
@pytest.mark.parametrize("names", [("R", "G", "B"), ("A",), ("x.Y",), ("Z", "N.X"), ("id",)])
@pytest.mark.parametrize("compression", exr.COMPRESSIONS)
def test_the_densest_files_are_read(path, compression, names):
    """Zeros, of all types, with names for each of DWA's three schemes: the highest compression ratios of each codec, in
    files of other programs, which may compress any channel with loss."""
    method = getattr(OpenEXR, f"{'NO' if compression == 'none' else compression.upper()}_COMPRESSION")
    for real in (np.float32, np.float16):
        planes = {name: np.zeros((512, 1024), np.uint32 if name == "id" else real) for name in names}
        with OpenEXR.File({"compression": method, "type": OpenEXR.scanlineimage}, planes) as file:
            file.write(str(path))
        assert not any(plane.any() for plane in exr.read(path)[0].values())


def test_a_small_file_with_a_large_display_window(path, capfd, monkeypatch):
    exr.write(path, {"c": np.ones((2, 2), np.float32)}, window=(0, 0, 0, 0))
    path.write_bytes(wide(path.read_bytes(), *LARGEST, name=b"displayWindow"))
    plane = exr.read(path)[0]["c"]
    assert (plane.shape, plane[:2, :2].tolist()) == ((16384, 16384), [[1.0, 0.0], [0.0, 0.0]])
    monkeypatch.setattr(exr_limits, "MAX_SHOWN", 2**30 - 1)
    assert "channels: expected at most 1073741823 bytes in the display window, found 1073741824" in bad(path, capfd)
    monkeypatch.undo()
    monkeypatch.setattr(exr, "_displayed", mock.Mock(side_effect=MemoryError))
    assert "an image that fits into memory" in bad(path, capfd)


def test_images_that_do_not_fit_into_memory_are_refused_before_they_are_decoded(path, capfd, monkeypatch, opened):
    exr.write(path, dict.fromkeys("RGBAZ", noise((40, 50))))
    opened.clear()
    monkeypatch.setattr(exr_limits.host_memory, "available", lambda: 40 * 50 * 5 * 4.0)
    assert len(exr.read(path)[0]) == 5
    assert opened == [True, False]
    monkeypatch.setattr(exr_limits.host_memory, "available", lambda: 40 * 50 * 5 * 4.0 - 1)
    text = bad(path, capfd)
    assert "expected an image that fits into memory, of which 39999 bytes are free, found 40000" in text
    assert opened == [True, False, True]


@pytest.mark.parametrize(("name", "needed"), [("Y", 2 * 4), ("Z", 4 + 4 * 64 * 64)])
def test_what_lies_outside_of_the_data_window_takes_memory_only_where_it_is_not_0(
    path, capfd, monkeypatch, name, needed
):
    plane = np.array([[1, np.inf], [np.inf, np.inf]]) if name == "Z" else np.array([[1.0, 0.0], [0.0, 0.0]])
    exr.write(path, {name: plane}, window="covered")
    path.write_bytes(wide(path.read_bytes(), 0, 0, 63, 63, name=b"displayWindow"))
    monkeypatch.setattr(exr_limits.host_memory, "available", lambda: float(needed))
    assert exr.read(path)[0][name].shape == (64, 64)
    monkeypatch.setattr(exr_limits.host_memory, "available", lambda: needed - 1.0)
    assert f"found {needed}" in bad(path, capfd)
