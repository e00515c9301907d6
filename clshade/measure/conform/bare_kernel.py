"""One kernel of a caller's own text, launched by itself on NumPy arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl

from ...errors import DeviceError
from ...pipeline.buffers import aligned
from ...pipeline.opencl.device import Device


@dataclass(frozen=True)
class Grid:
    """Work-items of a launch. size: in each dimension. group: of a work-group, None: the runtime's choice."""

    size: tuple[int, ...]
    group: tuple[int, ...] | None = None


def launch(device: Device, kernel: Any, grid: Grid, arguments: Sequence[Any]) -> None:
    """Run a kernel and wait for it.

    arguments: NumPy arrays, each copied to device memory and back if it is writeable, and NumPy scalars.
    Raises DeviceError.
    """
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    arrays = {k: value for k, value in enumerate(arguments) if isinstance(value, np.ndarray)}
    try:
        buffers = {k: cl.Buffer(device.context, flags, hostbuf=array) for k, array in arrays.items()}
        kernel.set_args(*(buffers.get(k, value) for k, value in enumerate(arguments)))
        cl.enqueue_nd_range_kernel(device.queue, kernel, grid.size, grid.group)
        for k, array in arrays.items():
            if array.flags.writeable:
                cl.enqueue_copy(device.queue, array, buffers[k])
        device.queue.finish()
    except cl.Error as error:
        raise DeviceError(f"{device.name}: a kernel did not run: {' '.join(str(error).split())}") from error


def edge_bytes(device: Device, size: int) -> tuple[int, int]:
    """Allocate a buffer of `size` bytes, write 5 into its first byte and 7 into its last, and return what is read there.

    Raises DeviceError if the device refuses.
    """
    ends = aligned((2,), np.dtype(np.uint8))
    try:
        memory = cl.Buffer(device.context, cl.mem_flags.READ_WRITE, size)
        cl.enqueue_copy(device.queue, memory, np.array([5], np.uint8), dst_offset=0)
        cl.enqueue_copy(device.queue, memory, np.array([7], np.uint8), dst_offset=size - 1)
        cl.enqueue_copy(device.queue, ends[:1], memory, src_offset=0)
        cl.enqueue_copy(device.queue, ends[1:], memory, src_offset=size - 1)
        memory.release()
    except (cl.Error, MemoryError, OverflowError) as error:
        raise DeviceError(f"{device.name}: {size} bytes: {' '.join(str(error).split())}") from error
    return int(ends[0]), int(ends[1])
