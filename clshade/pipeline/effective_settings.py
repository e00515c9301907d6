"""The scene and settings that the arguments of `render` and its like mean."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..base.validation import known, value_error
from ..errors import InputError
from ..scene.edges import PAPER
from ..scene.model import Scene, Settings
from ..scene.settings import Preset, SettingsFields

if TYPE_CHECKING:
    from typing_extensions import Unpack

_KEYWORDS = ("resolution", "preset", "settings", "device")  # of `render`, besides the fields of Settings
_KEYWORD_WORDS = {"size": "resolution", "width": "resolution", "height": "resolution", "spp": "samples"}
_KEYWORD_REMARKS = dict.fromkeys(
    ("camera", "lights", "background"),
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
    camera; the other fields replace those of `settings`, or of the preset (default: the scene's own)."""
    if not isinstance(scene, Scene):
        raise value_error(
            "render", "scene", "a Scene, such as clshade.load(path) or clshade.builtin(name) gives", scene
        )
    allowed = (*Settings.__dataclass_fields__, *_KEYWORDS)
    known("render", fields, allowed, words=_KEYWORD_WORDS, remarks=_KEYWORD_REMARKS)
    if resolution is not None:
        scene = replace(scene, camera=scene.camera.with_resolution(resolution))
    if settings is None:
        chosen = Settings.from_preset(scene.preset if preset is None else preset, **fields)
        return _on_paper(scene, chosen), chosen
    if preset is not None:
        raise InputError("render: settings: expected either settings or a preset, found both")
    if not isinstance(settings, Settings):
        raise value_error("render", "settings", "a Settings", settings)
    chosen = replace(settings, **fields)
    return _on_paper(scene, chosen), chosen


def _on_paper(scene: Scene, settings: Settings) -> Scene:
    """Return the scene with the background of line drawings, if only lines are drawn."""
    return replace(scene, background=PAPER) if settings.edges is not None and settings.edges.only else scene
