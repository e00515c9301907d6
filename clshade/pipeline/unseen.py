"""Why an image shows nothing, in one line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..base.arrays import Reals
from ..scene.image_part import PartCamera
from ..scene.model import Scene, Settings

# Counters of a frame -> why a triangle that they count is not drawn.
_NOT_DRAWN = {
    "behind": "behind the camera",
    "off_screen": "beside the image",
    "back_facing": "seen from behind, which is not drawn",
    "between_samples": "smaller than a pixel and between its samples",
    "zero_area": "without area",
}


def why_unseen(rgba: Reals, scene: Scene, settings: Settings, counts: Mapping[str, Any]) -> str:
    """Return a line if the scene has triangles and the image shows none of them, with the likely reason; else "".

    rgba: (M, N, 4). counts: `Frame.stats`, which the frames of other programs may lack.
    """
    if not counts.get("triangles") or isinstance(scene.camera, PartCamera):
        return ""
    if not rgba[..., 3].any():
        return f"nothing can be seen: {_not_covered(scene, counts)}"
    if not rgba[..., :3].any():
        return f"the image is black: {_dark(scene, settings)}"
    background = scene.background if settings.background == "scene" else None
    if background is not None and (rgba[..., :3] == np.float32(background)).all():
        return "nothing can be seen: all that is drawn has the color of the background"
    return ""


def _not_covered(scene: Scene, counts: Mapping[str, Any]) -> str:
    if counts["visible"]:
        materials = [mesh.material for mesh in scene.meshes if len(mesh.faces)]
        if all(material.blend and material.opacity == 0.0 for material in materials):
            return "the opacity of all materials is 0"
        if any(mesh.blends or mesh.tests_alpha for mesh in scene.meshes):
            return "alpha is 0, or below its cutoff, wherever there is a face"
        return "no face covers a sample of a pixel"
    most = max(_NOT_DRAWN, key=lambda name: counts[name])
    if counts[most] == counts["triangles"]:
        return f"every triangle is {_NOT_DRAWN[most]}"
    return f"{counts[most]:,} of {counts['triangles']:,} triangles are {_NOT_DRAWN[most]}"


def _dark(scene: Scene, settings: Settings) -> str:
    if settings.shader == "nolight":
        return "the colors and textures of all faces in view are black"
    lit = any(light.intensity.any() for light in scene.lights)
    ambient = np.any(scene.ambient) or (settings.shader == "pbr" and scene.environment is not None)
    if not lit and not ambient:
        return "the scene has no light"
    if not ambient:
        return "no light reaches the faces in view, and there is no ambient light"
    return "materials or colors of all faces in view are black"
