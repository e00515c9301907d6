"""Random parameters of shader pbr for the materials of a scene, also at the ends of their ranges."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ...scene.metallic_roughness import MetallicRoughness
from ...scene.model import Material, Scene, with_materials
from .random_shapes import Random


def with_facets(rng: Random, scene: Scene) -> Scene:
    """Return the scene with these parameters for the first mesh's material, and for some others."""
    first = scene.meshes[0].material

    def changed(material: Material) -> Material:
        some = material is first or rng.random() < 0.7
        return _changed(material, _parameters(rng, all_of_it=material is first) if some else {})

    return with_materials(scene, changed)


def _changed(material: Material, given: dict[str, Any]) -> Material:
    if not given:
        return material
    return replace(material, pbr=MetallicRoughness(**given) if material.pbr is None else replace(material.pbr, **given))


def _parameters(rng: Random, *, all_of_it: bool) -> dict[str, Any]:
    """Return fields of MetallicRoughness. all_of_it: with what needs each term of the model."""

    def some(*ends: float, least: float = 0.0) -> float:
        return float(rng.choice(ends)) if rng.random() < 0.5 else rng.uniform(least, 1.0)

    emission = rng.uniform(0.1, 1.0, 3) * rng.choice((1.0, 1.0, 1e-30, 1e30, 3e38))
    if not all_of_it and rng.random() < 0.3:
        emission *= 0.0
    return {
        "metallic": rng.uniform(0.1, 0.9) if all_of_it else some(0.0, 1.0, 1e-30),
        "roughness": some(0.0, 1e-4, 1.0 / 32.0, 0.05, 1.0),
        "ior": float(rng.choice((0.0, 1.0, 1.0 + 1e-9, 1.5, 2.4, 1e6))),
        "specular": some(0.5, 1.0, least=0.1) if all_of_it else some(0.0, 1e-30, 1.0),
        "specular_color": rng.uniform(0.0, 1.0, 3) * rng.choice((0.0, 1.0, 30.0, 1e30)),
        "emission": emission,
    }
