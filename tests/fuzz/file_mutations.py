"""Damaged files: each must load as a valid scene or raise an InputError of one line that names the file, within limits
of time and memory."""

import contextlib
import re
import resource
import signal
import struct
import sys
import tempfile
import time
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mesh_writers import pack_glb
from random_kinds import Random
from seed_files import IMAGES, Sample, samples

from clshade.errors import InputError
from clshade.scene.formats.environment import load_environment
from clshade.scene.formats.load import load
from clshade.scene.formats.table import EXTENSIONS
from clshade.scene.model import Scene

SECONDS = 5.0  # of CPU time, for a file of a few KB
MEMORY = 1 << 30  # bytes that loading may add to the peak memory of the process
MESSAGE = 500  # characters of a refusal, besides the file's path
HANGS = 60  # seconds after which loading is aborted

NUMBERS = (
    b"""0 -1 1 255 65536 4294967295 2147483648 -2147483649 9223372036854775808 99999999999999999999999999 1e9 1e38
1e39 1e308 1e999 -1e308 1e-320 nan NaN inf -Infinity 0.1e 0x10 1_000 1.5 -0 'x' "a" null []""".split()
    + [b""]
)
WORDS = struct.pack("<3I3f4I", 0xFFFFFFFF, 0x7FFFFFFF, 0x80000000, np.inf, np.nan, 2.0, 0, 1, 0x80, 0x7F7FFFFF)
VALUES = (b"null", b"[]", b"{}", b'"mesh"', b"true", b"[[1]]", b"-1", b"1e400", b'"\\ud800"', b'{"index":0}')


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


def _length(rng: Random, data: bytes) -> bytes:
    if rng.random() < 0.5:
        return data[: rng.integers(0, len(data))]
    return data + bytes(rng.integers(0, 256, rng.integers(1, 20), np.uint8))


def _replaced(rng: Random, data: bytes, pattern: bytes, replacement: Callable[[re.Match[bytes]], bytes]) -> bytes:
    """Replace a match of the pattern by another text."""
    matches = list(re.finditer(pattern, data))
    if not matches:
        return _flip(rng, data)
    match = matches[rng.integers(len(matches))]
    return data[: match.start()] + replacement(match) + data[match.end() :]


def _number(rng: Random, data: bytes) -> bytes:
    return _replaced(rng, data, rb"-?\d+(\.\d*)?([eE][-+]?\d+)?", lambda _: NUMBERS[rng.integers(len(NUMBERS))])


def _json(rng: Random, data: bytes) -> bytes:
    """Replace a value of the JSON by one of another type, or a key by another."""
    pattern = rb'"\w+"|true|false|[\[{][^\[\]{}]*[\]}]'
    return _replaced(rng, data, pattern, lambda _: VALUES[rng.integers(len(VALUES))])


def _word(rng: Random, data: bytes) -> bytes:
    place, word = int(rng.integers(0, max(len(data) - 3, 1))), 4 * int(rng.integers(len(WORDS) // 4))
    return data[:place] + WORDS[word : word + 4] + data[place + 4 :]


def _lines(rng: Random, data: bytes) -> bytes:
    lines = data.split(b"\n")
    k, target = rng.integers(0, len(lines), 2)
    how = rng.integers(3)
    if how == 0:
        lines[k:k] = [lines[k]] * int(rng.choice((1, 10, 1000)))
    elif how == 1:
        del lines[k]
    else:
        lines[k], lines[target] = lines[target], lines[k]
    return b"\n".join(lines)


def _part(rng: Random, data: bytes) -> bytes:
    first, last = np.sort(rng.integers(0, len(data) + 1, 2))
    last = min(last, first + 200)
    return data[:last] + data[first:] if rng.random() < 0.5 else data[:first] + data[last:]


def _long_list(rng: Random, data: bytes) -> bytes:
    """Repeat what a list of the JSON holds, or a text, a thousand times."""

    def longer(match: re.Match[bytes]) -> bytes:
        listed, word = match.groups()
        return b"[%s]" % b",".join([listed] * 1000) if word is None else b'"%s"' % (word * 1000)

    return _replaced(rng, data, rb'\[([^\[\]{}]+)\]|"(\w+)"', longer)


def _png(rng: Random, data: bytes) -> bytes:
    parts, at = [data[:8]], 8
    while at + 12 <= len(data):
        size = struct.unpack(">I", data[at : at + 4])[0]
        kind, content = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        if content and rng.random() < 0.5:
            content = (_flip, _word, _length)[rng.integers(3)](rng, content)
        parts.append(struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content)))
        at += 12 + size
    return b"".join(parts)


def _glb(rng: Random, data: bytes) -> bytes:
    size = struct.unpack("<I", data[12:16])[0]
    how = (_number, _number, _text, _lines, _json)[rng.integers(5)]
    return pack_glb(how(rng, data[20 : 20 + size]), data[28 + size :])


def _window(rng: Random, data: bytes) -> bytes:
    """Change an edge of the data or display window of an EXR."""
    place = data.find((b"dataWindow", b"displayWindow")[rng.integers(2)] + b"\0box2i\0\x10\0\0\0")
    if place < 0:
        return _flip(rng, data)
    place = data.index(b"\x10\0\0\0", place) + 4 + 4 * int(rng.integers(4))
    edge = int(rng.choice((-(1 << 31), -1, 0, 6, 100, 16383, 1 << 20, (1 << 28) // 9, 1 << 30, (1 << 31) - 1)))
    return data[:place] + struct.pack("<i", edge) + data[place + 4 :]


_ANY = (_flip, _flip, _length, _length, _number, _number, _word, _part)
_TEXTS = (*_ANY, _number, _text, _text, _lines, _lines)
_JSON_TEXTS = (*_TEXTS, _json, _json, _json, _long_list)
_BY_EXTENSION: dict[str, tuple[Any, ...]] = {
    **dict.fromkeys((*EXTENSIONS, ".mtl", ".hdr"), _TEXTS),
    **dict.fromkeys((".gltf", ".json"), _JSON_TEXTS),
    ".glb": (*_ANY, *[_glb] * 5),
    ".exr": (*_ANY, _word, *[_window] * 3),
    ".npy": _ANY,
    ".png": (*_ANY, *[_png] * 4),
}


def mutated(number: int, seed: int = 0) -> Sample:
    """Return damaged sample `number`, with one of its files mutated one to three times; determined by number and seed."""
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


def file_failures(numbers: Iterable[int], seed: int = 0) -> list[str]:
    failures = []
    for number in numbers:
        sample = mutated(number, seed)
        with tempfile.TemporaryDirectory(prefix="clshade-") as folder:
            reason = load_problem(Path(folder), sample)
        if reason:
            again = f"python tests/fuzz/run.py --files {number}:{number + 1} --seed {seed}"
            failures.append(f"file {number} of seed {seed}: {next(iter(sample.files))}: {reason}; again: {again}")
    return failures


class _Hung(BaseException):
    pass


@contextlib.contextmanager
def _broken_off() -> Iterator[None]:
    """Raise _Hung in the block after HANGS seconds."""

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
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


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
    options = {**sample.options, **({"texture": folder / sample.texture} if sample.texture else {})}
    first, problem = folder / next(iter(sample.files)), ""
    start, before = time.process_time(), _peak()
    with warnings.catch_warnings(record=True) as caught, _broken_off():
        warnings.simplefilter("error")
        warnings.simplefilter("always", UserWarning)
        try:
            if first.suffix in IMAGES:
                load_environment(first)
            else:
                problem = flaw(load(first, **options))
        except InputError as error:
            text = str(error)
            if not text.isprintable() or not any(name in text for name in sample.files):
                problem = f"expected one line that names the file, found {text!r}"
            elif len(text) > MESSAGE + len(str(first)):
                problem = f"a message of {len(text)} characters"
        except _Hung:
            problem = f"took more than {HANGS} s"
        except Exception as error:  # any other exception is a finding
            problem = f"{type(error).__name__}: {' '.join(str(error).split())}"
    seconds, more = time.process_time() - start, _peak() - before
    if not problem and not all(str(warning.message).isprintable() for warning in caught):
        problem = "a warning of several lines"
    if not problem and seconds > SECONDS:
        problem = f"took {seconds:.1f} s"
    return problem or (f"took {more >> 20} MiB" if more > MEMORY else "")
