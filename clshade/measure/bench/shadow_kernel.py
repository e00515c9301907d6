"""Our hierarchy and its kernel `shadow_rays`, as `bench --shadows` measures them."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from ...base.arrays import Array, Bools, Faces, Floats
from ...pipeline import hierarchy
from ...pipeline.opencl.device import Device
from .shadow_rays import Receivers


class ShadowKernel:
    """A mesh in our hierarchy on a device. seconds: that building took. bytes: of its buffers on the device."""

    def __init__(self, device: Device, verts: Floats, faces: Faces) -> None:
        self.title = device.title
        start = time.perf_counter()
        self._hierarchy = hierarchy.build(verts, faces, device)
        self.seconds = time.perf_counter() - start
        self.bytes = self._hierarchy.nbytes

    def tracing(self, rays: Receivers) -> Callable[[], Array]:
        """Return what traces all rays, lanes without one included: it returns (16 B,), 1 where the light is hidden, or
        (16 B, N)."""
        points, faces = rays.points.reshape(-1, 3), rays.faces.reshape(-1)
        if rays.ends is not None:
            fans = self._hierarchy.fans(points, faces, rays.ends.reshape(len(points), -1, 3))

            def trace_fans() -> Array:
                self._hierarchy.trace_fans(fans)
                return fans.dark.to_host()

            return trace_fans
        assert rays.light is not None
        on_device = self._hierarchy.rays(points, faces, np.append(rays.light, 1.0))

        def trace() -> Array:
            self._hierarchy.trace(on_device)
            return on_device.dark.to_host()

        return trace

    def shadowed(self, found: Array, rays: Receivers) -> Bools:
        """Return what `tracing` found as (K,) bool."""
        hidden: Bools = found[rays.asked.reshape(-1)].reshape(-1) != 0
        return hidden
