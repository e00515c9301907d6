"""The scene and settings that the arguments of `render` and its like mean."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..base.validation import choice, known, value_error
from ..errors import InputError
from ..scene.builtin.studio import without_stand_ins
from ..scene.geometry import bounding_box, half_diagonal
from ..scene.ground import objects_of
from ..scene.lights import RectangleLight
from ..scene.model import Scene, Settings
from ..scene.settings import PAPER, PRESETS, Layer, Preset, SettingsFields
from .shading_tables import textures_of

if TYPE_CHECKING:
    from typing_extensions import Unpack

AO_DISTANCE = 0.2  # of the diagonal of the scene's bounding box
_KEYWORDS = ("resolution", "preset", "settings", "device")  # of `render`, besides the fields of Settings
_KEYWORD_WORDS = {"size": "resolution", "width": "resolution", "height": "resolution", "spp": "samples"}
_KEYWORD_REMARKS = dict.fromkeys(
    ("camera", "lights"),
    "it is a part of the scene, see dataclasses.replace; Renderer(scene).render(camera) takes other cameras",
)


def effective_settings(
    scene: Scene,
    preset: Preset | None = None,
    settings: Settings | None = None,
    resolution: tuple[int, int] | None = None,
    **fields: Unpack[SettingsFields],
) -> tuple[Scene, Settings]:
    """Return the scene and settings that a call's arguments mean: `resolution` replaces the resolution of the scene's
    camera; the other fields replace those of `settings`, or of the preset (default: the scene's own). A distance of
    ambient occlusion that is None becomes a number if there is any."""
    if not isinstance(scene, Scene):
        expected = "a Scene, such as clshade.load(path) or clshade.builtin(name) gives"
        raise value_error("render", "scene", expected, scene)
    allowed = (*Settings.__dataclass_fields__, *_KEYWORDS)
    known("render", fields, allowed, words=_KEYWORD_WORDS, remarks=_KEYWORD_REMARKS)
    if resolution is not None:
        scene = replace(scene, camera=scene.camera.with_resolution(resolution))
    if preset is not None and {choice("Settings", "preset", preset, PRESETS), scene.preset} == {"standard", "pbr"}:
        scene = replace(scene, preset=preset)  # which names the tone map
    if settings is None:
        chosen = Settings.from_preset(scene.preset if preset is None else preset, **fields)
    elif preset is not None:
        raise InputError("render: settings: expected either settings or a preset, found both")
    elif not isinstance(settings, Settings):
        raise value_error("render", "settings", "a Settings", settings)
    else:
        chosen = replace(settings, **fields)
    if chosen.ambient_occlusion and chosen.ao_distance is None:
        distance = min(2.0 * AO_DISTANCE * half_diagonal(*bounding_box(scene)), sys.float_info.max)
        chosen = replace(chosen, ao_distance=distance or 1.0)  # whatever, of a scene without a size
    return _shown(scene, chosen), chosen


def _shown(scene: Scene, settings: Settings) -> Scene:
    """Return the scene as the settings show it. Its own background stays if they name none, but is paper behind lines
    alone."""
    scene = without_stand_ins(scene) if settings.shader == "pbr" else scene
    if settings.background == "environment":
        if scene.environment is None:
            needed = "an environment (Scene.environment; --environment FILE or studio)"
            raise InputError(f"render: background: environment needs {needed}")
        scene = replace(scene, background=0.0)  # what is behind that is not seen
    elif settings.background != "scene":
        scene = replace(scene, background=settings.background)
    elif settings.edges is not None and settings.edges.only:
        scene = replace(scene, background=PAPER)
    return scene


def numbers_alone(settings: Settings, layers: tuple[Layer, ...]) -> Settings:
    """Return settings with which each sample shows the same triangle, unlit, and these layers of numbers."""
    plain: dict[str, Any] = {"shader": "nolight", "sample_shading": False, "shadows": False, "ambient_occlusion": 0}
    plain |= {"texture_filter": "bilinear", "scalars": None, "edges": None, "background": None}
    return replace(settings, **plain, layers=layers)


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
    all_fields = {**vars(Settings.from_preset(preset)), **usual, **given}
    is_pbr = all_fields["shader"] == "pbr"
    lights_shine = not is_pbr or scene.own_lights
    if given.get("shadows") and not lights_shine:
        usual["ambient_occlusion"] = OCCLUSION_RAYS
    varies = (all_fields["shadows"] and lights_shine) or {**usual, **given}.get("ambient_occlusion")
    varies = varies or any(textures_of(mesh, maps=is_pbr) for mesh in objects_of(scene).meshes)
    if all_fields["samples"] > 1 and varies:
        usual["sample_shading"] = True
    return {**usual, **given}


def changed_fields(settings: Settings, scene: Scene, preset: Preset, **given: Any) -> dict[str, Any]:
    """Return the fields of Settings that `render` has to be given with this preset to draw the scene with these settings.
    given: those that it is given in any case."""
    values, last = vars(settings), ("ambient_occlusion", "sample_shading")  # whose usual values depend on others
    for name in [key for key in (*(value for value in values if value not in last), *last) if key not in given]:
        usual = {**vars(Settings.from_preset(preset)), **picture_fields(scene, preset, **given)}
        if values[name] != usual[name]:
            given[name] = values[name]
    return given
