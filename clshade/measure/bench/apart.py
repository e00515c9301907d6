"""Draw one workload and print its figures as JSON: `python -m clshade.measure.bench.apart NAME DEVICE FRAMES`.

`bench` runs it for figures that need a process of their own, such as peak memory.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from dataclasses import replace

from ...errors import ClshadeError
from ...pipeline.opencl.device import open_device
from .frame_timing import draw
from .workloads import SCALING, WORKLOADS


def peak_mib() -> float | None:
    """Return the peak memory of this process; None if the system does not report it. (getrusage would include that of
    the process it was forked from.)"""
    try:
        with open("/proc/self/status") as file:
            found = re.search(r"VmHWM:\s*(\d+) kB", file.read())
    except OSError:
        return None
    return int(found[1]) / 1024.0 if found else None


def main(arguments: Sequence[str]) -> int:
    name, device, frames = arguments
    known = {**SCALING, **{each.name: each for each in WORKLOADS}}
    try:
        workload = known[name]
        drawn = draw(workload.make(), open_device(device, profiling=True), int(frames), options=workload.options)
    except ClshadeError as error:
        print(error, file=sys.stderr)
        return 2
    print(json.dumps(replace(drawn, peak_mib=peak_mib()).stats()))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
