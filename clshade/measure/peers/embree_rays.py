"""Intel Embree by embreex: a ray through each pixel's center, in the calling thread; NumPy interpolates and lights."""

from __future__ import annotations

import numpy as np

from ...scene.model import Scene
from ...scene.seen_points import pixel_rays
from ..bench.peers.embree import Embree
from .drawing import Picture, interpolated, lambert, mesh_of, picture_of


class Rays:
    """Rays from the eye; they reach a depth of 1 with each of their lengths, so that the hit's multiple is its depth."""

    def __init__(self, scene: Scene, samples: int) -> None:
        self._scene, self._deep = scene, samples == 1
        self._verts, self._normals, self._faces = mesh_of(scene)
        self._hierarchy = Embree(self._verts, self._faces)
        self.title = self._hierarchy.title
        rays, origins = pixel_rays(scene.camera)
        self._shape = rays.shape[:2]
        self._rays, self._origins = (
            np.ascontiguousarray(each.reshape(-1, 3), np.float32) for each in (rays / scene.camera.focal, origins)
        )

    def draw(self) -> Picture:
        face, second, third, depth = self._hierarchy.nearest(self._origins, self._rays)
        seen = face >= 0
        faces, depth = self._faces[face[seen]], depth[seen]
        points = self._origins[seen] + depth[:, None] * self._rays[seen]
        normals = interpolated(self._normals, faces, second[seen], third[seen])
        rgb = lambert(normals, points, self._scene)
        return picture_of(seen.reshape(self._shape), rgb, depth if self._deep else None)


def open_for(name: str, scene: Scene, samples: int, threads: int) -> Rays:
    return Rays(scene, samples)
