"""Where a frame's triangles come from: the faces of a scene's meshes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base.arrays import Array, Floats, Integers
from .buffers import Buffer, TriangleBuffers, VertexBuffers, wait
from .clip import project_on_host
from .launches import FrameInFlight, SceneFrame, Stages, items


class Faces(NamedTuple):
    """Faces to clip, in order."""

    corners: Floats  # (C, 3, 3), world space
    numbers: Integers  # (C,)
    instances: Integers | None = None  # (C,), those that have them, None for faces of the scene


class TriangleSource:
    """Projects a scene's vertices and sets up the triangles of its faces, in memory that is kept from frame to frame.

    positions: (V, 3) and faces: (F, 3) of the scene. vertices: projected. made: the memory of faces, and of pieces of
    clipped ones. sizes: the numbers of triangles and vertices, those of all instances. culled: triangles outside of the view
    that are not even set up, by the counter that they are added to.
    """

    def __init__(self, stages: Stages, positions: Buffer, faces: Buffer, room: int | None = None) -> None:
        """room: faces that there is memory for at first, but none for vertices; None: all, and their vertices."""
        self.stages, self.positions, self.faces, self.culled = stages, positions, faces, dict[str, int]()
        self.vertices = VertexBuffers(stages.device, len(positions.array) if room is None else 0, stages.structs)
        self.make_memory(len(faces.array) if room is None else room)
        self.sizes = {"triangles": len(faces.array), "vertices": len(positions.array)}

    @property
    def room(self) -> int:
        """Number of faces that there is memory for; pieces follow them."""
        return len(self.made.to_clip.array)

    def make_memory(self, room: int, pieces: int = 0) -> None:
        """Replace the memory by one for so many faces and pieces of clipped ones."""
        stages = self.stages
        self.made = TriangleBuffers(stages.device, room, pieces, stages.structs, slack=stages.lanes)

    @property
    def nbytes(self) -> int:
        """Size of memory that depends on how many triangles are seen."""
        return 0

    def project(self, frame: SceneFrame) -> None:
        """Enqueue the projection of the vertices; on a device without float64 the host does it, and there is no event."""
        vertices, values, count = self.vertices, frame.values, len(self.positions.array)
        values |= {"vertices": vertices.projected, "relative": vertices.relative}
        if not self.room:
            return
        if self.stages.device.has_fp64:
            own = {"positions": self.positions, "count": count}
            frame.events["project"] = self.stages.run("project", items(count), values, **own)
        else:
            with vertices.projected.writing() as projected, vertices.relative.writing() as relative:
                project_on_host(self.positions.array, frame.space, projected, relative)
            frame.events["project"] = None

    def set_up(self, frame: SceneFrame) -> None:
        """Enqueue the setup of the triangles, whose keys are written; the frame's counters are 0 before."""
        stages, count, means = self.stages, self.room, None
        frame.values |= {**self.made.values, "keys": self.made.keys, "sorted": self.made.sorted_bounds}
        if not count:
            return
        if not (stages.device.has_fp64 or stages.features["DEPTH_TEST"]):
            means = Buffer(stages.device, self.mean_depths(self.vertices.projected.array, slice(None)))
        size = stages.runs(count, stages.device.setup_run)
        frame.events["setup"] = stages.run("setup", size, frame.values, mean_depths=means, count=count)
        if means is not None:
            wait(stages.device, [frame.events["setup"]])  # `means` is freed on return

    def mean_depths(self, projected: Array, which: Array | slice) -> Floats:
        """Return the mean depths of the corners of some faces, from projected vertices."""
        z = projected["depth"][self.faces.array[which]]
        means: Floats = ((z[:, 0] + z[:, 1]) + z[:, 2]) / 3.0
        return means

    def to_clip(self, count: int) -> Faces:
        """Return the faces that setup listed to be clipped."""
        numbers = np.sort(self.made.to_clip.to_host(count))
        return Faces(self.positions.array[self.faces.array[numbers]], numbers)

    def add_pieces(self, faces: Faces, sources: Integers) -> None:
        """Note which of the faces each of the pieces comes from, (C,). The table of pieces holds faces of the scene."""

    def painter_depths(self, frame: FrameInFlight, index: Array) -> tuple[Floats, Integers]:
        """Return the exact painter's depths of the triangles in `index`, and numbers in the order of their faces."""
        depth, whole = np.empty(len(index)), index < self.room
        depth[whole] = self.mean_depths(self.vertices.projected.to_host(), index[whole])
        depth[~whole] = frame.values["pieces"].array["key_depth"][index[~whole].astype(np.int64) - self.room]
        return depth, self.faces_of(frame, index)

    def faces_of(self, frame: FrameInFlight, index: Array) -> Integers:
        """Return the faces of the triangles in `index`."""
        face: Integers = index.astype(np.int64)
        pieces = face >= self.room
        if pieces.any():
            face[pieces] = frame.values["pieces"].array["face"][face[pieces] - self.room]
        return face


def set_up_pieces(stages: Stages, pieces: Buffer, frame: FrameInFlight, face_count: int) -> None:
    """Set up the triangles of pieces, (C,) of structs.Piece, after those of so many faces."""
    count, size = len(pieces.array), items(len(pieces.array), stages.lanes_of("setup_pieces"))
    frame.values["pieces"] = pieces
    stages.run("setup_pieces", size, frame.values, face_count=face_count, count=count)
