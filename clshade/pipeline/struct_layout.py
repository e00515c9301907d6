"""Structs and constants shared by host and kernels, defined once; `header()` emits them as OpenCL C.

A `real` is float32, or float64 in kernels of that precision. NumPy aligns members as C does;
`tests/pipeline/test_layout.py` probes sizes and offsets on every device.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..scene import metallic_roughness
from ..scene.image_light import brdf_table, specular
from ..scene.material import TERMS
from ..scene.metallic_roughness import MAPS

SUBPIXEL_BITS = 16  # snapped positions count 1/65536 px
SAMPLE_BITS = 8  # samples lie at multiples of 1/256 px
# The guard band: image coordinates, from the corner of the region that is drawn, of a vertex without clipping. Two corners
# are less than 2^15 px apart, so that differences of snapped positions are ints.
GUARD_LOW, GUARD_HIGH = -8191, 24575
# Means "beyond the guard band" in snapped positions, which within it are at most 24575 px from any part of an image.
SNAP_LIMIT = 32767 << SUBPIXEL_BITS
TILE_SIZE = 16  # pixels per side
FEW_PIXELS = 4  # boxes of up to so many are rasterized pixel by pixel, larger ones by blocks
MOST_SAMPLES = 64  # per pixel
MOST_LENGTH = 2.0**60  # scaled eye-relative coordinates are clamped to it: their squares stay within float32's range
MOST_DEPTH = 2.0**100  # scaled depths are clamped to it: their reciprocals stay within float32's range
MOST_LEVELS = 16  # of a texture: its own size, at most 2^15, and each half of the previous down to 1
MOST_POSITION = 2.0**100  # in a color map: positions are clamped to it, and those below mean something else
NAN_POSITION = 2.0**120  # of what has no number
WHITE_POSITION = 2.0**124  # of what no color map colors
LINE_INSET = 64  # 1/256 px: the visibility of a line is not asked nearer to its ends, nor beyond its middle
# How far a column and a row shift the points of lights in their unit square, fractions of 2^24: powers of 1/g, with
# g^5 = g + 1, so that the shifts of neighboring pixels fill the square evenly (light_points.py).
LIGHT_SHIFTS = {
    "SHIFT_U_COLUMN": 14372620,
    "SHIFT_U_ROW": 9036163,
    "SHIFT_V_COLUMN": 10547948,
    "SHIFT_V_ROW": 12312662,
}
SHADOW_REACH = 2.0**15  # coordinates of casters are at most this, in the units of shadows
SHADOW_GRID = 2.0**-31  # and multiples of this: differences have 47 bits, which a pair of float32 holds
RECEIVER_UNITS = 9  # of SHADOW_GRID: how far off its face's plane a receiver may lie along each axis
OCCLUSION_W = 0.125  # of the ends of rays of ambient occlusion, whose coordinates are below SHADOW_REACH / OCCLUSION_W
MOST_HIERARCHY_LEVELS = 7  # of nodes: 16^8 triangles
CURVE_BITS = 36  # of a caster's place along Hilbert's curve, 12 an axis
HIERARCHY_RUN = 4096  # casters that are put in a better order than that curve's
SIZE_BITS = 2  # of its class of size
LEAST_ALPHA = metallic_roughness.LEAST_ROUGHNESS**2
ENVIRONMENT_LEVELS = specular.LEVELS
BRDF_SIDE = brdf_table.SIDE
OFF_MIRROR = specular.OFF_MIRROR

CONSTANTS = {
    **{name: value for name, value in globals().items() if isinstance(value, (int, float))},  # all of the above
    **LIGHT_SHIFTS,
    **{f"TERM_{each.feature}": index for index, each in enumerate(TERMS.values())},
    "TERMS": len(TERMS),
    **{f"MAP_{each.name}": index for index, each in enumerate(MAPS.values())},
    "MAPS": len(MAPS),
    "SCALED_MAPS": sum(1 << index for index, each in enumerate(MAPS.values()) if each.factor),
    "WRAP_REPEAT": 0,
    "WRAP_CLAMP": 1,
    "WRAP_MIRROR": 2,
    "LOOKUP_STANDARD": 0,
    "LOOKUP_COURSE": 1,
}

# name -> list of (C type, member, count, description)
_STRUCTS: dict[str, list[tuple[str, str, int, str]]] = {
    "View": [
        ("ulong", "needs", 1, "as of Image"),
        ("double", "eye", 3, "world space"),
        ("double", "axes", 9, "rows: camera x, y, z in world space"),
        ("double", "principal", 2, "where the viewing direction meets the image, fractions of N and M"),
        ("double", "focal", 1, "scene units"),
        ("double", "plane_width", 1, "W, scene units"),
        ("double", "plane_height", 1, "H, scene units"),
        ("double", "columns", 1, "N, of the whole image if a part of one is drawn"),
        ("double", "rows", 1, "M, likewise"),
        ("double", "guarded", 2, "lower left corner of the region that the guard band surrounds, column and row"),
        ("double", "first", 2, "column and row of the drawn part's lower left pixel, in 1/65536 px"),
        ("double", "near", 1, "scene units"),
        ("double", "scale", 1, "power of two that brings eye-relative positions to about 1"),
    ],
    "Vertex": [
        ("double", "depth", 1, "camera z, scene units"),
        ("int", "x", 1, "snapped, 1/65536 px; meaningless before the near plane"),
        ("int", "y", 1, "snapped, 1/65536 px, up"),
        ("real", "w", 1, "1/depth, scaled; orthographic: minus the scaled depth"),
        ("real", "w_low", 1, "what rounding leaves of w"),
    ],
    "Triangle": [
        ("int", "x", 3, "snapped corners, 1/65536 px"),
        ("int", "y", 3, "snapped corners, 1/65536 px, up"),
        ("real", "w", 3, "1/depth of the corners, scaled"),
        ("int", "piece_and_turn", 1, "2 * p + 1 if clockwise, else 2 * p; p: its clipped piece, -1 for a whole face"),
        ("int", "face", 1, "index in the scene's face order"),
        ("real", "inverse_area", 1, "2^16 over twice the area in (1/65536 px)^2"),
    ],
    "Bounds": [
        ("ulong", "box", 1, "16 bits each, lowest first: first column, first row, last column, last row with a sample"),
        ("real", "nearest", 1, "the largest w of the corners"),
        ("real", "only", 1, "its w at the one pixel that it covers, infinity where that is not so or not known"),
    ],
    "Entry": [
        ("real", "nearest", 1, "the largest w of its corners"),
        ("int", "index", 1, "of the triangle"),
        ("int", "box", 1, "within the tile, 8 bits each: first column, first row, last column, last row"),
        ("real", "only", 1, "as in Bounds"),
    ],
    "Piece": [
        ("double", "key_depth", 1, "the depth it is sorted by, scene units"),
        ("real", "w", 3, "1/depth of the piece's corners, scaled"),
        ("real", "w_low", 3, "what rounding leaves of w"),
        ("int", "x", 3, "snapped corners, 1/65536 px"),
        ("int", "y", 3, "snapped corners, 1/65536 px, up"),
        ("int", "face", 1, "index in the scene's face order"),
        ("real", "weights", 9, "row j: the piece's corner j as a mean of the face's corners"),
        ("real", "weights_low", 9, "what rounding leaves of weights"),
        ("real", "uv", 6, "texture coordinates of the corners: u, v, u, v, u, v"),
        ("real", "uv_low", 6, "what rounding leaves of uv"),
    ],
    "Instance": [
        ("double", "rows", 12, "of its placement: three of the matrix, each with its shift"),
        ("double", "scale", 1, "a power of two that brings the matrix to about 1"),
        ("int", "plain", 1, "whether the placement is the identity"),
        ("int", "mirrored", 1, "whether it mirrors"),
        ("int", "first_vertex", 1, "of its mesh"),
        ("int", "first_face", 1, "of its mesh"),
        ("int", "face_shift", 1, "from its mesh's faces to the scene's, modulo 2^32"),
        ("int", "number", 1, "of the layer instance_id"),
    ],
    "Light": [  # zeros are a plain point
        ("real", "position", 3, "relative to the eye, world axes, scaled; directional: unit, toward the light"),
        ("real", "directional", 1, "1 for a directional light, else 0"),
        ("real", "intensity", 3, "linear RGB; attenuated: at a scaled distance of 1"),
        ("real", "inverse_range", 1, "1/range, scaled; 0 for none"),
        ("real", "axis", 3, "unit, world axes: of the cone, away from the light; or of a light of finite size"),
        ("real", "cone_cosine", 1, "of the outer angle"),
        ("real", "cone_scale", 1, "1 over the difference of the inner and the outer cosine"),
        ("int", "cone", 1, "whether it is a spot"),
        ("int", "attenuated", 1, "whether it decreases with the square of the distance"),
        ("int", "points", 1, "that stand for a light of finite size, 0 for none"),
        ("int", "sphere", 1, "whether it is a sphere, else a rectangle whose normal is axis"),
        ("real", "right", 3, "scaled: half a side of a rectangle, or a radius of a sphere's disc with normal axis"),
        ("real", "up", 3, "scaled: half the other side, or the radius at right angles"),
        ("real", "shadow_scale", 1, "turns right and up into the units of its ShadowLight; with SHADOWS"),
        ("real", "center_scale", 1, "turns position into the units of right and up, a power of two, 1 or less"),
        ("int", "first_point", 2, "in the unit square, fractions of 2^32"),
        ("int", "point_step", 2, "from point to point"),
    ],
    "ShadowLight": [
        ("float", "high", 3, "of its position relative to the casters' origin, in the units of shadows, times w"),
        ("float", "w", 1, "1, a smaller power of two for a distant light, 0 for a directional one: toward it"),
        ("float", "low", 3, "what rounding leaves of the position"),
        ("int", "pad", 1, ""),
    ],
    "ShadowView": [
        ("float", "start", 3, "where the rays begin, or with ORTHOGRAPHIC the center's, in the frame of shadows"),
        ("float", "start_low", 3, "what rounding leaves of start, and so below"),
        ("float", "along", 3, "direction of the center's ray"),
        ("float", "along_low", 3, ""),
        ("float", "right", 3, "what 1/256 px to the right adds to along, with ORTHOGRAPHIC to start"),
        ("float", "right_low", 3, ""),
        ("float", "up", 3, "what 1/256 px up adds"),
        ("float", "up_low", 3, ""),
        ("int", "center", 2, "1/256 px"),
        ("int", "pad", 2, ""),
    ],
    "Casters": [
        ("int", "levels", 1, "of nodes of a hierarchy, 0 without casters"),
        ("int", "first_node", MOST_HIERARCHY_LEVELS, "of each level, the parents of leaves first"),
        ("int", "first_leaf", 1, ""),
    ],
    "Material": [
        ("real", "ambient", 3, "ka * Ia, linear RGB"),
        ("real", "n", 1, "specular exponent"),
        ("int", "texture", 1, "index of the texture, -1 for none"),
        ("real", "k", 3 * len(TERMS), "coefficients of Phong's terms, by TERM_*, linear RGB each"),
        ("int", "two_sided", 1, "whether a side seen from behind is lit with its normal turned round"),
        ("real", "alpha_cutoff", 1, "pixels with less alpha are left out, if it is tested"),
        ("int", "front_only", 1, "whether only counter-clockwise triangles are drawn"),
        ("int", "alpha_texture", 1, "index of the texture whose alpha counts, -1 for none"),
        ("real", "f90", 1, "of the dielectric: its reflectance at grazing incidence"),
        ("real", "f0", 3, "of the dielectric: at normal incidence, per channel"),
        ("real", "metallic", 1, "0 to 1"),
        ("real", "diffuse", 3, "factor of the color in the diffuse term of shader pbr, per channel"),
        ("real", "roughness", 1, "0 to 1, GGX's alpha is its square"),
        ("real", "emission", 3, "linear RGB"),
        ("int", "maps", len(MAPS), "by MAP_*, indices of textures, -1 for none"),
        ("real", "map_factors", len(MAPS), "by MAP_*: `Map.factor`"),
        ("real", "opacity", 1, "factor of alpha"),
        ("int", "alpha_tested", 1, "whether alpha is tested"),
        ("int", "blends", 1, "whether it is transparent: composited by alpha"),
        ("int", "alpha_pad", 2, ""),
    ],
    "Environment": [
        ("int", "offset", ENVIRONMENT_LEVELS, "of each level's first texel in the table of radiance"),
        ("int", "side", ENVIRONMENT_LEVELS, "texels a side without the border of one texel"),
        ("int", "pad", 2, ""),
        ("real", "irradiance", 27, "over pi: factors of x, y, z, xx, yy, zz, xy, yz, zx of the normal, linear RGB"),
        ("real", "pad2", 1, ""),
    ],
    "Texture": [
        ("int", "offset", MOST_LEVELS, "of each level's first texel in the texel buffer"),
        ("int", "width", 1, "texels"),
        ("int", "height", 1, "texels"),
        ("int", "wrap", 2, "WRAP_* along u and v"),
        ("int", "lookup", 1, "LOOKUP_*"),
        ("int", "levels", 1, "how many there are, 1 without mip-mapping"),
        ("int", "nearest", 1, "whether the nearest texel is shown"),
        ("int", "uv_offset", 1, "of its coordinates among those of all sets"),
        ("int", "alike", 1, "the first texture with its size, wrap modes, lookup, filter and coordinates"),
    ],
    "Image": [
        ("ulong", "needs", 1, "a bit for each feature that the frame needs, see features.clh"),
        ("int", "columns", 1, "N"),
        ("int", "rows", 1, "M"),
        ("int", "first", 2, "column and row of the lower left pixel in the whole image of which this is a part"),
        ("int", "tiles_x", 1, "tiles a row"),
        ("int", "tiles", 1, "tiles in all"),
        ("int", "lights", 1, "count"),
        ("int", "samples", 1, "a pixel; with SAMPLES"),
        ("int", "sample_x", MOST_SAMPLES, "nearest to the center first, 1/65536 px from the pixel's left"),
        ("int", "sample_y", MOST_SAMPLES, "1/65536 px from the pixel's lower end"),
        ("int", "least", 2, "least of sample_x, of sample_y"),
        ("int", "most", 2, "most of sample_x, of sample_y"),
        ("int", "transparent", 1, "whether there is no background"),
        ("int", "streamed", 1, "whether pixels are written past the caches: rows must begin at multiples of 64 bytes"),
        ("int", "list_capacity", 1, "entries that the tile lists have room for"),
        ("int", "map_colors", 1, "colors of the color map from its low end to its high one; with SCALARS"),
        ("int", "unlit", 1, "whether colors are taken as they are, shader nolight, where they are lit nonetheless"),
        ("int", "backdrop_columns", 1, "pixels of the environment that is the background; with BACKDROP"),
        ("int", "backdrop_rows", 1, "pixels"),
        ("int", "ray_center", 2, "where the viewing direction meets the image, 1/256 px"),
        ("real", "background", 3, "linear RGB"),
        ("real", "unscale", 1, "turns a scaled depth into scene units"),
        ("real", "light_unit", 1, "what light is counted in: a power of two"),
        ("real", "layer_alpha", 1, "the alpha from which on layers show a transparent triangle"),
        ("real", "to_eye", 3, "unit, world axes: against the viewing direction"),
        ("real", "line_color", 3, "linear RGB; with LINES"),
        ("real", "marked_color", 3, "of lines along edges of more than two faces"),
        ("real", "backdrop_unit", 1, "what the table of the background is counted in: a power of two"),
        ("real", "ray_step", 2, "how far a ray turns to the right and up per 1/256 px, over the length of ray_axes"),
        ("real", "ray_offset", 2, "how far it is turned at ray_center"),
        ("real", "ray_axes", 9, "rows: the environment's front, left, top; columns: camera x, y, viewing direction"),
    ],
    "Line": [
        ("double", "w", 2, "1/depth of its ends, scaled; with painter's order minus the first rank of its faces"),
        ("double", "inset", 1, "fraction of its length: its visibility is not asked nearer to an end"),
        ("int", "x", 2, "snapped ends, 1/256 px"),
        ("int", "y", 2, "snapped ends, 1/256 px, up"),
        ("int", "first_face", 1, "index of the first of its faces in the faces of all edges"),
        ("int", "faces", 1, "that contain the edge"),
        ("int", "marked", 1, "whether they are more than two"),
        ("int", "pad", 1, ""),
    ],
    "LineGrid": [
        ("int", "cell_bits", 1, "cells have 2^cell_bits/256 px a side"),
        ("int", "margin", 1, "cells around the image, on each side, that lines may reach from"),
        ("int", "across", 1, "cells a row, those of the margin included"),
        ("int", "up", 1, "cells a column"),
        ("int", "width", 1, "of the lines, 1/256 px"),
        ("int", "pad", 3, ""),
    ],
    "Hider": [
        ("double", "nearest", 1, "the largest w of its corners; with painter's order minus its rank"),
        ("int", "index", 1, "of the triangle: a face, or the number of faces plus that of a clipped piece"),
        ("int", "low", 2, "least x and y of its corners, 1/256 px"),
        ("int", "high", 2, "largest x and y"),
        ("int", "pad", 1, ""),
    ],
    "Counters": [
        ("int", "visible", 1, "triangles that may be seen"),
        ("int", "to_clip", 1, "faces listed for the host to clip"),
        ("int", "behind", 1, "faces wholly before the near plane"),
        ("int", "off_screen", 1, "triangles whose box misses the image"),
        ("int", "between_samples", 1, "triangles that cover no sample"),
        ("int", "zero_area", 1, "triangles whose snapped corners lie on a line"),
        ("int", "back_facing", 1, "triangles culled as seen from behind"),
        ("int", "next_tile", 1, "the tile to be handed out next"),
        ("int", "saturated", 1, "pixels with a color beyond what a real holds"),
        ("int", "empty_tiles", 1, "tiles without entries, where there is a triangle at all"),
        ("ulong", "entries", 1, "of all tile lists"),
        ("int", "pad", 4, ""),
    ],
}

_NUMPY = {"double": "<f8", "float": "<f4", "int": "<i4", "ulong": "<u8"}


class Structs(NamedTuple):
    """The structs' NumPy types. real: the scalar type of their members of that name."""

    real: type[np.floating]
    View: np.dtype
    Vertex: np.dtype
    Triangle: np.dtype
    Bounds: np.dtype
    Entry: np.dtype
    Piece: np.dtype
    Instance: np.dtype
    Light: np.dtype
    ShadowLight: np.dtype
    ShadowView: np.dtype
    Casters: np.dtype
    Material: np.dtype
    Environment: np.dtype
    Texture: np.dtype
    Image: np.dtype
    Line: np.dtype
    LineGrid: np.dtype
    Hider: np.dtype
    Counters: np.dtype


def _structs(real: type[np.floating]) -> Structs:
    kinds = {**_NUMPY, "real": np.dtype(real).str}
    types = {
        struct: np.dtype(
            [(name, kinds[kind], (count,) if count > 1 else ()) for kind, name, count, _ in members], align=True
        )
        for struct, members in _STRUCTS.items()
    }
    return Structs(real, **types)


SINGLE, DOUBLE = _structs(np.float32), _structs(np.float64)


def header(*, double_reals: bool = False, with_double: bool = True) -> str:
    """Return OpenCL C of all constants and structs.

    double_reals: whether a real is a double. with_double: whether the device has float64; if not, members of type ulong hold
    the bits of doubles.
    """
    lines = [f"#define FP64 {int(with_double)}", f"typedef {'double' if double_reals else 'float'} real;"]
    lines += [f"#define {name} {value}" for name, value in CONSTANTS.items()]
    for struct, members in _STRUCTS.items():
        lines.append("typedef struct {")
        for kind, name, count, what in members:
            size = f"[{count}]" if count > 1 else ""
            comment = f"  // {what}" if what else ""
            lines.append(f"    {kind if with_double or kind != 'double' else 'ulong'} {name}{size};{comment}")
        lines.append(f"}} {struct};")
    return "\n".join(lines) + "\n"
