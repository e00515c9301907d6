"""Stand-alone scripts that show a failure: NumPy and pyopencl alone, for the maker of a driver."""

from __future__ import annotations

import json
import re
import textwrap
from dataclasses import replace
from pathlib import Path

from ...base.arrays import Array
from ...base.atomic_files import write_bytes
from ...pipeline.opencl.device import Device
from .case import GROUP, UNWRITTEN, Case, Wrong

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
program.{name}(queue, {size}, {group}, *buffers, global_offset={offset})
cl.enqueue_copy(queue, found, buffers[-1])
same = found.view(f"u{{found.itemsize}}") == EXPECTED.view(f"u{{found.itemsize}}")
if found.dtype.kind == "f":
    same |= np.isnan(found) & np.isnan(EXPECTED)
if same.all():
    print("as expected")
    sys.exit(0)
for place in np.argwhere(~same)[:5]:
    at = tuple(place)
    print(f"out{{place.tolist()}}: expected {{EXPECTED[at]!r}}, found {{found[at]!r}}")
sys.exit(1)
'''


def _values(array: Array) -> str:
    """Return an array as Python source that gives the same bits."""
    if array.dtype.kind == "f":
        words = [hex(word) for word in array.reshape(-1).view(f"u{array.itemsize}").tolist()]
        kind = f"np.uint{8 * array.itemsize}).view(np.{array.dtype})"
    else:
        words, kind = [str(word) for word in array.reshape(-1).tolist()], f"np.{array.dtype})"
    lines = textwrap.fill(", ".join(words), 120, initial_indent=" " * 8, subsequent_indent=" " * 8)
    return f"np.array([\n{lines}\n    ], {kind}.reshape({array.shape})"


def cut(wrong: Wrong | Case) -> Case:
    """Return the case of the first work-group that has a wrong row; of a case that has not run, of the first one."""
    case, row = (wrong.case, int(wrong.rows.argmax())) if isinstance(wrong, Wrong) else (wrong, 0)
    if case.grid is not None:
        return case
    first = row - row % GROUP
    return replace(case, inputs=tuple(v[first : first + GROUP] for v in case.inputs))


def script(case: Case, device: Device, options: list[str]) -> str:
    """Return the script of a case. options: of the compiler, for every program."""
    grid = case.launched
    return _SCRIPT.format(
        title=case.title,
        device=f"{device.title}, driver {device.driver}",
        kernel=re.sub(r"\n{2,}", "\n", re.sub(r"(?m)^#line.*$", "", case.source)),
        options=json.dumps([*case.options, *options]),
        inputs="".join(f"    {_values(v)},\n" for v in case.inputs),
        expected=_values(case.expected()),
        unwritten=UNWRITTEN,
        name=case.name,
        size=grid.size,
        group=grid.group,
        offset=grid.offset,
    )


def write(wrong: Wrong | Case, device: Device, options: list[str], folder: Path, name: str) -> Path:
    """Write the script of a failure as NAME.py; return its path. Raises OutputError."""
    path = folder / f"{re.sub(r'[^A-Za-z0-9_]+', '_', name)}.py"
    write_bytes(path, script(cut(wrong), device, options).encode())
    return path
