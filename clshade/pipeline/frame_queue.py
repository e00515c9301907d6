"""Many frames one behind the other: while the device draws one, the host completes the last and enqueues the next.

And the checks of what `Renderer.render_many` takes.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.spelling import hint
from ..base.validation import sequence, value_error
from ..errors import InputError
from ..images.layers import LAYER_REMARKS, LAYER_WORDS
from ..scene.camera import Camera
from .buffers import ALIGNMENT, Buffer, transfers, wait
from .camera_space import CameraSpace
from .draw import SceneDrawing
from .launches import SceneFrame

STREAMED_PIXELS = 1 << 19  # from here on images do not fit in caches, which they would only empty
_OWNER = "Renderer.render_many"
_LEAST_ALIGNMENT = 16  # bytes, of memory to which kernels write four float32 at once


def event_ms(event: Any) -> float:
    """Return the time of a kernel, from its event."""
    return float(event.profile.end - event.profile.start) / 1e6


def _is_aligned(array: Array, least: int) -> bool:
    """Return whether each of the images in an array is contiguous and begins at a multiple of so many bytes."""
    begins_well = array.ctypes.data % least == 0 and (len(array) < 2 or array.strides[0] % least == 0)
    return begins_well and all(first.flags.c_contiguous for first in array[:1])


class FrameQueue:
    """The drawing of many frames into arrays, (K, M, N, ...) in any layout by name: `rgba` and the layers. Kernels write
    straight into them where they can, elsewhere into one of two buffers, from which they are copied.

    Nothing else may be drawn meanwhile. After `draw`: facts, a function for each frame, see
    `SceneDrawing.facts_of`; stage_ms, the times of the stages, of all frames together.
    """

    def __init__(self, drawing: SceneDrawing, arrays: Mapping[str, Array]) -> None:
        self._drawing, self._device, types = drawing, drawing.device, drawing.layers.kernel_types
        self.facts: list[Callable[[], dict[str, Any]]] = []
        self.stage_ms: Counter[str] = Counter()
        self._arrays = {name: array.view(np.ndarray) for name, array in arrays.items()}
        self._staged = {}
        for name, array in self._arrays.items():
            kind, least = types.get(name, array.dtype), ALIGNMENT if array.dtype == np.float64 else _LEAST_ALIGNMENT
            if not (drawing.tables["image"].is_shared and array.dtype == kind and _is_aligned(array, least)):
                self._staged[name] = [drawing.pool.take(array.shape[1:], kind) for _ in range(2)]
        image, is_direct = self._arrays["rgba"], "rgba" not in self._staged
        together = image if is_direct else image[:1]
        self._streams = together[..., 0].size >= STREAMED_PIXELS and (not is_direct or _is_aligned(image, ALIGNMENT))
        shape = image.shape[1:3]
        self._owners = [drawing.pool.take(shape, np.int32) for _ in range(2) if drawing.features["OWNERS"]]
        self._tables = drawing.tables, {name: table.twin() for name, table in drawing.tables.items()}
        self._transfers = transfers(self._device)

    def draw(self, spaces: Sequence[CameraSpace]) -> None:
        """Draw a frame for each space. Raises as `Renderer.render`."""
        pending = deque[tuple[int, SceneFrame, list[Any]]]()
        for index, space in enumerate(spaces):
            if not self._device.has_fp64 and pending:  # the host projects into memory that kernels read
                self._complete(*pending.popleft())
            targets = {
                name: self._staged[name][index % 2][0] if name in self._staged else Buffer(self._device, array[index])
                for name, array in self._arrays.items()
            }
            owners = self._owners[index % 2][0] if self._owners else None
            rgba, tables = targets.pop("rgba"), self._tables[index % 2]
            frame = self._drawing.frame(space, tables, rgba, owners, streams=self._streams)
            frame.layers = targets
            self._drawing.enqueue(frame)
            pending.append((index, frame, self._fetch(frame)))
            if len(pending) > 1:
                self._complete(*pending.popleft())
        if pending:
            self._complete(*pending.popleft())

    def _fetch(self, frame: SceneFrame) -> list[Any]:
        """Enqueue the copies from a device with memory of its own; return the events after which the frame is complete."""
        last = next(reversed(frame.events.values()))
        if self._transfers is None:
            return [last]
        self._device.queue.flush()
        names = "rgba", "counters", *(["owners"] if "P" in frame.layers else [])
        wanted = [*frame.layers.values(), *map(frame.values.get, names)]
        return [each.fetch(self._transfers, last) for each in wanted if each is not None]

    def _complete(self, index: int, frame: SceneFrame, done: list[Any]) -> None:
        """Wait for a frame, draw it again if nothing of it was drawn, and do the host's part of its layers."""
        wait(self._device, done)
        if frame.counters is None:
            counters = frame.values["counters"].array[0].copy()
            frame.counters, frame.host_ms["sort"] = counters, 0.0
            if counters["to_clip"] or counters["entries"] > frame.room:
                self._drawing.draw_again(frame)
                wait(self._device, self._fetch(frame))
        self._write_results(index, frame)
        if self._device.profiling:
            self.stage_ms.update({name: event_ms(event) for name, event in frame.events.items() if event is not None})
        frame.events.clear()
        self.stage_ms.update(frame.host_ms)
        self.facts.append(self._drawing.facts_of(frame))

    def _write_results(self, index: int, frame: SceneFrame) -> None:
        """Complete the layers, and copy what the kernels did not write to its place."""
        arrays = {name: buffer.array for name, buffer in {"rgba": frame.values["rgba"], **frame.layers}.items()}
        results = {name: array[index] for name, array in self._arrays.items()}
        if frame.values["owners"] is not None:
            self._drawing.layers.finish(arrays, results, frame.values["owners"].array, frame.space)
        for name in self._staged:
            if name != "P":
                np.copyto(results[name], arrays[name])


def check_camera(owner: str, name: str, camera: Any, like: Camera) -> None:
    """Raise InputError for anything but a camera of the same kind as another."""
    if not isinstance(camera, Camera):
        raise value_error(owner, name, "a Camera", camera)
    if camera.orthographic != like.orthographic:
        kind = "an orthographic" if like.orthographic else "a perspective"
        raise value_error(owner, name, f"{kind} camera, as the scene's", "the other kind")


def check_cameras(cameras: Iterable[Camera], like: Camera) -> tuple[Camera, ...]:
    """Return cameras of one resolution, of the kind of another one. Raises InputError."""
    found = None if isinstance(cameras, (str, bytes)) else sequence(cameras)
    if found is None:
        raise value_error(_OWNER, "cameras", "a sequence of Cameras", cameras)
    for index, camera in enumerate(found):
        check_camera(_OWNER, f"cameras[{index}]", camera, like)
        if camera.resolution != found[0].resolution:
            expected = f"the resolution of all, {found[0].resolution} as that of cameras[0]"
            raise value_error(_OWNER, f"cameras[{index}]", expected, camera.resolution)
    return found


def result_arrays(
    kinds: Mapping[str, tuple[tuple[int, ...], np.dtype]],
    out: Mapping[str, Array] | None,
    make: Callable[[tuple[int, ...], np.dtype], Array],
) -> dict[str, Array]:
    """Return an array for each name, of the given shape and type: that of `out`, if it has one, or what `make` returns.
    Raises InputError for other arrays, and if there is no memory."""
    out = {} if out is None else out
    if not isinstance(out, Mapping):
        raise value_error(_OWNER, "out", "arrays by name, such as {'rgba': array}", out)
    for name in out:
        if name not in kinds:
            near = hint(name, kinds, LAYER_WORDS, remarks=LAYER_REMARKS)
            raise value_error(_OWNER, "out", f"names of {', '.join(kinds)}", name, near)
    found = {name: out[name] for name in kinds if name in out}
    for name, array in found.items():
        (shape, kind), field = kinds[name], f"out[{name!r}]"
        if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != kind:
            raise value_error(_OWNER, field, f"an array of shape {shape} and type {kind}", array)
        if not array.flags.writeable:
            raise InputError(f"{_OWNER}: {field}: expected a writeable array, found a read-only one")
    for one, other in combinations(found, 2):
        if np.shares_memory(found[one], found[other]):
            raise InputError(f"{_OWNER}: out[{other!r}]: expected memory of its own, found that of out[{one!r}]")
    try:
        return {name: found[name] if name in found else make(*kind) for name, kind in kinds.items()}
    except MemoryError:
        size = sum(np.prod(shape) * kind.itemsize for shape, kind in kinds.values())
        expected = "as many as fit in memory, or memory-mapped arrays as out"
        raise InputError(f"{_OWNER}: cameras: expected {expected}, found {size / 2**30:.1f} GiB of results") from None
