"""Colors of pixels whose owner is known, with the inputs of the error measures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.model import Scene, Settings
from . import shade
from .color_map import MapColors, map_colors
from .corners import Corners, Texels, corner_colors, texels
from .transform import camera_frame
from .vectors import length


@dataclass(frozen=True, eq=False)
class Shaded:
    """Colors and measures per pixel: rgb, budget and jump (K, 3); conditions (K, 4); exponent (K,). See
    frame.OracleFrame."""

    rgb: Floats
    budget: Floats
    conditions: Floats
    jump: Floats
    exponent: Floats


@dataclass(frozen=True, eq=False)
class Lights:
    """Lights of non-zero intensity, relative to the eye: positions and intensities (L, 3)."""

    positions: Floats
    intensities: Floats


@dataclass(frozen=True, eq=False)
class Surface:
    """Materials of some faces: ka_Ia, kd, ks (U, 3), n (U,)."""

    ka_Ia: Floats
    kd: Floats
    ks: Floats
    n: Floats

    def __getitem__(self, index: object) -> Surface:
        return Surface(*(getattr(self, name)[index] for name in ("ka_Ia", "kd", "ks", "n")))


def scene_lights(scene: Scene) -> Lights:
    lit = [light for light in scene.lights if light.intensity.any()]
    positions = np.array([light.position - scene.camera.eye for light in lit]).reshape(-1, 3)
    return Lights(positions, np.array([light.intensity for light in lit]).reshape(-1, 3))


def surfaces(scene: Scene, mesh: Integers) -> Surface:
    """Return the materials of faces that belong to meshes `mesh` (U,)."""
    materials = [m.material for m in scene.meshes]
    ka_Ia = np.array([m.ka * scene.ambient for m in materials])
    kd, ks, n = (np.array([getattr(m, name) for m in materials]) for name in ("kd", "ks", "n"))
    return Surface(ka_Ia, kd, ks, n)[mesh]


def blend(weights: Floats, values: Floats) -> Floats:
    """Interpolate corner values (K, 3, C) at corner weights (K, 3): (K, C)."""
    a, b, c = (weights[:, corner, None] * values[:, corner] for corner in range(3))
    return (a + b) + c


@dataclass(frozen=True, eq=False)
class Batch:
    """Pixels to light. U faces are involved; pixel k lies on face where[k], at corner weights weights[k].

    points, normals, colors: (U, 3, 3) at the corners, relative to the eye. extent: (U,) largest coordinate there.
    texel: per pixel. mapped: per pixel, colors of scalars. tinted: whether the color multiplies the ambient light. turned:
    (K,) whether the normal is flipped. view: None, or the unit vector toward an orthographic camera, the same everywhere.
    gate: see `shade.jumps`.
    """

    points: Floats
    normals: Floats
    colors: Floats
    extent: Floats
    surface: Surface
    lights: Lights
    tinted: bool
    where: Integers
    weights: Floats
    texel: Texels
    mapped: MapColors
    turned: Bools
    view: Floats | None
    gate: float

    def eye(self, point: Floats) -> Floats:
        """Return the position of the eye for points (..., 3): the origin, as everything here is relative to it. An
        orthographic camera's is as far from the point as the scene is large: 1 away from a point at 1e15 would leave no
        digit of the direction."""
        if self.view is None:
            return np.zeros(3)
        far: Floats = point + self.view * np.ldexp(1.0, np.frexp(self.extent.max(initial=1e-300))[1])
        return far


def shade_pixels(
    scene: Scene,
    settings: Settings,
    corners: Corners,
    face: Integers,
    weights: Floats,
    behind: Bools,
    steps: tuple[Floats, Floats] | None = None,
    condition: Floats | float = 1.0,
) -> Shaded:
    """Shade pixels of faces `face` (K,) at weights (K, 3) of the faces' original corners. behind: (K,) bool, whether
    the face is seen from behind. steps: of the weights from pixel to pixel, see `corners.texels`. condition: (K,) how much
    rounding of positions in float64 is amplified in the weights."""
    two_sided = np.array([m.material.two_sided for m in scene.meshes], bool)[corners.mesh[face]]
    axes = camera_frame(scene.camera.eye, scene.camera.lookat, scene.camera.up)
    used, where = np.unique(face, return_inverse=True)
    colors = corner_colors(scene, settings, corners, used)
    texel = texels(scene, settings, corners, face, weights, steps)
    rounding = 2.0**-53 if settings.precision == "float64" else 2.0**-24
    unit = np.maximum(rounding, 2.0**-53 * condition) * np.ones(len(face))
    points = corners.world[used] - scene.camera.eye
    extent = np.abs(points).max(axis=(1, 2))
    if settings.lighting_at == "centroid":
        points = np.broadcast_to(points.mean(axis=1, keepdims=True), points.shape)
    batch = Batch(
        points=points,
        normals=corners.normals[used],
        colors=colors,
        extent=extent,
        surface=surfaces(scene, corners.mesh[used]),
        lights=scene_lights(scene),
        tinted=settings.ambient == "tinted",
        where=where,
        weights=weights,
        texel=texel,
        mapped=map_colors(scene, settings, corners, face, weights, unit),
        turned=behind & two_sided,
        view=-axes[2] if scene.camera.orthographic else None,
        gate=shade.FAST_GATE if settings.precision == "fast" else shade.GATE,
    )
    return {"nolight": _nolight, "gouraud": _gouraud, "phong": _phong}[settings.shader](batch)


def _nolight(batch: Batch) -> Shaded:
    """Return the colors themselves."""
    plain = blend(batch.weights, batch.colors[batch.where]) * batch.texel.color
    rgb = plain * batch.mapped.color
    worst_color = np.abs(batch.colors).max(axis=1)[batch.where] * batch.texel.most * batch.mapped.most
    budget = np.maximum(worst_color, 1.0)
    return Shaded(rgb, budget, np.ones((len(rgb), 4)), np.abs(plain) * batch.mapped.spread, np.ones(len(rgb)))


def _gouraud(batch: Batch) -> Shaded:
    """Light the corners, then interpolate. The texel multiplies all but the plain ambient light."""
    points, normals, where, lights = batch.points, batch.normals, batch.where, batch.lights
    ka_Ia, kd, ks, n = (s[:, None] for s in (batch.surface.ka_Ia, batch.surface.kd, batch.surface.ks, batch.surface.n))
    turned = np.zeros(len(points), bool)
    turned[where] = batch.turned  # all pixels of a face see the same side of it
    normals = np.where(turned[:, None, None], -normals, normals)
    eye = batch.eye(points)
    lit = shade.reflected(points, normals, eye, kd, ks, n, lights.positions, lights.intensities)
    factor = lit + ka_Ia if batch.tinted else lit
    plain = blend(batch.weights, (batch.colors * factor)[where]) * batch.texel.color
    rgb = plain * batch.mapped.color
    pixel = batch.surface[where]
    if not batch.tinted:
        rgb = rgb + pixel.ka_Ia
    place, parallel = (points, batch.extent[:, None], np.ones(1)), batch.view is not None
    steepness = shade.steepness(points, normals, n, eye, lights.positions)
    conditions = shade.conditions(*place, eye, lights.positions, parallel, steepness)
    worst = shade.condition_number(conditions).argmax(axis=1)
    conditions = np.take_along_axis(conditions, worst[:, None, None], axis=1)[:, 0]
    jump = shade.jumps(points, normals, *place[1:], n, eye, lights.positions, lights.intensities, parallel, batch.gate)
    jump = (jump * np.abs(ks)).max(axis=1)[where]
    worst_color = np.abs(batch.colors).max(axis=1)[where] * batch.texel.most * batch.mapped.most
    flips = np.abs(plain) * batch.mapped.spread
    budget = shade.budget(worst_color, pixel.ka_Ia, pixel.kd, pixel.ks, lights.intensities, batch.tinted)
    return Shaded(rgb, budget, conditions[where], jump * worst_color + flips, pixel.n)


def _phong(batch: Batch) -> Shaded:
    """Interpolate point, normal and color, then light each pixel."""
    where, lights, surface = batch.where, batch.lights, batch.surface[batch.where]
    point, normal = blend(batch.weights, batch.points[where]), blend(batch.weights, batch.normals[where])
    normal = np.where(batch.turned[:, None], -normal, normal)
    vertex_color = blend(batch.weights, batch.colors[where])
    plain = vertex_color * batch.texel.color
    color = plain * batch.mapped.color
    eye = batch.eye(point)
    lit = shade.reflected(point, normal, eye, surface.kd, surface.ks, surface.n, lights.positions, lights.intensities)
    factor = lit + surface.ka_Ia if batch.tinted else lit
    rgb = color * factor if batch.tinted else surface.ka_Ia + color * factor
    # Where all three corner normals are 0 nothing cancels: 0 is exact.
    normal_length = np.where((batch.normals != 0.0).any(axis=(1, 2))[where], length(normal), 1.0)
    extent, parallel = batch.extent[where], batch.view is not None
    steepness = shade.steepness(point, normal, surface.n, eye, lights.positions)
    conditions = shade.conditions(point, extent, normal_length, eye, lights.positions, parallel, steepness)
    gates = extent, normal_length, surface.n, eye, lights.positions, lights.intensities, parallel, batch.gate
    # Corners whose colors differ in sign are each rounded separately.
    most = blend(batch.weights, np.abs(batch.colors[where])) * batch.texel.most * batch.mapped.most
    jump = shade.jumps(point, normal, *gates) * np.abs(surface.ks) * most
    jump = jump + np.abs(plain * factor) * batch.mapped.spread
    budget = shade.budget(most, surface.ka_Ia, surface.kd, surface.ks, lights.intensities, batch.tinted)
    return Shaded(rgb, budget, conditions, jump, surface.n)
