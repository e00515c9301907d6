"""How a scene is drawn: the settings, what they may be, and the types of the keywords that stand for them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict, get_args

from ..base.arrays import Converted, kept
from ..base.validation import choice, flag, integer, known, number, sequence, set_fields, value_error
from ..images.layer_words import LAYER_WORDS

if TYPE_CHECKING:
    from typing_extensions import Unpack

MAX_SAMPLES = 64  # a pixel

Shader: TypeAlias = Literal["gouraud", "phong", "nolight"]
Visibility: TypeAlias = Literal["painter", "depth"]
LightingAt: TypeAlias = Literal["centroid", "position"]
Interpolation: TypeAlias = Literal["affine", "perspective"]
TextureAt: TypeAlias = Literal["vertex", "pixel"]
TextureFilter: TypeAlias = Literal["bilinear", "trilinear"]
Ambient: TypeAlias = Literal["plain", "tinted"]
Resolve: TypeAlias = Literal["mean", "weighted"]
Precision: TypeAlias = Literal["fast", "float32", "float64"]
Layer: TypeAlias = Literal["Z", "id", "N", "P", "albedo", "uv", "object_id", "material_id", "barycentrics"]
Preset: TypeAlias = Literal["course", "standard"]

SHADERS: tuple[Shader, ...] = get_args(Shader)
VISIBILITIES: tuple[Visibility, ...] = get_args(Visibility)
LIGHTING_AT: tuple[LightingAt, ...] = get_args(LightingAt)
INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)
TEXTURE_AT: tuple[TextureAt, ...] = get_args(TextureAt)
TEXTURE_FILTERS: tuple[TextureFilter, ...] = get_args(TextureFilter)
AMBIENTS: tuple[Ambient, ...] = get_args(Ambient)
RESOLVES: tuple[Resolve, ...] = get_args(Resolve)
PRECISIONS: tuple[Precision, ...] = get_args(Precision)
LAYERS: tuple[Layer, ...] = get_args(Layer)
PRESETS: tuple[Preset, ...] = get_args(Preset)

# What layers are called elsewhere, in small letters.
LAYER_REMARKS = dict.fromkeys(
    ("r", "g", "b", "a", "rgb", "rgba", "color", "image", "beauty", "alpha", "mask", "coverage"),
    "the image and its coverage are always there (frame.rgba; R, G, B, A of the EXR)",
)


Asked: TypeAlias = Layer | Literal["all"] | Iterable[Layer | Literal["all"]]


class SettingsFields(TypedDict, total=False):
    """What `Settings` may be given, and every call that takes its fields as keywords."""

    shader: Shader
    visibility: Visibility
    lighting_at: LightingAt
    interpolation: Interpolation
    texture_at: TextureAt
    texture_filter: TextureFilter
    ambient: Ambient
    layers: Asked
    cull: bool
    near: float | None
    precision: Precision
    samples: int
    sample_shading: bool
    resolve: Resolve


class RenderOptions(SettingsFields, total=False):
    """The same with what changes the scene's camera."""

    resolution: tuple[int, int] | None


class FrameOptions(RenderOptions, total=False):
    """The same with what they change."""

    preset: Preset | None
    settings: Settings | None


@dataclass(frozen=True)
class Settings:
    """How a scene is drawn. The defaults are the preset `standard`; `Settings.from_preset("course")` gives the other.

    shader: gouraud, phong or nolight (the color itself).
    visibility: `painter`: the triangle with the smallest mean vertex depth wins, ties: the later face; `depth`: per
        pixel, ties: the later face.
    lighting_at: `centroid`: directions to eye and lights once per triangle; `position`: at each pixel (or vertex).
    interpolation: of attributes over a triangle, `affine` in the image or `perspective`. Depth is always perspective.
    texture_at: `vertex` looks the texture up at the corners, `pixel` at every pixel.
    texture_filter: `bilinear` takes the four texels around the point, however many a pixel spans. `trilinear` takes them
        of two mip-map levels, the level of detail being OpenGL's (kernels/texture.clh); where a pixel spans at most a
        texel that is bilinear, bit for bit. It needs texture_at pixel: a corner spans no texels. Textures with the
        course's lookup, and the alpha test, stay bilinear in full resolution.
    ambient: `plain` ka*Ia, or `tinted` ka*Ia*color.
    layers: further layers besides the image, any of LAYERS or `all`; `Frame.__getitem__` says what each holds.
    cull: leave out triangles that are seen from behind (clockwise in the image).
    near: distance of the near plane from the eye, scene units; None: 1e-4 of the scene's bounding radius.
    precision: arithmetic of the kernels. `float32`: the same bits on every device. `fast`: float32 with shorter polynomials
        and plain texture coordinates, right to about 3e-5, the same bits too. `float64`: the image is float64 then; not
        every device has it.
    samples: how many places of each pixel are looked at, 1 to 64 (`sampling.positions`). A triangle is lit once in each
        pixel: at the center where it covers all places, else at the one nearest the center of those it covers. Layers
        are those of the place nearest the center.
    sample_shading: light every sample.
    resolve: how samples become a pixel. `mean`, or `weighted`: each counts 1/(1 + its luminance), which keeps single
        bright samples from standing out but makes edges of bright surfaces darker than they are. Without a background
        the covered samples are weighed against each other, and their mean is premultiplied.
    """

    shader: Shader = "phong"
    visibility: Visibility = "depth"
    lighting_at: LightingAt = "position"
    interpolation: Interpolation = "perspective"
    texture_at: TextureAt = "pixel"
    texture_filter: TextureFilter = "bilinear"
    ambient: Ambient = "tinted"
    layers: Converted[Asked, tuple[Layer, ...]] = field(default=kept(()))
    cull: bool = False
    near: float | None = None
    precision: Precision = "float32"
    samples: int = 1
    sample_shading: bool = False
    resolve: Resolve = "mean"

    def __post_init__(self) -> None:
        who = "Settings"
        choice(who, "shader", self.shader, SHADERS)
        choice(who, "visibility", self.visibility, VISIBILITIES)
        choice(who, "lighting_at", self.lighting_at, LIGHTING_AT)
        choice(who, "interpolation", self.interpolation, INTERPOLATIONS)
        choice(who, "texture_at", self.texture_at, TEXTURE_AT)
        choice(who, "texture_filter", self.texture_filter, TEXTURE_FILTERS)
        if self.texture_filter == "trilinear" and self.texture_at == "vertex":
            expected = "bilinear with texture_at vertex, for a corner spans no texels (or texture_at pixel)"
            raise value_error(who, "texture_filter", expected, self.texture_filter)
        choice(who, "ambient", self.ambient, AMBIENTS)
        choice(who, "precision", self.precision, PRECISIONS)
        set_fields(self, samples=integer(who, "samples", self.samples, 1, MAX_SAMPLES))
        set_fields(self, sample_shading=flag(who, "sample_shading", self.sample_shading))
        choice(who, "resolve", self.resolve, RESOLVES)
        layers = (self.layers,) if isinstance(self.layers, str) else sequence(self.layers)
        if layers is None:
            raise value_error(who, "layers", f"names of {', '.join(LAYERS)}, or all", self.layers)
        for layer in layers:
            choice(who, "layers", layer, (*LAYERS, "all"), words=LAYER_WORDS, remarks=LAYER_REMARKS)
        asked = tuple(name for name in LAYERS if name in layers or "all" in layers)
        set_fields(self, layers=asked, cull=flag(who, "cull", self.cull))
        if self.near is not None:
            set_fields(self, near=number(who, "near", self.near, above=0.0))

    @classmethod
    def from_preset(cls, preset: Preset, **fields: Unpack[SettingsFields]) -> Settings:
        """The named preset with `fields` changed. Raises InputError for an unknown preset, field or value."""
        choice("Settings", "preset", preset, PRESETS)
        values: dict[str, Any] = {}
        if preset == "course":
            values = {
                "visibility": "painter",
                "lighting_at": "centroid",
                "interpolation": "affine",
                "texture_at": "vertex",
                "ambient": "plain",
            }
        known("Settings", fields, cls.__dataclass_fields__)
        return cls(**{**values, **fields})
