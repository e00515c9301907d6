"""Damaged files: each must load as a valid scene or raise an InputError of one line that names the file, within limits
of time and memory."""

from __future__ import annotations

import contextlib
import re
import signal
import struct
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...scene.formats.environment import load_environment
from ...scene.formats.load import load
from ...scene.formats.table import EXTENSIONS
from ...scene.model import Scene
from .seed_files import IMAGES, Sample, pack_glb, png_chunk, samples

SECONDS = 5.0  # of CPU time, for a file of a few KB
MEMORY = 1 << 30  # bytes that loading may add to the peak memory of the process
MESSAGE = 500  # characters of a refusal, besides the file's path
HANGS = 60  # seconds after which loading is aborted
Random = np.random.Generator

_NUMBER = re.compile(rb"-?\d+(\.\d*)?([eE][-+]?\d+)?")
_NUMBERS: tuple[bytes, ...] = (
    b"0",
    b"-1",
    b"1",
    b"255",
    b"65536",
    b"4294967295",
    b"2147483648",
    b"-2147483649",
    b"9223372036854775808",
)
_NUMBERS += (b"1e9", b"1e38", b"1e39", b"1e308", b"1e999", b"-1e308", b"1e-320", b"nan", b"NaN", b"inf", b"-Infinity")
_NUMBERS += (
    b"99999999999999999999999999",
    b"0.1e",
    b"0x10",
    b"1_000",
    b"",
    b"1.5",
    b"-0",
    b"'x'",
    b'"a"',
    b"null",
    b"[]",
)
_WORDS: tuple[bytes, ...] = (
    b"0000",
    b"\xff\xff\xff\xff",
    b"\x7f\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\x00\x00\x80\x7f",
    b"\x00\x00\xc0\x7f",
)
_WORDS += (b"\x00\x00\x00\x80", b"\x01\x00\x00\x00", b"\x00\x00\x00\x40", b"\xff\xff\x7f\x7f", b"\x80\x00\x00\x00")


# Mutations of bytes; each takes a generator and the bytes, and returns other bytes


def _flip(rng: Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for place in rng.integers(0, len(data), rng.integers(1, 6)):
        changed[place] = rng.integers(0, 256) if rng.random() < 0.5 else changed[place] ^ 1 << int(rng.integers(8))
    return bytes(changed)


def _text(rng: Random, data: bytes) -> bytes:
    """Replace bytes by characters with a meaning in text formats."""
    changed = bytearray(data)
    for place in rng.integers(0, len(data), rng.integers(1, 4)):
        changed[place] = int(rng.choice(list(b'0159-+.eE/ \t\n\\,:[]{}"#')))
    return bytes(changed)


def _truncate(rng: Random, data: bytes) -> bytes:
    return data[: rng.integers(0, len(data))]


def _lengthen(rng: Random, data: bytes) -> bytes:
    return data + bytes(rng.integers(0, 256, rng.integers(1, 20), np.uint8))


def _number(rng: Random, data: bytes) -> bytes:
    """Replace a number in the text."""
    found = list(_NUMBER.finditer(data))
    if not found:
        return _flip(rng, data)
    for match in sorted((found[k] for k in {*rng.integers(0, len(found), rng.integers(1, 3)).tolist()}), key=_start)[
        ::-1
    ]:
        other = _NUMBERS[rng.integers(len(_NUMBERS))]
        data = data[: match.start()] + other + data[match.end() :]
    return data


def _start(match: re.Match[bytes]) -> int:
    return match.start()


def _word(rng: Random, data: bytes) -> bytes:
    """Replace four bytes by an extreme number."""
    place = int(rng.integers(0, max(len(data) - 3, 1)))
    return data[:place] + _WORDS[rng.integers(len(_WORDS))] + data[place + 4 :]


def _lines(rng: Random, data: bytes) -> bytes:
    """Duplicate, repeat, delete or move a line."""
    lines = data.split(b"\n")
    k, other = rng.integers(0, len(lines), 2)
    how = rng.integers(4)
    if how == 0:
        lines.insert(other, lines[k])
    elif how == 1:
        lines[k:k] = [lines[k]] * int(rng.choice((10, 1000)))
    elif how == 2:
        del lines[k]
    else:
        lines[k], lines[other] = lines[other], lines[k]
    return b"\n".join(lines)


def _part(rng: Random, data: bytes) -> bytes:
    """Delete or duplicate a part."""
    first, last = np.sort(rng.integers(0, len(data) + 1, 2))
    last = min(last, first + 200)
    return data[:last] + data[first:] if rng.random() < 0.5 else data[:first] + data[last:]


def _png(rng: Random, data: bytes) -> bytes:
    """Change a chunk of a PNG, with a correct checksum."""
    parts, at = [data[:8]], 8
    while at + 12 <= len(data):
        size = struct.unpack(">I", data[at : at + 4])[0]
        kind, content = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        if content and rng.random() < 0.5:
            content = (_flip, _word, _truncate)[rng.integers(3)](rng, content)
        parts.append(png_chunk(kind, content))
        at += 12 + size
    return b"".join(parts)


def _glb(rng: Random, data: bytes) -> bytes:
    """Change the JSON of a GLB, with correct lengths."""
    size = struct.unpack("<I", data[12:16])[0]
    how = (_number, _number, _text, _lines, _json)[rng.integers(5)]
    return pack_glb(how(rng, data[20 : 20 + size]), data[28 + size :])


def _json(rng: Random, data: bytes) -> bytes:
    """Replace a value of the JSON by one of another type, or a key by another."""
    found = list(re.finditer(rb'"\w+"|true|false|[\[{][^\[\]{}]*[\]}]', data))
    if not found:
        return _flip(rng, data)
    match = found[rng.integers(len(found))]
    others = (b"null", b"[]", b"{}", b'"mesh"', b"true", b"[[1]]", b"-1", b"1e400", b'"\\ud800"', b'{"index":0}')
    return data[: match.start()] + others[rng.integers(len(others))] + data[match.end() :]


def _long_list(rng: Random, data: bytes) -> bytes:
    """Repeat what a list of the JSON holds, or a text, a thousand times."""
    found = list(re.finditer(rb'\[([^\[\]{}]+)\]|"(\w+)"', data))
    if not found:
        return _flip(rng, data)
    match = found[rng.integers(len(found))]
    listed, word = match.groups()
    longer = b"[%s]" % b",".join([listed] * 1000) if word is None else b'"%s"' % (word * 1000)
    return data[: match.start()] + longer + data[match.end() :]


# Pickles designed to take long; each takes a generator and returns the opcodes of one value.
_FIRST = 10_000  # first of the memo indices that they use


def _shared(rng: Random) -> bytes:
    """Return a nested tuple of up to 2^30 leaves: each level holds the one before twice."""
    steps = (struct.pack("<cIccI", b"j", _FIRST + k, b"\x86", b"r", _FIRST + k + 1) for k in range(rng.integers(2, 31)))
    return struct.pack("<2scI", b"K\x01", b"r", _FIRST) + b"".join(steps)


def _many(rng: Random) -> bytes:
    """Repeat an opcode or value many times, nested or in a list."""
    count = int(rng.choice((3, 1000, 30_000)))
    nested = (b"\x85", b"K\x01\x86", b"\x94", b"h\x01\x86")
    listed = (b"K\x01", b"N", b"]", b"}", b")", b"\x8c\x01a", b"\x8a\xff" + b"\x7f" * 255, b"C\x01a", b"h\x05", b"(t")
    if rng.random() < 0.4:
        return b"K\x01" + nested[rng.integers(len(nested))] * count
    return b"](" + listed[rng.integers(len(listed))] * count + b"e"


def _repeated(rng: Random) -> bytes:
    """Return a list of many references to one list of a thousand numbers, or to one array of three."""
    array = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\x00\x85C\x01btR(K\x01K\x03\x85"
    array += (
        b"cnumpy\ndtype\n(X\x02\x00\x00\x00i1K\x00K\x01tR(K\x03X\x01\x00\x00\x00|NNNK\x01K\x01K\x00tb\x89C\x03abctb"
    )
    part = array if rng.random() < 0.5 else b"](" + b"K\x01" * 1000 + b"e"
    kept = struct.pack("<cI", b"r", _FIRST)
    return b"](" + part + kept + struct.pack("<cI", b"j", _FIRST) * int(rng.choice((10, 1000, 50_000))) + b"e"


def _keyed(rng: Random) -> bytes:
    """Return a dict whose keys are not strings: a shared tuple, or integers whose hashes all collide in CPython."""
    if rng.random() < 0.5:
        return b"}" + _shared(rng) + b"Ns"
    numbers = (k * ((1 << 61) - 1) for k in range(int(rng.choice((3, 300, 30_000)))))
    return b"}(" + b"".join(b"\x8a\x0a" + each.to_bytes(10, "little") + b"N" for each in numbers) + b"u"


def _pickle(rng: Random, data: bytes) -> bytes:
    """Add or replace a field of a course file by one that takes a careless loader long."""
    end = data.rfind(b"uat")  # ends the dict, the list that holds it, and the array's state
    if end < 0:
        return _flip(rng, data)
    name = rng.choice((b"unused", b"verts", b"focal", b"light_positions", b"bg_color"))
    made = (_shared, _many, _repeated, _keyed)[rng.integers(4)](rng)
    changed: bytes = data[:end] + b"\x8c" + bytes([len(name)]) + name + made + data[end:]
    return changed


def _window(rng: Random, data: bytes) -> bytes:
    """Change an edge of the data or display window of an EXR."""
    head = (b"dataWindow", b"displayWindow")[rng.integers(2)] + b"\0box2i\0\x10\0\0\0"
    place = data.find(head)
    if place < 0:
        return _flip(rng, data)
    place += len(head) + 4 * int(rng.integers(4))
    edge = int(rng.choice((-(1 << 31), -1, 0, 6, 100, 16383, 1 << 20, (1 << 28) // 9, 1 << 30, (1 << 31) - 1)))
    return data[:place] + struct.pack("<i", edge) + data[place + 4 :]


_ANY = (_flip, _flip, _truncate, _lengthen, _number, _number, _word, _part)
_TEXTS = (*_ANY, _number, _text, _text, _lines, _lines)
_BY_EXTENSION: dict[str, tuple[Any, ...]] = {
    **dict.fromkeys(EXTENSIONS, _TEXTS),
    ".mtl": _TEXTS,
    ".gltf": (*_TEXTS, _json, _json, _json, _long_list),
    ".json": (*_TEXTS, _json, _json, _json, _long_list),
    ".glb": (*_ANY, _glb, _glb, _glb, _glb, _glb),
    ".exr": (*_ANY, _word, _window, _window, _window),
    ".hdr": _TEXTS,
    ".npy": (*_ANY, _pickle, _pickle, _pickle),
    ".png": (*_ANY, _png, _png, _png, _png),
}


def mutated(number: int, seed: int = 0) -> Sample:
    """Return damaged sample `number`, with one of its files mutated one to three times; determined by number and
    seed."""
    rng = np.random.default_rng([seed, number, 2])
    every = samples()
    sample = every[number % len(every)]
    names = list(sample.files)
    name = names[0] if rng.random() < 0.6 else names[rng.integers(len(names))]
    data = sample.files[name]
    ways = _BY_EXTENSION.get(Path(name).suffix, _ANY)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        with contextlib.suppress(struct.error):  # already too damaged to be parsed
            data = ways[rng.integers(len(ways))](rng, data) if data else b"\0"
    return Sample({**sample.files, name: data}, sample.texture, sample.options)


# Judging


class _Hung(BaseException):
    pass


@contextlib.contextmanager
def _broken_off() -> Iterator[None]:
    """Raise _Hung in the block after HANGS seconds, where signals allow it."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def handler(*_: Any) -> None:
        raise _Hung

    before = signal.signal(signal.SIGALRM, handler)
    signal.setitimer(signal.ITIMER_REAL, HANGS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _peak() -> int:
    """Return the peak memory of the process in bytes; 0 if unknown."""
    try:
        import resource
    except ImportError:
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def flaw(scene: Any) -> str:
    """Return why the result of `load` is not a valid scene; "" if it is."""
    if not isinstance(scene, Scene):
        return f"expected a Scene, found {type(scene).__name__}"
    for mesh in scene.meshes:
        for name in ("verts", "colors", "normals", "instances"):
            values = getattr(mesh, name)
            if values is not None and not np.isfinite(values).all():
                return f"{name} are not finite"
        for name, rows in (("faces", mesh.verts), ("normal_faces", mesh.normals), ("uv_faces", mesh.uvs)):
            index = getattr(mesh, name)
            if index is not None and index.size and not 0 <= index.min() <= index.max() < len(np.asarray(rows)):
                return f"{name} are out of range"
    return ""


def load_problem(folder: Path, sample: Sample) -> str:
    """Write the files of a sample to `folder`, load them with `load` or `load_environment`, and return what went wrong; ""
    if nothing."""
    for name, data in sample.files.items():
        (folder / name).write_bytes(data)
    options: dict[str, Any] = dict(sample.options)
    if sample.texture:
        options["texture"] = folder / sample.texture
    start, before, found = time.process_time(), _peak(), ""
    with warnings.catch_warnings(record=True) as told, _broken_off():
        warnings.simplefilter("error")
        warnings.simplefilter("always", UserWarning)
        try:
            first = folder / next(iter(sample.files))
            if first.suffix in IMAGES:
                load_environment(first)
            else:
                found = flaw(load(first, **options))
        except InputError as error:
            text = str(error)
            if not text.isprintable() or not any(name in text for name in sample.files):
                found = f"expected one line that names the file, found {text!r}"
            elif len(text) > MESSAGE + len(str(first)):
                found = f"a message of {len(text)} characters"
        except _Hung:
            found = f"took more than {HANGS} s"
        except Exception as error:  # any other exception is a finding
            found = f"{type(error).__name__}: {' '.join(str(error).split())}"
    seconds, more = time.process_time() - start, _peak() - before
    if not found and not all(str(warning.message).isprintable() for warning in told):
        found = "a warning of several lines"
    if not found and seconds > SECONDS:
        found = f"took {seconds:.1f} s"
    return found or (f"took {more >> 20} MiB" if more > MEMORY else "")


def problem(number: int, seed: int = 0) -> str:
    """Return what went wrong in loading damaged file `number`; "" if nothing."""
    sample = mutated(number, seed)
    with tempfile.TemporaryDirectory(prefix="clshade-") as folder:
        found = load_problem(Path(folder), sample)
    return found and f"{next(iter(sample.files))}: {found}"
