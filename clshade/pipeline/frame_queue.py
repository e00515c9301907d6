"""Many frames one behind the other: while the device draws one, the host completes the last and enqueues the next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Array
from .buffers import ALIGNMENT, Buffer, transfers, wait
from .camera_space import CameraSpace
from .frame_state import SceneFrame
from .scene_drawing import SceneDrawing

STREAMED_PIXELS = 1 << 19  # from here on images do not fit in caches, which they would only empty
_LEAST_ALIGNMENT = 16  # bytes, of memory to which kernels write four float32 at once


class _Output:
    """A result of all frames, (K, M, N, ...) in any layout. Kernels write straight into it where they can, elsewhere into
    one of two buffers, from which it is copied.

    kernel_type: the type that they write.
    """

    def __init__(self, drawing: SceneDrawing, array: Array, kernel_type: np.dtype) -> None:
        self.array = array.view(np.ndarray)
        self._device = drawing.device
        is_shared = drawing.tables.image.is_shared
        least = ALIGNMENT if array.dtype == np.float64 else _LEAST_ALIGNMENT
        self.is_direct = is_shared and array.dtype == kernel_type and _is_aligned(array, least)
        shape = array.shape[1:]
        self._staged = () if self.is_direct else tuple(drawing.pool.take(shape, kernel_type) for _ in range(2))

    def target(self, index: int) -> Buffer:
        """Return the buffer that the kernels write for a frame."""
        return Buffer(self._device, self.array[index]) if self.is_direct else self._staged[index % 2][0]


def _is_aligned(array: Array, least: int) -> bool:
    """Return whether each of the images in an array is contiguous and begins at a multiple of so many bytes."""
    begins_well = array.ctypes.data % least == 0 and (len(array) < 2 or array.strides[0] % least == 0)
    return begins_well and all(first.flags.c_contiguous for first in array[:1])


@dataclass
class _Pending:
    """A frame that is being drawn, the index-th. targets: what the kernels write, by name. done: the events that it is
    complete after."""

    index: int
    frame: SceneFrame
    targets: dict[str, Buffer]
    done: Sequence[Any] = ()

    @property
    def layers(self) -> dict[str, Buffer]:
        """The targets of the layers."""
        return {name: buffer for name, buffer in self.targets.items() if name != "rgba"}


class FrameQueue:
    """The drawing of many frames into arrays, (K, M, N, ...) by name: `rgba` and the layers.

    Nothing else may be drawn meanwhile. After `draw`: facts, a function for each frame, see
    `SceneDrawing.facts_of`; stage_ms, the times of the stages, of all frames together.
    """

    def __init__(self, drawing: SceneDrawing, arrays: Mapping[str, Array]) -> None:
        self._drawing, self._layers, self._device = drawing, drawing.layers, drawing.device
        self.facts: list[Callable[[], dict[str, Any]]] = []
        self.stage_ms: Counter[str] = Counter()
        self._outputs = {
            name: _Output(drawing, array, array.dtype if name == "rgba" else self._layers.kernel_type(name))
            for name, array in arrays.items()
        }
        image = self._outputs["rgba"]
        together = image.array if image.is_direct else image.array[:1]
        begins_lines = _is_aligned(image.array, ALIGNMENT) or not image.is_direct
        self._streams = together[..., 0].size >= STREAMED_PIXELS and begins_lines
        shape = image.array.shape[1:3]
        self._owners = [drawing.pool.take(shape, np.int32) for _ in range(2) if drawing.features["OWNERS"]]
        self._tables = drawing.tables, drawing.tables.twin()
        self._transfers = transfers(self._device)

    def draw(self, spaces: Sequence[CameraSpace]) -> None:
        """Draw a frame for each space. Raises as `Renderer.render`."""
        pending: _Pending | None = None
        for index, space in enumerate(spaces):
            if pending is not None and not self._device.has_fp64:  # the host projects into memory that kernels read
                self._complete(pending)
                pending = None
            latest = self._start(index, space)
            if pending is not None:
                self._complete(pending)
            pending = latest
        if pending is not None:
            self._complete(pending)

    def _start(self, index: int, space: CameraSpace) -> _Pending:
        """Enqueue a frame with its layers."""
        targets = {name: output.target(index) for name, output in self._outputs.items()}
        owners = self._owners[index % 2][0] if self._owners else None
        tables = self._tables[index % 2]
        frame = SceneFrame.of(space, tables, targets["rgba"], owners, streams=self._streams)
        drawn = _Pending(index, frame, targets)
        self._drawing.enqueue(frame, drawn.layers)
        self._fetch(drawn)
        return drawn

    def _fetch(self, drawn: _Pending) -> None:
        """Enqueue the copies from a device with memory of its own."""
        frame = drawn.frame
        drawn.done = [frame.last]
        if self._transfers is not None:
            self._device.queue.flush()
            wanted = [*drawn.targets.values(), frame.counted, frame.owners if "P" in drawn.targets else None]
            drawn.done = [each.fetch(self._transfers, frame.last) for each in wanted if each is not None]

    def _complete(self, drawn: _Pending) -> None:
        """Wait for a frame, draw it again if nothing of it was drawn, and do the host's part of its layers."""
        wait(self._device, drawn.done)
        frame = drawn.frame
        if frame.counters is None:
            counters = frame.counted.array[0].copy()
            frame.counters, frame.host_ms["sort"] = counters, 0.0
            if counters["to_clip"] or counters["entries"] > frame.room:
                self._drawing.draw_again(frame, drawn.layers)
                self._fetch(drawn)
                wait(self._device, drawn.done)
        self._write_results(drawn)
        if self._device.profiling:
            for name, event in frame.events.items():
                if event is not None:
                    self.stage_ms[name] += (event.profile.end - event.profile.start) / 1e6
        frame.events.clear()
        self.stage_ms.update(frame.host_ms)
        sizes = {"image": drawn.targets["rgba"], "owners": frame.owners}
        bytes_of = {name: 0 if buffer is None else buffer.array.nbytes for name, buffer in sizes.items()}
        self.facts.append(self._drawing.facts_of(frame, bytes_of))

    def _write_results(self, drawn: _Pending) -> None:
        """Complete the layers, and copy what the kernels did not write to its place."""
        arrays = {name: buffer.array for name, buffer in drawn.targets.items()}
        results = {name: output.array[drawn.index] for name, output in self._outputs.items()}
        if drawn.frame.owners is not None:
            self._layers.finish(arrays, results, drawn.frame.owners.array, drawn.frame.space)
        for name, output in self._outputs.items():
            if not output.is_direct and name != "P":
                np.copyto(results[name], arrays[name])
