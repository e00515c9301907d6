"""Mistakes in settings, normals, lights, colors and textures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...base.arrays import Floats
from ...oracle.corners import Corners, corner_colors
from ...oracle.vectors import cross, unit
from ...scene.lights import PointLight
from ...scene.model import Material
from ...scene.texture import Texture
from .drawing import Drawing, Variant
from .light_mistakes import of_materials, plain_materials, scaled, without_texture

# Settings


def _set(drawing: Drawing, name: str, value: Any) -> Drawing:
    return replace(drawing, settings=replace(drawing.settings, **{name: value}))


def _setting(name: str, value: Any) -> Callable[[Drawing], Drawing]:
    return partial(_set, name=name, value=value)


def _other(name: str, here: str, there: str) -> Callable[[Drawing], Iterator[Variant]]:
    """Return the variants of a mistake that exchanges two values of a setting."""

    def variants(drawing: Drawing) -> Iterator[Variant]:
        now = getattr(drawing.settings, name)
        if now in (here, there):
            found = there if now == here else here
            yield found, _setting(name, found)

    return variants


def _instead(name: str, right: str, wrong: str) -> Callable[[Drawing], Iterator[Variant]]:
    """Return the variants of a mistake that takes one value of a setting for another."""

    def variants(drawing: Drawing) -> Iterator[Variant]:
        if getattr(drawing.settings, name) == right:
            yield "", _setting(name, wrong)

    return variants


depth_buffer = _instead("visibility", "painter", "depth")
tinted_ambient = _instead("ambient", "plain", "tinted")
own_points = _instead("lighting_at", "centroid", "position")
texture_per_pixel = _instead("texture_at", "vertex", "pixel")
other_interpolation = _other("interpolation", "affine", "perspective")
other_shader = _other("shader", "phong", "gouraud")


def culled(drawing: Drawing) -> Iterator[Variant]:
    if not drawing.settings.cull:
        yield "", _setting("cull", True)


def unlit(drawing: Drawing) -> Iterator[Variant]:
    yield "", _setting("shader", "nolight")


# Normals, colors and texture coordinates


def _attributes(drawing: Drawing, change: Callable[[Corners], Corners]) -> Drawing:
    """Return the drawing with other attributes at the corners of faces."""
    before = drawing.corners
    return replace(drawing, corners=lambda corners: change(before(corners)))


def _flipped(corners: Corners) -> Corners:
    return replace(corners, normals=-corners.normals)


def _per_face(corners: Corners) -> Corners:
    a, b, c = np.moveaxis(corners.world, 1, 0)
    return replace(corners, normals=np.repeat(unit(cross(b - a, c - a))[:, None], 3, axis=1))


def _mean(values: Floats) -> Floats:
    return np.repeat(values.mean(axis=1, keepdims=True), 3, axis=1)


def _flat(drawing: Drawing) -> Drawing:
    """Return the drawing with means of what triangles have at their corners: of texels, where these are looked up there."""
    scene, settings = drawing.scene, drawing.settings
    at_corners = settings.texture_at == "vertex"

    def change(corners: Corners) -> Corners:
        faces = np.arange(len(corners.mesh))
        colors = corner_colors(scene, settings, corners, faces) if at_corners else corners.colors
        means = _mean(colors), unit(_mean(corners.normals)), _mean(corners.uvs)
        return replace(corners, colors=means[0], normals=means[1], uvs=means[2])

    return _attributes(plain_materials(drawing) if at_corners else drawing, change)


def flipped_normals(drawing: Drawing) -> Iterator[Variant]:
    yield "", partial(_attributes, change=_flipped)


def face_normals(drawing: Drawing) -> Iterator[Variant]:
    yield "", partial(_attributes, change=_per_face)


def flat_triangles(drawing: Drawing) -> Iterator[Variant]:
    yield "", _flat


# Lights and materials


def _lit_by(drawing: Drawing, change: Callable[[int, Any], Any]) -> Drawing:
    """Return the drawing with changed lights. change: from a light's number and the light to another, or None."""
    found = [change(k, light) for k, light in enumerate(drawing.scene.lights)]
    return replace(drawing, scene=replace(drawing.scene, lights=tuple(light for light in found if light is not None)))


def _without_light(number: int, light: Any, missing: int) -> Any:
    return None if number == missing else light


def _alone(number: int, light: Any, left: int) -> Any:
    return light if number == left else None


def missing_light(drawing: Drawing) -> Iterator[Variant]:
    count = len(drawing.scene.lights)
    for k in range(count):
        yield f"light {k + 1}", partial(_lit_by, change=partial(_without_light, missing=k))
    if count > 2:
        for k in (0, count - 1):
            yield f"all but light {k + 1}", partial(_lit_by, change=partial(_alone, left=k))


def _in_channel(number: int, light: Any, which: int, channel: int) -> Any:
    return replace(light, intensity=light.intensity * np.eye(3)[channel]) if number == which else light


def _of_channel(number: int, light: Any, channel: int) -> Any:
    return replace(light, intensity=light.intensity[channel] * np.ones(3))


def one_channel(drawing: Drawing) -> Iterator[Variant]:
    for channel, name in enumerate(("red", "green", "blue")):
        for k in range(len(drawing.scene.lights)):
            change = partial(_in_channel, which=k, channel=channel)
            yield f"{name} of light {k + 1}", partial(_lit_by, change=change)
        change = partial(_of_channel, channel=channel)
        yield f"{name} of all lights, for all channels", partial(_lit_by, change=change)


def white_lights(drawing: Drawing) -> Iterator[Variant]:
    if drawing.scene.lights:
        yield "", partial(_lit_by, change=lambda i, light: replace(light, intensity=np.ones(3)))


def averaged_lights(drawing: Drawing) -> Iterator[Variant]:
    count = len(drawing.scene.lights)
    if count > 1:
        yield "", partial(_lit_by, change=lambda i, light: replace(light, intensity=light.intensity / count))


def _fading(number: int, light: Any) -> Any:
    return replace(light, attenuation="inverse-square") if isinstance(light, PointLight) else light


def falling_off(drawing: Drawing) -> Iterator[Variant]:
    if any(isinstance(light, PointLight) and light.attenuation == "none" for light in drawing.scene.lights):
        yield "", partial(_lit_by, change=_fading)


def _without(name: str) -> Callable[[Drawing], Iterator[Variant]]:
    def variants(drawing: Drawing) -> Iterator[Variant]:
        yield "", lambda given: scaled(given, **{name: 0.0})

    return variants


no_ambient = _without("ka")
no_diffuse = _without("kd")
no_highlight = _without("ks")


def ambient_per_light(drawing: Drawing) -> Iterator[Variant]:
    if len(drawing.scene.lights) > 1:
        yield "", partial(scaled, ka=float(len(drawing.scene.lights)))


def ambient_without_intensity(drawing: Drawing) -> Iterator[Variant]:
    yield "", lambda given: replace(given, scene=replace(given.scene, ambient=np.ones(3)))


def no_exponent(drawing: Drawing) -> Iterator[Variant]:
    yield "", partial(of_materials, change=lambda material: replace(material, n=1.0))


# Textures


def _textured(drawing: Drawing) -> bool:
    return any(mesh.material.texture is not None and mesh.uvs is not None for mesh in drawing.scene.meshes)


def untextured(drawing: Drawing) -> Iterator[Variant]:
    if _textured(drawing):
        yield "", without_texture


def _image(drawing: Drawing, change: Callable[[Texture], Texture]) -> Drawing:
    """Return the drawing with other images as textures."""

    def changed(material: Material) -> Material:
        return material if material.texture is None else replace(material, texture=change(material.texture))

    return of_materials(drawing, changed)


def _looked_up(change: Callable[[Texture], Texture]) -> Callable[[Drawing], Iterator[Variant]]:
    def variants(drawing: Drawing) -> Iterator[Variant]:
        if _textured(drawing):
            yield "", partial(_image, change=change)

    return variants


flipped_v = _looked_up(lambda texture: replace(texture, image=texture.image[::-1]))
flipped_u = _looked_up(lambda texture: replace(texture, image=texture.image[:, ::-1]))
swapped_uv = _looked_up(lambda texture: replace(texture, image=np.swapaxes(texture.image, 0, 1)))


def _moved(corners: Corners, sizes: list[tuple[int, int]], change: Callable[[Floats], Floats]) -> Corners:
    """Return the corners with other texture coordinates. sizes: columns - 1 and rows - 1 of the meshes' textures. change: of
    coordinates in texels."""
    size = np.array(sizes)[corners.mesh][:, None]
    return replace(corners, uvs=change(np.clip(corners.uvs, 0.0, 1.0) * size) / size)


def _in_texels(drawing: Drawing, change: Callable[[Floats], Floats]) -> Drawing:
    textures = [mesh.material.texture for mesh in drawing.scene.meshes]
    shapes = [(2, 2) if texture is None else texture.image.shape for texture in textures]
    sizes = [(max(columns - 1, 1), max(rows - 1, 1)) for rows, columns, *_ in shapes]
    return _attributes(drawing, partial(_moved, sizes=sizes, change=change))


def half_texel(drawing: Drawing) -> Iterator[Variant]:
    if _textured(drawing):
        yield "looked up toward (0, 0)", partial(_in_texels, change=lambda texels: texels - 0.5)
        yield "looked up away from (0, 0)", partial(_in_texels, change=lambda texels: texels + 0.5)


def nearest_texel(drawing: Drawing) -> Iterator[Variant]:
    if _textured(drawing) and drawing.settings.texture_at == "vertex":
        yield "rounded", partial(_in_texels, change=lambda texels: np.floor(texels + 0.5))
        yield "down", partial(_in_texels, change=np.floor)
