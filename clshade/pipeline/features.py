"""Features: derive from scene and settings what kernels leave out, at compile time or at run time."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import TypeAlias

import numpy as np

from ..scene.camera import Camera
from ..scene.lights import Light
from ..scene.material import POWERED, TERMS
from ..scene.metallic_roughness import MAPS
from ..scene.model import Material, Mesh, Scene, Settings, Texture
from ..scene.settings import Shader
from .shading_tables import map_of, maps_of, textures_of, usable


def texture_applies(mesh: Mesh) -> bool:
    """Return whether the mesh has both a texture and texture coordinates."""
    return mesh.material.texture is not None and mesh.uvs is not None


MaterialKey: TypeAlias = tuple[int, bool, bool, bool, frozenset[str]]


def material_key(mesh: Mesh) -> MaterialKey:
    """Return a key; meshes with the same key share a row of the material table."""
    return id(mesh.material), texture_applies(mesh), mesh.blends, mesh.tests_alpha, frozenset(maps_of(mesh))


def materials_of(scene: Scene) -> dict[MaterialKey, Material]:
    """Return the rows of the material table by key, in the order of the meshes with faces; at least one. Each has only
    what applies to its meshes: textures, transparency, alpha test."""
    table: dict[MaterialKey, Material] = {}
    for mesh in scene.meshes:
        key = material_key(mesh)
        if len(mesh.faces) and key not in table:
            own = usable(mesh)
            cutoff = own.alpha_cutoff if mesh.tests_alpha else None
            is_plain = (own.blend, own.alpha_cutoff) == (mesh.blends, cutoff)
            table[key] = own if is_plain else replace(own, blend=mesh.blends, alpha_cutoff=cutoff)
    return table or {(0, False, False, False, frozenset()): Material()}


def replaces_colors(mesh: Mesh) -> bool:
    """Return whether texels replace the mesh's vertex colors."""
    return texture_applies(mesh) and mesh.material.texture.lookup == "course"  # type: ignore[union-attr]


def ignored(scene: Scene, settings: Settings) -> tuple[str, ...]:
    """Return what the scene's file or the settings ask for but no render shows, a few words each."""
    plain = settings.texture_filter == "trilinear" and any(replaces_colors(mesh) for mesh in scene.meshes)
    looked_up = [texture for mesh in scene.meshes for texture in textures_of(mesh, maps=False)]
    smooth = settings.texture_at == "vertex" and any(texture.filter == "nearest" for texture in looked_up)
    unlit = scene.environment is not None and settings.shader != "pbr" and settings.background != "environment"
    words = (
        (plain, "the trilinear filter of textures with the course's lookup"),
        (smooth, "the filter nearest of textures that are looked up at vertices"),
        (unlit, "the environment, which only shader pbr shows"),
    )
    return (*scene.ignored, *(text for holds, text in words if holds))


def shows_environment(scene: Scene, settings: Settings) -> bool:
    """Return whether an environment lights the scene."""
    return settings.shader == "pbr" and not no_environment(scene)


def no_environment(scene: Scene) -> str:
    """Return why no environment lights the scene, "" if one does."""
    environment = scene.environment
    if environment is None:
        return "no environment"
    return "" if environment.intensity and environment.image.any() else "it is black"


def shows_scalars(mesh: Mesh, settings: Settings) -> bool:
    """Return whether scalars color the mesh."""
    return settings.scalars is not None and settings.scalars.name in mesh.scalars


def casts_alpha(scene: Scene) -> bool:
    """Return whether some of what casts shadows may let light pass."""
    return any(mesh.blends or mesh.tests_alpha for mesh in scene.meshes if len(mesh.faces))


def looked_up_at_corners(scene: Scene, settings: Settings) -> bool:
    """Return whether textures are looked up at the corners of faces."""
    return settings.texture_at == "vertex" and any(texture_applies(mesh) for mesh in scene.meshes if len(mesh.faces))


def uses_normal_indices(scene: Scene, mesh: Mesh) -> bool:
    """Return whether the mesh's own normals, indexed separately from its vertices, are used; course scenes always
    compute theirs."""
    return mesh.normals is not None and mesh.normal_faces is not None and scene.preset != "course"


def _is_white(mesh: Mesh) -> bool:
    return mesh.colors is None or not (mesh.colors != 1.0).any()


def _any_beyond_one(mesh: Mesh, at_corners: bool) -> bool:
    """Return whether colors beyond 1 may be interpolated. at_corners: texture_at vertex, where texels are interpolated
    too."""
    looked_up = at_corners and texture_applies(mesh)
    if mesh.colors is None and not looked_up:
        return False
    most = np.abs(mesh.material.color)
    with np.errstate(over="ignore"):
        if mesh.colors is not None and not replaces_colors(mesh):
            most = most * np.maximum(mesh.colors.max(axis=0, initial=0.0), -mesh.colors.min(axis=0, initial=0.0))
        if looked_up:
            most = most * np.abs(mesh.material.texture.image[..., :3]).max(axis=(0, 1))  # type: ignore[union-attr]
    return bool((most > 1.0).any())


def _has_levels(texture: Texture) -> bool:
    return texture.lookup == "standard" and max(texture.texels.shape[:2]) > 1


def _any_nonzero(values: Iterable[np.ndarray]) -> bool:
    return any(value.any() for value in values)


def _first(*reasons: tuple[object, str]) -> str:
    """Return the text of the first condition that holds; "" if none does."""
    return next((text for holds, text in reasons if holds), "")


def are_zero(names: Sequence[str]) -> str:
    """Return "a, b and c are 0"."""
    return f"{', '.join(names[:-1])} and {names[-1]} are 0" if names[1:] else f"{names[0]} is 0"


@dataclass(frozen=True, eq=False)
class Drawn:
    """What is drawn, as the rows of FEATURES ask about it. Texts say why something is not needed, "" if it is.

    shining: whether any light has an intensity other than 0. Other fields: see `derive`.
    """

    scene: Scene
    settings: Settings
    materials: Sequence[Material]
    ambient: np.ndarray
    shining: bool
    double_positions: bool = False
    scalars_at_corners: bool = False
    instanced: bool = False
    forced: Collection[str] = ()
    reasons: dict[str, str] = field(default_factory=dict)

    def why(self, name: str) -> str:
        """Return why a feature is not needed."""
        if name not in self.reasons:
            self.reasons[name] = _BY_NAME[name].why(self)
        return self.reasons[name]

    def needs(self, name: str) -> bool:
        return name in self.forced or not self.why(name)

    @property
    def shader(self) -> str:
        return self.settings.shader

    @cached_property
    def meshes(self) -> list[Mesh]:
        return [mesh for mesh in self.scene.meshes if len(mesh.faces)]

    @cached_property
    def looked_up(self) -> list[Texture]:
        return [texture for mesh in self.meshes for texture in textures_of(mesh, maps=self.shader == "pbr")]

    @cached_property
    def at_corners(self) -> bool:
        """Whether textures are looked up at corners."""
        return looked_up_at_corners(self.scene, self.settings)

    @cached_property
    def own_corners(self) -> bool:
        """Whether corners have colors of their own for another reason."""
        return self.scalars_at_corners and any(shows_scalars(mesh, self.settings) for mesh in self.meshes)

    @property
    def bright(self) -> bool:
        return any(_any_beyond_one(mesh, self.at_corners) for mesh in self.meshes)

    @property
    def culls(self) -> bool:
        """Whether all back faces are culled."""
        return self.settings.cull or all(material.sides == "front" for material in self.materials)

    @property
    def unlit(self) -> str:
        return _first((self.shader == "nolight", "shader nolight"))

    @property
    def not_pbr(self) -> str:
        return _first((self.shader != "pbr", f"shader {self.shader}"))

    @property
    def no_texture(self) -> str:
        textured = any(mesh.material.texture is not None for mesh in self.meshes)
        applies = any(map(texture_applies, self.meshes))
        return _first((not textured, "no texture"), (not applies, "no texture coordinates"))

    @property
    def no_lookup(self) -> str:
        return "" if self.looked_up else self.no_texture

    def no_term(self, name: str) -> str:
        """Return why one of TERMS is not needed."""
        if self.shader == "pbr" and name not in _TERMS_OF_PBR:
            return "shader pbr"
        facets = [m.microfacets for m in self.materials if self.shader == "pbr"]
        if not facets:
            needed, why = _any_nonzero(getattr(m, name) for m in self.materials), are_zero([name])
        elif name == "ks":
            needed, why = any(f.metallic > 0.0 or f.specular > 0.0 for f in facets), "specular is 0"
        else:
            based = [f.metallic < 1.0 or f.metallic_roughness_texture is not None for f in facets]
            needed = any(b and m.diffuse.any() for b, m in zip(based, self.materials, strict=True))
            why = are_zero([name]) if any(based) else "metals alone"
        return self.unlit or _first((not self.shining, "no light shines"), (not needed, why))

    def no_terms(self, names: Sequence[str]) -> str:
        """Return why none of several terms is needed."""
        reasons = {self.why(TERMS[name].feature) for name in names}
        return _first(("" in reasons, ""), (len(reasons) == 1, min(reasons)), (True, are_zero(names)))

    def no_power(self) -> str:
        absent = self.no_terms(POWERED)
        used = any(m.n != 1.0 and _any_nonzero(getattr(m, name) for name in POWERED) for m in self.materials)
        of_pbr = self.shader == "pbr"
        return _first((of_pbr, "shader pbr"), (absent, f"no specular term: {absent}"), (not used, "no exponent but 1"))

    @cached_property
    def no_normals(self) -> str:
        """Why no normal is read."""
        names = _TERMS_OF_PBR if self.shader == "pbr" else list(TERMS)
        return "" if any(self.needs(TERMS[name].feature) for name in names) else self.no_terms(names)

    def no_light(self, has: Callable[[Light], bool], why: str) -> str:
        """Return why nothing is needed that only some lights have."""
        needed = any(has(each) for each in self.scene.lights if each.intensity.any())
        return self.no_normals or ("" if needed else why)

    def no_colors(self) -> str:
        plain = all(map(_is_white, self.meshes))
        white = all(_is_white(mesh) for mesh in self.meshes if not replaces_colors(mesh))
        white = white and not _any_nonzero(mesh.material.color != 1.0 for mesh in self.meshes)
        return _first(
            (self.at_corners, "texture_at vertex: they are in the corners' colors"),
            (self.own_corners, "they are in the corners' colors"),
            (not self.why("SCALARS"), ""),
            (white and not plain, "texels take the place of vertex colors"),
            (white, "no vertex or material colors other than white"),
        )

    def no_map(self, name: str) -> str:
        """Return why one of MAPS is not needed."""
        reasons = [self.why(feature) for feature in MAPS[name].changes]
        absent = all(map_of(mesh, name) is None for mesh in self.meshes)
        return self.not_pbr or _first((all(reasons), reasons[-1]), (absent, f"no {MAPS[name].words}"))


@dataclass(frozen=True)
class Feature:
    """Something that a frame may do without.

    name: as kernels know it. work: what is left out with it, in a few words, where 1 is always correct and gives the same
    bits; "" for a choice of the settings or the camera, where 0 and 1 mean different images. why: why what is drawn does
    without that work, "" if it needs it. chosen: whether the choice holds. compiled: whether there are programs with and
    without it. All others are conditions at run time (`NEEDS` in kernels/features.clh), or follow from the tables that
    kernels read.
    """

    name: str
    work: str = ""
    why: Callable[[Drawn], str] = lambda d: ""
    chosen: Callable[[Drawn], bool] = lambda d: False
    compiled: bool = False


_TERMS_OF_PBR = ["kd", "ks"]  # that shader pbr has, too

# A feature is compiled if leaving it out saves 5 % of some scene's frame: `bench --features` of commit 1e1eb0f measured it.
FEATURES = (
    Feature("FAST", chosen=lambda d: d.settings.precision == "fast", compiled=True),
    Feature("DOUBLE", chosen=lambda d: d.settings.precision == "float64", compiled=True),
    Feature("SAMPLES", chosen=lambda d: d.settings.samples > 1, compiled=True),
    # Lighting that is forced on for nolight is done pixel by pixel.
    Feature("PHONG", chosen=lambda d: d.shader == "phong" or ("LIT" in d.forced and bool(d.unlit)), compiled=True),
    Feature("PBR", chosen=lambda d: d.shader == "pbr", compiled=True),
    Feature("DEPTH_TEST", chosen=lambda d: d.settings.visibility == "depth", compiled=True),
    # The same image, from one copy of each mesh: see instances.py.
    Feature("INSTANCES", chosen=lambda d: d.instanced, compiled=True),
    # Whether rays are followed to what casts shadows.
    Feature("CASTERS", chosen=lambda d: d.needs("SHADOWS") or d.needs("AMBIENT_OCCLUSION"), compiled=True),
    Feature("SAMPLE_SHADING", chosen=lambda d: d.settings.samples > 1 and d.settings.sample_shading),
    Feature("WEIGHTED", chosen=lambda d: d.settings.samples > 1 and d.settings.resolve == "weighted"),
    Feature(
        "PERSPECTIVE", chosen=lambda d: d.settings.interpolation == "perspective" and not d.scene.camera.orthographic
    ),
    Feature("CENTROID", chosen=lambda d: d.settings.lighting_at == "centroid"),
    Feature("TINTED", chosen=lambda d: d.settings.ambient == "tinted"),
    Feature("CULL", chosen=lambda d: d.culls),
    Feature("ORTHOGRAPHIC", chosen=lambda d: d.scene.camera.orthographic),
    Feature("CORNER_COLORS", chosen=lambda d: d.at_corners or d.own_corners),
    # The error bound of phong and pbr is relative to the color at the pixel, that of the others to the brightest corner.
    Feature("BRIGHT", chosen=lambda d: d.shader in ("phong", "pbr") and d.bright),
    Feature("LINES", chosen=lambda d: d.settings.edges is not None),
    Feature("LINES_ONLY", chosen=lambda d: d.settings.edges is not None and d.settings.edges.only),
    Feature("BACKDROP", chosen=lambda d: d.settings.background == "environment" and not no_environment(d.scene)),
    Feature("LIT", "lighting", lambda d: d.unlit),
    Feature(
        "AMBIENT",
        "ambient light",
        lambda d: _first(
            (d.unlit, d.unlit),
            (not d.ambient.any(), "no ambient light"),
            (not _any_nonzero(m.ka for m in d.materials), "ka is 0"),
            (not _any_nonzero(m.ka * d.ambient for m in d.materials), "ka*Ia is 0"),
        ),
    ),
    *(Feature(term.feature, term.work, partial(Drawn.no_term, name=name)) for name, term in TERMS.items()),
    Feature("POWER", "power of highlights", Drawn.no_power),
    Feature(
        "EMISSION",
        "emission",
        lambda d: d.not_pbr or _first((not _any_nonzero(m.microfacets.emission for m in d.materials), "emission is 0")),
    ),
    Feature("ENVIRONMENT", "image-based light", lambda d: d.not_pbr or no_environment(d.scene)),
    Feature(
        "LIGHT_SHAPES",
        "directions, cones and attenuation of lights",
        lambda d: d.no_light(lambda light: not light.is_plain, "only points without attenuation shine"),
    ),
    Feature(
        "AREA_LIGHTS",
        "points of lights of finite size",
        lambda d: d.no_light(lambda light: light.has_size, "no light has a size"),
    ),
    Feature(
        "SHADOWS",
        "shadows",
        lambda d: (
            _first((not d.settings.shadows, "no shadows asked for"))
            or d.no_light(lambda light: True, "no light shines")
            or _first((not d.meshes, "no triangle"))
        ),
    ),
    Feature(
        "SHADOW_ALPHA",
        "shadows of what is not opaque",
        lambda d: _first(
            (bool(d.why("SHADOWS") and d.why("AMBIENT_OCCLUSION")), d.why("SHADOWS")),
            (not casts_alpha(d.scene), "all that casts shadows is opaque"),
        ),
    ),
    Feature(
        "AMBIENT_OCCLUSION",
        "ambient occlusion",
        lambda d: _first(
            (not d.settings.ambient_occlusion, "no ambient occlusion asked for"),
            (bool(d.why("AMBIENT") and d.why("ENVIRONMENT")), d.why("AMBIENT")),
            (not d.meshes, "no triangle"),
        ),
    ),
    Feature(
        "TWO_SIDED",
        "normals turned to the side seen",
        lambda d: d.no_normals or _first((not any(m.material.two_sided for m in d.meshes), "no two-sided material")),
    ),
    Feature(
        "NORMAL_INDICES",
        "indices of normals",
        lambda d: (
            d.no_normals or ("" if any(uses_normal_indices(d.scene, m) for m in d.meshes) else "a normal per vertex")
        ),
    ),
    Feature("VERTEX_COLORS", "colors of vertices", Drawn.no_colors),
    Feature(
        "SCALARS",
        "color map",
        lambda d: _first(
            (d.settings.scalars is None, "no scalars asked for"),
            (not any(shows_scalars(m, d.settings) for m in d.meshes), "no face has the scalars"),
        ),
    ),
    Feature(
        "TEXTURED",
        "texture lookups",
        lambda d: _first((d.at_corners, "texture_at vertex: looked up at the corners")) or d.no_texture,
    ),
    Feature(
        "UV_INDICES",
        "indices of texture coordinates",
        lambda d: d.no_lookup or _first((all(m.uv_faces is None for m in d.meshes), "texture coordinates per vertex")),
    ),
    Feature(
        "MIPMAPS",
        "mip-map levels",
        lambda d: _first(
            (d.no_lookup, d.no_lookup),
            (d.settings.texture_filter == "bilinear", "texture_filter bilinear"),
            (not any(map(_has_levels, d.looked_up)), "textures of one texel or with the course's lookup"),
        ),
    ),
    Feature("ALPHA_TEST", "alpha test", lambda d: _first((not any(m.tests_alpha for m in d.meshes), "no alpha test"))),
    Feature(
        "NEAREST",
        "nearest texels",
        lambda d: (
            d.no_lookup
            or _first((all(t.filter != "nearest" for t in d.looked_up), "no texture with the filter nearest"))
        ),
    ),
    *(Feature(f"{each.name}_MAP", f"{each.words}s", partial(Drawn.no_map, name=name)) for name, each in MAPS.items()),
    Feature(
        "UV_SETS",
        "further texture coordinates",
        lambda d: d.no_lookup or _first((not any(each.coordinates for each in d.looked_up), "one set of coordinates")),
    ),
    Feature(
        "BLEND",
        "transparent surfaces, in exact order",
        lambda d: _first((not any(m.blends for m in d.meshes), "nothing is transparent")),
    ),
    Feature(
        "VERTEX_ALPHA",
        "alpha at vertices",
        lambda d: _first(
            (all(m.alphas is None or not (m.blends or m.tests_alpha) for m in d.meshes), "no alpha at vertices counts")
        ),
    ),
    Feature("MATERIALS", "material per face", lambda d: _first((len(d.materials) < 2, "a single material"))),
    Feature(
        "SIDES",
        "side of each material that is drawn",
        lambda d: _first(
            (d.culls, "all that is seen from behind is culled"),
            (not any(m.sides == "front" for m in d.materials), "both sides of every material are drawn"),
        ),
    ),
    Feature(
        "DOUBLE_POSITIONS",
        "positions in float64",
        lambda d: _first(
            (d.instanced, "instances are placed where they are needed"),
            (not d.double_positions, "float32 holds the positions"),
        ),
    ),
    Feature(
        "BACKGROUND",
        "color of the background",
        lambda d: _first(
            (d.scene.background is None, "no background"),
            (d.settings.background == "environment", "the environment is the background"),
            (not np.any(d.scene.background), "the background is black"),
        ),
    ),
    Feature("OWNERS", "owner of each pixel", lambda d: _first((not d.settings.layers, "no layer asked for"))),
    # Gouraud's shading lights the corners of the sorted triangles; kernels of 16 doubles do not order lists; lines need the
    # clipped triangles before the pixel stage; lists of transparent triangles and of instances are sorted.
    Feature(
        "SORTED",
        "depth sort",
        lambda d: _first(
            (
                d.settings.visibility == "depth"
                and d.shader != "gouraud"
                and d.settings.precision != "float64"
                and d.settings.edges is None
                and not d.needs("BLEND")
                and not d.instanced,
                "the depth test decides",
            )
        ),
    ),
)
CHOICES = tuple(feature.name for feature in FEATURES if not feature.work)
OPTIONAL = tuple(feature.name for feature in FEATURES if feature.work)
COMPILED = tuple(feature.name for feature in FEATURES if feature.compiled)
_BY_NAME = {feature.name: feature for feature in FEATURES}
_BITS = {name: index for index, name in enumerate(feature.name for feature in FEATURES if not feature.compiled)}
# Of features in a row; kernels ask for one or any of them.
GROUPS = {"TERMS": [term.feature for term in TERMS.values()], "MAPS": [f"{each.name}_MAP" for each in MAPS.values()]}


def bit_definitions() -> str:
    """Return OpenCL C that numbers the features that are conditions at run time, for `NEEDS` and `NEEDS_ANY`."""
    lines = [f"#define BIT_{name} {index}\n" for name, index in _BITS.items()]
    for name, group in GROUPS.items():
        bits = [_BITS[each] for each in group]
        lines.append(f"#define FIRST_BIT_{name} {bits[0]}\n#define BITS_{name} {sum(1 << bit for bit in bits)}UL\n")
    return "".join(lines)


@dataclass(frozen=True)
class Features:
    """The features of a frame, name -> 0 or 1, and the reason why each optional one that is 0 is left out."""

    values: tuple[tuple[str, int], ...]
    left_out: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, names: Collection[str] = ()) -> Features:
        """Return those named as 1 and all others as 0."""
        return cls(tuple((feature.name, int(feature.name in names)) for feature in FEATURES))

    @cached_property
    def _table(self) -> dict[str, int]:
        return dict(self.values)

    def __getitem__(self, name: str) -> int:
        return self._table[name]

    @property
    def used(self) -> tuple[str, ...]:
        return tuple(name for name, value in self.values if value)

    @cached_property
    def needs(self) -> int:
        """The member `needs` of structs.Image and structs.View."""
        return sum(1 << bit for name, bit in _BITS.items() if self._table.get(name))

    def compiled(self, names: Collection[str] = COMPILED) -> Features:
        """Return what a program is compiled with, of which it reads `names`: all that is a condition at run time is 0."""
        unread = set(COMPILED).difference(names)
        kept = {name: 0 if name in unread else value for name, value in self.values if name not in _BITS}
        if kept["FAST"] and self._table.get("ALPHA_TEST"):
            kept["FAST"] = 2  # see numerics.clh
        return Features(tuple(kept.items()))

    def including(self, name: str) -> Features:
        """Return the features with an optional one that is not left out."""
        return replace(
            self,
            values=tuple((each, 1 if each == name else value) for each, value in self.values),
            left_out=tuple(reason for reason in self.left_out if reason[0] != name),
        )

    def needs_any(self, group: str) -> bool:
        """Return whether any feature of one of GROUPS is needed."""
        return any(self[name] for name in GROUPS[group])

    def options(self, needs: int = -1) -> list[str]:
        """Return -D options of the OpenCL build. needs: the conditions at run time that are compiled in."""
        left_out = sum(1 << bit for bit in _BITS.values()) & ~needs
        return [*(f"-D{name}={value}" for name, value in self.values), f"-DLEFT_OUT={left_out}UL"]


def needs(word: int, name: str) -> bool:
    """Return whether a member `needs` has a feature's bit."""
    return bool(int(word) >> _BITS[name] & 1)


def looks_up(features: Features) -> bool:
    """Return whether textures are looked up at the pixels."""
    return features.needs_any("MAPS") or any(features[name] for name in ("TEXTURED", "ALPHA_TEST", "BLEND"))


_settings = cache(lambda shader: Settings(shader=shader))
_NOTHING = Scene((), Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), 1.0, (1.0, 1.0)))


def derive_alone(
    shader: Shader, material: Material, ambient: np.ndarray, shining: bool, bright: bool = False
) -> Features:
    """Return the features of a single triangle or point with its own colors: preset `course`, no background.

    bright: whether colors beyond 1 are interpolated.
    """
    drawn = Drawn(_NOTHING, _settings(shader), [material], ambient, shining)
    terms = ("LIT", "AMBIENT", *GROUPS["TERMS"], "POWER", "EMISSION")
    names = [name for name in terms if drawn.needs(name)] + ["CENTROID", "VERTEX_COLORS", "SORTED"]
    return Features.of(names + ["PHONG"] * (shader == "phong") + ["BRIGHT"] * (shader == "phong" and bright))


def derive(
    scene: Scene,
    settings: Settings,
    *,
    double_positions: bool,
    scalars_at_corners: bool = False,
    instanced: bool = False,
    forced: Collection[str] = frozenset(),
) -> Features:
    """Return the features that this scene needs under these settings.

    double_positions: whether positions need float64. scalars_at_corners: whether the scalars that color faces differ
    between faces at a vertex.
    instanced: whether the scene's instances are drawn from one copy of each mesh.
    forced: OPTIONAL features to turn on even if the scene does not need them, to measure what leaving them out saves; the
    image stays the same, bit for bit. All of them together give a kernel for every scene.
    """
    shining = any(light.intensity.any() for light in scene.lights) or shows_environment(scene, settings)
    materials = list(materials_of(scene).values())
    how = double_positions, scalars_at_corners, instanced, forced
    drawn = Drawn(scene, settings, materials, scene.ambient, shining, *how)
    values = {each.name: int(drawn.needs(each.name) if each.work else each.chosen(drawn)) for each in FEATURES}
    left_out = tuple((name, drawn.why(name)) for name in OPTIONAL if not values[name])
    return Features(tuple(values.items()), left_out)


def at_lanes(features: Features, own: int, chosen: int | None) -> Features:
    """Return the features for a device with its own number of lanes, and another one chosen for the pixels. Only with
    vectors do kernels set up faces in their order, and pixel stages order the lists of tiles themselves."""
    return features if min(own, chosen or own) > 1 else features.including("SORTED")
