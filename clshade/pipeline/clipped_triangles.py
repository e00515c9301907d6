"""Clipped triangles: found on the host, set up on the device."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array
from ..errors import InputError
from ..scene.camera import Camera
from ..scene.image_part import raster_of
from ..scene.model import MAX_FACES
from . import clip
from .buffers import Buffer
from .frame_state import SceneFrame
from .programs import running_time
from .struct_layout import MOST_DEPTH, Structs
from .triangle_source import Faces, Triangles, TriangleSource


def piece_table(
    points: Array,
    faces: Array,
    uvs: Array | None,
    camera: Camera,
    structs: Structs,
    *,
    near: float,
    scale: float,
    depth_test: bool,
) -> Array:
    """Clip faces to the near plane and the guard band: (C,) of `structs.Piece`.

    points: (K, 3, 3) the faces' corners, camera space, scene units. faces: (K,) their numbers. uvs: (K, 3, 4) texture
    coordinates of the corners as double-singles (u, v, low parts of u, v), or None. near: scene units. scale: of depths.
    depth_test: sort by the nearest corner of each piece, else by the mean depth of its face.
    """
    cut = clip.clip(points, camera, near)
    table = np.zeros(len(cut.source), structs.Piece)
    z = points[..., 2]
    if depth_test:
        table["key_depth"] = cut.points[..., 2].min(axis=1)
    else:
        table["key_depth"] = (((z[:, 0] + z[:, 1]) + z[:, 2]) / 3.0)[cut.source]
    z_scaled = np.minimum(cut.points[..., 2] * scale, MOST_DEPTH)
    w = -z_scaled if camera.orthographic else 1.0 / z_scaled
    table["w"], table["w_low"] = w, w - w.astype(structs.real)
    snapped = clip.snap(clip.image_positions(cut.points, camera), raster_of(camera))
    table["x"], table["y"] = snapped[..., 0], snapped[..., 1]
    table["face"] = faces[cut.source]
    weights = cut.weights.reshape(-1, 9)
    table["weights"], table["weights_low"] = weights, weights - weights.astype(structs.real)
    if uvs is not None:
        parts = uvs.astype(np.float64)
        uv = np.einsum("cjk,ckd->cjd", cut.weights, (parts[..., :2] + parts[..., 2:])[cut.source]).reshape(-1, 6)
        table["uv"], table["uv_low"] = uv, uv - uv.astype(structs.real)
    return table


class Clipping:
    """Clips the faces that the near plane or the guard band cuts.

    uvs, uv_faces: (T, 4) and (F, 3) texture coordinates, or None. depth_test: see `piece_table`.
    """

    def __init__(self, source: TriangleSource, uvs: Array | None, uv_faces: Array, *, depth_test: bool) -> None:
        self._source, self._uvs, self._uv_faces, self._depth_test = source, uvs, uv_faces, depth_test
        self._none = Buffer.empty(source.stages.device, 0, source.stages.structs.Piece)

    def nothing_clipped(self, visible: int) -> Triangles:
        """Return the source's triangles, so many of them visible, without pieces."""
        return Triangles(self._source.made, visible, self._none)

    def clip(self, frame: SceneFrame) -> Triangles:
        """Clip what the frame's setup listed, and set up the pieces. Raises InputError for more triangles than MAX_FACES."""
        source, stages, counters = self._source, self._source.stages, frame.read_counters()
        if not counters["to_clip"]:
            return self.nothing_clipped(int(counters["visible"]))
        start = running_time()
        faces = source.to_clip(int(counters["to_clip"]))
        table, sources = self._pieces(faces, frame)
        count = len(table)
        if source.room + count > MAX_FACES:
            limit = f"at most {MAX_FACES} triangles, pieces of clipped ones included"
            raise InputError(f"render: scene: expected {limit}, found {source.room} and {count} pieces")
        if source.make_room(count):
            with frame.counted.writing() as rows:
                rows[:] = 0
            source.set_up(frame)
        pieces = self._none
        if count:
            pieces = Buffer(stages.device, table)
            source.add_pieces(faces, sources)
            arguments = (pieces, frame.image, source.made, frame.counted, source.room, count, source.sides)
            stages.setup_pieces(*arguments)
            counters = frame.read_counters()
        frame.host_ms["clip"] = (running_time() - start) * 1e3
        return Triangles(source.made, int(counters["visible"]), pieces)

    def _pieces(self, faces: Faces, frame: SceneFrame) -> tuple[Array, Array]:
        """Return the table of pieces, (C,), and which of the faces each comes from."""
        space = frame.space
        table = piece_table(
            space.points(faces.corners),
            np.arange(len(faces.numbers)),
            None if self._uvs is None else self._uvs[self._uv_faces[faces.numbers]],
            space.camera,
            self._source.stages.structs,
            near=space.near,
            scale=space.scale,
            depth_test=self._depth_test,
        )
        sources = table["face"].copy()
        table["face"] = faces.numbers[sources]
        return table, sources
