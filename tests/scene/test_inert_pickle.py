"""Pickles designed to take long: any course file is loaded or refused in time linear in its size."""

from __future__ import annotations

import gc
import pickle
import struct
import time
from math import prod

import numpy as np
import pytest
from scene_files import course_dict, npy_of_pickle, refusal

from clshade.errors import InputError
from clshade.scene.formats.load import load
from clshade.scene.formats.safe_pickle import MAX_OPCODES, Refused, _Steps, unpickle

SIZE = 300_000  # bytes of a worst case
SECONDS = 4.0  # of CPU time: most take a tenth, and what is not linear in the size takes ten or more
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


def pairs() -> bytes:
    """Return a nested tuple of 2^DEPTH leaves: each level holds the one before twice."""
    return b"K\x01" + put(0) + b"".join(get(k) + b"\x86" + put(k + 1) for k in range(DEPTH))


def lists() -> bytes:
    """Return the same with lists, all of them in a list; the largest is `get(DEPTH)`."""
    return b"](K\x01" + put(0) + b"".join(b"](" + get(k) * 2 + b"e" + put(k + 1) for k in range(DEPTH)) + b"e"


def repeated(part: bytes, before: bytes = b"", after: bytes = b"") -> bytes:
    return before + part * ((SIZE - len(before) - len(after)) // len(part)) + after


LONG = b"\x8a\xff" + b"\xff" * 254 + b"\x7f"
COLLIDING = b"".join(b"\x8a\x0a" + (k * PRIME).to_bytes(10, "little", signed=True) + b"N" for k in range(SIZE // 13))
LISTED = b"](" + b"K\x01" * 1000 + b"e" + put(0)
WORST = {
    # One opcode, or a few, repeated
    **{f"only {part!r}": repeated(part) for part in (b"N", b"(", b"cnumpy\ndtype\n")},
    "frames": repeated(b"\x95" + struct.pack("<Q", SIZE // 2)),
    "memoized anywhere": b"N" + b"".join(b"r" + word(k << 14) for k in range(SIZE // 5)),
    "a long reference": repeated(b"a", b"c", b"\nload\n"),
    # Values
    **{f"list of {one[:12]!r}": fields(verts=repeated(one, b"](", b"e")) for one in (b"K\x01", LONG, b"\x8c\x01\xff")},
    "appended to itself": fields(verts=repeated(get(0) + b"a", b"]" + put(0))),
    "many keys": fields(**{f"{k:06x}": b"N" for k in range(SIZE // 12)}),
    "colliding keys": fields(verts=b"}(" + COLLIDING + b"u"),
    "many lights": fields(light_positions=zeros(SIZE // 3, 3) + put(0), light_intensities=get(0)),
    "many faces": fields(face_indices=zeros(3, SIZE // 3) + put(0), face_uv_indices=get(0)),
    # Nested
    "lists in lists": fields(verts=b"](" * (SIZE // 3) + b"e" * (SIZE // 3)),
    "arrays in arrays": fields(verts=FRESH[:38] + b")R(NNNN" * (SIZE // 46) + b"N" + b"tb" * (SIZE // 46)),
    # Referenced many times
    "2^28 leaves": fields(verts=pairs()),
    "a list of 2^28 leaves": fields(unused=lists(), verts=get(DEPTH)),
    "a shape of 2^28 leaves": fields(verts=array(pairs(), F8, b"")),
    "a byte order of 2^28 leaves": fields(verts=array(b"K\x01\x85", dtype(text("f8"), pairs()), bytes(8))),
    "the whole of 2^28 leaves": pairs() + b".",
    "a list in all fields": fields(unused=LISTED, **{key: b"](" + get(0) * 250 + b"e" for key in course_dict()}),
    "an array many times": fields(unused=zeros(3) + put(0), light_positions=repeated(get(0), b"](", b"e")),
    "long arguments often": repeated(b"cnumpy\ndtype\n" + get(0) + b"R", b"(" + b"N" * (SIZE // 2) + b"t" + put(0)),
    "a long state often": repeated(get(0) + b"b", b"(" + b"N" * (SIZE // 2) + b"t" + put(0) + F8),
}


@pytest.mark.parametrize("name", WORST)
def test_worst_cases_take_no_time(tmp_path, name):
    path, start = npy_of_pickle(tmp_path / "a.npy", WORST[name]), time.process_time()
    try:
        load(path)
    except InputError as error:
        assert str(error).isprintable()
        assert len(str(error)) < 400
    assert time.process_time() - start < SECONDS


def test_the_garbage_collector_is_as_before(tmp_path):
    paths = [npy_of_pickle(tmp_path / f"{k}.npy", pickled) for k, pickled in enumerate([KNOWN, b"N."])]
    try:
        for switch in (gc.disable, gc.enable):
            switch()
            load(paths[0])
            refusal(paths[1], "1.npy: pickle: ")
            assert gc.isenabled() == (switch is gc.enable)
    finally:
        gc.enable()


@pytest.mark.parametrize("key", [b"K\x01", b"N", b"C\x01a", b"K\x01\x85", b"\x88", text("k" * 65)])
def test_keys_are_short_text(tmp_path, key):
    pickled = fields(unused=b"}" + key + b"Ns")
    refusal(npy_of_pickle(tmp_path / "bad.npy", pickled), "bad.npy: pickle: ", "a key other than text of at most 64")
    assert load(npy_of_pickle(tmp_path / "a.npy", fields(unused=b"}" + text("k" * 64) + b"Ns"))).face_count == 2


def test_limits_are_what_they_say(monkeypatch):
    """Each limit at its last valid and first invalid value."""
    assert MAX_OPCODES == 1 << 20
    monkeypatch.setattr(_Steps, "left", 100)
    assert unpickle(b"N" * 99 + b".") is None
    with pytest.raises(Refused, match="more than 1048576 opcodes"):
        unpickle(b"N" * 100 + b".")


@pytest.mark.parametrize(("times", "long"), [(200, False), (300, True)])
def test_what_a_file_names_again_may_be_a_quarter_of_a_million_numbers(tmp_path, times, long):
    repeated = b"](" + b"K\x01" * 1000 + b"e" + put(0)
    pickled = fields(unused=repeated, light_positions=b"](" + get(0) * times + b"e", light_intensities=b"]")
    message = refusal(npy_of_pickle(tmp_path / "a.npy", pickled), "light_positions")
    assert ("a list that is too long" in message) == long
