"""Results of costly preparations, kept for the next call with equal arguments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np

T = TypeVar("T")


def _bits(array: np.ndarray) -> np.ndarray:
    return array.reshape(-1).view(np.uint64 if array.nbytes % 8 == 0 else np.uint8)


def same(a: Any, b: Any) -> bool:
    """Whether two arguments are equal: arrays in type, shape and every bit, tuples item by item, others by ==."""
    if isinstance(a, np.ndarray):
        return (
            isinstance(b, np.ndarray)
            and (a.dtype, a.shape) == (b.dtype, b.shape)
            and np.array_equal(_bits(a), _bits(b))
        )
    return type(a) is type(b) and bool(a == b)


class ContentCache(Generic[T]):
    """The last `most` results of `make`, dropped from the oldest on while their arrays hold more than `size` bytes.

    make: gets the arguments, arrays as copies of its own, so that the caller may change theirs afterwards.
    drop: called with a result that is let go.
    """

    def __init__(self, make: Callable[..., T], drop: Callable[[T], Any], most: int = 4, size: int = 1 << 25) -> None:
        self._make, self._drop, self._most, self._size = make, drop, most, size
        self._kept: list[tuple[tuple[Any, ...], T]] = []  # the latest in front

    def get(self, *arguments: Any) -> T:
        """The result for these arguments; arrays have to be contiguous."""
        for place, (known, result) in enumerate(self._kept):
            if len(known) == len(arguments) and all(map(same, known, arguments)):
                self._kept.insert(0, self._kept.pop(place))
                return result
        own = tuple(item.copy() if isinstance(item, np.ndarray) else item for item in arguments)
        result = self._make(*own)
        self._kept.insert(0, (own, result))
        while len(self._kept) > 1 and (len(self._kept) > self._most or self._bytes() > self._size):
            self._drop(self._kept.pop()[1])
        return result

    def _bytes(self) -> int:
        return sum(item.nbytes for known, _ in self._kept for item in known if isinstance(item, np.ndarray))

    def clear(self) -> None:
        """Lets all results go."""
        while self._kept:
            self._drop(self._kept.pop()[1])
