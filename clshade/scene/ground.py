"""A ground: a round matte floor below a scene, which fades into the background."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..base.arrays import Array, Floats
from ..base.validation import choice, value_error
from .builtin.studio import studio, without_stand_ins
from .framing import UPS, Up, sphere_of_box, up_of
from .geometry import bounding_box
from .image_light import irradiance_at, irradiance_coefficients
from .lights import DirectionalLight, Light
from .model import Material, Mesh, Scene, Settings

GRAY = (0.2, 0.6)  # linear, of the middle: from dark to bright backgrounds
_OF_BACKGROUND = 0.6  # in between
MATERIAL = Material(ka=1.0, kd=1.0, ks=0.0, sides="front", name="clshade ground")  # whose name a ground is known by
_RADIUS = 9.0  # bounding radii of the scene
_CLEAR, _HALF = 0.7, 3.0  # radii within which the ground has its own color, and about which it fades
_BELOW = 1e-3  # gap to the lowest point, bounding radii: surfaces that touch the ground are not cut by it
_RINGS, _SECTORS = 24, 96


def with_ground(
    scene: Scene, up: Up | None = None, settings: Settings | None = None, *, gray: float | None = None
) -> Scene:
    """Return the scene with a ground below it, its last mesh: neutral and matte, just below the lowest point, seen from
    above alone.

    up: axis that points up; default: the one nearest to the camera's. settings: how the scene will be drawn, for the color
    towards the edge; default: as its preset says. gray: color of the middle, linear; default: by the background, 0.2 to
    0.6.

    Towards its edge, nine bounding radii from the middle, the ground takes the color that the scene's lights, or its
    environment, need to give the background's; over nothing or an environment it keeps its own. Cameras and named views
    that fit a scene leave its ground out. Where shader `pbr` lights the scene by the studio, that becomes its environment,
    with the ceiling above the ground in every view.

    Raises InputError if the axis is unknown, or a position leaves the range of float64.
    """
    up = up_of(scene.camera) if up is None else up
    choice("with_ground", "up", up, tuple(UPS))
    settings = Settings.from_preset(scene.preset) if settings is None else settings
    if not isinstance(settings, Settings):
        raise value_error("with_ground", "settings", "a Settings", settings)
    axes = np.array(UPS[up], np.float64)
    if settings.shader == "pbr" and not scene.own_lights and scene.environment is None:
        scene = replace(scene, environment=studio(tuple(axes[1].tolist())))
    meshes = objects_of(scene).meshes
    low, high = bounding_box(meshes)
    center, radius = sphere_of_box(low, high)
    foot = float(np.abs(axes[1]) @ (high / 2 - low / 2))
    with np.errstate(over="ignore", invalid="ignore"):  # Mesh refuses an overflow
        middle = center - axes[1] * (foot + _BELOW * radius)
        rings = _RADIUS * np.linspace(0.0, 1.0, _RINGS + 1)[1:] ** 1.5
        turns = np.linspace(0.0, 2.0 * np.pi, _SECTORS, endpoint=False)
        across = np.stack([np.cos(turns), -np.sin(turns)], axis=1) @ axes[[0, 2]]
        verts = np.vstack([[middle], (middle + radius * rings[:, None, None] * across).reshape(-1, 3)])
    share = np.repeat(np.r_[0.0, _fading(rings)], [1, *[_SECTORS] * _RINGS])
    with np.errstate(over="ignore"):
        # In float64 it would make the kernels keep all positions so, which only those far from the origin need.
        if np.spacing(np.float32(np.abs(verts).max())) < 0.1 * _BELOW * radius:
            verts = verts.astype(np.result_type(np.float32, *(mesh.verts.dtype for mesh in meshes)))
    faces = _disc()
    ground = Mesh(verts, faces, None, axes[1:2], np.zeros_like(faces), material=MATERIAL, name="ground")
    colors = _colors(replace(scene, meshes=(*meshes, ground)), settings, axes[1], share, gray)
    return replace(scene, meshes=(*meshes, replace(ground, colors=colors)))


def objects_of(scene: Scene) -> Scene:
    """Return the scene without its ground."""
    meshes = tuple(mesh for mesh in scene.meshes if mesh.material.name != MATERIAL.name)
    return scene if len(meshes) == len(scene.meshes) else replace(scene, meshes=meshes)


def _fading(radii: Floats) -> Floats:
    """Return the share of the background: 0 to _CLEAR, then a smooth step to 1 at _RADIUS, even as perspective shows it."""
    x, start, end = (r / (r + _HALF) for r in (np.maximum(radii, _CLEAR), _CLEAR, _RADIUS))
    x = (x - start) / (end - start)
    return np.asarray(x * x * x * (x * (6.0 * x - 15.0) + 10.0))


def _colors(scene: Scene, settings: Settings, up: Floats, share: Floats, gray: float | None) -> Floats:
    """Return the colors at the vertices of the ground, the scene's last mesh: a gray, and by the share (V,) those with which
    it looks like the background."""
    background = scene.background if settings.background == "scene" else settings.background
    verts = scene.meshes[-1].verts.astype(np.float64)
    if background is None or isinstance(background, str):  # an environment, which is no color
        return np.full(verts.shape, GRAY[0] if gray is None else gray)
    if gray is None:
        gray = float(np.clip(_OF_BACKGROUND * np.mean(background), *GRAY))
    tinted, plain = _light(scene, settings, verts, up)
    shown = (1.0 - share[:, None]) * gray * tinted + share[:, None] * np.maximum(background - plain, 0.0)
    with np.errstate(over="ignore"):
        colors = np.divide(shown, tinted, out=np.full(verts.shape, gray), where=tinted > 0.0)
    return np.asarray(np.minimum(colors, np.finfo(np.float32).max))


def _light(scene: Scene, settings: Settings, verts: Floats, up: Floats) -> tuple[Floats, Floats]:
    """Return the light that a white ground, the scene's last mesh, sends: the part that its color multiplies, (V, 3), and
    the part that it does not, (3,)."""
    if settings.shader == "nolight":
        return np.ones(verts.shape), np.zeros(3)
    scene = without_stand_ins(scene) if settings.shader == "pbr" else scene
    ambient = scene.meshes[-1].material.ka * scene.ambient
    tinted, plain = (ambient, np.zeros(3)) if settings.ambient == "tinted" else (np.zeros(3), ambient)
    total = np.tile(tinted, (len(verts), 1))
    for light in scene.lights:
        total += _arriving(light, verts, up)[:, None] * light.intensity
    if settings.shader == "pbr" and scene.environment is not None:
        total += irradiance_at(irradiance_coefficients(scene.environment), up)
    return total, plain


def _arriving(light: Light, verts: Floats, up: Floats) -> Floats:
    """Return which part (V,) of a light's intensity reaches the ground; of a light of finite size from its center."""
    if isinstance(light, DirectionalLight):
        return np.full(len(verts), max(float(-light.axis @ up), 0.0))
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # of what Mesh refuses
        towards = light.position - verts
        scale = np.frexp(np.abs(towards).max())[1]
        scaled = np.ldexp(towards, -scale)  # squares neither overflow nor vanish
        length = np.linalg.norm(scaled, axis=1)
        towards = scaled / np.where(length > 0.0, length, 1.0)[:, None]
        arriving = np.maximum(towards @ up, 0.0) * light.profile(-towards)
        if light.attenuates:
            distance = np.ldexp(length, scale)
            window = 1.0 if light.range is None else np.clip(1.0 - (distance / light.range) ** 4, 0.0, 1.0)
            arriving = arriving * np.where(distance > 0.0, window / distance**2, 0.0)
    return np.asarray(arriving)


def _disc() -> Array:
    """Return the faces of rings of vertices around vertex 0, counter-clockwise seen from above."""
    sector, first = np.arange(_SECTORS), 1 + _SECTORS * np.arange(_RINGS)[:, None]
    a, b = first + sector, first + (sector + 1) % _SECTORS
    inner = np.stack([np.zeros_like(sector), a[0], b[0]], axis=1)
    outer = np.array([[a[:-1], a[1:], b[1:]], [a[:-1], b[1:], b[:-1]]]).transpose(2, 0, 3, 1)
    return np.concatenate([inner, outer.reshape(-1, 3)]).astype(np.int32)
