"""The layers (AOVs) of a frame: a row for each, from which checks, help, channels of files and outputs of kernels follow."""

from __future__ import annotations

import inspect
import math
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

# By kind, for type checkers.
NumberLayer: TypeAlias = Literal["id", "object_id", "material_id", "instance_id"]
PointLayer: TypeAlias = Literal["P"]
RealLayer: TypeAlias = Literal["Z", "N", "albedo", "uv", "barycentrics", "scalar", "AO"]
Layer: TypeAlias = Literal[NumberLayer, PointLayer, RealLayer]


@dataclass(frozen=True)
class LayerRow:
    """A layer of frames."""

    what: str  # it holds
    # That of the image; completed in float64 by the host; or a number of what the triangle belongs to.
    kind: Literal["uint32", "real", "float64"] = "real"
    components: str = ""  # the last parts of its channels' names; none for a single number
    # Where there is no surface: of a number that kernels/surface_layers.cl writes 0, another finite one, or NaN.
    background: float = 0.0
    setting: Literal["scalars", "ambient_occlusion"] | None = None  # without which there is no such layer
    # Tables that it needs whatever the image does, see `pipeline.layers.layer_tables`.
    reads: tuple[Literal["normals", "uvs", "mirrored", "scalars", "casters"], ...] = ()
    keeps_digits: bool = False  # whether files hold it as float even where other layers are half
    names: str = ""  # the attribute of an EXR's header with the names of what it counts
    words: tuple[str, ...] = ()  # what else people call it, in lower case

    def described(self) -> str:
        """Return what it holds, and what it needs."""
        return self.what + (f"; needs `{self.setting}`" if self.setting else "")

    @property
    def shape(self) -> tuple[int, ...]:
        """Of a pixel: () or (components,)."""
        return (len(self.components),) if self.components else ()

    def dtype(self, real: type[np.floating]) -> np.dtype:
        """Return its type; real: that of the image."""
        return np.dtype(real if self.kind == "real" else self.kind)


LAYER_TABLE: dict[Layer, LayerRow] = {
    "Z": LayerRow(
        "distance along the viewing direction, scene units",
        background=math.inf,
        keeps_digits=True,
        words=("depth", "depths", "distance", "zbuffer", "z_buffer"),
    ),
    "id": LayerRow(
        "the face, from 1: mesh by mesh, instance by instance",
        kind="uint32",
        words=("ids", "face", "faces", "face_id", "triangle_id", "index"),
    ),
    "N": LayerRow(
        "unit normal that the light sees, world space, with shader `pbr` turned by the normal map; of two-sided materials "
        "the side seen; 0 where there is none",
        components="XYZ",
        reads=("normals",),
        words=("normal", "normals", "nrm"),
    ),
    "P": LayerRow(
        "position in world space, right to a few roundings of its distance from the eye",
        kind="float64",
        components="XYZ",
        keeps_digits=True,
        words=("position", "positions", "pos", "points", "world_position"),
    ),
    "albedo": LayerRow(
        "vertex color times material's color times texel, or the color map's color: what the light is multiplied by",
        components="RGB",
        words=("base_color", "basecolor", "diffuse", "reflectance"),
    ),
    "uv": LayerRow(
        "texture coordinates as the mesh has them, not wrapped; 0 where it has none",
        components="UV",
        reads=("uvs",),
        words=("uvs", "st", "texcoord", "texcoords", "texture_coordinates"),
    ),
    "object_id": LayerRow(
        "the object, from 1: a mesh, or all parts of one; instances alike",
        kind="uint32",
        names="objectNames",
        words=("object", "objects", "mesh", "mesh_id", "segmentation"),
    ),
    "material_id": LayerRow(
        "the material of its mesh, from 1 in the order of the meshes; equal ones alike",
        kind="uint32",
        names="materialNames",
        words=("material", "materials"),
    ),
    "barycentrics": LayerRow(
        "weights of the face's corners, in the mesh's order; their sum is 1", components="UVW", reads=("mirrored",)
    ),
    "scalar": LayerRow(
        "the number that `scalars` names, before its color map; NaN where there is none",
        background=math.nan,
        setting="scalars",
        reads=("scalars",),
        keeps_digits=True,
        words=("scalars", "values", "data"),
    ),
    "AO": LayerRow(
        "the share of the rays of ambient occlusion that meet nothing, 0 to 1",
        setting="ambient_occlusion",
        reads=("casters",),
        words=("ao", "occlusion", "ambient_occlusion"),
    ),
    "instance_id": LayerRow(
        "the placement of an object, from 1: object by object, in the order of `Mesh.instances`",
        kind="uint32",
        names="instanceNames",
        words=("instance", "instances", "placement", "placement_id"),
    ),
}
LAYERS: tuple[Layer, ...] = tuple(LAYER_TABLE)  # in the order in which frames have them

# For suggestions on a name that is misspelled, or another program's.
LAYER_WORDS = {word: name for name, row in LAYER_TABLE.items() for word in row.words}
LAYER_REMARKS = dict.fromkeys(
    ("r", "g", "b", "a", "rgb", "rgba", "color", "image", "beauty", "alpha", "mask", "coverage"),
    "the image and its coverage are always there (frame.rgba; R, G, B, A of the EXR)",
) | dict.fromkeys(
    ("flow", "optical_flow", "motion", "motion_vectors", "velocity", "vector"),
    "optical flow leads to another image: clshade.flow(frame, other), or --flow of turntable and animate",
)


def lists_layers(function: Function) -> Function:
    """Decorate a function whose docstring names `LAYER_TABLE` at the end of a line: its rows are listed below."""
    mark = "`LAYER_TABLE`:\n"
    before, _, after = inspect.cleandoc(function.__doc__ or "").partition(mark)
    rows = [
        f'    ``"{name}"``, {row.kind}{f" x {len(row.components)}" if row.components else ""}\n'
        + textwrap.fill(row.described(), 100, initial_indent=8 * " ", subsequent_indent=8 * " ")
        for name, row in LAYER_TABLE.items()
    ]
    function.__doc__ = "\n".join([before + mark, *rows, after])
    return function
