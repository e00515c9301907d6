"""Skins of a glTF file: vertices that follow joints (glTF 2.0, section 3.7.3)."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ...base.arrays import Array, Floats, Integers
from .gltf_accessors import Buffers
from .gltf_json import Item

TOLERANCE = 0.01  # of the sum of a vertex's weights: four of 8 bits, rounded each by itself, are 0.0078 off
_AFFINE = 1e-4  # of the last row of an inverse bind matrix, which exporters compute in float32
_BLOCK = 1 << 15  # vertices that are blended at a time, 12 MiB of matrices


class Influences(NamedTuple):
    """Which joints move each vertex: joints and weights, (V, K) each; weights add up to 1."""

    joints: Integers
    weights: Floats


def joint_matrices(document: Item, buffers: Buffers, index: int, worlds: Mapping[int, Floats]) -> Floats:
    """Return what moves a vertex with each joint of a skin from the bind pose to the world, (J, 3, 4).

    worlds: the (4, 4) matrix of each node in the world. Raises InputError for a broken skin.
    """
    skin = document.entry("skins", index)
    joints = skin.references("joints", "nodes")
    if not joints:
        raise skin.error("joints", "a skeleton of one node or more", "none")
    skin.reference("skeleton", "nodes")  # a hint for editors
    for joint in joints:
        if joint not in worlds:  # then it is reached from no root
            raise document.error(f"nodes[{joint}]", "a tree of nodes", "a cycle")
    placements: Floats = np.stack([worlds[joint] for joint in joints])
    accessor = skin.reference("inverseBindMatrices", "accessors")
    if accessor is None:
        return placements[:, :3]
    array = buffers.array(accessor)
    if array.dtype != np.float32 or array.shape[1] != 16 or len(array) < len(joints):
        other = f"{array.shape[0]} of {array.shape[1]} in accessors[{accessor}]"
        raise skin.error("inverseBindMatrices", f"{len(joints)} matrices of 16 float32", other)
    inverse: Floats = array[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
    good = np.isfinite(inverse).all(axis=(1, 2)) & (np.abs(inverse[:, 3] - [0.0, 0.0, 0.0, 1.0]) <= _AFFINE).all(axis=1)
    if not good.all():
        expected = "finite matrices with a last row of 0 0 0 1"
        raise skin.error("inverseBindMatrices", expected, f"another in row {int(np.argmin(good))}")
    inverse[:, 3] = 0.0, 0.0, 0.0, 1.0
    with np.errstate(over="ignore", invalid="ignore"):
        found: Floats = (placements @ inverse)[:, :3]
    if not np.isfinite(found).all():
        raise skin.error("joints", "joints at finite places in the world", "an overflow")
    return found


def influences_of(attributes: Item, buffers: Buffers, count: int, used: Array | None, joint_count: int) -> Influences:
    """Return the influences on the vertices of a primitive, from all its sets of joints and weights.

    count: rows of its attributes. used: (V,) those that are vertices, None for all.

    Weights are scaled to a sum of 1, with a warning if one is off by more than TOLERANCE; without any, a vertex follows
    the first joint. Raises InputError for other shapes, and joints or weights out of range.
    """
    sets = [number for number in range(len(attributes.value)) if f"JOINTS_{number}" in attributes.value]
    joints = np.concatenate([_rows(attributes, buffers, f"JOINTS_{number}", count) for number in sets], axis=1)
    weights = np.concatenate([_rows(attributes, buffers, f"WEIGHTS_{number}", count) for number in sets], axis=1)
    joints, weights = (each if used is None else each[used] for each in (joints, weights))
    weights = weights.astype(np.float64)
    if not (np.isfinite(weights) & (weights >= 0.0)).all():
        row = int(np.argmin((np.isfinite(weights) & (weights >= 0.0)).all(axis=1)))
        raise attributes.error("WEIGHTS", "finite numbers of at least 0", f"{weights[row].tolist()} in row {row}")
    sums = weights.sum(axis=1)
    off = np.abs(sums - 1.0)
    if off.max() > TOLERANCE:
        row = int(np.argmax(off))
        line = f"WEIGHTS: expected a sum of 1 for each vertex, found {sums[row]:g} in row {row}: scaled"
        warnings.warn(f"{attributes.owner}: {attributes.where}.{line}", stacklevel=2)
    weights[sums == 0.0, 0] = 1.0
    weights /= weights.sum(axis=1)[:, None]
    joints = np.where(weights > 0.0, joints, 0)  # what has no weight may have any number
    if joints.max() >= joint_count:
        row = int(np.argmax(joints.max(axis=1)))
        raise attributes.error("JOINTS", f"indices below {joint_count}", f"{joints[row].max()} in row {row}")
    return Influences(joints.astype(np.int64), weights)


def _rows(attributes: Item, buffers: Buffers, name: str, count: int) -> Array:
    index = attributes.reference(name, "accessors")
    if index is None:
        raise attributes.error(name, "an index", "none")
    joints = name.startswith("JOINTS")
    values = buffers.array(index, normalized=not joints)
    if values.shape != (count, 4) or values.dtype.kind != ("u" if joints else "f"):
        kind = "whole numbers" if joints else "float32 or normalized integers"
        found = f"{values.shape[0]} of {values.shape[1]} {values.dtype} in accessors[{index}]"
        raise attributes.error(name, f"{count} of 4 {kind}", found)
    return values


def skinned(vectors: Mapping[str, Array], influences: Influences, matrices: Floats) -> tuple[dict[str, Floats], Floats]:
    """Return positions, normals and tangents, by attribute, in the world, and the placement (4, 4) that they then need.

    vectors: POSITION and NORMAL (V, 3), TANGENT (V, 4), of those that are there. matrices: see `joint_matrices`. Positions
    and tangents are moved by the blended matrix of each vertex, normals by the cofactors of its linear part, which are
    parallel to its inverse transpose and exist for singular ones too; normals then have length 1, or 0 where they vanish.
    What overflows is infinite or NaN.
    The placement is the identity. But if most of the matrices mirror, the result is mirrored in x, and so is the placement:
    by it the renderer knows which sides are front.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # the caller refuses an overflow
        mirror = bool((np.sign(np.linalg.det(matrices[:, :, :3]))[influences.joints] * influences.weights).sum() < 0.0)
        if mirror:
            matrices = matrices * np.array([-1.0, 1.0, 1.0])[:, None]
        found = {name: np.array(values, np.float64) for name, values in vectors.items()}
        count = len(influences.joints)
        for start in range(0, count, _BLOCK):
            part = slice(start, min(start + _BLOCK, count))
            joints, weights = influences.joints[part], influences.weights[part]
            blended = np.zeros((len(joints), 3, 4))
            for joint, weight in zip(joints.T, weights.T, strict=True):
                if weight.any():
                    blended += weight[:, None, None] * matrices[joint]
            linear = blended[:, :, :3]
            for name, values in found.items():
                if name == "NORMAL":
                    rows = np.moveaxis(_scaled(linear, (1, 2)), 1, 0)
                    cofactors = np.stack([np.cross(rows[k - 2], rows[k - 1]) for k in range(3)], axis=1)
                    values[part] = _unit(_products(cofactors, values[part]))
                    continue
                moved = _products(linear, values[part, :3])
                values[part, :3] = moved + blended[:, :, 3] if name == "POSITION" else moved
    return found, np.diag([-1.0 if mirror else 1.0, 1.0, 1.0, 1.0])


def _products(matrices: Floats, vectors: Floats) -> Floats:
    """Return matrices (V, 3, 3) times vectors (V, 3), each a sum in a fixed order: the same on every machine."""
    x, y, z = (matrices[:, :, column] * vectors[:, column, None] for column in range(3))
    return x + y + z


def _scaled(values: Floats, axes: int | tuple[int, ...]) -> Floats:
    """Return values divided by their largest magnitude over these axes: products of them neither overflow nor vanish."""
    largest = np.abs(values).max(axis=axes, keepdims=True)
    return values / np.where(largest == 0.0, 1.0, largest)


def _unit(vectors: Floats) -> Floats:
    """Return vectors (V, 3) at length 1; 0 stays 0."""
    vectors = _scaled(vectors, 1)
    x, y, z = vectors.T
    lengths = np.sqrt(x * x + y * y + z * z)
    return vectors / np.where(lengths == 0.0, 1.0, lengths)[:, None]
