"""The state of a frame that is being drawn: the tables that the host writes for it, and how far it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from . import struct_layout
from .buffers import Buffer
from .camera_space import CameraSpace


@dataclass
class FrameTables:
    """What the host writes for a frame, and what its kernels count: with two of these, the host writes one while
    kernels use the other.

    image_of: what `image` was written for, None if it is yet to be written.
    """

    view: Buffer
    image: Buffer
    lights: Buffer
    shadow_view: Buffer | None
    counted: Buffer
    image_of: tuple[Any, ...] | None = None

    def twin(self) -> FrameTables:
        """Return other tables of the same sizes."""
        shadow_view = None if self.shadow_view is None else self.shadow_view.twin()
        return FrameTables(self.view.twin(), self.image.twin(), self.lights.twin(), shadow_view, self.counted.twin())


@dataclass
class FrameInFlight:
    """A frame that is being drawn: into what, and how far it is.

    image: its struct of that name. counted: the counters on the device. rgba: (M, N, 4). owners: (M, N) triangles, if there
    are layers. events: of its kernels, by name. host_ms: times of the host's stages. is_sorted: whether its triangles were
    sorted by depth. counters: as the host has read them, None until then. room: entries that fitted in the tile lists when
    it was enqueued. inputs: what its kernels read, kept until they are done.
    """

    image: Buffer
    counted: Buffer
    rgba: Buffer
    owners: Buffer | None = None
    events: dict[str, Any] = field(default_factory=dict)
    host_ms: dict[str, float] = field(default_factory=dict)
    is_sorted: bool = False
    counters: np.void | None = None
    room: int = 0
    inputs: dict[str, Any] | None = None

    @property
    def resolution(self) -> tuple[int, int]:
        """Columns and rows."""
        rows, columns = self.rgba.array.shape[:2]
        return columns, rows

    @property
    def tiles(self) -> int:
        columns, rows = self.resolution
        return -(-columns // struct_layout.TILE_SIZE) * -(-rows // struct_layout.TILE_SIZE)

    @property
    def values(self) -> dict[str, Any]:
        """The arguments of kernels by name."""
        return {"image": self.image, "counters": self.counted}

    @property
    def last(self) -> Any:
        """The event of the kernel enqueued last."""
        return next(reversed(self.events.values()))

    def read_counters(self) -> np.void:
        """Wait for the kernels enqueued so far, and return the counters."""
        counters: np.void = self.counted.to_host()[0].copy()
        return counters


@dataclass
class SceneFrame(FrameInFlight):
    """A frame of a scene. space: of its camera. tables: its own, those of `image` and `counted`. streams: whether the image
    is written past the caches, if it has rows of 64 bytes. layers: into what they are drawn, by name."""

    space: CameraSpace = field(kw_only=True)
    tables: FrameTables = field(kw_only=True)
    streams: bool = field(kw_only=True)
    layers: dict[str, Buffer] = field(default_factory=dict)

    @classmethod
    def of(
        cls, space: CameraSpace, tables: FrameTables, rgba: Buffer, owners: Buffer | None, *, streams: bool
    ) -> SceneFrame:
        """Return a frame of which nothing is drawn yet."""
        return cls(tables.image, tables.counted, rgba, owners, space=space, tables=tables, streams=streams)
