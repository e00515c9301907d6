"""The mistakes that are modeled: each a sentence for the student, and what it does to the drawing of the right image."""

from __future__ import annotations

from typing import NamedTuple

from . import edge_mistakes as edge
from . import image_mistakes as image
from . import light_mistakes as light
from . import scene_mistakes as scene
from .drawing import Variants


class Mistake(NamedTuple):
    """A mistake, in one or more variants.

    name: short. advice: what is wrong and what to do. variants: of the right drawing, each with its words; "" where there is
    one only; none where the scene cannot have it. early: whether it precedes those that concern the finished image. moves:
    whether it exchanges pixels.
    """

    name: str
    advice: str
    variants: Variants
    early: bool = True
    moves: bool = False


# In the order in which they are preferred where several give the same image.
MISTAKES = (
    Mistake(
        "upside down",
        "The course's functions return row 0 at the bottom; flip with image[::-1] once, only when writing a PNG.",
        image.rows_reversed,
        early=False,
        moves=True,
    ),
    Mistake(
        "mirrored",
        "Left and right are exchanged: check the sign of the camera's x axis, z cross y.",
        image.mirrored,
        early=False,
        moves=True,
    ),
    Mistake(
        "turned by 180 degrees",
        "Rows and columns are both reversed: the image point is u to the right, v up.",
        image.turned,
        early=False,
        moves=True,
    ),
    Mistake(
        "axes swapped",
        "Rows and columns are exchanged: index image[row, column], which is [y, x].",
        image.transposed,
        early=False,
        moves=True,
    ),
    Mistake("nothing is drawn", "The image shows the background alone: nothing of the object is drawn.", edge.nothing),
    Mistake(
        "whole pixels off",
        "The image is shifted by whole pixels: pixel (column, row) counts from 0.",
        edge.whole_pixels,
    ),
    Mistake(
        "half a pixel off",
        "The image is shifted by half a pixel: pixel centers lie at column + 0.5 and row + 0.5.",
        edge.half_pixel,
    ),
    Mistake(
        "corners rounded to pixels",
        "Projected corners are rounded to whole pixels: keep their fractions.",
        edge.rounded_corners,
    ),
    Mistake(
        "one pixel too many",
        "Triangles are drawn one pixel too far: a span ends before the edge that it meets.",
        edge.too_many,
    ),
    Mistake("one pixel too few", "Triangles miss their last pixel: range(first, last) leaves out last.", edge.too_few),
    Mistake(
        "painter's order reversed",
        "The nearest triangles are drawn first and covered by far ones: sort by depth, farthest first.",
        edge.reversed_order,
    ),
    Mistake(
        "no sort", "Triangles are drawn in the order of the file: sort them by depth, farthest first.", edge.no_sort
    ),
    Mistake(
        "sorted by one corner",
        "Triangles are sorted by the depth of one corner: sort by the mean of all three.",
        edge.one_corner,
    ),
    Mistake(
        "depth buffer",
        "Each pixel shows its nearest triangle: the course draws whole triangles in painter's order.",
        scene.depth_buffer,
    ),
    Mistake("back faces left out", "Faces seen from behind are left out: the course draws all.", scene.culled),
    Mistake(
        "shader exchanged",
        "Gouraud lights corners and interpolates colors, Phong lights each pixel: this is the other one.",
        scene.other_shader,
    ),
    Mistake(
        "no light at all",
        "The colors are shown unlit: call light() for each corner (Gouraud) or pixel (Phong).",
        scene.unlit,
    ),
    Mistake(
        "normals per face",
        "Each face has its own normal: average those of the faces around a vertex.",
        scene.face_normals,
    ),
    Mistake(
        "normals flipped",
        "Normals point inward: take the cross product of the edges in the other order.",
        scene.flipped_normals,
    ),
    Mistake(
        "normals not renormalized",
        "Interpolated normals are shorter than 1: divide by the length in each pixel.",
        light.unnormalized,
    ),
    Mistake("a light missing", "A light is not added: sum over all lights.", scene.missing_light),
    Mistake(
        "one channel of a light",
        "Only one channel of a light arrives: multiply by its intensity channel by channel.",
        scene.one_channel,
    ),
    Mistake(
        "lights without color",
        "The intensity of the lights is ignored: multiply by it, channel by channel.",
        scene.white_lights,
    ),
    Mistake("lights averaged", "The sum over the lights is divided by their number: only add.", scene.averaged_lights),
    Mistake("light falls off", "The light is divided by the squared distance: the course's is not.", scene.falling_off),
    Mistake("no ambient light", "The term ka*Ia is missing.", scene.no_ambient),
    Mistake("no diffuse light", "The term kd*(N.L) is missing.", scene.no_diffuse),
    Mistake("no highlight", "The term ks*(R.V)^n is missing.", scene.no_highlight),
    Mistake("ambient light per lamp", "ka*Ia is added once for each light: add it once.", scene.ambient_per_light),
    Mistake(
        "ka without Ia", "The ambient intensity Ia is left out: the term is ka*Ia.", scene.ambient_without_intensity
    ),
    Mistake(
        "ambient light times color",
        "ka*Ia is multiplied by the color: the course adds it as it is.",
        scene.tinted_ambient,
    ),
    Mistake(
        "highlight without color",
        "The highlight is not multiplied by the color: the course multiplies both terms.",
        light.white_highlight,
    ),
    Mistake(
        "light clipped before color",
        "The light is clipped to 1 before it is multiplied by the color: clip the sum, at the end.",
        light.clipped_light,
    ),
    Mistake("N.L not clamped", "N.L is not clamped: max(N.L, 0), or lights behind darken.", light.unclamped),
    Mistake("N.L by absolute value", "|N.L| lights the far side too: max(N.L, 0).", light.absolute),
    Mistake(
        "highlight without gate", "There are highlights where the light is behind: none where N.L <= 0.", light.ungated
    ),
    Mistake(
        "R.V by absolute value", "|R.V| or an even power makes a second highlight: max(R.V, 0).", light.absolute_mirror
    ),
    Mistake("Blinn for Phong", "The highlight is (N.H)^n, Blinn's: Phong's is (R.V)^n.", light.blinn),
    Mistake("R with the wrong sign", "R points the wrong way: R = 2N(N.L) - L.", light.reversed_mirror),
    Mistake("R without its factor 2", "R = N(N.L) - L lacks the factor 2: R = 2N(N.L) - L.", light.halved_mirror),
    Mistake("no exponent", "The highlight is not raised to the power n.", scene.no_exponent),
    Mistake("V from the wrong point", "V does not point from the surface to the eye: V = eye - P.", light.wrong_view),
    Mistake(
        "L from the wrong point", "L does not point from the surface to the light: L = position - P.", light.wrong_light
    ),
    Mistake(
        "light at each point",
        "V and L are taken at each point: the course takes the triangle's center of mass.",
        scene.own_points,
    ),
    Mistake(
        "the other interpolation",
        "Values are interpolated with perspective: the course interpolates linearly in the image (affine).",
        scene.other_interpolation,
    ),
    Mistake("texture ignored", "The vertex colors are shown in place of the texture.", scene.untextured),
    Mistake("v flipped", "v is upside down: row 0 of the texture is v = 0.", scene.flipped_v),
    Mistake("u flipped", "u is reversed: column 0 of the texture is u = 0.", scene.flipped_u),
    Mistake("u and v swapped", "u and v are exchanged: texture[v, u], row first.", scene.swapped_uv),
    Mistake("half a texel off", "The texture is shifted by half a texel: x = u*(w-1), y = v*(h-1).", scene.half_texel),
    Mistake("nearest for bilinear", "The nearest texel is shown: interpolate between four.", scene.nearest_texel),
    Mistake(
        "texture per pixel", "Texels are looked up per pixel: the course looks up corners.", scene.texture_per_pixel
    ),
    Mistake(
        "one color per triangle",
        "Colors and normals of a triangle are not interpolated: blend those of its corners.",
        scene.flat_triangles,
    ),
    Mistake("wrong background", "The background has another color than bg_color.", image.wrong_background, early=False),
    Mistake(
        "gamma", "The image is gamma-encoded: the course writes linear values, round(255*x).", image.gamma, early=False
    ),
    Mistake("gamma twice", "The image is gamma-encoded twice.", image.gamma_twice, early=False),
    Mistake("gamma decoded", "The image is too dark: it was decoded from gamma.", image.decoded, early=False),
    Mistake(
        "8-bit wrap",
        "Values above 1 wrap around in 8 bits: clip to [0, 1] before the conversion.",
        image.wrapped,
        early=False,
    ),
    Mistake(
        "divided by its maximum", "The image is divided by its largest value: clip it.", image.normalized, early=False
    ),
    Mistake(
        "channels in another order", "Color channels are exchanged, such as BGR for RGB.", image.channels, early=False
    ),
    Mistake("gray", "The image has no color: a mean or one channel is shown.", image.gray, early=False),
    Mistake("negative", "Dark and bright are exchanged: 1 - x.", image.negative, early=False),
)
