"""Device memory that the host accesses as NumPy arrays, and the buffers that one stage passes to the next."""

from __future__ import annotations

import contextlib
import math
import weakref
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
import pyopencl as cl

from ..base.arrays import Array
from ..errors import DeviceError
from .opencl.device import Device
from .struct_layout import SINGLE, Structs

_FLAGS = cl.mem_flags
ALIGNMENT = 64  # bytes, of a vector of 16 float32; kernels load four float64 at once, for which NumPy does not align
LEAST_INDEX_BITS = 24


@cache
def _coherent(context: cl.Context, queue: cl.CommandQueue) -> bool:
    """Return whether a finished queue leaves host memory given to a buffer up to date, both ways, without mapping it.

    OpenCL guarantees this for mapped memory only; on a CPU it holds if the runtime works in that memory itself. Tested
    by experiment, because each mapping of a small table costs as much as a small kernel: with memory that begins where
    NumPy's may, at a multiple of 16 bytes and no more.
    """
    array = aligned((4 + 1024,), np.dtype(np.uint32))[4:]
    array[:] = 0
    memory = cl.Buffer(context, _FLAGS.READ_WRITE | _FLAGS.USE_HOST_PTR, hostbuf=array)
    cl.enqueue_fill_buffer(queue, memory, np.array(7, np.uint32), 0, array.nbytes)
    queue.finish()
    written = bool((array == 7).all())
    array[:] = 9
    read_back = np.zeros_like(array)
    cl.enqueue_copy(queue, read_back, memory)
    return written and bool((read_back == 9).all())


def aligned(shape: tuple[int, ...], dtype: np.dtype) -> Array:
    """Return an array of arbitrary content, aligned for the widest vectors."""
    size = math.prod(shape) * dtype.itemsize
    raw = np.empty(size + ALIGNMENT, np.uint8)
    start = -raw.ctypes.data % ALIGNMENT
    return raw[start : start + size].view(dtype).reshape(shape)


@contextlib.contextmanager
def _named(device: Device) -> Iterator[None]:
    """Turn an error of OpenCL in the block into a DeviceError that names the device."""
    try:
        yield
    except cl.Error as error:
        raise DeviceError(f"{device.name}: {' '.join(str(error).split())}") from error


def finish(device: Device) -> None:
    """Wait until everything enqueued on the device is done. Raises DeviceError."""
    with _named(device):
        device.queue.finish()


def wait(device: Device, events: Iterable[cl.Event]) -> None:
    """Wait for events. Raises DeviceError."""
    with _named(device):
        for event in events:
            event.wait()


def transfers(device: Device) -> cl.CommandQueue | None:
    """Return a queue for copies from the device while its own draws; None if the host shares its memory."""
    if device.is_cpu and _coherent(device.context, device.queue):
        return None
    with _named(device):
        return cl.CommandQueue(device.context, device.device)


class Buffer:
    """Device memory that the host reads and writes as a NumPy array.

    is_shared: whether the kernels work in the array itself, as on CPUs; on other devices `writing` and `to_host` copy.
    """

    def __init__(self, device: Device, array: Array) -> None:
        self._device, self._queue = device, device.queue
        self.is_shared = device.is_cpu and _coherent(device.context, device.queue)
        array = np.ascontiguousarray(array)
        if array.dtype == np.float64 and array.ctypes.data % ALIGNMENT:
            array, given = aligned(array.shape, array.dtype), array
            array[:] = given
        self.array, size = array, array.nbytes
        if size > device.max_allocation:
            limit = f"the device allows {device.max_allocation}"
            raise DeviceError(f"{device.name}: one buffer needs {size} bytes, {limit}")
        access = _FLAGS.READ_WRITE if array.flags.writeable else _FLAGS.READ_ONLY
        place = _FLAGS.USE_HOST_PTR if self.is_shared else _FLAGS.COPY_HOST_PTR
        try:
            self.memory = cl.Buffer(device.context, access | place, hostbuf=array if size else np.zeros(64, np.uint8))
        except cl.Error as error:
            raise DeviceError(f"{device.name}: no memory for {size} bytes: {error}") from error

    @classmethod
    def empty(cls, device: Device, shape: int | tuple[int, ...], dtype: Any) -> Buffer:
        """Return a buffer of arbitrary content."""
        form, kind = shape if isinstance(shape, tuple) else (shape,), np.dtype(dtype)
        try:
            array = aligned(form, kind)
        except MemoryError:
            raise DeviceError(f"{device.name}: no memory for {math.prod(form) * kind.itemsize} bytes") from None
        return cls(device, array)

    @contextlib.contextmanager
    def writing(self, count: int | None = None, *, waits: bool = True) -> Iterator[Array]:
        """Yield the first `count` rows (default: all) for the host to overwrite.

        No kernel enqueued before may still use them; the next one enqueued sees them. waits: whether a copy to the device
        is complete afterwards; if not, the rows may not change until a kernel enqueued later has run.
        """
        rows = self.array[: len(self.array) if count is None else count]
        yield rows
        if rows.nbytes and not self.is_shared:
            with _named(self._device):
                # Freed, the event would be waited for.
                self._written = cl.enqueue_copy(self._queue, self.memory, rows, is_blocking=waits)

    def fetch(self, queue: cl.CommandQueue, after: cl.Event) -> cl.Event:
        """Enqueue a copy to the array, by another queue and after an event."""
        with _named(self._device):
            return cl.enqueue_copy(queue, self.array, self.memory, wait_for=[after], is_blocking=False)

    def to_host(self, count: int | None = None) -> Array:
        """Return the first `count` rows (default: all), once the kernels enqueued so far are done."""
        rows = self.array[: len(self.array) if count is None else count]
        if self.is_shared:
            finish(self._device)
        elif rows.nbytes:
            with _named(self._device):
                cl.enqueue_copy(self._queue, rows, self.memory)
        return rows


class Scratch:
    """Buffers by name, kept from frame to frame; they grow."""

    def __init__(self, device: Device) -> None:
        self._device, self._held = device, dict[str, Buffer]()

    def __call__(self, name: str, rows: int, kind: Any, *, exact: bool = False) -> Buffer:
        """Return a buffer of at least so many rows, or of so many."""
        held = len(self._held[name].array) if name in self._held else -1
        if held < rows or (exact and held != rows):
            self._held[name] = Buffer.empty(self._device, rows if exact else rows + rows // 2, kind)
        return self._held[name]


class VertexBuffers:
    """Outputs of `project` per vertex: projected (V,) structs.Vertex, relative (V, 4) reals."""

    def __init__(self, device: Device, count: int, structs: Structs = SINGLE) -> None:
        self.projected = Buffer.empty(device, count, structs.Vertex)
        self.relative = Buffer.empty(device, (count, 4), structs.real)


def index_bits(count: int) -> int:
    """Return how many low bits of sort keys hold the index of a triangle, of so many."""
    return max((count - 1).bit_length(), LEAST_INDEX_BITS)


class TriangleBuffers:
    """Outputs of `setup` and `setup_pieces`: triangles and sort keys, with room for `faces` and `pieces` of them; or of
    `setup_count`, which takes no keys and has `slack` more triangles."""

    def __init__(self, device: Device, faces: int, pieces: int, structs: Structs = SINGLE, slack: int = 0) -> None:
        self.piece_capacity, self.index_bits = pieces, index_bits(faces + pieces)
        self._device, self._structs, self._room = device, structs, faces + pieces
        self.triangles = Buffer.empty(device, faces + pieces + slack, structs.Triangle)
        self.bounds = Buffer.empty(device, faces + pieces + slack, structs.Bounds)
        self.to_clip = Buffer.empty(device, faces, np.int32)

    @property
    def nbytes(self) -> int:
        """Size of all that is in use."""
        return sum(value.array.nbytes for value in vars(self).values() if isinstance(value, Buffer))

    @property
    def values(self) -> dict[str, Any]:
        """The arguments of kernels by name, but for `keys` and `sorted_bounds`, for which not all need memory."""
        return {name: vars(self)[name] for name in ("triangles", "bounds", "to_clip", "index_bits")}

    @cached_property
    def keys(self) -> Buffer:
        """The sort keys (faces + pieces,) of `setup` and `setup_pieces`."""
        return Buffer.empty(self._device, self._room, np.uint64)

    @cached_property
    def sorted_bounds(self) -> Buffer:
        """The bounds (faces + pieces,) in the order of the depth sort, of `bin_count`."""
        return Buffer.empty(self._device, self._room, self._structs.Bounds)


class _PooledArray:
    """The base of an array that is handed out and of all its views: the memory is in use while it lives."""

    __slots__ = ("__array_interface__", "__weakref__", "_memory")

    def __init__(self, memory: Array) -> None:
        self._memory, self.__array_interface__ = memory, memory.__array_interface__


@dataclass(eq=False)
class _Block:
    """Memory, the buffer over it where a device uses it, and who uses it."""

    memory: Array
    buffer: Buffer | None
    user: Callable[[], _PooledArray | None] = lambda: None


class Pool:
    """Arrays by shape and type, with or without a buffer.

    keep: most kept of one kind. kinds: most kinds kept, the latest used.
    """

    def __init__(self, device: Device, keep: int = 4, kinds: int = 8) -> None:
        self._device, self._keep, self._kinds = device, keep, kinds
        self._held: dict[tuple[tuple[int, ...], Any, bool], list[_Block]] = {}  # latest last

    def take(self, shape: tuple[int, ...], dtype: Any) -> tuple[Buffer, Array]:
        """Return a buffer and an array over its memory, with arbitrary content. The buffer is not handed out again
        while that array or a view of it lives."""
        block, array = self._lend(shape, dtype, with_buffer=True)
        assert block.buffer is not None
        return block.buffer, array

    def take_host(self, shape: tuple[int, ...], dtype: Any) -> Array:
        """Return an array as `take` does, of memory that no device sees."""
        return self._lend(shape, dtype, with_buffer=False)[1]

    def _lend(self, shape: tuple[int, ...], dtype: Any, *, with_buffer: bool) -> tuple[_Block, Array]:
        kind = shape, dtype, with_buffer
        held = self._held[kind] = self._held.pop(kind, [])
        while len(self._held) > self._kinds:
            del self._held[next(iter(self._held))]
        block = next((candidate for candidate in held if candidate.user() is None), None)
        if block is None:
            buffer = Buffer.empty(self._device, shape, dtype) if with_buffer else None
            block = _Block(aligned(shape, np.dtype(dtype)) if buffer is None else buffer.array, buffer)
            if len(held) < self._keep:
                held.append(block)
        user = _PooledArray(block.memory)
        block.user = weakref.ref(user)
        return block, np.asarray(user)
