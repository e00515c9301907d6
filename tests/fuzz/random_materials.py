"""Random materials, textures, parameters of shader pbr, environments and lights, also at the ends of their ranges."""

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
from random_kinds import Kind, Random, is_wanted

from clshade.base.arrays import Array
from clshade.errors import InputError
from clshade.scene.environment import Environment
from clshade.scene.lights import FIELDS, LIGHTS, Field, PointLight
from clshade.scene.material import MAPS, MetallicRoughness
from clshade.scene.model import Light, Material, Mesh, Texture
from clshade.scene.texture import WRAPS

# Of attenuated lights, whose intensities grow with the square of a scene's size: what float32 holds.
MOST_INTENSITY, LEAST_SCALE = 3e38, 1e-15


def random_material(rng: Random, kind: Kind, all_of_it: bool = False) -> Material:
    """Return a material. all_of_it: with every feature of the kind."""
    wanted = partial(is_wanted, rng, always=all_of_it)
    present = {"ka": kind.ambient, "kd": kind.diffuse, "ks": kind.specular}
    textured, tinted = kind.textured and wanted(0.6), kind.colored and wanted(0.4)
    return Material(
        **{name: _coefficient(rng) if is_present and wanted(0.9) else 0.0 for name, is_present in present.items()},
        n=_exponent(rng, all_of_it) if kind.power else 1.0,
        texture=_base_texture(rng, kind, all_of_it) if textured else None,
        color=np.minimum(rng.uniform(0.1, 1.5, 3), 1.0 if kind.dim else np.inf) if tinted else 1.0,
        sides="front" if kind.front and wanted(0.3) else "both",
        two_sided=kind.two_sided and wanted(0.5),
        alpha_cutoff=rng.uniform(0.1, 0.9) if kind.alpha and wanted(0.6) else None,
        blend=kind.transparent and wanted(0.6),
        opacity=float(rng.choice((1.0, 0.5, 0.25, 1e-7, rng.uniform(0.1, 1)))) if kind.transparent else 1.0,
        pbr=_microfacets(rng, kind, all_of_it),
    )


def _coefficient(rng: Random) -> Any:
    value = rng.uniform(0.05, 1.0, 3) if rng.random() < 0.5 else rng.uniform(0.05, 1.0)
    return value * (rng.choice((1e-3, 5.0)) if rng.random() < 0.1 else 1.0)


def _exponent(rng: Random, needed: bool) -> float:
    choices = (2.0, 20.0, 200.0, 1e4, 1e9) if needed else (0.0, 0.5, 1.0, 2.0, 20.0, 200.0, 1e4, 1e9)
    return float(rng.choice(choices)) if rng.random() < 0.6 else float(10.0 ** rng.uniform(0.1, 9))


def _base_texture(rng: Random, kind: Kind, all_of_it: bool) -> Texture:
    height, width = (int(size) for size in rng.choice((1, 1, 2, 3, 4, 5, 7, 16, 33), 2))
    if all_of_it and kind.settings.texture_filter == "trilinear":
        width = max(width, 2)  # a single texel needs no mipmap levels
    channels = 4 if kind.alpha and (all_of_it or rng.random() < 0.5) else 3
    image: Array = rng.uniform(0, 1, (height, width, channels)).astype(np.float32)
    if rng.random() < 0.3:
        image = (image * 255).astype(np.uint8)
    elif rng.random() < 0.2 and not kind.dim:
        image[..., :3] *= 20.0
    if not all_of_it and rng.random() < 0.3:
        return Texture(image, _wraps(rng), "course")
    return Texture(image, _wraps(rng), filter=_filter(rng, kind, all_of_it))


def _wraps(rng: Random) -> Any:
    return WRAPS[rng.choice(len(WRAPS))], WRAPS[rng.choice(len(WRAPS))]


def _filter(rng: Random, kind: Kind, needed: bool = False) -> Any:
    return "nearest" if kind.nearest and (needed or rng.random() < 0.5) else "linear"


def _microfacets(rng: Random, kind: Kind, all_of_it: bool) -> MetallicRoughness | None:
    """Return parameters of shader pbr, unless they follow from Phong's. all_of_it: with what needs each term of the
    model."""

    def some(*ends: float, minimum: float = 0.0) -> float:
        return float(rng.choice(ends)) if rng.random() < 0.5 else rng.uniform(minimum, 1.0)

    if not (kind.maps or (kind.facets and (all_of_it or rng.random() < 0.7))):
        return None
    fields: dict[str, Any] = {
        "metallic": rng.uniform(0.1, 0.9) if all_of_it else some(0.0, 1.0, 1e-30),
        "roughness": some(0.0, 1e-4, 1.0 / 32.0, 0.05, 1.0),
        "emission": rng.uniform(0.1, 1.0, 3) * rng.choice((1.0, 1.0, 1e-30, 1e30, 3e38)),
    }
    if kind.facets:
        fields["ior"] = float(rng.choice((0.0, 1.0, 1.0 + 1e-9, 1.5, 2.4, 1e6)))
        fields["specular"] = some(0.5, 1.0, minimum=0.1) if all_of_it else some(0.0, 1e-30, 1.0)
        fields["specular_color"] = rng.uniform(0.0, 1.0, 3) * rng.choice((0.0, 1.0, 30.0, 1e30))
        if not all_of_it and rng.random() < 0.3:
            fields["emission"] = 0.0
    if kind.maps:
        fields["normal_scale"] = float(rng.choice((0.0, -1.0, 1.0, 5.0, rng.uniform(-2, 2))))
        fields["occlusion_strength"] = rng.uniform(0.0, 1.0)
        fields |= {name: _map(rng, kind) for name in MAPS if all_of_it or rng.random() < 0.5}
    return MetallicRoughness(**fields)


def _map(rng: Random, kind: Kind) -> Texture:
    height, width = (int(size) for size in rng.choice((1, 2, 3, 4, 7, 16, 33), 2))
    image = rng.uniform(0, 1, (height, width, 3)).astype(np.float32)
    if rng.random() < 0.1:
        image[:] = rng.choice((0.0, 0.5, 1.0))
    return Texture(image, _wraps(rng), filter=_filter(rng, kind), coordinates=int(rng.integers(0, 2)))


def random_environment(rng: Random) -> Environment:
    """Return an environment, up to 16 x 32 pixels, of any direction, with suns and black pixels, that shines."""
    shape = int(rng.integers(1, 17)), int(rng.integers(1, 33)), 3
    image = rng.uniform(0.0, 1.0, shape) ** rng.choice((1, 6))
    if rng.random() < 0.3:
        image[rng.random(shape[:2]) < 0.5] = 0.0
    image[rng.integers(shape[0]), rng.integers(shape[1])] = rng.choice((1.0, 1.0, 1e3, 1e6))
    if rng.random() < 0.15:
        image *= 10.0 ** rng.uniform(-30, 24)
    up = rng.normal(size=3) if rng.random() < 0.5 else (0.0, 1.0, 0.0)
    return Environment(image, rotation=rng.uniform(-400.0, 400.0), intensity=rng.uniform(0.1, 3.0), up=up)


# Lights


def random_lights(
    rng: Random, kind: Kind, meshes: Sequence[Mesh], center: Array, scale: float, shift: Array
) -> tuple[Light, ...]:
    """Return lights, at most six, of a scene that is scaled and then shifted; some are of the kind's sorts, and then
    the first is. The first is not black if the kind needs it."""
    points = [_point(rng, meshes) for _ in range(rng.integers(0, 6))]
    if kind.specialize or kind.two_sided or kind.normal_faces or kind.shaped or kind.sized:
        points.insert(0, PointLight(3.0 * rng.normal(size=3), rng.uniform(0.1, 1.0, 3)))
    points = [replace(point, position=point.position * scale + shift) for point in points]
    lights: list[Light] = list(points)
    for sized in [False] * kind.shaped + [True] * kind.sized:
        for k, point in enumerate(points):
            if k == 0 or rng.random() < 0.5:
                lights[k] = _light(rng, sized, point, scale, center * scale + shift)
    return tuple(lights)


def _point(rng: Random, meshes: Sequence[Mesh]) -> PointLight:
    position, intensity = 3.0 * rng.normal(size=3), rng.uniform(0, 2, 3)
    where, how = rng.random(2)
    if where < 0.1:
        position *= 10.0 ** rng.uniform(0, 9)
    elif where < 0.2:
        verts = meshes[rng.integers(len(meshes))].verts
        position = verts[rng.integers(len(verts))].astype(np.float64) if len(verts) else position
    elif where < 0.25:
        position = np.zeros(3)
    if how < 0.15:
        intensity *= 10.0 ** rng.uniform(-30, 30)
    elif how < 0.25:
        intensity[rng.random(3) < 0.6] = 0.0
    elif how < 0.3:
        intensity *= -1.0
    return PointLight(position, intensity)


def _light(rng: Random, sized: bool, point: PointLight, scale: float, center: Array) -> Light:
    """Return a light where a point is, and as bright. Half of those with a direction shine at the center."""
    while True:
        kind = LIGHTS[rng.integers(len(LIGHTS))]
        values = {field.name: _value(rng, FIELDS[field.name], scale) for field in fields(kind)}
        overrides = {"position": point.position, "intensity": point.intensity}
        if rng.random() < 0.5:
            overrides["direction"] = center - point.position + scale * rng.uniform(0.0, 0.5) * rng.normal(size=3)
        try:
            light = kind(**{**values, **{name: value for name, value in overrides.items() if name in values}})
        except InputError:  # values that do not go together
            continue
        if light.attenuates:
            intensity = light.intensity * scale**2
            if np.abs(intensity).max() > MOST_INTENSITY or scale < LEAST_SCALE:
                continue
            light = replace(light, intensity=intensity)
        if light.has_size == sized and not light.is_plain:
            return light


def _value(rng: Random, field: Field, scale: float) -> Any:
    """Return a value of a field: any vector, a value that it names, any length, or one between those that it names."""
    length = scale * 10.0 ** (rng.uniform(-1.5, 1.0) if rng.random() < 0.7 else rng.uniform(-8.0, 8.0))
    if field.turns:
        axis = rng.permutation([0.0, 0.0, rng.choice((-1.0, 1.0))])
        vector = axis if rng.random() < 0.3 else rng.normal(size=3)
        return length * vector if field.grows else vector
    named = field.values[rng.integers(len(field.values))] if field.values else None
    if field.grows:
        return named if rng.random() < 0.4 else length
    ends = [value for value in field.values if isinstance(value, float)]
    return rng.uniform(min(ends), max(ends)) if len(ends) > 1 and rng.random() < 0.6 else named
