"""Cryptomatte: hashes of names, ranks of what samples show, and the part of an EXR that other programs read."""

import io
import json
from collections import Counter
from itertools import product

import numpy as np
import pytest

from clshade import exr
from clshade.errors import InputError
from clshade.images.cryptomatte import hashes, matte, ranked

NAMES = {1: "bunny", 2: "floor", 3: "lamp"}


def shown(seed, samples=6):
    return np.random.default_rng(seed).integers(0, 4, (samples, 7, 9)).astype(np.uint32)


def test_hashes_are_those_of_murmur3():
    """Known values of MurmurHash3_x86_32 with seed 0; 0 is denormal as float32."""
    assert hashes(["", "hello", "hello, world"]).tolist() == [1 << 23, 0x248BFA47, 0x149BBB7F]
    ids = hashes(map(str, range(3000)))
    assert len(set(ids.tolist())) == 3000
    assert (np.abs(ids.view(np.float32)) >= np.finfo(np.float32).tiny).all()
    assert np.isfinite(ids.view(np.float32)).all()


@pytest.mark.parametrize("ranks", [1, 3, 6])
def test_ranks_are_sorted_counts(ranks):
    numbers = shown(1)
    listed, counts = ranked(numbers, ranks)
    assert listed.shape == counts.shape == (ranks, 7, 9)
    for row, column in np.ndindex(7, 9):
        tally = Counter(number for number in numbers[:, row, column].tolist() if number)
        expected = sorted(tally.items(), key=lambda item: (-item[1], item[0]))[:ranks]
        pairs = list(zip(listed[:, row, column].tolist(), counts[:, row, column].tolist(), strict=True))
        assert pairs == expected + [(0, 0)] * (ranks - len(expected))
    listed, counts = ranked(shown(2, samples=1), ranks)  # which has one rank
    assert listed.shape == (1, 7, 9)
    assert np.array_equal(counts, listed > 0)


def test_a_thing_is_recovered_from_its_name():
    numbers = shown(3)
    part = matte("CryptoObject", numbers, {**NAMES, 3: "bunny"})
    assert sorted(part.channels) == [f"CryptoObject{k:02d}.{letter}" for k in range(3) for letter in "ABGR"]
    manifest = json.loads(next(text for name, text in part.metadata.items() if name.endswith("/manifest")))
    assert set(manifest) == {"bunny", "floor"}
    for name, alike in (("bunny", (1, 3)), ("floor", (2,))):
        share = np.zeros((7, 9), np.float32)
        for k, (ids, weights) in product(range(3), ("RG", "BA")):
            ids, weights = (part.channels[f"CryptoObject{k:02d}.{letter}"] for letter in (ids, weights))
            share += np.where(ids.view(np.uint32) == int(manifest[name], 16), weights, 0)
        assert np.allclose(share, np.isin(numbers, alike).mean(axis=0), atol=1e-7)


def test_names_of_one_hash():
    one, twin = "tree 33987", "tree 49036"
    assert hashes([one])[0] == hashes([twin])[0]
    part = matte("CryptoObject", np.where(shown(8) == 3, 0, shown(8)).astype(np.uint32), {1: one, 2: "floor", 3: twin})
    assert part.channels["CryptoObject00.G"].max() > 0
    with pytest.raises(InputError, match=f"expected names whose hashes differ from that of '{one}', found '{twin}'"):
        matte("CryptoObject", shown(8), {1: one, 2: "floor", 3: twin})


def test_others_read_the_part(tmp_path):
    oiio = pytest.importorskip("OpenImageIO")
    part = matte("CryptoObject", shown(4), NAMES)
    with open(tmp_path / "a.exr", "w+b") as file:
        image = np.random.default_rng(5).random((7, 9, 4), np.float32)
        assert exr.encode(file, image, half=True, parts={"cryptomatte": part}) == []
    channels, header = exr.read(tmp_path / "a.exr")
    assert header["name"] == "rgba"
    assert np.array_equal(channels["G"], image[..., 1].astype(np.float16))
    opened = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    assert opened.seek_subimage(1, 0)
    spec = opened.spec()
    names = {"oiio:subimagename": "cryptomatte", **part.metadata}
    assert {name: spec[name] for name in names} == names
    pixels = opened.read_image(1, 0, 0, spec.nchannels, "float")
    for k, name in enumerate(spec.channelnames):
        assert np.array_equal(pixels[..., k].view(np.uint32), part.channels[name].view(np.uint32))
        assert np.array_equal(channels[name].view(np.uint32), part.channels[name].view(np.uint32))
    opened.close()


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"names": {1: "bunny", 2: "floor"}}, "names: expected a name for 3, found none"),
        ({"ranks": 0}, "ranks: expected a whole number from 1 to 64"),
        ({"label": ""}, "label: expected at least one letter"),
        ({"names": {**NAMES, 0: "sky"}}, "number of a name: expected a whole number from 1 to 4294967295, found 0"),
        ({"names": {**NAMES, 4: 5}}, "names: expected a text, found 5"),
        ({"numbers": shown(6) * 0.5}, "numbers: expected an array"),
    ],
)
def test_what_is_refused(change, part):
    with pytest.raises(InputError, match=part):
        matte(**{"label": "CryptoObject", "numbers": shown(6), "names": NAMES, **change})


def test_parts_of_a_file():
    image, part = np.zeros((7, 9, 3), np.float32), matte("CryptoObject", shown(7), NAMES)
    huge = np.full((7, 9), 1e300)
    (warning,) = exr.encode(io.BytesIO(), image, parts={"more": ({"R": huge}, {})})
    assert warning.startswith("more.R: 63 finite values")
    for parts, message in (
        ({"cryptomatte": ({"R": huge[1:]}, {})}, "cryptomatte: expected channels of 9 x 7 pixels, found others"),
        *(({name: part}, "exr: parts: expected names of at least one letter") for name in ("", "rgba", "\ud800", 3)),
    ):
        with pytest.raises(InputError, match=message):
            exr.encode(io.BytesIO(), image, parts=parts)
