"""How much of each instance an image shows: a table of shares, and amodal masks."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from ..base.atomic_files import write_bytes
from ..base.json_values import plain
from ..base.text_tables import as_csv
from ..base.validation import flag, integer, value_error
from ..base.validation import path as checked_path
from ..scene.camera import Camera
from ..scene.geometry import in_image
from ..scene.model import Material, Mesh, Scene, Settings
from ..scene.objects import first_instances, instance_names, object_numbers
from ..scene.settings import Preset, RenderOptions
from .camera_space import near_plane
from .effective_settings import effective_settings, numbers_alone
from .opencl.device import Device
from .renderer import Renderer

if TYPE_CHECKING:
    from typing_extensions import Unpack

MOST_MARGIN = 8  # images on each side: 288 around one
ENDINGS = (".csv", ".json")
_COLUMNS = {
    "instance": np.uint32,
    "object": np.uint32,
    "name": np.str_,
    "pixels": np.int64,
    "alone": np.int64,
    "whole": np.int64,
    "visible": np.float64,
    "inside": np.float64,
}


@dataclass(frozen=True, eq=False)
class Visible:
    """How much of each instance an image shows, see `clshade.visible`.

    Attributes
    ----------
    table : structured ndarray, (K,)
        A row for each instance, in the order of the layer instance_id. Columns: ``instance``, its
        number in that layer; ``object``, that of its object in object_id; ``name``, its name or else its
        object's; ``pixels``, those that show it; ``alone``, those that would if nothing else were there;
        ``whole``, the same, and the pixels around the image that would; ``visible``, pixels / alone;
        ``inside``, alone / whole. Shares of nothing are NaN.
    masks : ndarray of bool, (K, M, N), or None
        The pixels that would show each instance if nothing else were there; None unless asked for.
    """

    table: Array
    masks: Bools | None = None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the table as CSV or JSON; NaN is an empty field or null.

        Parameters
        ----------
        path : str or path-like
            File name ending in .csv or .json.
        """
        name = checked_path("Visible.save", "path", path)
        ending = os.path.splitext(name)[1].lower()
        if ending not in ENDINGS:
            raise value_error("Visible.save", "path", f"a file name ending in {' or '.join(ENDINGS)}", name)
        rows = [dict(zip(self.table.dtype.names or (), plain(list(row.item())), strict=True)) for row in self.table]
        if ending == ".json":
            write_bytes(name, json.dumps(rows, indent=1, ensure_ascii=False).encode() + b"\n")
            return
        texts = (["" if value is None else str(value) for value in row.values()] for row in rows)
        write_bytes(name, as_csv(self.table.dtype.names or (), texts).encode())


def visible(
    scene: Scene,
    *,
    masks: bool = False,
    margin: int = 1,
    preset: Preset | None = None,
    device: Device | str | None = None,
    settings: Settings | None = None,
    **fields: Unpack[RenderOptions],
) -> Visible:
    """Return how much of each instance the image shows, and how much of it would be in the image.

    Parameters
    ----------
    scene : Scene
        The scene, with its camera.
    masks : bool, default False
        Return amodal masks too: K images of bools, one for each instance.
    margin : int, default 1
        How far an instance counts beyond the image, in images: 1 to each side, so that what lies in an
        area of three by three images is its whole; 0 to 8.
    preset, device, settings, **fields
        As of `clshade.render`. What decides which triangles are seen counts, such as ``cull``, ``near``
        and ``layer_alpha``; shading does not.

    Returns
    -------
    Visible
        A table of counts and shares, and the masks if asked for.

    Notes
    -----
    Pixels are counted at their centers, as those of the layer instance_id with one sample. Each instance
    is drawn alone with the near plane of the whole scene, hence with the very coverage that it has in
    the image: ``pixels <= alone <= whole``. Instances whose boxes in the image do not overlap share a
    frame; those that cross the border of the image take more.

    Examples
    --------
    >>> import clshade
    >>> found = clshade.visible(clshade.builtin("box_room"), resolution=(160, 120))
    >>> found.table["visible"].max() <= 1.0
    np.True_
    """
    many, beyond = flag("visible", "masks", masks), integer("visible", "margin", margin, 0, MOST_MARGIN)
    scene, settings = effective_settings(scene, preset, settings, **fields)
    near = settings.near or near_plane(scene)
    settings = replace(numbers_alone(settings, ("instance_id",)), samples=1, near=near)
    scene = replace(scene, meshes=tuple(map(_bare, scene.meshes)), lights=(), environment=None)
    placed = list(_instances(scene))
    count = len(placed)
    with Renderer(scene, device=device, settings=settings) as renderer:
        seen, device = _counted(renderer.render()["instance_id"], count), renderer.device
    columns, height = scene.camera.resolution
    alone, around = np.zeros((2, count + 1), np.int64)
    found = np.zeros((count if many else 0, height, columns), bool)
    for group in _groups(placed):
        numbers = [each.number for each in group]
        shown = replace(scene, meshes=tuple(mesh for each in group for mesh in each.meshes))
        for place, image in _drawn(shown, group, settings, device, beyond):
            pixels = _counted(image, len(group))[1:]
            (around if any(place) else alone)[numbers] += pixels
            if many and not any(place):
                for k, number in enumerate(numbers, 1):
                    found[number - 1] = image == k
    rows = []
    for number, object_number, name, *_ in placed:
        counts = (int(seen[number]), int(alone[number]), int(alone[number] + around[number]))
        share, inside = (part / most if most else math.nan for part, most in (counts[:2], counts[1:]))
        rows.append((number, object_number, name, *counts, share, inside))
    longest = max((len(row[2]) for row in rows), default=0)
    kinds = {**_COLUMNS, "name": f"U{max(longest, 1)}"}
    return Visible(np.array(rows, [*kinds.items()]), found if many else None)


def _counted(numbers: Array, most: int) -> Integers:
    """Return how many pixels show each number, (most + 1,)."""
    return np.bincount(numbers.ravel(), minlength=most + 1)


def _bare(mesh: Mesh) -> Mesh:
    """Return a mesh that covers the same pixels, without what only its colors need."""
    own = mesh.material
    if mesh.tests_alpha or mesh.blends:
        plain = replace(own, pbr=None)
        return replace(mesh, material=plain, normals=None, normal_faces=None, tangents=None, tangent_faces=None)
    return Mesh(
        mesh.verts,
        mesh.faces,
        material=Material(sides=own.sides),
        instances=mesh.instances,
        name=mesh.name,
        instance_names=mesh.instance_names,
        part_of=mesh.part_of,
    )


class _Instance(NamedTuple):
    """An instance. meshes: its parts, with it alone. low, high: (2,) ends of the box of its vertices in the image, pixels to
    the right and down, a pixel wider than that; infinite if some of them are not in front of the camera."""

    number: int
    object_number: int
    name: str
    meshes: tuple[Mesh, ...]
    low: Floats
    high: Floats

    def reaches(self, place: tuple[int, int], camera: Camera) -> bool:
        """Return whether its box meets the image that lies so many images to the right and down of the camera's."""
        start = np.array(place) * camera.resolution
        return bool((self.low < start + camera.resolution).all() and (self.high > start).all())


def _instances(scene: Scene) -> Iterator[_Instance]:
    """Yield the instances in the order of instance_id."""
    names = instance_names(scene)
    parts: dict[tuple[int, int], list[Mesh]] = {}
    for first, object_number, mesh in zip(first_instances(scene), object_numbers(scene), scene.meshes, strict=True):
        for k, matrix in enumerate(np.asarray(mesh.instances)):
            name = mesh.instance_names[k : k + 1]
            own = replace(mesh, instances=matrix[None], instance_names=name, part_of=f"{first + k}")
            parts.setdefault((first + k, object_number), []).append(own)
    for (number, object_number), meshes in sorted(parts.items()):
        boxes = np.array([_box(mesh, scene.camera) for mesh in meshes])
        ends = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        yield _Instance(number, object_number, names[number - 1] or meshes[0].name, tuple(meshes), *ends)


def _box(mesh: Mesh, camera: Camera) -> tuple[Floats, Floats]:
    """Return `low` and `high` of `_Instance`."""
    nowhere: Floats = np.full(2, np.inf)
    if not len(mesh.faces):
        return nowhere, -nowhere
    (matrix,) = np.asarray(mesh.instances)
    points: Floats = mesh.verts.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    places, depths = in_image(camera, points - camera.eye)
    if not (np.isfinite(places).all() and (depths > 0.0).all()):
        return -nowhere, nowhere
    return places.min(axis=0) - 1.0, places.max(axis=0) + 1.0


def _groups(placed: Sequence[_Instance]) -> Iterator[list[_Instance]]:
    """Yield groups of instances whose boxes do not overlap: drawn together, none hides another. What has alpha is together
    with other instances of its mesh alone, whose kernels it shares."""
    groups: dict[int, list[list[_Instance]]] = {}
    for each in placed:
        if not any(len(mesh.faces) for mesh in each.meshes):
            continue
        own = any(mesh.tests_alpha or mesh.blends for mesh in each.meshes)
        known = groups.setdefault(each.object_number if own else 0, [])
        for group in known:
            low, high = np.array([(other.low, other.high) for other in group]).swapaxes(0, 1)
            if not ((low < each.high) & (each.low < high)).all(axis=1).any():
                group.append(each)
                break
        else:
            known.append([each])
    for some in groups.values():
        yield from some


def _drawn(
    scene: Scene, group: Sequence[_Instance], settings: Settings, device: Device, margin: int
) -> Iterator[tuple[tuple[int, int], Array]]:
    """Yield the layer instance_id of a scene of a group's instances, and of the images around that may show any, with how
    many images to the right and down these are."""
    around = range(-margin, margin + 1)
    camera = scene.camera
    reach = [place for place in product(around, around) if any(each.reaches(place, camera) for each in group)]
    if reach:
        with Renderer(scene, device=device, settings=settings) as renderer:
            for right, down in reach:
                x, y = camera.principal
                beside = replace(camera, principal=(x - right, y + down)) if right or down else camera
                yield (right, down), renderer.render(beside)["instance_id"]
