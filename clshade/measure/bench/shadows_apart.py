"""Trace the shadow rays of one workload and print the figures as JSON:
`python -m clshade.measure.bench.shadows_apart NAME DEVICE ROUNDS`.

`bench --shadows` runs it for a process that has one processor, so that neither renderer has more than one thread at work.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from functools import partial

from ...errors import ClshadeError
from ...pipeline.opencl.device import open_device
from .peers.embree import Embree
from .shadow_kernel import ShadowKernel
from .shadow_rays import WORKLOADS
from .shadows import measure


def main(arguments: Sequence[str]) -> int:
    name, device, rounds = arguments
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    try:
        opened = open_device(device, profiling=True)
        (workload,) = (each for each in WORKLOADS if each.name == name)
        found = measure(workload, opened, partial(ShadowKernel, opened), Embree, int(rounds))
    except ClshadeError as error:
        print(error, file=sys.stderr)
        return 2
    print(json.dumps(found.stats()))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
