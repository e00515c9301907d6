"""Expected results of the lighting stages in float64, for their own inputs: points, normals, colors and materials as
the kernels read them, owners as the fill stage found them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from kernel_stages import Pipeline, coefficients, float32, four, light_rows, material_rows, vertices_at

from clshade.oracle import OracleFrame, clip, coverage, frame, shade
from clshade.oracle.corners import gather
from clshade.oracle.lights import Interaction, Lights
from clshade.oracle.shade import Surface
from clshade.oracle.shot import Shot
from clshade.oracle.transform import SAMPLE_STEPS
from clshade.scene.camera import Camera
from clshade.scene.material import TERMS
from clshade.scene.model import Mesh, Scene, Settings

Array = np.ndarray
EXPONENTS = (1.0, 20.0, 200.0, 1e4)


@dataclass(frozen=True)
class Inputs:
    """Inputs of the pixel stages: F triangles without shared vertices, lights and materials.

    xy: (F, 3, 2) snapped. z: (F, 3). points, normals, colors: (F, 3, 3) float32; points are relative to the eye, in the
    image's axes. materials: struct_layout.SINGLE.Material rows. face_materials: (F,). lights:
    struct_layout.SINGLE.Light rows.
    """

    xy: Array
    z: Array
    points: Array
    normals: Array
    colors: Array
    materials: Array
    face_materials: Array
    lights: Array

    def arrays(self) -> dict[str, Array]:
        """Return the arguments of `Pipeline.draw`."""
        return {
            "normals": four(self.normals.reshape(-1, 3)),
            "colors": four(self.colors.reshape(-1, 3)),
            "face_materials": self.face_materials,
            "materials": self.materials,
            "lights": self.lights,
        }

    def set_up(self, pipeline: Pipeline) -> None:
        """Run the stages up to the tile lists."""
        vertices = vertices_at(pipeline.device, self.xy.reshape(-1, 2), self.z.reshape(-1), self.points.reshape(-1, 3))
        pipeline.set_up(vertices, np.arange(3 * len(self.z)).reshape(-1, 3))
        pipeline.sort()
        pipeline.bin()


def patches(resolution: tuple[int, int], count: int = 300, seed: int = 1) -> Inputs:
    """Return triangles of all sizes in front of the eye, lit from the sides, each with one of four materials, n of
    EXPONENTS.

    Normals point roughly towards the eye, so that many pixels have highlights, and are not quite of unit length.
    """
    rng = np.random.default_rng(seed)
    columns, rows = resolution
    z = rng.uniform(2.0, 4.0, (count, 1)) + rng.uniform(-0.5, 0.5, (count, 3))
    xy = rng.uniform(0, 1, (count, 1, 2)) + 0.25 * np.exp2(rng.uniform(-4, 1, (count, 1, 1))) * rng.normal(
        size=(count, 3, 2)
    )
    xy = np.rint(xy * [columns, rows] * coverage.SUBPIXELS).astype(np.int64)
    # A square image plane of side 1 at distance 1: a point at depth z has x = z * (u / columns - 1/2).
    flat = z[..., None] * (xy / (coverage.SUBPIXELS * np.array([columns, rows])) - 0.5)
    points = float32(np.concatenate([flat, z[..., None]], axis=2))
    normals = -points / np.linalg.norm(points, axis=2, keepdims=True) + 0.4 * rng.normal(size=(count, 3, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    materials = material_rows(len(EXPONENTS), n=EXPONENTS)
    for name in ("ambient", "k"):
        materials[name] = rng.uniform(0, 0.6, materials[name].shape)
    positions = float32([[0.3, 0.2, 0.1], [-2.0, 3.0, 1.0], [1.5, -2.0, 2.0]])
    return Inputs(
        xy=xy,
        z=as_kernels_see(z),
        points=points,
        normals=float32(normals),
        colors=float32(rng.uniform(0, 1, (count, 3, 3))),
        materials=materials,
        face_materials=np.resize(np.arange(len(EXPONENTS), dtype=np.int32), count),
        lights=light_rows(positions, float32([[1.0, 0.9, 0.8], [0.5, 0.1, 0.9], [0.2, 0.7, 0.3]])),
    )


def owners_of(xy: Array, z: Array, resolution: tuple[int, int], visibility: str, orthographic: bool = False) -> Array:
    """Return the oracle's owner of each pixel, -1 for none, (M, N), row 0 at the BOTTOM, of snapped triangles (F, 3,
    2)."""
    pieces = clip.Pieces(np.arange(len(xy)), xy, z, np.broadcast_to(np.eye(3), (len(xy), 3, 3)))
    faces = Mesh(np.zeros((3 * len(xy), 3)), np.arange(3 * len(xy)).reshape(-1, 3))
    camera = Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), 1.0, (1.0, 1.0), resolution, orthographic=orthographic)
    scene, settings = Scene((faces,), camera, ()), Settings(visibility=visibility)  # type: ignore[arg-type]
    shot = Shot(scene, settings, gather(scene), z, pieces, coverage.places(1)[0])
    row, column = np.divmod(np.arange(resolution[0] * resolution[1]), resolution[0])
    return frame.owners(shot, column, row).reshape(resolution[::-1])


SAMPLE = coverage.SUBPIXELS // SAMPLE_STEPS  # of the samples' grid


def seen_from(xy: Array, places: Array) -> list[Array]:
    """Return snapped corners (F, 3, 2) relative to each sample position (S, 2), 1/256 px, of a pixel: moved so that the
    sample is at the pixel's center."""
    return [xy + (coverage.HALF - SAMPLE * place) for place in places]


def hull(xy: Array, places: Array, resolution: tuple[int, int]) -> Array:
    """Return the union (F, 4) of the boxes of `coverage.setup` over all sample positions."""
    boxes = np.array([coverage.setup(moved, *resolution).box for moved in seen_from(xy, places)])
    return np.concatenate([boxes[..., :2].min(axis=0), boxes[..., 2:].max(axis=0)], axis=1)


def as_kernels_see(z: Array) -> Array:
    """Return depths whose reciprocals are float32, as the kernels see them."""
    return 1.0 / float32(1.0 / z).astype(np.float64)


def surface_of(inputs: Inputs, face: Array) -> Surface:
    """Return the materials of some faces in float64."""
    rows = inputs.materials[inputs.face_materials[face]]
    n, ambient = (rows[name].astype(np.float64) for name in ("n", "ambient"))
    return Surface(n, ambient, {name: k.astype(np.float64) for name, k in coefficients(rows).items()})


def light_of(inputs: Inputs) -> tuple[Array, Array]:
    return tuple(inputs.lights[name].astype(np.float64) for name in ("position", "intensity"))  # type: ignore[return-value]


def corner_points(inputs: Inputs, centroid: bool) -> Array:
    """Return the points (F, 3, 3) float64 at which the corners are lit."""
    points = inputs.points.astype(np.float64)
    return np.broadcast_to(points.mean(axis=1, keepdims=True), points.shape) if centroid else points


def owned(inputs: Inputs, owners: Array, interpolation: str) -> tuple[tuple[Array, Array], Array, Array]:
    """Return the covered pixels of owners (M, N), row 0 at the top: indices, faces (K,), corner weights (K, 3)."""
    at = np.nonzero(owners >= 0)
    face = owners[at]
    edges = coverage.edge_functions(inputs.xy[face], at[1], len(owners) - 1 - at[0])
    return at, face, shade.barycentrics(edges, inputs.z[face], interpolation)


def blend(weights: Array, values: Array) -> Array:
    return (weights[:, :, None] * values.astype(np.float64)).sum(axis=1)


def lit(point: Array, normal: Array, color: Array, surface: Surface, inputs: Inputs, extent: Array) -> dict[str, Array]:
    """Return the light without ambient at points (K, 3), and the quantities of its error bound."""
    length, lights = np.sqrt((normal * normal).sum(axis=-1)), Lights(*light_of(inputs))
    at = Interaction(point, normal, np.zeros(3), lights, extent, length)
    return {
        "rgb": color * shade.reflected(at, surface),
        "budget": shade.budget(color, surface, lights.intensities),
        "conditions": shade.conditions(at, shade.steepness(at, surface)),
        "jump": np.abs(color) * shade.jumps(at, surface),
        "exponent": surface.n,
    }


def phong(inputs: Inputs, owners: Array, *, centroid: bool, interpolation: str, tinted: bool) -> OracleFrame:
    """Return the image (M, N) of the phong stage, row 0 at the top, over black."""
    at, face, weights = owned(inputs, owners, interpolation)
    surface = surface_of(inputs, face)
    point = blend(weights, corner_points(inputs, centroid)[face])
    color = blend(weights, inputs.colors[face])
    extent = np.abs(inputs.points[face].astype(np.float64)).max(axis=(1, 2))
    light = lit(point, blend(weights, inputs.normals[face]), color, surface, inputs, extent)
    light["rgb"] = light["rgb"] + surface.ka_Ia * (color if tinted else 1.0)
    return as_frame(owners, at, face, light)


def gouraud_corners(inputs: Inputs, *, centroid: bool, tinted: bool) -> dict[str, Array]:
    """Return the light of each corner, without the ambient light not multiplied by a color: rgb (F, 3, 3) and the
    quantities of its error bound."""
    surface = surface_of(inputs, np.repeat(np.arange(len(inputs.z)), 3))
    point, normal, color = (
        a.astype(np.float64).reshape(-1, 3) for a in (corner_points(inputs, centroid), inputs.normals, inputs.colors)
    )
    extent = np.repeat(np.abs(inputs.points.astype(np.float64)).max(axis=(1, 2)), 3)
    light = lit(point, normal, color, surface, inputs, extent)
    if tinted:
        light["rgb"] = light["rgb"] + surface.ka_Ia * color
    return light


def as_frame(owners: Array, at: tuple[Array, Array], face: Array, covered: dict[str, Array]) -> OracleFrame:
    """Return an OracleFrame (M, N) with the values at the covered pixels, without Z."""
    shape = owners.shape
    planes = {
        "rgb": np.zeros((*shape, 3)),
        "budget": np.zeros((*shape, 3)),
        "conditions": np.ones((*shape, 4)),
        "jump": np.zeros((*shape, 3)),
        "exponent": np.ones(shape),
        "alpha_error": np.zeros(shape),
        "unsure": np.zeros(shape, bool),
    }
    for name, values in covered.items():
        planes[name][at] = values
    ids = np.zeros(shape, np.uint32)
    ids[at] = face + 1
    return OracleFrame(alpha=(ids > 0).astype(np.float64), id=ids, Z=np.full(shape, np.inf), **planes)


def only(frame: OracleFrame, inputs: Inputs, n: float) -> Array:
    """Return the pixels (M, N) bool whose material has exponent n."""
    return (frame.id > 0) & (frame.exponent == n)


def with_exponent(inputs: Inputs, n: float) -> Inputs:
    """Return the inputs with exponent n in all materials."""
    materials = inputs.materials.copy()
    materials["n"] = n
    return replace(inputs, materials=materials)


def options(**chosen: Any) -> dict[str, Any]:
    """Return features with every term of the light on, and those chosen."""
    parts = ("LIT", "AMBIENT", "POWER", "VERTEX_COLORS", "MATERIALS", "OWNERS")
    return {**dict.fromkeys((*parts, *(term.feature for term in TERMS.values())), 1), **chosen}
