"""Recycled image memory: arrays of frames of which no view is held any more serve the next frames."""

from __future__ import annotations

import sys
from typing import Any

from .device import Device
from .stages import Buffer


class Pool:
    """Buffers by shape and type. A buffer is free when nothing outside refers to its array or to a view of it."""

    def __init__(self, device: Device, keep: int = 4) -> None:
        self._device, self._keep = device, keep
        self._held: dict[tuple, list[tuple[Buffer, int]]] = {}

    def take(self, shape: tuple[int, ...], dtype: Any) -> Buffer:
        """A buffer whose array nobody else holds; the array's content is arbitrary."""
        held = self._held.setdefault((shape, dtype), [])
        for buffer, idle_references in held:
            if sys.getrefcount(buffer.array) <= idle_references:
                return buffer
        buffer = Buffer.empty(self._device, shape, dtype)
        if len(held) < self._keep:
            held.append((buffer, sys.getrefcount(buffer.array)))
        return buffer

    def clear(self) -> None:
        """Forgets all buffers; arrays still held by frames stay valid."""
        self._held.clear()
