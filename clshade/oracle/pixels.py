"""Colors of pixels whose owner is known, with the inputs of the error measures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Floats, Integers
from . import environment, microfacet, shade, visibility
from .corners import blend
from .lights import Interaction, scene_lights
from .microfacet import Reflected
from .shade import RIGHT, Steps, Surface
from .shadows import Receivers
from .shot import Hits
from .texture import corner_colors, map_colors, texels
from .transform import camera_frame, length, unit


@dataclass(frozen=True, eq=False)
class Shaded:
    """Colors of K pixels, and the measures of their errors."""

    rgb: Floats  # (K, 3), linear
    budget: (
        Floats  # (K, 3), B, which errors are relative to; without light max(color, 1), of the background its magnitude
    )
    conditions: Floats  # (K, 4), the terms of kappa, see `shade.conditions`; 1 where nothing is lit
    # (K, 3), by how much highlights that rounding may open or close, and colors of a map that it may exchange, change rgb
    jump: Floats
    exponent: Floats  # (K,), the material's n; 1 without light

    @property
    def kappa(self) -> Floats:
        """(K,), the condition number of the light's geometry: how far it amplifies rounding errors."""
        return shade.condition_number(self.conditions)


def shade_pixels(hits: Hits, light: Steps = RIGHT) -> Shaded:
    """Shade pixels. light: how it is computed, by shaders gouraud and phong."""
    models = {"nolight": _Unlit, "gouraud": _Gouraud, "phong": _Phong, "pbr": _Pbr}
    return models[hits.shot.settings.shader](hits, light).shaded()


class _Unlit:
    """Pixels K and the U faces that they lie on: `faces` (U,), pixel k lies on face `where[k]` of these.

    colors: (U, 3, 3) at the corners. vertex_color, color: (K, 3), the latter with texels and colors of scalars. max_color:
    (K, 3) the largest magnitude that the color is a mean of. tinted: whether the color multiplies the ambient light.
    """

    def __init__(self, hits: Hits, steps: Steps) -> None:
        self.hits, self.steps = hits, steps
        self.scene, self.settings, self.corners = hits.shot.scene, hits.shot.settings, hits.shot.corners
        self.faces, self.where = np.unique(hits.face, return_inverse=True)
        self.tinted = self.settings.ambient == "tinted"
        self.reach = microfacet.REACH[self.settings.precision]
        of_pixel = self.settings.texture_at == "pixel"
        self.texel = texels(hits, lambda mesh: mesh.material.texture if of_pixel else None)
        self.mapped = map_colors(hits)
        self.colors = corner_colors(self.settings, self.corners, self.faces)
        self.vertex_color = blend(hits.weights, self.colors[self.where])
        self.color = self.vertex_color * self.texel.color * self.mapped.color
        self.max_color = self.brightest() * self.texel.magnitude * self.mapped.magnitude

    def brightest(self) -> Floats:
        """Return the largest vertex color that each pixel's depends on, (K, 3): that of the worst corner."""
        return np.asarray(np.abs(self.colors).max(axis=1)[self.where])

    def flips(self, color: Floats) -> Floats:
        """Return by how much rounding may change the color (K, 3), times texel and color of scalars, where it decides which
        color those are."""
        of_texel = np.abs(color) * self.mapped.magnitude * self.texel.spread
        return np.asarray(np.abs(color * self.texel.color) * self.mapped.spread + of_texel)

    def shaded(self) -> Shaded:
        budget, jump, count = np.maximum(self.max_color, 1.0), self.flips(self.vertex_color), len(self.color)
        return Shaded(self.color, budget, np.ones((count, 4)), jump, np.ones(count))


class _Lit(_Unlit):
    """Pixels that are lit by Phong's reflection model.

    points: (U, 3, 3) where the corners are lit, relative to the eye. extent: (U,) the largest coordinate of the corners.
    surface: (U,) materials. at: (...) points where the light is computed, with lit_surface. smooth: (..., 3) normals before
    a map turned them. bend: (...), see `visibility.Normals`.
    """

    at: Interaction
    smooth: Floats
    bend: Floats

    def __init__(self, hits: Hits, steps: Steps) -> None:
        super().__init__(hits, steps)
        points = self.corners.world[self.faces] - self.scene.camera.eye
        self.extent = np.abs(points).max(axis=(1, 2))
        centroid = self.settings.lighting_at == "centroid"
        self.points = np.broadcast_to(points.mean(axis=1, keepdims=True), points.shape) if centroid else points
        surface = Surface.of([mesh.material for mesh in self.scene.meshes], self.scene.ambient)
        self.surface = surface[self.corners.mesh[self.faces]]
        self.pixel_surface = self.lit_surface = self.surface[self.where]

    def interaction(
        self, point: Floats, normal: Floats, extent: Floats, normal_length: Floats, place: Integers | None
    ) -> Interaction:
        """Return points (..., 3) that lights reach. place: of pixels, which shifts the points of lights.

        The eye is the origin, as everything is relative to it. An orthographic camera's is as far from the point as the
        scene is large: 1 away from a point at 1e15 would leave no digit of the direction.
        """
        camera, eye = self.scene.camera, np.zeros(3)
        if camera.orthographic:
            far = np.ldexp(1.0, np.frexp(self.extent.max(initial=1e-300))[1])
            eye = point + -camera_frame(camera)[2] * far
        lights = scene_lights(self.scene, self.settings.light_samples, place)
        return Interaction(point, normal, eye, lights, extent, normal_length, camera.orthographic)

    @property
    def receivers(self) -> Receivers:
        """The points as shadow rays start there."""
        return visibility.pixel_receivers(self.hits)

    def ambient_visibility(self, at_corners: bool = False) -> visibility.AmbientVisibility:
        """Return how much of the ambient light arrives at pixels or corners."""
        if not self.settings.ambient_occlusion:
            return visibility.AmbientVisibility(np.ones(()), np.zeros(()), 1.0)
        if at_corners:
            return visibility.ambient_visibility(self.receivers, self.settings, self.reach, None)
        at = visibility.pixel_receivers(self.hits)
        return visibility.ambient_visibility(at, self.settings, self.reach, self.hits.position)

    def shaded(self) -> Shaded:
        """Light the points, then bound the effects of rounding, on the visibility of lights too."""
        left = None
        if self.settings.shadows and len(self.at.lights.positions):
            left = visibility.light_visibility(self.receivers, self.at, self.smooth, self.bend, self.reach)
        rgb, budget, jump = self.light(left and left[0])
        if left:
            brightest = replace(self.at, lights=self.at.lights.magnitudes())
            budget = sum(self.magnitudes(brightest, left[1]), budget)
            jump = sum(self.magnitudes(brightest, left[2]), jump)
        return Shaded(rgb, budget, self.conditions(), jump, self.exponent())

    def light(self, reaching: Floats | None) -> tuple[Floats, Floats, Floats]:
        """Return the light of pixels, its budget, and its jumps, (K, 3) each. reaching: see `shade.reflected`."""
        factor = shade.reflected(self.at, self.lit_surface, reaching, self.steps)
        ambient, hidden, rounded = self.ambient()
        plain, rgb = self.colored(factor + ambient if self.tinted else factor)
        rgb = rgb if self.tinted else rgb + ambient
        jump = self.worst(shade.jumps(self.at, self.lit_surface)) * self.max_color + self.flips(plain)
        arriving = (self.worst(np.abs(sample.max_arriving)) for sample in self.at.samples)
        budget = shade.budget(self.max_color, self.pixel_surface, arriving, self.tinted)
        if not self.tinted:
            return rgb, budget + rounded, jump + hidden
        return rgb, budget + self.worst(rounded) * self.max_color, jump + self.worst(hidden) * self.max_color

    def magnitudes(self, brightest: Interaction, reaching: Floats) -> Iterator[Floats]:
        """Yield the summands of the light of lights with these factors, (K, 3)."""
        yield self.worst(shade.reflected(brightest, self.lit_surface.magnitudes(), reaching)) * self.max_color

    def conditions(self) -> Floats:
        return shade.conditions(self.at, shade.steepness(self.at, self.lit_surface))

    def exponent(self) -> Floats:
        return self.pixel_surface.n

    def worst(self, values: Floats) -> Floats:
        """Return the largest values for pixels (K, 3) of values at the points (..., 3)."""
        return values

    def colored(self, factor: Floats) -> tuple[Floats, Floats]:
        """Return the light (K, 3) without and with texels and colors of scalars, from factors of the color (..., 3)."""
        return self.vertex_color * factor, self.color * factor

    def ambient(self) -> tuple[Floats, Floats, Floats]:
        """Return the ambient light (..., 3) that arrives, at pixels if it is not tinted; by how much rounding may change it
        where it decides whether rays meet triangles; and by how much occlusion raises its budget."""
        return self.arriving(self.pixel_surface.ka_Ia, self.ambient_visibility())

    @staticmethod
    def arriving(ambient: Floats, part: visibility.AmbientVisibility) -> tuple[Floats, Floats, Floats]:
        magnitude, share, spread = np.abs(ambient), part.share[..., None], part.spread[..., None]
        return ambient * share, magnitude * spread, magnitude * (part.rounding - 1.0)


class _Gouraud(_Lit):
    """Lights the corners, (3 U,), then interpolates. The texel multiplies all but the plain ambient light."""

    def __init__(self, hits: Hits, steps: Steps) -> None:
        super().__init__(hits, steps)
        turned, normals = np.zeros(len(self.faces), bool), self.corners.normals[self.faces]
        turned[self.where] = hits.turned  # all pixels of a face see the same side of it
        self.smooth = np.where(turned[:, None, None], -normals, normals).reshape(-1, 3)
        of_corners, points = np.repeat(np.arange(len(self.faces)), 3), self.points.reshape(-1, 3)
        self.at = self.interaction(points, self.smooth, self.extent[of_corners], np.ones(1), None)
        self.bend, self.lit_surface = self.corners.bends[self.faces].reshape(-1), self.surface[of_corners]

    @property
    def receivers(self) -> Receivers:
        return visibility.corner_receivers(self.hits, self.faces, self.where)

    def worst(self, values: Floats) -> Floats:
        at_corners = np.broadcast_to(values, (3 * len(self.faces), 3)).reshape(-1, 3, 3)
        return np.asarray(at_corners.max(axis=1)[self.where])

    def colored(self, factor: Floats) -> tuple[Floats, Floats]:
        plain = blend(self.hits.weights, (self.colors * factor.reshape(-1, 3, 3))[self.where])
        return plain, plain * self.texel.color * self.mapped.color

    def ambient(self) -> tuple[Floats, Floats, Floats]:
        if not self.tinted:
            return super().ambient()
        return self.arriving(self.lit_surface.ka_Ia, self.ambient_visibility(at_corners=True))

    def conditions(self) -> Floats:
        """Return the conditions of the worst corner."""
        conditions = super().conditions().reshape(-1, 3, 4)
        worst = shade.condition_number(conditions).argmax(axis=1)
        return np.take_along_axis(conditions, worst[:, None, None], axis=1)[:, 0][self.where]


class _Phong(_Lit):
    """Interpolates point, normal and color, then lights each pixel."""

    def __init__(self, hits: Hits, steps: Steps) -> None:
        super().__init__(hits, steps)
        self.maps, weights = microfacet.maps(hits), hits.weights
        self.smooth, normal, normal_length = microfacet.shading_normals(hits, self.maps)
        point = blend(weights, self.points[self.where])
        self.at = self.interaction(point, normal, self.extent[self.where], normal_length, hits.position)
        mean = blend(weights, self.corners.bends[hits.face][..., None])[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            self.bend = np.nan_to_num(np.minimum(mean / length(self.smooth), visibility.MAX_BEND))

    def brightest(self) -> Floats:
        # Corners whose colors differ in sign are each rounded separately.
        return blend(self.hits.weights, np.abs(self.colors[self.where]))


class _Pbr(_Phong):
    """Interpolates point, normal and color, then lights each pixel by the metallic-roughness model."""

    def reflected(self, at: Interaction, reaching: Floats | None) -> Reflected:
        return microfacet.reflected(at, self.maps.facets, self.max_color, self.reach, self.maps.wear, reaching)

    def light(self, reaching: Floats | None) -> tuple[Floats, Floats, Floats]:
        ka_Ia, part = self.pixel_surface.ka_Ia, self.ambient_visibility()
        open_, open_spread = self.maps.open * part.share, self.maps.open_spread + part.spread
        ambient, lit = ka_Ia * open_[:, None], self.reflected(self.at, reaching)
        hideable = np.abs(ka_Ia * self.color if self.tinted else ka_Ia)
        if self.scene.environment is not None:
            reach = self.reach * np.maximum(np.nan_to_num(self.at.kappa, nan=1e300, posinf=1e300), 1.0)
            directions = unit(self.at.normal), unit(self.at.eye - self.at.point)
            around = environment.reflected(self.scene.environment, *directions, self.maps.facets, self.max_color, reach)
            tinted, plain = (light * open_[..., None] for light in (around.tinted, around.plain))
            lit = Reflected(lit.tinted + tinted, lit.plain + plain, lit.spread + around.spread)
            hideable = hideable + (np.abs(around.tinted * self.color) + around.plain)
        per_color = lit.tinted + ambient if self.tinted else lit.tinted
        rgb = self.color * per_color + lit.plain + self.maps.facets.emission
        rgb = rgb if self.tinted else rgb + ambient
        brightest = np.maximum(np.abs(self.max_color), 1.0) if self.tinted else 1.0
        budget = np.abs(ka_Ia) * brightest + self.maps.emission + lit.spread
        jump = self.flips(self.vertex_color * per_color) + hideable * open_spread[:, None]
        return rgb, budget + hideable * (part.rounding - 1.0), jump + self.maps.jump

    def magnitudes(self, brightest: Interaction, reaching: Floats) -> Iterator[Floats]:
        light = self.reflected(brightest, reaching)
        yield self.max_color * light.tinted
        yield light.plain

    def conditions(self) -> Floats:
        return shade.conditions(self.at)

    def exponent(self) -> Floats:
        return np.ones(len(self.where))
