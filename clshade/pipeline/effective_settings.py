"""The scene and settings that the arguments of `render` and its like mean."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING

from ..base.validation import choice, known, value_error
from ..errors import InputError
from ..scene.builtin.studio import without_stand_ins
from ..scene.edges import PAPER
from ..scene.geometry import bounding_box, half_diagonal
from ..scene.model import Scene, Settings
from ..scene.settings import PRESETS, Layer, Preset, SettingsFields

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
        raise value_error(
            "render", "scene", "a Scene, such as clshade.load(path) or clshade.builtin(name) gives", scene
        )
    allowed = (*Settings.__dataclass_fields__, *_KEYWORDS)
    known("render", fields, allowed, words=_KEYWORD_WORDS, remarks=_KEYWORD_REMARKS)
    if resolution is not None:
        scene = replace(scene, camera=scene.camera.with_resolution(resolution))
    if preset is not None and {choice("Settings", "preset", preset, PRESETS), scene.preset} == {"standard", "pbr"}:
        scene = replace(scene, preset=preset)  # which names the tone map
    if settings is None:
        chosen = Settings.from_preset(scene.preset if preset is None else preset, **fields)
        return _shown(scene, chosen), _with_distance(scene, chosen)
    if preset is not None:
        raise InputError("render: settings: expected either settings or a preset, found both")
    if not isinstance(settings, Settings):
        raise value_error("render", "settings", "a Settings", settings)
    chosen = replace(settings, **fields)
    return _shown(scene, chosen), _with_distance(scene, chosen)


def _with_distance(scene: Scene, settings: Settings) -> Settings:
    """Return the settings with a distance of ambient occlusion, if they ask for any."""
    if not settings.ambient_occlusion or settings.ao_distance is not None:
        return settings
    distance = min(2.0 * AO_DISTANCE * half_diagonal(*bounding_box(scene)), sys.float_info.max)
    return replace(settings, ao_distance=distance or 1.0)  # whatever, of a scene without a size


def _shown(scene: Scene, settings: Settings) -> Scene:
    """Return the scene as the settings show it."""
    scene = _with_background(scene, settings)
    scene = without_stand_ins(scene) if settings.shader == "pbr" else scene
    if settings.background == "environment" and scene.environment is None:
        raise InputError(
            "render: background: environment needs an environment (Scene.environment; --environment FILE or studio)"
        )
    return scene


def _with_background(scene: Scene, settings: Settings) -> Scene:
    """Return the scene with the background of the settings; without one, and if only lines are drawn, with theirs."""
    if settings.background == "environment":
        return replace(scene, background=0.0)  # what is behind that is not seen
    if settings.background != "scene":
        return replace(scene, background=settings.background)
    return replace(scene, background=PAPER) if settings.edges is not None and settings.edges.only else scene


def numbers_alone(settings: Settings, layers: tuple[Layer, ...]) -> Settings:
    """Return settings with which each sample shows the same triangle, unlit, and these layers of numbers."""
    return replace(
        settings,
        shader="nolight",
        layers=layers,
        sample_shading=False,
        shadows=False,
        ambient_occlusion=0,
        texture_filter="bilinear",
        scalars=None,
        edges=None,
        background=None,
    )
