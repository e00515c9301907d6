"""Array types for signatures, and dataclass fields that are converted. Shapes are given in docstrings."""

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
    """The type of a dataclass field that accepts one type and keeps another, to which `__post_init__` converts.

    For fields with a default, and for type checkers only; it is never instantiated.
    """

    if TYPE_CHECKING:

        def __get__(self, instance: object, owner: object) -> Kept: ...

        def __set__(self, instance: object, value: Given) -> None: ...


def kept(default: Any) -> Any:
    """Return the default of a `Converted` field."""
    return default


Vector: TypeAlias = Converted[ArrayLike, Floats]  # from one number or three
