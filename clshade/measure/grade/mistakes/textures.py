"""Mistakes in interpolation and in textures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from ....base.arrays import Floats
from ....oracle.corners import Corners
from ....oracle.texture import corner_colors
from ....oracle.transform import unit
from ....scene.model import Material
from ....scene.texture import Texture
from ..drawing import Drawing, Edit, then
from .mistake import Edits, Mistake, of_materials, plain_materials, wrong_setting


def _textured(drawing: Drawing) -> bool:
    return any(mesh.material.texture is not None and mesh.uvs is not None for mesh in drawing.scene.meshes)


def _with_textures(change: Callable[[Texture], Texture | None]) -> Edits:
    """Return the variant of a mistake that exchanges the textures."""

    def changed(material: Material) -> Material:
        return material if material.texture is None else replace(material, texture=change(material.texture))

    return {"": lambda drawing: of_materials(drawing, changed)}


def _in_texels(change: Callable[[Floats], Floats]) -> Edit:
    """Return an edit that changes the coordinates in texels."""

    def edit(drawing: Drawing) -> Drawing:
        textures = [mesh.material.texture for mesh in drawing.scene.meshes]
        shapes = [(2, 2) if texture is None else texture.image.shape for texture in textures]
        sizes = np.array([(max(columns - 1, 1), max(rows - 1, 1)) for rows, columns, *_ in shapes])

        def moved(corners: Corners) -> Corners:
            size = sizes[corners.mesh][:, None]
            uvs = change(np.clip(corners.uvs, 0.0, 1.0) * size) / size
            return replace(corners, uv_sets=uvs[:, :, None])

        return then(corners=moved)(drawing)

    return edit


def _mean(values: Floats) -> Floats:
    return np.repeat(values.mean(axis=1, keepdims=True), 3, axis=1)


def _flat(drawing: Drawing) -> Drawing:
    """Return the drawing with means of what triangles have at their corners: of texels, where these are looked up there."""
    scene, settings = drawing.scene, drawing.settings
    at_corners = settings.texture_at == "vertex"

    def flat(corners: Corners) -> Corners:
        faces = np.arange(len(corners.mesh))
        textured = replace(corners, scene=scene)  # with its textures
        colors = corner_colors(settings, textured, faces) if at_corners else corners.colors
        return replace(
            corners, colors=_mean(colors), normals=unit(_mean(corners.normals)), uv_sets=_mean(corners.uv_sets)
        )

    return then(corners=flat)(plain_materials(drawing) if at_corners else drawing)


_OfTexture = partial(Mistake, when=_textured)
MISTAKES = (
    Mistake(
        "the other interpolation",
        "The course interpolates linearly in the image (affine), without perspective.",
        wrong_setting("interpolation", {"affine": "perspective", "perspective": "affine"}),
    ),
    _OfTexture(
        "texture ignored", "The vertex colors are shown in place of the texture.", _with_textures(lambda texture: None)
    ),
    _OfTexture(
        "v flipped",
        "Row 0 of the texture is v = 0.",
        _with_textures(lambda texture: replace(texture, image=texture.image[::-1])),
    ),
    _OfTexture(
        "u flipped",
        "Column 0 of the texture is u = 0.",
        _with_textures(lambda texture: replace(texture, image=texture.image[:, ::-1])),
    ),
    _OfTexture(
        "u and v swapped",
        "Index texture[v, u], row first.",
        _with_textures(lambda texture: replace(texture, image=np.swapaxes(texture.image, 0, 1))),
    ),
    _OfTexture(
        "half a texel off",
        "The place in the texture is x = u*(w-1), y = v*(h-1).",
        {
            "looked up toward (0, 0)": _in_texels(lambda texels: texels - 0.5),
            "looked up away from (0, 0)": _in_texels(lambda texels: texels + 0.5),
        },
    ),
    Mistake(
        "nearest for bilinear",
        "Interpolate between four texels.",
        {"rounded": _in_texels(lambda texels: np.floor(texels + 0.5)), "down": _in_texels(np.floor)},
        lambda drawing: _textured(drawing) and drawing.settings.texture_at == "vertex",
    ),
    Mistake(
        "texture per pixel",
        "The course looks up texels at the corners.",
        wrong_setting("texture_at", {"vertex": "pixel"}),
    ),
    Mistake("one color per triangle", "Blend the colors and normals of its corners.", {"": _flat}),
)
