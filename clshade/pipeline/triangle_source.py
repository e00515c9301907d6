"""Where a frame's triangles come from: the faces of a scene's meshes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Array, Floats, Integers
from . import host_projection
from .buffers import Buffer, TriangleBuffers, VertexBuffers, wait
from .features import needs
from .frame_state import FrameInFlight, SceneFrame
from .launches import Stages, items

Sides = Mapping[str, "Buffer | None"]
NO_SIDES: Sides = {"face_materials": None, "materials": None}


def project(stages: Stages, positions: Buffer, view: Buffer, vertices: VertexBuffers) -> Any:
    """Project the vertices. On a device without float64 the host does it, and there is no event."""
    if stages.device.has_fp64:
        count = len(positions.array)
        values = {"positions": positions, "view": view, "vertices": vertices.projected, "relative": vertices.relative}
        return stages.run("project", items(count), values, count=count)
    orthographic = needs(view.array[0]["needs"], "ORTHOGRAPHIC")
    with vertices.projected.writing() as projected, vertices.relative.writing() as relative:
        host_projection.project(positions.array, view.array[0], orthographic, projected, relative)
    return None


def set_up(
    stages: Stages, faces: Buffer, vertices: VertexBuffers, made: TriangleBuffers, values: Mapping[str, Any]
) -> Any:
    """Set up the triangles of faces, and write their keys. values: further arguments of the kernel by name."""
    device, count, means = stages.device, len(faces.array), None
    if not (device.has_fp64 or stages.features["DEPTH_TEST"]):
        z = vertices.projected.array["depth"][faces.array]
        means = Buffer(device, ((z[:, 0] + z[:, 1]) + z[:, 2]) / 3.0)
    inputs = {**values, "faces": faces, "vertices": vertices.projected, "mean_depths": means}
    size = stages.runs(count, device.setup_run)
    event = stages.run("setup", size, {**inputs, **made.values}, keys=made.keys, count=count)
    if means is not None:
        wait(device, [event])  # `means` is freed on return
    return event


def set_up_pieces(
    stages: Stages,
    pieces: Buffer,
    frame: FrameInFlight,
    made: TriangleBuffers,
    face_count: int,
    sides: Sides = NO_SIDES,
) -> None:
    """Set up the triangles of pieces, (C,) of structs.Piece, after those of so many faces."""
    count = len(pieces.array)
    values = {**frame.values, **made.values, **sides, "pieces": pieces, "face_count": face_count}
    size = items(count, stages.lanes_of("setup_pieces"))
    stages.run("setup_pieces", size, values, keys=made.keys, count=count)


@dataclass(frozen=True)
class Triangles:
    """The triangles of a frame, T of them: those of faces, then the pieces of clipped ones.

    made: where they are set up. visible: number of those that may be seen. pieces: (C,) of structs.Piece.
    """

    made: TriangleBuffers
    visible: int
    pieces: Buffer


@dataclass(frozen=True)
class Faces:
    """Faces to clip, C of them, in order. corners: (C, 3, 3) world space. numbers: (C,). instances: (C,) those that have
    them, None for faces of the scene."""

    corners: Floats
    numbers: Integers
    instances: Integers | None = None


class TriangleSource(ABC):
    """Projects a scene's vertices and sets up its triangles, in memory that is kept from frame to frame.

    room: number of faces that there is memory for at first. made: the memory of faces, and of pieces of clipped ones.
    sides: face_materials and materials, None unless some material is drawn from the front only. culled: triangles that were
    found outside of the view before they were set up, by the counter that they are added to.
    """

    def __init__(self, stages: Stages, room: int, sides: Sides) -> None:
        self.stages, self.sides, self.culled = stages, sides, dict[str, int]()
        self.made = self._buffers(room, 0)

    @property
    def room(self) -> int:
        """Number of faces that there is memory for; pieces follow them."""
        return len(self.made.to_clip.array)

    def _buffers(self, room: int, pieces: int) -> TriangleBuffers:
        structs, slack = self.stages.structs, self.stages.lanes
        return TriangleBuffers(self.stages.device, room, pieces, structs, slack=slack)

    def make_room(self, pieces: int) -> bool:
        """Make room for pieces, with a margin for the next camera. Return whether there was not enough: then nothing is set
        up any more."""
        if pieces <= self.made.piece_capacity:
            return False
        self.made = self._buffers(self.room, pieces + pieces // 2)
        return True

    @property
    def nbytes(self) -> int:
        """Size of memory that depends on how many triangles are seen."""
        return 0

    @abstractmethod
    def sizes(self) -> dict[str, int]:
        """Return the numbers of triangles and vertices, those of all instances."""

    @abstractmethod
    def inputs(self, frame: SceneFrame) -> dict[str, Buffer]:
        """Return the inputs of the pixel stages that come from here, by name."""

    @abstractmethod
    def project(self, frame: SceneFrame) -> None:
        """Enqueue the projection of the vertices."""

    @abstractmethod
    def set_up(self, frame: SceneFrame) -> None:
        """Enqueue the setup of the triangles, whose keys are written; the frame's counters are 0 before."""

    @abstractmethod
    def to_clip(self, count: int) -> Faces:
        """Return the faces that setup listed to be clipped."""

    @abstractmethod
    def add_pieces(self, faces: Faces, sources: Integers) -> None:
        """Note which of the faces each of the pieces comes from, (C,)."""

    @abstractmethod
    def painter_depths(self, triangles: Triangles, index: Array) -> tuple[Floats, Integers]:
        """Return the exact painter's depths of the triangles in `index`, and numbers in the order of their faces."""

    @abstractmethod
    def faces_of(self, triangles: Triangles, index: Array) -> Integers:
        """Return the faces of the triangles in `index`."""


class SceneFaces(TriangleSource):
    """The triangles of a scene's faces, each with its own vertices.

    positions: (V, 3) and faces: (F, 3) of the scene. vertices: projected.
    """

    def __init__(self, stages: Stages, positions: Buffer, faces: Buffer, sides: Sides) -> None:
        super().__init__(stages, len(faces.array), sides)
        self.positions, self.faces = positions, faces
        self.vertices = VertexBuffers(stages.device, len(positions.array), stages.structs)

    def sizes(self) -> dict[str, int]:
        return {"triangles": self.room, "vertices": len(self.positions.array)}

    def inputs(self, frame: SceneFrame) -> dict[str, Buffer]:
        return {"relative": self.vertices.relative, "vertices": self.vertices.projected}

    def project(self, frame: SceneFrame) -> None:
        if self.room:
            frame.events["project"] = project(self.stages, self.positions, frame.tables.view, self.vertices)

    def set_up(self, frame: SceneFrame) -> None:
        if self.room:
            values = {**frame.values, **self.sides}
            frame.events["setup"] = set_up(self.stages, self.faces, self.vertices, self.made, values)

    def to_clip(self, count: int) -> Faces:
        numbers = np.sort(self.made.to_clip.to_host(count))
        return Faces(self.positions.array[self.faces.array[numbers]], numbers)

    def add_pieces(self, faces: Faces, sources: Integers) -> None:
        """Do nothing: the table of pieces holds their faces."""

    def painter_depths(self, triangles: Triangles, index: Array) -> tuple[Floats, Integers]:
        depth, whole = np.empty(len(index)), index < self.room
        z = self.vertices.projected.to_host()["depth"][self.faces.array[index[whole]]]
        depth[whole] = ((z[:, 0] + z[:, 1]) + z[:, 2]) / 3.0
        depth[~whole] = triangles.pieces.array["key_depth"][index[~whole].astype(np.int64) - self.room]
        return depth, self.faces_of(triangles, index)

    def faces_of(self, triangles: Triangles, index: Array) -> Integers:
        face: Integers = index.astype(np.int64)
        pieces = face >= self.room
        if pieces.any():
            face[pieces] = triangles.pieces.array["face"][face[pieces] - self.room]
        return face
