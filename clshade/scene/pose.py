"""A pose: what one frame of an animation changes in a scene."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from .model import Light, Mesh, Scene

_T = TypeVar("_T")

# What moves; faces, materials and scalars stay.
POSED = ("verts", "colors", "normals", "normal_faces", "uvs", "tangents", "more_uvs", "alphas", "instances")


@dataclass(frozen=True, eq=False)
class Pose:
    """What a frame changes in a scene, which it shares with all other frames.

    meshes: by number of the mesh, from 0, its fields that change: vertices, normals, instances and so on. lights: in place
    of the scene's, None if they stay.
    """

    meshes: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)
    lights: tuple[Light, ...] | None = None

    def of(self, scene: Scene) -> Scene:
        """Return the scene in this pose."""
        meshes = list(scene.meshes)
        for number, changed in self.meshes.items():
            meshes[number] = replace(meshes[number], **changed)
        return replace(scene, meshes=tuple(meshes), lights=scene.lights if self.lights is None else self.lights)


class PerFrame(Mapping[int, _T]):
    """What `make` returns for the number of each frame, when it is looked up."""

    def __init__(self, numbers: Iterable[int], make: Callable[[int], _T]) -> None:
        self._numbers = numbers if isinstance(numbers, range) else dict.fromkeys(numbers)
        self._make = make

    def __getitem__(self, number: int) -> _T:
        if number not in self._numbers:
            raise KeyError(number)
        return self._make(number)

    def __contains__(self, number: object) -> bool:
        return number in self._numbers

    def __iter__(self) -> Iterator[int]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)


class Poses(PerFrame[Pose]):
    """Poses by frame number. source: what they are computed from, which tells them from others without computing them."""

    def __init__(self, numbers: Iterable[int], make: Callable[[int], Pose], source: Callable[[], Any]) -> None:
        super().__init__(numbers, make)
        self._source = source

    @functools.cached_property
    def source(self) -> Any:
        return self._source()


def pose_between(meshes: Sequence[Mesh], posed: Sequence[Mesh], lights: tuple[Light, ...] | None = None) -> Pose:
    """Return the pose that makes `posed` of `meshes`, of which there are as many. lights: of the pose."""
    changes = {number: changes_of(*pair) for number, pair in enumerate(zip(meshes, posed, strict=True))}
    return Pose({number: changed for number, changed in changes.items() if changed}, lights)


def changes_of(mesh: Mesh, posed: Mesh) -> dict[str, Any]:
    """Return the fields of POSED that differ, as they are in `posed`."""
    if mesh is posed:
        return {}
    return {name: getattr(posed, name) for name in POSED if not _same(getattr(mesh, name), getattr(posed, name))}


def _same(one: Any, other: Any) -> bool:
    if one is other or (isinstance(one, tuple) and isinstance(other, tuple)):
        return one is other or all(map(_same, one, other))
    return one is not None and other is not None and np.array_equal(one, other)
