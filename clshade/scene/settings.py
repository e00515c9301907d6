"""Rendering settings, their values and the types of keyword arguments; edges drawn as lines, and scalars shown as colors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict, get_args

from numpy.typing import ArrayLike

from ..base import declare
from ..base.arrays import Converted
from ..base.validation import choice, items, known, number, sequence, value_error
from ..errors import InputError
from ..images.colors import Rgb, checked_colormap, encoded_rgb, linear_rgb
from ..images.layers import LAYER_REMARKS, LAYER_TABLE, LAYER_WORDS
from ..images.layers import LAYERS as LAYERS
from ..images.layers import Layer as Layer

if TYPE_CHECKING:
    from typing_extensions import Unpack

MAX_SAMPLES = 64  # per pixel
MAX_LIGHT_SAMPLES = 256
MAX_AMBIENT_OCCLUSION = 1024  # rays
MAX_WIDTH = 64.0  # of lines, pixels
WIDTH_STEPS = 256  # a pixel: widths are rounded to this grid, on which coverage is exact
PAPER = (1.0, 1.0, 1.0)  # background of drawings of lines alone

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
EdgeKind: TypeAlias = Literal["all", "feature", "silhouette", "boundary", "nonmanifold"]

SHADERS: tuple[Shader, ...] = get_args(Shader)
PRECISIONS: tuple[Precision, ...] = get_args(Precision)
PRESETS: tuple[Preset, ...] = get_args(Preset)
LOOKS: tuple[Look, ...] = get_args(Look)
EDGE_KINDS: tuple[EdgeKind, ...] = get_args(EdgeKind)

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

LayerNames: TypeAlias = Layer | Literal["all"] | Iterable[Layer | Literal["all"]]
EdgeKinds: TypeAlias = EdgeKind | Iterable[EdgeKind]


def _name(owner: str, name: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise value_error(owner, name, "the name of the scalars", value)
    return value


def _clim(owner: str, name: str, value: Any) -> tuple[float, float] | None:
    if value is None:
        return None
    expected = "two finite numbers, low and high"
    low, high = (number(owner, name, end, expected=expected) for end in items(owner, name, value, expected, 2))
    if low > high:
        raise value_error(owner, name, f"{expected}, low not above high", (low, high))
    return low, high


@dataclass(frozen=True)
class Scalars:
    """Which scalars of the meshes give the surface its color, and how.

    The scalar is interpolated over each triangle as the image's other attributes are, and its value
    at the point is looked up in the map; colors are never interpolated. The color takes the place
    of vertex color, material color and texel, and is lit as they are; with shader="nolight" the
    image shows the map's colors as they are. Meshes without these scalars keep their own colors.

    Attributes
    ----------
    name : str
        Name of the scalars, see `Mesh.scalars`.
    colormap : str or iterable of colors, default "viridis"
        Name of a color map of Matplotlib ("viridis", "viridis_r", "coolwarm", "tab10", ...), or
        colors from low to high, each as wide as the others.
    clim : (float, float) or None, default None
        Values of the map's ends, low first; values beyond get the color of the nearer end. None:
        the least and the largest finite value in the scene. If both are equal, that value has the
        map's first color, and values above it the last.
    nan_color : color, default "darkgray"
        Color of faces one of whose corners is NaN. Colors are whatever Matplotlib understands.

    Examples
    --------
    >>> from clshade import Scalars
    >>> Scalars("height", "coolwarm", clim=(-1, 1)).clim
    (-1.0, 1.0)
    """

    name: str = field(metadata={"check": _name})
    colormap: Converted[str | Iterable[Any], str | tuple[Rgb, ...]] = declare.checked("viridis", checked_colormap)
    clim: Converted[ArrayLike | None, tuple[float, float] | None] = declare.checked(None, _clim)
    nan_color: Converted[Any, Rgb] = declare.checked("darkgray", encoded_rgb)

    def __post_init__(self) -> None:
        declare.check_fields(self)


def _kinds(owner: str, name: str, value: Any) -> tuple[str, ...]:
    kinds = (value,) if isinstance(value, str) else sequence(value)
    if not kinds:
        raise value_error(owner, name, f"names of {', '.join(EDGE_KINDS)}", value)
    for kind in kinds:
        choice(owner, name, kind, EDGE_KINDS)
    return ("all",) if "all" in kinds else tuple(kind for kind in EDGE_KINDS if kind in kinds)


@dataclass(frozen=True)
class Edges:
    """Edges drawn as lines over the surfaces, hidden where a surface lies before them."""

    kinds: Converted[EdgeKinds, tuple[EdgeKind, ...]] = declare.value(
        ("all",), "str or iterable of str", _kinds, "KIND,..."
    ).about(
        "which: all; feature, between faces at an angle; silhouette; boundary, of one face; nonmanifold, of more than "
        "two, in red. Normals of faces at `feature` edges differ by more than `angle`. All faces of a `silhouette` "
        "lie on the same side of it, as seen from the eye; that includes boundaries. Vertices at the same place are "
        "one. Kept as a tuple."
    )
    angle: float = declare.number(30.0, "DEG", unit="degrees", least=0.0, most=180.0).about(
        "least angle of feature edges"
    )
    width: float = declare.number(1.5, "PIXELS", unit="pixels", above=0.0, most=MAX_WIDTH).about(
        f"of the lines, at most {MAX_WIDTH:g}. Rounded to 1/256."
    )
    color: Converted[ArrayLike, Rgb] = declare.value((0.0, 0.0, 0.0), "color", linear_rgb, "COLOR").about(
        "of the lines: a name, #rrggbb, or R,G,B, linear. As for `Settings.background`; it is not lit.", "black"
    )
    nonmanifold_color: Converted[ArrayLike, Rgb] = declare.value((1.0, 0.0, 0.0), "color", linear_rgb, "COLOR").about(
        "of edges of more than two faces", usual="red"
    )
    only: bool = declare.flag(False).about("the lines alone, on white, hidden by the surfaces")

    def __post_init__(self) -> None:
        declare.check_fields(self)

    @property
    def steps(self) -> int:
        """The width in 1/256 px, at least 1."""
        return max(1, round(self.width * WIDTH_STEPS))


Edges.__doc__ = declare.Docstring(Edges.__doc__)  # type: ignore[assignment]


class SettingsFields(TypedDict, total=False):
    """Fields of `Settings`, as keyword arguments of `Settings` and of every call that takes them."""

    shader: Shader
    visibility: Visibility
    lighting_at: LightingAt
    interpolation: Interpolation
    texture_at: TextureAt
    texture_filter: TextureFilter
    ambient: Ambient
    layers: LayerNames
    cull: bool
    near: float | None
    precision: Precision
    samples: int
    sample_shading: bool
    resolve: Resolve
    scalars: Scalars | str | None
    edges: Edges | EdgeKinds | None
    background: ArrayLike | None
    layer_alpha: float
    light_samples: int
    shadows: bool
    ambient_occlusion: int
    ao_distance: float | None


class RenderOptions(SettingsFields, total=False):
    """Fields of `Settings`, and a resolution for the scene's camera."""

    resolution: tuple[int, int] | None


class FrameOptions(RenderOptions, total=False):
    """Fields of `Settings`, a resolution, and the preset or settings that the fields change."""

    preset: Preset | None
    settings: Settings | None


def _as_scalars(owner: str, name: str, value: Any) -> Scalars | None:
    if value is None or isinstance(value, Scalars):
        return value
    if isinstance(value, str):
        return Scalars(value)
    raise value_error(owner, name, "a name, a Scalars or None", value)


def _layers(owner: str, name: str, value: Any) -> tuple[str, ...]:
    """Return names of layers, `all` among them, in any order."""
    value = (value,) if isinstance(value, str) else value
    layers = items(owner, name, value, f"names of {', '.join(LAYERS)}, or all")
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
    if value is None or (isinstance(value, str) and value in get_args(NamedBackground)):
        return value
    return linear_rgb(owner, name, value)


@dataclass(frozen=True)
class Settings:
    """How a scene is rendered; the defaults are the preset `standard`.

    `Settings.from_preset("course")` and `Settings.from_preset("pbr")` give the other presets.
    """

    shader: Shader = declare.choice("phong", Shader).about(
        "Phong's model at vertices or pixels, no light, or metallic-roughness. `phong` lights every pixel with "
        "interpolated normals, `gouraud` the vertices, whose colors are interpolated, `nolight` shows the unlit "
        "color, and `pbr` lights every pixel by the metallic-roughness model of glTF 2.0 (`Material.pbr`)."
    )
    visibility: Visibility = declare.choice("depth", Visibility).about(
        "what hides what: triangles by mean depth, or each pixel's depth. `painter`: the triangle with the smallest "
        "mean vertex depth wins. Of equal depths, the later face wins in both."
    )
    lighting_at: LightingAt = declare.choice("position", LightingAt).about(
        "where lights and eye are seen from. `position`: each pixel's, or vertex'. `centroid`: the triangle's."
    )
    interpolation: Interpolation = declare.choice("perspective", Interpolation).about(
        "of colors and normals over a triangle. `perspective`: as in space. `affine`: as in the image; depth is as in "
        "space even so."
    )
    texture_at: TextureAt = declare.choice("pixel", TextureAt).about("where textures are looked up")
    texture_filter: TextureFilter = declare.choice("bilinear", TextureFilter).about(
        "trilinear: mip-mapped. `bilinear`: the four texels around the point, however many texels a pixel spans. "
        "`trilinear`: bilinear in two mip-map levels, with OpenGL's level of detail (kernels/texture.clh); where a "
        'pixel spans at most one texel, the same as bilinear, bit for bit. It needs texture_at="pixel", because a '
        'vertex spans no texels. Textures with lookup="course", and the alpha test, remain bilinear at full '
        "resolution."
    )
    ambient: Ambient = declare.choice("tinted", Ambient).about("ambient light: ka*Ia, or ka*Ia*color")
    layers: Converted[LayerNames, tuple[Layer, ...]] = declare.value(
        (), "str or iterable of str", _layers, "NAME,..."
    ).about(
        f"further layers: {','.join(LAYERS)}; or all. "
        "`scalar` only with `scalars`, `AO` only with `ambient_occlusion`; see `Frame.__getitem__` for what each holds. "
        "Kept as a tuple."
    )
    cull: bool = declare.flag(False).about("leave out triangles seen from behind. They run clockwise in the image.")
    near: float | None = declare.number(None, "Z", above=0.0).about(
        "distance of the near plane, scene units", usual="1e-4 of the scene's bounding radius"
    )
    precision: Precision = declare.choice("float32", Precision).about(
        "of the arithmetic. `fast` is another name of `float32`. `float64`: the image is float64 as well; some "
        "devices lack it.",
        "float32, the same bits everywhere",
    )
    samples: int = declare.integer(1, 1, MAX_SAMPLES).about(
        "samples per pixel. They lie at `clshade.pipeline.camera_space.sample_positions`. A triangle is lit once per "
        "pixel, at the mean of the samples that it covers. Layers are those of the sample nearest the center."
    )
    sample_shading: bool = declare.flag(False).about("light every sample")
    resolve: Resolve = declare.choice("mean", Resolve).about(
        "how samples become a pixel; weighted: bright ones count less. `weighted` gives each the weight 1/(1 + its "
        "luminance), which keeps single bright samples from standing out, but makes edges of bright surfaces darker "
        "than they are. Without a background, the covered samples are weighted against each other, and their mean is "
        "premultiplied."
    )
    scalars: Converted[Scalars | str | None, Scalars | None] = declare.value(
        None, "Scalars or str", _as_scalars, "NAME"
    ).about("data on the meshes to color them by, with a color map")
    edges: Converted[Edges | EdgeKinds | None, Edges | None] = declare.value(
        None, "Edges, str or iterable of str", _edges, "KIND,..."
    ).about(
        'edges of the meshes drawn as lines. `Edges`, or their kinds alone, such as "feature". Layers stay those of '
        "the surfaces."
    )
    background: Converted[ArrayLike | None, NamedBackground | Rgb | None] = declare.value(
        "scene", '"scene", "environment", color or None', _background, "none|environment|COLOR"
    ).about(
        "behind the surfaces: none, which makes the PNG transparent; environment, what lights the scene from all "
        "around; a name or #rrggbb, sRGB; or R,G,B, linear. A color may be three linear numbers. Without one colors "
        "are premultiplied, and the PNG has straight alpha. Each sample sees the environment (`Scene.environment`, or "
        "what lights the scene instead) along its own ray.",
        "the scene's",
    )
    layer_alpha: float = declare.number(0.5, "0..1", least=0.0, most=1.0).about(
        "layers show the nearest surface whose alpha is at least this"
    )
    light_samples: int = declare.integer(16, 1, MAX_LIGHT_SAMPLES).about(
        "points of each light of finite size that its light is the mean of. Finite are a PointLight with a radius and "
        "a RectangleLight. The points (`clshade.pipeline.light_points`) are shifted from pixel to pixel, so that few "
        "of them look like fine grain."
    )
    shadows: bool = declare.flag(False).about(
        "lights reach only what no triangle hides. Shader `gouraud` asks at the corners of faces. Ambient light, "
        "emission and the environment are not shadowed.",
        "yes with preset pbr, else no",
    )
    ambient_occlusion: int = declare.integer(0, 0, MAX_AMBIENT_OCCLUSION).about(
        "rays from each point that look for triangles nearby, which keep ambient light away. They fill the hemisphere "
        "over its face. The share of them that meet no triangle multiplies the ambient term, and with shader `pbr` "
        "what the environment sends. Shader `gouraud` asks at the corners of faces for tinted ambient light, and at "
        "the pixels for plain one.",
        "0, none",
    )
    ao_distance: float | None = declare.number(None, "D", above=0.0).about(
        "how far these rays reach, scene units", usual="0.2 of the scene's diagonal"
    )

    def __post_init__(self) -> None:
        declare.check_fields(self)
        if self.texture_filter == "trilinear" and self.texture_at == "vertex":
            expected = "bilinear with texture_at vertex, for a corner spans no texels (or texture_at pixel)"
            raise value_error("Settings", "texture_filter", expected, self.texture_filter)
        layers: tuple[str, ...] = self.layers
        missing = {
            name: row.setting for name, row in LAYER_TABLE.items() if row.setting and not getattr(self, row.setting)
        }
        for name, setting in missing.items():
            if name in layers:
                raise InputError(f"Settings: layers: expected {setting} with the layer {name}, found none")
        chosen = tuple(name for name in LAYERS if name in layers or ("all" in layers and name not in missing))
        vars(self).update(layers=chosen, precision="float32" if self.precision == "fast" else self.precision)

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
        return cls(**{**PRESET_FIELDS[preset], **fields})


Settings.__doc__ = declare.Docstring(Settings.__doc__)  # type: ignore[assignment]
