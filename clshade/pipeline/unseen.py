"""Why an image shows nothing, in one line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..base.arrays import Reals
from ..scene.geometry import in_image
from ..scene.ground import objects_of
from ..scene.image_part import PartCamera
from ..scene.model import Scene, Settings
from .placements import mirroring

# Counters of a frame -> why a triangle that they count is not drawn.
_NOT_DRAWN = {
    "behind": "behind the camera",
    "off_screen": "beside the image",
    "back_facing": "seen from behind, which is not drawn",
    "between_samples": "smaller than a pixel and between its samples",
    "zero_area": "without area",
}
_BLOCK = 1 << 14  # triangles that are looked at together
_FLAT = 1e-9  # an area in the image, as a share of the squares of two sides, that is the rounding of none


def why_unseen(rgba: Reals, scene: Scene, settings: Settings, counts: Mapping[str, Any]) -> str:
    """Return a line if the scene has triangles and the image shows none of them, with the likely reason; else "". A ground
    does not count.

    rgba: (M, N, 4). counts: `Frame.stats`, which the frames of other programs may lack.
    """
    if not counts.get("triangles") or isinstance(scene.camera, PartCamera):
        return ""
    objects, is_empty = objects_of(scene), not (rgba[::16, ::16, 3].any() or rgba[..., 3].any())
    grounds = scene.face_count - objects.face_count
    if is_empty or (grounds and objects.face_count and counts["visible"] <= grounds and settings.edges is None):
        own = _object_counts(objects, settings) if grounds else counts
        if is_empty or not own["visible"] or _is_clear(objects):
            return f"nothing can be seen{'' if is_empty else ' but the ground'}: {_not_covered(objects, own)}"
    few, rgb = rgba[::16, ::16, :3], rgba[..., :3]  # a few pixels tell it of most images
    if not few.any() and not rgb.any():
        return f"the image is black: {_dark(scene, settings)}"
    background = scene.background if settings.background == "scene" else None
    if background is not None and all((some == np.float32(background)).all() for some in (few, rgb)):
        return "nothing can be seen: all that is drawn has the color of the background"
    return ""


@np.errstate(over="ignore", invalid="ignore")
def _object_counts(scene: Scene, settings: Settings) -> dict[str, int]:
    """Count triangles by why they cannot be seen, as `Frame.stats` does, up to the first block of which some may be."""
    counts = {"triangles": scene.face_count, "visible": 0, **dict.fromkeys(_NOT_DRAWN, 0)}
    placed = ((mesh, matrix) for mesh in scene.meshes for matrix in mesh.instances)
    for mesh, matrix, first in ((*pair, first) for pair in placed for first in range(0, len(pair[0].faces), _BLOCK)):
        corners = mesh.verts[mesh.faces[first : first + _BLOCK]].astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        places, depths = in_image(scene.camera, corners.reshape(-1, 3) - scene.camera.eye)
        places = places.reshape(-1, 3, 2)
        one, other = places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
        area = one[:, 1] * other[:, 0] - one[:, 0] * other[:, 1]  # positive where counter-clockwise
        beside: Any = (places < 0.0).all(axis=1) | (places > np.array(scene.camera.resolution)).all(axis=1)
        culls = settings.cull or mesh.material.sides == "front"
        left = np.ones(len(places), bool)
        for name, fault in {
            "behind": (depths.reshape(-1, 3) <= 0.0).all(axis=1),
            "off_screen": beside.any(axis=1),
            "zero_area": np.abs(area) <= _FLAT * (one * one + other * other).sum(axis=1),
            "back_facing": (area > 0.0 if mirroring(matrix[None])[0] else area < 0.0) & culls,
        }.items():
            counts[name] += int((left & fault).sum())
            left &= ~fault
        counts["visible"] += int(left.sum())
        if counts["visible"]:
            break
    return counts


def _is_clear(scene: Scene) -> bool:
    materials = [mesh.material for mesh in scene.meshes if len(mesh.faces)]
    return all(material.blend and material.opacity == 0.0 for material in materials)


def _not_covered(scene: Scene, counts: Mapping[str, Any]) -> str:
    if counts["visible"]:
        if _is_clear(scene):
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
    if np.any(scene.ambient) or (settings.shader == "pbr" and scene.environment is not None):
        return "materials or colors of all faces in view are black"
    if any(light.intensity.any() for light in scene.lights):
        return "no light reaches the faces in view, and there is no ambient light"
    return "the scene has no light"
