"""Rendering settings: the settings, their allowed values, and the types of the corresponding keyword arguments."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict, get_args

from numpy.typing import ArrayLike

from ..base.arrays import Converted, kept
from ..base.validation import choice, flag, integer, known, number, sequence, set_fields, value_error
from ..images.colors import Rgb, linear_rgb
from ..images.layer_words import LAYER_WORDS
from .edges import EDGE_KINDS, AskedKinds, Edges
from .scalars import Scalars, as_scalars

if TYPE_CHECKING:
    from typing_extensions import Unpack

MAX_SAMPLES = 64  # per pixel
MAX_LIGHT_SAMPLES = 256
MAX_AMBIENT_OCCLUSION = 1024  # rays
PICTURE_SAMPLES = 4  # of pictures from the command line, see `picture_samples`

Shader: TypeAlias = Literal["gouraud", "phong", "nolight", "pbr"]
Visibility: TypeAlias = Literal["painter", "depth"]
LightingAt: TypeAlias = Literal["centroid", "position"]
Interpolation: TypeAlias = Literal["affine", "perspective"]
TextureAt: TypeAlias = Literal["vertex", "pixel"]
TextureFilter: TypeAlias = Literal["bilinear", "trilinear"]
Ambient: TypeAlias = Literal["plain", "tinted"]
Resolve: TypeAlias = Literal["mean", "weighted"]
Precision: TypeAlias = Literal["fast", "float32", "float64"]
Layer: TypeAlias = Literal[
    "Z", "id", "N", "P", "albedo", "uv", "object_id", "material_id", "barycentrics", "scalar", "AO", "instance_id"
]
Preset: TypeAlias = Literal["course", "standard", "pbr"]
NamedBackground: TypeAlias = Literal["scene", "environment"]

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
BACKGROUNDS: tuple[NamedBackground, ...] = get_args(NamedBackground)

# What other programs call the image and its coverage, in lower case.
LAYER_REMARKS = dict.fromkeys(
    ("r", "g", "b", "a", "rgb", "rgba", "color", "image", "beauty", "alpha", "mask", "coverage"),
    "the image and its coverage are always there (frame.rgba; R, G, B, A of the EXR)",
) | dict.fromkeys(
    ("flow", "optical_flow", "motion", "motion_vectors", "velocity", "vector"),
    "optical flow leads to another image: clshade.flow(frame, other), or --flow of turntable and animate",
)


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


@dataclass(frozen=True)
class Settings:
    """How a scene is rendered; the defaults are the preset `standard`.

    `Settings.from_preset("course")` and `Settings.from_preset("pbr")` give the other presets.

    Attributes
    ----------
    shader : {"phong", "gouraud", "nolight", "pbr"}
        Light every pixel with interpolated normals, light the vertices and interpolate the result,
        or show the unlit color. `pbr` lights every pixel by the metallic-roughness model of glTF 2.0
        (`Material.pbr`), the others by Phong's.
    visibility : {"depth", "painter"}
        `depth`: a depth test per pixel. `painter`: the triangle with the smallest mean vertex depth
        wins. Of equal depths, the later face wins in both.
    lighting_at : {"position", "centroid"}
        Where the directions to the eye and the lights are taken: at each pixel (or vertex), or once
        per triangle.
    interpolation : {"perspective", "affine"}
        Interpolation of vertex attributes: perspective-correct, or affine in the image. Depth is
        always perspective-correct.
    texture_at : {"pixel", "vertex"}
        Look the texture up at every pixel, or at the vertices.
    texture_filter : {"bilinear", "trilinear"}
        `bilinear`: the four texels around the point, however many texels a pixel spans.
        `trilinear`: bilinear in two mip-map levels, with OpenGL's level of detail
        (kernels/texture.clh); where a pixel spans at most one texel, the same as bilinear, bit for
        bit. It needs texture_at="pixel", because a vertex spans no texels. Textures with
        lookup="course", and the alpha test, remain bilinear at full resolution.
    ambient : {"tinted", "plain"}
        Ambient term: ka*Ia*color, or ka*Ia.
    layers : str or iterable of str, default ()
        Layers (AOVs) besides the image: any of Z, id, N, P, albedo, uv, object_id, material_id,
        barycentrics, instance_id, with `scalars` scalar and with `ambient_occlusion` AO, or all; see
        `Frame.__getitem__` for what each holds. Kept as a tuple.
    cull : bool, default False
        Cull back faces, the triangles whose winding is clockwise in the image.
    near : float or None, default None
        Distance of the near plane from the eye, scene units, above 0; None: 1e-4 of the scene's
        bounding radius.
    precision : {"float32", "fast", "float64"}
        Arithmetic of the kernels. `float32`: the same bits on every device. `fast`: float32 with
        shorter polynomials and plain texture coordinates, accurate to about 3e-5, and also the same
        bits on every device. `float64`: the image is float64 as well; some devices lack it.
    samples : int, default 1
        Samples per pixel, 1 to 64 (`clshade.pipeline.sample_pattern.positions`). A triangle is
        shaded once per pixel: at the center if it covers all samples, else at the covered sample
        nearest the center. Layers are those of the sample nearest the center.
    sample_shading : bool, default False
        Shade every sample.
    resolve : {"mean", "weighted"}
        How samples become a pixel. `weighted` gives each the weight 1/(1 + its luminance), which
        keeps single bright samples from standing out, but makes edges of bright surfaces darker
        than they are. Without a background, the covered samples are weighted against each other,
        and their mean is premultiplied.
    scalars : Scalars, str or None, default None
        Scalars of the meshes that a color map shows, or their name; see `Scalars`.
    edges : Edges, str, iterable of str, or None, default None
        Edges of the meshes drawn as lines: `Edges`, or their kinds alone, such as "feature". Layers
        stay those of the surfaces.
    background : "scene", "environment", color or None, default "scene"
        What is behind the surfaces: what the scene says, its environment (`Scene.environment`, or
        what lights it instead), a color, or nothing (None): then colors are premultiplied, and the
        PNG has straight alpha. A color is three linear numbers, or a text: "#rrggbb" or a name,
        whose sRGB codes are decoded, or "R,G,B", linear. Each sample sees the environment along its
        own ray.
    layer_alpha : float, default 0.5
        Layers show the nearest surface whose alpha is at least this, 0 to 1.
    light_samples : int, default 16
        Points of each light of finite size (a PointLight with a radius, a RectangleLight) that its
        light is the mean of, 1 to 256 (`clshade.pipeline.light_points`). They are shifted from pixel
        to pixel, so that few of them look like fine grain.
    shadows : bool, default False, with preset `pbr` True
        A light reaches a point only if no triangle lies between them. Shader `gouraud` asks at the
        corners of faces. Ambient light, emission and the environment are not shadowed.
    ambient_occlusion : int, default 0
        Rays from each shaded point into the hemisphere over its face, 0 to 1024. The share of them
        that meet no triangle multiplies the ambient term, and with shader `pbr` what the environment
        sends. 0: that light arrives everywhere. Shader `gouraud` asks at the corners of faces for
        tinted ambient light, and at the pixels for plain one.
    ao_distance : float or None, default None
        Length of these rays, scene units, above 0: triangles farther away do not count. None: 0.2 of
        the diagonal of the scene's bounding box.

    Raises
    ------
    InputError
        A value is not allowed; the message names the field.
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
    scalars: Converted[Scalars | str | None, Scalars | None] = field(default=kept(None))
    edges: Converted[Edges | AskedKinds | None, Edges | None] = field(default=kept(None))
    background: Converted[ArrayLike | None, NamedBackground | Rgb | None] = field(default=kept("scene"))
    layer_alpha: float = 0.5
    light_samples: int = 16
    shadows: bool = False
    ambient_occlusion: int = 0
    ao_distance: float | None = None

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
        set_fields(self, scalars=as_scalars(who, self.scalars))
        layers = (self.layers,) if isinstance(self.layers, str) else sequence(self.layers)
        if layers is None:
            raise value_error(who, "layers", f"names of {', '.join(LAYERS)}, or all", self.layers)
        for layer in layers:
            choice(who, "layers", layer, (*LAYERS, "all"), words=LAYER_WORDS, remarks=LAYER_REMARKS)
        if "scalar" in layers and self.scalars is None:
            raise value_error(who, "layers", "scalar only with scalars, which name what it shows", "scalar without")
        set_fields(
            self, ambient_occlusion=integer(who, "ambient_occlusion", self.ambient_occlusion, 0, MAX_AMBIENT_OCCLUSION)
        )
        if "AO" in layers and not self.ambient_occlusion:
            raise value_error(who, "layers", "AO only with ambient_occlusion, the number of its rays", "AO without")
        missing = {"scalar": self.scalars is None, "AO": not self.ambient_occlusion}
        every = [name for name in LAYERS if not missing.get(name, False)]
        asked = tuple(name for name in LAYERS if name in layers or ("all" in layers and name in every))
        set_fields(self, layers=asked, cull=flag(who, "cull", self.cull))
        if self.near is not None:
            set_fields(self, near=number(who, "near", self.near, above=0.0))
        if self.ao_distance is not None:
            set_fields(self, ao_distance=number(who, "ao_distance", self.ao_distance, above=0.0))
        layer_alpha = number(who, "layer_alpha", self.layer_alpha, least=0.0, expected="a number from 0 to 1")
        if layer_alpha > 1.0:
            raise value_error(who, "layer_alpha", "a number from 0 to 1", self.layer_alpha)
        set_fields(self, layer_alpha=layer_alpha, shadows=flag(who, "shadows", self.shadows))
        set_fields(self, light_samples=integer(who, "light_samples", self.light_samples, 1, MAX_LIGHT_SAMPLES))
        if self.edges is not None and not isinstance(self.edges, Edges):
            if not isinstance(self.edges, str) and sequence(self.edges) is None:
                raise value_error(who, "edges", f"Edges, names of {', '.join(EDGE_KINDS)}, or None", self.edges)
            set_fields(self, edges=Edges(self.edges))
        if self.background is not None and not (isinstance(self.background, str) and self.background in BACKGROUNDS):
            set_fields(self, background=linear_rgb(who, "background", self.background))

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

        Returns
        -------
        Settings

        Raises
        ------
        InputError
            The preset, a field or a value is unknown.

        Examples
        --------
        >>> import clshade
        >>> clshade.Settings.from_preset("course", shader="gouraud").visibility
        'painter'
        """
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
        elif preset == "pbr":
            values = {"shader": "pbr", "shadows": True}
        known("Settings", fields, cls.__dataclass_fields__)
        return cls(**{**values, **fields})


def picture_samples(scene_preset: Preset, preset: Preset | None = None) -> int:
    """Return the samples of a picture from the command line that says nothing of them: 1 if the scene's preset or the one
    that was asked for is `course`, whose pictures are those of the course, else PICTURE_SAMPLES."""
    return 1 if "course" in (scene_preset, preset) else PICTURE_SAMPLES
