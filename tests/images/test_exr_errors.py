"""EXR errors: a full disk leaves the earlier file intact, bad files raise an InputError of one line."""

from __future__ import annotations

import io
import os
import re
import struct
import time
from functools import partial

import numpy as np
import pytest
from processes import PEAK, python

from clshade.errors import InputError, OutputError
from clshade.images import exr, exr_limits, png


def noise(shape):
    return np.random.default_rng(8).random(shape, np.float32)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.exr"


class Failing(io.BytesIO):
    """A stream that fails after `limit` bytes."""

    limit, error = 0, None

    def write(self, data):
        if self.tell() + len(data) > self.limit:
            raise self.error
        return super().write(data)


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_disk_that_is_full_after_any_number_of_bytes(error):
    """The last bytes matter most: OpenEXR seeks back and writes its table of offsets at the very end."""
    import OpenEXR

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
        ("a.exr", partial(exr.write, compression="zip"), 100_000),
        ("a.png", lambda path, values: png.write(path, (values * 255).astype(np.uint8)), 50_000),
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


def test_ctrl_c_leaves_the_earlier_file(path, monkeypatch):
    exr.write(path, noise((4, 4, 3)))
    before, calls = path.read_bytes(), []

    def interrupted(self, data):
        calls.append(len(data))
        if len(calls) == 60:
            raise KeyboardInterrupt
        return self.file.write(data)

    monkeypatch.setattr(exr._Sink, "write", interrupted, raising=False)
    with pytest.raises(KeyboardInterrupt):
        exr.write(path, noise((100, 100, 4)))
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == ["a.exr"]


def test_a_missing_folder(tmp_path):
    with pytest.raises(OutputError, match="there is no folder"):
        exr.write(tmp_path / "none" / "a.exr", noise((2, 2, 3)))


def bad(path, capfd) -> str:
    with pytest.raises(InputError) as caught:
        exr.read(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    assert capfd.readouterr() == ("", "")
    return text


def test_files_that_are_no_exr(tmp_path, capfd):
    assert "no such file" in bad(tmp_path / "missing.exr", capfd)
    assert "folder" in bad(tmp_path, capfd)
    for content, message in ((b"", "empty"), (b"text", "something else"), (b"\x76\x2f\x31\x01", "expected an OpenEXR")):
        (tmp_path / "a.exr").write_bytes(content)
        assert message in bad(tmp_path / "a.exr", capfd)
    os.mkfifo(tmp_path / "pipe.exr")
    assert "regular file" in bad(tmp_path / "pipe.exr", capfd)


@pytest.mark.sampled
@pytest.mark.parametrize("compression", exr.COMPRESSIONS)
def test_truncated_files(path, capfd, compression):
    exr.write(path, noise((40, 9, 3)), compression=compression)
    data = path.read_bytes()
    for size in [*range(0, len(data), 61), len(data) - 1]:
        path.write_bytes(data[:size])
        bad(path, capfd)


@pytest.mark.parametrize("compression", ["zip", "zstd", "pxr24"])
def test_damaged_files(path, capfd, compression):
    exr.write(path, np.repeat(noise((40, 3, 3)), 4, axis=1), compression=compression)
    data = bytearray(path.read_bytes())
    for k in range(20):
        data[len(data) // 2 + k] ^= 0x5A
    path.write_bytes(data)
    assert "truncated or damaged" in bad(path, capfd)


def test_images_of_other_kinds(path, capfd):
    import OpenEXR

    samples = np.empty((2, 2), object)
    for k in range(4):
        samples[k // 2, k % 2] = np.zeros(k + 1, np.float32)
    deep = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    OpenEXR.File(deep, {"Z": samples}).write(str(path))
    assert "a flat image" in bad(path, capfd)

    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 3
    OpenEXR.File({"type": OpenEXR.tiledimage, "tiles": tiles}, {"Y": noise((7, 5)).copy()}).write(str(path))
    assert np.array_equal(exr.read(path)[0]["Y"], noise((7, 5)))


def window(*edges):
    return np.array(edges[:2], np.int32), np.array(edges[2:], np.int32)


def test_several_parts(path, capfd):
    """Each in its own window; a name already taken is prefixed with the part's."""
    import OpenEXR

    first, second = noise((5, 7)).copy(), np.arange(4, dtype=np.float16).reshape(2, 2)
    common = {"type": OpenEXR.scanlineimage, "displayWindow": window(0, 0, 6, 4)}
    header = {**common, "dataWindow": window(3, 1, 4, 2)}
    parts = [
        OpenEXR.Part({**common, "dataWindow": window(0, 0, 6, 4)}, {"R": first.copy(), "Z": first.copy()}, "beauty"),
        OpenEXR.Part(header, {"Z": second.copy(), "id": second.astype(np.uint32)}, "other"),
    ]
    OpenEXR.File(parts).write(str(path))
    channels, header = exr.read(path)
    assert sorted(channels) == ["R", "Z", "id", "other.Z"]
    assert header["name"] == "beauty"
    assert np.array_equal(channels["Z"], first)
    inside = np.zeros((5, 7))
    inside[1:3, 3:5] = second
    assert np.array_equal(channels["other.Z"], inside)
    assert (channels["other.Z"].dtype, channels["id"].dtype) == (np.float16, np.uint32)
    path.write_bytes(path.read_bytes()[:-30])
    bad(path, capfd)


def test_a_subsampled_channel(path, capfd):
    """OpenEXR's module cannot write one; a patched header turns two halves per row into a float for every second
    pixel."""
    exr.write(path, {"Y": np.ones((3, 2)), "RY": np.ones((3, 2))}, compression="none", half=True)
    data = path.read_bytes()
    before, after = (b"RY\0" + struct.pack("<4i", *fields) for fields in ((1, 0, 1, 1), (2, 0, 2, 1)))
    assert data.count(before) == 1
    path.write_bytes(data.replace(before, after))
    assert "RY: expected a value for every pixel" in bad(path, capfd)


def test_a_header_that_claims_too_many_pixels(path, capfd):
    exr.write(path, noise((1, 1, 3)), compression="none")
    path.write_bytes(wide(path.read_bytes(), 0, 0, 65535, 65535, name=b"displayWindow"))
    assert "displayWindow: expected 1 to 268435456 pixels" in bad(path, capfd)


def test_a_small_file_with_a_large_display_window(path, capfd, monkeypatch):
    """Refused before memory is allocated, or if there is too little; channels that are 0 outside the data window need
    none."""
    exr.write(path, {"c": np.ones((2, 2), np.float32)}, window=(0, 0, 0, 0))
    path.write_bytes(wide(path.read_bytes(), 0, 0, 16383, 16383, name=b"displayWindow"))
    channels, _ = exr.read(path)
    assert channels["c"].shape == (16384, 16384)
    assert channels["c"][:2, :2].tolist() == [[1.0, 0.0], [0.0, 0.0]]
    monkeypatch.setattr(exr_limits, "MAX_SHOWN", 2**30 - 1)
    assert "channels: expected at most 1073741823 bytes in the display window, found 1073741824" in bad(path, capfd)
    monkeypatch.undo()

    def none_left(*_):
        raise MemoryError

    monkeypatch.setattr(exr, "_displayed", none_left)
    assert "an image that fits into memory" in bad(path, capfd)


def wide(data: bytes, *edges: int, name: bytes = b"dataWindow") -> bytes:
    """Return the file with another window in every header."""
    before, *parts = data.split(name + b"\0box2i\0" + struct.pack("<i", 16))
    assert parts
    return before + b"".join(name + b"\0box2i\0" + struct.pack("<5i", 16, *edges) + part[16:] for part in parts)


HEADERS = {
    "a wide data window": ("dwaa", ("R", "G", "B", "A", "Z", "id"), (0, 0, 6881326, 32)),
    "sixty channels": ("zip", tuple(f"layer{k:02d}.R" for k in range(60)), (0, 0, 16383, 16383)),
    "many rows": ("zips", ("R", "G", "B"), (0, 0, 16383, 16383)),
    "pxr24": ("pxr24", ("R",), (0, 0, 16383, 16383)),
    "zstd": ("zstd", ("Z", "id"), (-100_000_000, 5, 100_000_000, 5)),
}


@pytest.mark.parametrize("name", HEADERS)
def test_headers_that_claim_more_than_a_file_can_hold(path, capfd, name):
    compression, names, window = HEADERS[name]
    exr.write(path, {channel: noise((33, 47)) for channel in names}, compression=compression)
    path.write_bytes(wide(path.read_bytes(), *window))
    start = time.process_time()
    assert f"a.exr: dataWindow: expected pixels that {path.stat().st_size} bytes can hold" in bad(path, capfd)
    assert time.process_time() - start < 0.5


def test_commands_refuse_such_headers_in_little_memory(path):
    compression, names, window = HEADERS["a wide data window"]
    exr.write(path, {channel: noise((33, 47)) for channel in names}, compression=compression)
    path.write_bytes(wide(path.read_bytes(), *window))
    code = f"""{PEAK}
from clshade.cli.main import main
for arguments in (["inspect", {str(path)!r}], ["compare", {str(path)!r}, {str(path)!r}]):
    assert main(arguments) == 2
print(peak())
"""
    done = python(code, "")
    assert done.returncode == 0, done.stderr
    first, second = done.stderr.splitlines()
    assert first == second
    assert "a.exr: dataWindow: expected pixels that " in first
    assert float(done.stdout) < 300.0


@pytest.mark.sampled
@pytest.mark.parametrize("names", [("R", "G", "B"), ("A",), ("x.Y",), ("Z", "N.X"), ("id",)])
@pytest.mark.parametrize("compression", exr.COMPRESSIONS)
def test_the_densest_files_are_read(path, compression, names):
    """Zeros, of all types, with names for each of DWA's three schemes: the highest compression ratios of each codec, in
    files of other programs, which may compress any channel with loss."""
    import OpenEXR

    method = getattr(OpenEXR, f"{'NO' if compression == 'none' else compression.upper()}_COMPRESSION")
    for real in (np.float32, np.float16):
        planes = {name: np.zeros((512, 1024), np.uint32 if name == "id" else real) for name in names}
        with OpenEXR.File({"compression": method, "type": OpenEXR.scanlineimage}, planes) as file:
            file.write(str(path))
        assert not any(plane.any() for plane in exr.read(path)[0].values())


def test_images_that_do_not_fit_into_memory_are_refused_before_they_are_decoded(path, capfd, monkeypatch):
    import OpenEXR

    exr.write(path, {name: noise((40, 50)) for name in "RGBA"} | {"half": noise((40, 50))})
    opened = []
    genuine = OpenEXR.File

    def noted(*arguments, **options):
        opened.append(options.get("header_only", False))
        return genuine(*arguments, **options)

    monkeypatch.setattr(OpenEXR, "File", noted)
    monkeypatch.setattr(exr_limits.host_memory, "available", lambda: 40 * 50 * 5 * 4.0)
    assert len(exr.read(path)[0]) == 5
    assert opened == [True, False]
    monkeypatch.setattr(exr_limits.host_memory, "available", lambda: 40 * 50 * 5 * 4.0 - 1)
    text = bad(path, capfd)
    assert "expected an image that fits into memory, of which 39999 bytes are free, found 40000" in text
    assert opened == [True, False, True]


def test_what_lies_outside_of_the_data_window_takes_memory_only_where_it_is_not_0(path, capfd, monkeypatch):
    for name, needed in (("Y", 2 * 4), ("Z", 4 + 4 * 64 * 64)):
        exr.write(path, {name: np.ones((2, 2), np.float32)}, window=(0, 0, 0, 0))
        if name == "Z":
            exr.write(path, {name: np.array([[1, np.inf], [np.inf, np.inf]])}, window="covered")
        path.write_bytes(wide(path.read_bytes(), 0, 0, 63, 63, name=b"displayWindow"))
        monkeypatch.setattr(exr_limits.host_memory, "available", lambda needed=needed: float(needed))
        assert exr.read(path)[0][name].shape == (64, 64)
        monkeypatch.setattr(exr_limits.host_memory, "available", lambda needed=needed: needed - 1.0)
        assert f"found {needed}" in bad(path, capfd)


def test_what_an_image_takes_is_known_from_its_header(path):
    """Types and names of the channels of all parts."""
    import OpenEXR

    half, ids = np.zeros((3, 4), np.float16), np.zeros((3, 4), np.uint32)
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage}, {"Z": half.astype(np.float32), "a.half": half.copy()}, "one"),
        OpenEXR.Part({"type": OpenEXR.scanlineimage}, {"id": ids.copy(), "x" * 200: half.copy()}, "two"),
    ]
    OpenEXR.File(parts).write(str(path))
    assert exr_limits.channel_bytes(path.read_bytes(), 2) == [{"Z": 4, "a.half": 2}, {"id": 4, "x" * 200: 2}]
    channels, header = exr.read(path)
    assert {name: plane.itemsize for name, plane in channels.items()} == {"Z": 4, "a.half": 2, "id": 4, "x" * 200: 2}
    assert "channels" not in header
