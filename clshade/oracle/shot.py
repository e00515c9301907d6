"""A scene as the samples of pixels see it, and where they meet its triangles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.model import Scene, Settings
from . import coverage, shade, transform
from .clip import Pieces, pieces
from .corners import Corners, gather


@dataclass(frozen=True, eq=False)
class Shot:
    """A scene as one sample of each pixel sees it."""

    scene: Scene
    settings: Settings
    corners: Corners  # of all faces
    z: Floats  # (F, 3) their depths
    pieces: Pieces  # to draw, moved so that the sample is at the pixel's center
    place: Integers  # (2,) of the sample, 1/256 px from the pixel's lower left corner

    @cached_property
    def backs_culled(self) -> Bools:
        """(F,) the faces that are drawn from the front only."""
        return self.settings.cull | self.corners.of_meshes(lambda mesh: mesh.material.sides == "front")

    @cached_property
    def setup(self) -> coverage.Setup:
        return coverage.setup(self.pieces.xy, *self.scene.camera.resolution, self.backs_culled[self.pieces.face])

    @cached_property
    def drawn(self) -> Integers:
        """The pieces that are not culled."""
        return np.flatnonzero(~self.setup.culled)

    @cached_property
    def interpolation(self) -> str:
        return "affine" if self.scene.camera.orthographic else self.settings.interpolation

    def weights(self, piece: Integers, edges: Integers, interpolation: str | None = None) -> Floats:
        """Return weights (K, 3) of the original corners at pixels of pieces (K,) with edge functions (K, 3)."""
        on_piece = shade.barycentrics(edges, self.pieces.z[piece], interpolation or self.interpolation)
        return np.asarray((on_piece[:, :, None] * self.pieces.weights[piece]).sum(axis=1))

    @cached_property
    def samples(self) -> list[Shot]:
        """The scene as each sample sees it, nearest to the center first, if this is the center's."""
        places, xy = coverage.places(self.settings.samples), self.pieces.xy
        return [replace(self, pieces=replace(self.pieces, xy=moved(xy, place)), place=place) for place in places]


def prepare(scene: Scene, settings: Settings) -> Shot:
    """Run the stages before the pixels: placement, camera, clipping, projection, snapping."""
    corners = gather(scene, None if settings.scalars is None else settings.scalars.name, bent=settings.shadows)
    points = transform.to_camera(corners.world, scene.camera)
    near = transform.near_distance(corners.world.reshape(-1, 3), scene.camera, settings.near)
    cut = pieces(points, near, scene.camera)
    return Shot(scene, settings, corners, points[:, :, 2], cut, coverage.places(1)[0])


def moved(xy: Integers, place: Integers) -> Integers:
    """Return corners (..., 3, 2) relative to a sample at a place (..., 2), as if it were at the pixel's center."""
    return xy + (coverage.HALF - place * (transform.SUBPIXELS // transform.SAMPLE_STEPS))


@dataclass(frozen=True, eq=False)
class Hits:
    """Where K pixels meet pieces."""

    shot: Shot  # as the pixels' centers see it
    piece: Integers
    column: Integers
    row: Integers  # from the BOTTOM
    place: Integers  # (K, 2) in the pixel, 1/256 px
    edges: Integers  # (K, 3) edge functions there

    @classmethod
    def at(cls, shot: Shot, piece: Integers, column: Integers, row: Integers, place: Integers) -> Hits:
        edges = coverage.edge_functions(moved(shot.pieces.xy[piece], place[:, None]), column, row)
        # The mean of samples in a line, rounded, may lie beside their triangle.
        return cls(shot, piece, column, row, place, np.maximum(edges, 0))

    @cached_property
    def face(self) -> Integers:
        return self.shot.pieces.face[self.piece]

    @cached_property
    def mesh(self) -> Integers:
        return self.shot.corners.mesh[self.face]

    @cached_property
    def depth(self) -> Floats:
        return shade.depth(self.edges, self.shot.pieces.z[self.piece], self.shot.scene.camera.orthographic)

    @cached_property
    def weights(self) -> Floats:
        return self.shot.weights(self.piece, self.edges)

    @cached_property
    def steps(self) -> tuple[Floats, Floats] | None:
        """Derivatives of the weights from pixel to pixel, to the right and up, (K, 3) each; None if textures are
        bilinear."""
        if self.shot.settings.texture_filter != "trilinear":
            return None
        cut, column, row = self.shot.pieces, self.column, self.row
        xy = moved(cut.xy[self.piece], self.place[:, None])
        edges = coverage.edge_functions(xy, column, row)
        derivatives = []
        for columns, rows in ((1, 0), (0, 1)):
            # Edge functions are linear: the next pixel's differ from this one's by their derivative.
            change = coverage.edge_functions(xy, column + columns, row + rows) - edges
            on_piece = shade.barycentric_steps(np.maximum(edges, 0), change, cut.z[self.piece], self.shot.interpolation)
            derivatives.append((on_piece[:, :, None] * cut.weights[self.piece]).sum(axis=1))
        return derivatives[0], derivatives[1]

    @cached_property
    def behind(self) -> Bools:
        """(K,) where the face is seen from behind."""
        return np.asarray(self.shot.setup.area[self.piece] < 0)

    @cached_property
    def turned(self) -> Bools:
        """(K,) where the normals are flipped: on the back of a two-sided material."""
        return self.behind & self.shot.corners.of_meshes(lambda mesh: mesh.material.two_sided)[self.face]

    @cached_property
    def position(self) -> Integers:
        """(K, 2) in the image, 1/256 px, y up."""
        return np.asarray(transform.SAMPLE_STEPS * np.stack([self.column, self.row], axis=1) + self.place)

    @cached_property
    def reach(self) -> Floats:
        """(K,) the largest coordinate of the face's corners relative to the eye."""
        return np.asarray(np.abs(self.shot.corners.world[self.face] - self.shot.scene.camera.eye).max(axis=(1, 2)))

    @cached_property
    def condition(self) -> Floats:
        """How much rounding of camera-space positions in float64 is amplified in the weights, (K,), at least 1.

        A depth is accurate to 2^-53 of `reach`, and so 1/z to reach/z of itself. Where an edge crosses the near plane is a
        quotient by the difference of its depths.
        """
        nearest = self.shot.pieces.z[self.piece].min(axis=1)
        condition = np.ones(len(nearest))
        if not self.shot.scene.camera.orthographic:
            condition = np.fmax(self.reach / nearest, 1.0)
        clipped = (self.shot.pieces.weights[self.piece] != np.eye(3)).any(axis=(1, 2))
        depths = self.shot.z[self.face].T
        for a, b in zip(depths, np.roll(depths, -1, axis=0), strict=True):
            crosses = clipped & ((a < nearest) != (b < nearest))
            with np.errstate(divide="ignore", invalid="ignore"):
                condition = np.where(crosses, np.fmax(condition, self.reach / np.abs(a - b)), condition)
        return condition
