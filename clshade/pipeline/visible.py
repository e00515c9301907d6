"""How much of each instance an image shows: a table of shares, and amodal masks."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ..base.arrays import Array, Bools, Floats
from ..base.atomic_files import write_bytes
from ..base.json_values import plain
from ..base.validation import flag, integer, value_error
from ..base.validation import path as checked_path
from ..scene.camera import Camera
from ..scene.model import Material, Mesh, Scene, Settings
from ..scene.seen_points import in_image
from ..scene.settings import Preset, RenderOptions
from .camera_space import near_plane
from .effective_settings import effective_settings
from .layer_buffers import first_instances
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
        number in that layer; ``object``, that of its mesh in object_id; ``name``, its name or else its
        mesh's; ``pixels``, those that show it; ``alone``, those that would if nothing else were there;
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

        Raises
        ------
        InputError
            If the name ends otherwise.
        OutputError
            If the file cannot be written.
        """
        name = checked_path("Visible.save", "path", path)
        ending = os.path.splitext(name)[1].lower()
        if ending not in ENDINGS:
            raise value_error("Visible.save", "path", f"a file name ending in {' or '.join(ENDINGS)}", name)
        rows = [dict(zip(self.table.dtype.names or (), plain(list(row.item())), strict=True)) for row in self.table]
        if ending == ".json":
            write_bytes(name, json.dumps(rows, indent=1, ensure_ascii=False).encode() + b"\n")
            return
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.table.dtype.names or ())
        writer.writerows(row.values() for row in rows)
        write_bytes(name, text.getvalue().encode())


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

    Raises
    ------
    InputError
        If an argument is refused.
    DeviceError
        If no OpenCL device works.

    Notes
    -----
    Pixels are counted at their centers, as those of the layer instance_id with one sample. Each instance
    is drawn alone with the near plane of the whole scene, hence with the very coverage that it has in
    the image: ``pixels <= alone <= whole``. That takes a frame for each of them, and more where it
    crosses the border of the image.

    Examples
    --------
    >>> import clshade
    >>> found = clshade.visible(clshade.builtin("box_room"), resolution=(160, 120))
    >>> found.table["visible"].max() <= 1.0
    np.True_
    """
    many, beyond = flag("visible", "masks", masks), integer("visible", "margin", margin, 0, MOST_MARGIN)
    scene, settings = effective_settings(scene, preset, settings, **fields)
    settings = _settings(scene, settings)
    scene = replace(scene, meshes=tuple(map(_bare, scene.meshes)), lights=(), environment=None)
    with Renderer(scene, device=device, settings=settings) as renderer:
        numbers, device = renderer.render()["instance_id"], renderer.device
    rows = []
    columns, height = scene.camera.resolution
    found = np.zeros((_count(scene) if many else 0, height, columns), bool)
    seen = np.bincount(numbers.ravel(), minlength=_count(scene) + 1)
    for number, (place, mesh) in enumerate(_instances(scene), 1):
        mask, around = _alone(replace(scene, meshes=(mesh,)), settings, device, beyond)
        alone = int(mask.sum())
        name = next(iter(mesh.instance_names), "") or mesh.name
        shares = _share(int(seen[number]), alone), _share(alone, alone + around)
        rows.append((number, place, name, int(seen[number]), alone, alone + around, *shares))
        if many:
            found[number - 1] = mask
    longest = max((len(row[2]) for row in rows), default=0)
    kinds = {**_COLUMNS, "name": f"U{max(longest, 1)}"}
    return Visible(np.array(rows, [*kinds.items()]), found if many else None)


def _settings(scene: Scene, settings: Settings) -> Settings:
    """Return the settings that show the same triangles of a scene, unlit, with one sample."""
    return replace(
        settings,
        shader="nolight",
        samples=1,
        layers=("instance_id",),
        near=settings.near or near_plane(scene),
        shadows=False,
        ambient_occlusion=0,
        texture_filter="bilinear",
        scalars=None,
        edges=None,
        background=None,
    )


def _bare(mesh: Mesh) -> Mesh:
    """Return a mesh that covers the same pixels, without what only its colors need."""
    own = mesh.material
    if mesh.tests_alpha or mesh.blends:
        return replace(
            mesh, material=replace(own, pbr=None), normals=None, normal_faces=None, tangents=None, tangent_faces=None
        )
    return Mesh(
        mesh.verts,
        mesh.faces,
        material=Material(sides=own.sides),
        instances=mesh.instances,
        name=mesh.name,
        instance_names=mesh.instance_names,
    )


def _count(scene: Scene) -> int:
    """Return the number of instances. Raises InputError for more than instance_id counts."""
    first_instances(scene)
    return sum(len(np.asarray(mesh.instances)) for mesh in scene.meshes)


def _instances(scene: Scene) -> Iterator[tuple[int, Mesh]]:
    """Yield the number of the mesh, from 1, and the mesh with a single instance, for each instance."""
    for place, mesh in enumerate(scene.meshes, 1):
        for k, matrix in enumerate(np.asarray(mesh.instances)):
            yield place, replace(mesh, instances=matrix[None], instance_names=mesh.instance_names[k : k + 1])


def _share(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")


def _alone(scene: Scene, settings: Settings, device: Device, margin: int) -> tuple[Bools, int]:
    """Return the pixels that show something of a scene of one instance, (M, N), and how many around the image would."""
    columns, rows = scene.camera.resolution
    reach = _reach(scene, margin)
    if not reach:
        return np.zeros((rows, columns), bool), 0
    with Renderer(scene, device=device, settings=settings) as renderer:
        images = {place: renderer.render(_shifted(scene.camera, *place))["instance_id"] != 0 for place in reach}
    mask = images.pop((0, 0), np.zeros((rows, columns), bool))
    return mask, sum(int(image.sum()) for image in images.values())


def _reach(scene: Scene, margin: int) -> list[tuple[int, int]]:
    """Return in which images around that of the camera, this one included, something may be seen, counted in images to the
    right and down."""
    (mesh,) = scene.meshes
    if not len(mesh.faces):
        return []
    (matrix,) = np.asarray(mesh.instances)
    points: Floats = mesh.verts.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    places, depths = in_image(scene.camera, points - scene.camera.eye)
    around = range(-margin, margin + 1)
    if not (np.isfinite(places).all() and (depths > 0.0).all()):
        return list(product(around, around))
    size = np.array(scene.camera.resolution)
    low, high = np.floor((places.min(axis=0) - 1.0) / size), np.floor((places.max(axis=0) + 1.0) / size)
    return [(x, y) for x in around for y in around if low[0] <= x <= high[0] and low[1] <= y <= high[1]]


def _shifted(camera: Camera, right: int, down: int) -> Camera:
    """Return the camera of the image beside this one."""
    x, y = camera.principal
    return camera if right == down == 0 else replace(camera, principal=(x - right, y + down))
