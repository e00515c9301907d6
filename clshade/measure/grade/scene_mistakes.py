"""Mistakes in settings, normals, lights, colors and textures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...base.arrays import Floats
from ...oracle.corners import Corners, corner_colors
from ...oracle.vectors import cross, unit
from ...scene.lights import PointLight
from ...scene.model import Material
from ...scene.texture import Texture
from .drawing import Drawing, Edit, Variant, Variants, only, then, variants
from .light_mistakes import of_materials, plain_materials, scaled

# Settings


def _setting(name: str, value: Any) -> Edit:
    return lambda drawing: replace(drawing, settings=replace(drawing.settings, **{name: value}))


def _instead_of(name: str, right: Any, wrong: Any) -> Variants:
    """Return the variant of a mistake that takes one value of a setting for another."""
    return only(_setting(name, wrong), lambda drawing: getattr(drawing.settings, name) == right)


def _exchanged(name: str, one: str, other: str) -> Variants:
    """Return the variants of a mistake that exchanges two values of a setting."""

    def found(drawing: Drawing) -> Iterator[Variant]:
        for right, wrong in ((one, other), (other, one)):
            if getattr(drawing.settings, name) == right:
                yield wrong, _setting(name, wrong)

    return found


depth_buffer = _instead_of("visibility", "painter", "depth")
tinted_ambient = _instead_of("ambient", "plain", "tinted")
own_points = _instead_of("lighting_at", "centroid", "position")
texture_per_pixel = _instead_of("texture_at", "vertex", "pixel")
culled = _instead_of("cull", False, True)
other_interpolation = _exchanged("interpolation", "affine", "perspective")
other_shader = _exchanged("shader", "phong", "gouraud")
unlit = only(_setting("shader", "nolight"))


# Normals, colors and texture coordinates


def _per_face(corners: Corners) -> Corners:
    a, b, c = np.moveaxis(corners.world, 1, 0)
    return replace(corners, normals=np.repeat(unit(cross(b - a, c - a))[:, None], 3, axis=1))


def _mean(values: Floats) -> Floats:
    return np.repeat(values.mean(axis=1, keepdims=True), 3, axis=1)


def _flat(drawing: Drawing) -> Drawing:
    """Return the drawing with means of what triangles have at their corners: of texels, where these are looked up there."""
    scene, settings = drawing.scene, drawing.settings
    at_corners = settings.texture_at == "vertex"

    def flat(corners: Corners) -> Corners:
        faces = np.arange(len(corners.mesh))
        colors = corner_colors(scene, settings, corners, faces) if at_corners else corners.colors
        return replace(corners, colors=_mean(colors), normals=unit(_mean(corners.normals)), uvs=_mean(corners.uvs))

    return then(corners=flat)(plain_materials(drawing) if at_corners else drawing)


flipped_normals = only(then(corners=lambda corners: replace(corners, normals=-corners.normals)))
face_normals = only(then(corners=_per_face))
flat_triangles = only(_flat)


# Lights and materials


def _lit_by(change: Callable[[int, Any], Any]) -> Edit:
    """Return an edit that changes the lights. change: from a light's number and the light to another, or None."""

    def changed(drawing: Drawing) -> Drawing:
        found = [change(k, light) for k, light in enumerate(drawing.scene.lights)]
        lights = tuple(light for light in found if light is not None)
        return replace(drawing, scene=replace(drawing.scene, lights=lights))

    return changed


def _keeping(kept: Sequence[int]) -> Edit:
    """Return an edit that keeps the lights of these numbers."""
    return _lit_by(lambda k, light: light if k in kept else None)


def missing_light(drawing: Drawing) -> Iterator[Variant]:
    numbers = range(len(drawing.scene.lights))
    for k in numbers:
        yield f"light {k + 1}", _keeping([*numbers[:k], *numbers[k + 1 :]])
    if len(numbers) > 2:
        for k in (numbers[0], numbers[-1]):
            yield f"all but light {k + 1}", _keeping([k])


def _in_channel(number: int, channel: int) -> Edit:
    """Return an edit that keeps only one channel of a light."""
    only_it = np.eye(3)[channel]
    return _lit_by(lambda k, light: replace(light, intensity=light.intensity * only_it) if k == number else light)


def _of_channel(channel: int) -> Edit:
    """Return an edit that takes one channel of all lights for all."""
    return _lit_by(lambda k, light: replace(light, intensity=light.intensity[channel] * np.ones(3)))


def one_channel(drawing: Drawing) -> Iterator[Variant]:
    for channel, name in enumerate(("red", "green", "blue")):
        for k in range(len(drawing.scene.lights)):
            yield f"{name} of light {k + 1}", _in_channel(k, channel)
        yield f"{name} of all lights, for all channels", _of_channel(channel)


def averaged_lights(drawing: Drawing) -> Iterator[Variant]:
    count = len(drawing.scene.lights)  # also where the drawing that is changed has fewer
    if count > 1:
        yield "", _lit_by(lambda k, light: replace(light, intensity=light.intensity / count))


def ambient_per_light(drawing: Drawing) -> Iterator[Variant]:
    count = float(len(drawing.scene.lights))
    if count > 1.0:
        yield "", lambda changed: scaled(changed, ka=count)


def _fading(number: int, light: Any) -> Any:
    return replace(light, attenuation="inverse-square") if isinstance(light, PointLight) else light


def _steady(drawing: Drawing) -> bool:
    return any(isinstance(light, PointLight) and light.attenuation == "none" for light in drawing.scene.lights)


white_lights = only(
    _lit_by(lambda k, light: replace(light, intensity=np.ones(3))), lambda drawing: bool(drawing.scene.lights)
)
falling_off = only(_lit_by(_fading), _steady)
no_ambient = only(lambda drawing: scaled(drawing, ka=0.0))
no_diffuse = only(lambda drawing: scaled(drawing, kd=0.0))
no_highlight = only(lambda drawing: scaled(drawing, ks=0.0))
ambient_without_intensity = only(lambda drawing: replace(drawing, scene=replace(drawing.scene, ambient=np.ones(3))))
no_exponent = only(lambda drawing: of_materials(drawing, lambda material: replace(material, n=1.0)))


# Textures


def _textured(drawing: Drawing) -> bool:
    return any(mesh.material.texture is not None and mesh.uvs is not None for mesh in drawing.scene.meshes)


def _with_textures(change: Callable[[Texture], Texture | None]) -> Variants:
    """Return the variant of a mistake that exchanges the textures."""

    def changed(material: Material) -> Material:
        return material if material.texture is None else replace(material, texture=change(material.texture))

    return only(lambda drawing: of_materials(drawing, changed), _textured)


def _in_texels(change: Callable[[Floats], Floats]) -> Edit:
    """Return an edit that changes the coordinates in texels."""

    def changed(drawing: Drawing) -> Drawing:
        textures = [mesh.material.texture for mesh in drawing.scene.meshes]
        shapes = [(2, 2) if texture is None else texture.image.shape for texture in textures]
        sizes = np.array([(max(columns - 1, 1), max(rows - 1, 1)) for rows, columns, *_ in shapes])

        def moved(corners: Corners) -> Corners:
            size = sizes[corners.mesh][:, None]
            return replace(corners, uvs=change(np.clip(corners.uvs, 0.0, 1.0) * size) / size)

        return then(corners=moved)(drawing)

    return changed


untextured = _with_textures(lambda texture: None)
flipped_v = _with_textures(lambda texture: replace(texture, image=texture.image[::-1]))
flipped_u = _with_textures(lambda texture: replace(texture, image=texture.image[:, ::-1]))
swapped_uv = _with_textures(lambda texture: replace(texture, image=np.swapaxes(texture.image, 0, 1)))
half_texel = variants(
    {
        "looked up toward (0, 0)": _in_texels(lambda texels: texels - 0.5),
        "looked up away from (0, 0)": _in_texels(lambda texels: texels + 0.5),
    },
    _textured,
)
nearest_texel = variants(
    {
        "rounded": _in_texels(lambda texels: np.floor(texels + 0.5)),
        "down": _in_texels(np.floor),
    },
    lambda drawing: _textured(drawing) and drawing.settings.texture_at == "vertex",
)
