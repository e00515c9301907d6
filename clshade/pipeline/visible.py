"""How much of each instance an image shows, as a table of shares and amodal masks, and what each sample of a frame's pixels
shows, as Cryptomatte layers."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from ..base.arrays import Array, Bools, Floats
from ..base.atomic_files import write_bytes
from ..base.json_values import plain
from ..base.text_tables import as_csv
from ..base.validation import arguments, choice, flag, integer, sequence, value_error
from ..base.validation import path as checked_path
from ..images.cryptomatte import MATTES, MAX_RANKS, RANKS, Matte, MatteKind, hashes, matte
from ..scene.camera import Camera
from ..scene.contents import first_instances, instance_names, object_numbers
from ..scene.geometry import in_image
from ..scene.model import Material, Mesh, Scene, Settings
from ..scene.settings import Layer, Preset, RenderOptions
from .camera_space import near_plane, sample_positions
from .effective_settings import effective_settings, numbers_alone
from .frame import Frame
from .layers import number_names
from .opencl.device import Device
from .renderer import Renderer

if TYPE_CHECKING:
    from typing_extensions import Unpack

MOST_MARGIN = 8  # images on each side: 288 around one
ENDINGS = (".csv", ".json")
_COLUMNS = ("instance", "object", "name", "pixels", "alone", "whole", "visible", "inside")


@dataclass(frozen=True, eq=False)
class Visible:
    """How much of each instance an image shows, see `clshade.visible`.

    table: a structured array, (K,), a row for each instance in the order of the layer instance_id. Columns: ``instance``,
    its number in that layer; ``object``, that of its object in object_id; ``name``, its name or else its object's;
    ``pixels``, those that show it; ``alone``, those that would if nothing else were there; ``whole``, these and the pixels
    around the image that would; ``visible``, pixels / alone; ``inside``, alone / whole. Shares of nothing are NaN.
    masks: (K, M, N), the pixels that would show each instance if nothing else were there; None unless asked for.
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
        name, columns = checked_path("Visible.save", "path", path), self.table.dtype.names or ()
        ending = os.path.splitext(name)[1].lower()
        if ending not in ENDINGS:
            raise value_error("Visible.save", "path", f"a file name ending in {' or '.join(ENDINGS)}", name)
        rows = [plain(list(row.item())) for row in self.table]
        if ending == ".json":
            records = [dict(zip(columns, row, strict=True)) for row in rows]
            write_bytes(name, json.dumps(records, indent=1, ensure_ascii=False).encode() + b"\n")
        else:
            texts = (["" if value is None else str(value) for value in row] for row in rows)
            write_bytes(name, as_csv(columns, texts).encode())


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

    Pixels are counted at their centers, as those of the layer instance_id with one sample. Each instance
    is drawn alone with the near plane of the whole scene, hence with the very coverage that it has in
    the image: ``pixels <= alone <= whole``. Instances whose boxes in the image do not overlap share a
    frame; those that cross the border of the image take more.

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
        See `clshade.Renderer`. What decides which triangles are seen counts, such as ``cull``, ``near``
        and ``layer_alpha``; shading does not.

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
        seen, device = np.bincount(renderer.render()["instance_id"].ravel(), minlength=count + 1), renderer.device
    columns, height = scene.camera.resolution
    alone, visible_alone = np.zeros((2, count + 1), np.int64)
    found = np.zeros((count if many else 0, height, columns), bool)
    for group in _groups(placed):
        numbers = [instance.number for instance in group]
        part_scene = replace(scene, meshes=tuple(mesh for instance in group for mesh in instance.meshes))
        for place, image in _drawn(part_scene, group, settings, device, beyond):
            pixels = np.bincount(image.ravel(), minlength=len(group) + 1)[1:]
            visible_alone[numbers] += pixels
            if not any(place):
                alone[numbers] += pixels
                for k, number in enumerate(numbers if many else (), 1):
                    found[number - 1] = image == k
    rows = []
    for number, object_number, name, *_ in placed:
        counts = int(seen[number]), int(alone[number]), int(visible_alone[number])
        shares = (part / count_alone if count_alone else math.nan for part, count_alone in (counts[:2], counts[1:]))
        rows.append((number, object_number, name, *counts, *shares))
    longest = max((len(instance.name) for instance in placed), default=0)
    kinds = f"u4 u4 U{max(longest, 1)} i8 i8 i8 f8 f8".split()
    return Visible(np.array(rows, list(zip(_COLUMNS, kinds, strict=True))), found if many else None)


def _bare(mesh: Mesh) -> Mesh:
    """Return a mesh that covers the same pixels, without what only its colors need."""
    material = mesh.material
    if mesh.tests_alpha or mesh.blends:
        plain = replace(material, pbr=None)
        return replace(mesh, material=plain, normals=None, normal_faces=None, tangents=None, tangent_faces=None)
    names: dict[str, Any] = {"name": mesh.name, "instance_names": mesh.instance_names, "part_of": mesh.part_of}
    return Mesh(mesh.verts, mesh.faces, material=Material(sides=material.sides), instances=mesh.instances, **names)


class _Instance(NamedTuple):
    """An instance. meshes: its parts, with it alone. low, high: (2,) ends of the box of its vertices in the image, pixels to
    the right and down, a pixel wider than that; infinite if some of them are not in front of the camera."""

    number: int
    object_number: int
    name: str
    meshes: tuple[Mesh, ...]
    low: Floats
    high: Floats


def _instances(scene: Scene) -> Iterator[_Instance]:
    """Yield the instances in the order of instance_id."""
    names = instance_names(scene)
    parts: dict[tuple[int, int], list[Mesh]] = {}
    for first, object_number, mesh in zip(first_instances(scene), object_numbers(scene), scene.meshes, strict=True):
        for k, matrix in enumerate(np.asarray(mesh.instances)):
            name = mesh.instance_names[k : k + 1]
            alone = replace(mesh, instances=matrix[None], instance_names=name, part_of=f"{first + k}")
            parts.setdefault((first + k, object_number), []).append(alone)
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
    for instance in placed:
        if not any(len(mesh.faces) for mesh in instance.meshes):
            continue
        sees_through = any(mesh.tests_alpha or mesh.blends for mesh in instance.meshes)
        groups_there = groups.setdefault(instance.object_number if sees_through else 0, [])
        for group in groups_there:
            low, high = np.array([(member.low, member.high) for member in group]).swapaxes(0, 1)
            if not ((low < instance.high) & (instance.low < high)).all(axis=1).any():
                group.append(instance)
                break
        else:
            groups_there.append([instance])
    for some in groups.values():
        yield from some


def _drawn(
    scene: Scene, group: Sequence[_Instance], settings: Settings, device: Device, margin: int
) -> Iterator[tuple[tuple[int, int], Array]]:
    """Yield the layer instance_id of a scene of a group's instances, and of the images around that may show any, with how
    many images to the right and down these are."""
    around, camera = range(-margin, margin + 1), scene.camera
    low, high = (np.array([getattr(instance, end) for instance in group]) for end in ("low", "high"))

    def is_reached(place: tuple[int, int]) -> bool:
        start = np.array(place) * camera.resolution
        return bool(((low < start + camera.resolution) & (high > start)).all(axis=1).any())

    reach = list(filter(is_reached, product(around, around)))
    if reach:
        with Renderer(scene, device=device, settings=settings) as renderer:
            for right, down in reach:
                x, y = camera.principal
                beside = replace(camera, principal=(x - right, y + down)) if right or down else camera
                yield (right, down), renderer.render(beside)["instance_id"]


@arguments(frame=Frame)
def cryptomatte(
    frame: Frame, kinds: Sequence[MatteKind] = MATTES, *, ranks: int = RANKS, device: Device | str | None = None
) -> dict[MatteKind, Matte]:
    """Return Cryptomatte layers of a frame: for each pixel the things that its samples show, and the share of each.

    For each kind these are `channels`, arrays (M, N) float32 such as ``CryptoObject00.R``, and `metadata` for
    the header of an EXR file. Shares are exact: numbers of samples over all. What blends counts as layers do,
    by `layer_alpha`. Raises InputError without mmh3.

    Parameters
    ----------
    frame : Frame
        As `Renderer.render` draws it. Its scene is drawn again, unlit, for each sample of its
        settings.
    kinds : sequence of {"object", "material", "instance"}, default all
        What has masks: meshes, materials, placements of meshes. Unnamed ones are called ``object
        1``, ``material 1``, ``instance 1`` and so on, after the layers `object_id`, `material_id`
        and `instance_id`.
    ranks : int, 1 to 64, default 6
        Things that a pixel lists at most: those that most of its samples show.
    device : Device or str, optional
        As for `Renderer`. The masks are the same on every device.
    """
    checked = check_mattes(kinds)
    integer("cryptomatte", "ranks", ranks, 1, MAX_RANKS)
    scene, settings = frame.scene, frame.settings
    layers: dict[MatteKind, Layer] = {kind: cast("Layer", f"{kind}_id") for kind in MATTES if kind in checked}
    numbers: dict[MatteKind, list[Array]] = {kind: [] for kind in layers}
    with Renderer(scene, settings=numbers_alone(settings, tuple(layers.values())), device=device) as renderer:
        for place in sample_positions(settings.samples):  # nearest to the center first
            if settings.samples > 1:
                renderer.place_samples(place[None])
            drawn = renderer.render()
            for kind, layer in layers.items():
                numbers[kind].append(drawn[layer])
    mattes = {}
    for kind, layer in layers.items():
        names = {number: name or f"{kind} {number}" for number, name in number_names(scene, layer)}
        mattes[kind] = matte(f"Crypto{kind.capitalize()}", np.array(numbers[kind]), names, ranks)
    return mattes


def check_mattes(kinds: Sequence[MatteKind], files: Container[str] = ("exr",)) -> tuple[MatteKind, ...]:
    """Return kinds of `frame.mattes`. Raises InputError for others, without mmh3, and if these files of `Frame.save` do not
    hold them."""
    names = None if isinstance(kinds, str) else sequence(kinds)
    if not names:
        raise value_error("cryptomatte", "kinds", f"one or more of {', '.join(MATTES)}", kinds)
    for kind in names:
        choice("cryptomatte", "kinds", kind, MATTES)
    hashes(())  # before anything is drawn: raises without mmh3
    if "exr" not in files:
        raise value_error("cryptomatte", "files", "exr among them, which holds it", files)
    return tuple(names)
