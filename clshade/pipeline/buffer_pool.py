"""A pool of image memory: arrays that no frame or view references any more are reused for the next frames."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

import numpy as np

from ..base.arrays import Array
from .buffers import Buffer
from .opencl.device import Device


class _Loan:
    """The base of an array over a buffer's memory and of all its views: the memory is on loan while it lives."""

    __slots__ = ("__array_interface__", "__weakref__", "_memory")

    def __init__(self, memory: Array) -> None:
        self._memory, self.__array_interface__ = memory, memory.__array_interface__


class _Lent:
    """A buffer and a weak reference to the loan of its memory, if any."""

    def __init__(self, buffer: Buffer) -> None:
        self._buffer = buffer
        self._loan: Callable[[], _Loan | None] = lambda: None

    @property
    def is_free(self) -> bool:
        return self._loan() is None

    def lend(self) -> tuple[Buffer, Array]:
        loan = _Loan(self._buffer.array)
        self._loan = weakref.ref(loan)
        return self._buffer, np.asarray(loan)


class Pool:
    """Buffers by shape and type.

    keep: most buffers kept of one shape and type. shapes: most pairs of shape and type kept, the latest used.
    """

    def __init__(self, device: Device, keep: int = 4, shapes: int = 8) -> None:
        self._device, self._keep, self._shapes = device, keep, shapes
        self._held: dict[tuple[tuple[int, ...], Any], list[_Lent]] = {}  # latest last

    def take(self, shape: tuple[int, ...], dtype: Any) -> tuple[Buffer, Array]:
        """Return a buffer and an array over its memory, with arbitrary content. The buffer is not handed out again
        while that array or a view of it lives."""
        held = self._held[shape, dtype] = self._held.pop((shape, dtype), [])
        while len(self._held) > self._shapes:
            del self._held[next(iter(self._held))]
        lent = next((each for each in held if each.is_free), None)
        if lent is None:
            lent = _Lent(Buffer.empty(self._device, shape, dtype))
            if len(held) < self._keep:
                held.append(lent)
        return lent.lend()
