"""Looks: the background, light and ground that a scene is shown with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..base.arrays import Floats
from ..base.validation import arguments, choice, flag
from ..scene.builtin.studio import studio
from ..scene.camera import Camera
from ..scene.fitting import sphere_of_box
from ..scene.framing import UPS, Up, up_of
from ..scene.geometry import bounding_box
from ..scene.ground import objects_of, with_ground
from ..scene.model import Scene, Settings, Texture
from ..scene.settings import LOOKS, Look

BACKGROUND = 0.6  # of the studio, linear: a light gray, code 203 of sRGB
_GRAY = 0.8  # of its ground: in the middle about as bright as the background
_REACH = 1.6  # bounding radii: half the side of the square of ground that the shadow covers
_FADE = 0.6  # where the shadow begins to fade, as a part of _REACH
_TEXELS, _RAYS = 128, 64  # of its image
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
    device: str | None = None,
) -> Scene:
    """Return the scene as a look shows it.

    Parameters
    ----------
    scene : Scene
        What is shown, in the pose in which it touches the ground.
    look : {"studio", "plain", "course"}
        `studio`: preset pbr, lit by an environment alone, its own or the built-in studio, before a
        light neutral background, on a ground with a contact shadow. `course`: preset course.
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
    device : str, optional
        As of `clshade.render`; the contact shadow is computed there.

    Returns
    -------
    Scene
        With the studio a scene of preset pbr; its ground is the last mesh.

    Raises
    ------
    InputError
        The look or the axis is unknown.

    Notes
    -----
    The contact shadow is the ground's ambient occlusion: the share of the rays up to a bounding radius
    that meet the scene, as `Settings.ambient_occlusion` counts them, in an image of 128x128 texels that
    is smoothed over two texels to each side: with 64 rays a share is off by 0.003 (RMS), at most 0.02,
    in scenes tried, from one of 1024 rays. It is computed once, so that frames cost no more.
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
    return _with_contact_shadow(scene, up, device, None if contact_shadow is True else contact_shadow)


def has_ground(look: Look, edges: object = None) -> bool:
    """Whether a look has a ground on the command line: the studio, unless edges are drawn, which its own would join."""
    return look == "studio" and not edges


def _with_contact_shadow(scene: Scene, up: Up, device: str | None, shadow: Texture | None) -> Scene:
    """Return the scene with the shadow, if it is known, of what stands on its ground, the last mesh."""
    *others, ground = scene.meshes
    axes = np.array(UPS[up], np.float64)
    low, high = bounding_box(objects_of(scene))
    _, radius = sphere_of_box(low, high)
    middle = ground.verts[0].astype(np.float64)
    right, away = axes[0], -axes[2]
    if shadow is None:
        gap = float(axes[1] @ ((low if axes[1].sum() > 0.0 else high) - middle))  # below the lowest point
        image = np.repeat(_open_sky(scene, middle, right, away, radius, gap, device)[..., None], 3, axis=2)
        shadow = Texture(image, "clamp", name="contact shadow")
    place = (ground.verts - middle) / (2.0 * _REACH * radius)
    uvs = 0.5 + np.stack([place @ right, place @ away], axis=1)
    material = replace(ground.material, texture=shadow)
    return replace(scene, meshes=(*others, replace(ground, uvs=uvs, material=material)))


def _open_sky(
    scene: Scene, middle: Floats, right: Floats, away: Floats, radius: float, gap: float, device: str | None
) -> Floats:
    """Return the share of the light from above that reaches a square of the ground, (_TEXELS, _TEXELS): rows go along
    `away`, columns along `right`.

    middle: of the square. radius: of the bounding sphere of what stands on the ground. gap: between the two.
    """
    from .renderer import Renderer

    up = np.cross(right, away)
    side = 2.0 * _REACH * radius
    # It looks down from between the ground and what stands on it.
    eye = middle + 0.5 * gap * up
    camera = Camera(eye, middle, away, 1.0, (side, side), (_TEXELS, _TEXELS), orthographic=True)
    seen = replace(scene, camera=camera, lights=())
    settings = Settings(
        shader="nolight", layers=("AO",), samples=1, near=0.01 * gap, ambient_occlusion=_RAYS, ao_distance=radius
    )
    with Renderer(seen, settings=settings, device=device) as renderer:
        open_ = np.nan_to_num(renderer.render()["AO"].astype(np.float64), nan=1.0)[::-1]
    for axis in (0, 1):
        padded = np.pad(open_, [(2, 2) if k == axis else (0, 0) for k in (0, 1)], constant_values=1.0)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 5, axis=axis)
        open_ = windows @ _SMOOTHING
    at = np.linspace(-1.0, 1.0, _TEXELS)  # on the border there is no shadow: its texels are repeated outside
    x = np.clip((1.0 - np.hypot(at[:, None], at)) / (1.0 - _FADE), 0.0, 1.0)
    return np.asarray(1.0 - (1.0 - open_) * x * x * (3.0 - 2.0 * x))
