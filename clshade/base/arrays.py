"""Names for arrays in signatures, and for fields that are given as something else. Shapes stand in docstrings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[Any]  # of any type: indices, tables, what a file holds
Reals: TypeAlias = NDArray[np.floating[Any]]  # float32 or float64
Floats: TypeAlias = NDArray[np.float64]
Floats32: TypeAlias = NDArray[np.float32]
Bools: TypeAlias = NDArray[np.bool_]
Integers: TypeAlias = NDArray[np.integer[Any]]
Indices: TypeAlias = NDArray[np.intp]  # as np.flatnonzero and its like give them
Faces: TypeAlias = NDArray[np.int32]  # (F, 3) indices of each face's corners
UInt32s: TypeAlias = NDArray[np.uint32]
Bytes: TypeAlias = NDArray[np.uint8]  # codes 0 to 255


Given = TypeVar("Given", contravariant=True)
Kept = TypeVar("Kept", covariant=True)


class Converted(Generic[Given, Kept]):
    """What type checkers know of a dataclass' field with a default that is given as one type and kept as another, which
    `__post_init__` makes of it. There are no such objects."""

    if TYPE_CHECKING:

        def __get__(self, instance: object, owner: object) -> Kept: ...

        def __set__(self, instance: object, value: Given) -> None: ...


def kept(default: Any) -> Any:
    """The default of a `Converted` field."""
    return default


Vector: TypeAlias = Converted[ArrayLike, Floats]  # of a number or three of them
