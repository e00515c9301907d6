"""Mistakes in the light: wrong directions, and wrong terms."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from ...base.arrays import Floats
from ...oracle.terms import Directions, mirrored, power
from ...oracle.vectors import dot, unit
from ...scene.model import Scene
from .drawing import Drawing, Shade

Variant = tuple[str, Callable[[Drawing], Drawing]]
Value = Callable[[Directions, Floats], Floats]


# Directions. Positions are relative to the eye, which lies at 0.


def _directed(drawing: Drawing, change: Callable[[Directions, Floats, Floats, Floats, Scene], Directions]) -> Drawing:
    """Return the drawing with other directions. change: from those so far, point, light, normal and scene."""
    before = drawing.light.directions

    def directions(point: Floats, normal: Floats, eye: Floats, light: Floats) -> Directions:
        return change(before(point, normal, eye, light), point, light, normal, drawing.scene)

    return replace(drawing, light=drawing.light._replace(directions=directions))


def _shorter(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(normal=normal)


def unnormalized(drawing: Drawing) -> Iterator[Variant]:
    yield "", partial(_directed, change=_shorter)


def _view_back(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_eye=-at.to_eye)


def _view_of_origin(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_eye=unit(-scene.camera.eye - point))


def _view_from_target(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_eye=unit(scene.camera.lookat - scene.camera.eye - point))


def _view_of_camera(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_eye=unit(scene.camera.eye - scene.camera.lookat) + np.zeros_like(at.to_eye))


def _view_by_position(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_eye=unit(scene.camera.eye) + np.zeros_like(at.to_eye))


def wrong_view(drawing: Drawing) -> Iterator[Variant]:
    yield "away from the eye, P - eye", partial(_directed, change=_view_back)
    yield "toward the origin, -P", partial(_directed, change=_view_of_origin)
    yield "toward lookat", partial(_directed, change=_view_from_target)
    yield "the same everywhere, eye - lookat", partial(_directed, change=_view_of_camera)
    yield "the eye's position itself", partial(_directed, change=_view_by_position)


def _light_back(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_light=-at.to_light)


def _light_by_position(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_light=unit(light + scene.camera.eye) + np.zeros_like(at.to_light))


def _light_from_eye(at: Directions, point: Floats, light: Floats, normal: Floats, scene: Scene) -> Directions:
    return at._replace(to_light=unit(light) + np.zeros_like(at.to_light))


def wrong_light(drawing: Drawing) -> Iterator[Variant]:
    yield "away from the light, P - position", partial(_directed, change=_light_back)
    yield "the light's position itself", partial(_directed, change=_light_by_position)
    yield "from the eye, position - eye", partial(_directed, change=_light_from_eye)


# Terms


def _with_term(drawing: Drawing, name: str, value: Value) -> Drawing:
    return replace(drawing, light=drawing.light._replace(terms={**drawing.light.terms, name: value}))


def _term(name: str, value: Value) -> Callable[[Drawing], Iterator[Variant]]:
    """Return the variants of a mistake that replaces the term of a coefficient."""

    def variants(drawing: Drawing) -> Iterator[Variant]:
        yield "", partial(_with_term, name=name, value=value)

    return variants


def _cosine(at: Directions, n: Floats) -> Floats:
    return at.n_l


def _magnitude(at: Directions, n: Floats) -> Floats:
    return np.abs(at.n_l)


def _everywhere(at: Directions, n: Floats) -> Floats:
    return power(*mirrored(at), n)


def _both_ways(at: Directions, n: Floats) -> Floats:
    cosine, distance2 = mirrored(at)
    near = np.where(cosine < 0.0, 4.0 - distance2, distance2)  # |R + V|^2 = 4 - |R - V|^2
    return np.where(at.n_l > 0.0, power(np.abs(cosine), near, n), 0.0)


def _halfway(at: Directions, n: Floats) -> Floats:
    half = unit(at.to_light + at.to_eye)
    apart = half - at.normal
    return np.where(at.n_l > 0.0, power(dot(half, at.normal), dot(apart, apart), n), 0.0)


def _with_cosine(at: Directions, n: Floats, mirror: Callable[[Directions], Floats]) -> Floats:
    """Return the highlight of a wrong mirrored direction, of any length."""
    cosine = np.maximum(dot(mirror(at), at.to_eye), 0.0)
    return np.where((at.n_l > 0.0) & (cosine > 0.0), cosine**n, 0.0)


def _backward(at: Directions) -> Floats:
    return at.to_light - 2.0 * at.normal * at.n_l[..., None]


def _halved(at: Directions) -> Floats:
    return at.normal * at.n_l[..., None] - at.to_light


unclamped = _term("kd", _cosine)
absolute = _term("kd", _magnitude)
ungated = _term("ks", _everywhere)
absolute_mirror = _term("ks", _both_ways)
blinn = _term("ks", _halfway)
reversed_mirror = _term("ks", partial(_with_cosine, mirror=_backward))
halved_mirror = _term("ks", partial(_with_cosine, mirror=_halved))


# Sums


def scaled(drawing: Drawing, **factors: float) -> Drawing:
    """Return the drawing with coefficients of all materials multiplied."""
    scene = drawing.scene
    meshes = []
    for mesh in scene.meshes:
        changed = {name: getattr(mesh.material, name) * factor for name, factor in factors.items()}
        meshes.append(replace(mesh, material=replace(mesh.material, **changed)))
    return replace(drawing, scene=replace(scene, meshes=tuple(meshes)))


def without_texture(drawing: Drawing) -> Drawing:
    """Return the drawing without textures."""
    meshes = [replace(mesh, material=replace(mesh.material, texture=None)) for mesh in drawing.scene.meshes]
    return replace(drawing, scene=replace(drawing.scene, meshes=tuple(meshes)))


def _uncolored(drawing: Drawing) -> Drawing:
    plain = without_texture(drawing)
    meshes = [replace(m, colors=None, material=replace(m.material, color=1.0)) for m in plain.scene.meshes]
    return replace(plain, scene=replace(plain.scene, meshes=tuple(meshes)))


def _white_apart(drawing: Drawing, shade: Shade) -> Floats:
    return shade(scaled(drawing, ks=0.0)) + shade(scaled(_uncolored(drawing), ka=0.0, kd=0.0))


def white_highlight(drawing: Drawing) -> Iterator[Variant]:
    yield "", lambda given: replace(given, compose=_white_apart)


def _clipped_first(drawing: Drawing, shade: Shade) -> Floats:
    """Return ambient light and the color times the light that a white surface reflects, at most 1."""
    colors = shade(replace(drawing, settings=replace(drawing.settings, shader="nolight")))
    light = shade(scaled(_uncolored(drawing), ka=0.0))
    return shade(scaled(drawing, kd=0.0, ks=0.0)) + colors * np.clip(light, 0.0, 1.0)


def clipped_light(drawing: Drawing) -> Iterator[Variant]:
    yield "", lambda given: replace(given, compose=_clipped_first)
