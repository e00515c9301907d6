"""Draw many instances of one mesh and print the figures as JSON:
`python -m clshade.measure.bench.instances_apart WAY COUNT DEVICE FRAMES`.

`bench --instances` runs it for figures that need a process of their own, such as peak memory.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...base.arrays import Floats
from ...errors import ClshadeError
from ...pipeline import instances
from ...pipeline.opencl.device import open_device
from ...pipeline.renderer import Renderer
from ...scene.builtin.scenes import builtin
from ...scene.camera import Camera
from ...scene.model import Scene
from .apart import peak_mib
from .frame_timing import cameras

RESOLUTION = (640, 480)
_OPTIONS: dict[str, Any] = {"shader": "phong", "layers": ("id",)}


def placements(count: int) -> tuple[Floats, int]:
    """Return placements (K, 4, 4) in a cube of unit cells, turned and scaled at random, and how many cells its sides
    have."""
    rng = np.random.default_rng(1)
    turns = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    side = int(np.ceil(count ** (1 / 3)))
    found = np.tile(np.eye(4), (count, 1, 1))
    found[:, :3, :3] = turns * rng.uniform(0.1, 0.35, (count, 1, 1))
    found[:, :3, 3] = np.stack(np.unravel_index(np.arange(count), (side, side, side)), axis=1)
    return found, side


def crowd(count: int) -> Scene:
    """Return so many balls of 80 triangles."""
    source = builtin("icosphere", level=1)
    (mesh,) = source.meshes
    matrices, side = placements(count)
    middle = np.full(3, (side - 1) / 2)
    eye = middle + side * np.array([-1.2, 0.9, -1.5])
    camera = Camera(eye, middle, (0, 1, 0), 1.0, (0.9, 1.2), RESOLUTION)
    return Scene([replace(mesh, instances=matrices)], camera, source.lights, source.ambient)


def main(arguments: Sequence[str]) -> int:
    way, count, device, frames = arguments
    instances.LEAST_COPIES = 0 if way == "one" else sys.maxsize
    try:
        opened, scene = open_device(device or None, profiling=True), crowd(int(count))
        with Renderer(crowd(2), device=opened, **_OPTIONS) as renderer:
            renderer.render()  # loads the kernels
        start = time.perf_counter()
        with Renderer(scene, device=opened, **_OPTIONS) as renderer:
            loaded = time.perf_counter()
            frame = renderer.render()
            first = time.perf_counter()
            digest = hashlib.sha256(frame.rgba.tobytes() + frame["id"].tobytes()).hexdigest()
            stats = frame.stats
            del frame  # releases its memory for the next
            times = []
            for camera in cameras(scene.camera)[: int(frames)]:
                before = time.perf_counter()
                renderer.render(camera)
                times.append(time.perf_counter() - before)
    except ClshadeError as error:
        print(error, file=sys.stderr)
        return 2
    found = {
        "way": way,
        "instances": int(count),
        "triangles": stats["triangles"],
        "visible": stats["visible"],
        "load_s": loaded - start,
        "first_s": first - loaded,
        "next_ms": float(np.median(times)) * 1e3,
        "peak_mib": peak_mib(),
        "digest": digest,
    }
    print(json.dumps(found))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
