"""Settings of pictures from the command line, which people look at: those of Python serve measuring as well."""

from __future__ import annotations

from typing import Any

from ..scene.ground import objects_of
from ..scene.lights import RectangleLight
from ..scene.model import Scene, Settings
from ..scene.settings import Preset
from .maps import textures_of

SAMPLES = 4
OCCLUSION_RAYS = 16  # from each sample


def picture_fields(scene: Scene, preset: Preset | None = None, **given: Any) -> dict[str, Any]:
    """Return fields of Settings: those that were given, and those in which pictures differ from the preset.

    preset: the one that was asked for, None: the scene's. Pictures of the course stay as it draws them. Others have

    - 4 samples, each lit by itself where textures, shadows or occlusion vary inside of triangles;
    - soft shadows under a RectangleLight;
    - ambient occlusion where shadows are asked for and all light comes from an environment.
    """
    preset = preset or scene.preset
    if "course" in (scene.preset, preset):
        return {"samples": 1, **given}
    usual: dict[str, Any] = {"samples": SAMPLES}
    if any(isinstance(light, RectangleLight) for light in scene.lights):
        usual["shadows"] = True
    known = {**vars(Settings.from_preset(preset)), **usual, **given}
    lights_shine = known["shader"] != "pbr" or scene.own_lights
    if given.get("shadows") and not lights_shine:
        usual["ambient_occlusion"] = OCCLUSION_RAYS
    varies = (
        (known["shadows"] and lights_shine)
        or {**usual, **given}.get("ambient_occlusion")
        or any(textures_of(mesh, maps=known["shader"] == "pbr") for mesh in objects_of(scene).meshes)
    )
    if varies and known["samples"] > 1:
        usual["sample_shading"] = True
    return {**usual, **given}


def changed_fields(settings: Settings, scene: Scene, preset: Preset, **given: Any) -> dict[str, Any]:
    """Return the fields of Settings that `render` has to be given with this preset to draw the scene with these settings.
    given: those that it is given in any case."""
    values, last = vars(settings), ("ambient_occlusion", "sample_shading")  # whose usual values depend on others
    for name in (
        *(each for each in values if each not in (*last, *given)),
        *(each for each in last if each not in given),
    ):
        usual = {**vars(Settings.from_preset(preset)), **picture_fields(scene, preset, **given)}
        if values[name] != usual[name]:
            given[name] = values[name]
    return given
