"""Stand-alone scripts that show a failure: NumPy and pyopencl alone, for the maker of a driver."""

from __future__ import annotations

import re
import textwrap
from dataclasses import replace
from pathlib import Path

from ...base.arrays import Array
from ...base.atomic_files import write_bytes
from ...pipeline import programs
from ...pipeline.opencl.device import Device
from .case import GROUP, UNWRITTEN, Case

_SCRIPT = '''\
"""{title}

Found by `clshade conform` on {device}.
Run it with the number of a platform and of a device, 0 0 by default. Exit code 1: the device is at fault; 0: it is not.
"""

import sys

import numpy as np
import pyopencl as cl

KERNEL = r"""
{kernel}"""
OPTIONS = {options}
INPUTS = [
{inputs}]
EXPECTED = {expected}

platform, device = (int(word) for word in (sys.argv[1:] or ["0", "0"]))
device = cl.get_platforms()[platform].get_devices()[device]
print(device.platform.name, "|", device.name, "|", device.driver_version)
context = cl.Context([device])
queue = cl.CommandQueue(context)
program = cl.Program(context, KERNEL).build(OPTIONS)
flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
found = np.full(EXPECTED.nbytes, {unwritten}, np.uint8).view(EXPECTED.dtype).reshape(EXPECTED.shape)
buffers = [cl.Buffer(context, flags, hostbuf=array) for array in (*INPUTS, found)]
program.{name}(queue, {size}, {group}, *buffers)
cl.enqueue_copy(queue, found, buffers[-1])
same = found.view(f"u{{found.itemsize}}") == EXPECTED.view(f"u{{found.itemsize}}")
if found.dtype.kind == "f":
    same |= np.isnan(found) & np.isnan(EXPECTED)
if same.all():
    print("as expected")
    sys.exit(0)
for at in map(tuple, np.argwhere(~same)[:5].tolist()):
    print(f"out{{list(at)}}: expected {{EXPECTED[at]!r}}, found {{found[at]!r}}")
sys.exit(1)
'''


def _values(array: Array) -> str:
    """Return an array as Python source that gives the same bits."""
    bits = f"uint{8 * array.itemsize}"
    words = ", ".join(hex(word) for word in array.reshape(-1).view(bits).tolist())
    lines = textwrap.fill(words, 120, initial_indent=" " * 8, subsequent_indent=" " * 8)
    return f"np.array([\n{lines}\n    ], np.{bits}).view(np.{array.dtype}).reshape({array.shape})"


def write(case: Case, row: int, device: Device, folder: Path, name: str) -> str:
    """Write the script of a case with the work-group of a row; return its name. Raises OutputError."""
    first = row - row % GROUP
    case = replace(case, inputs=tuple(v[first : first + GROUP] for v in case.inputs))
    path = folder / f"{re.sub(r'[^A-Za-z0-9_]+', '_', name)}.py"
    text = _SCRIPT.format(
        title=case.title,
        device=f"{device.title}, driver {device.driver}",
        kernel=re.sub(r"(?m)^#line.*\n+", "", case.source),
        options=[*case.options, *programs.compiler_options(device)],
        inputs="".join(f"    {_values(v)},\n" for v in case.inputs),
        expected=_values(case.expected()),
        unwritten=UNWRITTEN,
        name=case.name,
        size=case.grid.size,
        group=case.grid.group,
    )
    write_bytes(path, text.encode())
    return path.name
