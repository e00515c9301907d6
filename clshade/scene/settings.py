"""Rendering settings: the settings, their allowed values, and the types of the corresponding keyword arguments."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict, get_args

from numpy.typing import ArrayLike

from ..base import declare
from ..base.arrays import Converted
from ..base.validation import choice, known, sequence, set_fields, value_error
from ..errors import InputError
from ..images.colors import Rgb, linear_rgb
from ..images.layers import LAYER_REMARKS, LAYER_TABLE, LAYER_WORDS
from ..images.layers import LAYERS as LAYERS
from ..images.layers import Layer as Layer
from .edges import EDGE_KINDS, AskedKinds, Edges
from .scalars import Scalars, as_scalars

if TYPE_CHECKING:
    from typing_extensions import Unpack

MAX_SAMPLES = 64  # per pixel
MAX_LIGHT_SAMPLES = 256
MAX_AMBIENT_OCCLUSION = 1024  # rays

Shader: TypeAlias = Literal["gouraud", "phong", "nolight", "pbr"]
Visibility: TypeAlias = Literal["painter", "depth"]
LightingAt: TypeAlias = Literal["centroid", "position"]
Interpolation: TypeAlias = Literal["affine", "perspective"]
TextureAt: TypeAlias = Literal["vertex", "pixel"]
TextureFilter: TypeAlias = Literal["bilinear", "trilinear"]
Ambient: TypeAlias = Literal["plain", "tinted"]
Resolve: TypeAlias = Literal["mean", "weighted"]
Precision: TypeAlias = Literal["fast", "float32", "float64"]
Preset: TypeAlias = Literal["course", "standard", "pbr"]
Look: TypeAlias = Literal["studio", "plain", "course"]  # of a scene, see `scene.look`
NamedBackground: TypeAlias = Literal["scene", "environment"]

SHADERS: tuple[Shader, ...] = get_args(Shader)
PRECISIONS: tuple[Precision, ...] = get_args(Precision)
PRESETS: tuple[Preset, ...] = get_args(Preset)
LOOKS: tuple[Look, ...] = get_args(Look)
BACKGROUNDS: tuple[NamedBackground, ...] = get_args(NamedBackground)

# Fields in which a preset differs from the defaults.
PRESET_FIELDS: dict[Preset, dict[str, Any]] = {
    "course": {
        "visibility": "painter",
        "lighting_at": "centroid",
        "interpolation": "affine",
        "texture_at": "vertex",
        "ambient": "plain",
    },
    "standard": {},
    "pbr": {"shader": "pbr", "shadows": True},
}
LIGHT_FIELDS = ("shadows", "light_samples", "ambient_occlusion", "ao_distance")  # which light arrives

Asked: TypeAlias = Layer | Literal["all"] | Iterable[Layer | Literal["all"]]


class SettingsFields(TypedDict, total=False):
    """Fields of `Settings`, as keyword arguments of `Settings` and of every call that takes them."""

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
    scalars: Scalars | str | None
    edges: Edges | AskedKinds | None
    background: ArrayLike | None
    layer_alpha: float
    light_samples: int
    shadows: bool
    ambient_occlusion: int
    ao_distance: float | None


class RenderOptions(SettingsFields, total=False):
    """The fields of `Settings`, and a resolution for the scene's camera."""

    resolution: tuple[int, int] | None


class FrameOptions(RenderOptions, total=False):
    """The same, and the preset or settings that they change."""

    preset: Preset | None
    settings: Settings | None


def _layers(owner: str, name: str, value: Any) -> tuple[str, ...]:
    """Return names of layers, `all` among them, in any order."""
    layers = (value,) if isinstance(value, str) else sequence(value)
    if layers is None:
        raise value_error(owner, name, f"names of {', '.join(LAYERS)}, or all", value)
    return tuple(
        choice(owner, name, layer, (*LAYERS, "all"), words=LAYER_WORDS, remarks=LAYER_REMARKS) for layer in layers
    )


def _edges(owner: str, name: str, value: Any) -> Edges:
    if isinstance(value, Edges):
        return value
    if not isinstance(value, str) and sequence(value) is None:
        raise value_error(owner, name, f"Edges, names of {', '.join(EDGE_KINDS)}, or None", value)
    return Edges(value)


def _background(owner: str, name: str, value: Any) -> Any:
    if value is None or (isinstance(value, str) and value in BACKGROUNDS):
        return value
    return linear_rgb(owner, name, value)


@dataclass(frozen=True)
class Settings:
    """How a scene is rendered; the defaults are the preset `standard`.

    `Settings.from_preset("course")` and `Settings.from_preset("pbr")` give the other presets.
    """

    shader: Shader = declare.choice(
        "phong",
        Shader,
        "Phong's model at vertices or pixels, no light, or metallic-roughness",
        "`phong` lights every pixel with interpolated normals, `gouraud` the vertices, whose colors are interpolated, "
        "`nolight` shows the unlit color, and `pbr` lights every pixel by the metallic-roughness model of glTF 2.0 "
        "(`Material.pbr`).",
    )
    visibility: Visibility = declare.choice(
        "depth",
        Visibility,
        "what hides what: triangles by mean depth, or each pixel's depth",
        "`painter`: the triangle with the smallest mean vertex depth wins. Of equal depths, the later face wins in "
        "both.",
    )
    lighting_at: LightingAt = declare.choice(
        "position",
        LightingAt,
        "where lights and eye are seen from",
        "`position`: each pixel's, or vertex'. `centroid`: the triangle's.",
    )
    interpolation: Interpolation = declare.choice(
        "perspective",
        Interpolation,
        "of colors and normals over a triangle",
        "`perspective`: as in space. `affine`: as in the image; depth is as in space even so.",
    )
    texture_at: TextureAt = declare.choice("pixel", TextureAt, "where textures are looked up")
    texture_filter: TextureFilter = declare.choice(
        "bilinear",
        TextureFilter,
        "trilinear: mip-mapped",
        "`bilinear`: the four texels around the point, however many texels a pixel spans. `trilinear`: bilinear in two "
        "mip-map levels, with OpenGL's level of detail (kernels/texture.clh); where a pixel spans at most one texel, "
        'the same as bilinear, bit for bit. It needs texture_at="pixel", because a vertex spans no texels. Textures '
        'with lookup="course", and the alpha test, remain bilinear at full resolution.',
    )
    ambient: Ambient = declare.choice("tinted", Ambient, "ambient light: ka*Ia, or ka*Ia*color")
    layers: Converted[Asked, tuple[Layer, ...]] = declare.other(
        (),
        "str or iterable of str",
        _layers,
        "NAME,...",
        f"further layers: {','.join(LAYERS)}; or all",
        "`scalar` only with `scalars`, `AO` only with `ambient_occlusion`; see `Frame.__getitem__` for what each holds. "
        "Kept as a tuple.",
    )
    cull: bool = declare.flag(False, "leave out triangles seen from behind", "They run clockwise in the image.")
    near: float | None = declare.real(
        None, "Z", "distance of the near plane, scene units", usual="1e-4 of the scene's bounding radius", above=0.0
    )
    precision: Precision = declare.choice(
        "float32",
        Precision,
        "of the arithmetic",
        "`fast` is another name of `float32`. `float64`: the image is float64 as well; some devices lack it.",
        "float32, the same bits everywhere",
    )
    samples: int = declare.whole(
        1,
        1,
        MAX_SAMPLES,
        "samples per pixel",
        "They lie at `clshade.pipeline.camera_space.sample_positions`. A triangle is lit once per pixel, at the mean of the "
        "samples that it covers. Layers are those of the sample nearest the center.",
    )
    sample_shading: bool = declare.flag(False, "light every sample")
    resolve: Resolve = declare.choice(
        "mean",
        Resolve,
        "how samples become a pixel; weighted: bright ones count less",
        "`weighted` gives each the weight 1/(1 + its luminance), which keeps single bright samples from standing out, "
        "but makes edges of bright surfaces darker than they are. Without a background, the covered samples are "
        "weighted against each other, and their mean is premultiplied.",
    )
    scalars: Converted[Scalars | str | None, Scalars | None] = declare.other(
        None, "Scalars or str", as_scalars, "NAME", "data on the meshes to color them by, with a color map"
    )
    edges: Converted[Edges | AskedKinds | None, Edges | None] = declare.other(
        None,
        "Edges, str or iterable of str",
        _edges,
        "KIND,...",
        "edges of the meshes drawn as lines",
        '`Edges`, or their kinds alone, such as "feature". Layers stay those of the surfaces.',
    )
    background: Converted[ArrayLike | None, NamedBackground | Rgb | None] = declare.other(
        "scene",
        '"scene", "environment", color or None',
        _background,
        "none|environment|COLOR",
        "behind the surfaces: none, which makes the PNG transparent; environment, what lights the scene from all "
        "around; a name or #rrggbb, sRGB; or R,G,B, linear",
        "A color may be three linear numbers. Without one colors are premultiplied, and the PNG has straight alpha. "
        "Each sample sees the environment (`Scene.environment`, or what lights the scene instead) along its own ray.",
        "the scene's",
    )
    layer_alpha: float = declare.real(
        0.5, "0..1", "layers show the nearest surface whose alpha is at least this", least=0.0, most=1.0
    )
    light_samples: int = declare.whole(
        16,
        1,
        MAX_LIGHT_SAMPLES,
        "points of each light of finite size that its light is the mean of",
        "Finite are a PointLight with a radius and a RectangleLight. The points (`clshade.pipeline.light_points`) are "
        "shifted from pixel to pixel, so that few of them look like fine grain.",
    )
    shadows: bool = declare.flag(
        False,
        "lights reach only what no triangle hides",
        "Shader `gouraud` asks at the corners of faces. Ambient light, emission and the environment are not shadowed.",
        "yes with preset pbr, else no",
    )
    ambient_occlusion: int = declare.whole(
        0,
        0,
        MAX_AMBIENT_OCCLUSION,
        "rays from each point that look for triangles nearby, which keep ambient light away",
        "They fill the hemisphere over its face. The share of them that meet no triangle multiplies the ambient term, "
        "and with shader `pbr` what the environment sends. Shader `gouraud` asks at the corners of faces for tinted "
        "ambient light, and at the pixels for plain one.",
        "0, none",
    )
    ao_distance: float | None = declare.real(
        None, "D", "how far these rays reach, scene units", usual="0.2 of the scene's diagonal", above=0.0
    )

    def __post_init__(self) -> None:
        who = "Settings"
        declare.check_fields(self)
        if self.texture_filter == "trilinear" and self.texture_at == "vertex":
            expected = "bilinear with texture_at vertex, for a corner spans no texels (or texture_at pixel)"
            raise value_error(who, "texture_filter", expected, self.texture_filter)
        layers: tuple[str, ...] = self.layers
        missing = [name for name, row in LAYER_TABLE.items() if row.setting and not getattr(self, row.setting)]
        for name in missing:
            if name in layers:
                raise InputError(
                    f"{who}: layers: expected {LAYER_TABLE[name].setting} with the layer {name}, found none"
                )
        asked = tuple(name for name in LAYERS if name in layers or ("all" in layers and name not in missing))
        set_fields(self, layers=asked, precision="float32" if self.precision == "fast" else self.precision)

    @classmethod
    def from_preset(cls, preset: Preset, **fields: Unpack[SettingsFields]) -> Settings:
        """Return a preset with some fields changed.

        Parameters
        ----------
        preset : {"course", "standard", "pbr"}
            `course`: visibility painter, lighting_at centroid, interpolation affine, texture_at
            vertex, ambient plain. `standard`: the defaults. `pbr`: the defaults with shader pbr and
            shadows.
        **fields
            Fields of `Settings` to change.

        Examples
        --------
        >>> import clshade
        >>> clshade.Settings.from_preset("course", shader="gouraud").visibility
        'painter'
        """
        choice("Settings", "preset", preset, PRESETS)
        known("Settings", fields, cls.__dataclass_fields__)
        changed: dict[str, Any] = {**PRESET_FIELDS[preset], **fields}
        return cls(**changed)


Settings.__doc__ = declare.documented(Settings)
