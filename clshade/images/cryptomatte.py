"""Cryptomatte: masks of named things with the share of each pixel that they cover, for compositing.

After Psyop's Cryptomatte specification, version 1.2.0. Needs mmh3 for the hashes of names.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from ..base.arrays import Array
from ..base.input_files import file_error
from ..base.validation import integer, text, value_error

MatteKind: TypeAlias = Literal["object", "material", "instance"]
MATTES: tuple[MatteKind, ...] = get_args(MatteKind)

RANKS = 6  # things that a pixel lists, by default
MAX_RANKS = 64


class Matte(NamedTuple):
    """One Cryptomatte layer: its channels, (M, N) float32, and the attributes of its part's header, by name."""

    channels: dict[str, Array]
    metadata: dict[str, str]


def hashes(names: Iterable[str]) -> Array:
    """Return the ids of names, uint32: MurmurHash3 of their UTF-8, with the lowest bit of the exponent flipped where they
    would be NaN, infinite or denormal as float32. Raises InputError if mmh3 is not installed."""
    try:
        import mmh3
    except ImportError:
        raise file_error("cryptomatte", "names", "mmh3, for their hashes", "none: `pip install mmh3`") from None
    ids = np.array([int(mmh3.hash(name.encode("utf-8", "replace"), signed=False)) for name in names], np.uint32)
    exponent = ids >> np.uint32(23) & np.uint32(255)
    return np.where((exponent == 0) | (exponent == 255), ids ^ np.uint32(1 << 23), ids)


def ranked(numbers: Array, ranks: int = RANKS) -> tuple[Array, Array]:
    """Return the numbers that the samples of each pixel show, and how many samples show each.

    numbers: (S, M, N) uint32, what each sample of each pixel shows; 0 for nothing. ranks: numbers that a pixel lists at
    most, 1 to 64.
    Returns (R, M, N) uint32 numbers and uint16 counts, R the smaller of `ranks` and S: the most frequent first, of equally
    frequent ones the smaller first, 0 where there are no more.
    """
    samples, rows, columns = numbers.shape
    ranks = min(integer("cryptomatte", "ranks", ranks, 1, MAX_RANKS), samples)
    flat = numbers.reshape(samples, -1)
    listed, counts = np.zeros((ranks, rows * columns), np.uint32), np.zeros((ranks, rows * columns), np.uint16)
    listed[0], counts[0] = flat[0], np.where(flat[0], samples, 0)
    mixed = np.flatnonzero((flat != flat[0]).any(axis=0))
    ordered = np.sort(flat[:, mixed], axis=0)
    group = np.zeros(ordered.shape, np.intp)  # equal numbers, in each column
    np.cumsum(ordered[1:] != ordered[:-1], axis=0, out=group[1:])
    unique, frequency = np.zeros_like(ordered), np.zeros(ordered.shape, np.int32)
    pixels = np.arange(len(mixed))
    for sample, groups in zip(ordered, group, strict=True):
        unique[groups, pixels] = sample
        frequency[groups, pixels] += 1
    frequency[unique == 0] = 0
    best = np.argsort(-frequency, axis=0, kind="stable")[:ranks]  # unique is in ascending order
    listed[:, mixed], counts[:, mixed] = (np.take_along_axis(table, best, axis=0) for table in (unique, frequency))
    return listed.reshape(ranks, rows, columns), counts.reshape(ranks, rows, columns)


def matte(label: str, numbers: Array, names: Mapping[int, str], ranks: int = RANKS) -> Matte:
    """Return one Cryptomatte layer.

    label: name of the layer, such as "CryptoObject": its channels are CryptoObject00.R and so on, with an id, the bits of
    float32, and its share in turn. numbers, ranks: as for `ranked`. names: the name of each number; things of one name
    have one id, hence one mask.

    Shares are exact: the number of samples over S, rounded to float32. The manifest in the metadata holds all names,
    whether a pixel shows them or not.
    Raises InputError for another shape or type, a number without a name, a name of 0, and two names with one hash that are
    both shown (of 10,000 names that happens with a probability of 1 %, of 77,000 with 50 %), or if mmh3 is not installed.
    """
    if not text("cryptomatte", "label", label):
        raise value_error("cryptomatte", "label", "at least one letter", label)
    numbers = np.asarray(numbers)
    if numbers.ndim != 3 or numbers.dtype.kind not in "ui" or 0 in numbers.shape:
        raise value_error("cryptomatte", "numbers", "an array of shape (S, M, N) of whole numbers", numbers)
    for number, name in names.items():
        integer("cryptomatte", "number of a name", number, 1, (1 << 32) - 1)
        text("cryptomatte", "names", name)
    present = [number for number in np.unique(numbers).tolist() if number]
    if missing := [number for number in present if number not in names]:
        raise file_error("cryptomatte", "names", f"a name for {missing[0]}", "none")
    once = dict.fromkeys(names.values())
    ids = dict(zip(once, hashes(once).tolist(), strict=True))
    by_id: dict[int, str] = {}
    for name in dict.fromkeys(names[number] for number in present):
        if (first := by_id.setdefault(ids[name], name)) != name:
            raise value_error("cryptomatte", "names", f"names whose hashes differ from that of {first!r}", name)
    # Things of one name are one thing, numbered in the order of the names.
    place = {name: k for k, name in enumerate(once, 1)}
    keys = np.array([0, *names], np.int64)
    order = np.argsort(keys)
    places = np.array([0, *(place[name] for name in names.values())], np.uint32)[order]
    listed, counts = ranked(places[np.searchsorted(keys[order], numbers)], ranks)
    bits = np.array([0, *ids.values()], np.uint32)[listed].view(np.float32)
    shares = counts.astype(np.float32) / np.float32(len(numbers))
    planes = [plane for pair in zip(bits, shares, strict=True) for plane in pair]
    planes += [np.zeros_like(bits[0])] * (2 * (len(listed) % 2))  # channels R, G, B, A are written together
    channels = {f"{label}{k // 4:02d}.{'RGBA'[k % 4]}": plane for k, plane in enumerate(planes)}
    key = f"cryptomatte/{hashes([label])[0]:08x}"[: len("cryptomatte/") + 7]
    manifest = {name: f"{hashed:08x}" for name, hashed in ids.items()}
    facts = {"name": label, "hash": "MurmurHash3_32", "conversion": "uint32_to_float32"}
    facts["manifest"] = json.dumps(manifest, ensure_ascii=False, separators=(",", ":"))
    return Matte(channels, {f"{key}/{name}": fact for name, fact in facts.items()})
