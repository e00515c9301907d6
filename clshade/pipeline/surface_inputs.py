"""The inputs of the pixel stages, and the layers: declared here for the host and, by macros, for the kernels."""

from __future__ import annotations

import math
from functools import cache
from typing import Annotated, NamedTuple, get_type_hints

from ..images.layers import LAYER_TABLE
from .buffers import Buffer


class SurfaceInputs(NamedTuple):
    """The first arguments of the kernels that shade pixels, in their order, with their element types in OpenCL C.

    F faces, C clipped pieces, V vertices; those that no feature of a scene reads are None.
    """

    triangles: Annotated[Buffer, "Triangle"]  # F + C, from setup
    faces: Annotated[Buffer, "int"]  # F x 3, vertices
    relative: Annotated[Buffer, "real4"]  # V, from project
    materials: Annotated[Buffer, "Material"]  # at least 1
    lights: Annotated[Buffer, "Light"]
    image: Annotated[Buffer, "Image"]  # 1
    vertices: Annotated[Buffer | None, "Vertex"] = None  # V, from project
    pieces: Annotated[Buffer | None, "Piece"] = None  # C, from the host
    normals: Annotated[Buffer | None, "real4"] = None  # K, unit or 0, world axes
    normal_faces: Annotated[Buffer | None, "int"] = None  # F x 3, normals; None: `faces`
    # V with VERTEX_COLORS, F x 3 with CORNER_COLORS: linear RGB, position in the color map
    colors: Annotated[Buffer | None, "real4"] = None
    color_map: Annotated[Buffer | None, "real4"] = None  # below, map_colors, above, NaN, white; with SCALARS
    uvs: Annotated[Buffer | None, "real4"] = None  # T of each set, u, v and their rounding errors
    uv_faces: Annotated[Buffer | None, "int"] = None  # F x 3, texture coordinates; None: `faces`
    tangents: Annotated[Buffer | None, "real4"] = None  # unit or 0, and the bitangent's side; with NORMAL_MAP
    tangent_faces: Annotated[Buffer | None, "int"] = None  # F x 3, tangents; with NORMAL_MAP
    face_materials: Annotated[Buffer | None, "int"] = None  # F, with MATERIALS
    textures: Annotated[Buffer | None, "Texture"] = None
    texels: Annotated[Buffer | None, "float4"] = None  # of all textures, linear RGB
    environment: Annotated[Buffer | None, "Environment"] = None  # 1, with ENVIRONMENT
    radiance: Annotated[Buffer | None, "real4"] = None  # the table of its BRDF, then its levels, linear RGB
    backdrop: Annotated[Buffer | None, "real4"] = None  # of `backdrop_table`, linear RGB; with BACKDROP
    alphas: Annotated[Buffer | None, "real"] = None  # V, with VERTEX_ALPHA
    ranks: Annotated[Buffer | None, "uint"] = None  # F + C, in painter's order; with BLEND without DEPTH_TEST
    triangle_instances: Annotated[Buffer | None, "int"] = None  # F + C, from setup_instances; these with INSTANCES
    instances: Annotated[Buffer | None, "Instance"] = None
    view: Annotated[Buffer | None, "View"] = None  # 1
    object_positions: Annotated[Buffer | None, "double"] = None  # V x 3, in place of relative and vertices
    object_normals: Annotated[Buffer | None, "double4"] = None  # K, in place of normals
    object_tangents: Annotated[Buffer | None, "double4"] = None  # in place of tangents
    corner_light: Annotated[Buffer | None, "real4"] = None  # (F + C) x 3, from gouraud_corners
    shadow_vertices: Annotated[Buffer | None, "float"] = None  # of Hierarchy: V x 8; this and the rest with CASTERS
    shadow_nodes: Annotated[Buffer | None, "float"] = None  # of Hierarchy
    shadow_leaves: Annotated[Buffer | None, "float"] = None  # of Hierarchy
    # of what is opaque, of what is not, for lights, then for ambient occlusion; without levels nothing is hidden
    shadow_casters: Annotated[Buffer | None, "Casters"] = None  # 4
    shadow_lights: Annotated[Buffer | None, "ShadowLight"] = None  # of `lights`, in their order
    shadow_view: Annotated[Buffer | None, "ShadowView"] = None  # 1
    shadow_hemisphere: Annotated[Buffer | None, "Light"] = None  # 1, the rays of ambient occlusion: see hemisphere_row

    def values(self) -> dict[str, Buffer | None]:
        """Return the arguments of a kernel by name."""
        values = self._asdict()
        for name in ("normal_faces", "uv_faces"):
            if values[name] is None:
                values[name] = self.faces
        return values


INSTANCES_ALONE = (
    "triangle_instances",
    "instances",
    "view",
    "object_positions",
    "object_normals",
    "object_tangents",
)
CASTERS_ALONE = tuple(name for name in SurfaceInputs._fields if name.startswith("shadow_"))


def parameters(*, casters: bool, instances: bool) -> list[str]:
    """Return the names of SURFACE_PARAMETERS, with CASTERS or with INSTANCES or without."""
    left_out = CASTERS_ALONE * (not casters) + INSTANCES_ALONE * (not instances)
    return [name for name in SurfaceInputs._fields if name not in left_out]


@cache
def macros() -> str:
    """Return OpenCL C: SURFACE_PARAMETERS of a kernel; SURFACE_ARGUMENTS, which initialize a struct of SURFACE_MEMBERS."""
    hints = get_type_hints(SurfaceInputs, include_extras=True)

    def definitions(*, casters: bool = False, instances: bool = False) -> str:
        names = parameters(casters=casters, instances=instances)
        members = [f"global const {hints[name].__metadata__[0]} *{name}" for name in names]
        return (
            f"#define SURFACE_PARAMETERS {', '.join(members)}\n"
            f"#define SURFACE_ARGUMENTS {{image->needs, {', '.join(names)}}}\n"
            f"#define SURFACE_MEMBERS ulong needs; {' '.join(f'{member};' for member in members)}\n"
        )

    return (
        f"#if CASTERS\n{definitions(casters=True)}"
        f"#elif INSTANCES\n{definitions(instances=True)}"
        f"#else\n{definitions()}#endif\n"
    )


# The layers that kernels/surface_layers.cl writes, and their bits in what is asked for. Z and the numbers are drawn from the
# triangles that own the pixels by kernels/layers.cl.
_LAYERS = {name: row for name, row in LAYER_TABLE.items() if row.kind != "uint32" and name != "Z"}
LAYER_BITS = {name: 1 << index for index, name in enumerate(_LAYERS)}
MIRRORED = 1 << len(LAYER_BITS)  # another bit: whether placements mirror


def layer_macros() -> str:
    """Return OpenCL C: the bits, LAYER_N and so on, and MIRRORED; LAYER_PARAMETERS of the kernel, to_N and so on;
    LAYER_VALUES, members named as the layers of type reals3; and FOR_LAYERS(DO), which is DO(name, bit, components,
    background) for each."""
    bits = {name: f"LAYER_{name.upper()}" for name in _LAYERS}
    each = ""
    for name, row in _LAYERS.items():
        background = "NAN_POSITION" if math.isnan(row.background) else f"{row.background!r}f"
        each += f" DO({name}, {bits[name]}, {len(row.components) or 1}, {background})"
    return (
        "".join(f"#define {bits[name]} {bit}\n" for name, bit in LAYER_BITS.items())
        + f"#define MIRRORED {MIRRORED}\n"
        + f"#define LAYER_PARAMETERS {', '.join(f'global real *to_{name}' for name in _LAYERS)}\n"
        + f"#define LAYER_VALUES reals3 {', '.join(_LAYERS)};\n"
        + f"#define FOR_LAYERS(DO){each}\n"
    )
