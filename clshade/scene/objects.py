"""Objects of a scene: a mesh, or several meshes of one material each that are parts of one thing."""

from __future__ import annotations

import numpy as np

from ..base.validation import value_error
from .model import Scene


def object_numbers(scene: Scene) -> list[int]:
    """Return the number of each mesh's object, from 1, in the order in which objects begin."""
    numbers: dict[str | int, int] = {}
    keys = (mesh.part_of or number for number, mesh in enumerate(scene.meshes))
    return [numbers.setdefault(key, len(numbers) + 1) for key in keys]


def object_names(scene: Scene) -> list[str]:
    """Return the name of each object: that of the first of its meshes."""
    numbers = object_numbers(scene)
    names = dict(zip(reversed(numbers), (mesh.name for mesh in reversed(scene.meshes)), strict=True))
    return [names[number] for number in sorted(names)]


def first_instances(scene: Scene) -> list[int]:
    """Return the number of each mesh's first instance. Instances are counted from 1, object by object: an object has as
    many as the part with the most.

    Raises InputError for more than a uint32 counts.
    """
    objects = object_numbers(scene)
    counts = np.zeros(max(objects, default=0) + 1, np.int64)
    np.maximum.at(counts, objects, [len(mesh.instances) for mesh in scene.meshes])
    first = 1 + np.cumsum(counts)
    if first[-1] > 1 << 32:
        limit = f"at most {(1 << 32) - 1} instances with the layer instance_id"
        raise value_error("render", "scene", limit, int(first[-1]) - 1)
    return (first - counts)[objects].tolist()  # type: ignore[no-any-return]


def instance_names(scene: Scene) -> list[str]:
    """Return the name of each instance, the first that a part of its object gives it, "" for none."""
    names: dict[int, str] = {}
    for first, mesh in zip(first_instances(scene), scene.meshes, strict=True):
        for number, name in enumerate(mesh.instance_names or len(mesh.instances) * ("",), first):
            names[number] = names.get(number) or name
    return [names[number] for number in sorted(names)]
