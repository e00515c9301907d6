"""Colors of pixels whose owner is known, with the inputs of the error measures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.model import Environment, Light, Scene, Settings
from . import ambient_occlusion, environment, light_points, microfacet, shade, shadows, transparency
from .color_map import MapColors, map_colors
from .corners import Corners, Texels, corner_colors, texels
from .lights import Shape, position_of, shape_of
from .lights import each as light_each
from .lights import place as place_of
from .maps import Maps, maps, turned_length, turned_normals
from .terms import RIGHT, Steps, Surface
from .transform import camera_frame
from .vectors import length, unit


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
    """Lights of non-zero intensity, relative to the eye: positions (see `lights.position_of`) and intensities (L, 3)."""

    positions: Floats
    intensities: Floats
    shapes: tuple[Shape, ...] = ()


def scene_lights(scene: Scene, settings: Settings, at: tuple[Integers, Integers] | None = None) -> Lights:
    """Return the lights as pixels see them. at: x and y (K,) where these are lit, 1/256 px; None for corners of faces."""
    lit = [light for light in scene.lights if light.intensity.any()]
    positions = np.array([position_of(light, scene.camera.eye) for light in lit]).reshape(-1, 3)
    shapes = (shape_of(light, settings.light_samples) for light in lit)
    shift = 0 if at is None else light_points.shifts(np.stack(at, axis=-1))
    shapes = (replace(shape, shift=shift) if shape.points else shape for shape in shapes)
    return Lights(positions, np.array([light.intensity for light in lit]).reshape(-1, 3), tuple(shapes))


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
    facets: (U,) parameters of shader pbr. reach: see `microfacet.REACH`. tangents: (U, 3, 4) at the corners. maps: per
    pixel. environment: of the scene, if it has one. seen: what reaches the pixels, or with shader gouraud the corners
    (U, 3); None without shadows. bends: (U, 3), see `corners.placed_bends`. open: what of the ambient light reaches the
    pixels, or with shader gouraud and `tinted` the corners; None without ambient occlusion.
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
    facets: microfacet.Facets
    reach: float
    tangents: Floats
    maps: Maps
    environment: Environment | None
    seen: shadows.Visibility | None = None
    bends: Floats | None = None
    open: ambient_occlusion.Openness | None = None
    light: Steps = RIGHT

    def flips(self, color: Floats) -> Floats:
        """Return by how much rounding may change the color (K, 3), times texel and color of scalars, where it decides which
        color those are."""
        of_texel = np.abs(color) * self.mapped.most * self.texel.spread
        total: Floats = np.abs(color * self.texel.color) * self.mapped.spread + of_texel
        return total

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
    at: tuple[Integers, Integers] | None = None,
    light: Steps = RIGHT,
) -> Shaded:
    """Shade pixels of faces `face` (K,) at weights (K, 3) of the faces' original corners. behind: (K,) bool, whether
    the face is seen from behind. steps: of the weights from pixel to pixel, see `corners.texels`. condition: (K,) how much
    rounding of positions in float64 is amplified in the weights. at: x and y (K,) of the samples, 1/256 px, y up, if there
    are shadows or lights of finite size. light: how it is computed, by shaders gouraud and phong."""
    two_sided = np.array([m.material.two_sided for m in scene.meshes], bool)[corners.mesh[face]]
    axes = camera_frame(scene.camera.eye, scene.camera.lookat, scene.camera.up)
    used, where = np.unique(face, return_inverse=True)
    colors = corner_colors(scene, settings, corners, used)
    condition = condition * np.ones(len(face))
    texel = texels(scene, settings, corners, face, weights, steps, condition)
    rounding = 2.0**-53 if settings.precision == "float64" else 2.0**-24
    unit = np.maximum(rounding, 2.0**-53 * condition)
    points = corners.world[used] - scene.camera.eye
    extent = np.abs(points).max(axis=(1, 2))
    if settings.lighting_at == "centroid":
        points = np.broadcast_to(points.mean(axis=1, keepdims=True), points.shape)
    shown = _Shown(scene, settings, corners, (used, where), behind, at)
    batch = Batch(
        points=points,
        normals=corners.normals[used],
        colors=colors,
        extent=extent,
        surface=Surface.of([m.material for m in scene.meshes], scene.ambient)[corners.mesh[used]],
        lights=scene_lights(scene, settings, None if settings.shader == "gouraud" else at),
        tinted=settings.ambient == "tinted",
        where=where,
        weights=weights,
        texel=texel,
        mapped=map_colors(scene, settings, corners, face, weights, unit),
        turned=behind & two_sided,
        view=-axes[2] if scene.camera.orthographic else None,
        facets=microfacet.facets_of([m.material for m in scene.meshes])[corners.mesh[used]],
        reach=microfacet.REACH[settings.precision],
        tangents=corners.tangents[used],
        maps=maps(scene, settings, corners, face, weights, steps, condition),
        environment=scene.environment,
        seen=_seen(shown),
        bends=corners.bends[used],
        open=_open(shown),
        light=light,
    )
    return {"nolight": _nolight, "gouraud": _gouraud, "phong": _phong, "pbr": _pbr}[settings.shader](batch)


class _Shown(NamedTuple):
    """What pixels show. faces: (U,), and the pixels' indices into them (K,). behind, at: see `shade_pixels`."""

    scene: Scene
    settings: Settings
    corners: Corners
    faces: tuple[Integers, Integers]
    behind: Bools
    at: tuple[Integers, Integers] | None

    def from_pixels(self) -> shadows.Visibility:
        """Return what reaches the pixels."""
        used, where = self.faces
        return seen_at_pixels(self.scene, self.corners, used[where], self.behind, self.at)

    def from_corners(self) -> shadows.Visibility:
        """Return what reaches the corners of the faces."""
        casters, lit, factors = _casting(self.scene, self.corners)
        used, where = self.faces
        of_face = np.zeros(len(used), bool)
        of_face[where] = self.behind  # all pixels of a face see the same side of it
        receivers = shadows.at_corners(casters, used)
        return shadows.visibility(casters, lit, receivers, np.repeat(of_face, 3), (len(used), 3), factors)


def _seen(shown: _Shown) -> shadows.Visibility | None:
    """Return what the lights of non-zero intensity reach; None without shadows."""
    if not shown.settings.shadows or shown.settings.shader == "nolight":
        return None
    return shown.from_corners() if shown.settings.shader == "gouraud" else shown.from_pixels()


def seen_at_pixels(
    scene: Scene, corners: Corners, face: Integers, behind: Bools, at: tuple[Integers, Integers] | None
) -> shadows.Visibility:
    """Return what reaches pixels of faces (K,). behind, at: see `shade_pixels`."""
    assert at is not None
    casters, lit, factors = _casting(scene, corners)
    receivers = shadows.at_pixels(casters, scene.camera, face, *at)
    return shadows.visibility(casters, lit, receivers, behind, (len(face),), factors)


@lru_cache(1)  # the parts of an image, one after another, have the same
def _casting(scene: Scene, corners: Corners) -> tuple[shadows.Casters, list[Light], shadows.Factors]:
    """Return what casts shadows, the lights that shine, and what veils let pass."""
    factors = partial(transparency.veil_factors, scene, corners)
    casters = shadows.Casters.of(corners, transparency.veiling_faces(scene, corners))
    return casters, [light for light in scene.lights if light.intensity.any()], factors


def _open(shown: _Shown) -> ambient_occlusion.Openness | None:
    """Return what of the ambient light arrives; None without ambient occlusion."""
    scene, settings = shown.scene, shown.settings
    if not settings.ambient_occlusion or settings.shader == "nolight":
        return None
    reach = microfacet.REACH[settings.precision]
    if settings.shader == "gouraud" and settings.ambient == "tinted":
        return ambient_occlusion.openness(shown.from_corners(), scene, settings, reach, None)
    return ambient_occlusion.openness(shown.from_pixels(), scene, settings, reach, shown.at)


def _arriving(ambient: Floats, open_: ambient_occlusion.Openness | None) -> tuple[Floats, Floats, Floats]:
    """Return ambient light (..., 3) as it arrives, by how much rounding may change it where it decides whether rays meet
    triangles, and what its budget is more than without occlusion."""
    if open_ is None:
        return ambient, np.zeros(3), np.zeros(3)
    share, spread = open_.share[..., None], open_.spread[..., None]
    return ambient * share, np.abs(ambient) * spread, np.abs(ambient) * (open_.rounding - 1.0)


@dataclass(frozen=True, eq=False)
class Unhidden:
    """What share of each light arrives, (L, ...); of one of finite size that of each point. changes: by how much rounding
    may change it, over how far it may turn a direction. doubtful: what arrives where either answer is right, else 0."""

    share: Floats
    changes: Floats
    doubtful: Floats


def _unhidden(
    batch: Batch, point: Floats, normals: tuple[Floats, Floats], extent: Floats, normal_length: Floats, eye: Floats
) -> Unhidden | None:
    """Return what triangles leave of the lights; None without shadows. normals: the one that is lit, and before a map turned
    it. Other arguments as of `shade.conditioning`."""
    seen, lights = batch.seen, batch.lights
    if seen is None or not len(lights.positions):
        return None
    assert batch.bends is not None
    bend = batch.bends
    if len(point.shape) == 2:  # pixels
        mean = blend(batch.weights, batch.bends[batch.where][..., None])[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            bend = np.nan_to_num(np.minimum(mean / length(normals[1]), shadows.MOST_BEND))
    at = shadows.Normals(unit(normals[0]), unit(normals[1]), seen.facing, bend)
    share, changes, doubtful = [], [], []
    common = shade.conditioning(point, extent, normal_length, eye, np.zeros((0, 3)), batch.view is not None)
    numbers = [number for number, shape in enumerate(lights.shapes) for _ in range(max(shape.points, 1))]
    each = light_each(lights.positions, lights.intensities, lights.shapes, point, extent)
    for number, (position, _, shape) in zip(numbers, each, strict=True):
        kappa = np.fmax(common, shade.light_condition(point, extent, eye, position, batch.view is not None, shape))
        turned = batch.reach * np.maximum(np.nan_to_num(kappa, nan=1e300, posinf=1e300), 1.0)
        to_light = unit(place_of(point, position, shape) - point)
        found, least, most = shadows.softened(at, to_light, turned + seen.off)
        of_point = number, shape.offset, np.nan_to_num(batch.reach * shape.blur, posinf=1e300)
        reached, unsure = seen.reached(*of_point)
        passed = seen.passed(*of_point)
        found, least, most = found * passed.share, least * passed.least, most * passed.most
        share.append(np.where(reached | unsure, found, 0.0))
        changes.append(np.where((reached | unsure) & ~passed.jumps, (most - least) / turned, 0.0))
        doubtful.append(np.where(unsure, most, np.where(reached & passed.jumps, most - least, 0.0)))
    return Unhidden(np.array(share), np.array(changes), np.array(doubtful))


def _nolight(batch: Batch) -> Shaded:
    """Return the colors themselves."""
    color = blend(batch.weights, batch.colors[batch.where])
    rgb = color * batch.texel.color * batch.mapped.color
    worst_color = np.abs(batch.colors).max(axis=1)[batch.where] * batch.texel.most * batch.mapped.most
    budget = np.maximum(worst_color, 1.0)
    return Shaded(rgb, budget, np.ones((len(rgb), 4)), batch.flips(color), np.ones(len(rgb)))


def _gouraud(batch: Batch) -> Shaded:
    """Light the corners, then interpolate. The texel multiplies all but the plain ambient light."""
    points, normals, where, lights = batch.points, batch.normals, batch.where, batch.lights
    surface = batch.surface[:, None]
    turned = np.zeros(len(points), bool)
    turned[where] = batch.turned  # all pixels of a face see the same side of it
    normals = np.where(turned[:, None, None], -normals, normals)
    eye = batch.eye(points)
    given = lights.positions, lights.intensities
    unhidden = _unhidden(batch, points, (normals, normals), batch.extent[:, None], np.ones(1), eye)
    reaching = None if unhidden is None else unhidden.share
    lit = shade.reflected(points, normals, eye, surface, *given, lights.shapes, reaching, batch.light)
    at_corners = _arriving(surface.ka_Ia, batch.open if batch.tinted else None)
    factor = lit + at_corners[0] if batch.tinted else lit
    plain = blend(batch.weights, (batch.colors * factor)[where])
    rgb = plain * batch.texel.color * batch.mapped.color
    pixel = batch.surface[where]
    ambient, hidden, rounded = _arriving(pixel.ka_Ia, None if batch.tinted else batch.open)
    if not batch.tinted:
        rgb = rgb + ambient
    place, parallel = (points, batch.extent[:, None], np.ones(1)), batch.view is not None
    steepness = shade.steepness(points, normals, surface, eye, lights.positions, lights.shapes)
    conditions = shade.conditions(*place, eye, lights.positions, parallel, steepness, lights.shapes)
    worst = shade.condition_number(conditions).argmax(axis=1)
    conditions = np.take_along_axis(conditions, worst[:, None, None], axis=1)[:, 0]
    jump = shade.jumps(points, normals, *place[1:], surface, eye, *given, parallel, lights.shapes)
    jump = jump.max(axis=1)[where]
    worst_color = np.abs(batch.colors).max(axis=1)[where] * batch.texel.most * batch.mapped.most
    arriving = shade.most_arriving(points, place[1], eye, *given, lights.shapes, parallel)
    if arriving.ndim > 2:  # of the brightest corner
        arriving = np.abs(arriving).max(axis=2)[:, where]
    budget = shade.budget(worst_color, pixel, arriving, batch.tinted)
    jump = jump * worst_color + batch.flips(plain)
    if batch.open is not None and batch.tinted:
        hidden, rounded = (
            np.broadcast_to(part, (len(points), 3, 3)).max(axis=1)[where] * worst_color for part in at_corners[1:]
        )
    budget, jump = budget + rounded, jump + hidden
    if unhidden is not None:
        brightest = surface.magnitudes(), lights.positions, np.abs(lights.intensities), lights.shapes
        changes, doubtful = (
            shade.reflected(points, normals, eye, *brightest, factors).max(axis=1)[where] * worst_color
            for factors in (unhidden.changes, unhidden.doubtful)
        )
        budget, jump = budget + changes, jump + doubtful
    return Shaded(rgb, budget, conditions[where], jump, pixel.n)


@dataclass(frozen=True, eq=False)
class Interpolated:
    """What pixels show, (K, 3): point, normal, the same before a map turned it, vertex color, and color; most: the largest
    magnitude that the color is a mean of. extent, normal_length: (K,), see `shade.conditions`."""

    point: Floats
    normal: Floats
    smooth: Floats
    vertex_color: Floats
    color: Floats
    most: Floats
    extent: Floats
    normal_length: Floats


def _interpolated(batch: Batch) -> Interpolated:
    where = batch.where
    normal = blend(batch.weights, batch.normals[where])
    normal = np.where(batch.turned[:, None], -normal, normal)
    vertex_color = blend(batch.weights, batch.colors[where])
    # Where all three corner normals are 0 nothing cancels: 0 is exact.
    normal_length = np.where((batch.normals != 0.0).any(axis=(1, 2))[where], length(normal), 1.0)
    smooth = normal
    if batch.maps.turned.any():
        normal = turned_normals(normal, batch.tangents[where], batch.weights, batch.turned, batch.maps)
        normal_length = np.where(batch.maps.turned, turned_length(normal, batch.maps, batch.reach), normal_length)
    return Interpolated(
        point=blend(batch.weights, batch.points[where]),
        normal=normal,
        smooth=smooth,
        vertex_color=vertex_color,
        color=vertex_color * batch.texel.color * batch.mapped.color,
        # Corners whose colors differ in sign are each rounded separately.
        most=blend(batch.weights, np.abs(batch.colors[where])) * batch.texel.most * batch.mapped.most,
        extent=batch.extent[where],
        normal_length=normal_length,
    )


def _phong(batch: Batch) -> Shaded:
    """Interpolate point, normal and color, then light each pixel."""
    lights, surface, at = batch.lights, batch.surface[batch.where], _interpolated(batch)
    point, normal, color = at.point, at.normal, at.color
    eye = batch.eye(point)
    given = lights.positions, lights.intensities
    unhidden = _unhidden(batch, point, (normal, at.smooth), at.extent, at.normal_length, eye)
    reaching = None if unhidden is None else unhidden.share
    lit = shade.reflected(point, normal, eye, surface, *given, lights.shapes, reaching, batch.light)
    ambient, hidden, rounded = _arriving(surface.ka_Ia, batch.open)
    factor = lit + ambient if batch.tinted else lit
    rgb = color * factor if batch.tinted else ambient + color * factor
    parallel = batch.view is not None
    steepness = shade.steepness(point, normal, surface, eye, lights.positions, lights.shapes)
    around = point, at.extent, at.normal_length, eye, lights.positions, parallel, steepness
    conditions = shade.conditions(*around, lights.shapes)
    gates = at.extent, at.normal_length, surface, eye, *given, parallel, lights.shapes
    jump = shade.jumps(point, normal, *gates) * at.most
    jump = jump + batch.flips(at.vertex_color * factor)
    arriving = shade.most_arriving(point, at.extent, eye, *given, lights.shapes, parallel)
    budget = shade.budget(at.most, surface, arriving, batch.tinted)
    of_ambient = at.most if batch.tinted else 1.0
    budget, jump = budget + rounded * of_ambient, jump + hidden * of_ambient
    if unhidden is not None:
        brightest = surface.magnitudes(), lights.positions, np.abs(lights.intensities), lights.shapes
        changes, doubtful = (
            shade.reflected(point, normal, eye, *brightest, factors) * at.most
            for factors in (unhidden.changes, unhidden.doubtful)
        )
        budget, jump = budget + changes, jump + doubtful
    return Shaded(rgb, budget, conditions, jump, surface.n)


def _from_around(batch: Batch, at: Interpolated, facets: microfacet.Facets, eye: Floats) -> microfacet.Reflected:
    """Return what pixels reflect of the environment."""
    assert batch.environment is not None
    kappa = shade.conditioning(
        at.point, at.extent, at.normal_length, eye, np.zeros((0, 3)), parallel=batch.view is not None
    )
    reach = batch.reach * np.maximum(np.nan_to_num(kappa, nan=1e300, posinf=1e300), 1.0)
    around = environment.Around(unit(at.normal), unit(eye - at.point), facets, at.most, reach)
    return environment.reflected(batch.environment, around)


def _pbr(batch: Batch) -> Shaded:
    """Interpolate point, normal and color, then light each pixel by the metallic-roughness model."""
    lights, plain, at, parallel = batch.lights, batch.facets[batch.where], _interpolated(batch), batch.view is not None
    all_of_it, eye, found = batch.surface.ka_Ia[batch.where], batch.eye(at.point), batch.maps
    open_, open_spread, sums = found.open, found.open_spread, 1.0
    if batch.open is not None:
        open_, open_spread, sums = open_ * batch.open.share, open_spread + batch.open.spread, batch.open.rounding
    ka_Ia = all_of_it * open_[:, None]
    facets = found.changed(plain)
    place = at.extent, at.normal_length
    unhidden = _unhidden(batch, at.point, (at.normal, at.smooth), *place, eye)

    def reflected(intensities: Floats, reaching: Floats | None) -> microfacet.Reflected:
        return microfacet.reflected(
            at.point,
            at.normal,
            eye,
            facets,
            at.most,
            lights.positions,
            intensities,
            batch.reach,
            *place,
            parallel,
            found.error(batch.reach),
            lights.shapes,
            reaching,
        )

    lit = reflected(lights.intensities, None if unhidden is None else unhidden.share)
    hidden = np.zeros(3)  # light of the environment that occlusion may hide
    if batch.environment is not None:
        around = _from_around(batch, at, facets, eye)
        lit = lit.plus(around.times(open_))
        hidden = np.abs(around.tinted * at.color) + around.plain
    rgb = microfacet.light(lit, at.color, ka_Ia, facets, batch.tinted)
    per_color = lit.tinted + ka_Ia if batch.tinted else lit.tinted
    conditions = shade.conditions(at.point, *place, eye, lights.positions, parallel, shapes=lights.shapes)
    budget = microfacet.budget(all_of_it, at.most, found.brightest(plain), lit.spread, batch.tinted)
    ambient = np.abs(all_of_it * at.color if batch.tinted else all_of_it)
    jump = batch.flips(at.vertex_color * per_color) + (ambient + hidden) * open_spread[:, None]
    jump = jump + found.jump(plain)
    budget = budget + (ambient + hidden) * (sums - 1.0)
    if unhidden is not None:
        changes, doubtful = (
            reflected(np.abs(lights.intensities), factors) for factors in (unhidden.changes, unhidden.doubtful)
        )
        budget = budget + at.most * changes.tinted + changes.plain
        jump = jump + at.most * doubtful.tinted + doubtful.plain
    return Shaded(rgb, budget, conditions, jump, np.ones(len(rgb)))
