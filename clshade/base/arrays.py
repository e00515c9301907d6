"""Array types for signatures, dataclass fields that are converted, and connected components. Docstrings give shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[Any]  # of any type: indices, tables, file contents
Reals: TypeAlias = NDArray[np.floating[Any]]  # float32 or float64
Floats: TypeAlias = NDArray[np.float64]
Floats32: TypeAlias = NDArray[np.float32]
Bools: TypeAlias = NDArray[np.bool_]
Integers: TypeAlias = NDArray[np.integer[Any]]
Faces: TypeAlias = NDArray[np.int32]  # (F, 3) vertex indices of each face
UInt32s: TypeAlias = NDArray[np.uint32]
Bytes: TypeAlias = NDArray[np.uint8]  # codes 0 to 255

Given = TypeVar("Given", contravariant=True)
Kept = TypeVar("Kept", covariant=True)


class Converted(Generic[Given, Kept]):
    """The type of a field of a `declare.record` that accepts one type and keeps another, to which its check converts.

    For type checkers only; it is never instantiated.
    """

    if TYPE_CHECKING:

        def __get__(self, instance: object, owner: object) -> Kept: ...

        def __set__(self, instance: object, value: Given) -> None: ...


Vector: TypeAlias = Converted[ArrayLike, Floats]  # from one number or three


def connected_components(count: int, first: Array, second: Array) -> Array:
    """Return (count,) int32: for each node the lowest one connected with it by the links first[i], second[i]."""
    labels = np.arange(count, dtype=np.int32)
    while True:
        one, two = labels[first], labels[second]
        apart = one != two
        if not apart.any():
            return labels
        first, second, one, two = first[apart], second[apart], one[apart], two[apart]
        np.minimum.at(labels, np.maximum(one, two), np.minimum(one, two))
        while not np.array_equal(further := labels[labels], labels):
            labels = further
