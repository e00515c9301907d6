"""riley-raster: a software rasterizer in float64 for digital image correlation.

It knows no light, but interpolates fields of three channels given at the vertices. It draws their normals and their
positions, one after the other, and NumPy lights what they show.
"""

from __future__ import annotations

from importlib import metadata
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...scene.geometry import camera_axes
from ...scene.model import Scene
from ..bench.peers.peer import MissingPeer
from .drawing import Picture, lambert, mesh_of, picture_of

NOWHERE = 1e300  # what the image has where no triangle is


class Fields:
    def __init__(self, scene: Scene, samples: int, threads: int) -> None:
        riley = self._riley = _module()
        self.title = f"riley-raster {metadata.version('riley-raster')}"
        self._scene, self._deep = scene, samples == 1
        verts, normals, faces = mesh_of(scene)
        verts = verts.astype(np.float64)
        self._meshes = [_mesh(riley, verts, faces, field) for field in (normals, verts)]
        self._camera = _camera(riley, scene, verts.mean(axis=0))
        self._config = riley.RasterConfig(
            parallel=threads or None,  # None: of all processors
            save_strategy=riley.SaveStrategy.memory,
            report=riley.ReportMode.off,
            background_value=NOWHERE,
        )

    def draw(self) -> Picture:
        normals, points = (
            np.moveaxis(self._riley.raster(mesh, self._camera, self._config)[0, 0], 0, -1) for mesh in self._meshes
        )
        seen = (points != NOWHERE).all(axis=2)
        normals, points = normals[seen], points[seen]
        camera = self._scene.camera
        depth = (points - camera.eye) @ camera_axes(camera)[2] if self._deep else None
        return picture_of(seen, lambert(normals, points, self._scene), depth)


def _module() -> Any:
    try:
        import riley
    except ImportError:
        raise MissingPeer(
            "riley: riley-raster is not installed (pip install riley-raster, or clshade's extra `peers`)"
        ) from None
    return riley


def _mesh(riley: Any, verts: Array, faces: Array, field: Array) -> Any:
    form = riley.ConnectConvention(riley.EElemType.TRI3, riley.EConnectAxis.ROW, 0, riley.ENodeOrder.RILEY)
    of_nodes = np.ascontiguousarray(field, np.float64)[:, None, :]  # nodes, frames, channels
    shader = riley.NodalShader(field=of_nodes, scaling_type=riley.ScaleStrategy.none)
    return riley.create_mesh(form, riley.MeshType.tri3opt, verts, faces.astype(np.int64), shader)


def _camera(riley: Any, scene: Scene, middle: Array) -> Any:
    """Return the camera: one that looks along -z, turned about x, then y, then z, by angles that are given last to first."""
    camera = scene.camera
    (height, width), (columns, rows) = camera.plane, camera.resolution
    right, up, forward = camera_axes(camera)
    turn = np.stack([right, up, -forward], axis=1)
    angles = (
        np.arctan2(turn[1, 0], turn[0, 0]),
        np.arctan2(-turn[2, 0], np.hypot(turn[2, 1], turn[2, 2])),
        np.arctan2(turn[2, 1], turn[2, 2]),
    )
    return riley.Camera(
        pixels_num=(columns, rows),
        pixels_size=(width / columns, height / rows),
        pos_world=tuple(map(float, camera.eye)),
        rot_world=tuple(map(float, angles)),
        roi_cent_world=tuple(map(float, middle)),
        focal_length=camera.focal,
        sub_sample=1,
    )


def open_for(name: str, scene: Scene, samples: int, threads: int) -> Fields:
    return Fields(scene, samples, threads)
