"""Recycled image memory: arrays of frames of which no view is held any more serve the next frames."""

from __future__ import annotations

import sys
from typing import Any

from .launches import Buffer
from .opencl.device import Device


class Pool:
    """Buffers by shape and type. A buffer is free when nothing outside refers to its array or to a view of it.

    keep: buffers of one shape and type. shapes: as many are kept, those asked for last.
    """

    def __init__(self, device: Device, keep: int = 4, shapes: int = 8) -> None:
        self._device, self._keep, self._shapes = device, keep, shapes
        self._held: dict[tuple, list[tuple[Buffer, int]]] = {}  # the latest last

    def take(self, shape: tuple[int, ...], dtype: Any) -> Buffer:
        """A buffer whose array nobody else holds; the array's content is arbitrary."""
        held = self._held[shape, dtype] = self._held.pop((shape, dtype), [])
        while len(self._held) > self._shapes:
            del self._held[next(iter(self._held))]
        for buffer, idle_references in held:
            if sys.getrefcount(buffer.owner) <= idle_references:
                return buffer
        buffer = Buffer.empty(self._device, shape, dtype)
        if len(held) < self._keep:
            held.append((buffer, sys.getrefcount(buffer.owner)))
        return buffer
