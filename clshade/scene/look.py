"""Looks: the background, light and ground that a scene is shown with; and changes of its lights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..base.arrays import Floats
from ..base.validation import arguments, choice, flag, number
from ..errors import InputError
from .builtin.studio import studio
from .contact_shadow import TEXELS, open_sky
from .fitting import sphere_of_box
from .framing import UPS, Up, up_of
from .geometry import bounding_box
from .ground import objects_of, with_ground
from .model import PointLight, Scene, Settings, Texture
from .settings import LOOKS, Look

BACKGROUND = 0.6  # of the studio, linear: a light gray, code 203 of sRGB
_GRAY = 0.8  # of its ground: in the middle about as bright as the background
_REACH = 1.6  # bounding radii: half the side of the square of ground that the shadow covers
_FADE = 0.6  # where the shadow begins to fade, as a part of _REACH
_SMOOTHING = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0  # of neighboring texels, along both axes


@arguments(scene=Scene, ground=flag)
def with_look(
    scene: Scene,
    look: Look,
    *,
    ground: bool = True,
    contact_shadow: bool | Texture = True,
    up: Up | None = None,
    settings: Settings | None = None,
) -> Scene:
    """Return the scene as a look shows it.

    Parameters
    ----------
    scene : Scene
        What is shown, in the pose in which it touches the ground.
    look : {"studio", "plain", "course"}
        `studio`: preset pbr, lit by an environment alone, its own or the built-in studio, before a
        light neutral background, on a ground, the last mesh, with a contact shadow. `course`: preset course.
        `plain`: the scene as it is.
    ground : bool, default True
        Whether the studio has a ground.
    contact_shadow : bool or Texture, default True
        Whether the scene darkens it; False for one that will move. The texture of a ground that it
        darkened before saves computing it again.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis that points up. Default: the one nearest to the camera's.
    settings : Settings, optional
        How it will be drawn, for the color of the ground towards its edge. Default: as its preset says.

    Notes
    -----
    The contact shadow is the ground's ambient occlusion: the share of the rays up to a bounding radius
    that meet the scene, on a grid of 1/160 of that radius, in an image of 128x128 texels that is smoothed
    over two texels to each side: in scenes tried a share is off by 0.004 to 0.01 (RMS) from one of exact
    rays. It is computed once, so that frames cost no more.
    """
    choice("with_look", "look", look, LOOKS)
    if look == "plain":
        return scene
    if look == "course":
        return replace(scene, preset="course")
    up = up_of(scene.camera) if up is None else up
    choice("with_look", "up", up, tuple(UPS))
    environment = scene.environment or studio(tuple(np.array(UPS[up][1], np.float64).tolist()))
    scene = replace(scene, preset="pbr", environment=environment, own_lights=False, background=BACKGROUND)
    if not ground:
        return scene
    scene = with_ground(scene, up, settings, gray=_GRAY)
    if contact_shadow is False or not objects_of(scene).face_count:
        return scene
    return _with_contact_shadow(scene, up, None if contact_shadow is True else contact_shadow)


def has_ground(look: Look, edges: object = None) -> bool:
    """Whether a look has a ground on the command line: the studio, unless edges are drawn, which its own would join."""
    return look == "studio" and not edges


def _with_contact_shadow(scene: Scene, up: Up, shadow: Texture | None) -> Scene:
    """Return the scene with the shadow, if it is known, of what stands on its ground, the last mesh."""
    *others, ground = scene.meshes
    axes = np.array(UPS[up], np.float64)
    low, high = bounding_box(objects_of(scene))
    _, radius = sphere_of_box(low, high)
    middle = ground.verts[0].astype(np.float64)
    right, away = axes[0], -axes[2]
    if shadow is None:
        image = np.repeat(_share_of_light(scene, middle, right, away, radius)[..., None], 3, axis=2)
        shadow = Texture(image, "clamp", name="contact shadow")
    place = (ground.verts - middle) / (2.0 * _REACH * radius)
    uvs = 0.5 + np.stack([place @ right, place @ away], axis=1)
    material = replace(ground.material, texture=shadow)
    return replace(scene, meshes=(*others, replace(ground, uvs=uvs, material=material)))


def _share_of_light(scene: Scene, middle: Floats, right: Floats, away: Floats, radius: float) -> Floats:
    """Return the share of the light from above that reaches a square of the ground, (TEXELS, TEXELS): rows go along `away`,
    columns along `right`.

    middle: of the square. radius: of the bounding sphere of what stands on the ground.
    """
    unit = 2.0 * _REACH * radius / TEXELS
    axes = np.stack([right, away, np.cross(right, away)])
    corner = middle - 0.5 * TEXELS * unit * (right + away)
    open_ = open_sky(objects_of(scene), corner, axes, unit, round(TEXELS / (2 * _REACH)))
    for axis in (0, 1):
        padded = np.pad(open_, [(2, 2) if k == axis else (0, 0) for k in (0, 1)], constant_values=1.0)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 5, axis=axis)
        open_ = windows @ _SMOOTHING
    at = np.linspace(-1.0, 1.0, TEXELS)  # on the border there is no shadow: its texels are repeated outside
    x = np.clip((1.0 - np.sqrt(at[:, None] ** 2 + at * at)) / (1.0 - _FADE), 0.0, 1.0)
    return np.asarray(1.0 - (1.0 - open_) * x * x * (3.0 - 2.0 * x))


def with_lights(scene: Scene, chosen: Sequence[int], option: str = "lights") -> Scene:
    """Return the scene with only the lights of these indices, its own from now on. Raises InputError, naming `option`,
    for an index that it lacks."""
    for index in chosen:
        if not scene.lights:
            raise InputError(f"{option}: the scene has no lights")
        if not 0 <= index < len(scene.lights):
            raise InputError(f"{option}: expected indices from 0 to {len(scene.lights) - 1}, found {index}")
    return replace(scene, lights=tuple(scene.lights[i] for i in dict.fromkeys(chosen)), own_lights=True)


def scaled_lights(scene: Scene, factors: Sequence[float], option: str = "light intensity") -> Scene:
    """Return the scene with its lights' intensities multiplied by `factors`, at least 0: one for each light, or one for all.
    Raises InputError, naming `option`."""
    count = len(scene.lights)
    if len(factors) not in (1, count):
        expected = f"one factor, or {count}: one for each light" if count > 1 else "one factor"
        raise InputError(f"{option}: expected {expected}, found {len(factors)}")
    scales = [number("scene", option, factor, least=0.0) for factor in factors]
    scales = scales * count if len(scales) == 1 else scales
    lights = zip(scene.lights, scales, strict=True)
    return replace(scene, lights=tuple(replace(light, intensity=light.intensity * scale) for light, scale in lights))


def sized_lights(scene: Scene, radius: float, option: str = "light radius") -> Scene:
    """Return the scene with spheres of this radius, scene units, for its point lights. Raises InputError, naming `option`,
    for a radius below 0 or a scene without point lights."""
    size = number("scene", option, radius, least=0.0)
    if not any(isinstance(light, PointLight) for light in scene.lights):
        raise InputError(f"{option}: the scene has no point lights")
    lights = (replace(light, radius=size) if isinstance(light, PointLight) else light for light in scene.lights)
    return replace(scene, lights=tuple(lights))
