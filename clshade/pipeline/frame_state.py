"""The state of a frame that is being drawn: the tables that the host writes for it, and how far it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from . import struct_layout
from .buffers import Buffer
from .camera_space import CameraSpace

STREAMED_PIXELS = 1 << 19  # from here on images do not fit in caches, which they would only empty


@dataclass
class FrameTables:
    """What the host writes for a frame, and the counters of its kernels: with two of these, the host writes one while
    kernels use the other.

    image_of: what `image` was written for, None if it is yet to be written.
    """

    view: Buffer
    image: Buffer
    lights: Buffer
    shadow_view: Buffer | None
    counters: Buffer
    image_of: tuple[Any, ...] | None = None

    def twin(self) -> FrameTables:
        """Return other tables of the same sizes."""
        shadow_view = None if self.shadow_view is None else self.shadow_view.twin()
        return FrameTables(self.view.twin(), self.image.twin(), self.lights.twin(), shadow_view, self.counters.twin())


@dataclass
class Progress:
    """The progress of a frame.

    streams: whether the image is written past the caches, if it has rows of 64 bytes. events: of its
    kernels, by name. host_ms: times of the host's stages. is_sorted: whether its triangles were sorted by depth.
    counters: as the host has read them, None until then. counted: those on the device. room: entries that fitted in the
    tile lists when it was enqueued.
    """

    space: CameraSpace
    streams: bool
    events: dict[str, Any] = field(default_factory=dict)
    host_ms: dict[str, float] = field(default_factory=dict)
    is_sorted: bool = False
    counters: np.void | None = None
    counted: Buffer | None = None
    room: int = 0

    @property
    def tiles(self) -> int:
        columns, rows = self.space.camera.resolution
        return -(-columns // struct_layout.TILE_SIZE) * -(-rows // struct_layout.TILE_SIZE)

    @property
    def last(self) -> Any:
        """The event of the kernel enqueued last."""
        return next(reversed(self.events.values()))
