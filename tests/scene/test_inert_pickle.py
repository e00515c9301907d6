"""Pickles designed to take long: any course file is loaded or refused in time linear in its size."""

from __future__ import annotations

import gc
import pickle
import struct
import time
from collections.abc import Callable
from functools import partial
from itertools import count
from math import prod

import numpy as np
import pytest
from scene_files import course_dict, npy_of_pickle, pickled_array, refusal

from clshade.errors import InputError
from clshade.scene.formats.load import load
from clshade.scene.formats.safe_pickle import Refused, unpickle

SIZE = 1_000_000  # bytes of a worst case
SECONDS = 1.0  # of CPU time, for SIZE; more on a slow machine, see `slowness`
STEPS, NOMINAL = 1 << 19, 0.06  # of a loop, and its seconds on the machine for which SECONDS holds
EVERY_DAY = 10  # times smaller without -m long
DEPTH = 28  # levels that hold the one before twice: 2^28 steps take seconds, and end
FIRST = 300  # of the memo indices used here
PRIME = (1 << 61) - 1  # CPython's hash of its multiples is 0
KNOWN = pickle.dumps(np.array(course_dict(), dtype=object), protocol=3)  # 4 has frames: nothing can be inserted
END = KNOWN[KNOWN.rindex(b"uat") :]  # ends the dict, the list that holds it, the array's state, the array
FRESH = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\x00\x85C\x01btR"


def word(value: int) -> bytes:
    return struct.pack("<I", value)


def text(content: str) -> bytes:
    return b"X" + word(len(content.encode())) + content.encode()


def put(index: int) -> bytes:
    return b"r" + word(FIRST + index)


def get(index: int) -> bytes:
    return b"j" + word(FIRST + index)


def dtype(name: bytes, order: bytes = b"X\x01\x00\x00\x00<") -> bytes:
    state = b"(K\x03" + order + b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"
    return b"cnumpy\ndtype\n(" + name + b"K\x00K\x01tR" + state


F2, F8, I1 = (dtype(text(name)) for name in ("f2", "f8", "i1"))


def array(shape: bytes, kind: bytes, data: bytes) -> bytes:
    return FRESH + b"(K\x01" + shape + kind + b"\x89B" + word(len(data)) + data + b"tb"


def zeros(*shape: int) -> bytes:
    """Return an array of one byte per number."""
    return array(b"(" + b"".join(b"J" + word(extent) for extent in shape) + b"t", I1, bytes(prod(shape)))


def fields(**values: bytes) -> bytes:
    """Return the pickle of a course file with fields added or replaced."""
    return KNOWN.removesuffix(END) + b"".join(text(key) + value for key, value in values.items()) + END


def filled(size: int, part: bytes, before: bytes = b"", after: bytes = b"") -> bytes:
    return before + part * ((size - len(before) - len(after)) // len(part)) + after


def listed(size: int, part: bytes, before: bytes = b"") -> bytes:
    """Return a file with a list as the verts."""
    return fields(verts=filled(size, part, before + b"](", b"e"))


def pairs() -> bytes:
    """Return a nested tuple of 2^DEPTH leaves: each level holds the one before twice."""
    return b"K\x01" + put(0) + b"".join(get(k) + b"\x86" + put(k + 1) for k in range(DEPTH))


def lists() -> bytes:
    """Return the same with lists, all of them in a list; the largest is `get(DEPTH)`."""
    return b"](K\x01" + put(0) + b"".join(b"](" + get(k) * 2 + b"e" + put(k + 1) for k in range(DEPTH)) + b"e"


def keys(size: int, form: bytes) -> bytes:
    """Return integers whose hashes all collide, each in `form`."""
    numbers = ((k * PRIME).to_bytes(10, "little", signed=True) for k in count())
    return b"".join(form % (b"\x8a\x0a" + next(numbers)) for _ in range(size // (len(form) + 10)))


def many_arrays(size: int) -> bytes:
    """Return a list of different arrays of three numbers, with a shared dtype."""
    kept = get(0) + get(1) + b"R(K\x01" + get(2) + get(3) + b"\x89C\x03abctb"
    names = b"cnumpy.core.multiarray\n_reconstruct\n" + put(0) + b"(cnumpy\nndarray\nK\x00\x85C\x01bt" + put(1)
    return fields(
        unused=b"(" + names + b"K\x03\x85" + put(2) + I1 + put(3) + b"t",
        light_positions=filled(size, kept, b"](", b"e"),
    )


def many_lights(number: int) -> bytes:
    return fields(light_positions=zeros(number, 3) + put(0), light_intensities=get(0))


ONLY = (b"N", b"\x88", b"(", b")", b"]", b"}", b"\x80\x04", b"cnumpy\ndtype\n", b"\xff")
NUMBERS = (b"K\x01", b"M\x01\x02", b"J\x01\x02\x03\x04", b"\x8a\xff" + b"\xff" * 254 + b"\x7f", b"G" + bytes(8))
LISTED = (*NUMBERS, b"\x8c\x01a", b"\x8c\x01\xff", b"C\x01a")  # texts, one of them not UTF-8, and bytes
WORST: dict[str, Callable[[int], bytes]] = {
    # One opcode, repeated
    **{f"only {part!r}": partial(filled, part=part) for part in ONLY},
    "frames": lambda size: filled(size, b"\x95" + struct.pack("<Q", size // 2)),
    "memoized": lambda size: filled(size, b"\x94", b"N"),
    "memoized anywhere": lambda size: b"N" + b"".join(b"r" + word(k << 14) for k in range(size // 5)),
    "references by name": lambda size: filled(
        size, get(0) + get(1) + b"\x93", text("numpy") + put(0) + text("dtype") + put(1)
    ),
    "a reference without an end": lambda size: filled(size, b"a", b"c"),
    "a long reference": lambda size: filled(size, b"a", b"c", b"\nload\n"),
    # Values
    **{f"a list of {part[:12]!r}": partial(listed, part=part) for part in LISTED},
    "a text": lambda size: fields(verts=text("é" * (size // 2))),
    "appended one by one": lambda size: fields(verts=filled(size, b"K\x01a", b"]")),
    "appended to itself": lambda size: fields(verts=filled(size, get(0) + b"a", b"]" + put(0))),
    "nothing appended": lambda size: fields(verts=filled(size, b"(e", b"]")),
    "set one by one": lambda size: fields(verts=filled(size, b"\x8c\x01aNs", b"}")),
    "nothing set": lambda size: fields(verts=filled(size, b"(u", b"}")),
    "many keys": lambda size: fields(**{f"{k:06x}": b"N" for k in range(size // 12)}),
    "many arrays": many_arrays,
    "many lights": lambda size: many_lights(size // 3),
    "most lights": lambda size: many_lights(min(size // 3, 1 << 15)),
    "many vertices": lambda size: fields(
        verts=array(b"(K\x03J" + word(size // 9) + b"t", F2, bytes(size // 9 * 6)), vertex_colors=zeros(3, size // 9)
    ),
    "many faces": lambda size: fields(face_indices=zeros(3, size // 3) + put(0), face_uv_indices=get(0)),
    # Nested
    "tuples in tuples": lambda size: fields(verts=filled(size, b"\x85", b"N")),
    "pairs in pairs": lambda size: fields(verts=filled(size, b"K\x01\x86", b"N")),
    "triples in triples": lambda size: fields(verts=filled(size, b"NN\x87", b"N")),
    "lists in lists": lambda size: fields(verts=b"](" * (size // 3) + b"e" * (size // 3)),
    "lists in lists, one by one": lambda size: fields(verts=b"]" * (size // 2) + b"a" * (size // 2 - 1)),
    "dicts in dicts": lambda size: fields(verts=b"}\x8c\x01a" * (size // 5) + b"N" + b"s" * (size // 5)),
    "arrays in arrays": lambda size: fields(
        unused=FRESH[:-1] + put(0) + b"R",
        verts=(b"cnumpy.core.multiarray\n_reconstruct\n)R(NNNN" * (size // 46)) + b"N" + b"tb" * (size // 46),
    ),
    # Referenced many times
    "a tuple of 2^28 leaves": lambda size: fields(verts=pairs()),
    "a list of 2^28 leaves": lambda size: fields(unused=lists(), verts=get(DEPTH)),
    "a number of 2^28 leaves": lambda size: fields(focal=pairs()),
    "a key of 2^28 leaves": lambda size: fields(verts=b"}" + pairs() + b"Ns"),
    "one of the keys of 2^28 leaves": lambda size: fields(verts=b"}(" + text("a") + b"N" + pairs() + b"Nu"),
    "a shape of 2^28 leaves": lambda size: fields(verts=array(pairs(), F8, b"")),
    "a type of 2^28 leaves": lambda size: fields(verts=array(b"K\x01\x85", dtype(pairs()), bytes(8))),
    "a byte order of 2^28 leaves": lambda size: fields(verts=array(b"K\x01\x85", dtype(text("f8"), pairs()), bytes(8))),
    "arguments of 2^28 leaves": lambda size: fields(verts=b"cnumpy\ndtype\n" + pairs() + b"R"),
    "the whole of 2^28 leaves": lambda size: pairs() + b".",
    "a list many times": lambda size: fields(
        unused=b"](" + b"K\x01" * 1000 + b"e" + put(0),
        light_positions=filled(size, get(0), b"](", b"e") + put(1),
        light_intensities=get(1),
    ),
    "a list in all fields": lambda size: fields(
        unused=b"](" + b"K\x01" * 1000 + b"e" + put(0), **{key: b"](" + get(0) * 250 + b"e" for key in course_dict()}
    ),
    "an array many times": lambda size: fields(
        unused=zeros(3) + put(0), light_positions=filled(size, get(0), b"](", b"e") + put(1), light_intensities=get(1)
    ),
    "a large array many times": lambda size: fields(
        unused=zeros(size // 2) + put(0), light_positions=filled(size // 2, get(0), b"](", b"e")
    ),
    "long arguments many times": lambda size: filled(
        size, b"cnumpy\ndtype\n" + get(0) + b"R", b"(" + b"N" * (size // 2) + b"t" + put(0)
    ),
    "a long state many times": lambda size: filled(size, get(0) + b"b", b"(" + b"N" * (size // 2) + b"t" + put(0) + F8),
    "a state many times": lambda size: filled(size, get(0) + b"b", b"(K\x03" + b"N" * 7 + b"t" + put(0) + F8),
    # Hashed
    "colliding keys": lambda size: fields(verts=b"}(" + keys(size, b"%bN") + b"u"),
    "colliding keys, one by one": lambda size: fields(verts=b"}" + keys(size, b"%bNs")),
    "a long key": lambda size: fields(**{"a" * size: b"N"}),
}


def slowness() -> float:
    """Return the time of a loop like the interpreter's relative to NOMINAL, at least 1: a core whose other hardware
    thread is busy does half as much in the same time."""
    start, stack, memo = time.process_time(), [], {}
    for step in range(STEPS):
        stack.append(step)
        memo[step & 1023] = stack.pop()
    return max((time.process_time() - start) / NOMINAL, 1.0)


def seconds(path: str) -> float:
    """Return the CPU time of loading, divided by `slowness`; the best of three if it is too long."""
    best = float("inf")
    for _ in range(3):
        slow = slowness()
        start = time.process_time()
        try:
            load(path)
        except InputError as error:
            assert str(error).isprintable()
            assert len(str(error)) < 400
        best = min(best, (time.process_time() - start) / max(slow, slowness()))
        if best < SECONDS:
            break
    return best


@pytest.mark.sampled
@pytest.mark.parametrize("name", WORST)
def test_bad_cases_take_no_time(tmp_path, name):
    """A hundred kilobytes within the time of a megabyte: some costs are independent of the size."""
    assert seconds(npy_of_pickle(tmp_path / "a.npy", WORST[name](SIZE // EVERY_DAY))) < SECONDS


@pytest.mark.parametrize("enabled", [True, False])
def test_the_garbage_collector_is_as_before(tmp_path, enabled):
    paths = [npy_of_pickle(tmp_path / f"{k}.npy", pickled) for k, pickled in enumerate([KNOWN, b"N."])]
    before = gc.isenabled()
    try:
        (gc.enable if enabled else gc.disable)()
        load(paths[0])
        assert gc.isenabled() == enabled
        with pytest.raises(InputError):
            load(paths[1])
        assert gc.isenabled() == enabled
    finally:
        (gc.enable if before else gc.disable)()


@pytest.mark.long
@pytest.mark.parametrize("name", WORST)
def test_worst_cases_take_less_than_a_second(tmp_path, name):
    pickled = WORST[name](SIZE)
    assert len(pickled) < SIZE * 1.1
    assert seconds(npy_of_pickle(tmp_path / "a.npy", pickled)) < SECONDS


@pytest.mark.parametrize("key", [b"K\x01", b"N", b"C\x01a", b"K\x01\x85", b"\x88", text("k" * 65)])
def test_keys_are_short_text(tmp_path, key):
    pickled = fields(unused=b"}" + key + b"Ns")
    refusal(npy_of_pickle(tmp_path / "bad.npy", pickled), "bad.npy: pickle: ", "a key other than text of at most 64")
    assert load(npy_of_pickle(tmp_path / "a.npy", fields(unused=b"}" + text("k" * 64) + b"Ns"))).face_count == 2


def test_shared_values_are_loaded(tmp_path):
    """As numpy.save writes values that a dict references more than once."""
    white, where = [1.0, 0.5, 0.25], [0.0, 1.0, 2.0]
    content = course_dict(light_positions=[where] * 500, light_intensities=[white] * 500, Ia=white, bg_color=white)
    scene = load(npy_of_pickle(tmp_path / "a.npy", pickled_array(content)))
    assert len(scene.lights) == 500
    assert scene.lights[499].intensity.tolist() == scene.ambient.tolist() == white


def test_limits_are_what_they_say():
    """Each limit at its last valid and first invalid value."""
    limit = 1 << 20  # opcodes
    assert unpickle(b"N" * (limit - 1) + b".") is None
    with pytest.raises(Refused, match="more than 1048576 opcodes"):
        unpickle(b"N" * limit + b".")
    called = b"cnumpy\ndtype\n(" + text("f8")
    assert unpickle(called + b"N" * 7 + b"tR.").name == "f8"
    with pytest.raises(Refused, match="a call of something other"):
        unpickle(called + b"N" * 8 + b"tR.")


@pytest.mark.parametrize(("times", "long"), [(200, False), (300, True)])
def test_what_a_file_names_again_may_be_a_quarter_of_a_million_numbers(tmp_path, times, long):
    repeated = b"](" + b"K\x01" * 1000 + b"e" + put(0)
    pickled = fields(unused=repeated, light_positions=b"](" + get(0) * times + b"e", light_intensities=b"]")
    message = refusal(npy_of_pickle(tmp_path / "a.npy", pickled), "light_positions")
    assert ("a list that is too long" in message) == long
