"""Intel Embree by embreex: the shadow rays of a mesh, traced in the calling thread."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from importlib import metadata
from typing import Any

import numpy as np

from ....base.arrays import Array, Bools, Faces, Floats, Floats32
from ..shadow_rays import Receivers
from .peer import MissingPeer

PIP = "pip install embreex, or clshade's extra `peers`"
# Embree has no notion of the face that a ray starts on: the ray begins this share of its length farther on.
START = 1e-4


class Embree:
    """A mesh in Embree's hierarchy, of float32 vertices.

    seconds: that building took. bytes: by which the process grew meanwhile; None where the system does not tell.
    Raises MissingPeer where embreex is not installed.
    """

    def __init__(self, verts: Floats, faces: Faces) -> None:
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError:
            raise MissingPeer(f"embree: embreex is not installed ({PIP})") from None
        self.title = f"Intel Embree by embreex {metadata.version('embreex')}"
        rounded, indices = verts.astype(np.float32), np.ascontiguousarray(faces, np.int32)
        before, start = resident_bytes(), time.perf_counter()
        self._scene: Any = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, rounded, indices)
        nowhere = np.zeros((1, 3), np.float32)
        self._scene.run(nowhere, np.ones((1, 3), np.float32), query="OCCLUDED")  # the first ray builds
        self.seconds = time.perf_counter() - start
        after = resident_bytes()
        self.bytes = None if before is None or after is None else after - before

    def tracing(self, rays: Receivers) -> Callable[[], Array]:
        """Return what traces all rays: it returns the faces that they meet, (K,), below 0 for none."""
        points, _, ends = rays.one_by_one()
        origins, directions = segments(points, ends)
        ends = np.ones(len(origins), np.float32)

        def trace() -> Array:
            found: Array = self._scene.run(origins, directions, dists=ends, query="OCCLUDED")
            return found

        return trace

    def nearest(self, origins: Array, directions: Array) -> tuple[Array, Array, Array, Array]:
        """Return what rays (K, 3), float32, meet first, (K,) each: the face, below 0 for none, the weights of its second and
        third corner, and the multiple of the direction."""
        found = self._scene.run(origins, directions, query="INTERSECT", output=True)
        return found["primID"], found["u"], found["v"], found["tfar"]

    def shadowed(self, found: Array, rays: Receivers) -> Bools:
        """Return what `tracing` found as (K,) bool."""
        return np.asarray(found) >= 0


def segments(points: Floats, light: Floats) -> tuple[Floats32, Floats32]:
    """Return where rays to a light (3,), or to points (K, 3), begin, and what leads from there to them, (K, 3) each."""
    towards = light - points
    return (points + START * towards).astype(np.float32), ((1.0 - START) * towards).astype(np.float32)


def resident_bytes() -> int | None:
    """Return the memory that this process holds; None where the system does not tell (Linux does)."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None
