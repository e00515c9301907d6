"""A pool of image memory: arrays that no frame or view references any more are reused for the next frames."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

import numpy as np

from ..base.arrays import Array
from .buffers import Buffer, aligned
from .opencl.device import Device


class _Loan:
    """The base of an array over a buffer's memory and of all its views: the memory is on loan while it lives."""

    __slots__ = ("__array_interface__", "__weakref__", "_memory")

    def __init__(self, memory: Array) -> None:
        self._memory, self.__array_interface__ = memory, memory.__array_interface__


class _Lent:
    """Memory, the buffer over it where a device uses it, and a weak reference to the loan, if any."""

    def __init__(self, memory: Array, buffer: Buffer | None) -> None:
        self._memory, self.buffer = memory, buffer
        self._loan: Callable[[], _Loan | None] = lambda: None

    @property
    def is_free(self) -> bool:
        return self._loan() is None

    def lend(self) -> Array:
        loan = _Loan(self._memory)
        self._loan = weakref.ref(loan)
        return np.asarray(loan)


class Pool:
    """Arrays by shape and type, with or without a buffer.

    keep: most kept of one kind. kinds: most kinds kept, the latest used.
    """

    def __init__(self, device: Device, keep: int = 4, kinds: int = 8) -> None:
        self._device, self._keep, self._kinds = device, keep, kinds
        self._held: dict[tuple[tuple[int, ...], Any, bool], list[_Lent]] = {}  # latest last

    def take(self, shape: tuple[int, ...], dtype: Any) -> tuple[Buffer, Array]:
        """Return a buffer and an array over its memory, with arbitrary content. The buffer is not handed out again
        while that array or a view of it lives."""
        array, buffer = self._lend(shape, dtype, with_buffer=True)
        assert buffer is not None
        return buffer, array

    def take_host(self, shape: tuple[int, ...], dtype: Any) -> Array:
        """Return an array as `take` does, of memory that no device sees."""
        return self._lend(shape, dtype, with_buffer=False)[0]

    def _lend(self, shape: tuple[int, ...], dtype: Any, *, with_buffer: bool) -> tuple[Array, Buffer | None]:
        kind = shape, dtype, with_buffer
        held = self._held[kind] = self._held.pop(kind, [])
        while len(self._held) > self._kinds:
            del self._held[next(iter(self._held))]
        lent = next((each for each in held if each.is_free), None)
        if lent is None:
            buffer = Buffer.empty(self._device, shape, dtype) if with_buffer else None
            lent = _Lent(aligned(shape, np.dtype(dtype)) if buffer is None else buffer.array, buffer)
            if len(held) < self._keep:
                held.append(lent)
        return lent.lend(), lent.buffer
